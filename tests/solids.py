"""Small finite element bodies: boxes, and sectors of a round hole, of cells of any order."""

from itertools import permutations

import dolfinx.fem
import dolfinx.mesh
import numpy as np
import ufl
from mpi4py import MPI

from isorod.fenics import compat
from isorod.fenics.flags import FAST
from isorod.fenics.solid import Solid
from isorod.material import NeoHookean

SHAPES = ("tetrahedron", "hexahedron")
LAW = NeoHookean(E=2.0, nu=0.3)
SIZES = np.array([1.0, 2.0, 0.5])


def mesh(shape, counts=(3, 4, 2), order=1, place=None, comm=MPI.COMM_WORLD):
    """Return a lattice of bricks, or of six tetrahedra each, on the unit cube, its nodes put elsewhere by ``place``."""
    steps = order * np.array(counts)
    ticks = np.stack(np.meshgrid(*[np.arange(n + 1) for n in steps], indexing="ij"), axis=-1).reshape(-1, 3)
    points = ticks / steps
    corners = order * np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), axis=-1).reshape(-1, 3)
    reference = compat.reference_nodes(shape, order)
    if shape == "hexahedron":
        maps = [np.eye(3)]
    else:
        # Edges of Kuhn's tetrahedra: along the axes in all orders.
        paths = [np.eye(3)[list(one)].cumsum(axis=0) for one in permutations(range(3))]
        maps = [path if np.linalg.det(path) > 0.0 else path[[1, 0, 2]] for path in paths]
    offsets = np.concatenate([np.rint(order * reference @ one)[None] for one in maps]).astype(int)
    nodes = corners[:, None, None] + offsets
    numbers = np.ravel_multi_index(np.moveaxis(nodes, -1, 0), steps + 1).reshape(-1, len(reference))
    # One rank gives the cells.
    numbers = numbers if comm.rank == 0 else numbers[:0]
    points = points if place is None else place(points)
    points = points if comm.rank == 0 else points[:0]
    return compat.create_mesh(comm, numbers.astype(np.int64), np.ascontiguousarray(points), shape, order)


def box(points):
    return SIZES * points


def sector(points):
    """A quarter of a thick tube about z: radii 1 to 2, height 1."""
    radius, angle = 1.0 + points[:, 0], 0.5 * np.pi * points[:, 1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), points[:, 2]], axis=1)


def space(domain, degree):
    return compat.function_space(domain, compat.element(domain, "Lagrange", degree, 3))


def solid(shape="tetrahedron", degree=1, order=1, place=box, counts=(3, 4, 2), comm=MPI.COMM_WORLD, **keywords):
    """Return a body on such a mesh."""
    return Solid(space(mesh(shape, counts, order, place, comm), degree), **keywords)


def gathered(comm, own):
    """Return what each rank has of the nodes, of all of these."""
    return np.concatenate(comm.allgather(own))


def boundary(domain):
    """Return all facets of the surface."""
    return compat.exterior_facets(domain).astype(np.int32)


def where(domain, condition):
    """Return facets of the surface whose vertices are where a function of positions ``(3, n)`` says."""
    return dolfinx.mesh.locate_entities_boundary(domain, 2, condition)


def times(matrix, own):
    """Return this rank's entries of a matrix times a vector."""
    x, y = matrix.createVecs()
    x.array[:] = own
    matrix.mult(x, y)
    return y.array.copy()


def volume(domain):
    """Return the form of a mesh's volume, exact of its polynomial cells."""
    one = dolfinx.fem.Constant(domain, 1.0)
    return compat.form(one * ufl.dx(metadata={"quadrature_degree": 8}), FAST)
