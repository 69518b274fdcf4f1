"""Crossed cylinders against Hertz, of a file that says nothing of spaces, points and penalties; what leads there."""

import warnings

import numpy as np
import pytest
from conftest import straight
from touching import crossing

from comparisons.contact import hertz
from isorod import Body, Contact, LinearElastic, Model, NeoHookean, Plane, Rod, Space, Support, statics
from isorod.command import solving
from isorod.contact.operator import ContactOperator
from isorod.contact.patches import ENOUGH
from isorod.files.scene import FileScene
from isorod.space.closer import Patch, closer
from isorod.space.transfer import transfer

# Of unit force.
APPROACH = 0.012305
MODULUS = hertz.modulus(1000.0, 0.3, 1000.0, 0.3)


def rod_of(radius=1.0):
    rod = straight(8, degree=2, height=4.0)
    return Rod(rod.axis, (rod.control_points - [0.0, 0.0, 2.0]) * [radius, radius, 1.0])


def test_displacements_are_taken_to_other_spaces_of_a_rod():
    rod = rod_of()
    old, rng = Space(rod, elements=2, degree=2, continuity=1, order=2), np.random.default_rng(5)
    new = closer(rod, [Patch(0.5, 0.3, 0.2, 0.2, 0.1)])
    xi, u = 0.7 * rng.standard_normal((9, 2)) / 3.0, rng.uniform(size=7)
    bent = np.where(old.is_control_point[:, None], np.sin(old.positions @ rng.standard_normal((3, 3))), 0.0)
    before, after = (
        space.displacement(nodal, xi, u)[0] for space, nodal in ((old, bent), (new, transfer(bent, old, new)))
    )
    # Of degree 2 with a jump in curvature where the new space has no knot.
    np.testing.assert_allclose(after, before, atol=0.01)
    again = transfer(transfer(bent, old, new), new, new)
    np.testing.assert_allclose(again, transfer(bent, old, new), atol=1e-9)
    finer = Space(rod, elements=4, degree=3, continuity=1, order=2, section_points=16)
    np.testing.assert_allclose(finer.displacement(transfer(bent, old, finer), xi, u)[0], before, atol=1e-10)


def on_plane(press=0.02, **more):
    space = Space.paper(rod_of(), degree=2, order=2)
    back = np.flatnonzero(space.is_control_point & (space.positions[:, 1] > 0.6))
    supports = [Support(back, "xyz", (0.0, -press, 0.0))]
    plane = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0))
    return Model(
        [Body(space, NeoHookean(1000.0, 0.3))],
        supports,
        contacts=[Contact(0, plane, penalty=5e3, points=(4, 6), **more)],
    )


def test_equilibria_are_found_from_where_somebody_says():
    model = on_plane()
    plain = statics.solve(model, load_steps=4)
    near = statics.solve(model, load_steps=4, start=plain.displacement)
    assert near.load_steps == 1 < plain.load_steps
    assert near.newton_iterations <= 3 < plain.newton_iterations
    np.testing.assert_allclose(near.displacement, plain.displacement, atol=1e-9)
    # One that is the answer takes no iteration, and is known to be stable all the same.
    again = statics.solve(model, load_steps=4, start=statics.solve(model, start=near.displacement).displacement)
    assert (again.newton_iterations, again.negative_eigenvalues) == (0, 0)
    # From where there is nothing to be found it begins at rest; friction depends on the path.
    far = 50.0 * np.random.default_rng(1).standard_normal(model.dofs)
    rubs = on_plane(friction=0.3)
    for one, start in ((model, far), (rubs, plain.displacement)):
        found, rest = (statics.solve(one, load_steps=4, start=begin) for begin in (start, None))
        assert found.load_steps == rest.load_steps > 1
        np.testing.assert_allclose(found.displacement, rest.displacement, atol=1e-9)


def test_one_step_with_friction_is_found_from_where_somebody_says():
    """Where points stick and slip depends on the path, which is one step whatever Newton's method begins at."""
    rubs = on_plane(friction=0.3)
    rest = statics.solve(rubs)
    near = statics.solve(rubs, start=rest.displacement)
    assert near.load_steps == rest.load_steps == 1
    assert near.newton_iterations < rest.newton_iterations
    np.testing.assert_allclose(near.displacement, rest.displacement, atol=1e-8)
    np.testing.assert_allclose(near.reactions, rest.reactions, rtol=1e-6, atol=1e-6)
    far = statics.solve(rubs, start=50.0 * np.random.default_rng(1).standard_normal(rubs.dofs))
    assert far.load_steps == 1
    np.testing.assert_allclose(far.displacement, rest.displacement, atol=1e-8)


