"""The compiled element loops.

Shapes: ``E`` elements, ``t`` quadrature points along each, ``q`` in the section, ``n`` section functions, ``l = p + 1`` axis
functions; an element's nodes run layer by layer.  ``section``, ``axial``, ``slopes``, ``inverse``, ``weights`` are those of
`isorod.space.Table`.  The sums are factorised: sections first, then along the axis.
"""

from typing import Any

import numpy as np
from numba import njit

from isorod.arrays import Array, Index

_OPTIONS: Any = {"cache": True, "fastmath": {"contract", "reassoc", "nsz", "arcp"}, "error_model": "numpy"}
_D2 = "f8[:,::1]"
_D3 = "f8[:,:,::1]"
# Kept tables are not to be written to.
_R2 = "Array(f8, 2, 'C', readonly=True)"
_R3 = "Array(f8, 3, 'C', readonly=True)"
_D4 = "f8[:,:,:,::1]"
_D5 = "f8[:,:,:,:,::1]"
_I1 = "i8[::1]"
_I2 = "i8[:,::1]"
_I3 = "i8[:,:,::1]"


@njit(f"Tuple(({_D4}, {_D2}))({_R2}, {_R3}, {_D3}, {_D3})", **_OPTIONS)
def inverse_jacobians(values: Array, gradients: Array, section: Array, along: Array) -> tuple[Array, Array]:
    """Return ``d(xi_1, xi_2, u)/dx`` ``(u, q, 3, 3)`` and ``det dx/d(xi_1, xi_2, u)`` ``(u, q)`` of a rod.

    ``values`` ``(q, n)`` and ``gradients`` ``(q, n, 2)`` are the rod's section functions, ``section`` and ``along`` ``(u, n, 3)`` its control
    polygons and their derivatives.
    """
    places, n, _ = section.shape
    points = values.shape[0]
    inverse = np.empty((places, points, 3, 3))
    det = np.empty((places, points))
    # Columns of the Jacobian, at all places at once.
    polygons = np.empty((2, n, 3 * places))
    for t in range(places):
        for i in range(n):
            for a in range(3):
                polygons[0, i, 3 * t + a] = section[t, i, a]
                polygons[1, i, 3 * t + a] = along[t, i, a]
    first = np.dot(np.ascontiguousarray(gradients[:, :, 0]), polygons[0])
    second = np.dot(np.ascontiguousarray(gradients[:, :, 1]), polygons[0])
    third = np.dot(values, polygons[1])
    for t in range(places):
        for q in range(points):
            f0, f1, f2 = first[q, 3 * t], first[q, 3 * t + 1], first[q, 3 * t + 2]
            s0, s1, s2 = second[q, 3 * t], second[q, 3 * t + 1], second[q, 3 * t + 2]
            t0, t1, t2 = third[q, 3 * t], third[q, 3 * t + 1], third[q, 3 * t + 2]
            c0, c1, c2 = s1 * t2 - s2 * t1, s2 * t0 - s0 * t2, s0 * t1 - s1 * t0
            volume = f0 * c0 + f1 * c1 + f2 * c2
            by = 1.0 / volume
            det[t, q] = volume
            inverse[t, q, 0, 0], inverse[t, q, 0, 1], inverse[t, q, 0, 2] = by * c0, by * c1, by * c2
            inverse[t, q, 1, 0] = by * (t1 * f2 - t2 * f1)
            inverse[t, q, 1, 1] = by * (t2 * f0 - t0 * f2)
            inverse[t, q, 1, 2] = by * (t0 * f1 - t1 * f0)
            inverse[t, q, 2, 0] = by * (f1 * s2 - f2 * s1)
            inverse[t, q, 2, 1] = by * (f2 * s0 - f0 * s2)
            inverse[t, q, 2, 2] = by * (f0 * s1 - f1 * s0)
    return inverse, det


