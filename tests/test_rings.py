"""Tubes and layered rods against exact solutions."""

import numpy as np
import pytest
from refused import refused

from isorod import Muscle, Rod, Space, airfoil, circle, ellipse, helix, modal, statics, straight
from isorod.material import LinearElastic, NeoHookean
from isorod.material.places import Places
from isorod.model import Body, BodyForce, Model, Pressure, SectionLoad, Support
from isorod.output import vtk

A, B, LENGTH = 0.8, 2.0, 3.0
E, NU = 200.0, 0.3


def prism(rings, section=None, length=LENGTH):
    return straight(length).sweep(circle(8, B) if section is None else section).with_rings(rings)


def tube(section_degree, inner=A, **keywords):
    return Space(prism((inner / B, 1.0)), section_degree=section_degree, **{"quadrature": "full"} | keywords)


def held(space, ends):
    """Hold both ends along z, or one; and what moves and turns a rod in its plane as a whole."""
    faces = [Support.end(space, which, "z") for which in ends]
    return [*faces, Support(np.array([0]), "xy"), Support(np.array([1]), "y")]


def radial(model, space, radii):
    """Return the radial displacement at radii, in some direction, half-way along, and the displacement along z."""
    solution = statics.solve(model)
    direction = np.array([np.cos(0.7), np.sin(0.7)])
    xi = np.outer(radii, direction) / B
    found, _ = space.displacement(solution.displacement, xi, [0.5])
    # Control points of the circle start at the angle 0.
    assert np.abs(found[0, :, :2] @ [-direction[1], direction[0]]).max() < 1e-9 * np.abs(found).max()
    return found[0, :, :2] @ direction, found[0, :, 2], solution


def lame(inner, outer):
    """Return ``A`` and ``B`` of the stresses ``A -+ B / r^2`` of a tube under pressures within and without."""
    share = B**2 - A**2
    return (inner * A**2 - outer * B**2) / share, (inner - outer) * (A * B) ** 2 / share


RADII = np.linspace(A, B, 7)


@pytest.mark.parametrize("section_degree", [2, 6])
@pytest.mark.parametrize("inner, outer", [(1.0, 0.0), (2.0, 0.7)])
def test_lame_tube_in_plane_strain(inner, outer, section_degree):
    space = tube(section_degree, degree=2)
    loads = [Pressure(inner, "inner"), Pressure(outer)]
    model = Model([Body(space, LinearElastic(E, NU))], held(space, ("start", "end")), loads=loads)
    found, _, solution = radial(model, space, RADII)
    mean, other = lame(inner, outer)
    exact = (1 + NU) / E * ((1 - 2 * NU) * mean * RADII + other / RADII)
    assert np.abs(found / exact - 1).max() < 1e-8
    # The ends carry the axial stress 2 nu A.
    thrust = 2 * NU * mean * np.pi * (B**2 - A**2)
    assert solution.reactions[1, 2] == pytest.approx(thrust, rel=1e-8)
    xi, u = np.outer(RADII / B, [1.0, 0.0]), np.array([0.5])
    P = model.bodies[0].laws_at(u, xi).stress(space.displacement(solution.displacement, xi, u)[1])[0]
    assert P[:, 0, 0] == pytest.approx(mean - other / RADII**2, abs=1e-8 * abs(other) / A**2)
    assert P[:, 1, 1] == pytest.approx(mean + other / RADII**2, abs=1e-8 * abs(other) / A**2)


def test_lame_tube_with_free_ends():
    space = tube(3, degree=2)
    model = Model([Body(space, LinearElastic(E, NU))], held(space, ("start",)), loads=[Pressure(1.5, "inner")])
    found, along, _ = radial(model, space, RADII)
    mean, other = lame(1.5, 0.0)
    exact = ((1 - NU) * mean * RADII + (1 + NU) * other / RADII) / E
    assert np.abs(found / exact - 1).max() < 1e-8
    assert along == pytest.approx(np.full(RADII.size, -2 * NU * mean / E * LENGTH / 2), rel=1e-8)


