"""The laws' part of the report page."""

from pathlib import Path

from comparisons import laws
from comparisons.measure.records import Record, part
from comparisons.report.html import heading, plain, table
from comparisons.report.precision import rerun


def section(records: list[Record], folder: Path) -> list[str]:
    """Return the study's HTML."""
    pairs = part(records, "pair")
    titles = {record["scene"]: record["title"] for record in pairs}
    return [
        heading(2, "Every law beside finite elements"),
        "<p>Both sides take the law's stored energy from one expression: isorod its compiled stress and moduli, "
        "dolfinx its form, of bricks of 27 nodes. What finite elements find is extrapolated from three meshes (at "
        "quick level: that of the second), and tells as far as the finest is from that. Ends have the shape of the "
        "section amid the rod. Scenes: " + "; ".join(f"{name}, {title}" for name, title in titles.items()) + ".</p>",
        table(*laws.table(pairs), text=(0, 1, 2)),
        rerun("laws", records),
    ]


def answer(records: list[Record]) -> list[str]:
    """Return the main finding as HTML."""
    return [f"<p>{summary(records)[-1].capitalize()}.</p>"]


def summary(records: list[Record]) -> list[str]:
    """Return the table, and how many laws agree."""
    pairs = part(records, "pair")
    good = sum(laws.agrees(record) for record in pairs)
    return [
        *plain(*laws.table(pairs)),
        f"laws: {good} of {len(pairs)} pairs of a law and a scene within {100 * laws.TOLERANCE:g} % of finite elements "
        "of the same energy",
    ]
