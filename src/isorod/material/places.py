"""Points of a rod and its directions there, for laws with material directions; computed on demand."""

from collections.abc import Callable
from functools import cached_property
from typing import Protocol

import numpy as np

from isorod.arrays import Array, Index


class Shape(Protocol):
    """The interface of a rod (`isorod.geometry.rod.Rod`)."""

    @property
    def arc_length(self) -> Callable[[Array], Array]:
        """A function that returns the length of the centre line up to parameters ``(t,)``."""

    def tangents(self, u: Array) -> Array:
        """Return the unit tangents ``(t, 3)`` of the centre line at parameters ``(t,)``."""

    def across(self, xi: Array, u: Array) -> tuple[Array, Array]:
        """Return positions ``(..., 3)`` and derivatives ``dx/d(xi_1, xi_2)``, ``(..., 3, 2)``."""


class Places:
    """Points of a rod at rest, and unit vectors there; all broadcast to ``(*shape, 3)``.

    ``tangent``, ``normal`` and ``binormal`` of a section are orthonormal and right-handed, as are ``radial``,
    ``around`` and ``tangent`` of a point.

    Parameters
    ----------
    rod
        The rod.
    u, xi
        Axis parameters ``(..., 1)`` and disk points ``(q, 2)``; or one each of any shape, ``(...)`` and ``(..., 2)``.

    Attributes
    ----------
    shape
        Shape of the points, such as ``(E, t, q)`` of elements, places along each and points of the section.
    u
        Axis parameters, with a further axis: ``places.u * places.tangent`` are vectors.
    xi
        Disk points.
    """

    def __init__(self, rod: Shape, u: Array, xi: Array) -> None:
        self._rod, self.u, self.xi = rod, u[..., None], xi
        self.shape = np.broadcast_shapes(u.shape, xi.shape[:-1])

    def part(self, places: slice, points: slice | Index) -> "Places":
        """Return some of the places along the rod, with some of the points ``(q, 2)`` of the section at each."""
        return Places(self._rod, self.u[places, ..., 0], self.xi[points])

    @cached_property
    def tangent(self) -> Array:
        """Unit tangents of the centre line."""
        u = self.u[..., 0]
        return self._rod.tangents(u.ravel()).reshape(*u.shape, 3)

    @cached_property
    def normal(self) -> Array:
        """Direction of the disk's first axis in the centre of the section, orthogonal to the tangent."""
        # Also the mean over the disk, by the mean value property of harmonic functions: as in section forces.
        return _normal_to(self.tangent, self._rod.across(np.zeros(2), self.u[..., 0])[1][..., 0])

    @cached_property
    def binormal(self) -> Array:
        """``tangent x normal``."""
        return np.cross(self.tangent, self.normal)

    @property
    def length(self) -> Array:
        """Length along the centre line from the start, shape of ``u`` as given."""
        u = self.u[..., 0]
        return np.asarray(self._rod.arc_length(u.ravel())).reshape(u.shape)

    @property
    def position(self) -> Array:
        """Positions."""
        return self._across[0]

    @property
    def offset(self) -> Array:
        """Positions from the centre line's point of the same section."""
        return self.position - self._rod.across(np.zeros(2), self.u[..., 0])[0]

    @cached_property
    def around(self) -> Array:
        """Circumferential direction, orthogonal to the tangent; in the centre the limit along ``xi_1``."""
        size = np.hypot(self.xi[..., 0], self.xi[..., 1])
        safe = np.where(size > 0.0, size, 1.0)
        cosine, sine = np.where(size > 0.0, self.xi[..., 0] / safe, 1.0), self.xi[..., 1] / safe
        first, second = np.moveaxis(self._across[1], -1, 0)
        return _normal_to(self.tangent, cosine[..., None] * second - sine[..., None] * first)

    @cached_property
    def radial(self) -> Array:
        """``around x tangent``: away from the centre, orthogonal to both."""
        return np.cross(self.around, self.tangent)

    @cached_property
    def _across(self) -> tuple[Array, Array]:
        return self._rod.across(self.xi, self.u[..., 0])


def _normal_to(tangent: Array, vector: Array) -> Array:
    """Return vectors made orthogonal to the tangent, of unit length."""
    vector = vector - np.sum(vector * tangent, axis=-1, keepdims=True) * tangent
    return np.asarray(vector / np.linalg.norm(vector, axis=-1, keepdims=True))


class _Cylinder:
    """A straight round rod of radius 1 along z."""

    def arc_length(self, u: Array) -> Array:
        return u

    def tangents(self, u: Array) -> Array:
        return np.broadcast_to([0.0, 0.0, 1.0], (u.size, 3))

    def across(self, xi: Array, u: Array) -> tuple[Array, Array]:
        shape = np.broadcast_shapes(xi.shape[:-1], u.shape)
        x, y = np.moveaxis(np.broadcast_to(xi, (*shape, 2)), -1, 0)
        return np.stack([x, y, np.broadcast_to(u, shape)], axis=-1), np.broadcast_to(np.eye(3, 2), (*shape, 3, 2))


def alone() -> Places:
    """Return a place for laws without a rod: tangent z, normal and radial x, binormal and around y."""
    return Places(_Cylinder(), np.zeros(1), np.array([[1.0, 0.0]]))
