"""Any rods by finite elements: bars with exact answers, the other paths of the same elements, and isorod itself."""

import json

import numpy as np
import pytest
from conftest import straight

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from dataclasses import replace

import dolfinx.fem

from comparisons.catalogue import FOLDER
from comparisons.fem import modal
from comparisons.fem import statics as elements
from comparisons.fem.domain import Domain
from comparisons.fem.rods import solve
from comparisons.fem.rods.elements import Elements
from comparisons.fem.rods.laws import Laws
from comparisons.fem.rods.places import on_rod
from comparisons.fem.rods.run import Configuration, mesh_of, run
from comparisons.fem.statics import Element, Held
from isorod import files, statics
from isorod import modal as rods_modal
from isorod.errors import InputError, SolveError
from isorod.fenics import compat
from isorod.fenics.flags import FAST
from isorod.fenics.stored import energy_of
from isorod.geometry.coils import arc
from isorod.geometry.section import circle
from isorod.material import LinearElastic, NeoHookean
from isorod.material.muscle import Muscle
from isorod.material.st_venant_kirchhoff import StVenantKirchhoff
from isorod.model import Body, BodyForce, Model, Pressure, SectionLoad, Spin, Support
from isorod.space import Space
from meshes import rods
from meshes.mesh import gradients
from meshes.within import Layers, lagrange

HEIGHT = 4.0


def clamped(rod=None, law=None, loads=(), ends=("start",), space=None, **body):
    """Return a bar along z that is clamped at some ends, and loaded."""
    space = space or Space(rod or straight(8, height=HEIGHT), elements=2, degree=2, section_degree=2)
    body = Body(space, law or LinearElastic(200.0, 0.0), **body)
    return Model([body], [Support.end(space, end) for end in ends], loads=loads)


def pulled(model, way):
    """Return the model with its end displaced as well."""
    held = Support.end(model.bodies[0].space, "end", displacement=way)
    return replace(model, supports=[*model.supports, held])


def found(model, analysis="statics", level=1, **more):
    return solve(model, mesh_of(model, level), analysis, **more)


def plain(mesh):
    """Return a mesh of one rod for what knows of one body only."""
    return replace(mesh, faces={name.removeprefix("rod 0 "): face for name, face in mesh.faces.items()})


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_bar_in_tension_is_exact(degree):
    model = pulled(clamped(), (0.0, 0.0, 0.1))
    mesh = mesh_of(model, 1, degree)
    solution = solve(model, mesh, "statics")
    area = mesh.volume() / HEIGHT
    assert solution.reactions[:, 2] == pytest.approx([-200.0 * area * 0.1 / HEIGHT, 200.0 * area * 0.1 / HEIGHT])
    assert solution.at(0, [0.0, 0.3, 1.0], [0.6, -0.5])[:, 2] == pytest.approx([0.0, 0.03, 0.1], abs=1e-12)
    assert solution.fields()["von_mises"] == pytest.approx(200.0 * 0.025 * np.ones(8 * solution.cells), rel=0.05)


def test_stresses_beside_a_held_end_are_those_of_bending_however_long_the_wire():
    length, force, nu = 160.0, 1e-3, 0.3
    space = Space(straight(8, height=length), elements=4, degree=3, section_degree=3)
    model = clamped(space=space, law=LinearElastic(200.0, nu), loads=[SectionLoad((force, 0.0, 0.0))])
    cubic = solve(model, mesh_of(model, 1, 3), "statics")
    # Two diameters from the end and farther, on both sides of cells' ends.
    places = np.linspace(4.0, 24.0, 21)
    bending = -force * (length - places) / (0.25 * np.pi)
    found = cubic.stress(0, places / length, (1.0, 0.0))[:, 2, 2]
    assert found == pytest.approx(bending, rel=2e-2)


@pytest.mark.parametrize("u", [1.0, 0.3])
def test_a_force_on_a_section_stretches_what_is_before_it(u):
    model = clamped(loads=[SectionLoad((0.0, 0.0, 2.0), u)])
    mesh = mesh_of(model)
    solution = solve(model, mesh, "statics")
    area = mesh.volume() / HEIGHT
    mean = solution.displacement[np.isclose(mesh.parameters[:, 2], 1.0), 2].mean()
    assert mean == pytest.approx(2.0 * u * HEIGHT / (200.0 * area), rel=1e-9 if u == 1.0 else 1e-3)
    assert solution.reactions[0] == pytest.approx([0.0, 0.0, -2.0], abs=1e-10)


