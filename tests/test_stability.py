"""The stability study at quick level: the limits it claims, and that every failure is one line with exit code 2."""

import re
import warnings
from typing import ClassVar

import numpy as np
import pytest

from comparisons import stability
from comparisons.__main__ import main
from comparisons.measure.records import newest, part
from comparisons.measure.study import Run
from comparisons.report import html
from comparisons.report import stability as report_stability
from comparisons.stability import contrast, point, sections, slender
from comparisons.stability.rods import stiffness
from isorod import modal, statics
from isorod.errors import InputError
from isorod.geometry.center_line import straight
from isorod.geometry.section import circle, ellipse
from isorod.material import LinearElastic, NeoHookean
from isorod.model import Body, Model, Support
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring
from isorod.space import Space


@pytest.fixture(scope="module")
def points():
    """The points that a function of a case yields at quick level, by sweep and series; each runs once."""
    found = {}

    def get(run):
        if run not in found:
            found[run] = list(run("quick"))
        return point.sweeps(found[run])

    return get


def one(points, value):
    """Return the point of a curve at a value."""
    (found,) = (record for record in points if record["value"] == value)
    return found


# --- the framework


def test_a_failure_becomes_a_record_and_a_defect_does_not():
    def refuse():
        raise InputError("no")

    def crash():
        raise ZeroDivisionError

    sweep = point.Sweep("x", "y", 0.1)
    found = sweep.point(1.0, refuse)
    assert found["failure"] == "no"
    assert "error" not in found
    assert not point.holds(found)
    with pytest.raises(ZeroDivisionError):
        sweep.point(1.0, crash)


def test_reach_ends_where_the_first_point_fails():
    records = [{"value": v, "error": e, "tolerance": 0.1} for v, e in ((1, 0.0), (2, 0.1), (3, 0.2), (4, 0.0))]
    assert point.reach(records) == 2
    assert point.reach(records[2:]) is None
    assert not point.holds({"error": np.nan, "tolerance": 0.1})


def test_limits_say_how_far_each_series_holds():
    sweep = point.Sweep("x", "y", 0.1)
    rows = [(1.0, 1e-3), (2.0, 0.05), (3.0, 0.5)]
    found = [sweep.point(value, lambda error=error: {"error": error}, series="a") for value, error in rows]
    found += [{"sweep": "x", "series": "b", "value": 1.0, "failure": "no", "tolerance": 0.1}]
    (line,) = point.limits(found)
    assert line == "x, error within 0.1: a up to 2 (largest error 0.5); b nowhere (1 refused)."


