"""Lengths and points as users give them."""

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.errors import InputError, numbers, positive, representable


def check_length(name: str, value: float) -> None:
    """Raise `InputError` if a number is not a positive length, or exceeds double precision."""
    positive(name, value)
    representable(name, value)


def finite_points(name: str, values: Numbers, shape: tuple[int | None, ...]) -> Array:
    """Return finite numbers of a shape, in which None stands for any size."""
    points = numbers(name, values)
    needed = (
        "(" + ", ".join("m" if size is None else str(size) for size in shape) + ("," if len(shape) == 1 else "") + ")"
    )
    if points.ndim != len(shape) or any(
        size not in (None, have) for size, have in zip(shape, points.shape, strict=True)
    ):
        raise InputError(f"{name}: got shape {points.shape}, need {needed}")
    good = np.isfinite(points)
    if not good.all():
        where = f"point {np.argwhere(~good)[0][0]}: " if len(shape) > 1 else ""
        raise InputError(f"{name}: {where}got {points[~good][0]}, need finite numbers")
    return points
