"""The compiled element loops of explicit dynamics: internal forces and energies.

Everything is made for short steps on one thread.  Quadrature points are taken in blocks of ``POINTS``; what belongs to
the points of a block lies side by side in a row, so that each loop over a block is a few vector instructions.  The sums
are factorised as in `isorod.assembly.element_kernel`, and nothing is stored for more than one block.  Indices are
unsigned and block lengths constants: only then does the compiler see that rows do not overlap.

A state vector holds layer by layer the x, then the y, then the z components of all nodes of the layer.
"""

import numpy as np
from numba import b1, f8, njit, types, u8, void

from isorod.arrays import Array
from isorod.compiled import F1, FAST
from isorod.dynamics.explicit.mesh import GEOMETRY, MESH, POINTS, Mesh

# Rows of the work space: gradients, later stresses, on disk x axis (9), F (9), det F, ln det F, fibre n = F f (3), its
# length (the stretch), and exp(m2 (stretch^2 - 1)) - 1.
WORK = 25

_W = np.uint64(POINTS)
_0, _1, _2, _3, _4, _5, _6, _9 = (np.uint64(k) for k in (0, 1, 2, 3, 4, 5, 6, 9))
_R = tuple(np.uint64(POINTS * k) for k in range(max(GEOMETRY, WORK)))


_u, f8 = u8, f8


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
            # Behind the coefficients are their derivatives along the axis, which go with the functions themselves.
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


@njit(types.UniTuple(f8, 2)(F1, _u, F1), **FAST)
def _deform(geometry: Array, g: int, work: Array) -> tuple[float, float]:
    """Fill rows 9-18 with ``F`` and ``det F``; return the number of points where it is not positive, and where not in [1/2, 2]."""
    for k in range(_W):
        at = g + k
        i00, i01, i02 = geometry[at], geometry[at + _R[1]], geometry[at + _R[2]]
        i10, i11, i12 = geometry[at + _R[3]], geometry[at + _R[4]], geometry[at + _R[5]]
        i20, i21, i22 = geometry[at + _R[6]], geometry[at + _R[7]], geometry[at + _R[8]]
        h0, h1, h2 = work[k], work[_R[1] + k], work[_R[2] + k]
        f00 = 1.0 + (h0 * i00 + h1 * i10 + h2 * i20)
        f01 = h0 * i01 + h1 * i11 + h2 * i21
        f02 = h0 * i02 + h1 * i12 + h2 * i22
        h0, h1, h2 = work[_R[3] + k], work[_R[4] + k], work[_R[5] + k]
        f10 = h0 * i00 + h1 * i10 + h2 * i20
        f11 = 1.0 + (h0 * i01 + h1 * i11 + h2 * i21)
        f12 = h0 * i02 + h1 * i12 + h2 * i22
        h0, h1, h2 = work[_R[6] + k], work[_R[7] + k], work[_R[8] + k]
        f20 = h0 * i00 + h1 * i10 + h2 * i20
        f21 = h0 * i01 + h1 * i11 + h2 * i21
        f22 = 1.0 + (h0 * i02 + h1 * i12 + h2 * i22)
        work[_R[9] + k], work[_R[10] + k], work[_R[11] + k] = f00, f01, f02
        work[_R[12] + k], work[_R[13] + k], work[_R[14] + k] = f10, f11, f12
        work[_R[15] + k], work[_R[16] + k], work[_R[17] + k] = f20, f21, f22
        work[_R[18] + k] = f00 * (f11 * f22 - f12 * f21) + f01 * (f12 * f20 - f10 * f22) + f02 * (f10 * f21 - f11 * f20)
    inverted = 0.0
    far = 0.0
    for k in range(_W):
        det = work[_R[18] + k]
        # NaN fails the comparisons.
        inverted += 0.0 if det > 0.0 else 1.0
        far += 0.0 if (det >= 0.5) & (det <= 2.0) else 1.0
    return inverted, far


