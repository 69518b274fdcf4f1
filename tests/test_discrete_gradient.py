"""The stress between two states of any law, by its compiled functions: its work, its symmetries and its moduli."""

import numpy as np
import pytest

from isorod.material.gent import Gent
from isorod.material.holzapfel_gasser_ogden import HolzapfelGasserOgden
from isorod.material.muscle import Muscle
from isorod.material.ogden import Ogden
from isorod.material.st_venant_kirchhoff import StVenantKirchhoff
from isorod.material.yeoh import Yeoh

FIBRE, OTHER = np.array([0.0, 0.6, 0.8]), np.array([0.8, 0.0, -0.6])
BEARING = [
    HolzapfelGasserOgden(1.0, 5.0, 0.5, 14.0 / 3.0, fibre=FIBRE),
    HolzapfelGasserOgden(1.0, 5.0, 0.5, 14.0 / 3.0, fibre=(FIBRE, OTHER)),
    Muscle(2.8, 0.4, sigma_max=5.0, m1=5.0, m2=0.5, activation=1.0, fibre=FIBRE),
]
SMOOTH = [StVenantKirchhoff(2.8, 0.4), Yeoh(0.5, -0.05, 0.02, 5.0), Gent(1.0, 10.0, 5.0), Ogden((1.2,), (2.0,), 5.0)]
# States in which it may bend sharply: fibres that begin to bear.
AT = {"taut": 1.0, "active": 1.5}


def across(size, stretch=1.0, points=400, seed=0):
    """Changes during which most of the fibres have this stretch."""
    rng = np.random.default_rng(seed)
    turns = np.linalg.qr(rng.standard_normal((points, 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    # Strains of everything but a fibre's own length.
    strains = 0.1 * rng.standard_normal((points, 3, 3))
    middle = stretch * np.outer(FIBRE, FIBRE) + (np.eye(3) + strains) @ (np.eye(3) - np.outer(FIBRE, FIBRE))
    change = size * rng.standard_normal((points, 3, 3))
    return turns @ (middle - rng.random((points, 1, 1)) * change), turns @ change


@pytest.mark.parametrize("law", BEARING + SMOOTH, ids=lambda law: type(law).__name__)
@pytest.mark.parametrize("size", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("at", AT)
def test_it_does_the_work_of_the_energy_however_small_the_change(law, size, at):
    F, H = across(size, AT[at])
    energy = law.energy(F), law.energy(F + H)
    work = np.sum(law.discrete(F, H)[0] * H, axis=(1, 2))
    # Half of it may be left out as rounding of energies, whose terms are of the size of the moduli.
    allowed = 64.0 * np.finfo(float).eps * (np.abs(law.tangent(F)).max() + np.abs(energy[0]).max())
    assert np.abs(work - (energy[1] - energy[0])).max() <= allowed


@pytest.mark.parametrize("law", BEARING, ids=lambda law: type(law).__name__)
@pytest.mark.parametrize("size", [1e-1, 1e-3, 1e-5])
def test_it_is_the_same_backwards_has_no_moment_and_turns_with_both_states(law, size):
    F, H = across(size)
    stress = law.discrete(F, H)[0]
    # What rounding of the energy is, divided by the change.
    allowed = 1e-13 * np.abs(law.tangent(F)).max() * (1.0 + 1e-2 / size)
    np.testing.assert_allclose(law.discrete(F + H, -H)[0], stress, rtol=0.0, atol=allowed)
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(law.discrete(turn @ F, turn @ H)[0], turn @ stress, rtol=0.0, atol=allowed)
    second = stress @ np.swapaxes(F + 0.5 * H, 1, 2)
    np.testing.assert_allclose(second, np.swapaxes(second, 1, 2), rtol=0.0, atol=1e-13 * np.abs(second).max())


@pytest.mark.parametrize("law", BEARING + SMOOTH, ids=lambda law: type(law).__name__)
@pytest.mark.parametrize("size", [0.2, 1e-2])
def test_its_moduli_are_its_derivatives(law, size):
    F, H = across(size, 1.1)
    moduli, found = law.discrete(F, H, True)[1], np.empty((len(F), 3, 3, 3, 3))
    step = 1e-6
    for b in range(3):
        for B in range(3):
            move = np.zeros((3, 3))
            move[b, B] = step
            found[..., b, B] = (law.discrete(F, H + move)[0] - law.discrete(F, H - move)[0]) / (2.0 * step)
    off = np.abs(moduli - found).max(axis=(1, 2, 3, 4)) / np.abs(found).max()
    # At a few of the points the differences step over where a fibre begins to bear.
    assert np.sort(off)[-20] < 1e-6 and (law in BEARING or off.max() < 1e-6)


@pytest.mark.parametrize("law", SMOOTH, ids=lambda law: type(law).__name__)
def test_it_is_the_same_on_any_number_of_points(law):
    """Whole blocks and parts of one; each point is by itself."""
    F, H = across(0.05, points=70)
    stress, moduli = law.discrete(F, H, True)
    for count in (1, 31, 32, 33, 64, 65):
        some, varied = law.discrete(F[-count:], H[-count:], True)
        np.testing.assert_allclose(some, stress[-count:], rtol=0.0, atol=1e-13 * np.abs(stress).max())
        np.testing.assert_allclose(varied, moduli[-count:], rtol=0.0, atol=1e-11 * np.abs(moduli).max())
    assert law.discrete(F[:0], H[:0], True)[0].shape == (0, 3, 3)
