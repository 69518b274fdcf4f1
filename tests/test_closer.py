"""Spaces finer where something small presses: graded sections and axes, contact on them, and what the command makes."""

import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import straight
from disks import disk_points
from touching import crossing

from comparisons.contact import hertz
from isorod import InputError, LinearElastic, Rod, SolveError, Space, statics
from isorod.command import solving
from isorod.contact.operator import ContactOperator
from isorod.contact.patches import ENOUGH, patches
from isorod.files.scene import FileScene
from isorod.geometry.quadrature import Rule, graded_points
from isorod.model import Body, Contact, Cylinder, Model, Plane, Support
from isorod.output.state import State
from isorod.scenes import Scene
from isorod.space.closer import Patch, closer
from isorod.space.graded import Graded
from isorod.space.polyharmonic import Polyharmonic

LAW = LinearElastic(1000.0, 0.3)
ARCS = (4, 4, 2, 1, 1, 1, 1, 1, 1, 4, 4, 4, 4)  # of eight of the rod's, each in four


def test_arcs_that_are_equal_are_those_of_evenly_spaced_control_points():
    xi = disk_points(0.999, 40)
    for arcs, even in (((3,) * 8, Polyharmonic(8)), ((1,) * 24, Polyharmonic(24, turn=Graded(8, (1,) * 24).turn))):
        for found, expected in zip(Graded(8, arcs).functions(xi), even.functions(xi), strict=True):
            np.testing.assert_allclose(found[:, : len(arcs)], expected, atol=1e-12)


def test_graded_functions_are_among_those_of_the_fine_arcs_and_hold_those_of_the_rod():
    """They add up to one, their gradients are their derivatives, and the rod itself is in their space."""
    basis, xi = Graded(8, ARCS), disk_points(0.999, 40)
    values, gradients = basis.functions(xi)
    np.testing.assert_allclose(values[:, basis.is_control_point].sum(axis=1), 1.0, rtol=1e-13)
    for k, step in enumerate(1e-6 * np.eye(2)):
        ahead, behind = (basis.functions(0.99 * xi + way)[0] for way in (step, -step))
        np.testing.assert_allclose(basis.functions(0.99 * xi)[1][:, :, k], (ahead - behind) / 2e-6, atol=1e-6)
    fine = Polyharmonic(32, basis.order, basis.turn).functions(xi)[0]
    left = values - fine @ np.linalg.lstsq(fine, values, rcond=None)[0]
    assert np.abs(left).max() < 1e-9
    rod = straight(8, degree=2)
    bent = Rod(rod.axis, rod.control_points * (1.0 + 0.1 * np.random.default_rng(1).standard_normal((1, 8, 1))))
    space = Space.paper(bent, order=1, section_basis=basis)
    np.testing.assert_allclose(
        space.displacement(space.positions, xi, [0.3])[0][0], bent.grid(xi, [0.3])[0][0], atol=1e-12
    )
    assert gradients.shape == (len(xi), 13 * basis.order, 2)


def test_points_of_graded_sections_see_what_lies_just_below_the_surface():
    """Six radial points for the whole radius miss a tenth of this energy of a short wave."""
    basis = Graded(8, (1,) * 6 + (6,) * 15)
    xi, weights = basis.points(Rule(4, 2, 1))
    assert weights.sum() == pytest.approx(np.pi, rel=1e-13)
    better, more = graded_points(basis.joints, Rule(12, 8, 1))
    for k in (2, 3):
        found, exact = (w @ (basis.functions(x)[1][:, k] ** 2).sum(axis=1) for x, w in ((xi, weights), (better, more)))
        assert found == pytest.approx(exact, rel=5e-3)


