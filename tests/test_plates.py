"""Planes that move along their normal with the load factor: what they press is as if it were moved onto them."""

import numpy as np
import pytest
from conftest import straight
from scipy.linalg import eigh
from touching import STIFF, bar

from isorod import Body, Contact, InputError, Model, Plane, Space, Support, dynamics, statics
from isorod.assembly.formulation import assembler_for
from isorod.checks import rigid_motions
from isorod.contact.operator import ContactOperator
from isorod.statics.newton import Newton

WAY = 0.08
HOW = {"penalty": 1e3, "points": (6, 4)}


def held(space, travel=0.0, way=0.0, gap=0.02, **how):
    """A bar whose ends are held, or moved down, above a plane that may come up."""
    supports = [Support.end(space, end, displacement=(0.0, -way, 0.0)) for end in ("start", "end")]
    plane = Plane((0.0, -1.0 - gap, 0.0), (0.0, 3.0, 0.0), travel)
    return Model([Body(space, STIFF, density=1.0)], supports, contacts=[Contact(0, plane, **HOW, **how)])


@pytest.mark.parametrize("how", [{}, {"friction": 0.3}])
def test_a_plane_that_moves_presses_as_one_that_a_rod_is_moved_onto(how):
    """By steps, so that the way of the plane is also what steps begin with."""
    models = held(bar(4.0), WAY, **how), held(bar(4.0), 0.0, WAY, **how)
    (one, other) = (statics.solve(model, load_steps=3) for model in models)
    (moving,), (fixed,) = one.contacts, other.contacts
    assert fixed.force > 5.0
    assert moving.force == pytest.approx(fixed.force, rel=1e-9)
    np.testing.assert_allclose(moving.friction, fixed.friction, atol=1e-9 * fixed.force)
    np.testing.assert_allclose(one.reactions, other.reactions, atol=1e-9 * fixed.force)
    # Steps begin as well as where supports move.
    assert one.newton_iterations <= other.newton_iterations + 1


def test_points_begin_to_stick_where_the_gap_closes():
    """A bar moved onto a plane and along it: a quarter of the way it is clear, and what sticks is not drawn by that."""
    space = bar(4.0)
    supports = [Support.end(space, end, displacement=(0.0, -WAY, 0.02)) for end in ("start", "end")]
    plane = Plane((0.0, -1.02, 0.0), (0.0, 1.0, 0.0))
    model = Model([Body(space, STIFF)], supports, contacts=[Contact(0, plane, **HOW, friction=10.0)])
    once, often = (statics.solve(model, load_steps=steps).contacts[0].friction[2] for steps in (1, 16))
    assert abs(often) > 0.1
    assert once == pytest.approx(often, rel=0.1)


def test_a_bar_between_two_plates_is_held_by_them():
    space = bar(4.0)
    plates = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)), Plane((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), WAY)
    model = Model([Body(space, STIFF, density=1.0)], contacts=[Contact(0, plate, **HOW) for plate in plates])
    solution = statics.solve(model)
    below, above = solution.contacts
    assert above.force > 20.0
    np.testing.assert_allclose(above.resultant, (0.0, -above.force, 0.0), atol=1e-9 * above.force)
    assert below.force == pytest.approx(above.force, rel=1e-5)
    # Each is as deep in the bar, which is upright between them.
    assert solution.at(0, [1.0])[0, 1] == pytest.approx(-0.5 * WAY, rel=1e-4)
    assert solution.stabilisation[0] <= 1e-6


def test_the_way_of_a_plane_changes_forces_as_is_said():
    operator = ContactOperator(held(bar(4.0), WAY, gap=-0.01))
    displacement = 1e-3 * np.random.default_rng(3).normal(size=operator.model.dofs)

    def forces(factor):
        operator.place(factor)
        return operator.forces(displacement)[0]

    # The penalty is linear in the way, as long as no point comes into contact.
    wanted = (forces(0.5 + 1e-5) - forces(0.5)) / 1e-5
    for step in (0.25, 1e-6):
        found = operator.carried_along(displacement, 0.5, step) / step
        np.testing.assert_allclose(found, wanted, atol=1e-6 * np.abs(wanted).max())
    operator.place(0.0)
    still = operator.push()
    forces(1.0)
    assert operator.push() > still > 0.0


def test_planes_do_not_move_in_motions():
    model = held(bar(4.0), WAY)
    for integrator in ("explicit", "implicit"):
        with pytest.raises(InputError, match="contact 0: motion of the obstacle by load factor is for statics alone"):
            dynamics.solve(model, end_time=1e-3, integrator=integrator)
    with pytest.raises(InputError, match="plane: travel: got inf, need a finite length"):
        Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), np.inf)


def test_what_holds_a_body_on_the_way_is_softer_than_the_body():
    """A hundredth of the softest deformation's stiffness, relative to the diagonal, as all eigenvalues tell it."""
    rod = straight(4, breaks=(0.0, 1.0, 2.0, 3.0, 4.0), height=160.0)
    space = Space.paper(rod, degree=3, order=2, quadrature="auto")
    far = Plane((0.0, -5.0, 0.0), (0.0, 1.0, 0.0), 1.0)
    model = Model([Body(space, STIFF)], contacts=[Contact(0, far, **HOW)])
    assembler = assembler_for(model)
    solver = Newton(assembler, rigid_motions.left_to_contact(model))
    matrix = assembler.matrix()
    assembler.tangent(assembler.vector(), 0.0, matrix)
    stiffness = matrix.convert("dense").getDenseArray()
    softest = eigh(stiffness, np.diag(np.diag(stiffness)), eigvals_only=True, subset_by_index=[0, 6])
    assert abs(softest[5]) < 1e-4 * softest[6]
    assert softest[6] < 1e-4
    fraction = solver.stabilisation.fraction
    assert softest[6] < 100.0 * fraction < 2.0 * softest[6]
    solver.destroy()
