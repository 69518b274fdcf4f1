"""Progress of runs on standard error: a line that is updated on a terminal, elsewhere a line now and then.

Short runs show nothing.
"""

import sys
from collections.abc import Callable
from time import perf_counter

from isorod.output.words import duration

# Seconds before the first line and between lines; the same on a terminal.
_FIRST, _BETWEEN = 6.0, 20.0
_FIRST_SHOWN, _BETWEEN_SHOWN = 1.0, 0.2


class Reporter:
    """Shows lines, not too often; called with a function that returns the line."""

    def __init__(self) -> None:
        self.start = perf_counter()
        self.shows = sys.stderr.isatty()
        self._next = self.start + (_FIRST_SHOWN if self.shows else _FIRST)
        self._shown = False

    def __call__(self, line: Callable[[], str]) -> None:
        """Show the line, if it is time for one."""
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
    """Shows the fraction done and the remaining time; called with the time reached.

    Parameters
    ----------
    begin, end
        Time at which the run starts or continues, and time to reach.
    what
        Name of the quantity, if not time.
    """

    def __init__(self, begin: float, end: float, name: str = "time") -> None:
        self._begin, self._end, self._name = begin, end, name
        self._reporter = Reporter()
        self.close = self._reporter.close

    def __call__(self, time: float) -> None:
        """Show the progress, if it is time to."""
        if time > self._begin:
            self._reporter(lambda: self._line(time))

    def _line(self, time: float) -> str:
        elapsed = perf_counter() - self._reporter.start
        left = duration(elapsed * max(0.0, self._end - time) / (time - self._begin))
        text = f"{self._name} {time:.4g} of {self._end:.4g}, {time / self._end:.0%}, about {left} to go"
        return f"[{'=' * int(30 * min(1.0, time / self._end)):30s}] {text}" if self._reporter.shows else text
