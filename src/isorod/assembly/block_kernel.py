"""Steps of evaluating forces and tangents at a block of quadrature points, compiled.

Rows of a block are as in `isorod.material.points`, which explains the unsigned indices.  The rows after the law's:
``d(xi_1, xi_2, u)/dx``, the weight, present ``F`` and ``det F`` while the law's rows hold the last state's, the
extrapolated stress, and the present and the last pressure of the mixed formulation.  Compiled once; callers use their
addresses (`Steps`).
"""

from typing import NamedTuple

import numpy as np
from numba import i8, types

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.points import (
    DETERMINANT,
    MODULI,
    MODULI_WORK,
    POINTS,
    SQUARES,
    STEP,
    add_products,
)
from isorod.material.points import ROWS as _R

_W = np.uint64(POINTS)
_3 = np.uint64(3)

INVERSE, WEIGHT, STATE, TARGET = MODULI_WORK, MODULI_WORK + 9, MODULI_WORK + 10, MODULI_WORK + 20
PRESSURE, BEFORE = TARGET + 6, TARGET + 7
SIZE = POINTS * (BEFORE + 1)

_M, _Q, _G = MODULI, SQUARES, INVERSE


@njit(**FAST)
def deform_point(geometry: Array, at: int, work: Array, k: int) -> None:
    """Fill in ``F`` and its determinant at a point from the gradient on disk x axis in the rows of the stress.

    Its inverse Jacobian, and the weight behind that, are rows of ``geometry``, of which ``at`` is the first.
    """
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
    work[_R[DETERMINANT] + k] = (
        f00 * (f11 * f22 - f12 * f21) + f01 * (f12 * f20 - f10 * f22) + f02 * (f10 * f21 - f11 * f20)
    )


@njit(**FAST)
def pull_back_point(geometry: Array, at: int, work: Array, k: int) -> None:
    """Replace ``P`` at a point by that times the volume on disk x axis, ``w P_aA dxi_d/dx_A`` (`deform_point`)."""
    m = geometry[at + _R[9]]
    i00, i01, i02 = geometry[at], geometry[at + _R[1]], geometry[at + _R[2]]
    i10, i11, i12 = geometry[at + _R[3]], geometry[at + _R[4]], geometry[at + _R[5]]
    i20, i21, i22 = geometry[at + _R[6]], geometry[at + _R[7]], geometry[at + _R[8]]
    p0, p1, p2 = m * work[k], m * work[_R[1] + k], m * work[_R[2] + k]
    work[k] = p0 * i00 + p1 * i01 + p2 * i02
    work[_R[1] + k] = p0 * i10 + p1 * i11 + p2 * i12
    work[_R[2] + k] = p0 * i20 + p1 * i21 + p2 * i22
    p0, p1, p2 = m * work[_R[3] + k], m * work[_R[4] + k], m * work[_R[5] + k]
    work[_R[3] + k] = p0 * i00 + p1 * i01 + p2 * i02
    work[_R[4] + k] = p0 * i10 + p1 * i11 + p2 * i12
    work[_R[5] + k] = p0 * i20 + p1 * i21 + p2 * i22
    p0, p1, p2 = m * work[_R[6] + k], m * work[_R[7] + k], m * work[_R[8] + k]
    work[_R[6] + k] = p0 * i00 + p1 * i01 + p2 * i02
    work[_R[7] + k] = p0 * i10 + p1 * i11 + p2 * i12
    work[_R[8] + k] = p0 * i20 + p1 * i21 + p2 * i22


@njit(STEP, **FAST)
def deform(work: Array) -> None:
    """Fill in ``F`` and its determinant from the gradients on disk x axis."""
    for k in range(_W):
        deform_point(work, _R[INVERSE] + k, work, k)


@njit(STEP, **FAST)
def pull_back_stress(work: Array) -> None:
    """Replace ``P`` by that times the volume on disk x axis."""
    for k in range(_W):
        pull_back_point(work, _R[INVERSE] + k, work, k)


