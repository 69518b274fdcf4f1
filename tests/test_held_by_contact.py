"""Bodies that contact alone holds in statics: forces are those of the loads, and what held them on the way vanishes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from refused import refused
from touching import ACROSS, STIFF, bar

from isorod import Body, BodyForce, Contact, Model, Plane, Rod, SectionLoad, SolveError, Support, files, statics
from isorod.assembly.assembler import Assembler
from isorod.space.closer import Patch, closer
from isorod.statics.stabilisation import Stabilisation

LENGTH = 8.0


def lying(gap, density, **contact):
    """A bar above a plane, without a support."""
    plane = Plane((0.0, -1.0 - gap, 0.0), (0.0, 1.0, 0.0))
    return Model([Body(bar(LENGTH), STIFF)], contacts=[Contact(0, plane, **contact)], loads=[BodyForce(density)])


def crossing(force, gap=0.1, **contact):
    """Two bars, the lower clamped; the upper is guided down and pressed by a force at either end."""
    spaces = bar(LENGTH), bar(LENGTH, ACROSS, 2.0 + gap)
    supports = [Support.end(spaces[0], end) for end in ("start", "end")]
    supports += [Support.end(spaces[1], end, "xz", body=1) for end in ("start", "end")]
    loads = [SectionLoad.end(spaces[1], end, (0.0, -0.5 * force, 0.0), body=1) for end in ("start", "end")]
    return Model([Body(one, STIFF) for one in spaces], supports, contacts=[Contact(0, 1, **contact)], loads=loads)


@pytest.mark.parametrize("gap", [0.1, 3.0])
def test_a_plane_bears_the_weight_of_a_bar_that_nothing_else_holds(gap):
    solution = statics.solve(lying(gap, (0.0, -1.0, 0.0), penalty=1e4, points=(24, 12)))
    volume = solution.model.bodies[0].space.tabulate(0, 2).weights.sum()
    (contact,) = solution.contacts
    assert contact.force == pytest.approx(volume, rel=1e-6)
    left, rounds = solution.stabilisation
    assert left <= 1e-6
    assert rounds >= 1
    assert solution.record()["stabilisation"] == left
    assert solution.record()["stabilisation_rounds"] == rounds
    # However far it fell, it lies level, pressed flat by its weight: by 0.006 in the middle, less at the ends.
    fallen = solution.at(0, [0.0, 1.0, 2.0])[:, 1] + gap
    assert fallen[0] == pytest.approx(fallen[2], abs=1e-7)
    assert fallen[1] == pytest.approx(-0.006063, abs=2e-6)


def test_a_bar_that_another_holds_up_bears_the_force_on_it_wherever_it_came_from():
    force, found = 20.0, []
    for gap in (0.1, 0.7):
        solution = statics.solve(crossing(force, gap, penalty=1e4, points=(4, 12)))
        assert solution.stabilisation[0] <= 1e-6
        np.testing.assert_allclose(solution.reactions[:2].sum(axis=0), (0.0, force, 0.0), atol=1e-5 * force)
        found.append(solution.at(1, "end")[1] + gap)
    assert -1.0 < found[0] < -0.1
    assert found[1] == pytest.approx(found[0], rel=1e-5)


def test_what_supports_hold_is_not_stabilised():
    model = lying(0.1, (0.0, -1.0, 0.0))
    clamped = statics.solve(replace(model, supports=[Support.end(model.bodies[0].space, "start")]))
    assert clamped.stabilisation is None
    assert "stabilisation" not in clamped.record()


def test_what_holds_a_bar_does_not_depend_on_how_many_functions_it_has():
    """Sums of functions that are close together at a patch can be next to nothing; their softness is none of a bar."""
    model = crossing(0.01)
    rod = Rod(model.bodies[1].space.rod.axis, model.bodies[1].space.rod.control_points)
    fine = closer(rod, [Patch(1.0, -0.5 * np.pi, 0.1, 0.1, 0.08)])
    held = []
    for space in (model.bodies[1].space, fine):
        lone = Model([Body(space, STIFF)], [Support.end(space, end, "xz") for end in ("start", "end")])
        assembler = Assembler(lone)
        matrix = assembler.matrix()
        assembler.tangent(assembler.vector(), 0.0, matrix)
        stabilisation = Stabilisation(assembler, matrix, [(0, space.is_control_point[:, None] * [0.0, 1.0, 0.0])])
        low = assembler.state((space.is_control_point[:, None] * [0.0, 1.0, 0.0]).ravel())
        out = assembler.vector()
        stabilisation.add_forces(low, out, 1.0)
        held.append(out.dot(low))
    assert held[1] == pytest.approx(held[0], rel=0.5)


FALLING = lying(0.1, (0.0, -1.0, 0.0))
NO_CONTACT = r"supports: body 0 is free to .* \(rigid-body mode\); add a support, or a contact in statics"
test_what_contact_cannot_hold_is_refused_and_the_motion_named = refused(
    (
        lying(0.1, (0.1, -1.0, 0.0)),
        r"body 0 is free to move along \(1, -?0.0\S*, 0\) \(rigid-body mode\), no active contact",
    ),
    (crossing(-1.0), r"body 1 is free to move along \(0, 1, 0\) \(rigid-body mode\), no active contact at the end"),
    *((replace(FALLING, contacts=contacts), NO_CONTACT) for contacts in ([], [Contact(0)])),
    by=statics.solve,
    error=SolveError,
)


@pytest.mark.slow
def test_a_rope_on_dead_loads_is_hauled_by_a_drum(tmp_path):
    """Friction alone holds it; the torque is that of the loads, and of the bend that one side makes as it is laid."""
    text = (Path(files.__file__).parent / "examples" / "contact" / "drum.toml").read_text()
    text = text.replace('[support.held]\nend = "end"\n', '[load.held]\nend = "end"\nforce = [-0.6, 0.0, 0.0]\n')
    (tmp_path / "rope.toml").write_text(text[: text.index("[measure.pull]")] + text[text.index("[measure.torque]") :])
    scene = files.find(str(tmp_path / "rope.toml"))
    with pytest.warns(UserWarning, match="under-resolved"):
        solution = statics.solve(scene.model(), **scene.settings())
    radius, bending = 20.25, 1000.0 * np.pi * 0.25**4 / 4.0
    assert scene.measure(solution)["torque"] == pytest.approx(0.4 * radius + bending / radius, rel=2e-3)
