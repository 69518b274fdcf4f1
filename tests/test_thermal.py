"""Thermal expansion: the law, rods that are free, held and layered, vibration under heat, and what is refused."""

import numpy as np
import pytest
from refused import refused

import isorod
from isorod import InputError, Thermal, modal, statics
from isorod.files.scene import FileScene
from isorod.material.places import Places
from isorod.material.yeoh import Yeoh

BASES = [
    isorod.NeoHookean(10.0, 0.3),
    isorod.StVenantKirchhoff(10.0, 0.3),
    isorod.LinearElastic(10.0, 0.3),
    Yeoh(1.0, 0.1, 0.01, bulk=20.0),
    isorod.OrthotropicKirchhoff((10.0, 8.0, 6.0), (0.3, 0.2, 0.25), (3.0, 2.5, 2.0), ((0, 0, 1), (1, 0, 0))),
]


# With coefficients of expansion along their own directions: axes 1, 2, 3, or along fibres and across.
DIRECTED = {
    "axes": (BASES[4], (3e-4, 1e-4, -2e-4)),
    "small": (isorod.Orthotropic(BASES[4].E, BASES[4].nu, BASES[4].G, BASES[4].axes), (3e-4, 1e-4, 0.0)),
    "fibres": (isorod.HolzapfelGasserOgden(3.0, 2.4, 0.8, 30.0, fibre=(0, 0, 1)), (3e-4, -1e-4)),
}

# Temperature, share of the stiffness.
SOFTER = ((-20.0, 1.2), (50.0, 1.0), (150.0, 0.6))


def ids(law):
    return type(law).__name__


@pytest.mark.parametrize("law", BASES, ids=ids)
def test_stress_is_that_of_what_strain_is_left(law):
    F = np.eye(3) + 0.1 * np.random.default_rng(0).standard_normal((7, 3, 3))
    heated = Thermal(law, 2e-4, 100.0)
    left = law.stress(F - 0.02 * np.eye(3)) if law.linear else 1.02**2 * law.stress(F / 1.02)
    np.testing.assert_allclose(heated.stress(F), left, atol=1e-13)
    way, h = np.random.default_rng(1).standard_normal((3, 3)), 1e-6
    slope = (heated.stress(F + h * way) - heated.stress(F - h * way)) / (2.0 * h)
    np.testing.assert_allclose(np.einsum("naAbB,bB->naA", heated.tangent(F), way), slope, atol=1e-7)
    slope = (heated.energy(F + h * way) - heated.energy(F - h * way)) / (2.0 * h)
    np.testing.assert_allclose(np.einsum("naA,aA->n", heated.stress(F), way), slope, atol=1e-7)
    np.testing.assert_allclose(heated.at(0.0).stress(F), law.stress(F), atol=1e-13)
    free = 1.02 * np.eye(3)[None]
    assert np.abs(heated.stress(free)).max() < 1e-13
    if law.objective:
        turn = np.linalg.qr(way)[0] * np.sign(np.linalg.det(way))
        turn *= np.sign(np.linalg.det(turn))
        np.testing.assert_allclose(heated.stress(turn @ F), turn @ heated.stress(F), atol=1e-13)


@pytest.mark.parametrize("which", DIRECTED)
@pytest.mark.parametrize("table", [(), SOFTER], ids=["stiff", "softer"])
def test_expansion_along_axes_of_a_temperature_by_places(which, table):
    """Stress of what is left, point by point; axes 1, 2 and 3 are z, x and y."""
    law, expansion = DIRECTED[which]
    rng = np.random.default_rng(2)
    warm, F = rng.uniform(0.0, 100.0, 9), np.eye(3) + 0.05 * rng.standard_normal((9, 3, 3))
    places = Places(isorod.straight(1.0).sweep(isorod.circle(8, 1.0)), np.full(9, 0.5), np.tile([[0.3, 0.2]], (9, 1)))
    heated = Thermal(law, expansion, lambda places: warm, table).placed(places)
    along, across = expansion[0], (*expansion[1:], expansion[-1])[:2]
    for k, temperature in enumerate(warm):
        strain = temperature * np.diag([*across, along])
        share = np.interp(temperature, *np.transpose(table)) if table else 1.0
        G = np.eye(3) + strain
        back = np.linalg.inv(G)
        left = law.stress(F[k] - strain) if law.linear else np.linalg.det(G) * law.stress(F[k] @ back) @ back
        np.testing.assert_allclose(heated.stress(F)[k], share * left, atol=1e-13)
    way, h = rng.standard_normal((3, 3)), 1e-6
    slope = (heated.stress(F + h * way) - heated.stress(F - h * way)) / (2.0 * h)
    np.testing.assert_allclose(np.einsum("naAbB,bB->naA", heated.tangent(F), way), slope, atol=2e-6)
    some = heated.some(np.array([2, 5]))
    np.testing.assert_array_equal(some.stress(F[[2, 5]]), heated.stress(F)[[2, 5]])


