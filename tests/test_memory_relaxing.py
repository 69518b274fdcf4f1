"""Solids that relax at large strains against the equations of Reese and Govindjee, integrated finely."""

import numpy as np
import pytest

from isorod import Body, Model, Space, Support, circle, statics, straight
from isorod.material.viscous import Viscoelastic

# Equal parts that stay and relax in time 1, incompressible: stress at times after a stretch of 1.5 from then on.
UNIAXIAL = [(0.0, 2.111111111), (0.5, 1.560615793), (1.0, 1.330035215), (2.0, 1.147848285), (5.0, 1.059953203)]
# Torque and normal force of a round bar of radius 1, twisted by 0.5 a length.
TWISTED = [
    (0.0, 1.57079633, -0.392699082),
    (0.5, 1.24758760, -0.357658375),
    (1.0, 1.06410231, -0.310347117),
    (2.0, 0.888244452, -0.244362913),
    (5.0, 0.790546437, -0.198915234),
]


def _law(nu: float = 0.5) -> Viscoelastic:
    return Viscoelastic(4.0 * (1.0 + nu), nu, [[0.5, 1.0]])


def _pulled(law: Viscoelastic, F: np.ndarray) -> float:
    """Return the nominal stress of tension without volume."""
    P = law.shear.stress(F)[0]
    return float(P[2, 2] - P[0, 0] * F[0, 0, 0] / F[0, 2, 2])


def test_a_stretch_that_is_held_relaxes_in_one_step_and_in_many() -> None:
    F, start, steps = np.diag([1.5**-0.5, 1.5**-0.5, 1.5])[None], _law().advanced(np.eye(3)[None], 0.0), _law()
    for time, stress in UNIAXIAL:
        one = start.advanced(F, 0.0).at(time)
        assert _pulled(one, F) == pytest.approx(stress, rel=1e-4)
        assert _pulled(steps.at(time), F) == pytest.approx(stress, rel=1e-4)
        steps = steps.advanced(F, time)


def test_what_is_lost_where_nothing_moves_is_what_is_not_stored_any_more() -> None:
    F, law = np.diag([1.5**-0.5, 1.5**-0.5, 1.5])[None], _law().shear.advanced(np.eye(3)[None], 0.0)
    held = law.advanced(F, 0.0)
    for time in (1e-9, 1e-3, 0.5, 5.0, 1e3):
        after = held.advanced(F, time)
        lost = held.energy(F) - after.at(time).energy(F)
        assert after.state[0, -1] == pytest.approx(lost[0], rel=1e-12, abs=1e-14)


def test_what_is_lost_is_the_work_less_what_is_stored_to_second_order() -> None:
    rng = np.random.default_rng(3)
    ways, errors = rng.normal(size=(2, 30, 3, 3)), []
    for steps in (8, 16, 32):
        law, F, work = Viscoelastic(2.6, 0.3, [[0.5, 0.7], [0.3, 0.1]]), np.eye(3) + 0.0 * ways[0], 0.0
        for k in range(steps):
            now = law.lasting(1.0 / steps)
            change = 0.2 / steps * (ways[0] if 2 * k < steps else ways[1])
            stress, _ = now.discrete(F, change, False)
            work = work + np.sum(stress * change, axis=(1, 2))
            F = F + change
            law = now.advanced(F, 0.0)
        assert law.state[:, -1].min() > 0.0
        errors.append(np.abs(work - law.lasting(0.0).energy(F) - law.state[:, -1]).max() / work.max())
    assert errors[0] < 5e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.3)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.2)


