"""Pressures of the mixed formulation and what is made of them: force per area, whatever the unknowns are counted in."""

import numpy as np
import pytest
from conftest import straight

from isorod import statics
from isorod.material import LinearElastic, NeoHookean
from isorod.model import Body, Model, Support
from isorod.output import stress, vtk
from isorod.space import Space

XI = np.array([[0.0, 0.0], [0.5, -0.3], [0.0, 1.0]])
U = np.array([0.0, 0.2, 0.5, 0.9, 1.0])
STRETCH = 1.3


def stretched(law, lateral, **keywords):
    """A rod of which both ends move as in a uniaxial state of stress; the lateral surface is free."""
    space = Space.paper(straight(n=6, height=3.0), elements=2, degree=3, **keywords)
    F = np.diag([lateral, lateral, STRETCH])
    ends = []
    for which in ("start", "end"):
        nodes = Support.end(space, which).nodes
        ends.append(Support(nodes, "xyz", space.positions[nodes] @ (F - np.eye(3))))
    return statics.solve(Model([Body(space, law, formulation="mixed")], ends))


@pytest.mark.parametrize("E", [3.0, 21.0, 6e5])
@pytest.mark.parametrize("sections", [{"order": 1}, {"order": 2}, {"section_degree": 3}], ids=str)
def test_pressure_of_an_incompressible_bar_is_that_which_leaves_its_sides_free(E, sections):
    """``mu (a^2 - 1) + p = 0`` with ``a^2 = 1 / stretch``; the axial stress is ``mu (stretch^2 - 1 / stretch)``."""
    solution = stretched(NeoHookean(E, 0.5), STRETCH**-0.5, **sections)
    body, mu = solution.model.bodies[0], E / 3.0
    (pressure,) = solution.pressures
    exact = mu * (1.0 - 1.0 / STRETCH)
    assert body.pressures.evaluate(pressure, XI, U) == pytest.approx(np.full((5, 3), exact), rel=1e-7)
    found = stress.cauchy(body, solution.displacement, XI, U, pressure=pressure)
    wanted = np.broadcast_to(np.diag([0.0, 0.0, mu * (STRETCH**2 - 1.0 / STRETCH)]), found.shape)
    np.testing.assert_allclose(found, wanted, atol=1e-7 * mu)


def test_pressure_of_a_compressible_linear_bar():
    """Lame's ``lambda`` times the volume strain."""
    solution = stretched(LinearElastic(7.0, 0.25), 1.0 - 0.25 * (STRETCH - 1.0))
    lame, strain = 7.0 * 0.25 / (1.25 * 0.5), 0.5 * (STRETCH - 1.0)
    found = solution.model.bodies[0].pressures.evaluate(solution.pressures[0], XI, U)
    assert found == pytest.approx(np.full((5, 3), lame * strain), rel=1e-7)


def test_unknown_pressures_of_a_rod_of_several_laws_are_counted_in_the_middle_shear_modulus():
    space = Space.paper(straight(n=6), elements=3, degree=2, continuity=0)
    laws = [NeoHookean(3.0 * mu, 0.5) for mu in (2.0, 90.0, 5.0)]
    assert Body(space, laws, formulation="mixed").pressure_unit == pytest.approx(5.0)


def test_mean_stress_in_files_is_a_third_of_the_trace():
    """In a bar under uniaxial stress a third of the axial one, and von Mises is the axial one itself."""
    pytest.importorskip("pyvista")
    E = 21.0
    solution = stretched(NeoHookean(E, 0.5), STRETCH**-0.5)
    body = solution.model.bodies[0]
    fields = {"displacement": solution.displacement.reshape(-1, 3), "pressure": solution.pressures[0]}
    mesh = vtk.grid(body, fields, rings=1, around=6, slices=2)
    axial = E / 3.0 * (STRETCH**2 - 1.0 / STRETCH)
    assert mesh.point_data["mean_stress"] == pytest.approx(np.full(mesh.n_points, axial / 3.0), rel=1e-6)
    assert mesh.point_data["von_mises"] == pytest.approx(np.full(mesh.n_points, axial), rel=1e-6)
    assert "pressure" not in mesh.point_data
