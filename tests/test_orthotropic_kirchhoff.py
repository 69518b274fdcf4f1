"""The law with axes for large rotations: small strains, rotations, and an isotropic one beside St. Venant-Kirchhoff."""

from dataclasses import replace

import numpy as np
import pytest

from isorod import dynamics, modal, statics
from isorod.geometry import center_line
from isorod.geometry.section import ellipse
from isorod.material.neo_hookean import NeoHookean
from isorod.material.orthotropic import Orthotropic
from isorod.material.orthotropic_kirchhoff import OrthotropicKirchhoff
from isorod.material.st_venant_kirchhoff import StVenantKirchhoff
from isorod.model import Body, Model, SectionLoad, Support
from isorod.model.support import rotation
from isorod.space import Space

WOOD = (5.0, 3.0, 2.0), (0.3, 0.25, 0.35), (1.2, 1.0, 0.8)
AXES = (1.0, 2.0, 0.5), (0.3, -1.0, 0.8)
E, NU, LENGTH = 100.0, 0.3, 20.0
ISOTROPIC = (E,) * 3, (NU,) * 3, (E / (2.0 + 2.0 * NU),) * 3
RANDOM = np.random.default_rng(3).standard_normal((20, 3, 3))


def test_small_strains_are_those_of_the_linear_law():
    law, linear = OrthotropicKirchhoff(*WOOD, AXES), Orthotropic(*WOOD, AXES)
    F = np.eye(3) + 1e-6 * RANDOM
    np.testing.assert_allclose(law.stress(F), linear.stress(F), atol=1e-10)


def test_a_rotation_turns_the_stress_and_the_axes_stay_with_the_material():
    law = OrthotropicKirchhoff(*WOOD, AXES)
    F, R = np.eye(3) + 0.1 * RANDOM, rotation((1.0, -2.0, 0.7))
    np.testing.assert_allclose(law.stress(R @ F), R @ law.stress(F), atol=1e-12)
    # Turning the material before is another thing, unless its axes turn along.
    turned = OrthotropicKirchhoff(*WOOD, [R.T @ one for one in np.array(AXES)])
    np.testing.assert_allclose(turned.stress(F @ R), law.stress(F) @ R, atol=1e-12)
    assert np.abs(law.stress(F @ R) - law.stress(F) @ R).max() > 1e-2


def test_isotropic_moduli_are_st_venant_and_kirchhoff():
    F = np.eye(3) + 0.2 * RANDOM
    law, isotropic = OrthotropicKirchhoff(*ISOTROPIC, AXES), StVenantKirchhoff(E, NU)
    np.testing.assert_allclose(law.stress(F), isotropic.stress(F), atol=1e-11 * E)
    assert np.isnan(law.stress(np.diag([1.0, 1.0, -1.0])[None])).all()


def bent(law, angle):
    """A cantilever that a force across turns by so much."""
    space = Space(center_line.straight(LENGTH).sweep(ellipse(8, 1.0, 0.7)), section_degree=2)
    force = 2.0 * angle * E * np.pi / 4.0 * 0.7**3 / LENGTH**2
    body = Body(space, law, 1.0)
    load = SectionLoad.end(space, "end", (0.0, force, 0.0))
    return statics.solve(Model([body], [Support.end(space, "start")], loads=[load]))


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
    solution = statics.solve(
        Model([body], [Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, 0.02))])
    )
    at = [[0.0, 0.3], [0.9, 0.0]]
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
