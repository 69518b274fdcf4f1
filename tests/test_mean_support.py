"""Supports of mean motions, bearings and springs: faces that stay free to deform."""

import warnings

import numpy as np
import pytest
from petsc4py import PETSc
from refused import refused

from isorod import (
    LinearElastic,
    NeoHookean,
    Space,
    StVenantKirchhoff,
    buckling,
    circle,
    dynamics,
    modal,
    rounded_rectangle,
    statics,
    straight,
)
from isorod.errors import SolveError
from isorod.files import supports as supports_of_files
from isorod.modal.loaded import burdens
from isorod.model import Body, BodyForce, Model, Pressure, SectionLoad, Support
from isorod.model.mean import MeanSupport

YOUNG, NU = 1000.0, 0.3
AREA, INERTIA, SHEAR = np.pi, np.pi / 4.0, YOUNG / 2.6
LAW = NeoHookean(10.0, 0.3)


def space(length=10.0, section=None, **given):
    section = circle(8) if section is None else section
    return Space(straight(length).sweep(section), **{"elements": 4, "degree": 3, "section_degree": 2} | given)


def model(supports, loads=(), own=None, law=LAW, density=1.0):
    own = space() if own is None else own
    return Model([Body(own, law, density)], supports(own), loads=list(loads))


def fork(own, which, components):
    return MeanSupport.end(own, which, components=components, mean="fork")


PULLS = {
    "held and moved": (
        lambda own: [
            MeanSupport.end(own, "start", mean="fixed"),
            MeanSupport.end(own, "end", displacement=(0.0, 0.0, 1.0), mean="pin"),
        ],
        False,
    ),
    "held and pulled": (lambda own: [MeanSupport.end(own, "start", mean="fixed")], True),
    "rigid motions alone": (lambda own: [MeanSupport.rigid(own)], True),
}


@pytest.mark.parametrize("law", [LAW, StVenantKirchhoff(10.0, 0.3), LinearElastic(10.0, 0.3)], ids=str)
@pytest.mark.parametrize("held", PULLS)
def test_a_bar_in_tension_is_uniform_from_end_to_end(held, law):
    supports, loaded = PULLS[held]
    own = space()
    loads = [SectionLoad.end(own, "start", (0.0, 0.0, -2.0)), SectionLoad.end(own, "end", (0.0, 0.0, 2.0))]
    found = statics.solve(model(supports, loads if loaded else (), own, law))
    gradients = found.deformation_gradient(0, np.linspace(0.0, 1.0, 5), np.array([[0.0, 0.0], [1.0, 0.0], [0.6, -0.8]]))
    first = gradients.reshape(-1, 3, 3)[0]
    assert np.abs(gradients - first).max() < 1e-8 and np.abs(first - np.diag(np.diag(first))).max() < 1e-8
    assert first[0, 0] == pytest.approx(first[1, 1], abs=1e-8)
    if not loaded:
        assert first[2, 2] == pytest.approx(1.1, abs=1e-9)
        assert found.reactions[0] == pytest.approx(-found.reactions[1], abs=1e-9)
        # Works of what moves are those of its force.
        assert found.work == pytest.approx(found.reactions[1, 2], rel=1e-9)


def test_a_beam_on_pins_has_the_frequencies_of_timoshenko():
    """Supported at both ends, bending in two planes: ``w`` by the smaller root of the beam's equation."""
    length, young = 40.0, 1e4
    own = space(length, elements=10, degree=4, section_degree=3)
    pins = model(lambda own: [fork(own, "start", "xyz"), fork(own, "end", "xy")], (), own, NeoHookean(young, NU))
    found = modal.solve(pins, 5)
    kappa, shear = 6.0 * 1.3 / (7.0 + 6.0 * 0.3), young / 2.6
    wanted = []
    for k in (1, 2):
        q = k * np.pi / length
        a, b = INERTIA / (kappa * shear), AREA + INERTIA * q**2 * (1.0 + young / (kappa * shear))
        wanted += 2 * [np.sqrt((b - np.sqrt(b * b - 4.0 * a * young * INERTIA * q**4)) / (2.0 * a)) / (2.0 * np.pi)]
    assert found.rigid == 0
    assert found.frequencies[:4] == pytest.approx(wanted, rel=1e-3)
    # Round in both directions at both ends: nothing twists it, and it may move along.
    free = modal.solve(
        model(lambda own: [MeanSupport.end(own, end, components="xy") for end in ("start", "end")], (), own), 2
    )
    assert free.rigid == 2


