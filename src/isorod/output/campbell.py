"""Campbell diagrams: frequencies over the speed of a spin, and lines of engine order across them."""

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array

# The highest engine order, and the beginning of the names of its columns.
_HIGHEST, LINE = 6, "order "

# Relative error of a speed from which it is reported.
_LARGE = 0.005


class Crossing(NamedTuple):
    """A crossing of an engine order and a frequency: angular velocity, cycles per time, relative error."""

    order: int
    curve: str
    speed: float
    frequency: float
    error: float

    def __str__(self) -> str:
        about = f", may be {100.0 * self.error:.2g} % off: give more speeds there" if self.error > _LARGE else ""
        return f"order {self.order} meets {self.curve} at {self.speed:.5g}, frequency {self.frequency:.5g}{about}"


def with_orders(columns: Mapping[str, Array]) -> dict[str, Array]:
    """Return columns with those of engine orders, ``order 1`` and so on: frequencies ``n |speed| / 2 pi``.

    The first column is the speed, radians per time.  Orders that cross no frequency are left out.
    """
    result = dict(columns)
    orders = {crossing.order for crossing in crossings(columns)}
    speed = np.abs(next(iter(columns.values())))
    return result | {f"{LINE}{n}": n * speed / (2.0 * np.pi) for n in sorted(orders)}


def crossings(columns: Mapping[str, Array]) -> list[Crossing]:
    """Return the crossings of engine orders with frequencies, by order.

    Between two speeds squares of frequencies are interpolated linearly over the squared speed, as suits blades, which
    stiffen.  The error is the difference to linear interpolation over the speed, as suits round shafts.
    """
    (speeds, *_), result = columns.values(), []
    rows = np.argsort(np.asarray(speeds, dtype=float))
    speed = np.asarray(speeds, dtype=float)[rows]
    turns = (speed / (2.0 * np.pi)) ** 2
    for name, values in columns.items():
        if not re.match(r"frequenc", name):
            continue
        column = values[rows]
        for n in range(1, _HIGHEST + 1):
            difference = column**2 - n**2 * turns
            for k in np.flatnonzero((difference[:-1] > 0.0) != (difference[1:] > 0.0)):
                if not np.isfinite(difference[k : k + 2]).all() or speed[k] * speed[k + 1] < 0.0:
                    continue
                fraction = difference[k] / (difference[k] - difference[k + 1])
                rate = np.sqrt(turns[k] + fraction * (turns[k + 1] - turns[k]))
                sign, ends = -1.0 if min(speed[k : k + 2]) < 0.0 else 1.0, np.sqrt(turns[k : k + 2])
                gaps = column[k : k + 2] - n * ends
                other = ends[0] + gaps[0] / (gaps[0] - gaps[1]) * (ends[1] - ends[0])
                error = float(abs(other / rate - 1.0)) if rate else 0.0
                result.append(Crossing(n, name, float(sign * 2.0 * np.pi * rate), float(n * rate), error))
    return sorted(result, key=lambda crossing: (crossing.order, abs(crossing.speed)))
