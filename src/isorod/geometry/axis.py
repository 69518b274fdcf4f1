"""The NURBS axis of a rod: basis functions, refinement and exact transfer between nested axes."""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array, Index
from isorod.errors import Checked, InputError, whole_number
from isorod.geometry import bspline

MAX_DEGREE = 6
MAX_ELEMENTS = 100_000

# Tables up to this many values are cached: runs use the same knots and parameters again and again.
_KEPT_SIZE = 2**14

# Refinements up to this many elements are cached: the same ones are requested again and again.
_KEPT_ELEMENTS = 1000

# Knots closer than this, relative to the length of the axis, are the same.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Axis(Checked):
    """A NURBS basis in one parameter ``u`` (Lu & Zhou 2011, eqs. 8-10).

    Parameters
    ----------
    degree
        Polynomial degree ``p``, 1 to 6.
    knots
        Clamped, non-decreasing knot vector, shape ``(m + p + 1,)``; interior multiplicity at most ``p``.
    weights
        Positive weights, shape ``(m,)``.

    Attributes
    ----------
    breaks, multiplicities
        Distinct knots, and the multiplicity of each, both of shape ``(elements + 1,)``.

    Raises
    ------
    InputError
        With the first offending entry, if any of this does not hold.
    """

    degree: int
    knots: Array
    weights: Array
    breaks: Array = field(init=False)
    multiplicities: Index = field(init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(**{name: np.array(getattr(self, name), dtype=float).ravel() for name in ("knots", "weights")})
        p, knots, weights = self.degree, self.knots, self.weights
        whole_number("axis degree", p, 1, MAX_DEGREE)
        _check_finite("knot", knots)
        _check_finite("weight", weights)
        rise = knots[1:] - knots[:-1]
        if (rise < 0.0).any():
            k = int(np.argmax(rise < 0.0))
            raise InputError(f"knot {k + 1} is {knots[k + 1]:g} after {knots[k]:g}; knots must not decrease")
        if weights.size != knots.size - p - 1:
            raise InputError(f"{knots.size} knots of degree {p} need {knots.size - p - 1} weights, got {weights.size}")
        if (weights <= 0.0).any():
            k = int(np.argmax(weights <= 0.0))
            raise InputError(f"weight {k} is {weights[k]:g}; weights must be positive")
        heads = np.concatenate([[0], np.flatnonzero(rise) + 1, [knots.size]])
        values, counts = knots[heads[:-1]], np.diff(heads)
        self._set(breaks=values, multiplicities=counts)
        if values.size < 2 or counts[0] != p + 1 or counts[-1] != p + 1:
            raise InputError(f"the first and the last knot must each stand {p + 1} times (degree {p}, clamped ends)")
        if (counts[1:-1] > p).any():
            k = 1 + int(np.argmax(counts[1:-1] > p))
            raise InputError(f"interior knot {values[k]:g} stands {counts[k]} times; degree {p} allows {p}")

    def __repr__(self) -> str:
        low, high = self.breaks[0], self.breaks[-1]
        return f"Axis(degree {self.degree}, {self.elements} elements from {low:g} to {high:g})"

    @property
    def count(self) -> int:
        """Number of basis functions ``m``."""
        return self.weights.size

    @property
    def elements(self) -> int:
        """Number of non-empty knot spans."""
        return self.breaks.size - 1

    def within(self, fractions: ArrayLike) -> Array:
        """Return the parameters at fractions ``(count,)`` of each element, shape ``(elements, count)``."""
        return self.breaks[:-1, None] + np.diff(self.breaks)[:, None] * np.asarray(fractions)

    def evenly(self, parts: int) -> Array:
        """Return the parameters that cut each element in equal parts, both ends included, ``(elements parts + 1,)``."""
        return np.append(self.within(np.arange(parts) / parts).ravel(), self.breaks[-1])

    @cached_property
    def first_function(self) -> Index:
        """First of the ``p + 1`` functions on each element, shape ``(elements,)``."""
        spans = np.searchsorted(self.knots, self.breaks[:-1], side="right") - 1
        return (spans - self.degree).astype(np.int64)

    def local(self, u: ArrayLike) -> tuple[Index, Array, Array]:
        """Return, for each parameter, the functions there.

        Parameters
        ----------
        u
            Parameters within the knot vector, shape ``(t,)``; at a knot those of the element above it (at the last,
            below).

        Returns
        -------
        first, values, slopes
            Index of the first of the ``p + 1`` functions ``(t,)``, ``R_j`` and ``dR_j/du``, both ``(t, p + 1)``; not to
            be written to.

        Raises
        ------
        InputError
            For a parameter outside the knot vector.
        """
        where = np.ascontiguousarray(np.atleast_1d(np.asarray(u, dtype=float)))
        if (self.degree + 1) * where.size + self.knots.size > _KEPT_SIZE:
            return _local(self.knots, self.degree, self.weights, where)
        return _kept_local(self.knots.tobytes(), self.degree, self.weights.tobytes(), where.tobytes())

    def refine(self, parts: int = 1, degree: int | None = None, continuity: int | None = None) -> "Axis":
        """Return the axis whose space contains this one: elements cut in ``parts``, degree raised, new knots smooth.

        Existing knots keep their continuity (or ``continuity``, if that is less), so that the geometry on the new axis
        is the same.

        Raises
        ------
        InputError
            If ``degree`` is below this one or above 6, ``continuity`` is not in ``0 .. degree - 1``, or ``parts < 1``.
        """
        degree = whole_number("axis degree", self.degree if degree is None else degree, self.degree, MAX_DEGREE)
        continuity = degree - 1 if continuity is None else continuity
        whole_number("continuity", continuity, 0, degree - 1)
        whole_number("parts of an element", parts, 1, MAX_ELEMENTS)
        if parts * self.elements > MAX_ELEMENTS:
            raise InputError(f"axis: {parts * self.elements} elements are too many; at most {MAX_ELEMENTS}")
        if parts * self.elements > _KEPT_ELEMENTS:
            return self._refined(parts, degree, continuity)
        return _kept_refinement(self.degree, self.knots.tobytes(), self.weights.tobytes(), parts, degree, continuity)

    def _refined(self, parts: int, degree: int, continuity: int) -> "Axis":
        old, counts = self.breaks, self.multiplicities
        cuts = (old[:-1, None] + np.arange(parts) * (np.diff(old)[:, None] / parts)).ravel()
        smoothness = np.full(cuts.size, continuity)
        smoothness[::parts] = np.minimum(continuity, self.degree - counts[:-1])
        multiplicity = degree - smoothness
        multiplicity[0] = degree + 1
        return self._on_knots(degree, np.concatenate([np.repeat(cuts, multiplicity), np.repeat(old[-1], degree + 1)]))

    def cut(self, parts: Index) -> "Axis":
        """Return the axis with each element cut in as many equal parts, ``(elements,)``, as smooth as possible."""
        fraction = np.concatenate([np.arange(1, count) / count for count in parts])
        element = np.repeat(np.arange(self.elements), parts - 1)
        new = self.breaks[element] + fraction * np.diff(self.breaks)[element]
        return self._on_knots(self.degree, np.sort(np.concatenate([self.knots, new])))

    def insert(self, u: float, multiplicity: int = 1) -> "Axis":
        """Return the axis with the knot ``u`` inserted ``multiplicity`` times (its space contains this one)."""
        present = int(np.count_nonzero(self.knots == u))
        if not self.knots[0] < u < self.knots[-1]:
            raise InputError(f"knot {u:g} is not inside ({self.knots[0]:g}, {self.knots[-1]:g})")
        if multiplicity < 1 or present + multiplicity > self.degree:
            raise InputError(
                f"knot {u:g} stands {present} times; {multiplicity} more is not within 1 .. {self.degree - present}"
            )
        knots = np.sort(np.concatenate([self.knots, np.full(multiplicity, u)]))
        return self._on_knots(self.degree, knots)

    def with_knots(self, places: ArrayLike, continuity: int) -> "Axis":
        """Return the axis with knots at more places ``(k,)``, at which functions are of a ``continuity``.

        At a place named twice they are C0; it may be a knot already.  Places equal to a knot up to round-off are that
        knot.

        Raises
        ------
        InputError
            If a place is not inside the axis, is there three times, or a knot already and named once.
        """
        targets = np.atleast_1d(np.asarray(places, dtype=float))
        nearest = self.breaks[np.abs(targets[:, None] - self.breaks).argmin(axis=1)]
        rounded = np.abs(targets - nearest) <= _ROUNDING * (self.breaks[-1] - self.breaks[0])
        u, times = np.unique(np.where(rounded, nearest, targets), return_counts=True)
        inside = (u > self.breaks[0]) & (u < self.breaks[-1])
        right = inside & (times <= 2) & (~np.isin(u, self.breaks) | (times == 2))
        if not right.all():
            raise InputError(
                f"knots: got {u[np.argmin(right)]:g}, need others than there are, once each (twice: a kink), "
                f"between {self.breaks[0]:g} and {self.breaks[-1]:g}"
            )
        there = np.searchsorted(self.knots, u, "right") - np.searchsorted(self.knots, u)
        smooth = self.degree - min(continuity, self.degree - 1)
        more = np.repeat(u, np.where(times == 2, np.maximum(self.degree - there, 0), smooth))
        return self._on_knots(self.degree, np.sort(np.concatenate([self.knots, more])))

    def _on_knots(self, degree: int, knots: Array) -> "Axis":
        return Axis(
            degree, knots, bspline.transfer(self.knots, self.degree, knots, degree, self.weights[:, None])[:, 0]
        )

    def transfer(self, finer: "Axis", points: ArrayLike) -> Array:
        """Return the control points ``(finer.count, ...)`` on a nested finer axis of the function with ``points``."""
        values = np.asarray(points, dtype=float)
        columns = values.reshape(self.count, -1) * self.weights[:, None]
        moved = bspline.transfer(self.knots, self.degree, finer.knots, finer.degree, columns) / finer.weights[:, None]
        return moved.reshape(finer.count, *values.shape[1:])


def _local(knots: Array, degree: int, weights: Array, u: Array) -> tuple[Index, Array, Array]:
    """Do `Axis.local`, from knots and weights."""
    low, high = knots[0], knots[-1]
    inside = (u >= low) & (u <= high)
    if not inside.all():
        raise InputError(f"axis parameter {u[np.argmin(inside)]:g} is outside [{low:g}, {high:g}]")
    first, values, slopes = bspline.table(knots, degree, u)
    near = weights[first[:, None] + np.arange(degree + 1)]
    weighted, slopes = near * values, near * slopes
    total = weighted.sum(axis=1, keepdims=True)
    values = weighted / total
    return first, values, (slopes - values * slopes.sum(axis=1, keepdims=True)) / total


@lru_cache(maxsize=64)
def _kept_local(knots: bytes, degree: int, weights: bytes, u: bytes) -> tuple[Index, Array, Array]:
    result = _local(np.frombuffer(knots), degree, np.frombuffer(weights), np.frombuffer(u))
    for array in result:
        array.flags.writeable = False
    return result


@lru_cache(maxsize=32)
def _kept_refinement(own: int, knots: bytes, weights: bytes, parts: int, degree: int, continuity: int) -> Axis:
    return Axis(own, np.frombuffer(knots), np.frombuffer(weights))._refined(parts, degree, continuity)


def _check_finite(name: str, values: Array) -> None:
    good = np.isfinite(values)
    if not good.all():
        k = int(np.argmin(good))
        raise InputError(f"{name} {k} is {values[k]}; it must be finite")