@pytest.mark.slow
def test_a_tube_that_is_not_round_converges_with_the_degree():
    """No function is the solution; the potential falls towards its minimum, the work of the pressure grows."""
    works = []
    for degree in (4, 6, 8):
        rod = straight(LENGTH).sweep(ellipse(8, 2.0, 1.5)).with_rings((0.5, 1.0))
        space = Space(rod, degree=2, section_degree=degree)
        load = Pressure(1.0, "inner")
        model = Model([Body(space, LinearElastic(E, NU))], held(space, ("start", "end")), loads=[load])
        works.append(np.sum(load.nodal(space) * statics.solve(model).displacement.reshape(-1, 3)))
    first, second = np.diff(works) / works[-1]
    assert 0.0 < second < 0.2 * first, works
    assert second < 0.01


def twisted(space, angle):
    ends = Support.end(space, "start"), Support.end(space, "end", turn=(0.0, 0.0, angle))
    return ends


def bent(space, curvature):
    """Supports of uniform bending about y: the ends stay plane, and nothing else holds them."""
    nodes = space.layer_nodes * (space.layers - 1) + np.arange(space.layer_nodes)
    slope = np.zeros((space.layer_nodes, 3))
    slope[:, 2] = curvature * LENGTH * space.positions[nodes, 0]
    return [Support(nodes, "z", slope), *held(space, ("start",))]


@pytest.mark.parametrize("section_degree", [2, 5])
def test_torsion_and_bending_of_a_tube(section_degree):
    space = tube(section_degree, degree=2)
    body = Body(space, LinearElastic(E, NU))
    angle = 1e-5
    solution = statics.solve(Model([body], twisted(space, angle)))
    polar = np.pi / 2 * (B**4 - A**4)
    assert solution.moments[1, 2] == pytest.approx(E / 2 / (1 + NU) * polar * angle / LENGTH, rel=1e-8)
    model = Model([body], bent(space, 0.01))
    solution = statics.solve(model)
    assert solution.moments[0, 1] == pytest.approx(-E * polar / 2 * 0.01, rel=1e-8)


LAYERS = (0.0, 0.4, 0.75, 1.0)
MODULI = (5.0, 200.0, 30.0)


def sums(moment):
    """Return the integral of ``E r^(moment - 1)`` over the section."""
    edges = B * np.array(LAYERS)
    return 2 * np.pi / moment * np.array(MODULI) @ np.diff(edges**moment)


def layered(section_degree=2, nu=(NU, NU, NU), **keywords):
    space = Space(prism(LAYERS), degree=2, section_degree=section_degree, **keywords)
    return space, Body(space, [LinearElastic(one, own) for one, own in zip(MODULI, nu, strict=True)])


def test_stiffnesses_of_a_layered_rod_are_the_sums_of_its_layers():
    """With one Poisson's ratio no layer presses on another, in tension and in bending; in torsion never."""
    space, body = layered()
    pulled = [Support.end(space, "end", "z", (0.0, 0.0, 0.01)), *held(space, ("start",))]
    solution = statics.solve(Model([body], pulled))
    assert solution.reactions[0, 2] == pytest.approx(sums(2) * 0.01 / LENGTH, rel=1e-10)
    solution = statics.solve(Model([body], bent(space, 0.01)))
    assert solution.moments[0, 1] == pytest.approx(-sums(4) / 2 * 0.01, rel=1e-10)
    solution = statics.solve(Model([body], twisted(space, 1e-5)))
    assert solution.moments[1, 2] == pytest.approx(sums(4) / 2 / (1 + NU) * 1e-5 / LENGTH, rel=1e-8)


def composite(nu):
    """Return the axial stiffness of round layers that adhere: ``u = A r + B / r`` in each, strain 1 along the axis."""
    edges, count = B * np.array(LAYERS), len(MODULI)
    shear = [E / (2 * (1 + own)) for E, own in zip(MODULI, nu, strict=True)]
    lame = [E * own / ((1 + own) * (1 - 2 * own)) for E, own in zip(MODULI, nu, strict=True)]
    rows, right = np.zeros((2 * count, 2 * count)), np.zeros(2 * count)
    rows[0, 1] = 1.0
    for j in range(count):
        r, k = edges[j + 1], 2 * j
        # Radial stress 2 (lame + mu) A - 2 mu B / r^2 + lame.
        rows[k + 1, k : k + 2] = 2 * (lame[j] + shear[j]), -2 * shear[j] / r**2
        right[k + 1] -= lame[j]
        if j < count - 1:
            rows[k + 1, k + 2 : k + 4] = -2 * (lame[j + 1] + shear[j + 1]), 2 * shear[j + 1] / r**2
            right[k + 1] += lame[j + 1]
            rows[k + 2, k : k + 4] = r, 1 / r, -r, -1 / r
    swell = np.linalg.solve(rows, right)[::2]
    area = np.pi * np.diff(edges**2)
    return sum(a * (2 * lm * s + lm + 2 * mu) for a, lm, mu, s in zip(area, lame, shear, swell, strict=True))


