"""Curved cells: VTK, which knows nothing of rods, reads geometry, displacement and stress from them."""

import numpy as np
import pytest

import isorod
from isorod import modal, statics
from isorod.command.run import _cells
from isorod.geometry import section
from isorod.geometry.center_line import straight
from isorod.geometry.coils import arc
from isorod.material import LinearElastic
from isorod.model import Body, Model, Support
from isorod.output import folder, stress, vtk
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring
from isorod.space import Space

pyvista = pytest.importorskip("pyvista")


def layered():
    rod = arc(20.0, 90.0).sweep(section.ellipse(8, 2.0, 1.0)).with_rings([0.3, 0.7, 1.0])
    space = Space(rod, section_degree=4, elements=2, degree=4, continuity=3)
    body = Body(space, [LinearElastic(2e5, 0.3), LinearElastic(1e4, 0.4)])
    return statics.solve(
        Model([body], [Support.end(space, "start"), Support.end(space, "end", displacement=(0.5, 0.0, 1.0))])
    )


def closed():
    rod = arc(20.0, 360.0).sweep(section.circle(8, 2.0))
    space = Space(rod, elements=8, degree=3, section_degree=3)
    u = np.linspace(0.0, 1.0, space.nodes)
    return space, np.stack([np.sin(7 * u), np.cos(5 * u), u], axis=1)


def spring(**options):
    return statics.solve(Spring(helix="paper", coils=1, **options).model())


def tapered():
    """A section that is no affine image of a circle, nor seen whole from its centroid; functions of control points."""
    bent = np.array([[2, 0], [2, 1.2], [0, 0.5], [-2, 1.2], [-2, 0], [-1, -0.6], [0, -0.4], [1, -0.6]], dtype=float)
    space = Space(straight(4.0).sweep(bent), elements=1, degree=2, section_degree=3)
    end = Support.end(space, "end", displacement=(0.0, 0.1, 0.0))
    return statics.solve(Model([Body(space, LinearElastic(1.0, 0.3))], [Support.end(space, "start"), end]))


CASES = {
    "spring": spring,
    "degree 8": lambda: spring(section_degree=8, degree=6),
    "control points": lambda: spring(preset="paper"),
    "order 2": lambda: spring(order=2, section_points=4),
    "incompressible": lambda: spring(nu=0.5),
    "layers": layered,
    "bent section": tapered,
}


def read(body, mesh):
    """Yield disk point and axis parameter of random points of cells, and what VTK makes of each: its place and fields.

    Radius, angle and axis parameter are linear in each of them.
    """
    from vtkmodules.vtkCommonCore import reference

    angles, rings, breaks = vtk._curved_angles(body), body.space.rod.rings, body.space.axis.breaks
    angles, round_it = np.append(angles, angles[0] + 2.0 * np.pi), len(angles) // 4
    rng = np.random.default_rng(5)
    for _ in range(80):
        number, at = int(rng.integers(mesh.n_cells)), rng.random(3)
        cell, place, weights = mesh.GetCell(number), [0.0] * 3, [0.0] * 125
        cell.EvaluateLocation(reference(0), at, place, weights)
        ids = [cell.GetPointId(k) for k in range(125)]
        third, across = divmod(number, round_it * (len(rings) - 1))
        ring, k = divmod(across, round_it)
        element, side = divmod(third, 3)
        u = breaks[element] + (side + at[2]) / 3.0 * (breaks[element + 1] - breaks[element])
        angle = angles[4 * k] + at[1] * (angles[4 * k + 4] - angles[4 * k])
        radius = rings[ring] + at[0] * (rings[ring + 1] - rings[ring])
        xi = radius * np.array([[np.cos(angle), np.sin(angle)]])
        yield xi, [u], place, {name: weights @ np.asarray(values)[ids] for name, values in mesh.point_data.items()}


