"""Values of laws: formulas of the literature, torsion against quadrature, moduli at rest, and refused constants."""

import math
from dataclasses import replace

import numpy as np
import pytest
from test_laws import EYE, LAWS, F, close

from comparisons.laws.torsion import ARTERY, CASES, STRETCHES, TRELOAR, taken, twisted
from comparisons.measure.convergence import newton_orders
from isorod import Gent, HolzapfelGasserOgden, InputError, MooneyRivlin, Ogden, StVenantKirchhoff, Yeoh
from isorod.material import LinearElastic, NeoHookean, symbols
from isorod.material.orthotropic import Orthotropic, TransverselyIsotropic
from isorod.material.orthotropic_kirchhoff import OrthotropicKirchhoff
from isorod.material.places import alone


def test_neo_hookean_is_the_formula_of_the_paper():
    law = NeoHookean(2.0, 0.3)
    mu, kappa = 2.0 / 2.6, 2.0 * 0.3 / (1.3 * 0.4)
    log = np.log(np.linalg.det(F))
    energy = mu / 2 * (np.trace(F.swapaxes(1, 2) @ F, axis1=1, axis2=2) - 2 * log - 3) + kappa / 2 * log**2
    assert law.energy(F) == pytest.approx(energy, rel=1e-13)
    assert (law.mu, law.lame) == pytest.approx((mu, kappa), rel=1e-15)


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
    first = J ** (-2.0 / 3.0) * (a * a + b * b + c * c)
    second = J ** (-4.0 / 3.0) * (a * a * b * b + b * b * c * c + c * c * a * a)
    constants = dict(zip(law.stored.constants, law.constants, strict=True))
    told = law.stored.expression.subs({symbols.I1bar: first, symbols.I2bar: second, symbols.J: J}).subs(constants)
    assert float(told) == pytest.approx(stored(first, second) + 10.0 * np.log(J) ** 2, rel=1e-12)


@pytest.mark.parametrize("E, nu", [(2.0, 0.3), (5.0, -0.5), (1.0, 0.49)])
def test_at_rest_isotropic_laws_are_linear_elasticity(E, nu):
    """And those with directions, of moduli without any, everywhere what these are."""
    linear, G = LinearElastic(E, nu), E / (2.0 + 2.0 * nu)
    moduli = ((E,) * 3, (nu,) * 3, (G,) * 3, ((1.0, 2.0, 0.5), (0.3, -1.0, 0.8)))
    for law in (NeoHookean(E, nu), StVenantKirchhoff(E, nu), OrthotropicKirchhoff(*moduli)):
        close(law.tangent(EYE[None]), linear.tangent(EYE[None]), 1e-13)
    alike = [(OrthotropicKirchhoff(*moduli), StVenantKirchhoff(E, nu)), (Orthotropic(*moduli), linear)]
    alike.append((TransverselyIsotropic(E, E, nu, nu, G, fibre=(1.0, 2.0, -1.0)), linear))
    for law, plain in alike:
        for name in ("energy", "stress", "tangent"):
            close(getattr(law, name)(F), getattr(plain, name)(F), 1e-13)
        assert law.modulus == pytest.approx(plain.modulus, rel=1e-12 if plain is linear else 1e-8)
        assert law.surface_modulus == pytest.approx(plain.surface_modulus, rel=1e-12 if plain is linear else 1e-8)
    strain = 1e-3 * np.diag([-nu, -nu, 1.0])
    close(linear.stress((EYE + strain)[None])[0], np.diag([0.0, 0.0, 1e-3 * E]), 1e-11)


def test_small_strains_are_those_of_the_linear_law_and_keep_their_digits():
    """The energy, of squares of strains, has as many as these have in ``F``."""
    close(LAWS["OrthotropicKirchhoff"].stress(EYE + 1e-6 * F), LAWS["Orthotropic"].stress(EYE + 1e-6 * F), 1e-5)
    law = LAWS["StVenantKirchhoff"]
    for size in (1e-3, 1e-6, 1e-9):
        change = (EYE + size * F) - EYE
        strain = 0.5 * (change + change.swapaxes(1, 2) + change.swapaxes(1, 2) @ change)
        energy = law.mu * np.sum(strain**2, axis=(1, 2)) + 0.5 * law.lame * np.trace(strain, axis1=1, axis2=2) ** 2
        assert law.energy(EYE + size * F) == pytest.approx(energy, rel=3e-15 / size)


# Each law is compiled, for some seconds, where no other run has left it: two of them stand for all.
@pytest.mark.parametrize(
    "name",
    [one if one in ("Ogden", "HolzapfelGasserOgden") else pytest.param(one, marks=pytest.mark.slow) for one in CASES],
)
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


