"""Static equilibrium: SNES with load continuation."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.checks import hourglass, rigid_motions
from isorod.checks.reactions import check as check_balance
from isorod.errors import SolveError
from isorod.model.model import Model
from isorod.options import defaults
from isorod.petsc import banded
from isorod.petsc.matrix import solver_types
from isorod.statics.convergence import Balance, squeezed

if TYPE_CHECKING:
    from isorod.contact.result import ContactResult

# Preconditioners that ask for the rigid motions.
MULTIGRID = ("gamg", "ml", "hypre")

# Share of a load step by which the residual is differentiated where supports turn.
_DELTA = 1e-6

# A load step is halved at most this many times.
HALVINGS = 10

# Multipliers of the augmented Lagrangian are updated at most this many times.
AUGMENTATIONS = 50

# What a user's option overrides.
OPTIONS = {"snes_linesearch_type": "basic", "snes_rtol": 1e-9, "snes_max_it": 15, "ksp_type": "preonly"}
# The tangent of rods is banded in the numbering along the axis; where nothing else is typed, LAPACK factorises the band.
BAND: dict[str, object] = {"pc_type": "python", "pc_python_type": banded.NAME}
# PETSc's own factors, typed or of a tangent that is not symmetric: natural ordering fills nothing in.  Where the band is wide, a
# supernodal factorisation wins all the same (measured: they meet at about 150 unknowns an element).
ROWS: dict[str, object] = {
    "pc_type": "lu",
    "pc_factor_mat_ordering_type": "natural",
    # PETSc's own bound is absolute: a modulus of 1e-12 would be refused.
    "pc_factor_zeropivot": 1e-300,
}
SPARSE: dict[str, object] = {"pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}
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
    linear_iterations
        Iterations of the linear solver in all those solves (one each where it is direct).
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
    contacts
        Outcome of each contact of the model.
    augmentations
        Updates of the multipliers of contact.
    pressures
        Pressure coefficients of each body, ``(layers, count)`` of its `isorod.space.pressure.Pressures`, or None; empty if no body is mixed.
    moments
        Moment of each support on the model about the mean of its nodes' present positions, shape ``(supports, 3)``.
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
    contacts: "Sequence[ContactResult]" = ()
    augmentations: int = 0
    linear_iterations: int = 0
    pressures: "Sequence[Array | None]" = ()
    moments: Array = field(default_factory=lambda: np.zeros((0, 3)))


def factorisation(assembler: Assembler, prefix: str = "", symmetric: bool = True) -> dict[str, object]:
    """Return the options of the direct solver that suits a model: `isorod.petsc.banded` where its matrices are, else MUMPS.

    Where a factorisation is typed, its ordering; where another preconditioner is, there are none: it may take some of them for its own.
    """
    typed = PETSc.Options().getAll()
    own = any(name.startswith(f"{prefix}pc_") or name == "mat_type" for name in typed)
    if typed.get(f"{prefix}pc_type", "lu") not in ("lu", "cholesky"):
        return {}
    width = max(3 * body.space.element_nodes.shape[1] for body in assembler.model.bodies)
    # Contact couples bodies, which are far from each other in the numbering.
    # The mixed formulation's tangent is indefinite and needs pivots.
    plain = assembler.contact is None and not _is_mixed(assembler.model) and assembler.comm.getSize() == 1
    if plain and symmetric and not own and banded.suits(assembler.model):
        chosen = BAND
    else:
        chosen = ROWS if plain and width <= WIDE else SPARSE
    return {f"{prefix}{name}": value for name, value in chosen.items()}


def _assembler(model: Model, comm: PETSc.Comm | None) -> Assembler:
    if not _is_mixed(model):
        return Assembler(model, comm)
    from isorod.assembly.mixed import MixedAssembler

    return MixedAssembler(model, comm)


def _is_mixed(model: Model) -> bool:
    return any(body.formulation == "mixed" for body in model.bodies)


class _Diverged(Exception):
    """A load step did not converge."""


def solve(model: Model, load_steps: int = 1, comm: PETSc.Comm | None = None) -> Equilibrium:
    """Bring supports and loads to their full values and return the equilibrium.

    Each load step starts with a predictor, linear from the last equilibrium or, once there are two, the cubic through both with their
    tangents, then SNES (`isorod.statics.convergence` says when it has converged).  A step in which SNES diverges, an element inverts
    (``det F <= 0``) or loses most of its volume is halved and tried again; after quick steps the step doubles.  Where a contact
    says how deep a point may penetrate, multipliers are added at the end until none is deeper (Uzawa's augmented Lagrangian).

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
        ``det F``; or penetration does not fall to what the contact asks for.
    """
    start = perf_counter()
    rigid_motions.refuse_free(model)
    solver = _Newton(_assembler(model, comm))
    try:
        return _solve(solver, load_steps, start)
    finally:
        solver.destroy()


def _solve(solver: "_Newton", load_steps: int, start: float) -> Equilibrium:
    assembler = solver.assembler
    model = assembler.model
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
    augmentations = _augment(solver)
    reactions = np.zeros((max(len(model.supports), 1), 3))
    forces = assembler.reactions(solver.x, 1.0)
    # Only functions that add up to one take part in the virtual work of a translation.
    carried = model.carries[model.bound // 3]
    np.add.at(reactions, (model.support_of[carried], model.bound[carried] % 3), forces[carried])
    displacement = assembler.displacement(solver.x, 1.0)
    moments = _moments(model, displacement, forces)
    rtol = solver.snes.getTolerances()[0]
    check_balance(assembler, solver.x, displacement, reactions, moments, solver.norms[-1], rtol)
    assembly = assembler.seconds
    seconds = {"setup": setup, "assembly": assembly, "solve": perf_counter() - start - setup - assembly}
    if hourglass.suspected(model):
        begin = perf_counter()
        hourglass.check_energy(model, displacement, assembler.energy(solver.x, 1.0), assembler.comm)
        seconds["check"] = perf_counter() - begin
    return Equilibrium(
        model=model,
        displacement=displacement,
        reactions=reactions,
        moments=moments,
        load_steps=steps,
        cuts=cuts,
        newton_iterations=solver.iterations,
        linear_iterations=solver.linear_iterations,
        residual_norms=solver.norms,
        seconds=seconds,
        built=assembler.built,
        solver=solver_types(solver.snes),
        ranks=assembler.comm.getSize(),
        contacts=() if assembler.contact is None else assembler.contact.results(displacement),
        augmentations=augmentations,
        pressures=assembler.pressures(solver.x),
    )


def _moments(model: Model, displacement: Array, forces: Array) -> Array:
    """Return each support's moment: the work of its nodal forces on a rotation, in which coefficients turn like positions."""
    nodal = np.zeros((model.dofs // 3, 3))
    nodal.ravel()[model.bound] = forces
    owner = np.full(model.dofs, -1)
    owner[model.bound] = model.support_of
    places = np.concatenate([body.space.positions for body in model.bodies]) + displacement.reshape(-1, 3)
    result = np.zeros((max(len(model.supports), 1), 3))
    for k in range(len(model.supports)):
        mine = (owner.reshape(-1, 3) == k).any(axis=1)
        carries = mine & model.carries
        if not carries.any():
            continue
        arms = places - model.carries[:, None] * places[carries].mean(axis=0)
        own = np.where(owner.reshape(-1, 3) == k, nodal, 0.0)
        result[k] = np.cross(arms[mine], own[mine]).sum(axis=0)
    return result


def _augment(solver: "_Newton") -> int:
    """Update the multipliers of contact at the full load until penetrations are as asked for; return how often."""
    contact = solver.assembler.contact
    if contact is None:
        return 0
    for count in range(AUGMENTATIONS):
        excess = contact.augment(solver.assembler.displacement(solver.x, 1.0))
        if excess is None:
            return count
        try:
            solver.advance(1.0, 1.0)
        except _Diverged as problem:
            raise SolveError(f"augmented Lagrangian, update {count + 1}: {problem}") from None
    raise SolveError(f"{excess} after {AUGMENTATIONS} updates of the multipliers; raise the penalty")


class _Past(NamedTuple):
    """The equilibrium before the last: how much lower its load factor was, its state, and the path's slope there."""

    step: float
    x: PETSc.Vec
    rate: PETSc.Vec


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
        self.balance = Balance(assembler)
        self._history: _Past | None = None
        self._rate = self.change
        self.iterations = 0
        self.linear_iterations = 0
        self.norms: list[float] = []
        self._stage = PETSc.Log.Stage("solve")
        with defaults(OPTIONS | factorisation(assembler)) as typed:
            self.snes = PETSc.SNES().create(assembler.comm)
            self.snes.setFunction(self._residual, assembler.vector())
            self.snes.setJacobian(self._tangent, self.matrix)
            self.snes.setMonitor(lambda snes, k, norm: self.norms.append(norm))
            self.snes.setFromOptions()
            if self.snes.getKSP().getPC().getType() in MULTIGRID:
                self.matrix.setNearNullSpace(assembler.near_null_space())
            self._own_tolerance = "snes_atol" not in typed
            self._may_reuse = self._own_tolerance and not PETSc.Options().hasName("snes_test_jacobian")
            if self._own_tolerance:
                self.snes.setConvergenceTest(self.balance.test)

    def destroy(self) -> None:
        """Give back matrix, factors and work vectors, which SNES and this object, each holding the other, would keep for long."""
        for one in (self.snes, self.matrix, self.trial, self.force, self.change):
            one.destroy()

    def _residual(self, snes: PETSc.SNES, x: PETSc.Vec, out: PETSc.Vec) -> None:
        self.assembler.residual(x, self.factor, out)

    def _tangent(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        # The last tangent, with its factors, may be good enough for the last iteration.
        own = self._may_reuse and snes.handle == self.snes.handle and P.handle == self.matrix.handle
        if not (own and len(self.norms) > 1 and self.balance.reuses_tangent(self.norms[-2], self.norms[-1], snes)):
            self.assembler.tangent(x, self.factor, P)
        if J.handle != P.handle:
            J.assemble()

    def advance(self, factor: float, target: float) -> int:
        """Go from the equilibrium at ``factor`` to the one at ``target``; return the number of linear solves."""
        self._stage.push()
        try:
            return self._advance(factor, target)
        finally:
            self._stage.pop()

    def _advance(self, factor: float, target: float) -> int:
        assembler, snes = self.assembler, self.snes
        assembler.extrapolate()
        matrices = assembler.tangent(self.x, factor, self.matrix, keep=True)
        # A cubic predictor takes the path's slope, the first step the whole way of supports that turn.
        share = 1.0 if self._history is None else _DELTA
        assembler.load_forces(self.x, factor, matrices, share * (target - factor), self.force)
        self.force.scale(1.0 / share)
        del matrices
        scale = self.force.norm()
        ksp = snes.getKSP()
        ksp.setOperators(self.matrix)
        ksp.solve(self.force, self.change)
        self.iterations += 1
        self.linear_iterations += ksp.getIterationNumber()
        if ksp.getConvergedReason() < 0 or not np.isfinite(self.change.norm()):
            advice = {"ksp_type": "preonly", **(SPARSE if _is_mixed(assembler.model) else {"pc_type": "lu"})}
            raise SolveError(
                f"the linear solver failed at load factor {factor:.6g} (KSP reason {ksp.getConvergedReason()}): a free rigid "
                f"motion is not held, or the preconditioner does not fit (try {' '.join(f'-{k} {v}' for k, v in advice.items())})"
            )
        self.trial.waxpy(-1.0, self.change, self.x)
        if self._bend(target - factor):
            # The extrapolated stress belongs to a straight step.
            assembler.extrapolate()
        self.factor = target
        before = assembler.jacobians(self.x, factor)
        self._refuse_squeezed(before)
        self.norms = [scale]
        if self._own_tolerance:
            self.balance.update(self.matrix, scale)
        snes.solve(None, self.trial)
        its = snes.getIterationNumber()
        self.iterations += its
        self.linear_iterations += snes.getLinearSolveIterations()
        if snes.getConvergedReason() < 0:
            det, body, element, u = assembler.smallest_jacobian(self.trial, target)
            at = f"element {element} of body {body}, axis position u = {u:.4g}: det F = {det:.3g}"
            why = "an element inverts" if not det > 0.0 else f"SNES diverged (reason {snes.getConvergedReason()})"
            if snes.getConvergedReason() == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
                why = f"the linear solver does not converge (KSP reason {ksp.getConvergedReason()})"
            raise _Diverged(f"{why} however small the load step; worst place: {at}{hourglass.hint(assembler.model)}")
        self._refuse_squeezed(before)
        self._history = _Past(target - factor, self.x.copy(), self._rate)
        self.trial.copy(self.x)
        return its + 1

    def _bend(self, step: float) -> bool:
        """Make the predictor follow the curve of the path, by the cubic through the last two equilibria with their tangents."""
        self._rate = self.change.copy()
        self._rate.scale(-1.0 / step if step else 0.0)
        if self._history is None or not step or self.assembler.contact is not None:
            return False
        length, past, slope = self._history
        gap = past - self.x
        gap.axpy(length, self._rate)
        turn = slope - self._rate
        turn.scale(length)
        share = step / length
        # x + v t + a t^2 + b t^3 with the values and slopes of both ends.
        gap.scale(3.0 * share**2 + 2.0 * share**3)
        gap.axpy(share**2 + share**3, turn)
        if not gap.norm() <= self.change.norm():
            return False
        self.trial.axpy(1.0, gap)
        return True

    def _refuse_squeezed(self, before: list[Array]) -> None:
        problem = squeezed(self.assembler, before, self.trial, self.factor)
        if problem is not None:
            raise _Diverged(problem)
