"""Values of a scene file, held to what the annotation of a parameter says."""

import re
import types
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.files.document import Place, shown

_UNIT = re.compile(r"\s*[-+]?[\d.]+([eE][-+]?\d+)?\s*[^\d\s].*")


def value_of(place: Place, value: Any, kind: Any) -> Any:
    """Return a value of TOML as one of a kind.

    Numbers must be finite, lists of the length that the kind has, whole numbers may be written ``8.0``; the name of a
    file is one of a file that is there, beside the scene's.

    Raises
    ------
    InputError
        If it is none of that kind.
    """
    for one in _parts(kind):
        if _is(value, one):
            _refuse_infinite(place, value)
            return _made(place, value, one)
    choices = [word for one in _parts(kind) if get_origin(one) is Literal for word in get_args(one)]
    if choices and isinstance(value, str):
        raise place.unknown(value, choices)
    hint = ""
    if isinstance(value, str) and _UNIT.fullmatch(value):
        hint = "; units are yours to choose, the same throughout, and are not written"
    raise place.error(f"got {shown(value)}, need {words(kind)}{hint}")


def words(kind: Any) -> str:
    """Return what a kind is in words."""
    plain = {
        int: "an integer",
        float: "a number",
        str: "a text",
        bool: "true or false",
        Path: "the name of a file beside this one",
    }
    told = []
    for one in _parts(kind):
        origin, parts = get_origin(one), get_args(one)
        if origin is Literal:
            told.append(" or ".join(parts))
        elif origin is tuple and Ellipsis not in parts:
            told.append(f"{len(parts)} {_several(parts[0])}")
        elif origin is tuple or origin is Sequence:
            told.append(f"a list of {_several(parts[0])}")
        else:
            told.append(plain.get(one, "numbers in lists" if _is_array(one) else "a value"))
    return " or ".join(dict.fromkeys(told))


def _several(kind: Any) -> str:
    return {int: "integers", float: "numbers", str: "texts"}.get(kind, "values")


def _parts(kind: Any) -> tuple[Any, ...]:
    """Return what a kind may be one of, None left out: that is to write nothing."""
    if _is_array(kind) or get_origin(kind) not in (Union, types.UnionType):
        return (kind,)
    if Numbers in get_args(kind):
        return (Numbers,)
    parts = tuple(part for part in get_args(kind) if part is not type(None))
    # The name of a file may also be given as a text in Python.
    return tuple(part for part in parts if part is not str) if Path in parts else parts


def _is_array(kind: Any) -> bool:
    return kind in (Numbers, Array, Any, object)


def _is(value: Any, kind: Any) -> bool:
    origin, parts = get_origin(kind), get_args(kind)
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    if kind is int:
        return value.is_integer() if isinstance(value, float) else _is(value, float)
    if kind in (str, Path):
        return isinstance(value, str)
    if kind is bool:
        return isinstance(value, bool)
    if origin is Literal:
        return value in parts
    if origin is tuple and Ellipsis not in parts:
        return isinstance(value, list) and len(value) == len(parts) and all(map(_is, value, parts))
    if origin in (tuple, Sequence):
        return isinstance(value, list) and all(any(_is(one, part) for part in _parts(parts[0])) for one in value)
    return _is_array(kind) and (isinstance(value, str) or _depth(value) is not None)


def _depth(value: Any) -> tuple[int, ...] | None:
    """Return the shape of numbers in lists, or None if they have none."""
    if not isinstance(value, list):
        return () if _is(value, float) else None
    shapes = {_depth(one) for one in value}
    inner = shapes.pop() if len(shapes) == 1 else None
    return None if inner is None else (len(value), *inner)


def _refuse_infinite(place: Place, value: Any) -> None:
    if isinstance(value, list):
        for k, one in enumerate(value):
            _refuse_infinite(place / k, one)
    # An integer may be too long for any other number.
    elif isinstance(value, int | float) and not abs(value) <= 1.7e308:
        said = f"{value:.40}" if isinstance(value, float) else f"{value!s:.20}..., an integer of too many digits"
        raise place.error(f"got {said}, need a finite number")


def _made(place: Place, value: Any, kind: Any) -> Any:
    if kind is int:
        return int(value)
    if kind is float:
        return float(value)
    if kind is Path:
        place.data(value)
        return place.document.folder / value
    if isinstance(value, list):
        return np.array(value, dtype=float) if _is_array(kind) else tuple(value)
    return value
