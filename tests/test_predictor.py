"""The first guess of a load step: straight in the first, then the cubic through two equilibria with their tangents."""

import numpy as np
import pytest
from conftest import straight

from isorod import Body, Model, NeoHookean, Space, Support, statics


def bent(size, turn):
    """A bar whose end is moved and turned, the more the larger the size."""
    space = Space.paper(straight(4, height=4.0), elements=3, degree=2)
    move = tuple(size * np.array([0.8, 0.3, -0.2]))
    end = Support.end(space, "end", displacement=move, turn=tuple(size * np.array(turn)))
    return Model([Body(space, NeoHookean(1.0, 0.3))], [Support.end(space, "start"), end])


# Where supports turn, the first step goes their whole way, straight: the slope at the start is known from the third
# step on.
@pytest.mark.parametrize(
    ("turn", "load_steps", "steps", "order"),
    [
        ((0.0, 0.0, 0.0), 1, 1, 2),
        ((0.0, 0.0, 0.0), 3, 2, 4),
        ((0.0, 0.0, 0.0), 2, 2, 4),
        ((0.0, 0.0, 0.0), 7, 3, 4),
        ((0.1, -0.3, 0.4), 1, 1, 2),
        ((0.1, -0.3, 0.4), 7, 3, 4),
    ],
)
def test_error_of_the_prediction_falls_with_its_order(turn, load_steps, steps, order):
    """Force out of balance after it, as paths shrink: of order two in size from one equilibrium, four from two."""
    norms = []
    for size in (0.4, 0.2):
        solution = statics.solve(bent(size, turn), load_steps)
        assert (solution.load_steps, solution.cuts) == (steps, 0)
        norms.append(solution.residual_norms[1])
    found = np.log2(norms[0] / norms[1])
    print("out of balance", norms, "order", found)
    assert found == pytest.approx(order, abs=0.3)
