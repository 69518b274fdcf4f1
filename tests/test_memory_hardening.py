"""Hardening that recovers and flow that takes time: cycles and rates in formulas."""

import numpy as np
import pytest
from scipy.optimize import brentq

from isorod.material.plastic import Plastic, Viscoplastic

E, NU, YIELD, H, GAMMA = 200e3, 0.3, 400.0, 2e4, 100.0
TABLE = [[0.0, YIELD], [0.1, 500.0]]
FIRST, SECOND = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]


def _tension(law: Plastic, strain: float) -> np.ndarray:
    """Return the deformation gradient of uniaxial tension with a logarithmic strain."""

    def across(s: float) -> float:
        return float(law.stress(np.diag([np.exp(s), np.exp(s), np.exp(strain)])[None])[0, 0, 0])

    s = brentq(across, -0.5 * strain - 0.01, -0.5 * strain + 0.01, xtol=1e-15)
    return np.diag([np.exp(s), np.exp(s), np.exp(strain)])[None]


def _pulled(law: Plastic, F: np.ndarray) -> tuple[float, float]:
    """Return Kirchhoff's stress and plastic strain along the axis."""
    return float(law.stress(F)[0, 2, 2] * F[0, 2, 2]), float(law.advanced(F, 1.0).state[0, 5])


def test_cycles_in_tension_and_compression_are_exact_in_steps_of_any_length() -> None:
    # On each way a = s H/gamma + (a0 - s H/gamma) exp(-gamma |e - e0|), s the way; stress s sy + a.
    law, plastic, back, lost = Plastic(E, NU, [[0.0, YIELD]], H, GAMMA), 0.0, 0.0, 0.0
    for strain in (0.02, -0.02, -0.03, 0.05):
        F = _tension(law, strain)
        stress, after = _pulled(law, F)
        way, before = np.sign(after - plastic), back
        back = way * H / GAMMA + (back - way * H / GAMMA) * np.exp(-GAMMA * abs(after - plastic))
        assert stress == pytest.approx(way * YIELD + back, rel=1e-9)
        law = law.advanced(F, 1.0)
        assert law.state[0, 12] == pytest.approx(2.0 / 3.0 * back, rel=1e-9)
        # Of the work (s sy + a) de what is not in a^2 / (2 H): the integral of a de is (H |de| - s da) / gamma.
        work = (YIELD + H / GAMMA) * abs(after - plastic) - way * (back - before) / GAMMA
        lost += work - 0.5 * (back**2 - before**2) / H
        assert law.state[0, 13] == pytest.approx(lost, rel=1e-9)
        plastic = after


@pytest.mark.parametrize("law", [Plastic(E, NU, TABLE, H, GAMMA), Viscoplastic(E, NU, TABLE, H, GAMMA, A=10.0, n=3.0)])
def test_each_step_of_ten_thousand_random_paths_loses_energy(law: Plastic) -> None:
    """Stress times plastic strain is never less than what hardening stores, however long the step."""
    rng, twice, most = np.random.default_rng(0), np.array([1.0, 2.0, 2.0, 1.0, 2.0, 1.0]), 0.0
    F, before = np.tile(np.eye(3), (10_000, 1, 1)), np.zeros((10_000, 14))
    for k in range(8):
        F = F + 0.02 * rng.normal(size=F.shape)
        law = law.advanced(F, k + 1.0)
        plastic, p, back = law.state[:, :6], law.state[:, 6], law.state[:, 7:13]
        values, vectors = np.linalg.eigh(np.swapaxes(F, 1, 2) @ F)
        strain = (vectors * 0.5 * np.log(values)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
        # The volume does no work on what flows without it.
        stress = E / (1.0 + NU) * (strain[:, FIRST, SECOND] - plastic)
        stored = 0.75 / H * ((back**2 - before[:, 7:13] ** 2) @ twice)
        lost = (stress * (plastic - before[:, :6])) @ twice - stored
        # What flows ends where its stress about the back stress is that of flow, whatever is left of Newton's steps.
        about = stress - stress[:, [0, 3, 5]].mean(axis=1)[:, None] * (np.equal(FIRST, SECOND)) - back
        grown = p - before[:, 6]
        limit = np.interp(p, *np.transpose(TABLE)) * (1.0 + ((grown / law.A) ** (1.0 / law.n) if law.timed else 0.0))
        missed = np.abs(np.sqrt(1.5 * about**2 @ twice) / limit - 1.0)
        assert missed[grown > 0.0].max() < 1e-11
        assert (lost - YIELD * (p - before[:, 6]) > -1e-10 * YIELD).all()
        told = law.state[:, 13] - before[:, 13]
        assert (told - YIELD * (p - before[:, 6]) > -1e-10 * YIELD).all()
        most, before = max(most, np.sqrt(1.5 * (back**2) @ twice).max()), law.state
    assert 0.9 * H / GAMMA < most < H / GAMMA


def test_recovery_that_is_slow_is_linear_hardening() -> None:
    F = np.eye(3) + 0.02 * np.random.default_rng(1).normal(size=(20, 3, 3))
    linear, slow = (Plastic(E, NU, TABLE, H, one) for one in (0.0, 1e-9))
    assert np.abs(linear.stress(F) - slow.stress(F)).max() < 1e-6


def test_what_flows_at_a_rate_has_so_much_more_stress() -> None:
    # tau = sy (1 + (rate/A)^(1/n)), once it is steady.
    law, rate = Viscoplastic(E, NU, [[0.0, YIELD]], A=10.0, n=4.0), 0.2
    for k in range(1, 12):
        now = law.at(0.02 * k)
        F = _tension(now, rate * 0.02 * k)
        stress, _ = _pulled(now, F)
        law = law.advanced(F, 0.02 * k)
    assert stress == pytest.approx(YIELD * (1.0 + (rate / 10.0) ** 0.25), rel=1e-6)


def test_held_it_relaxes_to_the_yield_stress_and_steps_err_in_proportion() -> None:
    # q' = -3 G A (q/sy - 1) with n = 1.
    start, G, errors, F = 1.5 * YIELD, E / 2.6, [], np.eye(3)[None].copy()
    rate = YIELD / (3.0 * G)
    for steps in (20, 40):
        law = Viscoplastic(E, NU, [[0.0, YIELD]], A=rate, n=1.0)
        shear = start / np.sqrt(3.0) / G
        F[0, 0, 1] = shear
        first = np.sqrt(3.0) * law.at(0.0).stress(F)[0, 0, 1]
        for k in range(steps):
            law = law.advanced(F, (k + 1.0) / steps)
        q = np.sqrt(3.0) * law.at(1.0).stress(F)[0, 0, 1]
        errors.append(abs(q / (YIELD + (first - YIELD) * np.exp(-1.0)) - 1.0))
    assert errors[1] < 3e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)


def test_fast_it_is_elastic_and_slow_it_is_plastic() -> None:
    F = np.eye(3) + 0.02 * np.random.default_rng(1).normal(size=(20, 3, 3))
    law, plastic = Viscoplastic(E, NU, TABLE, H, GAMMA, A=1.0, n=3.0), Plastic(E, NU, TABLE, H, GAMMA)
    assert np.abs(law.at(1e-30).stress(F) - Plastic(E, NU, [[0.0, 1e9]]).stress(F)).max() < 1e-3
    assert np.abs(law.at(0.0).stress(F) - Plastic(E, NU, [[0.0, 1e9]]).stress(F)).max() < 1e-6
    assert np.abs(law.at(1e30).stress(F) - plastic.stress(F)).max() < 1e-3
