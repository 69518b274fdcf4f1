"""Curves of runs - forces, energies, frequencies - from their files of comma-separated values."""

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.output import campbell
from isorod.output.picture import quiet
from isorod.output.results import check_folder, write_beside

# Fraction of the largest value of a quantity below which a column is round-off.
_ROUNDING = 1e-9

# Relative errors of balances below this are not plotted.
_BALANCED = 1e-6

# In tables of sweeps: the lines that name what varies, and that it is the speed of a spin; columns that are no results.
_VARIED, SPEED, _NO_RESULTS = "# varied: ", "over the speed of a spin", ("error_estimate", "unknowns", "status")

# Quantity and unit of a column, by the first pattern that fits its name.
_QUANTITIES = (
    (r"\(.*\)$", "", ""),
    (r" phase$", "phase", "degrees"),
    (r"error", "relative error", ""),
    (r"residual", "relative residual", ""),
    (r"\bforce\b", "force", "unit of E × length²"),
    (r"\bmoment\b", "moment", "unit of E × length³"),
    (r"displacement", "displacement", "length"),
    (r"penetration", "penetration", "length"),
    (r"\barea\b", "area", "length²"),
    (r"kinetic|stored|energy|work|dissipated", "energy", "unit of E × length³"),
    (r"frequenc|^order \d+$", "frequency", "cycles per time"),
    (r"^time$", "time", "unit of time"),
)

# Transfer functions: their columns, their abscissa, and the range from which its axis is logarithmic.
_SWINGS, _OVER, _WIDE = r" (amplitude|density)( \(.*\))?$", "frequency", 100.0

# Targets and measurements, plotted as points beside the computed curves.
_AIMS = (", wanted", ", measured")

# Names in files (`isorod.output.reading.Result.units`) of the units of some quantities.
_NAMED = {"displacement": "length", "penetration": "length"}


def read(path: Path) -> dict[str, Array]:
    """Return the columns of a file by their names (`columns`); raises `InputError` also if it cannot be read."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except (OSError, UnicodeDecodeError) as problem:
        raise InputError(f"{path}: cannot be read ({problem})") from None
    return columns(lines, str(path))


def columns(lines: Sequence[str], where: str) -> dict[str, Array]:
    """Return the columns of a table by their names; of a sweep its first parameter, and results over that.

    Parameters
    ----------
    lines
        Lines of the table: names, then numbers.  A line ``# varied: a, b`` before them marks a sweep, which gives a
        column for each result and each combination of values of the other parameters.
    where
        The table's name, for errors.

    Raises
    ------
    InputError
        If it is not a table of numbers below a line of names.
    """
    notes = [line for line in lines if line.startswith("#")]
    names, *rows = [*csv.reader(lines[len(notes) :])] or [[]]
    names = [name.strip() for name in names]
    varied = next((line.removeprefix(_VARIED) for line in notes if line.startswith(_VARIED)), None)
    if len(names) < 2 or not rows:
        raise InputError(f"{where}: need two columns or more, names in the first line and numbers below")
    table = []
    for number, row in enumerate(rows, len(notes) + 2):
        if len(row) != len(names):
            raise InputError(f"{where}:{number}: {len(row)} numbers below {len(names)} names")
        try:
            table.append(row if varied is not None else [float(word) for word in row])
        except ValueError:
            raise InputError(f"{where}:{number}: got {','.join(row)!r:.40}, need numbers with commas between") from None
    if varied is None:
        return dict(zip(names, np.array(table).T, strict=True))
    try:
        results = _results([dict(zip(names, row, strict=True)) for row in rows], next(csv.reader([varied])))
        return campbell.with_orders(results) if f"# {SPEED}" in notes else results
    except (ValueError, KeyError, StopIteration):
        raise InputError(f"{where}: is no table of a sweep, though it names what is varied") from None


def _results(rows: Sequence[dict[str, str]], varied: Sequence[str]) -> dict[str, Array]:
    """Return the first parameter of a sweep, and results over it, NaN where a point has none."""
    first, *others = varied
    values = list(dict.fromkeys(row[first] for row in rows))
    try:
        result = {first: np.array(values, dtype=float)}
    except ValueError:
        result = {first: np.array(values)}
    for row in rows:
        settings = [f"{name} {row[name]}" for name in others]
        for name in (key for key in row if key not in {*varied, *_NO_RESULTS}):
            column = result.setdefault(", ".join([name, *settings]), np.full(len(values), np.nan))
            column[values.index(row[first])] = float(row[name] or "nan")
    return result


class Panel(NamedTuple):
    """Curves of one quantity: labels of both axes, and the columns of abscissa and ordinate of each curve."""

    below: str
    beside: str
    curves: list[tuple[str, str]]


def panels(columns: dict[str, Array], units: Mapping[str, str]) -> list[Panel]:
    """Return the panels of columns: forces of supports over their displacements, the rest over the first column.

    Columns that stay zero, or at round-off, are left out.  Axes have ``units``, of quantities such as ``"force"`` or of
    columns, where these are given.
    """

    def label(name: str) -> str:
        quantity = (text := axis_label(name)).partition(" (")[0]
        unit = units.get(_NAMED.get(quantity, quantity))
        return f"{quantity} ({unit})" if unit else text

    first, *others = columns
    groups: dict[tuple[str, str], list[tuple[str, str]]] = {}
    largest: dict[str, float] = {}
    sizes = {name: float(np.nan_to_num(np.abs(columns[name])).max()) for name in others}
    for name, size in sizes.items():
        largest[label(name)] = max(size, largest.get(label(name), 0.0))
    plotted = [name for name, size in sizes.items() if size > _ROUNDING * largest[label(name)]]
    plotted = [name for name in plotted if not name.endswith(" error") or sizes[name] > _BALANCED]
    for name in plotted:
        force = name.replace("displacement", "force")
        # Force-displacement loops suit statics over time, not motions, which have energies.
        if force != name and force in plotted and np.ptp(columns[name]) > 0.0 and "kinetic" not in columns:
            groups.setdefault((label(name), label(force)), []).append((name, force))
    ordinates = {force for curves in groups.values() for _, force in curves}
    abscissas = {name for curves in groups.values() for name, _ in curves}
    for name in [one for one in plotted if one not in ordinates | abscissas] or ([] if groups else others[:1]):
        groups.setdefault((label(first), label(name)), []).append((first, name))
    return [Panel(*labels, curves) for labels, curves in groups.items()]


def axis_label(name: str) -> str:
    """Return the label of a column's axis: quantity and unit."""
    for pattern, quantity, unit in _QUANTITIES:
        if re.search(pattern, name):
            return f"{quantity} ({unit})" if unit else quantity or re.sub(r"\[\w+\]", "", name)
    # Names of sweeps have indices in brackets, and values of other parameters.
    return re.split(r"\[|, ", name)[0]


