"""Vibration modes by finite elements: bars with exact frequencies, the count that confirms them, and solver options."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from comparisons.fem.domain import Domain
from comparisons.fem.modal import RIGID, Settings, Solid, solve
from comparisons.fem.statics import Element
from isorod import ellipse
from isorod.errors import InputError, SolveError
from isorod.geometry import center_line
from isorod.modal.pencil import Pencil
from meshes.bricks import bricks
from meshes.split import fan, layered
from meshes.template import o_grid

STEEL = Solid(E=200.0, nu=0.3, density=2.0)


def bar(rod, kind: str, layers: int = 8, around: int = 8) -> Domain:
    if kind == "P2":
        return Domain.distribute(layered(rod, fan(6, 2, turn=45.0), layers))
    return Domain.distribute(bricks(rod, o_grid(around, 1, int(kind[1])), layers))


@pytest.mark.parametrize("kind, layers, tolerance", [("Q2", 8, 2e-3), ("Q3", 4, 1e-4), ("P2", 8, 1e-2)])
def test_free_bar_has_six_rigid_modes_and_the_exact_torsion(cylinder, kind, layers, tolerance):
    found = solve(bar(cylinder(height=6.0), kind, layers), STEEL, modes=8, element=Element(int(kind[1])))
    # The last one's twin may lie beyond.
    assert found.rigid == RIGID and found.below in (RIGID + 8, RIGID + 9)
    assert found.eigenvalues[:RIGID] == pytest.approx(0.0, abs=1e-6 * found.eigenvalues[RIGID])
    # Bending comes in pairs: none is missed or doubled.
    pairs = found.frequencies[RIGID : RIGID + 2]
    assert pairs[0] == pytest.approx(pairs[1], rel=0.02) and found.frequencies[RIGID + 2] > 1.2 * pairs[1]
    shear = STEEL.E / 2.6
    torsion = np.sqrt(shear / STEEL.density) / (2.0 * 6.0)
    nearest = found.frequencies[np.argmin(np.abs(found.frequencies - torsion))]
    assert nearest == pytest.approx(torsion, rel=tolerance)
    # Where its twin lies beyond, rounding brings that into the last one, after the test of convergence.
    assert found.residuals[:-1].max() < 1e-8 and found.residuals[-1] < 1e-6


def test_twins_of_a_symmetric_bar_are_found(cylinder):
    # Asked for nine, the last one's twin lies beyond: the count sees it.
    for modes in (1, 3, 9):
        found = solve(bar(cylinder(height=6.0), "Q2", around=4), STEEL, ["start"], modes=modes)
        assert len(found.frequencies) == modes and modes <= found.below <= modes + 1


@pytest.mark.parametrize("element", [Element(2), Element(2, "irons14")])
def test_slender_cantilever_is_eulers_and_bernoullis(cylinder, element):
    wave = np.array([1.8751041, 4.6940911])
    excess = []
    for length in (30.0, 60.0):
        found = solve(bar(cylinder(height=length), "Q2", layers=16), STEEL, ["start"], 4, element)
        exact = wave**2 / (2.0 * np.pi * length**2) * np.sqrt(STEEL.E / STEEL.density * 0.25)
        assert found.frequencies[[1, 3]] == pytest.approx(found.frequencies[[0, 2]], rel=1e-6)
        excess.append(found.frequencies[[0, 2]] / exact - 1.0)
    # What the beam leaves out, shear, rotary inertia and the clamped face, goes with the slenderness.
    assert np.abs(excess[1]).max() < 5e-3
    assert abs(excess[0][1]) > 2.0 * abs(excess[1][1])


def test_enhanced_bricks_do_not_lock_in_bending(cylinder):
    length = 40.0
    exact = 1.8751041**2 / (2.0 * np.pi * length**2) * np.sqrt(STEEL.E / STEEL.density * 0.25)
    where = bar(cylinder(height=length), "Q1", layers=16)
    enhanced = solve(where, STEEL, ["start"], 2, Element(1, 2, "enhanced"))
    plain = solve(where, STEEL, ["start"], 2, Element(1))
    # Radius of inertia of the octagon of straight edges, 0.95 of the circle's: I / A = R^2 (2 + cos 45) / 12.
    octagon = np.sqrt((2.0 + np.cos(np.pi / 4)) / 3.0)
    assert 0.0 < enhanced.frequencies[0] / (octagon * exact) - 1.0 < 0.025
    assert plain.frequencies[0] > 1.2 * enhanced.frequencies[0]
    assert enhanced.below == plain.below == 2


def test_stiffness_and_mass_scale_as_they_should(cylinder):
    where = bar(cylinder(height=6.0), "Q2", 4)
    one = solve(where, STEEL, ["start"], 3).frequencies
    other = solve(where, Solid(4.0 * STEEL.E, STEEL.nu, 0.25 * STEEL.density), ["start"], 3).frequencies
    assert other == pytest.approx(4.0 * one, rel=1e-8)


@pytest.mark.parametrize("held", [["start"], []], ids=["clamped", "free"])
@pytest.mark.parametrize("error", [-1, 1])
def test_a_count_that_disagrees_is_refused(error, held, monkeypatch):
    """More or fewer eigenvalues found than the inertia of K - tau M tells; of a bar without equal ones."""
    rod = center_line.straight(6.0).sweep(ellipse(8, 1.0, 0.6))
    count = Pencil.count_below
    monkeypatch.setattr(Pencil, "count_below", lambda self, value: count(self, value) + error)
    with pytest.raises(SolveError, match=r"modes: \d+ eigenvalues lie at or below [\d.e+-]+, but \d+ converged"):
        solve(bar(rod, "Q2", 4), STEEL, held, modes=3)


def test_every_mode_of_a_small_mesh_is_found(cylinder):
    """As often as the dense matrices have it; the last one's twin may lie beyond."""
    where = bar(cylinder(height=6.0), "Q2", 1, around=4)
    count = 40
    found = solve(where, STEEL, ["start"], count)
    exact = solve(where, STEEL, ["start"], found.unknowns - 1).eigenvalues
    assert found.eigenvalues == pytest.approx(exact[:count], rel=1e-8)
    assert found.below == np.count_nonzero(exact < exact[count - 1] * (1.0 + 1e-6))


