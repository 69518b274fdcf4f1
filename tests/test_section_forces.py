"""Normal force, shear, torsion and bending along a rod: exact where they are known, and in balance everywhere."""

import numpy as np
import pytest
from conftest import straight

from isorod import InputError, LinearElastic, Muscle, NeoHookean, Space, airfoil, circle, dynamics, helix, statics
from isorod.geometry import center_line
from isorod.model import Body, BodyForce, Model, SectionLoad, Support
from isorod.output.section_forces import SectionForces
from isorod.output.state import State

E, NU, RADIUS, LENGTH = 200.0, 0.3, 0.5, 6.0
AREA, INERTIA = np.pi * RADIUS**2, 0.25 * np.pi * RADIUS**4
LINEAR, RUBBER = LinearElastic(E, NU), NeoHookean(E, NU)
U = np.array([0.0, 0.13, 0.25, 0.6, 1.0])


def beam(law=LINEAR, loads=(), end=None, formulation="displacement", **space):
    """A rod of a circular section along z, clamped at its start; ``end`` is what the support of its end is told."""
    space = Space(straight(6, radius=RADIUS, height=LENGTH), **{"elements": 8, "degree": 3} | space)
    supports = [Support.end(space, "start")]
    if end is not None:
        supports.append(Support.end(space, "end", **end))
    return statics.solve(Model([Body(space, law, formulation=formulation)], supports, loads=list(loads)))


def assert_balanced(solution, u, rtol):
    """Between any section and the end there are the forces of the end's support, if nothing else acts."""
    found = solution.section_forces(0, u)
    force, moment = solution.reactions[1], solution.moments[1]
    at_end = solution.section_forces(0, "end").centroid
    moments = moment + np.cross(at_end - found.centroid, force)
    assert np.abs(found.force - force).max() <= rtol * np.abs(force).max()
    assert np.abs(found.moment - moments).max() <= rtol * np.abs(moments).max()


def test_bar_in_tension():
    """Uniaxial stress: ``N = E A e``, and nothing else."""
    strain = 1e-3
    space = Space(straight(6, radius=RADIUS, height=LENGTH), elements=2)
    lengths = np.diag([-NU * strain, -NU * strain, strain])
    ends = []
    for which in ("start", "end"):
        nodes = Support.end(space, which).nodes
        ends.append(Support(nodes, "xyz", space.positions[nodes] @ lengths))
    found = statics.solve(Model([Body(space, LINEAR)], ends)).section_forces(0, U)
    scale = E * AREA * strain
    assert found.N == pytest.approx(np.full(5, scale), rel=1e-9)
    assert np.abs(found.Q).max() < 1e-9 * scale
    assert np.abs(found.M).max() < 1e-9 * scale


@pytest.mark.parametrize("degree", [2, 3, 5])
def test_cantilever_with_an_end_load_has_constant_shear_and_a_linear_moment(degree):
    """A force F in the first direction: ``Q = (F, 0)``, and ``F (L - z)`` about the second."""
    load = 0.01
    solution = beam(loads=[SectionLoad((load, 0.0, 0.0))], degree=degree)
    found = solution.section_forces(0, U)
    zero = np.zeros(5)
    scale = load * LENGTH
    assert found.N == pytest.approx(zero, abs=1e-9 * load)
    assert found.Q == pytest.approx(np.stack([zero + load, zero], axis=1), abs=1e-9 * load)
    assert found.M == pytest.approx(np.stack([zero, zero, load * LENGTH * (1.0 - U)], axis=1), abs=1e-9 * scale)
    clamped = solution.section_forces(0, "start")
    assert clamped.force == pytest.approx(-solution.reactions[0], abs=1e-9 * load)
    assert clamped.moment == pytest.approx(-solution.moments[0], abs=1e-9 * scale)


def test_twisted_bar_has_torsion_alone():
    """``M = G J theta / L`` about the axis, ``J`` twice the second moment of area."""
    angle = 1e-6
    solution = beam(end={"turn": (0.0, 0.0, angle)})
    found = solution.section_forces(0, U)
    torsion = E / (2.0 * (1.0 + NU)) * 2.0 * INERTIA * angle / LENGTH
    assert found.M[:, 0] == pytest.approx(np.full(5, torsion), rel=1e-6)
    assert found.M[:, 0] == pytest.approx(np.full(5, solution.moments[1, 2]), rel=1e-9)
    assert np.abs(found.M[:, 1:]).max() < 1e-6 * torsion
    assert np.abs(found.force).max() < 1e-6 * torsion / RADIUS


