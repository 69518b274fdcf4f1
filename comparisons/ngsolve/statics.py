"""Static equilibrium with NGSolve by Newton's method.

What was tried and is slower: the BFGS formula upon the first tangent (33 forces take longer than 3 tangents), stress as
the derivative of the energy in place of its variation, UMFPACK.  Compiling the energy to machine code would save a
tenth of the assembly, but NGSolve keeps no such code: it takes 8 s a run.
"""

from dataclasses import dataclass
from typing import Any

import ngsolve
import numpy as np

from comparisons.measure.timing import Clock
from comparisons.ngsolve.space import INVERSE, displacements, measure
from isorod.errors import SolveError
from isorod.material import NeoHookean
from meshes.mesh import Array

# As SNES of `comparisons.fem` has them: residual over the first one, and iterations.
_RTOL, _ITERATIONS = 1e-9, 15


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A static solution.

    Attributes
    ----------
    reactions
        Force of each support on the body, shape ``(2, 3)``: of the start, and of the end.
    dofs, iterations, residual_norms
        Number of degrees of freedom, held ones included; of steps; norm of the residual before each.
    seconds
        ``forms``, ``setup``, ``assembly`` and ``solve``.
    """

    reactions: Array
    dofs: int
    iterations: int
    residual_norms: list[float]
    seconds: dict[str, float]


def neo_hookean(young: float, poisson: float, F: Any) -> Any:
    """Return the stored energy of `isorod.material.NeoHookean`, per volume."""
    law = NeoHookean(young, poisson)
    log = ngsolve.log(ngsolve.Det(F))
    return 0.5 * law.mu * (ngsolve.InnerProduct(F, F) - 2.0 * log - 3.0) + 0.5 * law.lame * log**2


def solve(
    mesh: ngsolve.Mesh,
    material: tuple[float, float],
    pull: float,
    degree: int,
    family: str,
    rule: int | str,
) -> Equilibrium:
    """Return the equilibrium of a neo-Hookean body whose ``start`` is clamped and ``end`` moved along z.

    Parameters
    ----------
    material
        Young's modulus and Poisson's ratio.
    pull
        Displacement of the end.
    degree, family, rule
        See `comparisons.ngsolve.space`.
    """
    clock = Clock()
    space = displacements(mesh, degree, family, "start|end")
    body = measure(mesh, rule)
    u = space.TrialFunction()
    clock.lap("setup")
    form = ngsolve.BilinearForm(space, symmetric=True)
    form += ngsolve.Variation(neo_hookean(*material, ngsolve.Id(3) + ngsolve.Grad(u)).Compile() * body)
    clock.lap("forms")
    state, moved = ngsolve.GridFunction(space), ngsolve.GridFunction(space)
    moved.Set(ngsolve.CF((0.0, 0.0, pull)), definedon=mesh.Boundaries("end"))
    clock.lap("setup")
    newton = _Newton(form, state, clock)
    newton.run(moved.vec)
    reactions = np.array([_force(space, newton.residual, mesh.Boundaries(name)) for name in ("start", "end")])
    clock.lap("solve")
    return Equilibrium(reactions, 3 * space.ndof, len(newton.norms) - 1, newton.norms, clock.seconds)


class _Newton:
    """Steps to a vanishing residual on the free unknowns; the first one lifts what the supports prescribe."""

    def __init__(self, form: Any, state: Any, clock: Clock) -> None:
        self.form, self.state, self.clock = form, state.vec, clock
        self.residual, self.step = state.vec.CreateVector(), state.vec.CreateVector()
        self.nodes = state.space.FreeDofs()
        self.free = np.repeat(np.array(list(self.nodes), dtype=bool), 3)
        self.inverse: Any = None
        self.norms: list[float] = []

    def run(self, moved: Any) -> None:
        """Solve from rest."""
        self._factorise()
        # At rest only the prescribed displacements cause forces.
        self.residual.data = self.form.mat * moved
        self._note()
        self.step.data = self.inverse * self.residual
        self.state.data = moved - self.step
        self._evaluate()
        while not self._done():
            self._factorise()
            self.step.data = self.inverse * self.residual
            self.state.data -= self.step
            self._evaluate()

    def _factorise(self) -> None:
        self.clock.lap("solve")
        self.form.AssembleLinearization(self.state)
        self.clock.lap("assembly")
        if self.inverse is None:
            self.inverse = self.form.mat.Inverse(self.nodes, inverse=INVERSE)
        else:
            # The order of elimination stays.
            self.inverse.Update()

    def _evaluate(self) -> None:
        self.clock.lap("solve")
        self.form.Apply(self.state, self.residual)
        self.clock.lap("assembly")
        self._note()

    def _note(self) -> None:
        self.norms.append(float(np.linalg.norm(self.residual.FV().NumPy()[self.free])))

    def _done(self) -> bool:
        if not np.isfinite(self.norms[-1]) or len(self.norms) > _ITERATIONS:
            raise SolveError(f"Newton's method diverged after {len(self.norms) - 1} steps; take a finer rule or mesh")
        return self.norms[-1] <= _RTOL * self.norms[0]


def _force(space: ngsolve.H1, residual: Any, face: ngsolve.Region) -> Array:
    """Return the residual's work on unit translations of a face: its vertices' functions add up to one."""
    nodes = np.flatnonzero(np.array(list(space.GetDofs(face)), dtype=bool))
    corners = nodes[nodes < space.mesh.nv]
    return residual.FV().NumPy().reshape(-1, 3)[corners].sum(axis=0)
