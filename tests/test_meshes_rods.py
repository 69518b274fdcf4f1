"""Meshes of any rods: volumes, closed boundaries, nested levels, rings and knots on mesh lines, and hard sections."""

import numpy as np
import pytest
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from isorod.errors import FoldedRodError, InputError
from isorod.geometry import center_line, coils, section
from isorod.geometry.rod import Rod
from isorod.scenes.blade import Blade
from meshes import rods
from meshes.mesh import Mesh, gradients, lexicographic
from meshes.sections import sections
from meshes.template import Template, o_grid

LINE = center_line.straight(6.0)


def tube() -> Rod:
    return LINE.sweep(section.circle(8)).with_rings((0.5, 1.0))


def layered() -> Rod:
    return LINE.sweep(section.circle(8)).with_rings((0.0, 0.6, 0.9, 1.0))


def torus() -> Rod:
    return coils.arc(4.0, 360.0).sweep(section.circle(8))


def trefoil() -> Rod:
    angle = 2.0 * np.pi * np.arange(24) / 24
    points = np.stack(
        [np.sin(angle) + 2.0 * np.sin(2.0 * angle), np.cos(angle) - 2.0 * np.cos(2.0 * angle), -np.sin(3.0 * angle)],
        axis=1,
    )
    return center_line.polyline(points, 0.05, closed=True).sweep(section.circle(8, 0.3)).with_rings((0.6, 1.0))


def airfoil(rings: tuple[float, ...] = (0.0, 1.0)) -> Rod:
    return LINE.sweep(section.naca("2412", 16, 2.0)).with_rings(rings)


def sharp(path, rings: tuple[float, ...] = (0.0, 1.0)) -> Rod:
    """Return a bar with an airfoil of a file whose upper and lower side meet in an edge."""
    x = 0.5 * (1.0 + np.cos(np.linspace(0.0, np.pi, 60)))
    half = 0.6 * (0.2969 * np.sqrt(x) - x * (0.1260 + x * (0.3516 - x * (0.2843 - 0.1036 * x))))
    mean = np.where(x < 0.4, 0.125 * x * (0.8 - x), 0.02 / 0.36 * (0.2 + x * (0.8 - x)))
    half[0] = mean[0] = 0.0
    rows = [*zip(x, mean + half, strict=True), *[*zip(x, mean - half, strict=True)][-2::-1]]
    path.write_text("sharp\n" + "\n".join(f"{a:.6f} {b:.6f}" for a, b in rows))
    return LINE.sweep(section.from_file(path, 24)).with_rings(rings)


def faces(mesh: Mesh) -> np.ndarray:
    """Return the nodes of all faces of all cells, sorted, ``(6 cells, nodes)``."""
    found = [mesh.cells[:, mesh.reference[:, axis] == end] for axis in range(3) for end in (0.0, 1.0)]
    return np.sort(np.concatenate(found), axis=1)