@njit(**FAST)
def _cofactors(work: Array, k: int) -> tuple[float, ...]:
    """Return the cofactors of ``F``, ``det F F^-T``, at a point: 00, 01, 02, 10, 11, 12, 20, 21, 22."""
    f00, f01, f02 = work[_R[9] + k], work[_R[10] + k], work[_R[11] + k]
    f10, f11, f12 = work[_R[12] + k], work[_R[13] + k], work[_R[14] + k]
    f20, f21, f22 = work[_R[15] + k], work[_R[16] + k], work[_R[17] + k]
    return (
        f11 * f22 - f12 * f21,
        f12 * f20 - f10 * f22,
        f10 * f21 - f11 * f20,
        f21 * f02 - f22 * f01,
        f22 * f00 - f20 * f02,
        f20 * f01 - f21 * f00,
        f01 * f12 - f02 * f11,
        f02 * f10 - f00 * f12,
        f00 * f11 - f01 * f10,
    )


@njit(STEP, **FAST)
def press_trace(work: Array) -> None:
    """Add the stress ``p 1`` of the mixed formulation's pressure where ``theta`` is the trace of the strain."""
    for k in range(_W):
        work[k] += work[_R[PRESSURE] + k]
        work[_R[4] + k] += work[_R[PRESSURE] + k]
        work[_R[8] + k] += work[_R[PRESSURE] + k]


@njit(STEP, **FAST)
def press(work: Array) -> None:
    """Add the stress ``p F^-T`` of the mixed formulation's pressure where ``theta`` is ``ln J``."""
    for k in range(_W):
        c00, c01, c02, c10, c11, c12, c20, c21, c22 = _cofactors(work, k)
        q = work[_R[PRESSURE] + k] / work[_R[DETERMINANT] + k]
        work[k] += q * c00
        work[_R[1] + k] += q * c01
        work[_R[2] + k] += q * c02
        work[_R[3] + k] += q * c10
        work[_R[4] + k] += q * c11
        work[_R[5] + k] += q * c12
        work[_R[6] + k] += q * c20
        work[_R[7] + k] += q * c21
        work[_R[8] + k] += q * c22


@njit(STEP, **FAST)
def press_moduli(work: Array) -> None:
    """Add ``-p G_aB G_bA``, ``G = F^-T``, to the moduli: those of the pressure where ``theta`` is ``ln J``."""
    for k in range(_W):
        c00, c01, c02, c10, c11, c12, c20, c21, c22 = _cofactors(work, k)
        det = work[_R[DETERMINANT] + k]
        q = -work[_R[PRESSURE] + k] / (det * det)
        add_products(work, k, 0.0, q, (c00, c01, c02), (c10, c11, c12), (c20, c21, c22))


@njit(STEP, **FAST)
def pull_back_moduli(work: Array) -> None:
    """Replace the moduli by ``w dP_aA/dF_bB dxi_d/dx_A dxi_c/dx_B``."""
    # One loop each: the first row has to be a constant in it.
    for k in range(_W):
        _pull_back_pair(work, k, _R[_M])
    for k in range(_W):
        _pull_back_pair(work, k, _R[_M + 9])
    for k in range(_W):
        _pull_back_pair(work, k, _R[_M + 18])
    for k in range(_W):
        _pull_back_square(work, k, _R[_Q])
    for k in range(_W):
        _pull_back_square(work, k, _R[_Q + 6])
    for k in range(_W):
        _pull_back_square(work, k, _R[_Q + 12])


