"""Meshes of the blade, and its modes by finite elements: exact bars, converged values, ranks, bad input."""

import dataclasses
import json
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
from reference import BLADE_FREQUENCIES as CONVERGED

pytest.importorskip("dolfinx")

from comparisons.fem import modal as fem_modal
from comparisons.fem.blade import Configuration, run, vibrations
from comparisons.fem.domain import Domain
from comparisons.fem.modal import RIGID, Settings, Solid, solve
from comparisons.fem.mode_shapes import nodal
from comparisons.fem.presets import blade as presets
from comparisons.fem.statics import Element
from comparisons.measure import published
from isorod.errors import InputError, SolveError
from isorod.modal.pencil import Pencil
from meshes import blade
from meshes.bricks import axis_positions, bricks
from meshes.mesh import Mesh
from meshes.split import fan, layered
from meshes.strip import paper_section, strip
from meshes.template import o_grid

STEEL = Solid(E=200.0, nu=0.3, density=2.0)

FEM = [sys.executable, "-m", "comparisons.fem", "blade"]


def configuration(arguments: str) -> Configuration:
    from comparisons.fem.__main__ import _parser

    given = vars(_parser().parse_args(["blade", *arguments.split()]))
    for name in ("scene", "repeat", "preset", "modes_file"):
        given.pop(name)
    return Configuration(**given | {"flags": tuple(given["flags"].split())})


def bar(rod, kind: str, layers: int = 8, around: int = 8) -> Domain:
    if kind == "P2":
        return Domain.distribute(layered(rod, fan(6, 2, turn=45.0), layers))
    return Domain.distribute(bricks(rod, o_grid(around, 1, int(kind[1])), layers))


# Meshes ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("along, across", [(2, 1), (3, 1), (5, 1), (8, 2), (12, 3), (24, 4)])
def test_bricks_are_positive_to_the_trailing_edge(along, across, order):
    mesh = blade.build("bricks", along, across, 4, order)
    assert mesh.check() >= 0.0
    # At Gauss points nothing is near zero, not even where the section ends in two tangent edges.
    ticks = 0.5 + np.array([-0.5, 0.5]) * np.sqrt(0.6)
    inner = mesh.jacobians(np.stack(np.meshgrid(ticks, ticks, ticks), axis=-1).reshape(-1, 3))
    assert (inner.min(axis=1) / inner.max(axis=1)).min() > 0.01


@pytest.mark.parametrize("order, tolerance", [(1, 0.05), (2, 2e-3), (3, 1e-3), (4, 1e-3)])
def test_volume_approaches_the_blades(order, tolerance):
    exact = blade.rod().volume()
    errors = [abs(blade.build("bricks", k * 4, k, k * 3, order, grading=1.5).volume() / exact - 1.0) for k in (1, 2, 4)]
    assert errors[1] < tolerance
    # The outline is only C1 at the joints of its arcs, which bounds the order.
    assert errors[2] < 0.3 * errors[1] < 0.09 * errors[0] + 1e-9


@pytest.mark.parametrize("family", [*presets.FULL, *presets.CONVERGED.values()], ids=lambda family: family.label)
def test_meshes_of_the_presets_are_positive(family):
    for arguments in family.arguments:
        assert configuration(arguments).mesh().check() >= 0.0


@pytest.mark.parametrize("along, across", [(2, 1), (4, 1), (5, 3), (12, 2)])
def test_tetrahedra_fit_together(along, across):
    mesh = blade.build("tetrahedra", along, across, 3, grading=1.5)
    assert np.array_equal(np.unique(mesh.cells), np.arange(len(mesh.points)))
    local = [(0, 2, 1, 5, 7, 4), (0, 1, 3, 4, 8, 6), (0, 3, 2, 6, 9, 5), (1, 2, 3, 7, 9, 8)]
    triangles = np.sort(np.concatenate([mesh.cells[:, face] for face in local]), axis=1)
    different, count = np.unique(triangles, axis=0, return_counts=True)
    # With their middle nodes: neighbours share whole curved faces.
    assert set(count) == {1, 2}
    boundary = np.sort(np.concatenate(list(mesh.faces.values())), axis=1)
    assert np.array_equal(np.unique(boundary, axis=0), different[count == 1])
    assert {name: len(nodes) for name, nodes in mesh.faces.items()} == {
        "start": 2 * across * (along - 1),
        "end": 2 * across * (along - 1),
        "lateral": 4 * along * 3,
    }


