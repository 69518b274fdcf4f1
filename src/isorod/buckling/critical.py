"""Load factors at which the tangent of the primary path is singular: Newton's method on its lowest eigenvalues.

At an equilibrium of load factor ``f`` the vibration modes estimate to zero, ``K x = omega^2 M x`` with a unit density,
span the shapes in which ``K(f + mu) = K + mu K'`` may be singular: the projected pencil ``(X^T K X) y = -mu (X^T K' X)
y`` gives ``mu``.  The next equilibrium lies short of that, so as not to leave the path, and errors fall with the square
of ``mu``.  The Sturm count of ``K(f)`` is the number of factors below, and selects the ``mu`` of the target.
"""

from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation
from isorod.buckling.path import Known, PathEnds, Primary
from isorod.buckling.tangents import Tangents
from isorod.errors import SolveError
from isorod.modal.pencil import Eigenpairs, Pencil
from isorod.petsc import inertia

# The next equilibrium is short of the factor by this fraction of the distance to it.
_SHORT = 0.05

# Maximum number of equilibria per factor.
_MOST = 15

# Maximum where a law yields, since its stiffness falls suddenly: the factor is then bracketed to this relative width.
_MOST_FLOWING, _AT_ONCE = 40, 1e-4

# Where the pencil has no factor, the search ends at this multiple of the first load factor.
_FARTHEST = 8.0

# Relative change of a converged factor, and the relative distance from which a factor is accepted.
_SETTLED, _NEAR = 1e-9, 1e-2

# The last equilibrium but one lies at this relative distance from a factor; errors are estimated there, since there is
# no equilibrium on another space at the factor itself.
_APART = 1e-2

# Near a factor the lowest eigenvalue is close to zero, where a shift at zero would leave only rounding of the others:
# it is below zero by this fraction of the first eigenvalue at rest.
_ASIDE = 1e-2

# Vibration modes computed in addition.
_SPARE = 4

# A factor less than this multiple of the distance of a converged one away has converged, too.
_BESIDE = 1.5

# The path bends towards a shape if this fraction of its tangent, squared in the norm of the mass, lies along it.
_BENDS = 0.9
_BEND_NEAR = 0.3

# Alternatives where there is no such factor.
_CURE = "statics with --stable continues, and linear_at takes the factors of a lower load (linear_at = 0: at rest)"

_END = "buckling: no equilibrium beyond load factor {:.6g}, a limit point or too fast a turn ({}); " + _CURE


class Linearised(NamedTuple):
    """The factors estimated at an equilibrium.

    Attributes
    ----------
    factor, x
        Its load factor and its unknowns.
    below
        Number of negative eigenvalues of its tangent.
    offsets
        Load factors of the projected pencil less that one, ``(p,)``, ascending.
    shapes
        Combinations of the modes, ``(modes, p)``.
    modes
        The vibration modes estimate to zero.
    slopes
        Derivatives of their ``omega^2`` with the load factor, ``(modes,)``.
    """

    factor: float
    x: PETSc.Vec
    below: int
    offsets: Array
    shapes: Array
    modes: Eigenpairs
    slopes: Array

    def factor_of(self, number: int) -> tuple[float, Array] | None:
        """Return the offset of a factor by its number, from 0, and its shape; None where it is not known here."""
        ahead, behind = np.flatnonzero(self.offsets > 0.0), np.flatnonzero(self.offsets <= 0.0)[::-1]
        k = number - self.below
        side, k = (ahead, k) if k >= 0 else (behind, -k - 1)
        return (float(self.offsets[side[k]]), self.shapes[:, side[k]]) if k < side.size else None


class Point(NamedTuple):
    """A load factor at which the tangent is singular.

    Attributes
    ----------
    factor
        The load factor.
    x
        Unknowns of the equilibrium there.
    shape
        Buckling shape, on the unknowns.
    loss
        By how much the stiffness ``x^T K x`` of the shape falls with the load factor.
    residual, settled
        Residual of the vibration mode that becomes the shape, and last relative change of the factor; the latter is not
        a number where the path was not followed.
    below
        Sturm count: negative eigenvalues just below the factor, one for each lower factor.
    softer
        Load factor and unknowns of an equilibrium short of the factor, the vibration mode there that becomes the shape,
        its stiffness, and by how much that falls with the load factor; None at rest.
    """

    factor: float
    x: PETSc.Vec
    shape: PETSc.Vec
    loss: float
    residual: float
    settled: float
    below: int
    softer: tuple[float, PETSc.Vec, PETSc.Vec, float, float] | None = None


