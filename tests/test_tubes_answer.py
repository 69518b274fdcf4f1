"""What solutions answer of hollow and layered rods: a centre without material, forces of the wall alone."""

import numpy as np
import pytest
from conftest import straight

from isorod import Body, InputError, LinearElastic, Model, NeoHookean, SectionLoad, Space, Support, statics
from isorod.output.state import State

RUBBER = NeoHookean(20.0, 0.3)
STIFF = NeoHookean(200.0, 0.3)


def rod(rings):
    return straight(6, radius=0.5, height=6.0).with_rings(rings)


def test_centre_of_a_tube_is_the_mean_of_its_hole():
    tube = rod((0.5, 1.0))
    space = Space(tube, section_degree=2)
    model = Model([Body(space, RUBBER)])
    F = np.array([[1.1, 0.2, 0.0], [0.0, 0.9, 0.1], [0.3, 0.0, 1.2]])
    state = State(model, (space.positions @ (F - np.eye(3)).T).ravel())
    height = np.array([0.0, 0.0, 3.0])
    assert state.position(tube, 0.5) == pytest.approx(F @ height, abs=1e-12)
    assert state.at(tube, [0.5, 0.5]) == pytest.approx(np.tile((F - np.eye(3)) @ height, (2, 1)), abs=1e-12)
    assert state.centre_line(tube, 3)[1] == pytest.approx(F @ height, abs=1e-12)
    assert state.at(tube, 0.5, (0.25, 0.5)).shape == (3,)
    for call in (state.at, state.position, state.stress, state.deformation_gradient):
        with pytest.raises(InputError, match=r"^disk points xi: the rod is hollow, need points from 0.5 to 1 away"):
            call(tube, 0.5, (0.2, 0.0))
    with pytest.raises(InputError, match="the rod is hollow"):
        state.stress(tube, 0.5)


def test_tube_with_an_end_load():
    tube, load = rod((0.5, 1.0)), 0.01
    space = Space(tube, section_degree=3, degree=3, elements=8)
    clamped = Support.end(space, "start")
    body = Body(space, LinearElastic(200.0, 0.3))
    solution = statics.solve(Model([body], [clamped], loads=[SectionLoad((load, 0.0, 0.0))]))
    found = solution.section_forces(tube, [0.0, 0.3, 1.0])
    assert found.Q == pytest.approx(np.tile([load, 0.0], (3, 1)), abs=1e-9 * load)
    assert found.M[:, 2] == pytest.approx(load * np.array([6.0, 4.2, 0.0]), abs=1e-8 * load)


def test_core_and_sheath_are_in_balance():
    cable = rod((0.0, 0.5, 1.0))
    space = Space(cable, section_degree=3, degree=3, elements=8)
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(1.0, 0.0, 0.0))
    solution = statics.solve(Model([Body(space, [STIFF, RUBBER])], ends))
    found = solution.section_forces(cable, [0.0, 0.3, 1.0])
    assert found.force == pytest.approx(np.tile(solution.reactions[1], (3, 1)), abs=1e-6)
    assert found.moment[-1] == pytest.approx(solution.moments[1], abs=1e-6)
    inner, outer = solution.stress(cable, 0.3, [(0.49, 0.0), (0.51, 0.0)], kind="von Mises")
    assert inner > 3.0 * outer
