"""Energies of laws with thermal expansion and temperature-dependent stiffness, as expressions."""

from collections.abc import Sequence

import sympy as sp

from isorod.errors import InputError
from isorod.material import symbols as s
from isorod.material.energy import Energy
from isorod.material.orthotropic import quadratic


def expanded(energy: Energy, axes: int = 1, points: int = 0, field: bool = False) -> Energy:
    """Return the energy ``f det(G) W(F G^-1)`` of a solid that has no stress when ``F`` is its free stretch ``G``.

    For small strains it is ``f W`` of the strain minus the free strain.

    Parameters
    ----------
    energy
        ``W``.
    axes
        Number of coefficients of expansion: 1 in all directions; 2 along fibres ``a`` and across; 3 along ``a``, ``b``
        and across both.
    points
        Number of points of the table of the stiffness factor ``f`` by temperature; 0 without.
    field
        Whether the temperature is that of the point times the constant ``heat``, or this alone.
    """
    along = sp.symbols(f"expansion0:{axes}", real=True)
    levels, fractions = (sp.symbols(f"{name}0:{points}", real=True) for name in ("level", "fraction"))
    constants = *energy.constants, *along, s.heat, *levels, *fractions
    temperature = s.heat * s.temperature if field else s.heat
    strains = [one * temperature for one in along]
    strains += [strains[-1]] * (3 - axes)
    factor = _joined(temperature, levels, fractions)
    if axes > 1 and energy == quadratic(energy.small):
        left = quadratic(energy.small, tuple(strains)).total
    elif axes == 1 and energy.small:
        left = energy.total.xreplace({s.C[A, A]: s.C[A, A] - 2 * strains[0] for A in range(3)})
    else:
        left = energy.total.xreplace(_left(energy, [1 + one for one in strains[:axes]]))
    if not energy.small:
        factor *= (1 + strains[0]) * (1 + strains[1]) * (1 + strains[2])
    return Energy(factor * left, constants, small=energy.small)


def _left(energy: Energy, grown: Sequence[sp.Expr]) -> dict[sp.Symbol, sp.Expr]:
    """Return substitutions that turn an energy of ``F`` into one of ``F G^-1``, ``G`` of stretches along the axes."""
    if len(grown) == 1:
        powers = dict.fromkeys((s.I1, s.I4a, s.I4b, s.I8, *s.STRAINS), 2) | {s.I2: 4, s.J: 3}
        powers |= dict.fromkeys((*s.stretches, *s.F), 1)
        return {one: one / grown[0] ** p for one, p in powers.items()}
    if {s.I2, s.I4b, s.I8, *s.stretches, *s.STRAINS, *s.F} & energy.total.free_symbols:
        raise InputError("expansion: got several numbers, which this law's energy is not written for; give one")
    first, rest = grown
    return {
        s.I1: s.I4a / first**2 + (s.I1 - s.I4a) / rest**2,
        s.I4a: s.I4a / first**2,
        s.J: s.J / (first * rest**2),
    }


def _joined(value: sp.Expr, levels: Sequence[sp.Symbol], fractions: Sequence[sp.Symbol]) -> sp.Expr:
    """Return the piecewise linear interpolant of a table at a value, 1 without a table."""
    if not levels:
        return sp.Integer(1)
    total = fractions[0]
    for k in range(len(levels) - 1):
        slope = (fractions[k + 1] - fractions[k]) / (levels[k + 1] - levels[k])
        total += slope * (sp.Min(sp.Max(value, levels[k]), levels[k + 1]) - levels[k])
    return total