@pytest.mark.parametrize("cells", blade.CELLS)
def test_nodes_know_their_place_on_the_rod(cells):
    mesh = blade.build(cells, 4, 1, 3)
    assert mesh.parameters is not None
    xi, u = mesh.parameters[:, :2], mesh.parameters[:, 2]
    assert np.abs(blade.rod().points(xi, u) - mesh.points).max() < 1e-14
    lateral = np.unique(mesh.faces["lateral"])
    assert np.abs(np.linalg.norm(xi[lateral], axis=1) - 1.0).max() < 1e-14
    assert not u[np.unique(mesh.faces["start"])].any()
    assert mesh.node_volumes().sum() == pytest.approx(mesh.volume(), rel=1e-12)


@pytest.mark.parametrize("cells", ["bricks", "tetrahedra", "paper"])
def test_faces_look_outward(cells):
    mesh = blade.build(cells, 4, 1, 3)
    corners = np.flatnonzero(np.isin(mesh.face_reference, (0.0, 1.0)).all(axis=1))
    inside = np.array([0.0, 0.0, 4.0])
    for name, sign in (("start", -1.0), ("end", 1.0)):
        p = mesh.points[mesh.faces[name][:, corners]]
        normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        assert (sign * normal[:, 2] > 0.0).all() and (sign * (p[:, 0] - inside)[:, 2] > 0.0).all()


def test_mesh_of_the_papers_counts():
    mesh = blade.build("paper")
    assert (len(mesh.points), len(mesh.cells), mesh.cells.shape[1]) == (1035, 686, 8)
    assert len(np.unique(mesh.parameters[:, 2])) == 15
    section = paper_section()
    assert (len(section.points), len(section.quads), len(section.rim)) == (69, 49, 38)
    assert np.abs(np.linalg.norm(section.points[section.rim], axis=2) - 1.0).max() < 1e-15


def test_grading():
    u = axis_positions(blade.rod(), 4, 2, 2.0)
    assert u == pytest.approx([0.0, 1 / 32, 1 / 16, 5 / 32, 1 / 4, 13 / 32, 9 / 16, 25 / 32, 1.0])
    with pytest.raises(InputError, match=r"grading: got 0\.5"):
        axis_positions(blade.rod(), 4, 2, 0.5)


def test_grading_needs_a_single_axis_element(cylinder):
    with pytest.raises(InputError, match="several axis elements"):
        bricks(cylinder(breaks=(0.0, 0.5, 1.0)), o_grid(4), 4, 2.0)


@pytest.mark.parametrize(
    "values, said",
    [
        ({"along": 0}, "cells of the section: got 0 along and 1 across"),
        ({"order": 5}, "order of the cells: got 5"),
        ({"clustering": 1.5}, "clustering: got 1.5"),
        ({"corners": (0.0, 10.0)}, "corners of the section"),
        ({"cells": "prisms"}, "cells: got 'prisms'"),
        ({"cells": "tetrahedra", "order": 1}, "order of tetrahedra: got 1"),
        ({"cells": "tetrahedra", "along": 1}, "got 1 along and 1 across, need at least 2 and 1"),
    ],
)
def test_bad_meshes(values, said):
    with pytest.raises(InputError, match=said):
        blade.build(**values)


