"""A scene file with other numbers: its text, comments and all, with these in the place of its own."""

import tomllib
from collections.abc import Mapping
from typing import Any

from isorod.errors import InputError
from isorod.files import lines


def rewritten(text: str, values: Mapping[str, float]) -> str:
    """Return the text of a scene file with other numbers.

    Parameters
    ----------
    text
        What is in the file.
    values
        Numbers by their paths, names and places in lists with dots between.

    Raises
    ------
    InputError
        If one does not stand in the text.
    """
    places = lines.places(text)
    by_name = {".".join(map(str, path)): place for path, place in places.items()}
    target = tomllib.loads(text)
    replacements = []
    for name, value in values.items():
        if name not in by_name:
            raise InputError(f"{name}: its number does not stand in the file; write it there, not with --set")
        replacements.append((by_name[name], f"{value:.9g}"))
        _put(target, name.split("."), float(f"{value:.9g}"))
    for (start, end), word in sorted(replacements, reverse=True):
        text = text[:start] + word + text[end:]
    if tomllib.loads(text) != target:
        raise InputError("the file cannot be written anew; take the numbers with --set")
    return text


def _put(table: Any, keys: list[str], value: float) -> None:
    *parents, last = keys
    for key in parents:
        table = table[int(key)] if isinstance(table, list) else table[key]
    table[int(last) if isinstance(table, list) else last] = value
