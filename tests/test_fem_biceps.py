"""The biceps in finite elements: the muscle's law, meshes, contact between surfaces, equilibrium and motion."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import as_array
from refused import refused

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

import dolfinx.fem
import ufl
from mpi4py import MPI
from scipy.integrate import trapezoid

from comparisons.fem.__main__ import BICEPS, _parser
from comparisons.fem.biceps import dynamics, statics
from comparisons.fem.biceps.branches import Branches
from comparisons.fem.biceps.run import Configuration, belly_bulge, run
from comparisons.fem.contact.surfaces import Contact
from comparisons.fem.fields import Sampler
from comparisons.fem.presets import biceps as biceps_presets
from isorod.errors import InputError, SolveError
from isorod.fenics import compat
from isorod.fenics.stored import energy_of
from isorod.geometry.axis import Axis
from isorod.geometry.center_line import straight
from isorod.geometry.rod import Rod
from isorod.geometry.section import circle
from isorod.material import NeoHookean
from isorod.material.muscle import Muscle
from isorod.output.stress import von_mises
from isorod.scenes.biceps import Biceps
from meshes import biceps, gmsh_model
from meshes.biceps import BRANCHES

KINDS = (
    {"cells": "tetrahedra", "size": 1.0, "order": 1},
    {"cells": "tetrahedra", "size": 0.7, "order": 2},
    {"cells": "bricks", "around": 8, "layers": 2, "order": 1, "cuts": 0},
    {"cells": "bricks", "around": 4, "layers": 2, "order": 2, "cuts": 1},
)
COARSE = {"cells": "bricks", "around": 4, "layers": 1, "cuts": 0}


@pytest.fixture(scope="module", params=KINDS, ids=("P1", "P2", "Q1", "Q2"))
def mesh(request):
    return biceps.build(**request.param)


def test_law_is_that_of_isorod():
    """P of the UFL energy, differentiated by UFL, against the stress at stretches on all branches of the law."""
    rng = np.random.default_rng(1)
    mesh = compat.create_mesh(
        MPI.COMM_SELF,
        np.array([[0, 1, 2, 3]]),
        np.vstack([np.zeros(3), np.eye(3)]),
        "tetrahedron",
        1,
    )
    fibre = np.array([0.36, 0.48, 0.8])
    law = Muscle(30.0, 0.49, 30.0, 35.0, 0.5, 0.7, fibre)
    u = dolfinx.fem.Function(compat.function_space(mesh, compat.element(mesh, "Lagrange", 1, 3)))
    F = ufl.variable(ufl.Identity(3) + ufl.grad(u))
    whole = replace(law, activation=1.0)
    energy = energy_of(whole, dolfinx.fem.Constant(mesh, 0.7), (ufl.as_vector(fibre.tolist()),))
    values = ufl.as_vector([energy(F), *(ufl.diff(energy(F), F)[i, j] for i in range(3) for j in range(3))])
    evaluate = compat.expression(values, np.array([[0.25, 0.25, 0.25]]), ("-O2",))
    seen = []
    for scale in (0.4, 0.7, 1.0, 1.2, 1.7):
        given = scale * np.eye(3) + 0.1 * rng.normal(size=(3, 3))
        u.interpolate(lambda x, given=given: (given - np.eye(3)) @ x)
        found = evaluate(mesh, np.array([0], dtype=np.int32)).ravel()
        assert found[0] == pytest.approx(law.energy(given), rel=1e-12)
        assert found[1:].reshape(3, 3) == pytest.approx(law.stress(given), rel=1e-11, abs=1e-11)
        seen.append(np.linalg.norm(given @ fibre))
    assert min(seen) < 0.5 and max(seen) > 1.5 and any(0.5 < one < 1.0 for one in seen)


@pytest.mark.parametrize("order, most", [(1, (0.027, 0.011)), pytest.param(2, (5e-5, 1.3e-5), marks=pytest.mark.slow)])
def test_volume_converges_to_that_of_the_rods(order, most):
    """Chords and parabolas lie inside the surface; free meshes are not refined everywhere alike."""
    exact = sum(rod.volume() for rod in biceps.rods())
    sizes = np.array([1 / 4, 1 / 8, 1 / 16])
    bricks = [biceps.build("bricks", around=n, layers=n // 2, order=order).volume() for n in (4, 8, 16)]
    lengths = np.array([0.7, 0.5, 0.35])
    free = [biceps.build(size=h, order=order).volume() for h in lengths]
    for volumes, h, allowed, finest in ((bricks, sizes, 0.15, most[0]), (free, lengths, 0.2 * order, most[1])):
        errors = 1.0 - np.array(volumes) / exact
        rates = np.diff(np.log(errors)) / np.diff(np.log(h))
        assert np.abs(rates - 2 * order).max() < allowed
        assert 0.0 < errors[-1] < finest


def test_regions_and_faces_meet_at_the_ends_of_the_muscle(mesh):
    scene = Biceps()
    low, high = scene.tendon_length, scene.tendon_length + scene.belly_length
    y, total = mesh.parameters[:, 2], 0
    slack = 1e-9 * high
    for branch in BRANCHES:
        muscle, tendons = (mesh.cells[mesh.regions[f"{branch} {part}"]] for part in ("muscle", "tendons"))
        total += len(muscle) + len(tendons)
        assert y[muscle].min() == pytest.approx(low) and y[muscle].max() == pytest.approx(high)
        assert ((y[tendons] <= low + slack).all(axis=1) | (y[tendons] >= high - slack).all(axis=1)).all()
        belly = mesh.faces[f"{branch} belly"]
        assert y[belly].min() == pytest.approx(low) and y[belly].max() == pytest.approx(high)
        assert np.abs(np.linalg.norm(mesh.parameters[belly, :2], axis=-1) - 1.0).max() < 1e-12
        assert np.ptp(y[mesh.faces[f"{branch} start"]]) == 0.0
        # The x of every node says on which side of the plane between the bellies its branch is.
        assert len(np.unique(np.sign(mesh.points[belly][:, :, 0]))) == 1
    assert total == len(mesh.cells)


def test_unstructured_counts_are_those_of_the_paper():
    found = biceps.build()
    assert len(found.cells) == pytest.approx(25315, rel=0.05)
    assert found.check() > 0.0


def test_file_has_the_regions(tmp_path):
    import gmsh

    mesh = biceps.build(size=1.5)
    gmsh_model.write(mesh, tmp_path / "biceps.msh")
    with gmsh_model.gmsh_session():
        gmsh.open(str(tmp_path / "biceps.msh"))
        names = {gmsh.model.getPhysicalName(3, tag): tag for _, tag in gmsh.model.getPhysicalGroups(3)}
        counts = {
            name: sum(
                len(one)
                for entity in gmsh.model.getEntitiesForPhysicalGroup(3, tag)
                for one in gmsh.model.mesh.getElements(3, entity)[1]
            )
            for name, tag in names.items()
        }
    assert counts == {name: len(cells) for name, cells in mesh.regions.items()}


def test_bad_meshes():
    with pytest.raises(InputError, match="cells: got 'wedges', need one of tetrahedra, bricks"):
        biceps.build("wedges")
    with pytest.raises(InputError, match="size of the cells: got 0, need a positive length"):
        biceps.build(size=0.0)
    with pytest.raises(InputError, match="order of tetrahedra: got 3, need 1 or 2"):
        biceps.build(order=3)
    with pytest.raises(InputError, match="cuts: got -1, need 0 to 8"):
        biceps.build("bricks", cuts=-1)
    with pytest.raises(InputError, match="got 1 axis elements, need at least 3"):
        bar = straight(1.0, degree=1).sweep(circle(4))
        biceps.build(branches=(bar, bar))


def squeezed(mesh, depth=0.2, noise=1e-3):
    """Return positions with the first branch pushed towards the second, all a little out of place."""
    nodes = mesh.points + noise * np.random.default_rng(2).normal(size=mesh.points.shape)
    nodes[np.unique(mesh.cells[mesh.regions["first muscle"]]), 0] += 0.1 + depth
    return nodes


@pytest.mark.parametrize("parts", [0, 1, 2])
def test_contact_forces_and_stiffness_are_derivatives_of_the_energy(mesh, parts):
    if parts == 0 and mesh.order > 1:
        with pytest.raises(InputError, match="contact at nodes: got facets of order 2, need order 1"):
            Contact(mesh, "first belly", "second belly", 1.0, 0)
        return
    contact = Contact(mesh, "first belly", "second belly", 50.0, parts)
    nodes, way = squeezed(mesh), np.random.default_rng(3).normal(size=mesh.points.shape)
    force = np.zeros_like(nodes)
    pressing = contact.add_forces(nodes, force)
    assert pressing.energy > 0.0 and pressing.gap < 0.0
    # No net force, no net moment, and the resultant is what acts on the first branch.
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * pressing.normal_force
    assert np.abs(np.cross(nodes, force).sum(axis=0)).max() < 1e-11 * pressing.normal_force
    first = np.unique(mesh.cells[mesh.regions["first muscle"]])
    assert -force[first].sum(axis=0) == pytest.approx(pressing.force, abs=1e-12 * pressing.normal_force)
    assert pressing.force[0] < 0.0

    step = 1e-6
    energies, forces = [], []
    for sign in (1.0, -1.0):
        out = np.zeros_like(nodes)
        energies.append(contact.add_forces(nodes + sign * step * way, out).energy)
        forces.append(out)
    assert (energies[0] - energies[1]) / (2.0 * step) == pytest.approx(np.sum(force * way), rel=1e-7)
    stiffness = contact.stiffness(nodes).tocsr()
    change = ((forces[0] - forces[1]) / (2.0 * step)).ravel()
    assert stiffness @ way.ravel() == pytest.approx(change, abs=1e-6 * np.abs(change).max())
    assert np.abs((stiffness - stiffness.T).data).max(initial=0.0) < 1e-12 * np.abs(stiffness.data).max()


def test_contact_of_rigid_overlap_is_exact():
    """A cylinder pushed ``d`` into its mirror image, all by nodes.

    Area and force tend to those of the lens between circles.
    """
    breaks = [0.0, 0.0, 1.0, 2.0, 3.0, 3.0]
    axis = Axis(1, breaks, [1.0] * 4)
    turn = np.broadcast_to(np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]), (4, 3, 3))
    centres = np.stack([np.zeros(4), np.arange(4.0), np.zeros(4)], axis=1)
    rods = [Rod.sweep(circle(8), axis, centres + np.array([side, 0.0, 0.0]), turn) for side in (-0.95, 0.95)]
    mesh = biceps.build("bricks", around=24, layers=1, order=2, cuts=0, branches=rods)
    contact = Contact(mesh, "first belly", "second belly", 10.0, 4)
    pressing = contact.add_forces(mesh.points, np.zeros_like(mesh.points))
    # Of a point at the angle t the distance to the other circle's centre is r(t); depth 1 - r; length 1 of the middle
    # element.
    t = np.linspace(-np.arccos(0.95), np.arccos(0.95), 4001)
    depth = 1.0 - np.sqrt(1.0 + 1.9**2 - 2.0 * 1.9 * np.cos(t))
    assert contact.area(0) == pytest.approx(2.0 * np.pi, rel=1e-5)
    assert pressing.energy == pytest.approx(0.5 * 10.0 * trapezoid(depth**2, t), rel=1e-2)
    assert pressing.normal_force == pytest.approx(10.0 * trapezoid(depth, t), rel=1e-2)
    assert pressing.area == pytest.approx(2.0 * np.arccos(0.95), rel=5e-2)
    assert pressing.gap == pytest.approx(-0.1, rel=1e-2)


def test_search_is_repeated_when_surfaces_have_moved():
    mesh = biceps.build(size=0.8)
    moved, fresh = (Contact(mesh, "first belly", "second belly", 50.0, 1, reach=0.05) for _ in range(2))
    for depth in np.linspace(-0.05, 0.12, 8):
        nodes = squeezed(mesh, depth, 0.0)
        found = moved.add_forces(nodes, np.zeros_like(nodes))
    again = fresh.add_forces(nodes, np.zeros_like(nodes))
    assert found.energy == pytest.approx(again.energy, rel=1e-12)
    assert found.energy > 0.0


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    file = tmp_path_factory.mktemp("still") / "fields.npz"
    return run(Configuration(**COARSE), file=file) | {"file": file}


def test_equilibrium(still):
    """Forces balance on each branch and mirror each other; Newton converges quadratically."""
    x, y = np.array(still["end_force_x"]), np.array(still["end_force_y"])
    assert y[0] == pytest.approx(-y[1], rel=1e-8) and y[2] == pytest.approx(-y[3], rel=1e-8)
    assert x[:2] == pytest.approx(-x[2:], rel=1e-6)
    assert x[:2].sum() + still["contact_resultant"][0] == pytest.approx(0.0, abs=1e-8 * abs(y[0]))
    assert still["contact_force"] > 1.0 and 0.0 < still["penetration"] < 0.1 and still["belly_bulge"] > 0.1
    assert still["residual_norms"][-1] < 1e-9 * still["residual_norms"][0]
    assert belly_bulge(Configuration(**COARSE).mesh(), np.load(still["file"])["positions"]) == still["belly_bulge"]


def branches_of(degree: int, **options) -> tuple[Branches, Contact, Biceps]:
    scene = Biceps(**options)
    mesh = biceps.build("bricks", around=4, layers=1, cuts=0, order=degree)
    contact = Contact(mesh, "first belly", "second belly", scene.penalty)
    return Branches(scene, mesh, 2 * degree), contact, scene


def test_stress_of_tendon_and_muscle_on_small_cells(tmp_path):
    """A homogeneous deformation has the von Mises stress of isorod's laws, each on its cells."""
    scene = Biceps(activation=0.7)
    mesh = biceps.build(**COARSE, order=2)
    branches = Branches(scene, mesh, 4)
    F = np.eye(3) + 0.1 * np.random.default_rng(2).normal(size=(3, 3))
    branches.state.x.array[:] = branches.to_dofs(mesh.points @ (F - np.eye(3)).T)
    branches.activation.value = scene.activation
    sampler = Sampler(branches.state, branches.laws(), 2)
    displacement, found = sampler.state()
    assert displacement == pytest.approx(sampler.points @ (F - np.eye(3)).T, abs=1e-10)
    tendon = NeoHookean(scene.tendon_factor * scene.E, scene.nu)
    muscle = Muscle(scene.E, scene.nu, scene.sigma_max, scene.m1, scene.m2, scene.activation, (0.0, 1.0, 0.0))
    expected = [float(von_mises(law.stress(F) @ F.T / np.linalg.det(F))) for law in (tendon, muscle)]
    inside = (sampler.points[sampler.cells].mean(axis=1)[:, 1] - scene.tendon_length) * (
        scene.tendon_length + scene.belly_length - sampler.points[sampler.cells].mean(axis=1)[:, 1]
    ) > 0.0
    assert 0 < inside.sum() < inside.size
    assert found[sampler.cells[inside]] == pytest.approx(expected[1], rel=1e-9)
    assert found[sampler.cells[~inside]] == pytest.approx(expected[0], rel=1e-9)


