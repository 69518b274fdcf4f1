"""The points of a sweep: every combination of the values that words of a command line have."""

import re
from collections.abc import Sequence
from fractions import Fraction
from itertools import product
from math import prod
from typing import NamedTuple

from isorod.errors import InputError

# Points of a sweep.
MOST = 100_000

_RANGE = re.compile(r"([^:]*):([^:]*):([^:]*)")


class Swept(NamedTuple):
    """What is varied: its name, as in a table, its values as they would be typed, and the words they stand in.

    ``words`` say where in the command line: the place of the word, and what of it comes before the value.
    """

    name: str
    values: tuple[str, ...]
    place: int
    before: str


class Grid(NamedTuple):
    """All words of a sweep, and what is varied, the last one fastest."""

    words: tuple[str, ...]
    swept: tuple[Swept, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """How many values each has that is varied."""
        return tuple(len(one.values) for one in self.swept)

    def indices(self) -> list[tuple[int, ...]]:
        """Return of each point which value of each it has."""
        return [*product(*map(range, self.shape))]

    def values(self, index: Sequence[int]) -> dict[str, str]:
        """Return the values of a point by name, as they would be typed."""
        return {one.name: one.values[k] for one, k in zip(self.swept, index, strict=True)}

    def at(self, index: Sequence[int]) -> list[str]:
        """Return the words of a point: those of the run that it is."""
        words = [*self.words]
        for one, k in zip(self.swept, index, strict=True):
            words[one.place] = one.before + one.values[k]
        return words


def read(words: Sequence[str], left: Sequence[str] = ()) -> Grid:
    """Find what is varied: each option whose value is ``a:b:n`` or ``a,b,c``.

    Parameters
    ----------
    words
        Behind the name of the command.
    left
        Options that are none of a run's, and keep their values whatever these are.

    Raises
    ------
    InputError
        If nothing is varied, or something twice, or a range is none.
    """
    swept: list[Swept] = []
    for place, word in enumerate(words):
        option, inside, value = word.partition("=")
        if option.startswith("--") and inside:
            before = option + inside
        elif place and words[place - 1].startswith("--") and "=" not in words[place - 1]:
            option, before, value = words[place - 1], "", word
        else:
            continue
        if option in left:
            continue
        name = option[2:].replace("-", "_")
        if option == "--set":
            # Its value is a path in the file and what is there.
            path, inside, value = value.partition("=")
            name, before = path.strip(), before + path + inside
        values = _values(name, value)
        if values is None:
            continue
        if any(one.name == name for one in swept):
            raise InputError(f"{name}: varied twice; name all its values at once, as a,b,c")
        swept.append(Swept(name, values, place, before))
    grid = Grid(tuple(words), tuple(swept))
    if not swept:
        raise InputError(
            "nothing is varied; give an option several values: --pull 0:10:21 (from, to, how many) or --nu 0.3,0.4"
        )
    points = prod(grid.shape)
    if points > MOST:
        raise InputError(f"{points:,} points; a sweep has at most {MOST:,}")
    return grid


def _values(name: str, value: str) -> tuple[str, ...] | None:
    """Return the values of a word, None if it has one alone."""
    found = _RANGE.fullmatch(value)
    if found:
        return _range(name, value, *found.groups())
    # Lists and tables of TOML have commas of their own.
    if "," not in value or re.match(r"\s*[\[{\"']", value):
        return None
    values = tuple(one.strip() for one in value.split(","))
    if "" in values:
        raise InputError(f"{name}: got {value}, in which a value is empty; need a,b,c")
    again = next((one for k, one in enumerate(values) if one in values[:k]), None)
    if again is not None:
        raise InputError(f"{name}: got {value}, which has {again} twice")
    return values


def _range(name: str, text: str, first: str, last: str, count: str) -> tuple[str, ...]:
    """Return evenly spaced numbers, both ends included, with the 15 digits that a float holds for certain."""
    try:
        low, high, number = Fraction(first), Fraction(last), int(count)
    except (ValueError, ZeroDivisionError):
        raise InputError(f"{name}: got {text}, need from:to:count, such as 0:10:21") from None
    if not 2 <= number <= MOST:
        raise InputError(f"{name}: got {text}, need a count from 2 to {MOST:,}")
    if low == high:
        raise InputError(f"{name}: got {text}, whose ends are the same")
    inner = (float(low + k * (high - low) / (number - 1)) for k in range(1, number - 1))
    return first.strip(), *(f"{one:.15g}" for one in inner), last.strip()
