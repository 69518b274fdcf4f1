"""References for bodies of revolution under ``cos(n theta)``: Fourier finite elements on half of the meridian plane.

They are of their own: no dolfinx, no rod.  Displacements are

``(v cos n theta, (r w - n v) sin n theta, z cos n theta)``, which for n = 0 and 1 is smooth on the axis.  Squares of
high degree are graded to all edges at which stresses are singular.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI
from numpy.polynomial import legendre
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import coo_array

Array = NDArray[np.float64]

# Of the cells next to a singular edge, in those before.
_RATIO = 0.15

# Poisson's ratio of rods on blocks and in sleeves.
_NU = 0.3


class Block(NamedTuple):
    """A rectangle ``r, z`` of the meridian plane with its Young's modulus and Poisson's ratio."""

    r: tuple[float, float]
    z: tuple[float, float]
    E: float
    nu: float


class Load(NamedTuple):
    """A harmonic, and tractions along ``r, theta, z`` by the radius, on ``r < radius`` of the plane ``z``."""

    n: int
    z: float
    radius: float
    traction: Callable[[Array], tuple[Any, Any, Any]]


class Held(NamedTuple):
    """A part of the boundary, by a marker of ``(r, z)``, and which of ``r, t, z`` are held there."""

    where: Callable[[Array], Any]
    components: str


def graded(marks: Array, layers: int, singular: Sequence[float]) -> Array:
    """Return breaks between marks, with layers of cells graded towards singular marks."""
    ticks = [marks]
    for low, high in pairwise(marks):
        both = low in singular and high in singular
        size = (high - low) * (0.5 if both else 1.0)
        steps = size * _RATIO ** np.arange(0 if both else 1, layers + 1)
        if low in singular:
            ticks.append(low + steps)
        if high in singular:
            ticks.append(high - steps)
    return np.unique(np.concatenate(ticks).round(12))


class Meridian:
    """A body of revolution.

    Parameters
    ----------
    blocks
        Its rectangles.
    held
        Supports.
    singular
        Radii and heights of edges to which cells are graded.
    degree, layers
        Of the elements, and of cells towards each edge.
    """

    def __init__(
        self,
        blocks: Sequence[Block],
        held: Sequence[Held],
        singular: tuple[Sequence[float], Sequence[float]],
        degree: int = 6,
        layers: int = 5,
    ) -> None:
        self._r, self._z = (
            graded(np.unique([edge for block in blocks for edge in (block.r, block.z)[axis]]), layers, singular[axis])
            for axis in range(2)
        )
        cells, constants = [], []
        for i in range(len(self._r) - 1):
            for j in range(len(self._z) - 1):
                middle = self._r[i : i + 2].mean(), self._z[j : j + 2].mean()
                for block in blocks:
                    if all(low < one < high for one, (low, high) in zip(middle, block[:2], strict=True)):
                        cells.append((i, j))
                        constants.append((block.E, block.nu))
        self._cells, (E, nu) = np.array(cells), np.array(constants).T
        self._lam, self._mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
        self._held, self.degree = held, degree
        self._nodes = _lobatto(degree)
        lines = [_between(one, self._nodes) for one in (self._r, self._z)]
        wide = len(lines[1])
        local = np.arange(degree + 1)
        rows = self._cells[:, :1] * degree + local, self._cells[:, 1:] * degree + local
        used, inverse = np.unique(rows[0][:, :, None] * wide + rows[1][:, None, :], return_inverse=True)
        self.numbers = inverse.reshape(len(cells), -1)
        self.points = np.stack([lines[0][used // wide], lines[1][used % wide]], axis=1)

    def compliance(self, load: Load) -> float:
        """Return the displacement conjugate to a unit load: the load's work on its displacements."""
        force = self._force(load)
        return float(force @ self.solve(load))

    def solve(self, load: Load) -> Array:
        """Return ``v, w, z`` of all nodes under a load, shape ``(3 nodes,)``."""
        matrix, force = self._matrix(load.n), self._force(load)
        free = np.setdiff1d(np.arange(len(force)), self._fixed(load.n))
        inner = matrix[free][:, free].tocsr()
        inner.sort_indices()
        places = inner.indptr.astype(PETSc.IntType), inner.indices.astype(PETSc.IntType)
        made = PETSc.Mat().createAIJ(inner.shape, csr=(*places, inner.data), comm=MPI.COMM_SELF)
        solver = PETSc.KSP().create(MPI.COMM_SELF)
        solver.setOperators(made)
        solver.setType("preonly")
        solver.getPC().setType("lu")
        solver.getPC().setFactorSolverType("mumps")
        x, b = made.createVecs()
        b.array[:] = force[free]
        solver.solve(b, x)
        result = np.zeros(len(force))
        result[free] = x.array
        return result

    def _tables(self, cell: slice) -> tuple[Array, Array, Array, Array, Array]:
        """Return functions, their slopes along r and z, radii and areas at the points of cells ``(c, q, m)``."""
        s, w = legendre.leggauss(self.degree + 2)
        value, slope = _lagrange(self._nodes, s)
        i, j = self._cells[cell].T
        dr, dz = np.diff(self._r)[i] / 2, np.diff(self._z)[j] / 2
        radius = self._r[i][:, None] + dr[:, None] * (1 + s)
        across, up, both = (
            np.einsum("qa,pb->qpab", one, other).reshape(len(s) ** 2, -1)
            for one, other in ((slope, value), (value, slope), (value, value))
        )
        weights = (w[:, None] * w).ravel() * (dr * dz)[:, None]
        return both, across / dr[:, None, None], up / dz[:, None, None], np.repeat(radius, len(s), axis=1), weights

    def _matrix(self, n: int) -> Any:
        """Return the stiffness matrix of a harmonic."""
        angle = 2 * np.pi if n == 0 else np.pi
        rows, columns, values = [], [], []
        for first in range(0, len(self._cells), 32):
            part = slice(first, first + 32)
            both, across, up, radius, weights = self._tables(part)
            r = radius[..., None]
            none = np.zeros_like(across)
            # Strains rr, tt, zz and twice rt, rz, tz of v, w, z; the tangential displacement is r w - n v.
            strain = np.stack(
                [
                    np.stack([across, none, none], axis=-1),
                    np.stack([(1 - n * n) * both / r, n * both + none, none], axis=-1),
                    np.stack([none, none, up], axis=-1),
                    np.stack([-n * across, r * across, none], axis=-1),
                    np.stack([up, none, across], axis=-1),
                    np.stack([-n * up, r * up, -n * both / r], axis=-1),
                ],
                axis=2,
            )
            size = strain.shape
            strain = strain.reshape(*size[:3], -1)
            lam, mu = self._lam[part], self._mu[part]
            law = np.zeros((len(lam), 6, 6))
            law[:, :3, :3] = lam[:, None, None]
            law[:, range(6), range(6)] += mu[:, None] * [2, 2, 2, 1, 1, 1]
            stress = (angle * weights * radius)[..., None, None] * np.einsum("cij,cqjm->cqim", law, strain)
            flat = (len(lam), size[1] * 6, -1)
            values.append((strain.reshape(flat).transpose(0, 2, 1) @ stress.reshape(flat)).ravel())
            dofs = (3 * self.numbers[part][:, :, None] + np.arange(3)).reshape(len(lam), -1)
            rows.append(np.repeat(dofs, dofs.shape[1], axis=1).ravel())
            columns.append(np.tile(dofs, dofs.shape[1]).ravel())
        count = 3 * len(self.points)
        parts = [np.concatenate(one) for one in (values, rows, columns)]
        return coo_array((parts[0], (parts[1], parts[2])), shape=(count, count)).tocsr()

    def _force(self, load: Load) -> Array:
        """Return the work of a load on each function."""
        s, w = legendre.leggauss(self.degree + 2)
        value = _lagrange(self._nodes, s)[0]
        result = np.zeros((len(self.points), 3))
        for (i, j), numbers in zip(self._cells, self.numbers, strict=True):
            on = [k for k in (0, 1) if np.isclose(self._z[j + k], load.z)]
            if not on or self._r[i + 1] > load.radius * (1 + 1e-9):
                continue
            dr = (self._r[i + 1] - self._r[i]) / 2
            r = self._r[i] + dr * (1 + s)
            radial, tangential, axial = (np.broadcast_to(one, r.shape) for one in load.traction(r))
            density = np.stack([radial - load.n * tangential, r * tangential, axial], axis=1)
            angle = 2 * np.pi if load.n == 0 else np.pi
            work = value.T @ (density * (angle * dr * w * r)[:, None])
            # The nodes of a cell are column by column.
            result[numbers.reshape(self.degree + 1, -1)[:, -on[0]]] += work
        return result.ravel()

    def _fixed(self, n: int) -> Array:
        """Return the degrees of freedom that are held, and that are nothing on the axis."""
        dofs = [3 * np.flatnonzero(self.points[:, 0] < 1e-12) + (0 if n == 0 else 2)]
        for held in self._held:
            on = np.flatnonzero(held.where(self.points.T))
            dofs += [3 * on + "rtz".index(letter) for letter in held.components]
        return np.unique(np.concatenate(dofs))