@njit(**FAST)
def _pull_back_pair(work: Array, k: int, row: int) -> None:
    """Pull back the nine moduli of a pair of components at a point (`pull_back_moduli`)."""
    w = work[_R[WEIGHT] + k]
    i00, i01, i02 = work[_R[_G] + k], work[_R[_G + 1] + k], work[_R[_G + 2] + k]
    i10, i11, i12 = work[_R[_G + 3] + k], work[_R[_G + 4] + k], work[_R[_G + 5] + k]
    i20, i21, i22 = work[_R[_G + 6] + k], work[_R[_G + 7] + k], work[_R[_G + 8] + k]
    x, y, z = w * work[row + k], w * work[row + _R[1] + k], w * work[row + _R[2] + k]
    a0, b0, c0 = x * i00 + y * i01 + z * i02, x * i10 + y * i11 + z * i12, x * i20 + y * i21 + z * i22
    x, y, z = w * work[row + _R[3] + k], w * work[row + _R[4] + k], w * work[row + _R[5] + k]
    a1, b1, c1 = x * i00 + y * i01 + z * i02, x * i10 + y * i11 + z * i12, x * i20 + y * i21 + z * i22
    x, y, z = w * work[row + _R[6] + k], w * work[row + _R[7] + k], w * work[row + _R[8] + k]
    a2, b2, c2 = x * i00 + y * i01 + z * i02, x * i10 + y * i11 + z * i12, x * i20 + y * i21 + z * i22
    work[row + k] = i00 * a0 + i01 * a1 + i02 * a2
    work[row + _R[1] + k] = i00 * b0 + i01 * b1 + i02 * b2
    work[row + _R[2] + k] = i00 * c0 + i01 * c1 + i02 * c2
    work[row + _R[3] + k] = i10 * a0 + i11 * a1 + i12 * a2
    work[row + _R[4] + k] = i10 * b0 + i11 * b1 + i12 * b2
    work[row + _R[5] + k] = i10 * c0 + i11 * c1 + i12 * c2
    work[row + _R[6] + k] = i20 * a0 + i21 * a1 + i22 * a2
    work[row + _R[7] + k] = i20 * b0 + i21 * b1 + i22 * b2
    work[row + _R[8] + k] = i20 * c0 + i21 * c1 + i22 * c2


@njit(**FAST)
def _pull_back_square(work: Array, k: int, row: int) -> None:
    """Pull back the six moduli of one component at a point (`pull_back_moduli`)."""
    w = work[_R[WEIGHT] + k]
    i00, i01, i02 = work[_R[_G] + k], work[_R[_G + 1] + k], work[_R[_G + 2] + k]
    i10, i11, i12 = work[_R[_G + 3] + k], work[_R[_G + 4] + k], work[_R[_G + 5] + k]
    i20, i21, i22 = work[_R[_G + 6] + k], work[_R[_G + 7] + k], work[_R[_G + 8] + k]
    m0, m1, m2 = w * work[row + k], w * work[row + _R[1] + k], w * work[row + _R[2] + k]
    m3, m4, m5 = w * work[row + _R[3] + k], w * work[row + _R[4] + k], w * work[row + _R[5] + k]
    x, y, z = m0 * i00 + m1 * i01 + m2 * i02, m1 * i00 + m3 * i01 + m4 * i02, m2 * i00 + m4 * i01 + m5 * i02
    work[row + k] = i00 * x + i01 * y + i02 * z
    work[row + _R[1] + k] = i10 * x + i11 * y + i12 * z
    work[row + _R[2] + k] = i20 * x + i21 * y + i22 * z
    x, y, z = m0 * i10 + m1 * i11 + m2 * i12, m1 * i10 + m3 * i11 + m4 * i12, m2 * i10 + m4 * i11 + m5 * i12
    work[row + _R[3] + k] = i10 * x + i11 * y + i12 * z
    work[row + _R[4] + k] = i20 * x + i21 * y + i22 * z
    x, y, z = m0 * i20 + m1 * i21 + m2 * i22, m1 * i20 + m3 * i21 + m4 * i22, m2 * i20 + m4 * i21 + m5 * i22
    work[row + _R[5] + k] = i20 * x + i21 * y + i22 * z


@njit(**FAST)
def _pulled(work: Array, k: int) -> tuple[float, ...]:
    """Return ``S = F^-1 P``, symmetric, at a point: 00, 01, 02, 11, 12, 22."""
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = _cofactors(work, k)
    d = 1.0 / work[_R[DETERMINANT] + k]
    p00, p01, p02 = d * work[k], d * work[_R[1] + k], d * work[_R[2] + k]
    p10, p11, p12 = d * work[_R[3] + k], d * work[_R[4] + k], d * work[_R[5] + k]
    p20, p21, p22 = d * work[_R[6] + k], d * work[_R[7] + k], d * work[_R[8] + k]
    return (
        c00 * p00 + c10 * p10 + c20 * p20,
        0.5 * (c00 * p01 + c10 * p11 + c20 * p21 + c01 * p00 + c11 * p10 + c21 * p20),
        0.5 * (c00 * p02 + c10 * p12 + c20 * p22 + c02 * p00 + c12 * p10 + c22 * p20),
        c01 * p01 + c11 * p11 + c21 * p21,
        0.5 * (c01 * p02 + c11 * p12 + c21 * p22 + c02 * p01 + c12 * p11 + c22 * p21),
        c02 * p02 + c12 * p12 + c22 * p22,
    )