@njit(f"{_D5}({_D3}, {_D3}, {_D3}, {_D5}, {_D4})", **_OPTIONS)
def deformation_gradients(section: Array, axial: Array, slopes: Array, inverse: Array, nodal: Array) -> Array:
    """Return ``F`` ``(E, t, q, 3, 3)`` of the nodal displacements ``(E, l, n, 3)``."""
    elements, along, functions = axial.shape
    points, _, n = section.shape
    result = np.empty((elements, along, points, 3, 3))
    plane = np.empty((3, n))
    axis = np.empty((3, n))
    h = np.empty((3, 3))
    for e in range(elements):
        for t in range(along):
            for i in range(n):
                for a in range(3):
                    value = 0.0
                    slope = 0.0
                    for j in range(functions):
                        value += axial[e, t, j] * nodal[e, j, i, a]
                        slope += slopes[e, t, j] * nodal[e, j, i, a]
                    plane[a, i] = value
                    axis[a, i] = slope
            for q in range(points):
                for a in range(3):
                    h0 = 0.0
                    h1 = 0.0
                    h2 = 0.0
                    for i in range(n):
                        h0 += plane[a, i] * section[q, 0, i]
                        h1 += plane[a, i] * section[q, 1, i]
                        h2 += axis[a, i] * section[q, 2, i]
                    h[a, 0] = h0
                    h[a, 1] = h1
                    h[a, 2] = h2
                for a in range(3):
                    for b in range(3):
                        result[e, t, q, a, b] = (
                            h[a, 0] * inverse[e, t, q, 0, b]
                            + h[a, 1] * inverse[e, t, q, 1, b]
                            + h[a, 2] * inverse[e, t, q, 2, b]
                        )
                    result[e, t, q, a, a] += 1.0
    return result


@njit(f"{_D4}({_D3}, {_D3}, {_D3}, {_D5}, {_D3}, {_D5})", **_OPTIONS)
def internal_forces(
    section: Array, axial: Array, slopes: Array, inverse: Array, weights: Array, stress: Array
) -> Array:
    """Return the nodal forces ``(E, l, n, 3)`` of the first Piola-Kirchhoff stress ``(E, t, q, 3, 3)``."""
    elements, along, functions = axial.shape
    points, _, n = section.shape
    result = np.zeros((elements, functions, n, 3))
    plane = np.empty((3, n))
    axis = np.empty((3, n))
    s = np.empty((3, 3))
    for e in range(elements):
        for t in range(along):
            plane[:] = 0.0
            axis[:] = 0.0
            for q in range(points):
                for a in range(3):
                    for d in range(3):
                        s[a, d] = weights[e, t, q] * (
                            stress[e, t, q, a, 0] * inverse[e, t, q, d, 0]
                            + stress[e, t, q, a, 1] * inverse[e, t, q, d, 1]
                            + stress[e, t, q, a, 2] * inverse[e, t, q, d, 2]
                        )
                for a in range(3):
                    for i in range(n):
                        plane[a, i] += s[a, 0] * section[q, 0, i] + s[a, 1] * section[q, 1, i]
                        axis[a, i] += s[a, 2] * section[q, 2, i]
            for j in range(functions):
                for i in range(n):
                    for a in range(3):
                        result[e, j, i, a] += axial[e, t, j] * plane[a, i] + slopes[e, t, j] * axis[a, i]
    return result


@njit(f"{_D5}({_D3}, {_D3}, {_D3})", **_OPTIONS)
def mass(section: Array, axial: Array, weights: Array) -> Array:
    """Return the integrals ``(E, l, n, l, n)`` of products of two functions, the weights being masses."""
    elements, along, functions = axial.shape
    points, _, n = section.shape
    result = np.zeros((elements, functions, n, functions, n))
    plane = np.empty((n, n))
    for e in range(elements):
        for t in range(along):
            plane[:] = 0.0
            for q in range(points):
                for i in range(n):
                    x = weights[e, t, q] * section[q, 2, i]
                    for k in range(n):
                        plane[i, k] += x * section[q, 2, k]
            for j in range(functions):
                for i in range(n):
                    for m in range(functions):
                        x = axial[e, t, j] * axial[e, t, m]
                        for k in range(n):
                            result[e, j, i, m, k] += x * plane[i, k]
    return result


