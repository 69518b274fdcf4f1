"""Expressions as lines of Python with common subexpressions, in functions that loops over points can vectorise."""

from collections.abc import Sequence

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from isorod.errors import InputError

_OWN = {"sin", "cos", "tan", "sinh", "cosh", "tanh", "atan", "asin", "acos", "asinh", "atanh", "acosh"}


class _Printer(PythonCodePrinter):  # type: ignore[misc]
    """Prints expressions by functions of `isorod.material.functions` and NumPy."""

    def _print_Rational(self, expr: sp.Rational) -> str:
        return repr(float(expr))

    def _print_Integer(self, expr: sp.Integer) -> str:
        return f"{int(expr)}.0"

    _print_Zero = _print_One = _print_NegativeOne = _print_Integer
    _print_Half = _print_Rational

    def _print_Float(self, expr: sp.Float) -> str:
        return repr(float(expr))

    def _print_NumberSymbol(self, expr: sp.Expr) -> str:
        return repr(float(expr))

    _print_Pi = _print_Exp1 = _print_NumberSymbol

    def _print_Pow(self, expr: sp.Pow, rational: bool = False) -> str:
        base, exponent = expr.base, expr.exp
        text = self._print(base)
        if exponent.is_Integer and 1 <= abs(int(exponent)) <= 16:
            text = text if base.is_Symbol else f"({text})"
            product = "(" + " * ".join([text] * abs(int(exponent))) + ")"
            return product if exponent > 0 else f"(1.0 / {product})"
        if exponent.is_Rational and exponent.q == 2 and abs(exponent.p) <= 15:
            factors = [f"({text})"] * ((abs(exponent.p) - 1) // 2)
            product = " * ".join([*factors, f"np.sqrt({text})"])
            return f"({product})" if exponent > 0 else f"(1.0 / ({product}))"
        return f"power({text}, {self._print(exponent)})"

    def _print_exp(self, expr: sp.Expr) -> str:
        return f"exp({self._print(expr.args[0])})"

    def _print_expm1(self, expr: sp.Expr) -> str:
        return f"expm1({self._print(expr.args[0])})"

    def _print_log(self, expr: sp.Expr) -> str:
        return f"log({self._print(expr.args[0])})"

    def _print_erf(self, expr: sp.Expr) -> str:
        return f"erf({self._print(expr.args[0])})"

    def _print_Abs(self, expr: sp.Expr) -> str:
        return f"abs({self._print(expr.args[0])})"

    def _print_sign(self, expr: sp.Expr) -> str:
        return f"np.sign({self._print(expr.args[0])})"

    def _print_Heaviside(self, expr: sp.Expr) -> str:
        return f"(1.0 if {self._print(expr.args[0])} > 0.0 else 0.0)"

    def _print_Max(self, expr: sp.Expr) -> str:
        return f"max({', '.join(self._print(one) for one in expr.args)})"

    def _print_Min(self, expr: sp.Expr) -> str:
        return f"min({', '.join(self._print(one) for one in expr.args)})"

    def _print_Piecewise(self, expr: sp.Piecewise) -> str:
        text = "np.nan"
        for value, condition in reversed(expr.args):
            value = self._print(value)
            text = value if condition == sp.true else f"({value} if {self._print(condition)} else {text})"
        return text

    def _print_Function(self, expr: sp.Function) -> str:
        name = expr.func.__name__
        if name not in _OWN:
            raise InputError(f"energy: the function {name} is not one that laws are compiled with")
        name = {"atan": "arctan", "asin": "arcsin", "acos": "arccos"}.get(
            name, name.replace("a", "arc", 1) if name in ("asinh", "atanh", "acosh") else name
        )
        return f"np.{name}({', '.join(self._print(one) for one in expr.args)})"

    _print_sin = _print_cos = _print_tan = _print_sinh = _print_cosh = _print_tanh = _print_Function
    _print_atan = _print_asin = _print_acos = _print_asinh = _print_atanh = _print_acosh = _print_Function

    def _print_Derivative(self, expr: sp.Expr) -> str:
        raise InputError(f"energy: the derivative {expr} has no formula")

    def _print_DiracDelta(self, expr: sp.Expr) -> str:
        return "0.0"


_PRINTER = _Printer({"fully_qualified_modules": False})


def assignments(names: Sequence[str], expressions: Sequence[sp.Expr]) -> list[str]:
    """Return lines that assign the values of expressions to names, with common subexpressions."""
    shared, lines = _shared_powers(list(expressions))
    numbers = sp.numbered_symbols("x")
    replaced, reduced = sp.cse([*lines.values(), *shared], numbers, order="none")
    statements = [f"{name} = {_PRINTER.doprint(value)}" for name, value in replaced]
    # A shared power comes after its base and before the powers computed from it.
    count = len(lines)
    if not count:
        return statements + [f"{n} = {_PRINTER.doprint(e)}" for n, e in zip(names, reduced, strict=True)]
    return _ordered(
        [*[(str(n), v) for n, v in replaced], *[(str(n), v) for n, v in zip(lines, reduced[:count], strict=True)]],
    ) + [f"{n} = {_PRINTER.doprint(e)}" for n, e in zip(names, reduced[count:], strict=True)]


def _ordered(pairs: list[tuple[str, sp.Expr]]) -> list[str]:
    """Return assignments in an order in which each uses only earlier ones."""
    names = {name for name, _ in pairs}
    statements: list[str] = []
    known: set[str] = set()
    while pairs:
        left = []
        for name, value in pairs:
            if {str(one) for one in value.free_symbols} & names <= known:
                statements.append(f"{name} = {_PRINTER.doprint(value)}")
                known.add(name)
            else:
                left.append((name, value))
        pairs = left
    return statements


def _shared_powers(expressions: list[sp.Expr]) -> tuple[list[sp.Expr], dict[sp.Symbol, sp.Expr]]:
    """Return expressions in which powers of a base whose exponents differ by integers are powers of one symbol."""
    powers = {power for e in expressions for power in e.atoms(sp.Pow) if not power.exp.is_Integer}
    groups: dict[tuple[sp.Expr, sp.Expr], list[sp.Pow]] = {}
    for power in sorted(powers, key=sp.default_sort_key):
        integer, rest = power.exp.as_coeff_Add()
        if rest == 0:
            if not integer.is_Rational or integer.q == 2:
                continue
            key = power.base, sp.Rational(1, integer.q)
        else:
            key = power.base, rest
        groups.setdefault(key, []).append(power)
    lines: dict[sp.Symbol, sp.Expr] = {}
    replaced = {}
    for (base, unit), members in groups.items():
        if unit.is_Rational and len(members) > 1:
            down = all(power.exp < 0 for power in members)
            name = sp.Symbol(f"r{len(lines)}", positive=True)
            lines[name] = base ** (-unit if down else unit)
            for power in members:
                replaced[power] = name ** int((-power.exp if down else power.exp) / unit)
        elif not unit.is_Rational and len(members) > 1:
            name = sp.Symbol(f"r{len(lines)}", positive=True)
            lines[name] = base**unit
            for power in members:
                replaced[power] = name * base ** power.exp.as_coeff_Add()[0]
    return [one.xreplace(replaced) for one in expressions], lines
