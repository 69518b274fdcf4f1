"""Rods and bodies as one solid of finite elements: volumes, faces, forces, beside exact ones and coupled models."""

import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("gmsh")
pytest.importorskip("dolfinx")

from test_joined_refused import BLOCK, block

import isorod
from comparisons.fem.contact.facets import facet_of
from comparisons.fem.contact.facets import gauss as facet_points
from comparisons.fem.rods import run as of_rods
from comparisons.fem.rods.solving import solve
from comparisons.measure import sampled
from comparisons.report import rod_pictures
from isorod import files, modal, statics
from isorod.command import new
from meshes import gmsh_model, inverse, occ_rods
from meshes.gmsh_model import gmsh_session
from meshes.joined_mesh import body_file

BARS = """
[rod.steel]
curve = {straight = 6.0}
section = {circle = 1.0}
law = {LinearElastic = {E = 200.0, nu = 0.3}}
[rod.brass]
curve = {straight = {start = [0.0, 0.0, 6.0], end = [0.0, 0.0, 10.0]}}
section = {circle = 1.0}
law = {LinearElastic = {E = 100.0, nu = 0.3}}
[support.foot]
end = "start"
rod = "steel"
[support.top]
end = "end"
rod = "brass"
rotation = [0.0, 0.0, 0.5]
[tie.weld]
slave = "brass.start"
master = "steel.end"
[analysis.statics]
[measure.torque]
tie_moment = "weld"
component = "z"
[measure.pull]
tie_force = "weld"
"""


def area(mesh, name):
    return facet_points(mesh, facet_of(mesh), mesh.faces[name]).weights.sum()


def solved(path, level):
    scene = files.find(str(path))
    model = scene.model()
    mesh, _ = of_rods.joined_mesh(scene, model, level)
    return scene, mesh, solve(model, mesh, "statics", bodies=scene.bodies() if model.solids else ())


@pytest.mark.parametrize(
    ("rod", "radii", "wanted"),
    [
        (isorod.straight(12.0).sweep(isorod.circle(8, 2.0)), (0.0, 1.0), 48.0 * np.pi),
        (isorod.straight(12.0).sweep(isorod.circle(8, 2.0)), (0.5, 1.0), 36.0 * np.pi),
        (isorod.straight(3.0).sweep(isorod.ellipse(8, 2.0, 1.0)), (0.0, 0.4, 1.0), 6.0 * np.pi),
    ],
)
def test_rods_are_volumes_of_their_own_size(rod, radii, wanted):
    with gmsh_session() as session:
        nested = occ_rods.volumes(session, rod, radii, (0.25,))
        size = {k: sum(session.model.occ.getMass(3, one.tag) for one in nested if one.ring == k) for k in (0, 1, 2)}
    assert len(nested) == 2 * sum(radius > 0.0 for radius in radii)
    outer = len(radii) - 1
    assert size[outer] - size[0] == pytest.approx(wanted, rel=2e-3)
    if len(radii) > 2:
        assert size[1] == pytest.approx(wanted * radii[1] ** 2, rel=2e-3)


def test_a_helix_and_a_ring_are_exact_surfaces():
    """Every point of the rod's surface is on that of gmsh's kernel."""
    angle = np.linspace(0.0, 6.0, 9)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for rod in (isorod.helix(8.0, 4.0, 1).sweep(isorod.circle(8)), isorod.arc(4.0, 360.0).sweep(isorod.flower(16))):
        with gmsh_session() as session:
            made = occ_rods.volumes(session, rod, (0.0, 1.0), ())
            session.model.occ.synchronize()
            faces = [face for _, face in session.model.getEntities(2)]
            points = rod.grid(around, rod.axis.breaks[:1] + 0.3 * np.ptp(rod.axis.breaks))[0].reshape(-1, 3)
            away = [
                min(np.linalg.norm(session.model.getClosestPoint(2, face, one)[0] - one) for face in faces)
                for one in points
            ]
        assert (len(made) > 1) == rod.closed and max(away) < 1e-6


