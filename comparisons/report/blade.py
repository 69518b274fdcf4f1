"""The blade's part of the report page."""

import html
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from comparisons.measure import published
from comparisons.measure.records import Record, part
from comparisons.report import plots, precision
from comparisons.report.html import percent, table
from comparisons.report.precision import LUCK, reach, refused, runs

MODES = tuple(f"mode {k}" for k in range(1, 11))


def summary(records: list[Record]) -> list[str]:
    """Return the study's main findings, one line each."""
    return precision.summary("blade", "ten frequencies", records)


def section(records: list[Record], folder: Path) -> list[str]:
    """Write the plots of a run of the study and return its HTML."""
    work, (limit,), (picture,) = (part(records, name) for name in ("work", "converged", "picture"))
    plots.work_precision(work, 5e-3, "blade's ten frequencies (largest)", folder / "blade-work-precision.png")
    entries = part(records, "table 2")
    order = plots.convergence(entries, folder / "blade-convergence.png")
    lines = ["<h2>Blade: error against run time</h2>"]
    lines.append(
        f"<p>Largest error of the ten lowest frequencies. Reference: three uniformly refined meshes "
        f"(<code>{html.escape(limit['element'])}</code>), extrapolated mode by mode.</p>"
    )
    lines.append('<img src="blade-work-precision.png" alt="error against run time and unknowns, log-log">')
    lines.append(reach(records) + LUCK)
    lines.append("<h2>Blade: how far the element is from the 3-D solution</h2>")
    lines.append(_elements(records, limit["frequencies"]))
    lines.append(
        "<p>The paper's element (K = 1) has harmonic functions of the section only; they cannot carry the shear "
        "warping and the thickness strain of a flat section, so modes 5, 7 and 10, which twist, stay stiff however "
        "fine the axis. That its numbers come near Table 2 says nothing about this. K = 2 removes it.</p>"
    )
    lines.append("<h2>Blade: Table 2 of Lu &amp; Zhou (2011)</h2>")
    lines.append(_published(entries))
    lines.append(_reference(records))
    lines.append(
        "<h2>Blade: Fig. 13, convergence of the first three frequencies</h2><p>Against the model of 30 elements; "
        f"common slope {order:.2f} (the paper draws 3).</p>"
        '<img src="blade-convergence.png" alt="error of three frequencies against the number of elements">'
    )
    lines.append("<h2>Blade: Fig. 12, mode shapes</h2>")
    lines.append(f'<img src="{picture["file"]}" alt="ten mode shapes">')
    lines.append("<h2>Blade: modal assurance criterion</h2>")
    lines.append(_assurance(part(records, "mac")[0]))
    lines.append("<h2>Blade: every run</h2>")
    lines.append(runs(work))
    lines.extend(refused(records))
    return lines


def _row(values: Sequence[float]) -> tuple[str, ...]:
    return tuple(f"{value:.5g}" for value in values)


def _deviations(values: Sequence[float], reference: Sequence[float]) -> tuple[str, ...]:
    return tuple(f"{100 * (a / b - 1):+.2f} %" for a, b in zip(values, reference, strict=True))


def _elements(records: list[Record], reference: Sequence[float]) -> str:
    rows = [("3-D (finite elements, extrapolated)", "", *_row(reference))]
    for record in part(records, "element"):
        rows.append((record["label"], f"{record['dofs']:,}", *_row(record["frequencies"])))
        rows.append(("", "", *_deviations(record["frequencies"], reference)))
    return table(("Hz", "unknowns", *MODES), rows)


def _published(entries: list[Record]) -> str:
    rows = []
    worst = 0.0
    for record in entries:
        rows.append((f"N = {record['elements']}", "published", *_row(record["published"])))
        rows.append(("", "ours", *_row(record["frequencies"])))
        rows.append(("", "deviation", *_deviations(record["frequencies"], record["published"])))
        worst = max(worst, float(np.max(np.abs(np.array(record["frequencies"]) / record["published"] - 1.0))))
    text = f"<p>Largest deviation of the 60 values: {percent(worst)}.</p>"
    return table(("elements", "", *MODES), rows, text=(0, 1)) + text


def _reference(records: list[Record]) -> str:
    (limit,) = part(records, "converged")
    rows = []
    for record in part(records, "convergence"):
        rows.append((record["arguments"], f"{record['dofs']:,}", *_row(record["frequencies"])))
    rows.append(("extrapolated", "", *_row(limit["frequencies"])))
    for record in part(records, "paper mesh"):
        rows.append(
            (
                f"{record['element']} on a mesh of the paper's density",
                f"{record['dofs']:,}",
                *_row(record["frequencies"]),
            )
        )
    rows.append(
        ("printed in the paper (8-node enhanced-strain bricks)", "3,105", *_row(published.BLADE_FEM_FREQUENCIES))
    )
    return table(("finite elements, Hz", "unknowns", *MODES), rows)


def _assurance(record: Record) -> str:
    rows = [(name, *(f"{value:.3f}" for value in row)) for name, row in zip(MODES, record["matrix"], strict=True)]
    ours, theirs = record["dofs"]
    head = (f"ours ({ours:,} unknowns) \\ dolfinx ({theirs:,})", *MODES)
    return table(head, rows)
