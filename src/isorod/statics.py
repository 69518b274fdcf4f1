"""Static equilibrium: SNES with load continuation."""

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from petsc4py import PETSc

from isorod import rigid
from isorod.assembly import Assembler
from isorod.disk import Array
from isorod.errors import SolveError
from isorod.model import Model
from isorod.options import defaults

# Preconditioners that ask for the rigid motions.
MULTIGRID = ("gamg", "ml", "hypre")

# Out-of-balance force, relative to stiffness times size, that is taken for rounding.
ROUNDING = 1e-15

# A load step is halved at most this many times.
HALVINGS = 10

# What a user's option overrides.
OPTIONS = {"snes_linesearch_type": "basic", "snes_rtol": 1e-9, "snes_max_it": 15, "ksp_type": "preonly"}
# The tangent is banded in the numbering along the axis: natural ordering fills nothing in.  Where the band is wide, a
# supernodal factorisation wins all the same (measured: they meet at about 150 unknowns an element).
BANDED = {"pc_type": "lu", "pc_factor_mat_ordering_type": "natural"}
SPARSE = {"pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}
WIDE = 150


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A static solution.

    Attributes
    ----------
    model
        What was solved.
    displacement
        All degrees of freedom, shape ``(dofs,)``, on every rank.
    reactions
        Force of each support on the model, shape ``(supports, 3)``.
    load_steps, cuts, newton_iterations
        Steps taken, steps cut and retried, and linear solves in all (each step's predictor counted).
    residual_norms
        Norms of the out-of-balance force in the last load step: before the predictor, then at each SNES iteration.
    seconds
        ``setup``, ``assembly`` and ``solve``, wall time.
    built
        Operators that were built.
    solver
        Types of SNES, KSP, PC and factorisation used.
    ranks
        Number of MPI ranks.
    """

    model: Model
    displacement: Array
    reactions: Array
    load_steps: int
    cuts: int
    newton_iterations: int
    residual_norms: list[float]
    seconds: dict[str, float]
    built: list[str]
    solver: dict[str, str]
    ranks: int


class _Diverged(Exception):
    """A load step did not converge."""


def solve(model: Model, load_steps: int = 1, comm: PETSc.Comm | None = None) -> Equilibrium:
    """Bring the supports to their displacements and return the equilibrium.

    Each load step starts with the linear predictor of the tangent at the last equilibrium, then SNES.  A step in which SNES
    diverges or an element inverts (``det F <= 0``) is halved and tried again; after quick steps the step doubles.

    Parameters
    ----------
    model
        Bodies and supports; the supports must leave no rigid motion free.
    load_steps
        Number of equal steps to start with.

    Raises
    ------
    SolveError
        If a rigid motion is free, or a step was halved ten times in vain: the message names element, axis position and
        ``det F``.
    """
    start = perf_counter()
    loose = rigid.free_motions(model)
    if loose:
        body, motion = loose[0]
        how = rigid.describe(model.bodies[body].space, motion)
        raise SolveError(f"supports: body {body} is free to {how}; hold it")
    assembler = Assembler(model, comm)
    solver = _Newton(assembler)
    setup = perf_counter() - start
    assembler.seconds = 0.0
    factor, step, steps, cuts = 0.0, 1.0 / load_steps, 0, 0
    smallest = step / 2**HALVINGS
    while factor < 1.0:
        target = 1.0 if factor + step > 1.0 - 1e-12 else factor + step
        try:
            iterations = solver.advance(factor, target)
        except _Diverged as problem:
            cuts += 1
            step = 0.5 * (target - factor)
            if step < smallest:
                raise SolveError(f"load factor {target:.6g}: {problem}") from None
            continue
        factor = target
        steps += 1
        if iterations <= 4:
            step *= 2.0
    reactions = np.zeros((max(len(model.supports), 1), 3))
    forces = assembler.reactions(solver.x, 1.0)
    # Only functions that add up to one take part in the virtual work of a translation.
    carried = model.carries[model.held // 3]
    np.add.at(reactions, (model.support_of[carried], model.held[carried] % 3), forces[carried])
    displacement = assembler.displacement(solver.x, 1.0)
    assembly = assembler.seconds
    seconds = {"setup": setup, "assembly": assembly, "solve": perf_counter() - start - setup - assembly}
    return Equilibrium(
        model=model,
        displacement=displacement,
        reactions=reactions,
        load_steps=steps,
        cuts=cuts,
        newton_iterations=solver.iterations,
        residual_norms=solver.norms,
        seconds=seconds,
        built=assembler.built,
        solver=solver.types(),
        ranks=assembler.comm.getSize(),
    )


class _Newton:
    """SNES on an assembler, at one load factor after the other."""

    def __init__(self, assembler: Assembler) -> None:
        self.assembler = assembler
        self.x = assembler.vector()
        self.trial = assembler.vector()
        self.force = assembler.vector()
        self.change = assembler.vector()
        self.matrix = assembler.matrix()
        self.factor = 0.0
        spaces = [body.space for body in assembler.model.bodies]
        self.size = max(float(np.ptp(space.positions[space.carries], axis=0).max()) for space in spaces)
        self.iterations = 0
        self.norms: list[float] = []
        self._stage = PETSc.Log.Stage("solve")
        width = max(3 * body.space.element_nodes.shape[1] for body in assembler.model.bodies)
        banded = assembler.comm.getSize() == 1 and width <= WIDE
        with defaults(OPTIONS | (BANDED if banded else SPARSE)) as typed:
            self.snes = PETSc.SNES().create(assembler.comm)
            self.snes.setFunction(self._residual, assembler.vector())
            self.snes.setJacobian(self._tangent, self.matrix)
            self.snes.setMonitor(lambda snes, k, norm: self.norms.append(norm))
            self.snes.setFromOptions()
            if self.snes.getKSP().getPC().getType() in MULTIGRID:
                self.matrix.setNearNullSpace(assembler.near_null_space())
            self._own_tolerance = "snes_atol" not in typed

    def _residual(self, snes: PETSc.SNES, x: PETSc.Vec, out: PETSc.Vec) -> None:
        self.assembler.residual(x, self.factor, out)

    def _tangent(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        self.assembler.tangent(x, self.factor, P)
        if J.handle != P.handle:
            J.assemble()

    def types(self) -> dict[str, str]:
        """Return the names of the solvers at work."""
        ksp = self.snes.getKSP()
        pc = ksp.getPC()
        names = {"snes": self.snes.getType(), "ksp": ksp.getType(), "pc": pc.getType()}
        if pc.getType() in ("lu", "cholesky"):
            names["factor"] = pc.getFactorSolverType()
        return names

    def advance(self, factor: float, target: float) -> int:
        """Go from the equilibrium at ``factor`` to the one at ``target``; return the number of linear solves."""
        self._stage.push()
        try:
            return self._advance(factor, target)
        finally:
            self._stage.pop()

    def _advance(self, factor: float, target: float) -> int:
        assembler, snes = self.assembler, self.snes
        matrices = assembler.tangent(self.x, factor, self.matrix)
        assembler.load_forces(self.x, factor, matrices, target - factor, self.force)
        del matrices
        scale = self.force.norm()
        ksp = snes.getKSP()
        ksp.setOperators(self.matrix)
        ksp.solve(self.force, self.change)
        self.iterations += 1
        if ksp.getConvergedReason() < 0 or not np.isfinite(self.change.norm()):
            raise SolveError(
                f"the linear solver failed at load factor {factor:.6g} (KSP reason {ksp.getConvergedReason()}): a free rigid "
                "motion is not held, or the preconditioner does not fit (try -ksp_type preonly -pc_type lu)"
            )
        self.trial.waxpy(-1.0, self.change, self.x)
        self.factor = target
        self.norms = [scale]
        if self._own_tolerance:
            rtol = snes.getTolerances()[0]
            # Forces are not known better than rounding of the deformation gradient, which is near one, lets them be.
            rounding = ROUNDING * self.size * self.matrix.norm(PETSc.NormType.INFINITY)
            snes.setTolerances(atol=max(rtol * scale, rounding))
        snes.solve(None, self.trial)
        its = snes.getIterationNumber()
        self.iterations += its
        if snes.getConvergedReason() < 0:
            det, body, element, u = assembler.smallest_jacobian(self.trial, target)
            at = f"element {element} of body {body}, axis position u = {u:.4g}: det F = {det:.3g}"
            why = "an element inverts" if not det > 0.0 else f"SNES diverged (reason {snes.getConvergedReason()})"
            raise _Diverged(f"{why} however small the load step; worst place: {at}")
        self.trial.copy(self.x)
        return its + 1
