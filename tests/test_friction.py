"""Coulomb friction: sticks, slides, turns with the rods, and what it takes is in the balance of energy."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import straight
from scipy.sparse import coo_matrix
from touching import ACROSS, LAW, crease, moved, pair, reference, shaken

from isorod.contact.operator import ContactOperator
from isorod.model import Body, Contact, Cylinder, Model, Plane, Sphere
from isorod.space import Space


def rubbing(scene, friction):
    """Return a scene with friction in all its contacts."""
    model = scene()
    return replace(model, contacts=[replace(contact, friction=friction) for contact in model.contacts])


def begun(model, size=0.004):
    """Return an operator that has accepted a state, and a displacement a step away from it."""
    operator, displacement = ContactOperator(model), shaken(model)
    operator.accept(displacement)
    return operator, displacement + size * np.random.default_rng(7).standard_normal(model.dofs)


def matrix(operator, displacement):
    values, size = operator.tangent(displacement), displacement.size
    return coo_matrix((values, (operator.rows, operator.columns)), shape=(size, size)).tocsr()


@pytest.mark.parametrize("scene", [pair, crease])
@pytest.mark.parametrize("friction", [100.0, 0.005], ids=["stick", "slip"])
def test_tangent_is_the_derivative_of_the_forces(scene, friction):
    model = rubbing(scene, friction)
    operator, displacement = begun(model)
    K = matrix(operator, displacement)
    stuck = sum(result.sticking for result in operator.results(displacement))
    slid = sum(result.slipping for result in operator.results(displacement))
    print(stuck, slid, abs(K - K.T).max() / abs(K).max())
    assert stuck > 20 * slid if friction > 1.0 else slid > 5 * stuck
    rng, step = np.random.default_rng(5), 1e-7
    for _ in range(5):
        v = rng.standard_normal(model.dofs)
        change = operator.forces(displacement - step * v)[0] - operator.forces(displacement + step * v)[0]
        change /= 2.0 * step
        print(np.abs(K @ v - change).max() / np.abs(change).max())
        assert np.abs(K @ v - change).max() < 1e-6 * np.abs(change).max()
        np.testing.assert_allclose(operator.product(v), K @ v, atol=1e-12 * np.abs(change).max())
