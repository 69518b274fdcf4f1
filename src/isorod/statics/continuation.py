"""Equilibrium paths beyond limit points and bifurcations: pseudo-arclength continuation.

State and load factor are both unknown; each step ends on the plane at arc length ``s`` along the tangent of the path
(Riks; Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, 1977).  The bordered system is
solved by two solves with one factorisation of the tangent stiffness, whose inertia gives the number of negative
eigenvalues: where it changes, the path has a limit point or a bifurcation.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import BAND, SPARSE, factorisation
from isorod.checks import overlap, rigid_motions
from isorod.checks.turning import Turning
from isorod.errors import InputError, SolveError
from isorod.model.model import Model, unmoved
from isorod.petsc import inertia
from isorod.petsc.banded import is_banded
from isorod.petsc.direct import direct
from isorod.statics.convergence import Convergence, squeezed, worst_place

# Residual allowed, relative to the forces carried; maximum number of corrections of a step, and of its halvings.
RTOL = 1e-9
CORRECTIONS = 12
HALVINGS = 12

# Target number of corrections: with more the step is shortened, with fewer lengthened.
TARGET = 5

# Step of the load factor by which the residual is differenced.
_DELTA = 1e-6

# Relative width of the bracket of a critical load factor in which its eigenvalue is taken as linear.
_BRACKET = 1e-4

# Steps of inverse iteration, and the change of the eigenvalue at which it ends.
_INVERSE = 200
_SETTLED = 1e-9


@dataclass(frozen=True, eq=False)
class Path:
    """Equilibria along a path.

    Attributes
    ----------
    model
        The model.
    factors
        Load factors, shape ``(m,)``.
    displacements
        All degrees of freedom, shape ``(m, dofs)``.
    negative
        Number of negative eigenvalues of the tangent stiffness, 0 where the equilibrium is stable, -1 where the
        factorisation chosen does not count them; shape ``(m,)``.
    corrections, cuts
        Linear solves in all, and steps cut and retried.
    """

    model: Model
    factors: Array
    displacements: Array
    negative: Index
    corrections: int
    cuts: int

    def at(self, node: int, component: str, body: int = 0) -> Array:
        """Return the displacement of a node's coefficient along the path, shape ``(m,)``."""
        return self.displacements[:, 3 * (self.model.first_node[body] + node) + "xyz".index(component)]


@dataclass(frozen=True, eq=False)
class Critical:
    """A point where the tangent stiffness is singular.

    Attributes
    ----------
    factor
        Load factor.
    displacement, mode
        All degrees of freedom there, and of the critical mode (largest entry 1), shape ``(dofs,)``.
    """

    factor: float
    displacement: Array
    mode: Array


def follow(
    model: Model,
    step: float,
    steps: int,
    bounds: tuple[float, float] = (-np.inf, 1.0),
    start: Critical | None = None,
    longest: float | None = None,
    comm: PETSc.Comm | None = None,
) -> Path:
    """Follow the path of equilibria from the unloaded state, or the branch that leaves a critical point.

    Arc length is measured so that the load factor counts as it is, and displacements by their norm: on the path from
    the unloaded state in units of what the initial stiffness would have at load factor 1; on a branch by the root mean
    square over the unknowns in units of the model's largest extent.

    Parameters
    ----------
    model
        Bodies, supports and loads.
    step
        Arc length of the first step.
    steps
        Number of points after the first.
    bounds
        The path ends with the first point whose load factor lies outside.
    start
        Critical point to start at in the direction of its mode; the unloaded state, towards higher load, where not
        given.
    longest
        Longest step; four times the first where not given.

    Raises
    ------
    InputError
        If a number is out of range, or the model has contacts.
    SolveError
        If a rigid motion is free, or a step was halved twelve times in vain.
    """
    if not (np.isfinite(step) and step > 0.0):
        raise InputError(f"arc length: got {step:g}, need a positive step")
    if steps < 1:
        raise InputError(f"steps of the path: got {steps}, need at least 1")
    longest = 4.0 * step if longest is None else longest
    if not longest >= step:
        raise InputError(f"longest step: got {longest:g}, need at least the first, {step:g}")
    path = _Path(model, comm)
    if start is not None:
        path.begin(start)
    smallest = step / 2**HALVINGS
    path.tangent(None if start is None else path.assembler.state(start.mode))
    rows = [path.row()]
    cuts = 0
    while len(rows) <= steps:
        try:
            count = path.advance(step)
        except _Cut as problem:
            cuts += 1
            step *= 0.5
            if step < smallest:
                raise SolveError(f"path, point {len(rows)}, load factor {path.factor:.6g}: {problem}") from None
            continue
        path.tangent()
        rows.append(path.row())
        if not bounds[0] <= path.factor <= bounds[1]:
            break
        step = min(longest, step * float(np.clip(TARGET / max(count, 1), 0.5, 2.0)))
    factors, displacements, negative = zip(*rows, strict=True)
    overlap.warn_in_the_end(model, displacements[-1], 0.0)
    return Path(model, np.array(factors), np.array(displacements), np.array(negative), path.corrections, cuts)


