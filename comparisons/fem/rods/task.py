"""The problem that finite elements of rods solve, and the fields common to equilibria and motions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

from comparisons.fem.rods.elements import Elements
from comparisons.fem.rods.solution import Solution
from comparisons.fem.rods.supports import Supports
from comparisons.fem.statics import NEWTON, Newton
from comparisons.measure.timing import Clock, peak_memory
from isorod.files.solid import OfBody
from isorod.model.model import Model
from meshes.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Task:
    """A model on a mesh, and how its equations are assembled and solved.

    Attributes
    ----------
    rule
        Degree of the quadrature.
    model, mesh, options, flags, bodies, comm
        See `comparisons.fem.rods.solve`.
    """

    model: Model
    mesh: Mesh
    rule: int
    options: Mapping[str, object] | None
    flags: Sequence[str]
    bodies: Sequence[OfBody]
    comm: MPI.Comm

    def elements(self, mixed: Sequence[int] = ()) -> Elements:
        """Return the mesh in dolfinx; pressures of the rods ``mixed`` are unknowns too."""
        return Elements(self.mesh, [body.space.rod for body in self.model.bodies], mixed, self.comm)

    def newton(self, direct: Mapping[str, object]) -> dict[str, object]:
        """Return the options of Newton's method, with a direct solver where none was given."""
        return NEWTON | dict(direct if self.options is None else self.options)

    def solved(
        self,
        analysis: str,
        elements: Elements,
        supports: Supports,
        newton: Newton,
        clock: Clock,
        **more: Any,
    ) -> Solution:
        """Return the solution that Newton's method has reached; ``more`` are its fields that differ by analysis."""
        return Solution(
            model=self.model,
            mesh=self.mesh,
            analysis=analysis,
            cell_parameters=elements.parameters,
            seconds=clock.seconds | {"assembly": newton.seconds, "solve": clock.seconds["solve"] - newton.seconds},
            dofs=elements.dofs,
            unknowns=supports.free,
            peak_memory=self.comm.allreduce(peak_memory(), op=MPI.MAX),
            bodies=self.bodies,
            **more,
        )


def typed() -> dict[str, str]:
    """Return the PETSc options in force."""
    return dict(PETSc.Options().getAll())
