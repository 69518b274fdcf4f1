"""Error estimates by refinement in each direction, and refinement until a tolerance holds."""

import json
import re
from dataclasses import replace

import pytest
from reference import SPRING_FORCE as SPRING

from isorod import InputError, SolveError, memory, scenes
from isorod.checks import adapt
from isorod.command import cli, refine, solving
from isorod.scenes.spring import Spring
from isorod.space import choice


@pytest.mark.parametrize("name", [name for name in scenes.SCENES if scenes.find(name).analysis in ("statics", "modal")])
def test_every_scene_is_refined_on_the_space_asked_for(name):
    """Whatever the scene calls its number of elements."""
    chosen = {"spring": {"preset": "paper"}, "blade": {"preset": "paper", "section_degree": 3, "degree": 6}}
    scene = scenes.find(name)(**chosen.get(name, {}))
    space = scene.model().bodies[0].space
    finer = replace(space, **choice.halved(space))
    (made, *_) = (body.space for body in scene.on([finer]).model().bodies)
    assert (made.elements, made.degree, made.continuity) == (finer.elements, finer.degree, finer.continuity)
    assert (made.section_degree, made.order, made.points_around) == (
        finer.section_degree,
        finer.order,
        finer.points_around,
    )


@pytest.mark.parametrize("tolerance", [1e-3, 3e-4])
@pytest.mark.parametrize("section", [{}, {"section_degree": 1}])
def test_spring_reaches_its_tolerance(tolerance, section):
    reached = refine.refine(Spring(preset="paper", elements_per_turn=4, **section), {}, tolerance)
    true = abs(reached.scene.measure(reached.solution)["force"] / SPRING - 1.0)
    print(tolerance, reached.scene, reached.error, true)
    assert reached.error <= tolerance
    assert true <= 1.2 * reached.error
    assert reached.history
    assert all(error > tolerance for *_, error in reached.history)


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, 1e-30, 1.0, float("nan"), float("inf")])
def test_a_tolerance_out_of_range_is_refused(tolerance):
    with pytest.raises(InputError, match=r"tolerance: got .*, need a relative error between 0 and 1"):
        refine.refine(Spring(preset="paper"), {}, tolerance)


def test_a_rule_that_does_not_follow_is_refused():
    with pytest.raises(InputError, match="quadrature: got 'paper', refinement needs a rule that follows"):
        refine.refine(Spring(preset="paper", quadrature="paper"), {}, 1e-3)


def test_what_is_not_reached_is_said_and_the_best_is_kept(monkeypatch):
    monkeypatch.setattr(adapt, "MAX_UNKNOWNS", 1000)
    reached = refine.refine(Spring(preset="paper", coils=1, elements_per_turn=4), {}, 1e-9)
    assert re.fullmatch(
        f"tolerance 1e-09 not reached: estimated error {reached.error:.2g} after . refinements", reached.short
    )
    assert 1e-9 < reached.error < min(error for *_, error in reached.history)


def _failing(at, problem, monkeypatch):
    """Let the solution so many of a run fail."""
    true, calls = solving.solve, []

    def solve(*given, **named):
        calls.append(given)
        if len(calls) == at:
            raise problem
        return true(*given, **named)

    monkeypatch.setattr(solving, "solve", solve)


LONG = "run spring --preset paper --coils 1 --elements-per-turn 4 --tolerance 1e-9 --json".split()


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
    said = f"tolerance 1e-09 not reached: estimated error {record['error_estimate']:.2g} after 1 refinements"
    assert err == f"isorod: {said}; the refined model fails: {why}\n"
    assert record["short"] == f"{said}; the refined model fails: {why}"
    assert json.loads((tmp_path / "results.jsonl").read_text())["force"] == record["force"]


def test_where_nothing_is_known_the_error_is_that_of_the_solution(monkeypatch):
    _failing(1, SolveError("no way"), monkeypatch)
    with pytest.raises(SolveError, match="no way"):
        refine.refine(Spring(preset="paper", coils=1, elements_per_turn=4), {}, 1e-9)


def test_on_the_command_line(command):
    words = "run spring --preset paper --no-estimate --coils 1 --section-degree 1 --tolerance 1e-2"
    record = command.record(*words.split())
    assert record["error_estimate"] <= 1e-2
    assert record["refinements"]
    assert record["options"]["section_degree"] > 1
