"""The numbers of a scene that may be varied: fields of a ready scene, values of a file by their paths."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

from isorod.errors import InputError, alternatives
from isorod.files import changes, schema
from isorod.files.document import Document
from isorod.files.form import Form

# Tables of a file whose numbers are a model's, with factors of loads in cases, and keys in them that say how it is
# solved.
_TABLES = ("rod", "support", "load", "gravity", "spin", "obstacle", "contact", "loads")
_LEFT = ("space", "tolerance", "section_tolerance", "temperature_history", "history", "copy", "tree")

# Where a supported patch is says which control points are held: answers do not change with it, and then jump.
_PATCH = ("around", "along")


def parameters(scene: Any) -> dict[str, float]:
    """Return the numbers of a scene that may be varied by a share of them, by name; none that is zero.

    What load cases say themselves has the name that it has in the file, ``case.high.load.push.force.1``.
    """
    if scene.content is None:
        fields = [field for field in scene.option_fields if field.type is float]
        found = {field.name: float(getattr(scene, field.name)) for field in fields}
    else:
        found = _numbers(scene.content)
    if scene.content is not None and scene.cases:
        document = Document(scene.path)
        changes.put(document, scene.changes)
        cases = {name: _numbers(document.content["case"][name]) for name in scene.cases}
        if scene.case:
            # A case multiplies loads by its factors, and leaves some out.
            whole = _numbers(replace(scene, case=None).content)
            found, cases = {name: whole[name] for name in found if name in whole}, {scene.case: cases[scene.case]}
        found = {name: value for name, value in found.items() if not any(name in one for one in cases.values())}
        found |= {f"case.{case}.{name}": value for case, one in cases.items() for name, value in one.items()}
    return {name: value for name, value in found.items() if value}


def _numbers(content: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers of a file, or of what one of its cases says."""
    return {name: value for key in _TABLES if key in content for name, value in _leaves(content[key], (key,))}


def named(scene: Any, name: str) -> dict[str, float]:
    """Return the numbers that a name stands for, of a list or a table all; raises `InputError` with those there are."""
    known = parameters(scene)
    found = {one: value for one, value in known.items() if one == name or one.startswith(f"{name}.")}
    if not found:
        raise InputError(f"{name!r} is no number of the scene that can vary; there are: {', '.join(known) or 'none'}")
    return found


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
