"""Plots made from result records alone."""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

from comparisons.measure.records import Record, part, version
from comparisons.measure.variants import DEFAULT
from comparisons.report.precision import named, pairs, targets, versions
from isorod.output.results import write_beside

# Okabe and Ito's colours, which colour-blind readers distinguish too: cold ones ours, warm ones and black theirs.
COLOURS = ("#0072B2", "#009E73", "#56B4E9")
FEM_COLOURS = ("#D55E00", "#E69F00", "#CC79A7", "#000000")
MARKERS = "oD^"
FEM_MARKERS = "svPX"
# What is compared with itself is a rounding error off.
SHOWN = 1e-9
FIELDS = {"displacement": "displacement field", "shape": "mode shapes"}


def pyplot() -> Any:
    """Return Matplotlib's pyplot, which draws without a display."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as module

    return module


def save(figure: Any, path: Path, dpi: int) -> None:
    """Write a figure to a file, and forget it."""
    write_beside(path, partial(figure.savefig, dpi=dpi))
    pyplot().close(figure)


def curves(records: list[Record], ours: Sequence[str], theirs: Sequence[str]) -> list[Record]:
    """Return the runs of the most important curves, as many as there are colours.

    Those that are fastest within an error, the smallest and the largest first, and the named ones, of dolfinx in the
    version that is fastest within the smallest.
    """
    best = pairs(records)[::-1]
    of = ("", version(best[0][2])) if best else ("", *versions(records)[:1])
    work = part(records, "work")
    kept: list[str] = []
    for method, colours, more in (("cylindrical", COLOURS, ours), ("fem", FEM_COLOURS, theirs)):
        winners = dict.fromkeys(named(one) for _, *both in best for one in both if one["method"] == method)
        others = [
            named(one)
            for curve in more
            for one in work
            if (one["method"], one["curve"]) == (method, curve) and version(one) in of
        ]
        # Room for one of the named ones at least; of the winners those at the ends are drawn.
        room, first = len(colours) - 1, list(winners)
        if len(first) > room:
            first = [*first[: room - 1], first[-1]]
        kept += list(dict.fromkeys([*first, *others]))[: len(colours)]
    return [one for name in kept for one in work if named(one) == name]


def looks(curves: Sequence[Record]) -> dict[str, dict[str, str]]:
    """Return colour, marker and line of each curve of the story by its name: no two have colour or marker in common."""
    looks: dict[str, dict[str, str]] = {}
    for method, colours, markers, line in (
        ("cylindrical", COLOURS, MARKERS, "-"),
        ("fem", FEM_COLOURS, FEM_MARKERS, "--"),
    ):
        names = dict.fromkeys(named(one) for one in curves if one["method"] == method)
        for name, colour, marker in zip(names, colours, markers, strict=False):
            looks[name] = {"color": colour, "marker": marker, "linestyle": line}
    return looks


def story(records: list[Record], curves: Sequence[Record], quantity: str, path: Path) -> None:
    """Draw error against run time and against unknowns.

    Parameters
    ----------
    records
        All of the study: their fastest are ringed, their targets marked.
    curves
        Runs that are drawn.
    quantity
        What the error is of.
    """
    figure, axes = pyplot().subplots(1, 2, figsize=(12.0, 5.4), sharey=True, layout="constrained")
    best = [one for _, *both in pairs(records) for one in both]
    rings: dict[str, Any] = {
        "color": "black",
        "marker": "o",
        "markersize": 14,
        "markerfacecolor": "none",
        "linestyle": "",
    }
    drawn: list[tuple[str, Mapping[str, Any], list[Record]]] = [
        (label, look, [one for one in curves if named(one) == label]) for label, look in looks(curves).items()
    ]
    drawn.append(("fastest that stays within an error, refined", rings, best))
    for label, look, points in drawn:
        errors = [one["error"] for one in points]
        shown = {"markersize": 6, "label": label, **look}
        axes[0].loglog([one["seconds"]["total"] for one in points], errors, **shown)
        axes[1].loglog([one["dofs"] for one in points], errors, **shown)
    for axis, what, form in zip(axes, ("run time, one thread a rank", "unknowns"), (_time, _count), strict=True):
        _scaled(axis, what, form)
        for target in targets(records):
            axis.axhline(target, color="black", linewidth=0.7, linestyle=":")
    axes[0].set_ylabel(f"error of the {quantity}", fontsize=12)
    handles = axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, frameon=False, fontsize=11)
    save(figure, path, 130)


def _scaled(axis: Any, what: str = "run time, one thread a rank", form: Any = None) -> None:
    """Label the axes of a plot of errors: against run time where nothing else is given."""
    axis.set_xlabel(what, fontsize=12)
    axis.tick_params(labelsize=11)
    axis.grid(True, which="major", alpha=0.3)
    axis.xaxis.set_major_formatter(form or _time)
    axis.yaxis.set_major_formatter(_percent)


def _percent(value: float, _: int) -> str:
    return f"{100 * value:g} %"


def _count(value: float, _: int) -> str:
    return f"{value:,.0f}"


def _time(value: float, _: int) -> str:
    return f"{1e3 * value:g} ms" if value < 1.0 else f"{value:g} s"


def labelled(work: Sequence[Record], uncertainty: Mapping[str, float], path: Path) -> None:
    """Draw error against run time of a comparison, each run with its label: measured, of stress, and of the field.

    Parameters
    ----------
    work
        Its runs: those of a ``sequence`` are joined, the others stand alone.
    uncertainty
        Of finite elements, below which errors are not resolved: ``error`` of what is measured, and ``stress``.
    """
    field = "shape" if any("shape" in one["field"] for one in work) else "displacement"
    panels = [("error", "error of what is measured", [one["error"] for one in work])]
    if any("stress" in one for one in work):
        panels.append(("stress", "error of stress", [one.get("stress", 0.0) for one in work]))
    panels.append((field, f"error of the {FIELDS[field]}", [one["field"].get(field, 0.0) for one in work]))
    rows = -(-len(panels) // 2)
    figure, grid = pyplot().subplots(rows, 2, figsize=(12.0, 5.4 if rows == 1 else 9.8), layout="constrained")
    axes, labels = grid.ravel(), []
    for axis, (name, what, errors) in zip(axes, panels, strict=False):
        labels.append(_points(axis, list(zip(work, errors, strict=True)), what))
        floor = uncertainty.get(name, 0.0)
        if floor > 0.0:
            low, high = axis.get_ylim()
            low = min(low, 0.6 * floor)
            axis.axhspan(low, floor, color="black", alpha=0.06, label="less than finite elements converged to")
            axis.set_ylim(low, max(high, 1.5 * floor))
    handles = {label: one for axis in axes for one, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    look: dict[str, Any] = {"frameon": False, "fontsize": 11}
    if len(axes) > len(panels):
        # In the place that is left.
        axes[-1].axis("off")
        axes[-1].legend(handles.values(), handles.keys(), loc="center", **look)
    else:
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3, **look)
    # Panels have their sizes then.
    figure.draw_without_rendering()
    for axis, those in zip(axes, labels, strict=False):
        _label(axis, those)
    save(figure, path, 130)


def _label(axis: Any, labels: Sequence[tuple[str, tuple[float, float], str]]) -> None:
    """Write labels of places, each in its colour, where they meet no other and no marker, and lines least.

    Those for which there is no such place near enough are left out.
    """
    import numpy as np

    size, dots = 9.0, 72.0 / axis.get_figure().dpi
    drawn = [dots * axis.transData.transform(np.column_stack(one.get_data())) for one in axis.lines]
    marks = [
        place
        for one, points in zip(axis.lines, drawn, strict=True)
        if one.get_linestyle() == "None"
        for place in points
    ]
    between = np.linspace(0.0, 1.0, 60)[:, None]
    lines = [(1.0 - between) * a + between * b for points in drawn for a, b in pairwise(points)]
    on_lines = np.concatenate([*lines, np.zeros((0, 2))])
    frame = dots * axis.bbox.get_points()
    # Of markers.
    taken = [(np.array(place) - 4.0, np.array(place) + 4.0) for place in marks]
    for text, place, colour in labels:
        at = dots * axis.transData.transform(place)
        # Letters are about 0.6 times as wide as high, lines a little higher.
        half = 0.5 * np.array([0.6 * size * len(text), 1.1 * size])
        free: list[tuple[float, ...]] = []
        for far in (0.0, 8.0, 18.0, 30.0):
            for angle in np.radians([30, 150, -30, -150, 90, -90, 0, 180]):
                towards = np.array([np.cos(angle), np.sin(angle)])
                middle = at + (half + 6.0) * np.sign(np.round(towards, 9)) + far * towards
                low, high = middle - half, middle + half
                meets = any((low < b).all() and (high > a).all() for a, b in taken)
                nearer = (
                    float(np.linalg.norm(np.reshape(marks, (-1, 2)) - middle, axis=1).min(initial=np.inf))
                    < np.linalg.norm(at - middle) - 0.5
                )
                if not meets and (low > frame[0]).all() and (high < frame[1]).all():
                    crossed = int(((on_lines > low) & (on_lines < high)).all(axis=1).sum())
                    cost = float(far + 3.0 * crossed + 12.0 * nearer)
                    free.append((cost, len(free), far or float(nearer), *low.tolist(), *high.tolist()))
        if not free:
            continue
        _, _, far, *box = min(free)
        low, high = np.array(box[:2]), np.array(box[2:])
        taken.append((low, high))
        thread = {"arrowstyle": "-", "color": colour, "linewidth": 0.6, "shrinkA": 0.0, "shrinkB": 3.0}
        axis.annotate(
            text,
            place,
            0.5 * (low + high) - at,
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=size,
            color=colour,
            arrowprops=thread if far else None,
        )


def _points(axis: Any, runs: Sequence[tuple[Record, float]], what: str) -> list[tuple[str, tuple[float, float], str]]:
    """Draw runs, and lines through those of a ``sequence``; return labels, places and colours, the default's first."""
    from matplotlib.ticker import LogLocator, NullFormatter

    theirs, own = iter(zip(FEM_COLOURS, FEM_MARKERS, strict=True)), iter(zip(COLOURS, MARKERS, strict=False))
    labels = []
    for name in dict.fromkeys(one["curve"] for one, _ in runs):
        ours = name.startswith("isorod")
        colour, marker = next(own if ours else theirs)
        points = [
            (one["dofs"], one["seconds"]["total"], error, one)
            for one, error in runs
            if one["curve"] == name and error > SHOWN
        ]
        points.sort(key=lambda point: point[0])
        joined = [(time, error) for _, time, error, one in points if one["sequence"]]
        axis.loglog(
            [time for time, _ in joined],
            [error for _, error in joined],
            color=colour,
            linestyle="-" if ours else "--",
            linewidth=1.2,
        )
        for k, (_, time, error, one) in enumerate(sorted(points, key=lambda point: point[1])):
            label = (name if ours else f"{name}, dolfinx") if k == 0 else None
            axis.loglog([time], [error], color=colour, marker=marker, linestyle="", label=label)
            labels.append((one["label"], (time, error), colour))
    axis.set_ylabel(what, fontsize=12)
    _scaled(axis)
    # With room for the last label.
    axis.margins(0.2, 0.12)
    for scale in (axis.xaxis, axis.yaxis):
        low, high = scale.get_view_interval()
        if high < 100.0 * low:
            scale.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            scale.set_minor_formatter(NullFormatter())
    return sorted(labels, key=lambda one: one[0] != DEFAULT)