@njit(STEP, **FAST)
def foresee(work: Array) -> None:
    """Fill in the extrapolated stress at the end of a step from stress and moduli at its start, in the rows.

    With ``D`` the change of ``F`` (`isorod.assembly.extrapolation`): ``S0 + F0^-1 (A0 : D - D S0)``.
    """
    for k in range(_W):
        s0, s1, s2, s3, s4, s5 = _pulled(work, k)
        d00, d01, d02 = (
            work[_R[STATE] + k] - work[_R[9] + k],
            work[_R[STATE + 1] + k] - work[_R[10] + k],
            work[_R[STATE + 2] + k] - work[_R[11] + k],
        )
        d10, d11, d12 = (
            work[_R[STATE + 3] + k] - work[_R[12] + k],
            work[_R[STATE + 4] + k] - work[_R[13] + k],
            work[_R[STATE + 5] + k] - work[_R[14] + k],
        )
        d20, d21, d22 = (
            work[_R[STATE + 6] + k] - work[_R[15] + k],
            work[_R[STATE + 7] + k] - work[_R[16] + k],
            work[_R[STATE + 8] + k] - work[_R[17] + k],
        )
        x0, x1, x2 = _of_square(work, k, _R[_Q], d00, d01, d02)
        y0, y1, y2 = _of_square(work, k, _R[_Q + 6], d10, d11, d12)
        z0, z1, z2 = _of_square(work, k, _R[_Q + 12], d20, d21, d22)
        a0, a1, a2, b0, b1, b2 = _of_pair(work, k, _R[_M], (d00, d01, d02), (d10, d11, d12))
        x0, x1, x2, y0, y1, y2 = x0 + a0, x1 + a1, x2 + a2, y0 + b0, y1 + b1, y2 + b2
        a0, a1, a2, b0, b1, b2 = _of_pair(work, k, _R[_M + 9], (d00, d01, d02), (d20, d21, d22))
        x0, x1, x2, z0, z1, z2 = x0 + a0, x1 + a1, x2 + a2, z0 + b0, z1 + b1, z2 + b2
        a0, a1, a2, b0, b1, b2 = _of_pair(work, k, _R[_M + 18], (d10, d11, d12), (d20, d21, d22))
        y0, y1, y2, z0, z1, z2 = y0 + a0, y1 + a1, y2 + a2, z0 + b0, z1 + b1, z2 + b2
        # Overwrites the stress, which is not needed any more.
        work[k] = x0 - (d00 * s0 + d01 * s1 + d02 * s2)
        work[_R[1] + k] = x1 - (d00 * s1 + d01 * s3 + d02 * s4)
        work[_R[2] + k] = x2 - (d00 * s2 + d01 * s4 + d02 * s5)
        work[_R[3] + k] = y0 - (d10 * s0 + d11 * s1 + d12 * s2)
        work[_R[4] + k] = y1 - (d10 * s1 + d11 * s3 + d12 * s4)
        work[_R[5] + k] = y2 - (d10 * s2 + d11 * s4 + d12 * s5)
        work[_R[6] + k] = z0 - (d20 * s0 + d21 * s1 + d22 * s2)
        work[_R[7] + k] = z1 - (d20 * s1 + d21 * s3 + d22 * s4)
        work[_R[8] + k] = z2 - (d20 * s2 + d21 * s4 + d22 * s5)
        g0, g1, g2, g3, g4, g5 = _pulled(work, k)
        work[_R[TARGET] + k], work[_R[TARGET + 1] + k], work[_R[TARGET + 2] + k] = s0 + g0, s1 + g1, s2 + g2
        work[_R[TARGET + 3] + k], work[_R[TARGET + 4] + k], work[_R[TARGET + 5] + k] = s3 + g3, s4 + g4, s5 + g5