def test_euler_load_of_a_column_on_pins():
    length, young = 60.0, 1e4
    own = space(length, elements=8, degree=4, section_degree=3)
    load = [SectionLoad.end(own, "end", (0.0, 0.0, -1.0))]
    pins = model(lambda own: [fork(own, "start", "xyz"), fork(own, "end", "xy")], load, own, NeoHookean(young, NU))
    assert buckling.solve(pins).factors[0] == pytest.approx(np.pi**2 * young * INERTIA / length**2, rel=5e-3)


def test_a_hinge_turns_about_its_axis_alone_and_by_any_angle():
    """A flat bar on a hinge, pushed across it by a spring of little stiffness, swings as a rigid body."""
    own = space(10.0, rounded_rectangle(None, 1.0, 3.0, 0.3), section_degree=3)
    supports = [
        MeanSupport.end(own, "start", mean="hinge", axis=(1.0, 0.0, 0.0)),
        MeanSupport.end(own, "end", components="y", displacement=(0.0, 8.0, 0.0)),
    ]
    found = statics.solve(Model([Body(own, NeoHookean(1e3, 0.3))], supports), load_steps=4)
    end = found.position(0, 1.0)
    assert end == pytest.approx([0.0, 8.0, 6.0], abs=1e-9)
    assert np.abs(found.reactions).max() < 1e-8 and found.energy(0) < 1e-12


def test_springs_to_ground_carry_force_and_moment():
    """A stiff bar on springs at one end: ``F / k`` and ``M / k``, and the same as a reaction; energies add up."""
    own = space()
    spring = MeanSupport.spring(own, "start", (2.0, 4.0, 5.0), (300.0, 400.0, 50.0))
    loads = [SectionLoad.end(own, "end", (0.0, 0.0, 0.3), moment=(0.0, 0.0, 0.2))]
    for law in (LinearElastic(YOUNG, NU), NeoHookean(YOUNG, NU)):
        found = statics.solve(model(lambda own: [spring], loads, own, law))
        assert found.reactions[0] == pytest.approx([0.0, 0.0, -0.3], abs=1e-9)
        assert found.moments[0] == pytest.approx([0.0, 0.0, -0.2], abs=1e-9)
        side = found.at(0, 0.0, (1.0, 0.0))
        assert side[[1, 2]] == pytest.approx([0.2 / 50.0, 0.3 / 5.0], rel=1e-4)


def test_a_bar_on_springs_has_their_frequencies():
    """Of a body much stiffer: ``sqrt(k / m)`` along, ``sqrt(k / J)`` about its axis."""
    own = space(4.0, elements=2)
    spring = MeanSupport.spring(own, 0.5, (0.0, 0.0, 3.0), (0.0, 0.0, 2.0))
    rest = MeanSupport(0.5, np.eye(3)[:2], np.eye(3)[:2], space=own)
    mass = 4.0 * AREA
    for supports in ([spring, rest], [rest, spring]):
        found = modal.solve(Model([Body(own, NeoHookean(1e6, NU), 1.0)], supports), 2)
        wanted = np.sqrt([3.0 / mass, 2.0 / (0.5 * mass)]) / (2.0 * np.pi)
        assert found.frequencies == pytest.approx(wanted, rel=1e-4)


def test_bearings_carry_a_shaft_as_a_beam_on_two_supports():
    """Overhang: reactions by the lever, none along, and the shaft turns in them without a moment."""
    own = space(10.0, elements=5, continuity=0)
    supports = [MeanSupport.bearing(own, 0.2), MeanSupport.bearing(own, 0.8)]
    supports.append(MeanSupport.section(own, 0.0, "fork", "z"))
    loads = [SectionLoad.end(own, "end", (0.0, 0.3, 0.0), moment=(0.0, 0.0, 0.7))]
    found = statics.solve(model(lambda own: supports, loads, own, LinearElastic(YOUNG, NU)))
    assert found.reactions[:3] == pytest.approx(
        np.array([[0.0, 0.1, 0.0], [0.0, -0.4, 0.0], [0.0, 0.0, 0.0]]), abs=1e-9
    )
    assert found.moments[2] == pytest.approx([0.0, 0.0, -0.7], abs=1e-9)


def test_motions_keep_energy_and_momentum():
    """On a spring at one end and in a bearing: forces of both are impulses, and the spring's energy is stored."""
    own = space(elements=3)
    supports = [MeanSupport.spring(own, "start", (0.5, 0.4, 0.3), (1.0, 2.0, 0.5)), MeanSupport.bearing(own, 0.7)]
    load = [SectionLoad.end(own, "end", (0.02, 0.1, 0.05)), BodyForce((0.0, 0.01, 0.0))]
    found = dynamics.solve(
        model(lambda own: supports, load, own), 4.0, 0.1, 4, integrator="implicit", comm=PETSc.COMM_SELF
    )
    assert np.abs(found.energy_error).max() < 1e-8 and np.abs(found.momentum_error).max() < 1e-8
    # At outputs the spring's force is that of its stretch.
    nodes, share = supports[0].middle(own)
    stretch = np.array([share @ one.reshape(-1, 3)[nodes] for one in found.displacement])
    assert found.reactions[:, 0] == pytest.approx(-stretch * [0.5, 0.4, 0.3], abs=1e-9)


