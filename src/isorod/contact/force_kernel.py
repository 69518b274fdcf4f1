"""The compiled contact forces: search, pressure, and its share to the nodes."""

import numpy as np
from numba import b1, f8, i8, njit, types, void

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, FAST, I1
from isorod.contact.surface_kernel import (
    EDGE,
    END,
    FREE,
    FUNCTIONS,
    LOST,
    PACKED,
    PLANE,
    Packed,
    closest,
    dot,
    surface_gap,
)

# Element boxes are enlarged by this part of their largest side: a normal may leave the box of a skewed end.
_MARGIN = 0.1


@njit(void(PACKED, F2), **FAST)
def place(packed: Packed, positions: Array) -> None:
    """Fill ``places`` with the slave points and ``boxes`` with those of the elements' control points."""
    for k in range(packed.passes.shape[0]):
        surface, _, point, across, along, first_around, first_along = packed.passes[k]
        n, degree, first, rows, _ = packed.surfaces[surface]
        section = np.empty((n, 3))
        for e in range(rows):
            row = first + e
            for a in range(3):
                low, high = np.inf, -np.inf
                for j in range(degree + 1):
                    for i in range(n):
                        x = positions[packed.layers[row, j] + i, a]
                        low, high = min(low, x), max(high, x)
                packed.boxes[row, a] = low
                packed.boxes[row, 3 + a] = high
            margin = 0.0
            for a in range(3):
                margin = max(margin, _MARGIN * (packed.boxes[row, 3 + a] - packed.boxes[row, a]))
            for a in range(3):
                packed.boxes[row, a] -= margin
                packed.boxes[row, 3 + a] += margin
            for t in range(along):
                r = packed.along[first_along + e * along + t]
                for i in range(n):
                    for a in range(3):
                        value = 0.0
                        for j in range(degree + 1):
                            value += r[j] * positions[packed.layers[row, j] + i, a]
                        section[i, a] = value
                for i in range(n):
                    before, after = (i - 1) % n, (i + 1) % n
                    for q in range(across):
                        f = packed.around[first_around + q]
                        for a in range(3):
                            packed.places[point, a] = (
                                f[0] * section[before, a] + f[1] * section[i, a] + f[2] * section[after, a]
                            )
                        point += 1


