"""Rotations, moments about points, patches of contacts and frequencies by their shapes: closed forms."""

import math
import warnings

import numpy as np
import pytest
from scene_files import text
from test_file_measures import INERTIA, LENGTH, NU, RADIUS, SHEAR, E, bar

from isorod import InputError, LinearElastic, NeoHookean, Space, circle, ellipse, modal, statics, straight
from isorod.files.contacts import _edge, _places
from isorod.files.scene import FileScene
from isorod.modal import kinds
from isorod.model import Body, Model, Support
from isorod.output import rotations
from isorod.tensors import rotation

STEEL, HEAVY = 2.1e5, 7.8e-9


@pytest.fixture
def measured(tmp_path):
    """Return what the file of a table measures, and the solution."""

    def run(table, **settings):
        path = tmp_path / "my.toml"
        path.write_text(text(table))
        scene = FileScene(str(path))
        solve = modal.solve if scene.analysis == "modal" else statics.solve
        solution = solve(scene.model(), **scene.settings(), **settings)
        return scene.measure(solution), solution

    return run


def loaded(load, **measures):
    table = bar({}, NU, **measures)
    del table["support"]["head"]
    return table | {"load": {"push": {"end": "end"} | load}}


def test_a_shaft_twists_by_its_torque(measured, silent):
    """``T L / (G J)``, in proportion along the shaft."""
    angle = 1e-3
    torque = 2.0 * SHEAR * INERTIA * angle / LENGTH
    asked = {"far": {"rotation": "bar", "about": "tangent"}, "half": {"rotation": "bar", "u": 0.5, "about": [0, 0, -3]}}
    found, solution = measured(loaded({"moment": [0.0, 0.0, torque]}, whole={"rotation": "bar"}, **asked))
    degrees = math.degrees(angle)
    assert found["far"] == pytest.approx(degrees, rel=3e-4)
    assert found["half"] == pytest.approx(-0.5 * degrees, rel=1e-3)
    assert found["whole"] == pytest.approx([0.0, 0.0, degrees], rel=3e-4, abs=1e-9)
    # For small rotations it is that of mean supports.
    space = solution.model.bodies[0].space
    from isorod.model.mean import MeanSupport

    nodes, rows = MeanSupport(1.0, np.zeros((0, 3)), np.eye(3)).rows(space)
    mean = np.einsum("kna,na->k", rows, solution.model.nodal(solution.displacement, 0)[nodes])
    assert np.radians(found["whole"]) == pytest.approx(mean, rel=1e-5, abs=1e-12)


@pytest.mark.parametrize("turn", [3.0, 4.0 * np.pi, -13.0])
def test_whole_turns_are_counted(turn):
    made = Space(straight(50.0).sweep(circle(8, 0.5)), elements=8, degree=5, continuity=0, section_degree=2)
    ends = Support.end(made, "start"), Support.end(made, "end", turn=(0.0, 0.0, turn))
    with warnings.catch_warnings(action="ignore"):
        solution = statics.solve(Model([Body(made, NeoHookean(STEEL, 0.3))], ends))
    for u in (0.25, 0.5, 1.0):
        assert float(solution.rotation(0, u, [0.0, 0.0, 2.0])) == pytest.approx(u * turn, abs=2e-5)
        assert solution.rotation(0, u) == pytest.approx([0.0, 0.0, u * turn], abs=2e-5)
    with pytest.raises(InputError, match=r"about: got .*, need three numbers that are not all zero"):
        solution.rotation(0, "end", [0.0, 0.0, 0.0])


def test_a_rigid_rotation_is_found_whatever_the_section():
    """Places of an ellipse, turned about any axis: that vector, and its angle about the axis."""
    rng = np.random.default_rng(1)
    arms = np.column_stack([rng.normal(size=(20, 2)) * [3.0, 1.0], np.zeros(20)])
    weights = rng.uniform(0.5, 2.0, 20)
    arms -= weights @ arms / weights.sum()
    turn = np.array([0.5, -0.9, 1.3])
    now = arms @ rotation(turn).T
    assert rotations.of_points(arms, now, weights, None) == pytest.approx(turn, abs=1e-12)
    size = np.linalg.norm(turn)
    assert float(rotations.of_points(arms, now, weights, turn / size)) == pytest.approx(size, abs=1e-12)


