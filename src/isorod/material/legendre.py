"""Legendre transform of volumetric energies that are not quadratic in ``ln J``."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import sympy as sp

from isorod.arrays import Array
from isorod.material import symbols as s

# Newton steps at most, from the linear solution to rounding.
_STEPS = 30


@np.errstate(all="ignore")
def transform(volume: sp.Expr, ratio: Array, modulus: float) -> tuple[Array, Array, Array]:
    """Return ``U*(p) = p theta - U`` of ``U = modulus volume(J)``, ``theta = ln J``, and its derivatives by ``p``.

    Parameters
    ----------
    volume
        An expression of ``J``, with ``U'' = modulus`` at rest.
    ratio
        ``p / modulus``, any shape.  Where no ``J`` has it, the results are NaN.
    modulus
        Force / area.
    """
    value, slope, bend = _functions(volume)
    theta = np.array(ratio)
    for _ in range(_STEPS):
        change = (slope(theta) - ratio) / bend(theta)
        theta = theta - np.clip(change, -0.5, 0.5)
        if not np.any(np.abs(change) > 1e-15):
            break
    theta = np.where((np.abs(change) < 1e-12) & (bend(theta) > 0.0), theta, np.nan)
    return modulus * (ratio * theta - value(theta)), theta, 1.0 / (modulus * bend(theta))


@cache
def _functions(volume: sp.Expr) -> tuple[Callable[[Any], Any], ...]:
    """Return a volumetric energy of ``ln J`` and its two derivatives."""
    theta = sp.Symbol("theta", real=True)
    energy = volume.subs(s.J, sp.exp(theta))
    return tuple(sp.lambdify(theta, sp.diff(energy, theta, k), "numpy") for k in range(3))