def critical(model: Model, step: float, highest: float = 1.0, comm: PETSc.Comm | None = None) -> Critical:
    """Return the first critical point on the path that starts unloaded, found by the inertia of the tangent stiffness.

    The load grows by ``step`` until an eigenvalue turns negative; bisection and, at the end, linear interpolation of
    that eigenvalue find where.

    Raises
    ------
    SolveError
        If there is none up to the load factor ``highest``, or the path has a limit point before (use `follow`).
    """
    if not (np.isfinite(step) and step > 0.0):
        raise InputError(f"load step: got {step:g}, need a positive number")
    path = _Path(model, comm)
    path.factorise(path.x, 0.0)
    first, low, high = path.negative, _Point(0.0, path.x.copy()), None
    while high is None or high.factor - low.factor > _BRACKET * high.factor:
        if low.factor >= highest:
            raise SolveError(f"no critical point up to load factor {highest:g}")
        path.go_to_point(low)
        longest = min(step, path.turning.longest_step(low.factor))
        path.go_to_factor(min(highest, low.factor + longest) if high is None else 0.5 * (low.factor + high.factor))
        point = _Point(path.factor, path.x.copy())
        if path.negative > first:
            high = point
        else:
            low = point
    values = []
    for point in (low, high):
        path.factorise(point.x, point.factor)
        values.append(path.lowest())
    (stable, mode), (unstable, _) = values
    fraction = stable / (stable - unstable) if stable > 0.0 > unstable else 0.5
    path.go_to_point(low)
    path.x.axpby(fraction, 1.0 - fraction, high.x)
    path.factor += fraction * (high.factor - low.factor)
    factor, displacement, _ = path.row()
    shape = path.assembler.displacement(mode, 0.0)
    return Critical(factor, displacement, shape / shape[np.argmax(np.abs(shape))])


class _Point(NamedTuple):
    factor: float
    x: PETSc.Vec


class _Cut(Exception):
    """A step did not converge."""


