"""Laws with memory at points: von Mises' plasticity against formulas, differences and invariances."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from isorod.material.plastic import Plastic
from tests.refused import refused

TABLE = [[0.0, 400.0], [0.01, 420.0], [0.1, 500.0]]


def _law(**changed: object) -> Plastic:
    return Plastic(**{"E": 200e3, "nu": 0.3, "hardening": TABLE, "kinematic": 1500.0} | changed)


def _random(size: float, count: int = 40, seed: int = 0) -> np.ndarray:
    F = np.eye(3) + size * np.random.default_rng(seed).normal(size=(count, 3, 3))
    return F[np.linalg.det(F) > 0.0]


def _differences(law: Plastic, F: np.ndarray, step: float) -> np.ndarray:
    found = np.zeros((*F.shape, 3, 3))
    for b, B in np.ndindex(3, 3):
        change = np.zeros((3, 3))
        change[b, B] = step
        found[..., b, B] = (law.stress(F + change) - law.stress(F - change)) / (2.0 * step)
    return found


@pytest.mark.parametrize("size", [1e-4, 1e-2, 0.3])
def test_the_tangent_is_the_derivative_of_the_stress_and_symmetric(size: float) -> None:
    # Elastic, flowing, and flowing on or back from a state.
    F = _random(size)
    law = _law().advanced(F, 0.5)
    for one, state in ((_law(), F), (law, F + 0.5 * size * _random(1.0, seed=3)[: len(F)] - 0.5 * size * np.eye(3))):
        moduli = one.tangent(state)
        off = np.abs(moduli - _differences(one, state, 1e-6 * max(size, 1e-2))).max()
        assert off < 1e-6 * np.abs(moduli).max()
        assert np.abs(moduli - np.transpose(moduli, (0, 3, 4, 1, 2))).max() < 1e-12 * np.abs(moduli).max()


def test_the_tangent_where_principal_stretches_meet_and_at_the_yield_surface() -> None:
    yields = 400.0 / 200e3
    same = [np.eye(3), 1.2 * np.eye(3), np.diag([1.1, 1.1, 1.0 + 1e-9]), np.diag([1.02, 1.02 + 1e-5, 0.97])]
    F = np.array(same)
    moduli = _law().tangent(F)
    assert np.abs(moduli - _differences(_law(), F, 1e-6)).max() < 1e-6 * np.abs(moduli).max()
    # Just below and just above first yield in tension: elastic, then softer.
    stretch = np.exp(yields * np.array([1.0, -0.3, -0.3]))
    for share, softer in ((1.0 - 1e-9, False), (1.0 + 1e-6, True)):
        state = np.diag(stretch**share)[None]
        assert (_law().tangent(state)[0, 0, 0, 0, 0] < 0.9 * _law().tangent(np.eye(3)[None])[0, 0, 0, 0, 0]) == softer


def test_a_rotation_turns_the_stress_and_leaves_the_state() -> None:
    F, Q = _random(0.1), Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix()
    law, turned = _law().advanced(F, 0.5), _law().advanced(Q @ F, 0.5)
    assert np.abs(law.state - turned.state).max() < 1e-12
    assert np.abs(Q @ law.stress(1.01 * F) - turned.stress(1.01 * Q @ F)).max() < 1e-9 * 500.0


def test_what_has_been_asked_thrice_is_as_if_asked_once() -> None:
    F = _random(0.05)
    law = _law().advanced(F, 0.3)
    before = law.state.copy()
    first = law.stress(1.02 * F)
    law.tangent(1.02 * F)
    law.advanced(1.5 * F, 0.6)
    assert np.array_equal(law.stress(1.02 * F), first)
    assert np.array_equal(law.state, before)


def test_a_state_that_stays_keeps_its_stress() -> None:
    F = _random(0.05)
    law = _law()
    assert np.abs(law.advanced(F, 1.0).stress(F) - law.stress(F)).max() < 1e-11 * 500.0


def test_random_paths_dissipate_and_flow_without_volume() -> None:
    rng, law = np.random.default_rng(5), _law()
    F, lost = np.tile(np.eye(3), (100, 1, 1)), np.zeros(100)
    for k in range(100):
        F = F + 0.003 * rng.normal(size=F.shape)
        new = law.advanced(F, k + 1.0)
        # By a stress without the back stress, which a law of the same plastic strain that is not kinematic has.
        bare = _law(kinematic=0.0)._with(state=new.state)
        S = np.linalg.solve(F, bare.stress(F))
        del S
        lost += new.told("p", (100,))[:, 0] - law.known((100, 7) and (100,))[..., 6]
        assert (new.state[:, 6] >= law.known((100,))[:, 6]).all()
        law = new
    assert lost.min() > 0.01
    assert np.abs(law.state[:, [0, 3, 5]].sum(axis=1)).max() < 1e-13


def _tension(law: Plastic, stretch: float) -> np.ndarray:
    """Return the deformation gradient of uniaxial tension."""

    def across(s: float) -> float:
        return float(law.stress(np.diag([s, s, stretch])[None])[0, 0, 0])

    s = brentq(across, 0.7 * stretch**-0.5, 1.3 * stretch**-0.3)
    return np.diag([s, s, stretch])[None]


def test_tension_with_linear_hardening() -> None:
    # tau = E eps_e = sy + H p, P = tau / l, J = exp((1 - 2 nu) tau / E).
    law = Plastic(200e3, 0.3, [[0.0, 400.0], [1.0, 1400.0]])
    F = _tension(law, 1.05)
    assert law.stress(F)[0, 2, 2] == pytest.approx(425.29274027, rel=1e-10)
    assert np.linalg.det(F[0]) == pytest.approx(1.0008935137, rel=1e-10)
    assert law.advanced(F, 1.0).told("p", (1,))[0, 0] == pytest.approx(0.0465573773, rel=1e-8)


def test_tension_through_several_pieces_of_the_table() -> None:
    # One step over two pieces, and behind the last point.
    law = _law(kinematic=0.0)
    for stretch in (1.005, 1.05, 1.3):
        F = _tension(law, stretch)
        tau, p = law.stress(F)[0, 2, 2] * stretch, law.advanced(F, 1.0).told("p", (1,))[0, 0]
        assert tau == pytest.approx(np.interp(p, *np.transpose(TABLE)), rel=1e-10)
        assert np.log(stretch) == pytest.approx(tau / 200e3 + p, rel=1e-10)


def test_kinematic_hardening_yields_earlier_on_the_way_back() -> None:
    law = Plastic(200e3, 0.3, [[0.0, 400.0]], kinematic=1e4)
    up = _tension(law, 1.02)
    law = law.advanced(up, 1.0)
    top = law.stress(up)[0, 2, 2] * 1.02
    assert top == pytest.approx(400.0 + 1e4 * law.told("p", (1,))[0, 0], rel=1e-10)
    stretch = 1.02 * np.exp(-4.0 * 400.0 / 200e3)
    down = _tension(law, stretch)
    strain = np.log(stretch) - law.advanced(down, 2.0).stress(down)[0, 2, 2] * stretch / 200e3
    assert law.stress(down)[0, 2, 2] * stretch == pytest.approx(1e4 * strain - 400.0, rel=1e-9)


test_bad_tables = refused(
    (lambda: _law(hardening=[[0.1, 400.0]]), "hardening: got plastic strains [0.1], need growing ones from 0 on"),
    (lambda: _law(hardening=[[0.0, 400.0], [0.0, 500.0]]), "need growing ones from 0 on"),
    (lambda: _law(hardening=[[0.0, 400.0], [0.1, 300.0]]), "need positive ones that do not fall"),
    (lambda: _law(hardening=[[0.0, 0.0]]), "need positive ones that do not fall"),
    (lambda: _law(hardening=[]), "hardening: need a list of points"),
    (lambda: _law(hardening=[[0.0, float("nan")]]), "hardening: got"),
    (lambda: _law(kinematic=-1.0), "kinematic: got -1, need a modulus, not negative"),
)
