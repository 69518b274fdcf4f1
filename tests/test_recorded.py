"""The one table of run times beside other programs: made of the runs that are kept, and nowhere else on a page."""

import json
import re
from pathlib import Path

import pytest

pytest.importorskip("rich")

from comparisons.bench import recorded
from comparisons.measure.study import Run
from comparisons.measure.work import AS_RUN
from comparisons.report.bench import BY_HAND
from isorod.errors import InputError
from isorod.space.basis import FAMILIES, PAPER, POLYNOMIALS

ROOT = Path(__file__).parent.parent
SHARE = re.compile(r"\b1/\d+\b")


def cells(text):
    """Return the cells of a table's rows, without its head."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def side(seconds, program="isorod", how=BY_HAND, family=PAPER):
    found = {"program": program, "seconds": seconds, "bare": 0.5 * seconds, "unknowns": 1000}
    return found | ({"how": how, "family": family} if program == "isorod" else {})


def kept(load, *sides, target=1e-2):
    machine = {"processor": "abacus", "cores": 4, "system": "Linux"}
    head = {"time": "2026-01-02T03:04:05+00:00", "commit": "abc", "machine": machine, "command": "make bench"}
    return head | {"load": load, "rows": [{"scene": "spring", "target": target, "runs": list(sides)}]}


def test_the_page_has_the_table_of_the_kept_runs():
    page = recorded.PAGE.read_text()
    inside = page.split(recorded.BEGIN)[1].split(recorded.END)[0].strip()
    assert inside == recorded.table(recorded.kept())
    rows = cells(inside)
    assert {row[2] for row in rows} <= set(FAMILIES)
    # With nothing chosen it stands below what was chosen by hand, for the same scene and error.
    assert {row[1] for row in rows} == {BY_HAND, AS_RUN.label}


def test_no_other_page_tells_a_share_of_the_time_of_dolfinx():
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    for page in pages:
        text = page.read_text()
        if page == recorded.PAGE:
            text = text.split(recorded.BEGIN)[0] + text.split(recorded.END)[1]
        for paragraph in re.split(r"\n\s*\n", text):
            assert not ("dolfinx" in paragraph and SHARE.search(paragraph)), f"{page}: {paragraph}"


def test_a_row_is_of_the_newest_quiet_run_and_its_spread_of_all_of_them():
    ours, dolfinx = side(0.1), side(1.0, "dolfinx 1")
    runs = [
        kept(None, ours, side(0.5, "dolfinx 1"), side(2.0, "dolfinx 2")),
        kept(0.1, ours, dolfinx, side(0.8, "NGSolve 6")),
        kept(recorded.BUSY, ours, side(9.0, "dolfinx 1"), side(0.4, how=AS_RUN.label, family=POLYNOMIALS)),
        # Without dolfinx there is nothing to tell.
        kept(0.0, ours, side(0.8, "NGSolve 6")),
    ]
    tuned, plain = cells(recorded.table(runs))
    assert tuned == [
        *("spring, force, 1 %", BY_HAND, PAPER, "100 (50), 1,000", "dolfinx 1: 1,000 (500), 1,000", "**1/10**"),
        *("1/5 to 1/10 (2)", "NGSolve 6: 800 (400), 1,000: 1/8", "2"),
    ]
    assert plain[1:] == [
        *(AS_RUN.label, POLYNOMIALS, "400 (200), 1,000", "dolfinx 1: 9,000 (4,500), 1,000", "**1/22**", "1/22 (1)"),
        *("", "3, busy"),
    ]
    told = recorded.table(runs).splitlines()
    assert told[-4] == "1. 2026-01-02, commit abc, make bench; abacus, 4 cores."
    assert told[-2].endswith("the machine did other things (load 0.5): to be measured again.")
    slow = cells(recorded.table([kept(0.0, side(2.0, how=AS_RUN.label), dolfinx)]))
    assert slow[0][5:7] == ["**2.0 times**", "2.0 times (1)"]


def test_an_error_that_nothing_chosen_does_not_reach_is_told():
    plain = side(0.4, how=AS_RUN.label, family=POLYNOMIALS) | {"error": 2e-3}
    run = kept(0.0, side(0.1), plain, side(1.0, "dolfinx 1"))
    run["rows"] += kept(0.0, side(0.2), side(2.0, "dolfinx 1"), target=1e-3)["rows"]
    rows = cells(recorded.table([run]))
    assert [row[:4] for row in rows[2:]] == [
        ["spring, force, 0.1 %", BY_HAND, PAPER, "200 (100), 1,000"],
        ["spring, force, 0.1 %", AS_RUN.label, POLYNOMIALS, "not reached: 0.2 %, 1,000"],
    ]


def confirmed(run, method, seconds, arguments, family=PAPER):
    parts = {"total": seconds, "check": 0.1 * seconds, "processor": seconds} | (
        {"estimate": 0.4 * seconds} if arguments in AS_RUN.arguments else {}
    )
    found = {"scene": "spring", "method": method, "arguments": arguments, "seconds": parts, "target": 1e-2}
    found |= {"versions": {"dolfinx": "1"}, "discretisation": [{"family": family}], "dofs": 300, "error": 1e-3}
    run.record("confirm", found | {"holds": True, "curve": "c", "finer": []})


def test_the_newest_run_is_kept_once_and_its_table_is_written(tmp_path, monkeypatch, capsys):
    page, file = tmp_path / "page.md", tmp_path / "recorded.jsonl"
    page.write_text(f"before\n{recorded.BEGIN}\nold\n{recorded.END}\nafter\n")
    file.write_text("")
    monkeypatch.setattr(recorded, "PAGE", page)
    monkeypatch.setattr(recorded, "FILE", file)
    monkeypatch.setattr(recorded, "draw", lambda records: None)
    run = Run("bench", "quick", tmp_path)
    run.record("opponents", {"here": [], "absent": {}, "load": 0.0})
    confirmed(run, "cylindrical", 0.01, "--order 1")
    confirmed(run, "cylindrical", 0.2, AS_RUN.arguments[0], POLYNOMIALS)
    confirmed(run, "fem", 0.05, "--degree 2")
    run.record("end", {})
    for _ in range(2):
        assert recorded.main(["--add", str(tmp_path)]) == 0
    assert len(file.read_text().splitlines()) == 1
    (one,) = map(json.loads, file.read_text().splitlines())
    assert one["machine"]["cores"] > 0 and one["level"] == "quick"
    tuned, plain = cells(page.read_text())
    assert tuned[1:6] == [BY_HAND, PAPER, "10 (9.0), 300", "dolfinx 1: 50 (45), 300", "**1/5**"]
    # Neither its check nor its estimate counts in brackets.
    assert plain[1:6] == [AS_RUN.label, POLYNOMIALS, "200 (100), 300", "dolfinx 1: 50 (45), 300", "**4.0 times**"]
    assert page.read_text().startswith("before\n") and page.read_text().endswith("\nafter\n")
    assert "4.0 times" in capsys.readouterr().out
    assert recorded.main(["--add", str(tmp_path / "none")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("comparisons.bench.recorded: results")
    page.write_text("no place")
    with pytest.raises(InputError, match="it has no table of run times"):
        recorded.write(page, [])