@pytest.mark.parametrize("space", [{}, {"order": 2}, {"section_degree": 3}, {"degree": 4, "continuity": 0}], ids=str)
def test_weight_makes_a_linear_force_and_a_quadratic_moment(space):
    """Weight ``w`` per length, across and along: ``w (L - z)`` and ``w (L - z)^2 / 2``."""
    weight = 0.01
    solution = beam(loads=[BodyForce((0.0, weight / AREA, -2.0 * weight / AREA))], **space)
    found, left = solution.section_forces(0, U), LENGTH * (1.0 - U)
    scale = weight * LENGTH
    assert found.N == pytest.approx(-2.0 * weight * left, abs=1e-9 * scale)
    assert found.Q == pytest.approx(np.outer(weight * left, [0.0, 1.0]), abs=1e-9 * scale)
    # A force along the second direction turns about the first, backwards.
    assert found.M == pytest.approx(np.outer(-0.5 * weight * left**2, [0.0, 1.0, 0.0]), abs=1e-8 * scale * LENGTH)


@pytest.mark.parametrize(
    ("law", "formulation", "space"),
    [
        (RUBBER, "displacement", {}),
        (RUBBER, "displacement", {"degree": 2, "order": 2, "quadrature": "auto"}),
        (RUBBER, "displacement", {"degree": 2, "quadrature": "paper", "continuity": 0}),
        (RUBBER, "displacement", {"section_degree": 2, "degree": 4}),
        (NeoHookean(E, 0.5), "mixed", {"order": 2}),
        (Muscle(E, NU, sigma_max=5.0, activation=0.5), "displacement", {}),
        ([RUBBER] * 4 + [NeoHookean(2.0 * E, NU)] * 4, "displacement", {"continuity": 0}),
    ],
)
def test_a_rod_bent_far_is_in_balance_along_its_length(law, formulation, space, petsc_options):
    petsc_options(snes_rtol=1e-13)
    end = {"turn": (0.3, 0.9, 0.4), "displacement": (2.0, 0.3, -1.0)}
    solution = beam(law, end=end, formulation=formulation, **space)
    assert np.abs(solution.reactions[1]).max() > 0.1
    assert_balanced(solution, np.linspace(0.0, 1.0, 23), 1e-8)


def test_directions_move_with_the_section():
    """At a face that is turned they are the turned ones, and force and moment there those of its support."""
    turn = (0.0, 0.9, 0.0)
    solution = beam(RUBBER, end={"turn": turn, "displacement": (2.0, 0.0, -1.0)})
    found = solution.section_forces(0, "end")
    cos, sin = np.cos(0.9), np.sin(0.9)
    frame = np.array([[sin, 0.0, cos], [cos, 0.0, -sin], [0.0, 1.0, 0.0]])
    assert found.frame == pytest.approx(frame, abs=1e-12)
    assert found.N == pytest.approx(frame[0] @ solution.reactions[1], rel=1e-7)
    assert found.Q == pytest.approx(frame[1:] @ solution.reactions[1], rel=1e-7, abs=1e-9)
    assert found.M == pytest.approx(frame @ solution.moments[1], rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(("elements", "degree"), [(8, 4), (16, 2)])
def test_spring(elements, degree):
    """Axial force small beside the stiffness: a section's own stress is off by a tenth, these are in balance."""
    space = Space(helix(10.0, 4.0, 2, 4).sweep(circle(8, 0.8)), order=2, degree=degree, elements=elements)
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, 2.0))
    solution = statics.solve(Model([Body(space, NeoHookean(2e5, 0.3))], ends))
    assert_balanced(solution, np.linspace(0.0, 8.0, 41), 1e-5)
    start = solution.section_forces(0, "start")
    assert start.force == pytest.approx(-solution.reactions[0], rel=1e-4, abs=1e-5)
    assert start.moment == pytest.approx(-solution.moments[0], rel=1e-4, abs=1e-4)
    # Mostly torsion, force times radius.
    assert start.M[0] == pytest.approx(10.0 * solution.reactions[1, 2], rel=0.02)