@njit(f"Tuple(({_I1}, {_I1}, {_I1}, {_I3}, {_I2}, i8))({_I2}, i8)", **_OPTIONS)
def pattern(element_layers: Index, size: int) -> tuple[Index, Index, Index, Index, Index, int]:
    """Return how elements couple layers of ``size`` entries, row by row (`isorod.assembly.pattern.Pattern`); negative layers are none.

    Those are the layers that have rows; where the columns of each begin, and the columns' layers; where the block ``j, m`` of an
    element begins, -1 if it has no place, and how far its rows are apart; the number of entries.
    """
    elements, functions = element_layers.shape
    count = element_layers.max() + 1
    keys = np.empty(elements * functions * functions, dtype=np.int64)
    place = 0
    for e in range(elements):
        for j in range(functions):
            for m in range(functions):
                if element_layers[e, j] >= 0 and element_layers[e, m] >= 0:
                    keys[place] = element_layers[e, j] * count + element_layers[e, m]
                    place += 1
    pairs = np.unique(keys[:place])
    columns = pairs % count
    layers = np.unique(pairs // count)
    first = np.searchsorted(pairs, layers * count)
    first = np.append(first, pairs.size)
    start = np.full((elements, functions, functions), -1, dtype=np.int64)
    width = np.zeros((elements, functions), dtype=np.int64)
    for e in range(elements):
        for j in range(functions):
            if element_layers[e, j] < 0:
                continue
            row = np.searchsorted(layers, element_layers[e, j])
            width[e, j] = (first[row + 1] - first[row]) * size
            for m in range(functions):
                if element_layers[e, m] < 0:
                    continue
                pair = np.searchsorted(pairs, element_layers[e, j] * count + element_layers[e, m])
                start[e, j, m] = size * (first[row] * size + pair - first[row])
    return layers, first, columns, start, width, pairs.size * size * size


@njit(f"UniTuple({_I1}, 2)({_I1}, {_I1}, {_I1}, i8, i8, {_I1})", **_OPTIONS)
def pattern_indices(
    layers: Index, first: Index, columns: Index, size: int, total: int, number: Index
) -> tuple[Index, Index]:
    """Return the numbers of row and column of each entry of an `isorod.assembly.pattern.Pattern`.

    Row layer ``layers[r]`` couples with the layers ``columns[first[r] : first[r + 1]]``.
    """
    row = np.empty(total, dtype=np.int64)
    column = np.empty(total, dtype=np.int64)
    place = 0
    for r in range(layers.size):
        for i in range(size):
            own = number[layers[r] * size + i]
            for c in range(first[r], first[r + 1]):
                other = columns[c] * size
                for k in range(size):
                    row[place] = own
                    column[place] = number[other + k]
                    place += 1
    return row, column


@njit(**_OPTIONS)
def pattern_rows(
    layers: Index, first: Index, columns: Index, size: int, number: Index, places: Index, start: Any, column: Any
) -> int:
    """Fill ``start`` and ``column`` with the compressed rows of the entries of a pattern that have a number, ``places`` with which they are (if it has room: it need not where all are).

    Returns how many there are, or -1 if rows or columns do not ascend.
    """
    total = 0
    place = 0
    row = -1
    near = np.empty(size * np.diff(first).max() if layers.size else 0, dtype=np.int64)
    for r in range(layers.size):
        # All rows of a layer have the same columns.
        width = size * (first[r + 1] - first[r])
        count = 0
        last = -1
        ascend = True
        for c in range(first[r], first[r + 1]):
            for k in range(size):
                other = number[columns[c] * size + k]
                if other >= 0:
                    ascend = ascend and other > last
                    last = other
                    column[total + count] = other
                    near[count] = (c - first[r]) * size + k
                    count += 1
        begin = total
        for i in range(size):
            own = number[layers[r] * size + i]
            if own >= 0:
                if own <= row or not ascend:
                    return -1
                while row < own:
                    row += 1
                    start[row] = total
                if total > begin:
                    column[total : total + count] = column[begin : begin + count]
                for k in range(count if places.size else 0):
                    places[total + k] = place + near[k]
                total += count
            place += width
    for i in range(row + 1, start.size):
        start[i] = total
    return total


@njit(f"f8[::1]({_D5}, {_I3}, {_I2}, i8)", **_OPTIONS)
def merge(blocks: Array, start: Index, width: Index, total: int) -> Array:
    """Return the sum of element matrices ``(E, l, size, l, size)`` as entries of a pattern.

    Block ``j, m`` of element ``e`` begins at ``start[e, j, m]``, negative if it has no place; its rows are ``width[e, j]`` entries apart.
    """
    elements, functions, size = blocks.shape[:3]
    result = np.zeros(total)
    for e in range(elements):
        for j in range(functions):
            for i in range(size):
                for m in range(functions):
                    if start[e, j, m] < 0:
                        continue
                    place = start[e, j, m] + i * width[e, j]
                    for k in range(size):
                        result[place + k] += blocks[e, j, i, m, k]
    return result
