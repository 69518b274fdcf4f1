"""What the spring's and the blade's part of the page share: error against run time, and every run."""

from collections.abc import Sequence
from pathlib import Path

from comparisons.measure.records import Record, part
from comparisons.report import plots
from comparisons.report.html import figure, fold, heading
from comparisons.report.precision import LUCK, named, reach, refused, rerun, runs


def errors(
    study: str, quantity: str, records: list[Record], folder: Path, ours: Sequence[str], theirs: Sequence[str]
) -> list[str]:
    """Write the plots and return the HTML: the curves that tell the story, the others, the fastest within each error.

    ``ours`` and ``theirs`` are curves that are shown beside the fastest.
    """
    work = part(records, "work")
    files = [f"{study}-{name}.png" for name in ("work-precision", "work-precision-narrow", "every-curve")]
    curves = plots.told(records, ours, theirs)
    plots.story(records, curves, quantity, *(folder / file for file in files[:2]))
    plots.every(work, quantity, folder / files[2])
    count = len({named(one) for one in work})
    return [
        heading(3, f"{study.title()}: error against run time"),
        figure(
            files[0],
            f"error of the {quantity} against run time and against unknowns, both axes logarithmic",
            "Lower is more accurate, further left is faster, or smaller. Solid lines in blue and green are isorod, "
            "dashed ones in warm colours and black dolfinx. Rings mark the fastest within each error (dotted lines) "
            "that stays there on finer meshes.",
            narrow=files[1],
        ),
        fold(
            f"All {count} curves",
            figure(files[2], f"error of the {quantity} against run time, all curves", "Left isorod, right dolfinx."),
        ),
        heading(3, f"{study.title()}: the fastest within each error"),
        reach(records),
        LUCK,
    ]


def closing(study: str, records: list[Record]) -> list[str]:
    """Return the HTML of every run, the raw data and how to run it again."""
    work = part(records, "work")
    return [
        heading(3, f"{study.title()}: every run, raw data, running it again"),
        rerun(study, records),
        fold(f"All {len(work)} runs", runs(work), *refused(records)),
    ]
