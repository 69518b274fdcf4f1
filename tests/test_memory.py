"""Laws with memory at points: von Mises' plasticity against formulas, differences and invariances."""

import numpy as np
import pytest
from refused import refused
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from isorod.material.plastic import Plastic, Viscoplastic
from isorod.material.viscous import Creep, Viscoelastic

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


LAWS = {
    "plastic": lambda: _law(),
    "prony": lambda: Viscoelastic(200e3, 0.3, [[0.3, 1.0], [0.2, 0.1]]),
    "creep": lambda: Creep(200e3, 0.3, 1e-8, 3.0),
    "recovery": lambda: _law(kinematic=2e4, recovery=100.0),
    "viscoplastic": lambda: Viscoplastic(200e3, 0.3, TABLE, 2e4, 100.0, A=10.0, n=3.0),
}

# Those whose stress has a derivative that is not symmetric.
UNSYMMETRIC = ("prony", "recovery", "viscoplastic")


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("size", [1e-4, 1e-2, 0.3])
def test_the_tangent_is_the_derivative_of_the_stress_and_symmetric(name: str, size: float) -> None:
    # At rest, and on or back from a state.
    F, law = _random(size), LAWS[name]()
    further = F + 0.5 * size * np.random.default_rng(3).normal(size=F.shape)
    for one, state in ((law.at(0.3), F), (law.advanced(F, 0.3).at(0.9), further)):
        moduli = one.tangent(state)
        found = _differences(one, state, 1e-6 * max(size, 1e-2))
        turned = np.transpose(found, (0, 3, 4, 1, 2))
        if name in UNSYMMETRIC:
            # It is the symmetric part, and near the whole.
            assert np.abs(moduli - found).max() < 0.01 * np.abs(moduli).max()
            found = 0.5 * (found + turned)
        assert np.abs(moduli - found).max() < 1e-6 * np.abs(moduli).max()
        assert np.abs(moduli - np.transpose(moduli, (0, 3, 4, 1, 2))).max() < 1e-12 * np.abs(moduli).max()


def test_the_logarithm_is_right_for_stretches_of_any_size_that_it_takes() -> None:
    # T_i / l_i along principal directions, from small strains to the last rule of Gauss points.
    law, rng = _law(hardening=[[0.0, 1e9]]), np.random.default_rng(4)
    G, lame = 200e3 / 2.6, 200e3 * 0.3 / (1.3 * 0.4)
    for size in (1e-6, 1e-3, 8e-3, 0.03, 0.1, 0.3, 0.7, -0.7, 1.5, -1.2, 2.4):
        logs = size * rng.uniform(-1.0 if size > 0.0 else 0.5, 1.0, (64, 3))
        logs[:, 0], size = size, abs(size)
        stresses = (2.0 * G * logs + lame * logs.sum(axis=1)[:, None]) / np.exp(logs)
        left, right = (Rotation.random(64, random_state=seed).as_matrix() for seed in (1, 2))
        found = law.stress(np.einsum("nai,ni,nAi->naA", left, np.exp(logs), right))
        exact = np.einsum("nai,ni,nAi->naA", left, stresses, right)
        # Of small strains rounding of C is a larger share, and of large ones that of the largest principal value.
        rel = np.abs(found - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))
        assert rel.max() < 1e-14 / size + 1e-14 * np.exp(6.5 * size)
    assert np.isnan(law.stress(np.diag([17.0, 1.0, 1.0])[None])).all()


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


@pytest.mark.parametrize("name", LAWS)
def test_a_rotation_turns_the_stress_and_leaves_the_state(name: str) -> None:
    F, Q = _random(0.1), Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix()
    law, turned = (LAWS[name]().advanced(one, 0.5).at(0.7) for one in (F, Q @ F))
    # Energies are those of strains times moduli.
    assert (np.abs(law.state - turned.state) < 1e-12 * np.maximum(1.0, np.abs(law.state))).all()
    assert np.abs(Q @ law.stress(1.01 * F) - turned.stress(1.01 * Q @ F)).max() < 1e-11 * 200e3


@pytest.mark.parametrize("name", LAWS)
def test_what_has_been_asked_thrice_is_as_if_asked_once(name: str) -> None:
    F = _random(0.05)
    law = LAWS[name]().advanced(F, 0.3)
    before, first = law.state.copy(), law.at(0.5).stress(1.02 * F)
    law.tangent(1.02 * F)
    law.advanced(1.5 * F, 0.6)
    assert np.array_equal(law.at(0.5).stress(1.02 * F), first)
    assert np.array_equal(law.state, before)


