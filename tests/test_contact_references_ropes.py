"""Reference values of rods over a cylinder, twisted together and knotted: their equations, limits and symmetries."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from comparisons.contact import capstan
from comparisons.contact.capstan import Capstan


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
