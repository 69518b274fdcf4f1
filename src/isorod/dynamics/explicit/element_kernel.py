"""The compiled element loops of explicit dynamics: internal forces and energies.

The loops are optimised for short steps on one thread.  Quadrature points are taken in blocks of ``POINTS``, with values
at the points of a block contiguous in a row, so that each loop over a block is a few vector instructions.  The sums are
factorised as in `isorod.assembly.element_kernel`, and nothing is stored for more than one block.  Indices are unsigned
and block lengths constants: only then can the compiler see that rows do not overlap.

A state vector holds layer by layer the x, then the y, then the z components of all nodes of the layer.
"""

import numpy as np
from numba import b1, f8, types, void
from numba import u8 as _u

from isorod.arrays import Array
from isorod.assembly.block_kernel import deform_point, pull_back_point
from isorod.compiled import F1, FAST, njit
from isorod.dynamics.explicit.mesh import GEOMETRY, MESH, Mesh
from isorod.material.points import (
    ACTIVE,
    DETERMINANT,
    ENERGY,
    FIBRE,
    LOST,
    POINTS,
    WORK,
    call_block,
)
from isorod.material.points import ROWS as _R

_W = np.uint64(POINTS)
_0, _1, _2, _3, _4, _6, _9 = (np.uint64(k) for k in (0, 1, 2, 3, 4, 6, 9))


@njit(void(F1, _u, F1, _u, F1), **FAST)
def _gradients(sections: Array, start: int, coefficients: Array, n: int, work: Array) -> None:
    """Fill rows 0-8 of the work space with the gradients on disk x axis at the points of a block."""
    for k in range(_9 * _W):
        work[k] = 0.0
    i = _0
    # Four functions at a time and three components: a row of a function is read once, one of the work space for four
    # multiplications.
    while i + _4 <= n:
        for d in range(_3):
            # The coefficients are followed by their derivatives along the axis, which multiply the functions.
            p = i if d < _2 else _3 * n + i
            q, r = p + n, p + _2 * n
            x0, x1, x2, x3 = coefficients[p], coefficients[p + _1], coefficients[p + _2], coefficients[p + _3]
            y0, y1, y2, y3 = coefficients[q], coefficients[q + _1], coefficients[q + _2], coefficients[q + _3]
            z0, z1, z2, z3 = coefficients[r], coefficients[r + _1], coefficients[r + _2], coefficients[r + _3]
            s, h = start + i * _R[3] + d * _W, d * _W
            for k in range(_W):
                f0, f1, f2, f3 = (
                    sections[s + k],
                    sections[s + _R[3] + k],
                    sections[s + _R[6] + k],
                    sections[s + _R[9] + k],
                )
                work[h + k] += x0 * f0 + x1 * f1 + x2 * f2 + x3 * f3
                work[h + _R[3] + k] += y0 * f0 + y1 * f1 + y2 * f2 + y3 * f3
                work[h + _R[6] + k] += z0 * f0 + z1 * f1 + z2 * f2 + z3 * f3
        i += _4
    while i < n:
        for d in range(_3):
            p = i if d < _2 else _3 * n + i
            x, y, z = coefficients[p], coefficients[p + n], coefficients[p + _2 * n]
            s, h = start + i * _R[3] + d * _W, d * _W
            for k in range(_W):
                f = sections[s + k]
                work[h + k] += x * f
                work[h + _R[3] + k] += y * f
                work[h + _R[6] + k] += z * f
        i += _1


@njit(f8(F1, _u, F1), **FAST)
def _deform(geometry: Array, g: int, work: Array) -> float:
    """Fill in ``F`` and ``det F``; return the number of points where ``det F`` is not positive."""
    for k in range(_W):
        deform_point(geometry, g + k, work, k)
    inverted = 0.0
    for k in range(_W):
        det = work[_R[DETERMINANT] + k]
        # NaN fails the comparison.
        inverted += 0.0 if det > 0.0 else 1.0
    return inverted


