"""Modes about an equilibrium with contact: what presses holds as a support does, and slides where it is free to."""

import json

import combinations
import numpy as np
import pytest
from petsc4py import PETSc
from vibrations import fixed, pinned, wave

from isorod import InputError, NeoHookean, Space, modal, straight
from isorod.command.cli import main
from isorod.contact.frozen import Frozen
from isorod.geometry import section
from isorod.modal import touching
from isorod.model import Body, BodyForce, Contact, Cylinder, Model, Plane, Support

E = 1000.0
LAW = NeoHookean(E, 0.3)
FLOOR = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0))
# Bending stiffness and mass per length.
BEAM = E * np.pi / 4.0, np.pi
UNSEEN = "ignore:contact 0. contact patch under-resolved. .* on body 0"


def bar(length, elements, degree=4, outline=None):
    outline = section.circle(8) if outline is None else outline
    rod = straight(length).sweep(outline)
    return Space(rod, elements=elements, degree=degree, order=2, section_points=len(outline), continuity=1)


@pytest.mark.filterwarnings(UNSEEN)
def test_a_post_under_the_end_of_a_clamped_bar_is_a_support_whatever_the_penalty():
    """Up and down it is pinned where it touches, sideways it is free; one is told by the other where it is clamped."""
    length, found = 80.0, []
    for penalty in (None, 3e2):
        space = bar(length, 8)
        post = Cylinder((0.0, -1.5, length - 0.5), (1.0, 0.0, 0.0), 0.7)
        contact = Contact(0, post, penalty, points=(12, 24))
        model = Model([Body(space, LAW, 1.0)], [Support.end(space, "start")], contacts=[contact])
        found.append(modal.solve(model, 3))
    touched = found[0].contacts[0].positions[found[0].contacts[0].pressure > 0.0][0, 2]
    sideways, up, _ = found[0].frequencies
    free = (1.8751040687 / length) ** 2 * np.sqrt(E / 4.0) / (2.0 * np.pi)
    assert sideways == pytest.approx(free, rel=5e-3)
    assert up / sideways == pytest.approx(pinned(0.0, touched, *BEAM) / free, rel=2e-3)
    for other in found[1:]:
        assert other.frequencies == pytest.approx(found[0].frequencies, rel=1e-3)
    assert found[0].about == "the equilibrium under 1 contact with 2 points in contact"
    assert 1e-5 < found[0].estimate() < 5e-3


def rolled(force, length):
    """Return the frequency of a beam clamped at both ends, half of it so long, that rolls on a fixed point halfway."""

    def missed(k, w):
        turn = k / length * w / length * np.sqrt(E / 4.0) / np.sqrt(E / 2.6)
        spring = E / 2.6 * 0.5 * np.pi * turn / np.tan(turn * length)
        # w = a (cosh - cos) + b (sinh / w - sin / k) without slope in the middle; over cosh.
        th, c, s = np.tanh(w), np.cos(k) / np.cosh(w), np.sin(k) / np.cosh(w)
        one = 1.0 - c, w * th + k * s, w**3 * th - k**3 * s
        two = th / w - s / k, 1.0 - c, w**2 + k**2 * c
        bending = E * np.pi / 4.0 / length**3
        a, b = two[1], -one[1]
        return bending * (a * one[2] + b * two[2]) - spring * (a * one[0] + b * two[0])

    return wave(missed, force, length, *BEAM, 0.55, 0.999)