class _Path:
    """A point on the path, its tangent, and the solver of the bordered system."""

    def __init__(self, model: Model, comm: PETSc.Comm | None) -> None:
        unmoved(model, "continuation")
        if model.contacts:
            raise InputError("continuation takes no contacts")
        if model.remembers:
            raise InputError("continuation takes no laws with memory")
        rigid_motions.refuse_free(model)
        self.assembler = Assembler(model.in_displacements(), comm)
        self.x, self.factor = self.assembler.vector(), 0.0
        self.matrix = self.assembler.matrix()
        self.convergence = Convergence(self.assembler)
        self.turning = Turning(model)
        self.slope = self.assembler.vector()
        self.residual = self.assembler.vector()
        self.direction, self.rise = self.assembler.vector(), 0.0
        self.weight = 1.0 / (model.unknowns * self.convergence.size**2)
        self.negative = -1
        self.corrections = 0
        # Both have the inertia.
        chosen = factorisation(self.assembler)
        self.ksp = direct(self.matrix, BAND if chosen.get("pc_type") == "python" else SPARSE)
        pc = self.ksp.getPC()
        self._counts = pc.getType() == PETSc.PC.Type.CHOLESKY and pc.getFactorSolverType() == "mumps"
        self._set_up = False

    def begin(self, start: Critical) -> None:
        """Go to a critical point."""
        self.assembler.state(start.displacement).copy(self.x)
        self.factor = start.factor

    def row(self) -> tuple[float, Array, int]:
        """Return load factor, displacements and number of negative eigenvalues."""
        return self.factor, self.assembler.displacement(self.x, self.factor), self.negative

    def factorise(self, x: PETSc.Vec, factor: float) -> None:
        """Set and factorise the tangent, count negative eigenvalues, and difference the residual by the load factor."""
        self.assembler.tangent(x, factor, self.matrix)
        self.assembler.load_forces(x, factor, _DELTA, self.slope)
        self.slope.scale(1.0 / _DELTA)
        self.ksp.setOperators(self.matrix)
        if self._counts and not self._set_up:
            inertia.prepare(self.ksp.getPC())
            self._set_up = True
        self.ksp.setUp()
        if self._counts or is_banded(self.ksp.getPC()):
            self.negative = inertia.count_negative(self.ksp.getPC())

    def solve(self, right: PETSc.Vec) -> PETSc.Vec:
        """Return the solution of the tangent for a right-hand side."""
        result = right.duplicate()
        self.ksp.solve(right, result)
        self.corrections += 1
        return result

    def tangent(self, along: PETSc.Vec | None = None) -> None:
        """Set the unit tangent at the point, in the sense of the last one; or along a given mode at constant load."""
        self.assembler.extrapolate()
        self.factorise(self.x, self.factor)
        if along is not None:
            along.copy(self.direction)
            self.rise = 0.0
        else:
            grown = self.solve(self.slope)
            grown.scale(-1.0)
            first = not self.direction.norm() > 0.0 and self.rise == 0.0
            if first:
                self.weight = 1.0 / max(grown.dot(grown), np.finfo(float).tiny)
            forward = 1.0 if first else self.weight * self.direction.dot(grown) + self.rise
            grown.copy(self.direction)
            self.rise = 1.0
            if forward < 0.0:
                self.direction.scale(-1.0)
                self.rise = -1.0
        length = np.sqrt(self.weight * self.direction.dot(self.direction) + self.rise**2)
        self.direction.scale(1.0 / length)
        self.rise /= length

    def advance(self, step: float) -> int:
        """Go an arc length along the path; return the number of corrections."""
        assembler, x = self.assembler, self.x.copy()
        factor = self.factor + step * self.rise
        x.axpy(step, self.direction)
        before = assembler.jacobians(self.x, self.factor)
        self._refuse_squeezed(before, x, factor)
        for count in range(CORRECTIONS + 1):
            self.convergence.carried_force = assembler.residual(x, factor, self.residual)
            force = self.residual.norm()
            if not np.isfinite(force):
                raise _Cut(worst_place(assembler, x, factor, "an element inverts"))
            if count and self.convergence.reached(self.residual, force, RTOL):
                self._refuse_squeezed(before, x, factor)
                self._refuse_lost(x, factor)
                x.copy(self.x)
                self.factor = factor
                return count
            self.factorise(x, factor)
            self.convergence.update(self.matrix, self.convergence.carried_force)
            back, grown = self.solve(self.residual), self.solve(self.slope)
            offset = x - self.x
            gap = self.weight * self.direction.dot(offset) + self.rise * (factor - self.factor) - step
            below = self.rise - self.weight * self.direction.dot(grown)
            change = (self.weight * self.direction.dot(back) - gap) / below
            if not np.isfinite(change):
                raise _Cut("the bordered system is singular")
            x.axpy(-1.0, back)
            x.axpy(-change, grown)
            factor += change
        raise _Cut(worst_place(assembler, x, factor, f"no convergence after {CORRECTIONS} corrector iterations"))

    def go_to_factor(self, factor: float) -> None:
        """Go to another load factor and set the tangent there."""
        self.direction.zeroEntries()
        self.rise = 1.0
        self.assembler.extrapolate()
        try:
            self.advance(factor - self.factor)
        except _Cut as problem:
            raise SolveError(f"load factor {factor:.6g}: {problem}") from None
        self.factorise(self.x, factor)

    def go_to_point(self, point: "_Point") -> None:
        """Go back to a point."""
        point.x.copy(self.x)
        self.factor = point.factor

    def _refuse_squeezed(self, before: list[Array], x: PETSc.Vec, factor: float) -> None:
        problem = squeezed(self.assembler, before, x, factor)
        if problem is not None:
            raise _Cut(problem)

    def _refuse_lost(self, x: PETSc.Vec, factor: float) -> None:
        if not self.turning.watches:
            return
        ends = sorted((self.factor, factor))
        if ends[1] - ends[0] > self.turning.longest_step(ends[0]) * (1.0 + 1e-9):
            raise _Cut("a support turns by more than a quarter of a turn")
        states = self.assembler.displacement(self.x, self.factor), self.assembler.displacement(x, factor)
        problem = self.turning.lost(*states)
        if problem is not None:
            raise _Cut(problem)

    def lowest(self) -> tuple[float, PETSc.Vec]:
        """Return the tangent's eigenvalue nearest to zero and its vector of unit length, by inverse iteration."""
        vector = self.assembler.vector()
        rows = slice(*vector.getOwnershipRange())
        vector.array_w[:] = np.random.default_rng(1).standard_normal(vector.getSize())[rows]
        value = np.inf
        for _ in range(_INVERSE):
            vector.normalize()
            following = self.solve(vector)
            newer = 1.0 / vector.dot(following)
            vector = following
            if abs(newer - value) <= _SETTLED * abs(newer):
                break
            value = newer
        vector.normalize()
        return float(newer), vector
