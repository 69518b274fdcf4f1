"""The blade's part of the report page."""

import html
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from comparisons.measure import published
from comparisons.measure.records import Record, is_ours, part
from comparisons.report import plots, precision
from comparisons.report.html import figure, percent, table
from comparisons.report.html import section as section_of
from comparisons.report.work import Part

MODES = tuple(f"mode {k}" for k in range(1, 11))
PART = Part(
    "blade",
    "ten frequencies",
    "its ten lowest frequencies",
    "blade's frequencies",
    ("paper", "K = 2, p = 3, n = 16"),
    ("P2 tetrahedra", "enhanced bricks", "Q3 bricks", "Q2 bricks"),
)
summary, answer = PART.summary, PART.answer


def section(records: list[Record], folder: Path) -> list[str]:
    """Write the plots of a run of the study and return its HTML."""
    records = precision.settled(records)
    (limit,), (picture,) = part(records, "converged"), part(records, "picture")
    entries, (mac,) = part(records, "table 2"), part(records, "mac")
    order = plots.convergence(entries, folder / "blade-convergence.png")
    scene = next(one for one in part(records, "work") if is_ours(one))["options"]
    about = (
        f"<p>A thin airfoil section of chord {scene['chord']:g}, swept over a length of {scene['length']:g}, turned by "
        f"{scene['twist']:g}° and tapered to {scene['taper']:g} of its size at the tip; the root is clamped. What are "
        f"its ten lowest frequencies? Linear elastic, E = {scene['E']:g}, ν = {scene['nu']:g}, density "
        f"{scene['density']:g}; units are consistent ones, frequencies in Hz with seconds. The error is the largest "
        "of the ten. Converged frequencies: three uniformly refined meshes of dolfinx "
        f"(<code>{html.escape(limit['element'])}</code>), extrapolated mode by mode.</p>"
    )
    return section_of(
        "Blade",
        about,
        {
            **PART.errors(records, folder),
            "how far the element is from the 3-D solution": [
                _elements(records, limit["frequencies"]),
                "<p>The paper's element (K = 1) has harmonic functions of the section only; they cannot carry the "
                "shear warping and the thickness strain of a flat section, so modes 5, 7 and 10, which twist, stay "
                "stiff however fine the axis. That its numbers come near Table 2 says nothing about this. K = 2 "
                "removes it.</p>",
            ],
            "Table 2 of Lu & Zhou (2011)": [
                "<p>The frequencies in Hz that the paper prints, and ours with its element.</p>",
                _published(entries),
            ],
            "the converged frequencies": _reference(records),
            "Fig. 13, convergence": figure(
                "blade-convergence.png",
                "error of three frequencies against the number of elements",
                "The paper's element against its own model of 30 elements, first three frequencies: a straight line "
                f"says that each doubling divides the error by the same factor. Common slope {order:.2f}; the paper "
                "draws 3.",
                fits=True,
            ),
            "mode shapes, as in Fig. 12": figure(picture["file"], picture["alt"], picture["caption"]),
            "the same modes": [
                "<p>Modal assurance criterion: 1 if a mode of isorod has the shape of one of dolfinx, 0 if they have "
                "nothing in common. Ones on the diagonal say that both found the same modes in the same order. "
                f"{mac['dofs'][0]:,} unknowns of isorod, {mac['dofs'][1]:,} of dolfinx.</p>",
                _assurance(mac["matrix"]),
            ],
            **PART.closing(records),
        },
    )


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
        rows.append((f"{record['elements']} elements", "published", *_row(record["published"])))
        rows.append(("", "ours", *_row(record["frequencies"])))
        rows.append(("", "deviation", *_deviations(record["frequencies"], record["published"])))
        worst = max(worst, float(np.max(np.abs(np.array(record["frequencies"]) / record["published"] - 1.0))))
    text = f"<p>Largest deviation of the 60 values: {percent(worst)}.</p>"
    return table(("Hz", "", *MODES), rows, text=(0, 1)) + text


def _reference(records: list[Record]) -> str:
    (limit,) = part(records, "converged")
    rows = []
    for record in part(records, "convergence"):
        mesh = record["arguments"].removeprefix("--").replace(" --", ", ")
        rows.append((mesh, f"{record['dofs']:,}", *_row(record["frequencies"])))
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


def _assurance(matrix: Sequence[Sequence[float]]) -> str:
    rows = [(name, *(f"{value:.3f}" for value in row)) for name, row in zip(MODES, matrix, strict=True)]
    return table(("isorod \\ dolfinx", *MODES), rows)
