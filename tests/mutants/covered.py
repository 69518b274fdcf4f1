"""Which test runs which line, and for how long: the suite once, under coverage, in a copy of the tree."""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

from coverage import CoverageData

from tests.mutants import trees

SETTINGS = """[run]
source =
    {tree}/src/isorod
    {tree}/comparisons
data_file = {data}
parallel = true
core = ctrace
context = ${{MUTANTS_CONTEXT-}}
disable_warnings = no-data-collected, module-not-measured, module-not-imported
"""


@dataclass(frozen=True)
class Covered:
    """Tests with their time (seconds) and the fixtures they share, and for each line of a file the tests that run it."""

    seconds: dict[str, float]
    fixtures: dict[str, tuple[str, ...]]
    fixture_seconds: dict[str, float]
    lines: dict[str, dict[int, set[str]]]
    dropped: list[str]

    def tests(self, path: str, first: int, last: int) -> set[str]:
        """Return the tests that run any of these lines."""
        lines = self.lines.get(path, {})
        return set().union(*(lines.get(line, set()) for line in range(first, last + 1)))


def measure(tree: Path, folder: Path) -> None:
    """Run the suite in the tree, compiled beforehand, and leave the notes in the folder."""
    data = folder / "coverage"
    shutil.rmtree(data, ignore_errors=True)
    data.mkdir(parents=True)
    settings = folder / "coverage.ini"
    settings.write_text(SETTINGS.format(tree=tree, data=data / "data"))
    pytest = ["-m", "pytest", "-q", "-m", "not slow", "-p", "no:cacheprovider"]
    trees.run(tree, [*pytest, "--collect-only"], log=folder / "collect.log")
    trees.run(
        tree,
        [*pytest, "-p", "tests.mutants.plugin"],
        log=folder / "suite.log",
        MUTANTS_NOTES=str(folder / "notes.json"),
        COVERAGE_PROCESS_START=str(settings),
    )
    notes = json.loads((folder / "notes.json").read_text())
    notes["lines"] = _lines(tree, data)
    (folder / "map.json").write_text(json.dumps(notes))
    shutil.rmtree(data)


def _lines(tree: Path, folder: Path) -> dict[str, dict[int, list[str]]]:
    """Return file, line, contexts, of all processes that the suite consisted of."""
    found: dict[str, dict[int, set[str]]] = {}
    for part in folder.iterdir():
        data = CoverageData(str(part))
        data.read()
        for file in data.measured_files():
            lines = found.setdefault(str(Path(file).relative_to(tree)), {})
            for line, contexts in data.contexts_by_lineno(file).items():
                lines.setdefault(line, set()).update(contexts)
    return {path: {line: sorted(them) for line, them in lines.items()} for path, lines in found.items()}


def load(folder: Path) -> Covered:
    """Return what `measure` has left; tests that did not pass are dropped: no mutant can be caught by them."""
    notes = json.loads((folder / "map.json").read_text())
    tests = {name: note for name, note in notes["tests"].items() if note["passed"]}
    users: dict[str, set[str]] = {name: {name} for name in tests}
    for name, note in tests.items():
        for fixture in note["fixtures"]:
            users.setdefault(fixture, set()).add(name)
    lines = {
        path: {int(line): set().union(*(users.get(one, set()) for one in them)) for line, them in found.items()}
        for path, found in notes["lines"].items()
    }
    return Covered(
        seconds={name: note["seconds"] for name, note in tests.items()},
        fixtures={name: tuple(note["fixtures"]) for name, note in tests.items()},
        fixture_seconds=notes["fixtures"],
        lines=lines,
        dropped=sorted(set(notes["tests"]) - set(tests)),
    )