def test_points_of_graded_sections_see_what_lies_under_very_short_arcs():
    """What vanishes on the surface goes deep: one ring from six widths down to the centre misses 1 % of this."""
    half = (32, 16, 8, 4, 2, 1, 1)
    basis = Graded(8, half + half[::-1] + (64,) * 14)
    found, exact = (
        weights @ (basis.functions(xi)[1][:, len(basis.arcs) + 4] ** 2).sum(axis=1)
        for xi, weights in (basis.points(basis.auto(2)), graded_points(basis.joints, Rule(8, 4, 1)))
    )
    assert found == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize(
    "arcs, what",
    [((4,) * 7, "got 28 fine ones"), ((3, 5) + (4,) * 6, "crosses the end"), ((0, 8) + (4,) * 6, "got 32")],
)
def test_arcs_that_do_not_fit_are_refused(arcs, what):
    with pytest.raises(InputError, match=f"arcs: .*{what}"):
        Graded(8, arcs)


def pressed(basis=None, press=0.02, **more):
    """A short rod held by its back and pressed on a rigid cylinder that crosses it."""
    rod = straight(8, degree=2, breaks=(0.0, 0.4, 0.6, 1.0), height=3.0)
    rod = Rod(rod.axis, rod.control_points - [0.0, 0.0, 1.5])
    space = Space.paper(rod, degree=2, order=1 if basis else 2, section_basis=basis, quadrature="4x2", **more)
    angle = space.turn + 2.0 * np.pi / space.points_around * np.arange(space.points_around)
    if basis:
        angle = 0.5 * (basis.joints[1:] + basis.joints[:-1])
    top = np.flatnonzero(np.sin(angle) > 0.8)
    back = (np.arange(space.layers)[:, None] * space.layer_nodes + top).ravel()
    cylinder = Cylinder((0.0, -2.0, 0.0), (1.0, 0.0, 0.0), 1.0)
    supports = [Support(back, "xyz", (0.0, -press, 0.0))]
    return Model([Body(space, LAW)], supports, contacts=[Contact(0, cylinder, penalty=1e4, points=(3, 6))])


