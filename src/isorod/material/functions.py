"""Functions in the compiled code generated from energies, which loops over points can vectorise.

The C library's logarithm and exponential are called point by point; those below are a few products and sums, exact to
two or three units in the last place.
"""

from typing import Any

import numpy as np
from numba import f8, i8, types, u8, void
from numba.extending import intrinsic

from isorod.arrays import Array
from isorod.compiled import F1, FAST, njit
from isorod.material.points import ROWS

_LN2 = 0.6931471805599453
_LN2_LOW = 2.3190468138462996e-17
# The exponent's bias, the place of its last bit, and the root of 1/2.
_BIAS, _SHIFT = np.uint64(1023 << 52), np.uint64(52)
_ROOT_HALF = np.uint64(0x3FE6A09E667F3BCD)


@intrinsic  # type: ignore[misc]
def _to_bits(typing: Any, x: Any) -> Any:
    """Return the bits of a number."""
    return u8(f8), lambda context, builder, _, values: builder.bitcast(values[0], context.get_value_type(u8))


@intrinsic  # type: ignore[misc]
def _of_bits(typing: Any, x: Any) -> Any:
    """Return the number that has these bits."""
    return f8(u8), lambda context, builder, _, values: builder.bitcast(values[0], context.get_value_type(f8))


# In compiled code they take one argument: the typing context is supplied.
bits: Any = _to_bits
number: Any = _of_bits


@njit(f8(f8), **FAST)
def log(x: float) -> float:
    """Return the natural logarithm; NaN where ``x`` is not positive or not finite."""
    moved = bits(x) - _ROOT_HALF + _BIAS
    exponent = moved >> _SHIFT
    # 2^e m = x with m from the root of 1/2 to that of 2.
    m = number(bits(x) - (exponent << _SHIFT) + _BIAS)
    # Four bytes: processors convert as many at once as they take doubles.
    e = float(np.int32(exponent) - np.int32(1023))
    z = (m - 1.0) / (m + 1.0)
    s = z * z
    y = 1.0 / 17.0 + s * (1.0 / 19.0 + s * (1.0 / 21.0))
    y = 1.0 / 11.0 + s * (1.0 / 13.0 + s * (1.0 / 15.0 + s * y))
    y = 1.0 / 5.0 + s * (1.0 / 7.0 + s * (1.0 / 9.0 + s * y))
    value = e * _LN2 + 2.0 * z * (1.0 + s * (1.0 / 3.0 + s * y))
    return value if (x > 0.0) & (x < np.inf) else np.nan


@njit(types.UniTuple(f8, 2)(f8), **FAST)
def _grown(x: float) -> tuple[float, float]:
    """Return ``exp(r) - 1`` and a power of 2 of ``exp(x) = 2^n exp(r)``, ``r`` at most half of ln 2."""
    inside = min(max(x, -708.0), 709.0)
    n = np.floor(inside * (1.0 / _LN2) + 0.5)
    r = (inside - n * _LN2) - n * _LN2_LOW
    y = 1.0 / 39916800.0 + r * (1.0 / 479001600.0 + r * (1.0 / 6227020800.0))
    y = 1.0 / 40320.0 + r * (1.0 / 362880.0 + r * (1.0 / 3628800.0 + r * y))
    y = 1.0 / 120.0 + r * (1.0 / 720.0 + r * (1.0 / 5040.0 + r * y))
    grown = r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * y))))
    return grown, number(np.uint64(np.int32(n) + np.int32(1023)) << _SHIFT)


@njit(f8(f8), **FAST)
def exp(x: float) -> float:
    """Return the exponential, infinite above 709 and at least 1e-308."""
    grown, scale = _grown(x)
    value = grown * scale + scale
    return value if x <= 709.0 else (np.inf if x > 709.0 else np.nan)


@njit(f8(f8), **FAST)
def expm1(x: float) -> float:
    """Return the exponential less 1, which keeps the digits of a small ``x``."""
    grown, scale = _grown(x)
    value = grown * scale + (scale - 1.0)
    return value if x <= 709.0 else (np.inf if x > 709.0 else np.nan)


@njit(f8(f8, f8), **FAST)
def power(x: float, exponent: float) -> float:
    """Return ``x**exponent`` of a positive ``x``."""
    return exp(exponent * log(x))


# Times below which digits cancel in `ramp_fractions`.
_SHORT = 1e-3


@njit(**FAST)
def ramp_fractions(x: float, gone: float) -> tuple[float, float]:
    """Return the fraction of a stress that remains after a ramp in a time ``x``, and the fraction dissipated.

    ``x`` is in relaxation times; ``gone`` is ``1 - exp(-x)``, the relaxed fraction of a stress at the start.
    """
    short, over = x < _SHORT, max(x, _SHORT)
    kept = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x / 120.0))) if short else gone / over
    lost = x * (1.0 / 3.0 - x * (0.25 - 7.0 / 60.0 * x)) if short else (1.0 - kept) / over - 0.5 * kept**2
    return kept, lost


# Rows of a block's symmetric tensors, 00, 01, 02, 11, 12, 22, of which 00, 11, 22 become eigenvalues, and eigenvectors.
SPECTRAL = 15

