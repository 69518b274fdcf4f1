"""Study ``newcomer``: ten scenes written by ``isorod new``, run with nothing chosen, compared with finite elements."""

import io
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import redirect_stdout
from operator import itemgetter
from pathlib import Path
from time import perf_counter
from typing import Any

from comparisons import compare
from comparisons.measure import timing
from comparisons.measure.records import newest, part
from comparisons.measure.study import Run
from comparisons.measure.variants import DEFAULT
from comparisons.report import compare as compared
from comparisons.report.html import columns, markdown
from isorod.command import new
from isorod.errors import InputError, SolveError
from isorod.output.results import write_beside

EXAMPLES = ("arc", "coil", "taper", "wing", "trefoil", "press", "crossing", "cable", "muscle", "bar")

# Of the published ones the biceps has a comparison of its own.
PUBLISHED = ("spring", "blade")

FOLDER, TABLE = "newcomer", "newcomer.md"


def run(study: Run) -> None:
    """Write each example, run it, compare it, and record a row of the table; write that as Markdown too."""
    place = study.folder / FOLDER
    place.mkdir(exist_ok=True)
    rows = []
    for name in (*EXAMPLES, *PUBLISHED):
        word = name if name in PUBLISHED else str(_written(place, name))
        counted = None if name in PUBLISHED else lines(Path(word))
        row = {"name": name, "lines": counted, "seconds_run": _seconds(word)} | _compared(study, word)
        rows.append(study.record("example", row))
    write_beside(study.folder / TABLE, lambda where: where.write_text(markdown(*table(rows)) + "\n"))


def lines(path: Path) -> int:
    """Return how many lines of a file are neither empty nor comments."""
    return sum(bool(line.split("#")[0].strip()) for line in path.read_text().splitlines())


def table(rows: Iterable[Mapping[str, Any]]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return head and rows of the table: the finite elements' uncertainty stands beside errors below it."""

    def error(row: Mapping[str, Any]) -> str:
        if "failure" in row:
            return str(row["failure"])
        uncertainty = f" (finite elements converged to {100 * row['told']:.2g} %)" if row["error"] < row["told"] else ""
        return f"{100 * row['error']:.2g} %{uncertainty}"

    shown: dict[str, Callable[[Any], object]] = {
        "example": itemgetter("name"),
        "lines of file": itemgetter("lines"),
        "error at default settings": error,
        "seconds of isorod run": lambda row: f"{row['seconds_run']:.1f}",
    }
    return columns(rows, shown)


def _written(place: Path, name: str) -> Path:
    """Write an example and its data anew."""
    for old in place.glob(f"{name}.*"):
        old.unlink()
    path = place / f"{name}.toml"
    with redirect_stdout(io.StringIO()):
        new.main(str(path), name)
    return path


def _seconds(word: str) -> float:
    """Return how long the command takes, as a person waits for it."""
    start = perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "isorod", "run", word], capture_output=True, text=True, env=timing.environment()
    )
    if done.returncode:
        raise SolveError(f"isorod run {word}: {done.stderr.strip()}")
    return perf_counter() - start


def _compared(study: Run, word: str) -> dict[str, Any]:
    """Return the error of the default against finite elements, and their uncertainty; or why there is none."""
    try:
        name = compare.main(word, study.level, str(study.folder))
    except (InputError, SolveError) as problem:
        return {"failure": str(problem)}
    records = newest(study.folder, name)
    (default,) = (one for one in part(records, "work") if one.get("label") == DEFAULT)
    return {"error": default["error"], "errors": default["errors"], "told": compared.uncertainty(records)}
