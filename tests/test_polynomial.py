"""Polynomials of the section's coordinates as section functions."""

from itertools import pairwise

import numpy as np
import pytest
from disks import disk_points
from reference import BLADE_FREQUENCIES, SPRING_FORCE
from refused import refused

from isorod import Rod, Space, ellipse, modal, statics, straight
from isorod.geometry.quadrature import Rule, section_points
from isorod.scenes.blade import Blade
from isorod.scenes.flower import Flower
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring
from isorod.space.polynomial import MAX_DEGREE, Polynomials
from isorod.tensors import determinant

RODS = {"blade": Blade().rod(), "spring": Spring(helix="paper", coils=1).rod(), "ring": Ring().rod()}

BLADE = np.array(BLADE_FREQUENCIES)


def prism(a, b, n=8):
    return straight(1.0).sweep(ellipse(n, a, b))


@pytest.mark.parametrize("name", RODS)
@pytest.mark.parametrize("degree", [1, 3, MAX_DEGREE])
def test_the_first_is_one_and_all_are_orthogonal(name, degree):
    rod = RODS[name]
    xi, area = section_points(rod.section_points, Rule(14, 24, 1))
    values, _ = Polynomials(rod, degree).functions(xi)
    # Sections are affine images of each other: any one's measure is the first's up to a factor.
    _, jacobian = rod.grid(xi, [0.3])
    inside = np.linalg.norm(np.cross(jacobian[0, :, :, 0], jacobian[0, :, :, 1]), axis=1)
    weights = area * inside / (area @ inside)
    assert values[:, 0] == pytest.approx(1.0, abs=1e-12)
    assert np.abs((values * weights[:, None]).T @ values - np.eye(values.shape[1])).max() < 1e-3


def test_gradients_are_those_of_the_values():
    functions, xi, h = Polynomials(RODS["blade"], 6), disk_points(0.98, 30), 1e-6
    _, gradients = functions.functions(xi)
    for b, step in enumerate(h * np.eye(2)):
        slope = (functions.functions(xi + step)[0] - functions.functions(xi - step)[0]) / (2 * h)
        assert np.abs(slope - gradients[:, :, b]).max() < 1e-7 * np.abs(gradients).max()


@pytest.mark.parametrize("name", RODS)
def test_positions_are_the_rod_itself(name):
    rod = RODS[name]
    space = Space.paper(rod, 2 * rod.axis.elements, 3, section_degree=3)
    xi, u = disk_points(0.98, 20), np.linspace(rod.axis.breaks[0], rod.axis.breaks[-1], 9)
    values, _ = space.basis.functions(xi)
    first, axial, _ = space.axis.local(u)
    layers = (first[:, None] + np.arange(space.axis.degree + 1)) % space.layers
    nodal = space.positions.reshape(space.layers, space.layer_nodes, 3)
    placed = values @ np.einsum("tj,tjia->tia", axial, nodal[layers])
    assert placed == pytest.approx(rod.grid(xi, u)[0], abs=1e-12 * np.abs(rod.control_points).max())


@pytest.mark.parametrize(
    ("a", "b", "degree", "expected"),
    [(1.0, 1.0, 3, 10), (1.0, 1.0, 5, 21), (1.0, 0.2, 3, 9), (1.0, 0.2, 4, 12), (0.2, 1.0, 4, 12), (1.0, 0.2, 5, 18)],
)
def test_a_thin_section_takes_fewer_across_its_thickness(a, b, degree, expected):
    assert Polynomials(prism(a, b), degree).count == expected


@pytest.mark.parametrize("a, b", [(1.0, 1.0), (1.0, 0.5), (1.0, 0.3)])
def test_torsion_constant_of_an_ellipse_is_exact(a, b):
    """The warping of an ellipse is x y."""
    from test_exactness import torsion_constant

    exact = np.pi * a**3 * b**3 / (a**2 + b**2)
    assert torsion_constant(Space.paper(prism(a, b), quadrature="8x4", section_degree=2)) == pytest.approx(
        exact, rel=1e-10
    )
    stiff = torsion_constant(Space.paper(prism(a, b), quadrature="8x4", section_degree=1))
    assert stiff == pytest.approx(np.pi * a * b * (a**2 + b**2) / 4, rel=1e-10)


