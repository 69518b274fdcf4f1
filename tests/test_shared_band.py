"""Factors of bands and their Schur complements, on one rank and shared by several: against dense matrices."""

import gc
import sys

import numpy as np
import pytest
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from isorod import Body, Model, NeoHookean, Space, Support
from isorod.petsc import banded, inertia
from isorod.petsc.band import Factors
from isorod.petsc.band_kernel import Ordered
from isorod.petsc.rows import Compressed, local_rows
from isorod.petsc.shared_band import DistributedFactors
from isorod.scenes.spring import Spring
from isorod.statics import continuation


def symmetric(rng, n, width, shift):
    """Return a matrix with entries in a band: definite, or shifted by so many times the median of the diagonal."""
    dense = rng.standard_normal((n, n))
    dense[np.abs(np.subtract.outer(np.arange(n), np.arange(n))) > width] = 0.0
    dense += dense.T
    # Not what is left of the diagonal of one of no width: a shift would make it zero.
    np.fill_diagonal(dense, np.abs(dense).sum(axis=1) + rng.uniform(1.0, 2.0, n))
    return dense - shift * np.median(np.diag(dense)) * np.eye(n)


def layered(rng, layers, thickness, shift):
    """Return a matrix of layers of which each is coupled to the next two, and each third to the one behind these."""
    n = layers * thickness
    dense = symmetric(rng, n, n, 0.0)
    place = np.arange(n) // thickness
    near = np.abs(np.subtract.outer(place, place)) <= 2
    far = np.abs(np.subtract.outer(place, place)) == 3
    dense[~(near | (far & (np.minimum.outer(place, place) % 3 == 0)))] = 0.0
    np.fill_diagonal(dense, 0.0)
    np.fill_diagonal(dense, np.abs(dense).sum(axis=1) + 1.0)
    return dense - shift * np.median(np.diag(dense)) * np.eye(n)


def compressed(dense):
    rows = csr_matrix(dense)
    kind = PETSc.IntType
    return Compressed(rows.indptr.astype(kind), rows.indices.astype(kind), rows.data)


def negative(dense):
    return int(np.count_nonzero(np.linalg.eigvalsh(dense) < 0.0))


def rounding(whole, gone):
    """Return the largest error of a Schur complement for want of digits.

    Elimination without pivots finds the factors of a matrix that is within ``gone`` times the unit round-off of
    ``|L| |D| |L^T|`` (Higham, Accuracy and Stability of Numerical Algorithms, Theorems 9.3 and 10.3); what that changes
    of ``C - B A^-1 B^T`` is ``W`` times it times ``W^T``, ``W = B A^-1``, beside the rounding of the products.
    """
    left, under, corner = whole[:gone, :gone].copy(), whole[gone:, :gone], whole[gone:, gone:]
    size = np.zeros_like(left)
    for k in range(gone):
        column = left[:, k] / left[k, k]
        size += np.abs(np.outer(column, column) * left[k, k])
        left -= np.outer(column, column) * left[k, k]
        left[k] = left[:, k] = 0.0
    W = np.abs(under @ np.linalg.inv(whole[:gone, :gone]))
    return gone * 2.0**-53 * (W @ size @ W.T + W @ np.abs(under.T) + np.abs(corner)).max()


@pytest.mark.parametrize("shift", [0.0, 0.9, 1.1])
@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("keep", [True, False])
@pytest.mark.parametrize("make", [lambda rng, s: symmetric(rng, 400, 13, s), lambda rng, s: layered(rng, 50, 9, s)])
def test_what_is_left_is_the_schur_complement(make, keep, backward, shift):
    """Of the last unknowns and of a border that is coupled to the first ones."""
    rng = np.random.default_rng(3)
    dense = make(rng, shift)
    n, sides = len(dense), 7
    gone = n - 20
    border, corner = rng.standard_normal((11, sides)), symmetric(rng, sides, 6, 0.0)
    factors = Factors()
    matrix = Ordered(compressed(dense), 0, n, backward, border=border, corner=corner)
    assert factors.factorise(matrix, gone, keep)
    ordered = dense[::-1, ::-1] if backward else dense
    beside = np.vstack([border, np.zeros((n - 11, sides))])
    whole = np.block([[ordered, beside], [beside.T, corner]])
    expected = whole[gone:, gone:] - whole[gone:, :gone] @ np.linalg.solve(whole[:gone, :gone], whole[:gone, gone:])
    found = np.block([[factors.schur, factors.border], [factors.border.T, factors.corner]])
    bound = rounding(whole, gone)
    assert np.abs(found - expected).max() < bound < 1e-6 * np.abs(whole).max()
    assert factors.negative == negative(ordered[:gone, :gone])