def test_two_materials_behind_each_other_share_the_lengthening():
    rod = straight(8, breaks=(0.0, 0.25, 1.0), height=HEIGHT)
    space = Space(rod, elements=2, degree=2, continuity=0, section_degree=2)
    model = pulled(clamped(space=space, law=[LinearElastic(50.0, 0.0), LinearElastic(200.0, 0.0)]), (0.0, 0.0, 0.1))
    mesh = mesh_of(model)
    solution = solve(model, mesh, "statics")
    compliance = HEIGHT * HEIGHT / mesh.volume() * (0.25 / 50.0 + 0.75 / 200.0)
    assert solution.reactions[1, 2] == pytest.approx(0.1 / compliance, rel=1e-9)


def test_laws_that_change_within_an_element_of_the_rod_get_a_plane_of_the_mesh():
    space = Space(straight(8, height=HEIGHT), elements=3, degree=2, continuity=0, section_degree=2)
    law = [LinearElastic(50.0, 0.0), LinearElastic(200.0, 0.0), LinearElastic(200.0, 0.0)]
    model = pulled(clamped(space=space, law=law), (0.0, 0.0, 0.1))
    mesh = mesh_of(model)
    solution = solve(model, mesh, "statics")
    compliance = HEIGHT * HEIGHT / mesh.volume() * (1.0 / 50.0 + 2.0 / 200.0) / 3.0
    assert solution.reactions[1, 2] == pytest.approx(0.1 / compliance, rel=1e-9)


def test_core_and_sheath_carry_side_by_side():
    rod = straight(8, height=HEIGHT).with_rings((0.0, 0.6, 1.0))
    space = Space(rod, elements=2, degree=2, section_degree=3)
    model = pulled(clamped(space=space, law=[LinearElastic(200.0, 0.0), LinearElastic(10.0, 0.0)]), (0.0, 0.0, 0.1))
    exact = np.pi * (0.36 * 200.0 + 0.64 * 10.0) * 0.1 / HEIGHT
    one, two = (found(model, level=level).reactions[1, 2] for level in (1, 2))
    assert one == pytest.approx(exact, rel=0.02) and two == pytest.approx(exact, rel=2e-3)


def test_a_tube_under_pressure_is_lames():
    """Half way along, far from the clamped face; the end is free."""
    E, nu, inner, pressure = 200.0, 0.3, 0.6, 3.0
    rod = straight(8, height=8.0).with_rings((inner, 1.0))
    space = Space(rod, elements=8, degree=3, section_degree=4)
    law = LinearElastic(E, nu)
    model = clamped(space=space, law=law, loads=[Pressure(pressure, "inner"), Pressure(1.0, "outer")])
    solution = found(model)
    a = (pressure * inner**2 - 1.0) / (1.0 - inner**2)
    b = (pressure - 1.0) * inner**2 / (1.0 - inner**2)
    for radius in (inner, 0.8, 1.0):
        exact = radius / E * ((1.0 - nu) * a + (1.0 + nu) * b / radius**2)
        moved = solution.at(0, 0.6, [[radius, 0.0], [0.0, radius]])
        assert [moved[0, 0], moved[1, 1]] == pytest.approx([exact, exact], rel=0.01)
    # The centre of a hollow rod is the mean of its hole.
    assert solution.at(0, 0.6)[:2] == pytest.approx([0.0, 0.0], abs=1e-6)


LOADED = {
    "weight": {"loads": [BodyForce((0.05, 0.0, 0.2))]},
    "pressure that follows": {"loads": [Pressure(5.0, follows=True)], "ends": ("start", "end")},
    "pressure that stays": {"loads": [Pressure(5.0)], "ends": ("start", "end")},
}


@pytest.mark.parametrize("case", LOADED)
def test_loads_are_isorods(case):
    space = Space(straight(8, height=HEIGHT), elements=4, degree=3, section_degree=4)
    model = clamped(space=space, law=NeoHookean(200.0, 0.3), **LOADED[case])
    one, other = found(model, level=2), statics.solve(model)
    size = np.abs(other.at(0, [0.5, 1.0], [[0.0, 0.0], [0.0, 1.0]])).max()
    for where in ((0.5, (0.0, 1.0)), ("end", None)):
        assert one.at(0, *where) == pytest.approx(other.at(0, *where), abs=0.02 * size)
    forces = np.abs(other.reactions).max()
    assert one.reactions == pytest.approx(other.reactions, abs=0.02 * forces)
    assert one.moments == pytest.approx(other.moments, abs=0.02 * forces)


