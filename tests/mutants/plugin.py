"""What the mutation test asks of pytest: to note which test runs what and how long, or to run a few in a given order.

Loaded with ``-p tests.mutants.plugin``. With MUTANTS_NOTES set to a file it takes notes, under coverage; with
MUTANTS_ORDER, a file that lists tests and their time limits, it runs those and writes beside it how far it came.
"""

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import coverage
import pytest

# what is running, for coverage in the processes that a test starts
CONTEXT = "MUTANTS_CONTEXT"
# seconds of processor time that importing all test files may take
COLLECTION = 300


def pytest_configure(config: pytest.Config) -> None:
    if notes := os.environ.get("MUTANTS_NOTES"):
        config.pluginmanager.register(_Notes(Path(notes)))
    if order := os.environ.get("MUTANTS_ORDER"):
        config.pluginmanager.register(_Order(Path(order)))


class _Notes:
    """Each test, and each fixture that several share, is a context of coverage of its own."""

    def __init__(self, path: Path):
        self._path = path
        self._tests: dict[str, dict] = {}
        self._fixtures: dict[str, float] = {}

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        # a result that an earlier test left in a cache of the test file would hide what this one needs
        for value in vars(item.module).values():
            if hasattr(value, "cache_clear"):
                value.cache_clear()
        found = item._fixtureinfo.name2fixturedefs.values()
        shared = sorted({_name(one) for several in found for one in several if one.scope != "function"})
        before, start = sum(self._fixtures.values()), _used()
        _switch(item.nodeid)
        self._tests[item.nodeid] = note = {"fixtures": shared, "passed": True}
        done = yield
        _switch("")
        note["seconds"] = _used() - start - (sum(self._fixtures.values()) - before)
        return done

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef, request: pytest.FixtureRequest) -> Iterator[None]:
        if fixturedef.scope == "function":
            return (yield)
        outer, start, name = os.environ[CONTEXT], _used(), _name(fixturedef)
        _switch(name)
        try:
            return (yield)
        finally:
            _switch(outer)
            self._fixtures[name] = max(_used() - start, self._fixtures.get(name, 0.0))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if not report.passed:
            self._tests[report.nodeid]["passed"] = False

    def pytest_sessionfinish(self) -> None:
        self._path.write_text(json.dumps({"tests": self._tests, "fixtures": self._fixtures}))


def _used() -> float:
    """Return the processor time so far, seconds, with that of processes that have ended: other load does not matter."""
    return sum(os.times()[:4])


def _name(fixture: pytest.FixtureDef) -> str:
    return f"fixture {fixture.baseid}::{fixture.argname}"


def _switch(context: str) -> None:
    os.environ[CONTEXT] = context
    measured = coverage.Coverage.current()
    assert measured is not None
    measured.switch_context(context)


class _Order:
    """Run the tests listed, in their order; those that are gone are passed over.

    A test that takes longer than it is given ends the whole process, by a signal that stops compiled code as well.
    """

    def __init__(self, path: Path):
        listed = json.loads(path.read_text())
        self._limits = {test: limit for test, limit in listed}
        self._places = {test: place for place, (test, _) in enumerate(listed)}
        self._at = path.with_suffix(".at")
        self._at.write_text("collection")
        self._failed = False
        _limit(COLLECTION)

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = [item for item in items if item.nodeid in self._places]
        items.sort(key=lambda item: self._places[item.nodeid])

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._at.write_text(nodeid)
        _limit(self._limits[nodeid])

    def pytest_runtest_logfinish(self) -> None:
        _limit(0)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed and not self._failed:
            self._failed = True
            self._at.write_text(f"import of {report.nodeid}")


def _limit(seconds: int) -> None:
    signal.setitimer(signal.ITIMER_PROF, seconds)