def test_file_has_the_fields_of_every_sample(tmp_path):
    file = tmp_path / "fields.npz"
    scene = Biceps(end_time=2e-4, outputs=2)
    run(Configuration("dynamics", **COARSE, scene=scene), file=file)
    with np.load(file) as arrays:
        assert arrays["times"] == pytest.approx([1e-4, 2e-4], rel=0.2)
        assert arrays["displacement"].shape == (2, *arrays["small_points"].shape)
        assert arrays["von_mises"].shape == (2, len(arrays["small_points"]))
        assert (arrays["von_mises"][1].max() > arrays["von_mises"][0].max()) and arrays["von_mises"].min() >= 0.0


def test_fibres_along_the_branch():
    branches, contact, _ = branches_of(2, fibre="tangent", penalty=100.0)
    found = statics.solve(branches, contact, 0.1)
    straight, other, _ = branches_of(2, penalty=100.0)
    reference = statics.solve(straight, other, 0.1)
    # The branches lean by some degrees: nearly, but not quite the same.
    assert 1e-4 < np.abs(found.reactions / reference.reactions - 1.0)[:, 1].max() < 0.1


def test_nodes_and_masses(mesh):
    branches = Branches(Biceps(), mesh, 2)
    where = branches.to_nodes(branches.space.tabulate_dof_coordinates().ravel())
    assert where == pytest.approx(mesh.points, abs=1e-12)
    assert branches.to_nodes(branches.to_dofs(mesh.points)) == pytest.approx(mesh.points, abs=0.0)
    mass = dynamics.lumped_mass(branches, 2.0)
    assert mass.min() > 0.0
    assert mass.sum() == pytest.approx(2.0 * mesh.volume(), rel=1e-12)


