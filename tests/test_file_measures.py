"""Stresses, section forces, energies and stiffnesses that a file asks for: closed forms, balance, differences."""

import copy
import csv
import math
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from scene_files import MOTION, text

from isorod import InputError, dynamics, statics
from isorod.command import solving
from isorod.files.measures import stiffness
from isorod.files.scene import FileScene
from isorod.output import held
from isorod.output.largest import largest

E, NU, RADIUS, LENGTH = 200.0, 0.3, 0.5, 4.0
AREA, INERTIA = np.pi * RADIUS**2, 0.25 * np.pi * RADIUS**4
SHEAR = E / (2.0 * (1.0 + NU))


def bar(end, nu=0.0, law="LinearElastic", curve=None, **measures):
    """A round bar along z, held at its start; ``end`` is what the support of its end is told."""
    return {
        "analysis": "statics",
        "rod": {
            "bar": {
                "curve": {"straight": LENGTH if curve is None else curve},
                "section": {"circle": RADIUS},
                "law": {law: {"E": E, "nu": nu}},
                "space": {"elements": 4, "degree": 3, "section_degree": 3},
            }
        },
        "support": {"foot": {"end": "start"}, "head": {"end": "end"} | end},
        "measure": measures,
    }


@pytest.fixture
def measured(tmp_path):
    """Return what the file of a table measures, and the solution."""

    def run(table):
        path = tmp_path / "my.toml"
        path.write_text(text(table))
        scene = FileScene(str(path))
        solution = statics.solve(scene.model(), **scene.settings())
        return scene.measure(solution), solution

    return run


def test_tension(measured, silent):
    """``sigma = E e``, ``N = E A e``, ``k = E A / L``, ``U = N d / 2``, the same everywhere."""
    pull = 1e-3
    alike = ("von_mises", "max_principal", "zz", "along")
    asked = {name: {"stress": "bar", "component": name} for name in (*alike, "shear", "min_principal")}
    asked |= {"inside": {"stress": "bar", "u": 0.3, "xi": [0.2, -0.1]}, "far": {"stress": "bar", "away": 1.5}}
    asked |= {"k": {"stiffness": "head"}, "slope": {"stiffness": "head", "slope": "tangent"}, "work": {"energy": "bar"}}
    asked |= {"N": {"section_force": "bar", "u": 0.3, "component": "axial"}, "all": {"section_force": "bar"}}
    found, solution = measured(bar({"displacement": [0.0, 0.0, pull]}, **asked))
    stress, rate = E * pull / LENGTH, E * AREA / LENGTH
    for name in (*alike, "inside", "far"):
        assert found[name] == pytest.approx(stress, rel=1e-9), name
    assert abs(found["shear"]) + abs(found["min_principal"]) < 1e-9 * stress
    assert [found["k"], found["slope"]] == pytest.approx([rate, rate], rel=1e-9)
    assert found["work"] == pytest.approx(0.5 * rate * pull**2, rel=1e-9)
    assert found["N"] == pytest.approx(rate * pull, rel=1e-9)
    assert found["N"] == pytest.approx(solution.reactions[1, 2], rel=1e-9)
    assert found["all"] == pytest.approx([rate * pull, 0.0, 0.0, 0.0, 0.0, 0.0], abs=1e-9 * rate * pull)


def test_torsion(measured, silent):
    """``tau = G r theta'``, largest on the surface, ``T = G J theta'``; pull and push of that size at 45 degrees."""
    # What a turn moves inwards is of second order.
    turn = 1e-7
    asked = {name: {"stress": "bar", "component": name} for name in ("shear", "von_mises", "max_principal")}
    asked |= {"min": {"stress": "bar", "component": "min_principal"}, "along": {"stress": "bar", "component": "along"}}
    asked |= {"half": {"stress": "bar", "u": 0.4, "xi": [0.0, 0.5], "component": "xz"}}
    asked |= {"T": {"section_force": "bar", "u": 0.7, "component": "torque"}, "k": {"stiffness": "head"}}
    asked |= {"slope": {"stiffness": "head", "slope": "tangent"}, "M": {"section_force": "bar", "component": "moment"}}
    found, solution = measured(bar({"rotation": [0.0, 0.0, math.degrees(turn)]}, NU, **asked))
    rate = 2.0 * SHEAR * INERTIA / LENGTH
    tau = SHEAR * RADIUS * turn / LENGTH
    assert found["shear"] == pytest.approx(tau, rel=1e-6)
    assert found["von_mises"] == pytest.approx(np.sqrt(3.0) * tau, rel=1e-6)
    assert [found["max_principal"], found["min"]] == pytest.approx([tau, -tau], rel=1e-5)
    assert abs(found["along"]) < 1e-5 * tau
    # Above the centre the surface moves backwards.
    assert found["half"] == pytest.approx(-0.5 * tau, rel=1e-6)
    assert found["places"]["shear"]["radius"] == pytest.approx(1.0, abs=1e-9)
    assert found["T"] == pytest.approx(rate * turn, rel=1e-6)
    assert found["M"] == pytest.approx(solution.moments[1], rel=1e-6, abs=1e-12 * rate)
    assert [found["k"], found["slope"]] == pytest.approx([rate, rate], rel=1e-6)


