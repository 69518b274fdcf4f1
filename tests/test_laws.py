"""Ready laws from energies: stress and tangent, Newton's order, torsion against quadrature, values of others."""

import math

import numpy as np
import pytest
from conftest import as_array, straight
from energies import by_complex_steps

from comparisons.laws.torsion import ARTERY, CASES, STRETCHES, TRELOAR, taken, twisted
from comparisons.measure.convergence import newton_orders
from isorod.assembly.assembler import Assembler
from isorod.assembly.mixed import MixedAssembler
from isorod.errors import InputError
from isorod.material import symbols
from isorod.material.fibre import helix
from isorod.material.gent import Gent
from isorod.material.holzapfel_gasser_ogden import HolzapfelGasserOgden
from isorod.material.mooney_rivlin import MooneyRivlin
from isorod.material.ogden import Ogden
from isorod.material.places import alone
from isorod.material.proof import prove
from isorod.material.yeoh import Yeoh
from isorod.model import Body, Model, Support
from isorod.space import Space

TWO = (helix(30.0), helix(-30.0))
LAWS = {
    "MooneyRivlin": MooneyRivlin(0.3, 0.2, 20.0),
    "Yeoh": Yeoh(0.5, -0.1, 0.03, 20.0),
    "Gent": Gent(1.0, 10.0, 20.0),
    "Ogden": Ogden(*TRELOAR, 10.0),
    "HolzapfelGasserOgden": HolzapfelGasserOgden(*ARTERY, 50.0),
    "of two families": HolzapfelGasserOgden(*ARTERY, 50.0, 0.0, TWO),
    "dispersed": HolzapfelGasserOgden(*ARTERY, 50.0, 0.15, TWO),
}
# Each law is compiled, for some seconds, where no other run has left it: two of them stand for all.
QUICK = ("Ogden", "HolzapfelGasserOgden")


def each(names):
    return [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in names]


def gradients():
    """Deformations anywhere, and such of which two or three principal stretches are, or nearly are, the same."""
    rng = np.random.default_rng(0)
    F = np.eye(3) + 0.25 * rng.uniform(-1.0, 1.0, (30, 3, 3))
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    same = [turn @ np.diag(one) for one in ([1.2, 1.2, 1.2], [1.3, 1.3, 0.8], [0.9, 1.1, 1.1], [1.2, 1.2 + 1e-7, 0.9])]
    return np.concatenate([F, same, np.array([turn.T @ one @ turn for one in same])])


def differences(f, F, step=1e-5):
    """Return the derivatives of a function of ``F``, by differences of fourth order."""
    found = []
    for a in range(3):
        for A in range(3):
            move = np.zeros((3, 3))
            move[a, A] = step
            near, far = f(F + move) - f(F - move), f(F + 2 * move) - f(F - 2 * move)
            found.append((8.0 * near - far) / (12.0 * step))
    return np.stack(found, axis=-1).reshape(*found[0].shape, 3, 3)


@pytest.mark.parametrize(
    ("name", "stored"),
    [
        ("MooneyRivlin", lambda first, second: 0.3 * (first - 3.0) + 0.2 * (second - 3.0)),
        ("Yeoh", lambda first, second: 0.5 * (first - 3.0) - 0.1 * (first - 3.0) ** 2 + 0.03 * (first - 3.0) ** 3),
        ("Gent", lambda first, second: -5.0 * np.log(1.0 - (first - 3.0) / 10.0)),
    ],
)
def test_energies_are_those_of_the_literature(name, stored):
    """By invariants of the isochoric part, and ``bulk/2 (ln J)^2``; nothing is compiled."""
    law, (a, b, c) = LAWS[name], (1.3, 0.9, 0.8)
    J = a * b * c
    first, second = (
        J ** (-2.0 / 3.0) * (a * a + b * b + c * c),
        J ** (-4.0 / 3.0) * (a * a * b * b + b * b * c * c + c * c * a * a),
    )
    constants = dict(zip(law.stored.constants, law.constants, strict=True))
    told = law.stored.expression.subs({symbols.I1bar: first, symbols.I2bar: second, symbols.J: J}).subs(constants)
    assert float(told) == pytest.approx(stored(first, second) + 10.0 * np.log(J) ** 2, rel=1e-12)


