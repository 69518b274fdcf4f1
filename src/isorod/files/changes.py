"""Values that are put in the place of a file's own: ``support.hand.displacement.2=0.5``."""

import tomllib
from collections.abc import Sequence
from typing import Any

from isorod.errors import InputError
from isorod.files.document import Document, Place, shown


def put(document: Document, changes: Sequence[str]) -> None:
    """Change values of a document.

    Parameters
    ----------
    document
        Its content is changed.
    changes
        Each a path and a value of TOML (or a text without quotes): names of tables and keys with dots between, places
        in arrays by their numbers from 0.  The last key need not be there yet.

    Raises
    ------
    InputError
        If a change is none, or leads nowhere.
    """
    for one in changes:
        path, _, value = one.partition("=")
        keys = _keys(path) if value.strip() else []
        if not keys:
            raise InputError(
                f"--set {one:.80}: need a path in the file and a value, such as rod.NAME.law.NeoHookean.nu=0.3"
            )
        if keys[0] == "analysis" and (len(keys) < 3 or keys[1] not in _table(document.content["analysis"])):
            raise (document.top / "analysis").error(f"--set {one}: the type of analysis can be set in the file only")
        _put(document, keys, _value(value.strip()))


def _put(document: Document, keys: Sequence[str], value: Any) -> None:
    at: Any = document.content
    place = document.top
    for key in keys[:-1]:
        step = _step(place, at, key)
        place /= step
        if isinstance(at, dict) and step not in at:
            raise place.unknown_key(at)
        at = at[step]
    at[_step(place, at, keys[-1])] = value


def _step(place: Place, at: Any, key: str) -> str | int:
    """Return the key, or the place in an array, by which a path goes on from what is there."""
    if isinstance(at, list):
        if not key.isdecimal() or int(key) >= len(at):
            raise place.error(f"got place {key}, need one from 0 to {len(at) - 1}")
        return int(key)
    if not isinstance(at, dict):
        raise place.error(f"it is {shown(at)}, in which there is no {key}")
    return key


def _keys(path: str) -> list[str]:
    """Return the keys of a path, none if it is not one."""
    try:
        at: Any = tomllib.loads(f"{path} = 0")
    except ValueError:
        return []
    keys = []
    while isinstance(at, dict) and len(at) == 1:
        key, at = next(iter(at.items()))
        keys.append(key)
    return [] if at != 0 else keys


def _value(text: str) -> Any:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except ValueError:
        return text
    return parsed["value"] if len(parsed) == 1 else text


def _table(value: Any) -> Any:
    return value if isinstance(value, dict) else {}
