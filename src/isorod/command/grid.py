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


class Point(NamedTuple):
    """A point of a sweep: the words of the run that it is, and the values of what is varied by name, as typed."""

    words: list[str]
    values: dict[str, str]


def read(words: Sequence[str], left: Sequence[str] = ()) -> list[Point]:
    """Return all combinations, the last option varied fastest, of options whose value is ``a:b:n`` or ``a,b,c``.

    Parameters
    ----------
    words
        Behind the name of the command.
    left
        Options that are not a run's: their values are not split.

    Raises
    ------
    InputError
        If nothing is varied, or something twice, or a range is none.
    """
    # Of each word what it may be: the name and the value of what is varied, and the word itself.
    choices: list[list[tuple[str, str, str]]] = []
    for place, word in enumerate(words):
        choices.append([("", "", word)])
        option, inside, value = word.partition("=")
        before = option + inside
        if place and words[place - 1].startswith("--") and "=" not in words[place - 1] and word[:2] != "--":
            option, before, value = words[place - 1], "", word
        elif not option.startswith("--") or not inside:
            continue
        name = option[2:].replace("-", "_")
        if option == "--set":
            # Its value is a path in the file and what is there.
            path, inside, value = value.partition("=")
            name, before = path.strip(), before + path + inside
        values = None if option in left else _values(name, value)
        if values is None:
            continue
        if any(each[0][0] == name for each in choices):
            raise InputError(f"{name}: varied twice; name all its values at once, as a,b,c")
        choices[-1] = [(name, one, before + one) for one in values]
    points = prod(map(len, choices))
    if points == 1:
        raise InputError(
            "nothing is varied; give an option several values: --travel 0:10:21 (from, to, how many) or --nu 0.3,0.4"
        )
    if points > MOST:
        raise InputError(f"{points:,} points; a sweep has at most {MOST:,}")
    return [
        Point([word for _, _, word in chosen], {name: value for name, value, _ in chosen if name})
        for chosen in product(*choices)
    ]


def _values(name: str, value: str) -> tuple[str, ...] | None:
    """Return the values of a word, None if it has a single one."""
    match = _RANGE.fullmatch(value)
    if match:
        return _range(name, value, *match.groups())
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
    return first.strip(), *(f"{value:.15g}" for value in inner), last.strip()