def test_a_bar_that_is_bent_and_pushed(measured, silent):
    """Stresses from ``-3 s`` to ``-s``: the largest in size has its sign, and there is no tension."""
    turn = 1e-6
    asked = {name: {"stress": "bar", "component": name} for name in ("along", "zz", "min_principal", "max_principal")}
    push = [0.0, -0.5 * turn * LENGTH, -2.0 * RADIUS * turn]
    found, _ = measured(bar({"rotation": [math.degrees(turn), 0.0, 0.0], "displacement": push}, **asked))
    stress = E * RADIUS * turn / LENGTH
    assert [found[name] for name in ("along", "zz", "min_principal")] == pytest.approx([-3.0 * stress] * 3, rel=1e-4)
    assert abs(found["max_principal"]) < 1e-4 * stress


def test_bending(measured, silent):
    """``sigma = E kappa y``: of either sign at the top and below, told with the sign it has; ``M = E I kappa``."""
    turn = 1e-6
    asked = {"size": {"stress": "bar", "component": "zz"}, "pull": {"stress": "bar", "component": "max_principal"}}
    asked |= {"push": {"stress": "bar", "component": "min_principal"}, "work": {"energy": "bar"}}
    asked |= {"section": {"stress": "bar", "u": 0.3}, "line": {"stress": "bar", "xi": [0.0, 0.5]}}
    asked |= {"M": {"section_force": "bar", "u": 0.2, "component": "bending_1"}}
    # Bent to a circle, a turn about x moves the end along y by half of it.
    end = {"rotation": [math.degrees(turn), 0.0, 0.0], "displacement": [0.0, -0.5 * turn * LENGTH, 0.0]}
    found, _ = measured(bar(end, **asked))
    stress = E * RADIUS * turn / LENGTH
    assert [found["pull"], found["push"]] == pytest.approx([stress, -stress], rel=1e-5)
    assert abs(found["size"]) == pytest.approx(stress, rel=1e-5)
    assert [found["section"], found["line"]] == pytest.approx([stress, 0.5 * stress], rel=1e-5)
    assert found["places"]["pull"]["angle"] == pytest.approx(90.0, abs=0.1)
    assert found["places"]["push"]["angle"] == pytest.approx(270.0, abs=0.1)
    assert found["places"]["section"]["u"] == 0.3 and found["places"]["line"]["radius"] == 0.5
    assert found["M"] == pytest.approx(E * INERTIA * turn / LENGTH, rel=1e-6)
    assert found["work"] == pytest.approx(0.5 * E * INERTIA * turn**2 / LENGTH, rel=1e-6)


