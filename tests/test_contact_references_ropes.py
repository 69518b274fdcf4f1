"""Reference values of rods over a cylinder, twisted together and knotted: their equations, limits and symmetries."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import minimize_scalar

from comparisons.contact import capstan, knot
from comparisons.contact.capstan import Capstan
from comparisons.contact.pair import TwistedPair
from isorod.errors import InputError


def test_rod_over_a_cylinder():
    assert Capstan(3.0, 2.0, np.pi, 1.0).threshold * 2.0**2 / 3.0 == pytest.approx(0.5, rel=1e-14)
    found = Capstan(1.0, 1.0, np.pi, 1.0).touch()
    assert np.degrees(found.half_angle) == pytest.approx(30.0, rel=1e-12)
    assert found.end_force == pytest.approx(np.sqrt(0.75), rel=1e-12)
    assert found.line_force == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("wrap", [0.3, 2.0, np.pi, 5.0])
@pytest.mark.parametrize("ratio", [0.4, 1.0, 1.5, 30.0])
@pytest.mark.parametrize("reach", [0.3, 4.0, np.inf])
def test_rod_over_a_cylinder_is_in_balance(wrap, ratio, reach):
    """Pressures hold the pulls; the rod's free part, integrated from its end, meets the cylinder as it should."""
    B, R = 3.0, 0.7
    force = ratio * Capstan(B, R, wrap, 1.0).threshold
    rate = np.sqrt(force / B)
    half_length = 0.5 * R * wrap + reach / rate
    rod = Capstan(B, R, wrap, force, half_length)
    found = rod.touch()
    if half_length == np.inf:
        assert (found.half_angle > 1e-7) == (ratio > 1.0)
        if ratio > 1.0:
            expected = 0.5 * wrap - np.arccos(1.0 - B / (2.0 * force * R**2))
            assert found.half_angle == pytest.approx(expected, rel=1e-12)
    assert found.half_angle + found.lift_angle == pytest.approx(0.5 * wrap, rel=1e-14)
    arc = 2.0 * found.line_force * R * np.sin(found.half_angle)
    total = arc + 2.0 * found.end_force * np.cos(found.half_angle)
    assert total == pytest.approx(2.0 * force * np.sin(0.5 * wrap), rel=1e-12)

    # An infinite rod from where it is almost straight: tan(psi/4) falls exponentially.
    lift = R * found.half_angle
    last = half_length if half_length < np.inf else lift + 12.0 / rate
    angle, bent = rod.end_angle, 0.0
    if half_length == np.inf:
        angle = 4.0 * np.arctan(np.tan(0.25 * found.lift_angle) * np.exp(-12.0))
        bent = 2.0 * rate * np.sin(0.5 * angle)

    def elastica(_, state):
        psi, curvature, _, _ = state
        direction = psi - 0.5 * wrap
        return curvature, force / B * np.sin(psi), -np.cos(direction), -np.sin(direction)

    begin = rod.positions(np.array([last]))[0]
    path = solve_ivp(
        elastica, (0.0, last - lift), (angle, bent, *begin), method="DOP853", rtol=1e-12, atol=1e-14, dense_output=True
    )
    psi, curvature, *place = path.y[:, -1]
    assert psi == pytest.approx(found.lift_angle, rel=1e-6)
    touching = [R * np.sin(found.half_angle), R * np.cos(found.half_angle)]
    np.testing.assert_allclose(place, touching, atol=1e-7)
    if found.half_angle > 0.0:
        assert curvature == pytest.approx(1.0 / R, rel=1e-6)
    else:
        assert curvature < (1.0 + 1e-6) / R
    along = np.linspace(lift, last, 9)
    np.testing.assert_allclose(rod.positions(along), path.sol(last - along)[2:].T, atol=1e-7)


