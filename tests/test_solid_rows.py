"""Rows of bodies at points: linear fields, nearest points, curved cells, ranks; quadrature on their surfaces."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import dolfinx.mesh
import solids
from mpi4py import MPI
from refused import refused
from solids import SHAPES, SIZES, box, mesh, sector, space, where

from isorod.fenics.boxes import Boxes
from isorod.fenics.surface import Surface

# Shape of cells, their degree, that of the space, and where they are.
KINDS = [(shape, 1, degree, box) for shape in SHAPES for degree in (1, 2, 3)]
KINDS += [(shape, 2, degree, sector) for shape in SHAPES for degree in (2, 3)]


def bent(points):
    """Straight edges on warped faces."""
    x, y, z = points.T
    return np.stack([x + 0.2 * y * z, y - 0.1 * x * z, z + 0.3 * x * y], axis=1)


class Body:
    """The surface of a body, and its nodes' positions on all ranks."""

    def __init__(self, shape, order, degree, place, counts=(3, 4, 2), comm=MPI.COMM_WORLD):
        self.mesh = mesh(shape, counts, order, place, comm)
        self.space = space(self.mesh, degree)
        self.surface = Surface(self.space)
        own = self.space.dofmap.index_map.size_local
        self.x = solids.gathered(self.mesh.comm, self.space.tabulate_dof_coordinates()[:own])

    def rows(self, points, facets=None):
        return self.surface.rows(np.asarray(points, dtype=float), facets)

    def values(self, rows, field):
        return np.einsum("qm,qma->qa", rows.values, field(self.x)[rows.nodes])


@pytest.fixture(scope="module", params=[*KINDS, ("hexahedron", 1, 1, bent)], ids=lambda kind: f"{kind[:3]}")
def body(request):
    return Body(*request.param)


def linear(x, seed=5):
    random = np.random.default_rng(seed)
    return x @ random.normal(size=(3, 3)) + random.normal(size=3)


def points_about(body, count=2000, seed=1):
    low, high = body.x.min(axis=0), body.x.max(axis=0)
    return np.random.default_rng(seed).uniform(low - 0.4, high + 0.4, (count, 3))


def test_linear_fields_are_reproduced_within_and_outside(body):
    points = points_about(body)
    for facets in (None, solids.boundary(body.mesh), solids.boundary(body.mesh)[::5]):
        rows = body.rows(points, facets)
        assert np.abs(body.values(rows, linear) - linear(points)).max() < 1e-11
        assert rows.values.sum(axis=1) == pytest.approx(np.ones(len(points)), abs=1e-12)
        assert 0.0 < rows.gap.max() and rows.gap.min() == 0.0


def test_shape_functions_at_their_own_nodes_are_one_and_nothing(body):
    rows = body.rows(body.x)
    dense = np.zeros((len(body.x), len(body.x)))
    np.add.at(dense, (np.arange(len(body.x))[:, None], rows.nodes), rows.values)
    assert np.abs(dense - np.eye(len(body.x))).max() < 1e-10
    assert rows.gap.max() < 1e-14


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_polynomials_of_the_space_have_their_values(shape, degree):
    body = Body(shape, 1, degree, box)

    def field(x):
        return np.stack([x[:, 0] ** degree, x[:, 1] ** (degree - 1) * x[:, 2], x[:, 2] ** degree], axis=1)

    points = np.random.default_rng(2).uniform(0.0, SIZES, (500, 3))
    assert np.abs(body.values(body.rows(points), field) - field(points)).max() < 1e-12


