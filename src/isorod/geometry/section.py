"""Control polygons of cross sections: the outline is ``sum_i Phi_i(theta) P_i``."""

import warnings
from pathlib import Path

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.errors import InputError, positive, whole_number
from isorod.geometry import fitted, reading
from isorod.geometry.disk import MAX_COUNT, boundary_functions, check_count, control_points

# Relative loss of area from the smooth outline to straight sides between points above which the points are too few to
# distinguish the two.
_FEW = 0.05

# At corners that turn by more, degrees, as the trailing edge of an airfoil, the section is thin, and denser control
# points would spoil its map.
_THIN = 136.0

# Samples of an exact outline.
_DENSE = 4096

_MORE = "take more control points (n)"


def circle(n: int, radius: float = 1.0) -> Array:
    """Return the ``(n, 2)`` control points of a circle, exact for any ``n >= 3``; ``radius`` in units of length."""
    positive("section radius", radius)
    return ellipse(n, radius, radius)


def ellipse(n: int, a: float, b: float) -> Array:
    """Return the ``(n, 2)`` control points of an ellipse with half axes ``a`` and ``b``, exact for any ``n >= 3``."""
    for name, value in (("a", a), ("b", b)):
        positive(f"section half axis {name}", value)
    return control_points(n) * np.array([a, b])


def flower(n: int = 16, petals: int = 4, radius: float = 1.0, depth: float = 0.3) -> Array:
    """Return the ``(n, 2)`` control points of a flower, concave between its petals (Lu & Zhou 2011, Fig. 3).

    The polygon's radius is ``radius * (1 + depth cos(petals theta))``.  `Rod.check` finds whether the
    map folds.
    """
    theta = 2.0 * np.pi * np.arange(check_count(n)) / n
    if not 0.0 <= depth < 1.0:
        raise InputError(f"flower depth: got {depth:g}, need 0 <= depth < 1")
    whole_number("flower petals", petals, 0, MAX_COUNT)
    return circle(n, radius) * (1.0 + depth * np.cos(petals * theta))[:, None]


def airfoil() -> Array:
    """Return the 16 control points ``(16, 2)`` of the paper's blade section, chord about 2 along x.

    The heights of the unit circle's control points, turned by half an arc, are multiplied by factors linear in the
    point's number: 0.35625 to 0.05 on the upper side from its front on, -0.02 to 0.05 on the lower one (Lu & Zhou 2011,
    appendix A, where the minus signs are lost).
    """
    n = 16
    angle = 2.0 * np.pi * (np.arange(n) + 0.5) / n
    factor = np.concatenate([0.35625 - 0.04375 * np.arange(8), -0.02 + 0.01 * np.arange(8)])
    return np.stack([np.cos(angle), np.sin(angle) * factor], axis=1) / np.cos(np.pi / n)


def naca(digits: str, n: int | None = None, chord: float = 1.0) -> Array:
    """Return the ``(n, 2)`` control points fitted to a NACA 4-digit airfoil, its leading edge towards -x, centred in x.

    The outline is sampled at ``x = chord / 2 (1 + cos theta)``, in which it is smooth except for the blunt trailing
    edge, which the fit rounds off.

    Parameters
    ----------
    digits
        Camber and its position and thickness, as in ``"2412"`` (Jacobs, Ward, Pinkerton, NACA Report 460, 1933).
    n
        Number of control points; chosen where not given (`isorod.geometry.fitted.fitted`).
    chord
        Units of length.

    Raises
    ------
    InputError
        If ``digits`` are not four of which the last two are a thickness of at least 1 %, or the chord is not positive.
    """
    if (
        len(digits) != 4
        or not (digits.isascii() and digits.isdigit())
        or digits[2:] == "00"
        or (digits[0] != "0") != (digits[1] != "0")
    ):
        raise InputError(f"airfoil: got {digits!r}, need a NACA 4-digit number such as 2412 or 0012")
    positive("chord", chord)
    camber, place, thickness = int(digits[0]) / 100.0, int(digits[1]) / 10.0, int(digits[2:]) / 100.0

    def outline(theta: Array) -> Array:
        x = 0.5 * (1.0 + np.cos(theta))
        half = 5.0 * thickness * (0.2969 * np.sqrt(x) - x * (0.1260 + x * (0.3516 - x * (0.2843 - 0.1015 * x))))
        mean = np.zeros_like(x)
        slope = np.zeros_like(x)
        if camber:
            fore = x < place
            scale = camber / np.where(fore, place, 1.0 - place) ** 2
            mean = scale * (np.where(fore, 0.0, 1.0 - 2.0 * place) + 2.0 * place * x - x * x)
            slope = 2.0 * scale * (place - x)
        tilt = np.arctan(slope)
        side = np.sign(np.sin(theta))
        points = np.stack([x - side * half * np.sin(tilt) - 0.5, mean + side * half * np.cos(tilt)], axis=1)
        return chord * points

    def make(count: int) -> Array:
        theta = _angles(16 * count)
        return fitted.fit(theta, outline(theta), count)

    return fitted.fitted("airfoil", make, outline(_angles(_DENSE)), n, MAX_COUNT, _MORE)


