"""The harmonic functions of the disk, against properties that determine them and against direct Poisson integrals."""

import numpy as np
import pytest
from disks import derivative, disk_points
from hypothesis import given
from hypothesis import strategies as st
from refused import refused

from isorod.geometry.disk import boundary_functions, control_points, harmonic_functions

COUNTS = [3, 4, 5, 8, 16, 40]


# Central differences of order 8: weights of f(x + k h) - f(x - k h), k = 1 .. 4.
def circle_points(theta):
    return np.stack([np.cos(theta), np.sin(theta)], axis=-1)


def joints(n):
    return np.pi / n * (2 * np.arange(n) + 1)


def special_points(n):
    """Origin, tiny radii, both sides of the switch of series, arc centres, joints, and points next to joints."""
    angles = np.concatenate([joints(n), joints(n) + 1e-9, 2 * np.pi * np.arange(n) / n, [0.1, 1.0, 4.0]])
    radii = np.array([0.0, 1e-300, 1e-16, 1e-8, 0.25 - 1e-12, 0.25, 0.25 + 1e-12, 0.9, 1 - 1e-9, 1 - 1e-15, 1.0])
    return (radii[:, None, None] * circle_points(angles)).reshape(-1, 2)


def assert_reproduces_linear_functions(n, points):
    values, gradients = harmonic_functions(n, points)
    q = control_points(n)
    assert np.abs(values.sum(axis=1) - 1).max() < 1e-13
    assert np.abs(values @ q - points).max() < 1e-13
    assert np.abs(gradients.sum(axis=1)).max() < 1e-12
    assert np.abs(np.einsum("qib,ia->qab", gradients, q) - np.eye(2)).max() < 1e-12


@given(n=st.integers(3, 40), r=st.floats(0, 1), theta=st.floats(0, 2 * np.pi))
def test_partition_of_unity_and_linear_completeness_anywhere(n, r, theta):
    assert_reproduces_linear_functions(n, r * circle_points(np.array([theta])))


@pytest.mark.parametrize("n", COUNTS)
def test_partition_of_unity_and_linear_completeness_at_special_points(n):
    assert_reproduces_linear_functions(n, special_points(n))


@pytest.mark.parametrize("n", COUNTS)
def test_equals_the_poisson_integral_and_its_gradient(n):
    points = np.concatenate([disk_points(0.9), [[0.0, 0.0], [0.9, 0.0], [0.0, -0.9]]])
    # Gauss on short pieces of the arcs, whose ends are joints.
    pieces = n * int(np.ceil(60 / n))
    s, w = np.polynomial.legendre.leggauss(24)
    edges = np.pi / n + 2 * np.pi * np.arange(pieces) / pieces
    theta = (edges[:, None] + np.pi / pieces * (s + 1)).ravel()
    phi = boundary_functions(n, theta) * np.tile(np.pi / pieces * w, pieces)[:, None]
    offset = points[:, None, :] - circle_points(theta)
    square = np.sum(offset**2, axis=2)
    inside = 1 - np.sum(points**2, axis=1)[:, None]
    kernel = inside / square / (2 * np.pi)
    slope = (-2 * points[:, None, :] / square[..., None] - 2 * (inside / square**2)[..., None] * offset) / (2 * np.pi)
    values, gradients = harmonic_functions(n, points)
    assert np.abs(values - kernel @ phi).max() < 1e-13
    assert np.abs(gradients - np.einsum("qtb,ti->qib", slope, phi)).max() < 1e-11


def test_many_points_at_once_have_the_values_of_each():
    """More values than are computed at once."""
    points = np.sqrt(np.linspace(0.0, 1.0, 1500))[:, None] * circle_points(np.linspace(0.0, 100.0, 1500))
    every = harmonic_functions(500, points)
    few = harmonic_functions(500, points[::37])
    for one, other in zip(every, few, strict=True):
        np.testing.assert_allclose(one[::37], other, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("n", COUNTS)
def test_harmonic_functions_are_the_boundary_functions_on_the_circle(n):
    theta = np.concatenate([np.linspace(-7, 7, 301), joints(n), joints(n) + 1e-10, 2 * np.pi * np.arange(n) / n])
    values, gradients = harmonic_functions(n, circle_points(theta))
    assert np.abs(values - boundary_functions(n, theta)).max() < 1e-13
    # and so is the tangential derivative, away from joints, where differences see both arcs
    theta = theta[np.abs((theta * n / np.pi + 1 + 1) % 2 - 1) > 0.3]
    values, gradients = harmonic_functions(n, circle_points(theta))
    tangential = np.einsum("qib,qb->qi", gradients, circle_points(theta + np.pi / 2))
    difference = derivative(lambda x: boundary_functions(n, x), theta, 1.0, 0.02 / n)
    assert np.abs(tangential - difference).max() < 1e-10


@pytest.mark.parametrize("n", COUNTS)
def test_values_and_gradients_are_continuous_up_to_the_circle(n):
    theta = np.concatenate([np.linspace(0, 6, 50), joints(n)])
    outer = harmonic_functions(n, circle_points(theta))
    inner = harmonic_functions(n, (1 - 1e-9) * circle_points(theta))
    assert np.abs(outer[0] - inner[0]).max() < 1e-8 * n
    assert np.abs(outer[1] - inner[1]).max() < 1e-7 * n**2


@pytest.mark.parametrize("n", COUNTS)
def test_boundary_functions_are_the_rational_bezier_arcs(n):
    """Barycentric coordinates of a point of arc i in its control triangle (J_{i-1}, Q_i, J_i), joints eliminated."""
    q = control_points(n)
    joint = 0.5 * (q + np.roll(q, -1, axis=0))
    local = np.linspace(-0.999, 0.999, 13) * np.pi / n
    for i in range(n):
        theta = 2 * np.pi * i / n + local
        triangle = np.stack([joint[i - 1], q[i], joint[i]])
        system = np.concatenate([triangle.T, np.ones((1, 3))])
        before, middle, after = np.linalg.solve(system, np.concatenate([circle_points(theta).T, np.ones((1, 13))]))
        expected = np.zeros((13, n))
        for k, share in ((i - 1, before / 2), (i, before / 2 + middle + after / 2), ((i + 1) % n, after / 2)):
            expected[:, k] += share
        assert np.abs(boundary_functions(n, theta) - expected).max() < 1e-12


@pytest.mark.parametrize("n", [4, 5, 8, 16])
def test_halving_every_arc_nests_the_spaces(n):
    theta = np.linspace(0, 2 * np.pi, 20 * n)
    coarse = boundary_functions(n, theta)

    def distance(fine):
        return np.abs(fine @ np.linalg.lstsq(fine, coarse, rcond=None)[0] - coarse).max()

    assert distance(boundary_functions(2 * n, theta - np.pi / (2 * n))) < 1e-13
    assert distance(boundary_functions(2 * n, theta)) > 1e-3


COUNTED = [lambda n: harmonic_functions(n, [[0.0, 0.0]]), lambda n: boundary_functions(n, [0.0]), control_points]
test_refuses_a_number_of_points_that_cannot_be = refused(
    *(
        (function, n, f"section control points: got {n}, need an integer")
        for function in COUNTED
        for n in (2, 0, -4, 3.5, np.nan, np.inf)
    ),
    by=lambda function, n: function(n),
)
test_refuses_a_point_that_is_not_in_the_disk = refused(
    *((point, "not in the unit disk") for point in ([1.0, 1e-5], [np.nan, 0.0], [0.0, np.inf], [-2.0, 0.0])),
    by=lambda point: harmonic_functions(5, [[0.0, 0.0], point]),
)