def test_axial_stiffness_where_layers_press_on_each_other():
    nu = (0.45, 0.1, 0.3)
    space, body = layered(2, nu)
    pulled = [Support.end(space, "end", "z", (0.0, 0.0, 0.01)), *held(space, ("start",))]
    exact = composite(nu) * 0.01 / LENGTH
    assert statics.solve(Model([body], pulled)).reactions[0, 2] == pytest.approx(exact, rel=1e-8)
    # That is not the sum, and not what functions without a kink find.
    assert abs(exact / (sums(2) * 0.01 / LENGTH) - 1) > 1e-3
    assert composite((NU,) * 3) == pytest.approx(sums(2), rel=1e-12)


@pytest.mark.slow
def test_bending_stiffness_where_layers_press_on_each_other_converges():
    moments = []
    for degree in (2, 5, 6):
        space, body = layered(degree, (0.45, 0.1, 0.3))
        moments.append(statics.solve(Model([body], bent(space, 0.01))).moments[0, 1])
    assert moments[1] == pytest.approx(moments[2], rel=1e-9)
    assert 1e-4 < moments[0] / moments[2] - 1 < 1e-2


def frequencies(body, wanted=3):
    """Return the lowest axial modes of a rod held along z at its start: in the plane nothing moves."""
    space = body.space
    supports = [Support.end(space, "start", "z"), Support(np.arange(space.nodes), "xy")]
    return modal.solve(Model([body], supports), wanted).frequencies


def test_axial_modes_of_a_layered_rod_with_one_wave_speed():
    """Waves stay plane, whatever the layers."""
    space = Space(prism(LAYERS, length=200.0), elements=6, degree=5, section_degree=2)
    density = np.array(MODULI) / 50.0
    body = Body(space, [LinearElastic(one, 0.0) for one in MODULI], list(density))
    exact = np.sqrt(50.0) * np.array([1, 3, 5]) / (4 * 200.0)
    assert frequencies(body) == pytest.approx(exact, rel=1e-6)


def test_axial_modes_of_a_slender_layered_rod():
    """The stiffness and the mass of all layers together; shear between them is small as (radius / length)^2."""
    density = np.array([3.0, 1.0, 8.0])
    space = Space(prism(LAYERS, length=3000.0 * B), elements=6, degree=4, section_degree=2)
    body = Body(space, [LinearElastic(one, 0.0) for one in MODULI], list(density))
    area = np.diff(np.array(LAYERS) ** 2)
    speed = np.sqrt(area @ MODULI / (area @ density))
    assert frequencies(body) == pytest.approx(speed * np.array([1, 3, 5]) / (4 * 3000.0 * B), rel=1e-5)


def test_volume_and_weight_leave_the_hole_out():
    rod = prism((0.4, 1.0))
    assert rod.volume() == pytest.approx(np.pi * B**2 * (1 - 0.16) * LENGTH, rel=1e-12)
    coil = helix(10.0, 4.0, 1).sweep(circle(8, 1.0))
    assert coil.with_rings((0.5, 1.0)).volume() == pytest.approx(0.75 * coil.volume(), rel=1e-3)
    assert coil.with_rings((0.5, 1.0)).refine(2).rings == (0.5, 1.0)
    space = Space(rod, section_degree=3)
    weight = BodyForce((0.0, 0.0, -2.0)).nodal(space)[space.is_control_point].sum(axis=0)
    assert weight == pytest.approx([0.0, 0.0, -2.0 * rod.volume()], abs=1e-10)
    force = SectionLoad((1.0, 2.0, 3.0)).nodal(space)
    assert force[space.is_control_point].sum(axis=0) == pytest.approx([1.0, 2.0, 3.0], rel=1e-12)