def test_a_ring_that_is_pressed_alike_is_held_by_its_rigid_motions():
    """Pressure from all round balances itself, whatever section holds."""
    own = space()
    loads = [
        Pressure(0.1),
        SectionLoad.end(own, "end", (0.0, 0.0, -0.1 * AREA)),
        SectionLoad.end(own, "start", (0, 0, 0.1 * AREA)),
    ]
    found = statics.solve(model(lambda own: [MeanSupport.rigid(own)], loads, own, LinearElastic(10.0, 0.3)))
    gradient = found.deformation_gradient(0, 0.3, (0.5, 0.1))
    assert np.ravel(gradient) == pytest.approx(np.ravel(np.eye(3) * (1.0 - 0.1 * 0.4 / 10.0)), abs=1e-5)
    assert np.abs(found.reactions).max() < 1e-6


def test_bearings_in_one_element_share_its_functions():
    """Neither is a master of the other alone: forces are those of the lever."""
    own = space(elements=1, degree=4)
    supports = [
        MeanSupport.bearing(own, 0.4),
        MeanSupport.bearing(own, 0.6),
        MeanSupport.section(own, 0.5, "fork", "z"),
    ]
    found = statics.solve(
        model(lambda own: supports, [SectionLoad.end(own, "end", (0.0, 0.3, 0.0))], own, LinearElastic(YOUNG, NU))
    )
    assert found.reactions[:, 1] == pytest.approx([0.6, -0.9, 0.0], abs=1e-9)


def record(path):
    """Save what the ranks find together (called under mpirun)."""
    own = space(elements=5, continuity=0)
    supports = [
        MeanSupport.spring(own, "start", (2.0, 4.0, 5.0), (30.0, 40.0, 50.0)),
        MeanSupport.bearing(own, 0.6),
        MeanSupport.end(own, "end", "hinge", "z", (0.0, 0.0, 0.2), (0.0, 1.0, 0.0)),
    ]
    load = [SectionLoad(u=0.4, force=(0.3, 0.0, 0.0), moment=(0.1, 0.2, 0.3))]
    whole = Model([Body(own, LAW, 1.0)], supports, loads=load)
    still = Model([Body(own, LAW, 1.0)], [*supports[:2], MeanSupport.section(own, 1.0, "fixed")], loads=load)
    found, moving = statics.solve(whole), dynamics.solve(still, 1.0, 0.1, 2, integrator="implicit")
    modes = modal.solve(Model(still.bodies, still.supports), 4)
    if PETSc.COMM_WORLD.getRank() == 0:
        np.savez(
            path,
            still=found.displacement,
            reactions=found.reactions,
            moments=found.moments,
            moving=moving.displacement,
            pulled=moving.reactions,
            frequencies=modes.frequencies,
        )


@pytest.mark.slow
def test_two_ranks_find_the_same(on_ranks, tmp_path):
    record(tmp_path / "one.npz")
    on_ranks(2, "test_mean_support.record(*sys.argv[1:])", str(tmp_path / "two.npz"))
    one, two = np.load(tmp_path / "one.npz"), np.load(tmp_path / "two.npz")
    for name in one.files:
        assert two[name] == pytest.approx(one[name], rel=1e-6, abs=1e-8 * np.abs(one[name]).max()), name


def of_file(**given):
    return supports_of_files.end(space(), "end", **given)


def unbalanced(own):
    return statics.solve(
        model(lambda own: [MeanSupport.rigid(own)], [SectionLoad.end(own, "end", (0.0, 0.0, 1.0))], own)
    )


