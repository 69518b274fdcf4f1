"""Laws from their stored energy: against ready laws, at repeated stretches, and what is refused."""

import numpy as np
import pytest
import sympy as sp
from refused import refused
from scipy.linalg import expm
from test_laws import F, close, differences

from isorod import Hyperelastic, InputError, MooneyRivlin, Muscle, NeoHookean, Ogden, StVenantKirchhoff, Yeoh
from isorod.material import symbols as s
from isorod.material.energy import pressure_at_rest, split
from isorod.material.functions import SPECTRAL, exp, expm1, log, principals
from isorod.material.legendre import transform
from isorod.material.places import alone
from isorod.material.points import POINTS

BUILT_IN = NeoHookean(2.0, 0.3)
MODULI = {"mu": BUILT_IN.mu, "lame": BUILT_IN.lame}
mu, lame, K = sp.symbols("mu lame K")
VOLUME = lame / 2 * sp.log(s.J) ** 2
NEO_HOOKE = mu / 2 * (s.I1 - 3 - 2 * sp.log(s.J)) + VOLUME
# As a person would who thinks in principal stretches: nothing is left of J.
PRODUCT = s.stretches[0] * s.stretches[1] * s.stretches[2]
STRETCHED = mu / 2 * (sum(x**2 for x in s.stretches) - 3 - 2 * sp.log(PRODUCT)) + lame / 2 * sp.log(PRODUCT) ** 2


def differ(one, other, F):
    """Return by how much energy, stress and tangent of two laws differ, relative to the largest."""
    pairs = [(getattr(one, name)(F), getattr(other, name)(F)) for name in ("energy", "stress", "tangent")]
    return [np.abs(x - y).max() / np.abs(x).max() for x, y in pairs]


def test_functions_are_those_of_numpy():
    rng = np.random.default_rng(0)
    x = np.concatenate([np.exp(rng.uniform(-300, 300, 300)), 1.0 + 10.0 ** rng.uniform(-12, -1, 300)])
    assert np.allclose([log(one) for one in x], np.log(x), rtol=1e-15, atol=0.0)
    x = rng.uniform(-5.0, 5.0, 300)
    assert np.allclose([exp(one) for one in x], np.exp(x), rtol=1e-15, atol=0.0)
    assert np.isnan([log(-1.0), log(0.0), log(np.nan), exp(np.nan)]).all()
    x *= 10.0 ** rng.uniform(-15, 0, 300)
    assert np.allclose([expm1(one) for one in x], np.expm1(x), rtol=1e-15, atol=0.0)
    assert exp(1000.0) == expm1(1000.0) == np.inf
    assert exp(-1000.0) < 1e-300


@pytest.mark.parametrize("apart", [0.0, 1e-15, 1e-9, 1e-4, 1.0])
def test_principal_directions_are_orthogonal_where_stretches_meet(apart):
    parts = np.random.default_rng(0).normal(size=(POINTS, 3, 3))
    C = np.diag([2.0, 1.0, 1.0]) + apart * (parts + np.swapaxes(parts, 1, 2))
    # Large beside small.
    C[:4] = np.diag([1e6, 1.0, 1e-6]) + apart * C[:4]
    rows = np.empty((SPECTRAL, POINTS))
    rows[:6] = [C[:, A, B] for A in range(3) for B in range(A, 3)]
    principals(rows.reshape(-1), POINTS)
    values, directions = rows[[0, 3, 5]].T, rows[6:].reshape(3, 3, POINTS).transpose(2, 0, 1)
    assert np.abs(directions @ np.swapaxes(directions, 1, 2) - np.eye(3)).max() < 1e-14
    again = np.einsum("ki,kiA,kiB->kAB", values, directions, directions)
    assert (np.abs(again - C).max(axis=(1, 2)) < 1e-14 * np.abs(C).max(axis=(1, 2))).all()


def test_a_law_from_its_energy_is_the_ready_one():
    law = Hyperelastic(NEO_HOOKE, MODULI)
    assert max(differ(BUILT_IN, law, F)) < 1e-14
    assert max(differ(BUILT_IN.shear, law.shear, F)) < 1e-14
    assert law.lame == pytest.approx(BUILT_IN.lame, rel=1e-14)
    assert law.modulus == pytest.approx(BUILT_IN.modulus, rel=1e-12)
    assert law.surface_modulus == pytest.approx(BUILT_IN.surface_modulus, rel=1e-12)
    assert law.nu == pytest.approx(BUILT_IN.nu, rel=1e-12)
    inverted = np.diag([-1.0, 1.0, 1.0])[None]
    assert np.isnan(law.stress(inverted)).all()
    assert np.isnan(law.tangent(inverted)).all()


