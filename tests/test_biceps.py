"""The biceps: its geometry, its laws, the equilibrium of its active muscle, and what it measures."""

import dataclasses
import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import KDTree

from isorod import Contact, InputError, Model, Muscle, NeoHookean, Plane, Support, dynamics, statics
from isorod.command import cli, solving
from isorod.scenes.biceps import Biceps

THETA = 2 * np.pi * np.arange(128) / 128
CIRCLE = np.stack([np.cos(THETA), np.sin(THETA)], axis=1)
HEIGHTS = np.linspace(0.0, 20.0, 401)


def surface(rod, u=HEIGHTS):
    return rod.grid(CIRCLE, u)[0]


@pytest.fixture(scope="module")
def branches():
    return Biceps().rods()


def test_branches_are_the_papers_net(branches):
    for rod in branches:
        assert (rod.axis.degree, rod.axis.elements, rod.axis.count, rod.section_points) == (2, 5, 7, 8)
        assert rod.check() > 0
        assert np.array_equal(rod.axis.weights, np.ones(7))


def test_sections_are_circles_normal_to_y_of_the_stated_radii(branches):
    for rod in branches:
        points = surface(rod)
        assert np.abs(points[:, :, 1] - HEIGHTS[:, None]).max() < 1e-13
        center = rod.grid(np.zeros((1, 2)), HEIGHTS)[0][:, 0]
        radii = np.linalg.norm(points - center[:, None], axis=2)
        assert np.ptp(radii, axis=1).max() < 1e-13
        assert radii[[0, 200, -1], 0] == pytest.approx([0.7, 1.6, 0.7], rel=1e-13)
        assert radii.max() == pytest.approx(1.6, rel=1e-13)
        assert np.abs(center[:, 2]).max() < 1e-13


def test_branches_mirror_each_other(branches):
    left, right = (surface(rod) for rod in branches)
    mirrored = left[:, (64 - np.arange(128)) % 128] * [-1, 1, 1]
    assert np.abs(mirrored - right).max() < 1e-13
    assert right[:, :, 0].mean() > 0


def test_bellies_are_apart_by_the_gap_the_lower_ends_overlap_and_the_upper_do_not(branches):
    left, right = (surface(rod) for rod in branches)
    belly = (HEIGHTS >= 4.0) & (HEIGHTS <= 16.0)
    distance, _ = KDTree(left[belly].reshape(-1, 3)).query(right[belly].reshape(-1, 3))
    assert distance.min() == pytest.approx(0.1, rel=1e-12)
    assert right[belly][:, :, 0].min() == pytest.approx(0.05, rel=1e-12)
    assert right[0, :, 0].min() == pytest.approx(0.15 - 0.7, rel=1e-12)
    assert right[-1, :, 0].min() == pytest.approx(2.0 - 0.7, rel=1e-12)


@pytest.mark.parametrize(("elements", "ends"), [(5, 0), (10, 1), (5, 3)])
def test_tendons_and_muscle_have_their_laws_where_they_are(elements, ends):
    model = Biceps(elements=elements, end_elements=ends, activation=0.5).model()
    for body in model.bodies:
        breaks = body.space.axis.breaks
        assert body.space.axis.elements == elements + 2 * ends * elements // 5
        middle = 0.5 * (breaks[1:] + breaks[:-1])
        for u, law in zip(middle, body.laws, strict=True):
            if 4 < u < 16:
                assert isinstance(law, Muscle)
                assert (law.E, law.nu, law.sigma_max, law.m1, law.m2, law.activation) == (30, 0.49, 30, 35, 0.5, 0.5)
                assert law.fibre.tolist() == [0, 1, 0]
            else:
                assert law == NeoHookean(300.0, 0.49)
        assert body.density == 1.06e-5
    (contact,) = model.contacts
    for body, (index, chosen) in zip(model.bodies, contact.sides, strict=True):
        assert model.bodies[index] is body
        edges = np.concatenate([body.space.axis.breaks[[e, e + 1]] for e in chosen])
        assert (edges.min(), edges.max()) == (4.0, 16.0)
        assert len(chosen) == 3 * elements // 5


def test_elements_at_the_ends_double_in_length():
    breaks = Biceps(elements=5, end_elements=2).model().bodies[0].space.axis.breaks
    assert breaks == pytest.approx([0, 4 / 7, 12 / 7, 4, 8, 12, 16, 20 - 12 / 7, 20 - 4 / 7, 20], abs=1e-13)


def alone(scene):
    """The model without contact."""
    model = scene.model()
    return Model(model.bodies, model.supports)


@pytest.fixture(scope="module")
def free():
    return statics.solve(alone(Biceps(statics=True)), load_steps=4)


