"""Contact between meshes' surfaces, without finite elements: closest points, sign of the gap, what the search keeps."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from comparisons.fem.contact.closest_kernel import Closest, Facet, Surface, closest
from comparisons.fem.contact.facets import surface_points
from comparisons.fem.contact.surfaces import Contact
from meshes.mesh import Mesh

ROTATIONS = Rotation.random(12, random_state=1).as_matrix()

# Functions of flat facets: powers of the monomials, and coefficients of each node's function.
TRIANGLE = (np.array([[0, 0], [1, 0], [0, 1]]), np.array([[1.0, 0, 0], [-1, 1, 0], [-1, 0, 1]]))
SQUARE = (
    np.array([[0, 0], [0, 1], [1, 0], [1, 1]]),
    np.array([[1.0, 0, 0, 0], [-1, 1, 0, 0], [-1, 0, 1, 0], [1, -1, -1, 1]]),
)
NODES = {"triangle": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "square": [[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0]]}


def gaps(kind, x, turn):
    """Return gaps and parameters of points ``x`` to the facet of `NODES`, outward normal z, everything turned."""
    powers, coefficients = TRIANGLE if kind == "triangle" else SQUARE
    nodes = np.ascontiguousarray(np.array(NODES[kind], dtype=float) @ turn.T)
    x = np.ascontiguousarray(np.atleast_2d(x) @ turn.T)
    surface = Surface(
        np.arange(len(nodes))[None, :], np.full((1, 1), -1), Facet(coefficients, powers, kind == "triangle")
    )
    found = Closest(x, np.zeros(len(x), dtype=np.int64), np.empty((len(x), 2)), np.empty(len(x)))
    closest(nodes, surface, found)
    return found.gap, found.xi


@pytest.mark.parametrize("turn", ROTATIONS)
@pytest.mark.parametrize("kind", NODES)
def test_gap_is_negative_behind_a_facet_however_it_is_turned(kind, turn):
    rng = np.random.default_rng(2)
    where = 0.5 * rng.random((40, 2))
    height = rng.uniform(0.05, 0.5, 40) * np.where(np.arange(40) % 2, -1.0, 1.0)
    found, xi = gaps(kind, np.column_stack([where, height]), turn)
    assert found == pytest.approx(height, rel=1e-12)
    assert xi == pytest.approx(where, abs=1e-12)


@pytest.mark.parametrize("turn", ROTATIONS[:4])
@pytest.mark.parametrize("kind", NODES)
def test_off_the_edge_only_points_deeper_than_slanted_are_inside(kind, turn):
    """At 60 degrees to the normal a point beside and below an edge changes from inside to outside."""
    for degrees, inside in ((10, True), (50, True), (58, True), (62, False), (89, False), (120, False), (170, False)):
        way = np.array([0.0, -np.sin(np.radians(degrees)), -np.cos(np.radians(degrees))])
        (found,), ((a, b),) = gaps(kind, np.array([0.5, 0.0, 0.0]) + 0.2 * way, turn)
        assert found == pytest.approx(-0.2 if inside else 0.2, rel=1e-12), degrees
        assert (a, b) == pytest.approx((0.5, 0.0), abs=1e-12)


@pytest.mark.parametrize("kind", NODES)
def test_closest_point_of_edges_and_corners(kind):
    """Against the distances to a fine lattice of the facet, from all around."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-1.0, 2.0, (60, 3))
    found, xi = gaps(kind, x, np.eye(3))
    a, b = (one.ravel() for one in np.meshgrid(np.linspace(0, 1, 401), np.linspace(0, 1, 401)))
    keep = a + b <= 1.0 + 1e-12 if kind == "triangle" else np.ones(a.size, dtype=bool)
    lattice = np.column_stack([a[keep], b[keep], 0.0 * a[keep]])
    nearest = np.array([np.linalg.norm(lattice - one, axis=1).min() for one in x])
    assert (np.abs(found) <= nearest + 1e-12).all()
    assert np.abs(found) == pytest.approx(nearest, abs=2e-3)
    assert np.linalg.norm(x - np.column_stack([xi, 0.0 * xi[:, :1]]), axis=1) == pytest.approx(np.abs(found), rel=1e-12)


def plates(gap, cells=4, slope=0.0):
    """Return two surfaces that face each other along z, ``gap`` apart at x = 0, by ``slope`` more at x = 1."""
    ticks = np.linspace(0.0, 1.0, cells + 1)
    grid = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    low = np.column_stack([grid, np.zeros(len(grid))])
    high = np.column_stack([grid, gap + slope * grid[:, 0]])
    corner = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)[:-1, :-1].ravel()
    square = corner[:, None] + np.array([0, 1, cells + 1, cells + 2])
    count = len(grid)
    # With its axes in each other's place the upper plate looks down.
    lower, upper = square, square[:, [0, 2, 1, 3]] + count
    reference = np.stack(np.meshgrid([0.0, 1.0], [0.0, 1.0], [0.0, 1.0], indexing="ij"), axis=-1).reshape(-1, 3)
    face = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
    return Mesh(
        "hexahedron",
        1,
        np.concatenate([low, high]),
        np.zeros((0, 8), dtype=np.int64),
        reference,
        {"low": lower, "high": upper},
        face,
    )


