"""Residual, tangent and energy agree with each other, on any number of ranks."""

from pathlib import Path

import numpy as np
import pytest
from conftest import as_array
from petsc4py import PETSc

from isorod import statics
from isorod.assembly.assembler import Assembler
from isorod.assembly.pattern import Pattern, add
from isorod.errors import InputError
from isorod.geometry.axis import Axis
from isorod.geometry.rod import Rod
from isorod.geometry.section import circle
from isorod.material import LinearElastic, NeoHookean
from isorod.material.muscle import Muscle
from isorod.material.st_venant_kirchhoff import StVenantKirchhoff
from isorod.model import Body, Model, Spin, Support
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring
from isorod.space import Space


def spring(rule="full"):
    return Spring(preset="paper", coils=1, section_points=4, elements_per_turn=4, quadrature=rule).model()


def ring():
    """A closed rod, held at a few nodes and not in every direction."""
    space = Space.paper(Ring(section_points=5).rod(), elements=8, degree=3)
    supports = [
        Support([0, 1], "xy"),
        Support([2, space.nodes - 1], "z"),
        Support([4 * 5], "xyz", (0.05, -0.02, 0.1)),
    ]
    return Model([Body(space, NeoHookean(100.0, 0.3))], supports)


def two_bodies():
    """A spring that is free to turn about z at one end, and a ring of another law; the bodies do not touch."""
    wire = Space.paper(Spring(coils=1, section_points=3).rod(), degree=2, elements=4, quadrature="paper")
    hoop = Space.paper(Ring(section_points=4).rod(), elements=8, degree=2, continuity=0)
    supports = [
        Support.end(wire, "start"),
        Support.end(wire, "end", "z", (0.0, 0.0, 0.3)),
        Support([0, 2, 3], "xyz", body=1),
        Support([hoop.nodes // 2], "y", (0.0, 0.2, 0.0), body=1),
    ]
    return Model([Body(wire, NeoHookean(50.0, 0.2)), Body(hoop, LinearElastic(80.0, 0.35))], supports)


def spinning():
    """A spring clamped at one end in a frame that turns about a line off its axis."""
    space = Space.paper(Spring(coils=1, section_points=4).rod(), elements=4)
    body = Body(space, NeoHookean(5e3, 0.3), density=2.0)
    return Model([body], [Support.end(space, "start")], Spin((0.02, -0.04, 0.1), (1.0, 2.0, 0.0)))


def tendon_and_muscle():
    """A wire of two laws whose fibres run along it and act more and more with the load factor."""
    space = Space.paper(Spring(coils=1, section_points=4).rod(), elements=4)
    tendon = NeoHookean(90.0, 0.3)
    muscle = Muscle(30.0, 0.4, sigma_max=40.0, activation=0.8)
    supports = [Support.end(space, "start"), Support.end(space, "end", "z", (0.0, 0.0, 0.1))]
    supports.append(Support([space.nodes - 1], "xy"))
    return Model([Body(space, [tendon, muscle, muscle, tendon])], supports)


MODELS = {
    "tendon and muscle": tendon_and_muscle,
    "spinning": spinning,
    "spring": spring,
    "paper rule": lambda: spring("paper"),
    "ring": ring,
    "two bodies": two_bodies,
}
# The energy is the stored one, without that of the centrifugal force.
CONSERVATIVE = [name for name in MODELS if name != "spinning"]
# Supports alone bring the load.
HELD = [name for name in CONSERVATIVE if name != "tendon and muscle"]


@pytest.fixture(params=MODELS)
def assembler(request):
    return Assembler(MODELS[request.param](), PETSc.COMM_SELF)


def deformed(assembler, size=0.03, seed=0):
    x = assembler.vector()
    x.array[:] = size * np.random.default_rng(seed).uniform(-1, 1, x.getSize())
    return x


def direction(assembler, seed):
    return np.random.default_rng(seed).normal(size=assembler.model.unknowns)


def moved(x, step):
    result = x.duplicate()
    result.array[:] = x.array_r + step
    return result


def residual(assembler, x, factor=0.7):
    out = assembler.vector()
    assembler.residual(x, factor, out)
    return out.array_r.copy()


def tangent(assembler, x, factor=0.7):
    matrix = assembler.matrix()
    assembler.tangent(x, factor, matrix)
    return matrix


WEIGHTS = (3 / 4, -3 / 20, 1 / 60)


def difference(f, h=1e-3):
    return sum(w * (f(k * h) - f(-k * h)) for k, w in enumerate(WEIGHTS, 1)) / h


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_tangent_is_the_derivative_of_the_residual(assembler, seed):
    x, v = deformed(assembler), direction(assembler, seed)
    v /= np.abs(v).max()
    matrix = tangent(assembler, x)
    product = (matrix * moved(x, v - x.array_r)).array_r
    expected = difference(lambda t: residual(assembler, moved(x, t * v)))
    assert np.linalg.norm(product - expected) < 1e-6 * np.linalg.norm(expected)


@pytest.mark.parametrize("assembler", ["two bodies", "tendon and muscle"], indirect=True)
def test_entries_are_the_sum_of_the_element_matrices(assembler):
    """Blocks of them go where they belong at once, and there are no element matrices."""
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
        Space.paper(Spring(coils=1, section_points=5).rod(), elements=4, degree=3),
        Space.paper(Spring(coils=1, section_points=5).rod(), elements=4, quadrature="2x1x2"),
        pytest.param(
            Space(Spring(coils=1, section_points=4).rod(), elements=4, order=2, section_points=32, degree=2),
            marks=pytest.mark.slow,
        ),
        Space(Spring(coils=1).rod(), elements=4, section_degree=3, degree=2),
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
    plane = np.einsum("etj,qdi->etqdji", t.axial, t.section[:, :2])
    axis = np.einsum("etj,qi->etqji", t.slopes, t.section[:, 2])[:, :, :, None]
    slopes = np.concatenate([plane, axis], axis=3).reshape(*t.weights.shape, 3, -1)
    slopes = np.swapaxes(t.inverse, -1, -2) @ slopes
    moduli = part.laws.tangent(part.gradients(local))
    expected = np.einsum("etq,etqAi,etqaAbB,etqBk->eiakb", t.weights, slopes, moduli, slopes, optimize=True)
    found = part.matrices(local, 0.0)
    assert np.abs(found - expected.reshape(found.shape)).max() < 1e-13 * np.abs(found).max()
    some = part.matrices(local, 0.0, np.array([0, 2]))
    assert np.abs(some - found[[0, 2]]).max() < 1e-15 * np.abs(found).max()


def test_every_column_of_the_tangent_is_right(assembler):
    x = deformed(assembler)
    dense = as_array(tangent(assembler, x))
    for k in range(0, assembler.model.unknowns, 7):
        v = np.eye(1, assembler.model.unknowns, k)[0]
        expected = difference(lambda t, v=v: residual(assembler, moved(x, t * v)))
        assert np.linalg.norm(dense[:, k] - expected) < 1e-6 * np.linalg.norm(expected)


def test_tangent_is_symmetric(assembler):
    dense = as_array(tangent(assembler, deformed(assembler)))
    assert np.abs(dense - dense.T).max() < 1e-14 * np.abs(dense).max()


@pytest.mark.parametrize("assembler", CONSERVATIVE, indirect=True)
def test_residual_is_the_gradient_of_the_energy(assembler):
    x, force = deformed(assembler), residual(assembler, deformed(assembler))
    for seed in (1, 2, 3):
        v = direction(assembler, seed)
        v /= np.abs(v).max()
        slope = difference(lambda t, v=v: assembler.energy(moved(x, t * v), 0.7))
        assert slope == pytest.approx(force @ v, rel=1e-8, abs=1e-8 * np.linalg.norm(force))


@pytest.mark.parametrize("assembler", HELD, indirect=True)
def test_reactions_are_the_gradient_of_the_energy_by_the_support_displacements(assembler):
    x = deformed(assembler)
    forces = assembler.reactions(x, 0.7)
    assert forces.shape == assembler.model.held.shape
    slope = difference(lambda t: assembler.energy(x, 0.7 + t))
    assert slope == pytest.approx(forces @ assembler.model.values, rel=1e-8)


def test_load_forces_are_the_derivative_of_the_residual_by_the_load_factor(assembler):
    x, out = deformed(assembler), assembler.vector()
    assembler.load_forces(x, 0.7, 0.5, out)
    expected = 0.5 * difference(lambda t: residual(assembler, x, 0.7 + t))
    assert np.linalg.norm(out.array_r - expected) < 1e-7 * np.linalg.norm(expected)


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


def test_spinning_bar_is_stretched_by_its_own_mass(cylinder):
    """u(z) = rho w^2 (L^2 z / 2 - z^3 / 6) / E for a bar along the radius, nu = 0; its clamp carries m w^2 L / 2."""
    space = Space.paper(cylinder(4, height=4.0, radius=0.3), elements=2, degree=3)
    body = Body(space, LinearElastic(1e4, 0.0), density=5.0)
    solution = statics.solve(Model([body], [Support.end(space, "start")], Spin((0.2, 0.0, 0.0))))
    z = np.linspace(0, 1, 7)
    u, _ = space.displacement(solution.displacement.reshape(-1, 3), [[0.0, 0.0]], z)
    exact = 5.0 * 0.04 * (16 * 4 * z / 2 - (4 * z) ** 3 / 6) / 1e4
    # softening by the displacement itself is of relative order rho w^2 L^2 / E = 3e-4
    assert u[:, 0, 2] == pytest.approx(exact, rel=5e-4)
    mass = 5.0 * np.pi * 0.09 * 4.0
    assert solution.reactions[0, 2] == pytest.approx(-mass * 0.04 * 2.0, rel=3e-4)


def test_displacement_puts_unknowns_and_supports_in_their_places(assembler):
    model, x = assembler.model, deformed(assembler)
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


@pytest.mark.parametrize(
    ("supports", "message"),
    [
        ([Support([0], body=1)], "support 0: body 1 is not one of the 1 bodies"),
        ([Support([0]), Support([-1])], "support 1: node -1 is not in body 0"),
        ([Support([3, 9999])], "support 0: node 9999"),
        ([Support([0], "xw")], "support 0: got components 'xw', need some of 'xyz'"),
        ([Support([0], "")], "got components ''"),
        ([Support([0], "x"), Support([1, 0], "xy", (1.0, 0, 0))], "support 1: node 0, component x is prescribed by"),
        ([Support([0], "x", (np.nan, 0, 0))], "not finite"),
    ],
)
def test_refuses_supports_that_cannot_be(supports, message):
    with pytest.raises(InputError, match=message):
        Model(spring().bodies, supports)


def test_a_closed_rod_has_no_ends():
    with pytest.raises(InputError, match="closed rod has none"):
        Support.end(Space.paper(Ring().rod()), "start")
    with pytest.raises(InputError, match="need 'start' or 'end'"):
        Support.end(spring().bodies[0].space, "top")


def record(path):
    """Save what the ranks find together (called under mpirun)."""
    found = {}
    for name, make in MODELS.items():
        solution = statics.solve(make())
        assembler = Assembler(make())
        x, out, product = assembler.vector(), assembler.vector(), assembler.vector()
        low, high = x.getOwnershipRange()
        x.array[:] = 0.03 * np.random.default_rng(0).uniform(-1, 1, x.getSize())[low:high]
        assembler.residual(x, 0.7, out)
        matrix = assembler.matrix()
        assembler.tangent(x, 0.7, matrix)
        support = assembler.vector()
        assembler.load_forces(x, 0.7, 1.0, support)
        if assembler.model.bodies[0].density:
            assembler.mass().mult(x, product)
            found[f"{name}: mass"] = assembler.displacement(product, 0.0)
        matrix.mult(x, product)
        arrays = {
            "displacement": solution.displacement,
            "reactions": solution.reactions,
            "norms": solution.residual_norms[:2],
            "energy": assembler.energy(x, 0.7),
            "smallest": assembler.smallest_jacobian(x, 0.7),
            "forces": assembler.reactions(x, 0.7),
        }
        for key, vector in (("residual", out), ("product", product), ("support", support)):
            arrays[key] = assembler.displacement(vector, 0.0)
        found |= {f"{name}: {key}": np.asarray(value) for key, value in arrays.items()}
        assert solution.ranks == PETSc.COMM_WORLD.getSize()
    if PETSc.COMM_WORLD.getRank() == 0:
        np.savez(path, **found)


@pytest.fixture(scope="module")
def on_one_rank(tmp_path_factory):
    path = tmp_path_factory.mktemp("ranks") / "1.npz"
    record(path)
    return np.load(path)


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, *[pytest.param(one, marks=pytest.mark.slow) for one in (3, 5)]])
def test_results_do_not_depend_on_the_number_of_ranks(ranks, on_one_rank, mpirun, tmp_path):
    """Five ranks are more than the elements of the spring."""
    path = tmp_path / "ranks.npz"
    script = (
        f"import sys; sys.path[:0] = [{str(Path(__file__).parent)!r}]; import test_assembly as t; t.record(sys.argv[1])"
    )
    done = mpirun(ranks, str(path), script=script)
    assert done.returncode == 0, done.stderr
    found = np.load(path)
    assert sorted(found) == sorted(on_one_rank)
    for key, expected in on_one_rank.items():
        assert np.abs(found[key] - expected).max() < 1e-10 * max(1e-3, np.abs(expected).max()), key