@njit(void(F1, b1), **FAST)
def _logarithms(work: Array, far: bool) -> None:
    """Fill row 19 with ``ln det F``: by a series that is exact to rounding in [1/2, 2], or anywhere by the library."""
    if far:
        for k in range(_W):
            work[_R[19] + k] = np.log(work[_R[18] + k])
        return
    for k in range(_W):
        det = work[_R[18] + k]
        z = (det - 1.0) / (det + 1.0)
        x = z * z
        # 2 atanh z, |z| <= 1/3
        y = 1.0 / 29.0 + x * (1.0 / 31.0)
        y = 1.0 / 25.0 + x * (1.0 / 27.0 + x * y)
        y = 1.0 / 21.0 + x * (1.0 / 23.0 + x * y)
        y = 1.0 / 17.0 + x * (1.0 / 19.0 + x * y)
        y = 1.0 / 13.0 + x * (1.0 / 15.0 + x * y)
        y = 1.0 / 9.0 + x * (1.0 / 11.0 + x * y)
        y = 1.0 / 5.0 + x * (1.0 / 7.0 + x * y)
        work[_R[19] + k] = 2.0 * z * (1.0 + x * (1.0 / 3.0 + x * y))


@njit(void(F1, _u, f8, f8, F1), **FAST)
def _matrix_stress(geometry: Array, g: int, mu: float, lame: float, work: Array) -> None:
    """Fill rows 0-8 with the neo-Hookean ``P``, times the volume, on disk x axis: ``w P J^-T``."""
    for k in range(_W):
        f00, f01, f02 = work[_R[9] + k], work[_R[10] + k], work[_R[11] + k]
        f10, f11, f12 = work[_R[12] + k], work[_R[13] + k], work[_R[14] + k]
        f20, f21, f22 = work[_R[15] + k], work[_R[16] + k], work[_R[17] + k]
        m = geometry[g + _R[9] + k]
        q = m * (lame * work[_R[19] + k] - mu) / work[_R[18] + k]
        m *= mu
        at = g + k
        i00, i01, i02 = geometry[at], geometry[at + _R[1]], geometry[at + _R[2]]
        i10, i11, i12 = geometry[at + _R[3]], geometry[at + _R[4]], geometry[at + _R[5]]
        i20, i21, i22 = geometry[at + _R[6]], geometry[at + _R[7]], geometry[at + _R[8]]
        p0 = m * f00 + q * (f11 * f22 - f12 * f21)
        p1 = m * f01 + q * (f12 * f20 - f10 * f22)
        p2 = m * f02 + q * (f10 * f21 - f11 * f20)
        work[k] = p0 * i00 + p1 * i01 + p2 * i02
        work[_R[1] + k] = p0 * i10 + p1 * i11 + p2 * i12
        work[_R[2] + k] = p0 * i20 + p1 * i21 + p2 * i22
        p0 = m * f10 + q * (f21 * f02 - f22 * f01)
        p1 = m * f11 + q * (f22 * f00 - f20 * f02)
        p2 = m * f12 + q * (f20 * f01 - f21 * f00)
        work[_R[3] + k] = p0 * i00 + p1 * i01 + p2 * i02
        work[_R[4] + k] = p0 * i10 + p1 * i11 + p2 * i12
        work[_R[5] + k] = p0 * i20 + p1 * i21 + p2 * i22
        p0 = m * f20 + q * (f01 * f12 - f02 * f11)
        p1 = m * f21 + q * (f02 * f10 - f00 * f12)
        p2 = m * f22 + q * (f00 * f11 - f01 * f10)
        work[_R[6] + k] = p0 * i00 + p1 * i01 + p2 * i02
        work[_R[7] + k] = p0 * i10 + p1 * i11 + p2 * i12
        work[_R[8] + k] = p0 * i20 + p1 * i21 + p2 * i22


