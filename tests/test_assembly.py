"""What is assembled: element matrices, masses, unknowns in their places, and what is refused."""

import numpy as np
import pytest
from conftest import as_array
from models import gradients_of_functions, ring, spring, tendon_and_muscle, two_bodies
from petsc4py import PETSc
from refused import refused

from isorod import Axis, Body, InputError, Model, NeoHookean, Rod, Space, StVenantKirchhoff, Support, circle, statics
from isorod.assembly.assembler import Assembler
from isorod.assembly.pattern import Pattern, add
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring


@pytest.mark.parametrize("make", [two_bodies, tendon_and_muscle])
def test_entries_are_the_sum_of_the_element_matrices(make):
    """Blocks of them go where they belong at once, and there are no element matrices."""
    assembler = Assembler(make(), PETSc.COMM_SELF)
    local = assembler.local(0.05 * np.random.default_rng(4).uniform(-1, 1, assembler.model.dofs))
    pattern = Pattern([part.of_dofs for part in assembler.parts], assembler.free)
    for part, blocks in zip(assembler.parts, pattern.blocks, strict=True):
        entries, expected = np.zeros((2, pattern.total))
        part.add_entries(local, 0.7, blocks, entries)
        add(part.matrices(local, 0.7), blocks, expected)
        assert np.abs(entries - expected).max() < 1e-14 * np.abs(expected).max()


@pytest.mark.parametrize(
    "space",
    [
        Space.paper(Spring(helix="paper", coils=1, section_points=5).rod(), elements=4, degree=3),
        Space.paper(Spring(helix="paper", coils=1, section_points=5).rod(), elements=4, quadrature="2x1x2"),
        pytest.param(
            Space(
                Spring(helix="paper", coils=1, section_points=4).rod(), elements=4, order=2, section_points=32, degree=2
            ),
            marks=pytest.mark.slow,
        ),
        Space(Spring(helix="paper", coils=1).rod(), elements=4, section_degree=3, degree=2),
    ],
    ids=["cubic", "few points", "more points than are taken at a time", "polynomials"],
)
def test_element_matrices_are_integrals_of_the_moduli(space):
    """Elements of three laws, deformed, against the sums written out."""
    laws = [
        NeoHookean(80.0, 0.35),
        StVenantKirchhoff(900.0, 0.1),
        StVenantKirchhoff(900.0, 0.1),
        NeoHookean(80.0, 0.35),
    ]
    (part,) = Assembler(Model([Body(space, laws)]), PETSc.COMM_SELF).parts
    local = 0.05 * np.random.default_rng(2).uniform(-1, 1, space.nodes * 3)
    t = part.table
    slopes = gradients_of_functions(t)
    moduli = part.laws.tangent(part.gradients(local))
    expected = np.einsum("etq,etqAi,etqaAbB,etqBk->eiakb", t.weights, slopes, moduli, slopes, optimize=True)
    found = part.matrices(local, 0.0)
    assert np.abs(found - expected.reshape(found.shape)).max() < 1e-13 * np.abs(found).max()
    some = part.matrices(local, 0.0, np.array([0, 2]))
    assert np.abs(some - found[[0, 2]]).max() < 1e-15 * np.abs(found).max()


def rest_and_mass(density=3.0, n=6):
    """A free body, the positions of its nodes, and its consistent mass matrix."""
    rod = Rod.sweep(
        circle(n, 0.5), Axis(2, [0, 0, 0, 0.3, 1, 1, 1], np.ones(4)), np.outer([0, 0.3, 1.3, 2], [0.2, 0, 1])
    )
    space = Space.paper(rod, degree=3, quadrature="6x4x6")
    assembler = Assembler(Model([Body(space, NeoHookean(1.0, 0.3), density)]), PETSc.COMM_SELF)
    return assembler, space.positions, as_array(assembler.mass())


def test_mass_matrix_holds_mass_centre_and_inertia():
    """Of the oblique cylinder with faces normal to z: mass, first and second moments through rigid motions."""
    _, x, mass = rest_and_mass()
    total, height = 3.0 * np.pi * 0.25 * 2.0, 2.0
    one = np.ones(len(x))
    scalar = mass[::3, ::3]
    assert np.abs(mass - mass.T).max() < 1e-15
    assert np.abs(mass - np.kron(scalar, np.eye(3))).max() == 0
    assert np.linalg.eigvalsh(scalar).min() > 0
    assert one @ scalar @ one == pytest.approx(total, rel=1e-12)
    assert x.T @ scalar @ one / total == pytest.approx([0.2, 0.0, 1.0], abs=1e-12)
    middle = x - [0.2, 0.0, 1.0]
    length = height**2 / 12
    expected = [[0.25 / 4 + 0.04 * length, 0, 0.2 * length], [0, 0.25 / 4, 0], [0.2 * length, 0, length]]
    assert middle.T @ scalar @ middle / total == pytest.approx(np.array(expected), abs=1e-12)


