"""Compiled: placement of rigid obstacles, and their forces and moments.

Load factors and times are those of `isorod.model.moving.ObstacleMotion`.  The work of an obstacle is that
of its resultant force on the displacement of its centre of rotation, plus that of its moment on the rotation.
"""

import numpy as np
from numba import f8, i8, void

from isorod.arrays import Array
from isorod.compiled import F1, F2, STRICT, njit
from isorod.contact.packed import FRICTION, PACKED, Friction, Packed
from isorod.contact.search_kernel import end_of


@njit(void(F2, i8, i8, f8, F1), **STRICT)
def follow(tracks: Array, first: int, count: int, when: float, out: Array) -> None:
    """Fill ``out`` ``(4,)`` with displacement and angle by ``count`` rows of tracks from ``first`` on."""
    last = first + count - 1
    k = first
    while k < last - 1 and tracks[k + 1, 0] < when:
        k += 1
    fraction = (when - tracks[k, 0]) / (tracks[k + 1, 0] - tracks[k, 0])
    fraction = min(1.0, max(0.0, fraction))
    for a in range(4):
        out[a] = tracks[k, 1 + a] + fraction * (tracks[k + 1, 1 + a] - tracks[k, 1 + a])


@njit(void(F1, f8, F2), **STRICT)
def _turn(axis: Array, angle: float, frame: Array) -> None:
    """Fill ``frame`` with the rotation about a unit axis."""
    sin, versed = np.sin(angle), 2.0 * np.sin(0.5 * angle) ** 2
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        frame[a, a] = 1.0 - versed * (axis[b] * axis[b] + axis[c] * axis[c])
        frame[a, b] = versed * axis[a] * axis[b] - sin * axis[c]
        frame[b, a] = versed * axis[a] * axis[b] + sin * axis[c]


@njit(void(PACKED, f8), **STRICT)
def place_obstacles(packed: Packed, when: float) -> None:
    """Put obstacles where they are at a load factor or time.

    ``Packed.travel`` grows by the largest displacement: points were clear of an obstacle where it was.
    """
    now, frame, axis, travel = np.empty(4), np.empty((3, 3)), np.empty(3), 0.0
    for k in range(packed.passes.size):
        pass_ = packed.passes[k]
        if pass_.tracks == 0:
            continue
        follow(packed.tracks, pass_.first_track, pass_.tracks, when, now)
        axis[:] = pass_.spin
        _turn(axis, now[3], frame)
        # The displacement of the obstacle at the farthest control point.
        twist = moved = far = 0.0
        for a in range(3):
            pivot = pass_.center[a] + now[a]
            moved += (pivot - pass_.pivot[a]) ** 2
            for b in range(3):
                twist += (frame[a, b] - pass_.frame[a, b]) ** 2
        if moved == 0.0 and twist == 0.0:
            continue
        for node in packed.control_points:
            square = 0.0
            for a in range(3):
                square += (packed.before[node, a] - pass_.pivot[a]) ** 2
            far = max(far, square)
        travel = max(travel, np.sqrt(moved) + np.sqrt(twist * far))
        for a in range(3):
            pass_.pivot[a] = pass_.center[a] + now[a]
            pass_.point[a], pass_.direction[a] = pass_.pivot[a], 0.0
            for b in range(3):
                pass_.frame[a, b] = frame[a, b]
                pass_.point[a] += frame[a, b] * (pass_.home[b] - pass_.center[b])
                pass_.direction[a] += frame[a, b] * pass_.homeward[b]
    packed.travel[0] += travel


@njit(void(PACKED, FRICTION, F2), **STRICT)
def obstacle_loads(packed: Packed, friction: Friction, loads: Array) -> None:
    """Fill ``loads`` ``(passes, 6)`` with loads of obstacles at this rank's points, as the last forces left them.

    They are forces, and moments about the centre of rotation, or the obstacle's point where it does not turn.
    """
    loads[:] = 0.0
    push, arm = np.empty(3), np.empty(3)
    for k in range(packed.passes.size):
        pass_ = packed.passes[k]
        if pass_.master >= 0:
            continue
        rubs = friction.coefficients[k] > 0.0
        for point in range(pass_.first_point, end_of(pass_, packed.surfaces[pass_.slave])):
            state, area = packed.states[point], packed.areas[point]
            if not (packed.own[point] and state.pressure > 0.0):
                continue
            for a in range(3):
                push[a] = area * state.pressure * state.normal[a]
                if rubs:
                    push[a] += area * friction.tractions[point, a]
                arm[a] = packed.points[point, a] - pass_.pivot[a]
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                loads[k, a] += push[a]
                loads[k, 3 + a] += arm[b] * push[c] - arm[c] * push[b]


@njit(f8(PACKED, F2, f8, f8), **STRICT)
def obstacle_work(packed: Packed, loads: Array, begin: float, end: float) -> float:
    """Return the work of `obstacle_loads` on the motion of obstacles between two load factors or times."""
    work, old, new = 0.0, np.empty(4), np.empty(4)
    for k in range(packed.passes.size):
        pass_ = packed.passes[k]
        if pass_.tracks == 0:
            continue
        follow(packed.tracks, pass_.first_track, pass_.tracks, begin, old)
        follow(packed.tracks, pass_.first_track, pass_.tracks, end, new)
        for a in range(3):
            work += loads[k, a] * (new[a] - old[a]) + loads[k, 3 + a] * pass_.spin[a] * (new[3] - old[3])
    return work
