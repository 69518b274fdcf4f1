"""Finite element bodies in scene files: what holds and loads them, ties to rods, and what is refused."""

import re
from pathlib import Path

import numpy as np
import pytest
import solids
from msh import box, content

from isorod import InputError, LinearElastic, SolveError, files, modal, statics
from isorod.command import cli, printing, solving
from isorod.design import derivatives
from isorod.files.scene import FileScene
from isorod.geometry.quadrature import WHOLE
from isorod.space import choice

pytest.importorskip("dolfinx")

# A rod that stands on a block, whose top is at z = 0.
SCENE = """
analysis = "statics"
[rod.post]
curve = {straight = 3.0}
section = {circle = 0.5}
law = {LinearElastic = {E = 1.0, nu = 0.3}}
density = 1.0
space = {elements = 2, section_degree = 3}
[solid.block]
mesh = "block.msh"
law = {LinearElastic = {E = 1.0, nu = 0.3}}
[tie.weld]
slave = "post.start"
master = "block.top"
[measure.force]
tie_force = "weld"
[measure.tip]
displacement = "post"
"""
HELD = ["solid.block.held=bottom"]
CLAMPED = "[support.end]\nend = 'end'\n"


@pytest.fixture
def written(tmp_path):
    """Write the scene and its mesh; return it, with changes."""

    def write(*changes, scene=SCENE, more="", **mesh):
        path = tmp_path / "my.toml"
        path.write_text(scene + more)
        (tmp_path / "block.msh").write_bytes(content(*box(**mesh)))
        return FileScene(str(path), changes=changes)

    return write


def measured(scene):
    solution = statics.solve(scene.model(), **scene.settings())
    return scene.measure(solution)


@pytest.mark.parametrize("bricks", [False, True])
@pytest.mark.parametrize("degree", [1, 2])
def test_a_block_that_is_moved_takes_the_rod_along(bricks, degree, written):
    held = 'solid.block.held={group="bottom", displacement=[1e-3, 2e-3, 3e-3]}'
    found = measured(written(held, f"solid.block.degree={degree}", bricks=bricks))
    np.testing.assert_allclose(found["tip"], [1e-3, 2e-3, 3e-3], rtol=1e-9)
    np.testing.assert_allclose(found["force"], 0.0, atol=1e-13)


def test_components_are_held_apart(written):
    held = (
        'solid.block.held=[{group="bottom", components="xy"}, {group="top", components="z", displacement=[9, 9, 1e-3]}]'
    )
    # The top stays level, and the rod on it is free to rise.
    np.testing.assert_allclose(measured(written(held))["tip"], [0.0, 0.0, 1e-3], atol=1e-9)


@pytest.mark.parametrize(
    ("load", "force"),
    [
        ('{force=[1e-6, 2e-6, 3e-6], group="bottom"}', [1e-6, 2e-6, 3e-6]),
        ('{traction=[1e-6, 2e-6, 3e-6], group="bottom"}', [4e-6, 8e-6, 12e-6]),
        ('{pressure=1e-6, group="bottom"}', [0.0, 0.0, 4e-6]),
        ("{body_force=[0, 0, -1e-6]}", [0.0, 0.0, -4e-6]),
        (
            '[{pressure=1e-6, group="bottom"}, {pressure=1e-6, group="top"}, {force=[1e-6, 0, 0], group="top"}]',
            [1e-6, 0, 0],
        ),
    ],
)
def test_a_load_on_a_block_goes_into_the_rod(load, force, written):
    found = measured(written(f"solid.block.load={load}", more=CLAMPED))
    np.testing.assert_allclose(found["force"], force, rtol=1e-8, atol=1e-14)


def test_a_record_and_what_is_printed_tell_of_the_mesh(written):
    scene = written(*HELD, more="[load.pull]\nend = 'end'\nforce = [0, 0, 1e-6]\n")
    solution, seconds = solving.solve(scene, scene.settings())
    record = solving.record(scene, solution, seconds, {})
    assert record["solids"] == [{"cells": 48, "kind": "tetrahedra", "degree": 2, "nodes": 125}]
    assert list(record["data"]) == ["block.msh"]
    np.testing.assert_allclose(record["ties"][0]["force"], [0.0, 0.0, -1e-6], rtol=1e-9, atol=1e-15)
    assert "solid               48 tetrahedra of degree 2, 125 nodes" in printing.summary(record, scene)


