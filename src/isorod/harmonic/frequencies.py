"""Frequencies of a response."""

from dataclasses import dataclass

import numpy as np

from isorod.arrays import Array
from isorod.errors import Checked, InputError, numbers, whole_number

# Frequencies round a resonance, in half-widths of its peak: enough to draw it, and for a parabola through its top.
_ROUND = np.array([0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0])

_MOST = 1_000_000


@dataclass(frozen=True)
class Span(Checked):
    """A range of frequencies, refined round each resonance.

    Parameters
    ----------
    first, last
        Cycles per time, both included.
    count
        Number of frequencies, without those round resonances.
    log
        Whether they are evenly spaced in their logarithm.
    """

    first: float
    last: float
    count: int = 200
    log: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.first < self.last < np.inf:
            raise InputError(f"frequencies: got {self.first:g} to {self.last:g}, need 0 or more, ascending")
        whole_number("frequencies: count", self.count, 2, _MOST)
        if self.log and not self.first > 0.0:
            raise InputError("frequencies: a logarithmic span begins above 0")

    @property
    def values(self) -> Array:
        """The frequencies, ascending."""
        return (np.geomspace if self.log else np.linspace)(self.first, self.last, self.count)

    def around(self, resonances: Array, ratios: Array) -> Array:
        """Return these frequencies and those round resonances, given with their damping ratios."""
        away = np.concatenate([-_ROUND[:0:-1], _ROUND])
        more = (resonances[:, None] * (1.0 + ratios[:, None] * away)).ravel()
        return np.unique(np.concatenate([self.values, more[(more >= self.first) & (more <= self.last)]]))


def checked(frequencies: object) -> "Span | Array":
    """Return a span as it is, or a list of frequencies, checked, ``(n,)``, ascending."""
    if isinstance(frequencies, Span):
        return frequencies
    values = numbers("frequencies", frequencies)
    values = values.reshape(-1) if values.ndim < 2 else values
    if values.ndim != 1 or not 1 <= values.size <= _MOST:
        raise InputError("frequencies: need one or more numbers, cycles per time")
    if not (np.isfinite(values).all() and (values >= 0.0).all()):
        bad = values[~(np.isfinite(values) & (values >= 0.0))][0]
        raise InputError(f"frequencies: got {bad:g}, need numbers that are not negative")
    return np.unique(values)
