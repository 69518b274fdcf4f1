"""Products of a matrix with several vectors at once."""

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.petsc.rows import Compressed, local_rows

# Mean number of rows of the dense blocks from which they pay.
_LEAST = 8


def products(matrix: PETSc.Mat, vectors: Sequence[PETSc.Vec]) -> Array:
    """Return this rank's rows of the products with vectors, shape ``(m, rows)``.

    Rows with contiguous, equal columns, like those of a rod's layer, are dense blocks for BLAS, which reads them from
    memory once for all vectors; other matrices are left to PETSc.
    """
    if matrix.getType() == "seqaij":
        result = _dense(local_rows(matrix).own, np.stack([one.array_r for one in vectors], axis=1))
        if result is not None:
            return np.ascontiguousarray(result.T)
    image = matrix.createVecLeft()
    rows = np.empty((len(vectors), image.getLocalSize()))
    for row, vector in zip(rows, vectors, strict=True):
        matrix.mult(vector, image)
        row[:] = image.array_r
    image.destroy()
    return rows


def _dense(rows: Compressed, columns: Array) -> Array | None:
    """Return the product with columns ``(n, m)``; None if a row has gaps or is empty, or blocks have few rows."""
    start, width = rows.start, np.diff(rows.start)
    if not width.all():
        return None
    first = rows.column[start[:-1]]
    if (rows.column[start[1:] - 1] - first != width - 1).any():
        return None
    cuts = np.flatnonzero((np.diff(width) != 0) | (np.diff(first) != 0)) + 1
    if _LEAST * cuts.size > width.size:
        return None
    result = np.empty((width.size, columns.shape[1]))
    for i, j in zip([0, *cuts.tolist()], [*cuts.tolist(), width.size], strict=True):
        block = rows.values[start[i] : start[j]].reshape(j - i, width[i])
        np.matmul(block, columns[first[i] : first[i] + width[i]], out=result[i:j])
    return result
