"""Common parts of compiled code: Numba's options, types of arrays, and the cofactors of a tensor."""

from typing import Any

import numpy as np
from numba import f8, i8, types, u8

from isorod.arrays import Array
from isorod.compiling import njit

# Sums in the order in which they are written; floating-point errors give infinities and NaN, as NumPy's do.
STRICT: Any = {"error_model": "numpy"}
# Sums may be reordered, so that loops become vector instructions; NaN and infinities still count.
FAST: Any = STRICT | {"fastmath": {"contract", "reassoc", "nsz", "arcp"}}

# C-ordered arrays by their number of axes.
F1, F2, F3, F4, F5, F6 = (types.Array(f8, axes, "C") for axes in range(1, 7))
I1, I2, I3 = (types.Array(i8, axes, "C") for axes in range(1, 4))
U1, U2 = (types.Array(u8, axes, "C") for axes in range(1, 3))
# Kept tables are not to be written to.
R2, R3 = (types.Array(f8, axes, "C", readonly=True) for axes in (2, 3))


def flat(F: Array) -> Array:
    """Return ``F`` as one C-ordered array ``(points, 3, 3)``."""
    return np.ascontiguousarray(F, dtype=float).reshape(-1, 3, 3)


@njit(f8(F2, F2), **STRICT)
def cofactors(f: Array, g: Array) -> float:
    """Fill ``g`` with the cofactors of ``f`` and return its determinant."""
    for a in range(3):
        a1, a2 = (a + 1) % 3, (a + 2) % 3
        for b in range(3):
            b1, b2 = (b + 1) % 3, (b + 2) % 3
            g[a, b] = f[a1, b1] * f[a2, b2] - f[a1, b2] * f[a2, b1]
    return f[0, 0] * g[0, 0] + f[0, 1] * g[0, 1] + f[0, 2] * g[0, 2]
