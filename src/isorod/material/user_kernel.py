"""The compiled part of user materials (`isorod.material.user`): their routines, called by address.

Three interfaces: a function compiled by Numba, Abaqus' UMAT, and the generic interface of MFront for finite strains
(TFEL 4 or later).  Address, interface and number of state variables are constants of the law, so that these functions
are compiled once for all routines.

What a routine reads and writes is in one array, which is read again after the call: Numba frees an array after its last
use, and does not see uses by address.
"""

from typing import Any

import numpy as np
from numba import i4, u8, void

from isorod.arrays import Array
from isorod.compiled import FAST, cofactors, njit
from isorod.material.points import (
    ACTIVE,
    BLOCK,
    DETERMINANT,
    ENERGY,
    FIBRE,
    GRADIENT,
    POINTS,
    ROWS,
    TANGENT,
    caller,
    modulus_row,
)

# Constants of the law; those of the routine follow.
ADDRESS, TIME, INTERFACE, COUNT, SINCE, OWN = range(6)
FUNCTION, UMAT, MFRONT = 0.0, 1.0, 2.0

# State: the deformation gradient at the start of the step minus the identity (9), the stress there (9; for UMAT the
# Cauchy stress, 6), UMAT's strain (6), the work since rest, the routine's own variables.
STRESSED, STRAINED, WORKED, VARIABLES = 9, 18, 24, 25

# Arguments of a function compiled by Numba, all by address: deformation gradients at the start and the end, state
# variables and their number, time of the step, constants and their number, the first Piola-Kirchhoff stress.
_call_function, _call_umat, _call_mfront = caller(void(*[u8] * 8)), caller(void(*[u8] * 38)), caller(i4(u8))

# Step of the differences for the tangent of a function.
_STEP = 1e-6

# Places of arguments in the common array, in units of 8 bytes.
_F0, _F, _STRESS, _OWN, _STEPPED, _K, _MORE = 0, 9, 18, 32, 64, 72, 180
_STRAIN, _GROWN, _TURN, _SHORTER, _SIZES, _NAME, _ZEROS, _DATA = 180, 186, 192, 201, 202, 212, 222, 250
_BEFORE, _OLD = 186, 222
_ROOM = 280

# Order of components: in MFront of a tensor that is not symmetric, in Abaqus of one that is.
_ROW, _COLUMN = (0, 1, 2, 0, 1, 0, 2, 1, 2), (0, 1, 2, 1, 0, 2, 0, 2, 1)
_FIRST, _SECOND = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)


@njit(**FAST)
def _put(six: Array, full: Array, shear: float) -> None:
    """Fill in a symmetric tensor from six components, those of shear times a factor."""
    for m in range(6):
        value = six[m] * (1.0 if m < 3 else shear)
        full[_FIRST[m], _SECOND[m]] = value
        full[_SECOND[m], _FIRST[m]] = value


@njit(**FAST)
def _grown(F0: Array, F: Array, strain: Array, turn: Array) -> None:
    """Fill in strain and rotation increments between two deformation gradients by their midpoint.

    T. J. R. Hughes & J. Winget, Int. J. Numer. Meth. Eng. 15 (1980) 1862-1867.
    """
    inverse, spin = np.empty((3, 3)), np.empty((3, 3))
    det = cofactors(0.5 * (F0 + F), inverse)
    for a in range(3):
        for b in range(3):
            total = 0.0
            for c in range(3):
                total += (F[a, c] - F0[a, c]) * inverse[b, c]
            turn[a, b] = total / det
    size = 0.0
    for a in range(3):
        for b in range(3):
            strain[a, b] = 0.5 * (turn[a, b] + turn[b, a])
            spin[a, b] = 0.5 * (turn[a, b] - turn[b, a])
            size += 0.5 * spin[a, b] ** 2
    for a in range(3):
        for b in range(3):
            square = 0.0
            for c in range(3):
                square += spin[a, c] * spin[c, b]
            turn[a, b] = (1.0 if a == b else 0.0) + (spin[a, b] + 0.5 * square) / (1.0 + 0.25 * size)


@njit(**FAST)
def _turned(six: Array, shear: float, turn: Array, out: Array) -> None:
    """Fill in the six components of a rotated symmetric tensor; ``shear`` as for `_put`."""
    full = np.empty((3, 3))
    _put(six, full, shear)
    for m in range(6):
        total = 0.0
        for a in range(3):
            for b in range(3):
                total += turn[_FIRST[m], a] * full[a, b] * turn[_SECOND[m], b]
        out[m] = total if m < 3 else total / shear