@pytest.mark.parametrize("law", [law for law in BASES if law.splits], ids=ids)
def test_the_mixed_formulation_knows_the_volume_that_heat_makes(law):
    """Legendre's transform with the rest of the energy is the energy; its slope is the change of volume."""
    heated, p, h = Thermal(law, 2e-4, 100.0, SOFTER), np.linspace(-2.0, 3.0, 7), 1e-5
    value, slope, bend = heated.complementary(p)
    ends = [heated.complementary(p + side) for side in (-h, h)]
    np.testing.assert_allclose((ends[1][0] - ends[0][0]) / (2.0 * h), slope, atol=1e-8)
    np.testing.assert_allclose((ends[1][1] - ends[0][1]) / (2.0 * h), bend, rtol=1e-6)
    size = np.exp(slope / 3.0) if law.logarithmic else 1.0 + slope / 3.0
    F = size[:, None, None] * np.eye(3)
    np.testing.assert_allclose(heated.shear.energy(F) + p * slope - value, heated.energy(F), atol=1e-13)


def bar(law, held, length=20.0):
    space = isorod.Space(isorod.straight(length).sweep(isorod.circle(8, 1.0)), elements=6)
    supports = [isorod.Support.end(space, one) for one in held]
    return isorod.Model([isorod.Body(space, law, 1.0)], supports)


def test_a_bar_that_may_not_contract_pulls():
    solution = statics.solve(bar(Thermal(isorod.LinearElastic(2e5, 0.0), 1.2e-5, -100.0), ("start", "end")))
    assert solution.reactions[1, 2] == pytest.approx(2e5 * np.pi * 1.2e-3, rel=1e-9)
    # Large strains: (1 + e) mu (l - 1 / l) of the stretch l = 1 / (1 + e) that is left, without a change of volume.
    left = 1.0 / 0.95
    solution = statics.solve(bar(Thermal(isorod.NeoHookean(10.0, 0.0), -5e-4, 100.0), ("start", "end")))
    assert solution.reactions[1, 2] > np.pi * 0.95**2 * 5.0 * (left - 1.0 / left)


def test_a_bent_rod_that_is_free_grows_without_stress(tmp_path):
    path = tmp_path / "free.toml"
    path.write_text(
        """
[rod.hook]
curve = {arc = {radius = 20, angle = 90}}
section = {ellipse = {a = 1.0, b = 0.5}}
law = {NeoHookean = {E = 2.0e5, nu = 0.3}}
expansion = 1.2e-5
temperature = 1000
[support.a]
mean = "fixed"
end = "start"
[analysis.statics]
[measure.tip]
displacement = "hook"
"""
    )
    scene = FileScene(str(path))
    solution = statics.solve(scene.model(), **scene.settings())
    np.testing.assert_allclose(scene.measure(solution)["tip"], [-0.24, 0.24, 0.0], atol=1e-9)
    assert solution.estimate() < 1e-6


