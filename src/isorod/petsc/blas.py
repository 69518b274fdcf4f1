"""LAPACK and BLAS for compiled code, by the functions that SciPy offers to others.

Arguments are addresses, as Fortran takes them; arrays are column by column, integers 32 bits.
"""

from typing import Any

from llvmlite import binding
from numba import types
from numba.extending import get_cython_function_address

_P = types.voidptr


def _function(module: str, name: str, arguments: int) -> Any:
    """Return one of SciPy's functions of so many arguments, to be called in compiled code.

    Compiled code names it, and may be kept: the name is bound to the address, which differs from process to process,
    when this module is imported.
    """
    symbol = f"isorod_{name}"
    binding.add_symbol(symbol, get_cython_function_address(f"scipy.linalg.cython_{module}", name))
    return types.ExternalFunction(symbol, types.void(*(_P,) * arguments))


dgemm = _function("blas", "dgemm", 13)
dsyrk = _function("blas", "dsyrk", 10)
dtrsm = _function("blas", "dtrsm", 11)
dpotrf = _function("lapack", "dpotrf", 5)
