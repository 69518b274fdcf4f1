"""How far a run is, on standard error: a line on a terminal that changes, elsewhere one now and then.

Short runs show nothing.
"""

import sys
from collections.abc import Callable
from time import perf_counter

from isorod.output.words import duration

# Seconds before the first word, and between two; on a terminal.
_FIRST, _BETWEEN = 6.0, 20.0
_FIRST_SHOWN, _BETWEEN_SHOWN = 1.0, 0.2


class Teller:
    """Called with what makes a line, says that line if it is time to."""

    def __init__(self) -> None:
        self.start = perf_counter()
        self.shows = sys.stderr.isatty()
        self._next = self.start + (_FIRST_SHOWN if self.shows else _FIRST)
        self._shown = False

    def __call__(self, line: Callable[[], str]) -> None:
        """Say it, if it is time to."""
        now = perf_counter()
        if now < self._next:
            return
        self._next = now + (_BETWEEN_SHOWN if self.shows else _BETWEEN)
        self._shown = True
        if self.shows:
            print(f"\r{line()}\x1b[K", end="", file=sys.stderr, flush=True)
        else:
            print(f"isorod: {line()}", file=sys.stderr, flush=True)

    def close(self) -> None:
        """End the line on a terminal."""
        if self.shows and self._shown:
            print(file=sys.stderr, flush=True)


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
        self._teller = Teller()
        self.close = self._teller.close

    def __call__(self, time: float) -> None:
        """Say how far it is, if it is time to."""
        if time > self._begin:
            self._teller(lambda: self._line(time))

    def _line(self, time: float) -> str:
        gone = perf_counter() - self._teller.start
        left = duration(gone * max(0.0, self._end - time) / (time - self._begin))
        text = f"{self._what} {time:.4g} of {self._end:.4g}, {time / self._end:.0%}, about {left} to go"
        return f"[{'=' * int(30 * min(1.0, time / self._end)):30s}] {text}" if self._teller.shows else text
