"""Sparse matrices from entries that repeat, as those of contact do."""

import numpy as np
import pytest
from petsc4py import PETSc
from scipy.sparse import coo_matrix

from isorod.petsc.matrix import compressed_rows, create_matrix, preallocate, set_values


def drawn(seed, size=30, count=400):
    """Return rows, columns and values of entries of which many repeat, and some are held."""
    random = np.random.default_rng(seed)
    rows, columns = random.integers(-2, size, (2, count))
    return rows, columns, random.standard_normal(count)


def summed(rows, columns, values, size=30):
    kept = (rows >= 0) & (columns >= 0)
    return coo_matrix((values[kept], (rows[kept], columns[kept])), shape=(size, size)).tocsr()


def test_entries_add_up_in_a_matrix_that_gets_other_ones():
    first, other = drawn(0), drawn(1, count=500)
    matrix = create_matrix(PETSc.COMM_SELF, (30, 30), 1, lambda: first[:2])
    for rows, columns, values in (first, other):
        if rows is not first[0]:
            preallocate(matrix, rows, columns)
        for scale in (1.0, -2.0):
            set_values(matrix, scale * values)
            start, column, found = compressed_rows(matrix)
            expected = summed(rows, columns, scale * values)
            np.testing.assert_array_equal(start, expected.indptr)
            np.testing.assert_array_equal(column, expected.indices)
            np.testing.assert_allclose(found, expected.data, atol=1e-14)


@pytest.mark.parametrize("solver", ["petsc", "mumps"])
def test_factors_follow_a_pattern_that_changes(solver):
    ksp = PETSc.KSP().create(PETSc.COMM_SELF)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType(solver)
    matrix = None
    for seed in range(3):
        rows, columns, values = (
            np.append(one, more)
            for one, more in zip(drawn(seed), (*[np.arange(30)] * 2, np.full(30, 50.0)), strict=True)
        )
        if matrix is None:
            matrix = create_matrix(PETSc.COMM_SELF, (30, 30), 1, lambda: (rows, columns))  # noqa: B023
        else:
            preallocate(matrix, rows, columns)
        set_values(matrix, values)
        ksp.setOperators(matrix)
        right, found = matrix.createVecs()
        right.set(1.0)
        ksp.solve(right, found)
        np.testing.assert_allclose(summed(rows, columns, values) @ found.array, 1.0, atol=1e-10)


def test_no_entries_make_an_empty_matrix():
    none = np.empty(0, dtype=int)
    matrix = create_matrix(PETSc.COMM_SELF, (3, 3), 1, lambda: (none, none))
    preallocate(matrix, none, none)
    set_values(matrix, np.empty(0))
    assert matrix.norm() == 0.0
