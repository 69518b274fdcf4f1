"""Stiffness and mass per length of sections: closed forms, invariance, energy of solutions, and what is refused."""

import numpy as np
import pytest
from refused import refused

import isorod
from isorod import Body, LinearElastic, NeoHookean, Space
from isorod.geometry.section import airfoil, circle, ellipse, naca, rounded_rectangle
from isorod.output.prism import Prism
from isorod.output.section_properties import SectionProperties, apart, section_properties
from isorod.space.polynomial import polynomials
from isorod.space.waves import Waves

E, NU = 210.0, 0.3
LAW = LinearElastic(E, NU)
G = E / (2 * (1 + NU))

# Exact values are met to this share.
EXACT = 1e-8


def bar(outline, rings=None, length=1.0):
    rod = isorod.straight(length).sweep(outline)
    return rod if rings is None else rod.with_rings(rings)


def annulus(inner, outer, points=40):
    """Points (x, y) of an annulus and weights: Gauss by the radius, even round it."""
    s, w = np.polynomial.legendre.leggauss(points)
    r = inner + 0.5 * (outer - inner) * (s + 1)
    angle = 2 * np.pi * np.arange(24) / 24
    weights = np.outer(0.5 * (outer - inner) * w * r, np.full(24, 2 * np.pi / 24))
    return np.outer(r, np.cos(angle)).ravel(), np.outer(r, np.sin(angle)).ravel(), weights.ravel()


def tube_flexure(x, y, inner, outer, nu):
    """Shear stresses of a tube under a unit force along x.

    A. E. H. Love, A treatise on the mathematical theory of elasticity (4th ed. 1927), art. 229, with ``chi = (A r + B /
    r) cos theta + 1/4 r^3 cos 3 theta`` such that nothing acts on either surface.
    """
    share = (3 + 2 * nu) / 4
    A, B = -share * (outer**2 + inner**2), -share * outer**2 * inner**2
    r2 = x**2 + y**2
    by_x = A + B * (y**2 - x**2) / r2**2 + 0.75 * (x**2 - y**2)
    by_y = -2 * B * x * y / r2**2 - 1.5 * x * y
    factor = -1 / (2 * (1 + nu) * np.pi / 4 * (outer**4 - inner**4))
    return factor * (by_x + nu / 2 * x**2 + (1 - nu / 2) * y**2), factor * (by_y + (2 + nu) * x * y)


def ellipse_flexure(x, y, a, b, nu):
    """Shear stresses of an ellipse of half axes a along x, b along y under a unit force along x.

    S. P. Timoshenko & J. N. Goodier, Theory of elasticity (3rd ed. 1970), art. 123.
    """
    inertia, share = np.pi / 4 * a**3 * b, 2 * (1 + nu) * a**2 + b**2
    whole = (1 + nu) * (3 * a**2 + b**2)
    first = share / (2 * inertia * whole) * (a**2 - x**2 - (1 - 2 * nu) * a**2 * y**2 / share)
    return first, -((1 + nu) * a**2 + nu * b**2) / (inertia * whole) * x * y


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49, -0.4])
def test_circle(nu):
    """The shear coefficient is that of the energy: J. D. Renton, Int. J. Solids Struct. 27 (1991) 1941-1952."""
    shear, r = E / (2 * (1 + nu)), 0.7
    found = section_properties(bar(circle(6, r)), material=LinearElastic(E, nu))
    area, inertia = np.pi * r**2, np.pi / 4 * r**4
    k = 6 * (1 + nu) ** 2 / (7 + 14 * nu + 8 * nu**2)
    exact = [E * area, k * shear * area, k * shear * area, 2 * shear * inertia, E * inertia, E * inertia]
    scale = np.sqrt(np.outer(exact, exact))
    assert (np.abs(found.stiffness - np.diag(exact)) / scale).max() < EXACT
    assert found.EA == pytest.approx(exact[0], rel=EXACT)
    assert found.GA == pytest.approx(exact[1:3], rel=EXACT)
    assert found.GJ == pytest.approx(exact[3], rel=EXACT)
    assert found.EI == pytest.approx(exact[4:], rel=EXACT)
    assert found.principal_angle == 0.0
    assert found.error < EXACT