def test_the_gap_of_a_box_is_the_distance_from_it():
    points = np.random.default_rng(3).uniform(-1.0, SIZES + 1.0, (3000, 3))
    for shape in SHAPES:
        body = Body(shape, 1, 1, box)
        from_box = np.linalg.norm(points - np.clip(points, 0.0, SIZES), axis=1)
        assert np.abs(body.rows(points).gap - from_box).max() < 1e-14
        top = where(body.mesh, lambda x: x[2] > SIZES[2] - 1e-9)
        rows = body.rows(points, top)
        nearest = np.clip(points, 0.0, SIZES)
        nearest[:, 2] = SIZES[2]
        # Within cells that carry facets there is no gap: the upper layer of bricks.
        away = np.where(rows.gap > 0.0, np.linalg.norm(points - nearest, axis=1), 0.0)
        assert np.abs(rows.gap - away).max() < 1e-14
        upper = (points > [0.0, 0.0, 0.5 * SIZES[2]]).all(axis=1) & (points < SIZES).all(axis=1)
        if shape == "hexahedron":
            assert ((rows.gap == 0.0) == upper).all() and upper.sum() > 10


@pytest.mark.parametrize(("shape", "order"), [(shape, order) for shape in SHAPES for order in (1, 2, 3)])
def test_the_nearest_point_of_a_hole_is_found(shape, order):
    """The gap is the distance from the cells' own surface, which approaches the round one with their degree."""
    wrong = []
    for n in (2, 4):
        body = Body(shape, order, order, sector, counts=(1, n, 2))
        hole = where(body.mesh, lambda x: np.hypot(x[0], x[1]) < 1.0 + 1e-9)
        assert len(hole) == (2 * n if shape == "hexahedron" else 4 * n)
        random = np.random.default_rng(4)
        angle, radius, z = (
            random.uniform(0.02, 1.55, 800),
            random.uniform(0.3, 0.85, 800),
            random.uniform(0.0, 1.0, 800),
        )
        points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
        rows = body.rows(points, hole)
        assert np.abs(body.values(rows, linear) - linear(points)).max() < 1e-10
        assert (rows.gap > 0.0).all()
        # Nothing of the surface is nearer than what was found, and some of it is as near.
        dense = dense_facets(body, hole)
        nearest = np.array([np.linalg.norm(dense - one, axis=1).min() for one in points])
        assert (rows.gap < nearest + 1e-12).all() and np.abs(rows.gap - nearest).max() < 2e-3
        wrong.append(np.abs(rows.gap - (1.0 - radius)).max())
    assert np.log2(wrong[0] / wrong[1]) > {1: 1.7, 2: 2.7, 3: 3.5}[order]


def dense_facets(body, facets):
    """Return many points of facets."""
    cells = body.surface._cells
    carrier, face = body.surface._places(np.sort(facets).astype(np.int64))
    ticks = np.linspace(0.0, 1.0, 41)
    s = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    s = s[s.sum(axis=1) <= 1.0 + 1e-9] if cells.simplex else s
    X = cells.on_faces(np.repeat(face, len(s)), np.tile(s, (len(face), 1)))
    return cells.at(np.repeat(carrier, len(s)), X)[0]


def test_a_row_across_a_gap_turns_with_the_body():
    """Second-order cells: a field that is linear is one across any gap, others are extrapolated by their gradients."""
    body = Body("hexahedron", 1, 2, box)
    top = where(body.mesh, lambda x: x[2] > SIZES[2] - 1e-9)
    points = np.random.default_rng(6).uniform([0.1, 0.1, SIZES[2]], [0.9, 1.9, SIZES[2] + 0.2], (100, 3))
    height = points[:, 2] - SIZES[2]
    rows = body.rows(points, top)
    got = body.values(rows, lambda x: np.repeat(x[:, 2:] ** 2, 3, axis=1))[:, 0]
    assert got == pytest.approx(SIZES[2] ** 2 + 2.0 * SIZES[2] * height, abs=1e-12)
    assert rows.gap == pytest.approx(height, abs=1e-14)


