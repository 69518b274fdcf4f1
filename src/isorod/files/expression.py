"""Formulas written as text: read by Python's grammar, of which a few words are known; nothing of it is run."""

import ast
import difflib
import math
import operator
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

from isorod.errors import InputError

if TYPE_CHECKING:
    import sympy as sp

# Long enough for any energy that somebody writes by hand, and whole exponents that are multiplied out at once.
_LONGEST, _DEEPEST, _HIGHEST = 2000, 60, 32

# Operations in second derivatives beyond which these are not found, nor compiled, within some ten seconds.
_MOST = 5000

_CHAINED = ast.Add | ast.Sub | ast.Mult | ast.Div
_OPERATIONS: dict[type[ast.operator], Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}

_FUNCTIONS = ("log", "exp", "sqrt", "sin", "cos", "tanh", "Max", "Min")

# Of tensors: the trace, what is left without it, and the sum of the products of components.
_TENSORS = ("tr", "dev", "dot")


def parsed(text: str, constants: Collection[str]) -> "sp.Expr":
    """Return an energy as an expression of `isorod.material.symbols` and constants.

    Raises
    ------
    InputError
        If it is none, with the column.
    """
    import sympy as sp

    from isorod.material import symbols as s

    names = _names()
    # Laws add symbols themselves.
    taken = {*names, *_FUNCTIONS, *map(str, (s.activation, s.temperature, s.bulk, *s.a, *s.b))}
    for one in constants:
        if one in taken or not one.isidentifier():
            raise InputError(f"constants: got the name {one!r}, need one that is not taken, of letters and digits")
    known = names | {one: sp.Symbol(one, real=True) for one in constants}
    return bounded(formula(text, known, "energy", "a constant that is given or a symbol of energies"), "energy")


def bounded(expression: "sp.Expr", what: str) -> "sp.Expr":
    """Return an expression whose second derivatives take no more operations than can be compiled.

    Raises
    ------
    InputError
        If they take more.
    """
    _, _, operations = _operations(expression)
    if operations > _MOST:
        raise InputError(
            f"{what}: its second derivatives take about {operations:,} operations, need at most {_MOST:,}: products of "
            "many factors, as powers of one where they are alike, take fewer"
        )
    return expression


def formula(text: str, names: Mapping[str, Any], what: str, known: str) -> "sp.Expr":
    """Return the expression of a text in names, which are expressions of SymPy.

    Parameters
    ----------
    text
        The text.
    names
        What each name means.
    what, known
        What the text is of, and what its names may be, for errors.

    Raises
    ------
    InputError
        If it is no expression of these, with the column.
    """
    if len(text) > _LONGEST:
        raise InputError(f"{what}: got {len(text)} characters, need at most {_LONGEST}")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as problem:
        column = f", column {problem.offset}" if isinstance(problem, SyntaxError) and problem.offset else ""
        raise InputError(f"{what}: got {text!r:.60}, which is no expression{column}") from None
    import sympy as sp

    try:
        result = _read(tree, names, known, 0)
    except InputError as problem:
        raise InputError(f"{what}: {problem}") from None
    if isinstance(result, sp.MatrixBase):
        raise InputError(f"{what}: got {text!r:.60}, which is a tensor, need a number")
    if result.has(sp.zoo, sp.nan, sp.oo):
        raise InputError(f"{what}: got {text!r:.60}, which divides by zero or is not finite")
    if result.has(sp.I):
        raise InputError(f"{what}: got {text!r:.60}, which is not real")
    return result


def _operations(expression: "sp.Expr") -> tuple[int, int, int]:
    """Return how many operations an expression takes, its first and its second derivatives, about."""
    if not expression.args:
        return 1, int(expression.is_Symbol), 0
    own, first, second = zip(*map(_operations, expression.args), strict=True)
    size = sum(own) + len(own)
    if expression.is_Add:
        return size, sum(first) + len(own), sum(second) + len(own)
    if expression.is_Mul:
        # By the product rule each factor in turn, and each pair of them, stand beside all others.
        vary = sum(1 for one in first if one)
        return size, sum(first) + vary * size, sum(second) + vary * size + vary * (vary - 1) * size
    return size, size + sum(first), 2 * size + 2 * sum(first) + sum(second)


