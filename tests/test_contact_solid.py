"""Rods that touch finite element bodies: tangents against differences, balance, Lame's press fit, ranks, bad input."""

import re

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import solids
from conftest import straight
from dolfinx import fem, mesh
from surfaces import DELTA, FIT, HUB, OUTER, SHAFT, fit_pressure
from touching import ACROSS, moved

from comparisons.contact import on_block
from comparisons.joints.lattice import circle, ring
from comparisons.joints.sleeve import pinned
from isorod import InputError, NeoHookean, SolveError, Space, statics
from isorod.assembly.formulation import assembler_for
from isorod.contact import cells, quality
from isorod.contact.facets import nodes_of
from isorod.contact.quality import widths
from isorod.contact.tables import pack
from isorod.contact.tunnelling import Tunnelling
from isorod.fenics import compat
from isorod.fenics.solid import Solid
from isorod.model import Body, Contact, Model, Support
from isorod.model.tie import EndFace, LateralSurface, SolidSurface, Tie

SOFT, STIFF = NeoHookean(1.0, 0.3), NeoHookean(50.0, 0.3)


def block(shape, degree, counts=(4, 4, 2), law=SOFT, below=True):
    """Return a block from (-1, -1, -1) to (1, 1, 0) that is held below, and the facets of its top."""
    place = solids.mesh(shape, counts, 1, lambda points: points * [2.0, 2.0, 1.0] - 1.0)
    space = solids.space(place, degree)
    nothing = fem.Function(space)
    held = fem.locate_dofs_geometrical(space, lambda x: x[2] < -1.0 + 1e-9)
    top = mesh.locate_entities_boundary(place, 2, lambda x: x[2] > -1e-9)
    return Solid(space, law, conditions=[fem.dirichletbc(nothing, held)] if below else []), top


def lying(shape="hexahedron", degree=2, push=0.05, along=0.0, friction=0.0, radius=0.4, height=0.0, elements=2, **more):
    """Return a bar over such a block, whose ends stand out, are pushed down and drawn along."""
    solid, top = block(shape, degree)
    rod = moved(straight(8, radius=radius, height=2.4), (-1.2, 0.02, radius + height), ACROSS)
    space = Space(rod, order=2, section_points=8, elements=elements, degree=3)
    ways = (along, 0.0, -push)
    supports = [Support.end(space, which, displacement=ways) for which in ("start", "end")]
    touching = Contact(0, SolidSurface(0, top), friction=friction, **more)
    return Model([Body(space, STIFF)], supports, contacts=[touching], solids=[solid])


def rates(model, seed=3, size=2e-3):
    """Return how a residual changes in a direction, by differences and by the tangent."""
    assembler = assembler_for(model)
    rng = np.random.default_rng(seed)
    x, way = assembler.vector(), assembler.vector()
    x.array_w[:] = size * rng.standard_normal(x.local_size)
    way.array_w[:] = rng.standard_normal(x.local_size)
    matrix, forces = assembler.matrix(), [assembler.vector() for _ in range(2)]
    if assembler.contact.friction is not None:
        assembler.contact.accept(assembler.touching(assembler.vector(), 0.9))
    assembler.tangent(x, 1.0, matrix)
    assert assembler.contact.touching > 20
    for sign, force in zip((1.0, -1.0), forces, strict=True):
        assembler.residual(x + sign * 1e-7 * way, 1.0, force)
    return (forces[0] - forces[1]) * (1.0 / 2e-7), matrix * way


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize(("shape", "degree"), [("hexahedron", 1), ("hexahedron", 2), ("tetrahedron", 2)])
def test_the_tangent_is_the_derivative_of_the_residual(shape, degree, friction):
    model = lying(shape, degree, push=0.08, along=0.02 * bool(friction), friction=friction, penalty=40.0)
    difference, product = rates(model)
    assert (difference - product).norm() < 1e-5 * difference.norm()


@pytest.mark.parametrize("shape", solids.SHAPES)
def test_forces_of_rod_and_body_are_in_balance(shape):
    solved = statics.solve(lying(shape))
    (contact,) = solved.contacts
    assert contact.on_facets and contact.force > 0.01
    assert contact.resultant + solved.reactions.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
    assert contact.relative_penetration < 2e-3
    # What the body is held by.
    below = solved.model.solids[0].residual(solved.solids[0], 1.0).reshape(-1, 3)
    held = solved.model.solids[0].positions[:, 2] < -1.0 + 1e-9
    assert below[held].sum(axis=0) == pytest.approx(contact.resultant, abs=1e-9)