def pressing(contact, nodes):
    force = np.zeros_like(nodes)
    return contact.add_forces(np.ascontiguousarray(nodes), force), force


def test_plates_press_with_penalty_times_depth():
    """Each pass has half the weight: energy of one surface, area 1."""
    mesh = plates(-0.05)
    found, force = pressing(Contact(mesh, "low", "high", 200.0, reach=0.2), mesh.points)
    assert found.gap == pytest.approx(-0.05, rel=1e-12)
    assert found.energy == pytest.approx(0.5 * 200.0 * 0.05**2, rel=1e-12)
    assert found.normal_force == pytest.approx(200.0 * 0.05, rel=1e-12)
    assert found.area == pytest.approx(1.0, rel=1e-12)
    # Pushed down is the lower one.
    assert found.force == pytest.approx([0.0, 0.0, -10.0], abs=1e-12)
    half = len(mesh.points) // 2
    assert -force[:half].sum(axis=0) == pytest.approx(found.force, abs=1e-12)
    assert -force[half:].sum(axis=0) == pytest.approx(-found.force, abs=1e-12)


def test_plates_apart_do_not_press_and_the_gap_is_told_within_reach():
    for gap, told in ((0.05, 0.05), (0.19, 0.19), (0.3, 0.2)):
        mesh = plates(gap)
        found, force = pressing(Contact(mesh, "low", "high", 200.0, reach=0.2), mesh.points)
        assert found[:3] == (0.0, 0.0, 0.0)
        assert not force.any()
        assert found.gap == pytest.approx(told, rel=1e-12)


def test_points_farther_than_the_reach_are_left_alone():
    """Plates that open like a mouth: what is kept of either is what is closer than the reach, neither more nor less."""
    mesh = plates(0.05, cells=16, slope=0.5)
    contact = Contact(mesh, "low", "high", 1.0, reach=0.2)
    pressing(contact, mesh.points)
    normal = np.array([-0.5, 0.0, 1.0]) / np.sqrt(1.25)
    for side in contact.sides:
        points = side.points
        x = np.einsum("mb,mbi->mi", points.shares, mesh.points[points.supports])
        # From below to the tilted plane, or from above straight down.
        below = np.allclose(x[:, 2], 0.0)
        distance = (np.array([0.0, 0.0, 0.05]) - x) @ normal if below else x[:, 2]
        kept = np.isin(np.arange(len(x)), side.near)
        # The foot of the perpendicular lies on the other plate but at its ends.
        inner = (x[:, 0] > 0.2) & (x[:, 0] < 0.9)
        assert kept[inner & (distance < 0.199)].all()
        assert not kept[distance > 0.201].any()
        assert (inner & kept).any() and not kept.all()


@pytest.mark.parametrize("step", [0.3, 0.7, 0.95])
def test_surfaces_that_both_approach_are_found_in_time(step):
    """Just out of reach when searched, each then moves in steps of less and of more than half the reach."""
    reach, gap = 0.1, 0.101
    mesh = plates(gap)
    contact = Contact(mesh, "low", "high", 200.0, reach=reach)
    pressing(contact, mesh.points)
    half = len(mesh.points) // 2
    nodes = mesh.points.copy()
    nodes[:half, 2] += step * reach
    nodes[half:, 2] -= step * reach
    depth = 2.0 * step * reach - gap
    found, _ = pressing(contact, nodes)
    assert found.normal_force == pytest.approx(200.0 * max(depth, 0.0), rel=1e-9)


def test_the_search_is_not_repeated_before_surfaces_have_moved(monkeypatch):
    mesh = plates(0.05)
    contact = Contact(mesh, "low", "high", 200.0, reach=0.1)
    searches = []
    for side in contact.sides:
        true = side.search
        monkeypatch.setattr(side, "search", lambda *given, true=true: (searches.append(1), true(*given)))
    for shift, count in ((0.0, 2), (0.04, 2), (0.049, 2), (0.051, 4), (0.1, 4), (0.102, 6)):
        pressing(contact, mesh.points + np.array([shift, 0.0, 0.0]))
        assert len(searches) == count, shift


@pytest.mark.parametrize("parts", [1, 2, 3])
def test_points_on_a_face_lie_on_it(parts):
    mesh = plates(0.0, cells=2)
    supports, shares = surface_points(mesh, "high", parts)
    x = np.einsum("mb,mbi->mi", shares, mesh.points[supports])
    assert len(x) == 4 * (parts + 1) ** 2
    assert shares.sum(axis=1) == pytest.approx(1.0)
    lattice = np.unique(x.round(12), axis=0)
    assert len(lattice) == (2 * parts + 1) ** 2
    assert np.unique(x[:, 0].round(12)) == pytest.approx(np.linspace(0.0, 1.0, 2 * parts + 1))
