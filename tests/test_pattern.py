"""Where blocks of element matrices go, on one rank and over several: against sums of dense matrices."""

import warnings

import numpy as np
import pytest
from conftest import as_array, straight
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from isorod import Body, Model, NeoHookean, Space, Support, arc, circle
from isorod.assembly.assembler import Assembler
from isorod.assembly.formulation import assembler_for
from isorod.assembly.pattern import Layers, Pattern, add
from isorod.petsc.matrix import add_componentwise, create_matrix, set_values, zeros
from isorod.petsc.options import in_force
from isorod.petsc.rows import local_rows

STIFF = NeoHookean(100.0, 0.3)


def bodies():
    """Layers of the elements of two bodies, the second one closed, at places of an array with room between them."""
    first, second = np.arange(6)[:, None] + np.arange(3), (np.arange(5)[:, None] + np.arange(2)) % 5
    return [Layers(2 + 4 * first, 4), Layers(40 + 3 * second, 3)]


def numbers(held):
    """Number what is at the bodies' places but what is held."""
    number = np.full(60, -1)
    there = np.concatenate([np.arange(2, 34), np.arange(40, 55)])
    there = there[~np.isin(there, held)]
    number[there] = np.arange(there.size)
    return number


def dense(parts, number, matrices):
    """Return the sum of element matrices."""
    whole = np.zeros((number.max() + 1,) * 2)
    for (places, size), own in zip(parts, matrices, strict=True):
        for element, matrix in zip(places, own, strict=True):
            dofs = number[(element[:, None] + np.arange(size)).ravel()]
            there = dofs >= 0
            np.add.at(whole, np.ix_(dofs[there], dofs[there]), matrix[np.ix_(there, there)])
    return whole


def random_matrices(parts, seed):
    rng = np.random.default_rng(seed)
    return [rng.standard_normal((len(one.places), *(one.places.shape[1] * one.size,) * 2)) for one in parts]


def entries_of(pattern, matrices):
    entries = np.zeros(pattern.total)
    for own, blocks in zip(matrices, pattern.blocks, strict=True):
        add(own, blocks, entries)
    return entries


HELD = {
    "nothing": [],
    "layers": [*range(2, 10), *range(46, 49)],
    "parts of layers": [3, 11, 12, 33, 40, 42, 50],
    "both": [*range(10, 14), 15, 47],
    "a body": [*range(2, 34)],
}


@pytest.mark.parametrize("held", HELD.values(), ids=list(HELD))
def test_entries_are_sums_of_element_matrices(held):
    parts, number = bodies(), numbers(held)
    matrices = random_matrices(parts, 1)
    expected = dense(parts, number, matrices)
    n = len(expected)
    alone = Pattern(parts, number)
    assert alone.layout is None
    row, column = alone.indices()
    there = (row >= 0) & (column >= 0)
    found = np.zeros((n, n))
    # Each place once.
    found[row[there], column[there]] = entries_of(alone, matrices)[there]
    assert np.abs(found - expected).max() < 1e-14
    pattern = Pattern(parts, number, (PETSc.COMM_SELF, n))
    matrix = create_matrix(PETSc.COMM_SELF, (n, n), 1, pattern.indices, pattern.layout, pattern.total)
    set_values(matrix, entries_of(pattern, matrices))
    assert (as_array(matrix) == found).all()
    start, column, _ = local_rows(matrix).own
    assert column.size == there.sum()
    assert all((np.diff(own) > 0).all() for own in np.split(column, start[1:-1]))


def test_what_is_added_to_the_values_is_the_matrix():
    """Without a copy, where no layer is held in part; and matrices of one pattern share none."""
    parts, number = bodies(), numbers(HELD["layers"])
    matrices, n = random_matrices(parts, 2), number.max() + 1
    pattern = Pattern(parts, number, (PETSc.COMM_SELF, n))
    one, other = (
        create_matrix(PETSc.COMM_SELF, (n, n), 1, pattern.indices, pattern.layout, pattern.total) for _ in range(2)
    )
    values = zeros(one, pattern.total)
    for own, blocks in zip(matrices, pattern.blocks, strict=True):
        add(own, blocks, values)
    set_values(one, values)
    assert np.abs(as_array(one) - dense(parts, number, matrices)).max() < 1e-14
    assert np.shares_memory(local_rows(one).own.values, values)
    assert other.norm() == 0.0
    in_part = Pattern(parts, numbers(HELD["both"]), (PETSc.COMM_SELF, int(numbers(HELD["both"]).max()) + 1))
    n = in_part.layout.own.start.size - 1
    made = create_matrix(PETSc.COMM_SELF, (n, n), 1, in_part.indices, in_part.layout, in_part.total)
    assert not np.shares_memory(zeros(made, in_part.total), local_rows(made).own.values)


