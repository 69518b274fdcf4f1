"""Harmonic functions on the unit disk, in closed form.

The unit circle is cut into ``n`` equal arcs of half angle ``alpha = pi / n``; arc ``i`` is centred on the angle
``2 alpha i``.  The boundary functions ``Phi_i`` of the "reduced Bezier circle" (Lu & Zhou 2011, eq. 7) are, on each
arc, a combination of ``1, cos, sin``: the C1 periodic trigonometric splines of order 3.  Their harmonic extensions
``T_i`` (eq. 4) therefore have a closed form, derived here.

Let ``J_m`` be the jump of ``Phi'' + Phi`` at the joint angle ``beta_m``.  Integrating the Fourier coefficients by parts
gives ``c_k = sum_m J_m exp(-i k beta_m) / (2 pi i k (1 - k^2))`` for ``k >= 2``, and with ``z = xi_1 + i xi_2``,
``w_m = z exp(-i beta_m)``

    T(z) = c_0 + 2 Re [ c_1 z + sum_m J_m / (2 pi i) S(w_m) ],
    S(w) = sum_{k>=2} w^k / (k (1 - k^2)) = (1 - w)^2 log(1 - w) / (2 w) + 1/2 - 3 w / 4.

``c_0 = 1/n`` and ``c_1 = cos(alpha) exp(-i theta_i) / n`` follow from ``sum Phi_i = 1`` and ``sum Phi_i Q_i = xi``.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isorod.arrays import Array
from isorod.errors import InputError, whole_number

# The limit is the memory of a section's tables (40 n^2); closed form and tables are accurate well beyond.
MAX_COUNT = 2048

# Tables up to this many values are cached: a rod's check, its geometry and its space use the same points again and
# again.
_KEPT_SIZE = 2**16

# Values of a table computed at once, which takes a dozen complex arrays.
_AT_ONCE = 2**19

# Below this radius S and S' lose digits to cancellation and their power series, cut after this many terms, is accurate.
_SERIES_RADIUS = 0.25
_SERIES_TERMS = 28


def check_count(n: int) -> int:
    """Return ``n`` if it can be a number of section control points (3 to 2048), or raise `InputError`."""
    return whole_number("section control points", n, 3, MAX_COUNT)


def control_points(n: int) -> Array:
    """Return the control points ``Q_i`` of the unit circle ``(n, 2)``: where tangents of neighbouring joints meet."""
    return circle(check_count(n)) / np.cos(np.pi / n)


def circle(count: int) -> Array:
    """Return so many points evenly round the unit circle, from ``(1, 0)`` on, shape ``(count, 2)``."""
    theta = 2.0 * np.pi * np.arange(count) / count
    return np.stack([np.cos(theta), np.sin(theta)], axis=1)


def boundary_functions(n: int, theta: ArrayLike) -> Array:
    """Return the boundary functions ``Phi_i(theta)`` of the reduced Bezier circle.

    Parameters
    ----------
    n
        Number of control points, at least 3.
    theta
        Angles in radians, shape ``(m,)``.

    Returns
    -------
    Array of shape ``(m, n)`` (Lu & Zhou 2011, eq. 7: the barycentric coordinates of the point on its arc).
    """
    alpha = np.pi / check_count(n)
    angle = np.atleast_1d(np.asarray(theta, dtype=float))
    arc = np.round(angle / (2.0 * alpha)).astype(int)
    local = angle - 2.0 * alpha * arc
    middle = (np.cos(local) - np.cos(alpha)) * np.cos(alpha) / np.sin(alpha) ** 2
    slope = np.sin(local) / np.sin(alpha)
    values = np.zeros((angle.size, n))
    rows = np.arange(angle.size)
    np.add.at(values, (rows, arc % n), 0.5 * (1.0 + middle))
    np.add.at(values, (rows, (arc + 1) % n), 0.25 * (1.0 - middle + slope))
    np.add.at(values, (rows, (arc - 1) % n), 0.25 * (1.0 - middle - slope))
    return values


def harmonic_functions(n: int, xi: ArrayLike) -> tuple[Array, Array]:
    """Return the harmonic functions ``T_i`` and their gradients anywhere in the closed unit disk.

    Parameters
    ----------
    n
        Number of control points, at least 3.
    xi
        Points of the disk, shape ``(m, 2)``, ``|xi| <= 1``.

    Returns
    -------
    values, gradients
        Shapes ``(m, n)`` and ``(m, n, 2)`` (Lu & Zhou 2011, eq. 4, in the closed form of this module's header);
        read-only.

    Raises
    ------
    InputError
        If a point lies outside the disk by more than round-off, or is not finite.
    """
    points = np.ascontiguousarray(xi, dtype=float).reshape(-1, 2)
    check_count(n)
    if n * points.shape[0] <= _KEPT_SIZE:
        return _kept(n, points.tobytes())
    return _tabulate(n, points)


@lru_cache(maxsize=32)
def _kept(n: int, points: bytes) -> tuple[Array, Array]:
    values, gradients = _tabulate(n, np.frombuffer(points).reshape(-1, 2))
    values.flags.writeable = gradients.flags.writeable = False
    return values, gradients


def _tabulate(n: int, points: Array) -> tuple[Array, Array]:
    """Do `harmonic_functions`, without the cache."""
    count = max(1, _AT_ONCE // n)
    if len(points) <= count:
        return _tabulate_part(n, points)
    values, gradients = np.empty((len(points), n)), np.empty((len(points), n, 2))
    for first in range(0, len(points), count):
        part = slice(first, first + count)
        values[part], gradients[part] = _tabulate_part(n, points[part])
    return values, gradients


def _tabulate_part(n: int, points: Array) -> tuple[Array, Array]:
    """Do `harmonic_functions` at few enough points for a dozen complex arrays."""
    radius = np.hypot(points[:, 0], points[:, 1])
    bad = ~(radius <= 1.0 + 1e-12)
    if bad.any():
        where = points[np.argmax(bad)]
        raise InputError(f"point ({where[0]:g}, {where[1]:g}) is not in the unit disk")

    alpha = np.pi / n
    z = points[:, 0] + 1j * points[:, 1]
    joints = np.exp(-1j * alpha * (2.0 * np.arange(n) + 1.0))
    s, ds = _joint_function(z[:, None] * joints[None, :])
    ds = ds * joints[None, :]

    # Jumps of Phi'' + Phi at the four joints of function i: theta_i - 3 alpha, - alpha, + alpha, + 3 alpha.
    outer = 0.25 / np.sin(alpha) ** 2
    inner = -(2.0 * np.cos(2.0 * alpha) + 1.0) * outer

    def combine(f: NDArray[np.complex128]) -> NDArray[np.complex128]:
        jumps = outer * (np.roll(f, 2, axis=1) - np.roll(f, -1, axis=1)) + inner * (np.roll(f, 1, axis=1) - f)
        return jumps / (np.pi * 1j)

    first = 2.0 * np.cos(alpha) / n * np.exp(-2j * alpha * np.arange(n))
    values = 1.0 / n + (first * z[:, None] + combine(s)).real
    slope = first + combine(ds)
    return values, np.stack([slope.real, -slope.imag], axis=2)


def _joint_function(w: NDArray[np.complex128]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return ``S(w)`` and ``S'(w)`` of the module header for ``|w| <= 1``."""
    s = np.zeros_like(w)
    ds = np.zeros_like(w)
    near = np.abs(w) < _SERIES_RADIUS
    small = w[near]
    for k in range(_SERIES_TERMS, 1, -1):
        s[near] = (s[near] + 1.0 / (k * (1.0 - k * k))) * small
        ds[near] = (ds[near] + 1.0 / (1.0 - k * k)) * small
    s[near] *= small

    w = w[~near]
    gap = 1.0 - w
    on_joint = gap == 0.0
    log = np.log(np.where(on_joint, 1.0, gap))
    s[~near] = gap * gap * log / (2.0 * w) + 0.5 - 0.75 * w
    ds[~near] = -gap * log / w - gap / (2.0 * w) - gap * gap * log / (2.0 * w * w) - 0.75
    return s, ds
