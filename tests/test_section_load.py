"""A force spread over a section whose points lie closer in some places than in others: uniform in area all the same."""

import numpy as np
import pytest

from isorod import Axis, Rod, SectionLoad, Space, airfoil, ellipse, flower, naca
from isorod.tensors import rotation

FORCE = np.array([0.3, -0.7, 1.1])
SECTIONS = {
    "airfoil": airfoil(),
    "cambered airfoil": naca("4412", 12),
    "flower off the axis": flower(12, 1, depth=0.3) + np.array([0.4, -0.2]),
    "ellipse": ellipse(6, 2.0, 0.5),
}


def swept(section, **keywords):
    """A rod that tapers and twists."""
    axis = Axis(2, np.repeat([0.0, 1.0], 3), np.ones(3))
    turns = [rotation((0.0, 0.0, angle)) for angle in (0.0, 0.2, 0.4)]
    stretches = np.array([1.0, 0.8, 0.6])[:, None, None] * np.eye(3)
    centers = np.outer([0.0, 2.0, 4.0], [0.1, 0.2, 1.0])
    return Space.paper(Rod.sweep(section, axis, centers, turns, stretches), quadrature="16x12x3", **keywords)


def outline_integrals(space, u):
    """Area, first and second moments ``(2,)``, ``(2, 2)`` of a plane section by Green's theorem, from its outline."""
    angle = 2.0 * np.pi * np.arange(20000) / 20000
    points, _ = space.rod.grid(np.stack([np.cos(angle), np.sin(angle)], axis=1), [u])
    points = points[0, :, :2]
    after = np.roll(points, -1, axis=0)
    cross = points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0]
    first = ((points + after) * cross[:, None]).sum(axis=0) / 6.0
    pairs = [(points, points), (after, after), (points + after, points + after)]
    second = sum(np.einsum("ia,ib,i->ab", a, b, cross) for a, b in pairs) / 24.0
    return 0.5 * cross.sum(), first, second


@pytest.mark.parametrize("name", SECTIONS)
@pytest.mark.parametrize("space", [{"order": 1}, {"order": 2}, {"section_degree": 3}], ids=str)
@pytest.mark.parametrize("u", [0.0, 1.0])
def test_resultant_acts_at_the_centroid_of_the_outline(name, space, u):
    """Work on translations and turns: force and moment of a uniform traction, whatever the section's functions."""
    space = swept(SECTIONS[name], **space)
    nodal = SectionLoad(tuple(FORCE), u=u).nodal(space)
    area, first, _ = outline_integrals(space, u)
    height = space.rod.points([[0.0, 0.0]], [u])[0, 2]
    centroid = np.array([*(first / area), height])
    assert nodal[space.is_control_point].sum(axis=0) == pytest.approx(FORCE, rel=1e-12)
    moment = np.cross(space.positions, nodal).sum(axis=0)
    assert moment == pytest.approx(np.cross(centroid, FORCE), abs=1e-7)


@pytest.mark.parametrize("name", SECTIONS)
def test_work_on_a_field_that_is_quadratic_in_the_section(name):
    """With section polynomials of degree 2 or more, the mean of ``x_a x_b`` over the section is exact."""
    space = swept(SECTIONS[name], section_degree=3)
    nodal = SectionLoad((0.0, 0.0, 1.0), u=0.0).nodal(space).reshape(space.layers, -1, 3)[0, :, 2]
    area, _, second = outline_integrals(space, 0.0)
    angle, radius = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, 200), np.random.default_rng(1).uniform(0, 1, 200)
    xi = (np.sqrt(radius) * np.array([np.cos(angle), np.sin(angle)])).T
    points = space.rod.grid(xi, [0.0])[0][0]
    functions = space.basis.functions(xi)[0]
    for a, b in ((0, 0), (0, 1), (1, 1)):
        coefficients, *_ = np.linalg.lstsq(functions, points[:, a] * points[:, b], rcond=None)
        assert functions @ coefficients == pytest.approx(points[:, a] * points[:, b], abs=1e-9)
        assert coefficients @ nodal == pytest.approx(second[a, b] / area, abs=1e-7)
