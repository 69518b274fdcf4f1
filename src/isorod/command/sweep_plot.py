"""The plot of a sweep: an answer against what is varied first, a line for each combination of the others."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from isorod.command import sheet
from isorod.errors import InputError
from isorod.output import results
from isorod.output.picture import quiet

# Combinations that a legend can tell apart, and entries of a list of which each is a line.
_LINES, _ENTRIES = 12, 12

Record = Mapping[str, Any]


def ready(path: str, of: str | None, scene: Any) -> Callable[[Sequence[Record]], None]:
    """Return what draws the plot of records into a file.

    Parameters
    ----------
    path
        The file; its ending says what kind it is.
    of
        Which answer, ``frequencies`` or one of a list, ``frequencies[2]``; None: the first of the scene's.
    scene
        The scene, or its class.

    Raises
    ------
    InputError
        If there is no such answer, or matplotlib is not there or does not write such files.
    """
    quiet()
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise InputError("--png: matplotlib is not installed: pip install matplotlib") from None
    kinds = Figure().canvas.get_supported_filetypes()
    if Path(path).suffix[1:].lower() not in kinds:
        raise InputError(f"--png {path}: need a name that ends in .png, or in one of {', '.join(sorted(kinds))}")
    results.check_folder(str(Path(path).parent))
    asked = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", of or next(iter(scene.units)))
    if asked is None or asked[1] not in scene.units:
        raise InputError(
            f"--of {of}: need one of {', '.join(scene.units)}, or of a list one number, as {next(iter(scene.units))}[0]"
        )
    name, entry = asked[1], None if asked[2] is None else int(asked[2])
    told = {field.name: field.metadata.get("help", "") for field in fields(scene)}

    def draw(records: Sequence[Record]) -> None:
        figure = _figure(records, name, entry, scene.units[name], told)
        results.make_folder(str(Path(path).parent))
        results.write_beside(Path(path), lambda beside: figure.savefig(beside, dpi=150))

    return draw


def _figure(records: Sequence[Record], name: str, entry: int | None, unit: str, told: Mapping[str, str]) -> Any:
    """Return the figure of an answer; points that could not be solved are not in it."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    first = next(iter(records[0]["sweep"]["values"]))
    typed = list(dict.fromkeys(one["sweep"]["values"][first] for one in records))
    places = dict(zip(typed, _places(typed), strict=True))
    lines: dict[str, list[tuple[float, list[float]]]] = {}
    for one in records:
        others = [f"{key.replace('_', ' ')} {value}" for key, value in one["sweep"]["values"].items() if key != first]
        line = lines.setdefault(", ".join(others), [])
        if name in one:
            values = sheet.answers(one)[name]
            line.append((places[one["sweep"]["values"][first]], values if entry is None else values[entry : entry + 1]))
    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    axes = figure.add_subplot()
    for k, (label, line) in enumerate(lines.items()):
        color = colormaps["viridis"](0.9 * k / (len(lines) - 1)) if len(lines) > 1 else "C0"
        for j in range(min(_ENTRIES, max((len(values) for _, values in line), default=0))):
            here = sorted((x, values[j]) for x, values in line if j < len(values))
            axes.plot(*zip(*here, strict=True), ".-", color=color, linewidth=1.2, label=None if j else label)
    if not _are_numbers(typed):
        axes.set_xticks(list(places.values()), typed)
    what = told.get(first, "")
    axes.set_xlabel(f"{first.replace('_', ' ')}" + (f": {what}" if what else ""))
    axes.set_ylabel(f"{name.replace('_', ' ')}{'' if entry is None else f'[{entry}]'} {unit}".strip())
    axes.grid(alpha=0.3)
    if 1 < len(lines) <= _LINES:
        axes.legend(frameon=False)
    return figure


def _are_numbers(typed: Sequence[str]) -> bool:
    try:
        return all(math.isfinite(float(one)) for one in typed)
    except ValueError:
        return False


def _places(typed: Sequence[str]) -> list[float]:
    """Return where values stand along an axis: numbers at themselves, words one after the other."""
    return [float(one) for one in typed] if _are_numbers(typed) else [float(k) for k in range(len(typed))]
