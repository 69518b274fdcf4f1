"""One mutant tried: the tests that can notice it, quickest first, in a fresh copy of the tree, until one fails."""

import json
import shutil
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from tests.mutants import trees
from tests.mutants.covered import Covered
from tests.mutants.population import Mutant
from tests.mutants.reach import Reach

# Limit of a test's processor time: so many times what it took when all was right, and some for what is compiled in it
# (seconds). And, for one that waits for ever, of the wall time of all tests of a mutant.
SLOWER = 5.0
ALLOWANCE = 60.0
COMPILING = 1800.0
WAITING = 1800.0
# pytest's exit codes: all passed; nothing to run
HARMLESS = {0, 5}
# ended from outside, which says nothing of the mutant
STOPPED = {-signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT}


@dataclass(frozen=True)
class Outcome:
    """``how``: caught, timeout, survived, or unreached (no test runs the line); by which test; of how many, run for."""

    how: str
    by: str
    tests: int
    left_out: int
    seconds: float


def order(covered: Covered, tests: set[str], budget: float, first: str) -> list[tuple[str, int]]:
    """Return the tests to run and their time limits, quickest first until the budget (seconds) is spent.

    Tests that share fixtures which take long stand together. ``first`` goes ahead: it caught this mutant before.
    """
    # Not what all tests need: they would be one group, which no budget has room for.
    everywhere = frozenset.intersection(*map(frozenset, covered.fixtures.values()))
    slow = {name for name, seconds in covered.fixture_seconds.items() if seconds > 0.5} - everywhere
    groups: dict[tuple[str, ...], list[str]] = {}
    for test in sorted(tests, key=lambda test: (test != first, covered.seconds[test], test)):
        shared = tuple(name for name in covered.fixtures[test] if name in slow)
        groups.setdefault(shared or (test,), []).append(test)
    setup = {key: sum(covered.fixture_seconds.get(name, 0.0) for name in key) for key in groups}
    costs = {key: setup[key] + sum(covered.seconds[test] for test in group) for key, group in groups.items()}
    chosen: list[tuple[str, int]] = []
    spent = 0.0
    for key in sorted(groups, key=lambda key: (first not in groups[key], costs[key])):
        spent += setup[key]
        for test in groups[key]:
            spent += covered.seconds[test]
            if chosen and spent > budget:
                return chosen
            chosen.append((test, int(ALLOWANCE + SLOWER * (setup[key] + covered.seconds[test]))))
    return chosen


def run(mutant: Mutant, place: Path, tree: Path, reach: Reach, budget: float, first: str) -> Outcome:
    """Try the mutant in a copy of the measured tree, made at ``place``."""
    start = time.perf_counter()
    able = reach.tests(mutant.path, mutant.line)
    tests = order(reach.covered, able, budget, first)
    if not tests:
        return Outcome("unreached", "", 0, 0, 0.0)
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(tree, place, symlinks=True)
    (place / mutant.path).write_text(mutant.code)
    compiled = trees.forget_compiled(place, mutant.path) if reach.inlined(mutant.path, mutant.line) else []
    if compiled:  # before the tests, whose time limits are not made for it
        trees.run(place, ["-c", f"import {', '.join(compiled)}"], COMPILING)
    listed, at = place.with_suffix(".order"), place.with_suffix(".at")
    listed.write_text(json.dumps(tests))
    at.unlink(missing_ok=True)
    files = sorted({test.partition("::")[0] for test, _ in tests})
    pytest = ["-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-p", "tests.mutants.plugin", *files]
    code = trees.run(place, pytest, WAITING, place.with_suffix(".log"), MUTANTS_ORDER=str(listed))
    if code in STOPPED or not at.exists():
        raise RuntimeError(f"{mutant.path}:{mutant.line}: the tests ended with {code}; see {place.with_suffix('.log')}")
    how = "survived" if code in HARMLESS else "timeout" if code in {None, -signal.SIGPROF} else "caught"
    by = "" if how == "survived" else at.read_text()
    return Outcome(how, by, len(tests), len(able) - len(tests), time.perf_counter() - start)