def test_motion_keeps_its_energy():
    """At constant activation and without damping, an error of second order in the step.

    With it, what is dissipated is counted.
    """
    errors = []
    for step in (8e-6, 4e-6):
        branches, contact, scene = branches_of(1)
        motion = dynamics.solve(branches, contact, scene.density, [8e-4], lambda time: 1.0, 0.0, step)
        last = motion.samples[-1]
        errors.append(abs(last.kinetic + last.stored + last.contact.energy) / last.kinetic)
        assert motion.steps == round(8e-4 / step) and step < motion.critical_step
    assert errors[0] < 1e-2 and errors[1] < 0.3 * errors[0]
    branches, contact, scene = branches_of(1)
    damped = dynamics.solve(branches, contact, scene.density, [8e-4], lambda time: 1.0, 2000.0, 4e-6).samples[-1]
    balance = damped.kinetic + damped.stored + damped.contact.energy + damped.dissipated
    assert damped.dissipated > 0.2 * damped.kinetic
    assert abs(balance) < 5e-3 * damped.kinetic


def test_motion_comes_to_rest_at_the_equilibrium():
    branches, contact, scene = branches_of(1, nu=0.3)
    motion = dynamics.solve(branches, contact, scene.density, [0.05], lambda time: min(1.0, time / 5e-3), 800.0)
    last = motion.samples[-1]
    other, again, _ = branches_of(1, nu=0.3)
    rest = statics.solve(other, again)
    assert last.reactions[:, 1] == pytest.approx(rest.reactions[:, 1], rel=1e-3)
    assert belly_bulge(branches.source, last.positions) == pytest.approx(
        belly_bulge(other.source, rest.positions), rel=1e-2
    )


