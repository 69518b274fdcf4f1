"""Energies of laws as expressions, and what is computed of them."""

from dataclasses import replace

import numpy as np
import pytest
from energies import by_complex_steps

from isorod.material import LinearElastic, NeoHookean
from isorod.material.active_muscle import ActiveMuscle
from isorod.material.muscle import Muscle
from isorod.material.st_venant_kirchhoff import StVenantKirchhoff

EYE = np.eye(3)


def states():
    F = EYE + 0.35 * np.random.default_rng(0).uniform(-1.0, 1.0, (400, 3, 3))
    F = F[np.linalg.det(F) > 0.1]
    return F, np.random.default_rng(1).normal(size=(len(F), 3))


F, FIBRES = states()
LAWS = {
    "LinearElastic": LinearElastic(100.0, 0.3),
    "NeoHookean": NeoHookean(100.0, 0.3),
    "StVenantKirchhoff": StVenantKirchhoff(100.0, 0.3),
    "Muscle": Muscle(30.0, 0.49, 30.0, 35.0, 0.5, 0.8, FIBRES),
    "Muscle without m2": Muscle(30.0, 0.49, 30.0, 35.0, 0.0, 0.8, FIBRES),
}


def same(law, other, found=("energy", "stress", "tangent")):
    for name in found:
        expected = getattr(law, name)(F)
        np.testing.assert_allclose(getattr(other, name)(F), expected, rtol=0.0, atol=2e-15 * np.abs(expected).max())


@pytest.mark.parametrize("name", LAWS)
def test_energy_and_stress_are_those_of_the_expression(name):
    for k, one in enumerate(F[::20]):
        law = LAWS[name]
        law = replace(law, fibre=FIBRES[20 * k]) if law.families else law
        energy, stress = by_complex_steps(law, one)
        for found, value in ((energy, law.energy(one[None])[0]), (stress, law.stress(one[None])[0])):
            np.testing.assert_allclose(found, value, rtol=0.0, atol=1e-12 * max(1.0, np.abs(value).max()))


def test_laws_load_nothing_of_sympy_until_their_energy_is_asked_for(python):
    done = python(
        "import sys, isorod, numpy\n"
        "isorod.Muscle(30.0, 0.4, 30.0, 5.0, 0.5, 1.0, (0, 0, 1)).stress(numpy.eye(3)[None])\n"
        "isorod.Ogden([1.0], [2.0], 50.0), isorod.HolzapfelGasserOgden(1.0, 1.0, 1.0, 50.0), isorod.Gent(1, 9, 50)\n"
        "print('sympy' in sys.modules, isorod.NeoHookean(1.0, 0.3).stored.shape, 'sympy' in sys.modules)"
    )
    assert (done.stdout, done.stderr) == ("False mu*(I1 - 2*log(J) - 3)/2 True\n", "")


def parabola():
    import sympy

    stretch = sympy.Symbol("stretch")
    return sympy.Max(0, 1 - 4 * (1 - stretch) ** 2)


@pytest.mark.slow
def test_muscle_of_the_parabola_is_muscle_to_rounding():
    law = LAWS["Muscle"]
    given = law.E, law.nu, law.sigma_max, law.m1, law.m2, law.activation, FIBRES
    other = ActiveMuscle(*given, parabola())
    same(law, other)
    same(law.at(0.25), other.at(0.25), ("energy", "stress"))
    same(law.shear, other.shear)
    assert other.activation_work == pytest.approx(law.activation_work, rel=1e-5)
    # Two ways to a stress that does the work of the energy.
    change = 0.05 * np.random.default_rng(3).normal(size=F.shape)
    stays = np.linalg.det(F + change) > 0.05
    for one in (law, other):
        work = np.sum(one.discrete(F, change, False)[0] * change, axis=(1, 2))
        np.testing.assert_allclose(work[stays], (one.energy(F + change) - one.energy(F))[stays], atol=1e-10)
