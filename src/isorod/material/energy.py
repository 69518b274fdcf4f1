"""A stored energy as an expression, and its split into deviatoric and volumetric parts."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import sympy as sp

from isorod.errors import InputError
from isorod.material import symbols as s

LOGARITHMIC = sp.log(s.J) ** 2 / 2

# Values of invariants and stretches at rest.
_REST = {s.I1: 3, s.I2: 3, s.J: 1, s.I4a: 1, s.I4b: 1} | dict.fromkeys(s.stretches, 1)


@dataclass(frozen=True)
class Energy:
    """A stored energy per reference volume.

    Parameters
    ----------
    shape
        The energy without ``bulk volume``: an expression of `isorod.material.symbols` and constants.
    constants
        The symbols of the constants, in the order of the law's; with a volumetric energy ``bulk`` is the last.
    volume
        Volumetric energy of unit modulus at rest: an expression of ``J`` (of small strains: of the trace of ``F``), or
        None.
    small
        Whether strains are small: ``C`` stands for ``F + F^T - 1``.
    """

    shape: sp.Expr
    constants: tuple[sp.Symbol, ...]
    volume: sp.Expr | None = None
    small: bool = False

    @cached_property
    def total(self) -> sp.Expr:
        """The energy with its volumetric part."""
        if self.volume is None:
            return self.shape
        return self.shape + self.constants[-1] * self.volume

    @cached_property
    def expression(self) -> sp.Expr:
        """The energy with its volumetric part, of components of ``F`` if strains are small."""
        if not self.small:
            return self.total
        linear = s.F + s.F.T - sp.eye(3)
        return self.total.xreplace({s.C[A, B]: linear[A, B] for A in range(3) for B in range(A, 3)})

    @property
    def quadratic(self) -> bool:
        """Whether the volumetric energy is ``bulk/2 (ln J)^2``."""
        return self.volume == LOGARITHMIC

    @cached_property
    def rests(self) -> bool:
        """Whether it is of invariants and stretches alone, and zero at rest without activation, with its stress."""
        energy = self.total.subs(s.activation, 0)
        if self.small or energy.free_symbols & {*s.F, *s.C, s.I8} or _differs(energy.subs(_REST)):
            return False
        fibres = sum(abs(sp.diff(energy, one).subs(_REST)) for one in (s.I4a, s.I4b))
        return bool(sp.simplify(energy.subs(_REST)) == 0 and sp.simplify(fibres + abs(pressure_at_rest(energy))) == 0)

    @cached_property
    def families(self) -> int:
        """Number of fibre directions that it depends on."""
        free = self.expression.free_symbols
        if free & {s.I4b, s.I8, *s.b}:
            return 2
        return 1 if free & {s.I4a, *s.a} else 0


def split(given: sp.Expr, constants: Sequence[sp.Symbol]) -> Energy:
    """Return a complete energy, split so that terms of ``J`` alone are the volumetric part.

    Raises
    ------
    InputError
        If it has symbols that are neither constants nor those of `isorod.material.symbols`.
    """
    given = _checked(given, constants)
    depends = given.free_symbols - set(constants)
    if s.J not in depends or depends & set(s.F):
        return Energy(given, tuple(constants))
    others = [one for one in depends if one != s.J]
    volume, _ = sp.expand(given).as_independent(*others, as_Add=True) if others else (given, 0)
    slope = sp.diff(volume, s.J).subs(s.J, 1)
    volume = volume - volume.subs(s.J, 1) - slope * sp.log(s.J)
    factor = sp.simplify(sp.diff(volume, s.J, 2).subs(s.J, 1))
    if factor == 0:
        return Energy(given, tuple(constants))
    unit = sp.simplify(volume / factor)
    unit = LOGARITHMIC if sp.simplify(unit - LOGARITHMIC) == 0 else unit
    return Energy(_tidy(sp.expand(given) - sp.expand(factor * unit)), (*constants, s.bulk), unit)


def completed(given: sp.Expr, constants: Sequence[sp.Symbol]) -> Energy:
    """Return an energy with ``- p ln J + bulk/2 (ln J)^2`` added, ``p`` such that the pressure at rest is zero."""
    given = _checked(given, constants)
    if {*s.F, *s.C} & given.free_symbols:
        raise InputError("energy: with a bulk modulus it takes invariants, stretches and fibres, no components of F")
    return Energy(given - pressure_at_rest(given) * sp.log(s.J), (*constants, s.bulk), LOGARITHMIC)


def factor_of(energy: Energy, given: sp.Expr) -> sp.Expr:
    """Return the factor ``bulk`` of a split energy (`split`) as an expression of the constants."""
    if energy.volume is None:
        return sp.Integer(0)
    rest = given - energy.shape
    return sp.simplify(sp.diff(rest, s.J, 2).subs(s.J, 1))


def pressure_at_rest(given: sp.Expr) -> sp.Expr:
    """Return the pressure (positive in tension) of an energy of invariants, stretches and fibres at rest."""
    weights = {s.I1: 2, s.I2: 4, s.J: 1, s.stretches[0]: 1}
    pressure = sp.simplify(sum(w * sp.diff(given, one).subs(_REST) for one, w in weights.items()))
    if pressure.has(sp.zoo, sp.nan, sp.oo, sp.I):
        raise InputError("energy: it or its slope is not finite, or not real, at rest")
    return pressure


def _differs(given: sp.Expr) -> bool:
    """Return whether an expression is nonzero at sample values, which is faster than to simplify it."""
    numbers = {one: sp.Float(1.0 + 1.0 / (k + 3.0)) for k, one in enumerate(sorted(given.free_symbols, key=str))}
    value = given.subs(numbers).evalf()
    return bool(value.is_comparable and abs(value) > 1e-9)


def _checked(given: sp.Expr, constants: Sequence[sp.Symbol]) -> sp.Expr:
    """Return an energy in terms of ``C`` alone, of ``F``, or of invariants; raises `InputError` for unknown symbols."""
    if callable(given):
        raise InputError("energy: got a function, need an expression of SymPy")
    given = sp.sympify(given)
    if set(s.C) & given.free_symbols and {*s.F, *s.INVARIANTS} & given.free_symbols:
        product = s.F.T * s.F
        given = given.subs({s.C[A, B]: product[A, B] for A in range(3) for B in range(A, 3)})
    known = {*s.INVARIANTS, *s.F, *s.C, *s.a, *s.b, s.activation, *constants}
    unknown = sorted(str(one) for one in given.free_symbols - known)
    if unknown:
        raise InputError(
            f"energy: {', '.join(unknown)} is neither a constant that is given nor a symbol of "
            "isorod.material.symbols (F, C, I1, I2, J, I1bar, I2bar, I4a, I4b, I8, stretches, a, b, activation)"
        )
    if set(s.F) & given.free_symbols and set(s.INVARIANTS) & given.free_symbols:
        given = given.subs(_invariants_of_F(given))
    return given


def _invariants_of_F(given: sp.Expr) -> dict[sp.Symbol, sp.Expr]:
    """Return invariants as expressions of ``F``."""
    if set(s.stretches) & given.free_symbols:
        raise InputError("energy: components of F or C and principal stretches cannot stand together")
    C, a, b = s.F.T * s.F, sp.Matrix(s.a), sp.Matrix(s.b)
    return {
        s.I1: C.trace(),
        s.I2: (C.trace() ** 2 - (C * C).trace()) / 2,
        s.J: s.F.det(),
        s.I4a: (a.T * C * a)[0],
        s.I4b: (b.T * C * b)[0],
        s.I8: (a.T * C * b)[0],
    }


def _tidy(expression: sp.Expr) -> sp.Expr:
    """Return the form of an expression with the fewest operations."""
    return min((expression, sp.factor_terms(expression)), key=sp.count_ops)
