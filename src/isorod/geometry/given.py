"""Lengths and points as users give them."""

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.errors import InputError, numbers, positive, representable


def check_length(name: str, value: float) -> None:
    """Raise `InputError` if a number is no positive length, or one that leaves double precision."""
    positive(name, value)
    representable(name, value)


def finite_points(name: str, values: Numbers, shape: tuple[int | None, ...]) -> Array:
    """Return finite numbers of a shape, in which None stands for any number."""
    found = numbers(name, values)
    wanted = (
        "(" + ", ".join("m" if size is None else str(size) for size in shape) + ("," if len(shape) == 1 else "") + ")"
    )
    if found.ndim != len(shape) or any(size not in (None, have) for size, have in zip(shape, found.shape, strict=True)):
        raise InputError(f"{name}: got shape {found.shape}, need {wanted}")
    good = np.isfinite(found)
    if not good.all():
        where = f"point {np.argwhere(~good)[0][0]}: " if len(shape) > 1 else ""
        raise InputError(f"{name}: {where}got {found[~good][0]}, need finite numbers")
    return found
