"""Bonds of ties that slide, and springs to ground: forces and tangent of a potential, on all degrees of freedom."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import bsr_array, csr_array

from isorod.arrays import Array, Index
from isorod.assembly.averages import Mean
from isorod.model.bond import BondLaw


class Bond(NamedTuple):
    """The bond of a tie, at the points of its slave.

    Attributes
    ----------
    jump : (q, nodes)
        The master's functions less the slave's, on all nodes.
    nodes, values : (q, m)
        The same by point: nodes and their coefficients in the jump.
    normals, weights
        The slave's normals at rest ``(q, 3)``, and areas ``(q,)``.
    law
        Of the size of the slip.
    """

    jump: csr_array
    nodes: Index
    values: Array
    normals: Array
    weights: Array
    law: BondLaw

    def slips(self, moved: Array) -> Array:
        """Return the slips ``(q, 3)`` of displacements of all degrees of freedom ``(dofs,)``."""
        return tangential(self.jump @ moved.reshape(-1, 3), self.normals)

    def forces(self, moved: Array) -> Array:
        """Return the forces ``(dofs,)`` on all degrees of freedom: the derivative of the energy."""
        slips = self.slips(moved)
        secant = self.law.at(np.linalg.norm(slips, axis=1))[0]
        return np.asarray(self.jump.T @ ((self.weights * secant)[:, None] * slips)).ravel()

    def energy(self, moved: Array) -> float:
        """Return the energy."""
        return float(self.weights @ self.law.at(np.linalg.norm(self.slips(moved), axis=1))[2])

    def stiffness(self, moved: Array) -> Array:
        """Return the derivative of the traction by the jump, times areas, at each point ``(q, 3, 3)``; symmetric."""
        slips = self.slips(moved)
        sizes = np.linalg.norm(slips, axis=1)
        secant, tangent, _ = self.law.at(sizes)
        direction = slips / np.where(sizes > 0.0, sizes, 1.0)[:, None]
        across = np.eye(3) - self.normals[:, :, None] * self.normals[:, None]
        along = direction[:, :, None] * direction[:, None]
        return np.asarray(
            (self.weights * secant)[:, None, None] * across + (self.weights * (tangent - secant))[:, None, None] * along
        )

    def change(self, moved: Array, direction: Array) -> Array:
        """Return the derivative of the forces along a ``direction`` ``(dofs,)``."""
        tractions = np.einsum("qab,qb->qa", self.stiffness(moved), self.jump @ direction.reshape(-1, 3))
        return np.asarray(self.jump.T @ tractions).ravel()

    @property
    def linear(self) -> bool:
        """Whether its stiffness is the same in all states."""
        return self.law.linear

    def elements(self, first: int, last: int) -> "Iterator[_BondElement]":
        """Yield groups of points with the same nonzero functions, given this rank's range of nodes."""
        sets, of = np.unique(self.nodes, axis=0, return_inverse=True)
        order = np.argsort(of.ravel(), kind="stable")
        for own, points in zip(sets, np.split(order, np.cumsum(np.bincount(of.ravel()))[:-1]), strict=True):
            yield _BondElement(self, points, own, self.values[points], (own >= first) & (own < last))