@njit(**FAST)
def _of_square(work: Array, k: int, row: int, x: float, y: float, z: float) -> tuple[float, ...]:
    """Return the product of the symmetric moduli of one component with a vector."""
    m0, m1, m2 = work[row + k], work[row + _R[1] + k], work[row + _R[2] + k]
    m3, m4, m5 = work[row + _R[3] + k], work[row + _R[4] + k], work[row + _R[5] + k]
    return m0 * x + m1 * y + m2 * z, m1 * x + m3 * y + m4 * z, m2 * x + m4 * y + m5 * z


@njit(**FAST)
def _of_pair(work: Array, k: int, row: int, p: tuple[float, ...], q: tuple[float, ...]) -> tuple[float, ...]:
    """Return the products of the moduli of a pair of components with ``q``, and of their transpose with ``p``."""
    m0, m1, m2 = work[row + k], work[row + _R[1] + k], work[row + _R[2] + k]
    m3, m4, m5 = work[row + _R[3] + k], work[row + _R[4] + k], work[row + _R[5] + k]
    m6, m7, m8 = work[row + _R[6] + k], work[row + _R[7] + k], work[row + _R[8] + k]
    return (
        m0 * q[0] + m1 * q[1] + m2 * q[2],
        m3 * q[0] + m4 * q[1] + m5 * q[2],
        m6 * q[0] + m7 * q[1] + m8 * q[2],
        m0 * p[0] + m3 * p[1] + m6 * p[2],
        m1 * p[0] + m4 * p[1] + m7 * p[2],
        m2 * p[0] + m5 * p[1] + m8 * p[2],
    )


@njit(STEP, **FAST)
def press_on(work: Array) -> None:
    """Add the change of pressure since the start of the step, times ``F0^-1 F0^-T``, to the extrapolated stress."""
    for k in range(_W):
        c00, c01, c02, c10, c11, c12, c20, c21, c22 = _cofactors(work, k)
        det = work[_R[DETERMINANT] + k]
        x = (work[_R[PRESSURE] + k] - work[_R[BEFORE] + k]) / (det * det)
        work[_R[TARGET] + k] += x * (c00 * c00 + c10 * c10 + c20 * c20)
        work[_R[TARGET + 1] + k] += x * (c00 * c01 + c10 * c11 + c20 * c21)
        work[_R[TARGET + 2] + k] += x * (c00 * c02 + c10 * c12 + c20 * c22)
        work[_R[TARGET + 3] + k] += x * (c01 * c01 + c11 * c11 + c21 * c21)
        work[_R[TARGET + 4] + k] += x * (c01 * c02 + c11 * c12 + c21 * c22)
        work[_R[TARGET + 5] + k] += x * (c02 * c02 + c12 * c12 + c22 * c22)


@njit(STEP, **FAST)
def exceed(work: Array) -> None:
    """Add the extrapolated stress less that in the rows to the moduli, as a geometric stiffness."""
    for k in range(_W):
        s0, s1, s2, s3, s4, s5 = _pulled(work, k)
        x0, x1, x2 = work[_R[TARGET] + k] - s0, work[_R[TARGET + 1] + k] - s1, work[_R[TARGET + 2] + k] - s2
        x3, x4, x5 = work[_R[TARGET + 3] + k] - s3, work[_R[TARGET + 4] + k] - s4, work[_R[TARGET + 5] + k] - s5
        for a in range(_3):
            row = _R[_Q] + a * _R[6]
            work[row + k] += x0
            work[row + _R[1] + k] += x1
            work[row + _R[2] + k] += x2
            work[row + _R[3] + k] += x3
            work[row + _R[4] + k] += x4
            work[row + _R[5] + k] += x5


class Steps(NamedTuple):
    """Addresses of the steps at a block, in their order; zero for those that are left out."""

    deform: int
    press: int
    press_moduli: int
    foresee: int
    press_on: int
    exceed: int
    pull_back: int


STEPS = types.NamedUniTuple(i8, 7, Steps)
