"""Laws of two potentials against the formula of their step, differences and invariances, from Python and from text."""

import numpy as np
import pytest
import sympy as sp
from refused import refused
from scipy.spatial.transform import Rotation

from isorod import Body, Dissipative, Model, SolveError, Space, Support, circle, dynamics, statics, straight
from isorod.files.material import dissipative
from isorod.material.symbols import internal, strain

MU, TAU, BULK = 2.0, 0.7, 5.0

# A spring beside a spring with a damper, and a variable that the strain draws along, until its energy bends down.
ENERGY = "mu*dot(dev(strain), dev(strain)) + mu*dot(dev(strain) - v, dev(strain) - v) + s**2*(1 - c*tr(strain)**2)"
ENERGY += " + c*s*strain00"
LOST = "mu*tau*dot(v_rate, v_rate) + eta/2*s_rate**2"
STATE, CONSTANTS = {"v": "deviatoric", "s": "scalar"}, {"mu": MU, "tau": TAU, "c": 3.0, "eta": 0.1}


def _law(**changed) -> Dissipative:
    given = {"energy": ENERGY, "dissipation": LOST, "state": STATE, "constants": CONSTANTS, "bulk": BULK} | changed
    return dissipative(**given)


def _random(size: float, count: int = 20) -> np.ndarray:
    return np.eye(3) + size * np.random.default_rng(0).normal(size=(count, 3, 3))