@pytest.mark.parametrize("hole", [0.3, 0.8, 0.97])
def test_tube(hole):
    r = 1.3
    found = section_properties(bar(circle(8, r), [hole, 1]), material=LAW)
    area, inertia = np.pi * r**2 * (1 - hole**2), np.pi / 4 * r**4 * (1 - hole**4)
    x, y, w = annulus(hole * r, r)
    energy = w @ np.sum(np.square(tube_flexure(x, y, hole * r, r, NU)), axis=0)
    exact = [E * area, G / energy, G / energy, 2 * G * inertia, E * inertia, E * inertia]
    scale = np.sqrt(np.outer(exact, exact))
    assert (np.abs(found.stiffness - np.diag(exact)) / scale).max() < EXACT


def test_flexure_of_the_tube_is_that_of_the_circle_without_a_hole():
    x, y, w = annulus(0.0, 1.0)
    energy = w @ np.sum(np.square(tube_flexure(x, y, 0.0, 1.0, NU)), axis=0)
    assert np.pi * energy == pytest.approx((7 + 14 * NU + 8 * NU**2) / (6 * (1 + NU) ** 2), rel=1e-12)


@pytest.mark.parametrize(("a", "b"), [(1.0, 0.5), (0.3, 0.9), (2.0, 0.1)])
def test_ellipse(a, b):
    found = section_properties(bar(ellipse(8, a, b)), material=LAW)
    x, y, w = annulus(0.0, 1.0)
    along = a * b * w @ np.sum(np.square(ellipse_flexure(a * x, b * y, a, b, NU)), axis=0)
    across = a * b * w @ np.sum(np.square(ellipse_flexure(b * x, a * y, b, a, NU)), axis=0)
    area = np.pi * a * b
    torsion = G * np.pi * a**3 * b**3 / (a**2 + b**2)
    exact = [E * area, G / along, G / across, torsion, E * area * b**2 / 4, E * area * a**2 / 4]
    scale = np.sqrt(np.outer(exact, exact))
    assert (np.abs(found.stiffness - np.diag(exact)) / scale).max() < EXACT


def test_concentric_layers():
    """Where Poisson's ratios are alike stresses are those of each layer alone."""
    r, edges, moduli = 0.5, np.array([0.2, 0.6, 0.9, 1.0]), np.array([3.0, 70.0, 210.0])
    found = section_properties(bar(circle(8, r), edges), material=[LinearElastic(one, NU) for one in moduli])
    area, inertia = (np.pi * np.diff((r * edges) ** 2), np.pi / 4 * np.diff((r * edges) ** 4))
    assert found.EA == pytest.approx(moduli @ area, rel=EXACT)
    assert found.EI == pytest.approx([moduli @ inertia] * 2, rel=EXACT)
    assert found.GJ == pytest.approx(moduli @ inertia / (1 + NU), rel=EXACT)


def test_layers_that_hinder_each_other():
    """Core and sheath of other Poisson's ratios: Lame's solutions with one axial strain, and torsion as ever."""
    inner, core, sheath = 0.6, LinearElastic(10.0, 0.45), LinearElastic(40.0, 0.1)
    found = section_properties(bar(circle(8), [0, inner, 1]), material=[core, sheath])
    # Displacements A r, and B r + C / r, per axial strain: as large and pressed as hard where they meet, free outside.
    m, h, n, k = core.mu, core.lame, sheath.mu, sheath.lame
    matrix = [
        [inner, -inner, -1 / inner],
        [2 * (m + h), -2 * (n + k), 2 * n / inner**2],
        [0.0, 2 * (n + k), -2 * n],
    ]
    A, B, _ = np.linalg.solve(matrix, [0.0, k - h, -k])
    exact = np.pi * inner**2 * (2 * h * A + h + 2 * m) + np.pi * (1 - inner**2) * (2 * k * B + k + 2 * n)
    assert found.EA == pytest.approx(exact, rel=EXACT)
    assert found.EA > 1.001 * np.pi * (inner**2 * core.E + (1 - inner**2) * sheath.E)
    assert found.GJ == pytest.approx(np.pi / 2 * (inner**4 * m + (1 - inner**4) * n), rel=EXACT)


