"""What every law keeps: derivatives, its expression, rotations, and the stress between two states that does work."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from comparisons.laws.torsion import ARTERY, TRELOAR
from isorod import Gent, HolzapfelGasserOgden, MooneyRivlin, Muscle, Ogden, StVenantKirchhoff, Yeoh
from isorod.material import LinearElastic, NeoHookean
from isorod.material import symbols as s
from isorod.material.orthotropic import Orthotropic, TransverselyIsotropic
from isorod.material.orthotropic_kirchhoff import OrthotropicKirchhoff
from isorod.material.places import alone
from isorod.material.proof import prove
from isorod.tensors import rotation

EYE = np.eye(3)
FIBRE, OTHER = np.array([0.0, 0.6, 0.8]), np.array([0.8, 0.0, -0.6])
WOOD = (5.0, 3.0, 2.0), (0.3, 0.25, 0.35), (1.2, 1.0, 0.8), ((1.0, 2.0, 0.5), (0.3, -1.0, 0.8))
SMALL = {
    "LinearElastic": LinearElastic(2.0, 0.3),
    "Orthotropic": Orthotropic(*WOOD),
    "TransverselyIsotropic": TransverselyIsotropic(13.0, 0.9, 0.28, 0.4, 0.5, FIBRE),
}
BEARING = {
    "Muscle": Muscle(30.0, 0.49, 30.0, 35.0, 0.5, 0.7, FIBRE),
    "HolzapfelGasserOgden": HolzapfelGasserOgden(*ARTERY, 50.0, fibre=FIBRE),
    "of two families": HolzapfelGasserOgden(*ARTERY, 50.0, 0.0, (FIBRE, OTHER)),
    "dispersed": HolzapfelGasserOgden(*ARTERY, 50.0, 0.15, (FIBRE, OTHER)),
}
LARGE = BEARING | {
    "NeoHookean": NeoHookean(2.0, 0.3),
    "NeoHookean of nu < 0": NeoHookean(1.0, -0.4),
    "NeoHookean of nu = 0": NeoHookean(1.0, 0.0),
    "NeoHookean of nu = 0.49": NeoHookean(3.0, 0.49),
    "StVenantKirchhoff": StVenantKirchhoff(100.0, 0.3),
    "OrthotropicKirchhoff": OrthotropicKirchhoff(*WOOD),
    "Muscle without m2": Muscle(30.0, 0.49, 30.0, 35.0, 0.0, 0.8, FIBRE),
    "MooneyRivlin": MooneyRivlin(0.3, 0.2, 20.0),
    "Yeoh": Yeoh(0.5, -0.1, 0.03, 20.0),
    "Gent": Gent(1.0, 10.0, 20.0),
    "Ogden": Ogden(*TRELOAR, 10.0),
}
LAWS = LARGE | SMALL


def each(names):
    """Parametrise by names; each law is compiled, for some seconds, where no other run has left it."""
    slow = "MooneyRivlin", "dispersed"
    values = [pytest.param(name, marks=pytest.mark.slow) if name in slow else name for name in names]
    return pytest.mark.parametrize("name", values)


def turns(count, seed):
    found = np.linalg.qr(np.random.default_rng(seed).normal(size=(count, 3, 3)))[0]
    return found * np.linalg.det(found)[:, None, None]


def gradients():
    """Deformations anywhere; of all stretches of a fibre; of principal stretches that are, or nearly are, the same.

    None is so close to where a fibre's stress has a kink that differences step over it.
    """
    rng = np.random.default_rng(0)
    anywhere = EYE + 0.3 * rng.uniform(-1.0, 1.0, (60, 3, 3))
    along = EYE + (np.linspace(0.3, 1.7, 29)[:, None, None] - 1.0) * np.outer(FIBRE, FIBRE)
    along += 0.03 * rng.uniform(-1.0, 1.0, along.shape)
    same = np.array(
        [np.diag(one) for one in ([1.2, 1.2, 1.2], [1.3, 1.3, 0.8], [0.9, 1.1, 1.1], [1.2, 1.2 + 1e-7, 0.9])]
    )
    (turn,) = turns(1, 0)
    found = np.concatenate([anywhere, along, turn @ same, turn.T @ same @ turn])
    stretch = np.linalg.norm(found @ np.stack([FIBRE, OTHER], axis=1), axis=1)
    clear = np.abs(stretch[:, :, None] - [0.5, 1.0, 1.5]).min(axis=(1, 2)) > 0.005
    kept = found[clear & (np.linalg.det(found) > 0.15)]
    assert (np.histogram(np.linalg.norm(kept @ FIBRE, axis=1), [0, 0.5, 1.0, 1.5, 3.0])[0] >= 3).all()
    return kept


F = gradients()


def differences(f, F, step=1e-4):
    """Return the derivatives of a function of ``F``, by differences of fourth order."""
    found = []
    for move in step * np.eye(9).reshape(9, 3, 3):
        near, far = f(F + move) - f(F - move), f(F + 2 * move) - f(F - 2 * move)
        found.append((8.0 * near - far) / (12.0 * step))
    return np.stack(found, axis=-1).reshape(*found[0].shape, 3, 3)


def close(found, expected, error):
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=error * max(1e-3, np.abs(expected).max()))


@each(LAWS)
def test_stress_and_tangent_are_derivatives(name):
    law = LAWS[name].placed(alone())
    stress, tangent = law.stress(F), law.tangent(F)
    close(stress, differences(law.energy, F), 1e-9)
    close(tangent, differences(law.stress, F), 1e-9)
    close(tangent, tangent.transpose(0, 3, 4, 1, 2), 1e-14)
    if isinstance(law, Gent | Yeoh | Ogden | HolzapfelGasserOgden):
        prove(LAWS[name], prestressed=False)


def expression(law):
    """Return what an energy's expression is of deformation gradients ``(m, 3, 3)``, complex or not, by NumPy alone."""
    stored, fibres = law.stored, np.resize(np.append(law.fibres((1,))[0], np.zeros(6)), 6)
    names = (*s.F, *s.STRAINS, *s.a, *s.b, *s.INVARIANTS, s.activation, *stored.constants)
    # NumPy's maximum takes no numbers beside arrays in a list.
    function = sp.lambdify(names, stored.expression.rewrite((sp.Max, sp.Min), sp.Piecewise), "numpy")

    def energy(F):
        C = np.swapaxes(F, -1, -2) @ F
        first = np.trace(C, axis1=-2, axis2=-1)
        second = 0.5 * (first**2 - np.trace(C @ C, axis1=-2, axis2=-1))
        a, b = fibres[:3], fibres[3:]
        along = [np.einsum("A,mAB,B->m", x, C, y) for x, y in ((a, a), (b, b), (a, b))]
        stretches = np.sqrt(np.linalg.eigvals(C)).T
        invariants = (first, second, np.linalg.det(F), *along, *stretches)
        strains = [C[:, A, B] for A in range(3) for B in range(A, 3)]
        values = function(*F.reshape(-1, 9).T, *strains, *fibres, *invariants, 1.0, *law.constants)
        return np.broadcast_to(values, F.shape[:1])

    return energy


