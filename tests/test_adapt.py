"""Error estimates by refinement in each direction, and refinement until a tolerance holds."""

import json
import re
from dataclasses import dataclass
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest
from reference import BLADE_FREQUENCIES as BLADE
from reference import SPRING_FORCE as SPRING

from isorod import memory, scenes
from isorod.checks import adapt
from isorod.command import cli, refine, solving
from isorod.errors import InputError, SolveError
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring


def test_directions_of_control_points_and_of_polynomials():
    scene = Spring(preset="paper", order=6, section_points=8, degree=3, elements_per_turn=4)
    assert set(refine.finer(scene)) == {"section_points", "degree", "elements_per_turn"}
    scene = Blade(preset="paper", section_degree=3, degree=6)
    assert set(refine.finer(scene)) == {"section_degree", "elements"}
    assert refine.finer(scene)["section_degree"].section_degree == 4
    assert set(refine.finer(Blade(preset="paper", section_degree=8, degree=2))) == {"degree", "elements"}


@pytest.mark.parametrize("name", [name for name in scenes.SCENES if scenes.find(name).analysis in ("statics", "modal")])
def test_every_scene_has_a_finer_one_in_each_direction(name):
    """Whatever the scene calls its numbers of elements and of control points."""
    chosen = {"spring": {"preset": "paper"}, "blade": {"preset": "paper", "section_degree": 3, "degree": 6}}
    scene = scenes.find(name)(**chosen.get(name, {}))
    finer = refine.finer(scene)
    (along,) = {"elements", "elements_per_turn", "parts"} & set(finer)
    assert set(finer) - {along, "degree"} <= {"order", "section_points", "section_degree"}
    for direction, one in finer.items():
        assert getattr(one, direction) > getattr(scene, direction)


def test_a_higher_degree_keeps_the_continuity_so_that_spaces_nest():
    ahead = refine.finer(Spring(preset="paper", degree=3))["degree"]
    assert (ahead.degree, ahead.continuity) == (4, 2)


@pytest.mark.parametrize("tolerance", [1e-3, 3e-4])
@pytest.mark.parametrize("section", [{}, {"section_degree": 1}])
def test_spring_reaches_its_tolerance(tolerance, section):
    reached = refine.estimate(Spring(preset="paper", elements_per_turn=4, **section), {}, tolerance)
    true = abs(reached.scene.measure(reached.solution)["force"] / SPRING - 1.0)
    print(tolerance, reached.scene, reached.error, true)
    assert reached.error <= tolerance
    assert true <= 1.2 * reached.error
    assert reached.history
    assert all(error > tolerance for *_, error in reached.history)


def test_blade_reaches_its_tolerance():
    reached = refine.estimate(Blade(preset="paper", section_degree=2, degree=3, elements=6), {"modes": 10}, 5e-3)
    true = np.abs(reached.solution.frequencies / BLADE - 1.0).max()
    assert reached.error <= 5e-3
    assert true <= 5e-3
    assert {name for name, *_ in reached.history} >= {"degree", "section_degree"}


def test_an_estimate_changes_nothing():
    scene = Spring(preset="paper", elements_per_turn=4)
    reached = refine.estimate(scene, {})
    assert reached.scene == scene
    assert not reached.history
    assert reached.error == pytest.approx(sum(reached.changes.values()))
    assert set(reached.changes) == {"order", "section_points", "degree", "elements_per_turn"}


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, 1e-30, 1.0, float("nan"), float("inf")])
def test_a_tolerance_out_of_range_is_refused(tolerance):
    with pytest.raises(InputError, match=r"tolerance: got .*, need a relative error between 0 and 1"):
        refine.estimate(Spring(preset="paper"), {}, tolerance)


def test_a_rule_that_does_not_follow_is_refused():
    with pytest.raises(InputError, match="quadrature: got 'paper', refinement needs a rule that follows"):
        refine.estimate(Spring(preset="paper", quadrature="paper"), {})


def test_what_is_not_reached_is_said_and_the_best_is_kept(monkeypatch):
    monkeypatch.setattr(adapt, "MAX_UNKNOWNS", 1000)
    reached = refine.estimate(Spring(preset="paper", coils=1, elements_per_turn=4), {}, 1e-9)
    assert re.fullmatch(
        f"tolerance 1e-09 is not reached: the estimate is {reached.error:.2g} after . refinements", reached.short
    )
    assert 1e-9 < reached.error < min(error for *_, error in reached.history)