def test_a_moment_about_a_point_is_that_of_the_forces(measured, silent):
    """About any point supports balance the load, ``(x - P) x F``."""
    force, point = np.array([1e-4, 2e-4, 0.5e-4]), np.array([10.0, 20.0, 30.0])
    asked = {"M": {"moment": "foot", "point": point.tolist()}, "z": {"moment": "foot", "component": "z"}}
    asked |= {"along": {"moment": "foot", "point": point.tolist(), "about": [0.0, 3.0, 4.0]}}
    found, _ = measured(loaded({"force": force.tolist()}, **asked))
    balance = -np.cross([0.0, 0.0, LENGTH] - point, force)
    assert found["M"] == pytest.approx(balance, rel=1e-6)
    assert found["along"] == pytest.approx(balance @ [0.0, 0.6, 0.8], rel=1e-6)
    # Rounding is nothing.
    assert found["z"] == 0.0


def test_moments_and_rotations_are_told_along_the_load_steps(tmp_path, command):
    angle = 0.02
    asked = {"twist": {"rotation": "bar", "u": 0.5, "about": "z"}, "T": {"moment": "head", "component": "z"}}
    table = bar({"rotation": [0.0, 0.0, math.degrees(angle)]}, NU, **asked)
    table["analysis"] = {"statics": {"load_steps": 2}}
    path = tmp_path / "my.toml"
    path.write_text(text(table))
    command.prints("run", path, "--no-estimate", "--output", tmp_path / "out")
    rows = np.genfromtxt(tmp_path / "out" / "my.csv", delimiter=",", names=True)
    stiffness = 2.0 * SHEAR * INERTIA / LENGTH
    assert rows["twist"][1:] == pytest.approx(np.degrees([0.25, 0.5]) * angle, rel=2e-4)
    assert rows["T"][1:] == pytest.approx(np.array([0.5, 1.0]) * stiffness * angle, rel=2e-4)


def beam(section, held=True, modes=10, law=None):
    space = Space(straight(50.0).sweep(section), elements=6, degree=3, section_degree=3)
    law = LinearElastic(STEEL, 0.3) if law is None else law
    return modal.solve(Model([Body(space, law, HEAVY)], [Support.end(space, "start")] if held else []), modes=modes)


@pytest.mark.parametrize("held", [True, False])
def test_modes_of_a_round_rod_are_told_apart(held):
    """Two of bending at one frequency, in any direction; torsion at ``sqrt(G / rho) / 4 L``, or 2 L where free."""
    modes = beam(circle(8, 1.0), held)
    longest = 4.0 if held else 2.0
    torsion = math.sqrt(STEEL / 2.6 / HEAVY) / 50.0 / longest
    assert kinds.of_rod(modes, 0, "torsion").frequency == pytest.approx(torsion, rel=1e-5)
    first = modes.frequencies[modes.rigid]
    for towards in (None, [1.0, 0.0, 0.0], [0.3, -0.7, 0.0]):
        found = kinds.of_rod(modes, 0, "bending", towards)
        assert found.frequency == pytest.approx(first, rel=1e-6) and found.fraction > 0.99
    assert kinds.of_rod(modes, 0, "bending", None, 2).frequency == pytest.approx(first, rel=1e-6)
    second = kinds.of_rod(modes, 0, "bending", [1.0, 0.0, 0.0], 2).frequency
    assert second == pytest.approx(modes.frequencies[modes.rigid + 2], rel=1e-6)
    if held:
        # The thin bar's ratio of the first two, less what shear takes.
        assert second / first == pytest.approx(6.267, rel=0.01)


