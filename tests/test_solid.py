"""Finite element bodies: forces and tangents against differences, rigid motions, masses, conditions, loads, ranks."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import dolfinx.fem
import solids
import ufl
from conftest import as_array
from mpi4py import MPI
from refused import refused
from solids import LAW, SHAPES, box, mesh, sector, solid, space

from isorod.errors import InputError
from isorod.fenics import compat
from isorod.fenics.solid import Solid
from isorod.material import LinearElastic, NeoHookean
from isorod.material.holzapfel_gasser_ogden import HolzapfelGasserOgden
from isorod.material.muscle import Muscle
from isorod.material.ogden import Ogden
from isorod.material.orthotropic import Orthotropic
from isorod.material.yeoh import Yeoh
from isorod.tensors import rotation

MUSCLE = Muscle(E=2.0, nu=0.3, sigma_max=1.5, m1=0.4, m2=2.0, activation=0.8, fibre=(1.0, 2.0, 2.0))


def noise(body, size, seed=0):
    return size * np.random.default_rng(seed).normal(size=3 * body.nodes)


def load_of(one):
    """Return a load on the surface and in the volume, of which the unknown of the body knows nothing."""
    v, x = ufl.TestFunction(one), ufl.SpatialCoordinate(one.mesh)
    return ufl.inner(ufl.as_vector([x[1], 2.0, 0.0]), v) * ufl.ds + 3.0 * v[2] * ufl.dx


@pytest.fixture(scope="module", params=[(s, p) for s in SHAPES for p in (1, 2)], ids=str)
def body(request):
    one = space(mesh(request.param[0], place=box), request.param[1])
    return Solid(one, MUSCLE, density=3.0, load=load_of(one))


def test_forces_are_the_derivative_of_energy_and_load(body):
    u, way, h = noise(body, 0.01), noise(body, 1.0, 1), 1e-5
    outer = body.external()
    for factor in (0.0, 0.7):
        ahead, behind = (body.energy(u + s * h * way, factor) for s in (1.0, -1.0))
        expected = (ahead - behind) / (2.0 * h) - factor * outer @ way
        assert body.residual(u, factor) @ way == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_the_tangent_is_the_derivative_of_forces(body):
    u, way, h = noise(body, 0.01), noise(body, 1.0, 1), 1e-6
    matrix = body.tangent(u, 0.6)
    got = solids.times(matrix, way)
    expected = (body.residual(u + h * way, 0.6) - body.residual(u - h * way, 0.6)) / (2.0 * h)
    assert np.abs(got - expected).max() < 1e-7 * np.abs(expected).max()
    assert body.tangent(0.0 * u, 0.0) is matrix
    assert matrix.getType() == "seqaij" and matrix.getBlockSize() == 3


def test_energy_of_a_homogeneous_deformation_is_the_laws(body):
    change = 0.1 * np.random.default_rng(2).normal(size=(3, 3))
    u = (body.positions @ change.T).ravel()
    for factor in (0.0, 1.0):
        expected = MUSCLE.at(factor).energy(np.eye(3) + change) * solids.SIZES.prod()
        assert body.energy(u, factor) == pytest.approx(expected, rel=1e-12)


LAWS = [
    Ogden([0.63, -0.1], [1.3, -2.0], 20.0),
    HolzapfelGasserOgden(3.0, 2.4, 0.8, 50.0, fibre=((1.0, 2.0, 0.0), (1.0, -2.0, 0.5))),
    Orthotropic((10.0, 2.0, 3.0), (0.3, 0.2, 0.25), (1.0, 1.5, 2.0), axes=((1.0, 1.0, 0.0), (0.0, 0.0, 1.0))),
    Yeoh(1.0, 0.2, 0.1, 30.0),
]


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_laws_are_those_of_rods(law):
    body = solid("tetrahedron", counts=(1, 1, 1), law=law)
    change = 0.1 * np.random.default_rng(2).normal(size=(3, 3))
    u = (body.positions @ change.T).ravel()
    volume = solids.SIZES.prod()
    assert body.energy(u, 1.0) == pytest.approx(law.energy(np.eye(3) + change) * volume, rel=1e-8)
    # The work of the stress on linear fields.
    got = np.einsum("na,nb->ab", body.residual(u, 1.0).reshape(-1, 3), body.positions)
    expected = volume * law.stress(np.eye(3) + change)
    assert np.abs(got - expected).max() < 1e-7 * np.abs(expected).max()


def test_another_value_of_a_constant_compiles_nothing(monkeypatch):
    def signatures(law):
        made = []
        monkeypatch.setattr(compat, "form", lambda integrals, flags: made.append(integrals.signature()))
        solid("hexahedron", counts=(1, 1, 1), law=law)
        return made

    # Old UFL sorts constants by their names, in which c_10 is before c_9: from here on all numbers have three digits.
    mesh = solids.mesh("hexahedron", (1, 1, 1))
    for _ in range(100):
        dolfinx.fem.Constant(mesh, 0.0)
    muscle = Muscle(E=3.0, nu=0.2, sigma_max=0.5, m1=0.1, m2=1.0, activation=0.3, fibre=(0.0, 1.0, 2.0))
    assert signatures(MUSCLE) == signatures(muscle)
    assert len(signatures(MUSCLE)) == 3


def test_masses_add_up_and_weigh_linear_fields_exactly(body):
    mass = body.mass()
    assert body.mass() is mass
    a, b = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.4, -1.0])
    one = (body.positions @ a)[:, None] * b
    # Moments of the box from the origin.
    second = (np.outer(solids.SIZES, solids.SIZES) / 4.0 + np.diag(solids.SIZES**2) / 12.0) * solids.SIZES.prod()
    assert one.ravel() @ solids.times(mass, one.ravel()) == pytest.approx(3.0 * (a @ second @ a) * (b @ b), rel=1e-12)


def test_loads_add_up(body):
    force = body.external().reshape(-1, 3).sum(axis=0)
    (a, b, c), volume = solids.SIZES, solids.SIZES.prod()
    area = 2.0 * (a * b + b * c + c * a)
    # The mean of y over the surface is half its side.
    assert force == pytest.approx([0.5 * b * area, 2.0 * area, 3.0 * volume], rel=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_rigid_motion_asks_for_no_force(shape):
    for degree, order, place in ((1, 1, box), (2, 2, sector), (3, 2, sector)):
        one = solid(shape, degree, order, place, counts=(2, 2, 2), law=LAW)
        u = one.positions @ (rotation([0.5, -1.0, 2.0]) - np.eye(3)).T + [1.0, 2.0, 3.0]
        assert np.abs(one.residual(u.ravel(), 1.0)).max() < 1e-13
        assert abs(one.energy(u.ravel(), 1.0)) < 1e-13


@pytest.mark.parametrize("shape", SHAPES)
def test_a_linear_body_solved_with_its_conditions_finds_a_linear_field(shape):
    """Patch test of what is held: a linear field on the surface."""
    one = space(mesh(shape, place=box), 2)
    change = 0.01 * np.random.default_rng(3).normal(size=(3, 3))
    field = dolfinx.fem.Function(one)
    field.interpolate(lambda x: change @ x)
    surface = solids.boundary(one.mesh)
    conditions = [dolfinx.fem.dirichletbc(field, dolfinx.fem.locate_dofs_topological(one, 2, surface))]
    body = Solid(one, LinearElastic(E=5.0, nu=0.3), conditions=conditions)
    dofs, values = body.held
    assert 0 < len(dofs) < 3 * body.nodes and (np.diff(dofs) > 0).all()
    u = np.zeros(3 * body.nodes)
    K = as_array(body.tangent(u, 1.0))
    u[dofs] = values
    free = np.setdiff1d(np.arange(len(u)), dofs)
    u[free] = np.linalg.solve(K[np.ix_(free, free)], -K[np.ix_(free, dofs)] @ values)
    assert np.abs(u - (body.positions @ change.T).ravel()).max() < 1e-13


def test_conditions_on_components_and_the_later_one_wins():
    one = space(mesh("hexahedron", place=box), 1)
    bottom = dolfinx.fem.locate_dofs_topological((one.sub(2)), 2, solids.where(one.mesh, lambda x: x[2] < 1e-9))
    edge = dolfinx.fem.locate_dofs_geometrical(one, lambda x: (x[2] < 1e-9) & (x[0] < 1e-9))
    conditions = [
        dolfinx.fem.dirichletbc(np.float64(0.5), bottom, one.sub(2)),
        dolfinx.fem.dirichletbc(np.array([1.0, 2.0, 3.0]), edge, one),
    ]
    body = Solid(one, LAW, conditions=conditions)
    dofs, values = body.held
    expected = {}
    for node, x in enumerate(body.positions):
        if x[2] < 1e-9:
            expected[3 * node + 2] = 0.5
            if x[0] < 1e-9:
                expected |= {3 * node + a: a + 1.0 for a in range(3)}
    assert dict(zip(dofs.tolist(), values.tolist(), strict=True)) == expected


@pytest.mark.parametrize("way", ["terms", "derivative"])
def test_a_form_is_the_law_and_its_value_at_rest_the_loads(way):
    one = space(mesh("tetrahedron", place=box), 2)
    u, v = dolfinx.fem.Function(one), ufl.TestFunction(one)
    strain = ufl.sym(ufl.grad(u))
    stress = 1.5 * ufl.tr(strain) * ufl.Identity(3) + 2.0 * strain
    dx = ufl.dx(metadata={"quadrature_degree": 2})
    form = ufl.inner(stress, ufl.grad(v)) * dx - load_of(one)
    if way == "derivative":
        work = 0.5 * ufl.inner(stress, strain) * dx - ufl.replace(load_of(one), {v: u})
        form = ufl.derivative(work, u, v)
    by_form = Solid(one, form=form, unknown=u)
    nu = 1.5 / (2.0 * (1.5 + 1.0))
    by_law = Solid(one, LinearElastic(E=2.0 * (1.0 + nu), nu=nu), load=load_of(one))
    given = noise(by_law, 0.1)
    for factor in (0.0, 0.4, 1.0):
        expected = by_law.residual(given, factor)
        assert np.abs(by_form.residual(given, factor) - expected).max() < 1e-12 * np.abs(expected).max()
    assert np.abs(by_form.external() - by_law.external()).max() < 1e-13
    with pytest.raises(InputError, match="given as a form, which stores none"):
        by_form.energy(given, 1.0)


def test_springs_of_a_form_are_stretched_by_the_load_factor():
    """``k (u - u0)`` on the surface: the load stands in a product with the unknown."""
    one = space(mesh("hexahedron", (2, 2, 2), place=box), 1)
    u, v = dolfinx.fem.Function(one), ufl.TestFunction(one)
    strain, there = ufl.sym(ufl.grad(u)), ufl.as_vector([0.1, 0.2, -0.3])
    body = Solid(one, form=ufl.inner(strain, ufl.grad(v)) * ufl.dx + 5.0 * ufl.inner(u - there, v) * ufl.ds, unknown=u)
    for factor in (0.0, 0.5, 1.0):
        moved = np.tile(factor * np.array([0.1, 0.2, -0.3]), body.nodes)
        assert np.abs(body.residual(moved, factor)).max() < 1e-14


def test_a_pressure_that_follows_the_body_is_in_the_tangent():
    one = space(mesh("tetrahedron", place=box), 2)
    u, v = dolfinx.fem.Function(one), ufl.TestFunction(one)
    F = ufl.Identity(3) + ufl.grad(u)
    pressure = 0.3 * ufl.inner(ufl.cofac(F) * ufl.FacetNormal(one.mesh), v) * ufl.ds(metadata={"quadrature_degree": 4})
    body = Solid(one, LAW, load=pressure, unknown=u)
    given, way, h = noise(body, 0.01), noise(body, 1.0, 1), 1e-6
    expected = (body.residual(given + h * way, 2.0) - body.residual(given - h * way, 2.0)) / (2.0 * h)
    assert np.abs(solids.times(body.tangent(given, 2.0), way) - expected).max() < 1e-7 * np.abs(expected).max()
    # On a closed surface pressure neither moves nor turns a body, in any state.
    force = (body.residual(given, 2.0) - body.residual(given, 0.0)).reshape(-1, 3)
    assert np.abs(force.sum(axis=0)).max() < 1e-13
    assert np.abs(np.cross(body.positions + given.reshape(-1, 3), force).sum(axis=0)).max() < 1e-13


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_forces_have_no_value_where_a_cell_is_turned_inside_out(nu):
    body = solid(law=NeoHookean(E=1.0, nu=nu))
    mirrored = body.positions * [-2.0, 0.0, 0.0]
    assert np.isnan(body.residual(mirrored.ravel(), 1.0)).all()
    linear = solid(law=LinearElastic(E=1.0, nu=nu))
    assert np.isfinite(linear.residual(mirrored.ravel(), 1.0)).all()


def test_a_function_has_the_values(body):
    u = noise(body, 1.0)
    found = body.function(u)
    assert found.function_space == body.space
    assert (found.x.array[: len(u)] == u).all()


def answers(counts=(4, 4, 3)):
    """Return numbers of a body that do not depend on how it is distributed."""
    one = space(mesh("tetrahedron", counts, 2, sector), 2)
    held = dolfinx.fem.locate_dofs_geometrical(one, lambda x: x[2] < 1e-9)
    values = dolfinx.fem.Function(one)
    values.interpolate(lambda x: np.stack([x[0], x[1] * x[0], x[2] + 1.0]))
    body = Solid(one, MUSCLE, density=2.0, load=load_of(one), conditions=[dolfinx.fem.dirichletbc(values, held)])
    assert body.owned[1] - body.owned[0] == len(body.positions) and body.nodes == body.comm.allreduce(
        len(body.positions)
    )
    x = body.positions
    u = 0.05 * np.stack([np.sin(x[:, 1]), x[:, 0] * x[:, 2], np.cos(x[:, 0])], axis=1).ravel()
    way = np.stack([x[:, 2] ** 2, np.sin(x[:, 0]), x[:, 1]], axis=1).ravel()
    found = [body.residual(u, 0.5), body.external(), solids.times(body.tangent(u, 0.5), way)]
    found.append(solids.times(body.mass(), way))
    dofs, values = body.held
    own = np.zeros(len(u))
    own[dofs - 3 * body.owned[0]] = values
    table = np.concatenate([x, np.stack([*found, own], axis=1).reshape(len(x), -1)], axis=1)
    table = solids.gathered(body.comm, table)
    order = np.lexsort(np.round(table[:, :3], 9).T)
    return np.append(table[order].ravel(), [body.energy(u, 0.5), body.function(u).x.array.max() > 0.0])


def agree(path):
    if MPI.COMM_WORLD.size == 1:
        np.save(path, answers())
        return
    got, expected = answers(), np.load(path)
    assert np.abs(got - expected).max() < 1e-13


@pytest.mark.mpi
def test_ranks_agree(on_ranks, tmp_path):
    agree(tmp_path / "alone.npy")
    on_ranks(2, f"test_solid.agree({str(tmp_path / 'alone.npy')!r})")


def flat():
    return dolfinx.mesh.create_unit_square(MPI.COMM_SELF, 2, 2)


def element_space(domain, family="Lagrange", degree=1, size=3):
    return compat.function_space(domain, compat.element(domain, family, degree, size))


def cube():
    return mesh("tetrahedron", (1, 1, 1), comm=MPI.COMM_SELF)


def of_form(change):
    """Return a body from a form with something changed."""
    one = element_space(cube())
    other = element_space(one.mesh, degree=2)
    u, v = dolfinx.fem.Function(one), ufl.TestFunction(one)
    given = {"form": ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx, "unknown": u}
    changes = {
        "law": {"law": LAW},
        "no unknown": {"unknown": None},
        "other unknown": {"unknown": dolfinx.fem.Function(other)},
        "other test": {"form": ufl.inner(u, ufl.TestFunction(other)) * ufl.dx(metadata={"quadrature_degree": 3})},
        "bilinear": {"form": ufl.inner(ufl.TrialFunction(one), v) * ufl.dx},
        "loads alone": {"form": v[0] * ufl.dx},
        "load": {"load": ufl.inner(u, u) * ufl.dx},
        "condition": {"conditions": [dolfinx.fem.dirichletbc(dolfinx.fem.Function(other), np.array([0], np.int32))]},
    }
    return Solid(one, **(given | changes[change]))


test_bodies_that_cannot_be = refused(
    (lambda: Solid(None, LAW), "space of the solid: got NoneType, need a dolfinx function space"),
    (
        lambda: Solid(element_space(flat(), size=2), LAW),
        "mesh of the solid: got triangle cells in 2-D, need tetrahedra",
    ),
    (lambda: Solid(element_space(cube(), size=None), LAW), "got block size 1, need a vector space of 3 components"),
    (lambda: Solid(element_space(cube(), size=2), LAW), "got block size 2, need a vector space of 3 components"),
    (lambda: Solid(element_space(cube(), "DG"), LAW), "need Lagrange elements"),
    (lambda: solid(degree=1, order=2, place=sector, law=LAW), "degree 1 on curved cells of degree 2 cannot rotate"),
    (lambda: solid(), "solid: got neither a law nor a form, need one of them"),
    (lambda: of_form("law"), "solid: got both a law and a form, need one of them"),
    (lambda: of_form("no unknown"), "got a form without its unknown"),
    (lambda: of_form("other unknown"), "unknown of the solid: it is of another space"),
    (lambda: of_form("other test"), "form of the solid: need a UFL form with one test function, of the space given"),
    (lambda: of_form("bilinear"), "form of the solid: need a UFL form with one test function, of the space given"),
    (lambda: of_form("loads alone"), "form of the solid: its unknown does not stand in it"),
    (lambda: of_form("load"), "load of the solid: need a UFL form with one test function"),
    (lambda: of_form("condition"), "conditions of the solid: one is of another space"),
    (lambda: solid(law=NeoHookean(E=1.0, nu=0.5)), "incompressible"),
    (lambda: solid(law=Muscle(E=1.0, nu=0.3)), "law: its fibres follow a rod; on a finite element body give them as a"),
    (lambda: solid(law=LAW).mass(), "density of the solid: got 0, need a positive mass per volume"),
    (lambda: solid(law=LAW, density=-1.0).mass(), "density of the solid: got -1, need a positive mass per volume"),
)