def test_pressure_at_rest_is_made_up_for():
    law = Hyperelastic(mu / 2 * (s.I1 - 3), {"mu": BUILT_IN.mu}, bulk=BUILT_IN.lame)
    assert max(differ(BUILT_IN, law, F)) < 1e-14
    assert Hyperelastic(mu / 2 * (s.I1 - 3), {mu: 1.0}, bulk=np.inf).nu == 0.5


@pytest.mark.parametrize(
    ("energy", "pressure"),
    [(s.I1, 2), (s.I2, 4), (3 * s.J, 3), (sum(one**3 for one in s.stretches), 3), (s.I1bar + s.I2bar, 0)],
)
def test_pressure_at_rest_is_the_slope_by_a_swelling(energy, pressure):
    """Of ``F = (1 + x) 1``, whose volume grows by three times ``x``."""
    assert pressure_at_rest(energy) == pressure
    x = sp.Symbol("x", positive=True)
    swollen = {s.I1: 3 * (1 + x) ** 2, s.I2: 3 * (1 + x) ** 4, s.J: (1 + x) ** 3} | dict.fromkeys(s.stretches, 1 + x)
    assert sp.diff(energy.subs(swollen), x).subs(x, 0) / 3 == pressure


@pytest.mark.parametrize("apart", [0.0, 1e-12, 1e-8, 1e-6, 1e-5, 1e-3])
def test_principal_stretches_may_meet(apart):
    law = Hyperelastic(STRETCHED, MODULI)
    F = np.diag([1.3, 1.0, 1.0]) + apart * np.random.default_rng(1).normal(size=(20, 3, 3))
    assert max(differ(BUILT_IN, law, F)) < 1e-9
    close(law.tangent(F), differences(law.stress, F), 1e-9)


SMALL = [BUILT_IN, MooneyRivlin(1.0, 0.5, 20.0), Ogden([1.0], [3.0], 20.0), Yeoh(1, 1, 1, 9)]
SMALL += [Muscle(3.0, 0.3, 0.5, 0.4, 0.5, activation, (1.0, 0.0, 0.0)) for activation in (0.0, 0.6)]


@pytest.mark.slow
@pytest.mark.parametrize("law", SMALL)
@pytest.mark.parametrize("size", [1e-9, 1e-7, 1e-5])
def test_energies_of_very_small_strains_have_their_digits(law, size):
    """Of a unit load on steel nothing is left of ``I1 - 3 - 2 ln J`` but rounding; energies are half the work there."""
    strain = size * np.array([[1.0, 0.3, 0.0], [0.3, -0.4, 0.2], [0.0, 0.2, 0.5]])
    F = expm(np.cross(np.eye(3), [0.4, -0.3, 0.8])) @ (np.eye(3) + strain)
    half = 0.5 * np.einsum("aA,aB,AB", F, law.at(0.0).stress(F), strain)
    # Without the work of active fibres, which is beside it.
    assert law._evaluate(F)[0][..., 0] == pytest.approx(half, rel=1e-4)


def test_components_of_strain_do_as_well():
    strain = (s.C - sp.eye(3)) / 2
    law = Hyperelastic(mu * (strain * strain).trace() + lame / 2 * strain.trace() ** 2, MODULI)
    assert max(differ(StVenantKirchhoff(2.0, 0.3), law, F)) < 1e-13


@pytest.mark.slow
def test_tangents_with_all_that_an_energy_may_have():
    energy = s.I1bar + 0.3 * (s.I2bar - 3) * s.I1bar + 0.4 * (s.I4a - 1) ** 2 * s.I1bar + sp.exp(s.I4b - 1) - s.I4b
    energy += 0.2 * (s.I8 - sp.Rational(1, 2)) ** 2 + 0.1 * (s.I4a - 1) * (s.I4b - 1)
    law = Hyperelastic(energy, bulk=20.0, fibre=((0.0, 0.0, 1.0), (0.0, np.sqrt(0.75), 0.5)))
    close(law.tangent(F), differences(law.stress, F), 1e-9)


