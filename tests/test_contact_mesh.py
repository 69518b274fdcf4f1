"""Rigid closed meshes of triangles: distances, forces and tangent, what STL files hold, and bad ones."""

import re
import struct
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from conftest import straight
from refused import refused
from touching import among, assert_tangent, forces_at, moved, shaken

from isorod import Contact, InputError, Plane, Space, Sphere, TriangleMesh
from isorod.contact.mesh_kernel import mesh_gap
from isorod.contact.operator import ContactOperator
from isorod.contact.surface_kernel import new_projection
from isorod.contact.tables import pack

PENALTY = 10.0


def blocks(cells, low=(0.0, 0.0, 0.0), size=1.0):
    """The surface of unit cubes that hang together."""
    cells = {tuple(cell) for cell in cells}
    numbers, triangles = {}, []
    for cell, axis, side in product(sorted(cells), range(3), (0, 1)):
        beside = np.array(cell)
        beside[axis] += 2 * side - 1
        if tuple(beside) in cells:
            continue
        b, c = (axis + 1) % 3, (axis + 2) % 3
        corners = []
        for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
            corner = np.array(cell)
            corner[[axis, b, c]] += [side, u, v]
            corners.append(numbers.setdefault(tuple(corner), len(numbers)))
        corners = corners if side else corners[::-1]
        triangles += [[corners[0], *corners[1:3]], [corners[0], *corners[2:]]]
    return TriangleMesh(size * np.array([*numbers]) + np.array(low), np.array(triangles))


def ball(center, radius, halvings):
    """An icosahedron whose triangles are divided into four so many times, on a sphere."""
    g = 0.5 * (1.0 + np.sqrt(5.0))
    x = np.array([[0.0, s, t * g] for s, t in product((-1, 1), repeat=2)])
    x = np.concatenate([np.roll(x, k, axis=1) for k in range(3)])
    near = np.linalg.norm(x[:, None] - x, axis=2) < 2.1
    corners = [
        (i, j, k) for i in range(12) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]
    ]
    triangles = [t if np.linalg.det(x[list(t)]) > 0.0 else t[::-1] for t in corners]
    for _ in range(halvings):
        edges = {tuple(sorted(edge)) for a, b, c in triangles for edge in ((a, b), (b, c), (c, a))}
        half = {edge: len(x) + k for k, edge in enumerate(edges)}
        finer = []
        for a, b, c in triangles:
            d, e, f = (half[tuple(sorted(edge))] for edge in ((a, b), (b, c), (c, a)))
            finer += [(a, d, f), (d, b, e), (f, e, c), (d, e, f)]
        x, triangles = np.concatenate([x, x[np.array([*edges])].mean(axis=1)]), finer
    return TriangleMesh(center + radius * x / np.linalg.norm(x, axis=1)[:, None], triangles)


def rod():
    return Space.paper(straight(8, breaks=(0.0, 1.0, 2.0, 3.0), height=6.0))


def on(obstacle, space=None, **more):
    return among([space or rod()], Contact(0, obstacle, PENALTY, **{"points": (4, 6)} | more))


def gap(packed, x, number=0):
    projection = new_projection()
    distance = mesh_gap(packed, packed.passes[number], np.array(x, dtype=float), projection)
    return distance, projection.normal.copy()


def test_distances_from_a_cube_are_exact():
    """Faces, edges and corners, inside and outside, near and far; the normal is the distance's gradient."""
    packed, rng = pack(on(blocks([(0, 0, 0)], (-0.5, -0.5, -0.5)))), np.random.default_rng(1)
    for _ in range(400):
        x = rng.uniform(-1.5, 1.5, 3) * rng.choice([0.3, 1.0, 10.0])
        outside, inside = np.maximum(np.abs(x) - 0.5, 0.0), (np.abs(x) - 0.5).max()
        expected = np.linalg.norm(outside) if inside > 0.0 else inside
        found, normal = gap(packed, x)
        assert found == pytest.approx(expected, abs=1e-13)
        away = outside if inside > 0.0 else np.where(np.abs(x) - 0.5 == inside, 1.0, 0.0)
        np.testing.assert_allclose(normal, np.sign(x) * away / np.linalg.norm(away), atol=1e-10)


