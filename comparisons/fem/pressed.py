"""Newton's method with the forces and the stiffness of contacts, which know nodes and no forms."""

from collections.abc import Sequence
from time import perf_counter
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

from comparisons.fem.contact.surfaces import Pressing
from comparisons.fem.statics import Newton
from meshes.mesh import Array, Index, Mesh


class Nodal(Protocol):
    """A space of displacements whose unknowns are the nodes of a `Mesh`, perhaps with pressures.

    Attributes
    ----------
    source
        The mesh.
    state
        The displacement, with the pressure perhaps; a dolfinx function.
    """

    source: Mesh
    state: Any

    @property
    def places(self) -> Index:
        """Degrees of freedom of each node, shape ``(nodes, 3)``."""

    @property
    def numbers(self) -> Index:
        """Number of each among those of all ranks, shape ``(nodes, 3)``."""

    @property
    def unknowns(self) -> int:
        """Number of unknowns that this rank knows, pressures included."""

    def to_dofs(self, nodal: Array) -> Array:
        """Return values by node ``(nodes, 3)`` as coefficients of the rank's unknowns."""

    def to_nodes(self, coefficients: Array) -> Array:
        """Return coefficients of all unknowns by node, shape ``(nodes, 3)``."""


class Touching(Protocol):
    """A contact: `comparisons.fem.contact.surfaces.Contact`, one with a rigid obstacle, or an action on a section."""

    penalty: float

    def add_forces(self, nodes: Array, out: Array) -> Pressing | None:
        """Add the gradient of the energy to ``out``, both of shape ``(nodes, 3)``, ``nodes`` present positions."""

    def stiffness(self, nodes: Array) -> sparse.coo_array:
        """Return the second derivative of the energy, rows and columns ``3 node + component``; entries repeat."""


class Pressed(Newton):
    """Newton's method with the contacts' forces and stiffness added to those of the forms.

    Of several ranks each sees all of the contacts, and adds what is its own.

    Attributes
    ----------
    contact_seconds
        Wall time of the contacts so far; part of ``seconds``.
    """

    def __init__(
        self,
        nodal: Nodal,
        residual: Any,
        tangent: Any,
        supports: Sequence[Any],
        contacts: Sequence[Touching],
        definite: bool = True,
    ) -> None:
        # Pressed together bodies may be close to buckling: symmetric is all that is sure.
        super().__init__(nodal.state, residual, tangent, supports, None, definite and not contacts)
        self.nodal, self.contacts = nodal, contacts
        self.contact_seconds = 0.0
        self._pattern: sparse.csr_array | None = None
        # What is held has a row of the identity, to which nothing may be added.
        held = np.zeros(nodal.unknowns)
        for support in supports:
            held[support.dofs] = 1.0
        self._is_held = nodal.to_nodes(held).ravel() > 0.0
        if contacts:
            # Contact couples nodes that the forms do not.
            self.matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)

    def positions(self) -> Array:
        """Return the present positions of the nodes, numbered as the source mesh."""
        return self.nodal.source.points + self.nodal.to_nodes(self.state.array_r)

    def press(self, out: PETSc.Vec) -> list[Pressing | None]:
        """Add the contacts' forces to ``out`` and return their states."""
        if not self.contacts:
            return []
        start = perf_counter()
        nodal = np.zeros_like(self.nodal.source.points)
        positions = self.positions()
        pressings = [contact.add_forces(positions, nodal) for contact in self.contacts]
        out.array[:] += self.nodal.to_dofs(nodal)[: out.array.size]
        self.contact_seconds += perf_counter() - start
        return pressings

    def add_forces(self, out: PETSc.Vec) -> None:
        """Add forces that no form has."""
        self.press(out)

    def add_stiffness(self, matrix: PETSc.Mat) -> None:
        """Add their derivative."""
        if not self.contacts:
            return
        start = perf_counter()
        positions = self.positions()
        parts = [contact.stiffness(positions) for contact in self.contacts]
        if any(part.nnz for part in parts):
            csr = rows_of(parts, self.nodal.numbers, matrix, self._is_held)
            pattern = csr.copy()
            pattern.data[:] = 1.0
            union = pattern if self._pattern is None else self._pattern + pattern
            # The factorisation's analysis is repeated only where bodies touch that did not before.
            known = self._pattern is not None and union.nnz == self._pattern.nnz
            known = bool(matrix.getComm().tompi4py().allreduce(known, op=MPI.LAND))
            self._pattern = union
            add_rows(matrix, csr, known)
            if not known:
                # PETSc later than 3.18 (seen in 3.22 and 3.25) gives the sum the nonzero state of any new matrix,
                # takes its pattern for the old one and puts its numbers where the old factors were.
                self.snes.getKSP().getPC().reset()
        self.contact_seconds += perf_counter() - start


def rows_of(parts: Sequence[sparse.coo_array], numbers: Index, matrix: PETSc.Mat, held: Any = None) -> sparse.csr_array:
    """Return this rank's rows of a sum of stiffnesses of nodes, in the numbers of a matrix.

    Parameters
    ----------
    parts
        Rows and columns ``3 node + component``; entries repeat.
    numbers
        See `Nodal`.
    held
        Which rows and columns are left out, ``(3 nodes,)``.
    """
    number = numbers.ravel()
    rows, columns = (np.concatenate([getattr(part, name) for part in parts]) for name in ("row", "col"))
    values = np.concatenate([part.data for part in parts])
    first, last = matrix.getOwnershipRange()
    taken = (first <= number[rows]) & (number[rows] < last)
    if held is not None:
        taken &= ~(held[rows] | held[columns])
    where = number[rows[taken]] - first, number[columns[taken]]
    csr = sparse.coo_array((values[taken], where), shape=(last - first, matrix.getSize()[1])).tocsr()
    csr.sort_indices()
    return csr


def add_rows(matrix: PETSc.Mat, csr: sparse.csr_array, known: bool = False) -> None:
    """Add this rank's rows to a matrix; ``known`` if it has all their entries already."""
    indices = csr.indptr.astype(PETSc.IntType), csr.indices.astype(PETSc.IntType)
    size = matrix.getLocalSize()[0], matrix.getSize()[0]
    add = PETSc.Mat().createAIJ((size, size), csr=(*indices, csr.data), comm=matrix.getComm())
    structure = PETSc.Mat.Structure
    matrix.axpy(1.0, add, structure.SUBSET_NONZERO_PATTERN if known else structure.DIFFERENT_NONZERO_PATTERN)
    add.destroy()
