"""The stored energy of muscle (`isorod.material.muscle`) as an expression, with any tension curve of active fibres."""

from dataclasses import replace
from functools import cache

import sympy as sp
from sympy.codegen.cfunctions import expm1

from isorod.material.energy import Energy
from isorod.material.neo_hookean import matrix_energy
from isorod.material.symbols import I4a, activation

STRETCH = sp.Symbol("stretch", positive=True)


def of_fibres(work: sp.Expr) -> Energy:
    """Return the energy as an expression.

    Parameters
    ----------
    work
        Energy of active fibres with a largest stress of 1: the integral of their tension over ``STRETCH``, from 1.
    """
    matrix = matrix_energy()
    mu, lame = matrix.constants
    active, m1, m2 = sp.symbols("active m1 m2", nonnegative=True)
    squared = I4a - 1
    passive = sp.Piecewise((expm1(m2 * squared) / m2 - squared, squared > 0), (0, True))
    fibres = activation * active * work.subs(STRETCH, sp.sqrt(I4a)) + m1 / 2 * passive
    return replace(matrix, shape=matrix.shape + fibres, constants=(mu, active, m1, m2, lame))


@cache
def of_the_parabola() -> Energy:
    """Return the energy of `isorod.material.muscle.Muscle`."""
    # Tension is 1 - 4 short^2 for shortening below a half, else zero.
    short, most, end = STRETCH - 1, sp.Rational(1, 2), sp.Rational(1, 3)
    inside = short - sp.Rational(4, 3) * short**3
    return of_fibres(sp.Piecewise((-end, short <= -most), (inside, short < most), (end, True)))