def test_a_turned_scene_has_the_same_stresses_energies_and_rates(measured):
    asked = {"peak": {"stress": "bar"}, "at": {"stress": "bar", "u": 0.6, "xi": [0.6, 0.8], "component": "along"}}
    asked |= {
        "k": {"stiffness": "head", "slope": "tangent"},
        "work": {"energy": "bar"},
        "six": {"section_force": "bar"},
    }
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    across = np.cross([0.0, 0.0, 1.0], axis)
    # The shortest way from z to the axis.
    angle, across = np.arccos(axis[2]), across / np.linalg.norm(across)
    K = np.cross(np.eye(3), across)
    turn = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    moved = np.array([0.3, -0.2, 0.5])
    with warnings.catch_warnings(action="ignore"):
        one, _ = measured(bar({"displacement": moved.tolist()}, NU, "NeoHookean", **asked))
        curve = {"end": (LENGTH * axis).tolist()}
        table = bar({"displacement": (turn @ moved).tolist()}, NU, "NeoHookean", {}, **asked)
        table["rod"]["bar"]["curve"] = {"straight": curve}
        other, _ = measured(table)
    assert np.linalg.norm(turn @ [0, 0, 1] - axis) < 1e-14
    assert other["peak"] == pytest.approx(one["peak"], rel=1e-5)
    for name in ("at", "k", "work"):
        assert other[name] == pytest.approx(one[name], rel=1e-7), name
    assert other["six"] == pytest.approx(one["six"], abs=1e-7 * np.abs(one["six"]).max())


def test_the_largest_is_that_of_a_dense_grid_and_stands_where_it_is_said(measured):
    table = bar({"displacement": [0.5, 0.3, 0.2], "turn": [0.0, 0.4, 1.0]}, NU, "NeoHookean")
    table["measure"] = {"peak": {"stress": "bar", "away": 1.0}}
    with warnings.catch_warnings(action="ignore"):
        found, solution = measured(table)
    u = np.linspace(0.25, 0.75, 101)
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    xi = np.concatenate([r * np.stack([np.cos(angle), np.sin(angle)], axis=1) for r in (0.5, 0.9, 1.0)])
    dense = solution.stress(0, u, xi, "von Mises").max()
    assert dense <= found["peak"] < 1.001 * dense
    place = found["places"]["peak"]
    way = np.radians(place["angle"])
    there = solution.stress(0, place["u"], place["radius"] * np.array([np.cos(way), np.sin(way)]), "von Mises")
    assert there == pytest.approx(found["peak"], rel=1e-9)
    assert 0.25 - 1e-9 <= place["u"] <= 0.75 + 1e-9


def test_a_peak_between_the_points_of_the_grid_is_found(measured):
    _, solution = measured(bar({"displacement": [0.0, 0.0, 0.1]}))
    space, middle = solution.model.bodies[0].space, np.array([0.6123, 0.7071, 1.2345])

    def peak(u, xi):
        polar = np.hypot(*xi.T), np.arctan2(xi[:, 1], xi[:, 0])
        return -((u[:, None] - middle[0]) ** 2) - (polar[0] - middle[1]) ** 2 - (polar[1] - middle[2]) ** 2

    found, *_ = largest(space, peak)
    assert found.value == pytest.approx(0.0, abs=1e-7)
    assert found.u == pytest.approx(middle[0], abs=1e-3)


@pytest.mark.parametrize("law, nu", [("NeoHookean", NU), ("NeoHookean", 0.4999), ("LinearElastic", NU)])
def test_the_energy_is_the_work_done(law, nu, measured):
    """What a support's force does on its way: the derivative of the energy, by differences; half of it where linear."""

    def state(pull):
        table = bar({"displacement": [0.3 * pull, 0.0, pull]}, nu, law, work={"energy": "bar"})
        found, solution = measured(table)
        return found["work"], solution.reactions[1] @ [0.3, 0.0, 1.0]

    step = 1e-3
    stored, force = state(0.8)
    slope = (state(0.8 + step)[0] - state(0.8 - step)[0]) / (2.0 * step)
    assert slope == pytest.approx(force, rel=1e-5)
    if law == "LinearElastic":
        assert stored == pytest.approx(0.5 * force * 0.8, rel=1e-9)


@pytest.mark.parametrize(
    "end",
    [
        {"displacement": [0.0, 0.4, 1.0]},
        {"displacement": [0.0, 0.0, 1.0], "components": "z", "tied": "xy"},
        {"turn": [0.0, 0.2, 0.5]},
        {"turn": [0.0, 0.0, 0.5], "center": [0.0, 0.0, 1.0]},
        {"turn": [0.0, 0.0, 0.5], "components": "xy", "tied": "z"},
    ],
    ids=str,
)
@pytest.mark.parametrize("nu", [NU, 0.499])
def test_the_tangent_is_the_slope_of_the_force(end, nu, measured):
    def state(share):
        told = {
            key: (share * np.array(one)).tolist() if key in ("displacement", "turn") else one
            for key, one in end.items()
        }
        table = bar(told, nu, "NeoHookean", k={"stiffness": "head"}, slope={"stiffness": "head", "slope": "tangent"})
        table["rod"]["bar"]["curve"] = {"helix": {"radius": 3.0, "pitch": 2.0, "turns": 0.5}}
        table["rod"]["bar"]["space"] |= {"elements": 4, "degree": 4}
        table["load"] = {"weight": {"body_force": [0.1, 0.0, 0.0]}}
        return measured(table)[0]

    size, step = np.linalg.norm(end.get("displacement", end.get("turn"))), 1e-3
    ahead, behind = (share * size * state(share)["k"] for share in (1.0 + step, 1.0 - step))
    assert state(1.0)["slope"] == pytest.approx((ahead - behind) / (2.0 * step * size), rel=1e-5)