@pytest.mark.parametrize("name", each(LAWS))
def test_stress_and_tangent_are_derivatives(name):
    law, F = LAWS[name].placed(alone()), gradients()
    prove(LAWS[name], prestressed=False)
    stress, tangent = law.stress(F), law.tangent(F)
    np.testing.assert_allclose(stress, differences(law.energy, F), atol=1e-8 * np.abs(stress).max())
    np.testing.assert_allclose(tangent, differences(law.stress, F), atol=1e-8 * np.abs(tangent).max())
    assert np.isnan(law.stress(np.diag([1.0, 1.0, -1.0])[None])).any()


@pytest.mark.parametrize("name", each(LAWS))
def test_energy_and_stress_are_those_of_the_expression(name):
    law, F = LAWS[name].placed(alone()), gradients()
    for one, energy, stress in zip(F[:30], law.energy(F), law.stress(F), strict=False):
        value, slope = by_complex_steps(law, one)
        assert energy == pytest.approx(value, abs=1e-12 * law.modulus)
        np.testing.assert_allclose(stress, slope, rtol=0.0, atol=1e-12 * law.modulus)


@pytest.mark.parametrize("name", each(LAWS))
@pytest.mark.parametrize("formulation", ["displacement", "mixed"])
def test_a_rods_tangent_is_the_derivative_of_its_forces(name, formulation):
    where = Space.paper(straight(4), elements=2, degree=2, order=2)
    model = Model([Body(where, LAWS[name], formulation=formulation)], [Support.end(where, "start")])
    assembler = (MixedAssembler if formulation == "mixed" else Assembler)(model)
    f, g = assembler.vector(), assembler.vector()
    # Pulled, so that no fibre is where it begins to bear.
    pulled = np.outer(where.positions[:, 2], [0.0, 0.0, 0.2])
    x = assembler.state((pulled + 0.005 * np.random.default_rng(5).standard_normal(pulled.shape)).ravel())
    tangent = assembler.matrix()
    assembler.tangent(x, 1.0, tangent)
    K, step = as_array(tangent), 1e-5
    for k in range(0, x.getSize(), 7):
        y = x.copy()
        y.array[k] += step
        assembler.residual(y, 1.0, f)
        y.array[k] -= 2.0 * step
        assembler.residual(y, 1.0, g)
        assert np.abs((f.array - g.array) / (2.0 * step) - K[:, k]).max() < 1e-6 * np.abs(K).max()


@pytest.mark.parametrize("name", each(CASES))
@pytest.mark.parametrize("stretch", STRETCHES)
def test_torsion_and_extension_are_those_of_quadrature(name, stretch):
    case = CASES[name]
    solution = twisted(case.law, stretch)
    found = solution.moments[1, 2], solution.reactions[1, 2]
    assert found == pytest.approx(taken(case.stored, stretch), rel=1e-7)
    order = newton_orders(solution.residual_norms)
    print(name, stretch, "orders", *(f"{one:.2f}" for one in order))
    # Newton's method is quadratic, but for a last correction that is rounding.
    assert solution.load_steps == 1
    assert max(order[-2:]) > 1.75


def test_torsion_of_closed_form():
    assert taken(CASES["NeoHookean"].stored) == pytest.approx((np.pi / 4.0, -np.pi / 16.0), rel=1e-12)
    # Mooney-Rivlin, by Rivlin: M = pi tau (c10 + c01), N = - pi tau^2/2 (c10 + 2 c01).
    assert taken(CASES["MooneyRivlin"].stored) == pytest.approx((np.pi / 4.0, -np.pi / 8.0 * 0.7), rel=1e-12)
    assert taken(CASES["Ogden"].stored) == pytest.approx((0.327188, -0.096960), abs=5e-7)


def pulled(law, stretch):
    """Nominal stress of an incompressible law that is pulled along z, the sides free."""
    F = np.diag([stretch**-0.5, stretch**-0.5, stretch])[None]
    P = law.shear.placed(alone()).stress(F)[0]
    return P[2, 2] - P[0, 0] * stretch**-1.5


def test_stresses_of_treloars_rubber():
    law = Ogden(*TRELOAR, math.inf)
    assert [pulled(law, one) for one in (2.0, 3.0, 4.0)] == pytest.approx([0.602722, 0.879926, 1.207971], abs=5e-7)


def test_stresses_of_an_artery_whose_fibres_bear_no_compression():
    law = HolzapfelGasserOgden(*ARTERY, math.inf)
    stress = [one * pulled(law, one) for one in (1.1, 1.2)]
    assert stress == pytest.approx([2.148990, 5.343007], abs=5e-7)
    assert pulled(law, 0.9) == pytest.approx(3.0 * (0.9 - 0.9**-2), rel=1e-12)


