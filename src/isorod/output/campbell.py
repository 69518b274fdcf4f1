"""Campbell diagrams: frequencies over the speed of a spin, and lines of engine order across them."""

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array

# The highest order there is a line of, and what its column is called.
_HIGHEST, LINE = 6, "order "

# An error of a speed that is said, relative.
_LARGE = 0.005


class Crossing(NamedTuple):
    """Where what acts so often a revolution meets a frequency: angular velocity, cycles per time, relative error."""

    order: int
    curve: str
    speed: float
    frequency: float
    error: float

    def __str__(self) -> str:
        about = f", may be {100.0 * self.error:.2g} % off: give more speeds there" if self.error > _LARGE else ""
        return f"order {self.order} meets {self.curve} at {self.speed:.5g}, frequency {self.frequency:.5g}{about}"


def with_orders(columns: Mapping[str, Array]) -> dict[str, Array]:
    """Return columns with more, ``order 1`` and so on: frequencies ``n |speed| / 2 pi`` of what turns with the spin.

    The first column is the speed, radians per time.  Those of the lines are left out that meet no frequency.
    """
    found = dict(columns)
    met = {one.order for one in crossings(columns)}
    speed = np.abs(next(iter(columns.values())))
    return found | {f"{LINE}{n}": n * speed / (2.0 * np.pi) for n in sorted(met)}


def crossings(columns: Mapping[str, Array]) -> list[Crossing]:
    """Return where lines of engine order meet frequencies, by order.

    Between two speeds squares of frequencies are straight over the square of the speed, as those of blades nearly are,
    which stiffen; those of round shafts are straight over the speed.  How far both are apart is the error.
    """
    (given, *_), found = columns.values(), []
    rows = np.argsort(np.asarray(given, dtype=float))
    speed = np.asarray(given, dtype=float)[rows]
    turns = (speed / (2.0 * np.pi)) ** 2
    for name, values in columns.items():
        if not re.match(r"frequenc", name):
            continue
        column = values[rows]
        for n in range(1, _HIGHEST + 1):
            off = column**2 - n**2 * turns
            for k in np.flatnonzero((off[:-1] > 0.0) != (off[1:] > 0.0)):
                if not np.isfinite(off[k : k + 2]).all() or speed[k] * speed[k + 1] < 0.0:
                    continue
                share = off[k] / (off[k] - off[k + 1])
                rate = np.sqrt(turns[k] + share * (turns[k + 1] - turns[k]))
                sign, ends = -1.0 if min(speed[k : k + 2]) < 0.0 else 1.0, np.sqrt(turns[k : k + 2])
                gaps = column[k : k + 2] - n * ends
                other = ends[0] + gaps[0] / (gaps[0] - gaps[1]) * (ends[1] - ends[0])
                error = float(abs(other / rate - 1.0)) if rate else 0.0
                found.append(Crossing(n, name, float(sign * 2.0 * np.pi * rate), float(n * rate), error))
    return sorted(found, key=lambda one: (one.order, abs(one.speed)))
