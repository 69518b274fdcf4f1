"""Common to the spring's and the blade's part of the page: answers, error against run time, and every run."""

from pathlib import Path
from typing import NamedTuple

from comparisons.measure.records import Record, part
from comparisons.report import plots, precision
from comparisons.report.html import figure, fold
from comparisons.report.precision import LUCK, reach, refused, rerun, runs


class Part(NamedTuple):
    """The part of a study.

    Attributes
    ----------
    study
        Its name.
    quantity, asked, drawn
        What its error is of: in a line of text, in the answer, and in plots.
    ours, theirs
        Curves that are shown beside the fastest.
    """

    study: str
    quantity: str
    asked: str
    drawn: str
    ours: tuple[str, ...]
    theirs: tuple[str, ...]

    def summary(self, records: list[Record]) -> list[str]:
        """Return the study's main findings, one line each."""
        return precision.summary(self.study, self.quantity, records)

    def answer(self, records: list[Record]) -> list[str]:
        """Return the study's main findings as HTML."""
        return precision.answer(self.study.title(), self.asked, records)

    def story(self, records: list[Record], path: Path, *more: str) -> None:
        """Draw the most important curves; ``more`` are curves of ours."""
        curves = plots.curves(records, (*more, *self.ours), self.theirs)
        plots.story(records, curves, self.drawn, path)

    def errors(self, records: list[Record], folder: Path) -> dict[str, list[str]]:
        """Write the plots and return parts of the section: the story, the fastest within each error."""
        file = f"{self.study}-work-precision.png"
        self.story(records, folder / file)
        return {
            "error against run time": [
                figure(
                    file,
                    f"error of the {self.drawn} against run time and against unknowns, both axes logarithmic",
                    "Lower is more accurate, further left is faster, or smaller. Solid lines in blue and green are "
                    "isorod, dashed ones in warm colours and black dolfinx. Rings mark the fastest within each error "
                    "(dotted lines) that stays there on finer meshes.",
                )
            ],
            "the fastest within each error": [reach(records), LUCK],
        }

    def closing(self, records: list[Record]) -> dict[str, list[str]]:
        """Return the last part of the section: every run, the raw data and how to run it again."""
        work = part(records, "work")
        return {
            "every run, raw data, running it again": [
                rerun(self.study, records),
                fold(f"All {len(work)} runs", runs(work), *refused(records)),
            ]
        }
