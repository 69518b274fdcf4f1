"""Load factors at which the tangent of the primary path is singular: Newton's method on its lowest eigenvalues.

At an equilibrium of load factor ``f`` the vibration modes nearest to zero, ``K x = omega^2 M x`` with a unit density,
span the shapes in which ``K(f + mu) = K + mu K'`` may be singular: a small pencil ``(X^T K X) y = -mu (X^T K' X) y``
tells ``mu``.  The next equilibrium lies short of that, so that nothing leads off the path, and errors fall with the
square of ``mu``.  The Sturm count of ``K(f)`` says how many factors lie below, and so which of the ``mu`` is wanted.
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

# The next equilibrium is short of the factor by this share of the way.
_SHORT = 0.05

# Equilibria from which a factor is sought at most.
_MOST = 15

# So many of what yields, whose stiffness falls at once: then the factor lies between two that differ by this share.
_MOST_FLOWING, _AT_ONCE = 40, 1e-4

# Where no factor is in sight it is looked for up to so many times the first load factor.
_FARTHEST = 8.0

# Relative changes of a factor that are none, and the relative way to a factor from which it is told.
_SETTLED, _NEAR = 1e-9, 1e-2

# The last equilibrium but one lies this far (relative) from a factor; errors are estimated there, since at the factor
# an equilibrium on another space is not to be had.
_APART = 1e-2

# The shift is this share of the first eigenvalue at rest below zero, where the lowest one is next to a factor: the
# others would drown in it.
_ASIDE = 1e-2

# Vibration modes besides those that are wanted.
_SPARE = 4

# Factors that are told from less than so many times the distance of one that has settled have done so, too.
_BESIDE = 1.5

# The path's own motion has this share along a shape (its root in the norm of mass) where it bends towards that.
_BENDS = 0.9
_BEND_NEAR = 0.3

# What else can be asked where there is no such factor.
_CURE = "statics with --stable goes on, and linear_at takes the factors told at a lower load (linear_at = 0: at rest)"

_END = "buckling: no equilibrium beyond load factor {:.6g}, a limit point or too fast a turn ({}); " + _CURE


class Look(NamedTuple):
    """What is known at an equilibrium.

    Attributes
    ----------
    factor, x
        Its load factor and its unknowns.
    below
        Number of negative eigenvalues of its tangent.
    ways
        Load factors of the small pencil less that one, ``(p,)``, ascending.
    shapes
        Combinations of the modes, ``(modes, p)``.
    modes
        The vibration modes nearest to zero.
    slopes
        By how much their ``omega^2`` grow with the load factor, ``(modes,)``.
    """

    factor: float
    x: PETSc.Vec
    below: int
    ways: Array
    shapes: Array
    modes: Eigenpairs
    slopes: Array

    def way(self, number: int) -> tuple[float, Array] | None:
        """Return how far the factor of a number, from 0, is from here, and its shape; None where it is not seen."""
        ahead, behind = np.flatnonzero(self.ways > 0.0), np.flatnonzero(self.ways <= 0.0)[::-1]
        here = number - self.below
        several, k = (ahead, here) if here >= 0 else (behind, -here - 1)
        return (float(self.ways[several[k]]), self.shapes[:, several[k]]) if k < several.size else None


class Point(NamedTuple):
    """A load factor at which the tangent is singular.

    Attributes
    ----------
    factor
        The load factor.
    x
        Unknowns of the equilibrium there.
    shape
        What it buckles into, on the unknowns.
    loss
        By how much the stiffness ``x^T K x`` of the shape falls with the load factor.
    residual, settled
        Of the vibration mode that becomes the shape, and the relative change of the factor that is left; not a number
        where nothing was followed.
    below
        Sturm count: negative eigenvalues just below, of factors that are lower.
    softer
        Load factor and unknowns of an equilibrium short of it, the vibration mode there that becomes the shape, its
        stiffness, and by how much that falls with the load factor; None at rest.
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
        self.looks = 0
        self._last: Look | None = None
        self._short: Look | None = None
        # How far the last factor that has settled lay from the equilibrium that told it, and by how much it may be off.
        self._reach = self._doubt = 0.0

    def modes(self, count: int) -> Eigenpairs:
        """Return the lowest vibration modes about the equilibrium at which the tangents are."""
        return self.pencil.solve(min(count, self.pencil.size), -_ASIDE * self.pencil.floor)

    def look(self, place: Known, wanted: int) -> Look:
        """Return what is known at an equilibrium of the factors around it, that of the number ``wanted`` among them."""
        self._tangents.fill(place)
        below = inertia.negative_eigenvalues(self._tangents.stiffness) - self.pencil.pressures
        modes = self.modes(max(below, wanted + 1) + _SPARE)
        pushed = [self._tangents.derivative * one for one in modes.vectors]
        slopes = np.array([[a.dot(b) for b in modes.vectors] for a in pushed])
        self.looks += 1
        # 1 / mu, as the derivative may be singular.
        rates, shapes = np.linalg.eig(-0.5 * (slopes + slopes.T) / modes.eigenvalues[:, None])
        real = (np.abs(rates.imag) <= 1e-9 * np.abs(rates)) & (rates != 0.0)
        ways, shapes = 1.0 / rates[real].real, shapes[:, real].real
        order = np.argsort(ways)
        self._reach = 0.0
        self._last = Look(place.factor, place.x, below, ways[order], shapes[:, order], modes, np.diag(slopes))
        return self._last

    def seek(self, number: int, guess: float | None = None) -> Point:
        """Return the load factor of a number, from 0 and in the order of their size.

        Where there is no guess it is sought from the last equilibrium, from which another factor was computed.
        """
        low, high, before, bends, told = 0.0, np.inf, (np.nan, np.nan), 0, None
        factor, farthest = np.nan, 0.0
        ended: PathEnds | None = None
        flows = self._assembler.model.remembers
        for _ in range(_MOST_FLOWING if flows else _MOST):
            if guess is not None:
                try:
                    self.look(self._path.at(guess), number)
                except PathEnds as problem:
                    # What lies before its end may have passed a factor all the same.
                    ended = problem
                    if not ended.reached > low:
                        raise SolveError(_END.format(ended.reached, ended)) from None
                    self.look(self._path.at(ended.reached), number)
            last = self._last
            assert last is not None
            guess = last.factor
            low, high = (guess, high) if last.below <= number else (low, guess)
            if flows and high < np.inf and high - low <= _AT_ONCE * high:
                raise SolveError(
                    f"buckling: factor {number + 1} is none: it buckles as it yields, at load factor {high:.5g}, where "
                    "the tangent stiffness falls at once"
                )
            found = last.way(number)
            if found is None:
                farthest = farthest or _FARTHEST * guess
                if guess > farthest:
                    raise SolveError(
                        f"buckling: no factor {number + 1} up to {guess:.6g}: the path bends and stiffens; {_CURE}"
                    )
                guess = 0.5 * (low + high) if high < np.inf else 1.5 * guess
                continue
            way, shape = found
            factor = guess + way
            told = factor if told is None else told
            bends += not flows and last.below == number and way > abs(before[1])
            if bends > 1 or (0.0 < way < _BEND_NEAR * guess and self._moves_along(shape)):
                raise SolveError(
                    f"buckling: the path bends before factor {number + 1}, first estimated at {told:.6g}: it has a "
                    f"limit point, or goes aside as an imperfect column does; {_CURE}"
                )
            # Errors fall with the square of the way.
            if way > 0.3 * _APART * factor:
                self._short = last
            doubt = abs(factor - before[0]) * (way / before[1]) ** 2
            if 0.0 < way <= self._reach:
                # A factor that lies beside one that has settled is told as well.
                doubt = float(np.nanmin((doubt, self._doubt)))
            if 0.0 < way <= _NEAR * factor and (doubt <= _SETTLED * factor or way <= _SETTLED**0.5 * factor):
                self._reach, self._doubt = _BESIDE * way, doubt
                point = self._point(last, number, self._short, doubt / factor)
                assert point is not None
                return point
            before = factor, way
            guess = factor - max(_SHORT * abs(way), _APART * factor if abs(way) > 2.0 * _APART * factor else 0.0)
            if not low < guess < high:
                guess = 0.5 * (low + high) if high < np.inf else 1.5 * low
            if ended is not None and guess >= ended.reached:
                raise SolveError(_END.format(ended.reached, ended))
        raise SolveError(f"buckling: factor {number + 1} does not settle, last {factor:.6g}: the path bends; {_CURE}")

    def told_at(self, factor: float, modes: int, more: int) -> list[Point]:
        """Return the factors by the tangent and its derivative at an equilibrium of a lower load.

        Raises
        ------
        SolveError
            If there is no such equilibrium, it is not stable, or has no factor.
        """
        try:
            place = self._path.at(factor)
        except PathEnds as problem:
            raise SolveError(_END.format(problem.reached, problem)) from None
        look = self.look(place, modes - 1 + more)
        if look.below:
            raise SolveError(f"buckling: linear_at {factor:g} is beyond {look.below} load factors; take a lower one")
        points = [one for one in (self._point(look, k) for k in range(modes)) if one is not None]
        if not points:
            raise SolveError(f"buckling: at linear_at {factor:g} the loads take no stiffness away")
        return points

    def _moves_along(self, shape: Array) -> bool:
        """Return whether the path itself moves along a shape: it bends, and no other path meets it there."""
        mass, rate = self.pencil.mass, self._tangents.rate
        moved = mass * rate
        assert self._last is not None
        along = np.array([moved.dot(one) for one in self._last.modes.vectors]) @ shape / np.linalg.norm(shape)
        return bool(along**2 > _BENDS * moved.dot(rate))

    def _point(self, look: Look, number: int, near: Look | None = None, settled: float = np.nan) -> Point | None:
        """Return what a look tells of the factor of a number, and of its error another one, short of it."""
        found = look.way(number)
        if found is None:
            return None
        way, shape = found
        x, vector = look.x.copy(), self._tangents.rate.duplicate()
        x.axpy(way, self._tangents.rate)
        vector.zeroEntries()
        vector.maxpy(shape, look.modes.vectors)
        # What is lost on the way is all there was.
        loss = float(look.modes.eigenvalues @ shape**2) / way
        residual = float(look.modes.residuals[np.argmax(np.abs(shape))])
        softer = self._softer(near or look, number)
        return Point(look.factor + way, x, vector, loss, residual, settled, look.below, softer)

    def _softer(self, look: Look, number: int) -> tuple[float, PETSc.Vec, PETSc.Vec, float, float] | None:
        """Return what is known at an equilibrium of the vibration mode that becomes a shape (`Point.softer`)."""
        found = look.way(number)
        if found is None:
            return None
        k = int(np.argmax(np.abs(found[1])))
        return look.factor, look.x, look.modes.vectors[k], float(look.modes.eigenvalues[k]), -float(look.slopes[k])