def test_modes_of_a_rod_on_a_block(written):
    """If stiff, the block is a wall."""
    words = SCENE.partition("[measure")[0].replace('analysis = "statics"', "analysis = {modal = {modes = 2}}")

    def frequencies(*changes):
        scene = written("solid.block.density=1.0", *changes, scene=words)
        return scene.measure(modal.solve(scene.model(), **scene.settings()))["frequencies"]

    wall = written(scene=words.partition("[solid")[0], more=CLAMPED)
    clamped = wall.measure(modal.solve(wall.model(), **wall.settings()))["frequencies"]
    stiff = frequencies(*HELD, "solid.block.law.LinearElastic.E=1e6")
    np.testing.assert_allclose(stiff, clamped, rtol=1e-3)
    soft = frequencies(*HELD)
    assert (soft < 0.98 * clamped).all()
    with pytest.raises(InputError, match="density of the solid: got 0"):
        frequencies(*HELD, "solid.block.density=0.0")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["solid.block.held=botom"], "solid.block.held: 'botom' is not known; did you mean bottom?"),
        (["solid.block.held={group='bottom', components='w'}"], "solid.block.held.components: got 'w', need some of"),
        (["solid.block.mesh=no.msh"], "solid.block.mesh: no.msh: cannot be read"),
        (["solid.block.mesh=../my.msh"], "solid.block.mesh: ../my.msh: "),
        (["solid.block.mesh=my.toml"], "solid.block.mesh: my.toml: no mesh of gmsh"),
        (["solid.block.law={LinearElastc=1}"], "solid.block.law: 'LinearElastc' is not known; did you mean Linear"),
        (["solid.block.law={NeoHookean={E=1, nu=0.7}}"], "solid.block.law.NeoHookean.nu: "),
        (["solid.block.law={TransverselyIsotropic={}}"], "solid.block.law.TransverselyIsotropic: "),
        (["solid.block.degree=3"], "solid.block.degree: got 3, need 1 or 2"),
        (["solid.block.density=-1"], "solid.block.density: got -1, need a mass per volume"),
        (["solid.block.mash=1"], "solid.block: 'mash' is not known; did you mean mesh?"),
        (["solid.block.load={force=[0, 0, 1]}"], "solid.block.load.force: group is missing"),
        (["solid.block.load={forc=[0, 0, 1]}"], "solid.block.load: 'forc' is not known; did you mean force?"),
        (
            ["solid.block.load={pressure=1, group='tip'}"],
            "solid.block.load.group: 'tip' is not known; did you mean top",
        ),
        (["tie.weld.master=block.tip"], "tie.weld.master: 'block.tip' is not known; did you mean block.top?"),
        ([*HELD, "tie.weld.master=block.bottom"], "tie.weld: the surfaces are 1 apart"),
    ],
)
def test_a_solid_that_cannot_be_is_refused_where_it_is(changes, said, written):
    with pytest.raises(InputError, match=rf"my.toml:\d+: {re.escape(said)}") as caught:
        solving.solve(written(*changes), {})
    assert "\n" not in str(caught.value)


def test_warnings_are_shown_as_without(written, python):
    # The form compiler replaces the function when it is first loaded: in a process of its own.
    script = """
import sys, warnings
from isorod.files.scene import FileScene
show = warnings.showwarning
FileScene(sys.argv[1], changes=sys.argv[2:]).model()
print("ffcx" in sys.modules, warnings.showwarning is show)
"""
    done = python(script, written().path, *HELD)
    assert done.stdout.split() == ["True", "True"], done.stderr


def test_no_tolerance_is_promised(written):
    from isorod.command.refine import refine

    with pytest.raises(InputError, match="--tolerance: the meshes of finite element bodies are not refined"):
        refine(written(*HELD), {}, 1e-2)


def test_a_rod_on_a_block_that_nothing_holds_is_free(written):
    with pytest.raises(SolveError, match=r"my.toml:\d+: analysis: supports: rod post is free to move"):
        solving.solve(written(), {})


def test_a_group_inside_the_mesh_is_refused(written, tmp_path):
    points, cells, faces = box()
    inner = cells[np.isclose(points[cells][..., 2], -0.5).sum(axis=1) == 3][:1]
    scene = written(*HELD)
    cut = inner[0][np.isclose(points[inner[0]][:, 2], -0.5)][None]
    (tmp_path / "block.msh").write_bytes(content(points, cells, faces | {"cut": cut}))
    # Nothing names it.
    assert FileScene(scene.path, changes=HELD).model().solids
    scene = FileScene(scene.path, changes=["solid.block.held=cut"])
    with pytest.raises(
        InputError, match=r"my.toml:\d+: solid.block.mesh: group cut: 1 of its 1 facets are none of the mesh's"
    ):
        scene.model()


def test_a_rod_and_a_solid_have_names_of_their_own(written):
    scene = SCENE.replace("[solid.block]", "[solid.post]").replace("block.top", "post.top")
    with pytest.raises(InputError, match=r"my.toml:\d+: solid.post: a rod has this name; choose another"):
        written(scene=scene)