@pytest.mark.parametrize("rings", [(0.5, 1.0), (0.0, 0.6, 1.0), (0.3, 0.6, 1.0)])
@pytest.mark.parametrize("section", [circle(8, B), airfoil()], ids=["round", "airfoil"])
def test_functions(rings, section):
    """The first is one, the map of the rod is among them, and gradients are those of the values."""
    rod = straight(LENGTH).sweep(section).with_rings(rings)
    space = Space(rod, section_degree=4)
    random = np.random.default_rng(4)
    radius, angle = random.uniform(max(rings[0], 0.05), 1.0, 40) * 0.99 + 0.005, random.uniform(0.0, 2 * np.pi, 40)
    xi = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    values, gradients = space.basis.functions(xi)
    assert values[:, 0] == pytest.approx(np.ones(40), abs=1e-12)
    layer = space.positions.reshape(space.layers, -1, 3)[0]
    assert values @ layer == pytest.approx(rod.grid(xi, [0.0])[0][0], abs=1e-12)
    for b, step in enumerate(1e-6 * np.eye(2)):
        slope = (space.basis.functions(xi + step)[0] - space.basis.functions(xi - step)[0]) / 2e-6
        assert np.abs(slope - gradients[:, :, b]).max() < 1e-7 * np.abs(gradients).max()


def test_a_kink_where_two_layers_meet_and_no_gap():
    space = Space(prism((0.0, 0.6, 1.0)), section_degree=3)
    values, gradients = space.basis.functions([[0.6 - 1e-9, 0.0], [0.6 + 1e-9, 0.0]])
    assert np.abs(values[1] - values[0]).max() < 1e-6
    assert np.abs(gradients[1] - gradients[0]).max() > 0.1


def test_large_deformation_of_a_tube_is_that_of_a_whole_rod_where_it_should_be():
    """A uniform stretch: the force is the area's share."""
    forces = []
    for rings in ((0.0, 1.0), (0.5, 1.0), (0.0, 0.5, 1.0)):
        space = Space(prism(rings), degree=2, section_degree=2)
        law = NeoHookean(E, NU)
        body = Body(space, law if len(rings) < 3 else [law, NeoHookean(2 * E, NU)])
        ends = [Support.end(space, "end", "z", (0.0, 0.0, 0.6)), *held(space, ("start",))]
        forces.append(statics.solve(Model([body], ends)).reactions[0, 2])
    assert forces[1] == pytest.approx(0.75 * forces[0], rel=1e-6)
    assert forces[2] == pytest.approx(1.75 * forces[0], rel=1e-6)


def test_a_law_for_each_element_and_ring():
    """Two bars in series, each of two layers: compliances add up."""
    space = Space(prism((0.0, 0.5, 1.0)), elements=2, degree=2, continuity=0, section_degree=2)
    rows = [[LinearElastic(1.0, 0.0), LinearElastic(2.0, 0.0)], [LinearElastic(3.0, 0.0), LinearElastic(6.0, 0.0)]]
    body = Body(space, rows, [[1.0, 2.0], [3.0, 4.0]])
    pulled = [Support.end(space, "end", "z", (0.0, 0.0, 0.01)), *held(space, ("start",))]
    area = np.pi * B**2 * np.array([0.25, 0.75])
    compliance = LENGTH / 2 * (1 / (area @ [1.0, 2.0]) + 1 / (area @ [3.0, 6.0]))
    assert statics.solve(Model([body], pulled)).reactions[0, 2] == pytest.approx(0.01 / compliance, rel=1e-9)