def clamped(**measures):
    table = bar({"displacement": [0.0, 0.0, 1e-3]}, NU, **measures)
    table["rod"]["bar"]["space"] |= {"elements": 16, "section_degree": 6}
    return table


def test_a_largest_at_a_held_edge_is_said_to_be_one(measured):
    asked = {"peak": {"stress": "bar"}} | {
        name: {"stress": "bar", "away": away} for name, away in (("close", 0.12), ("far", 1.0))
    }
    with pytest.warns(UserWarning) as said:
        found, _ = measured(clamped(**asked))
    (one,) = [str(each.message) for each in said]
    assert (
        "is 0 from the edge of a held face or patch, a stress singularity that grows without bound under refinement"
        in one
    )
    assert "(away = 1) it is 0.05" in one
    assert found["peak"] > 1.15 * found["far"]
    assert found["places"]["peak"]["u"] in (0.0, pytest.approx(1.0)) and found["places"]["peak"]["radius"] > 0.999
    assert found["close"] > 1.02 * found["far"]
    # One width from a clamped face the stress is that of the bar but for some hundredths.
    assert found["far"] == pytest.approx(E * 1e-3 / LENGTH, rel=0.03)


def test_a_place_at_a_held_edge_is_warned_of(measured):
    with pytest.warns(UserWarning, match="von Mises stress at u = 0: edge of a held face"):
        measured(clamped(edge={"stress": "bar", "u": 0.0, "xi": [1.0, 0.0]}))
    with warnings.catch_warnings(action="error"):
        measured(clamped(middle={"stress": "bar", "u": 0.5, "xi": [1.0, 0.0]}))


def test_a_stress_that_is_out_of_balance_is_warned_of(measured):
    """Four elements of degree 5 do not see how a clamped face holds the bar's narrowing, and wave all along."""
    table = bar({"displacement": [0.0, 0.0, 0.05]}, NU, "NeoHookean", mid={"stress": "bar", "u": 0.5, "xi": [1.0, 0.0]})
    table["rod"]["bar"] |= {"curve": {"straight": 50.0}, "section": {"circle": 3.0}}
    table["rod"]["bar"]["space"] = {"elements": 4, "degree": 5, "continuity": 0, "section_degree": 3}
    with pytest.warns(UserWarning, match=r"at u = 0.5: stress residual 2\d %, a lower bound"):
        found, _ = measured(table)
    assert abs(found["mid"] / (E * 1e-3) - 1.0) > 0.03


def test_distances_from_what_is_held(measured):
    _, solution = measured(bar({"displacement": [0.0, 0.0, 0.1]}))
    assert held.distance(solution.model, 0, np.array([0.0, 0.1, 0.5, 0.8])) == pytest.approx([0.0, 0.4, 2.0, 0.8])
    assert held.edges(solution.model, 0, 1.0) == pytest.approx([0.25, 0.75])
    assert held.width(solution.model, 0) == pytest.approx(2.0 * RADIUS)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"stress": "bar", "away": -1.0}, r"my.toml:\d+: measure.one.away: got -1, need a length, not negative"),
        ({"stress": "bar", "away": 3.0}, "away: got 3, but no point of the rod is that far from all supports"),
        ({"stress": "bar", "u": 0.5, "away": 1.0}, "away: it goes with the largest along a rod, and not with a place"),
        ({"stress": "bar", "xi": [2.0, 0.0]}, r"xi: got \[2.0, 0.0\], need a point of the unit disk"),
        ({"stress": "bar", "component": "von_mise"}, "component: 'von_mise' is not known; did you mean von_mises"),
        ({"stress": "bar", "u": 2.0}, "got 2, need numbers from 0 to 1"),
        ({"section_force": "bar", "u": 2.0}, "got 2, need numbers from 0 to 1"),
        ({"section_force": "bar", "component": "N"}, "component: 'N' is not known"),
        ({"stiffness": "foot"}, "the support does not move, need one with a displacement or a turn"),
        ({"stiffness": "head"}, "the support has a displacement and a turn, need one of the two"),
        ({"energy": "bars"}, "'bars' is not known; did you mean bar"),
    ],
)
def test_what_cannot_be_measured_is_one_line(asked, said, measured):
    end = {"displacement": [0.0, 0.0, 1e-3], "turn": [0.0, 0.0, 1e-3]}
    with pytest.raises(InputError, match=said) as problem:
        measured(bar(end, one=asked))
    assert "\n" not in str(problem.value)