def test_lumped_mass_is_the_row_sums():
    assembler, _, mass = rest_and_mass()
    lumped = as_array(assembler.mass(lumped=True))
    assert np.abs(lumped - np.diag(mass.reshape(-1, len(mass) // 3, 3).sum(axis=1).max(axis=1))).max() < 1e-14
    assert assembler.built == ["mass", "lumped mass"]


@pytest.mark.parametrize("make", [spring, ring, two_bodies])
def test_displacement_puts_unknowns_and_supports_in_their_places(make):
    model, assembler = make(), Assembler(make(), PETSc.COMM_SELF)
    x = assembler.vector()
    x.array[:] = np.random.default_rng(0).uniform(-1, 1, x.getSize())
    u = assembler.displacement(x, 0.5)
    assert u.shape == (model.dofs,)
    assert np.array_equal(u[model.held], 0.5 * model.values)
    assert np.array_equal(np.delete(u, model.held), x.array_r)


def test_blocks_of_three_where_nodes_are_free_or_held_as_a_whole():
    whole, part = Assembler(spring(), PETSc.COMM_SELF), Assembler(ring(), PETSc.COMM_SELF)
    assert (whole.matrix().getBlockSize(), whole.vector().getBlockSize()) == (3, 3)
    assert (part.matrix().getBlockSize(), part.vector().getBlockSize()) == (1, 1)


def test_bodies_that_do_not_touch_are_solved_as_if_alone():
    both = two_bodies()
    supports = [Support(s.nodes, s.components, s.displacement) for s in both.supports]
    alone = Model(both.bodies[:1], supports[:2]), Model(both.bodies[1:], supports[2:])
    together = statics.solve(both)
    for k, model in enumerate(alone):
        solution = statics.solve(model)
        u = both.nodal(together.displacement, k)
        assert np.abs(u - model.nodal(solution.displacement)).max() < 1e-9 * np.abs(u).max()
        assert np.abs(u).max() > 0.1


def test_smallest_jacobian_names_body_element_and_place():
    model = two_bodies()
    assembler = Assembler(model, PETSc.COMM_SELF)
    x = assembler.vector()
    u = np.zeros(model.dofs)
    space = model.bodies[1].space
    # turn one layer of the ring, the one in the middle of element 5, inside out
    layer = int(space.element_layers[5, 1])
    points = space.rod.axis.transfer(space.axis, space.rod.control_points)[layer]
    nodes = model.first_node[1] + layer * space.layer_nodes + np.arange(space.layer_nodes)
    u.reshape(-1, 3)[nodes] = 3 * (points.mean(axis=0) - points) * [0, 0, 1]
    x.array[:] = u[model.free >= 0]
    det, body, element, where = assembler.smallest_jacobian(x, 0.0)
    assert det < 0
    assert (body, element) == (1, 5)
    assert space.axis.breaks[5] < where < space.axis.breaks[6]


def test_a_folded_rod_is_refused_and_the_element_named():
    rod = Ring(a=6.0).rod()
    # The ring folds everywhere alike; which element is worst is a matter of the last digits.
    with pytest.raises(InputError, match=r"folds in element \d at u = .*disk point \(-"):
        Assembler(Model([Body(Space.paper(rod), NeoHookean(1.0, 0.3))]), PETSc.COMM_SELF)


test_refuses_supports_that_cannot_be = refused(
    ([Support([0], body=1)], "support 0: body 1 is not one of the 1 bodies"),
    ([Support([0]), Support([-1])], "support 1: node -1 is not in body 0"),
    ([Support([3, 9999])], "support 0: node 9999"),
    ([Support([0], "xw")], "support 0: got components 'xw', need some of 'xyz'"),
    ([Support([0], "")], "got components ''"),
    ([Support([0], "x"), Support([1, 0], "xy", (1.0, 0, 0))], "support 1: node 0, component x is prescribed by"),
    ([Support([0], "x", (np.nan, 0, 0))], "not finite"),
    by=lambda supports: Model(spring().bodies, supports),
)


def test_a_closed_rod_has_no_ends():
    with pytest.raises(InputError, match="closed rod has none"):
        Support.end(Space.paper(Ring().rod()), "start")
    with pytest.raises(InputError, match="need 'start' or 'end'"):
        Support.end(spring().bodies[0].space, "top")