def _lobatto(degree: int) -> Array:
    """Return Lobatto's points."""
    inner = legendre.Legendre.basis(degree).deriv().roots().real
    return np.concatenate([[-1.0], np.sort(inner), [1.0]])


def _between(breaks: Array, nodes: Array) -> Array:
    """Return nodes of all cells along a line."""
    middle, half = (breaks[1:] + breaks[:-1]) / 2, np.diff(breaks) / 2
    inner = middle[:, None] + half[:, None] * nodes[:-1]
    return np.append(inner.ravel(), breaks[-1])


def _lagrange(nodes: Array, s: Array) -> tuple[Array, Array]:
    """Return Lagrange's polynomials of nodes at points, and their slopes, shape ``(q, nodes)``."""
    vandermonde = legendre.legvander(nodes, len(nodes) - 1)
    slopes = np.stack([legendre.Legendre.basis(k).deriv()(s) for k in range(len(nodes))], axis=1)
    values = legendre.legvander(s, len(nodes) - 1)
    return np.linalg.solve(vandermonde.T, values.T).T, np.linalg.solve(vandermonde.T, slopes.T).T


AXIAL = Load(0, 0.0, 1.0, lambda r: (0.0, 0.0, 1.0 / np.pi))
TORSION = Load(0, 0.0, 1.0, lambda r: (0.0, 2.0 * r / np.pi, 0.0))
TRANSVERSE = Load(1, 0.0, 1.0, lambda r: (1.0 / np.pi, -1.0 / np.pi, 0.0))
MOMENT = Load(1, 0.0, 1.0, lambda r: (0.0, 0.0, 4.0 * r / np.pi))
LOADS = {"axial": AXIAL, "torsion": TORSION, "transverse": TRANSVERSE, "moment": MOMENT}