def fitted(around, delta=DELTA, degree=2):
    """Return a shaft in the hub of `fit_pressure`, whose ends are free."""
    made = ring(FIT, circle(OUTER), 10.0, (3, around, 1), "hexahedron", degree)
    space = compat.function_space(made.mesh, compat.element(made.mesh, "Lagrange", degree, 3))
    part = space.sub(2)
    own, _ = compat.collapsed(part)
    face = fem.locate_dofs_geometrical((part, own), lambda x: np.abs(x[2]) < 1e-9)
    hub = Solid(space, HUB, conditions=[*pinned(space, OUTER), fem.dirichletbc(fem.Function(own), face, part)])
    shaft = Space(straight(8, radius=FIT + delta, height=10.0), order=2, elements=1, degree=2)
    supports = [Support(np.arange(shaft.layer_nodes), "z"), Support([0, 4], "y"), Support([2], "x")]
    fit = Contact(0, SolidSurface(0, made.hole))
    return Model([Body(shaft, SHAFT)], supports, contacts=[fit], solids=[hub])


def test_a_press_fit_has_lames_pressure():
    (result,) = statics.solve(fitted(32)).contacts
    assert result.force / result.area == pytest.approx(fit_pressure(False), rel=3e-3)
    assert np.abs(result.pressure / fit_pressure(False) - 1.0).max() < 0.05


def test_a_polygon_is_no_round_hole_and_that_is_warned_of():
    """Of 24 sides the middles are 0.09 nearer than the corners, nine times the interference."""
    with pytest.warns(UserWarning, match="contact 0: facets are flat, up to 0.085 from a smooth surface"):
        statics.solve(fitted(24, degree=1))


def test_points_are_as_close_as_rods_are_curved_and_more_come_where_a_patch_is_narrow():
    wide, slim = (assembler_for(lying(radius=radius)).contact for radius in (0.4, 0.05))
    assert slim.packed.areas.size > 20 * wide.packed.areas.size
    assert wide.packed.areas.sum() == pytest.approx(4.0) == slim.packed.areas.sum()
    solved = statics.solve(lying(push=0.02))
    assert solved.contacts[0].pressure.size > 1.3 * wide.packed.areas.size


def test_points_are_as_close_as_functions_of_the_rod():
    few, many = (assembler_for(lying(elements=count)).contact for count in (2, 48))
    assert many.packed.areas.size > 2 * few.packed.areas.size


@pytest.mark.parametrize("shape", solids.SHAPES)
def test_other_points_have_what_those_of_their_facet_had(shape):
    old, new = (pack(lying(shape), [(count, count)]) for count in (4, 10))
    facet = [np.repeat(np.arange(one.surfaces["elements"][-1]), one.passes["along"][-1]) for one in (old, new)]
    np.testing.assert_array_equal(cells.moved(old, facet[0].astype(float), new), facet[1])


def test_the_width_of_a_strip_is_that_in_which_points_press():
    """A bar along x that is in a flat block by ``d``: half the width is the root of ``2 r d``."""
    depth, radius = 0.01, 0.4
    model = lying(radius=radius, height=-depth, push=0.0)
    contact = assembler_for(model).contact
    assert contact.increase_points(np.zeros(model.dofs + contact.beyond.size), between=False)
    contact.forces(np.zeros(model.dofs + contact.beyond.size))
    (width,) = widths(contact.packed)
    spacing = np.sqrt(contact.packed.areas.mean())
    # The pressure is a parabola across, whose second moment is a fifth of half the width's square.
    assert width.around * spacing == pytest.approx(np.sqrt(12.0 / 5.0 * 2.0 * radius * depth), rel=0.03)
    assert width.along == np.inf


def test_angles_are_in_the_arcs_of_graded_sections():
    """Ten fine arcs, the first about the angle 0.3, in arcs of 1, 2, 3 and 4."""
    arc_of = np.repeat(np.arange(4), [1, 2, 3, 4])
    masters = {"turn": np.full(12, 0.3), "fine": np.full(12, 10), "arc_of": np.tile(arc_of, (12, 1))}
    numbers = np.arange(12) - 1
    for off in (-0.49, 0.0, 0.49):
        theta = 0.3 + 2.0 * np.pi / 10.0 * (numbers + off)
        assert quality._arcs(masters, theta).tolist() == arc_of[numbers % 10].tolist()


