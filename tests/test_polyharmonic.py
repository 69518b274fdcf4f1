"""The polyharmonic functions of the section: what determines them, and rules that see them."""

import numpy as np
import pytest
from disks import derivative, disk_points

from isorod import InputError, Space
from isorod.geometry.disk import harmonic_functions
from isorod.geometry.quadrature import Rule, section_points
from isorod.space.polyharmonic import Polyharmonic

ORDERS = [1, 2, 3, 4, 6]
COUNTS = [3, 4, 8, 16]


# Central differences of order 8: weights of f(x + k h) - f(x - k h), k = 1 .. 4.
def circle_points(n):
    """Points of the circle, joints and centres of the arcs among them."""
    t = np.concatenate([np.pi / n * np.arange(2 * n), np.linspace(0, 6, 40)])
    return np.stack([np.cos(t), np.sin(t)], axis=1)


def distance(space, of):
    """Largest distance of the columns of ``of`` from the span of the columns of ``space``."""
    return np.abs(space @ np.linalg.lstsq(space, of, rcond=None)[0] - of).max()


@pytest.mark.parametrize("n", COUNTS)
def test_order_1_is_the_harmonic_functions_to_the_bit(n):
    points = np.concatenate([disk_points(1.0), circle_points(n)])
    for own, harmonic in zip(Polyharmonic(n, 1).functions(points), harmonic_functions(n, points), strict=True):
        assert np.array_equal(own, harmonic)


@pytest.mark.parametrize("order", ORDERS)
def test_a_lower_order_is_the_beginning_of_a_higher_one(order):
    points = disk_points(1.0)
    lower, higher = (Polyharmonic(5, k).functions(points) for k in (order, 6))
    for low, high in zip(lower, higher, strict=True):
        assert np.array_equal(low, high[:, : order * 5])


@pytest.mark.parametrize("n", COUNTS)
@pytest.mark.parametrize("order", ORDERS)
def test_only_order_0_acts_on_the_circle(n, order):
    points = circle_points(n)
    values, gradients = Polyharmonic(n, order).functions(points)
    assert np.array_equal(values[:, :n], harmonic_functions(n, points)[0])
    scale = np.abs(gradients).max()
    assert np.abs(values[:, n:]).max(initial=0.0) < 1e-14 * scale
    # nor does the derivative along the circle, while the one across it does not vanish
    across = np.einsum("qib,qb->qi", gradients, points)[:, n:].reshape(len(points), order - 1, n)
    along = gradients[:, n:] @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert np.abs(np.einsum("qib,qb->qi", along, points)).max(initial=0.0) < 1e-14 * scale
    assert np.all(np.linalg.norm(across, axis=2) > 0.1)


@pytest.mark.parametrize("n", COUNTS)
@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_gradient_is_the_derivative_of_the_value(n, turn):
    points = np.concatenate([disk_points(0.8), [[0.0, 0.0], [0.25, 0.0], [0.0, -0.25]]])
    basis = Polyharmonic(n, 4, turn)
    _, gradients = basis.functions(points)
    for a, direction in enumerate(np.eye(2)):
        difference = derivative(lambda x: basis.functions(x)[0], points, direction, 2e-3)
        assert np.abs(difference - gradients[:, :, a]).max() < 1e-10 * np.abs(gradients).max()


@pytest.mark.parametrize("n", COUNTS)
@pytest.mark.parametrize("order", ORDERS)
def test_spans_what_powers_of_the_distance_to_the_circle_do(n, order):
    """They are all polyharmonic functions (Almansi's theorem)."""
    points = disk_points(1.0, 20 * n)
    harmonic, _ = harmonic_functions(n, points)
    gap = 1 - np.sum(points**2, axis=1)[:, None]
    powers = np.concatenate([gap**k * harmonic for k in range(order)], axis=1)
    own, _ = Polyharmonic(n, order).functions(points)
    assert distance(own, powers) < 1e-13
    assert distance(powers, own) < 1e-12
    assert np.linalg.matrix_rank(own) == order * n
    if order > 1:
        assert distance(own[:, : (order - 1) * n], powers) > 1e-4


@pytest.mark.parametrize("n", COUNTS)
def test_gradients_of_the_radially_symmetric_functions_are_orthogonal(n):
    """The mean of the functions of one order over a turn of the disk is a multiple of a function of the radius."""
    s, w = np.polynomial.legendre.leggauss(12)
    r, angle = 0.5 * (s + 1), 2 * np.pi * np.arange(8 * n) / (8 * n)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    _, gradients = Polyharmonic(n, 6).functions((r[:, None, None] * normal).reshape(-1, 2))
    slopes = np.einsum("rtib,tb->ri", gradients.reshape(r.size, angle.size, 6 * n, 2), normal) / angle.size
    assert np.abs(slopes[:, :n]).max() < 1e-13
    blocks = slopes[:, n:].reshape(-1, 5, n)
    profiles = np.einsum("rki,ki->kr", blocks, blocks[-1])
    for k in range(5):
        assert np.linalg.matrix_rank(blocks[:, k], tol=1e-12 * np.abs(blocks[:, k]).max()) == 1
    gram = np.einsum("r,kr,mr->km", r * w, profiles, profiles)
    scale = np.sqrt(np.diag(gram))
    assert np.abs(gram / np.outer(scale, scale) - np.eye(5)).max() < 1e-12


@pytest.mark.parametrize("n", COUNTS)
@pytest.mark.parametrize("turn", [0.3, -1.1])
def test_turned_functions_are_the_functions_at_points_turned_back(n, turn):
    points = disk_points(1.0)
    c, s = np.cos(turn), np.sin(turn)
    matrix = np.array([[c, -s], [s, c]])
    values, gradients = Polyharmonic(n, 3).functions(points)
    turned_values, turned_gradients = Polyharmonic(n, 3, turn).functions(points @ matrix.T)
    assert np.abs(turned_values - values).max() < 1e-13
    assert np.abs(turned_gradients - gradients @ matrix.T).max() < 1e-12


@pytest.mark.parametrize("order", [0, -1, 7, 2.5, np.nan, np.inf])
def test_refuses_an_order_that_cannot_be(order, cylinder):
    with pytest.raises(InputError, match=rf"^polyharmonic order: got {order}, need an integer from 1 to 6$"):
        Polyharmonic(4, order).functions([[0.0, 0.0]])
    with pytest.raises(InputError, match=rf"order: got {order}, need an integer"):
        _ = Space.paper(cylinder(4), order=order).nodes


@pytest.mark.parametrize("order, n", [(1, 48), (2, 48), (2, 64), pytest.param(2, 96, marks=pytest.mark.slow), (1, 128)])
def test_rules_see_functions_that_live_near_the_circle(order, n):
    """Of the energy of one of 48 functions five radial points miss a ninth, of one of 96 six a quarter."""
    basis = Polyharmonic(n, order)
    energies = []
    for rule in (basis.auto(3), basis.full(3), Rule(24, 4, 4)):
        xi, weights = section_points(n, rule)
        energies.append(weights @ (basis.functions(xi)[1][:, 0] ** 2).sum(axis=1))
    assert energies[0] == pytest.approx(energies[2], rel=0.045)
    assert abs(energies[1] - energies[2]) < 0.6 * abs(energies[0] - energies[2])