def test_an_oval_rod_has_a_mode_in_each_plane_and_none_between():
    modes = beam(ellipse(8, 1.5, 0.8))
    x, y = (kinds.of_rod(modes, 0, "bending", way).frequency for way in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    assert [y, x] == pytest.approx(modes.frequencies[:2], rel=1e-12)
    assert x / y == pytest.approx(1.5 / 0.8, rel=0.01)
    axial = kinds.of_rod(beam(ellipse(8, 1.5, 0.8), modes=12), 0, "axial")
    assert axial.frequency == pytest.approx(math.sqrt(STEEL / HEAVY) / 200.0, rel=2e-3)
    with pytest.raises(InputError, match=r"0 are mostly bending .* another direction"):
        kinds.of_rod(modes, 0, "bending", [1.0, 1.0, 0.0])
    with pytest.raises(InputError, match="direction: it goes with bending, and not with torsion"):
        kinds.of_rod(modes, 0, "torsion", [1.0, 1.0, 0.0])


def test_a_file_asks_for_frequencies_by_shape_and_by_load(measured, silent):
    """A tapered bar: the mode that bends in a direction is the one most like what a force there does."""
    asked = {"bend": {"frequency": "bar", "shape": "bending", "direction": "x"}, "like": {"frequency_like": "push"}}
    asked |= {"twist": {"frequency": "bar", "shape": "torsion"}}
    table = loaded({"force": [1.0, 0.0, 0.0]}, **asked)
    table["rod"]["bar"] |= {
        "density": 1.0,
        "section": {"ellipse": {"a": 0.5, "b": 0.3}},
        "end_section": {"circle": 0.2},
    }
    table["rod"]["bar"]["curve"] = {"straight": 10.0}
    table["analysis"] = {"modal": {"modes": 8, "at_rest": True}}
    found, modes = measured(table)
    assert found["bend"] == found["like"] == pytest.approx(modes.frequencies[1], rel=1e-12)
    assert found["twist"] > 3.0 * found["bend"] and np.abs(modes.frequencies / found["twist"] - 1.0).min() < 1e-9


def test_places_of_contact_are_counted_round_and_along():
    touching = np.zeros((6, 8), dtype=bool)
    touching[0, 0] = touching[1, 7] = touching[5, 0] = touching[3, 4] = True
    assert _places(touching, (False, False)).max() == 4
    assert _places(touching, (False, True)).max() == 3
    number = _places(touching, (True, True))
    assert number.max() == 2 and number[0, 0] == number[1, 7] == number[5, 0] != number[3, 4] > 0
    assert not number[~touching].any()


def test_an_edge_of_hertz_is_found_between_points():
    way = np.linspace(0.0, 2.0, 21)
    pressure = np.sqrt(np.maximum(1.0 - (way / 1.13) ** 2, 0.0))
    last = int(np.flatnonzero(pressure)[-1])
    assert _edge(way, pressure, last) == pytest.approx(1.13, abs=0.004)


def pressed(**measures):
    """Half a bar on a plane in plane strain, as wide as a patch of it is pushed down."""
    table = bar({"components": "z"}, NU, "NeoHookean", **measures)
    table["rod"]["bar"]["space"] = {"elements": 1, "degree": 2, "section_points": 64, "order": 2}
    table["rod"]["bar"]["curve"] = {"straight": 1.0}
    table["support"]["foot"]["components"] = "z"
    table["support"]["top"] = {"patch": {"around": [70, 110], "along": [0, 1]}, "displacement": [0.0, -0.02, 0.0]}
    table["obstacle"] = {"floor": {"Plane": {"point": [0.0, -RADIUS, 0.0], "normal": [0.0, 1.0, 0.0]}}}
    return table | {"contact": {"floor": {"first": "bar", "second": "floor"}}}


def test_the_patch_of_a_cylinder_on_a_plane_is_as_hertz_has_it(measured):
    """Width ``4 sqrt(F R / (pi E*))``, pressure ``4 F / (pi width)``; force and moment as the support has them."""
    names = ("area", "length", "width", "pressure", "places")
    asked = {name if name != "places" else "count": {"contact_patch": "floor", "component": name} for name in names}
    asked |= {"F": {"contact_force": "floor", "component": "y"}, "M": {"contact_moment": "floor", "about": "x"}}
    asked |= {"held": {"reaction": "top", "component": "y"}}
    with pytest.warns(UserWarning, match=r"contact 0: the width of the patch is known to about \d+") as said:
        found, _ = measured(pressed(**asked))
    width = 4.0 * math.sqrt(found["F"] * RADIUS / (math.pi * E / (1.0 - NU**2)))
    error = float(
        next(str(one.message) for one in said if "width" in str(one.message)).split("about ")[1].split(" %")[0]
    )
    assert found["width"] == pytest.approx(width, rel=error / 100.0)
    assert error < 20.0
    assert found["length"] == pytest.approx(1.0, rel=0.25)
    assert found["pressure"] == pytest.approx(4.0 * found["F"] / (math.pi * width), rel=0.1)
    assert found["count"] == 1.0 and found["area"] == pytest.approx(found["width"], rel=0.2)
    assert found["F"] == pytest.approx(-found["held"], rel=1e-6)
    assert found["M"] == pytest.approx(-0.5 * found["F"], rel=1e-6)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"rotation": "bar", "about": "up"}, "about: 'up' is not known"),
        ({"rotation": "bar", "u": 3.0}, "u: got 3, need numbers from 0 to 1"),
        ({"moment": "foot", "component": "x", "about": "y"}, "about: beside component; need one of the two"),
        ({"moment": "foot", "about": [0.0, 0.0, 0.0]}, "about: got .*, need three numbers that are not all zero"),
        ({"frequency": "bar", "shape": "torsion"}, "not available in statics; available: reaction, moment"),
        ({"contact_patch": "bar"}, "'bar' is not known"),
    ],
)
def test_what_cannot_be_measured_is_one_line(asked, said, measured):
    with pytest.raises(InputError, match=said) as problem:
        measured(bar({"displacement": [0.0, 0.0, 1e-3]}, one=asked))
    assert "\n" not in str(problem.value)