@pytest.mark.parametrize(
    "volume",
    [(s.J - 1) ** 2 / 2, (s.J**2 - 1 - 2 * sp.log(s.J)) / 4, (s.J**2 - 1) ** 2 / 8, sp.log(s.J) ** 2 / 2],
)
def test_any_energy_of_volume_splits(volume):
    energy = split(mu / 2 * (s.I1 - 3 - 2 * sp.log(s.J)) + K * volume, (mu, K))
    assert sp.simplify(energy.volume - volume) == 0
    assert sp.simplify(energy.shape - mu / 2 * (s.I1 - 3 - 2 * sp.log(s.J))) == 0
    p = np.linspace(-0.1, 3.0, 40)
    dual, theta, slope = transform(energy.volume, p / 5.0, 5.0)
    J = np.exp(theta)
    # p = J dU/dJ, and U* = p theta - U.
    assert np.allclose(5.0 * sp.lambdify(s.J, s.J * sp.diff(volume, s.J))(J), p, rtol=0.0, atol=1e-14)
    assert np.allclose(dual, p * theta - 5.0 * sp.lambdify(s.J, volume)(J), rtol=0.0, atol=1e-14)
    step = 1e-6
    ahead, behind = (transform(energy.volume, (p + way) / 5.0, 5.0)[1] for way in (step, -step))
    assert np.allclose((ahead - behind) / (2.0 * step), slope, rtol=1e-7)


def test_what_has_no_volume_does_not_split():
    assert split(mu * (s.I1 - 3) ** 2, (mu,)).volume is None
    assert split(mu * s.F[0, 0] ** 2, (mu,)).volume is None
    beyond = transform((s.J - 1) ** 2 / 2, np.array([-0.3]), 1.0)
    assert np.isnan(beyond).all()


FAMILY = (
    mu / 2 * (s.I1bar - 3)
    + K / 2 * (s.J - 1) ** 2
    + sp.Symbol("slope") * s.I1
    + sp.Symbol("root") * sp.sqrt(s.I1 - sp.Symbol("limit"))
    + sp.Symbol("large") * (sp.log(s.I1 - 2) - (s.I1 - 3) + (s.I1 - 3) ** 2 / 2)
)
GOOD = {"mu": 1.0, "K": 9.0, "slope": 0.0, "root": 0.0, "limit": -1.0, "large": 0.0}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"slope": 0.5}, r"not free of stress at rest, there is a pressure of -1;"),
        ({"mu": -1.0}, r"not elliptic at rest: the least modulus of plane waves is -1\.\d+"),
        ({"root": 1e-9, "limit": 3.0}, r"NaN at strains of 0\.08"),
        ({"large": 1e3}, r"at strains of 1e-08 is off by [\d.]+ %: cancellation"),
    ],
)
def test_a_bad_law_is_told_which_check_fails_and_by_how_much(changed, message):
    assert Hyperelastic(FAMILY, GOOD).lame == 9.0
    with pytest.raises(InputError, match=message) as caught:
        Hyperelastic(FAMILY, GOOD | changed)
    assert "\n" not in str(caught.value)


def test_a_stress_at_rest_may_be_meant():
    law = Hyperelastic(FAMILY, GOOD | {"slope": 0.5}, prestressed=True)
    assert law.stress(np.eye(3)[None])[0] == pytest.approx(np.eye(3))


def test_rotations_that_change_an_energy_are_seen():
    strain = (s.F + s.F.T) / 2 - sp.eye(3)
    with pytest.raises(InputError, match=r"not objective: a rotation changes it by [\d.e+]+ %"):
        Hyperelastic(mu * (strain * strain).trace(), {mu: 1.0})


test_refuses_energies_that_cannot_be = refused(
    (lambda F: F[0, 0], {}, "energy: got a function, need an expression of SymPy"),
    (mu * s.I1 + sp.Symbol("q"), {"mu": 1.0}, "q is neither a constant that is given nor a symbol of"),
    (mu * (s.I1 - 3), {"mu": np.nan}, "constant mu: got nan"),
    (sp.gamma(s.J), {}, "is not one that laws are compiled with"),
    (s.F[0, 0] * s.stretches[0], {}, "cannot stand together"),
    by=Hyperelastic,
)


def test_bulk_is_a_positive_stress():
    with pytest.raises(InputError, match="bulk: got -1, need a positive stress"):
        Hyperelastic(s.I1 - 3, bulk=-1.0)


def test_compiled_code_is_kept_for_other_processes():
    law = Hyperelastic(NEO_HOOKE, MODULI).placed(alone())
    law.tangent(np.eye(3)[None])
    assert law.compiled._tangent.kept
    assert law.compiled._block.kept


def test_a_law_is_told_from_others_by_its_energy():
    """What a motion is resumed with has to be the same law, with the same constants."""
    law, other = Hyperelastic(NEO_HOOKE, MODULI), Hyperelastic(STRETCHED, MODULI)
    assert law.identity != other.identity
    assert law.identity != Hyperelastic(NEO_HOOKE, MODULI | {"mu": 2.0}).identity
    assert law.identity == Hyperelastic(NEO_HOOKE, MODULI).identity
