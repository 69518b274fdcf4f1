"""Rotations that are large: laws with axes that know them, beside St. Venant-Kirchhoff, and laws of small strains."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from isorod import OrthotropicKirchhoff, Space, StVenantKirchhoff, dynamics, ellipse, modal, statics
from isorod.geometry import center_line
from isorod.material import LinearElastic, NeoHookean
from isorod.material.orthotropic import Orthotropic, TransverselyIsotropic
from isorod.model import Body, Model, SectionLoad, Support

WOOD = (5.0, 3.0, 2.0), (0.3, 0.25, 0.35), (1.2, 1.0, 0.8)
E, NU, LENGTH = 100.0, 0.3, 20.0
ISOTROPIC = (E,) * 3, (NU,) * 3, (E / (2.0 + 2.0 * NU),) * 3
SMALL = [LinearElastic(E, NU), Orthotropic(*ISOTROPIC), TransverselyIsotropic(E, E, NU, NU, E / 2.6)]


def bent(law, angle):
    """A cantilever that a force across turns by so much."""
    space = Space(center_line.straight(LENGTH).sweep(ellipse(8, 1.0, 0.7)), section_degree=2)
    force = 2.0 * angle * E * np.pi / 4.0 * 0.7**3 / LENGTH**2
    load = SectionLoad.end(space, "end", (0.0, force, 0.0))
    return statics.solve(Model([Body(space, law, 1.0)], [Support.end(space, "start")], loads=[load]))


@pytest.mark.parametrize("law", SMALL, ids=lambda law: type(law).__name__)
def test_a_rotation_is_warned_of_before_it_takes_half_a_percent(law):
    warned = []
    for angle in (0.02, 0.08, 0.12, 0.2, 1.0):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            exact, nothing = bent(StVenantKirchhoff(E, NU), angle).at(0, 1.0)[1], len(said)
            found = bent(law, angle).at(0, 1.0)[1]
        assert nothing == 0
        assert said or abs(found / exact - 1.0) <= 0.005
        warned.append(bool(said))
    assert warned == [False, False, True, True, True]
    line = f"rotations or strains of body 0 reach 1, the small-strain law {type(law).__name__} needs less than 0.1"
    assert line in str(said[0].message)


def test_a_cantilever_bent_by_a_radian_and_its_modes():
    one, other = (bent(law, 1.5) for law in (OrthotropicKirchhoff(*ISOTROPIC), StVenantKirchhoff(E, NU)))
    assert one.at(0, 1.0)[1] > 0.4 * LENGTH
    np.testing.assert_allclose(one.displacement, other.displacement, atol=1e-7 * LENGTH)
    assert one.negative_eigenvalues == 0
    frequencies = [modal.solve(state.model, 3, state=state).frequencies for state in (one, other)]
    np.testing.assert_allclose(*frequencies, rtol=1e-7)


def test_stiffer_along_the_rod_than_across():
    """Along the centre line, axis 1, it has ``E_1``, which bends; all turns that it knows keep that so."""
    stiff = (E, 0.1 * E, 0.1 * E), (NU, NU, NU), (0.03 * E,) * 3
    tip, known = (bent(law, 1.0).at(0, 1.0)[1] for law in (OrthotropicKirchhoff(*stiff), StVenantKirchhoff(E, NU)))
    across = bent(OrthotropicKirchhoff(*stiff, ("normal", "tangent")), 0.01).at(0, 1.0)[1]
    # Shear adds a little.
    assert known < tip < 1.06 * known
    assert across == pytest.approx(bent(StVenantKirchhoff(0.1 * E, NU), 0.01).at(0, 1.0)[1], rel=0.01)


@pytest.mark.parametrize("law", [OrthotropicKirchhoff, Orthotropic])
def test_a_layer_without_a_place_is_not_asked(law):
    rod = replace(center_line.straight(LENGTH).sweep(ellipse(8, 1.0, 1.0)), rings=(0.0, 0.6, 1.0))
    space = Space(rod, section_degree=3, elements=2, degree=3)
    body = Body(space, [law(*WOOD, ("tangent", "normal")), StVenantKirchhoff(E, NU)])
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, 0.02))
    solution, at = statics.solve(Model([body], ends)), [[0.0, 0.3], [0.9, 0.0]]
    both = solution.stress(0, 0.5, at)
    for k, one in enumerate(at):
        np.testing.assert_allclose(solution.stress(0, 0.5, [one])[0], both[k], rtol=1e-9, atol=1e-12)


def test_a_rod_of_wood_and_of_rubber_in_explicit_steps_keeps_its_energy():
    """Poisson's ratios of one are three numbers, that of the other is one."""
    space = Space(center_line.straight(10.0).sweep(ellipse(8, 1.0, 0.5)), elements=4, degree=3)
    laws = [OrthotropicKirchhoff(*WOOD)] * 2 + [NeoHookean(2.0, NU)] * 2
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.01, 0.0))
    history = dynamics.solve(Model([Body(space, laws, 1.0)], ends), 0.5, outputs=1)
    assert np.abs(history.energy_error).max() < 1e-4 and history.stored[-1] > 0.0


@pytest.mark.parametrize("stretch", [0.9, 1.2])
def test_a_stretched_bar_bears_what_st_venant_and_kirchhoff_say(stretch):
    """nu = 0: no strain across, ``P = E L (L^2 - 1) / 2`` along."""
    space = Space(center_line.straight(LENGTH).sweep(ellipse(8, 1.0, 1.0)), elements=2)
    end = Support.end(space, "end", displacement=(0.0, 0.0, (stretch - 1.0) * LENGTH))
    solution = statics.solve(Model([Body(space, StVenantKirchhoff(E, 0.0))], [Support.end(space, "start"), end]))
    force = 0.5 * E * stretch * (stretch**2 - 1.0) * np.pi
    assert solution.reactions[1, 2] == pytest.approx(force, rel=1e-9)