def test_modes_have_no_stress_and_motions_have_one_an_output(tmp_path, command):
    table = copy.deepcopy(MOTION)
    table["rod"]["muscle"]["space"] = {"section_degree": 2, "elements": 2}
    table["measure"] = {"peak": {"stress": "muscle"}, "at": {"stress": "muscle", "u": 0.5, "xi": [1.0, 0.0]}}
    table["measure"] |= {"work": {"energy": "muscle"}, "six": {"section_force": "muscle", "u": 0.5}}
    path = tmp_path / "my.toml"
    path.write_text(text(table))
    scene = FileScene(str(path))
    with warnings.catch_warnings(action="ignore"):
        history = dynamics.solve(scene.model(), **scene.settings())
        found = scene.measure(history)
    assert len(found["peak"]) == len(found["places"]["peak"]) == len(found["at"]) == len(history)
    assert found["at"] == pytest.approx([float(one.stress(0, 0.5, [1.0, 0.0], "von Mises")) for one in history])
    assert found["six"].shape == (len(history), 6) and found["work"].shape == (len(history),)
    assert all(peak >= at for peak, at in zip(found["peak"], found["at"], strict=True))
    assert ", the largest: at u = " in command.prints("run", path)
    path.write_text(text(table | {"analysis": {"modal": {"modes": 2}}}))
    assert "measure" in command.refuses("run", path)


def test_run_and_sweep_tell_stresses(tmp_path, command):
    path = tmp_path / "my.toml"
    asked = {"peak": {"stress": "bar", "unit": "MPa", "away": 1.0}, "k": {"stiffness": "head"}}
    path.write_text(text(bar({"displacement": [0.0, 0.0, 1e-3]}, **asked)))
    out = " ".join(command.prints("run", path).split())
    assert "peak 0.05 MPa, the largest: at u = " in out
    assert "of stresses" in out
    record = command.record("run", path)
    assert record["error_estimate"] < 1e-6 and set(record["places"]["peak"]) == {"u", "angle", "radius"}
    words = [str(path), "--set", "support.head.displacement.2=1e-3,2e-3", "--no-estimate"]
    command.prints("sweep", *words, "--output", tmp_path / "a.csv")
    lines = [line for line in (tmp_path / "a.csv").read_text().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert [float(row["peak"]) for row in rows] == pytest.approx([0.05, 0.1], rel=1e-6)
    assert [float(row["k"]) for row in rows] == pytest.approx([E * AREA / LENGTH] * 2, rel=1e-6)


def test_the_tangent_with_contact_is_refused(measured):
    _, solution = measured(bar({"displacement": [0.0, 0.0, 0.1]}))
    object.__setattr__(solution.model, "contacts", (None,))
    with pytest.raises(InputError, match="slope 'tangent' is not available with contact; use 'secant'"):
        stiffness(solution, 1, "tangent")


@pytest.mark.parametrize(("stress", "warned"), [(0.009, False), (0.011, True), (None, False)])
def test_stresses_are_warned_of_from_a_percent_on(stress, warned):
    solution = SimpleNamespace(estimate=None, errors=lambda: (1e-4, stress), model=SimpleNamespace(contacts=()))
    with warnings.catch_warnings(record=True, action="always") as said:
        solving.estimate(solution, True)
    assert [str(one.message).startswith("estimated stress error 1.1 %") for one in said] == [True] * warned