@pytest.mark.parametrize("name", LAWS)
def test_a_state_that_stays_keeps_its_stress(name: str) -> None:
    F, law = _random(0.05), LAWS[name]()
    assert np.abs(law.advanced(F, 0.4).at(0.4).stress(F) - law.at(0.4).stress(F)).max() < 1e-12 * 200e3


@pytest.mark.parametrize("name", LAWS)
def test_random_paths_lose_energy_and_flow_without_volume(name: str) -> None:
    """The work of the stress is what is stored, and what is lost is never less than before."""
    rng, law = np.random.default_rng(5), LAWS[name]()
    F, P, lost = np.tile(np.eye(3), (50, 1, 1)), np.zeros((50, 3, 3)), np.zeros(50)
    for leg in range(5):
        way = 0.01 * rng.normal(size=F.shape)
        for k in range(40):
            before, stored = (F, P), law.energy(F) if law.state is not None else 0.0
            F, time = F + way / 40.0, 0.01 * (40 * leg + k + 1)
            P = law.at(time).stress(F)
            law = law.advanced(F, time)
            work = 0.5 * np.sum((before[1] + P) * (F - before[0]), axis=(1, 2))
            # Sums of trapezia are right to a share of the energy that a step changes.
            lost += work - (law.energy(F) - stored)
            assert (work - (law.energy(F) - stored) > -2e-3 * np.abs(work).max()).all()
    assert lost.min() > 0.0
    if name == "plastic":
        assert np.abs(law.state[:, [0, 3, 5]].sum(axis=1)).max() < 1e-13
        table = np.array(TABLE)
        p = law.state[:, 6]
        surface = np.array([_area(*_yields(table, end)) for end in p])
        assert lost == pytest.approx(surface, rel=0.02)


def _area(values: np.ndarray, at: np.ndarray) -> float:
    return float(np.sum(0.5 * (values[1:] + values[:-1]) * np.diff(at)))


def _yields(table: np.ndarray, end: float) -> tuple[np.ndarray, np.ndarray]:
    p = np.linspace(0.0, end, 200)
    return np.interp(p, *table.T), p


@pytest.mark.parametrize("name", LAWS)
def test_after_a_step_nothing_flows_where_no_time_goes_by(name: str) -> None:
    F = _random(0.1)
    law = LAWS[name]().advanced(0.5 * (np.eye(3) + F), 0.2).at(0.3)
    after = law.advanced(F, 0.3)
    scale = np.abs(law.stress(F)).max()
    for one in (after.frozen, after.lasting(0.0)):
        np.testing.assert_allclose(one.stress(F), law.stress(F), rtol=0.0, atol=1e-11 * scale)
        np.testing.assert_allclose(one.energy(F), law.energy(F), rtol=1e-10)
    # Elastic from there: of stresses that go with the strain, and back.
    stiff = after.frozen.tangent(F)
    found = _differences(after.frozen, F, 1e-7)
    assert np.abs(stiff - found).max() < 1e-5 * np.abs(stiff).max()


@pytest.mark.parametrize("name", ["plastic", "recovery"])
def test_ten_thousand_steps_keep_the_volume_of_what_has_flown(name: str) -> None:
    law, angle = LAWS[name](), 0.0
    for k in range(10_000):
        angle += 0.05
        F = np.eye(3) + 0.01 * np.array([[np.cos(angle), np.sin(angle), 0.0], [0.0, 0.0, 0.3], [0.0, 0.0, 0.0]])
        law = law.advanced(F[None], k + 1.0)
    assert law.state[0, 6] > 1.0
    assert abs(law.state[0, [0, 3, 5]].sum()) < 1e-12


def test_a_solid_that_relaxes_has_the_exact_stress_on_straight_ramps() -> None:
    # G(t) = (1 + exp(-t))/2, sheared to 1 in time 1, then held.
    law, shear, F = Viscoelastic(2.6, 0.3, [[0.5, 1.0]]), 1e-6, np.eye(3)
    for time, stress in ((0.5, 0.4467346701), (1.0, 0.8160602794), (2.0, 0.6162720790), (5.0, 0.5057888459)):
        F[0, 1] = shear * min(time, 1.0)
        assert law.at(time).stress(F[None])[0, 0, 1] == pytest.approx(shear * stress, rel=1e-8)
        law = law.advanced(F[None], time)


def test_held_shear_relaxes_by_norton() -> None:
    # tau = (tau0^(1-n) + (n-1) k t)^(-1/(n-1)), k = G sqrt3 A 3^(n/2), in one step however long.
    E, A, n, F = 200e3, 1e-12, 3.0, np.eye(3)
    F[0, 1] = 1e-3
    law = Creep(E, 0.3, A, n).advanced(F[None], 0.0)
    start = law.at(0.0).stress(F[None])[0, 0, 1]
    rate = E / 2.6 * np.sqrt(3.0) * A * 3.0 ** (n / 2.0) * start ** (n - 1.0)
    for time in (1.0, 10.0, 100.0):
        held = law.at(time / rate).stress(F[None])[0, 0, 1]
        assert held / start == pytest.approx((1.0 + (n - 1.0) * time) ** (-1.0 / (n - 1.0)), rel=1e-6)


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
    assert law.advanced(F, 1.0).state[0, 6] == pytest.approx(0.0465573773, rel=1e-8)


