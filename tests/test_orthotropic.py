"""Linear elasticity with directions: rotated stiffness, bars with exact answers, its energy as an expression."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from isorod import InputError, Space, circle, dynamics, ellipse, modal, section_properties, statics
from isorod.assembly.assembler import Assembler
from isorod.files.scene import FileScene
from isorod.geometry.center_line import straight
from isorod.geometry.coils import arc, helix
from isorod.material import LinearElastic, fibre
from isorod.material.orthotropic import Orthotropic, TransverselyIsotropic
from isorod.material.places import Places
from isorod.model import Body, Contact, Model, Plane, Support
from isorod.output.section_properties import _prism, apart
from isorod.space.ringed import Ringed

E, NU, G = (120.0, 30.0, 20.0), (0.3, 0.25, 0.35), (12.0, 9.0, 7.0)
WOOD = Orthotropic(E, NU, G)
SCENE = """
[rod.bar]
curve = {straight = {length = 4.0, breaks = [0.0, 0.5, 1.0]}}
section = {circle = 0.5}

[[rod.bar.law]]
Orthotropic = {E = [120, 30, 20], nu = [0.3, 0.25, 0.35], G = [12, 9, 7.0], axes = ["tangent", [0, 2, 0]]}

[[rod.bar.law]]
TransverselyIsotropic = {E = 130, E_across = 9.0, nu = 0.28, nu_across = 0.4, G = 5.0, fibre = {helix = 90}}

[support.wall]
end = "start"

[analysis.statics]
"""
CARBON = TransverselyIsotropic(130.0, 9.0, 0.28, 0.4, 5.0)
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def rotation(seed):
    found, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return found * np.linalg.det(found)


def compliance(E, nu, G):
    """The strains along axes 11, 22, 33 and twice those of 12, 13, 23 of unit stresses."""
    found = np.diag([*(1.0 / np.array(E)), *(1.0 / np.array(G))])
    for value, (i, j) in zip(nu, PAIRS[3:], strict=True):
        found[i, j] = found[j, i] = -value / E[i]
    return found


def tensor(stiffness, axes):
    """The tensor ``C_abcd`` of a matrix of `PAIRS`, whose axes are the rows of ``axes``."""
    found = np.zeros((3, 3, 3, 3))
    for row, (i, j) in enumerate(PAIRS):
        for column, (k, m) in enumerate(PAIRS):
            for p, q in {(i, j), (j, i)}:
                for r, s in {(k, m), (m, k)}:
                    found[p, q, r, s] = stiffness[row, column]
    return np.einsum("ia,jb,kc,ld,ijkl->abcd", axes, axes, axes, axes, found)


@pytest.mark.parametrize("law", [WOOD, CARBON], ids=["orthotropic", "transverse"])
def test_stress_and_tangent_are_those_of_a_rotated_stiffness(law):
    axes = rotation(1)
    told = replace(law, axes=axes[:2]) if law is WOOD else replace(law, fibre=3.0 * axes[0])
    C = tensor(np.linalg.inv(compliance(*law.engineering)), axes)
    F = np.eye(3) + 0.3 * np.random.default_rng(2).normal(size=(40, 3, 3))
    strain = 0.5 * (F + F.swapaxes(1, 2)) - np.eye(3)
    expected = np.einsum("abcd,mcd->mab", C, strain)
    assert np.abs(told.stress(F) - expected).max() < 1e-13 * np.abs(expected).max()
    assert told.energy(F) == pytest.approx(0.5 * np.sum(expected * strain, axis=(1, 2)), rel=1e-12)
    assert np.abs(told.tangent(F) - C).max() < 1e-13 * C.max()
    # What a law is asked without a rod: axes along z and x.
    along = tensor(np.linalg.inv(compliance(*law.engineering)), np.eye(3)[[2, 0, 1]])
    assert law.modulus == pytest.approx(max(along[a, a, a, a] for a in range(3)), rel=1e-12)


def held(space):
    """Ends along z, and what else moves and turns a rod in its plane as a whole."""
    return [Support.end(space, "start", "z"), Support(np.array([0]), "xy"), Support(np.array([1]), "y")]


@pytest.mark.parametrize("angle", [0.0, 35.0])
def test_a_bar_pulled_at_an_angle_to_its_axes(angle):
    """Axis 1 is turned from z towards x: one stress, the strains of the compliance, among them the shear of z and x."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    axes = np.array([[s, 0.0, c], [c, 0.0, -s], [0.0, 1.0, 0.0]])
    rod = straight(4.0).sweep(ellipse(8, 0.6, 0.4))
    space = Space(rod, elements=2, degree=2, section_degree=2)
    law = replace(WOOD, axes=axes[:2])
    pulled = Support.end(space, "end", "z", (0.0, 0.0, 0.02))
    model = Model([Body(space, law)], [*held(space), pulled])
    solution = statics.solve(model)
    local = axes @ np.diag([0.0, 0.0, 1.0]) @ axes.T
    flexible = compliance(E, NU, G) @ [local[i, j] for i, j in PAIRS]
    strain = np.zeros((3, 3))
    for value, (i, j) in zip(flexible, PAIRS, strict=True):
        strain[i, j] = strain[j, i] = value if i == j else 0.5 * value
    strain = axes.T @ strain @ axes
    area = np.pi * 0.24
    stress = 0.005 / strain[2, 2]
    assert solution.reactions[-1, 2] == pytest.approx(stress * area, rel=1e-9)
    assembler = Assembler(model)
    stored = assembler.energy(assembler.state(solution.displacement.ravel()), 1.0)
    assert stored == pytest.approx(0.5 * 0.02 * solution.reactions[-1, 2], rel=1e-9)
    _, F = space.displacement(solution.displacement, np.array([[0.3, 0.2], [-0.5, 0.6]]), [0.3, 0.8])
    found = 0.5 * (F + F.swapaxes(-1, -2)) - np.eye(3)
    assert np.abs(found - stress * strain).max() < 1e-9 * 0.005
    assert abs(strain[0, 2]) > 0.1 * strain[2, 2] or angle == 0.0
    # The same said by the rod's directions.
    turned = replace(law, axes=(lambda p: c * p.tangent + s * p.normal, lambda p: c * p.normal - s * p.tangent))
    again = statics.solve(Model([Body(space, turned)], model.supports))
    assert np.abs(again.displacement - solution.displacement).max() < 1e-12