def convergence(entries: Sequence[Record], path: Path) -> float:
    """Draw Fig. 13: errors of the first three frequencies against the finest model, and return their common slope.

    Parameters
    ----------
    entries
        Records with ``elements`` and ``frequencies``, coarse to fine; the last is the reference.
    """
    import numpy as np

    elements = np.array([record["elements"] for record in entries[:-1]], dtype=float)
    reference = np.array(entries[-1]["frequencies"][:3])
    errors = np.array([record["frequencies"][:3] for record in entries[:-1]]) / reference - 1.0
    slopes = -np.polyfit(np.log(elements), np.log(errors), 1)[0]
    figure, axis = pyplot().subplots(figsize=(4.8, 3.9), layout="constrained")
    for k in range(3):
        label = f"mode {k + 1}, slope {slopes[k]:.2f}"
        axis.loglog(elements, errors[:, k], color=COLOURS[k], marker=MARKERS[k], label=label)
    guide = errors[0].mean() * (elements / elements[0]) ** -3.0
    axis.loglog(elements, guide, color="black", linewidth=0.8, linestyle=":", label="slope 3")
    axis.set_xlabel("elements")
    axis.set_ylabel("error of the frequency")
    axis.yaxis.set_major_formatter(_percent)
    axis.set_xticks(elements, [f"{count:g}" for count in elements])
    axis.minorticks_off()
    axis.grid(True, alpha=0.25)
    axis.legend(frameon=False)
    save(figure, path, 120)
    return float(slopes.mean())