def test_contact_of_graded_sections_is_that_of_the_surface_they_make():
    """Forces are those of evenly spaced control points, and the tangent is their derivative."""
    even, graded = pressed(section_points=16), pressed(Graded(8, (1,) * 16))
    for model in (even, graded):
        space = model.bodies[0].space
        moved = np.zeros(model.dofs).reshape(-1, 3)
        moved[space.is_control_point, 1] = -0.03
        operator = ContactOperator(model)
        forces, energy = operator.forces(moved.ravel())
        if model is even:
            expected = forces.reshape(space.layers, -1, 3)[:, :16], energy
    np.testing.assert_allclose(forces.reshape(space.layers, -1, 3)[:, :16], expected[0], atol=1e-11)
    assert energy == pytest.approx(expected[1], rel=1e-12)
    # Patches are as wide as their own arcs say, not the finest.
    pairs = pressed(Graded(8, (2,) * 8)), pressed(section_points=8)
    coarse, same = (
        ContactOperator(one).results(-0.03 * np.tile([0.0, 1.0, 0.0], one.dofs // 3) * one.is_control_point.repeat(3))[
            0
        ]
        for one in pairs
    )
    assert coarse.cells_across == pytest.approx(same.cells_across, rel=0.3)
    model = pressed(Graded(8, (2,) * 5 + (1,) * 2 + (2,) * 2))
    space, rng = model.bodies[0].space, np.random.default_rng(2)
    moved = 0.002 * rng.standard_normal((model.dofs // 3, 3))
    moved[space.is_control_point, 1] -= 0.03
    operator, way = ContactOperator(model), rng.standard_normal(model.dofs)
    operator.tangent(moved.ravel())
    change = [operator.forces(moved.ravel() + step * way)[0] for step in (1e-7, -1e-7)]
    slope = (change[1] - change[0]) / 2e-7
    np.testing.assert_allclose(operator.product(way), slope, atol=1e-5 * np.abs(slope).max())


def test_elements_and_arcs_are_short_at_a_patch_and_grow_with_the_distance():
    rod = straight(8, degree=2, height=8.0)
    patch = Patch(0.5, -0.5 * np.pi, 0.12, 0.12, 0.07)
    space = closer(rod, [patch])
    xi = disk_points(0.999, 40)
    breaks, joints = 8.0 * space.axis.breaks, space.basis.joints
    for edges, middle in ((breaks, 4.0), (joints, 1.5 * np.pi)):
        lengths, way = np.diff(edges), np.abs(0.5 * (edges[1:] + edges[:-1]) - middle)
        assert lengths[way < 0.12].max() <= 0.07
        assert lengths[way < 0.12].min() > 0.03
        assert lengths.max() > 0.3
        assert (lengths <= 0.07 + 0.5 * way + 1e-9).all()
    assert space.nodes < 0.1 * Space(rod, 128, 3, order=2, section_points=96).nodes
    np.testing.assert_allclose(space.rod.grid(xi, [0.37])[0], rod.grid(xi, [0.37])[0], atol=1e-12)
    # A closed rod's patch may lie across its seam.
    for bad in ([], [patch._replace(size=0.0)]):
        with pytest.raises(InputError, match="patches: name one"):
            closer(rod, bad)
    with pytest.raises(InputError, match=r"patches: .* round the section, need 2048"):
        closer(rod, [patch._replace(size=1e-3)])
    with pytest.raises(InputError, match="patches: hollow and layered rods"):
        closer(rod.with_rings((0.5, 1.0)), [patch])


def test_parallel_cylinders_to_one_per_cent():
    """A cylinder on a rigid plane in plane strain, as two equal ones: Hertz' half width and pressure.

    They are those of small patches: of one of a fourteenth of the radius 1.7 and 2.1 % is missing and too much.
    """
    E, nu, size = 1.0, 0.3, 0.005
    rod = straight(8, degree=1)
    basis = closer(rod, [Patch(0.5, -0.5 * np.pi, 0.5, 0.02, size)]).basis
    space = Space.paper(rod, degree=1, order=1, section_basis=basis, quadrature="4x2x1")
    top = np.flatnonzero(np.sin(0.5 * (basis.joints[1:] + basis.joints[:-1])) > np.cos(1.2))
    back = np.concatenate([top, space.layer_nodes + top])
    supports = [Support(np.arange(space.nodes), "z"), Support(back, "xy", (0.0, -0.0005, 0.0))]
    plane = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0))
    (result,) = statics.solve(
        Model([Body(space, LinearElastic(E, nu))], supports, contacts=[Contact(0, plane)])
    ).contacts
    exact = hertz.line_contact(result.force, hertz.modulus(E, nu), (1.0, np.inf))
    load = result.areas * result.pressure
    assert 2.0 * np.sqrt(load @ result.positions[:, 0] ** 2 / load.sum()) == pytest.approx(exact.half_width, rel=0.01)
    # Pressure is force per reference area, which the pressure itself shortens.
    shortened = 1.0 - (1.0 + nu) * (1.0 - 2.0 * nu) * exact.peak / E
    assert result.peak / shortened == pytest.approx(exact.peak, rel=0.01)


def test_patches_are_where_contact_presses_and_as_wide():
    model = pressed(section_points=16)
    model = replace(model, contacts=[Contact(0, model.contacts[0].second)])
    moved = -0.03 * np.tile([0.0, 1.0, 0.0], model.dofs // 3) * model.is_control_point.repeat(3)
    operator = ContactOperator(model)
    operator.increase_points(moved, between=True)
    results = operator.results(moved)
    ((patch,),) = patches(model, results).values()
    assert patch.u == pytest.approx(0.5, abs=1e-6)
    assert np.sin(patch.angle) == pytest.approx(-1.0, abs=1e-6)
    # A gap of (x^2 + z^2) / 2 is closed up to a radius of sqrt(0.06).
    assert patch[2:4] == pytest.approx((1.2 * np.sqrt(0.06), 1.2 * np.sqrt(0.06)), rel=0.25)
    assert (patch.size, patch.arc) == pytest.approx((2.0 * patch.along / 2.04, 2.0 * patch.around / 2.04))
    # Seen roughly, it is as large as it is seen.
    ((seen,),) = patches(model, [replace(results[0], cells_across=2.0, force=1e-3)]).values()
    assert seen[2:4] == pytest.approx((1.2 * np.sqrt(0.06), 1.2 * np.sqrt(0.06)), rel=0.25)
    assert seen.size == pytest.approx(2.0 / 1.2 * seen.along / model.contacts[0].across)
    refined = replace(model, contacts=[replace(model.contacts[0], across=6.0)])
    ((finer,),) = patches(refined, [replace(results[0], cells_across=2.0, force=1e-3)]).values()
    assert finer.size == pytest.approx(seen.size * model.contacts[0].across / 6.0)
    # Seen well, or by points and a penalty that somebody gave, it stays as it is; so does a line, unless asked for.
    enough = replace(results[0], cells_across=ENOUGH * model.contacts[0].across)
    assert not patches(model, [enough])
    assert patches(refined, [enough])
    assert not patches(pressed(section_points=16), results)
    plane = replace(model, contacts=[Contact(0, Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)))])
    assert not patches(plane, ContactOperator(plane).results(moved), lines=False)


