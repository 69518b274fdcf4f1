"""Warm starts: where the points before it in a sweep say that an equilibrium is."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from isorod.arrays import Array

# Points that are extrapolated from, at least and at most.
LEAST, MOST = 3, 4

# How much the last of these may change the way from the point before: what it changes more does not go on smoothly.
SMOOTH = 0.1

# Bytes that displacements of points before may take.
ROOM = 2**28


class _State(NamedTuple):
    """A displacement ``(dofs,)``, and the discretisation that it is on."""

    displacement: Array
    space: list[dict[str, Any]]


class Warm:
    """Displacements of the last points of a grid, and what they say of the next one.

    A point lies on a line of the grid in each direction.  Along that with the most points before it the polynomial
    through the last of them is extrapolated, of the third degree if there are four.

    Parameters
    ----------
    values
        What is varied, as it would be typed; along what are not numbers nothing is extrapolated.
    """

    def __init__(self, values: Sequence[Sequence[str]]) -> None:
        self._values = [_numbers(one) for one in values]
        self._kept: dict[tuple[int, ...], _State] = {}
        # What is farther back is looked at no more.
        self._most = MOST * int(np.prod([len(one) for one in values[1:]], dtype=int))

    def near(self, index: tuple[int, ...], model: Any) -> Array | None:
        """Return a displacement near the equilibrium of a point, None where that is not known.

        Parameters
        ----------
        index
            Of the point in the grid.
        model
            That of the point: statics without contact, which depends on the way there.
        """
        if model.contacts:
            return None
        space = _space(model)
        lines = [
            (numbers[index[d]], line)
            for d, numbers in enumerate(self._values)
            if numbers is not None and len(line := self._line(index, d, numbers, space)) >= LEAST
        ]
        # Of directions with as many points the last one, of which the next point has most.
        return _extrapolated(*max(reversed(lines), key=lambda one: len(one[1]))) if lines else None

    def keep(self, index: tuple[int, ...], solution: Any) -> None:
        """Keep what was found at a point."""
        if solution.model.contacts:
            return
        state = _State(solution.displacement, _space(solution.model))
        self._kept[index] = state
        while len(self._kept) > min(self._most, max(MOST, ROOM // max(state.displacement.nbytes, 1))):
            del self._kept[next(iter(self._kept))]

    def _line(
        self, index: tuple[int, ...], direction: int, numbers: Sequence[float], space: list[dict[str, Any]]
    ) -> list[tuple[float, Array]]:
        """Return the last points before one in a direction, the nearest first: their values, and displacements."""
        found = []
        for k in range(index[direction] - 1, max(-1, index[direction] - 1 - MOST), -1):
            state = self._kept.get((*index[:direction], k, *index[direction + 1 :]))
            if state is None or state.space != space:
                break
            found.append((numbers[k], state.displacement))
        return found


def _numbers(values: Sequence[str]) -> list[float] | None:
    try:
        return [float(one) for one in values]
    except ValueError:
        return None


def _space(model: Any) -> list[dict[str, Any]]:
    return [body.discretisation for body in model.bodies]


def _extrapolated(x: float, line: Sequence[tuple[float, Array]]) -> Array | None:
    """Return the polynomial through points of a line at ``x``, None if the last one bends it much."""
    at, states = [one[0] for one in line], [one[1] for one in line]
    far = sum(w * u for w, u in zip(_weights(x, at), states, strict=True))
    less = sum(w * u for w, u in zip(_weights(x, at[:-1]), states[:-1], strict=True))
    smooth = np.linalg.norm(far - less) <= SMOOTH * np.linalg.norm(far - states[0])
    return np.asarray(far) if smooth else None


def _weights(x: float, at: Sequence[float]) -> list[float]:
    """Return Lagrange's polynomials of some places at ``x``."""
    return [float(np.prod([(x - other) / (one - other) for other in at if other != one])) for one in at]