def check(path: Path | None) -> None:
    """Raise `InputError` if matplotlib is not installed, or writes no files of that name."""
    quiet()
    try:
        import matplotlib
    except ImportError:
        raise InputError("curves need matplotlib, which is not installed: pip install matplotlib") from None
    if path is None:
        return
    matplotlib.use("agg")
    from matplotlib.figure import Figure

    kinds = Figure().canvas.get_supported_filetypes()
    if path.suffix[1:].lower() not in kinds:
        raise InputError(f"{path}: need a name that ends in .png, or in one of {', '.join(sorted(kinds))}")
    check_folder(str(path.parent))


def draw(
    columns: dict[str, Array], title: str, size: tuple[int, int], path: Path | None, units: Mapping[str, str]
) -> None:
    """Draw columns over the first one, a panel for each quantity, in a window or a file of the type of its suffix.

    The ``units`` are as for `panels`.

    Raises
    ------
    InputError
        If matplotlib is not installed, or the picture cannot be written.
    """
    check(path)
    from matplotlib import pyplot

    shown = panels(columns, units)
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
            swings = re.search(_SWINGS, panel.curves[0][1]) is not None
            lines = [name for _, name in panel.curves if name.startswith(campbell.LINE)]
            drawn = [curve for curve in panel.curves if curve[1] not in lines]
            for over, name in drawn:
                style = "o" if separate or name.endswith(_AIMS) else "-" if over == _OVER else ".-"
                axis.plot(columns[over], columns[name], style, label=name, linewidth=1.3, markerfacecolor=_face(style))
            axis.set_xlabel(panel.below)
            axis.set_ylabel(panel.beside)
            axis.grid(alpha=0.3)
            if swings:
                axis.set_yscale("log")
            if panel.curves[0][0] == _OVER and _WIDE * columns[_OVER][0] < columns[_OVER][-1]:
                axis.set_xscale("log")
            if separate:
                axis.xaxis.get_major_locator().set_params(integer=True)
            if lines:
                _draw_orders(axis, columns, lines)
            if len(drawn) > 1 or drawn[0][1] not in panel.beside:
                # Above the curves, so that it hides none.
                place = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": 4 // across}
                axis.legend(fontsize="small", frameon=False, borderaxespad=0.2, **place)
        for axis in axes.flat[len(shown) :]:
            axis.set_axis_off()
        if path is None:
            pyplot.show()
        else:
            write_beside(path, lambda where: figure.savefig(where, format=path.suffix[1:].lower()))
    finally:
        pyplot.close(figure)


def _face(style: str) -> str | None:
    """Return the fill colour of markers: none for points, so that curves are visible through them."""
    return "none" if style == "o" else None


def _draw_orders(axis: Any, columns: dict[str, Array], lines: Sequence[str]) -> None:
    """Draw lines of engine order across frequencies, and mark their crossings."""
    speed = next(iter(columns.values()))
    last = int(np.argmax(np.abs(speed)))
    top = axis.get_ylim()[1]
    for name in lines:
        axis.plot(speed, columns[name], "--", color="0.55", linewidth=0.9)
        # Labelled at its end, or where it leaves the picture.
        scale = min(1.0, top / columns[name][last])
        axis.annotate(
            name.removeprefix(campbell.LINE) + "x",
            (scale * speed[last], scale * columns[name][last]),
            fontsize="small",
        )
    axis.set_ylim(0.0, top)
    for crossing in campbell.crossings(columns):
        axis.plot([crossing.speed], [crossing.frequency], "o", color="black", markerfacecolor="none")
