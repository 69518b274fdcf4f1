"""The stability study's part of the report page."""

import html
from pathlib import Path
from typing import Any

from comparisons import stability
from comparisons.measure.records import Record, part
from comparisons.report.html import figure, fold, table
from comparisons.report.html import section as section_of
from comparisons.report.precision import rerun
from comparisons.stability import figure as figures
from comparisons.stability.point import holds, sweeps


def section(records: list[Record], folder: Path) -> list[str]:
    """Write the figures of a run of the study and return its HTML."""
    about = (
        "<p>How slender, thin, stiff or far from rest may it be? Each case is swept until it fails. A point "
        "<em>holds</em> within the tolerance beside it; what is <em>refused</em> ended with the one-line error shown, "
        "exit code 2, and no number.</p>\n"
    )
    parts: dict[str, str | list[str]] = {}
    for ended in part(records, "case"):
        points = _points(records, ended["case"])
        picture = f"stability-{ended['case']}.png"
        figures.draw(points, folder / picture)
        parts[ended["title"]] = [
            "<ul>" + "".join(f"<li>{html.escape(text)}</li>" for text in ended["limits"]) + "</ul>",
            figure(
                picture,
                f"{ended['title']}: error against the swept number",
                "Error against what is swept; the line is the tolerance, a cross on the upper edge a refusal.",
            ),
            fold(f"All {len(points)} points", *_tables(points, getattr(stability.find(ended["case"]), "COLUMNS", {}))),
        ]
    parts["raw data, running it again"] = rerun("stability", records)
    return section_of("Stability", about + _overview(records), parts)


def summary(records: list[Record]) -> list[str]:
    """Return the study's main finding, one line."""
    points = part(records, "point")
    good = sum(holds(record) for record in points)
    refused = sum("failure" in record for record in points)
    cases = len(part(records, "case"))
    return [
        f"stability: {cases} cases, {len(points)} points: {good} hold, {refused} refused with one line, "
        f"{len(points) - good - refused} outside their tolerance"
    ]


def _points(records: list[Record], case: str) -> list[Record]:
    return [record for record in part(records, "point") if record["case"] == case]


def _overview(records: list[Record]) -> str:
    rows = []
    for ended in part(records, "case"):
        points = _points(records, ended["case"])
        good, refused = (sum(map(test, points)) for test in (holds, lambda record: "failure" in record))
        seconds = sum(record["seconds"] for record in points)
        rows.append((ended["title"], len(points), good, refused, len(points) - good - refused, f"{seconds:.1f}"))
    return table(("case", "points", "hold", "refused", "outside tolerance", "s"), rows)


def _tables(points: list[Record], columns: dict[str, str]) -> list[str]:
    lines = []
    for sweep, curves in sweeps(points).items():
        shown = {
            key: name for key, name in columns.items() if any(key in one for curve in curves.values() for one in curve)
        }
        references = {
            one["reference"] for curve in curves.values() for one in curve if isinstance(one.get("reference"), str)
        }
        lines.append(f"<h4>{html.escape(sweep)}</h4>")
        if references:
            lines.append(f"<p class=small>Reference: {html.escape('; '.join(sorted(references)))}.</p>")
        named = any(curves)
        rows = [
            (
                *((series,) if named else ()),
                _number(one["value"]),
                f"{one['error']:.2g}" if "error" in one else "",
                f"{one['tolerance']:g}" if "tolerance" in one else "",
                *(_number(one.get(key, "")) for key in shown),
                f"{one['seconds']:.2f}",
                one.get("failure", "holds" if holds(one) else "outside tolerance"),
            )
            for series, curve in curves.items()
            for one in curve
        ]
        head = (*(("",) if named else ()), sweep, "error", "tolerance", *shown.values(), "s", "")
        lines.append(f"<div class=failures>{table(head, rows, text=(*((0,) if named else ()), len(head) - 1))}</div>")
    return lines


def _number(value: Any) -> str:
    if isinstance(value, float):
        # As many digits as a Poisson's ratio near 1/2 needs, where that stays short.
        return f"{value:g}" if len(f"{value:g}") <= 8 else f"{value:.3g}"
    if isinstance(value, list):
        return ", ".join(_number(one) for one in value)
    return str(value)
