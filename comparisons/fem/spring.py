"""The spring of Lu & Zhou (2011), section 4.2, solved with dolfinx, and the record of a run."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

from comparisons.fem import compat
from comparisons.fem.domain import Domain
from comparisons.fem.fields import save
from comparisons.fem.material import neo_hookean
from comparisons.fem.statics import DIRECT, FAST, Element, Equilibrium, Held, solve
from isorod import results
from isorod.errors import InputError
from isorod.scenes.spring import Spring
from meshes import spring
from meshes.mesh import Mesh


@dataclass(frozen=True)
class Configuration:
    """A mesh of the spring, an element on it, and how the equations are solved.

    Parameters
    ----------
    cells, around, layers, order, rings, core
        See `meshes.spring.build`; ``order`` None means the order that fits the element.
    degree, quadrature, family
        See `comparisons.fem.statics.Element`.
    solver
        PETSc options; the user's own win.
    matrix
        PETSc matrix type, None for PETSc's default.
    flags
        C compiler flags of the forms.
    """

    cells: str = "bricks"
    around: int = 8
    layers: int = 48
    order: int | None = None
    rings: int = 1
    core: float | None = None
    degree: int = 2
    quadrature: int | str | None = None
    family: str = "Lagrange"
    solver: Mapping[str, object] | None = None
    matrix: str | None = None
    flags: Sequence[str] = FAST

    def __post_init__(self) -> None:
        bricks = self.cells != "tetrahedra"
        if not 1 <= self.degree <= (4 if bricks else 3):
            raise InputError(f"degree: got {self.degree}, need 1 to 4 on bricks, 1 to 3 on tetrahedra")
        if self.family != "Lagrange" and not bricks:
            raise InputError(f"family {self.family}: bricks only; tetrahedra take Lagrange")
        if self.family == "enhanced" and (self.degree, self.geometry_order) != (1, 1):
            raise InputError("family enhanced: it is of degree 1 on bricks of order 1; add --degree 1 --order 1")
        if isinstance(self.quadrature, str) and not bricks:
            raise InputError(f"quadrature {self.quadrature}: bricks only; tetrahedra take a degree")
        if self.quadrature == 0 or (isinstance(self.quadrature, int) and self.quadrature > 20):
            raise InputError(f"quadrature: got degree {self.quadrature}, need 1 to 20")

    @property
    def geometry_order(self) -> int:
        """Order of the mesh: that of the element, at most 2 on tetrahedra; 1 on the paper's mesh."""
        if self.cells == "paper":
            return 1
        if self.order is not None:
            return self.order
        return min(self.degree, 2) if self.cells == "tetrahedra" else self.degree

    def mesh(self) -> Mesh:
        """Return the mesh."""
        return spring.build(self.cells, self.around, self.layers, self.geometry_order, self.rings, self.core)


def domain(configuration: Configuration, comm: MPI.Comm = MPI.COMM_WORLD) -> Domain:
    """Build the mesh on rank 0 and share it out; an `InputError` is raised on every rank."""
    mesh, problem = None, None
    if comm.rank == 0:
        try:
            mesh = configuration.mesh()
        except InputError as error:
            problem = str(error)
    problem = comm.bcast(problem, root=0)
    if problem is not None:
        raise InputError(problem)
    return Domain.distribute(mesh, comm)


def equilibrium(where: Domain, configuration: Configuration) -> Equilibrium:
    """Return the spring's equilibrium: lower end clamped, upper end displaced along the axis."""
    scene = Spring()
    return solve(
        where,
        neo_hookean(scene.E, scene.nu),
        [Held("start"), Held("end", (0.0, 0.0, scene.pull))],
        Element(configuration.degree, configuration.quadrature, configuration.family),
        DIRECT if configuration.solver is None else configuration.solver,
        configuration.flags,
        configuration.matrix,
    )


def run(
    configuration: Configuration, repeat: int = 1, fields: Path | None = None, comm: MPI.Comm = MPI.COMM_WORLD
) -> dict[str, Any]:
    """Solve ``repeat`` times in this process and return the record, the same on every rank.

    The last solution's stress and displacement go to the file ``fields`` if one is named.

    ``seconds`` holds the median of the warm runs (all but the first), or the only run.  Each part is the slowest rank's.
    """
    start = perf_counter()
    where = domain(configuration, comm)
    meshing = perf_counter() - start
    runs: list[dict[str, float]] = []
    for _ in range(repeat):
        comm.Barrier()
        start = perf_counter()
        found = equilibrium(where, configuration)
        parts = found.seconds | {"total": perf_counter() - start}
        runs.append({name: comm.allreduce(value, op=MPI.MAX) for name, value in parts.items()})
    if fields is not None:
        save(found, fields)
    warm = runs[1:] or runs
    median = {name: statistics.median(one[name] for one in warm) for name in runs[0]}
    rule = Element(configuration.degree, configuration.quadrature).rule(where.shape)
    record = {
        "scene": "spring",
        "analysis": "statics",
        "method": "fem",
        "force": float(found.reactions[1, 2]),
        "dofs": found.dofs,
        "cells": where.cells,
        "newton_iterations": found.newton_iterations,
        "linear_iterations": found.linear_iterations,
        "residual_norms": found.residual_norms,
        "seconds": {"mesh": meshing} | median,
        "warm": repeat > 1,
        "runs": runs,
        "options": asdict(configuration)
        | {"order": configuration.geometry_order, "quadrature": rule, "flags": list(configuration.flags)},
        "petsc_options": found.options,
        "ranks": comm.size,
        "peak_memory": found.peak_memory,
        **results.provenance(),
    }
    record["versions"] |= {"dolfinx": compat.version, "petsc": ".".join(map(str, PETSc.Sys.getVersion()))}
    return record
