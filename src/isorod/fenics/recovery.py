"""Error estimate of a finite element body by the difference of its strains from recovered ones.

Displacement gradients are averaged at nodes, weighted by the volumes of cells, and the averages interpolated
(Zienkiewicz and Zhu, Int. J. Numer. Meth. Engng. 24 (1987) 337-357).
"""

from typing import NamedTuple

import basix
import numpy as np
from mpi4py import MPI

from isorod.arrays import Array
from isorod.fenics.cells import Cells, tabulated
from isorod.material.law import Material
from isorod.tensors import inverse

# Factors from the work of the difference to that of the error, by the degree of displacements.  In smooth solutions the
# averages of linear elements give all of it, those of others less; beside edges of rods, where stresses are singular,
# both give two or three fifths (measured: `comparisons.joints.recovered`).
_LINEAR, _OTHERS = 1.5, 2.2

# Gradients at nodes are taken nearer to a cell's centre by this fraction: a curved cell may be flat at a corner.
_INWARD = 0.01

# Largest gradient at which differences of stresses approximate those by the tangent.
_SLIGHT = 1e-6

# Cells at a time.
_AT_ONCE = 4000


class Recovered(NamedTuple):
    """The estimate for a body.

    Attributes
    ----------
    work
        Work of the stress's error on the strain's, over the body: twice the energy of the error.
    place
        Point of the largest contribution, shape ``(3,)``.
    """

    work: float
    place: Array


def recovered(
    cells: Cells, moved: Array, nodes: int, law: Material, comm: MPI.Comm, about: Array | None = None
) -> Recovered:
    """Return the estimate for a body with a law; collective.

    Parameters
    ----------
    cells
        This rank's cells.
    moved
        Displacements of their nodes, shape ``(cells, m, 3)``.
    nodes
        Number of all nodes.
    about
        Displacements about which ``moved`` are small motions, ``(cells, m, 3)``: the work is then that of the
        tangent's stresses.
    """
    kind, degree = cells.element.cell_type, cells.element.degree
    X, w = (np.asarray(item) for item in basix.make_quadrature(kind, 2 * degree)[:2])
    means = averages(cells, moved, nodes, comm)
    table, work = tabulated(cells.element, 0, X)[0], np.zeros(len(cells.x))
    for part in _parts(cells):
        gradients, sizes = _gradients(cells, moved, part, X)
        smooth = np.einsum("qm,cmab->cqab", table, means[cells.nodes[part]])
        state, scale = np.eye(3), 1.0
        if about is not None:
            state = state + _gradients(cells, about, part, X)[0]
            scale = _SLIGHT / max(np.abs(gradients).max(), np.abs(smooth).max(), np.finfo(float).tiny)
        stress = law.stress(state + scale * smooth) - law.stress(state + scale * gradients)
        work[part] = np.einsum("cqab,cqab,cq,q->c", stress, smooth - gradients, sizes, w) / scale
    worst = int(np.argmax(work)) if len(work) else 0
    local = (float(work[worst]), cells.x[worst].mean(axis=0)) if len(work) else (-np.inf, np.zeros(3))
    place = max(comm.allgather(local), key=lambda item: item[0])[1]
    factor = _LINEAR if degree == 1 else _OTHERS
    return Recovered(factor * float(comm.allreduce(work.sum(), op=MPI.SUM)), place)


def averages(cells: Cells, moved: Array, nodes: int, comm: MPI.Comm) -> Array:
    """Return the displacement gradients at all nodes, averages over cells by their volumes, ``(nodes, 3, 3)``."""
    X, w = (np.asarray(array) for array in basix.make_quadrature(cells.element.cell_type, 2 * cells.element.degree)[:2])
    points = np.asarray(cells.element.points)
    at_nodes = points + _INWARD * (cells.middle - points)
    sums, volumes = np.zeros((nodes, 3, 3)), np.zeros(nodes)
    for part in _parts(cells):
        volume = _gradients(cells, moved, part, X)[1] @ w
        gradients = _gradients(cells, moved, part, at_nodes)[0]
        numbers = cells.nodes[part]
        np.add.at(sums, numbers, gradients * volume[:, None, None, None])
        np.add.at(volumes, numbers, np.repeat(volume[:, None], numbers.shape[1], axis=1))
    comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
    comm.Allreduce(MPI.IN_PLACE, volumes, op=MPI.SUM)
    return np.asarray(sums / volumes[:, None, None])


def _parts(cells: Cells) -> list[slice]:
    return [slice(k, k + _AT_ONCE) for k in range(0, len(cells.x), _AT_ONCE)]


def _gradients(cells: Cells, moved: Array, part: slice, X: Array) -> tuple[Array, Array]:
    """Return displacement gradients ``(c, q, 3, 3)`` of some cells at reference points, and volumes ``(c, q)``."""
    jacobian = np.einsum("dqn,cna->cqad", tabulated(cells.geometry, 1, X)[1:], cells.x[part])
    back, determinant = inverse(jacobian)
    slopes = np.einsum("dqm,cma->cqad", tabulated(cells.element, 1, X)[1:], moved[part])
    return slopes @ back, np.abs(determinant)