def test_stresses_of_treloars_rubber_and_of_an_artery_whose_fibres_bear_no_compression():
    rubber, artery = Ogden(*TRELOAR, math.inf), HolzapfelGasserOgden(*ARTERY, math.inf)
    assert [pulled(rubber, one) for one in (2.0, 3.0, 4.0)] == pytest.approx([0.602722, 0.879926, 1.207971], abs=5e-7)
    assert [one * pulled(artery, one) for one in (1.1, 1.2)] == pytest.approx([2.148990, 5.343007], abs=5e-7)
    assert pulled(artery, 0.9) == pytest.approx(3.0 * (0.9 - 0.9**-2), rel=1e-12)
    # Nolan et al.: fibres take the whole deformation; in a ball that swells they pull.
    stress = HolzapfelGasserOgden(*ARTERY, 50.0).placed(alone()).stress(1.1 * EYE[None])[0]
    fibre = 2.0 * 1.1 * 2.3632 * 0.21 * np.exp(0.8393 * 0.21**2)
    assert stress[2, 2] - stress[0, 0] == pytest.approx(fibre, rel=1e-12)


def test_moduli_at_rest():
    for name, expected in {"Ogden": 0.4225, "HolzapfelGasserOgden": 3.0}.items():
        assert LAWS[name].shear_modulus == pytest.approx(expected, rel=1e-9)
    assert LAWS["Ogden"].modulus == pytest.approx(10.0 + 4.0 / 3.0 * 0.4225, rel=1e-9)
    # Taut fibres count: c/2 (I1bar - 3), k1/2 (I4 - 1)^2 along them.
    assert HolzapfelGasserOgden(*ARTERY, 50.0).modulus == pytest.approx(50.0 + 4.0 + 4.0 * 2.3632, rel=1e-7)
    assert Ogden(*TRELOAR, math.inf).nu == 0.5


def test_laws_of_the_same_constants_are_the_same():
    assert MooneyRivlin(1, 2.0, 3.0) == MooneyRivlin(1.0, 2.0, 3.0) != MooneyRivlin(1.0, 2.0, 4.0)
    assert Ogden([1.0], [2.0], 3.0) == Ogden((1,), (2,), 3) and len({Gent(1, 2, 3), Gent(1.0, 2.0, 3.0)}) == 1
    assert Yeoh(1.0, 2.0, 3.0, 4.0).stored is Yeoh(2.0, 2.0, 3.0, 4.0).stored