@njit(**FAST)
def _umat(F0: Array, F: Array, state: Array, constants: Array, w: Array, stress: Array, moduli: Array) -> None:
    """Call a UMAT: fill in the first Piola-Kirchhoff stress and the moduli, and update the state."""
    strain, turn, full, inverse = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    _grown(F0, F, strain, turn)
    _turned(state[STRESSED:STRAINED], 1.0, turn, w[_STRESS : _STRESS + 6])
    _turned(state[STRAINED:WORKED], 0.5, turn, w[_STRAIN : _STRAIN + 6])
    sizes, name = w[_SIZES:_NAME].view(np.int32), w[_NAME:_ZEROS].view(np.uint8)
    sizes[:] = 1
    sizes[0], sizes[1], sizes[2], sizes[3], sizes[4] = 3, 3, 6, np.int32(constants[COUNT]), constants.size - OWN
    # A blank.
    name[:] = 32
    w[_ZEROS:_DATA] = 0.0
    w[_K : _K + 36] = 0.0
    w[_SHORTER], w[_STEPPED] = 1.0, constants[TIME]
    # TIME, and KINC: routines set up their state at time zero, or in the first increment.
    w[_ZEROS + 17] = w[_ZEROS + 18] = constants[SINCE]
    sizes[9] = 1 if constants[SINCE] == 0.0 else 2
    for m in range(6):
        w[_GROWN + m] = strain[_FIRST[m], _SECOND[m]] * (1.0 if m < 3 else 2.0)
    for a in range(3):
        for b in range(3):
            # Fortran has columns one after the other.
            w[_TURN + 3 * b + a], w[_F0 + 3 * b + a], w[_F + 3 * b + a] = turn[a, b], F0[a, b], F[a, b]
    at, integer = u8(w.ctypes.data), u8(w.ctypes.data) + u8(8 * _SIZES)
    zero, one, properties = at + u8(8 * _ZEROS), integer + u8(20), u8(constants.ctypes.data) + u8(8 * OWN)
    _call_umat(
        u8(constants[ADDRESS]),
        (
            # STRESS, STATEV, DDSDDE
            at + u8(8 * _STRESS),
            at + u8(8 * _OWN),
            at + u8(8 * _K),
            # SSE, SPD, SCD, RPL, DDSDDT, DRPLDE, DRPLDT
            zero,
            zero + u8(8),
            zero + u8(16),
            zero + u8(24),
            zero + u8(32),
            zero + u8(80),
            zero + u8(128),
            # STRAN, DSTRAN, TIME, DTIME, TEMP, DTEMP, PREDEF, DPRED, CMNAME
            at + u8(8 * _STRAIN),
            at + u8(8 * _GROWN),
            zero + u8(136),
            at + u8(8 * _STEPPED),
            zero + u8(152),
            zero + u8(160),
            zero + u8(168),
            zero + u8(176),
            at + u8(8 * _NAME),
            # NDI, NSHR, NTENS, NSTATV, PROPS, NPROPS, COORDS, DROT, PNEWDT, CELENT, DFGRD0, DFGRD1
            integer,
            integer + u8(4),
            integer + u8(8),
            integer + u8(12),
            properties,
            integer + u8(16),
            zero + u8(184),
            at + u8(8 * _TURN),
            at + u8(8 * _SHORTER),
            zero + u8(208),
            at + u8(8 * _F0),
            at + u8(8 * _F),
            # NOEL, NPT, LAYER, KSPT, KSTEP (four numbers), KINC, and the length of CMNAME
            one,
            one,
            one,
            one,
            one,
            integer + u8(36),
            u8(80),
        ),
    )
    for m in range(6):
        state[STRESSED + m] = w[_STRESS + m]
        state[STRAINED + m] = w[_STRAIN + m] + w[_GROWN + m]
    _put(w[_STRESS : _STRESS + 6], full, 1.0)
    det = cofactors(F, inverse)
    # PNEWDT below 1: the routine asks for a shorter step.
    if w[_SHORTER] < 1.0:
        full[:] = np.nan
    for a in range(3):
        for A in range(3):
            total = 0.0
            for b in range(3):
                total += full[a, b] * inverse[b, A]
            stress[a, A] = total
    if moduli.size:
        _from_jaumann(w[_K : _K + 36].reshape((6, 6)), full, inverse, det, moduli)


