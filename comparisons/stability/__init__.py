"""Study ``stability``: how far the element and the solvers hold, swept to where they fail; one file a case.

A case is a module of this package, listed in `CASES`, with

- ``TITLE``, one line;
- ``run(level)``, an iterator of records, one a point of a sweep (`comparisons.stability.point`);
- ``COLUMNS`` where its tables show more than a point has at least: heading by key of the records,
  and ``LIMITS(records)`` where sentences other than `comparisons.stability.point.limits` state the limits.
"""

from collections.abc import Sequence
from importlib import import_module
from typing import Any

from comparisons.measure.study import Run
from comparisons.stability.point import limits
from isorod import options

CASES = ("incompressible", "slender", "large", "contrast", "sections", "stepping", "stresses")


def find(name: str) -> Any:
    """Return the module of a case."""
    return import_module(f"{__name__}.{name}")


def run(study: Run, names: Sequence[str] = ()) -> None:
    """Run the cases (all where none is named) and append their records."""
    options.initialize([])
    chosen = names or CASES
    with study.progress(len(chosen)) as steps:
        for name in chosen:
            case = find(name)
            with steps.step(case.TITLE):
                records = [study.record("point", {"case": name} | record) for record in case.run(study.level)]
            stated = getattr(case, "LIMITS", limits)(records)
            study.record("case", {"case": name, "title": case.TITLE, "limits": stated})