def test_a_corner_whose_edges_are_tangent_has_rows():
    """A square made a disk: the cell's map has no inverse at a corner, which lies on the rim."""

    def disk(points):
        a, b = 2.0 * points[:, 0] - 1.0, 2.0 * points[:, 1] - 1.0
        return np.stack([a * np.sqrt(1.0 - 0.5 * b**2), b * np.sqrt(1.0 - 0.5 * a**2), points[:, 2]], axis=1)

    body = Body("hexahedron", 2, 2, disk, counts=(1, 1, 1))
    corner = np.sqrt(0.5) * np.array([1.0, 1.0, 0.0])
    points = np.array([1.0, 1.001, 1.3])[:, None] * corner + [0.0, 0.0, 0.4]
    rows = body.rows(points)
    assert np.isfinite(rows.values).all()
    assert np.abs(body.values(rows, linear) - linear(points)).max() < 1e-9


def test_many_points_of_thin_and_unequal_cells():
    """Points are found in the cell they are in, of cells a thousand times as long as thick that grow a hundredfold."""

    def graded(points):
        return points**3 * [1.0, 1.0, 1e-3]

    body = Body("tetrahedron", 1, 1, graded, counts=(8, 8, 8), comm=MPI.COMM_SELF)
    points = np.random.default_rng(7).uniform(0.0, [1.0, 1.0, 1e-3], (5000, 3))
    rows = body.rows(points)
    assert rows.gap.max() == 0.0
    assert rows.values.min() > -1e-7
    assert np.abs(body.values(rows, linear) - linear(points)).max() < 1e-12


@pytest.mark.parametrize("shape", SHAPES)
def test_a_body_far_from_the_origin_has_no_gaps_between_its_cells(shape):
    away = np.array([3e7, -1e7, 2e7])
    body = Body(shape, 1, 1, lambda points: away + points, counts=(6, 6, 6), comm=MPI.COMM_SELF)
    x = np.random.default_rng(10).uniform(size=(5000, 3))
    # On faces between cells.
    x[:, 0] = np.round(6.0 * x[:, 0]) / 6.0
    rows = body.rows(away + x)
    assert rows.gap.max() < 1e-7
    assert np.abs(body.values(rows, lambda y: linear(y - away)) - linear(x)).max() < 1e-6


def test_boxes_near_points_are_all_found():
    random = np.random.default_rng(8)
    for count in (1, 2, 3, 7, 64, 101):
        low = random.uniform(size=(count, 3))
        high = low + random.uniform(0.0, 0.3, (count, 3))
        points, reach = random.uniform(-0.5, 1.5, (50, 3)), random.uniform(0.0, 0.5, 50)
        away = np.maximum(np.maximum(low - points[:, None], points[:, None] - high), 0.0)
        expected = np.argwhere(np.linalg.norm(away, axis=2) <= reach[:, None])
        found = np.stack(Boxes(low, high).within(points, reach), axis=1)
        assert found[np.lexsort(found.T[::-1])].tolist() == expected.tolist()


def test_the_trace_of_a_box_is_its_area_and_normals(body):
    trace = body.surface.trace(solids.boundary(body.mesh))
    assert np.linalg.norm(trace.normals, axis=1) == pytest.approx(1.0, abs=1e-12)
    # The divergence theorem: of a constant field nothing goes out, of position three times the volume.
    flux = trace.weights[:, None] * trace.normals
    assert np.abs(flux.sum(axis=0)).max() < 1e-12
    volume = dolfinx.fem.assemble_scalar(solids.volume(body.mesh))
    assert (flux * trace.points).sum() == pytest.approx(3.0 * volume, rel=1e-10)
    # Shape functions that are left out vanish.
    assert (
        np.abs(np.einsum("qm,qma->qa", trace.values, linear(body.x)[trace.nodes]) - linear(trace.points)).max() < 1e-12
    )
    # No node has rows elsewhere than on its facets.
    on_surface = body.rows(trace.points)
    full, less = np.zeros((2, len(trace.points), len(body.x)))
    np.add.at(full, (np.arange(len(full))[:, None], on_surface.nodes), on_surface.values)
    np.add.at(less, (np.arange(len(less))[:, None], trace.nodes), trace.values)
    assert np.abs(full - less).max() < 1e-9


