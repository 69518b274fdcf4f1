"""Load cases of a file: which of its loads and supports act in each, and what is otherwise in its place."""

import re
from collections.abc import Sequence
from copy import deepcopy
from typing import Any

from isorod.files import changes
from isorod.files.document import Document, Place, shown

# What a case may choose of by names, each as the file's table of it is called.
_CHOSEN = {"loads": "load", "supports": "support", "contacts": "contact", "ties": "tie", "measures": "measure"}

# Loads without a name of their own: they are called what they are.
_ALONE = ("gravity", "spin")

# What of a load a factor multiplies; a spin has none, as its load goes with the square.
_SIZES = ("force", "moment", "pressure", "body_force", "density", "per_length", "acceleration", "traction")

_NAME = re.compile(r"[\w-]+")


def put(document: Document, case: str | None, assignments: Sequence[str]) -> list[str]:
    """Apply a load case and typed changes to a document; return the names of its load cases.

    Parameters
    ----------
    document
        Its content is changed; afterwards no cases stand in it.
    case
        The case; None for what all have in common.
    assignments
        Changes (`isorod.files.changes.put`): of a case before it is read, of all else before it chooses what acts.

    Raises
    ------
    InputError
        If there is no such case, or it chooses or changes what is not there.
    """
    ours = [one.lstrip().partition(".")[0] == "case" for one in assignments]
    own, rest = (
        [one for one, of_case in zip(assignments, ours, strict=True) if of_case == case_too]
        for case_too in (True, False)
    )
    changes.put(document, own)
    place, tables = document.top / "case", document.content.pop("case", {})
    if not isinstance(tables, dict):
        raise place.error(f"got {shown(tables)}, need a table for each, with a name: [case.NAME]")
    for name, table in tables.items():
        if not _NAME.fullmatch(name):
            raise place.error(f"{name!r} is no name; need letters, digits, - and _: results have a folder of it")
        (place / name).table(table)
    if case is not None:
        if case not in tables:
            raise place.unknown(case, tables) if tables else document.top.error("--case: no [case.NAME] is in it")
        _put(document, place / case, tables[case], rest)
    else:
        changes.put(document, rest)
    return [*tables]


def _put(document: Document, place: Place, table: dict[str, Any], assignments: Sequence[str]) -> None:
    content = document.content
    rest = {key: value for key, value in table.items() if key not in _CHOSEN}
    for key in ("title", "analysis"):
        if key in rest:
            raise (place / key).error("it is the same in all cases; write it above them, or in a file of its own")
    before = {kind: {*content.get(kind, {})} for kind in _CHOSEN.values()}
    _merge(document, content, rest, (), place)
    # What is typed may be of a load that does not act here.
    changes.put(document, assignments)
    for key, kind in _CHOSEN.items():
        if key in table:
            _choose(content, place / key, table[key], kind, {*rest.get(kind, {})} & before[kind], rest)


def _merge(document: Document, into: dict[str, Any], table: dict[str, Any], path: tuple[str, ...], at: Place) -> None:
    """Replace values of the file by those of a case, key by key, and note where they stand."""
    for key, value in table.items():
        document.moved((*path, key), (at / key).path)
        if isinstance(value, dict) and isinstance(into.get(key), dict):
            _merge(document, into[key], value, (*path, key), at / key)
        else:
            into[key] = deepcopy(value)


def _choose(
    content: dict[str, Any], place: Place, requested: Any, kind: str, changed: set[str], rest: dict[str, Any]
) -> None:
    """Leave of a kind what a case names alone; loads may be named with factors."""
    factors = requested if isinstance(requested, dict) and kind == "load" else None
    if factors is None and not (isinstance(requested, list) and all(isinstance(one, str) for one in requested)):
        also = ", or a factor for each: {NAME = 1.5}" if kind == "load" else ""
        raise place.error(f"got {shown(requested)}, need names in a list{also}")
    there = dict(content.get(kind, {}))
    alone = [one for one in _ALONE if one in content] if kind == "load" else []
    for name in requested:
        if name not in there and name not in alone:
            raise place.unknown(name, [*there, *alone])
    left = next((name for name in changed if name not in requested), None)
    if left is not None:
        raise place.error(f"{left} is changed in this case, but not among them")
    solid = next(
        (one for one, own in content.get("solid", {}).items() if isinstance(own, dict) and "load" in own), None
    )
    if kind == "load" and solid is not None and "load" not in rest.get("solid", {}).get(solid, {}):
        raise place.error(f"solid {solid} has loads of its own; give them here: solid.{solid}.load = ...")
    kept = {name: deepcopy(there[name]) for name in there if name in requested}
    for one in alone:
        if one not in requested:
            del content[one]
    for name, factor in (factors or {}).items():
        if isinstance(factor, bool) or not isinstance(factor, int | float):
            raise (place / name).error(f"got {shown(factor)}, need a number")
        if name == "spin" and factor != 1.0:
            raise (place / name).error("a spin has no factor; give its velocity in the case: spin.velocity = ...")
        if name in alone:
            content[name] = _times(place / name, content[name], float(factor))
        else:
            kept[name] = _times(place / name, kept[name], float(factor))
    content.pop(kind, None)
    if kept:
        content[kind] = kept


def _times(place: Place, table: Any, factor: float, size: bool = False) -> Any:
    """Return the table of a load with its forces and moments times a factor."""
    if factor == 1.0:
        return table
    if isinstance(table, dict):
        return {key: _times(place, one, factor, size or key in _SIZES) for key, one in table.items()}
    if not size:
        return table
    if isinstance(table, list):
        return [_times(place, one, factor, True) for one in table]
    if isinstance(table, bool) or not isinstance(table, int | float):
        raise place.error(f"a factor needs numbers, and the load has {shown(table)}; give its values in the case")
    return factor * table