def test_rod_over_a_cylinder_keeps_its_length_and_off_the_cylinder():
    rod = Capstan(1.0, 1.0, np.pi, 1.3, 6.0)
    along = np.linspace(-6.0, 6.0, 4001)
    points = rod.positions(along)
    np.testing.assert_allclose(np.linalg.norm(np.diff(points, axis=0), axis=1), 12.0 / 4000.0, rtol=1e-6)
    assert np.linalg.norm(points, axis=1).min() > 1.0 - 1e-12
    np.testing.assert_allclose(points[::-1], points * [-1.0, 1.0], atol=1e-14)
    np.testing.assert_allclose(
        Capstan(1.0, 1.0, np.pi, 1.3, 30.0).touch(), Capstan(1.0, 1.0, np.pi, 1.3).touch(), rtol=1e-12
    )


def test_rod_over_a_cylinder_wraps_less_than_a_turn():
    with pytest.raises(InputError, match="between 0 and a whole turn"):
        Capstan(1.0, 1.0, 2.0 * np.pi, 1.0)


def test_rod_over_a_cylinder_pulled_hard_is_a_rope():
    """All of the wrap is in contact, pressed by F/R; what bending takes falls with the root of the force."""
    errors = []
    for force in (1e4, 4e4):
        found = Capstan(1.0, 1.0, np.pi, force).touch()
        assert found.line_force == pytest.approx(force, rel=1e-4)
        errors.append(0.5 * np.pi - found.half_angle)
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=1e-3)


def test_friction_of_ropes():
    """Tension by its equation over the cylinder, without and with weight."""
    friction, radius, weight, hanging = 0.3, 0.8, 2.5, 1.7

    def slope(angle, tension):
        return weight * radius * np.cos(angle) + friction * (tension + weight * radius * np.sin(angle))

    path = solve_ivp(slope, (0.0, np.pi), [weight * hanging], rtol=1e-11, atol=1e-12)
    assert capstan.heavy_rope_bound(hanging, radius, friction) == pytest.approx(path.y[0, -1] / weight, rel=1e-9)
    thin = capstan.heavy_rope_bound(hanging, 1e-12, friction)
    assert thin == pytest.approx(hanging * capstan.friction_ratio(friction, np.pi), rel=1e-10)
    assert capstan.heavy_rope_bound(hanging, radius, 0.0) == hanging
    both = capstan.friction_ratio(friction, 1.0) * capstan.friction_ratio(friction, 2.0)
    assert capstan.friction_ratio(friction, 3.0) == pytest.approx(both, rel=1e-14)


def test_rod_on_an_incline():
    steep = np.arctan(0.3)
    assert capstan.incline_acceleration(steep - 1e-9, 0.3, 9.81) == 0.0
    assert capstan.incline_acceleration(steep + 1e-3, 0.3, 9.81) == pytest.approx(
        9.81e-3 * np.hypot(1.0, 0.3), rel=1e-3
    )
    assert capstan.incline_acceleration(0.5 * np.pi, 0.3, 9.81) == pytest.approx(9.81)


# Two rods of radius 0.01 or 0.0095 with axes 0.019 apart, E = 1e9, nu = 0, stretched by 1 % and twisted once.
def twisted(radius, **changes):
    area = np.pi * radius**2
    bending = 0.25e9 * area * radius**2
    given = {"helix_radius": 0.0095, "length": 5.0, "stretch": 1.01, "turns": 1.0, "tension": 1e7 * area}
    return TwistedPair(**(given | {"bending": bending, "torsion": bending} | changes))


def test_twisted_pair():
    beams, solids = twisted(0.01), twisted(0.0095)
    assert beams.height - beams.length == pytest.approx(0.0496472226, abs=5e-11)
    assert beams.curvature == pytest.approx(0.0147062, abs=5e-8)
    assert beams.helix_torsion == pytest.approx(1.2441082, abs=5e-8)
    assert (beams.tension, solids.tension) == pytest.approx((3141.593, 2835.29), rel=2e-6)
    assert beams.line_load() == pytest.approx(46.38, abs=5e-3)
    assert solids.line_load() == pytest.approx(41.84, abs=5e-3)


