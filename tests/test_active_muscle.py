"""Muscle with a tension curve of one's own: the force it bears, what is no curve."""

import numpy as np
import pytest
import sympy
from scipy.integrate import quad
from scipy.interpolate import PchipInterpolator
from test_laws import LAWS, F, across, close

from isorod import InputError, Muscle
from isorod.material.active_muscle import ActiveMuscle, _stored
from isorod.material.muscle_energy import STRETCH

POINTS = ((0.5, 0.0), (0.75, 0.4), (0.95, 1.0), (1.05, 1.0), (1.3, 0.5), (1.6, 0.0))
x = sympy.Symbol("x")
GIVEN = {"E": 30.0, "nu": 0.4, "sigma_max": 20.0, "m1": 5.0, "m2": 0.5, "activation": 0.6, "fibre": (0.0, 0.0, 1.0)}


def of_points(stretch):
    return float(PchipInterpolator(*np.array(POINTS).T)(np.clip(stretch, 0.5, 1.6)))


CURVES = {
    "points": (POINTS, of_points),
    "points that hold at their ends": (
        ((1.1, 0.5), (1.2, 1.0), (1.3, 0.25)),
        lambda one: float(PchipInterpolator((1.1, 1.2, 1.3), (0.5, 1.0, 0.25))(np.clip(one, 1.1, 1.3))),
    ),
    "bell": (sympy.exp(-(((x - 1) / sympy.Rational(3, 10)) ** 2)), lambda one: np.exp(-(((one - 1) / 0.3) ** 2))),
    "parabola": (sympy.Max(0, 1 - 4 * (1 - x) ** 2), lambda one: max(0.0, 1.0 - 4.0 * (1.0 - one) ** 2)),
}


@pytest.mark.parametrize("name", CURVES)
def test_what_is_stored_is_the_integral_of_the_curve(name):
    curve, tension = CURVES[name]
    law = ActiveMuscle(**GIVEN, curve=curve)
    work, stretch = _stored(law.curve), STRETCH
    assert float(work.subs(stretch, 1)) == 0.0
    for one in (0.4, 0.6, 0.9, 1.15, 1.25, 1.5, 1.9):
        breaks = [k for k in (0.5, 0.75, 0.95, 1.05, 1.1, 1.2, 1.3, 1.5, 1.6) if min(one, 1.0) < k < max(one, 1.0)]
        exact = quad(tension, 1.0, one, points=breaks or None, epsabs=1e-13)[0]
        assert float(work.subs(stretch, one)) == pytest.approx(exact, abs=1e-11)
        assert float(sympy.diff(work, stretch).subs(stretch, one)) == pytest.approx(tension(one), abs=1e-12)
    most = quad(tension, 0.25, 2.5, points=[0.5, 0.75, 0.95, 1.1, 1.2, 1.3, 1.5, 1.6], limit=200)[0]
    assert law.activation_work == pytest.approx(12.0 * most, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["points", "bell"])
def test_fibres_bear_the_tension_of_the_curve(name):
    curve, tension = CURVES[name]
    law, passive = ActiveMuscle(**GIVEN, curve=curve), Muscle(**(GIVEN | {"activation": 0.0}))
    for stretch in (0.4, 0.8, 1.0, 1.2, 1.7):
        F = np.diag([1.1, 0.9, stretch])[None]
        along = (law.stress(F) - passive.stress(F))[0]
        assert along[2, 2] == pytest.approx(12.0 * tension(stretch), abs=1e-11)
        assert np.abs(along[:2]).max() < 1e-12
        assert law.at(0.5).stress(F)[0, 2, 2] - passive.stress(F)[0, 2, 2] == pytest.approx(
            6.0 * tension(stretch), abs=1e-11
        )


@pytest.mark.slow
def test_muscle_of_the_parabola_is_muscle_to_rounding():
    law = LAWS["Muscle"]
    given = law.E, law.nu, law.sigma_max, law.m1, law.m2, law.activation, law.fibre
    other = ActiveMuscle(*given, CURVES["parabola"][0])
    for one, same in ((law, other), (law.at(0.25), other.at(0.25)), (law.shear, other.shear)):
        for name in ("energy", "stress", "tangent"):
            close(getattr(same, name)(F), getattr(one, name)(F), 2e-15)
    assert other.activation_work == pytest.approx(law.activation_work, rel=1e-5)
    F0, H = across(0.05)
    work = np.sum(other.discrete(F0, H, False)[0] * H, axis=(1, 2))
    np.testing.assert_allclose(work, other.energy(F0 + H) - other.energy(F0), atol=1e-10)


@pytest.mark.parametrize(
    ("curve", "message"),
    [
        (None, "curve: need points (stretch, tension) or a SymPy expression of the stretch"),
        ([(0.5, 1.0), (1.0, 1.0)], "curve: got shape (2, 2), need three or more points (stretch, tension)"),
        ([(0.5, 1.0), (0.4, 1.0), (1.0, 0.0)], "curve: stretches must be positive and rise from point to point"),
        ([(0.5, 1.0), (0.6, np.nan), (1.0, 0.0)], "curve: point 1 is not finite"),
        ([(0.5, 1.0), (0.6, -0.5), (1.0, 0.0)], "curve: got a tension of -0.5, need none that is negative"),
        (x + sympy.Symbol("y"), "curve: got an expression of x, y, need one of the stretch"),
        (x**x, "curve: SymPy finds no integral of x**x; give points (stretch, tension) of it"),
        ("parabola", "curve: got 'parabola', need numbers"),
    ],
)
def test_what_is_no_curve_gets_one_line(curve, message):
    with pytest.raises(InputError) as error:
        ActiveMuscle(**GIVEN, curve=curve)
    assert str(error.value) == message