@pytest.mark.parametrize("case", CASES)
def test_vtk_reads_geometry_displacement_and_stress(case, tmp_path):
    solution = CASES[case]()
    (body,), fields = solution.model.bodies, solution.fields(0)
    results = folder.add(tmp_path, {"scene": "rod"}, [body], folder.frames(solution))
    mesh = pyvista.read(tmp_path / results["files"][0])
    size, gaps, most = np.abs(fields["displacement"]).max(), [], mesh.point_data["von_mises"].max()
    for xi, u, place, found in read(body, mesh):
        assert np.abs(body.space.rod.grid(xi, u)[0][0, 0] - place).max() < 1e-3
        moved, _ = body.space.displacement(fields["displacement"], xi, u)
        assert np.abs(moved[0, 0] - found["displacement"]).max() < 5e-4 * size
        cauchy = stress.cauchy(body, fields["displacement"], xi, u, 1.0, fields.get("pressure"))
        six = cauchy[0, 0][[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
        gaps.append([stress.von_mises(cauchy)[0, 0] - found["von_mises"], *(six - found["cauchy"])])
        if "pressure" in fields:
            gaps[-1].append(np.trace(cauchy[0, 0]) / 3.0 - found["mean_stress"])
    assert np.quantile(np.abs(gaps), 0.9, axis=0).max() < 0.02 * most
    assert np.abs(gaps).max() < 0.06 * most


@pytest.mark.parametrize("case", ["layers", "control points"])
def test_points_have_the_values_of_the_fields(case):
    """And small cells between them fill the rod, none inside out."""
    solution = CASES[case]()
    (body,), fields = solution.model.bodies, solution.fields(0)
    mesh = vtk.grid(body, fields, curved=True)
    small = vtk.small_cells(mesh)
    assert np.array_equal(small.points, mesh.points) and small.point_data.keys() == mesh.point_data.keys()
    assert small.n_cells == 64 * mesh.n_cells and vtk.small_cells(small) is small
    sizes = small.compute_cell_sizes()["Volume"]
    assert sizes.min() > 0.0
    assert sizes.sum() == pytest.approx(body.space.rod.volume(), rel=2e-2)
    linear = vtk.grid(body, fields)
    for name in ("von_mises", "displacement"):
        assert np.max(mesh.point_data[name]) == pytest.approx(np.max(linear.point_data[name]), rel=0.05)


def test_modes_of_the_blade_are_in_one_file():
    solution = modal.solve(Blade().model(), modes=3)
    (body,), fields = solution.model.bodies, solution.fields(0)
    for xi, u, place, found in read(body, vtk.grid(body, fields, curved=True)):
        assert np.abs(body.space.rod.grid(xi, u)[0][0, 0] - place).max() < 1e-3
        for name, nodal in fields.items():
            shape, _ = body.space.displacement(nodal, xi, u)
            assert np.abs(shape[0, 0] - found[name]).max() < 1e-4 * np.abs(nodal).max()


def test_a_closed_rod_ends_where_it_begins():
    space, nodal = closed()
    mesh = vtk.grid(Body(space, LinearElastic(1.0, 0.3)), {"motion": nodal}, curved=True)
    for values in (mesh.points, mesh.point_data["motion"]):
        layers = np.reshape(values, (8 * 13, -1, 3))
        assert np.abs(layers[0] - layers[-1]).max() < 1e-6


@pytest.mark.parametrize(("cells", "kind"), [("auto", 72), ("curved", 72), ("linear", 12)])
def test_a_folder_takes_the_cells_that_are_asked_for(cells, kind, tmp_path):
    """Where there is pressure of contact, linear ones that have corners at it."""
    space = Space(straight(4.0).sweep(section.circle(4)), elements=1, degree=2, section_degree=2)
    fields = {"displacement": np.zeros((space.nodes, 3))}
    touched = fields | {
        "contact_pressure": np.array([[u, 0.1, p, 0, 1] for u, p in ((0.3, 1.0), (0.5, 2.0), (0.7, 1.0))])
    }
    for given, expected in ((fields, kind), (touched, 72 if cells == "curved" else 12)):
        body = Body(space, LinearElastic(1.0, 0.3))
        record = folder.add(tmp_path, {"scene": "wire"}, [body], [folder.Frame(0.0, [given])], cells=cells)
        assert set(pyvista.read(tmp_path / record["files"][0]).celltypes) == {expected}


def test_the_former_name_of_curved_cells_warns():
    with pytest.warns(FutureWarning, match="--cells bezier: renamed, use --cells curved"):
        assert _cells("bezier") == "curved"


def test_public_name_of_a_helix_is_shown_whole(tmp_path):
    """From Python: a helix swept and solved, all load steps in a series."""
    wire = isorod.helix(radius=10, pitch=4, turns=1).sweep(isorod.circle(8, 0.8))
    space = isorod.Space(wire)
    ends = isorod.Support.end(space, "start"), isorod.Support.end(space, "end", displacement=(0, 0, 1))
    model = isorod.Model([isorod.Body(space, isorod.NeoHookean(E=2e5, nu=0.3))], ends)
    solution = statics.solve(model, load_steps=4, keep=True)
    record = folder.add(tmp_path, {"scene": "wire"}, model.bodies, folder.frames(solution), solution.curves())
    assert record["files"][-2:] == ["wire.pvd", "wire.csv"]
    factors = np.loadtxt(tmp_path / "wire.csv", delimiter=",", skiprows=1)[:, 0]
    assert factors[0] == 0.0 and factors[-1] == 1.0 and len(factors) == len(record["files"]) - 1
