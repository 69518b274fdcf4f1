"""Contact that nobody tuned: penalty, multipliers and points by default, what is said of a patch, and its picture."""

import re
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import straight
from touching import bars, strip

from isorod import LinearElastic, Material, Muscle, NeoHookean, Space, StVenantKirchhoff, statics
from isorod.command import printing
from isorod.contact import cells, quality
from isorod.contact.defaults import penalty
from isorod.contact.operator import ContactOperator
from isorod.contact.tables import pack
from isorod.output import vtk

E, NU = 1.0, 0.3


def quiet(model, **options):
    with warnings.catch_warnings(action="ignore"):
        return statics.solve(model, **options)


def hertz(solution, modulus=E / (1.0 - NU**2)):
    """Return errors of half width, by the pressure's second moment, and peak, of a `strip`'s force."""
    (result,) = solution.contacts
    width = np.sqrt(4.0 * result.force / (np.pi * modulus))
    load = result.areas * result.pressure
    found = 2.0 * np.sqrt(load @ result.positions[:, 0] ** 2 / load.sum())
    # Pressures are per reference area, which at the peak is 2.5 per cent larger.
    return found / width - 1.0, result.peak / 0.975 / (2.0 * result.force / (np.pi * width)) - 1.0


def test_the_default_penalty_does_not_grow_without_bound_near_incompressibility():

    def own(model):
        return penalty(model, model.contacts[0])

    penalties = [own(strip(law=LinearElastic(E, nu))) for nu in (0.3, 0.49, 0.499999)]
    assert penalties[2] == pytest.approx(penalties[1], rel=0.02)
    assert penalties[2] == pytest.approx(penalties[0] * (1.0 - 0.3**2) / 0.75, rel=1e-4)
    # Shorter waves meet a stiffer surface.
    assert own(strip(128)) == pytest.approx(2.0 * penalties[0], rel=1e-9)


def test_a_surface_is_as_stiff_as_its_shear_and_pressure_waves_say():
    for nu in (-0.2, 0.0, 0.3, 0.45):
        law = StVenantKirchhoff(7.0, nu)
        assert Material.surface_modulus.fget(law) == pytest.approx(law.surface_modulus, rel=1e-12)
    assert NeoHookean(3.0, 0.5).surface_modulus == pytest.approx(4.0)
    # Fibres along the rod do not stiffen it.
    assert Muscle(3.0, 0.3, m1=50.0, m2=2.0).surface_modulus == pytest.approx(3.0 / 0.91)


@pytest.mark.parametrize("n", [56, 64, 80])
def test_hertz_by_default(n):
    """1.9 to 2.7 control points across the patch; nothing is told but the space."""
    solution = quiet(strip(n))
    width, peak = hertz(solution)
    (result,) = solution.contacts
    assert abs(width) < 0.05
    assert abs(peak) < 0.12
    assert result.relative_penetration < 1e-3
    assert 1 <= solution.augmentations <= 3
    assert result.force_error < 0.05
    assert abs(peak) < result.peak_error < 0.25


@pytest.mark.parametrize("E_", [1e-3, 1e5])
def test_stiff_and_soft_are_the_same_problem(E_):
    soft, hard = quiet(strip(64)), quiet(strip(64, LinearElastic(E_, NU)))
    assert hard.contacts[0].force == pytest.approx(E_ * soft.contacts[0].force, rel=1e-6)
    assert hard.newton_iterations == soft.newton_iterations


def test_multipliers_in_cells_do_not_sharpen_the_pressure_with_each_update():
    """At points they would: the peak grows by a fifth in three updates."""
    found = []
    for limit in (None, 5e-4):
        (result,) = quiet(strip(64, penetration=limit)).contacts
        found.append(result.peak)
    assert found[1] == pytest.approx(found[0], rel=0.05)


def test_points_grow_until_the_patch_is_seen():
    """Three points an arc and four an element saw two or three points of this patch."""
    few, best, own = (
        quiet(bars(0.3, penalty=2e3, **points)).contacts[0] for points in ({"points": (3, 4)}, {"points": (16, 24)}, {})
    )
    assert few.points_across < quality.POINTS
    assert own.points_across >= quality.FEWEST
    assert own.force == pytest.approx(best.force, rel=0.01)
    assert own.force_error < 0.02


def test_a_patch_that_control_points_do_not_see_is_warned_of():
    """Crossed cylinders on eight control points: the silent factor of 1.8."""
    with pytest.warns(
        UserWarning,
        match=r"contact 0: contact patch under-resolved: 0\.\d+ control points wide on body [01] at u = \S+,",
    ):
        solution = statics.solve(bars(0.3))
    (result,) = solution.contacts
    assert result.cells_across < quality.CELLS
    assert result.peak_error > 0.2
    with pytest.warns(UserWarning, match=r"contact force changes by \d+ % .* increase points"):
        statics.solve(strip(80, points=(1, 1)))


def test_each_doubt_says_what_and_where():
    (result,) = quiet(strip(80)).contacts
    assert result.doubt() is None
    found = replace(result, points_across=2.0).doubt()
    assert re.fullmatch(
        r"contact patch under-resolved: \d+ active quadrature points on body 0 at u = \S+, 2 across; "
        r"increase points .*",
        found,
    )
    assert "4 times as many section points" in replace(result, cells_across=0.1).doubt()
    assert replace(result, cells_across=0.1, at_lines=True).doubt() is None
    assert replace(result, points_across=0.0).doubt() is None


