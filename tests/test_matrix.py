"""Sparse matrices from entries that repeat, as those of contact do."""

import numpy as np
import pytest
from petsc4py import PETSc
from scipy.sparse import coo_matrix, csr_matrix

from isorod.petsc.inertia import negative_of_rows
from isorod.petsc.matrix import componentwise, create_matrix, fits, preallocate, set_values
from isorod.petsc.products import products
from isorod.petsc.rows import local_rows
from isorod.petsc.shifted import upper_rows


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
            start, column, found = local_rows(matrix).own
            expected = summed(rows, columns, scale * values)
            np.testing.assert_array_equal(start, expected.indptr)
            np.testing.assert_array_equal(column, expected.indices)
            np.testing.assert_allclose(found, expected.data, atol=1e-14)


def test_other_entries_that_fit_keep_the_pattern():
    """Behind the first hundred come fewer of those there were, in another order; one that is nowhere is refused."""
    rows, columns, values = drawn(0)
    matrix = create_matrix(PETSc.COMM_SELF, (30, 30), 1, lambda: (rows[:100], columns[:100]))
    preallocate(matrix, rows, columns)
    before = [one.copy() for one in local_rows(matrix).own[:2]]
    chosen = np.append(np.arange(100), np.random.default_rng(2).permutation(np.arange(100, 400))[:200])
    rows, columns, values = rows[chosen], columns[chosen], values[chosen]
    assert fits(matrix, 100, rows[100:], columns[100:])
    set_values(matrix, values)
    *pattern, found = local_rows(matrix).own
    for one, other in zip(before, pattern, strict=True):
        np.testing.assert_array_equal(one, other)
    dense = csr_matrix((found, pattern[1], pattern[0]), shape=(30, 30)).toarray()
    np.testing.assert_allclose(dense, summed(rows, columns, values).toarray(), atol=1e-14)
    free = np.argwhere(summed(*drawn(0)[:2], np.ones(400)).toarray() == 0.0)[0]
    assert not fits(matrix, 100, free[:1], free[1:])


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


def add_up(*rows_of_ranks):
    """Set a matrix twice from entries that each rank has anywhere, some held, some at one place (under mpirun)."""
    comm = PETSc.COMM_WORLD
    rank, n = comm.getRank(), 23
    own = rows_of_ranks[rank]
    rng = np.random.default_rng(rank)
    rows, columns = rng.integers(-1, n, (2, 300))
    made = create_matrix(comm, (own, n), 1, lambda: (rows, columns))
    for _ in range(2):
        values = rng.standard_normal(300)
        expected = np.zeros((n, n))
        there = (rows >= 0) & (columns >= 0)
        np.add.at(expected, (rows[there], columns[there]), values[there])
        expected = comm.tompi4py().allreduce(expected)
        set_values(made, values)
        first, last = made.getOwnershipRange()
        start, column, found = made.getValuesCSR()
        dense = csr_matrix((found, column, start), shape=(last - first, n)).toarray()
        assert last - first == own
        assert np.abs(dense - expected[first:last]).max(initial=0.0) < 1e-13


@pytest.mark.mpi
def test_entries_of_all_ranks_are_added_up(on_ranks):
    """Also where some have no rows."""
    for rows in ("7, 16", "0, 23", "23, 0"):
        on_ranks(2, f"test_matrix.add_up({rows})")


def fails_on(rank):
    assert PETSc.COMM_WORLD.getRank() != rank, "as it should"


@pytest.mark.mpi
def test_what_fails_on_a_rank_fails(on_ranks):
    with pytest.raises(AssertionError, match=r"(?s)fails_on\(1\) on 2 ranks:.*AssertionError: as it should"):
        on_ranks(2, "test_matrix.fails_on(1)")


def banded(random, layers, size, gaps):
    """Return a symmetric positive matrix in which layers couple with those beside them, and its PETSc matrix."""
    layer = np.repeat(np.arange(layers), size)
    dense = random.standard_normal((layer.size, layer.size)) * (np.abs(np.subtract.outer(layer, layer)) <= 1)
    dense = dense + dense.T + 8.0 * size * np.eye(layer.size)
    if gaps:
        dense[:, 4] = dense[4] = 0.0
        dense[4, 4] = 1.0
    return dense, petsc(csr_matrix(dense))


def petsc(rows):
    return PETSc.Mat().createAIJ(rows.shape, csr=(rows.indptr, rows.indices, rows.data), comm=PETSc.COMM_SELF)


@pytest.mark.parametrize("gaps", [False, True])
def test_products_with_several_vectors(gaps):
    random = np.random.default_rng(0)
    dense, matrix = banded(random, 5, 9, gaps)
    vectors = []
    for column in random.standard_normal((3, 45)):
        vectors.append(matrix.createVecRight())
        vectors[-1].array = column
    found = products(matrix, vectors)
    np.testing.assert_allclose(found, [dense @ one.array for one in vectors], atol=1e-12)


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize("components", [1, 3])
def test_a_shifted_matrix_and_its_inertia(components, gaps):
    random = np.random.default_rng(2)
    dense, matrix = banded(random, 5, 9, gaps)
    size = 45 // components
    # No entries where the matrix has none.
    one = random.standard_normal((size, size)) * (np.kron(np.eye(5), np.ones((9 // components,) * 2)) > 0.0)
    one = one + one.T + 6.0 * np.eye(size)
    if gaps:
        one[:, 4 // components] = one[4 // components] = 0.0
    other = petsc(csr_matrix(one)) if components == 1 else componentwise(petsc(csr_matrix(one)), components)
    expected = dense - 9.0 * np.kron(one, np.eye(components))
    rows = upper_rows(matrix, 9.0, other)
    found = csr_matrix((rows.values, rows.column, rows.start), shape=(45, 45)).toarray()
    np.testing.assert_allclose(np.triu(found), np.triu(expected), atol=1e-12)
    negative = int(np.count_nonzero(np.linalg.eigvalsh(expected) < 0.0))
    assert 0 < negative < 45
    assert negative_of_rows(rows) == negative


def test_a_shift_by_entries_that_have_no_place_is_refused():
    _, matrix = banded(np.random.default_rng(2), 5, 9, False)
    assert upper_rows(matrix, 1.0, petsc(csr_matrix(np.ones((45, 45))))) is None
