"""Stored-energy laws: stress and tangent are derivatives of the energy, and the energy is what it should be."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isorod.errors import InputError
from isorod.material import LinearElastic, NeoHookean

LAWS = [
    NeoHookean(2.0, 0.3),
    NeoHookean(1.0, -0.4),
    NeoHookean(1.0, 0.0),
    NeoHookean(3.0, 0.49),
    LinearElastic(2.0, 0.3),
]
EYE = np.eye(3)
WEIGHTS = (4 / 5, -1 / 5, 4 / 105, -1 / 280)


@pytest.fixture(params=LAWS, ids=str)
def law(request):
    return request.param


def gradients(count=20, size=0.25, seed=0):
    return EYE + size * np.random.default_rng(seed).uniform(-1, 1, (count, 3, 3))


def rotation(a, b, c):
    x, y, z = (
        np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]),
        np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]]),
        np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]]),
    )
    return x @ y @ z


def difference(f, F, a, A, h=5e-3):
    step = np.zeros((3, 3))
    step[a, A] = h
    return sum(w * (f(F + k * step) - f(F - k * step)) for k, w in enumerate(WEIGHTS, 1)) / h


def test_stress_is_the_derivative_of_the_energy(law):
    F = gradients()
    stress = law.stress(F)
    for a in range(3):
        for A in range(3):
            assert np.abs(difference(law.energy, F, a, A) - stress[:, a, A]).max() < 1e-10 * np.abs(stress).max()


def test_tangent_is_the_derivative_of_the_stress(law):
    F = gradients()
    tangent = law.tangent(F)
    for b in range(3):
        for B in range(3):
            error = difference(law.stress, F, b, B) - tangent[..., b, B]
            assert np.abs(error).max() < 1e-10 * np.abs(tangent).max()


def test_tangent_has_major_symmetry(law):
    tangent = law.tangent(gradients())
    assert np.abs(tangent - tangent.transpose(0, 3, 4, 1, 2)).max() < 1e-14 * np.abs(tangent).max()


angles = st.floats(-np.pi, np.pi)


@given(a=angles, b=angles, c=angles, seed=st.integers(0, 99))
def test_neo_hookean_is_frame_indifferent_and_isotropic(a, b, c, seed):
    law, Q, F = LAWS[0], rotation(a, b, c), gradients(5, seed=seed)
    scale = np.abs(law.stress(F)).max()
    assert np.abs(law.energy(Q @ F) - law.energy(F)).max() < 1e-13
    assert np.abs(law.energy(F @ Q) - law.energy(F)).max() < 1e-13
    assert np.abs(law.stress(Q @ F) - Q @ law.stress(F)).max() < 1e-13 * max(scale, 1)
    assert np.abs(law.stress(F @ Q) - law.stress(F) @ Q).max() < 1e-13 * max(scale, 1)


def test_neo_hookean_is_the_formula_of_the_paper():
    law, F = NeoHookean(2.0, 0.3), gradients()
    mu, kappa = 2.0 / 2.6, 2.0 * 0.3 / (1.3 * 0.4)
    log = np.log(np.linalg.det(F))
    energy = mu / 2 * (np.trace(F.swapaxes(1, 2) @ F, axis1=1, axis2=2) - 2 * log - 3) + kappa / 2 * log**2
    assert law.energy(F) == pytest.approx(energy, rel=1e-13)
    assert (law.mu, law.lame) == pytest.approx((mu, kappa), rel=1e-15)


def test_rest_has_no_energy_and_no_stress(law):
    assert law.energy(EYE[None]) == 0
    assert np.abs(law.stress(EYE[None])).max() < 1e-15


@pytest.mark.parametrize(("E", "nu"), [(2.0, 0.3), (5.0, -0.5), (1.0, 0.49)])
def test_linear_law_is_the_linearisation_of_neo_hookean_at_rest(E, nu):
    linear = LinearElastic(E, nu).tangent(EYE[None])
    assert np.abs(NeoHookean(E, nu).tangent(EYE[None]) - linear).max() < 1e-14 * np.abs(linear).max()


def test_linear_law_shows_E_and_nu_in_simple_tension():
    strain = np.diag([-0.3, -0.3, 1.0]) * 1e-3
    assert np.abs(LinearElastic(7.0, 0.3).stress((EYE + strain)[None])[0] - np.diag([0, 0, 7e-3])).max() < 1e-15


def test_linear_law_does_not_see_infinitesimal_rotations():
    W = np.array([[0, 1, -2], [-1, 0, 3], [2, -3, 0]]) * 0.1
    assert np.abs(LinearElastic(1.0, 0.3).stress((EYE + W)[None])).max() < 1e-15


@pytest.mark.parametrize("F", [np.diag([1, 1, 0.0]), np.diag([1, 1, -1.0]), -EYE, np.full((3, 3), np.nan)])
def test_neo_hookean_is_nan_where_the_determinant_is_not_positive(F):
    law, pair = LAWS[0], np.stack([EYE, F])
    with np.errstate(invalid="ignore"):
        values = law.energy(pair), law.stress(pair), law.tangent(pair)
    for value in values:
        assert np.isfinite(value[0]).all()
        assert np.isnan(value[1]).any()
    assert np.isnan(law.stress(pair)[1]).all()


def test_any_leading_shape_and_memory_layout(law):
    F = gradients(24).reshape(2, 3, 4, 3, 3)
    turned = np.ascontiguousarray(F.transpose(2, 1, 0, 3, 4)).transpose(2, 1, 0, 3, 4)
    for f in (law.energy, law.stress, law.tangent):
        assert f(F).shape[:3] == (2, 3, 4)
        assert np.array_equal(f(turned), f(F))
    assert np.array_equal(law.stress(F)[1, 2, 3], law.stress(F[1, 2, 3][None])[0])


@pytest.mark.parametrize("kind", [NeoHookean, LinearElastic])
@pytest.mark.parametrize(
    ("E", "nu", "message"),
    [
        (0.0, 0.3, "E: got 0, need a positive stress"),
        (-1.0, 0.3, "E: got -1, need"),
        (np.nan, 0.3, "E: got nan, need"),
        (np.inf, 0.3, "E: got inf, need"),
        (1.0, 0.51, "nu: got 0.51, need -1 < nu <= 0.5"),
        (1.0, 0.7, "nu: got 0.7, need"),
        (1.0, -1.0, "nu: got -1, need"),
        (1.0, np.nan, "nu: got nan, need"),
    ],
)
def test_refuses_constants_that_cannot_be(kind, E, nu, message):
    with pytest.raises(InputError, match=message) as caught:
        kind(E, nu)
    assert "\n" not in str(caught.value)