@pytest.mark.parametrize("wrong", ["tied", "descends", "beyond the rows"])
def test_numbers_that_do_not_ascend_have_no_layout(wrong):
    """Compressed rows would not be theirs; the indices are."""
    parts, number = bodies(), numbers([])
    rows = number.max() + 1
    if wrong == "tied":
        number[[30, 31]] = number[[6, 7]]
    elif wrong == "descends":
        number[[8, 9]] = number[[9, 8]]
    else:
        rows -= 1
    pattern = Pattern(parts, number, (PETSc.COMM_SELF, rows))
    assert pattern.layout is None
    matrices = random_matrices(parts, 3)
    found, (row, column) = np.zeros((number.max() + 1,) * 2), pattern.indices()
    np.add.at(found, (row, column), entries_of(pattern, matrices))
    assert np.abs(found - dense(parts, number, matrices)).max() < 1e-13


def held_rod(held="xyz", tied="", elements=7, height=4.0, formulation="displacement"):
    space = Space.paper(straight(4, height=height), elements=elements, degree=2, order=2, quadrature="auto")
    ends = [Support.end(space, "start", held), Support.end(space, "end", "z" if tied else "xyz", tied=tied)]
    return Body(space, STIFF, 2.0, formulation), ends


def models():
    """A clamped rod; one held in part; one whose end is tied; two of two kinds; a closed one; and the mixed form."""
    found = {}
    for name, held, tied in (("clamped", "xyz", ""), ("in part", "xz", ""), ("tied", "xyz", "xy")):
        body, ends = held_rod(held, tied)
        found[name] = Model([body], ends)
    (first, ends), second = held_rod(), Space.paper(straight(6, height=3.0), elements=3, degree=3)
    found["two"] = Model([first, Body(second, STIFF, 1.0)], [*ends, Support.end(second, "end", body=1)])
    closed = Space.paper(arc(4.0, 360.0).sweep(circle(4, 0.5)), elements=8, degree=2, quadrature="auto")
    found["closed"] = Model([Body(closed, STIFF, 2.0)])
    body, ends = held_rod(formulation="mixed")
    found["mixed"] = Model([body], ends)
    return found


def own_rows(matrix):
    """Return this rank's rows of a matrix, and what is stored of them."""
    start, column, values = matrix.getValuesCSR()
    shape = start.size - 1, matrix.getSize()[1]
    stored = csr_matrix((np.ones(values.size), column, start), shape).toarray() > 0.0
    return csr_matrix((values, column, start), shape).toarray(), stored


def tangents(model, comm):
    """Return a tangent, of which there are two in turn, and masses."""
    assembler = assembler_for(model, comm)
    x = assembler.state(1e-2 * np.sin(np.arange(model.dofs)))
    stiffness = assembler.matrix()
    for factor in (0.5, 1.0):
        assembler.tangent(x, factor, stiffness)
    found = {"stiffness": stiffness}
    if type(assembler) is Assembler:
        found |= {"mass": assembler.mass(), "lumped": assembler.mass(lumped=True)}
        found["by components"] = assembler.mass_operator()
        found["operator"] = found["by components"].convert("aij", PETSc.Mat())
    return found, found["stiffness"].getAttr("isorod_pattern").layout is not None


def shifted(found):
    """Return whether a stiffness less the mass is the same in place as by PETSc, and whether it could be in place."""
    expected, made = (found["stiffness"].copy() for _ in range(2))
    expected.axpy(-3.7, found["operator"], PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
    done = add_componentwise(made, -3.7, found["by components"])
    return (own_rows(made)[0] == own_rows(expected if done else found["stiffness"])[0]).all(), done


def same_on_ranks(typed):
    """Compare matrices over all ranks with those of one (under mpirun); all ranks raise, or none."""
    warnings.simplefilter("ignore")
    wrong = []
    for name, model in models().items():
        with in_force({"mat_type": typed} if typed else None):
            found, laid_out = tangents(model, PETSc.COMM_WORLD)
        expected, _ = tangents(model, PETSc.COMM_SELF)
        if laid_out != (name != "tied" and not typed):
            wrong.append((name, "layout", laid_out))
        if "operator" in found:
            same, done = shifted(found)
            # Where components are held apart, or tied, there is no matrix of one of them.
            if not same or done != (name in ("clamped", "two", "closed") and not typed):
                wrong.append((name, "shifted", done))
        for which, matrix in found.items():
            if which == "by components":
                continue
            first, last = matrix.getOwnershipRange()
            values, stored = own_rows(matrix)
            others, theirs = own_rows(expected[which])
            gap = np.abs(values - others[first:last]).max(initial=0.0) / np.abs(others).max()
            if not gap < 1e-14 or (stored != theirs[first:last]).any():
                wrong.append((name, which, gap))
    everywhere = PETSc.COMM_WORLD.tompi4py().allgather(wrong)
    assert not any(everywhere), everywhere


@pytest.mark.mpi
@pytest.mark.parametrize(("ranks", "typed"), [(2, ""), (2, "mpiaij"), (4, "")])
def test_matrices_do_not_depend_on_the_number_of_ranks(ranks, typed, on_ranks):
    """More ranks than elements of a body, too; and of a type of the user's, which knows no layout."""
    on_ranks(ranks, f"test_pattern.same_on_ranks({typed!r})")