def rounded_rectangle(n: int | None, width: float, height: float, corner_radius: float) -> Array:
    """Return the ``(n, 2)`` control points fitted to a rectangle with round corners, ``width`` along x, about 0.

    The fit rounds off corners that ``n`` points cannot follow; control points are denser at sharp ones.  With a
    multiple of four it has the rectangle's symmetry.

    Parameters
    ----------
    n
        Number of control points; chosen where it is None (`isorod.geometry.fitted.fitted`).
    width, height, corner_radius
        Units of length.

    Raises
    ------
    InputError
        If a length is not positive, or the radius of the corners is not between 0 and half of the shorter side.
    """
    positive("rectangle width", width)
    positive("rectangle height", height)
    sides = np.array([width, height])
    if not 0.0 <= corner_radius <= 0.5 * sides.min():
        raise InputError(
            f"corner radius: got {corner_radius:g}, need 0 to {0.5 * sides.min():g}, half the shorter side"
        )
    signs = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
    angle = 0.5 * np.pi * (np.arange(4)[:, None] + np.linspace(0.0, 1.0, 257))
    arcs = corner_radius * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    middle = [[0.5 * width, 0.0]]
    corners = (signs[:, None] * (0.5 * sides - corner_radius) + arcs).reshape(-1, 2)
    ring = np.concatenate([middle, corners, middle])
    # Divided by the sides' lengths, short sides of a flat section get as many points as long ones.
    arc = 257 * np.arange(4) + 129
    sharpness = 1.0 - corner_radius / (0.5 * sides.min())
    target = reading.filled(ring)

    def make(count: int) -> Array:
        return fitted.crowded(ring, arc, sides, count, sharpness)

    return fitted.fitted("rounded rectangle", make, target, n, MAX_COUNT, _MORE)


def from_file(
    path: str | Path, n: int | None = None, scale: float = 1.0, near: Numbers | None = None, closer: float = 2.0
) -> Array:
    """Return the ``(n, 2)`` control points of an outline in a file, times ``scale``.

    Angles are in proportion to the length of the outline stretched to equal height and width, so that those of a flat
    one are like an ellipse's.

    Parameters
    ----------
    path
        A file of points ``x, y``, or one that ends in ``.dat`` with an airfoil (`isorod.geometry.outline.read`).
    n, near, closer
        As in `from_points`, ``near`` in the coordinates of the file.

    Raises
    ------
    InputError
        If the file cannot be read or `from_points` refuses its points: the message names the file.
    """
    # Imported late: only files need it.
    from isorod.geometry import outline

    positive("section scale", scale, "a positive number")
    points = outline.read(path)
    extent = np.ptp(points, axis=0)
    if not extent.min() > 0.0:
        raise InputError(f"{path}: the outline has no area")
    try:
        return scale * _through(points, n, near, closer, extent)
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from None


def from_points(points: Numbers, n: int | None = None, near: Numbers | None = None, closer: float = 2.0) -> Array:
    """Return the ``(n, 2)`` control points of an outline through points: smooth, straight between sharp corners.

    A corner is where the polyline turns by more than 60 degrees, by more than 30 and more than twice as far as at one
    of its neighbours, or more than four times as far as at both; next to a corner any turn of more than 30 degrees
    is one, with a warning.  Without corners the outline fits the points in the least-squares sense; with corners it
    fits the cubic splines and straight sides between them, control points being denser at those that turn by at most
    136 degrees (`isorod.geometry.reading`).

    Parameters
    ----------
    points
        Points of the outline in counter-clockwise order, shape ``(m, 2)``, the first not repeated, ``m >= n`` without
        corners; the first point is at the angle 0 of the disk, the others at angles in proportion to the arc length.
    n
        Number of control points; chosen where not given (`isorod.geometry.fitted.fitted`).
    near, closer
        A place ``(x, y)`` where control points are denser than uniform, by the factor ``closer``: at the nearest of the
        points the angles are stretched by a Moebius map of the disk to itself, which keeps harmonic functions harmonic.
        On the opposite side they are sparser by the same factor.  Control points are then not denser at corners.

    Raises
    ------
    InputError
        If there are too few points, two neighbours coincide, a value is not finite, the order is clockwise, or area or
        a second moment is off by more than 1 %.
    """
    return _through(np.asarray(points, dtype=float), n, near, closer)