def between_planes():
    """A bar that two planes at right angles reach into, by a twenty-fifth of its radius."""
    space = Space(straight(8, degree=2, height=6.0), 12, 3, order=2, section_points=8)
    planes = [Plane((0.0, -0.96, 0.0), (0.0, 1.0, 0.0)), Plane((-0.96, 0.0, 0.0), (1.0, 0.0, 0.0))]
    return Model([Body(space, LAW)], contacts=[Contact(0, plane) for plane in planes])


def test_lines_of_contact_are_looked_at_closer_round_the_section_alone():
    model = between_planes()
    operator = ContactOperator(model)
    operator.increase_points(np.zeros(model.dofs), between=True)
    results = operator.results(np.zeros(model.dofs))
    (found,) = patches(model, results).values()
    assert [one.angle for one in found] == pytest.approx([-0.5 * np.pi, -np.pi], abs=1e-9)
    # A gap of x^2 / 2 is closed up to the root of 0.08.
    half = np.sqrt(0.08)
    for one in found:
        assert one.arc == pytest.approx(2.0 * half / model.contacts[0].across, rel=0.25)
        assert one.around > half
    space = closer(model.bodies[0].space.rod, found)
    short = np.diff(space.basis.joints) < 0.16
    middles = 0.5 * (space.basis.joints[1:] + space.basis.joints[:-1])
    ways = [np.abs(np.angle(np.exp(1j * (middles - angle)))) for angle in (-0.5 * np.pi, np.pi)]
    assert short[np.min(ways, axis=0) < half].all()
    assert not short[np.min(ways, axis=0) > 3.0 * half].any()
    assert space.axis.elements == Space(straight(8, degree=2, height=6.0)).elements
    # They are as fine as they get; where steps would be taken anew, and where lines wind, they stay as they are.
    again = replace(model, bodies=[replace(model.bodies[0], space=space)])
    assert not patches(again, results)
    assert not patches(model, results, lines=False)
    winding = [replace(one, parameters=one.parameters + one.parameters[:, :1] * [0.0, 2.0]) for one in results]
    assert not patches(model, winding)


def test_a_finer_space_begins_where_the_one_before_ended():
    """What a bar of few elements does is a field of one of more."""
    rod = straight(8, radius=0.3, height=3.0)
    models = []
    for elements in (2, 4):
        space = Space(rod, elements=elements, degree=3, section_degree=3)
        supports = [Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.02, 0.01))]
        models.append(Model([Body(space, LAW)], supports))
    solved = statics.solve(models[0])
    start = State(models[1], solving.start_at(solved, models[1]))
    u, xi = np.linspace(0.0, 1.0, 7), [[0.0, 0.0], [0.9, 0.1], [-0.2, -0.8]]
    for one in xi:
        np.testing.assert_allclose(start.at(0, u, one), solved.at(0, u, one), atol=1e-9)