@dataclass(frozen=True)
class _Touching:
    """A scene with contact whose force errs by the number of control points most, and by the cheap degree a little."""

    order: int = 6
    section_points: int = 8
    degree: int = 3
    elements: int = 4
    analysis = "statics"
    units = MappingProxyType({"force": ""})

    def model(self):
        space = SimpleNamespace(chosen=(), quadrature="auto")
        return SimpleNamespace(contacts=[None], bodies=[SimpleNamespace(space=space)], dofs=1)

    def measure(self, solution):
        return {"force": 1.0 + 0.2 * 8 / self.section_points + 0.02 * 3 / self.degree + 0.002 * 4 / self.elements}


def test_what_is_large_counts_moments_by_the_size_of_the_model():
    """A twisted bar has no force but of rounding, which is nothing beside its moment."""
    model = SimpleNamespace(size=2.0, external=np.zeros(3))
    found = SimpleNamespace(model=model, reactions=np.zeros((2, 3)), displacement=np.full(3, 0.1))
    assert refine._scale(found) == 0.1
    found.moments = np.array([[0.0, 0.0, -6.0]])
    assert refine._scale(found) == 3.0


def test_with_contact_directions_of_the_largest_changes_are_refined_and_no_cheap_one_before(monkeypatch):
    def work(scene):
        return scene.section_points**3 * scene.elements * (1.0 + 0.01 * scene.degree)

    monkeypatch.setattr(
        solving, "solve", lambda one, settings, begin=None: (SimpleNamespace(model=one.model(), scene=one), {})
    )
    monkeypatch.setattr(refine, "_work", lambda solution: work(solution.scene))
    monkeypatch.setattr(refine, "_scale", lambda solution: 1.0)
    reached = refine.estimate(_Touching(), {}, 0.06)
    assert [name for name, *_ in reached.history] == ["section_points"]
    assert reached.error < 0.06 and not reached.short


def _failing(at, problem, monkeypatch):
    """Let the solution so many of a run fail."""
    true, calls = solving.solve, []

    def solve(*given, **named):
        calls.append(given)
        if len(calls) == at:
            raise problem
        return true(*given, **named)

    monkeypatch.setattr(solving, "solve", solve)


LONG = [
    "run",
    "spring",
    "--preset",
    "paper",
    "--coils",
    "1",
    "--elements-per-turn",
    "4",
    "--tolerance",
    "1e-9",
    "--json",
]


@pytest.mark.parametrize(
    ("problem", "why"),
    [(SolveError("no way"), "no way"), (InputError("too much"), "too much"), (MemoryError(), memory.SHORT)],
)
def test_a_refinement_that_fails_leaves_the_result_there_was(problem, why, monkeypatch, capsys, tmp_path):
    _failing(3, problem, monkeypatch)
    assert cli.main([*LONG, "--output", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    record = json.loads(out)
    assert len({error for *_, error in record["refinements"]}) == 1
    said = f"tolerance 1e-09 is not reached: the estimate is {record['error_estimate']:.2g} after 1 refinements"
    assert err == f"isorod: {said}; finer it fails: {why}\n"
    assert record["short"] == f"{said}; finer it fails: {why}"
    assert json.loads((tmp_path / "results.jsonl").read_text())["force"] == record["force"]


def test_where_nothing_is_known_the_error_is_that_of_the_solution(monkeypatch):
    _failing(1, SolveError("no way"), monkeypatch)
    with pytest.raises(SolveError, match="no way"):
        refine.estimate(Spring(preset="paper", coils=1, elements_per_turn=4), {}, 1e-9)


def test_on_the_command_line(isorod):
    done = isorod(
        "run",
        "spring",
        "--preset",
        "paper",
        "--no-estimate",
        "--coils",
        "1",
        "--section-degree",
        "1",
        "--tolerance",
        "1e-2",
        "--json",
    )
    assert (done.returncode, done.stderr) == (0, "")
    record = json.loads(done.stdout)
    assert record["error_estimate"] <= 1e-2
    assert record["refinements"]
    assert record["options"]["section_degree"] > 1