def test_a_spin_pulls_outward():
    space = Space(straight(8, height=HEIGHT), elements=4, degree=3, section_degree=3)
    model = replace(clamped(space=space, law=LinearElastic(200.0, 0.3), density=1.0), spin=Spin((0.0, 1.0, 0.0)))
    one, other = found(model, level=2), statics.solve(model)
    assert one.at(0, "end")[2] == pytest.approx(other.at(0, "end")[2], rel=5e-3)
    assert one.reactions == pytest.approx(other.reactions, abs=5e-3 * np.abs(other.reactions).max())


@pytest.mark.parametrize("components", ["xyz", "xz"])
def test_an_end_that_turns_has_the_same_forces_and_moments(components):
    space = Space(straight(8, height=HEIGHT), elements=4, degree=3, section_degree=4)
    model = clamped(space=space, law=NeoHookean(200.0, 0.3))
    turned = Support.end(space, "end", components, (0.0, 0.1, -0.05), turn=(0.1, 0.05, 0.3))
    model = replace(model, supports=[*model.supports, turned])
    one, other = found(model, level=2), statics.solve(model)
    for name in ("reactions", "moments"):
        exact = getattr(other, name)
        assert getattr(one, name) == pytest.approx(exact, abs=0.02 * np.abs(exact).max())
    if components == "xyz":
        assert one.at(0, "end", (0.3, 0.4)) == pytest.approx(other.at(0, "end", (0.3, 0.4)), abs=1e-12)


LAWS = {
    "linear": LinearElastic(200.0, 0.3),
    "neo-Hookean": NeoHookean(200.0, 0.3),
    "St. Venant": StVenantKirchhoff(200.0, 0.3),
    "muscle": Muscle(30.0, 0.4, 20.0, 5.0, 2.0, 0.7, "tangent"),
    "muscle along y": Muscle(30.0, 0.4, 20.0, 0.0, 0.0, 0.7, (0.0, 1.0, 0.0)),
}


@pytest.mark.parametrize("name", LAWS)
def test_energies_are_those_of_isorods_laws(name):
    rod = arc(3.0, 60.0).sweep(circle(8, 0.5))
    body = Body(Space(rod, elements=2, degree=2, section_degree=2), LAWS[name])
    model = Model([body])
    mesh = mesh_of(model)
    held = Elements(mesh, [rod])
    laws = Laws(held, model, 4)
    rng = np.random.default_rng(2)
    moved = mesh.points @ (0.2 * rng.normal(size=(3, 3))) + 0.01 * rng.normal(size=mesh.points.shape)
    held.state.x.array[:] = held.to_dofs(moved)
    laws.activation.value = 0.6
    stored = dolfinx.fem.assemble_scalar(compat.form(laws.energy(), FAST))

    x, w = np.polynomial.legendre.leggauss(3)
    where = np.stack([one.ravel() for one in np.meshgrid(*[0.5 * (x + 1.0)] * 3, indexing="ij")], axis=1)
    weights = 0.125 * np.einsum("i,j,k->ijk", w, w, w).ravel()
    slopes = gradients("hexahedron", 2, mesh.reference, where)
    jacobian = np.einsum("qnb,cna->cqab", slopes, mesh.points[mesh.cells])
    F = np.eye(3) + np.einsum("qnb,cna->cqab", slopes, moved[mesh.cells]) @ np.linalg.inv(jacobian)
    parameters = np.einsum("qn,cnp->cqp", lagrange(2, mesh.reference, where), held.parameters)
    law = LAWS[name].at(0.6).placed(on_rod(rod, parameters))
    exact = np.einsum("cq,cq,q->", law.energy(F), np.linalg.det(jacobian), weights)
    # Directions of fibres are polynomials between the nodes.
    assert stored == pytest.approx(exact, rel=1e-4 if name == "muscle" else 1e-12)


def test_the_spring_is_that_of_the_other_path_on_the_same_mesh():
    scene = files.find("spring")
    model = scene.model()
    mesh = mesh_of(model)
    one = solve(model, mesh, "statics")
    held = [Held("start"), Held("end", (0.0, 0.0, scene.travel))]
    other = elements.solve(Domain.distribute(plain(mesh)), energy_of(NeoHookean(scene.E, scene.nu)), held)
    assert one.reactions == pytest.approx(other.reactions, abs=1e-6)
    assert scene.measure(one)["force"] == pytest.approx(other.reactions[1, 2], rel=1e-6)