@each(LAWS)
def test_energy_and_stress_are_those_of_the_expression(name):
    """The stress by complex steps, which lose no digits (Squire & Trapp, SIAM Review 40 (1998) 110-112)."""
    law, apart = LAWS[name].placed(alone()), F[:-8]
    energy = expression(law)
    close(law.energy(apart), np.real(energy(apart.astype(complex))), 1e-12)
    steps = 1e-30j * np.eye(9).reshape(9, 3, 3)
    slopes = np.stack([np.imag(energy(apart + step)) / 1e-30 for step in steps], axis=-1)
    close(law.stress(apart), slopes.reshape(-1, 3, 3), 1e-12)


def turned(law, turn):
    """Return a law whose fibres or axes are turned along with the material."""
    if not law.families:
        return law
    field = "axes" if hasattr(law, "axes") else "fibre"
    vectors = np.array(getattr(law, field)) @ turn
    return replace(law, **{field: vectors if vectors.ndim == 1 else tuple(vectors)})


@each(LARGE)
def test_rotations_turn_the_stress_and_those_of_the_material_nothing_but_its_directions(name):
    law, Q, (turn,) = LAWS[name].placed(alone()), turns(len(F), 1), turns(1, 2)
    stress, energy = law.stress(F), law.energy(F)
    close(law.energy(Q @ F), energy, 1e-12)
    close(law.stress(Q @ F), Q @ stress, 1e-12)
    close(turned(law, turn).energy(F @ turn), energy, 1e-12)
    close(turned(law, turn).stress(F @ turn), stress @ turn, 1e-12)
    if law.families:
        assert np.abs(law.stress(F @ turn) - stress @ turn).max() > 1e-2 * np.abs(stress).max()
        # The sense of a fibre does not matter.
        close(turned(law, -EYE).stress(F), stress, 1e-12)