def test_a_patch_between_points_is_found():
    """The approach is less than what the nearest points lie apart; nothing touched, and forces did not balance."""
    low, high = rod_of(), rod_of()
    turn = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    high = Rod(high.axis, high.control_points @ turn.T + [0.0, 2.0, 0.0])
    spaces = [Space(rod, elements=8, degree=2, order=2, quadrature="4x2") for rod in (low, high)]
    bodies = [Body(space, LinearElastic(1000.0, 0.3)) for space in spaces]
    backs = [
        np.flatnonzero(body.space.is_control_point & (sign * (body.space.positions[:, 1] - middle) > 0.6))
        for body, sign, middle in zip(bodies, (-1.0, 1.0), (0.0, 2.0), strict=True)
    ]
    supports = [Support(backs[0], "xyz"), Support(backs[1], "xyz", (0.0, -0.003, 0.0), 1)]
    with pytest.warns(UserWarning, match="control points wide"):
        (result,) = statics.solve(Model(bodies, supports, contacts=[Contact(0, 1)])).contacts
    assert result.active
    apart = ContactOperator(Model(bodies, contacts=[Contact(0, 1)]))
    moved = np.repeat([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]], [one.space.nodes for one in bodies], axis=0)
    assert not apart.increase_points((np.tile(spaces[0].is_control_point, 2)[:, None] * moved).ravel(), between=True)


HELD = """
[support.floor]
patch = {around = [200.0, 340.0], along = [0.0, 4.0]}
rod = "low"
"""
PUSHED = """
[support.top]
patch = {around = [20.0, 160.0], along = [0.0, 4.0]}
rod = "high"
displacement = [0.0, -APPROACH, 0.0]
"""
PRESSED = """
[support.start]
end = "start"
rod = "high"
components = "xz"

[support.end]
end = "end"
rod = "high"
components = "xz"

[load.start]
end = "start"
rod = "high"
force = [0.0, -0.5, 0.0]

[load.end]
end = "end"
rod = "high"
force = [0.0, -0.5, 0.0]
"""
ON_PIN = """
[rod.bar]
curve = {straight = {start = [0.0, 0.0, -2.0], end = [0.0, 0.0, 2.0]}}
section = {circle = 1.0}
law = {LinearElastic = {E = 1000.0, nu = 0.3}}

[obstacle.pin]
Cylinder = {point = [0.0, -2.0, 0.0], axis = [1.0, 0.0, 0.0], radius = 1.0}

[support.back]
patch = {around = [20.0, 160.0], along = [0.0, 4.0]}
displacement = [0.0, -0.01, 0.0]

[contact.pin]
first = "bar"
second = "pin"

[analysis.statics]
"""


def of_file(path, text, told="error"):
    """Return the contact of a scene as the command solves it; what it warns of fails, if it is not to be ignored."""
    path.write_text(text)
    scene = FileScene(str(path))
    with warnings.catch_warnings(action=told):
        solution, _ = solving.solve(scene, scene.settings())
    return solution.contacts[0]


def errors(result, modulus=MODULUS):
    """Relative errors of a contact's radius, by its area, and largest pressure, against Hertz at its own force."""
    exact = hertz.crossed_cylinders(result.force, modulus, (1.0, 1.0))
    return np.sqrt(result.area / np.pi) / exact.long - 1.0, result.peak / exact.peak - 1.0


@pytest.mark.slow
def test_a_bar_on_a_pin_is_seen_at_the_third_look(tmp_path, monkeypatch):
    """At the first the radius is 40 % too small, and the largest pressure several times Hertz'."""
    monkeypatch.setattr(solving, "REFINEMENTS", 2)
    result = of_file(tmp_path / "bar.toml", ON_PIN, "ignore")
    assert result.cells_across > ENOUGH * 5.0
    assert errors(result, hertz.modulus(1000.0, 0.3)) == pytest.approx((0.0, 0.0), abs=0.05)


@pytest.mark.slow
def test_cylinders_pressed_on_each_other_are_those_of_hertz_by_default(tmp_path):
    result = of_file(tmp_path / "bars.toml", crossing() + HELD + PRESSED)
    assert abs(result.resultant[1]) == pytest.approx(1.0, abs=1e-6)
    assert errors(result) == pytest.approx((0.0, 0.0), abs=0.05)


@pytest.mark.slow
def test_cylinders_pushed_onto_each_other_are_those_of_hertz_by_default(tmp_path):
    """Between the backs there is more than Hertz' half spaces: what adds to the approach is linear in the force.

    Two pushes tell both: ``approach = K F^(2/3) + C F``.
    """
    results = [
        of_file(tmp_path / "bars.toml", crossing() + HELD + PUSHED.replace("APPROACH", str(approach)))
        for approach in (APPROACH, 0.25 * APPROACH)
    ]
    for one in results:
        assert errors(one) == pytest.approx((0.0, 0.0), abs=0.05)
    forces = np.array([one.force for one in results])
    found = np.linalg.solve(np.stack([forces ** (2.0 / 3.0), forces], axis=1), [APPROACH, 0.25 * APPROACH])
    assert (found[0] / APPROACH) ** -1.5 == pytest.approx(1.0, abs=0.05)