def test_a_swollen_law_of_fibres_does_not_stay_a_sphere():
    """Nolan et al.: fibres take the whole deformation; in a ball that swells they pull."""
    stress = HolzapfelGasserOgden(*ARTERY, 50.0).placed(alone()).stress(1.1 * np.eye(3)[None])[0]
    fibre = 2.0 * 1.1 * 2.3632 * 0.21 * np.exp(0.8393 * 0.21**2)
    assert stress[2, 2] - stress[0, 0] == pytest.approx(fibre, rel=1e-12)


def test_moduli_at_rest():
    for name in QUICK:
        law = LAWS[name]
        expected = {"Ogden": 0.4225, "HolzapfelGasserOgden": 3.0}[name]
        assert law.shear_modulus == pytest.approx(expected, rel=1e-9)
    assert LAWS["Ogden"].modulus == pytest.approx(10.0 + 4.0 / 3.0 * 0.4225, rel=1e-9)
    # Taut fibres count: c/2 (I1bar - 3), k1/2 (I4 - 1)^2 along them.
    assert LAWS["HolzapfelGasserOgden"].modulus == pytest.approx(50.0 + 4.0 + 4.0 * 2.3632, rel=1e-7)
    assert Ogden(*TRELOAR, math.inf).nu == 0.5


def test_laws_of_the_same_constants_are_the_same():
    assert MooneyRivlin(1, 2.0, 3.0) == MooneyRivlin(1.0, 2.0, 3.0) != MooneyRivlin(1.0, 2.0, 4.0)
    assert Ogden([1.0], [2.0], 3.0) == Ogden((1,), (2,), 3) and len({Gent(1, 2, 3), Gent(1.0, 2.0, 3.0)}) == 1
    assert Yeoh(1.0, 2.0, 3.0, 4.0).stored is Yeoh(2.0, 2.0, 3.0, 4.0).stored


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: MooneyRivlin(0.1, -0.2, 1.0), "c10 + c01: got -0.1, need a positive stress"),
        (lambda: MooneyRivlin(math.nan, 0.2, 1.0), "c10: got nan, need a finite stress"),
        (
            lambda: MooneyRivlin(0.1, 0.2, 0.0),
            "bulk: got 0, need a positive stress, infinite for an incompressible law",
        ),
        (lambda: MooneyRivlin(0.1, "x", 1.0), "MooneyRivlin: c01: got 'x', need a number"),
        (lambda: Yeoh(-1.0, 0.0, 0.0, 1.0), "c10: got -1, need a positive stress"),
        (lambda: Yeoh(1.0, 0.0, math.inf, 1.0), "c30: got inf, need a finite stress"),
        (lambda: Gent(1.0, 0.0, 1.0), "limit: got 0, need a positive number that I1bar - 3 does not reach"),
        (lambda: Gent(1e200, 1.0, 1.0), "mu: got 1e+200, need 1e-100 to 1e100; choose other units"),
        (lambda: Ogden((1.0, 2.0), (1.0,), 1.0), "alpha: got 1 exponents for 2 factors mu, need one for each"),
        (lambda: Ogden((), (), 1.0), "alpha: got 0 exponents for 0 factors mu, need one for each"),
        (lambda: Ogden((1.0,), (0.0,), 1.0), "alpha[0]: got 0, need an exponent that is not zero"),
        (lambda: Ogden((1.0,), (-2.0,), 1.0), "sum of mu alpha / 2: got -1, need a positive stress"),
        (lambda: HolzapfelGasserOgden(1.0, 1.0, 0.0, 1.0), "k2: got 0, need a positive exponent"),
        (
            lambda: HolzapfelGasserOgden(1.0, 1.0, 1.0, 1.0, 0.4),
            "dispersion: got 0.4, need 0 (parallel fibres) to 1/3 (isotropic)",
        ),
        (
            lambda: HolzapfelGasserOgden(1.0, 1.0, 1.0, 1.0, fibre=("tangent", (0.0, 0.0, 0.0))),
            "fibre direction: got (0, 0, 0), need a finite vector, not zero",
        ),
    ],
)
def test_bad_constants_get_one_line(make, message):
    with pytest.raises(InputError) as error:
        make()
    assert str(error.value) == message