def test_without_contact_each_branch_is_in_balance_by_itself(free):
    """Forces and moments of both ends.

    The reaction at an end acts somewhere on its face, so moments balance within its radius.
    """
    lower, upper = free.reactions[2], free.reactions[3]
    assert np.abs(lower + upper).max() < 1e-8 * np.abs(lower).max()
    assert free.reactions[:2] == pytest.approx(free.reactions[2:] * [-1, 1, 1], abs=1e-7)
    assert np.abs(free.reactions[:, 2]).max() < 1e-7
    # the line of action leads from the one face to the other
    angle = upper[0] / upper[1]
    assert abs(angle * 20.0 - (2.0 - 0.15)) < 2 * 0.7
    assert upper[1] > 0


@pytest.mark.slow
def test_bellies_would_overlap_without_contact_and_hardly_do_with_it(free):
    scene = Biceps(statics=True)
    right = free.model.bodies[1].space
    u = np.linspace(4, 16, 97)
    moved = surface(right.rod, u) + right.displacement(free.model.nodal(free.displacement, 1), CIRCLE, u)[0]
    assert moved[:, :, 0].min() < -0.3
    solution, _ = solving.solve(scene, {"load_steps": 4})
    held = surface(right.rod, u) + right.displacement(solution.model.nodal(solution.displacement, 1), CIRCLE, u)[0]
    assert -0.02 < held[:, :, 0].min() < 0.0
    found = scene.measure(solution)
    assert 0 < solution.contacts[0].penetration < 0.02
    # what one end does not carry, the other branch does
    pressed = solution.reactions[2, 0] + solution.reactions[3, 0]
    assert pressed == pytest.approx(-found["contact_force"], rel=2e-3)


@pytest.mark.slow
def test_pressing_on_each_other_is_pressing_on_the_plane_between():
    """A branch and its mirror image touch in the plane x = 0; half the gap there, so twice the penalty."""
    scene = Biceps(statics=True, penalty=2000.0)
    both, _ = solving.solve(scene, {"load_steps": 4})
    model = both.model
    body, chosen = model.bodies[1], model.contacts[0].second_elements
    supports = [Support(s.nodes, s.components, s.displacement) for s in model.supports[2:]]
    wall = Contact(0, Plane((0, 0, 0), (1, 0, 0)), 4000.0, chosen, points=model.contacts[0].points)
    one = statics.solve(Model([body], supports, contacts=[wall]), load_steps=4)
    assert one.contacts[0].force == pytest.approx(both.contacts[0].force, rel=5e-3)
    assert one.reactions == pytest.approx(both.reactions[2:], abs=2e-3 * np.abs(both.reactions).max())


@pytest.mark.slow
def test_equilibrium_is_the_converged_one():
    """Reference: --statics --order 2 --degree 3 --elements 20 --end-elements 2 gives 105.81 N, 0.2321 cm, 11.72 N."""
    scene = Biceps(statics=True, order=2, end_elements=2)
    found = scene.measure(solving.solve(scene, {"load_steps": 4})[0])
    assert found["end_force"][[0, 2]] == pytest.approx([105.81] * 2, rel=0.01)
    assert found["belly_bulge"] == pytest.approx(0.2321, rel=0.01)
    assert found["contact_force"] == pytest.approx(11.72, rel=0.02)
    # with harmonic functions alone
    scene = Biceps(statics=True, order=1)
    found = scene.measure(solving.solve(scene, {"load_steps": 4})[0])
    assert found["end_force"][[0, 2]] == pytest.approx([105.81] * 2, rel=0.03)
    assert found["belly_bulge"] == pytest.approx(0.2321, rel=0.01)


@pytest.mark.slow
def test_the_default_is_within_two_per_cent_of_finite_elements():
    """Of 27-node bricks in dolfinx, extrapolated (`python -m comparisons biceps`); contact within five."""
    scene = Biceps(statics=True)
    found = scene.measure(solving.solve(scene, {"load_steps": 4})[0])
    assert found["end_force"] == pytest.approx([105.74, 104.72, 105.74, 104.72], rel=0.02)
    assert found["belly_bulge"] == pytest.approx(0.2323, rel=0.02)
    assert found["contact_force"] == pytest.approx(11.23, rel=0.05)


def test_pressures_ask_for_a_finer_space():
    """They are chosen from the same ratio on; what is typed is as it is typed."""

    def sizes(**given):
        scene = Biceps(statics=True, **given)
        return scene.model().bodies[0].formulation, scene.section_points, scene.elements

    assert sizes(nu=0.498) == sizes() == ("displacement", 8, 10)
    assert sizes(nu=0.499) == ("mixed", 16, 20)
    assert sizes(nu=0.499, elements=10, section_points=12) == ("mixed", 12, 10)
    assert sizes(nu=0.499, formulation="displacement") == ("displacement", 8, 10)
    with pytest.warns(UserWarning, match="contact 0: .* use order 2"):
        assert sizes(nu=0.499, preset="paper") == ("mixed", 8, 5)