def test_modes_are_those_of_the_other_path_on_the_same_mesh():
    scene = files.find("blade")
    model = scene.model()
    mesh = mesh_of(model)
    one = solve(model, mesh, "modal", modes=6)
    solid = modal.Solid(scene.E, scene.nu, scene.density)
    other = modal.solve(Domain.distribute(plain(mesh)), solid, ["start"], 6, Element(2))
    assert one.frequencies == pytest.approx(other.frequencies, rel=1e-8)
    assert scene.measure(one)["frequencies"] is one.frequencies
    fields = one.fields()
    assert fields["modes"].shape == (6, len(mesh.points), 3)
    # x^T M x = 1, as far as nodes' shares of the volume make a mass.
    mass = scene.density * np.einsum("n,kna,kna->k", fields["weights"], fields["modes"], fields["modes"])
    assert mass == pytest.approx(np.ones(6), rel=0.3)


@pytest.mark.parametrize("components, rigid", [("xyz", 0), ("z", 3), ("", 6)])
def test_rigid_modes_are_those_the_supports_leave(components, rigid):
    space = Space(straight(8, height=HEIGHT), elements=4, degree=3, section_degree=4)
    supports = [Support.end(space, "start", components)] if components else []
    model = Model([Body(space, LinearElastic(200.0, 0.3), 2.0)], supports)
    one, other = found(model, "modal", modes=3), rods_modal.solve(model, 3)
    assert one.rigid == other.rigid == rigid
    assert one.frequencies[rigid:] == pytest.approx(other.frequencies[rigid:], rel=0.02)


def test_the_command_answers_what_the_file_asks_for(tmp_path):
    file = tmp_path / "fields.npz"
    record = run(Configuration("spring"), fields=file)
    scene = files.find("spring")
    assert record["force"] == pytest.approx(scene.measure(statics.solve(scene.model()))["force"], rel=0.01)
    arrays = np.load(file)
    assert arrays["displacement"].shape == arrays["points"].shape == arrays["parameters"].shape
    assert len(arrays["von_mises"]) == len(arrays["stress_parameters"]) == 8 * record["cells"]
    json.dumps(record["seconds"])


def test_a_file_asks_both_programs_by_the_same_words(tmp_path):
    file = tmp_path / "tube.toml"
    file.write_text(
        """
        [rod.tube]
        curve = {straight = 20.0}
        section = {circle = 2.0}
        rings = [0.5, 1.0]
        law = {LinearElastic = {E = 200.0, nu = 0.3}}
        [support.wall]
        end = "start"
        [load.pull]
        end = "end"
        force = [0.1, 0.0, 0.0]
        [analysis.statics]
        [measure.deflection]
        displacement = "tube"
        component = "x"
        [measure.outside]
        displacement = "tube"
        u = 0.5
        xi = [0.0, 1.0]
        [measure.wall]
        moment = "wall"
        component = "y"
        """
    )
    scene = files.find(str(file))
    own = scene.measure(statics.solve(scene.model()))
    record = run(Configuration(str(file)))
    assert record["deflection"] == pytest.approx(own["deflection"], rel=0.01)
    assert record["outside"] == pytest.approx(own["outside"], abs=0.01 * abs(own["deflection"]))
    assert record["wall"] == pytest.approx(own["wall"], rel=1e-3) == pytest.approx(-2.0, rel=1e-3)


@pytest.mark.parametrize(
    "name, message",
    [("flower", "analysis geometry: finite elements have statics, modal and dynamics"), ("no", "'no'")],
)
def test_what_is_no_analysis_here_is_refused(name, message):
    with pytest.raises(InputError, match=message):
        run(Configuration(name))


def test_points_of_a_closed_rod_are_found_beyond_its_joint_too():
    rod = files.find("ring").rod()
    mesh = rods.build([rod], 1, 2)
    held = Elements(mesh, [rod])
    low, high = rod.axis.breaks[[0, -1]]
    places = Layers(rod, 2, mesh.reference, held.parameters)
    rng = np.random.default_rng(1)
    angle, u = 2.0 * np.pi * rng.random(60), np.append(rng.uniform(low, high, 58), [low, high])
    points = np.stack([0.98 * np.cos(angle), 0.98 * np.sin(angle), u], axis=1)
    cell, where = places.find(points)
    values = lagrange(2, mesh.reference, where)
    moved = np.einsum("mn,mna->ma", values, mesh.points[mesh.cells[cell]])
    # A brick is a polynomial between nodes on the curve.
    assert moved == pytest.approx(rod.points(points[:, :2], points[:, 2]), abs=0.05)
    assert np.einsum("mn,mna->ma", values, held.parameters[cell])[:, :2] == pytest.approx(points[:, :2])
    middles = held.middles(0)[1]
    assert middles.min() > low and middles.max() < high
    with pytest.raises(InputError, match="not in the unit disk"):
        places.find(np.array([[1.3, 0.0, low]]))


