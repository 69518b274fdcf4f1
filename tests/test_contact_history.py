"""Projections, the memory of searches, and searches left out: what is the same from any start, and what calls leave."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from petsc4py import PETSc
from touching import LAW, RADIUS, RING, across, add_forces, among, forces_at, pair, reference, shaken

from isorod import Body, Contact, Cylinder, Model, Plane, Space, circle, helix
from isorod.contact.operator import ContactOperator
from isorod.contact.packed import START
from isorod.contact.surface_kernel import EDGE, END, FREE, closest, new_projection, surface_gap
from isorod.contact.tables import pack

OFFSET = np.array([0.0, 2.9, 3.0])  # of the crossing rods' middles


def project(packed, surface, x, start, positions):
    """Return outcome, gap, foot and where it is (element, theta, s)."""
    projection, where = new_projection(), np.array([tuple(start)], START)
    outcome = closest(packed.surfaces[surface], packed.elements, x, where[0], positions, projection)
    gap = surface_gap(projection, outcome == EDGE)
    assert abs(projection.d @ projection.y[1]) < 1e-11
    return outcome, gap, projection.y[0].copy(), where[0]


def test_projection_on_a_torus_is_exact_from_any_start():
    both = pair()
    packed, positions = pack(both), reference(both)
    rng = np.random.default_rng(1)
    center = np.array([-RING - 1.6, 0.0, 3.1])
    first, rows = packed.surfaces[1][["first_element", "elements"]]
    for _ in range(200):
        around, phi, depth = *rng.uniform(-np.pi, np.pi, 2), rng.uniform(-0.5, 0.6)
        out = RING + (RADIUS + depth) * np.cos(phi)
        x = center + np.array([out * np.cos(around), out * np.sin(around), (RADIUS + depth) * np.sin(phi)])
        # A start one element away along the axis and an eighth of a turn round the section.
        row = int(around % (2.0 * np.pi) / (2.0 * np.pi) * rows)
        start = [first + (row + rng.integers(-1, 2)) % rows, -phi + rng.uniform(-0.8, 0.8), rng.uniform(-1.0, 1.0)]
        outcome, gap, projection, _ = project(packed, 1, x, start, positions)
        assert outcome == FREE
        assert abs(gap - depth) < 1e-12
        np.testing.assert_allclose(
            x - projection,
            depth / (RADIUS + depth) * (x - center - RING * np.array([np.cos(around), np.sin(around), 0.0])),
            atol=1e-10,
        )


def test_projection_on_a_cylinder_and_beyond_its_ends():
    both = pair()
    packed, positions = pack(both), reference(both)
    rng = np.random.default_rng(2)
    for _ in range(200):
        height, phi, depth = rng.uniform(-1.0, 7.0), rng.uniform(-np.pi, np.pi), rng.uniform(-0.6, 1.0)
        x = np.array([(1.0 + depth) * np.cos(phi), (1.0 + depth) * np.sin(phi), height])
        start = [rng.integers(0, 3), phi + rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0)]
        outcome, gap, projection, where = project(packed, 0, x, start, positions)
        assert outcome == (FREE if 0.0 <= height <= 6.0 else END)
        np.testing.assert_allclose(projection, [np.cos(phi), np.sin(phi), np.clip(height, 0.0, 6.0)], atol=1e-11)
        if outcome == FREE:
            assert abs(gap - depth) < 1e-12
            assert abs(where["element"] + 0.5 + 0.5 * where["s"] - 0.5 * height) < 1e-11


def test_start_values_change_nothing_but_time():
    both = pair()
    x = reference(both) + shaken(both).reshape(-1, 3)
    packed, outcome, fresh = forces_at(both, shaken(both))
    starts = packed.starts.copy()
    assert (starts["element"] >= 0.0).sum() >= 20
    warm = np.zeros_like(fresh)
    again = add_forces(packed, x, warm)
    np.testing.assert_allclose(again, outcome, rtol=1e-12)
    np.testing.assert_allclose(warm, fresh, atol=1e-12 * np.abs(fresh).max())
    packed.starts[:] = starts
    repeated = np.zeros_like(fresh)
    assert add_forces(packed, x, repeated) == again
    assert np.array_equal(repeated, warm)


@pytest.fixture
def crossing():
    """A rod, a thinner one across it, and a motion of both, from afar to a touch and on."""
    model = across((-2.0, 0.0, 0.0))
    first = np.arange(model.dofs // 3)[:, None] < model.first_node[1]
    way = [np.array([0.2 * np.sin(3.0 * t), 0.8 * np.cos(t), np.sin(t)]) for t in np.linspace(0.0, 2.0 * np.pi, 300)]
    return model, [reference(model) + np.where(first, -w, w + OFFSET) for w in way]


def test_starts_are_all_the_history_there_is(crossing):
    """A run that goes on from copied starts, as from a checkpoint, is the same run; one that forgets is a fresh one."""
    model, states = crossing
    first = pack(model)
    touched = 0
    for x in states[::3]:
        second = pack(model)
        second.starts[:] = first.starts
        one, other, fresh = (np.zeros_like(x) for _ in range(3))
        outcome = add_forces(first, x, one)
        assert add_forces(second, x, other) == outcome
        assert np.array_equal(one, other)
        touched += outcome.area > 0.0
        second.forget()
        other[:] = 0.0
        assert add_forces(second, x, other) == add_forces(pack(model), x, fresh)
        assert np.array_equal(other, fresh)
    assert 10 < touched < 90


def test_searches_left_out_change_nothing(crossing):
    """Both rods approach: the same forces, to the last bit, as where every point is searched for in every call."""
    model, states = crossing
    lazy, thorough = pack(model), pack(model)
    searches = np.zeros(2, dtype=int)
    for x in states:
        thorough.clear[:] = -np.inf
        until = lazy.clear.copy()
        one, other = np.zeros_like(x), np.zeros_like(x)
        assert add_forces(lazy, x, one) == add_forces(thorough, x, other)
        assert np.array_equal(one, other)
        assert np.array_equal(lazy.starts["element"], thorough.starts["element"])
        searches += [(until <= lazy.travel[0]).sum(), until.size]
    print(searches)
    assert searches[0] < 0.7 * searches[1]


@pytest.mark.parametrize(
    "obstacle",
    [Plane((-4.0, 0.0, 0.0), (1.0, 0.0, 0.0), travel=2.5), Cylinder((-4.0, 0.0, 3.0), (0.0, 1.0, 0.0), 2.0)],
    ids=["plate", "cylinder"],
)
def test_a_rod_that_nears_an_obstacle_is_not_looked_at_before(cylinder, obstacle):
    """It comes and goes, and so does the plate: forces as where all points are sought, which few are."""
    rod = cylinder(8, breaks=(0.0, 1.0, 2.0, 3.0), height=6.0)
    model = among([Space.paper(rod)], Contact(0, obstacle, 10.0, points=(3, 3)))
    zero = np.zeros(model.dofs)
    lazy, thorough = ContactOperator(model), ContactOperator(model)
    touched, sought = 0, []
    for t in np.linspace(0.0, 2.0 * np.pi, 300):
        moved_by = zero.copy()
        moved_by[::3] = np.where(model.is_control_point, -0.7 + 0.7 * np.cos(t), 0.0)
        for one in (lazy, thorough):
            one.place(0.5 - 0.5 * np.cos(t))
        thorough.packed.look_everywhere()
        until = lazy.packed.clear.copy()
        forces, energy = lazy.forces(moved_by)
        sought.append((until <= lazy.packed.travel[0]).mean())
        expected, other = thorough.forces(moved_by)
        assert energy == other
        assert np.array_equal(forces, expected)
        touched += energy > 0.0
    print(touched, np.mean(sought))
    assert 20 < touched < 280
    assert np.mean(sought) < 0.5


def test_work_along_a_path_is_the_change_of_energy():
    """A rod slides across arcs and elements of another: nothing is lost, nothing jumps."""
    model = across((-2.0, 1.4, 0.0), (4, 8))
    base, packed = reference(model), pack(model)
    mobile = np.arange(base.shape[0]) >= model.first_node[1]

    def at(t):
        x, forces = base.copy(), np.zeros_like(base)
        x[mobile] += [0.6 * np.sin(2.0 * t), -0.1 * t, 1.3 + 2.4 * t]
        outcome = add_forces(packed, x, forces)
        return outcome[0], forces[mobile].sum(axis=0) @ [1.2 * np.cos(2.0 * t), -0.1, 2.4]

    # Gauss points on many pieces: the force is smooth but for points that come and go.
    x, w = np.polynomial.legendre.leggauss(2)
    pieces = np.linspace(0.0, 1.0, 1201)
    work = sum(
        0.5 * (b - a) * v * at(0.5 * (a + b) + 0.5 * (b - a) * t)[1]
        for a, b in pairwise(pieces)
        for t, v in zip(x, w, strict=True)
    )
    gained = at(1.0)[0] - at(0.0)[0]
    assert abs(gained) > 1e-3
    assert abs(work + gained) < 1e-6 * abs(gained)


def test_far_and_separated_bodies_do_nothing():
    both = pair()
    for shift in ([50.0, 0.0, 0.0], [-0.3, 0.0, 0.0]):
        displacement = np.zeros((both.dofs // 3, 3))
        displacement[both.first_node[1] :] = shift
        packed, outcome, forces = forces_at(replace(both, contacts=both.contacts[:1]), displacement)
        assert outcome == (0.0, 0.0, 0.0, 0.0)
        assert not forces.any()
        assert (packed.starts["element"] == -1.0).all()


def test_numbers_that_are_not_finite_are_not_passed_over():
    both = pair()
    for bad in (np.nan, np.inf):
        for chosen in (slice(3 * 16, 3 * 40), slice(None), slice(0, 1)):
            displacement = shaken(both)
            displacement[chosen] = bad
            packed, outcome, forces = forces_at(both, displacement)
            assert np.isnan(outcome).all()
            assert np.isnan(forces).all()
            # And it does not last.
            fresh = forces_at(both, shaken(both))
            forces[:] = 0.0
            assert add_forces(packed, reference(both) + shaken(both).reshape(-1, 3), forces) == fresh[1]
            assert np.array_equal(forces, fresh[2])


def test_what_is_known_to_be_far_changes_no_force_of_a_coil_that_is_shaken_hard():
    """Searches that begin outside of what can touch, as where points were near before, end at the far side or nowhere.

    Stretched by half and more, sections are farther apart than they were made.
    """
    rod = helix(3.0, 2.2, turns=1.5).sweep(circle(8, 1.0))
    space = Space(rod, elements=12, degree=4, order=2, section_points=8)
    model = Model([Body(space, LAW, 1.0)], contacts=[Contact(0, penalty=30.0)])
    known, fresh = (ContactOperator(model, PETSc.COMM_SELF) for _ in range(2))
    rng, pressed = np.random.default_rng(0), 0
    places = (space.positions - space.positions[space.is_control_point].mean(axis=0)) * space.is_control_point[:, None]
    for _ in range(30):
        turn, bend = 0.3 * rng.standard_normal((3, 3)), 0.06 * rng.standard_normal((3, 3))
        motion = (places @ turn.T + places * np.roll(places, 1, axis=1) @ bend.T).ravel()
        for one in (known, fresh):
            one.packed.forget()
        fresh.packed.look_everywhere()
        forces, expected = (one.forces(motion)[0] for one in (known, fresh))
        np.testing.assert_allclose(forces, expected, atol=1e-12 * max(np.abs(expected).max(), 1.0))
        pressed += int((fresh.packed.states["pressure"] > 0.0).sum())
    assert pressed > 250
