"""Meshes and facet tags from XDMF files, by dolfinx's reader, complete on each rank."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from dolfinx.io import XDMFFile
from mpi4py import MPI

from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.fenics import compat
from isorod.fenics.groups import corners


def mesh(path: Path, hdf: bool, name: str, shape: str, degree: int) -> tuple[Array, Index]:
    """Return points ``(n, 3)``, and the cells of a grid by their nodes in gmsh's order ``(c, m)``.

    Parameters
    ----------
    path, hdf
        The file, and whether numbers are in the ``.h5`` file beside it.
    name, shape, degree
        The grid, the type of its cells, and the degree of their geometry.

    Raises
    ------
    InputError
        If it cannot be read, or is damaged.
    """
    with _open(path, hdf) as file:
        nodes, points = file.read_topology_data(name), _points(file, name)
        _check(nodes, len(points), name)
    # dolfinx' tags cannot have points outside cells.
    loose = len(points) - len(np.unique(nodes))
    if loose:
        raise InputError(
            f"grid {name}: {loose:,} of its {len(points):,} points are in no cell; leave them out, as meshio's "
            "remove_orphaned_nodes does"
        )
    cells = np.empty_like(nodes)
    cells[:, compat.gmsh_order(shape, nodes.shape[1])] = nodes
    return points, cells


def facets(
    path: Path, hdf: bool, name: str, own: bool, points: Array, cells: Index, shape: str, degree: int
) -> tuple[Index, Index]:
    """Return the corners ``(f, 3 or 4)`` and numbers ``(f,)`` of the facets of a grid on a mesh.

    Parameters
    ----------
    own
        Whether the grid has its own points, which must be those of the mesh.
    points, cells, shape, degree
        The mesh, as `mesh` returns it.

    Raises
    ------
    InputError
        If it cannot be read, is damaged, or facets do not belong to the mesh.
    """
    with _open(path, hdf) as file:
        nodes = file.read_topology_data(name)
        if own and not np.array_equal(_points(file, name), points):
            raise InputError(f"grid {name}: its points are not those of the mesh; write both with the same points")
        _check(nodes, len(points), name)
        domain = compat.create_mesh(
            MPI.COMM_SELF, cells[:, compat.gmsh_order(shape, cells.shape[1])], points, shape, degree
        )
        for low, high in ((2, 3), (3, 2)):
            compat.links(domain, low, high)
        tags = file.read_meshtags(domain, name)
    distinct = len(np.unique(np.sort(nodes, axis=1), axis=0))
    if distinct < len(nodes):
        raise InputError(f"grid {name}: {len(nodes) - distinct:,} of its {len(nodes):,} facets are there twice")
    if len(tags.indices) < distinct:
        raise InputError(
            f"grid {name}: {distinct - len(tags.indices):,} of its {distinct:,} facets are none of the mesh"
        )
    return corners(domain, np.asarray(tags.indices, dtype=np.int64)), np.asarray(tags.values, dtype=np.int64)


def _points(file: Any, name: str) -> Array:
    points = np.asarray(file.read_geometry_data(name), dtype=float)
    if not np.isfinite(points).all():
        raise InputError(f"grid {name}: point {np.argmin(np.isfinite(points).all(axis=1))} is not finite")
    return points


def _check(nodes: Index, count: int, name: str) -> None:
    """Raise `InputError` if cells have nodes that do not exist."""
    if not nodes.size or nodes.min() < 0 or nodes.max() >= count:
        raise InputError(f"grid {name}: it has nodes that are none of its {count:,} points")


@contextmanager
def _open(path: Path, hdf: bool) -> Iterator[Any]:
    """Open a file for this rank alone, without HDF5's messages on bad files."""
    encoding = XDMFFile.Encoding.HDF5 if hdf else XDMFFile.Encoding.ASCII
    sys.stderr.flush()
    stderr, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        with XDMFFile(MPI.COMM_SELF, str(path), "r", encoding) as file:
            yield file
    except InputError:
        raise
    except (RuntimeError, ValueError, IndexError, MemoryError) as problem:
        message = (str(problem).splitlines() or ["damaged"])[0]
        raise InputError(f"dolfinx cannot read it: {message}") from None
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(null)