def test_section_stiffnesses_of_an_ellipse():
    """``E_1 A``, ``E_1 I`` and the torsion of a section with two shear moduli, on a bent rod whose axes go along."""
    a, b = 0.7, 0.3
    rod = arc(10.0, 90.0).sweep(ellipse(8, a, b))
    found = section_properties(rod, 0.0, material=WOOD)
    area = np.pi * a * b
    assert found.stiffness[0, 0] == pytest.approx(E[0] * area, rel=1e-9)
    assert found.EI == pytest.approx([E[0] * area * b**2 / 4, E[0] * area * a**2 / 4], rel=1e-9)
    assert found.GJ == pytest.approx(area * a**2 * b**2 * G[0] * G[1] / (b**2 * G[0] + a**2 * G[1]), rel=1e-9)


def test_section_stiffness_where_fibres_wind():
    """A wound tube: its stretch and twist under a pull, far from its ends, whose faces bear no shear."""
    length = 8.0
    tube = straight(length).sweep(circle(8, 0.5)).with_rings((0.6, 1.0))
    law = replace(CARBON, fibre=fibre.helix(30.0))
    space = Space(tube, elements=8, degree=3, section_degree=4)
    prism, _, _ = _prism(Body(space, law), np.zeros(1))
    basis = Ringed(prism.rod, 4)
    compliance = np.linalg.inv(prism.stiffness(basis))
    pulled = Support.end(space, "end", "z", (0.0, 0.0, 0.01))
    solution = statics.solve(Model([Body(space, law)], [*held(space), pulled]))
    ahead, behind = (solution.at(0, u, [[1.0, 0.0], [-1.0, 0.0]]) for u in (0.6, 0.4))
    moved = (ahead - behind) / (0.2 * length * solution.reactions[-1, 2])
    assert moved[:, 2].mean() == pytest.approx(compliance[0, 0], rel=1e-3)
    assert moved[0, 1] - moved[1, 1] == pytest.approx(compliance[3, 0], rel=1e-3)
    assert compliance[3, 0] < -0.1
    # The same moduli everywhere, taken point by point.
    same = np.broadcast_to(prism.moduli[0], (10_000, 3, 3, 3, 3))
    pointwise = replace(prism, field=lambda xi: same[: len(xi)])
    assert apart(replace(prism, field=None).stiffness(basis), pointwise.stiffness(basis)) < 1e-9


def test_modes_of_a_free_bar():
    """Stretching with ``E`` along the fibre and its small Poisson's effect, twisting with ``G``."""
    length, radius, density = 10.0, 0.2, 2.0
    space = Space(straight(length).sweep(circle(8, radius)), elements=4, degree=4, section_degree=3)
    law = replace(CARBON, E=20.0)
    model = Model([Body(space, law, density)])
    modes = modal.solve(model, modes=16)
    twisting = np.sqrt(law.G / density) / (2.0 * length)
    stretching = np.sqrt(law.E / density) / (2.0 * length)
    # Rayleigh's and Love's correction of lateral inertia.
    stretching /= 1.0 + 0.25 * (law.nu * np.pi * radius / length) ** 2
    for frequency in (twisting, stretching):
        assert np.abs(modes.frequencies / frequency - 1.0).min() < 1e-5
    # About a loaded state its tangent knows nothing.
    with pytest.raises(InputError, match="body 0 is linear elastic"):
        modal.solve(model, state=statics.solve(Model(model.bodies, [Support.end(space, "start")])))


