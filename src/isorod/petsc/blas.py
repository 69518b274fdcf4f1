"""LAPACK and BLAS for compiled code, by SciPy's Cython API.

Matrices are given by flat arrays that begin with them, column by column, and the leading dimension.
"""

from typing import Any

import numpy as np
from llvmlite import binding
from numba import types
from numba.core import cgutils
from numba.extending import get_cython_function_address, intrinsic

from isorod.arrays import Array
from isorod.compiled import STRICT, njit

_P = types.voidptr

# Options of Fortran's functions: lower triangle, matrix on the right, transposed, not transposed.
_LOWER, _RIGHT, _TRANSPOSED, _PLAIN = (np.uint8(ord(letter)) for letter in "LRTN")


def _function(module: str, name: str, arguments: int) -> Any:
    """Return one of SciPy's functions of so many arguments, to be called in compiled code.

    Compiled code refers to it by name, so that it can be cached: importing this module binds the name to the address,
    which differs between processes.
    """
    symbol = f"isorod_{name}"
    binding.add_symbol(symbol, get_cython_function_address(f"scipy.linalg.cython_{module}", name))
    return types.ExternalFunction(symbol, types.void(*(_P,) * arguments))


_dgemm = _function("blas", "dgemm", 13)
_dsyrk = _function("blas", "dsyrk", 10)
_dtrsm = _function("blas", "dtrsm", 11)
_dpotrf = _function("lapack", "dpotrf", 5)


def _place_number(typing: Any, value: Any) -> Any:
    """Return the address of a copy of a number, as Fortran takes its arguments."""

    def build(context: Any, builder: Any, _: Any, values: Any) -> Any:
        place = cgutils.alloca_once_value(builder, values[0])
        return builder.bitcast(place, context.get_value_type(_P))

    return _P(value), build


_at: Any = intrinsic(_place_number)


@njit(**STRICT)
def factorise(a: Array, lead: int, n: int) -> int:
    """Factorise the lower triangle of a matrix by Cholesky; return 0, or 1 plus the first pivot not positive."""
    result = np.zeros(1, dtype=np.int32)
    _dpotrf(_at(_LOWER), _at(np.int32(n)), a.ctypes, _at(np.int32(lead)), result.ctypes)
    return int(result[0])


@njit(**STRICT)
def divide(a: Array, lead: int, rows: int, columns: int, triangle: Array, lead_of: int) -> None:
    """Replace a matrix ``A`` by ``A L^-T`` with a lower triangle ``L``."""
    m, n, lda, ldl = _at(np.int32(rows)), _at(np.int32(columns)), _at(np.int32(lead)), _at(np.int32(lead_of))
    right, lower, transposed, plain = _at(_RIGHT), _at(_LOWER), _at(_TRANSPOSED), _at(_PLAIN)
    _dtrsm(right, lower, transposed, plain, m, n, _at(1.0), triangle.ctypes, ldl, a.ctypes, lda)


@njit(**STRICT)
def add_square(c: Array, lead: int, size: int, columns: int, factor: float, a: Array, lead_of: int) -> None:
    """Add ``factor A A^T`` to the lower triangle of a matrix."""
    n, k, ldc, lda = _at(np.int32(size)), _at(np.int32(columns)), _at(np.int32(lead)), _at(np.int32(lead_of))
    _dsyrk(_at(_LOWER), _at(_PLAIN), n, k, _at(factor), a.ctypes, lda, _at(1.0), c.ctypes, ldc)


@njit(**STRICT)
def add_product(c: Array, rows: int, columns: int, inner: int, factor: float, a: Array, b: Array, lead: int) -> None:
    """Add ``factor A B^T`` to a matrix; it and ``A`` have contiguous columns."""
    m, n, k, ldb = _at(np.int32(rows)), _at(np.int32(columns)), _at(np.int32(inner)), _at(np.int32(lead))
    _dgemm(_at(_PLAIN), _at(_TRANSPOSED), m, n, k, _at(factor), a.ctypes, m, b.ctypes, ldb, _at(1.0), c.ctypes, m)
