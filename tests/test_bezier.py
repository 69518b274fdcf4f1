"""Rational Bezier cells: VTK, which knows nothing of rods, reads the very geometry and displacement from them."""

import json
import warnings
from itertools import pairwise

import numpy as np
import pytest

import isorod
from isorod import modal, statics
from isorod.geometry import section
from isorod.geometry.center_line import arc, straight
from isorod.material import LinearElastic
from isorod.model import Body, Model, Support
from isorod.output import bezier, folder, patches, stress, vtk
from isorod.output.limited import Limited
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring
from isorod.space import Space

pytest.importorskip("pyvista")

READER = """
import json, random, sys
import vtk

reader = vtk.vtkXMLUnstructuredGridReader()
reader.SetFileName(sys.argv[1])
reader.Update()
mesh = reader.GetOutput()
random.seed(5)
found = []
for _ in range(80):
    number = random.randrange(mesh.GetNumberOfCells())
    cell = mesh.GetCell(number)
    wedge = isinstance(cell, vtk.vtkBezierWedge)
    assert wedge or isinstance(cell, vtk.vtkBezierHexahedron)
    at = [random.random() for _ in range(3)]
    if wedge and at[0] + at[1] > 1.0:
        at[:2] = 1.0 - at[0], 1.0 - at[1]
    # Every other one on the side of the cell that is farthest from the centre.
    if len(found) % 2:
        at[0] = 1.0 - at[1] if wedge else 1.0
    place, shares = [0.0] * 3, [0.0] * cell.GetNumberOfPoints()
    cell.EvaluateLocation(vtk.reference(0), at, place, shares)
    fields = {}
    for k in range(mesh.GetPointData().GetNumberOfArrays()):
        values = mesh.GetPointData().GetArray(k)
        rows = [values.GetTuple(cell.GetPointId(i)) for i in range(len(shares))]
        fields[values.GetName()] = [sum(w * row[c] for w, row in zip(shares, rows)) for c in range(len(rows[0]))]
    found.append([number, at, place, fields])
print(json.dumps(found))
"""


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
    return statics.solve(Spring(coils=1, **options).model())


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