def test_rows_of_another_rank_come_apart():
    """Couplings to unknowns behind the rows, whose own block is somebody else's; to the last two there are none."""
    rng = np.random.default_rng(0)
    dense = symmetric(rng, 60, 8, 0.0)
    own = 50
    row, column = (one.copy() for one in np.nonzero(dense[:own, own:]))
    factors = Factors()
    apart = row, own + column, dense[row, own + column]
    assert factors.factorise(Ordered(compressed(dense[:own, :own]), 0, own, False, apart, 10), own)
    expected = -dense[own:, :own] @ np.linalg.solve(dense[:own, :own], dense[:own, own:])
    assert np.abs(factors.schur - expected).max() < 1e-13 * np.abs(dense).max()


def test_factors_take_no_more_memory_than_the_entries_of_layers():
    dense = layered(np.random.default_rng(0), 30, 12, 0.0)
    factors = Factors()
    assert factors.factorise(Ordered(compressed(dense), 0, 360), 360)
    # A column of the lower band, three layers behind its own.
    assert factors._band.size == 360 * 4 * 12


def test_factors_whose_entries_would_grow_are_refused_and_rows_exchanged():
    dense = np.array([[1e-9, 1.0, 0.0], [1.0, 1e-9, 1.0], [0.0, 1.0, 1.0]])
    big = np.kron(dense, np.eye(8))
    # The leading block of a panel is nearly singular and negative: what it adds is huge.
    big[:8, :8] *= -1.0
    assert not Factors().factorise(Ordered(compressed(big), 0, 24), 24)
    rows = csr_matrix(big)
    matrix = PETSc.Mat().createAIJ(rows.shape, csr=(rows.indptr, rows.indices, rows.data), comm=PETSc.COMM_SELF)
    factors = DistributedFactors()
    assert factors.factorise(matrix)
    assert factors.negative is None
    x = np.random.default_rng(0).standard_normal(24)
    assert factors.solve(big @ x) == pytest.approx(x, rel=1e-12)
    assert inertia.negative_eigenvalues(matrix) == negative(big)


@pytest.mark.parametrize("at", [0, 10, 58])
def test_a_pivot_of_nothing_takes_the_unknowns_beside_it(at):
    """Two unknowns that only couple with each other have eigenvalues of either sign, and no pivot."""
    rng = np.random.default_rng(1)
    dense = symmetric(rng, 60, 8, 0.9)
    dense[:, at : at + 2] = dense[at : at + 2] = 0.0
    dense[at, at + 1] = dense[at + 1, at] = 5.0
    factors = Factors()
    assert factors.factorise(Ordered(compressed(dense), 0, 60), 60)
    assert factors.negative == negative(dense)
    x = rng.standard_normal(60)
    found = dense @ x
    factors.solve(found)
    assert found == pytest.approx(x, rel=1e-9, abs=1e-9)


def test_negative_pivots_are_taken_one_by_one():
    """As many columns are cut out as there are negative eigenvalues: no block of eigenvectors is made."""
    dense = layered(np.random.default_rng(3), 30, 12, 1.02)
    factors = Factors()
    assert factors.factorise(Ordered(compressed(dense), 0, 360), 360)
    assert 20 < factors.negative == negative(dense)
    assert factors._odd.size < 0.1 * factors.negative