def test_core_and_sheath_share_what_they_hinder_each_other_to_grow(tmp_path):
    """Composite cylinder in generalised plane strain: u = C r within, A r + B / r without."""
    path = tmp_path / "cable.toml"
    path.write_text(
        """
[rod.cable]
curve = {straight = 16.0}
section = {circle = 1.0}
rings = [0.0, 0.6, 1.0]
law = [{LinearElastic = {E = 1.0e5, nu = 0.3}}, {LinearElastic = {E = 2.0e5, nu = 0.25}}]
expansion = [1.0e-5, 2.0e-5]
temperature = 100
[support.a]
mean = "fixed"
end = "start"
[analysis.statics]
[measure.core]
stress = "cable"
u = 0.5
component = "zz"
[measure.skin]
stress = "cable"
u = 0.5
xi = [1.0, 0.0]
component = "zz"
"""
    )
    scene = FileScene(str(path))
    found = scene.measure(statics.solve(scene.model(), **scene.settings()))
    radius, moduli, free = 0.6, ((1e5, 0.3), (2e5, 0.25)), (1e-3, 2e-3)

    def stress(ring, strains, heat):
        E, nu = moduli[ring]
        lame, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
        left = np.array(strains) - heat * free[ring]
        return lame * left.sum() + 2 * mu * left

    def balance(x, heat):
        C, A, B, along = x
        core = stress(0, [C, C, along], heat)
        inner, outer = (stress(1, [A - B / r**2, A + B / r**2, along], heat) for r in (radius, 1.0))
        pull = core[2] * radius**2 + outer[2] * (1 - radius**2)
        return np.array([C * radius - A * radius - B / radius, core[0] - inner[0], outer[0], pull])

    matrix = np.array([balance(one, 0.0) for one in np.eye(4)]).T
    C, A, B, along = np.linalg.solve(matrix, -balance(np.zeros(4), 1.0))
    assert found["core"] == pytest.approx(stress(0, [C, C, along], 1.0)[2], rel=5e-3)
    assert found["skin"] == pytest.approx(stress(1, [A - B, A + B, along], 1.0)[2], rel=5e-3)


def test_heat_lowers_the_frequencies_of_a_bar_between_walls():
    """By the square root of one less the share of Euler's load, of a bar whose shape hardly changes."""
    law = isorod.NeoHookean(2e5, 0.3)
    slender, strain = 40.0, 4.0 * np.pi**2 / 4.0 / 40.0**2
    cold, hot = (
        modal.solve(bar(Thermal(law, 1e-5, 1e5 * share * strain), ("start", "end"), slender), 1).frequencies[0]
        for share in (0.0, 0.2)
    )
    # 0.97: the shape of vibration is not that of buckling.
    assert hot / cold == pytest.approx(np.sqrt(1.0 - 0.97 * 0.2), rel=5e-3)


test_what_cannot_be_is_refused = refused(
    (BASES[0], np.nan, 1.0, "expansion"),
    (BASES[0], 1e-5, np.inf, "temperature"),
    (BASES[0], 1e-3, 500.0, "strain up to 0.2"),
    (BASES[0], (1e-5, 2e-5), 10.0, "expansion: got 2 numbers, need one"),
    (BASES[4], (1e-5, 2e-5), 10.0, "or three along its axes"),
    (Thermal(BASES[0], 1e-5, 1.0), 1e-5, 10.0, "already"),
    by=Thermal,
)


def test_what_does_not_know_temperatures_says_so():
    law = Thermal(BASES[0], 1e-5, 10.0)
    with pytest.raises(InputError, match="ramp"):
        isorod.dynamics.solve(bar(law, ("start",)), 1.0, 0.1, integrator="implicit", ramp=0.5)
    rubber = Thermal(isorod.NeoHookean(1.0, 0.5), 1e-5, 10.0)
    with pytest.raises(InputError, match="incompressible law"):
        isorod.dynamics.solve(bar(rubber, ("start",)), 1.0, 0.1, integrator="implicit")
    timed = Thermal(BASES[0], 1e-5, 10.0, history=[[0, 0], [1, 1]])
    with pytest.raises(InputError, match="temperature history of body 0"):
        isorod.dynamics.solve(bar(timed, ("start",)), 1.0, 0.1, integrator="implicit")
    soft = Thermal(BASES[0], 1e-5, 10.0, SOFTER)
    with pytest.raises(InputError, match="stiffness that depends"):
        isorod.buckling.solve(bar(soft, ("start", "end")))
    with pytest.raises(InputError, match="only a body"):
        Thermal(BASES[0], 1e-5, lambda places: 1.0).stress(np.eye(3)[None])