def test_what_is_seen_well_is_not_warned_of():
    with warnings.catch_warnings(action="error"):
        statics.solve(strip(80))


def test_results_of_a_contact_are_in_the_record():
    solution = quiet(bars(0.3))
    (result,) = solution.contacts
    record = solution.record()
    (kept,) = record["contacts"]
    assert kept["relative_penetration"] == result.relative_penetration <= 1e-3
    assert kept["active"] == np.count_nonzero(result.pressure)
    assert kept["peak"] == result.pressure.max()
    assert record["augmentations"] == solution.augmentations >= 1
    # What the second bar's supports press with arrives at the first.
    pressed = solution.reactions[2:].sum(axis=0)
    np.testing.assert_allclose(result.resultant, pressed, atol=1e-6 * np.abs(pressed).max())
    assert result.force >= np.linalg.norm(result.resultant)


def test_contact_is_one_line_of_the_summary():
    solution = quiet(strip(64))
    scene = SimpleNamespace(units={}, stresses=(), described="strip")
    said = printing.summary({**solution.record(), "scene": "strip", "analysis": "statics"}, scene)
    (line,) = [line for line in said.splitlines() if line.startswith("contact")]
    (result,) = solution.contacts
    assert f"peak {result.peak:.3g} (" in line
    assert line.endswith("6 points wide")
    assert len(line) <= 80


def test_runs_of_points():
    rows = np.array([[1, 1, 0, 1, 0, 1], [0, 0, 0, 0, 0, 0], [1, 1, 1, 1, 1, 1]], dtype=bool)
    np.testing.assert_array_equal(quality._runs(rows, False)[0], [2, 2, 0, 1, 0, 1])
    np.testing.assert_array_equal(quality._runs(rows, True)[0], [3, 3, 0, 1, 0, 3])
    assert not quality._runs(rows, True)[1].any()
    assert np.isinf(quality._runs(rows, True)[2]).all()


def test_cells_hold_means_and_points_are_where_they_say():
    model = bars(0.3, points=(4, 5))
    operator = ContactOperator(model)
    packed = operator.packed
    values = np.maximum(0.0, np.random.default_rng(1).standard_normal(packed.areas.size))
    packed.states["pressure"] = values
    means = cells.means(packed, values)
    assert packed.areas @ means == pytest.approx(packed.areas @ values, rel=1e-12)
    np.testing.assert_array_equal(means > 0.0, values > 0.0)
    np.testing.assert_allclose(cells.means(packed, means), means, rtol=1e-12)
    # Along the axis there are as many cells as functions: of smooth axes one an element.
    rod = straight(8, degree=1)
    assert [cells.functions(Space(rod, 4, 3, continuity)) for continuity in (0, 1, 2)] == [3, 2, 1]
    parts = cells.functions(model.bodies[0].space)
    first, mean = (next(cells.grids(packed, one)) for one in (values, means))
    assert np.unique(mean[1, :, 2][first[1, :, 2] > 0.0].round(12)).size == parts
    finer = pack(model, [(8, 10)] * 2)
    np.testing.assert_array_equal(np.unique(cells.moved(packed, means, finer)), np.unique(means))
    (result,) = operator.results(np.zeros(model.dofs))
    for body in (0, 1):
        rod, own = model.bodies[body].space.rod, result.body == body
        u, angle = result.parameters[own].T
        at = rod.points(np.stack([np.cos(angle), np.sin(angle)], axis=1), u)
        np.testing.assert_allclose(at, result.positions[own], atol=1e-12)


def test_pressure_of_contact_is_in_the_vtk_file(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    solution = quiet(bars(0.3, penalty=2e3))
    (result,) = solution.contacts
    fields = solution.fields(1)
    (tmp_path / "high.vtu").write_bytes(vtk.content(vtk.grid(solution.model.bodies[1], fields)))
    mesh = pyvista.read(tmp_path / "high.vtu")
    pressure = mesh.point_data["contact_pressure"]
    own = result.body == 1
    assert pressure.max() == pytest.approx(result.pressure[own].max(), rel=1e-6)
    # It is where the first bar is: below.
    low = mesh.points[np.argmax(pressure)]
    assert np.hypot(low[0], low[2]) < 0.5
    assert low[1] == pytest.approx(1.0, abs=0.05)
    # Elements have end faces of their own; the lateral one is where all corners of a cell are on the outline.
    surface = mesh.extract_surface(algorithm="dataset_surface").compute_cell_sizes()
    surface.point_data["outer"] = np.hypot(surface.points[:, 1] - 2.0, surface.points[:, 2]) > 0.999
    mean = surface.point_data_to_cell_data().cell_data
    lateral = mean["outer"] == 1.0
    whole = surface.cell_data["Area"][lateral] @ mean["contact_pressure"][lateral]
    assert whole == pytest.approx(2.0 * result.areas[own] @ result.pressure[own], rel=0.03)
    assert "contact_pressure" not in statics.solve(replace(solution.model, contacts=[])).fields(0)