@pytest.mark.parametrize(
    ("degree", "rule", "elements", "unknowns", "bound"),
    [
        (3, "3x1x5", 2, 243, 3.6e-3),
        (3, "3x1x5", 6, 567, 4.3e-3),
        (4, "4x2x5", 2, 324, 1.7e-3),
        (5, "4x2x5", 3, 648, 4e-4),
    ],
)
def test_blade_on_half_smooth_axes(degree, rule, elements, unknowns, bound):
    """C3 knots, degree 6, 5 points along an element: what the section leaves, on two elements, no hourglass modes."""
    scene = Blade(preset="paper", section_degree=degree, degree=6, continuity=3, elements=elements, quadrature=rule)
    found = modal.solve(scene.model())
    assert found.model.unknowns == unknowns
    assert np.abs(found.frequencies / BLADE - 1.0).max() < bound


def test_blade_converges_with_the_degree():
    """By Rayleigh's principle each frequency falls when the degree grows, and none falls below the 3-D value."""
    found = [
        modal.solve(
            Blade(preset="paper", section_degree=degree, degree=4, elements=12, quadrature="full").model()
        ).frequencies
        for degree in (2, 3, 4, 5)
    ]
    for coarse, fine in pairwise(found):
        assert (fine <= coarse * (1.0 + 1e-9)).all()
    errors = [np.abs(f / BLADE - 1.0).max() for f in found]
    assert errors[0] > 0.05
    assert errors[-1] < 3e-3
    assert (found[-1] > BLADE * (1.0 - 2e-4)).all()


def test_spring_agrees_with_control_points():
    """Both converge to the same three-dimensional solution: 6.0992 with K = 2, n = 8 and 16 elements a turn."""
    scene = Spring(preset="paper", section_degree=3, degree=4, elements_per_turn=8)
    force = statics.solve(scene.model()).reactions[1, 2]
    assert force == pytest.approx(SPRING_FORCE, rel=3e-4)


def test_a_concave_section_is_no_matter():
    rod = Flower().rod()
    xi, area = section_points(rod.section_points, Rule(8, 6, 1))
    values, gradients = Polynomials(rod, 4).functions(xi)
    assert np.isfinite(values).all()
    assert np.isfinite(gradients).all()
    assert determinant(rod.grid(xi, [0.5])[1]).shape == (1, area.size)


def sheared():
    """A blade of which one control point is not where the other sections have it."""
    points = RODS["blade"].control_points.copy()
    points[2, 3] += [0.0, 0.01, 0.0]
    return Rod(RODS["blade"].axis, points)


def sized(*sizes):
    rod = prism(1.0, 1.0, 4)
    return Polynomials(Rod(rod.axis, rod.control_points * [*sizes, 1.0]), 2)


test_refuses_what_has_no_polynomials = refused(
    *(
        (lambda n=n: Polynomials(RODS["blade"], n), "section degree: got .*, need an integer from 1 to 8")
        for n in (0, -1, MAX_DEGREE + 1, 2.5, float("nan"))
    ),
    (lambda: Polynomials(sheared(), 2), "section degree: layer 2 .* is not an affine image"),
    *(
        (
            lambda other=other: Space.paper(RODS["blade"], section_degree=2, **other).layer_nodes,
            "section degree: polynomials take the place of order and section points",
        )
        for other in ({"order": 2}, {"section_points": 32})
    ),
    (lambda: sized(1e300, 1.0), "section's extent: got"),
    (lambda: sized(1.0, 1e-300), "sections have no area"),
    (lambda: sized(5e-324, 5e-324), "extent"),
)
