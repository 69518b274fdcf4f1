"""Functions in the compiled code of laws that are made from energies, which loops over points can vectorise.

The C library's logarithm and exponential are called point by point; those below are a few products and sums, exact to
two or three units in the last place.
"""

from typing import Any

import numpy as np
from numba import f8, types, u8
from numba.extending import intrinsic

from isorod.compiled import FAST, STRICT, njit

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


# In compiled code they take one argument.
_bits: Any = _to_bits
_number: Any = _of_bits


@njit(f8(f8), **FAST)
def log(x: float) -> float:
    """Return the natural logarithm; NaN where ``x`` is not positive or not finite."""
    moved = _bits(x) - _ROOT_HALF + _BIAS
    exponent = moved >> _SHIFT
    # 2^e m = x with m from the root of 1/2 to that of 2.
    m = _number(_bits(x) - (exponent << _SHIFT) + _BIAS)
    # Four bytes: processors convert as many at once as they take doubles.
    e = float(np.int32(exponent) - np.int32(1023))
    z = (m - 1.0) / (m + 1.0)
    s = z * z
    y = 1.0 / 17.0 + s * (1.0 / 19.0 + s * (1.0 / 21.0))
    y = 1.0 / 11.0 + s * (1.0 / 13.0 + s * (1.0 / 15.0 + s * y))
    y = 1.0 / 5.0 + s * (1.0 / 7.0 + s * (1.0 / 9.0 + s * y))
    value = e * _LN2 + 2.0 * z * (1.0 + s * (1.0 / 3.0 + s * y))
    return value if (x > 0.0) & (x < np.inf) else np.nan


@njit(f8(f8), **FAST)
def exp(x: float) -> float:
    """Return the exponential, infinite above 709 and at least 1e-308."""
    inside = min(max(x, -708.0), 709.0)
    n = np.floor(inside * (1.0 / _LN2) + 0.5)
    r = (inside - n * _LN2) - n * _LN2_LOW
    y = 1.0 / 39916800.0 + r * (1.0 / 479001600.0 + r * (1.0 / 6227020800.0))
    y = 1.0 / 40320.0 + r * (1.0 / 362880.0 + r * (1.0 / 3628800.0 + r * y))
    y = 1.0 / 120.0 + r * (1.0 / 720.0 + r * (1.0 / 5040.0 + r * y))
    y = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * y))))
    scale = _number(np.uint64(np.int32(n) + np.int32(1023)) << _SHIFT)
    value = y * scale
    return value if x <= 709.0 else (np.inf if x > 709.0 else np.nan)


@njit(f8(f8, f8), **FAST)
def power(x: float, exponent: float) -> float:
    """Return ``x**exponent`` of a positive ``x``."""
    return exp(exponent * log(x))


@njit(types.UniTuple(f8, 12)(f8, f8, f8, f8, f8, f8), **STRICT)
def principal(c00: float, c01: float, c02: float, c11: float, c12: float, c22: float) -> tuple[float, ...]:
    """Return the eigenvalues of a symmetric tensor and, one behind the other, its unit eigenvectors.

    Jacobi's rotations: to rounding, and orthogonal where eigenvalues meet.
    """
    c, v = np.empty((3, 3)), np.eye(3)
    c[0, 0], c[0, 1], c[0, 2], c[1, 1], c[1, 2], c[2, 2] = c00, c01, c02, c11, c12, c22
    for _ in range(12):
        off = abs(c[0, 1]) + abs(c[0, 2]) + abs(c[1, 2])
        # NaN fails the comparison.
        if not off > 1e-17 * (abs(c[0, 0]) + abs(c[1, 1]) + abs(c[2, 2])):
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if c[p, q] == 0.0:
                    continue
                r = 3 - p - q
                half = 0.5 * (c[q, q] - c[p, p]) / c[p, q]
                t = (1.0 if half >= 0.0 else -1.0) / (abs(half) + np.sqrt(half * half + 1.0))
                k = 1.0 / np.sqrt(t * t + 1.0)
                s = t * k
                c[p, p] -= t * c[p, q]
                c[q, q] += t * c[p, q]
                c[p, q] = 0.0
                x = c[min(p, r), max(p, r)]
                y = c[min(q, r), max(q, r)]
                c[min(p, r), max(p, r)] = k * x - s * y
                c[min(q, r), max(q, r)] = s * x + k * y
                for m in range(3):
                    x, y = v[m, p], v[m, q]
                    v[m, p] = k * x - s * y
                    v[m, q] = s * x + k * y
    return (
        c[0, 0], c[1, 1], c[2, 2],
        v[0, 0], v[1, 0], v[2, 0], v[0, 1], v[1, 1], v[2, 1], v[0, 2], v[1, 2], v[2, 2],
    )  # fmt: skip