def weld(E: tuple[float, float], **accuracy: int) -> dict[str, float]:
    """Return the compliances of a rod ``r < 1``, 8 long, on a block ``r < 4``, 4 high, held below; rod and block."""
    return _compliances(E, 1, Held(lambda x: np.isclose(x[1], 0.0), "rtz"), accuracy)


def through(E: tuple[float, float], **accuracy: int) -> dict[str, float]:
    """Return the compliances of a rod from 0 to 12, bonded below 4 in a sleeve to r = 4 held outside; rod, sleeve."""
    return _compliances(E, 0, Held(lambda x: np.isclose(x[0], 4.0), "rtz"), accuracy)


def _compliances(E: tuple[float, float], lower: int, held: Held, accuracy: dict[str, int]) -> dict[str, float]:
    """Return the compliances of a rod in or on a block; ``lower`` is the body on the axis below 4, rod 0 or block 1."""
    body = Meridian(
        [
            Block((0.0, 1.0), (4.0, 12.0), E[0], _NU),
            Block((0.0, 1.0), (0.0, 4.0), E[lower], _NU),
            Block((1.0, 4.0), (0.0, 4.0), E[1], _NU),
        ],
        [held],
        ((1.0, 4.0), (0.0, 4.0, 12.0)),
        **accuracy,
    )
    return {name: body.compliance(load._replace(z=12.0)) for name, load in LOADS.items()}
