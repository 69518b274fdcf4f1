"""How what is held and what is tied together moves with a rod: rows of its rigid motions."""

import numpy as np

from isorod.checks import groups


def test_components_that_are_the_same_unknown_must_move_alike():
    """Also those of the first unknown; what is held must not move at all."""
    moved = np.array([[1.0, 0.0], [3.0, 1.0], [0.0, 2.0], [5.0, 7.0], [0.0, 5.0]])
    found = groups._held(np.array([0, 0, 1, -1, 1]), moved)
    np.testing.assert_array_equal(found, [[5.0, 7.0], [2.0, 1.0], [0.0, 3.0]])