def test_parameters_of_points_are_found_again():
    rod = isorod.helix(8.0, 4.0, 3).sweep(isorod.circle(8))
    chance = np.random.default_rng(3)
    size, angle = np.sqrt(chance.random(300)), 2.0 * np.pi * chance.random(300)
    size[:50] = 1.0
    wanted = np.stack([size * np.cos(angle), size * np.sin(angle), chance.random(300)], axis=1)
    wanted[:, 2] = rod.axis.breaks[0] + wanted[:, 2] * np.ptp(rod.axis.breaks)
    found, away = inverse.parameters(rod, rod.points(wanted[:, :2], wanted[:, 2]))
    assert found == pytest.approx(wanted, abs=1e-9) and away.max() < 1e-9


def test_bars_that_are_welded_end_to_end_carry_the_exact_torque(tmp_path):
    (tmp_path / "bars.toml").write_text(BARS)
    scene, mesh, solution = solved(tmp_path / "bars.toml", 3)
    exact = np.radians(0.5) * 0.5 * np.pi / (6.0 / (200.0 / 2.6) + 4.0 / (100.0 / 2.6))
    found = scene.measure(solution)
    assert found["torque"] == pytest.approx(-exact, rel=2e-3)
    # What the weld carries is in equilibrium with what supports exert, to rounding.
    assert found["torque"] == pytest.approx(solution.moments[0, 2], rel=1e-6)
    assert found["pull"] == pytest.approx(-solution.reactions[1], abs=1e-8)
    assert mesh.volume() == pytest.approx(10.0 * np.pi, rel=1e-3)
    assert area(mesh, "tie 0") == pytest.approx(np.pi, rel=1e-3)
    # Nodes of the weld are those of both rods, with the parameters of each.
    both = np.unique(mesh.faces["tie 0"])
    assert mesh.parameters_in(0, both)[:, 2] == pytest.approx(1.0) and mesh.parameters_in(1, both)[:, 2] == (
        pytest.approx(0.0, abs=1e-9)
    )
    # Pictures have all of the surface.
    fields = solution.fields()
    places = sampled.Places(fields["node_rod"], *[None] * 5)
    sample = sampled.Sample(
        places, *(fields[name] for name in ("weights", "points", "cells")), 2, reference=mesh.reference
    )
    drawn = rod_pictures._tetrahedra(sample, fields["displacement"], np.zeros(mesh.cells.shape))
    assert drawn.area == pytest.approx(22.0 * np.pi, rel=0.01)


