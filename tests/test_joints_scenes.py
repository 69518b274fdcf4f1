"""Rods with blocks as one solid: what is meshed, both sides beside each other, and what the study makes of it."""

import json

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")
pytest.importorskip("rich")

import dolfinx.fem
import ufl
from mpi4py import MPI

from comparisons.joints import study, whole
from comparisons.joints.bushes import BLOCK_RADIUS, LEG, Spring
from comparisons.joints.columns import Screw, Tendon
from comparisons.joints.scene import Sizes
from comparisons.measure.study import Run
from comparisons.report import joints as report

COARSE = Sizes(2.0, 4.0, 8.0, 8, 1)


def volume(mesh, tags=None, tag=None):
    dx = ufl.Measure("dx", domain=mesh, subdomain_data=tags)
    form = dolfinx.fem.form(dolfinx.fem.Constant(mesh, 1.0) * (dx if tag is None else dx(tag)))
    return mesh.comm.allreduce(dolfinx.fem.assemble_scalar(form), op=MPI.SUM)


def test_nodes_of_an_outline_are_on_its_sides_and_corners_at_odd_multiples_of_45_degrees():
    angle = np.radians(np.arange(-180, 180, 15))
    found = whole.rectangle((3.0, 2.0))(angle)
    assert np.abs(found / [3.0, 2.0]).max(axis=1) == pytest.approx(np.ones(angle.size))
    corners = np.isclose(np.abs(angle) % (0.5 * np.pi), 0.25 * np.pi)
    assert found[corners] == pytest.approx(
        np.sign(np.stack([np.cos(angle), np.sin(angle)], axis=1)[corners]) * [3.0, 2.0]
    )
    ahead = np.roll(found, -1, axis=0)
    turn = found[:, 0] * ahead[:, 1] - found[:, 1] * ahead[:, 0]
    assert (turn > 0.0).all()


def test_cells_have_the_sizes_asked_for_and_end_where_they_should():
    found = whole.spaced((1.0, 9.0), 2.0, (0.1, 0.4))[::2]
    size = np.diff(found)
    assert found[[0, -1]] == pytest.approx([1.0, 9.0])
    assert size[0] == pytest.approx(0.1, rel=0.4) and size[-1] == pytest.approx(0.4, rel=0.4)
    assert size.max() <= 2.0 and np.all(size[1:] < 2.0 * size[:-1])


@pytest.mark.parametrize(
    "scene, of_rod, of_block",
    [
        (Tendon(), 30.0 * np.pi * 9.0, 24.0 * 16.0 * 12.0),
        (Screw(), 12.0 * np.pi * 4.0, 6.0 * (256.0 - np.pi * 4.0)),
        (Spring(), np.pi * 325.118, 2.0 * LEG * np.pi * (BLOCK_RADIUS**2 - 1.0)),
    ],
)
def test_one_solid_and_blocks_alone_have_their_volumes(scene, of_rod, of_block):
    made = scene.bricks(COARSE)
    assert volume(made.mesh, made.tags, whole.ROD) == pytest.approx(of_rod, rel=5e-3)
    assert volume(made.mesh, made.tags, whole.BLOCK) == pytest.approx(of_block, rel=5e-3)
    for shape in ("hexahedron", "tetrahedron"):
        alone = sum(volume(mesh) for mesh in scene.blocks(COARSE, shape))
        assert alone == pytest.approx(of_block, rel=1e-2)


@pytest.mark.parametrize("scene", [Tendon(), Screw()])
def test_one_solid_and_the_coupled_model_agree(scene):
    sizes = COARSE._replace(near=1.0, far=3.0, wire=4.0)
    one = scene.of_whole(whole.solve(scene.bricks(sizes), scene.problem()))
    coupled = scene.coupled(scene.space(), scene.blocks(sizes, "hexahedron"))
    assert coupled.values == pytest.approx(one, rel=0.01)
    # Of one solid by tetrahedra, which err to the other side of neither.
    assert scene.of_whole(whole.solve(scene.tetrahedra(sizes), scene.problem())) == pytest.approx(one, rel=0.03)


def test_what_reaches_an_error_reaches_it_on_all_meshes_that_are_nowhere_coarser():
    works = [study.Work("coupled", "hexahedron", Sizes(near, 1.0)) for near in (4.0, 2.0, 1.0)]
    others = [study.Work("coupled", "tetrahedron", Sizes(near, 1.0)) for near in (4.0, 2.0)]
    round_ = study.Work("coupled", "hexahedron", Sizes(2.0, 1.0, around=4))
    errors, seconds = (0.004, 0.02, 0.003, 0.009, 0.001, 0.001), (1.0, 2.0, 5.0, 3.0, 4.0, 0.1)
    done = [
        (work, {"error": error, "seconds": time})
        for work, error, time in zip([*works, *others, round_], errors, seconds, strict=True)
    ]
    # The first and the last are within by luck: with smaller cells, or more of them round the rod, they are not.
    assert study.fastest(done, 0.01)[0] is others[0]
    assert study.fastest(done, 0.005)[0] is others[1]
    assert study.fastest(done, 1e-4) is None


@pytest.mark.slow
def test_a_scene_is_run_recorded_and_reported(tmp_path, monkeypatch):
    meshes = COARSE, COARSE._replace(near=1.0)
    work = [study.Work(side, "hexahedron", COARSE) for side in ("one solid", "coupled")]
    subject = study.Subject("tendon", "a tendon", Tendon(), work, meshes)
    monkeypatch.setattr(study, "SUBJECTS", (subject,))
    monkeypatch.setattr(study, "TARGETS", (0.05,))
    monkeypatch.setattr(study, "TURNS", 1)
    monkeypatch.setattr(study, "REPEAT", 1)
    run = Run("joints", "quick", tmp_path)
    study.run(run)
    records = [json.loads(line) for line in run.path.read_text().splitlines()]
    assert [one["part"] for one in records] == ["converged", "work", "work", "confirm", "confirm"]
    assert all(one["error"] < 0.05 for one in records[1:])
    _, ours, bricks, tetrahedra = report.summary(records)
    assert ours.startswith("tendon, 5 %") and "default rod" in ours and "one solid, bricks" in bricks
    assert tetrahedra.endswith("not reached")
    page = "".join(report.section(records, tmp_path) + report.answer(records))
    share = records[3]["seconds"] / records[4]["seconds"]
    assert (f"1/{1.0 / share:.2g}" if share < 1.0 / 1.5 else f"{share:.2g} times") in page
    alone = [one for one in records if one.get("side") != "coupled"]
    assert list(report.best(alone, "tendon")[0.05]) == ["hexahedron"]