def test_laws_of_rings_are_those_of_the_points_within_them():
    """Fibres that follow the rod in the core, which contracts; rubber around."""
    muscle, rubber = Muscle(1.0, 0.3, 0.5, 0.4, 0.6, 1.0, "tangent"), NeoHookean(2.0, 0.2)
    space = Space(helix(10.0, 4.0, 1).sweep(circle(8, 1.0)).with_rings((0.0, 0.5, 1.0)), section_degree=2)
    body = Body(space, [muscle, rubber])
    xi = np.array([[0.9, 0.0], [0.1, 0.2], [0.0, 0.5], [-0.3, 0.0]])
    core = np.array([False, True, False, True])
    u = np.array([0.1, 0.4, 0.8])
    F = np.eye(3) + 0.1 * np.random.default_rng(2).standard_normal((3, 4, 3, 3))
    laws = body.laws_at(u, xi).at(0.7)
    along = muscle.at(0.7).placed(Places(space.rod, u[:, None], xi[core]))
    # Fibres are sums of products with a matrix, whose order depends on how many points there are: a few roundings.
    rounded = {"rtol": 1e-13, "atol": 1e-13}
    for name in ("energy", "stress", "tangent"):
        found = getattr(laws, name)(F)
        np.testing.assert_allclose(found[:, core], getattr(along, name)(F[:, core]), **rounded)
        assert np.array_equal(found[:, ~core], getattr(rubber, name)(F[:, ~core]))
    stress, moduli = laws.discrete(F, 0.01 * F, True)
    np.testing.assert_allclose(stress[:, core], along.discrete(F[:, core], 0.01 * F[:, core], True)[0], **rounded)
    assert np.array_equal(moduli[:, ~core], rubber.discrete(F[:, ~core], 0.01 * F[:, ~core], True)[1])
    fibres = body.known(space.tabulate(0, 1))
    lengths = np.linalg.norm(fibres, axis=-1)
    inside = np.hypot(*space.tabulate(0, 1).xi.T) < 0.5
    assert lengths[..., inside] == pytest.approx(1.0) and not lengths[..., ~inside].any()


def test_picture_of_a_tube_has_its_hole_and_stress_jumps_where_layers_meet():
    space, body = layered()
    strain = 1e-5
    pulled = [Support.end(space, "end", "z", (0.0, 0.0, strain * LENGTH)), *held(space, ("start",))]
    solution = statics.solve(Model([body], pulled))
    mesh = vtk.grid(body, {"displacement": solution.displacement.reshape(-1, 3)}, around=64)
    assert mesh.volume == pytest.approx(np.pi * B**2 * LENGTH, rel=3e-3)
    assert np.unique((mesh.point_data["von_mises"] / strain).round(1)) == pytest.approx(np.sort(MODULI))
    hollow = Body(tube(2), LinearElastic(E, NU))
    mesh = vtk.grid(hollow, {"displacement": np.zeros((hollow.space.nodes, 3))}, around=64)
    assert mesh.volume == pytest.approx(np.pi * (B**2 - A**2) * LENGTH, rel=3e-3)
    assert np.hypot(*mesh.points[:, :2].T).min() == pytest.approx(A, rel=1e-6)


LAW = LinearElastic(E, NU)


test_refusals = refused(
    (lambda: Space(prism((0.5, 1.0)), order=1), "section degree: got none, need one such as 4: hollow and layered"),
    (lambda: tube(13), "section degree: got 13, need an integer from 1 to 12"),
    (lambda: Pressure(np.nan), "pressure: got nan"),
    (lambda: Pressure(1.0, "top"), "pressure: got surface 'top', need 'outer' or 'inner'"),
    (lambda: Pressure(1.0, "inner").nodal(layered()[0]), "the rod has no hole"),
    (lambda: Body(layered()[0], [LAW, LAW]), "material: got 2 laws for 3 rings"),
    (lambda: Body(layered()[0], [[LAW] * 3] * 2), "material: got 2 laws for 3 rings"),
    (lambda: Body(tube(2), [[LAW]]), "material: got 1 laws for 5 elements, need one law or one an element"),
    (
        lambda: Body(layered()[0], LAW, [1.0, 2.0]),
        r"density: got shape \(2,\), need one or one for each of the 3 ri",
    ),
    (lambda: Body(layered()[0], LAW, [[1.0, 2.0, 3.0], [1.0]]), r"density: got shape \(2,\), .*in rows of one length"),
)


def test_same_volume_for_any_rings():
    rod = prism((0.0, 1.0))
    assert prism((0.0, 0.3, 1.0)).volume() == pytest.approx(rod.volume(), rel=1e-12)
    assert isinstance(rod, Rod) and repr(prism((0.5, 1))).count("rings 0.5 1") == 1


NO_RINGS = [(0.0,), (0.5, 0.5, 1.0), (0.9, 0.5, 1.0), (0.0, 0.5), (-0.1, 1.0), (0.001, 1.0), (0.0, np.nan, 1.0), ()]
test_radii_that_are_none = refused(
    *((rings, "^rings: got radii .*need some that rise from 0, .*$") for rings in NO_RINGS), by=prism
)