test_loads_that_do_not_balance = refused(
    (
        lambda: unbalanced(space()),
        "support 0: the loads do not balance each other, and a support of rigid motions alone",
    ),
    (
        lambda: statics.solve(model(lambda own: [MeanSupport.end(own, "start", mean="pin")])),
        "body 0 is free to turn about",
    ),
    error=SolveError,
)
FLAT = rounded_rectangle(None, 1.0, 3.0, 0.3)
test_bad_input = refused(
    (lambda: MeanSupport.end(space(), "end", mean="clamp"), "mean: got 'clamp', need one of pin, fork, hinge, fixed"),
    (lambda: MeanSupport.end(space(), "end", mean="hinge"), "axis: a hinge has one"),
    (lambda: MeanSupport.end(space(), "end", axis=(1.0, 0.0, 0.0)), "axis: a hinge has one, and nothing else does"),
    (lambda: of_file(axis=(1.0, 0.0, 0.0)), "mean: got '', need one of pin, fork, hinge, fixed"),
    (lambda: of_file(mean="pin", turn=(0.0, 0.0, 1.0)), "mean: a face held in the mean does not turn; leave out"),
    (lambda: MeanSupport.end(space(), "end", mean="hinge", axis=(0.0, 0.0, 0.0)), "axis: got no direction"),
    (lambda: MeanSupport.end(space(section=FLAT), "end", mean="hinge", axis=(1.0, 1.0, 0.0)), "principal axes"),
    (lambda: MeanSupport.end(space(), "end", components="", mean="pin"), "components: got none"),
    (lambda: MeanSupport.spring(space(), "end"), "stiffness: got"),
    (lambda: MeanSupport.spring(space(), "end", (1.0, -1.0, 0.0)), "none negative"),
    (lambda: MeanSupport.bearing(space(), 1.5), "got u = 1.5, need an axis parameter from 0 to 1"),
    (
        lambda: model(lambda own: [MeanSupport.rigid(own), Support.end(own, "end")]),
        "support 0: rigid motions alone are held where nothing else holds the rod, and support 1 does",
    ),
    (
        lambda: statics.solve(
            model(lambda own: [MeanSupport.end(own, "start", mean="fixed"), MeanSupport.end(own, "start", mean="pin")])
        ),
        "support 1: other supports or ties hold the section already",
    ),
    (lambda: modal.solve(model(lambda own: [MeanSupport.rigid(own)])), "support 0: to hold rigid motions alone is for"),
    (
        lambda: dynamics.solve(
            model(lambda own: [MeanSupport.end(own, "end", displacement=(0.1, 0, 0), mean="pin")]),
            1.0,
            0.1,
            integrator="implicit",
        ),
        "support 0: a mean motion is not displaced at once in dynamics; give it a history",
    ),
)


@pytest.mark.parametrize("share", [0.05, 0.15, 0.4])
def test_a_rotational_spring_that_turns_far_is_warned_of(share):
    """A stiff bar on such a spring, whose potential is half the stiffness times the squared sine."""
    own = space()
    springs = MeanSupport.spring(own, "start", (1e3, 1e3, 1e3), (10.0, 10.0, 10.0))
    load = SectionLoad.end(own, "end", moment=(10.0 * share, 0.0, 0.0))
    held = Model([Body(own, NeoHookean(1e4, 0.3))], [springs], loads=[load])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        solution = statics.solve(held, load_steps=4)
    angle = float(springs.turned(own, held.nodal(solution.displacement, 0))[0])
    assert np.sin(angle) * np.cos(angle) == pytest.approx(share, rel=1e-3)
    told = [str(one.message) for one in said if "rotational springs" in str(one.message)]
    assert len(told) == (share > 0.0865)
    if told:
        assert f"turns by {np.degrees(angle):.3g} degrees" in told[0]


def test_a_face_of_two_laws_is_held_in_the_mean_as_one_of_one_law():
    """Means are weighed by moduli: by areas alone the first frequency is 1.6 and 3.2 % below that of clamped ends."""
    rod = straight(50.0).sweep(circle(8)).with_rings((0.0, 0.55, 1.0))
    own = Space(rod, elements=8, degree=4, section_degree=3)

    def softer(ratio):
        laws, found = [LinearElastic(100.0 * ratio, NU), LinearElastic(100.0, NU)], []
        for hold in (Support.end, lambda space, end: MeanSupport.end(space, end, mean="fixed")):
            bar = Model([Body(own, laws, 1.0)], [hold(own, end) for end in ("start", "end")])
            found.append(modal.solve(bar, 1).frequencies[0])
        return found[1] / found[0]

    alike = softer(1.0)
    assert 0.99 < alike < 1.0
    assert [softer(ratio) for ratio in (0.08, 12.5)] == pytest.approx([alike, alike], abs=1e-3)


@pytest.mark.parametrize(("moved", "said"), [(0.0, ""), (0.1, "1 moved support")])
def test_modes_are_about_the_state_that_a_mean_support_moves_to(moved, said):
    own = Space(straight(4.0).sweep(circle(8, 0.5)), section_degree=3, elements=2, degree=3)
    held = [MeanSupport.end(own, "start", mean="fixed")]
    held.append(MeanSupport.end(own, "end", displacement=(0.0, 0.0, moved), mean="pin"))
    assert burdens(Model([Body(own, NeoHookean(1e3, 0.3))], held)) == said