@pytest.mark.filterwarnings(UNSEEN)
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_string_over_a_cylinder(friction):
    """It halves the string across; along itself it is slid over, or rolled on if it is rough."""
    length, longer = 100.0, 104.0
    space = bar(length, 7, 5)
    over = Cylinder((0.0, -2.5, 0.5 * length), (1.0, 0.0, 0.0), 1.8)
    way = 0.5 * (longer - length)
    ends = [Support.end(space, end, displacement=(0.0, 0.0, z)) for end, z in (("start", -way), ("end", way))]
    contact = Contact(0, over, 3e3, points=(3, 25), friction=friction)
    modes = modal.solve(Model([Body(space, LAW, 1.0)], ends, contacts=[contact]), 4)
    force = modes.equilibrium.reactions[1, 2]
    # Of its mass more length has as much.
    lighter = np.sqrt(longer / length)
    halves = [lighter * end(force, 0.5 * longer, *BEAM) for end in (pinned, fixed)]
    whole = lighter * fixed(force, longer, *BEAM)
    free = [whole, halves[0], halves[0], halves[1]]
    rough = [lighter * rolled(force, 0.5 * longer), halves[0], halves[0], halves[1]]
    # Stretched by 4 % it is thinner, and twists more easily.
    assert modes.frequencies == pytest.approx(rough if friction else free, rel=7e-3)


def test_a_file_says_how_many_points_are_in_contact(tmp_path, capsys):
    path = tmp_path / "post.toml"
    path.write_text(
        """analysis = {modal = {modes = 2}}
[rod.bar]
curve = {straight = 80.0}
section = {circle = {radius = 1.0}}
law = {NeoHookean = {E = 1e3, nu = 0.3}}
density = 1.0
space = {elements = 8, degree = 4, order = 2, section_points = 8}
[support.start]
end = {end = "start"}
[obstacle.post]
Cylinder = {point = [0.0, -1.5, 79.5], axis = [1.0, 0.0, 0.0], radius = 0.7}
[contact.on]
first = "bar"
second = "post"
points = [12, 24]
"""
    )
    assert main(["run", str(path), "--json"]) == 0
    out, err = capsys.readouterr()
    record = json.loads(out)
    assert record["about"].startswith("the equilibrium under 1 contact with ")
    assert record["frequencies"][1] > 4.0 * record["frequencies"][0]
    assert "error_estimate" in record and "control points wide" in err


def lying(outline, floor, friction=0.0, push=0.0, hold=""):
    space = bar(4.0, 1, 3, outline)
    supports = [Support.end(space, "start", hold)] if hold else []
    contacts, load = [Contact(0, floor, friction=friction, points=(3, 6))], BodyForce((push, -1.0, 0.0))
    return Model([Body(space, LAW, 1.0)], supports, contacts=contacts, loads=[load])


@pytest.mark.filterwarnings("ignore:contact 0")
def test_a_bar_that_lies_on_a_plane_slides_and_turns_on_it_but_does_not_roll():
    flat = section.rounded_rectangle(16, 2.0, 1.0, 0.2), Plane((0.0, -0.5, 0.0), (0.0, 1.0, 0.0))
    modes = modal.solve(lying(*flat), 2)
    assert modes.rigid == 3
    assert np.abs(modes.frequencies[:3]).max() < 1e-5 * modes.frequencies[3]
    rough = modal.solve(lying(*flat, friction=0.5), 2)
    assert rough.rigid == 0
    assert rough.frequencies[0] > 0.3 * modes.frequencies[3]
    with pytest.raises(InputError, match=r"contact 0: \d+ of \d+ points slip; modes are of points that stick"):
        modal.solve(lying(*flat, friction=0.2, push=0.6, hold="x"), 2)
    with pytest.raises(
        InputError, match=r"equilibrium: body 0 is free to turn about .* but for the width of contact patches"
    ):
        modal.solve(lying(section.circle(8), FLOOR), 2)


