"""What has no counterpart in one solid of finite elements is refused in one line, before anything is solved."""

import re
import sys

import pytest

pytest.importorskip("gmsh")
pytest.importorskip("dolfinx")

import gmsh

from comparisons.fem.rods import run as of_rods
from comparisons.fem.rods.solving import solve as solve_rods
from isorod import InputError, LinearElastic, Space, circle, files, straight
from isorod.model import Body, EndFace, Model, Tie

BLOCK = """
[rod.rod]
curve = {straight = 3.0}
section = {circle = 1.0}
law = {LinearElastic = {E = 10.0, nu = 0.3}}
[support.end]
end = "end"
[tie.joint]
slave = "rod.start"
master = "block.top"
[analysis.statics]
[measure.joint]
tie_force = "joint"
[solid.block]
mesh = "block.msh"
geometry = "block.step"
law = {LinearElastic = {E = 10.0, nu = 0.3}}
held = "bottom"
"""


def block(folder, at=-4.0, hollow=False):
    """Write a cube below z = 0 as mesh and geometry, the latter perhaps elsewhere, or with a hollow in it."""
    gmsh.initialize(["gmsh"], False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ, model = gmsh.model.occ, gmsh.model
        occ.addBox(-2.0, -2.0, -4.0, 4.0, 4.0, 4.0)
        occ.synchronize()
        names = {"left": (0, -2.0), "bottom": (2, -4.0), "top": (2, 0.0)}
        for name, (axis, place) in names.items():
            own = [t for _, t in model.getEntities(2) if abs(occ.getCenterOfMass(2, t)[axis] - place) < 1e-6]
            model.setPhysicalName(2, model.addPhysicalGroup(2, own), name)
        model.addPhysicalGroup(3, [1])
        gmsh.option.setNumber("Mesh.MeshSizeMax", 1.5)
        model.mesh.generate(3)
        gmsh.write(str(folder / "block.msh"))
        gmsh.clear()
        occ.addBox(-2.0, -2.0, at, 4.0, 4.0, 4.0)
        if hollow:
            occ.cut([(3, 1)], [(3, occ.addSphere(0.0, 0.0, -2.0, 1.0))])
        occ.synchronize()
        gmsh.write(str(folder / "block.step"))
    finally:
        gmsh.finalize()


def refusal(folder, text, **options):
    (folder / "on.toml").write_text(text)
    with pytest.raises(InputError) as problem:
        of_rods.run(of_rods.Configuration(str(folder / "on.toml"), **options))
    said = str(problem.value)
    assert "\n" not in said
    return said.removeprefix(str(folder / "on.toml"))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            'geometry = "block.step"\n',
            "",
            r":14: solid.block: geometry is missing: .* geometry = \"NAME.step\", beside",
        ),
        (
            'master = "block.top"',
            'master = "block.top"\nkind = "slide"',
            r":11: tie.joint.kind: got kind 'slide'; .*weld",
        ),
        ('slave = "rod.start"', 'slave = "rod.start"\nkind = "mean"', r":10: tie.joint.kind: got kind 'mean'; .*weld"),
        (
            "[tie.joint]",
            "[load.a]\npressure = {pressure = 1.0, follows = true}\n[tie.joint]",
            r"load.a.*: a pressure that follows",
        ),
        (
            "[tie.joint]",
            "[load.a]\nsection = {u = 0.5, force = [0.0, 0.0, 1.0]}\n[tie.joint]",
            r"a section within a rod",
        ),
        (
            "{straight = 3.0}",
            "{straight = {start = [0.0, 0.0, 0.05], end = [0.0, 0.0, 3.0]}}",
            r"tie.joint: the surfaces .* are nowhere",
        ),
        (
            "{straight = 3.0}",
            "{straight = {start = [1.9, 0.0, 0.0], end = [1.9, 0.0, 3.0]}}",
            r"tie.joint: rod rod and solid block are the same surface on an area of 1.7.*, and 3.14\d* are tied",
        ),
        (
            "[solid.block]",
            "[rod.other]\ncurve = {straight = {start = [0.0, -1.5, -8.0], end = [0.0, -1.5, -4.0]}}\n"
            "section = {circle = 0.3}\nlaw = {LinearElastic = {E = 10.0, nu = 0.3}}\n[support.o]\nrod = 'other'\nend = "
            "'start'\n[solid.block]",
            r".*rod other and solid block touch, on an area of 0.28\d*, and nothing ties them",
        ),
    ],
)
def test_what_one_solid_does_not_have_is_refused(old, new, said, tmp_path):
    block(tmp_path)
    text = BLOCK.replace(old, new)
    if "rod.other" in new:
        text = text.replace('end = "end"', 'end = "end"\nrod = "rod"')
    assert re.search(said, refusal(tmp_path, text))


