"""Plots of the biceps' study, made from result records alone."""

from collections.abc import Sequence
from pathlib import Path

from comparisons.measure.records import Record, side
from comparisons.report.plots import COLOURS, FEM_COLOURS, pyplot, save

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