def test_distances_from_a_notch_are_exact():
    """Eight cubes less one: three edges and a corner at which the nearest point inside is."""
    cells = [cell for cell in product((0, 1), repeat=3) if cell != (1, 1, 1)]
    packed, rng = pack(on(blocks(cells, (-1.0, -1.0, -1.0)))), np.random.default_rng(2)
    for _ in range(300):
        x = rng.uniform(-0.3, 0.45, 3)
        # The notch is where all coordinates are positive.
        found, normal = gap(packed, x)
        depth = np.minimum(x, 0.0)
        expected = x.min() if x.min() > 0.0 else -np.linalg.norm(depth)
        assert found == pytest.approx(expected, abs=1e-13)
        away = np.where(x == x.min(), 1.0, 0.0) if x.min() > 0.0 else -depth / np.linalg.norm(depth)
        np.testing.assert_allclose(normal, away, atol=1e-10)


def test_the_tree_finds_the_nearest_of_many_triangles():
    mesh = ball(np.array([1.0, 2.0, 3.0]), 2.0, 5)
    packed, rng = pack(on(mesh)), np.random.default_rng(3)
    assert len(packed.corners) == 20 * 4**5
    for _ in range(200):
        x = np.array([1.0, 2.0, 3.0]) + rng.uniform(-4.0, 4.0, 3)
        far = np.linalg.norm(x - [1.0, 2.0, 3.0]) - 2.0
        # No facet is farther than 3e-4 inside of the sphere.
        assert far - 1e-13 < gap(packed, x)[0] < far + 6e-4
        # And no corner is nearer.
        assert abs(gap(packed, x)[0]) <= np.linalg.norm(mesh.vertices - x, axis=1).min() + 1e-13


def test_the_face_of_a_box_is_a_plane():
    box = blocks([(0, 0, 0)], (-10.0, -20.95, -7.0), 20.0)
    model, plane = on(box), on(Plane((0.0, -0.95, 0.0), (0.0, 1.0, 0.0)))
    displacement = shaken(model)
    _, outcome, forces = forces_at(model, displacement)
    _, expected, pushed = forces_at(plane, displacement)
    assert expected.force > 0.1
    np.testing.assert_allclose(outcome, expected, rtol=1e-11)
    np.testing.assert_allclose(forces, pushed, atol=1e-12 * np.abs(pushed).max())
    values = [ContactOperator(one).tangent(displacement) for one in (model, plane)]
    np.testing.assert_allclose(values[0], values[1], atol=1e-11 * np.abs(values[1]).max())


def test_a_fine_ball_is_a_sphere():
    """The error falls with the square of the sides of its triangles."""
    center, radius, errors = np.array([0.2, 2.4, 2.7]), 1.5, []
    expected = forces_at(on(Sphere(tuple(center), radius)), np.zeros(on(Sphere(tuple(center), radius)).dofs))
    for halvings in (2, 4):
        model = on(ball(center, radius, halvings))
        _, outcome, forces = forces_at(model, np.zeros(model.dofs))
        errors.append(
            max(
                abs(outcome.force / expected[1].force - 1.0),
                np.linalg.norm(forces - expected[2]) / np.linalg.norm(expected[2]),
            )
        )
    assert errors[0] > 8.0 * errors[1]
    assert errors[1] < 0.03


def notched():
    """A rod that lies in the notch of seven cubes, deep in its edges."""
    cells = [cell for cell in product((0, 1), repeat=3) if cell != (1, 1, 1)]
    space = Space.paper(moved(straight(8, breaks=(0.0, 1.0, 2.0, 3.0), height=3.0), (0.5, 0.6, -0.4)))
    return on(blocks(cells, (-4.0, -4.0, -4.0), 4.0), space)


def edged():
    """A rod across an edge of a cube, and beside the corner of another."""
    cubes = blocks([(0, 0, 0)], (0.3, 0.25, 2.0), 5.0), blocks([(0, 0, 0)], (-5.9, -5.9, 3.1), 5.0)
    model = on(cubes[0])
    return replace(model, contacts=[replace(model.contacts[0], second=cube) for cube in cubes])


