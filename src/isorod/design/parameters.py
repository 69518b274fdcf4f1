"""The numbers of a scene that may be varied: fields of a ready scene, values of a file by their paths."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

from isorod.errors import InputError, alternatives
from isorod.files import schema
from isorod.files.document import Document
from isorod.files.form import Form

# Tables of a file whose numbers are a model's, and keys in them that say how it is solved.
_TABLES = ("rod", "support", "load", "gravity", "spin", "obstacle", "contact")
_LEFT = ("space", "tolerance", "section_tolerance", "temperature_history", "history", "copy", "tree")

# Where a supported patch is says which control points are held: answers do not change with it, and then jump.
_PATCH = ("around", "along")


def parameters(scene: Any) -> dict[str, float]:
    """Return the numbers of a scene that may be varied by a share of them, by name; none that is zero."""
    if scene.content is None:
        fields = [field for field in scene.option_fields if field.type is float]
        found = {field.name: float(getattr(scene, field.name)) for field in fields}
    else:
        found = {}
        for table in _TABLES:
            if table in scene.content:
                found |= dict(_leaves(scene.content[table], (table,)))
        # What a case says is typed before it is read (`isorod.files.cases`).
        said = Document(scene.path).content.get("case", {}) if scene.cases else {}
        found |= dict(_leaves(said, ("case",)))
    return {name: value for name, value in found.items() if value}


def value(scene: Any, name: str) -> float:
    """Return a number of a scene by its name, also one that is zero; raises `InputError` with the names there are."""
    known = parameters(scene)
    if name in known:
        return known[name]
    raise InputError(f"{name!r} is no number of the scene that can vary; there are: {', '.join(known) or 'none'}")


def at(scene: Any, values: Mapping[str, float]) -> Any:
    """Return a scene with other numbers."""
    if scene.content is None:
        return replace(scene, **values)
    changes = [f"{name}={float(one)!r}" for name, one in values.items()]
    return replace(scene, changes=[*scene.changes, *changes])


def _leaves(table: Any, path: Sequence[str]) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a table or a list that are no counts, by their paths."""
    if isinstance(table, dict):
        several: Any = table.items()
    elif isinstance(table, list):
        several = ((str(k), one) for k, one in enumerate(table))
    else:
        several = ()
        if isinstance(table, int | float) and not isinstance(table, bool) and abs(table) < float("inf"):
            yield ".".join(path), float(table)
    for key, one in several:
        if key not in _LEFT and key not in _counts() and not (path[0] == "support" and key in _PATCH):
            yield from _leaves(one, (*path, key))


@cache
def _counts() -> frozenset[str]:
    """Return the keys whose numbers are whole."""
    groups = (schema.CURVES, schema.SECTIONS, schema.LAWS, schema.PIECES, schema.SUPPORTS, schema.LOADS)
    forms: list[Form] = [*(form for group in groups for form in group.values()), schema.SWEEP, schema.BODY]
    forms += [schema.CONTACTS, schema.GRAVITY, schema.SPIN]
    whole = set[str]()
    for form in forms:
        for key, one in form.parameters.items():
            whole |= {key} if _is_whole(one.kind) else set()
    return frozenset(whole)


def _is_whole(kind: Any) -> bool:
    return not isinstance(kind, dict | tuple) and {*alternatives(kind)} <= {int, type(None)}
