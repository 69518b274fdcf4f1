"""How far a motion or a sweep is, on standard error: a bar on a terminal, elsewhere a line now and then.

Nothing is said of what is short.
"""

import sys
from time import perf_counter

from isorod.output.words import duration

# Seconds before the first word, and between two.
_FIRST, _BETWEEN = 6.0, 20.0
_FIRST_OF_BAR, _BETWEEN_BARS = 1.0, 0.2


class Progress:
    """Called with the time reached, says what share of the way that is and how long the rest takes.

    Parameters
    ----------
    begin, end
        Time at which the run starts or continues, and time to reach.
    what
        What counts, if not time.
    """

    def __init__(self, begin: float, end: float, what: str = "time") -> None:
        self._begin, self._end, self._what = begin, end, what
        self._start = perf_counter()
        self._bar = sys.stderr.isatty()
        self._next = self._start + (_FIRST_OF_BAR if self._bar else _FIRST)
        self._shown = False

    def __call__(self, time: float) -> None:
        """Say how far it is, if it is time to."""
        now = perf_counter()
        if now < self._next or not time > self._begin:
            return
        self._next = now + (_BETWEEN_BARS if self._bar else _BETWEEN)
        self._shown = True
        left = duration((now - self._start) * max(0.0, self._end - time) / (time - self._begin))
        text = f"{self._what} {time:.4g} of {self._end:.4g}, {time / self._end:.0%}, about {left} to go"
        if self._bar:
            bar = "=" * int(30 * min(1.0, time / self._end))
            print(f"\r[{bar:30s}] {text}\x1b[K", end="", file=sys.stderr, flush=True)
        else:
            print(f"isorod: {text}", file=sys.stderr, flush=True)

    def close(self) -> None:
        """End the line of the bar."""
        if self._bar and self._shown:
            print(file=sys.stderr, flush=True)