@pytest.mark.parametrize("shape", SHAPES)
def test_the_area_of_a_hole_converges(shape):
    wrong = []
    for n in (2, 4):
        body = Body(shape, 2, 2, sector, counts=(1, n, 1))
        trace = body.surface.trace(where(body.mesh, lambda x: np.hypot(x[0], x[1]) < 1.0 + 1e-9))
        assert (np.einsum("qa,qa->q", trace.normals[:, :2], trace.points[:, :2]) < -0.99).all()
        wrong.append(abs(trace.weights.sum() - 0.5 * np.pi))
    assert wrong[1] < 1e-4 and np.log2(wrong[0] / wrong[1]) > 3.5


def answers(path):
    """Return rows and a trace of a field, which do not depend on how the body is distributed."""
    body = Body("tetrahedron", 2, 2, sector, counts=(4, 4, 3))
    points = points_about(body, 3000, 9)

    def field(x):
        return np.sin(x * [1.0, 2.0, 3.0])

    found = []
    # One facet set is on few ranks.
    for facets in (None, where(body.mesh, lambda x: np.hypot(x[0], x[1]) < 1.0 + 1e-9)):
        rows = body.rows(points, facets)
        found += [rows.gap[:, None], body.values(rows, field)]
    trace = body.surface.trace(solids.boundary(body.mesh))
    table = np.column_stack(
        [trace.points, trace.normals, trace.weights, np.einsum("qm,qma->qa", trace.values, field(body.x)[trace.nodes])]
    )
    table = table[np.lexsort(np.round(table[:, :3], 9).T)]
    # All ranks have the same.
    every = body.mesh.comm.allgather(np.concatenate([rows.values.ravel(), trace.values.ravel()]))
    assert all((one == every[0]).all() for one in every)
    return np.concatenate([one.ravel() for one in (*found, table)])


def agree(path):
    if MPI.COMM_WORLD.size == 1:
        np.save(path, answers(path))
        return
    got, expected = answers(path), np.load(path)
    # Where two cells are as near, another may answer: gaps are the same, values of the curved field alike.
    different = np.abs(got - expected) > 1e-9
    assert different.mean() < 0.01, different.mean()


@pytest.mark.mpi
def test_ranks_agree(on_ranks, tmp_path):
    agree(tmp_path / "alone.npy")
    on_ranks(2, f"test_solid_rows.agree({str(tmp_path / 'alone.npy')!r})")


def small():
    return solids.solid("tetrahedron", counts=(1, 1, 1), law=solids.LAW)


def inner(body):
    """Return all facets, those within the mesh too."""
    tables = body.space.mesh.topology
    tables.create_entities(2)
    return np.arange(tables.index_map(2).size_local)


test_points_and_facets_that_cannot_be = refused(
    (lambda: small().rows([1.0, 2.0, 3.0]), "points: got shape (3,), need finite positions, shape (q, 3)"),
    (lambda: small().rows([[np.nan, 0.0, 0.0]]), "points: got shape (1, 3), need finite positions"),
    (lambda: small().rows([["a", 0.0, 0.0]]), "points: got .*need numbers"),
    (lambda: small().rows([[0.0, 0.0, 0.0]], []), "facets of the solid: there is none on any rank"),
    (lambda: small().trace([]), "facets of the solid: there is none on any rank"),
    (lambda: small().trace(inner(small())), "6 of 18 are inside of the mesh, need those of its surface"),
    (lambda: small().trace([500]), "facets of the solid: got 500, need whole numbers from 0 to 17"),
    (lambda: small().trace([-1]), "facets of the solid: got -1, need whole numbers from 0 to 17"),
    (lambda: small().trace([0.5]), "facets of the solid: got 0.5, need whole numbers from 0 to 17"),
)


def test_no_points_have_no_rows():
    rows = small().rows(np.empty((0, 3)))
    assert rows.nodes.shape == rows.values.shape == (0, 4) and rows.gap.shape == (0,)
