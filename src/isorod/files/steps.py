"""Steps of a file, one after the other: what loads and supports reach in each, turned into their histories."""

from collections.abc import Mapping, Sequence
from typing import Any

from isorod.files.document import Document, Place, shown

# What a step may name by its kind, and where the history of it stands.
_NAMED = {"load": "history", "support": "history", "temperature": "temperature_history"}

# What is called what it is.
_ALONE = ("gravity", "spin")

# Whose tables have names that steps call otherwise.
_TABLES = {"temperature": "rod"}

# The analyses that know histories.
_ANALYSES = ("statics", "modal", "dynamics")

# A table is no longer than that of a data file of this many rows.
_MOST = 100_000

# Kind and name of what has a history.
Key = tuple[str, str]


def put(document: Document) -> None:
    """Turn the steps of a document into histories, and the time they take into the end time of its analysis.

    What a step names goes straight to its value there, or through several in equal parts of its time; in a ``cycle``
    through them and back to where it began, so many times.  What it does not name stays.

    Raises
    ------
    InputError
        If a step is none, names what is not there or has a history, or the analysis has no time.
    """
    content, top = document.content, document.top
    if "step" not in content:
        return
    steps, place = content.pop("step"), top / "step"
    if not (isinstance(steps, list) and steps and all(isinstance(one, dict) for one in steps)):
        raise place.error(f"got {shown(steps)}, need steps, each a table: [[step]]")
    analysis = _analysis(top / "analysis", content.get("analysis"))
    tables: dict[Key, list[list[float]]] = {}
    for k, step in enumerate(steps):
        for key in _names(place / k, step):
            tables.setdefault(key, [[0.0, 0.0]])
    for kind, name in tables:
        _refuse_named(content, top, kind, name)
    end = 0.0
    for k, step in enumerate(steps):
        end = _take(place / k, step, tables, end)
    for (kind, name), rows in tables.items():
        held = content[kind] if kind in _ALONE else content[_TABLES.get(kind, kind)][name]
        held[_NAMED.get(kind, "history")] = rows
    analysis.setdefault("end_time", end)


def _analysis(place: Place, value: Any) -> dict[str, Any]:
    """Return the table of the analysis, whose end time is given."""
    content = place.document.content
    if isinstance(value, str):
        value = content["analysis"] = {value: {}}
    word = next(iter(value), "") if isinstance(value, dict) else ""
    if word not in _ANALYSES:
        raise place.error(f"steps are of {', '.join(_ANALYSES)}; leave out [[step]]")
    return (place / word).table(value[word])


def _names(place: Place, step: Mapping[str, Any]) -> list[Key]:
    """Return what a step names."""
    keys: list[Key] = []
    content, known = place.document.content, ("time", "hold", "unload", "cycle", *_NAMED, *_ALONE)
    for key, value in step.items():
        if key not in known:
            raise (place / key).unknown_key(known)
        if key in _ALONE:
            if key not in content:
                raise (place / key).error(f"the file has no [{key}]")
            keys.append((key, ""))
        elif key in _NAMED:
            there = content.get(_TABLES.get(key, key), {})
            for name in (place / key).table(value):
                if name not in there or not isinstance(there[name], dict):
                    raise (place / key / name).unknown_key(there)
                keys.append((key, name))
    return keys


def _refuse_named(content: Mapping[str, Any], top: Place, kind: str, name: str) -> None:
    table = content[kind] if kind in _ALONE else content[_TABLES.get(kind, kind)][name]
    place = top / kind if kind in _ALONE else top / _TABLES.get(kind, kind) / name
    if kind == "temperature" and "temperature" not in table:
        raise place.error("steps name its temperature, and it has none")
    if _NAMED.get(kind, "history") in place.table(table):
        raise (place / _NAMED.get(kind, "history")).error("steps has it too; leave one of the two out")


def _take(place: Place, step: Mapping[str, Any], tables: Mapping[Key, list[list[float]]], begin: float) -> float:
    """Add a step to the tables, and return when it ends."""
    time = step.get("time")
    if isinstance(time, bool) or not isinstance(time, int | float) or not 0.0 < time < float("inf"):
        raise (place / "time").error(
            f"got {shown(time)}, need how long the step takes" if "time" in step else "missing"
        )
    for word in ("hold", "unload"):
        if step.get(word, True) is not True:
            raise (place / word).error(f"got {shown(step[word])}, need true, or leave it out")
    cycles = step.get("cycle", 0)
    if isinstance(cycles, bool) or not isinstance(cycles, int) or ("cycle" in step and not 1 <= cycles <= _MOST):
        raise (place / "cycle").error(f"got {shown(cycles)}, need how often, from 1 to {_MOST:,}")
    named = _names(place, step)
    does = [word for word in ("hold", "unload") if word in step] + ["values"] * bool(named)
    if len(does) != 1:
        raise place.error(
            "it is empty; need values, hold = true, or unload = true"
            if not does
            else f"it has {' and '.join(does)}; need one of them"
        )
    if "cycle" in step and not named:
        raise (place / "cycle").error("need values to go to, and back")
    if "unload" in step:
        aims: dict[Key, Sequence[float]] = {key: [0.0] for key in tables}
    else:
        aims = {key: _values(place, step, key) for key in named}
    longest = max((len(one) for one in aims.values()), default=0) + 1
    if max(cycles, 1) * longest > _MOST:
        raise place.error(f"more than {_MOST:,} points")
    for key, rows in tables.items():
        start = rows[-1][1]
        values = list(aims.get(key, [start]))
        if cycles and key in aims:
            values = [*values, start] * cycles
        rows += [[begin + (j + 1) / len(values) * time, value] for j, value in enumerate(values)]
        rows[-1][0] = begin + time
    return begin + float(time)


def _values(place: Place, step: Mapping[str, Any], key: Key) -> list[float]:
    kind, name = key
    value = step[kind] if kind in _ALONE else step[kind][name]
    values = value if isinstance(value, list) and value else [value]
    for one in values:
        if isinstance(one, bool) or not isinstance(one, int | float) or not abs(one) < float("inf"):
            at = place / kind if kind in _ALONE else place / kind / name
            raise at.error(f"got {shown(value)}, need a factor, or several in a list")
    return [float(one) for one in values]