def test_the_page_shows_limits_tables_and_failures(tmp_path, monkeypatch):
    class Made:
        TITLE = "made up"
        COLUMNS: ClassVar = {"newton": "iterations"}

        @staticmethod
        def LIMITS(records):
            return [f"{len(records)} points: holds up to 2 < 3"]

        @staticmethod
        def run(level):
            yield {"sweep": "s", "value": 1.0, "error": 1e-3, "newton": 4, "tolerance": 0.1, "seconds": 0.1}
            yield {"sweep": "s", "value": 2.0, "error": 0.5, "newton": 5, "tolerance": 0.1, "seconds": 0.1}
            yield {"sweep": "s", "value": 3.0, "failure": "a < b", "tolerance": 0.1, "seconds": 0.1}

    monkeypatch.setattr(stability, "find", lambda name: Made)
    study = Run("stability", "quick", tmp_path)
    stability.run(study, ["contrast"])
    study.record("end", {})
    records = newest(tmp_path, "stability")
    page = "\n".join(report_stability.section(records, tmp_path))
    assert "3 points: holds up to 2 &lt; 3" in page
    assert "a &lt; b" in page
    assert "outside tolerance" in page
    assert (tmp_path / "stability-contrast.png").stat().st_size > 10_000
    assert report_stability.summary(records) == [
        "stability: 1 cases, 3 points: 1 hold, 1 refused with one line, 1 outside their tolerance"
    ]
    assert len(part(records, "point")) == 3
    assert main(["stability", "--level", "quick", "--case", "contrast", "--results", str(tmp_path / "other")]) == 0
    assert len(part(newest(tmp_path / "other", "stability"), "case")) == 1
    assert html.table(("a",), [("<",)]).count("&lt;") == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["spring", "--case", "large"], "--case large: only the study stability has cases"),
        (["stability", "--case", "larger"], "invalid choice: 'larger' (choose from"),
    ],
)
def test_a_case_that_is_not_there_is_one_line(arguments, said, capsys, tmp_path):
    assert main([*arguments, "--results", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_every_case_there_is_has_what_the_study_needs():
    for name in stability.CASES:
        case = stability.find(name)
        assert case.TITLE
        assert callable(case.run)


@pytest.mark.slow
@pytest.mark.parametrize("run", [contrast.at_rest, sections.run], ids=["contrast", "sections"])
def test_failures_are_one_line(run, points):
    failures = [
        record["failure"]
        for curves in points(run).values()
        for curve in curves.values()
        for record in curve
        if "failure" in record
    ]
    assert len(failures) > 5
    assert all(text and "\n" not in text for text in failures)


@pytest.mark.parametrize("length", [10.0, 1e3, 1e5])
def test_slender_rods_are_right_without_a_choice(length):
    space = Space(straight(length).sweep(circle(4)))
    tip, found = slender.solve(space, length, 1.0)
    assert "degree 5" in str(space)
    assert tip == pytest.approx(slender.reference(length, 1.0), rel=1e-4)
    assert found.estimate() < 5e-3


# --- stiffness and density contrast


def test_bars_in_series_are_exact_in_the_linear_limit():
    assert contrast.force_in_series(3.0, 5.0, 2.0, 4.0, 1e-9) == pytest.approx(1e-9 / (2 / 3 + 4 / 5), rel=1e-8)


def test_longitudinal_modes_of_one_material_are_those_of_the_uniform_bar():
    exact = (2 * np.arange(4) + 1) / (4 * 10.0) * np.sqrt(2.0 / 3.0)
    assert contrast.longitudinal((2.0, 2.0), (3.0, 3.0), (4.0, 6.0), 4) == pytest.approx(exact, rel=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["banded LU (default)", "Cholesky, MUMPS", "CG + ICC"])
def test_stretched_rod_holds_to_a_contrast_of_1e8(solver, points):
    curve = points(contrast.at_rest)[contrast.STRETCHED.name][solver]
    assert point.reach(curve) >= 1e8
    # Double precision gives up at contrast * 1e-15, never silently.
    for record in curve:
        if record["value"] >= 1e11:
            assert "do not balance" in record["failure"]
        else:
            assert record["error"] < max(1e-14 * record["value"], 1e-9)
            assert record["soft_end"] < 1e-12


@pytest.mark.slow
def test_multigrid_holds_or_says_that_it_does_not(points):
    """How far depends on PETSc: with 3.18 it fails from some contrast on, with 3.25 it does not."""
    curve = points(contrast.at_rest)[contrast.STRETCHED.name]["CG + GAMG"]
    assert point.reach(curve) >= 1e2
    assert max(record["error"] for record in curve if "error" in record) < 1e-6
    failures = [record["failure"] for record in curve if "failure" in record]
    assert failures or point.reach(curve) == max(record["value"] for record in curve)
    assert all("linear solver failed" in text for text in failures)


@pytest.mark.slow
def test_bent_rod_tends_to_the_muscle_held_by_a_wall(points):
    (curve,) = points(contrast.at_rest)[contrast.BENT.name].values()
    assert point.reach(curve) >= 1e8
    for value in (1e4, 1e6):
        assert one(curve, value)["rigid_limit"] < 10.0 / value
    assert one(curve, 1e8)["rigid_limit"] < 1e-4


def test_modes_follow_the_transcendental_equation(points):
    curves = points(contrast.swinging)[contrast.MODES.name]
    for series in ("stiff half fixed", "heavy half fixed", "heavy half free"):
        assert point.reach(curves[series]) >= 1e16
    assert point.reach(curves["stiff half free"]) >= 1e8
    for record in curves["stiff half free"]:
        if record["value"] > 1e10:
            # Which of the checks is the first to see it is a matter of rounding.
            assert re.search(r"the residual of mode \d+ is|eigenvalues lie at or below", record["failure"])
        else:
            assert "failure" in record or record["error"] < 1e-5


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_motion_errs_by_its_steps_and_its_mass_not_by_the_contrast(integrator, points):
    curves = points(contrast.swinging)[contrast.MOTION[integrator].name]
    assert len(curves) == 4
    for curve in curves.values():
        assert point.reach(curve) == 1e4
        assert max(record["error"] for record in curve) < 5e-5


def test_a_joint_without_a_knot_is_warned_of():
    space = Space.paper(straight(breaks=[0.0, 4.0, 10.0], degree=3).sweep(circle(8)), elements=2)
    laws = [NeoHookean(100.0, 0.0), NeoHookean(1.0, 0.0)]
    for either in (laws, laws[::-1]):
        with pytest.warns(UserWarning, match="stiffness jumps by 100 at u = 4"):
            Body(space, either)
    three = Space.paper(straight(breaks=[0.0, 4.0, 10.0, 12.0], degree=3).sweep(circle(8)), elements=3)
    for moduli, place in (([1.0, 20.0, 1e3], 10), ([1.0, 50.0, 1.0], 4), ([1e3, 20.0, 1.0], 4), ([1.0, 1.0, 0.02], 10)):
        with pytest.warns(UserWarning, match=f"stiffness jumps by 50 at u = {place}"):
            Body(three, [NeoHookean(E, 0.0) for E in moduli])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Body(Space.paper(straight(breaks=[0.0, 4.0, 10.0], degree=3, continuity=0).sweep(circle(8)), elements=2), laws)
        Body(space, [NeoHookean(2.0, 0.0), NeoHookean(1.0, 0.0)])


def test_densities_belong_to_elements():
    space = Space.paper(straight(breaks=[0.0, 4.0, 10.0]).sweep(circle(8)), elements=2)
    law = LinearElastic(1.0, 0.0)
    for wrong in ([1.0, 2.0, 3.0], [1.0, -1.0], [1.0, np.nan]):
        with pytest.raises(InputError, match="density"):
            Body(space, law, wrong)
    assert Body(space, law, [1.0, 2.0]).densities.tolist() == [1.0, 2.0]
    with pytest.raises(InputError, match="density of body 0: got 0"):
        modal.solve(Model([Body(space, law, [1.0, 0.0])], [Support.end(space, "start")]), 1)


def test_laws_given_one_by_one_are_linear_elastic_too():
    space = Space.paper(straight(breaks=[0.0, 4.0, 10.0]).sweep(circle(8)), elements=2)
    body = Body(space, [LinearElastic(1.0, 0.0)] * 2, 1.0)
    model = Model([body], [Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, 0.1))])
    with pytest.raises(InputError, match="linear elastic"):
        modal.solve(model, 1, state=statics.solve(model))


