"""Cauchy and von Mises stress."""

import numpy as np
import pytest

from isorod.material import LinearElastic, NeoHookean
from isorod.model import Body
from isorod.output.stress import cauchy, von_mises
from isorod.scenes.spring import Spring
from isorod.space import Space

XI = np.array([[0.0, 0.0], [0.4, -0.3], [1.0, 0.0]])
U = np.array([0.0, 0.3, 1.0])


def homogeneous(body, F):
    """Nodal displacements of the affine map F."""
    rod, space = body.space.rod, body.space
    rest = rod.axis.transfer(space.axis, rod.control_points).reshape(-1, 3)
    return rest @ (F - np.eye(3)).T


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


@pytest.fixture(params=["straight", "spring"])
def body(request, cylinder):
    rod = cylinder(5, height=2.0) if request.param == "straight" else Spring(section_points=5, coils=1).rod()
    return Body(Space.paper(rod, degree=3), NeoHookean(2.0, 0.3))


def test_von_mises_of_known_states():
    assert von_mises(np.diag([0.0, 0.0, -7.0])) == pytest.approx(7.0)
    assert von_mises(5.0 * np.eye(3)) == pytest.approx(0.0, abs=1e-14)
    shear = np.zeros((2, 3, 3))
    shear[:, 0, 1] = shear[:, 1, 0] = 2.0
    assert von_mises(shear) == pytest.approx([2 * np.sqrt(3)] * 2)
    s1, s2, s3 = 3.0, -1.0, 0.5
    expected = np.sqrt(((s1 - s2) ** 2 + (s2 - s3) ** 2 + (s3 - s1) ** 2) / 2)
    Q = rotation(0.7)
    assert von_mises(Q @ np.diag([s1, s2, s3]) @ Q.T) == pytest.approx(expected)


def test_rest_and_rigid_turns_have_no_stress(body):
    for F in (np.eye(3), rotation(1.1)):
        assert np.abs(cauchy(body, homogeneous(body, F), XI, U)).max() < 1e-12


def test_homogeneous_stretch_gives_the_principal_stresses_of_the_law(body):
    stretches, law = np.array([0.9, 1.1, 1.3]), body.material
    J = stretches.prod()
    expected = (law.mu * (stretches**2 - 1) + law.lame * np.log(J)) / J
    stress = cauchy(body, homogeneous(body, np.diag(stretches)), XI, U)
    assert stress.shape == (3, 3, 3, 3)
    assert np.abs(stress - np.diag(expected)).max() < 1e-12
    Q = rotation(0.8)
    turned = cauchy(body, homogeneous(body, Q @ np.diag(stretches)), XI, U)
    assert np.abs(turned - Q @ np.diag(expected) @ Q.T).max() < 1e-12


def test_cauchy_stress_is_symmetric_in_any_state(body):
    random = np.random.default_rng(1)
    stress = cauchy(body, 0.05 * random.uniform(-1, 1, (body.space.nodes, 3)), XI, U)
    assert np.abs(stress).max() > 0.01
    assert np.abs(stress - stress.swapaxes(-1, -2)).max() < 1e-13


def test_uniaxial_stress_of_the_linear_law_is_young_times_strain(cylinder):
    body = Body(Space.paper(cylinder(4)), LinearElastic(200.0, 0.25))
    strain = 1e-7
    nodal = homogeneous(body, np.eye(3) + strain * np.diag([-0.25, -0.25, 1.0]))
    assert von_mises(cauchy(body, nodal, XI, U)) == pytest.approx(200.0 * strain, rel=1e-6)
