"""Rotation vectors of a scene file, in degrees as all of its angles."""

import math
from typing import Any

import numpy as np

from isorod.arrays import Numbers
from isorod.files import values
from isorod.files.document import Place, shown


def degrees(place: Place, value: Any) -> tuple[float, ...]:
    """Return a rotation vector in degrees as one in radians."""
    return tuple(math.radians(one) for one in values.value_of(place, value, tuple[float, float, float]))


def _table(place: Place, value: Any) -> Any:
    """Return a number in degrees, or rows whose last one is in degrees, in radians."""
    if isinstance(value, str):
        raise place.error(f"got {shown(value)}, need {ANGLES.words}")
    found = np.array(values.value_of(place, value, Numbers), dtype=float)
    if found.ndim:
        found[..., -1] = np.radians(found[..., -1])
    return found if found.ndim else math.radians(found)


DEGREES = values.Kind(degrees, "3 numbers, degrees")
ANGLES = values.Kind(_table, "a number, degrees, or rows of load factor or time, and degrees")
