"""Control polygons fitted to outlines: angles and number of control points, and the deviation of the outline."""

import warnings
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.geometry import reading
from isorod.geometry.disk import boundary_functions, check_count

# Numbers of control points to choose from: the first that is accurate enough.
_COUNTS = (16, 24, 32, 40, 48, 64, 96)

# Largest errors of area and second moments: of a chosen number, without a warning, without an error.
_CHOSEN, _WARNED, _REFUSED = 2e-3, 5e-3, 1e-2

# Samples of an outline.
_DENSE = 4096

# Samples for each control point.
_SAMPLES = 32

# At a sharp corner control points are up to three times as dense, over this fraction of their mean distance. This
# halves the rounding of the corner; larger values do not reduce it further.
_DENSER, _AROUND = 2.0, 0.5


class Polygon(np.ndarray[Any, np.dtype[np.float64]]):
    """A control polygon ``(n, 2)`` that was fitted to an outline.

    Attributes
    ----------
    deviation
        The largest distance between its outline and the target, relative to half the diameter of the target.
    """

    deviation: float

    def __array_finalize__(self, other: Any) -> None:
        self.deviation = getattr(other, "deviation", 0.0)


def fit(theta: Array, points: Array, n: int) -> Array:
    """Return the control points ``(n, 2)`` whose outline is nearest to points at angles, by least squares."""
    polygon, _, rank, _ = np.linalg.lstsq(boundary_functions(n, theta), points, rcond=None)
    if rank < n:
        raise InputError(f"section points: they determine only {rank} of {n} control points; give more or spread them")
    return polygon


def crowded(ring: Array, sharp: Index, extent: Array, n: int, sharpness: float = 1.0) -> Array:
    """Return the control points ``(n, 2)`` of an outline, denser at its corners.

    Angles are in proportion to the length of the outline stretched to a square, times a density that is larger at the
    corners.

    Parameters
    ----------
    ring
        Samples of the outline, shape ``(k, 2)``, the last the first again.
    sharp
        Which of them are corners.
    extent
        Divisor of the samples.
    n
        Number of control points.
    sharpness
        Of the corners, from 0 to 1.
    """
    arc_length = reading.chord_lengths(ring / extent)
    arc_length /= arc_length[-1]
    u = np.linspace(0.0, 1.0, 2 * _DENSE + 1)
    places = np.unique(arc_length[sharp])
    places = np.concatenate([places[-1:] - 1.0, places, places[:1] + 1.0])
    after = np.clip(np.searchsorted(places, u), 1, places.size - 1)
    apart = np.minimum(np.abs(u - places[after - 1]), np.abs(places[after] - u))
    density = 1.0 + sharpness * _DENSER * np.exp(-((apart * n / _AROUND) ** 2))
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    turned = np.arange(_SAMPLES * n) / (_SAMPLES * n)
    place = np.interp(turned, angle / angle[-1], u)
    points = np.stack([np.interp(place, arc_length, ring[:, k]) for k in range(2)], axis=1)
    return fit(2.0 * np.pi * turned, points, n)


def fitted(name: str, make: Callable[[int], Array], target: Array, n: int | None, most: int, cure: str) -> Polygon:
    """Return the control polygon of an outline, its deviation measured.

    Parameters
    ----------
    name
        Name of the section in warnings and errors.
    make
        Returns the polygon of a number of control points.
    target
        Samples of the outline ``(k, 2)``.
    n
        Number of control points; by default the first of 16, 24, 32, 40, 48, 64, 96 with which area and
        second moments are right to 0.2 % and the outline to a hundredth of half the diameter.
    most
        The most that may be chosen.
    cure
        Remedy in warnings and errors.

    Raises
    ------
    InputError
        If area or a second moment is off by more than 1 %.
    """
    half = _half_diameter(target[:: max(1, len(target) // 256)])
    counts = [count for count in _COUNTS if count <= most] or [most]
    for count in counts if n is None else [check_count(n)]:
        try:
            polygon = make(count).view(Polygon)
        except InputError:
            # Unevenly spaced points do not determine as many control points as there are points.
            if count in (n, counts[0]):
                raise
            break
        outline = boundary_functions(count, 2.0 * np.pi * np.arange(_DENSE + 1) / _DENSE) @ np.asarray(polygon)
        polygon.deviation = reading.distance(outline, target) / half
        off = reading.mismatch(outline, target)
        if abs(off) <= _CHOSEN and polygon.deviation < reading.LARGE:
            return polygon
    count = len(polygon)
    if abs(off) > _WARNED:
        message = f"{name}: area or second moments of {count} control points are {100.0 * off:+.2g} % off; {cure}"
        if abs(off) > _REFUSED:
            raise InputError(message)
        warnings.warn(message, stacklevel=3)
    elif polygon.deviation >= reading.LARGE:
        warnings.warn(
            f"{name}: the outline of {count} control points is {polygon.deviation * half:.3g} off, "
            f"{polygon.deviation:.2g} of half the diameter, though area and second moments are right to "
            f"{100.0 * abs(off):.1g} %; {cure}",
            stacklevel=3,
        )
    return polygon


def radius(polygon: Array) -> float:
    """Return half the diameter of the outline of a control polygon ``(n, 2)``, from 64 samples."""
    return _half_diameter(_round(len(polygon)) @ polygon)


@cache
def _round(n: int) -> Array:
    """Return the boundary functions of ``n`` control points at 64 angles."""
    return boundary_functions(n, np.pi * np.arange(64) / 32.0)


def _half_diameter(points: Array) -> float:
    squares = (points * points).sum(axis=1)
    return 0.5 * float(np.sqrt((squares[:, None] + squares - 2.0 * points @ points.T).max()))