class Seeker:
    """Looks for load factors along the primary path."""

    def __init__(self, assembler: Assembler, tangents: Tangents, path: Primary, mass: PETSc.Mat) -> None:
        self._assembler, self._tangents, self._path = assembler, tangents, path
        pressures = assembler.unknowns - assembler.model.unknowns
        self.pencil = Pencil(tangents.stiffness, mass, pressures=pressures, factors=factorisation(assembler, "st_"))
        self.equilibria = 0
        self._last: Linearised | None = None
        self._short: Linearised | None = None
        # Distance of the last converged factor from the equilibrium at which it was computed, and its error.
        self._reach = self._doubt = 0.0

    def modes(self, count: int) -> Eigenpairs:
        """Return the lowest vibration modes about the equilibrium of the tangents."""
        return self.pencil.solve(min(count, self.pencil.size), -_ASIDE * self.pencil.floor)

    def linearise(self, place: Known, highest: int) -> Linearised:
        """Return the factors estimated at an equilibrium, up to the number ``highest`` at least."""
        self._tangents.fill(place)
        below = inertia.negative_eigenvalues(self._tangents.stiffness) - self.pencil.pressures
        modes = self.modes(max(below, highest + 1) + _SPARE)
        pushed = [self._tangents.derivative * vector for vector in modes.vectors]
        slopes = np.array([[a.dot(b) for b in modes.vectors] for a in pushed])
        self.equilibria += 1
        # 1 / mu, since the derivative may be singular.
        rates, shapes = np.linalg.eig(-0.5 * (slopes + slopes.T) / modes.eigenvalues[:, None])
        real = (np.abs(rates.imag) <= 1e-9 * np.abs(rates)) & (rates != 0.0)
        offsets, shapes = 1.0 / rates[real].real, shapes[:, real].real
        order = np.argsort(offsets)
        self._reach = 0.0
        self._last = Linearised(place.factor, place.x, below, offsets[order], shapes[:, order], modes, np.diag(slopes))
        return self._last

    def seek(self, number: int, guess: float | None = None) -> Point:
        """Return the load factor by its number, from 0, ascending.

        Without a guess the search starts from the last equilibrium, which another factor was computed from.
        """
        low, high, before, bends, first = 0.0, np.inf, (np.nan, np.nan), 0, None
        factor, farthest = np.nan, 0.0
        ended: PathEnds | None = None
        flows = self._assembler.model.remembers
        for _ in range(_MOST_FLOWING if flows else _MOST):
            if guess is not None:
                try:
                    self.linearise(self._path.at(guess), number)
                except PathEnds as problem:
                    # A factor may lie before the end of the path.
                    ended = problem
                    if not ended.reached > low:
                        raise SolveError(_END.format(ended.reached, ended)) from None
                    self.linearise(self._path.at(ended.reached), number)
            last = self._last
            assert last is not None
            guess = last.factor
            low, high = (guess, high) if last.below <= number else (low, guess)
            if flows and high < np.inf and high - low <= _AT_ONCE * high:
                raise SolveError(
                    f"buckling: there is no factor {number + 1}: it buckles as it yields, at load factor {high:.5g}, "
                    "where the tangent stiffness drops suddenly"
                )
            estimate = last.factor_of(number)
            if estimate is None:
                farthest = farthest or _FARTHEST * guess
                if guess > farthest:
                    raise SolveError(
                        f"buckling: no factor {number + 1} up to {guess:.6g}: the path bends and stiffens; {_CURE}"
                    )
                guess = 0.5 * (low + high) if high < np.inf else 1.5 * guess
                continue
            offset, shape = estimate
            factor = guess + offset
            first = factor if first is None else first
            bends += not flows and last.below == number and offset > abs(before[1])
            if bends > 1 or (0.0 < offset < _BEND_NEAR * guess and self._moves_along(shape)):
                raise SolveError(
                    f"buckling: the path bends before factor {number + 1}, first estimated at {first:.6g}: it has a "
                    f"limit point, or goes aside as an imperfect column does; {_CURE}"
                )
            # Errors fall with the square of the offset.
            if offset > 0.3 * _APART * factor:
                self._short = last
            doubt = abs(factor - before[0]) * (offset / before[1]) ** 2
            if 0.0 < offset <= self._reach:
                # A factor next to a converged one is as accurate.
                doubt = float(np.nanmin((doubt, self._doubt)))
            if 0.0 < offset <= _NEAR * factor and (doubt <= _SETTLED * factor or offset <= _SETTLED**0.5 * factor):
                self._reach, self._doubt = _BESIDE * offset, doubt
                point = self._point(last, number, self._short, doubt / factor)
                assert point is not None
                return point
            before = factor, offset
            guess = factor - max(_SHORT * abs(offset), _APART * factor if abs(offset) > 2.0 * _APART * factor else 0.0)
            if not low < guess < high:
                guess = 0.5 * (low + high) if high < np.inf else 1.5 * low
            if ended is not None and guess >= ended.reached:
                raise SolveError(_END.format(ended.reached, ended))
        raise SolveError(f"buckling: factor {number + 1} does not settle, last {factor:.6g}: the path bends; {_CURE}")

    def linearised_at(self, factor: float, modes: int, more: int) -> list[Point]:
        """Return the factors of the linearisation at the equilibrium of a lower load, with ``more`` modes in addition.

        Raises
        ------
        SolveError
            If there is no such equilibrium, it is not stable, or has no factor.
        """
        try:
            place = self._path.at(factor)
        except PathEnds as problem:
            raise SolveError(_END.format(problem.reached, problem)) from None
        at = self.linearise(place, modes - 1 + more)
        if at.below:
            raise SolveError(f"buckling: linear_at {factor:g} is beyond {at.below} load factors; take a lower one")
        points = [point for point in (self._point(at, k) for k in range(modes)) if point is not None]
        if not points:
            raise SolveError(f"buckling: at linear_at {factor:g} the loads take no stiffness away")
        return points

    def _moves_along(self, shape: Array) -> bool:
        """Return whether the path itself moves along a shape: it bends, and does not bifurcate."""
        mass, rate = self.pencil.mass, self._tangents.rate
        moved = mass * rate
        assert self._last is not None
        along = np.array([moved.dot(mode) for mode in self._last.modes.vectors]) @ shape / np.linalg.norm(shape)
        return bool(along**2 > _BENDS * moved.dot(rate))

    def _point(
        self, at: Linearised, number: int, near: Linearised | None = None, settled: float = np.nan
    ) -> Point | None:
        """Return a factor as estimated at an equilibrium; its error is estimated at another one, short of it."""
        estimate = at.factor_of(number)
        if estimate is None:
            return None
        offset, shape = estimate
        x, vector = at.x.copy(), self._tangents.rate.duplicate()
        x.axpy(offset, self._tangents.rate)
        vector.zeroEntries()
        vector.maxpy(shape, at.modes.vectors)
        loss = float(at.modes.eigenvalues @ shape**2) / offset
        residual = float(at.modes.residuals[np.argmax(np.abs(shape))])
        softer = self._softer(near or at, number)
        return Point(at.factor + offset, x, vector, loss, residual, settled, at.below, softer)

    def _softer(self, at: Linearised, number: int) -> tuple[float, PETSc.Vec, PETSc.Vec, float, float] | None:
        """Return the vibration mode at an equilibrium that becomes a shape (`Point.softer`)."""
        estimate = at.factor_of(number)
        if estimate is None:
            return None
        k = int(np.argmax(np.abs(estimate[1])))
        return at.factor, at.x, at.modes.vectors[k], float(at.modes.eigenvalues[k]), -float(at.slopes[k])