class Spring(NamedTuple):
    """Springs between mean motions and the ground (`isorod.model.mean.MeanSupport`).

    Attributes
    ----------
    mean
        The mean motions.
    stiffness : (k,)
        Of the spring on each.
    """

    mean: Mean
    stiffness: Array

    @classmethod
    def of(cls, mean: Mean) -> "Spring":
        """Return the springs of a support."""
        assert mean.stiffness is not None
        return cls(mean, mean.stiffness)

    @property
    def linear(self) -> bool:
        """Whether its stiffness is the same in all states."""
        return True

    def forces(self, moved: Array) -> Array:
        """Return the forces ``(dofs,)`` on all degrees of freedom: the derivative of the energy."""
        return self.mean.pushed(self.stiffness * self.mean.moved(moved), moved.size // 3).ravel()

    def energy(self, moved: Array) -> float:
        """Return the energy."""
        return 0.5 * float(self.stiffness @ self.mean.moved(moved) ** 2)

    def change(self, moved: Array, direction: Array) -> Array:
        """Return the derivative of the forces along a ``direction`` ``(dofs,)``."""
        return self.forces(direction)

    def elements(self, first: int, last: int) -> "Iterator[_SpringElement]":
        """Yield all springs as one element, given this rank's range of nodes."""
        yield _SpringElement(self, self.mean.nodes, (self.mean.nodes >= first) & (self.mean.nodes < last))


class _BondElement(NamedTuple):
    """Points of a bond with the same nonzero functions.

    Attributes
    ----------
    bond
        The bond.
    points
        Their numbers among its points, ``(p,)``.
    nodes : (m,)
        Nodes of the functions.
    values : (p, m)
        The functions.
    mine : (m,)
        Which nodes have their rows on this rank.
    """

    bond: Bond
    points: Index
    nodes: Index
    values: Array
    mine: NDArray[np.bool_]

    def blocks(self, moved: Array) -> Array:
        """Return the tangent at displacements of all degrees of freedom, blocks ``(pairs, 3, 3)`` of nodes."""
        stiffness = self.bond.stiffness(moved)[self.points].reshape(-1, 9)
        products = self.values[:, self.mine].T @ (stiffness.T[:, :, None] * self.values)
        return np.moveaxis(products, 0, 2).reshape(-1, 3, 3)


class _SpringElement(NamedTuple):
    """Springs, with the interface of `_BondElement`."""

    spring: Spring
    nodes: Index
    mine: NDArray[np.bool_]

    def blocks(self, moved: Array) -> Array:
        """Return the tangent, blocks ``(pairs, 3, 3)`` of nodes."""
        rows = self.spring.mean.rows
        blocks = np.einsum("k,kma,knb->mnab", self.spring.stiffness, rows[:, self.mine], rows, optimize=True)
        return blocks.reshape(-1, 3, 3)


class Bonds:
    """All bonds of a model.

    Parameters
    ----------
    bonds
        One or more.
    nodes
        Number of all nodes.
    comm
        Communicator of the matrix.

    Attributes
    ----------
    matrix
        The tangent on all degrees of freedom (AIJ), of the state that was `set`.
    linear
        Whether it is the same in all states.
    """

    def __init__(self, bonds: Sequence[Bond | Spring], nodes: int, comm: PETSc.Comm) -> None:
        self._bonds, self._nodes = bonds, nodes
        self.linear = all(one.linear for one in bonds)
        rank, size = comm.getRank(), comm.getSize()
        first, last = nodes * rank // size, nodes * (rank + 1) // size
        self._elements = [element for bond in bonds for element in bond.elements(first, last)]
        places = [np.empty(0, dtype=np.int64)]
        places += [((one.nodes[one.mine] - first)[:, None] * nodes + one.nodes).ravel() for one in self._elements]
        # Pairs of nodes, row by row, and the pair of each element block.
        self._pairs, self._which = np.unique(np.concatenate(places), return_inverse=True)
        sizes = ((3 * (last - first), 3 * nodes),) * 2
        row = np.searchsorted(self._pairs, nodes * np.arange(last - first + 1, dtype=np.int64))
        self._start = row, self._pairs % nodes
        csr = self._expanded(np.zeros((self._pairs.size, 3, 3)))
        self.matrix = PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm)
        self.matrix.assemble()

    def _expanded(self, blocks: Array) -> tuple[Array, Array, Array]:
        """Return the rows of this rank with blocks ``(pairs, 3, 3)`` of pairs of nodes, as PETSc takes them."""
        start, column = self._start
        shape = 3 * (start.size - 1), 3 * self._nodes
        whole = csr_array(bsr_array((blocks, column, start), shape=shape).tocsr())
        return whole.indptr.astype(PETSc.IntType), whole.indices.astype(PETSc.IntType), whole.data

    def set(self, moved: Array, factor: float = 1.0) -> None:
        """Set the matrix to ``factor`` times the tangent at displacements of all degrees of freedom ``(dofs,)``."""
        parts = [np.empty((0, 3, 3)), *(factor * one.blocks(moved) for one in self._elements)]
        entries = np.concatenate(parts).reshape(-1, 9)
        count = self._pairs.size
        sums = [np.bincount(self._which.ravel(), one, count) for one in entries.T]
        blocks: Array = np.stack(sums, axis=1).astype(float)
        self.matrix.setValuesCSR(*self._expanded(blocks.reshape(-1, 3, 3)))
        self.matrix.assemble()

    def forces(self, moved: Array) -> Array:
        """Return the forces on all degrees of freedom ``(dofs,)`` at displacements of these."""
        return np.asarray(sum(one.forces(moved) for one in self._bonds))

    def change(self, moved: Array, direction: Array) -> Array:
        """Return the derivative of the forces along a ``direction`` ``(dofs,)``."""
        return np.asarray(sum(one.change(moved, direction) for one in self._bonds))

    def energy(self, moved: Array) -> float:
        """Return the stored energy."""
        return sum(one.energy(moved) for one in self._bonds)


def tangential(vectors: Array, normals: Array) -> Array:
    """Return the tangential components of vectors ``(q, 3)`` for unit normals."""
    return np.asarray(vectors - np.sum(vectors * normals, axis=1)[:, None] * normals)