@njit(void(F1, _u, f8, F1), **FAST)
def _stretches(geometry: Array, g: int, m2: float, work: Array) -> None:
    """Fill rows 20-24 with ``n = F f``, its length, and ``exp(m2 (stretch^2 - 1)) - 1`` where the fibre is stretched, else 0."""
    for k in range(_W):
        f0, f1, f2 = geometry[g + _R[10] + k], geometry[g + _R[11] + k], geometry[g + _R[12] + k]
        n0 = work[_R[9] + k] * f0 + work[_R[10] + k] * f1 + work[_R[11] + k] * f2
        n1 = work[_R[12] + k] * f0 + work[_R[13] + k] * f1 + work[_R[14] + k] * f2
        n2 = work[_R[15] + k] * f0 + work[_R[16] + k] * f1 + work[_R[17] + k] * f2
        square = n0 * n0 + n1 * n1 + n2 * n2
        # Points that only fill up a block have no fibre.
        square = square if square > 0.0 else 1.0
        work[_R[20] + k], work[_R[21] + k], work[_R[22] + k] = n0, n1, n2
        work[_R[23] + k] = np.sqrt(square)
        work[_R[24] + k] = m2 * (square - 1.0 if square > 1.0 else 0.0)
    large = 0.0
    for k in range(_W):
        large += 1.0 if work[_R[24] + k] > 1.0 else 0.0
    if large > 0.0:
        for k in range(_W):
            work[_R[24] + k] = np.expm1(work[_R[24] + k])
        return
    # The exponential series: to rounding up to 1.
    for k in range(_W):
        x = work[_R[24] + k]
        y = 1.0 + x * (1.0 / 17.0) * (1.0 + x * (1.0 / 18.0))
        y = 1.0 + x * (1.0 / 15.0) * (1.0 + x * (1.0 / 16.0) * y)
        y = 1.0 + x * (1.0 / 13.0) * (1.0 + x * (1.0 / 14.0) * y)
        y = 1.0 + x * (1.0 / 11.0) * (1.0 + x * (1.0 / 12.0) * y)
        y = 1.0 + x * (1.0 / 9.0) * (1.0 + x * (1.0 / 10.0) * y)
        y = 1.0 + x * (1.0 / 7.0) * (1.0 + x * (1.0 / 8.0) * y)
        y = 1.0 + x * (1.0 / 5.0) * (1.0 + x * (1.0 / 6.0) * y)
        y = 1.0 + x * (1.0 / 3.0) * (1.0 + x * (1.0 / 4.0) * y)
        work[_R[24] + k] = x * (1.0 + x * 0.5 * y)


@njit(void(F1, _u, f8, f8, F1), **FAST)
def _add_fibre_stress(geometry: Array, g: int, active: float, m1: float, work: Array) -> None:
    """Add ``w T/stretch (F f) (J^-1 f)`` to rows 0-8, ``T`` the fibre's tension (eqs. 18, 19 of the paper, as in `isorod.material.muscle`)."""
    for k in range(_W):
        stretch = work[_R[23] + k]
        short = stretch - 1.0
        level = 1.0 - 4.0 * short * short
        level = level if level > 0.0 else 0.0
        factor = geometry[g + _R[9] + k] * (active * level / stretch + m1 * work[_R[24] + k])
        for a in range(_3):
            x = factor * work[_R[20] + a * _W + k]
            work[a * _R[3] + k] += x * geometry[g + _R[13] + k]
            work[a * _R[3] + _R[1] + k] += x * geometry[g + _R[14] + k]
            work[a * _R[3] + _R[2] + k] += x * geometry[g + _R[15] + k]


@njit(void(F1, _u, F1, _u, F1), **FAST)
def _add_resultants(sections: Array, start: int, work: Array, n: int, resultants: Array) -> None:
    """Add the integrals of rows 0-8 against the section functions: those of the section, then those along the axis."""
    n3 = _3 * n
    for i in range(n):
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
        resultants[i] += x0
        resultants[n + i] += x1
        resultants[_2 * n + i] += x2
        resultants[n3 + i] += y0
        resultants[n3 + n + i] += y1
        resultants[n3 + _2 * n + i] += y2


@njit(void(MESH, _u, _u, F1, F1), **FAST)
def _coefficients(mesh: Mesh, e: int, t: int, u: Array, coefficients: Array) -> None:
    """Fill in the section coefficients of ``u`` at a point along the axis and, behind them, their derivatives."""
    n3 = _3 * mesh.elements[e, _0]
    functions = mesh.elements[e, _3]
    row = mesh.elements[e, _5] + _2 * t * functions
    for k in range(_2 * n3):
        coefficients[k] = 0.0
    for j in range(functions):
        value, slope = mesh.axial[row + j], mesh.axial[row + functions + j]
        layer = mesh.layers[e, j]
        for k in range(n3):
            coefficients[k] += value * u[layer + k]
            coefficients[n3 + k] += slope * u[layer + k]


