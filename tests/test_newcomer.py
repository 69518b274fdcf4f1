"""The newcomer's table: examples written, run and compared, in rows that say what is not known."""

import pytest

pytest.importorskip("rich")

from comparisons import newcomer
from comparisons.measure.records import newest, part
from comparisons.measure.study import Run
from comparisons.report import newcomer as report
from isorod.command import new
from isorod.errors import InputError


@pytest.fixture
def study(tmp_path, monkeypatch):
    """Run the study of two examples, of which finite elements refuse one; runs and comparisons are made up."""
    monkeypatch.setattr(newcomer, "EXAMPLES", ("arc", "trefoil"))
    monkeypatch.setattr(newcomer, "PUBLISHED", ("spring",))
    monkeypatch.setattr(newcomer, "_seconds", lambda word: 1.25)

    def compared(word, level, folder):
        if "trefoil" in word:
            raise InputError("no mesh")
        made = Run("compare-arc", level, tmp_path)
        error = 1e-3 if "arc" in word else 0.01
        made.record("work", {"label": "default", "error": error, "errors": {"z": error}})
        made.record("end", {})
        return "compare-arc"

    monkeypatch.setattr(newcomer.compare, "main", compared)
    monkeypatch.setattr(newcomer.compared, "uncertainty", lambda records: 2e-3)
    run = Run("newcomer", "quick", tmp_path)
    newcomer.run(run)
    run.record("end", {})
    return tmp_path


def test_a_row_has_lines_error_and_seconds_or_why_there_is_none(study):
    head, _, *rows = (study / "newcomer.md").read_text().splitlines()
    assert head == "| example | lines of file | error at default settings | seconds of isorod run |"
    assert rows == [
        "| arc | 19 | 0.1 % (finite elements converged to 0.2 %) | 1.2 |",
        "| trefoil | 8 | no mesh | 1.2 |",
        "| spring |  | 1 % | 1.2 |",
    ]
    assert sorted(one.name for one in (study / "newcomer").iterdir()) == ["arc.toml", "trefoil.csv", "trefoil.toml"]


def test_the_page_counts_those_within_half_a_percent(study):
    records = newest(study, "newcomer")
    assert len(part(records, "example")) == 3
    assert report.summary(records) == [
        "newcomer: 1 of 3 scenes within 0.5 % with nothing chosen, as far as finite elements converged; "
        "not compared: trefoil"
    ]
    assert "no mesh" in "".join(report.section(records, study))


def test_all_examples_are_there():
    assert len(newcomer.EXAMPLES) == 10
    assert set(newcomer.EXAMPLES) < set(new.EXAMPLES)
