"""A stored energy written in SymPy, such as that of each of isorod's laws, as a UFL expression of ``F``."""

from collections.abc import Callable, Mapping
from functools import partial, reduce
from math import isfinite, pi
from operator import add, mul
from typing import Any

import sympy
import ufl
from sympy.codegen import cfunctions

from isorod.errors import InputError
from isorod.material import symbols
from isorod.material.law import Material

Energy = Callable[[Any], Any]

# Added to the squared radius in the trigonometric solution, so that no two squared principal stretches are equal;
# symmetric functions of them have an error of this size, second derivatives a round-off of 1e-16 / APART**1.5.
APART = 1e-9

_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    sympy.exp: ufl.exp,
    sympy.log: ufl.ln,
    sympy.sin: ufl.sin,
    sympy.cos: ufl.cos,
    sympy.tan: ufl.tan,
    sympy.asin: ufl.asin,
    sympy.acos: ufl.acos,
    sympy.atan: ufl.atan,
    sympy.sinh: ufl.sinh,
    sympy.cosh: ufl.cosh,
    sympy.tanh: ufl.tanh,
    sympy.erf: ufl.erf,
    sympy.sign: ufl.sign,
    sympy.Abs: abs,
    sympy.Max: lambda *values: reduce(ufl.max_value, values),
    sympy.Min: lambda *values: reduce(ufl.min_value, values),
    cfunctions.expm1: lambda x: ufl.exp(x) - 1.0,
    cfunctions.log1p: lambda x: ufl.ln(1.0 + x),
}
_CONDITIONS: dict[Any, Callable[..., Any]] = {
    sympy.StrictGreaterThan: ufl.gt,
    sympy.GreaterThan: ufl.ge,
    sympy.StrictLessThan: ufl.lt,
    sympy.LessThan: ufl.le,
    sympy.Equality: ufl.eq,
    sympy.Unequality: ufl.ne,
    sympy.And: lambda *values: reduce(ufl.And, values),
    sympy.Or: lambda *values: reduce(ufl.Or, values),
    sympy.Not: ufl.Not,
}


def density(
    expression: sympy.Expr,
    F: Any,
    values: Mapping[sympy.Symbol, Any] | None = None,
    fibres: tuple[Any, ...] = (),
) -> Any:
    """Return a stored energy as a UFL scalar.

    Parameters
    ----------
    expression
        Expression of the symbols in `isorod.material.symbols`, and constants.
    F
        Deformation gradient in UFL.
    values
        Numbers or UFL scalars for the constants.
    fibres
        Unit vectors in UFL along up to two families of fibres at rest.

    Raises
    ------
    InputError
        If it has a symbol without a value, or a function that UFL does not have.
    """
    return _Converter(_Kinematics(F, fibres), values or {})(expression)


def density_of(
    expression: sympy.Expr,
    C: Any,
    values: Mapping[sympy.Symbol, Any] | None = None,
    fibres: tuple[Any, ...] = (),
) -> Any:
    """Return a frame-invariant stored energy as a UFL scalar of ``C``; otherwise as `density` does."""
    return _Converter(_Stretching(C, fibres), values or {})(expression)


def energy_of(law: Material, activation: Any = 0.0, fibres: tuple[Any, ...] = ()) -> Energy:
    """Return the stored energy of one of isorod's laws: a UFL function of the deformation gradient.

    Parameters
    ----------
    law
        The law; its constants become numbers in the form.
    activation
        Factor of the law's activation: a number, or a UFL scalar such as a dolfinx Constant.
    fibres
        See `density`.

    Raises
    ------
    InputError
        If it is incompressible.
    """
    stored, values = law.stored, constants_of(law)
    constants = dict(zip(stored.constants, values, strict=True)) | {symbols.activation: activation}
    return lambda F: density(stored.expression, F, constants, fibres)


def constants_of(law: Material) -> list[float]:
    """Return the values of the constants of a law's stored energy.

    Raises
    ------
    InputError
        If one is infinite: the law is incompressible.
    """
    values = [float(value) for value in law.constants]
    if not all(map(isfinite, values)):
        raise InputError("material: incompressible (nu = 0.5), which displacements alone cannot be")
    return values


