"""Design variables, targets and limits: options of the command line, checked against a scene."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from isorod.design import parameters
from isorod.errors import InputError

# Default bounds of a variable, relative to its value.
_LOWER, _UPPER = 0.5, 2.0

_RELATION = re.compile(r"\s*(.+?)\s*(<=|>=|=|<|>)\s*(\S+)\s*")


class Variable(NamedTuple):
    """A design variable: its name, its initial value and its bounds."""

    name: str
    start: float
    lower: float
    upper: float


class Constraint(NamedTuple):
    """A target or limit: the result's name, the relation ``=``, ``<`` or ``>``, and the value."""

    name: str
    relation: str
    value: float

    def __str__(self) -> str:
        return f"{self.name} {self.relation} {self.value:g}"


def varied(texts: Sequence[str], scene: Any) -> list[Variable]:
    """Return the variables of ``NAME=lower:upper`` or ``NAME``, all numbers of a list or table.

    Raises
    ------
    InputError
        If the scene has no such number, or its value is not between the bounds.
    """
    variables = dict[str, Variable]()
    for text in _words(texts):
        name, given, bounds = (part.strip() for part in text.partition("="))
        for path, start in parameters.named(scene, name).items():
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
            variables[path] = Variable(path, start, lower, upper)
    if not variables:
        raise InputError("--vary: name what may change: --vary wire_radius=0.6:1.2")
    return [*variables.values()]


class Known(NamedTuple):
    """Results by name, and the points of a curve; a name without a point stands for the result at all points."""

    values: Mapping[str, float]
    points: Sequence[str]

    def named(self, option: str, name: str) -> list[str]:
        """Return the results that a name stands for; raises `InputError` that lists those known."""
        each = [f"{point}.{name}" for point in self.points]
        matches = [one for one in ([name] if name in self.values else each) if one in self.values]
        if matches:
            return matches
        if name == "mass":
            raise InputError(f"{option} mass: no rod has a density; give one, or take the volume")
        names = dict.fromkeys(one.partition(".")[2] or one for one in self.values) if self.points else self.values
        raise InputError(f"{option} {name}: not measured; there are: {', '.join(names)}")


def constraints(texts: Sequence[str], option: str, relations: str, known: Known) -> list[Constraint]:
    """Return targets or limits of results; raises `InputError`."""
    required = []
    for text in _words(texts):
        match = _RELATION.fullmatch(text)
        if match is None or match[2][0] not in relations:
            example = "force=8.0" if "=" in relations else "stress<900"
            raise InputError(f"{option} {text}: need a name, {' or '.join(relations)} and a number, such as {example}")
        value = _number(f"{option} {text}", match[3])
        required += [Constraint(name, match[2][0], value) for name in known.named(option, match[1])]
    return required


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
