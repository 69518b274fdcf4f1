"""Values of a scene file, checked against the annotation of a parameter."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args, get_origin

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.errors import PLAIN, alternatives, described, fits
from isorod.files.document import Place, shown


class Kind(NamedTuple):
    """What a value may be that no annotation says: what makes it, of its place and its value, and what it is in words.

    ``name`` is that of what a file knows by names, such as ``"rod"``.
    """

    make: Callable[[Place, Any], Any]
    words: str
    name: str = ""


_ARRAYS = (Numbers, Array, Any, object)
_PLAIN = PLAIN | {
    bool: "true or false",
    Path: "the name of a file beside this one",
    **dict.fromkeys(_ARRAYS, "numbers in lists"),
}
_UNIT = re.compile(r"\s*[-+]?[\d.]+([eE][-+]?\d+)?\s*[^\d\s].*")


def value_of(place: Place, value: Any, kind: Any) -> Any:
    """Return a value of TOML as one of a kind: an annotation, or a `Kind`.

    Numbers must be finite, lists of the length that the kind has, whole numbers may be written ``8.0``; the name of a
    file is one of a file that is there, beside the scene's.

    Raises
    ------
    InputError
        If it is none of that kind.
    """
    if isinstance(kind, Kind):
        return kind.make(place, value)
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
    if isinstance(kind, Kind):
        return kind.words
    return described(_parts(kind), _PLAIN)


def _parts(kind: Any) -> tuple[Any, ...]:
    """Return what a kind may be one of, None left out: that is to write nothing."""
    parts = tuple(part for part in alternatives(kind) if part is not type(None))
    if Numbers in parts:
        return (Numbers,)
    # The name of a file may also be given as a text in Python.
    return tuple(part for part in parts if part is not str) if Path in parts else parts


def _is_array(kind: Any) -> bool:
    return kind in _ARRAYS


def _is(value: Any, kind: Any) -> bool:
    if kind is Path:
        return isinstance(value, str)
    if _is_array(kind):
        return isinstance(value, str) or _depth(value) is not None
    return fits(value, kind)


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
        text = f"{value:.40}" if isinstance(value, float) else f"{value!s:.20}..., an integer of too many digits"
        raise place.error(f"got {text}, need a finite number")


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
