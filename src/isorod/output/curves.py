"""Curves of runs - forces, energies, frequencies - from their files of comma-separated values."""

import csv
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.output.picture import quiet

# Share of the largest of a quantity below which a column is but rounding.
_ROUNDING = 1e-9

# Of what a column is, by its name, and in which unit; the first that fits.
_QUANTITIES = (
    (r"\(.*\)$", "", ""),
    (r"error", "relative error", ""),
    (r"residual", "relative residual", ""),
    (r"\bforce\b", "force", "unit of E × length²"),
    (r"\bmoment\b", "moment", "unit of E × length³"),
    (r"displacement", "displacement", "length"),
    (r"penetration", "penetration", "length"),
    (r"\barea\b", "area", "length²"),
    (r"kinetic|stored|energy|work|dissipated", "energy", "unit of E × length³"),
    (r"frequency", "frequency", "cycles per time"),
    (r"^time$", "time", "unit of time"),
)


def read(path: Path) -> dict[str, Array]:
    """Return the columns of a file by their names.

    Raises
    ------
    InputError
        If it cannot be read, or is no table of numbers below a line of names.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except (OSError, UnicodeDecodeError) as problem:
        raise InputError(f"{path}: cannot be read ({problem})") from None
    names = [word.strip() for word in next(csv.reader(lines[:1]), [])]
    rows = []
    for number, line in enumerate(lines[1:], 2):
        try:
            rows.append([float(word) for word in line.split(",")])
        except ValueError:
            raise InputError(f"{path}:{number}: got {line!r:.40}, need numbers with commas between") from None
        if len(rows[-1]) != len(names):
            raise InputError(f"{path}:{number}: {len(rows[-1])} numbers below {len(names)} names")
    if len(names) < 2 or not rows:
        raise InputError(f"{path}: need two columns or more, names in the first line and numbers below")
    return dict(zip(names, np.array(rows).T, strict=True))


class Panel(NamedTuple):
    """Curves of one quantity: what stands below and beside them, and the columns over and of each."""

    below: str
    beside: str
    curves: list[tuple[str, str]]


def panels(columns: dict[str, Array]) -> list[Panel]:
    """Return the curves in columns: forces of supports over their displacements, and all over the first column.

    Columns that stay zero, or what rounding makes of it, are left out.
    """
    first, *others = columns
    found: dict[tuple[str, str], list[tuple[str, str]]] = {}
    largest: dict[str, float] = {}
    for name in others:
        size = float(np.abs(columns[name]).max())
        largest[label(name)] = max(size, largest.get(label(name), 0.0))
    seen = [name for name in others if np.abs(columns[name]).max() > _ROUNDING * largest[label(name)]]
    for name in seen:
        force = name.replace("displacement", "force")
        if force != name and force in seen and np.ptp(columns[name]) > 0.0 and first != "time":
            found.setdefault((label(name), label(force)), []).append((name, force))
    over = {force for curves in found.values() for _, force in curves}
    moved = {name for curves in found.values() for name, _ in curves}
    for name in [one for one in seen if one not in over | moved] or ([] if found else others[:1]):
        found.setdefault((label(first), label(name)), []).append((first, name))
    return [Panel(*said, curves) for said, curves in found.items()]


def label(name: str) -> str:
    """Return what an axis of a column says: the quantity and its unit."""
    for pattern, quantity, unit in _QUANTITIES:
        if re.search(pattern, name):
            return f"{quantity} ({unit})" if unit else quantity or name
    return name


def draw(path: Path, title: str, size: tuple[int, int], png: Path | None) -> None:
    """Draw the columns of a file over the first one, a panel for each quantity, in a window or a PNG file.

    Raises
    ------
    InputError
        If the file cannot be used, matplotlib is not installed, or the picture cannot be written.
    """
    columns = read(path)
    quiet()
    try:
        import matplotlib
    except ImportError:
        raise InputError("curves need matplotlib, which is not installed: pip install matplotlib") from None
    if png is not None:
        matplotlib.use("agg")
    from matplotlib import pyplot

    from isorod.output.results import write_beside

    shown = panels(columns)
    across = 1 if len(shown) == 1 else 2
    figure, axes = pyplot.subplots(
        -(-len(shown) // across),
        across,
        figsize=(size[0] / 100, size[1] / 100),
        dpi=100,
        squeeze=False,
        layout="constrained",
    )
    try:
        figure.suptitle(title)
        for axis, panel in zip(axes.flat, shown, strict=False):
            separate = panel.curves[0][0] == "mode"
            for over, name in panel.curves:
                axis.plot(columns[over], columns[name], "o" if separate else ".-", label=name, linewidth=1.3)
            axis.set_xlabel(panel.below)
            axis.set_ylabel(panel.beside)
            axis.grid(alpha=0.3)
            if separate:
                axis.xaxis.get_major_locator().set_params(integer=True)
            if len(panel.curves) > 1 or panel.curves[0][1] not in panel.beside:
                axis.legend(fontsize="x-small", loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
        for axis in axes.flat[len(shown) :]:
            axis.set_axis_off()
        if png is None:
            pyplot.show()
        else:
            write_beside(png, lambda where: figure.savefig(where, format="png"))
    finally:
        pyplot.close(figure)