# --- sections


@pytest.mark.slow
def test_polynomials_hold_on_every_ellipse(points):
    for kind in ("torsion constant", "bending the thin way", "bending the wide way"):
        curve = points(sections.run)[f"ellipse 1 : x, {kind}"]["polynomials N = 2"]
        assert max(record["error"] for record in curve) < 1e-10
        assert max(record["scaled"] for record in curve) < 1e6


@pytest.mark.slow
def test_control_points_converge_on_thin_ellipses(points):
    torsion = points(sections.run)["ellipse 1 : x, torsion constant"]
    thin = {series: one(curve, 20.0)["error"] for series, curve in torsion.items()}
    assert thin["K = 1, n = 16"] < thin["K = 1, n = 8"] / 16
    # Harmonic functions hold the anticlastic curvature back: 1 / (1 - nu^2) in a strip.
    bending = points(sections.run)["ellipse 1 : x, bending the thin way"]["K = 1, n = 16"]
    assert one(bending, 100.0)["error"] == pytest.approx(1.0 / (1.0 - 0.3**2) - 1.0, rel=0.02)
    assert one(points(sections.run)["ellipse 1 : x, bending the thin way"]["K = 2, n = 16"], 5.0)["error"] < 1e-3


def test_the_estimate_of_a_stiffness_that_is_exact_vanishes():
    """Saint-Venant's torsion on the default space: supports hold two components of a face that is free to warp."""
    found, exact, model = stiffness(Space(straight(4.0).sweep(ellipse(8, 1.0, 0.1))), "torsion", 1.0, 0.1, 4.0)
    assert found == pytest.approx(exact, rel=1e-9)
    assert statics.solve(model).estimate() < 1e-9