def moduli_of(compliance):
    """Moduli (3, 3, 3, 3) of a compliance in the order xx, yy, zz, 2 yz, 2 xz, 2 xy."""
    stiff = np.linalg.inv(compliance)
    voigt = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
    return stiff[voigt[:, :, None, None], voigt[None, None]]


def test_orthotropic_circle():
    """Torsion: S. G. Lekhnitskii, Theory of elasticity of an anisotropic body (1981), that of an ellipse."""
    along, g12, g13 = 10.0, 1.0, 3.0
    compliance = np.diag([1 / along, 1 / 4.0, 1 / 2.0, 1 / 0.7, 1 / g13, 1 / g12])
    compliance[0, 1] = compliance[1, 0] = compliance[0, 2] = compliance[2, 0] = -0.3 / along
    prism = Prism(circle(8), (0.0, 1.0), moduli_of(compliance)[None], np.ones(1))
    found = prism.stiffness(polynomials(prism.rod, 6))
    assert found[0, 0] == pytest.approx(along * np.pi, rel=EXACT)
    assert np.diag(found)[4:] == pytest.approx([along * np.pi / 4] * 2, rel=EXACT)
    assert found[3, 3] == pytest.approx(np.pi * g12 * g13 / (g12 + g13), rel=EXACT)


def test_a_force_shears_a_section_of_oblique_fibres():
    """Under an axial force the stress is uniform in any homogeneous bar, and the shear is that of the material."""
    compliance = np.diag([0.1, 0.3, 0.5, 1.0, 1.2, 0.9])
    compliance[0, 5] = compliance[5, 0] = 0.05
    prism = Prism(airfoil(), (0.0, 1.0), moduli_of(compliance)[None], np.ones(1))
    area, first = prism.moments()
    centred = Prism(prism.outline - first / area, (0.0, 1.0), prism.moduli, np.ones(1))
    found = np.linalg.inv(centred.stiffness(polynomials(centred.rod, 4)))[:, 0]
    assert found[:2] * area == pytest.approx([0.1, 0.05], rel=1e-6)
    assert np.abs(found[2:]).max() < 1e-6 * found[0]


def test_laws_count_by_their_moduli_at_rest():
    section = bar(circle(8))
    one, other = (section_properties(section, material=law(E, NU)).stiffness for law in (LinearElastic, NeoHookean))
    assert apart(one, other) < 1e-12


def test_a_stiff_core_off_the_centroid():
    """Where Poisson's ratios are alike stretching and bending are those of masses that are as dense as stiff."""
    moduli = np.array([10.0, 1.0])
    tangents = np.stack([LinearElastic(one, NU).tangent(np.eye(3)[None])[0] for one in moduli])
    prism = Prism(airfoil(), (0.0, 0.6, 1.0), tangents, moduli)
    matrices = prism.stiffness(Waves(prism.rod, 8, 6)), prism.mass()
    found = SectionProperties(*matrices, prism.moments()[0], np.zeros(3), np.eye(3), 0.0, 0.0, "")
    assert np.hypot(*found.tension_centre) > 0.1
    assert found.tension_centre == pytest.approx(found.mass_centre, rel=1e-6)
    assert found.EA == pytest.approx(found.mass[0, 0], rel=1e-6)
    about = found.about(found.mass_centre, found.principal_angle).mass
    assert abs(about[4, 5]) < 1e-6 * about[4, 4]
    assert abs(found.principal_angle) > 0.1
    assert found.EI == pytest.approx(np.diag(about)[4:], rel=1e-6)


