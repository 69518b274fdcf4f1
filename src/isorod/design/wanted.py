"""What a design is to be: words of the command line, held to a scene."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from isorod.design import parameters
from isorod.errors import InputError

# Bounds of what varies where none are given, as shares of the value.
_LOWER, _UPPER = 0.5, 2.0

_RELATION = re.compile(r"\s*(.+?)\s*(<=|>=|=|<|>)\s*(\S+)\s*")


class Vary(NamedTuple):
    """A number that varies: its name, where it begins, and its bounds."""

    name: str
    start: float
    lower: float
    upper: float


class Wanted(NamedTuple):
    """A number that is to have, or not to pass, a value: its name, ``=``, ``<`` or ``>``, and the value."""

    name: str
    relation: str
    value: float

    def __str__(self) -> str:
        return f"{self.name} {self.relation} {self.value:g}"


def varied(texts: Sequence[str], scene: Any) -> list[Vary]:
    """Return what varies: ``NAME=lower:upper`` or ``NAME``, of a list or a table all its numbers.

    Raises
    ------
    InputError
        If the scene has no such number, or its value is not between the bounds.
    """
    found = dict[str, Vary]()
    for text in _words(texts):
        name, given, bounds = (part.strip() for part in text.partition("="))
        for one, start in parameters.named(scene, name).items():
            lower, upper = sorted((_LOWER * start, _UPPER * start))
            if given:
                ends = bounds.split(":")
                if len(ends) != 2:
                    raise InputError(f"--vary {text}: need bounds lower:upper, such as {name}=0.6:1.2")
                lower, upper = (_number(f"--vary {text}", end) for end in ends)
            if not lower < upper:
                raise InputError(f"--vary {text}: need a lower bound below the upper one")
            if not lower <= start <= upper:
                raise InputError(
                    f"--vary {text}: it begins at {start:g}, need bounds about that (--set begins elsewhere)"
                )
            if lower * upper <= 0.0:
                raise InputError(f"--vary {text}: bounds on both sides of zero; need both above or below it")
            found[one] = Vary(one, start, lower, upper)
    if not found:
        raise InputError("--vary: name what may change: --vary wire_radius=0.6:1.2")
    return [*found.values()]


class Known(NamedTuple):
    """What is measured, by name, and the points of a curve, in each of which what has no name of a point is meant."""

    values: Mapping[str, float]
    points: Sequence[str]

    def named(self, option: str, name: str) -> list[str]:
        """Return the names that a name stands for; raises `InputError` with those there are."""
        each = [f"{point}.{name}" for point in self.points]
        found = [one for one in ([name] if name in self.values else each) if one in self.values]
        if found:
            return found
        if name == "mass":
            raise InputError(f"{option} mass: no rod has a density; give one, or take the volume")
        there = dict.fromkeys(one.partition(".")[2] or one for one in self.values) if self.points else self.values
        raise InputError(f"{option} {name}: not measured; there are: {', '.join(there)}")


def wanted(texts: Sequence[str], option: str, relations: str, known: Known) -> list[Wanted]:
    """Return targets or limits of measured numbers; raises `InputError`."""
    found = []
    for text in _words(texts):
        match = _RELATION.fullmatch(text)
        if match is None or match[2][0] not in relations:
            example = "force=8.0" if "=" in relations else "stress<900"
            raise InputError(f"{option} {text}: need a name, {' or '.join(relations)} and a number, such as {example}")
        value = _number(f"{option} {text}", match[3])
        found += [Wanted(name, match[2][0], value) for name in known.named(option, match[1])]
    return found


def _words(texts: Sequence[str]) -> list[str]:
    return [one.strip() for text in texts for one in text.split(",") if one.strip()]


def _number(where: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{where}: got {text!r}, need a number") from None
    if not abs(value) < float("inf"):
        raise InputError(f"{where}: got {text}, need a finite number")
    return value