def _strain(F: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(np.swapaxes(F, 1, 2) @ F)
    found = (vectors * 0.5 * np.log(values)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return found - np.trace(found, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)


def _told(law: Dissipative) -> np.ndarray:
    return law.state[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


def test_text_and_symbols_make_one_law() -> None:
    v, flow = internal("v", "deviatoric")
    s, grows = internal("s", "scalar")
    mu, tau, c, eta = sp.symbols("mu tau c eta", real=True)
    dev = strain - strain.trace() / 3 * sp.eye(3)
    energy = mu * sum(one**2 for one in dev) + mu * sum(one**2 for one in dev - v)
    energy += s**2 * (1 - c * strain.trace() ** 2) + c * s * strain[0, 0]
    lost = mu * tau * sum(one**2 for one in flow) + eta / 2 * grows**2
    F, given = _random(0.1), {mu: MU, tau: TAU, c: 3.0, eta: 0.1}
    law = Dissipative(energy, lost, STATE, given, BULK)
    assert np.array_equal(law.at(0.3).stress(F), _law().at(0.3).stress(F))


def test_a_step_is_that_of_its_least() -> None:
    # v (1 + t/tau) = v_n + t/tau dev: the implicit step of Maxwell.
    law, before = _law(), np.zeros((20, 3, 3))
    for k, time in enumerate((0.2, 0.5, 3.0)):
        F = _random(0.05 * (k + 1))
        share = (time - law.since) / TAU
        before = (before + share * _strain(F)) / (1.0 + share)
        law = law.advanced(F, time)
        assert np.abs(_told(law) - before).max() < 1e-12
        assert np.abs(np.trace(_told(law), axis1=1, axis2=2)).max() < 1e-14


def test_moduli_are_the_derivative_of_the_stress_and_symmetric() -> None:
    F = _random(0.1)
    for law, time in ((_law(), 0.0), (_law(), 0.3), (_law().advanced(0.9 * F, 0.4), 1e3)):
        one, found = law.at(time), np.empty((20, 3, 3, 3, 3))
        for b, B in np.ndindex(3, 3):
            change = np.zeros((3, 3))
            change[b, B] = 1e-6
            found[..., b, B] = (one.stress(F + change) - one.stress(F - change)) / 2e-6
        moduli = one.tangent(F)
        assert np.abs(moduli - found).max() < 1e-7 * np.abs(moduli).max()
        assert np.abs(moduli - np.transpose(moduli, (0, 3, 4, 1, 2))).max() < 1e-12 * np.abs(moduli).max()


def test_a_rotation_after_turns_the_stress_and_leaves_the_state() -> None:
    F, Q = _random(0.1), Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix()
    law, turned = (_law().advanced(one, 0.5).at(0.7) for one in (F, Q @ F))
    assert np.abs(law.state - turned.state).max() < 1e-12
    assert np.abs(Q @ law.stress(1.01 * F) - turned.stress(1.01 * Q @ F)).max() < 1e-12


def test_random_paths_lose_energy() -> None:
    rng, law = np.random.default_rng(5), _law()
    F, stored, P = np.tile(np.eye(3), (60, 1, 1)), np.zeros(60), np.zeros((60, 3, 3))
    lost = np.zeros(60)
    for leg in range(2):
        way = 0.02 * rng.normal(size=F.shape)
        for k in range(15):
            time, before = 0.01 * (15 * leg + k + 1), P
            F = F + way / 15.0
            P, law = law.at(time).stress(F), law.advanced(F, time)
            now = law.energy(F)
            work = 0.5 * np.sum((before + P) * way / 15.0, axis=(1, 2))
            assert (work - (now - stored) > -2e-3 * np.abs(work).max()).all()
            lost, stored = lost + work - (now - stored), now
    assert lost.min() > 0.0


def test_where_there_is_no_least_there_is_no_stress() -> None:
    # What is stored bends down from a change of volume of exp(3^(-1/2)) on.
    wide = np.diag([1.3, 1.3, 1.3])[None]
    assert np.isnan(_law().at(1e3).stress(wide)).all()
    assert np.isfinite(_law().at(0.0).stress(wide)).all()


@pytest.mark.slow
def test_a_step_to_where_there_is_no_least_is_cut() -> None:
    made = Space(straight(0.2).sweep(circle(8, 1.0)), section_degree=2, elements=1, degree=2)
    ends = Support.end(made, "start"), Support.end(made, "end", displacement=(0.0, 0.0, 0.4))
    with pytest.raises(SolveError, match=r"SNES diverged .* element 0 of body 0"):
        statics.solve(Model([Body(made, _law())], ends), end_time=1e6)


def test_where_no_time_goes_by_it_is_as_stiff_as_at_once() -> None:
    F = _random(0.05)
    law = _law().at(0.5)
    after = law.advanced(F, 0.5)
    np.testing.assert_allclose(after.frozen.stress(F), law.stress(F), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(after.frozen.tangent(F), after.at(0.5).tangent(F), rtol=0.0, atol=1e-12)


def _bar() -> Model:
    made = Space(straight(2.0).sweep(circle(8, 1.0)), section_degree=2, elements=1, degree=2)
    return Model(
        [Body(made, _law(), 1.0)], [Support.end(made, "start"), Support.end(made, "end", displacement=(0.0, 0.0, 0.02))]
    )


test_what_is_lost_is_not_told = refused(
    (lambda: dynamics.solve(_bar(), 1.0), "material: Dissipative does not compute its dissipation; use statics"),
    (
        lambda: statics.solve(_bar(), 2, end_time=1.0).dissipated(0),
        "dissipated: Dissipative does not compute its dissipation",
    ),
)


test_bad_potentials = refused(
    (lambda: _law(energy=ENERGY + " + strain00"), "energy: stress and driving forces"),
    (lambda: _law(energy=ENERGY + " + s"), "energy: stress and driving forces"),
    (lambda: _law(constants=CONSTANTS | {"mu": 0.0}), "energy: not elliptic at rest"),
    (lambda: _law(energy=ENERGY + " + q"), "'q' is not known; need a constant, strain, or one of state"),
    (lambda: _law(energy="dev(strain)"), "which is a tensor, need a number"),
    (lambda: _law(energy="strain + 1"), "column 1: tensors take + and - with tensors, and * with numbers"),
    (lambda: _law(energy="strain**2"), "column 1: tensors take + and - with tensors"),
    (lambda: _law(energy="tr(s)"), "need tr(tensor), dev(tensor) or dot(tensor, tensor)"),
    (lambda: _law(energy="exp(strain)"), "column 1: exp of a tensor, need a number"),
    (lambda: _law(dissipation="-(" + LOST + ")"), "dissipation: some rates gain energy"),
    (lambda: _law(dissipation=LOST + " + 1"), "dissipation: need one of rates, zero where nothing flows"),
    (lambda: _law(dissipation=LOST + " + s"), "'s' is not known"),
    (lambda: _law(dissipation="mu*sqrt(dot(v_rate, v_rate)) + s_rate**2"), "no second derivative where nothing flows"),
    (lambda: _law(state={"v": "tensor"}), "state v: got 'tensor', need one of scalar, symmetric, deviatoric"),
    (lambda: _law(state={"v v": "scalar"}), "state: got the name 'v v', need one of letters and digits"),
    (
        lambda: _law(energy="*".join(f"(s + {k}*strain00)" for k in range(1, 40))),
        "energy: its second derivatives take about",
    ),
    (lambda: _law(state={"dissipated": "scalar"}), "state: got the name 'dissipated', which records and files"),
    (lambda: _law(state={}), "need 1 to 48 numbers"),
    (lambda: _law(constants=CONSTANTS | {"mu": float("nan")}), "constant mu: got nan, need a finite number"),
    (lambda: _law(constants=CONSTANTS | {"v": 1.0}), "constants: got the name 'v', need one that is not taken"),
    (lambda: _law(bulk=-1.0), "bulk: got -1, need a positive stress"),
)
