"""Which test runs which line, and for how long: each test file once, under coverage, in a copy of the tree.

What is found is kept a file of tests, under a name that says of what it was found: a changed file of tests is measured
again by itself, changed code anew with all of them.
"""

import json
import shutil
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coverage import CoverageData

from isorod.output import results
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
PYTEST = ["-m", "pytest", "-q", "-m", "not slow", "-p", "no:cacheprovider"]
# pytest's exit codes: passed, failed, nothing to run (a file of slow tests)
USUAL = {0, 1, 5}


@dataclass(frozen=True)
class Covered:
    """Tests with their processor time (seconds) and shared fixtures; for each line of a file the tests that run it."""

    seconds: dict[str, float]
    fixtures: dict[str, tuple[str, ...]]
    fixture_seconds: dict[str, float]
    lines: dict[str, dict[int, set[str]]]
    dropped: list[str]

    def tests(self, path: str, first: int, last: int) -> set[str]:
        """Return the tests that run any of these lines."""
        lines = self.lines.get(path, {})
        return set().union(*(lines.get(line, set()) for line in range(first, last + 1)))


def measure(root: Path, tree: Path, folder: Path, jobs: int) -> Covered:
    """Measure what has changed since the last time, in the tree, and return what is known of all."""
    folder.mkdir(parents=True, exist_ok=True)
    parts = {file: folder / f"{Path(file).stem}-{trees.digest(root, [file])}.json" for file in trees.test_files(root)}
    for old in set(folder.glob("*.json")) - set(parts.values()):
        old.unlink()
        old.with_suffix(".log").unlink(missing_ok=True)
    todo = [file for file, part in parts.items() if not part.exists()]
    if todo:
        print(f"measuring which test runs which line: {len(todo)} of {len(parts)} files of tests", flush=True)
        trees.run(tree, [*PYTEST, "--collect-only", *todo], log=folder / "collect.log")  # compiles
    with ThreadPoolExecutor(jobs) as pool:
        for file in pool.map(lambda file: _measure(tree, file, parts[file]), todo):
            print(f"    {file}", flush=True)
    return _joined([json.loads(part.read_text()) for part in parts.values()])


def _measure(tree: Path, file: str, part: Path) -> str:
    data, notes, settings = part.with_suffix(".data"), part.with_suffix(".notes"), part.with_suffix(".ini")
    shutil.rmtree(data, ignore_errors=True)
    data.mkdir()
    settings.write_text(SETTINGS.format(tree=tree, data=data / "data"))
    told = {"MUTANTS_NOTES": str(notes), "COVERAGE_PROCESS_START": str(settings)}
    code = trees.run(tree, [*PYTEST, "-p", "tests.mutants.plugin", file], log=part.with_suffix(".log"), **told)
    if code not in USUAL:
        raise RuntimeError(f"{file}: pytest ended with {code}; see {part.with_suffix('.log')}")
    found = json.loads(notes.read_text()) | {"lines": _lines(tree, data)}
    results.write_beside(part, lambda path: path.write_text(json.dumps(found)))
    shutil.rmtree(data)
    notes.unlink()
    settings.unlink()
    return file


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


def _joined(parts: Iterable[dict[str, Any]]) -> Covered:
    """Put the files of tests together; tests that did not pass are dropped: no mutant can be caught by them."""
    it = Covered({}, {}, {}, {}, [])
    for part in parts:
        passed = {name: note for name, note in part["tests"].items() if note["passed"]}
        it.dropped.extend(sorted(set(part["tests"]) - set(passed)))
        it.fixture_seconds.update(part["fixtures"])
        users: dict[str, set[str]] = {name: {name} for name in passed}
        for name, note in passed.items():
            it.seconds[name], it.fixtures[name] = note["seconds"], tuple(note["fixtures"])
            for fixture in note["fixtures"]:
                users.setdefault(fixture, set()).add(name)
        for path, lines in part["lines"].items():
            known = it.lines.setdefault(path, {})
            for line, contexts in lines.items():
                known.setdefault(int(line), set()).update(*(users.get(one, ()) for one in contexts))
    return it
