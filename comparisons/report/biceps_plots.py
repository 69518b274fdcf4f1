"""Plots of the biceps' study, made from result records alone."""

from collections.abc import Sequence
from pathlib import Path

from comparisons.measure.records import Record, side
from comparisons.report.plots import COLOURS, FEM_COLOURS, MARKERS, pyplot, save

# Records' key of ours and of the finite elements' history, the equilibrium's key, and the axis label.
COURSES = (
    ("belly_bulge_history", "belly_bulge", "belly_bulge", "bulge of the belly [cm]"),
    ("end_force_history", "end_force", "end_force", "end force [N]\nlower (–), upper (··)"),
    ("contact_force", "contact_force", "contact_force", "contact force [N]"),
    ("contact_area", "contact_area", "contact_area", "contact area [cm²]"),
)


def courses(motions: Sequence[Record], theirs: Sequence[Record], path: Path) -> None:
    """Draw bulge, end forces, contact force and area against time: left the finite elements' time, right all.

    Parameters
    ----------
    motions
        Records of the element's motion, each with its ``equilibrium``, drawn as a line at the right.
    theirs
        Those of the finite elements, with ``history``.
    """
    import numpy as np

    figure, axes = pyplot().subplots(
        len(COURSES), 2, figsize=(12.5, 11.0), sharex="col", sharey="row", width_ratios=(1.4, 1.0), layout="constrained"
    )
    end = max(record["history"]["time"][-1] for record in theirs)
    every = [(record, COLOURS[k], f"{side(record)}, {record['label']}") for k, record in enumerate(motions)]
    every += [(record, FEM_COLOURS[k], f"{record['label']} (dolfinx)") for k, record in enumerate(theirs)]
    for row, (own, fem, rest, label) in enumerate(COURSES):
        for record, colour, name in every:
            history = record.get("history")
            times = 1e3 * np.array(history["time"] if history else record["times"])
            values = np.array(history[fem] if history else record[own])
            for axis in axes[row]:
                if values.ndim == 1:
                    axis.plot(times, values, color=colour, label=name, linewidth=1.2, marker="." if history else None)
                    continue
                # Both branches do the same.
                for end_at, line in ((0, "-"), (1, ":")):
                    shown = name if end_at == 0 else None
                    axis.plot(times, values[:, end_at], color=colour, linestyle=line, label=shown, linewidth=1.2)
            if "equilibrium" in record:
                axes[row, 1].axhline(
                    np.ravel(record["equilibrium"][rest])[0], color=colour, linewidth=0.7, linestyle="--"
                )
        axes[row, 0].set_ylabel(label)
        for axis in axes[row]:
            axis.grid(True, alpha=0.25)
    axes[0, 0].set_xlim(0.0, 1e3 * end)
    axes[0, 1].set_xlim(0.0, 1e3 * motions[0]["times"][-1])
    for axis in axes[-1]:
        axis.set_xlabel("time [ms]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    save(figure, path, 110)


def work(records: Sequence[Record], quantities: dict[str, float], path: Path) -> None:
    """Draw the error of each quantity at the equilibrium against run time, one curve a family.

    Parameters
    ----------
    records
        Records with ``curve``, ``method``, ``error`` by quantity, ``seconds``.
    quantities
        Error marked by a line, by quantity.
    """
    figure, axes = pyplot().subplots(1, len(quantities), figsize=(13.5, 4.6), layout="constrained")
    curves = list(dict.fromkeys((record["curve"], record["method"]) for record in records))
    for method, colours in (("cylindrical", COLOURS), ("fem", FEM_COLOURS)):
        for k, curve in enumerate(curve for curve, made in curves if made == method):
            points = [record for record in records if record["curve"] == curve and record["error"]]
            for axis, name in zip(axes, quantities, strict=True):
                # The reference itself has no error to draw.
                drawn = [(one["seconds"]["total"], one["error"][name]) for one in points if one["error"][name] > 0.0]
                axis.loglog(
                    *zip(*drawn, strict=True) if drawn else ((), ()),
                    color=colours[k % len(colours)],
                    marker=MARKERS[k % len(MARKERS)],
                    linestyle="-" if method == "cylindrical" else "--",
                    label=curve if method == "cylindrical" else f"{curve} (dolfinx)",
                )
    for axis, (name, bound) in zip(axes, quantities.items(), strict=True):
        axis.axhline(bound, color="black", linewidth=0.8)
        axis.annotate(f"{100 * bound:g} %", (1.0, bound), xycoords=("axes fraction", "data"), ha="right", va="bottom")
        axis.set_title(f"{name.replace('_', ' ')}", fontsize=11)
        axis.set_xlabel("run time, one thread [s]")
        axis.grid(True, which="both", alpha=0.25)
    axes[0].set_ylabel("relative error at the equilibrium")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right center", frameon=False, fontsize=9)
    save(figure, path, 110)