@njit(f8(PACKED, i8, i8, F1), **FAST)
def _guess(packed: Packed, surface: int, point: int, start: Array) -> float:
    """Set ``start``, if there is none, to the sample of a surface nearest to a point; return how far the point is from all boxes.

    The samples are the surface's own slave points.  No start is set where that distance is positive.
    """
    n, _, first, rows, own = packed.surfaces[surface]
    x = packed.places[point]
    distance = np.inf
    for row in range(first, first + rows):
        box = packed.boxes[row]
        beside = max(box[0] - x[0], x[0] - box[3], box[1] - x[1], x[1] - box[4], box[2] - x[2], x[2] - box[5])
        distance = min(distance, beside)
    if distance > 0.0:
        return distance
    if start[0] >= 0.0:
        return 0.0
    _, _, begin, across, along, _, _ = packed.passes[own]
    best, found = np.inf, 0
    for k in range(rows * along * n * across):
        y = packed.places[begin + k]
        square = (x[0] - y[0]) ** 2 + (x[1] - y[1]) ** 2 + (x[2] - y[2]) ** 2
        if square < best:
            best, found = square, k
    sector = 2.0 * np.pi / (n * across)
    start[0] = first + found // (along * n * across)
    start[1] = packed.turns[surface, 0] - np.pi / n + sector * (found % (n * across) + 0.5)
    start[2] = 2.0 * (found // (n * across) % along + 0.5) / along - 1.0
    return 0.0


@njit(b1(PACKED, F2), **FAST)
def _travel(packed: Packed, positions: Array) -> bool:
    """Add the longest way of a carrier since the last call to ``travel``; False if a position is not finite."""
    longest = 0.0
    finite = True
    for node in packed.carriers:
        square = 0.0
        for a in range(3):
            x = positions[node, a]
            square += (x - packed.before[node, a]) ** 2
            packed.before[node, a] = x
        finite = finite and square < np.inf
        longest = max(longest, square)
    packed.travel[0] += np.sqrt(longest)
    return finite


@njit(f8(PACKED, i8, i8, F1), **FAST)
def rigid_gap(packed: Packed, k: int, point: int, normal: Array) -> float:
    """Return the gap of a slave point to the rigid obstacle of pass ``k``, and fill its normal."""
    rigid = packed.rigid[k]
    x = packed.places[point]
    height = 0.0
    for a in range(3):
        height += (x[a] - rigid[a]) * rigid[3 + a]
    if packed.passes[k, 1] == PLANE:
        for a in range(3):
            normal[a] = rigid[3 + a]
        return height
    for a in range(3):
        normal[a] = x[a] - rigid[a] - height * rigid[3 + a]
    distance = np.sqrt(dot(normal, normal))
    for a in range(3):
        normal[a] /= distance
    return distance - rigid[6]


@njit(void(i8, i8, I1, i8, F1, F1, f8, F1, F2), **FAST)
def _share(
    n: int,
    count: int,
    layers: Index,
    arc: int,
    axial: Array,
    phi: Array,
    force: float,
    normal: Array,
    forces: Array,
) -> None:
    """Add a normal force at a point of a surface to the forces of the nodes there."""
    for j in range(count):
        for c in range(3):
            node = layers[j] + (arc + c - 1) % n
            for a in range(3):
                forces[node, a] += force * axial[j] * phi[c] * normal[a]


@njit(types.UniTuple(f8, 4)(PACKED, F2, F2), **FAST)
def add_forces(packed: Packed, positions: Array, forces: Array) -> tuple[float, float, float, float]:
    """Add the forces that contact exerts on the nodes: minus the derivative of the energy by the positions.

    Only nodes that carry the surface (``k = 0``) are read and get forces.  The result depends on ``positions`` and
    ``packed.starts`` alone; ``starts``, ``states``, ``places`` and what saves searches are updated.

    Parameters
    ----------
    packed
        From `isorod.contact.pack`.
    positions
        Coefficients of the map, `Space.positions` plus displacement, nodes of all bodies, shape ``(nodes, 3)``.
    forces
        Same shape; is added to.

    Returns
    -------
    energy, normal force, area in contact, deepest gap
        Sums over all pairs; the gap is negative, or zero where nothing touches.  All are NaN if a closest-point search
        failed or a position is not finite, and so are forces.
    """
    if not _travel(packed, positions):
        packed.before[:] = 0.0
        forces[:] = np.nan
        return np.nan, np.nan, np.nan, np.nan
    travel = packed.travel[0]
    place(packed, positions)
    energy = force = area = deepest = 0.0
    phi, axial, y = np.empty((3, 3)), np.empty((3, FUNCTIONS)), np.empty((6, 3))
    d, normal = np.empty(3), np.empty(3)
    for k in range(packed.passes.shape[0]):
        surface, master, begin, across, along, first_around, first_along = packed.passes[k]
        n, degree, first, rows, _ = packed.surfaces[surface]
        penalty = packed.penalty[k]
        for point in range(begin, begin + rows * along * n * across):
            start, state = packed.starts[point], packed.states[point]
            state[0] = np.nan
            state[1] = state[2] = 0.0
            arc, outcome = 0, FREE
            if master < 0:
                gap = rigid_gap(packed, k, point, normal)
            else:
                if packed.clear[point] > travel:
                    start[0] = -1.0
                    continue
                distance = _guess(packed, master, point, start)
                if distance > 0.0:
                    start[0] = -1.0
                    # Both may come nearer, each by the way that it goes.
                    packed.clear[point] = travel + 0.5 * distance
                    continue
                outcome, arc = closest(packed, master, packed.places[point], start, positions, phi, axial, y, d)
                if outcome == END:
                    start[0] = -1.0
                    continue
                gap = surface_gap(y, d, outcome == EDGE, normal) if outcome != LOST else np.nan
            state[0] = gap
            pressure = packed.multipliers[point] - penalty * gap
            if pressure <= 0.0:
                # Another part of the surface may be nearer next time.
                start[0] = -1.0
                packed.clear[point] = travel - 0.5 * pressure / penalty
                continue
            state[1] = pressure
            state[2] = 1.0 if outcome == EDGE else 0.0
            weight = packed.areas[point]
            energy += 0.5 * weight * (pressure**2 - packed.multipliers[point] ** 2) / penalty
            force += weight * pressure
            area += weight
            deepest = min(deepest, gap)
            place_along, rest = (point - begin) // (n * across), (point - begin) % (n * across)
            r, f = packed.along[first_along + place_along], packed.around[first_around + rest % across]
            push = weight * pressure
            layers = packed.layers[first + place_along // along]
            _share(n, degree + 1, layers, rest // across, r, f, push, normal, forces)
            if master >= 0:
                m, other = packed.surfaces[master, 0], packed.surfaces[master, 1] + 1
                _share(m, other, packed.layers[int(start[0])], arc, axial[0], phi[0], -push, normal, forces)
    if not np.isfinite(energy):
        forces[:] = np.nan
        return np.nan, np.nan, np.nan, np.nan
    return energy, force, area, deepest