def test_a_geometry_of_another_place_or_size_is_refused(tmp_path):
    block(tmp_path, at=-5.0)
    assert "geometry block.step reaches from -2 to 2; -2 to 2; -5 to -1, its mesh from" in refusal(tmp_path, BLOCK)
    (tmp_path / "block.step").write_text("no geometry")
    assert "geometry block.step: gmsh reads no volume from it; save the body as STEP" in refusal(tmp_path, BLOCK)
    assert "need the name of a .step file" in refusal(tmp_path, BLOCK.replace("block.step", "block.stl"))


def test_a_part_of_a_surface_that_touches_must_be_all_that_touches(tmp_path):
    """A rod in a hole that is tied on a part of its length would be glued on all of it."""
    block(tmp_path)
    inside = BLOCK.replace("{straight = 3.0}", "{straight = {start = [0.0, 0.0, -4.0], end = [0.0, 0.0, 3.0]}}")
    text = inside.replace('"rod.start"', '"rod.outer"\nalong = [1.0, 4.0]\ngap = 5.0')
    said = refusal(tmp_path, text)
    assert "tie.joint" in said or "solid block" in said


def test_gmsh_that_is_not_installed_is_told(tmp_path, monkeypatch):
    block(tmp_path)
    monkeypatch.setitem(sys.modules, "gmsh", None)
    assert "gmsh is not installed; pip install gmsh, or" in refusal(tmp_path, BLOCK)


def test_cells_of_one_solid_are_tetrahedra_of_degree_2(tmp_path):
    block(tmp_path)
    assert "meshed as one solid, with tetrahedra of degree 2" in refusal(tmp_path, BLOCK, degree=3)
    assert "tetrahedra of degree 2" in refusal(tmp_path, BLOCK, around=4, across=2, layers=3)


def test_tied_rods_are_refused_where_each_rod_is_meshed_for_itself():
    rods = [straight(3.0, start=(0.0, 0.0, z)).sweep(circle(8)) for z in (0.0, 3.0)]
    bodies = [Body(Space(rod), LinearElastic(1.0, 0.3)) for rod in rods]
    tied = Model(bodies, ties=[Tie(EndFace(1, "start"), EndFace(0, "end"))])
    with pytest.raises(InputError, match=r"^ties and finite element bodies: need a mesh of all as one solid"):
        solve_rods(tied, None, "statics")


def test_a_scene_without_ties_is_meshed_as_before(tmp_path):
    (tmp_path / "bar.toml").write_text(
        "[rod.bar]\ncurve = {straight = 3.0}\nsection = {circle = 1.0}\nlaw = {LinearElastic = {E = 1.0, nu = 0.3}}\n"
        '[support.a]\nend = "start"\n[analysis.statics]\n'
    )
    scene = files.find(str(tmp_path / "bar.toml"))
    assert of_rods.mesh_of(scene.model()).shape == "hexahedron"


def test_a_geometry_of_another_volume_is_not_the_body(tmp_path):
    block(tmp_path, hollow=True)
    said = refusal(tmp_path, BLOCK)
    assert re.search(r"block.step: its volume without the rods is 59\.8\d*, that of the mesh 64; need the body", said)