@njit(f8(MESH, F1, f8, F1), **FAST)
def internal_forces(mesh: Mesh, u: Array, activation: float, forces: Array) -> float:
    """Fill ``forces`` with the internal forces of the displacement ``u``; return the number of points with ``det F <= 0`` (or NaN).

    ``activation`` multiplies that of the laws.  Forces of an element that is inverted are not usable.
    """
    largest = np.max(mesh.elements[:, 0])
    # Coefficients, then resultants.
    coefficients = np.empty(np.int64(_6 * largest))
    resultants = np.empty(np.int64(_6 * largest))
    work = np.empty(WORK * POINTS)
    forces[:] = 0.0
    inverted = 0.0
    for e in range(np.uint64(mesh.elements.shape[0])):
        n, blocks, along, functions = (
            mesh.elements[e, _0],
            mesh.elements[e, _1],
            mesh.elements[e, _2],
            mesh.elements[e, _3],
        )
        n3 = _3 * n
        mu, lame = mesh.laws[e, 0], mesh.laws[e, 1]
        active, m1, m2 = activation * mesh.laws[e, 2], mesh.laws[e, 3], mesh.laws[e, 4]
        for t in range(along):
            _coefficients(mesh, e, t, u, coefficients)
            for k in range(_2 * n3):
                resultants[k] = 0.0
            for b in range(blocks):
                section = mesh.elements[e, _4] + b * n * _R[3]
                g = mesh.elements[e, _6] + (t * blocks + b) * np.uint64(GEOMETRY) * _W
                _gradients(mesh.sections, section, coefficients, n, work)
                bad, far = _deform(mesh.geometry, g, work)
                inverted += bad
                _logarithms(work, far > 0.0)
                _matrix_stress(mesh.geometry, g, mu, lame, work)
                if active > 0.0 or m1 > 0.0:
                    _stretches(mesh.geometry, g, m2, work)
                    _add_fibre_stress(mesh.geometry, g, active, m1, work)
                _add_resultants(mesh.sections, section, work, n, resultants)
            row = mesh.elements[e, _5] + _2 * t * functions
            for j in range(functions):
                value, slope = mesh.axial[row + j], mesh.axial[row + functions + j]
                layer = mesh.layers[e, j]
                for k in range(n3):
                    forces[layer + k] += value * resultants[k] + slope * resultants[n3 + k]
    return inverted


@njit(types.UniTuple(f8, 2)(MESH, F1), **FAST)
def energies(mesh: Mesh, u: Array) -> tuple[float, float]:
    """Return the stored energy of matrix and passive fibres, and that of the active ones at full activation."""
    coefficients = np.empty(np.int64(_6 * np.max(mesh.elements[:, 0])))
    work = np.empty(WORK * POINTS)
    stored = 0.0
    active = 0.0
    for e in range(np.uint64(mesh.elements.shape[0])):
        n, blocks, along = mesh.elements[e, _0], mesh.elements[e, _1], mesh.elements[e, _2]
        mu, lame, strongest, m1, m2 = mesh.laws[e]
        for t in range(along):
            _coefficients(mesh, e, t, u, coefficients)
            for b in range(blocks):
                g = mesh.elements[e, _6] + (t * blocks + b) * np.uint64(GEOMETRY) * _W
                _gradients(mesh.sections, mesh.elements[e, _4] + b * n * _R[3], coefficients, n, work)
                _, far = _deform(mesh.geometry, g, work)
                _logarithms(work, far > 0.0)
                fibres = strongest > 0.0 or m1 > 0.0
                if fibres:
                    _stretches(mesh.geometry, g, m2, work)
                for k in range(_W):
                    volume = mesh.geometry[g + _R[9] + k]
                    log = work[_R[19] + k]
                    trace = 0.0
                    for r in range(_9, _9 + _9):
                        trace += work[r * _W + k] ** 2
                    stored += volume * (0.5 * mu * (trace - 3.0 - 2.0 * log) + 0.5 * lame * log * log)
                    if fibres:
                        stretch = work[_R[23] + k]
                        short = min(max(stretch - 1.0, -0.5), 0.5)
                        active += volume * strongest * (short - 4.0 / 3.0 * short**3)
                        squared = max(stretch, 1.0) ** 2 - 1.0
                        growth = work[_R[24] + k] / m2 if m2 > 0.0 else squared
                        stored += volume * 0.5 * m1 * (growth - squared)
    return stored, active
