"""Study ``scaling``: time and memory against size, ranks and kinds of functions; what a cluster could do with it."""

from collections.abc import Iterator
from typing import NamedTuple

from comparisons.measure import timing
from comparisons.measure.study import Run

# Coils of the wire: 1e3, 1e4, 1e5, 5e5, 3e6 unknowns of order 1.
SIZES = {"quick": (3, 30, 300), "full": (3, 30, 150, 300, 1500, 8333)}

# Coils up to which analyses other than statics, and other functions, are taken.
OTHERS = {"quick": 30, "full": 150}

# Analyses, coils, and numbers of ranks, where ranks are compared: two for time, more for the results alone.  Longer
# wires' modes are refused: rounding may make too much of them (`docs/limits.md`).
RANKS = {
    "quick": (("statics", 300, 2), ("modes", 300, 2), ("statics", 30, 4), ("modes", 30, 4)),
    "full": (
        *(("statics", coils, 2) for coils in (300, 1500)),
        ("modes", 300, 2),
        *((analysis, 150, 2) for analysis in ("implicit", "explicit")),
        *((analysis, 30, ranks) for ranks in (3, 4) for analysis in ("statics", "modes", "implicit", "explicit")),
    ),
}


class Case(NamedTuple):
    """One measurement of the wire: `comparisons.scaling.wire` with these arguments, on so many ranks."""

    analysis: str
    family: str
    coils: int
    ranks: int = 1

    @property
    def title(self) -> str:
        """A description in words."""
        on = f", {self.ranks} ranks" if self.ranks > 1 else ""
        return f"{self.analysis}, {self.family}, {self.coils} coils{on}"


def cases(level: str) -> Iterator[Case]:
    """Yield the cases, small to large."""
    for coils in SIZES[level]:
        yield Case("statics", "order-1", coils)
        if coils <= OTHERS[level]:
            yield from (Case(analysis, "order-1", coils) for analysis in ("modes", "implicit", "explicit"))
            yield from (Case("statics", family, coils) for family in ("order-2", "polynomials"))
    for analysis, coils, ranks in RANKS[level]:
        yield Case(analysis, "order-1", coils)
        yield Case(analysis, "order-1", coils, ranks)


def run(study: Run) -> None:
    """Measure each case in a process of its own and record it."""
    # Each once, though some are in several comparisons.
    chosen = list(dict.fromkeys(cases(study.level)))
    with study.progress(1 + len(chosen)) as steps:
        with steps.step("tangents beside DGEMM"):
            for family in timing.run("comparisons.scaling.roofline", [])["families"]:
                study.record("roofline", family)
        for case in chosen:
            with steps.step(case.title):
                arguments = [case.analysis, case.family, str(case.coils)]
                study.record("wire", timing.run("comparisons.scaling.wire", arguments, case.ranks, 7200.0))