def of(body, fields, tmp_path, python):
    """Return what VTK reads at points of a file of the body, with the disk point and axis parameter of each."""
    cells = bezier.Cells(body, [fields])
    (tmp_path / "rod.vtu").write_bytes(vtk.content(cells.grid(fields)))
    done = python(READER, str(tmp_path / "rod.vtu"))
    assert done.returncode == 0, done.stderr
    count = len(cells.patches.patches)
    for number, at, place, found in json.loads(done.stdout):
        xi = cells.patches.disk(number % count, np.array([at[:2]]))
        low, high = cells.breaks[number // count :][:2]
        yield xi, [low + at[2] * (high - low)], place, found


@pytest.mark.parametrize(
    "case",
    [one if one in ("spring", "incompressible") else pytest.param(one, marks=pytest.mark.slow) for one in CASES],
)
def test_vtk_reads_the_geometry_and_the_displacement(case, tmp_path, python):
    solution = CASES[case]()
    (body,), fields = solution.model.bodies, solution.fields(0)
    size, on_surface = np.abs(fields["displacement"]).max(), 0
    cells = bezier.Cells(body, [fields])
    gaps, most = [], 0.0
    for xi, u, place, found in of(body, fields, tmp_path, python):
        rest, _ = body.space.rod.grid(xi, u)
        assert np.abs(rest[0, 0] - place).max() < 1e-7
        moved, _ = body.space.displacement(fields["displacement"], xi, u)
        assert np.abs(moved[0, 0] - found["displacement"]).max() < 1e-8 * size
        on_surface += np.linalg.norm(xi) > 1.0 - 1e-12
        # Where two layers meet that of the inner one.
        cauchy = stress.cauchy(body, fields["displacement"], (1.0 - 1e-9) * xi, u, 1.0, fields.get("pressure"))
        most = max(most, float(stress.von_mises(cauchy)[0, 0]))
        six = cauchy[0, 0][[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
        gaps.append((np.abs(six - found["cauchy"]).max(), abs(stress.von_mises(cauchy)[0, 0] - found["von_mises"][0])))
    # Stress is no function of the cells' kind: elements are cut, up to four times, until it is met to 2 %.
    assert np.quantile(gaps, 0.9, axis=0).max() < (0.02 if len(cells.patches.patches) <= 64 else 0.5) * most
    assert on_surface > 5


def test_modes_of_the_blade_are_in_one_file_and_exact(tmp_path, python):
    solution = modal.solve(Blade().model(), modes=3)
    (body,), fields = solution.model.bodies, solution.fields(0)
    for xi, u, place, found in of(body, fields, tmp_path, python):
        assert np.abs(body.space.rod.grid(xi, u)[0][0, 0] - place).max() < 1e-7
        for name, nodal in fields.items():
            shape, _ = body.space.displacement(nodal, xi, u)
            assert np.abs(shape[0, 0] - found[name]).max() < 1e-8 * np.abs(nodal).max()
    # Patches in the airfoil's own coordinates: one an arc.
    assert len(bezier.Cells(body, [fields]).patches.patches) == body.space.rod.section_points


def test_a_closed_rod_ends_where_it_begins(tmp_path, python):
    space, nodal = closed()
    fields = {"motion": nodal}
    mesh = bezier.Cells(Body(space, LinearElastic(1.0, 0.3)), [fields]).grid(fields)
    layers = mesh.points.reshape(8, 4, -1, 3)
    assert np.abs(layers[0, 0] - layers[-1, -1]).max() < 1e-12
    motion = mesh.point_data["motion"].reshape(8, 4, -1, 3)
    assert np.abs(motion[0, 0] - motion[-1, -1]).max() < 1e-12


def test_patches_are_cut_until_functions_are_met_and_it_is_said_where_they_are_not(monkeypatch):
    space = Space.paper(straight(4.0).sweep(section.circle(8, 1.0)), elements=2, degree=2)
    # Every other control point moves: the second derivatives jump where arcs meet.
    columns = np.where(np.arange(8) % 2, 1.0, -1.0)[:, None]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = patches.cover(space, columns)
    assert 100 < len(found.patches) < patches.MOST
    assert found.error < patches.TOLERANCE
    monkeypatch.setattr(patches, "MOST", 100)
    with pytest.warns(
        UserWarning, match=r"Bezier cells: 1\d\d patches of the section meet its functions to .*e-0[4567]"
    ):
        coarse = patches.cover(space, columns)
    assert coarse.error > 10 * found.error


def test_sections_of_more_patches_than_are_wanted_are_not_covered(monkeypatch):
    """Cells are chosen by how many there would be, of hollow rods hundreds: one more than are wanted says so."""
    space = Space(straight(4.0).sweep(section.circle(8)).with_rings([0.6, 1.0]), section_degree=4, elements=2, degree=3)
    body = Body(space, LinearElastic(1.0, 0.3))
    count, evaluated = [], monkeypatch.setattr(stress, "cauchy", lambda *given: pytest.fail("stresses of no cells"))
    cover = patches.cover
    monkeypatch.setattr(bezier, "cover", lambda *given: count.append(len((found := cover(*given)).patches)) or found)
    nodal = np.random.default_rng(2).standard_normal((space.nodes, 3))
    assert evaluated is None and folder._bezier(body, [{"displacement": nodal}], "auto") is None
    assert bezier.MOST < count[0] <= bezier.MOST + 8


RANGES = """
import json, sys
import vtk
from vtkmodules.util.numpy_support import vtk_to_numpy

reader = vtk.vtkXMLUnstructuredGridReader()
reader.SetFileName(sys.argv[1])
reader.Update()
data = reader.GetOutput().GetPointData()
found = {}
for name in ("von_mises", "cauchy", "mean_stress"):
    if data.HasArray(name):
        values = vtk_to_numpy(data.GetArray(name)).reshape(reader.GetOutput().GetNumberOfPoints(), -1)
        found[name] = [values.min(axis=0).tolist(), values.max(axis=0).tolist()]
print(json.dumps(found))
"""


def pulled_bar():
    """Held at both ends, where its edges are singular."""
    space = Space(straight(50.0).sweep(section.circle(8, 3.0)), elements=8, degree=5, continuity=0, section_degree=5)
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, 0.05))
    return statics.solve(Model([Body(space, LinearElastic(2e5, 0.3))], ends))


@pytest.mark.parametrize(
    "solved", [pulled_bar, spring, pytest.param(layered, marks=pytest.mark.slow)], ids=lambda one: one.__name__
)
def test_values_at_points_are_within_the_stress_and_reach_its_largest(solved, tmp_path, python):
    """Whoever takes the largest of a file's points has the largest stress: coefficients do not go beyond it."""
    solution = solved()
    (body,), fields = solution.model.bodies, solution.fields(0)
    (tmp_path / "rod.vtu").write_bytes(vtk.content(bezier.Cells(body, [fields]).grid(fields)))
    done = python(RANGES, str(tmp_path / "rod.vtu"))
    assert done.returncode == 0, done.stderr
    found = {name: np.array(values) for name, values in json.loads(done.stdout).items()}
    breaks = body.space.axis.breaks
    inside = np.concatenate([[1e-9], np.linspace(0.0, 1.0, 34)[1:-1], [1.0 - 1e-9]])
    u = (breaks[:-1, None] + np.diff(breaks)[:, None] * inside).ravel()
    angle = 2.0 * np.pi * np.arange(96) / 96
    rings = body.space.rod.rings
    radii = np.unique(np.concatenate([np.linspace(a, b - 1e-9 * (b < 1.0), 9) for a, b in pairwise(rings)]))
    xi = (radii[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)).reshape(-1, 2)
    cauchy = stress.cauchy(body, fields["displacement"], xi, u, 1.0, fields.get("pressure")).reshape(-1, 3, 3)
    exact = {
        "von_mises": stress.von_mises(cauchy)[:, None],
        "cauchy": cauchy[:, [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]],
        "mean_stress": np.trace(cauchy, axis1=1, axis2=2)[:, None] / 3.0,
    }
    size = exact["von_mises"].max()
    for name, (low, high) in found.items():
        # Points of the grid and of the file are not the same.
        assert (low > exact[name].min(axis=0) - 0.02 * size).all(), name
        assert (high < exact[name].max(axis=0) + 0.02 * size).all(), name
    assert found["von_mises"][0] >= 0.0
    assert found["von_mises"][1] == pytest.approx(size, rel=0.02)


def test_fields_are_met_at_corners_and_kept_between_their_values():
    space = Space(straight(4.0).sweep(section.ellipse(8, 2.0, 1.0)), section_degree=3)
    found = patches.cover(space, np.eye(space.basis.count))
    # Four triangles of degree 6 share the centre and their sides.
    assert found.weights.size == 1 + 4 * sum(range(1, 7))
    along, weights = Limited(found, 4), np.ones((1, 5))
    t = along.samples[None, :, None, None]
    flat = np.ones((1, t.size, len(found.samples), 1))
    for field, gap in ((flat * (2.0 - t), 1e-8), (flat * np.exp(-3.0 * t), 0.01)):
        controls = along.controls(field, weights)
        assert np.abs(along.shown(controls, weights) - field).max() < gap
        corner = found.nodes[0][found.shapes[0].corners[0]]
        assert controls[0, 0, corner, 0] == pytest.approx(field[0, 0, 0, 0])
        assert controls[0, -1, corner, 0] == pytest.approx(field[0, -1, 0, 0])
    # A jump, near which the best approximation waves by a tenth and more.
    step = np.where(t < 0.5, 0.0, 1.0) * flat
    controls = along.controls(step, weights)
    assert controls.min() == 0.0 and controls.max() == 1.0
    assert (np.diff(controls, axis=1) >= 0.0).all()


def test_elements_are_cut_until_the_stress_is_shown():
    solution = spring()
    (body,), fields = solution.model.bodies, solution.fields(0)
    cells = bezier.Cells(body, [fields])
    elements = body.space.axis.elements
    pieces, left = divmod(len(cells.breaks) - 1, elements)
    assert pieces in (2, 4) and left == 0
    mesh = cells.grid(fields)
    assert np.array_equal(np.unique(mesh.cell_data["element"]), np.arange(elements))
    # Shapes alone need no more than an element.
    assert len(bezier.Cells(body, [{"motion": fields["displacement"]}]).breaks) == elements + 1


@pytest.mark.slow
def test_small_cells_have_the_same_points_and_fields():
    for case in ("spring", "layers"):
        solution = CASES[case]()
        (body,), fields = solution.model.bodies, solution.fields(0)
        mesh = bezier.Cells(body, [fields]).grid(fields)
        small = bezier.in_small_cells(mesh, 3)
        assert set(small.point_data.keys()) == set(mesh.point_data.keys()) - {"RationalWeights"}
        # Of fine linear cells the volume is that of the rod, and none is inside out.
        fine = bezier.in_small_cells(mesh, 8).triangulate()
        sizes = fine.compute_cell_sizes()["Volume"]
        assert sizes.min() > 0.0
        assert sizes.sum() == pytest.approx(body.space.rod.volume(), rel=2e-2)
        cell = mesh.get_cell(0)
        corner = np.abs(small.points - cell.points[0]).sum(axis=1).argmin()
        assert np.abs(small.points[corner] - mesh.points[cell.point_ids[0]]).max() < 1e-12
        name = "displacement"
        assert np.abs(small.point_data[name][corner] - mesh.point_data[name][cell.point_ids[0]]).max() < 1e-12
        assert bezier.in_small_cells(small) is small


@pytest.mark.slow
def test_a_folder_takes_the_cells_that_suit(tmp_path):
    import pyvista

    for options, cells, kind in (
        ({}, "auto", 80),
        ({"preset": "paper", "elements_per_turn": 4}, "auto", 12),
        ({}, "linear", 12),
        ({"order": 2, "section_points": 4}, "bezier", 79),
    ):
        solution = spring(**options)
        record = folder.add(
            tmp_path, {"scene": "wire"}, solution.model.bodies, folder.frames(solution), solution.curves(), cells
        )
        assert kind in pyvista.read(tmp_path / record["files"][0]).celltypes


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
