"""How far implicit steps are off in time: what swings comes late, and the later the more often it has swung.

For linear forces the step is the trapezoidal rule: with a frequency ``w`` phase advances by ``2 atan(w dt / 2)`` in the
place of ``w dt``, a share of ``(w dt)^2 / 12`` too little (Hughes, The Finite Element Method, section 9.1), and an
amplitude ``A`` that is late by a phase ``f`` is off by ``2 A sin(f / 2)``, by ``2 A`` at the most.

Amplitudes and frequencies are those of second and third differences of the motion over 1, 2, 4 ... steps, each of the
motion smoothed over those before: over a time ``s`` they are ``4 sin^2(w s / 2) A`` and ``8 sin^3(w s / 2) A``, and
uniform motion is in neither.
"""

from collections.abc import Callable

import numpy as np

from isorod.arrays import Array

# Samples that a third difference takes.
_KEPT = 4

# Half a phase that levels but the first are for: the next one sees twice as much, and smoothing leaves less of it.
_SLOW = np.pi / 4.0


class Phase:
    """The error of the steps of a motion so far.

    Parameters
    ----------
    heavy
        Returns the mass matrix times a vector of all degrees of freedom.
    displacement, way
        At the start, shape ``(dofs,)``, and the velocity there times a step.
    """

    def __init__(self, heavy: Callable[[Array], Array], displacement: Array, way: Array) -> None:
        self._heavy, self._start, self._way = heavy, displacement, way
        # Of each level the last samples, how many there were, and sums of the squares of second and third differences.
        self._samples: list[list[Array]] = []
        self._counts: list[int] = []
        self._sums: list[Array] = []
        self._farthest = 0.0

    def add(self, displacement: Array) -> None:
        """Take the state at the end of a step."""
        if not self._counts:
            # Before the start, as far as a reversal of time tells.
            self._take(0, displacement - 2.0 * self._way)
            self._take(0, self._start)
        self._farthest = max(self._farthest, self._square(displacement - self._start))
        self._take(0, displacement)

    def _take(self, level: int, sample: Array) -> None:
        """Take a sample of a level; the next has every second one, smoothed."""
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
        """Return the largest error of the displacement relative to the largest there was; None of a single step."""
        found, steps = [0.0], (self._counts or [0])[0] - 2
        for level, (count, (second, third)) in enumerate(zip(self._counts, self._sums, strict=True)):
            if count < _KEPT or not second:
                continue
            half = np.arcsin(min(1.0, 0.5 * np.sqrt(third / (count - 3) / (second / (count - 2)))))
            if level and half > _SLOW:
                # The level before tells better.
                continue
            # Of half a step of each level before.
            halves = half / 2.0 ** np.arange(1, level + 1)
            amplitude = np.sqrt(2.0 * second / (count - 2)) / (4.0 * np.sin(half) ** 2 * np.prod(np.cos(halves) ** 2))
            late = 2.0 * steps * (np.tan(half / 2.0**level) - half / 2.0**level)
            found.append(2.0 * amplitude * np.sin(0.5 * min(late, np.pi)))
        if steps < 2 or not self._farthest:
            return None
        return float(min(1.0, max(found) / np.sqrt(self._farthest)))

    def state(self) -> dict[str, Array]:
        """Return what `restore` takes."""
        kept = np.zeros((len(self._counts), _KEPT, self._start.size))
        for row, samples in zip(kept, self._samples, strict=True):
            row[: len(samples)] = samples
        sums = np.reshape(self._sums, (-1, 2))
        counts = np.array(self._counts, dtype=np.int64)
        return {"phase": kept, "phase_sums": sums, "phase_counts": counts, "farthest": np.array(self._farthest)}

    def restore(self, kept: dict[str, Array]) -> None:
        """Go on from what `state` returned."""
        self._counts = [int(one) for one in kept["phase_counts"]]
        self._samples = [list(row[:count]) for row, count in zip(kept["phase"], self._counts, strict=True)]
        self._sums = [row.copy() for row in kept["phase_sums"]]
        self._farthest = float(kept["farthest"])
