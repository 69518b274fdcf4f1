"""The figure of a case: error against the swept number, one panel a sweep, failures on the upper edge."""

from math import ceil
from pathlib import Path

import numpy as np

from comparisons.measure.records import Record
from comparisons.report.plots import pyplot, save
from comparisons.stability.point import sweeps

# Okabe and Ito's colours, which colour-blind readers distinguish too.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
# One fewer than colours, so that no two of many curves look alike.
MARKERS = "osD^vP"
# Errors at or below this are drawn here: rounding.
FLOOR = 1e-16
ACROSS = 3


def draw(records: list[Record], path: Path) -> None:
    """Draw relative error against the swept number, log-log; failures are crosses on the upper edge.

    Parameters
    ----------
    records
        Points (`comparisons.stability.point.measure`); the largest tolerance of a sweep is marked by a line.
    """
    groups = sweeps(records)
    rows = ceil(len(groups) / ACROSS)
    across = min(ACROSS, len(groups))
    figure, axes = pyplot().subplots(
        rows, across, figsize=(5.6 * across, 4.4 * rows), layout="constrained", squeeze=False
    )
    for axis in axes.flat[len(groups) :]:
        axis.set_visible(False)
    for axis, (sweep, curves) in zip(axes.flat, groups.items(), strict=False):
        points = [record for curve in curves.values() for record in curve]
        for k, (series, curve) in enumerate(curves.items()):
            colour = COLOURS[k % len(COLOURS)]
            done = [record for record in curve if "failure" not in record]
            failed = [record["value"] for record in curve if "failure" in record]
            axis.plot(
                [record["value"] for record in done],
                [max(record["error"], FLOOR) for record in done],
                color=colour,
                marker=MARKERS[k % len(MARKERS)],
                markersize=5,
                label=series or None,
            )
            # A little apart, so that failures of several curves at one value show.
            height = 0.97 - 0.04 * (k % 4)
            axis.plot(
                failed,
                np.full(len(failed), height),
                "x",
                color=colour,
                markersize=8,
                transform=axis.get_xaxis_transform(),
            )
        values = np.array([record["value"] for record in points], dtype=float)
        if values.min() > 0.0 and values.max() > 50.0 * values.min():
            axis.set_xscale("log")
        axis.set_yscale("log")
        # Room for the crosses above the curves.
        axis.margins(y=0.2)
        bounds = [record["tolerance"] for record in points if "tolerance" in record]
        if bounds:
            axis.axhline(max(bounds), color="black", linewidth=0.8)
        axis.set_xlabel(sweep)
        axis.set_ylabel("relative error (× refused)")
        axis.grid(True, which="both", alpha=0.25)
        if any(curves):
            axis.legend(frameon=False, fontsize="small")
    save(figure, path, 110)