def _through(points: Array, n: int | None, near: Numbers | None, closer: float, extent: Array | None = None) -> Array:
    """Do `from_points`; lengths along the outline are those of points divided by the extent."""
    if points.ndim != 2 or points.shape[1] != 2 or points.shape[0] < 3:
        raise InputError(f"section points: got an array of shape {points.shape}, need (m, 2) with m >= 3")
    if n is not None:
        check_count(n)
    if not np.isfinite(points).all():
        raise InputError(f"section point {np.argmax(~np.isfinite(points).all(axis=1))} is not finite")
    edges = np.roll(points, -1, axis=0) - points
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    if (lengths == 0.0).any():
        raise InputError(f"section point {np.argmax(lengths == 0.0)} coincides with the next one")
    if np.sum(points[:, 0] * edges[:, 1] - points[:, 1] * edges[:, 0]) <= 0.0:
        raise InputError("section points run clockwise; give them counter-clockwise")
    sharp, doubt = reading.outline_corners(points)
    target, where = reading.between(points, sharp, closed=True)
    if doubt.size:
        warnings.warn(
            f"section points: the turn of {reading.turns(points, True)[doubt[0]]:.0f} degrees at point {doubt[0]} is "
            "taken for a sharp corner, but points beside it turn too; give more points there of a smooth outline, "
            "points on the sides of a straight one",
            stacklevel=3,
        )
    blunt = sharp[reading.turns(points, closed=True)[sharp] <= _THIN]
    if blunt.size and near is None:
        size = np.ptp(points, axis=0)
        return fitted.fitted(
            "section points",
            lambda count: fitted.crowded(target, where[blunt], size, count),
            target,
            n,
            MAX_COUNT,
            f"{_MORE}, or rounded_rectangle",
        )
    if len(points) < (n or 0):
        raise InputError(f"section points: got an array of shape {points.shape}, need (m, 2) with m >= {n}")
    scaled = points if extent is None else points / extent
    lengths = np.hypot(*(np.roll(scaled, -1, axis=0) - scaled).T)
    theta = 2.0 * np.pi * np.concatenate([[0.0], np.cumsum(lengths)[:-1]]) / lengths.sum()
    if near is not None:
        theta = _crowded(theta, points, near, closer)
    if not sharp.size:
        less = 1.0 - reading.moments(points)[0] / reading.moments(target)[0]
        if less > _FEW:
            warnings.warn(
                f"section points: straight sides between them hold {100.0 * less:.2g} % less area than the smooth "
                "outline through them, which is taken; give more points of a smooth one, points on the sides of a "
                "straight one",
                stacklevel=3,
            )
    return fitted.fitted(
        "section points",
        lambda count: fitted.fit(theta, points, count),
        target,
        n,
        len(points),
        "give more points" if n in (None, len(points)) else _MORE,
    )


def _angles(count: int) -> Array:
    """Return so many angles, evenly round the circle, half a step from its start."""
    angles: Array = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return angles


def _crowded(theta: Array, points: Array, near: Numbers, closer: float) -> Array:
    """Return the angles of points after the Moebius map that stretches them about a place."""
    place = np.asarray(near, dtype=float)
    if place.shape != (2,) or not np.isfinite(place).all():
        raise InputError(f"section points near a place: got {place.tolist()}, need two finite coordinates")
    if not (np.isfinite(closer) and closer >= 1.0):
        raise InputError(f"section points closer: got {closer:g}, need a factor of 1 or more")
    focus = (closer - 1.0) / (closer + 1.0) * np.exp(1j * theta[np.argmin(np.hypot(*(points - place).T))])
    z = np.exp(1j * theta)
    moved: Array = np.angle((z - focus) / (1.0 - np.conj(focus) * z))
    return moved


def refinement_turn(n: int, multiple: int) -> float:
    """Return the angle of the first control point when each of ``n`` arcs is cut in ``multiple``, radians."""
    return -np.pi / n * (1.0 - 1.0 / multiple)


def refine(points: Numbers, multiple: int) -> Array:
    """Return the control points of the same outline with every arc cut in ``multiple``.

    The spaces nest, so that the outline and the map of the disk do not change.  The new points' first angle is
    `refinement_turn`.

    Parameters
    ----------
    points
        Control points, shape ``(n, ...)``.

    Returns
    -------
    Array of shape ``(n multiple, ...)``.
    """
    given = np.asarray(points, dtype=float)
    n = check_count(given.shape[0])
    fine = check_count(n * multiple)
    if multiple == 1:
        return given
    # The middle of each fine arc: interpolation there is exact and well conditioned.
    theta = refinement_turn(n, multiple) + 2.0 * np.pi * np.arange(fine) / fine
    placed = boundary_functions(n, theta) @ given.reshape(n, -1)
    middle = boundary_functions(fine, theta - theta[0])
    return np.linalg.solve(middle, placed).reshape(fine, *given.shape[1:])