@each(LAWS)
def test_rest_has_no_energy_and_no_stress(name):
    law = LAWS[name].placed(alone()).at(0.0)
    assert law.energy(EYE[None]) == 0
    close(law.stress(EYE[None]), np.zeros((1, 3, 3)), 1e-12 * law.modulus)


@each(LARGE)
@pytest.mark.parametrize("bad", [np.diag([1, 1, 0.0]), np.diag([1, 1, -1.0]), -EYE, np.full((3, 3), np.nan)])
def test_an_inverted_point_has_no_stress(name, bad):
    law, pair = LAWS[name].placed(alone()), np.stack([F[0], bad])
    change = law.discrete(pair[[0, 0]], pair - F[0], True)
    assert np.isnan(law.stress(pair)[1]).all()
    for value in (law.energy(pair), law.stress(pair), law.tangent(pair), *change):
        assert np.isfinite(value[0]).all() and np.isnan(value[1]).any()


@each(LAWS)
def test_each_point_is_by_itself_whatever_the_shape_and_layout(name):
    law, grid = LAWS[name].placed(alone()), F[:24].reshape(2, 3, 4, 3, 3)
    layout = np.ascontiguousarray(grid.transpose(2, 1, 0, 3, 4)).transpose(2, 1, 0, 3, 4)
    for f in (law.energy, law.stress, law.tangent):
        assert f(grid).shape[:3] == (2, 3, 4)
        assert np.array_equal(f(layout), f(grid))
    close(law.stress(grid)[1, 2, 3], law.stress(grid[1, 2, 3][None])[0], 1e-14)


@pytest.mark.parametrize("name", SMALL)
def test_a_law_of_small_strains_is_linear_in_what_is_no_deformation_too(name):
    """As a mode of vibration of any size; infinitesimal rotations it does not see."""
    law, H = SMALL[name].placed(alone()), np.diag([-2.0, 0.3, 0.1]) + 0.2 * F[:1]
    assert np.linalg.det(EYE + H[0]) < 0.0
    for scale in (1e-3, 1.0, 10.0):
        stress = law.stress(EYE + scale * H)
        np.testing.assert_allclose(stress, scale * law.stress(EYE + H), rtol=1e-9)
        assert law.energy(EYE + scale * H) == pytest.approx(0.5 * scale * np.sum(stress * H), rel=1e-9)
    spin = np.array([[0, 0.1, -0.2], [-0.1, 0, 0.3], [0.2, -0.3, 0]])
    close(law.stress((EYE + spin)[None]), np.zeros((1, 3, 3)), 1e-12)


# The stress between two states

# Fibres that begin to bear, and such whose active force ends.
AT = {"taut": 1.0, "active": 1.5}