@njit(**FAST)
def _from_jaumann(jacobian: Array, cauchy: Array, cofactor: Array, det: float, moduli: Array) -> None:
    """Fill in ``dP/dF`` from UMAT's DDSDDE: the Jaumann rate of Kirchhoff stress over ``J``, by strain."""
    gradient, rate, six = np.empty((3, 3)), np.empty((3, 3)), np.empty(6)
    for b in range(3):
        for B in range(3):
            # Velocity gradient for a one rate of F's component bB.
            gradient[:] = 0.0
            for c in range(3):
                gradient[b, c] = cofactor[c, B] / det
            for m in range(6):
                six[m] = 0.0
                for n in range(6):
                    i, j = _FIRST[n], _SECOND[n]
                    six[m] += det * jacobian[n, m] * (gradient[i, j] if n < 3 else gradient[i, j] + gradient[j, i])
            _put(six, rate, 1.0)
            for a in range(3):
                for c in range(3):
                    total = 0.0
                    for d in range(3):
                        total += 0.5 * (gradient[a, d] - gradient[d, a]) * cauchy[d, c]
                        total -= cauchy[a, d] * 0.5 * (gradient[d, c] + gradient[c, d])
                    rate[a, c] += det * total
            for a in range(3):
                for A in range(3):
                    total = 0.0
                    for c in range(3):
                        total += rate[a, c] * cofactor[c, A]
                    moduli[3 * a + A, 3 * b + B] = total / det


@njit(**FAST)
def _mfront(F0: Array, F: Array, state: Array, constants: Array, w: Array, stress: Array, moduli: Array) -> None:
    """Call a behaviour of MFront: fill in the stress and the moduli, and update the state."""
    for m in range(9):
        w[_F0 + m], w[_F + m] = F0[_ROW[m], _COLUMN[m]], F[_ROW[m], _COLUMN[m]]
        w[_BEFORE + m] = w[_STRESS + m] = state[STRESSED + m]
    for m in range(state.size - VARIABLES):
        w[_OLD + m] = state[VARIABLES + m]
    # The consistent tangent, if any; first Piola-Kirchhoff stress and its derivative.
    w[_K : _K + 3] = 2.0
    w[_K] = 4.0 if moduli.size else 0.0
    # Proposed step, speed of sound, mass density, stored and dissipated energy, temperature.
    w[_MORE : _MORE + 5] = 0.0
    w[_MORE] = w[_MORE + 2] = 1.0
    w[_MORE + 5] = 293.15
    at, data = u8(w.ctypes.data), w[_DATA : _DATA + 21].view(np.uint64)
    more = at + u8(8 * _MORE)
    data[:] = u8(0)
    w[_DATA + 1] = constants[TIME]
    data[2], data[3], data[4] = at + u8(8 * _K), more, more + u8(8)
    for begin, gradient, force, variables in ((5, _F0, _BEFORE, _OLD), (13, _F, _STRESS, _OWN)):
        data[begin], data[begin + 1], data[begin + 2] = at + u8(8 * gradient), at + u8(8 * force), more + u8(16)
        data[begin + 3], data[begin + 4] = u8(constants.ctypes.data) + u8(8 * OWN), at + u8(8 * variables)
        data[begin + 5], data[begin + 6], data[begin + 7] = more + u8(24), more + u8(32), more + u8(40)
    done = _call_mfront(u8(constants[ADDRESS]), (at + u8(8 * _DATA),))
    for m in range(9):
        stress[_ROW[m], _COLUMN[m]] = w[_STRESS + m] if done == 1 else np.nan
        state[STRESSED + m] = w[_STRESS + m]
    if moduli.size:
        for m in range(9):
            for n in range(9):
                moduli[3 * _ROW[m] + _COLUMN[m], 3 * _ROW[n] + _COLUMN[n]] = w[_K + 9 * m + n]


@njit(**FAST)
def _function(F0: Array, F: Array, constants: Array, w: Array, stress: Array) -> None:
    """Call a function compiled by Numba: fill in the stress, and update its state variables."""
    for a in range(3):
        for A in range(3):
            w[_F0 + 3 * a + A], w[_F + 3 * a + A] = F0[a, A], F[a, A]
    w[_STEPPED] = constants[TIME]
    at = u8(w.ctypes.data)
    properties = u8(constants.ctypes.data) + u8(8 * OWN)
    given = at + u8(8 * _F0), at + u8(8 * _F), at + u8(8 * _OWN), u8(constants[COUNT]), at + u8(8 * _STEPPED)
    _call_function(u8(constants[ADDRESS]), (*given, properties, u8(constants.size - OWN), at + u8(8 * _STRESS)))
    for a in range(3):
        for A in range(3):
            stress[a, A] = w[_STRESS + 3 * a + A]


