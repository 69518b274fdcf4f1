"""The newcomer's table on the report page."""

from pathlib import Path

from comparisons import newcomer
from comparisons.measure.records import Record, part
from comparisons.report.compare import ERROR, TOLERANCES
from comparisons.report.html import heading, table
from comparisons.report.precision import rerun


def section(records: list[Record], folder: Path) -> list[str]:
    """Return the study's HTML; each comparison has a part of the page of its own."""
    return [
        heading(2, "A newcomer's ten examples"),
        "<p>Scenes as <code>isorod new</code> writes them, run with nothing chosen, and compared with finite elements; "
        "the published spring and blade below them. Lines are those without comments; seconds those of the whole "
        "command. The biceps has a study of its own.</p>",
        table(*newcomer.table(part(records, "example"))),
        rerun("newcomer", records),
    ]


def summary(records: list[Record]) -> list[str]:
    """Return the main finding, one line."""
    rows = part(records, "example")
    good = sum("failure" not in row and row["error"] <= max(TOLERANCES[ERROR], row["told"]) for row in rows)
    failed = [row["name"] for row in rows if "failure" in row]
    more = f"; not compared: {', '.join(failed)}" if failed else ""
    return [
        f"newcomer: {good} of {len(rows)} scenes within {100 * TOLERANCES[ERROR]:g} % with nothing chosen, as far "
        f"as finite elements converged{more}"
    ]
