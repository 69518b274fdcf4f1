"""Which elements and rows a rank has, without MPI."""

import numpy as np
import pytest

from isorod import Body, Model, NeoHookean, Space
from isorod.assembly.partition import Partition
from isorod.assembly.unknowns import Unknowns
from isorod.scenes.ring import Ring


@pytest.fixture
def model(cylinder):
    spaces = [
        Space.paper(cylinder(4), elements=3),
        Space.paper(Ring().rod()),
        Space.paper(cylinder(5, height=2.0), elements=2, order=2),
    ]
    return Model([Body(space, NeoHookean(1.0, 0.3)) for space in spaces])


def split_of(model, size):
    return Partition(model, 3 * model.first_node, [Unknowns.layer_dofs(body) for body in model.bodies], size)


@pytest.mark.parametrize("size", [1, 2, 3, 7, 40])
def test_each_element_is_on_one_rank_and_shares_are_equal(model, size):
    split = split_of(model, size)
    found = [[(s.which, e) for s in split.element_ranges(rank) for e in range(s.first, s.last)] for rank in range(size)]
    bodies = model.bodies
    assert [one for own in found for one in own] == [
        (b, e) for b, body in enumerate(bodies) for e in range(body.space.axis.elements)
    ]
    counts = [len(own) for own in found]
    assert max(counts) - min(counts) <= 1


@pytest.mark.parametrize("size", [2, 3, 7])
def test_a_rank_owns_the_layers_whose_first_element_it_has(model, size):
    split = split_of(model, size)
    owner = split.owners()
    first = np.full(owner.size, size)
    for rank in reversed(range(size)):
        for share in split.element_ranges(rank):
            first[share.dofs] = rank
    assert np.array_equal(owner, first)


def test_numbers_of_displacements_are_all_where_there_is_nothing_else(model):
    assert np.array_equal(split_of(model, 2).numbers(), np.arange(model.dofs))