def shared(dense, bounds, comm):
    """Return the rows of a rank as a matrix over all."""
    low, high = bounds[comm.getRank()], bounds[comm.getRank() + 1]
    rows = csr_matrix(dense[low:high])
    sizes = (high - low, len(dense))
    return PETSc.Mat().createAIJ((sizes, sizes), csr=(rows.indptr, rows.indices, rows.data), comm=comm)


def compare():
    """Solve on the ranks there are; with uneven shares some have too few rows, or none."""
    comm = PETSc.COMM_WORLD
    size, mpi = comm.getSize(), comm.tompi4py()
    rng = np.random.default_rng(size)
    gathered = 0
    for n, width in [(1, 0), (7, 2), (40, 1), (40, 29), (150, 7), (203, 29), (203, 0)]:
        for shift in (0.0, 0.9, 1.1):
            dense = symmetric(rng, n, width, shift)
            even = n * np.arange(size + 1) // size
            for bounds in (even, np.array([0, *np.sort(rng.integers(0, n + 1, size - 1)), n])):
                matrix = shared(dense, bounds, comm)
                ksp = PETSc.KSP().create(comm)
                ksp.setOperators(matrix)
                ksp.setType("preonly")
                ksp.getPC().setType("python")
                ksp.getPC().setPythonType(banded.NAME)
                right, x = matrix.createVecs()
                right.array = (dense @ rng.standard_normal(n))[bounds[comm.getRank()] : bounds[comm.getRank() + 1]]
                ksp.solve(right, x)
                assert ksp.getConvergedReason() > 0
                found, wanted = (np.concatenate(mpi.allgather(one.array)) for one in (x, right))
                amount = np.abs(dense) @ np.abs(found) + np.abs(wanted)
                assert (np.abs(dense @ found - wanted) / amount).max() < 1e-12, (n, width, shift, bounds)
                assert inertia.negative_eigenvalues(matrix) == negative(dense)
                enough = bool((np.diff(bounds) > width).all())
                factors = DistributedFactors()
                if enough or size == 1:
                    assert factors.eliminate(matrix) and factors.negative == negative(dense)
                else:
                    gathered += not factors.eliminate(matrix)
                ksp.destroy()
                matrix.destroy()
    assert gathered > 0 or size == 1
    # Singular, and not so when something has changed.
    matrix = shared(np.kron(np.eye(10), np.ones((4, 4))), 40 * np.arange(size + 1) // size, comm)
    factors = DistributedFactors()
    assert not factors.factorise(matrix)
    matrix.shift(1.0)
    assert factors.factorise(matrix)


def test_solves_to_rounding_on_one_rank():
    compare()


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, *[pytest.param(one, marks=pytest.mark.slow) for one in (3, 4)]])
def test_solves_to_rounding_on_ranks(ranks, on_ranks):
    on_ranks(ranks, "test_shared_band.compare()")


def test_critical_loads_take_the_band_and_agree_with_mumps(petsc_options):
    rod = Spring(helix="paper", coils=1, section_points=4).rod()
    space = Space.paper(rod, elements=8, degree=3)
    ends = [Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, -12.0))]
    model = Model([Body(space, NeoHookean(1.0, 0.3))], ends)
    path = continuation.follow(model, 0.1, 4, bounds=(0.0, 0.4))
    petsc_options(pc_type="cholesky", pc_factor_mat_solver_type="mumps")
    other = continuation.follow(model, 0.1, 4, bounds=(0.0, 0.4))
    assert path.negative.tolist() == other.negative.tolist()
    assert path.factors == pytest.approx(other.factors, rel=1e-8)


def test_rows_keep_their_matrix_alive():
    """They are read where PETSc has them, also when nobody else holds the matrix any more."""
    matrix = PETSc.Mat().createAIJ((2, 2), csr=([0, 1, 2], [0, 1], [3.0, 4.0]), comm=PETSc.COMM_SELF)
    held = sys.getrefcount(matrix)
    values = local_rows(matrix).own.values
    assert sys.getrefcount(matrix) > held
    np.testing.assert_array_equal(values, [3.0, 4.0])
    del values
    gc.collect()
    assert sys.getrefcount(matrix) == held
