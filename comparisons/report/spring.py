"""The spring's part of the report page."""

import html
from pathlib import Path

from comparisons.measure import published
from comparisons.measure.records import Record, is_ours, part
from comparisons.report import precision
from comparisons.report.html import figure, fold, table
from comparisons.report.html import section as section_of
from comparisons.report.work import Part

PAPER_ELEMENTS = {
    "q1": "8-node bricks, displacements only,",
    "q2": "27-node bricks (Q2 displacement)",
    "enhanced": "8-node enhanced-strain bricks (9 modes)",
}
PART = Part(
    "spring",
    "force",
    "the force that pulls it",
    "spring's force",
    ("paper, n = 4", "polynomials N = 3, p = 4"),
    ("P2 tetrahedra", "Q2 bricks"),
)
summary, answer = PART.summary, PART.answer


def section(records: list[Record], folder: Path) -> list[str]:
    """Write the plots of a run of the study and return its HTML."""
    records = precision.settled(records)
    (limit,), (picture,) = part(records, "converged"), part(records, "picture")
    (force,) = limit["force"]
    scene = next(one for one in part(records, "work") if is_ours(one))["options"]
    about = (
        f"<p>A round wire of radius {scene['wire_radius']:g}, wound in {scene['coils']} coils of radius "
        f"{scene['coil_radius']:g} that rise {scene['pitch']:g} a turn, clamped at its lower end. The upper end, kept "
        f"from turning, is pulled {scene['travel']:g} along the axis: how large is the force? The material is "
        f"neo-Hookean, E = {scene['E']:g}, ν = {scene['nu']:g}. Units are consistent ones: with mm and MPa the force "
        f"is in N. Converged force: {force:.5f}, extrapolated from three uniformly refined meshes of curved "
        f"bricks (<code>{html.escape(limit['element'])}</code>, observed order {_order(limit)}, finest mesh "
        f"{limit['uncertainty'] * force:.1g} away).</p>"
    )
    paper, *others = (_published(records, extra) for extra in published.SPRING_GAUSS_POINTS)
    return section_of(
        "Spring",
        about,
        {
            **PART.errors(records, folder),
            "von Mises stress": figure(
                picture["file"],
                picture["alt"],
                "The pulled spring, as in the paper's Fig. 8, both sides on one scale. The wire is stressed most at "
                "the inside of the coils, and along its middle not at all, on both sides alike.",
            ),
            "Table 1 of Lu & Zhou (2011)": [
                "<p>The force that the paper prints, and ours with its element and the rule R x S x T = 2 x 1 x t.</p>",
                paper,
                fold("The same with more points along an element: t = p + 2, t = p + 4", *others),
                "<p>E = 2.014e4 is inferred (the paper does not print it). The column of 4 elements a turn hangs on "
                "the quadrature along the axis: an element there spans 90° and its integrand is rational. t = p + 1 "
                "under-integrates it and the spring comes 4 % soft, t = p + 2 overshoots by 0.8 %, and with t = p + "
                "4, where more points change nothing, it is 0.2 % above the printed values. From 8 elements a turn "
                "on, all three rules agree with each other and with the paper.</p>",
            ],
            "the converged force": _reference(records),
            **PART.closing(records),
        },
    )


def _published(records: list[Record], extra: int) -> str:
    records_of_rule = part(records, f"table 1, t = p + {extra}")
    rows = []
    for points in published.SPRING_FORCE:
        mine = [record for record in records_of_rule if record["options"]["section_points"] == points]
        mine.sort(key=lambda record: record["options"]["elements_per_turn"])
        rows.append((f"n = {points}", "published", *(f"{record['published']:.5f}" for record in mine)))
        rows.append(("", f"ours, t = p + {extra}", *(f"{record['force']:.5f}" for record in mine)))
        rows.append(
            ("", "deviation", *(f"{100 * (record['force'] / record['published'] - 1):+.3f} %" for record in mine))
        )
    head = ("points", "", *(f"{count} a turn" for count in published.SPRING_ELEMENTS_PER_TURN))
    return table(head, rows, text=(0, 1))


def _order(limit: Record) -> str:
    (order,) = limit["orders"]["force"]
    return "none shown" if order is None else f"{order:.1f}"


def _reference(records: list[Record]) -> str:
    rows = []
    for record in part(records, "convergence"):
        options = record["options"]
        name = f"Q{options['degree']} curved bricks, {options['around']} round, {options['layers']} layers"
        rows.append((name, f"{record['dofs']:,}", f"{record['force']:.5f}"))
    (limit,) = part(records, "converged")
    rows.append((f"extrapolated, order {_order(limit)}", "", f"{limit['force'][0]:.5f}"))
    for record in part(records, "paper mesh"):
        name = f"{PAPER_ELEMENTS[record['element']]} on the paper's mesh (O-grid, 72 layers, straight sides)"
        rows.append((name, f"{record['dofs']:,}", f"{record['force']:.5f}"))
    rows.append(("printed in the paper (8-node enhanced-strain bricks)", "21,243", f"{published.SPRING_FEM_FORCE:.5f}"))
    return table(("finite elements", "unknowns", "force"), rows)