def test_steps_of_a_way_that_goes_on_err_as_their_square() -> None:
    # A stretch that grows with time, and turns, beside the equation itself in many small steps.
    def way(time: float) -> np.ndarray:
        F = np.eye(3) + time * np.array([[0.2, 0.9, 0.0], [-0.3, -0.1, 0.4], [0.2, 0.0, 0.5]])
        return F / np.cbrt(np.linalg.det(F))

    def slope(time: float, damper: np.ndarray) -> np.ndarray:
        C = way(time).T @ way(time)
        return C - np.trace(C @ np.linalg.inv(damper)) / 3.0 * damper

    damper, count = np.eye(3), 400
    for k in range(count):
        t, h = k / count, 1.0 / count
        a = slope(t, damper)
        b = slope(t + 0.5 * h, damper + 0.5 * h * a)
        c = slope(t + 0.5 * h, damper + 0.5 * h * b)
        d = slope(t + h, damper + h * c)
        damper = damper + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    errors = []
    for steps in (4, 8, 16):
        law = _law()
        for k in range(steps):
            law = law.advanced(way((k + 1.0) / steps)[None], (k + 1.0) / steps)
        found = np.eye(3) + law.state[0, 6:][[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
        assert np.linalg.det(found) == pytest.approx(1.0, abs=1e-12)
        errors.append(np.abs(found - damper).max())
    assert errors[0] < 5e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.2)


def test_short_steps_by_series_are_those_of_the_exponential() -> None:
    """A step of one part, at the rate of its middle, in steps of any length beside their formula."""
    moved = np.eye(3) + 0.3 * np.random.default_rng(0).normal(size=(2, 1, 3, 3))
    before, now = (C / np.cbrt(np.linalg.det(C)) for C in (F[0].T @ F[0] for F in moved))
    law = _law(0.3).advanced(moved[0], 0.0)

    def damper(x: float, part: float) -> np.ndarray:
        gone, c = -np.expm1(-x), part * (1.0 + np.expm1(-x) / x)
        return (1.0 - gone) * np.eye(3) + (gone - c) * before + c * now

    for time in (1e-9, 1e-4, 1.9e-3, 2.1e-3, 9e-3, 1.1e-2, 0.05, 0.15, 0.24):
        rate = np.cbrt(np.linalg.det(damper(0.5 * time, 0.5)) / np.linalg.det(0.5 * (before + now)))
        end = damper(rate * time, 1.0)
        found = np.eye(3) + law.lasting(time).advanced(moved[1], 0.0).state[0, 6:12][[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
        assert np.abs(found - end / np.cbrt(np.linalg.det(end))).max() < 1e-13


def test_fast_it_is_glass_and_slow_it_is_rubber() -> None:
    F = np.eye(3) + 0.2 * np.random.default_rng(0).normal(size=(20, 3, 3))
    law, glass = Viscoelastic(2.6, 0.3, [[0.5, 1.0], [0.2, 1e-3]]), Viscoelastic(2.6, 0.3, [[1e-12, 1.0]])
    assert np.abs(law.at(0.0).stress(F) - glass.stress(F)).max() < 1e-9
    # Of the shape three tenths are left, of the volume all.
    volume = np.cbrt(np.linalg.det(F))[:, None, None] * np.eye(3)
    turned = np.einsum("naA,nbA->nab", glass.stress(F), F)
    pressure = np.trace(turned, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    slow = law.at(1e9)
    assert np.abs(np.einsum("naA,nbA->nab", slow.stress(F), F) - pressure - 0.3 * (turned - pressure)).max() < 1e-7
    assert np.abs(slow.stress(volume) - glass.stress(volume)).max() < 1e-12


def test_a_twisted_bar_relaxes_in_torque_and_normal_force() -> None:
    made = Space(straight(2.0).sweep(circle(8, 1.0)), section_degree=3, elements=2, degree=3)
    ends = [Support.end(made, "start"), Support.end(made, "end", turn=(0.0, 0.0, 1.0), history=[[0, 1], [2, 1]])]
    for time, torque, force in TWISTED[2:4]:
        found = statics.solve(Model([Body(made, _law())], ends), end_time=time)
        assert found.moments[1, 2] == pytest.approx(torque, rel=5e-4)
        assert found.reactions[1, 2] == pytest.approx(force, rel=5e-4)