def test_critical_step_is_that_of_the_dense_pencil():
    branches, contact, scene = branches_of(1)
    mass = dynamics.lumped_mass(branches, scene.density)
    free = np.ones((mass.size, 3))
    for end in branches.ends():
        free.ravel()[end.dofs] = 0.0
    found, _ = dynamics.critical_step(branches, contact, mass, free, np.ones(free.size))
    matrix = compat.create_matrix(branches.tangent, None)
    compat.assemble_matrix(matrix, branches.tangent, [])
    scale = (free / np.sqrt(mass)[:, None]).ravel()
    dense = scale[:, None] * as_array(matrix) * scale
    assert found == pytest.approx(2.0 / np.sqrt(np.linalg.eigvalsh(dense)[-1]), rel=2e-3)
    with pytest.raises(SolveError, match="not finite at"):
        dynamics.solve(branches, contact, scene.density, [0.01], lambda time: 1.0, 0.0, 3.0 * found)


test_bad_configurations = refused(
    ({"analysis": "modal"}, "analysis: got 'modal', need one of statics, dynamics"),
    ({"degree": 3}, "degree: got 3, need 1 or 2"),
    ({"scene": Biceps(activation=1.5)}, "activation: got 1.5, need 0"),
    ({"scene": Biceps(fibre="x")}, "fibre: got 'x', need 'y' or 'tangent'"),
    ({"scene": Biceps(damping=-1.0)}, "damping: got -1, need a finite number, not negative"),
    ({"analysis": "dynamics", "scene": Biceps(outputs=0)}, "outputs: got 0 up to"),
    ({"parts": -1}, "parts: got -1, need 0 to 8"),
    ({"time_step": 0.0}, "time step: got 0, need a positive time"),
    by=lambda given: Configuration(**given),
)


