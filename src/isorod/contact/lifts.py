"""Tangents at control points of surfaces, transformed to the model's nodes where spaces have no control points."""

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from isorod.arrays import Array, Index
from isorod.contact.packed import Packed


class Lifts:
    """``P^T K P`` of entries of a tangent; its pattern is kept as long as theirs.

    Parameters
    ----------
    packed
        Its tables ``lifts`` and ``matrices``.
    nodes
        Number of the model's nodes.

    Attributes
    ----------
    rows, columns
        Of all entries.
    """

    def __init__(self, packed: Packed, nodes: int) -> None:
        rows, columns, values = [np.arange(nodes)], [np.arange(nodes)], [np.ones(nodes)]
        for lift in packed.lifts:
            shape = lift["layers"], lift["around"], lift["functions"]
            size = lift["around"] * lift["functions"]
            layer, point, function = (each.ravel() for each in np.indices(shape))
            rows.append(lift["first_point"] + layer * lift["around"] + point)
            columns.append(lift["first_node"] + layer * lift["functions"] + function)
            values.append(np.tile(packed.matrices[lift["first_value"] :][:size], lift["layers"]))
        row, column, value = (np.concatenate(each) for each in (rows, columns, values))
        three = np.arange(3)
        every = np.repeat(value, 3), ((3 * row[:, None] + three).ravel(), (3 * column[:, None] + three).ravel())
        made = csr_matrix(every, shape=(3 * packed.before.shape[0], 3 * nodes))
        made.eliminate_zeros()
        self._lift = PETSc.Mat().createAIJ(made.shape, csr=(made.indptr, made.indices, made.data), comm=PETSc.COMM_SELF)
        self._matrix = PETSc.Mat()
        self._product: PETSc.Mat | None = None
        self._order, self._pattern = np.empty(0, dtype=np.int64), (np.empty(0), np.empty(0))
        self._version = -1
        self.rows = self.columns = np.empty(0, dtype=np.int64)

    def lower(self, rows: Index, columns: Index, values: Array, version: int) -> Array:
        """Return the entries at the model's nodes, from those at ``rows`` and ``columns`` of a pattern's version."""
        size = self._lift.getSize()[0]
        if version != self._version:
            self._order = np.lexsort((columns, rows))
            starts = np.searchsorted(rows[self._order], np.arange(size + 1))
            self._pattern = starts.astype(PETSc.IntType), columns[self._order].astype(PETSc.IntType)
            self._matrix = PETSc.Mat().createAIJ((size, size), csr=self._pattern, comm=PETSc.COMM_SELF)
            self._product = None
        self._matrix.setValuesCSR(*self._pattern, values[self._order])
        self._matrix.assemble()
        product = self._product = self._matrix.ptap(self._lift, self._product)
        starts, columns, entries = product.getValuesCSR()
        if version != self._version:
            self.rows = np.repeat(np.arange(starts.size - 1), np.diff(starts)).astype(np.int64)
            self.columns, self._version = columns.astype(np.int64), version
        return entries