def test_without_dolfinx_there_is_one_line(written, python):
    script = """
import sys
sys.modules["dolfinx"] = None
from isorod.errors import InputError
from isorod.files.scene import FileScene
try:
    FileScene(sys.argv[1], changes=sys.argv[2:]).model()
except InputError as error:
    print(error)
"""
    done = python(script, written().path, *HELD)
    assert re.search(r"my.toml:\d+: solid.block: finite element bodies need dolfinx, ", done.stdout), done.stderr
    assert done.stdout.count("\n") == 1


def test_bodies_are_written_beside_the_rods(written, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    from isorod.output import folder

    solved = solving.solve(written(*HELD), {})[0]
    (solid,) = solved.model.solids
    record = folder.add(
        tmp_path, {"scene": "my"}, solved.model.bodies, folder.frames(solved), solids=solved.model.solids
    )
    assert record["files"] == ["my-0.vtu", "my-1.vtu", "my.pvd"]
    mesh = pyvista.read(tmp_path / "my-1.vtu")
    np.testing.assert_allclose(mesh.points, solid.positions, atol=1e-7)
    np.testing.assert_array_equal(mesh["displacement"].ravel(), solved.solids[0])
    assert mesh.volume == pytest.approx(4.0)


def test_no_file_of_a_body_is_overwritten(written, tmp_path):
    pytest.importorskip("pyvista")
    from isorod.output import folder

    solved = solving.solve(written(*HELD), {})[0]
    place = tmp_path / "found"
    place.mkdir()
    (place / "my-1.vtu").write_text("mine")
    record = folder.add(place, {"scene": "my"}, solved.model.bodies, folder.frames(solved), solids=solved.model.solids)
    assert record["files"] == ["my-run2-0.vtu", "my-run2-1.vtu", "my-run2.pvd"]
    assert (place / "my-1.vtu").read_text() == "mine"


@pytest.mark.parametrize("shape", solids.SHAPES)
def test_a_stretched_body_has_the_stress_of_its_law_at_all_nodes(shape):
    pytest.importorskip("pyvista")
    from isorod.output.solids import grid

    body = solids.solid(shape, degree=2, law=LinearElastic(200.0, 0.3))
    u = body.positions * 1e-3 * np.array([1.0, -0.3, -0.3])
    assert grid(body, {"displacement": u.ravel()})["von_mises"] == pytest.approx(0.2, rel=1e-9)


SCREW = str(Path(files.__file__).parent / "examples" / "screw.toml")
BONDED = [
    ((), choice.RIM),
    (("tie.thread={slave='plate.hole', master='screw.outer'}",), choice.RIM),
    (("rod.screw.space={section_degree=4}",), WHOLE),
    (("rod.screw.section={flower={}}",), WHOLE),
    (("rod.screw.rings=[0.5, 1]",), (0.5, 1.0)),
    (("tie.thread={slave='screw.start', master='plate.hole'}",), WHOLE),
]


@pytest.mark.parametrize(("changes", "rings"), BONDED)
def test_a_rod_in_a_hole_has_functions_that_see_its_rim(changes, rings):
    """In rings, unless what it is across is given, or polynomials do not suit."""
    scene = FileScene(SCREW, changes=changes)
    body = scene.plans["screw"].body(scene._use(0))
    assert body.space.rod.rings == rings
    assert len({id(law) for law in body.laws}) == 1
    again = scene.on([body.space])
    assert again.plans["screw"].body(again._use(0)).space.rod.rings == rings


def test_show_tells_of_a_body_and_draws_it(written, tmp_path, capsys):
    pytest.importorskip("pyvista")
    image, picture = pytest.importorskip("PIL.Image"), tmp_path / "seen.png"
    scene = written(bricks=True)
    assert cli.main(["show", scene.path, "--png", str(picture), "--size", "420x320"]) == 0
    written_to, told = capsys.readouterr().out.splitlines()
    assert told == (
        "solid block: block.msh, groups bottom, top, 8 hexahedra of degree 2, 125 nodes, volume 4, LinearElastic"
    )
    assert written_to.startswith(str(picture))
    with image.open(picture) as found:
        pixels = np.asarray(found)[60:-30, : 420 - 190, :3].astype(int)
    # Lines between cells are of the legend's colour, what is between them paler: nothing else is green.
    rows, columns = np.nonzero(pixels[:, :, 1] > 8 + pixels[:, :, [0, 2]].max(axis=2))
    assert rows.size > 3000 and np.ptp(columns) > 100


def test_derivatives_with_a_block_are_differences_of_answers(written):
    pulled = "[support.end]\nend = 'end'\ndisplacement = [0.0, 0.0, 1e-3]\n"
    scene, name = written(*HELD, more=pulled), "support.end.displacement.2"
    found = derivatives.of(scene, statics.solve(scene.model()), {name: 1e-3})
    assert found.why == "not available with finite element bodies"
    assert found.by[name]["force"][2] * 1e-3 == pytest.approx(found.values["force"][2], rel=1e-8)
    assert found.errors[name]["force"] < 1e-6