@pytest.mark.slow
def test_near_incompressibility_the_default_is_within_one_per_cent_of_taylor_hood_elements():
    """Of 51,878 unknowns (`python -m comparisons.nearly_incompressible biceps --meshes 3`)."""
    scene = Biceps(nu=0.4999, statics=True)
    found = scene.measure(statics.solve(scene.model()))
    assert found["end_force"] == pytest.approx([105.76, 104.72, 105.76, 104.72], rel=0.01)
    assert found["belly_bulge"] == pytest.approx(0.2384, rel=0.01)
    assert found["contact_force"] == pytest.approx(11.16, rel=0.01)


def test_near_incompressibility_locks_the_ends_not_the_sections():
    """With the paper's five elements nothing helps in the section.

    Short elements at the ends do, and then order 2 is enough.
    """

    def force(**given):
        return np.linalg.norm(statics.solve(alone(Biceps(**given)), load_steps=4).reactions[3])

    coarse = [force(elements=5, end_elements=0, order=order) for order in (1, 2, 3)]
    graded = [force(elements=5, end_elements=2, order=order) for order in (1, 2, 3)]
    assert min(coarse) > 1.1 * max(graded)
    assert graded[0] == pytest.approx(graded[2], rel=0.03)
    assert graded[1] == pytest.approx(graded[2], rel=5e-4)
    softer = [force(elements=5, end_elements=ends, order=2, nu=0.3) for ends in (0, 2)]
    assert softer[0] == pytest.approx(softer[1], rel=0.02)


def test_resting_muscle_pulls_nothing():
    scene = Biceps(statics=True, activation=0.0)
    found = scene.measure(solving.solve(scene, {})[0])
    assert not found["end_force"].any()
    assert (found["belly_bulge"], found["contact_force"]) == (0.0, 0.0)


def test_fibres_along_the_branch_change_little():
    """The centre lines lean by a few degrees from y.

    The force by less than a few per cent, but by more than nothing.
    """
    along_y, along = (statics.solve(alone(Biceps(fibre=f)), load_steps=4).reactions[3, 1] for f in ("y", "tangent"))
    assert 1e-3 < abs(along / along_y - 1) < 0.1