def across(size, stretch=1.0, points=400):
    """Changes during which most of the fibres have this stretch."""
    rng = np.random.default_rng(0)
    turn = turns(points, 3)
    # Strains of everything but a fibre's own length.
    strains = 0.1 * rng.standard_normal((points, 3, 3))
    middle = stretch * np.outer(FIBRE, FIBRE) + (EYE + strains) @ (EYE - np.outer(FIBRE, FIBRE))
    change = size * rng.standard_normal((points, 3, 3))
    first, change = turn @ (middle - rng.random((points, 1, 1)) * change), turn @ change
    good = (np.linalg.det(first) > 0.1) & (np.linalg.det(first + change) > 0.1)
    return first[good], change[good]


@each(LARGE)
@pytest.mark.parametrize("size", [0.3, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("at", AT)
def test_stress_between_states_does_the_work_of_the_energy_however_small_the_change(name, size, at):
    law, (F, H) = LAWS[name].placed(alone()), across(size, AT[at])
    energy = law.energy(F), law.energy(F + H)
    work = np.sum(law.discrete(F, H)[0] * H, axis=(1, 2))
    # Half of it may be left out as rounding of energies, whose terms are of the size of the moduli.
    allowed = 64.0 * np.finfo(float).eps * (np.abs(law.tangent(F)).max() + np.abs(energy).max())
    assert np.abs(work - (energy[1] - energy[0])).max() <= allowed


@each(LARGE)
@pytest.mark.parametrize("size", [1e-1, 1e-3, 1e-5])
def test_stress_between_states_is_the_same_backwards_has_no_moment_and_turns_with_both(name, size):
    law, (F, H) = LAWS[name].placed(alone()), across(size)
    stress = law.discrete(F, H)[0]
    # What rounding of the energy is, divided by the change.
    allowed = 1e-13 * np.abs(law.tangent(F)).max() * (1.0 + 1e-2 / size)
    np.testing.assert_allclose(law.discrete(F + H, -H)[0], stress, rtol=0.0, atol=allowed)
    turn = rotation((0.0, 0.0, 0.9))
    np.testing.assert_allclose(law.discrete(turn @ F, turn @ H)[0], turn @ stress, rtol=0.0, atol=allowed)
    second = stress @ np.swapaxes(F + 0.5 * H, 1, 2)
    close(second, np.swapaxes(second, 1, 2), 1e-13)


@each(LARGE)
@pytest.mark.parametrize("size", [0.2, 1e-2])
def test_moduli_between_states_are_derivatives(name, size):
    law, (F, H) = LAWS[name].placed(alone()), across(size, 1.1)
    moduli, found = law.discrete(F, H, True)[1], differences(lambda H: law.discrete(F, H)[0], H, 1e-5)
    off = np.abs(moduli - found).max(axis=(1, 2, 3, 4)) / np.abs(found).max()
    # At a few of the points the differences step over where a fibre begins to bear.
    assert np.sort(off)[-20] < 1e-6 and (law.families or off.max() < 1e-6)


@each(LARGE)
def test_without_a_change_stress_between_states_is_the_laws_own(name):
    law = LAWS[name].placed(alone()).at(0.7)
    stress, moduli = law.discrete(F, 0.0 * F)
    close(stress, law.stress(F), 1e-12)
    close(moduli, 0.5 * law.tangent(F), 1e-12)


@pytest.mark.parametrize("name", ["StVenantKirchhoff", "Yeoh", "Gent", "Ogden"])
def test_stress_between_states_is_the_same_on_any_number_of_points(name):
    """Whole blocks and parts of one; each point is by itself."""
    law, (F, H) = LAWS[name], across(0.05, points=70)
    stress, moduli = law.discrete(F, H, True)
    for count in (1, 31, 32, 33, 64, 65):
        some, varied = law.discrete(F[-count:], H[-count:], True)
        close(some, stress[-count:], 1e-13)
        close(varied, moduli[-count:], 1e-11)
    assert law.discrete(F[:0], H[:0], True)[0].shape == (0, 3, 3)
