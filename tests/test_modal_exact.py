"""Vibration modes against exact solutions of bars, waves and rings."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial import Legendre
from scipy.linalg import block_diag, eigh
from scipy.optimize import brentq
from vibrations import RHO, SPEED, E, bars, bending, clamped, rates, sliding, stretching

from isorod import Body, LinearElastic, Model, SolveError, Space, modal
from isorod.scenes.ring import Ring


@pytest.fixture
def bar(cylinder):
    """A circular bar along z."""
    return bars(cylinder)


# Free-free and cantilever: solutions of cos x cosh x = +1 and -1.
FREE_FREE = [4.7300407, 7.8532046, 10.9956078]
CANTILEVER = [1.8751041, 4.6940911, 7.8547574, 10.9955407]


def test_beta_l_of_the_beams_is_what_their_equations_say():
    for values, sign in ((FREE_FREE, 1.0), (CANTILEVER, -1.0)):
        for value in values:
            exact = brentq(lambda x, sign=sign: np.cos(x) - sign / np.cosh(x), value - 0.1, value + 0.1, xtol=1e-13)
            assert value == pytest.approx(exact, abs=6e-8)


def timoshenko(slenderness, free, count=40):
    """Return the angular frequencies of a bar of radius 1 with nu = 0 by Timoshenko's theory with shear coefficient 1.

    Ritz with polynomials, converged to rounding.  It is what the element of order 1 is made of: without Poisson's
    ratio, plane sections that move and tilt as wholes do not couple with anything else there.
    """
    x, w = np.polynomial.legendre.leggauss(count + 10)
    x, w = 0.5 * (x + 1.0), 0.5 * w * slenderness
    basis = [Legendre.basis(j, domain=[0, 1]) for j in range(count)]
    value, slope = np.array([f(x) for f in basis]), np.array([f.deriv()(x) for f in basis]) / slenderness
    if not free:
        value, slope = value * x, slope * x + value / slenderness
    area, inertia, shear = np.pi, np.pi / 4, E / 2

    def integral(a, b):
        return (a * w) @ b.T

    corner = area * shear * integral(slope, value)
    stiffness = np.block(
        [
            [area * shear * integral(slope, slope), corner],
            [corner.T, E * inertia * integral(slope, slope) + area * shear * integral(value, value)],
        ]
    )
    mass = RHO * block_diag(area * integral(value, value), inertia * integral(value, value))
    return np.sqrt(eigh(stiffness, mass, eigvals_only=True)[2 * free :])


@pytest.mark.parametrize("free", [True, False], ids=["free", "clamped"])
@pytest.mark.parametrize("slenderness", [10.0, 40.0])
def test_bending_without_poisson_is_timoshenkos(slenderness, free, bar):
    """Three modes to the error of the axis, C (k h)^2p with p = 5."""
    model = bar(slenderness, clamped if not free else lambda space: [], nu=0.0, degree=5, elements=16)
    found = bending(modal.solve(model, 12))[:3]
    deviation = found / timoshenko(slenderness, free)[:3] - 1.0
    print(deviation)
    assert np.abs(deviation).max() < 5e-8
    assert np.abs(deviation[0]) < 1e-9


def test_what_rounding_leaves_of_a_very_slender_bars_residuals_is_no_reason_to_refuse(bar):
    """Nor is what it makes of the frequencies; where one rounding of each entry may make 1e-4, modes are refused."""
    slender = bar(1000.0, clamped, nu=0.0, degree=3, elements=60)
    modes = modal.solve(slender, 6)
    found = 1000.0**2 * rates(modes) / (SPEED * 0.5) / np.repeat(CANTILEVER[:3], 2) ** 2 - 1.0
    assert modes.residuals.max() > 2e-5
    # One rounding of each entry may take 2e-4 of an eigenvalue, half of that of a frequency (`pencil._LOST`).  An entry
    # is a sum over the points of a section, the same one in all elements: roundings of its terms are a random walk.
    space = slender.bodies[0].space
    points = space.section_rule(space.rule)[1].size
    assert np.abs(found).max() < 1e-4 * np.sqrt(points)
    with pytest.raises(SolveError, match="too large for double precision"):
        modal.solve(bar(10_000.0, clamped, nu=0.0, degree=3, elements=60), 6)


def test_poissons_ratio_leaves_the_slender_limit_as_the_section_is_refined(bar):
    """The anticlastic field x^2 - y^2 is harmonic but not among the functions of n points: its error falls with n."""
    stiff = []
    for n in (4, 8, 16, 32):
        modes = modal.solve(bar(200.0, section_points=n, degree=5, elements=6), 2)
        stiff.append((200.0**2 * rates(modes)[0] / (SPEED * 0.5) / FREE_FREE[0] ** 2) ** 2 - 1.0)
    print(stiff)
    # Shear and rotary inertia, (beta R)^2, are left.
    assert -6e-4 < stiff[-1] < 0
    assert stiff[0] > 0.1
    assert all(b - stiff[-1] < 0.05 * (a - stiff[-1]) for a, b in pairwise(stiff[:-1]))


# Pochhammer and Chree: c / sqrt(E / rho) of longitudinal waves in a circular rod of radius 1, nu = 0.3, by k R.
LONGITUDINAL = {0.1: 0.9997746423, 0.5: 0.9941452085, 1.0: 0.9735264429}


def mindlin_herrmann(k, nu=0.3):
    """Return the speed if sections stay plane and widen in proportion to the radius: the element of order 1."""
    shear, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    stiffness = [[4 * (lame + shear) + shear * k * k / 2, 2 * lame * k], [2 * lame * k, (lame + 2 * shear) * k * k]]
    return np.sqrt(eigh(stiffness, RHO * np.diag([0.5, 1.0]), eigvals_only=True)[0]) / k / SPEED


# Order of the element, and its gap to the exact speed at each k R: 1e-10 is the precision of the reference.
GAPS = {1: (8.7e-5, 2.38e-3, 1.242e-2), 2: (2e-10, 6e-7, 4e-5), 3: (2e-10, 2e-10, 1e-8)}


@pytest.mark.parametrize("wave", range(3))
@pytest.mark.parametrize("order", GAPS)
def test_longitudinal_speed_is_pochhammers_and_chrees(order, wave, bar):
    """Ends in their planes, shear-free: k = pi / L is exact.  Order 1 has only u_r = r f(z), u_z = g(z) to offer."""
    k, exact = list(LONGITUDINAL.items())[wave]
    modes = modal.solve(bar(np.pi / k, sliding, degree=5, elements=6, order=order), 8 if k > 0.2 else 24)
    assert modes.rigid == 3
    speeds = rates(modes) / k / SPEED
    speed = speeds[stretching(modes) > 0.1][0]
    print(speed / exact - 1.0)
    assert abs(speed / exact - 1.0) < GAPS[order][wave]
    if order == 1:
        assert speed == pytest.approx(mindlin_herrmann(k), rel=1e-9)
        assert abs(speed / exact - 1.0) > 0.98 * GAPS[1][wave]


def test_ring_in_its_plane_is_rayleighs():
    """omega^2 = E I / (rho A R^4) n^2 (n^2 - 1)^2 / (n^2 + 1), extrapolated to a thin ring; in pairs."""
    found = []
    for thickness in (0.1, 0.05, 0.025):
        space = Space.paper(Ring(radius=1.0, a=thickness, b=thickness, section_points=4).rod(), elements=32, degree=5)
        modes = modal.solve(Model([Body(space, LinearElastic(E, 0.0), RHO)]), 8)
        moved = modes.vectors[modes.rigid :].reshape(-1, space.nodes, 3) ** 2
        flat = rates(modes)[moved[:, :, 2].sum(axis=1) < 1e-3 * moved.sum(axis=(1, 2))][:4].reshape(2, 2)
        assert np.abs(flat[:, 1] / flat[:, 0] - 1.0).max() < 1e-3
        found.append((flat.mean(axis=1) / (SPEED * thickness / 2)) ** 2)
    n = np.array([2, 3])
    exact = n**2 * (n**2 - 1) ** 2 / (n**2 + 1)
    first = [(4 * fine - coarse) / 3 for coarse, fine in pairwise(found)]
    limit = (16 * first[1] - first[0]) / 15
    print(np.array(found) / exact, limit / exact)
    assert np.abs(limit / exact - 1.0).max() < 1e-5
