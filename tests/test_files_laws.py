"""Laws in scene files: constants without bound, directions of fibres, curves, energies written as text."""

import math
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import sympy
from conftest import straight
from refused import refused

from isorod import Gent, HolzapfelGasserOgden, MooneyRivlin, Ogden, Space, StVenantKirchhoff, dynamics, modal, statics
from isorod.errors import InputError
from isorod.files.document import Document
from isorod.files.expression import parsed
from isorod.files.form import choice
from isorod.files.scene import FileScene
from isorod.files.schema import LAWS
from isorod.material import NeoHookean
from isorod.material import symbols as s
from isorod.model import Body, Model, Support


def law(text):
    """Return the law of a file that has nothing else."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(f"law = {text}\n")
        document = Document(str(path))
        return choice(document.top / "law", LAWS, document.content["law"]).make()


def test_a_bulk_modulus_may_be_infinite():
    assert law("{MooneyRivlin = {c10 = 0.3, c01 = 0.1, bulk = inf}}") == MooneyRivlin(0.3, 0.1, math.inf)
    assert law("{Gent = {mu = 0.3, limit = 30, bulk = 50}}") == Gent(0.3, 30.0, 50.0)
    assert law("{Ogden = {mu = [0.63, -0.01], alpha = [1.3, -2], bulk = inf}}") == Ogden(
        (0.63, -0.01), (1.3, -2), math.inf
    )


ENERGY = "{{Hyperelastic = {{energy = '{}', {}}}}}"
HGO = "{{HolzapfelGasserOgden = {{c = 3.0, k1 = 2.0, k2 = 0.8, bulk = inf, fibre = {}}}}}"


def test_directions_of_fibres():
    from isorod.material.places import alone

    found = [law(HGO.format(one)) for one in ("'around'", "[0, 2, 0]", "[{helix = 30}, {helix = -30}]")]
    assert [one.families for one in found] == [1, 1, 2]
    around, vector, helices = (one.placed(alone()).fibres((1,))[0] for one in found)
    np.testing.assert_allclose(around, vector, atol=1e-15)
    np.testing.assert_allclose(helices, [0.0, 0.5, 0.75**0.5, 0.0, -0.5, 0.75**0.5], atol=1e-15)


def test_a_tension_curve_is_points():
    muscle = "{ActiveMuscle = {E = 30.0, nu = 0.4, sigma_max = 20.0, curve = [[0.5, 0], [1, 1], [1.5, 0]]}}"
    assert law(muscle).curve == ((0.5, 0.0), (1.0, 1.0), (1.5, 0.0))


test_what_is_wrong_gets_one_line_with_its_place = refused(
    *(
        (text, f"scene.toml:1: law.{message}")
        for text, message in (
            ("{Gent = {mu = 1.0, limit = 30, bulk = -1.0}}", "Gent.bulk: got -1, need a positive stress, infinite for"),
            ("{Gent = {mu = inf, limit = 30, bulk = inf}}", "Gent.mu: got inf, need a finite number"),
            ("{Gent = {mu = 1.0, limit = 30, bulk = 'inf'}}", "Gent.bulk: got 'inf', need a number"),
            ("{Gent = {mu = 1.0, limit = 30}}", "Gent: bulk is missing: a number, or inf"),
            (HGO.format("'arround'"), "HolzapfelGasserOgden.fibre: 'arround' is not known; did you mean around?"),
            (HGO.format("[0.0, 1.0]"), "HolzapfelGasserOgden.fibre[0]: got 0.0, need 3 numbers"),
            (
                HGO.format("{screw = 30}"),
                "HolzapfelGasserOgden.fibre: got a table of screw, need a word, a vector [x, y",
            ),
            (
                ENERGY.format("mu*(I1 - 3)", "constants = {mu = 'x'}"),
                "Hyperelastic.constants.mu: got 'x', need a number",
            ),
            (ENERGY.format("mu*(I1bar - 3)", "bulk = inf"), "Hyperelastic.energy: column 1: 'mu' is not known; need a"),
        )
    ),
    (
        ENERGY.format("mu/(I1bar - 3)", "constants = {mu = 1.0}, bulk = 2.0"),
        "energy: it or its slope is not finite, or",
    ),
    by=law,
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("mu/2*(I1bar - 3) + K/2*log(J)**2", lambda mu, K: mu / 2 * (s.I1bar - 3) + K / 2 * sympy.log(s.J) ** 2),
        (
            "-mu*Max(0, I4a - 1)**2 + sqrt(K)*I8",
            lambda mu, K: -mu * sympy.Max(0, s.I4a - 1) ** 2 + sympy.sqrt(K) * s.I8,
        ),
        ("mu*(l1 + l2 + l3) + K*(F01 + C10)", lambda mu, K: mu * sum(s.stretches) + K * (s.F[0, 1] + s.C[0, 1])),
        ("exp(mu)*tanh(K) + +2e-1", lambda mu, K: sympy.exp(mu) * sympy.tanh(K) + sympy.Float(0.2)),
    ],
)
def test_energies_are_read(text, expected):
    mu, K = sympy.symbols("mu K", real=True)
    assert parsed(text, ("mu", "K")) == expected(mu, K)


test_what_is_no_energy_gets_one_line = refused(
    ("mu*(I1 - 3", "energy: got 'mu*(I1 - 3', which is no expression, column 4"),
    ("__import__('os').system('true')", "energy: column 1: need numbers, names, + - * / ** and functions (log, exp"),
    ("mu.__class__", "energy: column 1: need numbers, names"),
    ("open('x')", "energy: column 1: 'open' is not known; need a constant that is given"),
    ("mu*(I1bra - 3)", "energy: column 5: 'I1bra' is not known; did you mean I1bar?"),
    ("mu*loq(J)", "energy: column 4: 'loq' is not known; did you mean log?"),
    ("mu*log(J, 2)", "energy: column 4: log of 2 values"),
    ("Max(J)", "energy: column 1: Max of 1 values"),
    ("9**9**9**9", "energy: column 4: an exponent of 387420489, need at most 32"),
    ("mu*(I1 - 3)/(1 - 1)", "energy: got 'mu*(I1 - 3)/(1 - 1)', which divides by zero or is not finite"),
    ("1e999*mu", "energy: column 1: need numbers"),
    ("sqrt(-1)*(I1 - 3)", "energy: got 'sqrt(-1)*(I1 - 3)', which is not real"),
    ("*".join(f"(I1 - {k})" for k in range(50)), "energy: its second derivatives take about"),
    ("-" * 70 + "mu", "energy: brackets within brackets deeper than 60"),
    ("I1 + " * 500 + "mu", "energy: got 2502 characters, need at most 2000"),
    ("[mu for mu in J]", "energy: column 1: need numbers"),
    ("mu if J else 1", "energy: column 1: need numbers"),
    ("", "energy: got '', which is no expression"),
    by=lambda text: parsed(text, ("mu",)),
)
test_constants_have_names_of_their_own = refused(
    ("I1", "constants: got the name 'I1', need one that is not taken"),
    *((own, f"constants: got the name '{own}', need one") for own in ("a b", "activation", "bulk", "a0", "b2")),
    by=lambda own: parsed("I1", (own,)),
)


def test_many_terms_are_no_brackets():
    assert parsed(" + ".join(["I1"] * 300), ()) == 300 * s.I1
    assert parsed("I1" + "/2" * 70, ()) == s.I1 / 2**70
    assert parsed("8 - 3 - 2", ()) == 3
    assert str(parsed("(" * 70 + "mu" + ")" * 70, ("mu",))) == "mu"


@pytest.mark.slow
def test_an_energy_as_text_is_the_law_that_it_says():
    found = law(
        "{Hyperelastic = {energy = 'c10*(I1bar - 3) + c01*(I2bar - 3)', constants = {c10 = 0.3, c01 = 0.2}, bulk = 20}}"
    )
    F = np.eye(3) + 0.2 * np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3, 3))
    np.testing.assert_allclose(found.stress(F), MooneyRivlin(0.3, 0.2, 20.0).stress(F), rtol=0.0, atol=1e-13)


CORD = """
[rod.cord]
curve = {{straight = 4.0}}
section = {{circle = 0.5}}
density = 1.0
space = {{section_degree = 2, degree = 2, elements = 1}}
law = {}
[support.base]
end = "start"
[support.grip]
end = "end"
displacement = [0.0, 0.0, 0.2]
[analysis.{}]
"""


@pytest.mark.parametrize("analysis", ["statics", "modal", "dynamics]\nend_time = 1.0 #"])
def test_incompressible_laws_with_fibres_take_pressures_by_themselves(analysis, tmp_path):
    (tmp_path / "cord.toml").write_text(CORD.format(HGO.format("'tangent'"), analysis))
    model = FileScene(str(tmp_path / "cord.toml")).model()
    for one in (model, model.in_motion("implicit")):
        assert one.bodies[0].formulation == "mixed" and one.bodies[0].chosen
    with pytest.raises(InputError, match="no explicit step is stable"):
        model.in_motion("explicit")


def test_an_incompressible_law_takes_pressures_whatever_is_beside_it():
    """But for what has none, of which one line says so."""
    space = Space.paper(straight(8, height=2.0), elements=2, degree=2, order=2)
    fibres = HolzapfelGasserOgden(3.0, 2.0, 0.8, math.inf)
    assert Body(space, [fibres, NeoHookean(1.0, 0.3)]).formulation == "mixed"
    assert Body(space, [replace(fibres, bulk=100.0), NeoHookean(1.0, 0.3)]).formulation == "displacement"
    for law in (NeoHookean(1.0, 0.0), StVenantKirchhoff(1.0, 0.3)):
        with pytest.raises(
            InputError, match=r"element 0: incompressible \(nu = 0.5, or a bulk modulus that is infinite"
        ):
            Body(space, [fibres, law])


def test_a_finite_bulk_modulus_tends_to_an_infinite_one():
    """Statics, modes about its state and implicit motion, by default."""
    space = Space.paper(straight(8, height=4.0), elements=1, degree=3, order=2)
    found = []
    for bulk in (math.inf, 1e6):
        body = Body(space, HolzapfelGasserOgden(3.0, 2.0, 0.8, bulk), 1.0)
        supports = [Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.1, 0.2))]
        still = statics.solve(Model([body], supports))
        swing = np.outer(space.positions[:, 2], [0.1, 0.0, 0.0]).ravel()
        moving = dynamics.solve(Model([body], supports[:1]), 0.5, 0.1, integrator="implicit", velocity=swing, outputs=1)
        assert np.abs(moving.energy_error).max() < 1e-7
        assert {one.model.bodies[0].formulation for one in (still, moving)} == {"mixed"}
        found.append(
            [
                *still.reactions[1],
                *modal.solve(still.model, 2, state=still).frequencies,
                moving.displacement[-1, 0::3].max(),
            ]
        )
    np.testing.assert_allclose(*found, rtol=1e-4, atol=1e-8)