def rounds(monkeypatch, analyse, scenes, first=0):
    """Solve a scene whose models are their own solutions, each closer than the one before; return the last."""
    monkeypatch.setattr(solving, "start_at", lambda solution, model: (solution, model))

    def closer_at(solution):
        return SimpleNamespace(number=solution + 1, model=lambda: scenes(solution + 1))

    scene = SimpleNamespace(analysis="statics", refined_at_contact=closer_at)
    seen, found = solving._solve_refined(scene, first, analyse, {"load_steps": 5})
    assert getattr(seen, "number", 0) == found
    return found


def test_a_scene_is_solved_again_where_its_patches_are_not_seen_and_says_what_the_last_solution_says(monkeypatch):
    begun = []

    def analyse(model, load_steps, start=None):
        begun.append(start)
        warnings.warn(f"of {model}, {load_steps}", stacklevel=1)
        return model

    with pytest.warns(UserWarning, match=f"of {solving.REFINEMENTS}, 5") as said:
        assert rounds(monkeypatch, analyse, lambda k: k) == solving.REFINEMENTS
    assert len(said) == 1
    assert begun == [None, *((k, k + 1) for k in range(solving.REFINEMENTS))]
    with pytest.warns(UserWarning, match="of 0, 5"):
        assert solving._solve_refined(scene := Scene(), 0, analyse, {"load_steps": 5}) == (scene, 0)


@pytest.mark.parametrize("where", ["model", "analysis"])
def test_what_was_found_is_kept_if_looking_closer_fails(monkeypatch, where):
    def analyse(model, load_steps, start=None):
        if model == 2:
            raise SolveError("load factor 1: no equilibrium")
        warnings.warn(f"of {model}", stacklevel=1)
        return model

    def scenes(k):
        if k == 2 and where == "model":
            raise InputError("patches: too many points")
        return k

    with pytest.warns(UserWarning) as said:
        assert rounds(monkeypatch, analyse, scenes) == 1
    why = {"model": "patches: too many points", "analysis": "load factor 1: no equilibrium"}[where]
    assert [str(one.message) for one in said] == [
        f"local refinement of small contact patches failed, results are without it: {why}",
        "of 1",
    ]
    with pytest.raises(SolveError, match="no equilibrium"):
        rounds(monkeypatch, analyse, scenes, 2)


@pytest.mark.parametrize("told, rods", [("", [0, 1]), ("space = {section_points = 16}", [0])])
def test_rods_of_a_file_whose_space_is_not_told_are_looked_at_closer(tmp_path, told, rods):
    path = tmp_path / "bars.toml"
    path.write_text(crossing(told))
    scene = FileScene(str(path))
    model = scene.model()
    moved = model.is_control_point.repeat(3) * np.tile([0.0, 1.0, 0.0], model.dofs // 3)
    moved[3 * int(model.first_node[1]) :] *= -1.0
    results = ContactOperator(model).results(0.02 * moved)
    closer_ = scene.refined_at_contact(SimpleNamespace(model=model, contacts=results))
    graded = [k for k, body in enumerate(closer_.model().bodies) if isinstance(body.space.basis, Graded)]
    assert graded == rods
    assert scene.refined_at_contact(SimpleNamespace(model=model, contacts=())) is None


def test_penalty_by_default_is_softer_where_control_points_are_closer():
    """By 1.8 over how many are wanted across the patch; with other points it stays so, and a typed one as typed."""
    rod = straight(8, degree=1)
    space = Space.paper(rod, degree=1, order=1, section_basis=closer(rod, [Patch(0.5, 0.0, 0.5, 0.2, 0.1)]).basis)
    plane = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0))
    found = []
    for asked in ({"across": 4.0}, {"across": 6.0}, {"penalty": 7.0}):
        operator = ContactOperator(Model([Body(space, LinearElastic(1.0, 0.3))], contacts=[Contact(0, plane, **asked)]))
        before = operator.packed.passes["penalty"].copy()
        assert (operator.packed.passes["penalty"] == before).all()
        found.append(before[0])
    stiff = 2.0 / (1.0 - 0.3**2) * space.basis.fine / (2.0 * np.pi)
    assert found == pytest.approx([0.45 * stiff, 0.3 * stiff, 7.0], rel=0.02)
