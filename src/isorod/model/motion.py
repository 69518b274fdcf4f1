"""Prescribed motion of a support's degrees of freedom by the load factor."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.model.history import Clock
from isorod.tensors import cross, rotation, turning


class SupportMotion(NamedTuple):
    """Prescribed motion of degrees of freedom ``dofs`` ``(m,)`` by one support.

    Component ``a`` of ``path(f) + (R(f turn) - 1) arm`` is the displacement of those that are held, and of those that
    are ``tied`` the difference from their common unknown, one a component.  ``f`` is the load factor, or its fraction
    of the interval ``during``.  ``path`` ``(s + 1, m)`` has displacements at ``f = 0, 1/s, ..., 1``, linear between
    them.  In motions ``f`` is the value of the ``clock``, and ``path`` has one segment.
    """

    dofs: Index
    path: Array
    arms: Array
    turn: Array
    tied: NDArray[np.bool_]
    during: tuple[float, float] = (0.0, 1.0)
    clock: Clock = Clock()

    @property
    def farthest(self) -> float:
        """The largest angle by which it turns, radians."""
        factors = (1.0,) if self.clock.table is None else self.clock.table.factors
        return float(np.linalg.norm(self.turn) * np.abs(factors).max())

    def driven(self, factor: float = 1.0) -> Array:
        """Return the derivative by ``f`` of prescribed displacements at the end, shape ``(m,)``, times ``factor``.

        Its product with nodal forces is forces times displacements plus moments times rotations.  ``factor`` is the
        value of ``f`` at the end, 1 unless a table ends at another.
        """
        rates = factor * (len(self.path) - 1) * (self.path[-1] - self.path[-2])
        if not self.turn.any():
            return rates
        spin = cross(factor * self.turn) @ rotation(factor * self.turn)
        return np.asarray(rates + np.einsum("ma,ma->m", spin[self.dofs % 3], self.arms))

    def at(self, factor: float) -> Array:
        """Return the prescribed part of the displacements at a load factor, shape ``(m,)``."""
        begin, end = self.during
        if (begin, end) != (0.0, 1.0):
            factor = min(1.0, max(0.0, (factor - begin) / (end - begin)))
        legs = len(self.path) - 1
        leg = max(0, min(int(factor * legs), legs - 1))
        result = self.path[leg] + (factor * legs - leg) * (self.path[leg + 1] - self.path[leg])
        if self.turn.any():
            rows = turning(factor * self.turn)[self.dofs % 3]
            result = result + np.einsum("ma,ma->m", rows, self.arms)
        return result

    def velocity(self, time: float, before: bool = False) -> Array:
        """Return prescribed velocities after a time, or ``before`` it, shape ``(m,)``."""
        rate = self.clock.rate(time, before)
        return rate * self.path[-1] + self._turning(time, rate * cross(self.turn))

    def acceleration(self, time: float) -> Array:
        """Return prescribed accelerations, shape ``(m,)``."""
        rate, grows = 0.5 * (self.clock.rate(time, False) + self.clock.rate(time, True)), self.clock.acceleration(time)
        spin = cross(self.turn)
        return grows * self.path[-1] + self._turning(time, grows * spin + rate**2 * spin @ spin)

    def _turning(self, time: float, spin: Array) -> Array:
        """Return a matrix ``(3, 3)`` times the arms in their orientation at a time."""
        rows = (spin @ rotation(self.clock.at(time) * self.turn))[self.dofs % 3]
        return np.asarray(np.einsum("ma,ma->m", rows, self.arms))