STRESS = "need a positive stress"
BAD = [
    ("NeoHookean", {"E": 0.0}, f"E: got 0, {STRESS}"),
    ("NeoHookean", {"E": -1.0}, "E: got -1, need"),
    ("NeoHookean", {"E": math.nan}, "E: got nan, need"),
    ("NeoHookean", {"E": math.inf}, "E: got inf, need"),
    ("NeoHookean", {"nu": 0.51}, "nu: got 0.51, need -1 < nu <= 0.5"),
    ("NeoHookean", {"nu": -1.0}, "nu: got -1, need"),
    ("NeoHookean", {"nu": math.nan}, "nu: got nan, need"),
    ("LinearElastic", {"E": -1.0}, "E: got -1, need"),
    ("LinearElastic", {"nu": 0.7}, "nu: got 0.7, need"),
    ("Muscle", {"E": -1.0}, "E: got -1"),
    ("Muscle", {"nu": 0.6}, "nu: got 0.6"),
    ("Muscle", {"activation": 1.1}, "activation: got 1.1, need 0"),
    ("Muscle", {"activation": -0.1}, "activation: got -0.1, need 0"),
    ("Muscle", {"activation": math.nan}, "activation: got nan"),
    ("Muscle", {"sigma_max": -1.0}, "sigma_max: got -1, need a stress, not negative"),
    ("Muscle", {"sigma_max": math.inf}, "sigma_max: got inf"),
    ("Muscle", {"m1": -2.0}, "m1: got -2, need a stress, not negative"),
    ("Muscle", {"m2": -0.5}, "m2: got -0.5, need an exponent, not negative"),
    ("Muscle", {"fibre": (0, 0, 0)}, "fibre direction: got (0, 0, 0), need a finite vector, not zero"),
    ("Muscle", {"fibre": (0, math.nan, 0)}, "need a finite vector"),
    ("Muscle", {"fibre": [(1, 0, 0), (0, 0, 0)]}, "got (0, 0, 0)"),
    ("Muscle", {"fibre": (0, 1)}, "got shape (2,), need (3,)"),
    ("Muscle", {"fibre": "along"}, "got 'along', need a vector"),
    ("MooneyRivlin", {"c10": 0.1, "c01": -0.2}, f"c10 + c01: got -0.1, {STRESS}"),
    ("MooneyRivlin", {"c10": math.nan}, "c10: got nan, need a finite stress"),
    ("MooneyRivlin", {"bulk": 0.0}, f"bulk: got 0, {STRESS}, infinite for an incompressible law"),
    ("MooneyRivlin", {"c01": "x"}, "MooneyRivlin: c01: got 'x', need a number"),
    ("Yeoh", {"c10": -1.0}, f"c10: got -1, {STRESS}"),
    ("Yeoh", {"c30": math.inf}, "c30: got inf, need a finite stress"),
    ("Gent", {"limit": 0.0}, "limit: got 0, need a positive number that I1bar - 3 does not reach"),
    ("Gent", {"mu": 1e200}, "mu: got 1e+200, need 1e-100 to 1e100; choose other units"),
    ("Ogden", {"mu": (1.0, 2.0), "alpha": (1.0,)}, "alpha: got 1 exponents for 2 factors mu, need one for each"),
    ("Ogden", {"mu": (), "alpha": ()}, "alpha: got 0 exponents for 0 factors mu, need one for each"),
    ("Ogden", {"mu": (1.0,), "alpha": (0.0,)}, "alpha[0]: got 0, need an exponent that is not zero"),
    ("Ogden", {"mu": (1.0,), "alpha": (-2.0,)}, f"sum of mu alpha / 2: got -1, {STRESS}"),
    ("HolzapfelGasserOgden", {"k2": 0.0}, "k2: got 0, need a positive exponent"),
    ("HolzapfelGasserOgden", {"dispersion": 0.4}, "dispersion: got 0.4, need 0 (parallel fibres) to 1/3 (isotropic)"),
    ("HolzapfelGasserOgden", {"fibre": ("tangent", (0, 0, 0))}, "fibre direction: got (0, 0, 0), need a finite vector"),
    ("Orthotropic", {"E": (1.0, -1.0, 1.0)}, "E2: got -1"),
    ("Orthotropic", {"G": (1.0, 1.0, 0.0)}, f"G23: got 0, {STRESS}"),
    (
        "Orthotropic",
        {"E": (4.0, 1.0, 1.0), "nu": (2.1, 0.0, 0.0)},
        "nu12: got 2.1, need less than sqrt(E1 / E2) = 2",
    ),
    ("Orthotropic", {"nu": (0.9, 1.1, 0.9)}, "nu12 nu21 - nu13 nu31 - nu23 nu32 - 2 nu21 nu32 nu13 is -"),
    ("Orthotropic", {"E": (1.0, 2.0)}, "E: got (1.0, 2.0), need 3 numbers"),
    ("Orthotropic", {"axes": ("tangent",)}, "axes: got 1 directions, need two"),
    ("Orthotropic", {"axes": ("tangent", "up")}, "axis 2: got 'up', need a vector"),
    ("Orthotropic", {"axes": ((0, 0, 1), (0, 0, -2))}, "axis 2 runs along axis 1"),
    ("TransverselyIsotropic", {"nu_across": 1.0}, "nu_across: got 1, need -1 < nu_across < 1"),
    ("TransverselyIsotropic", {"nu": 4.0}, "nu: got 4, need less than sqrt(E / E_across) = 3.801"),
    ("TransverselyIsotropic", {"E_across": math.nan}, "E_across: got nan"),
]


@pytest.mark.parametrize("name, changes, message", BAD, ids=str)
def test_constants_that_cannot_be_get_one_line(name, changes, message):
    with pytest.raises(InputError) as caught:
        replace(LAWS[name], **changes)
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_what_is_no_number_stays_none_without_a_word(python):
    done = python(
        "import numpy as np\nfrom isorod import StVenantKirchhoff\n"
        "print(np.isnan(StVenantKirchhoff(1.0, 0.3).stress(np.full((1, 3, 3), np.nan))).all())"
    )
    assert (done.stdout, done.stderr) == ("True\n", "")


def test_laws_load_nothing_of_sympy_until_their_energy_is_asked_for(python):
    done = python(
        "import sys, isorod, numpy\n"
        "isorod.Muscle(30.0, 0.4, 30.0, 5.0, 0.5, 1.0, (0, 0, 1)).stress(numpy.eye(3)[None])\n"
        "isorod.Ogden([1.0], [2.0], 50.0), isorod.HolzapfelGasserOgden(1.0, 1.0, 1.0, 50.0), isorod.Gent(1, 9, 50)\n"
        "print('sympy' in sys.modules, isorod.NeoHookean(1.0, 0.3).stored.shape, 'sympy' in sys.modules)"
    )
    assert (done.stdout, done.stderr) == ("False mu*(I1 - 2*log(J) - 3)/2 True\n", "")