@pytest.mark.parametrize("rings", [None, [0, 0.5, 1]])
def test_a_section_is_the_same_wherever_it_is(rings):
    """Turned and moved in its plane, and with its control points begun at another one."""
    laws = LAW if rings is None else [LAW, LinearElastic(30.0, 0.2)]
    outline = ellipse(8, 1.0, 0.6) + np.array([0.4, 0.0])
    here = section_properties(bar(outline, rings), material=laws)
    angle = np.radians(33.0)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    there = section_properties(bar((outline + np.array([3.0, -7.0])) @ turn, rings), material=laws)
    assert apart(here.stiffness, there.stiffness) < 1e-9
    assert there.frame[1] == pytest.approx([*turn[0], 0.0], abs=1e-9)
    begun = section_properties(bar(np.roll(outline, 2, axis=0), rings), material=laws)
    # The disk's first axis is where the first control point is.
    seen = np.degrees(np.arctan2(*begun.frame[1, [1, 0]]))
    assert abs(abs(seen) - 90.0) < 1e-6
    assert apart(begun.about(angle=-seen).stiffness, here.stiffness) < 1e-9
    assert np.abs(begun.about(angle=-seen).mass - here.mass).max() == 0.0
    assert begun.EI[::-1] == pytest.approx(here.EI, rel=1e-9)


def test_units():
    """Lengths in millimetres in the place of metres, and newtons."""
    metres = section_properties(bar(airfoil()), material=LAW, density=3.0)
    small = section_properties(bar(1e3 * airfoil()), material=LinearElastic(1e-6 * E, NU), density=3e-9)
    scale = np.array([1.0, 1.0, 1.0, 1e3, 1e3, 1e3])
    assert apart(metres.stiffness * np.outer(scale, scale), small.stiffness) < 1e-9
    assert apart(1e-3 * metres.mass * np.outer(scale, scale), small.mass) < 1e-9


def test_about_another_point_in_other_directions():
    found = section_properties(bar(ellipse(8, 1.0, 0.4)), material=LAW, density=2.0)
    y, z, angle = 0.3, -0.8, np.radians(20.0)
    moved = found.about((y, z))
    assert moved.stiffness[4, 4] == pytest.approx(found.stiffness[4, 4] + z**2 * found.stiffness[0, 0], rel=1e-12)
    assert moved.stiffness[5, 5] == pytest.approx(found.stiffness[5, 5] + y**2 * found.stiffness[0, 0], rel=1e-12)
    assert moved.mass[3, 3] == pytest.approx(found.mass[3, 3] + (y**2 + z**2) * found.mass[0, 0], rel=1e-12)
    # A force there has moments about the centroid, and moves what is there.
    force = np.array([2.0, 3.0, 5.0])
    about_centroid = np.concatenate([force, np.cross([0.0, y, z], force)])
    energy = about_centroid @ found.compliance @ about_centroid
    assert force @ moved.compliance[:3, :3] @ force == pytest.approx(energy, rel=1e-12)
    turned = found.about((y, z), 20.0)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), np.sin(angle)], [0, -np.sin(angle), np.cos(angle)]])
    assert (turn @ force) @ turned.compliance[:3, :3] @ (turn @ force) == pytest.approx(energy, rel=1e-12)
    assert apart(turned.about().stiffness, found.stiffness) < 1e-12
    assert apart(turned.about((y, z)).stiffness, moved.stiffness) < 1e-12
    for other in (moved, turned):
        assert other.EI == pytest.approx(found.EI, rel=1e-9)
        assert other.GA == pytest.approx(found.GA, rel=1e-9)
        assert (other.EA, other.GJ) == pytest.approx((found.EA, found.GJ), rel=1e-9)


def test_centres():
    found = section_properties(bar(airfoil()), material=LAW, density=1.0)
    shear = found.about(found.shear_centre).compliance
    assert np.abs(shear[3, 1:3]).max() < 1e-12 * np.sqrt(shear[3, 3] * shear[1, 1])
    tension = found.about(found.tension_centre).compliance
    assert np.abs(tension[0, 4:]).max() < 1e-9 * np.sqrt(tension[0, 0] * tension[4, 4])
    # Of one material that is the centroid.
    assert np.abs(found.tension_centre).max() < 1e-9
    assert np.abs(found.mass_centre).max() < 1e-9
    # A symmetric section's is on its axis, an airfoil's ahead of the centroid (its nose is to -x).
    symmetric = section_properties(bar(naca("0012", 24)), material=LAW)
    assert symmetric.shear_centre[0] * symmetric.frame[1, 0] < -0.01
    assert abs(symmetric.shear_centre[1]) < 1e-9
    principal = found.about(angle=found.principal_angle).compliance
    assert abs(principal[4, 5]) < 1e-9 * principal[4, 4]
    assert found.EI[0] < found.EI[1]