def test_a_tendon_on_bone_has_the_forces_of_the_coupled_model(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    new.main("tendon.toml", "tendon")
    scene, mesh, solution = solved("tendon.toml", 2)
    coupled = statics.solve(scene.model())
    ours, theirs = scene.measure(coupled), scene.measure(solution)
    assert [theirs[name] for name in ("pull", "push")] == pytest.approx(
        [ours[name] for name in ("pull", "push")], rel=1e-2
    )
    # The bone alone has the groups of its file, that of the tie among them.
    (bone,) = mesh.bodies
    assert bone.volume() == pytest.approx(24.0 * 16.0 * 12.0, rel=1e-9)
    assert [area(bone, name) for name in ("top", "bottom")] == pytest.approx([24.0 * 16.0] * 2, rel=1e-9)
    assert set(bone.faces) == {"top", "bottom"}
    # A file of it takes the place of the scene's own.
    gmsh_model.write(bone, body_file(tmp_path, "bone"))
    changed = scene.with_options(changes=("solid.bone.mesh=bone.msh",))
    finer = statics.solve(changed.model())
    assert finer.model.solids[0].nodes == len(bone.points)
    assert changed.measure(finer)["pull"] == pytest.approx(ours["pull"], rel=5e-3)
    # Both displacements at the same places, of the bone too.
    fields = solution.fields()
    xi, u = fields["parameters"][:, :2], fields["parameters"][:, 2]
    places = sampled.Places(fields["node_rod"], xi, u, *np.zeros((3, 0)))
    assert set(fields["node_rod"]) == {0, -1}
    both = sampled.fields(coupled, places)["displacement"], fields["displacement"]
    assert sampled.relative(*both, fields["weights"]) < 1e-2
    for body in (0, -1):
        own = fields["node_rod"] == body
        assert sampled.relative(both[0][own], both[1][own], fields["weights"][own]) < 0.03
    # The field of a mesh at its own nodes, and that of another mesh there.
    sample = sampled.Sample(
        places,
        fields["weights"],
        fields["points"],
        fields["cells"],
        2,
        fields["displacement"],
        reference=mesh.reference,
    )
    assert sample.on(mesh.points)["displacement"] == pytest.approx(fields["displacement"], abs=1e-9)


def test_loads_on_a_body_are_carried_by_what_holds_it(tmp_path):
    block(tmp_path)
    text = BLOCK + (
        'load = [{force = [1.0, 2.0, 3.0], group = "left"}, {traction = [0.0, 0.0, 0.5], group = "top"},'
        ' {pressure = 0.25, group = "left"}, {body_force = [0.0, 0.1, 0.0]}]\n'
    )
    (tmp_path / "on.toml").write_text(text.replace('held = "bottom"\n', ""))
    scene, _, solution = solved(tmp_path / "on.toml", 1)
    # A cube of 4, under a rod of radius 1 whose end is held.
    wanted = np.array([1.0 + 0.25 * 16.0, 2.0 + 6.4, 3.0 + 0.5 * (16.0 - np.pi)])
    assert solution.reactions[0] == pytest.approx(-wanted, rel=2e-2)
    assert solution.reactions[0][:2] == pytest.approx(-wanted[:2], rel=1e-9)
    assert scene.measure(solution)["joint"] == pytest.approx(-solution.reactions[0], rel=1e-6)


def test_a_body_that_is_held_moves_the_rod(tmp_path):
    """With it, where nothing else holds it."""
    block(tmp_path)
    text = BLOCK.replace('held = "bottom"', 'held = {group = "bottom", displacement = [0.1, 0.0, 0.2]}')
    (tmp_path / "on.toml").write_text(text.replace('[support.end]\nend = "end"\n', ""))
    _, _, solution = solved(tmp_path / "on.toml", 1)
    assert solution.at(0, "end") == pytest.approx([0.1, 0.0, 0.2], abs=1e-9)


def test_modes_of_welded_bars_are_isorods(tmp_path):
    text = (
        BARS[: BARS.index("[analysis")]
        .replace("law =", "density = 1.0\nlaw =")
        .replace("rotation = [0.0, 0.0, 0.5]", "")
    )
    (tmp_path / "bars.toml").write_text(text + "[analysis.modal]\nmodes = 3\n")
    scene = files.find(str(tmp_path / "bars.toml"))
    model = scene.model()
    mesh, _ = of_rods.joined_mesh(scene, model, 2)
    found = solve(model, mesh, "modal", modes=3)
    assert found.frequencies == pytest.approx(modal.solve(model, modes=3).frequencies, rel=0.01)
    assert found.rigid == 0 and found.shapes.shape == (3, len(mesh.points), 3)


@pytest.mark.slow
def test_a_scene_with_a_body_from_end_to_end(tmp_path):
    pytest.importorskip("pyvista")
    pytest.importorskip("matplotlib")
    program = [sys.executable, "-m", "isorod"]
    for words in (["new", "tendon.toml", "--from", "tendon"], ["compare", "tendon.toml"]):
        done = subprocess.run([*program, *words], cwd=tmp_path, capture_output=True, text=True, timeout=1800)
        assert done.returncode == 0, done.stderr
    assert "tendon: default (polynomials) within 0.5 %: yes" in done.stdout
    text = (tmp_path / "results" / "report.html").read_text()
    for piece in ("rods and bodies as one solid", "bodies 1", "P2 tetrahedra", "compare-tendon-picture.png"):
        assert piece in text