@pytest.mark.filterwarnings("ignore:contact 0")
def test_a_bar_that_slides_is_softer_on_springs_of_all_points(monkeypatch):
    """Rigid modes are left out: inverse iteration is shifted."""
    model = lying(section.rounded_rectangle(16, 2.0, 1.0, 0.2), Plane((0.0, -0.5, 0.0), (0.0, 1.0, 0.0)))
    modes = modal.solve(model, 3)
    free = slice(modes.rigid, None)
    elastic = modes.eigenvalues[free], modes.vectors[free]
    # As on finer spaces, where the equilibrium is corrected first.
    assert all(0.0 < modes.estimate(direction) < 0.2 for direction in ("section", "axis"))
    contact = Frozen(model, model.contacts, modes.contacts, modes.state, PETSc.COMM_SELF, tight=True)
    within = contact.compliance(modes.vectors[free])[0] / modes.eigenvalues[free]
    monkeypatch.setattr(touching, "_SURE", 0.0)
    found = touching.doubt(model, modes.equilibrium, *elastic, free=True)
    monkeypatch.setattr(touching, "Frozen", lambda *given, **how: Frozen(*given, **how | {"tight": False}))
    springs = modal.solve(model, 3, state=modes.equilibrium)
    expected = 1.0 - springs.frequencies[free] / modes.frequencies[free]
    assert expected.max() > 1e-3
    assert found == pytest.approx((expected + 0.5 * within).max(), rel=1e-2)


def test_what_touches_at_rest_is_left_out_of_modes_at_rest():
    model = lying(section.circle(8), Plane((0.0, -0.9, 0.0), (0.0, 1.0, 0.0)))
    assert modal.solve(model, 2, at_rest=True).rigid == 6


@pytest.mark.filterwarnings(UNSEEN)
def test_what_is_not_known_of_a_patch_counts_in_the_estimate():
    """A thick bar on a post: with springs of all points in the place of mean gaps a mode is 7 % lower."""
    space = bar(10.0, 4, 4)
    post = Cylinder((0.0, -1.9, 5.0), (1.0, 0.0, 0.0), 1.0)
    ends = [Support.end(space, end) for end in ("start", "end")]
    modes = modal.solve(Model([Body(space, LAW, 1.0)], ends, contacts=[Contact(0, post, points=(6, 12))]), 3)
    # Of a direction alone it is no part: no refinement lowers it.
    assert modes.estimate("section") + modes.estimate("axis") + 0.02 < modes.estimate() < 1.0


@pytest.mark.filterwarnings(UNSEEN)
@pytest.mark.filterwarnings("ignore:estimated error")
def test_cells_whose_reactions_cancel_are_no_doubt(monkeypatch):
    """A soft wall: reactions of cells alone would tell of errors of hundreds of per cent; the bound is a solution."""
    space = bar(6.0, 4, 3)
    wall = Cylinder((0.0, 6.1, 4.5), (1.0, 0.0, 0.0), 5.0)
    supports = [Support.end(space, "start"), Support.end(space, "end", displacement=(0.05, 0.3, 0.0))]
    model = Model([Body(space, LAW, 1.0)], supports, contacts=[Contact(0, wall, penalty=300.0)])
    modes = modal.solve(model, 3)
    contact = Frozen(model, model.contacts, modes.contacts, modes.state, PETSc.COMM_SELF, tight=True)
    within, reactions = contact.compliance(modes.vectors)
    found = touching.doubt(model, modes.equilibrium, modes.eigenvalues, modes.vectors)
    monkeypatch.setattr(touching, "Frozen", lambda *given, **how: Frozen(*given, **how | {"tight": False}))
    springs = modal.solve(model, 3, state=modes.equilibrium)
    expected = 1.0 - springs.frequencies / modes.frequencies
    assert (reactions / modes.eigenvalues).max() > 2.0 > 1.0 > 3.0 * expected.max()
    assert found == pytest.approx((expected + 0.5 * within / modes.eigenvalues).max(), rel=1e-2)


@pytest.mark.parametrize(("tolerance", "warned"), [(0.1, True), (0.9, False)])
def test_a_tolerance_says_what_patches_of_contact_may_change_beside_it(tolerance, warned, tmp_path, capsys):
    """No refinement of the spaces lowers that, so it is no part of the error that is reached."""
    path = tmp_path / "wall.toml"
    path.write_text(combinations.scene("modes", "contact"))
    assert main(["run", str(path), "--tolerance", str(tolerance), "--json"]) == 0
    out, err = capsys.readouterr()
    assert 0.0 < json.loads(out)["error_estimate"] <= tolerance
    assert ("patches may change frequencies by up to" in err) == warned