class _Kinematics:
    """The values of `isorod.material.symbols`, each made when it is first needed."""

    def __init__(self, F: Any, fibres: tuple[Any, ...]) -> None:
        self._F, self._fibres = F, fibres
        self._made: dict[str, Any] = {}
        find: dict[sympy.Symbol, Callable[[], Any]] = {
            symbols.I1: self._trace,
            symbols.I2: lambda: 0.5 * (self._trace() ** 2 - ufl.inner(self.C, self.C)),
            symbols.J: self._determinant,
            symbols.I4a: lambda: self._along(0, 0),
            symbols.I4b: lambda: self._along(1, 1),
            symbols.I8: lambda: self._along(0, 1),
        }
        for k, symbol in enumerate(symbols.stretches):
            find[symbol] = partial(self._stretch, k)
        for i in range(3):
            for j in range(3):
                find[symbols.F[i, j]] = partial(self._component, i, j)
                find[symbols.C[i, j]] = partial(self._component_of_C, i, j)
            find[symbols.a[i]] = partial(self._direction, 0, i)
            find[symbols.b[i]] = partial(self._direction, 1, i)
        self.find = find

    def _once(self, name: str, make: Callable[[], Any]) -> Any:
        if name not in self._made:
            self._made[name] = make()
        return self._made[name]

    @property
    def F(self) -> Any:
        return self._F

    @property
    def C(self) -> Any:
        return self._once("C", lambda: self.F.T * self.F)

    def _component(self, i: int, j: int) -> Any:
        return self.F[i, j]

    def _trace(self) -> Any:
        return ufl.inner(self.F, self.F)

    def _determinant(self) -> Any:
        return ufl.det(self.F)

    def _along(self, first: int, second: int) -> Any:
        return ufl.inner(self._deformed(first), self._deformed(second))

    def _fibre(self, family: int) -> Any:
        if family >= len(self._fibres):
            raise InputError(f"stored energy: it has fibres {'ab'[family]}, and no direction of these is given")
        return self._fibres[family]

    def _direction(self, family: int, i: int) -> Any:
        return self._fibre(family)[i]

    def _component_of_C(self, i: int, j: int) -> Any:
        return self.C[i, j]

    def _deformed(self, family: int) -> Any:
        return self._once(f"deformed {family}", lambda: ufl.dot(self.F, self._fibre(family)))

    def _stretch(self, k: int) -> Any:
        """Return a principal stretch, by the trigonometric solution of the characteristic equation of ``C``."""
        middle, radius, angle = self._once("roots", self._roots)
        return ufl.sqrt(middle + 2.0 * radius * ufl.cos((angle + 2.0 * pi * k) / 3.0))

    def _roots(self) -> tuple[Any, Any, Any]:
        middle = ufl.tr(self.C) / 3.0
        rest = self.C - middle * ufl.Identity(3)
        radius = ufl.sqrt(ufl.inner(rest, rest) / 6.0 + APART)
        return middle, radius, ufl.acos(ufl.det(rest) / (2.0 * radius**3))


class _Stretching(_Kinematics):
    """Kinematics from ``C``."""

    def __init__(self, C: Any, fibres: tuple[Any, ...]) -> None:
        super().__init__(None, fibres)
        self._C = C

    @property
    def C(self) -> Any:
        return self._C

    @property
    def F(self) -> Any:
        # Any F with F^T F = C will do.
        return self._once("F", lambda: _triangular(self._C))

    def _trace(self) -> Any:
        return ufl.tr(self._C)

    def _determinant(self) -> Any:
        return ufl.sqrt(ufl.det(self._C))

    def _along(self, first: int, second: int) -> Any:
        return ufl.dot(self._fibre(first), ufl.dot(self._C, self._fibre(second)))


def _triangular(C: Any) -> Any:
    """Return an upper triangular ``U`` with ``U^T U = C``."""
    u00 = ufl.sqrt(C[0, 0])
    u01, u02 = C[0, 1] / u00, C[0, 2] / u00
    u11 = ufl.sqrt(C[1, 1] - u01**2)
    u12 = (C[1, 2] - u01 * u02) / u11
    return ufl.as_matrix([[u00, u01, u02], [0.0, u11, u12], [0.0, 0.0, ufl.sqrt(C[2, 2] - u02**2 - u12**2)]])


class _Converter:
    """Conversion from SymPy to UFL; equal subexpressions become one object."""

    def __init__(self, kinematics: _Kinematics, values: Mapping[sympy.Symbol, Any]) -> None:
        self._kinematics, self._values = kinematics, values
        self._converted: dict[sympy.Basic, Any] = {}

    def __call__(self, node: sympy.Basic) -> Any:
        if node not in self._converted:
            self._converted[node] = self._made(node)
        return self._converted[node]

    def _made(self, node: Any) -> Any:
        if isinstance(node, sympy.Symbol):
            return self._symbol(node)
        if isinstance(node, sympy.Number | sympy.NumberSymbol):
            return int(node) if node.is_Integer else float(node)
        if isinstance(node, sympy.Add | sympy.Mul):
            return reduce(add if node.is_Add else mul, map(self, node.args))
        if isinstance(node, sympy.Pow):
            return self._power(*node.args)
        if isinstance(node, sympy.Piecewise):
            return self._piecewise(node)
        make = _FUNCTIONS.get(node.func)
        if make is None:
            raise InputError(f"stored energy: UFL has no function {node.func.__name__}")
        return make(*map(self, node.args))

    def _symbol(self, node: sympy.Symbol) -> Any:
        if node in self._values:
            return self._values[node]
        if node in self._kinematics.find:
            return self._kinematics.find[node]()
        raise InputError(f"stored energy: the symbol {node} has no value")

    def _power(self, base: Any, exponent: Any) -> Any:
        if exponent.is_negative and exponent.is_Rational:
            return 1.0 / self(base**-exponent)
        if exponent == sympy.Rational(1, 2):
            return ufl.sqrt(self(base))
        return self(base) ** self(exponent)

    def _piecewise(self, node: sympy.Piecewise) -> Any:
        *branches, (last, rest) = node.args
        if rest != sympy.true:
            raise InputError("stored energy: a Piecewise has no default; end it with (value, True)")
        value = self(last)
        for branch, condition in reversed(branches):
            value = ufl.conditional(self._condition(condition), self(branch), value)
        return value

    def _condition(self, node: Any) -> Any:
        make = _CONDITIONS.get(node.func)
        if make is None:
            raise InputError(f"stored energy: UFL has no condition {node.func.__name__}")
        logical = isinstance(node, sympy.logic.boolalg.BooleanFunction)
        return make(*map(self._condition if logical else self, node.args))