def test_layers_of_several_densities():
    """They are symmetric, and so are the centres; the mass counts each ring's density."""
    outline = ellipse(8, 1.0, 0.7)
    laws, densities = [LAW, LAW], [1.0, 5.0]
    found = section_properties(bar(outline, [0, 0.5, 1]), material=laws, density=densities)
    for centre in (found.shear_centre, found.tension_centre, found.mass_centre):
        assert np.abs(centre).max() < 1e-9
    area = np.pi * 0.7
    assert found.mass[0, 0] == pytest.approx(area * (0.25 * 1.0 + 0.75 * 5.0), rel=1e-12)
    assert found.mass[5, 5] == pytest.approx(area / 4 * (0.0625 * 1.0 + 0.9375 * 5.0), rel=1e-12)


def test_a_hollow_airfoil_is_right_without_a_warning(recwarn):
    found = section_properties(bar(airfoil(), [0.6, 1]), material=LAW)
    assert "waves" in found.functions
    assert 0.0 < found.error < 5e-3
    assert not recwarn.list


def test_many_layers_have_fewer_functions_each():
    """Polynomials of degree 8 along the radius in each of seven rings would be too many."""
    laws = [LinearElastic(one, NU) for one in (1.0, 2.0, 3.0, 2.0, 1.0, 2.0, 3.0)]
    found = section_properties(bar(ellipse(8, 1.0, 0.9), np.arange(8) / 7), material=laws)
    assert found.functions == "polynomials of degree 8, 8 waves of degree 4"
    assert found.error < 5e-3


def test_what_is_too_sharp_is_warned_of():
    """A flat strip with a hole along it."""
    with pytest.warns(
        UserWarning, match=r"^section at u = 0: the stiffness is uncertain by \S+ %, by which the energy"
    ):
        found = section_properties(bar(rounded_rectangle(16, 1.0, 0.02, 0.005), [0.9, 1]), material=LAW)
    assert found.error > 5e-3


ROD = bar(circle(6))
BODY = Body(Space(ROD, section_degree=3), LAW)


def crooked():
    points = ROD.control_points.copy()
    points[:, ::2, 2] += 0.2
    return Body(Space.paper(isorod.Rod(ROD.axis, points)), LAW)


def folded():
    outline = circle(8)
    outline[0] *= -0.9
    return Body(Space.paper(bar(outline)), LAW)


test_bad_input = refused(
    (lambda: section_properties(ROD), "a Rod needs material="),
    (lambda: section_properties(BODY, material=LAW), "a body has its own material and density"),
    (lambda: section_properties(BODY, density=1.0), "a body has its own material and density"),
    (lambda: section_properties(Space(ROD)), "section properties: got Space, need a Body or a Rod"),
    (lambda: section_properties(BODY, 1.5), "axis parameter u: got 1.5, need numbers from 0 to 1"),
    (lambda: section_properties(BODY, "middle"), "axis parameter u: got 'middle'"),
    (lambda: section_properties(BODY, [0.0, 1.0]), "axis parameter u: got 2 of them, need one"),
    (lambda: section_properties(ROD, material=LinearElastic(1.0, 0.5)), "incompressible law"),
    (lambda: section_properties(BODY).about((1.0,)), "point: got"),
    (lambda: section_properties(BODY).about((0.0, np.nan)), "point: got"),
    (lambda: section_properties(BODY).about(angle=np.inf), "angle: got inf, need degrees"),
    (lambda: section_properties(crooked()), "off its plane"),
    (lambda: section_properties(folded()), "the section folds at disk point"),
)


def test_words():
    found = section_properties(BODY)
    assert isinstance(found, SectionProperties)
    assert repr(found).startswith("SectionProperties(EA 659.734, GA ")
