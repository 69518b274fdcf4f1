"""The parameters of a scene: fields of a ready scene, numbers of a file by their key paths."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

from isorod.errors import InputError, alternatives
from isorod.files import changes, schema
from isorod.files.document import Document
from isorod.files.form import Form

# Tables of a file whose numbers define a model, with load factors of cases, and keys in them that are settings of its
# solution.
_TABLES = ("rod", "support", "load", "gravity", "spin", "obstacle", "contact", "loads")
_LEFT = ("space", "tolerance", "section_tolerance", "temperature_history", "history", "copy", "tree")

# The place of a supported patch selects the control points that are held: results are piecewise constant in it.
_PATCH = ("around", "along")


def parameters(scene: Any) -> dict[str, float]:
    """Return the numbers of a scene that may be varied, by name; none that is zero, as changes are relative.

    Numbers of a load case have their path in the file, ``case.high.load.push.force.1``.
    """
    if scene.content is None:
        fields = [field for field in scene.option_fields if field.type is float]
        numbers = {field.name: float(getattr(scene, field.name)) for field in fields}
    else:
        numbers = _numbers(scene.content)
    if scene.content is not None and scene.cases:
        document = Document(scene.path)
        changes.put(document, scene.changes)
        cases = {name: _numbers(document.content["case"][name]) for name in scene.cases}
        if scene.case:
            # A case multiplies loads by its factors, and leaves some out.
            whole = _numbers(replace(scene, case=None).content)
            numbers, cases = {name: whole[name] for name in numbers if name in whole}, {scene.case: cases[scene.case]}
        numbers = {name: value for name, value in numbers.items() if not any(name in table for table in cases.values())}
        numbers |= {f"case.{case}.{name}": value for case, table in cases.items() for name, value in table.items()}
    return {name: value for name, value in numbers.items() if value}


def _numbers(content: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers of a file, or of one of its load cases."""
    return {name: value for key in _TABLES if key in content for name, value in _leaves(content[key], (key,))}


def named(scene: Any, name: str) -> dict[str, float]:
    """Return the numbers that a name stands for, all of a list or table; raises `InputError` that lists those known."""
    known = parameters(scene)
    matches = {path: value for path, value in known.items() if path == name or path.startswith(f"{name}.")}
    if not matches:
        raise InputError(
            f"{name!r} is no parameter of the scene that can vary; there are: {', '.join(known) or 'none'}"
        )
    return matches


def at(scene: Any, values: Mapping[str, float]) -> Any:
    """Return a scene with other values of parameters."""
    if scene.content is None:
        return replace(scene, **values)
    changes = [f"{name}={float(value)!r}" for name, value in values.items()]
    return replace(scene, changes=[*scene.changes, *changes])


def _leaves(table: Any, path: Sequence[str]) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a table or list, but for counts, by their paths."""
    if isinstance(table, dict):
        entries: Any = table.items()
    elif isinstance(table, list):
        entries = ((str(k), value) for k, value in enumerate(table))
    else:
        entries = ()
        if isinstance(table, int | float) and not isinstance(table, bool) and abs(table) < float("inf"):
            yield ".".join(path), float(table)
    for key, value in entries:
        if key not in _LEFT and key not in _counts() and not (path[0] == "support" and key in _PATCH):
            yield from _leaves(value, (*path, key))


@cache
def _counts() -> frozenset[str]:
    """Return the keys whose numbers are integers."""
    groups = (schema.CURVES, schema.SECTIONS, schema.LAWS, schema.PIECES, schema.SUPPORTS, schema.LOADS)
    forms: list[Form] = [*(form for group in groups for form in group.values()), schema.SWEEP, schema.BODY]
    forms += [schema.CONTACTS, schema.GRAVITY, schema.SPIN]
    integers = set[str]()
    for form in forms:
        for key, parameter in form.parameters.items():
            integers |= {key} if _is_whole(parameter.kind) else set()
    return frozenset(integers)


def _is_whole(kind: Any) -> bool:
    return not isinstance(kind, dict | tuple) and {*alternatives(kind)} <= {int, type(None)}