@pytest.mark.parametrize("scene", [notched, edged])
def test_tangent_is_the_derivative_of_the_forces_and_symmetric(scene):
    """With multipliers, so that edges and corners press from outside as well."""
    model = scene()
    displacement = shaken(model)
    operator = ContactOperator(model)
    operator.forces(displacement)
    packed = operator.packed
    operator.packed.multipliers[np.abs(packed.states["gap"]) < 0.5] = 8.0
    half = len(packed.points) // len(packed.passes)
    pressed = np.flatnonzero(packed.multipliers)
    places = {tuple(np.abs(gap(packed, packed.points[k], k // half)[1]).round(6) > 0.0) for k in pressed}
    # Normals of faces, of edges and of a corner.
    assert {sum(place) for place in places} == {1, 2, 3}
    assert_tangent(operator, displacement, 1e-7, 4, 1e-5)


def text(corners, head="solid a part"):
    lines = [head]
    for facet in corners:
        lines += [" facet normal 0 0 0", "  outer loop"]
        lines += [f"   vertex {x!r} {y!r} {z!r}" for x, y, z in facet.tolist()]
        lines += ["  endloop", " endfacet"]
    return "\n".join([*lines, "endsolid a part", ""]).encode()


def binary(corners, count=None):
    facets = (struct.pack("<12fH", 0.0, 0.0, 0.0, *facet.ravel(), 0) for facet in corners)
    head = b"solid, though binary".ljust(80)
    return head + struct.pack("<I", len(corners) if count is None else count) + b"".join(facets)


@pytest.mark.parametrize("write", [text, binary])
def test_what_a_file_holds(write, tmp_path):
    """ASCII and binary; vertices are joined, zeros of both signs are one place, and clockwise bodies turned round."""
    box = blocks([(0, 0, 0), (1, 0, 0)], (-1.0, 0.0, 2.0))
    corners = box.corners.copy()
    corners[corners == 0.0] *= np.where(np.arange((corners == 0.0).sum()) % 2, 1.0, -1.0)
    file = tmp_path / "box.stl"
    for facets in (corners, corners[:, ::-1]):
        file.write_bytes(write(facets))
        found = TriangleMesh.from_file(file, 2.0)
        assert len(found.vertices) == len(box.vertices)
        assert np.unique(found.vertices, axis=0).tolist() == np.unique(2.0 * box.vertices, axis=0).tolist()
        middles = found.corners.mean(axis=1)
        assert ((middles - found.vertices.mean(axis=0)) * found.normals()[:, 0]).sum(axis=1).min() > 0.9


def test_normals_of_edges_and_corners_do_not_depend_on_how_faces_are_cut():
    """Of a cube: of a face its own, of an edge the mean of its faces', of a corner along the diagonal."""
    cube = blocks([(0, 0, 0)], (-1.0, -1.0, -1.0), 2.0)
    corners, found = cube.corners, cube.normals()
    edges = 0.5 * (corners + np.roll(corners, -1, axis=1))
    # On a cube about the origin a normal points to where it stands, of diagonals of faces as of faces.
    to = np.concatenate([corners.mean(axis=1, keepdims=True), edges, corners], axis=1)
    outwards = np.where(np.abs(to) > 1.0 - 1e-12, np.sign(to), 0.0)
    np.testing.assert_allclose(found, outwards / np.linalg.norm(outwards, axis=2, keepdims=True), atol=1e-14)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda x: text(x[1:]), "an edge of triangle 0 is open; need a closed surface, two triangles at each edge"),
        (lambda x: text(np.concatenate([x, x[:1]])), "is one of 3 triangles; need a closed surface"),
        (lambda x: text(np.concatenate([x[:1, ::-1], x[1:]])), "turn in opposite senses; turn one round"),
        (lambda x: text(x).replace(b"vertex 1.0", b"vertex one", 1), "line 6: got one 1.0 1.0, need three numbers"),
        (lambda x: text(x).replace(b"vertex 1.0", b"vertex nan", 1), "got (nan, 1.0, 1.0), need finite numbers"),
        (lambda x: text(x)[:-20], "got 36 vertices of 11 facets, need three of each"),
        (lambda x: text(x[:0]), "got 29 bytes, neither an ASCII nor a whole binary STL file"),
        (lambda x: binary(x)[:-7], "bytes, neither an ASCII nor a whole binary STL file"),
        (lambda x: binary(x, 11), "got 684 bytes, neither"),
        (lambda x: b"", "got 0 bytes, neither"),
        (lambda x: text(x * [1.0, 1.0, 0.0]), "it has no volume; need a surface round a body"),
    ],
)
def test_bad_files_get_one_line(make, message, tmp_path):
    file = tmp_path / "part.stl"
    file.write_bytes(make(np.roll(blocks([(0, 0, 0)]).corners, 6, axis=0)))
    with pytest.raises(InputError, match=re.escape(message)) as error:
        TriangleMesh.from_file(file)
    assert str(error.value).startswith(f"{file}: ")
    assert "\n" not in str(error.value)


test_bad_arrays_get_one_line = refused(
    (lambda: TriangleMesh.from_file("no/such.stl"), "no/such.stl: No such file"),
    (lambda: TriangleMesh.from_file("x.stl", -1.0), "scale: got -1, need a positive number"),
    (lambda: TriangleMesh([[0.0, 0.0]], [[0, 0, 0]]), "vertices: got shape (1, 2), need (m, 3)"),
    (lambda: TriangleMesh(np.eye(3), np.zeros((0, 3))), "triangles: got shape (0, 3), need (m, 3)"),
    (lambda: TriangleMesh(np.eye(3), [[0, 1, 3]]), "got (0.0, 1.0, 3.0), need numbers of the 3 vertices"),
    (lambda: TriangleMesh(np.eye(3), [[0, 1, 0.5]]), "need numbers of the 3 vertices"),
    (lambda: TriangleMesh(np.diag([0, 1, 2]) @ np.ones((3, 3)), [[0, 1, 2], [2, 1, 0]]), "triangle 0 has no area"),
    (lambda: TriangleMesh(np.eye(3), [[0, 1, 2], [2, 1, 0]]), "it has no volume; need a surface round a body"),
    (lambda: TriangleMesh("part.stl", [[0, 1, 2]]), "vertices: got 'part.stl', need numbers"),
)


SCENE = """
analysis = "statics"
[rod.bar]
curve = {straight = 4.0}
section = {circle = 1.0}
law = {NeoHookean = {E = 10.0, nu = 0.3}}
[support.foot]
end = "start"
[obstacle.die]
TriangleMesh = "die.stl"
[contact.both]
first = "bar"
second = "die"
penalty = 10.0
points = [3, 4]
"""


def test_scene_files_name_the_file_beside_them(tmp_path):
    from isorod.files.scene import FileScene

    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "die.stl").write_bytes(binary(blocks([(0, 0, 0)], (-4.0, -8.95, -2.0), 8.0).corners))
    scene = FileScene(str(tmp_path / "scene.toml"))
    (result,) = ContactOperator(scene.model()).results(np.zeros(scene.model().dofs))
    assert result.penetration == pytest.approx(0.05, rel=0.1)
    assert list(scene.data) == ["die.stl"]
    (tmp_path / "die.stl").write_bytes(b"")
    with pytest.raises(InputError, match=r"scene.toml:\d+: obstacle.die.*die.stl: .*got 0 bytes, neither") as error:
        FileScene(str(tmp_path / "scene.toml")).model()
    assert "\n" not in str(error.value)
    (tmp_path / "die.stl").unlink()
    with pytest.raises(InputError, match=r"scene.toml:\d+: obstacle.die.*die.stl: cannot be read"):
        FileScene(str(tmp_path / "scene.toml")).model()


def test_the_resultant_of_a_mesh_is_the_sum_of_its_forces():
    model = on(ball(np.array([0.2, 2.2, 2.7]), 1.5, 2))
    displacement = shaken(model)
    (result,) = ContactOperator(model).results(displacement)
    _, _, forces = forces_at(model, displacement)
    assert result.force > 0.0
    np.testing.assert_allclose(result.resultant, forces[model.is_control_point].sum(axis=0), rtol=1e-9)