@njit(void(F1, _u, _u, F1), **FAST)
def _take_fibres(fibres: Array, begin: int, size: int, work: Array) -> None:
    """Fill in the rows of the fibres, ``size`` numbers."""
    for k in range(size):
        work[_R[FIBRE] + k] = fibres[begin + k]


@njit(void(F1, _u, F1), **FAST)
def _pull_back(geometry: Array, g: int, work: Array) -> None:
    """Replace ``P`` by ``P`` times the volume, pulled back to disk x axis."""
    for k in range(_W):
        pull_back_point(geometry, g + k, work, k)


@njit(void(F1, _u, _u, types.UniTuple(f8, 6)), **FAST)
def _add_to(resultants: Array, i: int, n: int, sums: tuple[float, ...]) -> None:
    """Add to the resultants of function ``i`` those of the section, then those along the axis."""
    x0, x1, x2, y0, y1, y2 = sums
    n3 = _3 * n
    resultants[i] += x0
    resultants[n + i] += x1
    resultants[_2 * n + i] += x2
    resultants[n3 + i] += y0
    resultants[n3 + n + i] += y1
    resultants[n3 + _2 * n + i] += y2


@njit(void(F1, _u, F1, _u, F1), **FAST)
def _add_resultants(sections: Array, start: int, work: Array, n: int, resultants: Array) -> None:
    """Add the integrals of rows 0-8 against the section functions: those of the section, then those along the axis."""
    i = _0
    # Two functions at a time: a row of the work space is read once for both.
    while i + _2 <= n:
        s = start + i * _R[3]
        t = s + _R[3]
        x0 = x1 = x2 = y0 = y1 = y2 = 0.0
        u0 = u1 = u2 = v0 = v1 = v2 = 0.0
        for k in range(_W):
            f, g, h = sections[s + k], sections[s + _R[1] + k], sections[s + _R[2] + k]
            a, b, c = sections[t + k], sections[t + _R[1] + k], sections[t + _R[2] + k]
            p, q, r = work[k], work[_R[1] + k], work[_R[2] + k]
            x0 += p * f + q * g
            u0 += p * a + q * b
            y0 += r * h
            v0 += r * c
            p, q, r = work[_R[3] + k], work[_R[4] + k], work[_R[5] + k]
            x1 += p * f + q * g
            u1 += p * a + q * b
            y1 += r * h
            v1 += r * c
            p, q, r = work[_R[6] + k], work[_R[7] + k], work[_R[8] + k]
            x2 += p * f + q * g
            u2 += p * a + q * b
            y2 += r * h
            v2 += r * c
        _add_to(resultants, i, n, (x0, x1, x2, y0, y1, y2))
        _add_to(resultants, i + _1, n, (u0, u1, u2, v0, v1, v2))
        i += _2
    while i < n:
        s = start + i * _R[3]
        x0 = x1 = x2 = y0 = y1 = y2 = 0.0
        for k in range(_W):
            f, g, h = sections[s + k], sections[s + _R[1] + k], sections[s + _R[2] + k]
            x0 += work[k] * f + work[_R[1] + k] * g
            x1 += work[_R[3] + k] * f + work[_R[4] + k] * g
            x2 += work[_R[6] + k] * f + work[_R[7] + k] * g
            y0 += work[_R[2] + k] * h
            y1 += work[_R[5] + k] * h
            y2 += work[_R[8] + k] * h
        _add_to(resultants, i, n, (x0, x1, x2, y0, y1, y2))
        i += _1


@njit(void(MESH, _u, _u, F1, F1), **FAST)
def _coefficients(mesh: Mesh, e: int, t: int, u: Array, coefficients: Array) -> None:
    """Fill in the section coefficients of ``u`` at a point along the axis, followed by their derivatives."""
    element = mesh.elements[e]
    n3 = _3 * element.functions
    row = element.axial + _2 * t * element.along
    for k in range(_2 * n3):
        coefficients[k] = 0.0
    for j in range(element.along):
        value, slope = mesh.axial[row + j], mesh.axial[row + element.along + j]
        layer = mesh.layers[e, j]
        for k in range(n3):
            coefficients[k] += value * u[layer + k]
            coefficients[n3 + k] += slope * u[layer + k]