@pytest.mark.parametrize("shape", solids.SHAPES)
@pytest.mark.parametrize("sideways", [0.0, 0.02])
def test_a_centre_line_that_goes_through_facets_is_noticed(shape, sideways):
    """Also where all of it passes along the edges of facets."""
    model = lying(shape, height=0.3)
    count = model.dofs + assembler_for(model).contact.beyond.size
    passing = Tunnelling(model)

    def moved(way, below=0.0):
        found = np.zeros((count // 3, 3))
        found[: model.dofs // 3][model.bodies[0].space.is_control_point] = way
        found[model.dofs // 3 :, 2] = below
        return found.ravel()

    rest = moved((0.0, -sideways, 0.0))
    assert passing.passed(rest, moved((0.0, -sideways, -1.2))).startswith("tunnelling of body 0 at u = ")
    assert 0.1 < passing.free(rest, moved((0.0, -sideways, -1.2))) < 0.6
    # Facets beside each other may move apart.
    apart = moved((0.0, -sideways, -1.2))
    apart[model.dofs + 1 :: 3] = 0.05 * nodes_of(model)[1][:, 1]
    assert passing.passed(rest, apart) is not None
    # Nor if the block goes as far.
    for way, below in (((0.0, 0.0, 1.0), 0.0), ((0.3, 0.3, 0.0), 0.0), ((0.0, 0.0, -1.2), -1.2)):
        assert passing.passed(rest, moved(way, below)) is None


@pytest.mark.slow
def test_friction_holds_back_what_is_drawn_along():
    free, rough = (statics.solve(lying(along=0.05, friction=mu), load_steps=4) for mu in (0.0, 0.2))
    assert abs(free.reactions[:, 0].sum()) < 1e-3 * free.contacts[0].force
    (contact,) = rough.contacts
    assert contact.slipping > contact.sticking
    assert -contact.friction[0] == pytest.approx(0.2 * contact.force, rel=0.03)
    assert rough.reactions[:, 0].sum() == pytest.approx(-contact.resultant[0] - contact.friction[0], abs=1e-9)


def seen():
    """Return how many points a narrow patch is looked at with, and the width of it."""
    model = lying(degree=1, height=-0.01, push=0.0)
    contact = assembler_for(model).contact
    rest = np.zeros(model.dofs + contact.beyond.size)
    contact.increase_points(rest, between=False)
    contact.forces(rest)
    contact.ranks.gather(contact.packed, contact.packed.states, contact.packed.starts)
    (width,) = widths(contact.packed)
    return [*contact.points[0], width.around]


def pressed():
    """Return the reactions and the force of contact, with friction."""
    solved = statics.solve(lying(degree=1, along=0.02, friction=0.3), petsc={"snes_rtol": 1e-12})
    return np.append(solved.reactions.ravel(), solved.contacts[0].force)


def same(expected, points):
    assert pressed() == pytest.approx(np.array(expected), abs=1e-9)
    assert seen() == pytest.approx(points, rel=1e-12)


@pytest.mark.mpi
def test_ranks_agree(on_ranks):
    on_ranks(2, f"test_contact_solid.same({pressed().tolist()!r}, {seen()!r})")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"second": SolidSurface(1)}, "contact 0: solid 1 is not one of the model's 1"),
        ({"second_surface": "inner"}, "contact: second_surface is given, but the second partner is rigid, facets"),
    ],
)
def test_bad_input_is_refused(change, said):
    model = lying()
    with pytest.raises(InputError, match=re.escape(said)):
        contact = Contact(0, **({"second": SolidSurface(0)} | change))
        Model(model.bodies, model.supports, contacts=[contact], solids=model.solids)


def test_surfaces_that_are_tied_do_not_touch():
    model = lying()
    ties = [Tie(LateralSurface(0), model.contacts[0].facets, gap=1.0)]
    with pytest.raises(InputError, match="contact 0: tie 0 holds the same surfaces; leave out one of the two"):
        Model(model.bodies, model.supports, contacts=model.contacts, ties=ties, solids=model.solids)
    # A part of the rod may be tied, and so may its end.
    for other in (LateralSurface(0, (0.0, 1.2)), EndFace(0, "end")):
        ties = [Tie(other, model.contacts[0].facets, gap=1.0)]
        Model(model.bodies, model.supports, contacts=model.contacts, ties=ties, solids=model.solids)


def test_what_is_not_known_is_refused():
    with pytest.raises(InputError, match=r"facets of solid 0: .* points are needed to see a rod of radius 0.0001"):
        statics.solve(lying(radius=1e-4))
    with pytest.raises(SolveError, match="a solid is free to move as a rigid body"):
        model = lying()
        solid, top = block("hexahedron", 1, below=False)
        statics.solve(Model(model.bodies, model.supports, contacts=[Contact(0, SolidSurface(0, top))], solids=[solid]))


@pytest.mark.slow
def test_a_rod_on_a_block_presses_as_hertz_says():
    found = on_block.measure(4)
    assert abs(found.half) < 0.01
    assert abs(found.peak) < 0.01
