"""Matrices of parts on the unknowns that ties leave, beside the full product, on any number of ranks."""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array, random
from solids import LAW, solid

from isorod import Space, circle, straight
from isorod.assembly.condensed import Condensed, groups
from isorod.assembly.formulation import assembler_for
from isorod.model import Body, Model


def check():
    """Compare with ``T^T K T`` of a matrix of no symmetry: slaves of two ties, held unknowns, and an idle slave."""
    comm = MPI.COMM_WORLD
    rng = np.random.default_rng(7)
    count, unknowns = 40, 32
    number, slave = np.full((2, count), -1)
    slave[[3, 4, 5, 20, 21, 30]] = [2, 0, 1, 5, 4, 3]
    free = np.setdiff1d(np.arange(count), [*np.flatnonzero(slave >= 0), 7, 33])
    number[free] = rng.permutation(unknowns)[: free.size]
    dependent = np.zeros((6, unknowns))
    dependent[:3, 2:8] = rng.normal(size=(3, 6))
    # Of the last, which the fourth is no part of, some of what it may be is not; the fifth depends on nothing.
    dependent[[3, 5], 12:16] = [[1.0, 0.0, -2.0, 0.5], [0.0, 3.0, 1.0, 0.0]]
    whole = random(count, count, 0.3, random_state=5).toarray()
    T = np.zeros((count, unknowns))
    T[free, number[free]] = 1.0
    T[slave >= 0] = dependent[slave[slave >= 0]]

    first = count * comm.rank // comm.size, count * (comm.rank + 1) // comm.size
    mine = csr_array(whole[slice(*first)])
    arrays = mine.indptr.astype(PETSc.IntType), mine.indices.astype(PETSc.IntType), mine.data
    own = PETSc.Mat().createAIJ(((first[1] - first[0], count),) * 2, csr=arrays, comm=comm)
    every = groups(csr_array(dependent))
    assert sorted(map(len, (one.slaves for one in every))) == [2, 3]
    condensed = Condensed(own, number, slave, every)
    for factor in (1.0, -3.0):
        values = condensed.values(own)
        found = np.zeros((unknowns, unknowns))
        kept = (condensed.rows >= 0) & (condensed.columns >= 0)
        np.add.at(found, (condensed.rows[kept], condensed.columns[kept]), values[kept])
        np.testing.assert_allclose(comm.allreduce(found), factor * T.T @ whole @ T, atol=1e-12)
        own.scale(-3.0)


def test_parts_add_the_full_product():
    check()


def test_parts_of_ranks_add_the_full_product(on_ranks):
    on_ranks(2, "test_condensed.check()")


def test_tangents_are_those_of_the_state_whoever_asked_last():
    body = solid(law=LAW)
    rod = Body(Space(straight(1.0).sweep(circle(8)), order=2, elements=1, degree=3), LAW)
    one, other = (assembler_for(Model([rod], solids=[body])).coupling for _ in range(2))
    x, y = (one.vector() for _ in "xy")
    x.array_w[:] = 1e-2 * np.sin(np.arange(x.getLocalSize()))
    y.array_w[:] = 2e-2 * np.cos(np.arange(y.getLocalSize()))

    def entries(coupling, state, factor=1.0):
        return np.array(coupling.tangents(state, factor)[0].getValuesCSR()[2])

    at_x, at_y = entries(one, x), entries(one, y)
    assert np.abs(at_x - at_y).max() > 1e-3
    for coupling, state, wanted in ((one, y, at_y), (other, x, at_x), (one, y, at_y), (one, y, at_y), (one, x, at_x)):
        np.testing.assert_array_equal(entries(coupling, state), wanted)