def test_moments_are_about_the_centroid():
    """A pull spread evenly over a blade's face bends nothing, though the disk's centre is not the centroid."""
    rod = center_line.straight(12.0).sweep(airfoil())
    space = Space(rod, elements=4, degree=3, order=2)
    held = [Support.end(space, "start", "z"), Support([0], "xy"), Support([8], "y")]
    load = 0.01
    solution = statics.solve(Model([Body(space, LINEAR)], held, loads=[SectionLoad((0.0, 0.0, load))]))
    found = solution.section_forces(rod, [0.1, 0.5, 0.9])
    assert found.N == pytest.approx(np.full(3, load), rel=1e-8)
    assert np.abs(found.M).max() < 1e-7 * load
    middle = rod.points([[0.0, 0.0]], [0.5])[0]
    assert np.linalg.norm(found.centroid[1, :2] - middle[:2]) > 0.01


def test_ring_pulled_apart():
    """A closed rod, held on one side and pulled on the other: by symmetry half of the pull in each arm."""
    rod = helix(10.0, 0.0, 1, 4).sweep(circle(6, 0.5), closed=True)
    space = Space(rod, elements=16, degree=4, order=2)
    pull = 1e-3
    held = Support(space.layers // 2 * space.layer_nodes + np.arange(space.layer_nodes), "xyz")
    load = SectionLoad((pull, 0.0, 0.0), u=0.0)
    found = statics.solve(Model([Body(space, LINEAR)], [held], loads=[load])).section_forces(0, [1.0, 3.0])
    # What lies beyond pulls back in the first arm; in the other it is what is pulled.
    assert found.force[:, 0] == pytest.approx([-0.5 * pull, 0.5 * pull], rel=1e-3)
    assert np.abs(found.force[:, 2]).max() < 1e-6 * pull
    assert found.force[0, 1] == pytest.approx(found.force[1, 1], abs=1e-3 * pull)


def test_degree_one():
    """Splines of degree 0: a value an element, equal to the force of the support."""
    space = Space(straight(4, degree=1), elements=3, degree=1)
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, 0.01))
    solution = statics.solve(Model([Body(space, LINEAR)], ends))
    assert solution.section_forces(0, U).N == pytest.approx(np.full(5, solution.reactions[1, 2]), rel=1e-9)


def test_shapes_are_those_of_u():
    solution = beam(end={"displacement": (0.0, 0.0, 0.1)})
    for u, shape in (("end", ()), (0.5, ()), ([0.5], (1,)), (np.full((2, 3), 0.5), (2, 3))):
        found = solution.section_forces(0, u)
        assert isinstance(found, SectionForces)
        assert (np.shape(found.N), found.Q.shape, found.M.shape) == (shape, (*shape, 2), (*shape, 3))
        assert (found.force.shape, found.moment.shape, found.centroid.shape) == ((*shape, 3),) * 3
        assert found.frame.shape == (*shape, 3, 3)
        assert len(repr(found).splitlines()) <= 3 and "array" not in repr(found)
    with pytest.raises(InputError, match=r"axis parameter u: got 1.5, need numbers from 0 to 1, or 'start' or 'end'"):
        solution.section_forces(0, 1.5)


def test_active_muscle_pulls_at_the_load_factor():
    """A muscle that is held: its fibres' tension times the area, in proportion to its activation."""
    law = Muscle(1.0, 0.3, sigma_max=5.0, activation=0.5)
    space = Space(straight(4))
    model = Model([Body(space, law)], [Support(np.arange(space.nodes), "xyz")])
    for factor in (0.0, 0.4, 1.0):
        found = State(model, np.zeros(model.dofs), factor=factor).section_forces(0, 0.3)
        assert found.N == pytest.approx(factor * 0.5 * 5.0 * np.pi, rel=1e-9, abs=1e-12)


def test_output_of_a_motion_has_section_forces():
    """Of a bar that starts from rest with an impulse at its end, none at first, then tension."""
    space = Space(straight(4, radius=RADIUS, height=LENGTH), elements=4)
    model = Model([Body(space, RUBBER, density=1.0)], [Support.end(space, "start")])
    velocity = np.zeros(model.dofs)
    velocity.reshape(space.layers, -1, 3)[-1, :, 2] = 0.1
    history = dynamics.solve(model, 0.2, outputs=2, velocity=velocity)
    assert history[0].section_forces(0, 0.9).N == pytest.approx(0.0, abs=1e-12)
    assert history[1].section_forces(0, 0.9).N > 0.01
