"""The spring's part of the report page."""

import html
from pathlib import Path

from comparisons.measure import published
from comparisons.measure.records import Record, part
from comparisons.report import plots, precision
from comparisons.report.html import table
from comparisons.report.precision import LUCK, reach, refused, runs

PAPER_ELEMENTS = {
    "q1": "8-node bricks, displacements only,",
    "q2": "27-node bricks (Q2 displacement)",
    "enhanced": "8-node enhanced-strain bricks (9 modes)",
}


def summary(records: list[Record]) -> list[str]:
    """Return the study's main findings, one line each."""
    return precision.summary("spring", "force", records)


def section(records: list[Record], folder: Path) -> list[str]:
    """Write the plots of a run of the study and return its HTML."""
    work, (limit,) = part(records, "work"), part(records, "converged")
    picture = part(records, "picture")[0]
    plots.work_precision(work, 1e-3, "spring's force", folder / "spring-work-precision.png")
    lines = []
    lines.append("<h2>Spring: error against run time</h2>")
    lines.append(
        f"<p>Reference: the force {limit['force']:.5f}, extrapolated from three uniformly refined meshes of curved "
        f"bricks (<code>{html.escape(limit['element'])}</code>, observed order {limit['order']:.1f}, finest mesh "
        f"{limit['uncertainty']:.1g} away).</p>"
    )
    lines.append('<img src="spring-work-precision.png" alt="error against run time and unknowns, log-log">')
    lines.append(reach(records) + LUCK)
    lines.append("<h2>Spring: von Mises stress</h2>")
    peaks = " and ".join(f"{peak:.1f}" for peak in picture["largest_von_mises"])
    lines.append(
        f"<p>Deformed shape; one colour scale, that of the paper's Fig. 8. Largest values: {peaks} (left, right; at "
        "the "
        f'clamped edges).</p><img src="{picture["file"]}" alt="von Mises stress of both models">'
    )
    lines.append("<h2>Spring: Table 1 of Lu &amp; Zhou (2011)</h2>")
    lines.extend(_published(records, extra) for extra in published.SPRING_GAUSS_POINTS)
    lines.append(
        "<p>E = 2.014e4 is inferred (the paper does not print it). The column of 4 elements a turn hangs on the "
        "quadrature along the axis: an element there spans 90° and its integrand is rational. t = p + 1 "
        "under-integrates it and the spring comes 4 % soft, t = p + 2 overshoots by 0.8 %, and with t = p + 4, where "
        "more points change nothing, it is 0.2 % above the printed values. From 8 elements a turn on, all three rules "
        "agree with each other and with the paper.</p>"
    )
    lines.append("<h2>Spring: finite element reference</h2>")
    lines.append(_reference(records))
    lines.append("<h2>Spring: every run</h2>")
    lines.append(runs(work))
    lines.extend(refused(records))
    return lines


def _published(records: list[Record], extra: int) -> str:
    found = part(records, f"table 1, t = p + {extra}")
    rows = []
    for points in published.SPRING_FORCE:
        mine = [record for record in found if record["options"]["section_points"] == points]
        mine.sort(key=lambda record: record["options"]["elements_per_turn"])
        rows.append((f"n = {points}", "published", *(f"{record['published']:.5f}" for record in mine)))
        rows.append(("", f"ours, t = p + {extra}", *(f"{record['force']:.5f}" for record in mine)))
        rows.append(
            ("", "deviation", *(f"{100 * (record['force'] / record['published'] - 1):+.3f} %" for record in mine))
        )
    head = ("points", "", *(f"{count} a turn" for count in published.SPRING_ELEMENTS_PER_TURN))
    return table(head, rows, text=(0, 1))


def _reference(records: list[Record]) -> str:
    rows = []
    for record in part(records, "convergence"):
        options = record["options"]
        name = f"Q{options['degree']} curved bricks, {options['around']} round, {options['layers']} layers"
        rows.append((name, f"{record['dofs']:,}", f"{record['force']:.5f}"))
    (limit,) = part(records, "converged")
    rows.append((f"extrapolated, order {limit['order']:.1f}", "", f"{limit['force']:.5f}"))
    for record in part(records, "paper mesh"):
        name = f"{PAPER_ELEMENTS[record['element']]} on the paper's mesh (O-grid, 72 layers, straight sides)"
        rows.append((name, f"{record['dofs']:,}", f"{record['force']:.5f}"))
    rows.append(("printed in the paper (8-node enhanced-strain bricks)", "21,243", f"{published.SPRING_FEM_FORCE:.5f}"))
    return table(("model", "unknowns", "force"), rows)
