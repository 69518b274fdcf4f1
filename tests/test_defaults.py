"""The stability study's points with nothing chosen by hand: how they are made, counted, and what comes out of some."""

import warnings

import pytest

from comparisons.stability import contrast, defaults, point, sections, slender
from isorod.space import Space


def records(monkeypatch, case, sweeps):
    """Return the points of some sweeps of one case."""
    monkeypatch.setattr(defaults, "CASES", (case,))
    monkeypatch.setattr(defaults, "LEFT_OUT", ())
    kept = case.run

    def run(level):
        yield from (one for one in kept(level) if one)

    monkeypatch.setattr(case, "run", run)
    found = []
    for record in defaults.run("quick"):
        if not any(record["sweep"].endswith(sweep) for sweep in sweeps):
            break
        found.append(record)
    return found


def test_slender_rods_are_right_without_a_choice(monkeypatch):
    found = records(monkeypatch, slender, ["P L^2 / EI = 1"])
    assert [record["value"] for record in found] == [10.0, 1e3, 1e5]
    assert {record["outcome"] for record in found} == {"right"}
    assert all("degree 5" in record["space"] for record in found)
    assert max(record["error"] for record in found) < 1e-4


def test_the_estimate_of_a_stiffness_that_is_exact_vanishes(monkeypatch):
    """Saint-Venant's torsion: supports hold two components of a face that is free to warp."""
    monkeypatch.setattr(sections, "RATIOS", (10.0,))
    (found,) = records(monkeypatch, sections, ["torsion constant"])
    assert found["outcome"] == "right"
    assert max(found["error"], found["estimate"]) < 1e-9


def test_a_jump_of_stiffness_without_a_knot_is_told_of(monkeypatch):
    monkeypatch.setattr(contrast, "run", lambda level: contrast_points())
    monkeypatch.setattr(defaults, "CASES", (contrast,))
    found = list(defaults.run("quick"))
    assert [record["value"] for record in found] == [100.0]
    assert found[0]["outcome"] == "told of"
    assert "use continuity 0" in found[0]["warned"]


def contrast_points():
    """Yield one point twice: it is measured once."""
    for series in ("one", "other"):
        yield from contrast.KNOT.over([100.0], contrast._smooth, series=series)


def test_outcomes():
    def outcome(**found):
        return defaults.outcome(found)

    assert outcome(failure="no") == "refused"
    assert outcome(error=4e-3) == "right"
    assert outcome(error=6e-3, estimate=2.1e-3) == outcome(error=1.0, warned="no") == "told of"
    assert outcome(error=6e-3, estimate=1.9e-3) == outcome(error=1.0) == "wrong in silence"
    said = defaults.LIMITS([{"outcome": "right"}, {"outcome": "right"}, {"outcome": "told of"}])
    assert said[0].startswith("3 points, within 0.5 %: 2 right, 1 told of, 0 refused, 0 wrong in silence.")


def test_what_a_case_chooses_is_its_own_again_afterwards(monkeypatch):
    monkeypatch.setattr(slender, "run", lambda level: iter(()))
    monkeypatch.setattr(defaults, "CASES", (slender,))
    measure = point.measure
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert list(defaults.run("quick")) == []
    assert slender.Space is Space
    assert point.measure is measure


@pytest.mark.parametrize(("given", "kept"), [({"elements": 6}, False), ({"elements": 6, "degree": 5}, True)])
def test_references_stay(given, kept):
    rod = slender.straight(4.0).sweep(slender.circle(8))
    assert (defaults.Bare.paper(rod, **given).elements == 6) is kept
