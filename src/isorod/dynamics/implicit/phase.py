"""Phase error of implicit steps (period elongation), which grows with the number of oscillations.

For linear forces the step is the trapezoidal rule: with a frequency ``w`` the phase advances by ``2 atan(w dt / 2)``
instead of ``w dt``, a relative error of ``(w dt)^2 / 12`` (Hughes, The Finite Element Method, section 9.1).  The error
of an amplitude ``A`` with a phase lag ``f`` is ``2 A sin(f / 2)``, at most ``2 A``.

Amplitudes and frequencies follow from second and third differences of the motion over 1, 2, 4 ... steps, each of the
motion smoothed over the ones before: over a time ``s`` they are ``4 sin^2(w s / 2) A`` and ``8 sin^3(w s / 2) A``, and
zero for uniform motion.
"""

from collections.abc import Callable

import numpy as np

from isorod.arrays import Array

# Number of samples of a third difference.
_KEPT = 4

# Largest half phase of levels but the first: the next level has twice the phase, and smoothing reduces its amplitude.
_SLOW = np.pi / 4.0


class Phase:
    """The phase error of the steps of a motion so far.

    Parameters
    ----------
    heavy
        Returns the mass matrix times a vector of all degrees of freedom.
    displacement, increment
        At the start, shape ``(dofs,)``, and the velocity there times a step.
    """

    def __init__(self, heavy: Callable[[Array], Array], displacement: Array, increment: Array) -> None:
        self._heavy, self._start, self._increment = heavy, displacement, increment
        # Of each level the last samples, their number so far, and sums of the squares of second and third differences.
        self._samples: list[list[Array]] = []
        self._counts: list[int] = []
        self._sums: list[Array] = []
        self._farthest = 0.0

    def add(self, displacement: Array) -> None:
        """Add the state at the end of a step."""
        if not self._counts:
            # A state before the start, by reversing time.
            self._take(0, displacement - 2.0 * self._increment)
            self._take(0, self._start)
        self._farthest = max(self._farthest, self._square(displacement - self._start))
        self._take(0, displacement)

    def _take(self, level: int, sample: Array) -> None:
        """Add a sample to a level; every second one, smoothed, goes to the next level."""
        if level == len(self._counts):
            self._samples.append([])
            self._counts.append(0)
            self._sums.append(np.zeros(2))
        kept = self._samples[level] = [*self._samples[level], sample][-_KEPT:]
        self._counts[level] += 1
        for order in (2, 3):
            if len(kept) > order:
                self._sums[level][order - 2] += self._square(np.diff(kept[-order - 1 :], order, axis=0)[0])
        if self._counts[level] > 2 and self._counts[level] % 2:
            self._take(level + 1, 0.25 * (kept[-3] + 2.0 * kept[-2] + kept[-1]))

    def _square(self, vector: Array) -> float:
        return float(vector @ self._heavy(vector))

    def error(self) -> float | None:
        """Return the largest error of the displacement relative to the largest displacement; None for a single step."""
        errors, steps = [0.0], (self._counts or [0])[0] - 2
        for level, (count, (second, third)) in enumerate(zip(self._counts, self._sums, strict=True)):
            if count < _KEPT or not second:
                continue
            half = np.arcsin(min(1.0, 0.5 * np.sqrt(third / (count - 3) / (second / (count - 2)))))
            if level and half > _SLOW:
                # The level before is more accurate.
                continue
            # Half phases of the levels before, for their smoothing.
            halves = half / 2.0 ** np.arange(1, level + 1)
            amplitude = np.sqrt(2.0 * second / (count - 2)) / (4.0 * np.sin(half) ** 2 * np.prod(np.cos(halves) ** 2))
            late = 2.0 * steps * (np.tan(half / 2.0**level) - half / 2.0**level)
            errors.append(2.0 * amplitude * np.sin(0.5 * min(late, np.pi)))
        if steps < 2 or not self._farthest:
            return None
        return float(min(1.0, max(errors) / np.sqrt(self._farthest)))

    def state(self) -> dict[str, Array]:
        """Return the state for `restore`."""
        kept = np.zeros((len(self._counts), _KEPT, self._start.size))
        for row, samples in zip(kept, self._samples, strict=True):
            row[: len(samples)] = samples
        sums = np.reshape(self._sums, (-1, 2))
        counts = np.array(self._counts, dtype=np.int64)
        return {"phase": kept, "phase_sums": sums, "phase_counts": counts, "farthest": np.array(self._farthest)}

    def restore(self, kept: dict[str, Array]) -> None:
        """Continue from the result of `state`."""
        self._counts = [int(count) for count in kept["phase_counts"]]
        self._samples = [list(row[:count]) for row, count in zip(kept["phase"], self._counts, strict=True)]
        self._sums = [row.copy() for row in kept["phase_sums"]]
        self._farthest = float(kept["farthest"])