def test_meshes_command_writes_the_blade(tmp_path):
    pytest.importorskip("gmsh")
    file = tmp_path / "blade.msh"
    command = [sys.executable, "-m", "meshes", "blade", "--cells", "tetrahedra", "--layers", "3", "-o", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "90 cells of 10 nodes" in done.stdout and file.stat().st_size > 1000


# Bars with exact frequencies ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind, tolerance", [("Q2", 2e-3), ("Q3", 1e-4), ("P2", 1e-2)])
def test_free_bar_has_six_rigid_modes_and_the_exact_torsion(cylinder, kind, tolerance):
    found = solve(bar(cylinder(height=6.0), kind), STEEL, modes=8, element=Element(int(kind[1])))
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
    assert found.residuals.max() < 1e-8


def test_twins_of_a_symmetric_bar_are_found(cylinder):
    # Asked for nine, the last one's twin lies beyond: the count sees it.
    for modes in (1, 3, 9):
        found = solve(bar(cylinder(height=6.0), "Q2", around=4), STEEL, ["start"], modes=modes)
        assert len(found.frequencies) == modes and modes <= found.below <= modes + 1


@pytest.mark.parametrize(
    "factor, said",
    [
        (0.25, r"modes: found 3 up to .*, but the inertia counts 2"),
        (4.0, r"modes: \d+ eigenvalues lie at or below .*-st_shift"),
    ],
)
def test_modes_that_the_inertia_does_not_confirm_are_refused(cylinder, monkeypatch, factor, said):
    """Counted with another mass than solved with, fewer or more eigenvalues lie below the last one than were found."""
    where = bar(cylinder(height=6.0), "Q2", 4)
    sound = solve(where, STEEL, ["start"], 3)
    assert sound.below == 3
    # Counted are those that times the factor lie below: the twins of bending alone.
    assert np.count_nonzero(sound.eigenvalues * 4.0 <= sound.eigenvalues[2]) == 2
    true = fem_modal._Body.mass_by_blocks

    def other(body):
        mass = true(body)
        mass.scale(factor)
        return mass

    monkeypatch.setattr(fem_modal._Body, "mass_by_blocks", other)
    with pytest.raises(SolveError, match=said):
        solve(where, STEEL, ["start"], 3)
    # Unless nobody asks.
    assert solve(where, STEEL, ["start"], 3, check=False).below is None


@pytest.mark.parametrize("kind, element", [("Q2", Element(2)), ("Q2", Element(2, "irons14")), ("Q3", Element(3))])
def test_slender_cantilever_is_eulers_and_bernoullis(cylinder, kind, element):
    wave = np.array([1.8751041, 4.6940911])
    excess = []
    for length in (30.0, 60.0):
        found = solve(bar(cylinder(height=length), kind, layers=16), STEEL, ["start"], 4, element)
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
@pytest.mark.parametrize("error", [-1, 1, 5])
def test_a_count_that_disagrees_is_refused(error, held, cylinder, monkeypatch):
    """More or fewer eigenvalues found than the inertia of K - tau M tells."""
    count = Pencil.count_below
    monkeypatch.setattr(Pencil, "count_below", lambda self, value: count(self, value) + error)
    with pytest.raises(SolveError, match=r"modes: \d+ eigenvalues lie at or below [\d.e+-]+, but \d+ were found"):
        solve(bar(cylinder(height=6.0), "Q2", 4), STEEL, held, modes=3)


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


# The blade ------------------------------------------------------------------------------------------------------------


def test_best_preset_is_within_half_a_percent():
    record = run(configuration(presets.PRESETS["best"]))
    assert record["frequencies"] == pytest.approx(CONVERGED, rel=5e-3)
    assert record["sturm_count"] == 10 and record["residuals"].max() < 1e-6
    assert record["unknowns"] < record["dofs"] == 3321
    assert set(record["seconds"]) == {"mesh", "forms", "setup", "assembly", "solve", "check", "total"}


def test_accurate_preset_is_accurate():
    assert run(configuration(presets.PRESETS["accurate"]))["frequencies"] == pytest.approx(CONVERGED, rel=1e-3)


def test_quadratic_bricks_extrapolate_to_the_converged_values():
    found = [run(configuration(arguments)) for arguments in presets.CONVERGED["quick"].arguments[:2]]
    fine, finer = (np.array(record["frequencies"]) for record in found)
    # Two meshes and the order seen on three.
    assert finer + (finer - fine) / (1.5**3.5 - 1.0) == pytest.approx(CONVERGED, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("level", presets.CONVERGED)
def test_three_meshes_extrapolate_to_the_converged_values(level):
    from comparisons.measure.convergence import richardson

    records = [run(configuration(arguments)) for arguments in presets.CONVERGED[level].arguments]
    sizes = [1.0 / record["options"]["layers"] for record in records]
    for values, exact in zip(zip(*(record["frequencies"] for record in records), strict=True), CONVERGED, strict=True):
        try:
            limit = richardson(sizes, values).value
        except SolveError:
            limit = values[-1]
        assert limit == pytest.approx(exact, rel=2e-4)


def test_elements_on_the_mesh_of_the_papers_counts():
    found = {name: run(configuration(arguments)) for name, arguments in presets.PAPER.items()}
    trilinear, enhanced, quadratic = (np.array(record["frequencies"]) for record in found.values())
    # Shear locking: the first mode is more than twice too fast.
    assert trilinear[0] > 2.0 * CONVERGED[0]
    # The paper's own element on a section that is only a guess.
    assert enhanced == pytest.approx(published.BLADE_FEM_FREQUENCIES, rel=0.07)
    assert np.abs(enhanced / published.BLADE_FEM_FREQUENCIES - 1.0).mean() < 0.04
    assert quadratic == pytest.approx(CONVERGED, rel=0.025)


def test_modes_file(tmp_path):
    file = tmp_path / "modes.npz"
    record = run(configuration("--along 4 --layers 6 --modes 3"), modes_file=file)
    mesh = blade.build("bricks", 4, 1, 6)
    with np.load(file) as arrays:
        assert arrays["frequencies"] == pytest.approx(record["frequencies"])
        assert np.array_equal(arrays["points"], mesh.points)
        assert np.array_equal(arrays["cells"], mesh.cells) and arrays["shape"] == "hexahedron"
        shapes, weights = arrays["modes"], arrays["weights"]
        assert not shapes[:, arrays["u"] == 0.0].any()
        assert np.abs(shapes[:, arrays["u"] == 1.0]).max() > 0.0
    product = 40.0 * np.einsum("kma,m,lma->kl", shapes, weights, shapes)
    assert product == pytest.approx(np.eye(3), abs=0.1)


@pytest.mark.parametrize("arguments", ["--along 4 --layers 6 --degree 3", "--cells tetrahedra --layers 6"])
def test_shapes_at_nodes_are_those_of_the_function(arguments):
    from comparisons.fem import compat

    chosen = configuration(arguments)
    mesh = chosen.mesh()
    found = vibrations(Domain.distribute(mesh), chosen)
    values = nodal(found)
    assert values is not None and values.shape == (10, len(mesh.points), 3)
    # Against the degrees of freedom where those stand at the mesh's nodes: corners do for every degree.
    space = found.displacement.function_space
    corners = np.unique(mesh.cells[:, np.isin(mesh.reference, (0.0, 1.0)).all(axis=1)])
    places = space.tabulate_dof_coordinates()
    distance = np.linalg.norm(mesh.points[corners][:, None] - places[None], axis=2)
    rows = distance.argmin(axis=1)
    assert distance[np.arange(len(corners)), rows].max() < 1e-12
    found.carry(found.shapes[4])
    state = compat.petsc_vector(found.displacement).array_r.reshape(-1, 3)
    assert state[rows] == pytest.approx(values[4, corners], abs=1e-10 * np.abs(values[4]).max())


@pytest.mark.mpi
@pytest.mark.parametrize("arguments", ["--along 4 --layers 6", "--preset paper-enhanced"])
def test_two_ranks_give_the_serial_modes(mpirun, tmp_path, arguments):
    script = "import sys; from comparisons.fem.__main__ import main; sys.exit(main())"
    file = tmp_path / "parallel.npz"
    done = mpirun(2, "blade", *arguments.split(), "--modes-file", str(file), script=script)
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.strip().splitlines()
    parallel = json.loads(line)
    other = tmp_path / "serial.npz"
    chosen = presets.PRESETS["paper-enhanced"] if "paper" in arguments else arguments
    serial = run(configuration(chosen), modes_file=other)
    assert parallel["ranks"] == 2 and parallel["sturm_count"] == serial["sturm_count"] == 10
    assert parallel["dofs"] == serial["dofs"] and parallel["unknowns"] == serial["unknowns"]
    assert parallel["frequencies"] == pytest.approx(serial["frequencies"], rel=1e-9)
    with np.load(file) as a, np.load(other) as b:
        overlap = np.einsum("kma,kma->k", a["modes"], b["modes"]) / np.einsum("kma,kma->k", b["modes"], b["modes"])
        assert np.abs(overlap) == pytest.approx(np.ones(10), abs=1e-7)


# Bad input ------------------------------------------------------------------------------------------------------------


FAMILIES = [*presets.FULL, *presets.QUICK, *presets.CONVERGED.values()]


@pytest.mark.parametrize("text", [*presets.PRESETS.values(), *(text for one in FAMILIES for text in one.arguments)])
def test_presets_set_what_they_say_and_nothing_else(text):
    words = text.split()
    said = {name.removeprefix("--"): value for name, value in zip(words[::2], words[1::2], strict=True)}
    found, default = configuration(text), configuration("")
    for field in dataclasses.fields(Configuration):
        value = getattr(found, field.name)
        if field.name in said:
            assert str(value) == said.pop(field.name)
        else:
            assert value == getattr(default, field.name)
    assert not said


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.label)
def test_meshes_of_a_family_go_from_coarse_to_fine(family):
    meshes = [configuration(text) for text in family.arguments]
    for coarse, fine in pairwise(meshes):
        assert fine.along * fine.across * fine.layers > coarse.along * coarse.across * coarse.layers
        assert (fine.cells, fine.degree, fine.family) == (coarse.cells, coarse.degree, coarse.family)
    if family in presets.CONVERGED.values():
        # Richardson's: refined alike in all directions.
        assert len(meshes) == 3
        assert len({(one.layers / one.along, one.along / one.across, one.grading) for one in meshes}) == 1


@pytest.mark.parametrize(
    "arguments, said",
    [
        (["--modes", "0"], "modes: got 0, need at least 1"),
        (["--along", "2", "--layers", "1", "--modes", "500"], "modes: got 500, need 1 to"),
        (["--grading", "0"], "grading: got 0"),
        (["--quadrature", "2", "--degree", "5"], "degree: got 5, need 1 to 4"),
        (["--family", "enhanced"], "it is of degree 1"),
        (["--layers", "6", "-eps_max_it", "1", "-eps_ncv", "13"], "SLEPc found"),
        (["--layers", "6", "-eps_typo", "3"], "-eps_typo 3: nothing used it"),
    ],
)
def test_bad_input_is_one_line(arguments, said):
    done = subprocess.run([*FEM, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and not done.stdout
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("comparisons.fem: ") and said in line


def test_density_and_faces(cylinder):
    where = bar(cylinder(), "Q1", 2)
    with pytest.raises(InputError, match="density: got 0"):
        solve(where, Solid(1.0, 0.3, 0.0), ["start"], 1, Element(1))
    with pytest.raises(InputError, match="'top', need one of"):
        solve(where, STEEL, ["top"], 1, Element(1))
    with pytest.raises(InputError, match="modes: got 0, need 1 to"):
        solve(where, STEEL, ["start"], 0, Element(1))


def test_strip_has_its_corners_on_the_circle():
    grid = strip(3, 2, 2, turn=30.0)
    assert isinstance(blade.build(along=3, across=2, layers=1), Mesh)
    radius = np.linalg.norm(grid.points, axis=1)
    assert radius.max() < 1.0 + 1e-15 and np.abs(radius[grid.rim] - 1.0).max() < 1e-15
    assert (len(grid.quads), len(grid.rim)) == (6, 10)