def test_stress_is_isorods_inside_the_rod():
    space = Space(straight(8, height=HEIGHT), elements=4, degree=3, section_degree=4)
    model = clamped(space=space, law=NeoHookean(200.0, 0.3), loads=[SectionLoad((0.5, 0.0, 2.0))])
    fields, other = found(model, level=2).fields(), statics.solve(model)
    inside = np.flatnonzero(np.abs(fields["stress_parameters"][:, 2] - 0.5) < 0.25)[::41]
    exact = [other.stress(0, p[2], p[:2], "von Mises") for p in fields["stress_parameters"][inside]]
    assert fields["von_mises"][inside] == pytest.approx(np.array(exact), abs=0.02 * np.max(exact))
    assert fields["stress_points"][inside] == pytest.approx(
        np.array([other.position(0, p[2], p[:2], 0.0) for p in fields["stress_parameters"][inside]]), abs=0.02
    )


def test_a_tied_face_is_refused():
    space = Space(straight(8, height=HEIGHT), elements=2, degree=2, section_degree=2)
    model = replace(clamped(space=space), supports=[Support.end(space, "start", "z", tied="xy")])
    with pytest.raises(InputError, match="support 0: a tied face is not on the finite element side"):
        found(model)


def test_a_patch_of_the_surface_moves_as_it_is_told():
    """The nodes where nothing else acts, up to planes of the mesh at both ends of the patch."""
    space = Space(straight(8, height=HEIGHT), elements=8, degree=2, order=2)
    way = np.array([0.0, -0.05, 0.02])
    patch = Support.patch(space, (30.0, 150.0), (2.0, 3.0), displacement=tuple(way))
    model = Model([Body(space, LinearElastic(200.0, 0.3))], [Support.end(space, "start"), patch])
    mesh = mesh_of(model)
    one = solve(model, mesh, "statics")
    (held,) = np.nonzero(np.abs(one.displacement - way).max(axis=1) < 1e-12)
    xi, u = mesh.parameters[held, :2], mesh.parameters[held, 2]
    assert np.hypot(*xi.T) == pytest.approx(1.0) and (xi[:, 1] >= 0.5 - 1e-9).all()
    assert [u.min(), u.max()] == pytest.approx([0.5, 0.75]) and one.reactions.sum(axis=0) == pytest.approx(np.zeros(3))


def test_what_nothing_holds_is_refused():
    space = Space(straight(8, height=HEIGHT), elements=2, degree=2, section_degree=2)
    with pytest.raises(SolveError, match="free to"):
        found(Model([Body(space, LinearElastic(200.0, 0.3))], [Support.end(space, "start", "z")]))


def test_points_on_the_rim_of_a_flat_strip_are_found():
    scene = files.find(str(FOLDER / "clock_spring.toml"))
    model = scene.model()
    mesh, rod = mesh_of(model), model.bodies[0].space.rod
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    u = np.full(angle.size, rod.axis.breaks[:2].mean())
    points = np.stack([np.cos(angle), np.sin(angle), u], axis=1)
    cell, where = Layers(rod, 2, mesh.reference, mesh.parameters[mesh.cells]).find(points)
    found = np.einsum("mn,mna->ma", lagrange(2, mesh.reference, where), mesh.points[mesh.cells[cell]])
    # The strip is 0.4 by 3, and the mesh of level 1 cuts its corners.
    assert found == pytest.approx(rod.grid(points[:, :2], u[:1])[0][0], abs=0.03)


def test_layers_of_thin_wires_that_bend_are_told():
    straight_one = Space(straight(8, height=HEIGHT), elements=4, degree=2).rod
    assert rods.locking(straight_one) == pytest.approx(0.0)
    # Four layers of a quarter of a circle each turn by 45 degrees: L^2 / (R t) is R / t times that squared.
    hook = files.find(str(FOLDER / "s_hook.toml")).model().bodies[0].space.rod
    assert rods.locking(hook) <= 1.1 * (10.0 / 5.0) * (np.pi / 4.0) ** 2
    assert rods.locking(files.find(str(FOLDER / "clock_spring.toml")).model().bodies[0].space.rod) > 5.0
