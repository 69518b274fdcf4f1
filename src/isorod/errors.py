"""The errors a user can cause or meet, and checks of what is given.

Each message is one line: what, where, what would be right.
"""

import sys
import types
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import cache
from math import inf, isfinite
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin

if TYPE_CHECKING:
    from isorod.arrays import Array


# Integers beyond it are no floats.
_LONGEST = 10**300


class InputError(ValueError):
    """A value given by the user cannot be used."""


class FoldedRodError(InputError):
    """The map from disk x axis to space is not one-to-one."""


class SolveError(RuntimeError):
    """An analysis did not reach a solution."""


class Checked:
    """A frozen dataclass whose fields are checked against their annotations when it is made; whole numbers are int."""

    def __post_init__(self) -> None:
        owner: Any = type(self)
        for name, kind, plain in _kinds(owner):
            value = getattr(self, name)
            if type(value) is int and abs(value) > _LONGEST:
                raise InputError(f"{owner.__name__}: {name}: got {value!r:.20}..., an integer of too many digits")
            if type(value) in plain:
                continue
            expect(f"{owner.__name__}: {name}", value, kind)
            if type(value) is not int and fits(value, float) and not fits(0.5, kind):
                self._set(**{name: int(value)})

    def _set(self, **values: object) -> None:
        """Set fields while it is made."""
        for name, value in values.items():
            object.__setattr__(self, name, value)


def expect(name: str, value: object, kind: Any) -> None:
    """Raise `InputError` if a value is not of the kind that its annotation names.

    Numbers may be of any type that is real, sequences arrays; nothing is asked of kinds that cannot be told apart.
    """
    if fits(value, kind):
        return
    entries: Sequence[object] = value if isinstance(value, list | tuple) else [value]
    plain = all(one is None or isinstance(one, str | Real) for one in entries)
    own = getattr(value, getattr(kind, "__name__", "").lower() or "_", None)
    hint = f" (its {kind.__name__.lower()}() is one)" if callable(own) else ""
    shown = f"{value!r:.40}" if plain else f"{type(value).__name__}"
    raise InputError(f"{name}: got {shown}, need {described(alternatives(kind))}{hint}")


def numbers(name: str, values: Any) -> "Array":
    """Return an array of numbers, or raise `InputError` if they are none or of no one shape."""
    # The command line's first words do without, and answer twice as fast.
    import numpy as np

    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name}: got {values!r:.40}, need numbers") from None


def whole_number(name: str, value: float, low: int, high: int) -> int:
    """Return ``value`` as an integer, or raise `InputError` if it is not one from ``low`` to ``high``."""
    # NaN and infinity fail the comparison, before int() sees them.
    if not fits(value, float) or not low <= value <= high or int(value) != value:
        raise InputError(f"{name}: got {value!s:.40}, need an integer from {low} to {high}")
    return int(value)


def positive(name: str, value: float, need: str = "a positive length") -> None:
    """Raise `InputError` if a number is not positive and finite."""
    if not 0.0 < value < inf:
        raise InputError(f"{name}: got {value:g}, need {need}")


def finite(name: str, values: Any, need: str = "finite numbers") -> None:
    """Raise `InputError` if a number, or one of several, is not finite."""
    if not all(map(isfinite, values if hasattr(values, "__len__") else [values])):
        raise InputError(f"{name}: got {values}, need {need}")


def representable(name: str, value: float) -> None:
    """Raise `InputError` if a positive value is so far from one that products with it leave double precision."""
    if not 1e-100 <= value <= 1e100:
        raise InputError(f"{name}: got {value:g}, need 1e-100 to 1e100; choose other units")


def modulus(name: str, value: float, need: str = "a positive stress") -> None:
    """Raise `InputError` if a constant of a law is not positive, finite and `representable`."""
    positive(name, value, need)
    representable(name, value)


def within(name: str, value: float, low: float, high: float) -> None:
    """Raise `InputError` if a number is not from ``low`` to ``high``."""
    if not low <= value <= high:
        raise InputError(f"{name}: got {value:.4g}, need {low:g} to {high:g}")