@njit(**FAST)
def _differences(F0: Array, F: Array, state: Array, constants: Array, w: Array, moduli: Array) -> None:
    """Fill in the moduli of a function compiled by Numba by differences of its stress."""
    aside, ahead, behind = F.copy(), np.empty((3, 3)), np.empty((3, 3))
    for b in range(3):
        for B in range(3):
            for step, stress in ((_STEP, ahead), (-_STEP, behind)):
                aside[b, B] = F[b, B] + step
                for m in range(state.size - VARIABLES):
                    w[_OWN + m] = state[VARIABLES + m]
                _function(F0, aside, constants, w, stress)
            aside[b, B] = F[b, B]
            for a in range(3):
                for A in range(3):
                    moduli[3 * a + A, 3 * b + B] = (ahead[a, A] - behind[a, A]) / (2.0 * _STEP)


@njit(**FAST)
def _evaluate(work: Array, k: Any, constants: Array, w: Array, state: Array, stress: Array, moduli: Array) -> None:
    """Fill in stress, state at the end and, unless empty, ``dP/dF`` (9, 9), of one point; NaN if inverted."""
    F0, F = np.empty((3, 3)), np.empty((3, 3))
    for m in range(state.size):
        state[m] = work[np.uint64(POINTS * (FIBRE + m)) + k]
    for a in range(3):
        for A in range(3):
            F[a, A] = work[np.uint64(POINTS * (GRADIENT + 3 * a + A)) + k]
            F0[a, A] = state[3 * a + A] + (1.0 if a == A else 0.0)
    det = work[ROWS[DETERMINANT] + k]
    if not (det > 0.0 and det < np.inf):
        stress[:] = np.nan
        moduli[:] = np.nan
        return
    if constants[INTERFACE] == FUNCTION and moduli.size:
        _differences(F0, F, state, constants, w, moduli)
    for m in range(state.size - VARIABLES):
        w[_OWN + m] = state[VARIABLES + m]
    if constants[INTERFACE] == UMAT:
        _umat(F0, F, state, constants, w, stress, moduli)
    elif constants[INTERFACE] == MFRONT:
        _mfront(F0, F, state, constants, w, stress, moduli)
    else:
        _function(F0, F, constants, w, stress)
    for m in range(state.size - VARIABLES):
        state[VARIABLES + m] = w[_OWN + m]
    # Work of the step by the mean stress of its ends: not an energy, but of its size.
    for a in range(3):
        for A in range(3):
            state[WORKED] += 0.5 * stress[a, A] * (F[a, A] - F0[a, A])
            state[3 * a + A] = F[a, A] - (1.0 if a == A else 0.0)


@njit(**FAST)
def _width(constants: Array) -> int:
    """Return the number of components of the state."""
    return VARIABLES + int(constants[COUNT])


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, with_energy: bool) -> None:
    """Fill in the stress, and on demand the work since rest instead of the energy."""
    w, state, stress, none = np.zeros(_ROOM), np.empty(_width(constants)), np.empty((3, 3)), np.empty((0, 9))
    for k in range(np.uint64(POINTS)):
        _evaluate(work, k, constants, w, state, stress, none)
        if with_energy:
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = state[WORKED], 0.0
        for a in range(3):
            for A in range(3):
                work[np.uint64(POINTS * (3 * a + A)) + k] = stress[a, A]


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the symmetric part of the moduli."""
    w, state, stress, moduli = np.zeros(_ROOM), np.empty(_width(constants)), np.empty((3, 3)), np.empty((9, 9))
    for k in range(np.uint64(POINTS)):
        _evaluate(work, k, constants, w, state, stress, moduli)
        for m in range(9):
            for n in range(9):
                a, A, b, B = m // 3, m % 3, n // 3, n % 3
                if a < b or (a == b and A <= B):
                    work[modulus_row(a, A, b, B) + k] += 0.5 * (moduli[m, n] + moduli[n, m])


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, with_energy: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    w, state, stress, none = np.zeros(_ROOM), np.empty(_width(constants)), np.empty((3, 3)), np.empty((0, 9))
    for k in range(np.uint64(POINTS)):
        _evaluate(work, k, constants, w, state, stress, none)
        for m in range(state.size):
            work[np.uint64(POINTS * (FIBRE + m)) + k] = state[m]
        for a in range(3):
            for A in range(3):
                work[np.uint64(POINTS * (3 * a + A)) + k] = stress[a, A]