def test_jacobi_and_davidson_agree(cylinder, petsc_options):
    where = bar(cylinder(height=6.0), "Q2", 4)
    expected = solve(where, STEEL, ["start"], 3).eigenvalues
    petsc_options(eps_type="jd")
    assert solve(where, STEEL, ["start"], 3).eigenvalues == pytest.approx(expected, rel=1e-6)


def test_multigrid_is_told_the_rigid_motions(cylinder, petsc_options):
    where = bar(cylinder(height=6.0), "Q2", 4)
    expected = solve(where, STEEL, ["start"], 2).eigenvalues
    petsc_options(st_ksp_type="cg", st_ksp_rtol=1e-11, st_pc_type="gamg")
    assert solve(where, STEEL, ["start"], 2, settings=Settings(matrix_type="aij")).eigenvalues == (
        pytest.approx(expected, rel=1e-8)
    )


def test_matrix_types_and_shift_change_nothing(cylinder, petsc_options):
    where = bar(cylinder(height=6.0), "Q2", 4)
    one = solve(where, STEEL, ["start"], 3)
    for kind in ("aij", "baij"):
        options = {"st_pc_type": "lu", "st_pc_factor_mat_solver_type": "mumps", "st_type": "sinvert"}
        settings = Settings(options, matrix_type=kind, check=False)
        found = solve(where, STEEL, ["start"], 3, settings=settings)
        assert found.below is None
        assert found.frequencies == pytest.approx(one.frequencies, rel=1e-8)
    petsc_options(st_shift=0.5 * one.eigenvalues[0])
    # The shifted matrix is still definite.
    assert solve(where, STEEL, ["start"], 3).frequencies == pytest.approx(one.frequencies, rel=1e-8)


def test_density_and_faces(cylinder):
    where = bar(cylinder(), "Q1", 2)
    with pytest.raises(InputError, match="density: got 0"):
        solve(where, Solid(1.0, 0.3, 0.0), ["start"], 1, Element(1))
    with pytest.raises(InputError, match="'top', need one of"):
        solve(where, STEEL, ["top"], 1, Element(1))
    with pytest.raises(InputError, match="modes: got 0, need 1 to"):
        solve(where, STEEL, ["start"], 0, Element(1))
