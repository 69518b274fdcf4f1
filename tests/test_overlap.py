"""Bodies that run through each other or themselves are warned of, with place and depth."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from conftest import straight
from pushed import ACROSS, LAW, ROD, rods

from isorod import Body, Contact, InputError, Model, Space, Support, circle, helix, statics
from isorod.checks import overlap
from isorod.geometry import boxes
from isorod.scenes.biceps import Biceps
from isorod.scenes.spring import Spring


@pytest.mark.parametrize("depth", [0.015, 0.1, 0.5])
@pytest.mark.parametrize("turn", [None, ACROSS], ids=["parallel", "crossing"])
def test_two_rods_that_overlap_are_found_with_place_and_depth(depth, turn):
    found = overlap.deepest(rods((0.3 * (turn is not None), 2.0 - depth, 0.2), turn=turn))
    assert found.bodies == (0, 1)
    assert found.depth == pytest.approx(depth, abs=0.005)
    assert found.relative == pytest.approx(found.depth, rel=1e-9)
    assert not found.declared
    if turn is not None:
        # z is twice u, from the middle.
        np.testing.assert_allclose(found.u, (1.5 + 0.1, 1.5 - 0.15), atol=0.15)


@pytest.mark.parametrize("depth", [-0.3, -0.001, 0.005])
@pytest.mark.parametrize("turn", [None, ACROSS], ids=["parallel", "crossing"])
def test_rods_that_touch_do_not_overlap(depth, turn):
    assert overlap.deepest(rods((0.0, 2.0 - depth, 0.0), turn=turn)) is None


def test_rods_end_to_end_do_not_overlap_and_rods_in_one_place_do():
    assert overlap.deepest(rods((0.0, 0.0, 6.0))) is None
    assert overlap.deepest(rods((0.0, 0.0, 0.0))).relative > 0.9


def test_a_rod_in_the_hole_of_a_tube_does_not_overlap_it():
    tube = Space(ROD.with_rings((0.5, 1.0)), section_degree=2)
    for radius, deep in ((0.45, False), (0.6, True)):
        inner = Space.paper(straight(8, breaks=(0.0, 1.0), radius=radius, height=6.0))
        found = overlap.deepest(Model([Body(tube, LAW), Body(inner, LAW)]))
        assert (found is not None) is deep


@pytest.mark.parametrize(("pitch", "depth"), [(2.05, None), (1.9, 0.1), (1.2, 0.8)])
def test_coils_of_one_wire(pitch, depth):
    space = Space.paper(helix(6.0, pitch, 3).sweep(circle(8, 1.0)), elements=24, degree=4)
    found = overlap.deepest(Model([Body(space, LAW)]))
    if depth is None:
        assert found is None
        return
    assert found.bodies == (0, 0)
    assert found.depth == pytest.approx(depth, abs=0.02)
    # A turn apart.
    assert abs(found.u[1] - found.u[0]) == pytest.approx(np.ptp(space.axis.breaks) / 3.0, rel=0.05)


def test_a_closed_ring_does_not_overlap_itself():
    space = Space.paper(helix(2.0, 0.0, 1, 4).sweep(circle(8, 1.0), closed=True))
    assert overlap.deepest(Model([Body(space, LAW)])) is None


def test_what_is_near_nothing_costs_one_stage_alone(monkeypatch):
    monkeypatch.setattr(overlap, "_depths", lambda *_: pytest.fail("outlines were looked at"))
    for model in (
        Spring(helix="paper", elements_per_turn=4).model(),
        Spring(preset="paper").model(),
        rods((0.0, 2.5, 0.0)),
    ):
        assert overlap.deepest(model) is None


def test_elements_that_a_contact_leaves_out_are_left_out():
    """The tendons of both heads of the biceps grow together; contact names the bellies."""
    model = Biceps().model()
    assert overlap.deepest(model) is None
    assert overlap.deepest(replace(model, contacts=())).relative > 0.5


def test_a_spring_beyond_its_bind_is_warned_of():
    scene = Spring(helix="paper", coils=2)
    bind = scene.coils * (scene.pitch - 2.0 * scene.wire_radius)
    with pytest.warns(
        UserWarning, match=r"final overlap: body 0 at \S+ = \S+ penetrates itself at \S+ = \S+ by 0\.\d+"
    ) as said:
        statics.solve(replace(scene, travel=-2.0 * bind).model(), load_steps=2)
    assert len(said) == 1
    assert re.search("no contact is defined between them; add one$", str(said[0].message))
    with warnings.catch_warnings(action="error"):
        statics.solve(replace(scene, travel=-0.8 * bind).model(), load_steps=2)


def test_wires_that_overlap_at_rest_are_warned_of():
    model = rods((0.0, 1.9, 0.0), contacts=[Contact((0, 1), penalty=100.0)])
    ends = [Support.end(body.space, end, body=b) for b, body in enumerate(model.bodies) for end in ("start", "end")]
    with pytest.warns(
        UserWarning, match=r"initial overlap: body 0 .* penetrates body 1 .* by 0\.1, .* forces act before any load"
    ):
        solution = statics.solve(replace(model, supports=ends))
    assert solution.contacts[0].force > 1.0


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (0.0, 0.5, 0.0), (0.3, 0.9, 0.2)])
@pytest.mark.parametrize("turn", [None, ACROSS], ids=["parallel", "crossing"])
def test_contact_cannot_part_what_is_in_each_other_beyond_the_middle(offset, turn):
    contacts = [Contact((0, 1), penalty=100.0)]
    with pytest.raises(
        InputError, match=r"initial overlap: body 0 .* penetrates body 1 .*: too deep for contact to separate them"
    ):
        overlap.warn_at_rest(rods(offset, turn=turn, contacts=contacts))
    with pytest.warns(UserWarning, match="initial overlap"):
        overlap.warn_at_rest(rods((0.0, 1.1, 0.0), turn=turn, contacts=contacts))


def test_pairs_of_boxes_are_those_that_overlap():
    rng = np.random.default_rng(0)
    low = rng.uniform(0.0, 10.0, (300, 3)) * [1.0, 3.0, 1.0]
    high = low + rng.exponential(0.7, (300, 3))
    meet = ((low[:, None] <= high) & (low <= high[:, None])).all(axis=2)
    expected = {(i, j) for i, j in np.argwhere(meet) if i < j}
    found = [tuple(sorted(pair)) for pair in zip(*boxes.pairs(low, high), strict=True)]
    assert len(found) == len(expected) > 20
    assert set(found) == expected
