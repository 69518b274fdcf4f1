"""Results of random vibration: spectral densities, and root mean squares of displacement, acceleration and stress."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.harmonic.response import Response, refuse_principal
from isorod.output.state import Named
from isorod.output.stress import component
from isorod.output.words import Component


@dataclass(frozen=True, eq=False, repr=False)
class RandomResponse(Response):
    """A stationary vibration: a `Response` times the root of the spectral density, at each frequency.

    The square of its amplitude is a spectral density, whose integral is a mean square (`rms`).

    Attributes
    ----------
    density
        Spectral density of the signal, shape ``(n,)``.
    weights
        Weights of the integral over frequencies, shape ``(n,)``.
    """

    density: Array
    weights: Array

    def rms(self, values: Array) -> Array:
        """Return the root mean square of values given at each frequency, ``(n, ...)``, of zero mean."""
        return np.asarray(np.sqrt(np.tensordot(self.weights, np.abs(values) ** 2, 1)))

    @property
    def _shaken(self) -> Array:
        return super()._shaken * np.sqrt(self.density)

    def amplitude(self, stress: Array, name: Component, normals: Array) -> Array:
        """Return the root of the spectral density of a component of stress, which needs no phase.

        The mean square of the von Mises stress is that of its quadratic form (D. J. Segalman et al., J. Vib. Acoust.
        122 (2000) 42-48).
        """
        refuse_principal(name)
        if name not in ("von_mises", "shear"):
            return np.abs(component(stress, name, normals))
        return np.hypot(component(stress.real, name, normals), component(stress.imag, name, normals))

    def whole(self) -> "Whole":
        """Return the response over all frequencies, whose stresses are root mean squares."""
        if self.soft:
            raise InputError("stress: not available for viscoelastic bodies in random response; ask for displacements")
        covariance = (self.weights[:, None] * self.coordinates).T @ self.coordinates.conj()
        sizes, turns = np.linalg.eigh(covariance.real)
        own = {one.name: getattr(self, one.name) for one in fields(self)}
        return Whole(**own | {"coordinates": (np.sqrt(np.maximum(sizes, 0.0)) * turns).T})

    def summary(self, measured: Mapping[str, Any]) -> dict[str, Any]:
        """Return the entries of a record for what is measured: root mean squares, densities and apparent frequencies.

        The last are rates of zero upcrossings (S. O. Rice), for counts of cycles.
        """
        result: dict[str, Any] = {}
        response: dict[str, Any] = {}
        apparent: dict[str, float] = {}
        for name, given in measured.items():
            values = np.asarray(given)
            size = self.rms(values)
            result[name] = float(size) if size.ndim == 0 else size
            columns = np.abs(values.reshape(len(values), -1)).T
            for k, column in enumerate(columns):
                label = name if values.ndim == 1 else f"{name}[{'xyz'[k]}]"
                rms = float(self.rms(column))
                seen = rms > _ROUNDING * np.max(size)
                response[label] = {"density": column**2 if seen else np.zeros(len(self))}
                if seen:
                    apparent[label] = float(self.rms(column * self.frequencies)) / rms
        return result | {"response": response, "apparent": apparent}

    def _warn_of_flanks(self, error: float) -> None:
        """Do not warn: the area below a peak does not depend on its frequency."""


# Fraction of the largest component below which others are rounding.
_ROUNDING = 1e-9


class Whole(RandomResponse):
    """Uncorrelated shapes: what is measured is the root of the sum of their squares."""

    def stress(self, body: Named, u: ArrayLike, xi: ArrayLike = (0.0, 0.0)) -> Array:
        """Return the stress of each shape, ``(m, ..., 3, 3)``."""
        return np.tensordot(self.coordinates, self._stresses(self.ritz, body, u, xi), 1)

    def amplitude(self, stress: Array, name: Component, normals: Array) -> Array:
        """Return the root mean square of a component."""
        refuse_principal(name)
        return np.asarray(np.sqrt((component(stress, name, normals) ** 2).sum(axis=0)))
