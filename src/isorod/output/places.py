"""Axis parameters as given by users: numbers, or the names of ends."""

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.space.space import Space


def numbers_in(given: ArrayLike) -> Array | None:
    """Return an array of numbers, or None if there are others."""
    try:
        return np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        return None


def parameters(space: Space, u: ArrayLike) -> Array:
    """Return axis parameters as given, the names of ends replaced."""
    low, high = space.axis.breaks[[0, -1]]
    values = numbers_in({"start": low, "end": high}.get(u, "") if isinstance(u, str) else u)
    if values is None:
        got = f"{u!r:.40}" if isinstance(u, str) else type(u).__name__
    else:
        inside = (values >= low) & (values <= high)
        if values.size and inside.all():
            return values
        got = f"{values[~inside].flat[0]:g}" if values.size else "none"
    raise InputError(f"axis parameter u: got {got}, need numbers from {low:g} to {high:g}, or 'start' or 'end'")