def test_stiffness_of_a_circle_is_exact_in_all_three_ways():
    space = Space.paper(straight(3.0).sweep(circle(8)), section_degree=2)
    for kind in ("torsion", "weak", "strong"):
        found, exact, _ = stiffness(space, kind, 1.0, 1.0, 3.0)
        assert found == pytest.approx(exact, rel=1e-11)


def test_thinned_blade_converges_without_spurious_modes(points):
    curves = points(sections.run)[sections.THINNED.name]
    symmetric = next(curve for series, curve in curves.items() if series.startswith("symmetric"))
    assert point.reach(symmetric) == 100.0
    for record in symmetric:
        assert record["error"] < 5e-3
        assert record["rule"] < 1e-3
    papers = next(curve for series, curve in curves.items() if series.startswith("paper"))
    assert [record["value"] for record in papers] == [1.0, 10.0, 100.0]
    assert papers[0]["error"] < 5e-3
    assert all("folds" in record["failure"] for record in papers[1:])


@pytest.mark.parametrize("sweep", [sections.DEPTH.name, sections.OFFSET.name])
def test_folds_are_found_within_a_thousandth(sweep, points):
    (curve,) = points(sections.run)[sweep].values()
    for record in curve:
        past = record["value"] > record["fold"]
        assert ("failure" in record) == past
        assert not past or "folds" in record["failure"]
        assert past or record["error"] < record["tolerance"]
    assert any(0.0 < record["value"] / record["fold"] - 1.0 < 1.1e-3 for record in curve)


@pytest.mark.parametrize(
    ("series", "silent", "warned"),
    [("quadratic", 45.0, 120.0), ("cubic", 45.0, 120.0), ("quadratic, twice as many", 30.0, 90.0)],
)
def test_twist_is_right_then_warned_of_then_refused(series, silent, warned, points):
    """The error goes with the angle squared."""
    curve = points(sections.run)[sections.TWIST.name][series]
    for record in curve:
        assert ("failure" in record) == (record["value"] > warned)
        assert ("warned" in record) == (silent < record["value"] <= warned)
        assert "shrinks" in record.get("warned", "shrinks")
        assert record["value"] > silent or record["error"] < 0.06
    assert (len(curve), curve[-1]["value"]) == (9, 540.0)
    small = [one(curve, angle)["error"] / angle**2 for angle in (15.0, 30.0)]
    assert small[1] == pytest.approx(small[0], rel=0.02)


def test_the_size_that_twisted_sections_shrink_to_is_told_right(points):
    """Half-way between the layers of a quadratic element, whose middle one turns by half: (1 + cos(angle / 2)) / 2."""
    curve = points(sections.run)[sections.TWIST.name]["quadratic"]
    for angle in (90.0, 120.0, 180.0):
        told = one(curve, angle).get("warned") or one(curve, angle)["failure"]
        assert f"shrinks to {50.0 * (1.0 + np.cos(np.radians(angle / 2.0))):.0f} %" in told


def test_twist_warns_only_where_sections_shrink():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Spring(helix="paper").rod().check()
        Blade().rod().check()
    with pytest.warns(UserWarning, match="shrinks to 85 %"):
        Blade(twist=90.0, taper=1.0).rod().check()


def test_short_elements_do_not_matter(points):
    for curve in points(sections.run)[sections.LENGTHS.name].values():
        assert point.reach(curve) == 1e10
        assert max(record["error"] for record in curve) < 1e-10
        assert max(record["scaled"] for record in curve) < 2.0 * curve[0]["scaled"]
