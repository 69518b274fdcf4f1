"""Laws of small strains beyond their range: statics says so wherever a large rotation takes half a percent."""

import warnings

import numpy as np
import pytest

from isorod import statics
from isorod.geometry import center_line
from isorod.geometry.section import circle
from isorod.material import LinearElastic
from isorod.material.orthotropic import Orthotropic, TransverselyIsotropic
from isorod.material.places import alone
from isorod.material.st_venant_kirchhoff import StVenantKirchhoff
from isorod.model import Body, Model, SectionLoad, Support
from isorod.space import Space

LENGTH, E = 20.0, 100.0
SMALL = [
    LinearElastic(E, 0.3),
    Orthotropic((E,) * 3, (0.3,) * 3, (E / 2.6,) * 3),
    TransverselyIsotropic(E, E, 0.3, 0.3, E / 2.6),
]


@pytest.mark.parametrize("law", SMALL, ids=lambda law: type(law).__name__)
def test_energy_and_stress_are_linear_of_what_is_no_deformation_too(law):
    """As a mode of vibration of any size."""
    H = np.diag([-2.0, 0.3, 0.1]) + 0.2 * np.random.default_rng(7).standard_normal((1, 3, 3))
    law = law.placed(alone())
    assert np.linalg.det(np.eye(3) + H[0]) < 0.0
    for scale in (1e-3, 1.0, 10.0):
        stress = law.stress(np.eye(3) + scale * H)
        np.testing.assert_allclose(stress, scale * law.stress(np.eye(3) + H), rtol=1e-9)
        assert law.energy(np.eye(3) + scale * H) == pytest.approx(0.5 * scale * np.sum(stress * H), rel=1e-9)


def bent(law, angle):
    """Return how far the end of a cantilever goes that a force across turns by so much, and what is warned of."""
    space = Space(center_line.straight(LENGTH).sweep(circle(8)))
    force = 2.0 * angle * E * np.pi / 4.0 / LENGTH**2
    model = Model(
        [Body(space, law)], [Support.end(space, "start")], loads=[SectionLoad.end(space, "end", (0.0, force, 0.0))]
    )
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        solution = statics.solve(model)
    return solution.at(0, 1.0)[1], [str(one.message) for one in said]


@pytest.mark.parametrize("law", SMALL, ids=lambda law: type(law).__name__)
def test_a_rotation_is_warned_of_before_it_takes_half_a_percent(law):
    warned = []
    for angle in (0.02, 0.08, 0.12, 0.2, 1.0):
        found, said = bent(law, angle)
        exact, nothing = bent(StVenantKirchhoff(E, 0.3), angle)
        assert nothing == []
        assert said or abs(found / exact - 1.0) <= 0.005
        warned.append(bool(said))
    assert warned == [False, False, True, True, True]
    assert (
        f"rotations or strains of body 0 reach 1, the small-strain law {type(law).__name__} needs less than 0.1"
        in said[0]
    )
