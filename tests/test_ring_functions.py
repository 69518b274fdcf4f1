"""Functions of sections with a hole or in layers, and the quadrature rules that are to see them."""

import numpy as np
import pytest
from scipy.linalg import eigh

from isorod import Space, circle, naca, straight
from isorod.geometry.disk import harmonic_functions


def prism(rings, section=None):
    return straight(3.0).sweep(circle(8) if section is None else section).with_rings(rings)


def energies(space, rule):
    """Products of the functions' gradients by the section's own coordinates over it, all but of the constant."""
    xi, area = space.section_rule(rule)
    turn = np.einsum("qib,ia->qab", harmonic_functions(space.rod.section_points, xi)[1], space.basis.polygon)
    gradients = space.basis.functions(xi)[1] @ np.linalg.inv(turn)
    rows = np.sqrt(area * np.abs(np.linalg.det(turn)))[:, None, None] * gradients
    rows = rows.swapaxes(1, 2).reshape(-1, space.basis.count)[:, 1:]
    return rows.T @ rows


RODS = [
    *(prism((hole, 1.0)) for hole in (0.3, 0.6, 0.85, 0.97)),
    prism((0.6, 1.0), naca("2412")),
    prism((0.0, 0.6, 1.0)),
]


@pytest.mark.parametrize("section_degree", [3, 6, 8])
@pytest.mark.parametrize("rod", RODS)
def test_the_cheap_rule_sees_every_function(rod, section_degree):
    """It has most of the energy of gradients that a fine one has, whatever the function; two points less have not.

    What varies most across a ring has none then, and stresses are off by 4 %.
    """
    space = Space(rod, section_degree=section_degree, elements=1)
    cheap, fine = space.basis.auto(3), space.basis.full(3)
    seen = eigh(energies(space, cheap), energies(space, fine), eigvals_only=True)
    assert 0.7 < seen.min() and seen.max() < 1.1


@pytest.mark.parametrize(("hole", "degree", "lowest"), [(0.9, 2, -4), (0.5, 3, -8), (0.2, 4, -8), (0.05, 1, -4)])
def test_the_fine_rule_has_the_radial_points_that_products_of_powers_need(hole, degree, lowest):
    """Of the radius: the highest and the lowest there are, integrated to 1e-12; no more than one point apart."""

    def error(count, power):
        place, weight = np.polynomial.legendre.leggauss(count)
        exact = (1.0 - hole ** (power + 1)) / (power + 1)
        return abs(0.5 * (1.0 - hole) * weight @ (0.5 * (1.0 + hole + (1.0 - hole) * place)) ** power / exact - 1.0)

    space = Space(prism((hole, 1.0)), section_degree=degree, elements=1)
    needed = next(n for n in range(1, 65) if max(error(n, 2 * degree), error(n, lowest)) < 1e-12)
    assert abs(space.basis.full(3).radial - needed) <= 1


@pytest.mark.parametrize("rod", RODS)
def test_gradients_are_orthonormal_and_the_first_functions_linear(rod):
    """By another rule than the one that made them so, 1e-12 off, times 1e5 a factor where functions hardly differ."""
    space = Space(rod, section_degree=6, elements=1)
    found = energies(space, space.basis.full(3))
    assert found == pytest.approx(found[0, 0] * np.eye(len(found)), abs=1e-2 * found[0, 0])
    assert np.abs(space.basis.functions([[0.9, 0.1], [0.1, 0.98]])[0][:, 0]) == pytest.approx(1.0, abs=1e-14)