# Cyclic sweeps of Jacobi rotations at most: convergence is quadratic, and five are enough for eigenvalues that differ
# much.  They end when the off-diagonal part, squared, is less than this fraction of the trace, squared.
_SWEEPS, _ROUNDING = 6, 1e-34


@njit(void(F1, i8), **FAST)
def principals(spectral: Array, count: int) -> None:
    """Replace the first tensors of a block by their eigenvalues, and fill in unit eigenvectors: Jacobi's rotations.

    Right to rounding, with orthogonal eigenvectors for equal eigenvalues.

    Parameters
    ----------
    spectral
        ``SPECTRAL`` rows of ``POINTS`` numbers.
    count
        Number of tensors.
    """
    for k in range(np.uint64(count)):
        for m in range(np.uint64(9)):
            spectral[ROWS[6] + m * ROWS[1] + k] = 1.0 if m % np.uint64(4) == np.uint64(0) else 0.0
    for _ in range(_SWEEPS):
        far = 0.0
        for k in range(np.uint64(count)):
            b, c, e = spectral[ROWS[1] + k], spectral[ROWS[2] + k], spectral[ROWS[4] + k]
            trace = spectral[ROWS[0] + k] + spectral[ROWS[3] + k] + spectral[ROWS[5] + k]
            far += 1.0 if b * b + c * c + e * e > _ROUNDING * (trace * trace) else 0.0
        if far == 0.0:
            break
        # Three rotations in the plane of the first two axes, after each of which the axes are permuted cyclically.
        for _ in range(3):
            for k in range(np.uint64(count)):
                x, y, z = spectral[ROWS[0] + k], spectral[ROWS[3] + k], spectral[ROWS[1] + k]
                apart = y - x
                # No rotation of equal, uncoupled ones.
                tangent = 2.0 * z / (abs(apart) + np.sqrt(apart * apart + 4.0 * z * z) + 1e-300)
                tangent = tangent if apart >= 0.0 else -tangent
                c = 1.0 / np.sqrt(1.0 + tangent * tangent)
                t = tangent * c
                first, second = spectral[ROWS[2] + k], spectral[ROWS[4] + k]
                spectral[ROWS[0] + k], spectral[ROWS[3] + k] = y + tangent * z, spectral[ROWS[5] + k]
                spectral[ROWS[5] + k] = x - tangent * z
                spectral[ROWS[1] + k], spectral[ROWS[2] + k] = t * first + c * second, 0.0
                spectral[ROWS[4] + k] = c * first - t * second
                for m in range(np.uint64(3)):
                    row = m * ROWS[1] + k
                    x, y = spectral[ROWS[6] + row], spectral[ROWS[9] + row]
                    spectral[ROWS[6] + row] = t * x + c * y
                    spectral[ROWS[9] + row], spectral[ROWS[12] + row] = spectral[ROWS[12] + row], c * x - t * y


# The square of ``C - 1`` below which strains are small: there rounding exceeds some 1e-4 of the energy.
_SMALL = 4e-12


@njit(**FAST)
def of_small(f: tuple[float, ...], p: tuple[float, ...], energy: float) -> float:
    """Return an energy without stress at rest; for small strains half the product of stress and strain instead.

    There terms of the energy cancel and are lost to rounding at strains of 1e-8.  The product is right to first order
    in the strains, ``S : E / 2 = F^T P : (C - 1) / 4``.

    Parameters
    ----------
    f, p
        Components of the deformation gradient and of its first Piola-Kirchhoff stress ``(9,)``.
    energy
        Value of its expression.
    """
    c00, c11 = f[0] * f[0] + f[3] * f[3] + f[6] * f[6] - 1.0, f[1] * f[1] + f[4] * f[4] + f[7] * f[7] - 1.0
    c22, c01 = f[2] * f[2] + f[5] * f[5] + f[8] * f[8] - 1.0, f[0] * f[1] + f[3] * f[4] + f[6] * f[7]
    c02, c12 = f[0] * f[2] + f[3] * f[5] + f[6] * f[8], f[1] * f[2] + f[4] * f[5] + f[7] * f[8]
    size = c00 * c00 + c11 * c11 + c22 * c22 + 2.0 * (c01 * c01 + c02 * c02 + c12 * c12)
    x = (f[0] * p[0] + f[3] * p[3] + f[6] * p[6]) * c00 + (f[0] * p[1] + f[3] * p[4] + f[6] * p[7]) * c01
    x += (f[0] * p[2] + f[3] * p[5] + f[6] * p[8]) * c02 + (f[1] * p[0] + f[4] * p[3] + f[7] * p[6]) * c01
    x += (f[1] * p[1] + f[4] * p[4] + f[7] * p[7]) * c11 + (f[1] * p[2] + f[4] * p[5] + f[7] * p[8]) * c12
    x += (f[2] * p[0] + f[5] * p[3] + f[8] * p[6]) * c02 + (f[2] * p[1] + f[5] * p[4] + f[8] * p[7]) * c12
    x += (f[2] * p[2] + f[5] * p[5] + f[8] * p[8]) * c22
    return 0.25 * x if size < _SMALL else energy
