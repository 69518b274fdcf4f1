"""Two ropes, one of which comes to rest on the other without friction: by statics with contact.

Both are straight at rest, the upper one above the lower one by more than they can sag.  Their ends first come as near
each other as the scenario has them, while the weight grows; then the upper rope's come down to where they belong.
"""

import warnings
from typing import Any

import numpy as np

import isorod
from comparisons.referee.rods import PINNED, Placed, configuration, held, loads, place
from comparisons.referee.touching import near, pairs
from isorod.arrays import Array

# The equal steps to start with, short since slender ropes hardly resist the first of their weight, and the load factor
# from which the ends come down.
STEPS, DOWN = 1000, 0.75

_SMALL = 1e-9


def takes(scenario: Any, elements: int) -> bool:
    """Return whether a scenario is such a one."""
    rods = scenario.rods
    return (
        scenario.quasi_static
        and not scenario.obstacles
        and not scenario.self_contact
        and len(rods) == 2
        and len(pairs(scenario, elements)) == 1
        and np.count_nonzero(scenario.gravity) == 1
        and all(rod.friction == 0.0 and (rod.start.value, rod.end.value) == (PINNED, PINNED) for rod in rods)
    )


def solve(scenario: Any, elements: int) -> list[tuple[Array, Array]]:
    """Return nodes and directors (`comparisons.referee.rods.configuration`) of each rope, in equilibrium.

    A pin holds two points of a section's outline, which deforms round them; so it is solved twice, the second time
    with these where the section's mean is right.
    """
    up = -np.sign(np.asarray(scenario.gravity, dtype=float))
    first, second = scenario.rods
    both = tuple(near(one, other, elements).tolist() for one, other in ((first, second), (second, first)))
    placed = [
        place(rod, elements, True, rest=rest) for rod, rest in zip(scenario.rods, _rests(scenario, up), strict=True)
    ]
    contact = isorod.Contact(0, 1, first_elements=both[0], second_elements=both[1])
    bodies = [one.body for one in placed]
    weight = [load for k, one in enumerate(placed) for load in loads(one, scenario.gravity, k)]
    off, last, start = np.zeros((2, 2, 3)), [], None
    for _ in range(2):
        held_by = [one for k, rope in enumerate(placed) for one in _supports(rope, k, up, off[k])]
        model = isorod.Model(bodies, held_by, loads=weight, contacts=[contact])
        with warnings.catch_warnings():
            # Peak pressures, which the contact warns of, are not looked at.
            warnings.filterwarnings("ignore", message="contact 0: ")
            state = isorod.statics.solve(model, STEPS, start=start)
        last = [configuration(one, state, k, elements) for k, one in enumerate(placed)]
        off += [rod.nodes(1) - nodes[[0, -1]] for rod, (nodes, _) in zip(scenario.rods, last, strict=True)]
        start = state.displacement
    return last


def _rests(scenario: Any, up: Array) -> list[Array]:
    """Return how much higher each rope is at rest than where it starts, ``(3,)``."""
    points = [rod.nodes(100) for rod in scenario.rods]
    apart = np.linalg.norm(points[0][:, None] - points[1], axis=2)
    nearest = np.unravel_index(int(np.argmin(apart)), apart.shape)
    upper = int(np.argmax([rope[k] @ up for rope, k in zip(points, nearest, strict=True)]))
    below = (points[1 - upper][[0, -1]] @ up).max()
    # No rope sags by more than half its length, and what stretch adds has room in how far the lower one does.
    high = max(below - (points[upper][[0, -1]] @ up).min() + 0.5 * scenario.rods[upper].length, 0.0)
    return [high * up if k == upper else np.zeros(3) for k in (0, 1)]


def _supports(placed: Placed, body: int, up: Array, off: Array) -> list[isorod.Support]:
    """Return supports that take a rope's ends to their places, and ``off``, ``(2, 3)``, more.

    The second one goes round half a circle, level, so that the ends come nearer with the square of the load factor,
    while the weight grows with the factor: the rope sags before it is pushed, and does not buckle.
    """
    vertical = "xyz"[int(np.argmax(np.abs(up)))]
    level = "xyz".replace(vertical, "")
    supports = []
    for (which, how), more in zip(placed.ends(), off, strict=True):
        nodes = placed.layer(which)
        moved = placed.initial[nodes].mean(axis=0) + more
        arm = -0.5 * (moved - (moved @ up) * up)
        turn = np.pi * up if np.linalg.norm(arm) > _SMALL else np.zeros(3)
        for some, _ in held(placed, which, how):
            arms = np.tile(arm, (some.size, 1))
            supports.append(isorod.Support(some, level, body=body, turn=tuple(turn), arms=arms, during=(0.0, DOWN)))
            supports.append(isorod.Support(some, vertical, moved, body, during=(DOWN, 1.0)))
    return supports