def functions(order: int, s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the functions ``(m, nodes)`` of a quadrilateral's nodes at points of the unit square, and their slopes."""
    ticks = np.arange(order + 1) / order
    first, second = (
        np.stack([np.prod([(x - b) / (a - b) for b in ticks if b != a], axis=0) for a in ticks], axis=1) for x in (s, t)
    )
    where = np.stack([s, t, np.zeros(s.size)], axis=1)
    slopes = gradients("hexahedron", order, lexicographic(order, 3), where)[:, : ticks.size**2, :2]
    return (second[:, :, None] * first[:, None, :]).reshape(s.size, -1), slopes


def enclosed(mesh: Mesh, names: list[str]) -> tuple[np.ndarray, float]:
    """Return the vector area of boundary faces, and the volume that they enclose: the integral of ``x . n / 3``."""
    x, w = np.polynomial.legendre.leggauss(mesh.order + 2)
    s, t = (grid.ravel() for grid in np.meshgrid(0.5 * (x + 1.0), 0.5 * (x + 1.0)))
    values, slopes = functions(mesh.order, s, t)
    area, volume = np.zeros(3), 0.0
    for name in names:
        corners = mesh.points[mesh.faces[name]]
        edges = np.einsum("qnb,fna->fqab", slopes, corners)
        normal = np.cross(edges[..., 0], edges[..., 1]) * 0.25 * np.outer(w, w).reshape(-1, 1)
        area += normal.sum(axis=(0, 1))
        volume += np.sum(normal * np.einsum("qn,fna->fqa", values, corners)) / 3.0
    return area, volume


@pytest.mark.parametrize("order, rate", [(1, 2.0), (2, 4.0), (3, 4.0)])
@pytest.mark.parametrize(
    "rod, exact",
    [(tube, 4.5 * np.pi), (layered, 6.0 * np.pi), (torus, 8.0 * np.pi**2)],
    ids=["tube", "layered", "torus"],
)
def test_volume_converges_to_the_exact_one(rod, exact, order, rate):
    errors = [abs(rods.build([rod()], level, order).volume() / exact - 1.0) for level in (1, 2, 4)]
    assert -np.diff(np.log2(errors)) == pytest.approx([rate, rate], abs=0.5)
    assert errors[-1] < {1: 0.011, 2: 6e-5, 3: 3e-5}[order]


@pytest.mark.parametrize("order", [1, 2, 3])
def test_named_faces_are_the_boundary(order):
    several = [LINE.sweep(section.circle(8)), tube(), torus().with_rings((0.4, 1.0)), layered()]
    mesh = rods.build(several, 1, order)
    assert list(mesh.regions) == [f"rod {k}" for k in range(4)]
    assert [*mesh.faces] == [
        *("rod 0 start", "rod 0 end", "rod 0 lateral"),
        *("rod 1 start", "rod 1 end", "rod 1 lateral", "rod 1 inner"),
        *("rod 2 lateral", "rod 2 inner"),
        *("rod 3 start", "rod 3 end", "rod 3 lateral"),
    ]
    # Faces of one cell only are all named: none is at the closed rod's seam, and rods share no node.
    different, count = np.unique(faces(mesh), axis=0, return_counts=True)
    named = np.sort(np.concatenate([*mesh.faces.values()]), axis=1)
    assert set(count) == {1, 2}
    assert np.array_equal(np.unique(named, axis=0), different[count == 1])
    owners = rods.owners(mesh)
    assert (np.diff(owners) >= 0).all()
    for k in range(4):
        cells = mesh.cells[mesh.regions[f"rod {k}"]]
        assert (owners[cells] == k).all()
        own = Mesh("hexahedron", order, mesh.points, cells, mesh.reference, {}, mesh.face_reference)
        area, volume = enclosed(mesh, [name for name in mesh.faces if name.startswith(f"rod {k} ")])
        assert np.abs(area).max() < 1e-10
        assert volume == pytest.approx(own.volume(), rel=1e-10)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_levels_are_nested(order):
    several = [layered(), torus().with_rings((0.4, 1.0)), airfoil()]
    coarse, fine, finest = (rods.build(several, level, order) for level in (1, 2, 4))
    assert [len(mesh.cells) // len(coarse.cells) for mesh in (fine, finest)] == [8, 64]
    for one, other in ((coarse, fine), (fine, finest)):
        keys = [np.column_stack([mesh.parameters, 10.0 * rods.owners(mesh)]) for mesh in (one, other)]
        distance, node = cKDTree(keys[1]).query(keys[0])
        assert distance.max() < 1e-9
        assert np.abs(other.points[node] - one.points).max() < 1e-9


def test_cells_of_first_order_have_the_nodes_of_second():
    several = [layered(), tube()]
    first, second = (rods.build(several, 1, order) for order in (1, 2))
    assert len(first.cells) == 8 * len(second.cells)
    assert len(first.points) == len(second.points)
    assert cKDTree(second.points).query(first.points)[0].max() < 1e-12


def test_nodes_are_where_the_rods_put_them():
    several = [tube(), torus(), airfoil((0.0, 0.7, 1.0)), trefoil()]
    mesh = rods.build(several)
    owners = rods.owners(mesh)
    for k, rod in enumerate(several):
        xi, u = mesh.parameters[owners == k, :2], mesh.parameters[owners == k, 2]
        assert np.abs(rod.points(xi, u) - mesh.points[owners == k]).max() < 1e-13
        assert u.min() == rod.axis.breaks[0] and (u.max() < rod.axis.breaks[-1]) == rod.closed
        for name, radius in (("lateral", 1.0), ("inner", rod.rings[0])):
            if (face := mesh.faces.get(f"rod {k} {name}")) is not None:
                assert np.abs(np.linalg.norm(mesh.parameters[face, :2], axis=-1) - radius).max() < 1e-13


def test_laws_change_on_mesh_lines():
    line = center_line.polyline([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [6.0, 1.0, 0.0], [9.0, 0.0, 1.0]], 0.0)
    layers = line.sweep(section.circle(8)).with_rings((0.0, 0.6, 0.9, 1.0))
    ring = coils.arc(4.0, 360.0).sweep(section.ellipse(8, 1.0, 0.4)).with_rings((0.3, 0.5, 1.0))
    several = [layers, ring]
    mesh = rods.build(several)
    places = rods.places(mesh, several)
    owner, element, layer = places.T
    for k, rod in enumerate(several):
        own = owner == k
        assert np.array_equal(np.flatnonzero(own), mesh.regions[f"rod {k}"])
        assert np.array_equal(np.unique(element[own]), np.arange(rod.axis.elements))
        assert np.array_equal(np.unique(layer[own]), np.arange(len(rod.rings) - 1))
        nodes = mesh.parameters[mesh.cells[own]]
        radius, u = np.linalg.norm(nodes[..., :2], axis=2), nodes[..., 2]
        inner, outer = (np.array(rod.rings)[layer[own] + one][:, None] for one in (0, 1))
        assert ((inner - 1e-12 <= radius) & (radius <= outer + 1e-12)).all()
        low, high = (rod.axis.breaks[element[own] + one][:, None] for one in (0, 1))
        at_seam = rod.closed & (high == rod.axis.breaks[-1]) & (u == rod.axis.breaks[0])
        assert (((low <= u) & (u <= high)) | at_seam).all()


HARD = {
    "trefoil": (trefoil, 0.7),
    "blade": (lambda: Blade().rod(), 0.2),
    "hollow blade": (lambda: Blade().rod().with_rings((0.8, 1.0)), 0.03),
    "airfoil": (airfoil, 0.2),
    "hollow airfoil": (lambda: airfoil((0.8, 1.0)), 0.05),
    "layered airfoil": (lambda: airfoil((0.0, 0.8, 1.0)), 0.03),
    "rectangle": (lambda: LINE.sweep(section.rounded_rectangle(16, 3.0, 1.0, 0.4)), 0.05),
    "flower": (lambda: LINE.sweep(section.flower()), 0.5),
    "hollow flower": (lambda: LINE.sweep(section.flower()).with_rings((0.6, 1.0)), 0.5),
    "flat ellipse": (lambda: LINE.sweep(section.ellipse(8, 2.0, 0.2)), 0.3),
    "twisted and tapered": (
        lambda: LINE.sweep(section.ellipse(8, 1.0, 0.5), scale=[1.0, 0.4], twist=270.0),
        0.3,
    ),
}


@pytest.mark.parametrize("name", HARD)
def test_cells_of_hard_sections(name):
    make, least = HARD[name]
    rod = make()
    for level in (1, 2):
        mesh = rods.build([rod], level)
        assert mesh.check() > -1e-12
        assert mesh.quality().min() > least / level
    assert mesh.volume() == pytest.approx(rod.volume(), rel=4e-3)


@pytest.mark.parametrize("rings, least", [((0.0, 1.0), 0.1), ((0.8, 1.0), 0.05)])
def test_sharp_airfoils_of_files(rings, least, tmp_path):
    rod = sharp(tmp_path / "sharp.dat", rings)
    mesh = rods.build([rod])
    assert mesh.check() > -1e-12
    assert mesh.quality().min() > least
    assert mesh.volume() == pytest.approx(rod.volume(), rel=1e-2)


def torsion(rod: Rod, template: Template) -> float:
    """Return the torsion constant of a section in a plane of z, meshed with quadrilaterals: warping by finite elements.

    ``J = int |x|^2 - max over w of (2 int x . curl w - int |grad w|^2)`` (Saint-Venant).
    """
    order = template.order
    x = rod.grid(template.points, [0.5])[0][0, :, :2]
    x = x - x.mean(axis=0)
    tick, weight = np.polynomial.legendre.leggauss(order + 3)
    s, t = (grid.ravel() for grid in np.meshgrid(0.5 * (tick + 1.0), 0.5 * (tick + 1.0)))
    values, slopes = functions(order, s, t)
    corners = x[template.quads]
    jacobian = np.einsum("qnb,cna->cqab", slopes, corners)
    weights = np.linalg.det(jacobian) * 0.25 * np.outer(weight, weight).ravel()
    gradient = np.einsum("qnb,cqba->cqna", slopes, np.linalg.inv(jacobian))
    place = np.einsum("qn,cna->cqa", values, corners)
    stiffness = np.einsum("cqna,cqma,cq->cnm", gradient, gradient, weights, optimize=True)
    force = np.einsum("cqna,cqa,cq->cn", gradient, np.stack([place[..., 1], -place[..., 0]], axis=-1), weights)
    size, count = len(x), template.quads.shape[1]
    rows, columns = np.repeat(template.quads, count, axis=1).ravel(), np.tile(template.quads, (1, count)).ravel()
    matrix = csc_matrix((stiffness.ravel(), (rows, columns)), (size, size))
    load = np.bincount(template.quads.ravel(), force.ravel(), size)
    # A constant warps nothing.
    warping = np.append(0.0, spsolve(matrix[1:, 1:], load[1:]))
    return float(np.sum(weights * (place**2).sum(axis=-1)) - load @ warping)


def test_grid_laid_out_in_space_is_right_in_torsion(tmp_path):
    rod = sharp(tmp_path / "sharp.dat")
    found = next(sections(rod, 2))
    assert found.name == "grid of 6 x 1 cells"
    exact = torsion(rod, found.make(5, 3))
    # An O-grid with as many nodes and more has its cells sheared in the flat section.
    assert exact == pytest.approx(torsion(rod, o_grid(64, 8, 3)), rel=3e-4)
    assert abs(torsion(rod, found.make(1, 2)) / exact - 1.0) < 1e-3
    assert abs(torsion(rod, o_grid(8, 1, 2)) / exact - 1.0) > 1e-2


def test_layers_follow_the_rod():
    # A turn has 8 layers, however short it is, a long bar cells 6 times as long as wide, a short one at least 4 layers.
    ring = coils.arc(1.2, 360.0).sweep(section.circle(8))
    slender = center_line.straight(1000.0).sweep(section.circle(8))
    stub = center_line.straight(1.0).sweep(section.circle(8))
    layers = [len(rods.build([rod]).cells) // 5 for rod in (ring, slender, stub)]
    assert layers[0] == 8
    assert layers[1] == pytest.approx(1000.0 / (6.0 * np.sqrt(2.0)), rel=0.2)
    assert layers[2] == 4
    for rod in (tube(), layered(), torus(), airfoil(), Blade().rod()):
        assert 64 * 24 * len(rods.build([rod]).cells) < 2.5e5


def test_bad_input_is_refused_in_one_line():
    rod = LINE.sweep(section.circle(8))
    for given, said in {
        ((), 1, 2): "no rod is given",
        ((rod,), 0, 2): "level: got 0, need",
        ((rod,), 2.5, 2): "level",
        ((rod,), 1, 4): "order of the cells: got 4",
    }.items():
        with pytest.raises(InputError, match=said) as problem:
            rods.build(*given)
        assert "\n" not in str(problem.value)
    with pytest.raises(FoldedRodError, match=r"mesh: rod 1: the rod folds in element 0 .*concave|outline|fold"):
        rods.build([rod, LINE.sweep(section.flower(16, 4, 1.0, 0.6))])


@pytest.mark.parametrize(("rings", "quads"), [((0.5, 1.0), 12 * 2), ((0.0, 0.4, 0.7, 1.0), 9 + 12 + 2 * 12 * 2)])
def test_cells_are_as_many_as_are_asked_for(rings, quads):
    rod = coils.helix(5.0, 2.0, 1).sweep(section.circle(8)).with_rings(rings)
    layers = 3 * rod.axis.elements
    mesh = rods.build([rod], 1, 3, rods.Cells(12, 2, layers))
    assert len(mesh.cells) == quads * layers
    assert len(rods.build([rod], 2, 3, rods.Cells(12, 2, layers)).cells) == 8 * quads * layers
    with pytest.raises(InputError, match=rf"layers: got 1, need a multiple of the {rod.axis.elements} elements"):
        rods.build([rod], 1, 2, rods.Cells(12, 1, 1))
    with pytest.raises(InputError, match="sections with a hole or layers"):
        rods.build([center_line.straight(1.0).sweep(section.circle(8))], 1, 2, rods.Cells(12, 1, 4))
