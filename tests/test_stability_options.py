"""The lines of solver options that the stability study tries: which agree, which fail, and which it recommends."""

import re

import numpy as np
import pytest

from comparisons.stability import point, tuning


@pytest.fixture(scope="module")
def records():
    """The points at quick level, run once."""
    with pytest.MonkeyPatch.context() as patch:
        # Whether a line is right does not depend on how busy this machine is.
        patch.setitem(tuning.TIME_LIMIT, "quick", 300.0)
        return list(tuning.run("quick"))


@pytest.mark.slow
def test_lines_of_options_agree_with_the_default(records):
    sweeps = point.sweeps(records)
    for case, lines in tuning.CASES["quick"].items():
        (curve,) = sweeps[case].values()
        assert [record["value"] for record in curve] == list(lines)
        for record in curve:
            assert "failure" not in record, record
            assert record["error"] <= tuning.TOLERANCE
            assert record["milliseconds"] > 0.0


SMALL = "spring --preset paper --no-estimate --coils 1 --elements-per-turn 4 --section-points 4"


def tuned(lines, monkeypatch, limit=300.0):
    """Return the points of the small spring with lines of options by name."""
    monkeypatch.setitem(tuning.CASES, "quick", {SMALL: lines})
    monkeypatch.setitem(tuning.TIME_LIMIT, "quick", limit)
    return list(tuning.run("quick"))


def test_a_line_that_fails_is_recorded_with_its_exit_code_and_not_recommended(monkeypatch):
    default, typo = tuned({tuning.DEFAULT: "", "typo": "-pc_type nope"}, monkeypatch)
    assert (default["error"], default["tolerance"]) == (0.0, 1e-6)
    assert default["warm"] is False
    assert (typo["code"], typo["said"]) == (2, 1)
    assert "nope" in typo["failure"]
    (said,) = tuning.LIMITS([default, typo])
    assert f"recommended `isorod run {SMALL}`" in said
    assert "1 of 2 lines give the same to 1e-06, not: typo." in said


def test_a_line_that_is_wrong_does_not_hold(monkeypatch):
    answers = {SMALL: [2.0, 4.0], f"{SMALL} -a": [2.0, 4.0 + 4.1e-6], f"{SMALL} -b": [2.0, 4.0 - 3.9e-6]}

    def command(line, limit, warm):
        return {"values": np.array(answers[line]), "milliseconds": 1.0, "warm": False}

    monkeypatch.setattr(tuning, "_command", command)
    default, wrong, right = tuned({tuning.DEFAULT: "", "a": "-a", "b": "-b"}, monkeypatch)
    assert wrong["error"] == pytest.approx(1.025e-6)
    assert [point.holds(one) for one in (default, wrong, right)] == [True, False, True]


def test_a_line_that_works_is_timed_once_more_warm(monkeypatch):
    monkeypatch.setitem(tuning.WARM, "quick", 1)
    cholesky = {"Cholesky, PETSc": tuning.DIRECT["Cholesky, PETSc"]}
    default, other = tuned({tuning.DEFAULT: "", **cholesky}, monkeypatch)
    assert [one.get("failure") for one in (default, other)] == [None, None]
    assert default["warm"] and other["warm"]
    assert default["processor"] > 0.0 and other["processor"] > 0.0
    assert other["error"] <= tuning.TOLERANCE


def test_a_line_that_takes_too_long_is_given_up(monkeypatch):
    (late,) = tuned({tuning.DEFAULT: ""}, monkeypatch, limit=0.01)
    assert (late["failure"], late["code"]) == ("no result within 0.01 s", None)
    assert tuning.LIMITS([late]) == [f"{SMALL}: nothing holds."]


def test_the_default_is_recommended_unless_a_warm_line_is_clearly_faster():
    def lines(milliseconds, warm):
        return [
            {"sweep": "case", "value": name, "line": f"case {name}", "error": 0.0, "tolerance": 1e-6, "seconds": 1.0}
            | {"milliseconds": time, "warm": warm}
            for name, time in zip(("default", "other"), milliseconds, strict=True)
        ]

    for milliseconds, warm, picked in (
        ((100.0, 80.0), True, "other"),
        ((100.0, 95.0), True, "default"),
        ((100.0, 50.0), False, "default"),
        # Too long for the first run's extra to matter.
        ((20_000.0, 9_000.0), False, "other"),
    ):
        (said,) = tuning.LIMITS(lines(milliseconds, warm))
        assert f"recommended `isorod run case {picked}`" in said


@pytest.mark.slow
def test_each_case_recommends_a_line_that_was_run(records):
    lines = tuning.LIMITS(records)
    assert len(lines) == len(tuning.CASES["quick"])
    for text in lines:
        (line,) = re.findall(r"`isorod run (.+?)`", text)
        assert line in {record["line"] for record in records if point.holds(record)}
