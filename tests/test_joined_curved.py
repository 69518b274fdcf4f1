"""Tetrahedra of rods follow their windings: volumes, and cells that are not turned over."""

import dataclasses
import re
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("gmsh")

import isorod
from meshes.curved import relaxed
from meshes.joined import RodPart
from meshes.joined_mesh import build


def made(rod, level, radii=(0.0, 1.0)):
    return build([RodPart("rod 0", "rod wire", rod, radii)], [], {}, level)


@pytest.mark.parametrize(
    "rod",
    [isorod.helix(8.0, 4.0, 1).sweep(isorod.circle(8)), isorod.arc(4.0, 360.0).sweep(isorod.ellipse(8, 1.0, 0.8))],
)
def test_wires_keep_their_volume(rod):
    """The volume of cells of degree 2 errs by the fourth power of their size: that of a circle by chords of 0.75."""
    mesh, _ = made(rod, 2)
    assert mesh.volume() == pytest.approx(rod.volume(), rel=2e-3)
    assert mesh.quality().min() > 0.0


def test_a_finer_mesh_has_more_of_the_volume():
    rod = isorod.helix(8.0, 4.0, 1).sweep(isorod.circle(8))
    lost = [1.0 - made(rod, level)[0].volume() / rod.volume() for level in (1, 2)]
    assert 0.0 < lost[1] < lost[0] / 4.0


def test_rings_meet_on_their_circle():
    mesh, _ = made(isorod.straight(3.0).sweep(isorod.circle(8)), 2, (0.0, 0.5, 1.0))
    core = np.linalg.norm(mesh.points[mesh.cells[:, :4], :2].mean(axis=1), axis=1) < 0.5
    inner = dataclasses.replace(mesh, cells=mesh.cells[core])
    # With straight edges it is 9 % too small.
    assert inner.volume() == pytest.approx(0.75 * np.pi, rel=5e-3)


def test_cells_that_curves_turn_over_get_less_curved():
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    reference = np.concatenate([corners, [corners[list(one)].mean(axis=0) for one in pairs]])
    points = reference.copy()
    points[4] += [0.0, 0.6, 0.6]
    cells = np.arange(10)[None]
    found, count = relaxed(points, cells, reference)
    assert count == 1
    # The middle goes back on its line, by as much as is needed.
    share = (found[4] - reference[4])[1:] / 0.6
    assert share == pytest.approx([share[0]] * 2) and share[0] in (0.5, 0.25, 0.125)
    assert relaxed(reference, cells, reference)[1] == 0


@pytest.mark.slow
def test_a_spring_between_blocks_is_within_half_a_per_cent_of_one_solid(tmp_path):
    for name in ("dolfinx", "pyvista", "matplotlib", "rich"):
        pytest.importorskip(name)
    from comparisons.joints import spring_file

    spring_file.write(tmp_path)
    done = subprocess.run(
        [sys.executable, "-m", "isorod", "compare", "spring-blocks.toml"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=3600,
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r"^spring-blocks: default \(polynomials\) within 0.5 %: yes", done.stdout, re.MULTILINE)