@cache
def _kinds(owner: Any) -> tuple[tuple[str, Any, tuple[Any, ...]], ...]:
    """Return of each field that is given the name, the kind, and types whose values are of that kind for certain."""
    found = []
    for one in fields(owner):
        if one.init:
            # The annotation is one of the class that has it, which may be a base in another file.
            base = next(base for base in owner.__mro__ if one.name in vars(base).get("__annotations__", ()))
            kind = evaluated(one.type, vars(sys.modules[base.__module__]))
            found.append((one.name, kind, alternatives(kind)))
    return tuple(found)


def evaluated(kind: Any, module: Mapping[str, Any]) -> Any:
    """Return what an annotation in quotes stands for; names for type checkers alone stand for anything."""

    class Names(dict[str, Any]):
        def __missing__(self, name: str) -> Any:
            return module.get(name, object)

    return eval(kind, {}, Names()) if isinstance(kind, str) else kind


@cache
def made_of(kind: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return what an annotation is made of: what stands before its brackets, and what within."""
    return get_origin(kind), get_args(kind)


@cache
def alternatives(kind: Any) -> tuple[Any, ...]:
    """Return the kinds of which an annotation asks for one."""
    origin, parts = made_of(kind)
    return parts if origin in (Union, types.UnionType) else (kind,)


def fits(value: Any, kind: Any) -> bool:
    """Return whether a value is of a kind, or the kind is none that can be asked."""
    if type(value) is kind or kind is Any:
        return True
    origin, parts = made_of(kind)
    if origin in (Union, types.UnionType):
        return any(fits(value, part) for part in parts)
    if kind is float:
        return isinstance(value, Real) and not isinstance(value, bool)
    if kind is int:
        return fits(value, float) and (isinstance(value, int) or float(value).is_integer())
    if kind is bool:
        return isinstance(value, bool) or getattr(getattr(value, "dtype", None), "kind", "") == "b"
    if origin is Literal:
        return isinstance(value, str) and value in parts
    if origin in (Sequence, tuple):
        several = (isinstance(value, Sequence) and not isinstance(value, str)) or getattr(value, "ndim", 0) > 0
        if origin is tuple and Ellipsis not in parts:
            return several and len(value) == len(parts) and all(map(fits, value, parts))
        return several and all(fits(one, parts[0]) for one in value)
    if getattr(kind, "_is_protocol", False):
        return all(hasattr(value, name) for name in _asked(kind))
    return not isinstance(kind, type) or isinstance(value, kind)


@cache
def _asked(protocol: Any) -> tuple[str, ...]:
    """Return what a protocol asks for."""
    names = {*vars(protocol), *vars(protocol).get("__annotations__", ())}
    return tuple(name for name in names if not name.startswith("_"))


PLAIN = {
    int: "an integer",
    float: "a number",
    str: "a text",
    bool: "True or False",
    type(None): "None",
}


def described(kinds: Sequence[Any], plain: Mapping[Any, str] = PLAIN) -> str:
    """Return in words of which kinds a value may be; ``plain`` has those of kinds that have no parts."""
    texts = []
    for kind in kinds:
        origin, parts = made_of(kind)
        if kind in plain:
            texts.append(plain[kind])
        elif origin is Literal:
            texts += parts
        elif origin is tuple and Ellipsis not in parts:
            texts.append(f"{len(parts)} {_several(parts[0])}")
        elif origin in (tuple, Sequence):
            texts.append(f"a list of {_several(parts[0])}")
        else:
            texts.append(f"a {getattr(kind, '__name__', 'value')}")
    return " or ".join(dict.fromkeys(texts))


def _several(kind: Any) -> str:
    if isinstance(kind, type):
        return {int: "integers", float: "numbers", str: "texts"}.get(kind, f"{kind.__name__} objects")
    if all(isinstance(one, type) for one in alternatives(kind)):
        return f"{' or '.join(one.__name__ for one in alternatives(kind))} objects"
    return "lists" if made_of(kind)[0] in (tuple, Sequence) else "values"
