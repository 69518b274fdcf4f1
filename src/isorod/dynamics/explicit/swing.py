"""How far explicit steps are off in time: what swings comes early, and the earlier the more often it has swung.

Of a frequency ``w`` central differences make ``2 asin(w dt / 2) / dt``, a share of ``(w dt)^2 / 24`` too much (Hughes,
The Finite Element Method, section 9.1): an amplitude ``A`` is off by ``A w T (w dt)^2 / 24`` after a time ``T``, and by
``2 A`` at the most.  Sums over all modes of ``(A w^3)^2`` are squares of the third derivative by time, in the norm of
mass; so the error is that times ``T dt^2 / 24``, or less where what is fast has lost its phase: amplitude and frequency
are those that two derivatives in a row would have of one mode.
"""

import numpy as np

from isorod.arrays import Array


class Swing:
    """The error of the steps of a motion so far.

    Attributes
    ----------
    sums
        Number of outputs, sums of the squares of the first, second and third derivative at them, and the square of the
        largest displacement from the start.
    """

    def __init__(self) -> None:
        self.sums = np.zeros(5)

    def add(self, squares: Array, way: float) -> None:
        """Take the squares of three derivatives at an output ``(3,)``, and that of the way from the start."""
        self.sums[0] += 1.0
        self.sums[1:4] += squares
        self.sums[4] = max(self.sums[4], way)

    def error(self, time: float, step: float) -> float | None:
        """Return the error at a time of steps, relative to the largest displacement; None where nothing moved."""
        count, *_, farthest = self.sums
        if count < 2.0 or not farthest > 0.0:
            return None
        speed, force, jerk = np.sqrt(2.0 * self.sums[1:4] / count).tolist()
        found = [0.0]
        for slower, faster in ((speed, force), (force, jerk)):
            if slower > 0.0 and faster > 0.0:
                frequency = faster / slower
                amplitude = speed / frequency if slower == speed else force / frequency**2
                found.append(amplitude * min(2.0, frequency**3 * step**2 * time / 24.0))
        return min(1.0, max(found) / float(np.sqrt(farthest)))
