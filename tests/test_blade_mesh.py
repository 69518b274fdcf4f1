"""Meshes of the blade: positive to the trailing edge, its volume, faces and grading, and the paper's counts."""

import subprocess
import sys

import numpy as np
import pytest
from refused import refused

from isorod.errors import InputError
from meshes import blade
from meshes.bricks import axis_positions, bricks
from meshes.mesh import Mesh
from meshes.strip import paper_section, strip
from meshes.template import o_grid


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


def test_strip_has_its_corners_on_the_circle():
    grid = strip(3, 2, 2, turn=30.0)
    assert isinstance(blade.build(along=3, across=2, layers=1), Mesh)
    radius = np.linalg.norm(grid.points, axis=1)
    assert radius.max() < 1.0 + 1e-15 and np.abs(radius[grid.rim] - 1.0).max() < 1e-15
    assert (len(grid.quads), len(grid.rim)) == (6, 10)


test_bad_meshes = refused(
    ({"along": 0}, "cells of the section: got 0 along and 1 across"),
    ({"order": 5}, "order of the cells: got 5"),
    ({"clustering": 1.5}, "clustering: got 1.5"),
    ({"corners": (0.0, 10.0)}, "corners of the section"),
    ({"cells": "prisms"}, "cells: got 'prisms'"),
    ({"cells": "tetrahedra", "order": 1}, "order of tetrahedra: got 1"),
    ({"cells": "tetrahedra", "along": 1}, "got 1 along and 1 across, need at least 2 and 1"),
    by=lambda values: blade.build(**values),
)


def test_meshes_command_writes_the_blade(tmp_path):
    pytest.importorskip("gmsh")
    file = tmp_path / "blade.msh"
    command = [sys.executable, "-m", "meshes.study", "blade", "--cells", "tetrahedra", "--layers", "3", "-o", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "90 cells of 10 nodes" in done.stdout and file.stat().st_size > 1000
