"""Copies of a rod of a scene file, and of everything in the file that refers to it."""

from collections.abc import Iterator, Mapping, Sequence
from copy import copy, deepcopy
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError, finite, whole_number
from isorod.files import schema
from isorod.files.document import Place
from isorod.files.form import Call, Name, call
from isorod.files.trees import branches
from isorod.files.values import Kind
from isorod.tensors import rotation

if TYPE_CHECKING:
    from isorod.geometry.rod import Rod

Letter = Literal["x", "y", "z"]

# As many rods as a scene can have is more than anybody waits for.
_MOST = 1000


class Motion(NamedTuple):
    """Where a copy is: ``x -> turn x + shift``, shapes ``(3, 3)`` and ``(3,)``; ``turn`` may mirror."""

    turn: Array
    shift: Array

    def __call__(self, rod: "Rod") -> "Rod":
        """Return a rod's copy; in a mirrored one the section runs in the opposite direction, without a fold."""
        points = rod.control_points @ self.turn.T + self.shift
        if np.linalg.det(self.turn) < 0.0:
            points = points[:, -np.arange(rod.section_points)]
        return replace(rod, control_points=points)


def copies(
    around: Letter | None = None,
    move: tuple[float, float, float] | None = None,
    mirror: Letter | None = None,
    count: int = 2,
) -> list[Motion]:
    """Return where several of one rod are: `[rod.wire]` with copies is the rods `wire-1` (as written), `wire-2` ...

    Parameters
    ----------
    around
        Axis through the origin about which they stand evenly, a whole turn: `"x"`, `"y"` or `"z"`.
    move
        From each to the next, units of length.
    mirror
        Normal of the plane through the origin in which the second is the mirror image of the first: `"x"`, `"y"` or
        `"z"`; laws are not mirrored.
    count
        How many rods there are in all.
    """
    if sum(one is not None for one in (around, move, mirror)) != 1:
        raise InputError("need one of around, move, mirror")
    whole_number("count", count, 2, 2 if mirror else _MOST)
    if move is not None:
        finite("move", move)
        if not any(move):
            raise InputError("move: got zeros: all would be in one place")
        return [Motion(np.eye(3), float(k) * np.array(move, dtype=float)) for k in range(count)]
    axis = np.eye(3)["xyz".index(around or mirror or "x")]
    if mirror:
        return [Motion(np.eye(3), np.zeros(3)), Motion(np.eye(3) - 2.0 * np.outer(axis, axis), np.zeros(3))]
    return [Motion(rotation(2.0 * np.pi * k / count * axis), np.zeros(3)) for k in range(count)]


def names(name: str, count: int) -> list[str]:
    """Return the names of so many copies."""
    return [f"{name}-{k + 1}" for k in range(count)]


class Placed(NamedTuple):
    """The rods of a file, by their names, copies and branches of trees among them.

    Attributes
    ----------
    places, tables
        The place of each in the file, and its table.
    motions
        Where copies are put.
    names
        The names of the copies, or branches, of a rod by its own.
    ties
        The tables of the ties between branches.
    """

    places: dict[str, Place]
    tables: dict[str, dict[str, Any]]
    motions: dict[str, Motion]
    names: dict[str, list[str]]
    ties: dict[str, dict[str, Any]]


def placed(rods: Iterator[tuple[str, Place, dict[str, Any]]]) -> Placed:
    """Return all rods of a file, of which names, places and tables are given."""
    result = Placed({}, {}, {}, {}, {})
    for name, place, table in rods:
        tables = {name: table}
        if "tree" in table:
            tables, ties = branches(table, place, name)
            result.ties.update(ties)
        elif "copy" in table:
            made = call(place / "copy", schema.COPIES, (place / "copy").table(table["copy"])).make()
            tables = {one: deepcopy(table) for one in names(name, len(made))}
            result.motions.update(zip(tables, made, strict=True))
        if [*tables] != [name]:
            result.names[name] = [*tables]
        for one in tables:
            if one in result.places:
                raise place.error(f"{one} is the name of a copy of another rod, or of a branch; choose another")
            result.places[one] = place
        result.tables.update(tables)
    return result


class Copies:
    """The names of all that there is in copies: of each kind, by the name that the file has for them.

    Parameters
    ----------
    rods
        The names of the copies of a rod, by its own.
    only
        The only rod of the file, if there is but one, which need not be named.
    """

    def __init__(self, rods: Mapping[str, Sequence[str]], only: str | None) -> None:
        self._known: dict[str, dict[str, Sequence[str]]] = {"rod": dict(rods)}
        self._only = only

    def of(self, kind: str, calls: Mapping[str, Call]) -> dict[str, Call]:
        """Return what a file has of a kind, such as supports, for each copy of what it names."""
        copied: dict[str, Call] = {}
        for name, one in calls.items():
            made = dict(zip(names(name, _MOST), self._each(one), strict=False)) or {name: one}
            if len(made) > 1:
                self._known.setdefault(kind, {})[name] = [*made]
            copied |= made
        return copied

    def _each(self, one: Call) -> Iterator[Call]:
        """Yield a call for each copy of what it names; nothing where it names none."""
        several: dict[str, list[Name]] = {}
        for parameter in one.form.parameters.values():
            if not (isinstance(parameter.kind, Kind) and parameter.kind.name):
                continue
            value, kind = one.arguments.get(parameter.name), parameter.kind.name
            if value is None and kind == "rod" and self._only:
                value = Name(one.place, self._only)
            if isinstance(value, Name):
                head, dot, rest = value.name.partition(".")
                same = self._known.get("rod" if kind == "surface" else kind, {}).get(head, ())
                several |= {parameter.name: [Name(value.place, f"{name}{dot}{rest}") for name in same]} if same else {}
        sides = [*several.values()]
        owners = {side[0].name.partition(".")[0] for side in sides}
        if len({len(side) for side in sides}) > 1 or len(owners) < len(sides):
            raise one.place.error(
                f"which copies are tied to which? name them, as in {sides[0][0].name!r}; of two rods with as many "
                "copies each the first is tied to the first"
            )
        for chosen in zip(*sides, strict=True):
            copied = copy(one)
            copied.arguments = one.arguments | dict(zip(several, chosen, strict=True))
            yield copied