@njit(void(MESH, _u, _u, F1, F1), **FAST)
def _add_forces(mesh: Mesh, e: int, t: int, resultants: Array, forces: Array) -> None:
    """Add the forces by the resultants at a point along the axis."""
    element = mesh.elements[e]
    n3 = _3 * element.functions
    row = element.axial + _2 * t * element.along
    for j in range(element.along):
        value, slope = mesh.axial[row + j], mesh.axial[row + element.along + j]
        layer = mesh.layers[e, j]
        for k in range(n3):
            forces[layer + k] += value * resultants[k] + slope * resultants[n3 + k]


@njit(void(MESH, f8), **FAST)
def elapse(mesh: Mesh, time: float) -> None:
    """Set the time since the states of laws with memory."""
    for e in range(np.uint64(mesh.elements.shape[0])):
        if mesh.elements[e].clock:
            mesh.constants[mesh.elements[e].constants + mesh.elements[e].clock] = time


@njit(types.UniTuple(f8, 4)(MESH, F1, f8, b1, b1, F1), **FAST)
def internal_forces(
    mesh: Mesh, u: Array, activation: float, energies: bool, update: bool, forces: Array
) -> tuple[float, float, float, float]:
    """Fill ``forces`` with the internal forces of a displacement; those of inverted elements are not usable.

    Parameters
    ----------
    u, forces
        State vectors, shape ``(dofs,)``.
    activation
        Fraction of the laws' activation.
    energies
        Whether to compute energies; not those of laws with memory that are updated.
    update
        Whether to update the states of laws with memory.

    Returns
    -------
    inverted
        Number of points with ``det F <= 0`` (or NaN).
    stored, active
        Energy without activation, and that added by full activation.
    lost
        Dissipation of laws with memory.
    """
    largest = np.uint64(0)
    for e in range(np.uint64(mesh.elements.shape[0])):
        largest = max(largest, mesh.elements[e].functions)
    # Coefficients, then resultants.
    coefficients = np.empty(np.int64(_6 * largest))
    resultants = np.empty(np.int64(_6 * largest))
    work = np.empty(WORK * POINTS)
    forces[:] = 0.0
    inverted = stored = active = lost = 0.0
    for e in range(np.uint64(mesh.elements.shape[0])):
        element = mesh.elements[e]
        n, blocks, directions = element.functions, element.blocks, element.directions * _W
        updates = update and element.update > 0
        block = element.update if updates else element.block
        constants = mesh.constants[element.constants : element.constants + element.count]
        for t in range(element.points):
            _coefficients(mesh, e, t, u, coefficients)
            for k in range(_6 * n):
                resultants[k] = 0.0
            for b in range(blocks):
                section = element.sections + b * n * _R[3]
                g = element.geometry + (t * blocks + b) * np.uint64(GEOMETRY) * _W
                _gradients(mesh.sections, section, coefficients, n, work)
                inverted += _deform(mesh.geometry, g, work)
                f = element.fibres + (t * blocks + b) * directions
                if directions:
                    _take_fibres(mesh.fibres, f, directions, work)
                call_block(block, (work, constants, activation, energies))
                if updates:
                    for k in range(directions):
                        mesh.fibres[f + k] = work[_R[FIBRE] + k]
                elif energies:
                    for k in range(_W):
                        stored += mesh.geometry[g + _R[9] + k] * work[_R[ENERGY] + k]
                        active += mesh.geometry[g + _R[9] + k] * work[_R[ACTIVE] + k]
                    if element.update:
                        for k in range(_W):
                            lost += mesh.geometry[g + _R[9] + k] * work[_R[LOST] + k]
                _pull_back(mesh.geometry, g, work)
                _add_resultants(mesh.sections, section, work, n, resultants)
            _add_forces(mesh, e, t, resultants, forces)
    return inverted, stored, active, lost