def test_tension_through_several_pieces_of_the_table() -> None:
    # One step over two pieces, and behind the last point.
    law = _law(kinematic=0.0)
    for stretch in (1.005, 1.05, 1.3):
        F = _tension(law, stretch)
        tau, p = law.stress(F)[0, 2, 2] * stretch, law.advanced(F, 1.0).state[0, 6]
        assert tau == pytest.approx(np.interp(p, *np.transpose(TABLE)), rel=1e-10)
        assert np.log(stretch) == pytest.approx(tau / 200e3 + p, rel=1e-10)


def test_kinematic_hardening_yields_earlier_on_the_way_back() -> None:
    law = Plastic(200e3, 0.3, [[0.0, 400.0]], kinematic=1e4)
    up = _tension(law, 1.02)
    law = law.advanced(up, 1.0)
    top = law.stress(up)[0, 2, 2] * 1.02
    assert top == pytest.approx(400.0 + 1e4 * law.state[0, 6], rel=1e-10)
    stretch = 1.02 * np.exp(-4.0 * 400.0 / 200e3)
    down = _tension(law, stretch)
    strain = np.log(stretch) - law.advanced(down, 2.0).stress(down)[0, 2, 2] * stretch / 200e3
    assert law.stress(down)[0, 2, 2] * stretch == pytest.approx(1e4 * strain - 400.0, rel=1e-9)


def test_moduli_of_creep_in_steps_of_many_relaxation_times() -> None:
    """What is left after ``r`` of them has no digits beside what there was, and the moduli have all of theirs."""
    F, n = np.eye(3)[None].copy(), 10.0
    F[0, 0, 1] = 1e-2
    for r in (1e9, 1e12, 1e15, 1e18):
        law = Creep(2.6, 0.3, r / (0.5 * 3.0 * (np.sqrt(3.0) * F[0, 0, 1]) ** (n - 1.0)), n).lasting(1.0)
        moduli = law.tangent(F)
        sheared = [law.stress(F + step * np.eye(3)[:1, :, None] * np.eye(3)[1]) for step in (1e-6, -1e-6)]
        assert moduli[0, 0, 1, 0, 1] == pytest.approx(((sheared[0] - sheared[1]) / 2e-6)[0, 0, 1], rel=1e-5)


test_bad_tables = refused(
    (lambda: _law(hardening=[[0.1, 400.0]]), "hardening: got plastic strains [0.1], need growing ones from 0 on"),
    (lambda: _law(hardening=[[0.0, 400.0], [0.0, 500.0]]), "need growing ones from 0 on"),
    (lambda: _law(hardening=[[0.0, 400.0], [0.1, 300.0]]), "need positive ones that do not fall"),
    (lambda: _law(hardening=[[0.0, 0.0]]), "need positive ones that do not fall"),
    (lambda: _law(hardening=[]), "hardening: need a list of points"),
    (lambda: _law(hardening=[[0.0, float("nan")]]), "hardening: got"),
    (lambda: _law(kinematic=-1.0), "kinematic: got -1, need a modulus, not negative"),
    (lambda: _law(recovery=-1.0), "recovery: got -1, need a number, not negative"),
    (lambda: _law(kinematic=0.0, recovery=1.0), "recovery: there is no back stress to recover from; give a modulus"),
    (lambda: Viscoplastic(1.0, 0.3, TABLE), "A: got 0, need a positive rate"),
    (lambda: Viscoplastic(1.0, 0.3, TABLE, A=1.0, n=0.5), "n: got 0.5, need an exponent from 1 to 50"),
    (lambda: Viscoelastic(1.0, 0.3, [[0.6, 1.0], [0.5, 2.0]]), "need positive ones that add up to 1 at most"),
    (lambda: Viscoelastic(1.0, 0.3, [[0.6, 0.0]]), "prony: got 0, need a positive time"),
    (lambda: Viscoelastic(1.0, 0.3, 4 * [[0.1, 1.0]]), "prony: need 1 to 3 rows"),
    (lambda: Creep(1.0, 0.3, 0.0, 3.0), "A: got 0, need a positive rate"),
    (lambda: Creep(1.0, 0.3, 1.0, 0.5), "n: got 0.5, need an exponent from 1 to 50"),
)
