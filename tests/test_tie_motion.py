"""What ties carry in implicit motion: the rate of the momenta of what they hold; files, curves, explicit steps."""

import numpy as np
import pytest
from motions import momenta
from test_ties import WELD, bar

from isorod import LinearElastic, dynamics
from isorod.errors import InputError
from isorod.files.scene import FileScene
from isorod.model import Body, Model, Support
from isorod.model.tie import EndFace, Tie

LAW = LinearElastic(10.0, 0.3)
PUSH = np.array([0.0, 3e-6, 2e-6])
BONDED = Tie(EndFace(1, "start"), EndFace(0, "end"), kind="slide", bond=20.0)
CENTER = np.array([0.0, 0.0, 2.0])


def pair(tie):
    """Return two bars, the first one held below and tied to the second above."""
    lower, upper = (bar(2.0, (0.0, 0.0, z), elements=2, order=2, degree=3, continuity=0) for z in (0.0, 2.0))
    return Model([Body(one, LAW, 1.0) for one in (lower, upper)], [Support.end(lower, "start")], ties=[tie])


def moving(model, step, outputs):
    """Return a motion in which the pair bends, twists and stretches, an output each step."""
    start = np.zeros(model.dofs // 3 * 3).reshape(-1, 3)
    rows = slice(model.bodies[0].space.nodes, None)
    upper = model.bodies[1].space
    start[rows] = np.cross([2e-6, 1e-6, 3e-6], upper.positions) + upper.is_control_point[:, None] * PUSH
    return dynamics.solve(model, step * outputs, step, outputs=outputs, integrator="implicit", velocity=start.ravel())


def rates(model, history, step):
    """Return the rates of momentum and angular momentum of the upper bar at all outputs but the first and last."""
    space = model.bodies[1].space
    own = momenta(model, history.velocity).reshape(len(history), -1, 3)[:, model.bodies[0].space.nodes :]
    arms = space.positions - space.is_control_point[:, None] * CENTER
    found = (own * space.is_control_point[:, None]).sum(axis=1), np.cross(arms, own).sum(axis=1)
    return [(one[2:] - one[:-2]) / (2.0 * step) for one in found]


@pytest.mark.parametrize(
    ("tie", "sign"),
    [(WELD, 1.0), (Tie(EndFace(0, "end"), EndFace(1, "start")), -1.0), (BONDED, 1.0)],
    ids=["upper", "lower", "bonded"],
)
def test_a_tie_exerts_what_changes_the_momenta(tie, sign):
    """Central differences of them are the tie's force and moment but for an error of second order in the step."""
    model, errors = pair(tie), []
    for step, outputs in ((0.02, 20), (0.01, 40)):
        history = moving(model, step, outputs)
        carried = [sign * one[1:-1, 0] for one in (history.tie_forces, history.tie_moments)]
        errors.append(
            [np.abs(a - b).max() / np.abs(b).max() for a, b in zip(carried, rates(model, history, step), strict=True)]
        )
    coarse, fine = np.array(errors)
    assert (fine < 0.02).all()
    assert np.log2(coarse / fine) == pytest.approx([2.0, 2.0], abs=0.3)


def test_forces_of_ties_are_among_the_curves_and_the_record():
    model = pair(WELD)
    history = moving(model, 0.05, 4)
    assert history.tie_forces.shape == history.tie_moments.shape == (5, 1, 3)
    curves = history.curves()
    np.testing.assert_array_equal(curves["tie 0 force y"], history.tie_forces[:, 0, 1])
    np.testing.assert_array_equal(curves["tie 0 moment x"], history.tie_moments[:, 0, 0])
    np.testing.assert_array_equal(history.record()["tie_forces"], history.tie_forces)


def test_explicit_steps_tell_of_none():
    model = pair(WELD)
    history = dynamics.solve(model, 0.1, outputs=2)
    assert history.tie_forces.shape == (3, 0, 3)
    assert "tie_forces" not in history.record()


def bars(integrator):
    return f"""
[rod.lower]
curve = {{straight = 2.0}}
section = {{circle = 0.5}}
space = {{elements = 4, degree = 3, section_degree = 2}}
law = {{NeoHookean = {{E = 10.0, nu = 0.3}}}}
density = 1.0
[rod.upper]
curve = {{straight = {{start = [0.0, 0.0, 2.0], end = [0.0, 0.0, 4.0]}}}}
section = {{circle = 0.5}}
space = {{elements = 4, degree = 3, section_degree = 2}}
law = {{NeoHookean = {{E = 10.0, nu = 0.3}}}}
density = 1.0
[support.foot]
rod = "lower"
end = "start"
[load.push]
rod = "upper"
end = "end"
force = [0.0, 0.0, 0.01]
[tie.weld]
slave = "upper.start"
master = "lower.end"
[measure.pull]
tie_force = "weld"
component = "z"
[measure.turn]
tie_moment = "weld"
[analysis.dynamics]
end_time = 2.0
time_step = 0.025
outputs = 4
integrator = "{integrator}"
"""


def test_a_file_asks_for_them(tmp_path):
    path = tmp_path / "my.toml"
    path.write_text(bars("implicit"))
    scene = FileScene(str(path))
    history = dynamics.solve(scene.model(), **scene.settings())
    found = scene.measure(history)
    np.testing.assert_array_equal(found["pull"], history.tie_forces[:, 0, 2])
    np.testing.assert_array_equal(found["turn"], history.tie_moments[:, 0])
    # A load that comes at once sends a wave; before it arrives the tie carries nothing.
    assert abs(found["pull"][0]) < 1e-5 and found["pull"][-1] < -0.005
    path.write_text(bars("explicit"))
    with pytest.raises(
        InputError, match=r"^[^\n]*measure.pull.tie_force: tie forces are not available in explicit steps[^\n]*$"
    ):
        FileScene(str(path))
