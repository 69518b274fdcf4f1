"""What a step in time asks of a finite element body: work of the energy, no moment, tangents, no volume."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import dolfinx.fem
import solids
import ufl
from solids import mesh, solid, space
from test_solid import LAWS, MUSCLE, noise

from isorod import LinearElastic, NeoHookean, StVenantKirchhoff
from isorod.fenics.solid import Solid
from isorod.fenics.step import Step
from isorod.material.gent import Gent

LAW = NeoHookean(10.0, 0.3)

# C compilers take half a minute for principal stretches.
SLOW = [pytest.param(one, marks=[pytest.mark.slow] * (type(one).__name__ == "Ogden")) for one in LAWS]
ALL = [LAW, MUSCLE, StVenantKirchhoff(10.0, 0.3), *SLOW, Gent(2.0, 8.0, 20.0)]


@pytest.mark.parametrize("law", ALL, ids=lambda one: type(one).__name__)
def test_forces_of_a_step_do_the_work_of_the_energy_and_turn_nothing(law):
    body = solid(law=law, degree=2, counts=(2, 2, 1), density=1.0)
    step, start, change = Step(body), noise(body, 0.01), noise(body, 0.01, 1)
    step.begin(1.0, 0.0, start, 0.0 * start)
    inertial, forces, loads = step.forces(change, 0.6)
    work = body.energy(start + change, 0.6) - body.energy(start, 0.6)
    # Strains change by tenths.  Fibres begin to bear at some points, where Gauss points do not see all of it.
    assert forces @ change == pytest.approx(work, rel=1e-4 if law.families else 1e-7)
    assert not loads.any()
    assert inertial == pytest.approx(2.0 * body.momenta(change), abs=1e-15)
    middle = body.positions + (start + 0.5 * change).reshape(-1, 3)
    nodal = forces.reshape(-1, 3)
    assert np.abs(nodal.sum(axis=0)).max() < 1e-12 * np.abs(nodal).max()
    if law.objective:
        assert np.abs(np.cross(middle, nodal).sum(axis=0)).max() < 1e-11 * np.abs(nodal).max()


@pytest.mark.parametrize("law", [MUSCLE, SLOW[0], LAWS[1], LinearElastic(2.0, 0.3)], ids=lambda one: type(one).__name__)
def test_the_tangent_of_a_step_is_the_derivative_of_its_forces(law):
    one = space(mesh("tetrahedron", (2, 2, 1), place=solids.box), 2)
    u, v = dolfinx.fem.Function(one), ufl.TestFunction(one)
    F = ufl.Identity(3) + ufl.grad(u)
    pressure = 0.3 * ufl.inner(ufl.cofac(F) * ufl.FacetNormal(one.mesh), v) * ufl.ds(metadata={"quadrature_degree": 4})
    body = Solid(one, law, 1.5, load=pressure, unknown=u)
    step, start, change, way, h = Step(body), noise(body, 0.01), noise(body, 0.01, 1), noise(body, 1.0, 2), 1e-6
    step.begin(0.5, 0.2, start, noise(body, 0.1, 3))

    def balance(change):
        inertial, internal, loads = step.forces(change, 0.6)
        return inertial + internal - loads

    expected = (balance(change + h * way) - balance(change - h * way)) / (2.0 * h)
    assert np.abs(solids.times(step.tangent(change, 0.6), way) - expected).max() < 1e-7 * np.abs(expected).max()


def test_a_step_has_no_forces_where_a_cell_is_turned_inside_out():
    body = solid(law=LAW, density=1.0)
    step = Step(body)
    step.begin(1.0, 0.0, np.zeros(3 * body.nodes), np.zeros(3 * body.nodes))
    assert np.isnan(step.forces((body.positions * [-2.0, 0.0, 0.0]).ravel(), 1.0)[1]).all()
