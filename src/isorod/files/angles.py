"""Rotation vectors of a scene file, in degrees as all of its angles."""

import math
import warnings
from typing import Any

import numpy as np

from isorod.arrays import Numbers
from isorod.files import values
from isorod.files.document import Place, shown


def degrees(place: Place, value: Any) -> tuple[float, ...]:
    """Return a rotation vector in degrees as one in radians."""
    return tuple(math.radians(one) for one in _vector(place, value))


def radians(place: Place, value: Any) -> tuple[float, ...]:
    """Return a rotation vector in radians, with a warning that gives the text to write in its place."""
    vector = _vector(place, value)
    degrees_text = ", ".join(f"{math.degrees(one):.9g}" for one in vector)
    doubt = ""
    if math.hypot(*vector) > 2.0 * math.pi:
        typed = ", ".join(f"{one:.9g}" for one in vector)
        doubt = f"; this is more than a whole turn: if degrees were meant, write rotation = [{typed}]"
    warnings.warn(
        str(place.error(f"radians, taken for the last time: write rotation = [{degrees_text}], in degrees{doubt}")),
        FutureWarning,
        stacklevel=2,
    )
    return vector


def _table(place: Place, value: Any) -> Any:
    """Return a number in degrees, or rows whose last one is in degrees, in radians."""
    if isinstance(value, str):
        raise place.error(f"got {shown(value)}, need {ANGLES.words}")
    numbers = np.array(values.value_of(place, value, Numbers), dtype=float)
    if numbers.ndim:
        numbers[..., -1] = np.radians(numbers[..., -1])
    return numbers if numbers.ndim else math.radians(numbers)


def _vector(place: Place, value: Any) -> tuple[float, ...]:
    return values.value_of(place, value, tuple[float, float, float])  # type: ignore[no-any-return]


DEGREES = values.Kind(degrees, "3 numbers, degrees")
ANGLES = values.Kind(_table, "a number, degrees, or rows of load factor or time, and degrees")
RADIANS = values.Kind(radians, "3 numbers, radians")