def test_bulge_is_half_the_growth_of_the_extent_in_z():
    """Of a state where the one branch is stretched by 10 % in z and moved, and the other one is narrowed."""
    scene = Biceps(statics=True)
    model = scene.model()
    u = np.zeros((model.dofs // 3, 3))
    for k, factor in enumerate((0.1, -0.2)):
        space = model.bodies[k].space
        nodes = slice(model.first_node[k], model.first_node[k + 1])
        u[nodes, 2] = factor * space.positions[:, 2] + 0.3 * space.is_control_point
        u[nodes, 0] = 5.0 * space.is_control_point
    forces = np.arange(12.0).reshape(4, 3) - 3.0
    contact = SimpleNamespace(force=7.0)
    found = scene.measure(SimpleNamespace(model=model, displacement=u.ravel(), reactions=forces, contacts=[contact]))
    assert found["belly_bulge"] == pytest.approx(0.16, rel=1e-3)
    assert found["end_force"] == pytest.approx(np.linalg.norm(forces, axis=1))
    assert found["contact_force"] == 7.0
    motion = SimpleNamespace(
        model=model, displacement=np.stack([0 * u.ravel(), u.ravel()]), reactions=np.stack([0 * forces, forces])
    )
    moving = scene.measure(motion)
    assert moving["belly_bulge_history"] == pytest.approx([0.0, 0.16], rel=1e-3, abs=1e-12)
    assert moving["end_force_y"] == pytest.approx(forces[:, 1])


def test_analysis_is_what_is_asked_for():
    assert (Biceps().analysis, Biceps(statics=True).analysis) == ("dynamics", "statics")
    assert Biceps(time_step=0.0).settings()["time_step"] is None
    assert Biceps().settings()["time_step"] == 4e-5


def test_record_of_the_equilibrium(capsys):
    assert cli.main(["run", "biceps", "--statics", "--activation", "0.5", "--load-steps", "2", "--json"]) == 0
    out, err = capsys.readouterr()
    record = json.loads(out)
    # Forces are 1 %, that of the contact 3 % off.
    # On a machine that is slow it is told how far it is, too.
    assert re.search("^isorod: warning: estimated error 4[.]", err, re.MULTILINE)
    assert record["analysis"] == "statics"
    assert record["built"] == ["contact", "tangent"]
    assert 20 < record["end_force"][0] < 90
    assert record["contact_force"] > 0
    assert 0 < record["penetration"] < 0.02
    assert record["contact_area"] > 0


@pytest.mark.parametrize("order", [1, 2])
def test_the_papers_time_step_is_stable(order):
    """Through the swing of the bellies and their clash, at some critical steps of the consistent mass.

    Energy and momentum balance.
    """
    scene = Biceps(order=order, end_time=0.02, outputs=40, time_step=2.5e-5)
    history = dynamics.solve(scene.model(), **scene.settings())
    print(f"critical step {history.critical_step:.4g}, energy {np.abs(history.energy_error).max():.1e}")
    assert (history.steps, history.time_step) == (800, pytest.approx(2.5e-5))
    assert history.critical_step > 1.1 * history.time_step
    assert history.contact_force.max() > 10.0
    assert np.abs(history.energy_error).max() < 1e-3
    assert np.abs(history.momentum_error).max() < 1e-12
    # What is added to the mass carries little of the kinetic energy.
    assert 0.0 < history.added_kinetic_share < 0.05
    consistent = dynamics.solve(scene.model(), **dataclasses.replace(scene, end_time=1e-3, time_step=0.0).settings())
    assert consistent.time_step < 0.5 * history.time_step
    assert consistent.added_kinetic_share == 0.0


def test_the_default_step_moves_as_the_consistent_mass_does():
    """End forces over the first swing: within 2 % in the mean, while lumped mass changed them by a tenth and more."""
    scene = Biceps(end_time=0.01, outputs=40)
    found, exact = (
        np.linalg.norm(dynamics.solve(one.model(), **one.settings()).reactions, axis=2)
        for one in (scene, dataclasses.replace(scene, time_step=0.0))
    )
    error = np.linalg.norm(found - exact) / np.linalg.norm(exact)
    print(f"end forces differ by {error:.2%}")
    assert error < 0.02


@pytest.mark.slow
def test_damped_motion_ends_in_the_equilibrium():
    scene = Biceps()
    end = scene.measure(dynamics.solve(scene.model(), **scene.settings()))
    still = dataclasses.replace(scene, statics=True)
    expected = still.measure(solving.solve(still, {"load_steps": 4})[0])
    assert end["end_force"] == pytest.approx(expected["end_force"], rel=1e-5)
    assert end["belly_bulge"] == pytest.approx(expected["belly_bulge"], rel=1e-5)
    # the bellies overshoot on their way
    assert end["belly_bulge_history"].max() > 1.02 * end["belly_bulge"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--elements", "7"], "elements: got 7, need a multiple of 5"),
        (["--elements", "0"], "elements: got 0, need a multiple of 5"),
        (["--end-elements", "-1"], "end elements: got -1, need an integer from 0 to 8"),
        (["--gap", "0"], "gap: got 0, need a positive length in cm"),
        (["--belly-radius", "nan"], "belly radius: got nan, need a positive length"),
        (["--tendon-radius", "2"], "tendon radius: got 2, need at most the radius of the belly, 1.6"),
        (["--activation", "1.5"], "activation: got 1.5, need 0"),
        (["--fibre", "x"], "fibre: got 'x', need 'y' or 'tangent'"),
        (["--tendon-factor", "0"], "tendon factor: got 0, need a positive number"),
        (
            ["--tendon-factor", "1e12"],
            ", support reactions 1.9e+02: the stiffness contrast along the model is too large",
        ),
        (["--sigma-max", "-1"], "sigma_max: got -1, need a stress, not negative"),
        (["--penalty", "0"], "penalty: got 0, need a positive"),
        (["--statics", "yes"], "unrecognized arguments: yes|option yes is not known"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_two(words, message, capsys):
    assert cli.main(["run", "biceps", "--statics", *words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    # Of a long run also how far it is.
    assert len([line for line in err.splitlines() if not line.startswith("isorod: load factor")]) == 1
    assert any(part in err for part in message.split("|"))


@pytest.mark.parametrize("more", [[], ["--json"]])
def test_a_warning_of_a_run_that_fails_does_not_stand_beside_the_error(more, capsys):
    assert cli.main(["run", "biceps", "--tendon-factor", "1e12", "--order", "1", *more]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"isorod: time step 4e-05: unstable, .*\n", err)


@pytest.mark.parametrize("words", ["", "--integrator implicit"])
@pytest.mark.parametrize("value", ["1e-300", "1e300"])
def test_a_time_that_products_cannot_hold_is_refused(value, words, capsys):
    assert cli.main(["run", "biceps", "--order", "1", "--end-time", value, *words.split()]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"isorod: end time: got 1e[-+]300, need 1e-100 to 1e100; choose other units\n", err)


def test_a_negative_time_step_is_refused():
    with pytest.raises(InputError, match="time step: got -1, need a positive time, or 0"):
        Biceps(time_step=-1.0).settings()