def test_presets_are_arguments_that_parse():
    for text in (*biceps_presets.PRESETS.values(), *biceps_presets.CONVERGED.arguments):
        given = vars(_parser("biceps").parse_args(["biceps", *text.split()]))
        for name in ("scene", "repeat", "preset", "fields", "flags"):
            given.pop(name)
        scene = Biceps(**{name: given.pop(name) for name in BICEPS})
        assert scene == Biceps()
        Configuration(**given, scene=scene)


@pytest.mark.parametrize("option", ["degree", "quadrature", "repeat", "around", "layers", "rings", "cuts", "parts"])
def test_counts_on_the_command_line_are_whole(option):
    assert vars(_parser("biceps").parse_args(["biceps", f"--{option}", "3"]))[option] == 3
    for text in ("2.5", "x", *["0"] * (option in ("degree", "quadrature", "repeat"))):
        with pytest.raises(InputError, match=f"argument --{option}"):
            _parser("biceps").parse_args(["biceps", f"--{option}", text])


@pytest.mark.slow
def test_command_line(fem):
    options = "--analysis dynamics --degree 1 --size 1.2 --end-time 4e-4 --outputs 2 --quadrature 3".split()
    record = json.loads(fem.prints("biceps", *options))
    assert len(record["end_force"]) == 4 and len(record["history"]["time"]) == 2
    assert record["options"]["quadrature"] == 3 and record["seconds"]["step"] > 0.0
    assert 0 < record["steps"] and record["time_step"] < record["critical_step"]
    assert fem.refuses("biceps", "--penalty", 0) == "penalty: got 0, need a positive force per volume"