def _names() -> dict[str, Any]:
    from isorod.material import symbols as s

    known = [s.I1, s.I2, s.J, s.I4a, s.I4b, s.I8, *s.stretches, *s.F]
    known_names = {str(one): one for one in known}
    known_names |= {f"C{A}{B}": s.C[A, B] for A in range(3) for B in range(3)}
    return known_names | {"I1bar": s.I1bar, "I2bar": s.I2bar}


def _read(node: ast.AST, names: Mapping[str, Any], known: str, depth: int) -> Any:
    """Return the expression of a node; raises `InputError` at what is not known."""
    import sympy as sp

    if depth > _DEEPEST:
        raise InputError(f"brackets within brackets deeper than {_DEEPEST}")
    if isinstance(node, ast.Constant):
        if type(node.value) is int and abs(node.value) < 10**15:
            return sp.Integer(node.value)
        if type(node.value) is float and math.isfinite(node.value):
            return sp.Float(node.value)
    elif isinstance(node, ast.Name):
        if node.id in names:
            return names[node.id]
        raise _unknown(node, node.id, [*names, *_FUNCTIONS], known)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        value = _read(node.operand, names, known, depth + 1)
        return -value if isinstance(node.op, ast.USub) else value
    elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATIONS:
        # Terms of a sum, or factors, are no brackets: the grammar has each on the left of the next.
        chain = [node]
        while isinstance(left := chain[-1].left, ast.BinOp) and isinstance(left.op, _CHAINED):
            chain.append(left)
        found = _read(chain[-1].left, names, known, depth + 1)
        for one in reversed(chain):
            found = _combined(one, found, _read(one.right, names, known, depth + 1))
        return found
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        tensors = _TENSORS if any(isinstance(one, sp.MatrixBase) for one in names.values()) else ()
        if node.func.id not in (*_FUNCTIONS, *tensors):
            raise _unknown(node, node.func.id, (*_FUNCTIONS, *tensors), known)
        given = [_read(one, names, known, depth + 1) for one in node.args]
        if node.func.id in tensors:
            return _of_tensors(node, given)
        if any(isinstance(one, sp.MatrixBase) for one in given):
            raise InputError(f"column {node.col_offset + 1}: {node.func.id} of a tensor, need a number")
        if (len(given) == 1) == (node.func.id in ("Max", "Min")):
            raise InputError(f"column {node.col_offset + 1}: {node.func.id} of {len(given)} values")
        return getattr(sp, node.func.id)(*given)
    raise InputError(
        f"column {getattr(node, 'col_offset', 0) + 1}: need numbers, names, + - * / ** and functions "
        f"({', '.join(_FUNCTIONS)})"
    )


def _of_tensors(node: ast.Call, given: list[Any]) -> Any:
    """Return the trace, the deviator, or the product of tensors."""
    import sympy as sp

    name = ast.unparse(node.func)
    if len(given) != 1 + (name == "dot") or not all(isinstance(one, sp.MatrixBase) for one in given):
        raise InputError(f"column {node.col_offset + 1}: need tr(tensor), dev(tensor) or dot(tensor, tensor)")
    if name == "dot":
        return sum(one * other for one, other in zip(*given, strict=True))
    return given[0].trace() if name == "tr" else given[0] - given[0].trace() / 3 * sp.eye(3)


def _combined(node: ast.BinOp, left: Any, right: Any) -> Any:
    import sympy as sp

    tensors = [isinstance(one, sp.MatrixBase) for one in (left, right)]
    if any(tensors):
        sums, factors = isinstance(node.op, ast.Add | ast.Sub), isinstance(node.op, ast.Mult)
        if not (sums and all(tensors)) and not (factors and not all(tensors)):
            raise InputError(f"column {node.col_offset + 1}: tensors take + and - with tensors, and * with numbers")
    if isinstance(node.op, ast.Pow) and right.is_number and abs(right) > _HIGHEST:
        raise InputError(f"column {node.col_offset + 1}: an exponent of {right}, need at most {_HIGHEST}")
    return _OPERATIONS[type(node.op)](left, right)


def _unknown(node: ast.expr, word: str, words: Collection[str], known: str) -> InputError:
    near = difflib.get_close_matches(word, words, 1)
    hint = f"did you mean {near[0]}?" if near else f"need {known}"
    return InputError(f"column {node.col_offset + 1}: {word!r} is not known; {hint}")
