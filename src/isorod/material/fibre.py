"""Material directions of a law, such as those of fibres: given as vectors, or relative to the rod.

A user gives a word (`WORDS`), a vector ``(3,)`` of any length, one for each point, or a function of the rod's
`isorod.material.places.Places` that returns vectors.  A law keeps what `checked` returns.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array, Index
from isorod.errors import InputError, numbers
from isorod.material.places import Places

Fibre = ArrayLike | str | Callable[[Places], ArrayLike]

# Attributes of places.
WORDS = ("tangent", "normal", "binormal", "radial", "around")


def helix(angle: float) -> Callable[[Places], Array]:
    """Return the direction of a helix about a rod's centre line, at an angle to its tangent in degrees.

    0 is along the rod, 90 around it; positive angles give a right-handed helix.
    """
    if not np.isfinite(angle):
        raise InputError(f"helix: got an angle of {angle}, need finite degrees")
    return partial(_helical, angle)


def _helical(angle: float, places: Places) -> Array:
    turn = np.radians(angle)
    return np.asarray(np.cos(turn) * places.tangent + np.sin(turn) * places.around)


def checked(fibre: Fibre, name: str = "fibre direction") -> Fibre:
    """Return a direction as a law keeps it: a word, a function, or unit vectors ``(..., 3)``.

    Raises
    ------
    InputError
        If it is none of these, or a vector is zero or not finite.
    """
    if isinstance(fibre, str):
        if fibre not in WORDS:
            words = ", ".join(repr(word) for word in WORDS[:-1]) + f" or {WORDS[-1]!r}"
            raise InputError(f"{name}: got {fibre!r}, need a vector (x, y, z), {words}, or a function of places")
        return fibre
    if callable(fibre):
        return fibre
    vectors = np.array(numbers(name, fibre))
    if vectors.ndim == 0 or vectors.shape[-1] != 3:
        raise InputError(f"{name}: got shape {vectors.shape}, need (3,) or one a point (..., 3)")
    length = np.sqrt(np.sum(vectors**2, axis=-1, keepdims=True))
    good = np.isfinite(length) & (length > 0.0)
    if not good.all():
        raise InputError(f"{name}: got {_bad(vectors, good)}, need a finite vector, not zero")
    return vectors / length


def _bad(vectors: Array, good: Array) -> str:
    x, y, z = vectors.reshape(-1, 3)[np.argmin(good.ravel())]
    return f"({x:g}, {y:g}, {z:g})"


def follows(fibre: Fibre) -> bool:
    """Whether a direction depends on the rod's places."""
    return isinstance(fibre, str) or callable(fibre)


def placed(fibre: Fibre, places: Places, name: str = "fibre direction") -> Fibre:
    """Return a direction at a rod's places; vectors stay the same.

    Raises
    ------
    InputError
        If a function does not return nonzero vectors there.
    """
    if isinstance(fibre, str):
        return np.asarray(getattr(places, fibre))
    if not callable(fibre):
        return fibre
    vectors = numbers(f"{name}: function of places", fibre(places))
    if not _fit(vectors.shape, (*places.shape, 3)):
        raise InputError(
            f"{name}: the function returns shape {vectors.shape}, need (3,) or what broadcasts to {(*places.shape, 3)}"
        )
    length = np.sqrt(np.sum(vectors**2, axis=-1))
    good = np.broadcast_to(np.isfinite(length) & (length > 0.0), places.shape)
    if not good.all():
        at = np.unravel_index(np.argmin(good), good.shape)
        u = np.broadcast_to(places.u, (*places.shape, 1))[at][0]
        x, y = np.broadcast_to(places.xi, (*places.shape, 2))[at]
        bad = _bad(np.broadcast_to(vectors, (*places.shape, 3)), good)
        raise InputError(
            f"{name}: the function returns {bad} at u = {u:.4g}, disk point ({x:.3g}, {y:.3g}), need a finite vector, "
            "not zero"
        )
    return vectors


def _fit(shape: tuple[int, ...], target: tuple[int, ...]) -> bool:
    try:
        return shape[-1:] == (3,) and np.broadcast_shapes(shape, target) == target
    except ValueError:
        return False


def some(fibre: Fibre, places: Index) -> Fibre:
    """Return a direction at some of its places, the same if it does not depend on them."""
    if isinstance(fibre, np.ndarray) and fibre.ndim > 1 and fibre.shape[0] > 1:
        return np.asarray(fibre[places])
    return fibre


def vectors(fibre: Fibre, shape: tuple[int, ...], name: str = "fibre direction") -> Array:
    """Return the unit vectors at points of some shape, ``(*shape, 3)``.

    Raises
    ------
    InputError
        If they depend on a rod's places, which are not set (`placed`).
    """
    if follows(fibre):
        what = repr(fibre) if isinstance(fibre, str) else "a function of places"
        raise InputError(f"{name} {what}: only a body knows its rod's places; give the law to one")
    return np.broadcast_to(np.asarray(fibre), (*shape, 3))