def test_twisted_pair_is_in_balance():
    """Kirchhoff's equations, integrated along a pair wound steeply: half a turn on, all has gone round by half one."""
    pair = twisted(0.01, length=0.1, tension=900.0)
    span = pair.stretch * pair.length
    turning, sine = 2.0 * np.pi / span, pair.height / span

    def frame(s):
        c, n = np.cos(turning * s), np.sin(turning * s)
        tangent = np.array([-0.0095 * turning * n, 0.0095 * turning * c, sine])
        return tangent, np.array([-c, -n, 0.0])

    def twist(s):
        """Of a frame that keeps its direction across the axis."""
        tangent, normal = frame(s)
        along = tangent[0]
        across = np.array([1.0, 0.0, 0.0]) - along * tangent
        rate = -(pair.curvature * normal[0]) * tangent - along * pair.curvature * normal
        return rate @ np.cross(tangent, across) / (across @ across)

    lag = quad(twist, 0.0, span, epsrel=1e-11)[0] / span
    tangent, normal = frame(0.0)
    moment = pair.stretch * (pair.torsion * lag * tangent + pair.bending * pair.curvature * np.cross(tangent, normal))
    # The moment goes round with the helix; M' + t x F = 0 leaves the tension open.
    force = pair.tension * tangent + np.cross(tangent, turning * np.cross([0.0, 0.0, 1.0], moment))

    def balance(s, state):
        tangent, normal = frame(s)
        return np.concatenate([pair.line_load() * normal, -np.cross(tangent, state[:3])])

    path = solve_ivp(balance, (0.0, 0.5 * span), np.concatenate([force, moment]), method="DOP853", rtol=1e-12)
    half_turn = np.tile([-1.0, -1.0, 1.0], 2)
    np.testing.assert_allclose(path.y[:3, -1], force * half_turn[:3], atol=1e-8 * np.linalg.norm(force))
    np.testing.assert_allclose(path.y[3:, -1], moment * half_turn[3:], atol=1e-8 * np.linalg.norm(moment))
    place = np.array([0.0095, 0.0, 0.0])
    np.testing.assert_allclose(pair.wrench(), [2.0 * force[2], 2.0 * (moment + np.cross(place, force))[2]], rtol=1e-9)
    ends = pair.positions(np.array([0.0, 0.05]))
    np.testing.assert_allclose(ends, [place, [-0.0095, 0.0, 0.5 * pair.height]], atol=1e-15)


def test_twisted_pair_mirrored_and_slack():
    pair, mirrored = twisted(0.01), twisted(0.01, turns=-1.0)
    assert mirrored.line_load() == pytest.approx(pair.line_load(), rel=1e-14)
    np.testing.assert_allclose(mirrored.wrench(), np.array(pair.wrench()) * [1.0, -1.0], rtol=1e-14)
    # A pair wound a little presses as two ropes: tension times curvature, which is of second order in the turns.
    small = twisted(0.01, turns=0.01)
    assert small.line_load() == pytest.approx(small.tension * small.curvature, rel=1e-5)
    with pytest.raises(InputError, match="does not go round 90 times"):
        twisted(0.01, turns=90.0)


def test_loose_knot():
    """Of the energies of circles under a tension the least has the loop's radius."""
    bending, loop = 3.0, 0.4
    pull = knot.tension(bending, loop)

    def energy(radius, pull):
        angle = np.linspace(0.0, 2.0 * np.pi, 2001)
        line = radius * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
        sides = np.diff(line, axis=0)
        lengths = np.linalg.norm(sides, axis=1)
        bends = np.diff(np.unwrap(np.arctan2(sides[:, 1], sides[:, 0])))
        return 0.5 * bending * np.sum(bends**2) / lengths[0] + pull * lengths.sum()

    least = minimize_scalar(energy, bounds=(0.1, 2.0), args=(pull,), method="bounded", options={"xatol": 1e-9})
    assert least.x == pytest.approx(loop, rel=1e-3)
    # Released, the knot's work is its bending energy: the integral of tension over shortening from here to no tension.
    work = quad(lambda radius: knot.tension(bending, radius) * 2.0 * np.pi, loop, np.inf)[0]
    assert work == pytest.approx(np.pi * bending / loop, rel=1e-9)