@pytest.mark.parametrize(
    ("law", "formulation"),
    [(WOOD, None), (LinearElastic(30.0, 0.3), None), (LinearElastic(30.0, 0.4999), "mixed")],
)
def test_a_clamped_bar_swings_in_its_first_mode(law, formulation):
    """Small motions are those of the modes: a quarter of a period after it is pushed, all is stored."""
    space = Space(straight(6.0).sweep(ellipse(8, 0.5, 0.3)), elements=2, degree=4, section_degree=3)
    model = Model([Body(space, law, 1.0, formulation)], [Support.end(space, "start")])
    modes = modal.solve(model, modes=1)
    shape, omega = modes.vectors[0], 2.0 * np.pi * modes.frequencies[0]
    shape = 0.01 * shape / np.abs(shape).max()
    quarter = 0.5 * np.pi / omega
    swings = [("implicit", quarter / 200, 1e-4)]
    if formulation is None:
        swings.append(("explicit", None, 1e-5))
    for integrator, step, close in swings:
        history = dynamics.solve(model, quarter, step, 1, velocity=omega * shape, integrator=integrator)
        np.testing.assert_allclose(history.displacement[-1].ravel(), shape, atol=close * np.abs(shape).max())
        assert history.kinetic[-1] < close * history.stored[-1]
        assert np.abs(history.energy_error).max() < 1e-5


def test_motion_says_where_small_strains_do_not_hold():
    space = Space(straight(2.0).sweep(circle(8, 0.4)), elements=1, degree=2, section_degree=2)
    model = Model([Body(space, WOOD, 1.0)], [Support.end(space, "start")])
    velocity = 0.3 * space.positions[:, 2:] * [1.0, 0.0, 0.0]
    with pytest.warns(
        UserWarning,
        match="rotations or strains of body 0 reach 0.1.*, the small-strain law Orthotropic needs less than",
    ):
        dynamics.solve(model, 0.5, velocity=velocity.ravel())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dynamics.solve(model, 0.5, velocity=0.5 * velocity.ravel())


@pytest.mark.filterwarnings("ignore:contact 0. contact patch")
def test_contact_takes_it():
    """A ring that a plane presses on: of material with directions that is isotropic, as that without them."""
    space = Space(arc(3.0, 120.0, phase=-60.0).sweep(circle(6, 0.4)), elements=4, degree=3, order=1)
    ends = [Support.end(space, which) for which in ("start", "end")]
    floor = Contact(0, Plane((3.36, 0.0, 0.0), (-1.0, 0.0, 0.0)))

    def pressed(law):
        return statics.solve(Model([Body(space, law)], ends, contacts=[floor])).contacts[0]

    plain = pressed(LinearElastic(50.0, 0.3))
    found = pressed(TransverselyIsotropic(50.0, 50.0, 0.3, 0.3, 50.0 / 2.6, fibre=fibre.helix(30.0)))
    assert plain.force > 0.1
    assert found.force == pytest.approx(plain.force, rel=1e-9)


def test_files_have_them(tmp_path):
    """Axes by words and as vectors, side by side."""
    path = tmp_path / "wood.toml"
    path.write_text(SCENE)
    (body,) = FileScene(path).model().bodies
    first, second = body.laws[0], body.laws[-1]
    assert np.array_equal(first.constants, WOOD.constants) and first.axes[0] == "tangent"
    assert np.array_equal(first.axes[1], [0.0, 1.0, 0.0])
    assert np.array_equal(second.constants, CARBON.constants) and second.fibre.args == (90.0,)


def test_pressures_are_refused():
    space = Space(straight(1.0).sweep(circle(4, 1.0)))
    with pytest.raises(InputError, match="needs a law with an energy of volume change"):
        statics.solve(Model([Body(space, WOOD, formulation="mixed")], [Support.end(space, "start")]))


def test_axis_two_is_made_square_to_axis_one():
    law = Orthotropic(E, NU, G, axes=((0.0, 0.0, 2.0), (3.0, 0.0, 5.0)))
    assert np.array_equal(law.fibres((2,)), np.tile([0.0, 0.0, 1.0, 1.0, 0.0, 0.0], (2, 1)))
    rod = helix(4.0, 6.0, 0.5).sweep(circle(6, 0.5), twist=30.0)
    places = Places(rod, np.array([[0.1], [1.5]]), np.array([[0.1, 0.2], [0.5, 0.0]]))
    found = WOOD.placed(places).fibres(places.shape)
    assert np.abs(found[..., :3] - places.tangent).max() < 1e-14
    assert np.abs(found[..., 3:] - places.normal).max() < 1e-14
