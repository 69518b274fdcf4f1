"""Damping of vibrations: a ratio of critical damping, Rayleigh's, and structural, which add up."""

from dataclasses import dataclass

import numpy as np

from isorod.arrays import Array
from isorod.errors import Checked, InputError


@dataclass(frozen=True)
class Damping(Checked):
    """Damping of vibrations, besides that of laws with memory.

    Parameters
    ----------
    ratio
        Fraction of critical damping of each mode, 0.02 for 2 %.
    rayleigh
        ``alpha`` [1/time] and ``beta`` [time] of the damping matrix ``alpha M + beta K``.
    structural
        Loss factor ``eta`` of a stiffness ``(1 + i eta) K``, as of internal friction.

    Raises
    ------
    InputError
        If one is negative or not finite, or none is given: resonances would be unbounded.
    """

    ratio: float = 0.0
    rayleigh: tuple[float, float] = (0.0, 0.0)
    structural: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, several in (("ratio", [self.ratio]), ("rayleigh", self.rayleigh), ("structural", [self.structural])):
            if not all(np.isfinite(one) and one >= 0.0 for one in several):
                raise InputError(f"{name}: got {np.array(several).tolist()}, need numbers that are not negative")
        if not self.ratio < 1.0:
            raise InputError(f"ratio: got {self.ratio:g}, need a share of critical damping below 1, as 0.02 for 2 %")
        if not (self.ratio or any(self.rayleigh) or self.structural):
            raise InputError("damping: got none, need ratio, rayleigh or structural")

    def of_modes(self, omega: Array, squares: Array) -> Array:
        """Return the damping terms of modes of unit mass beside ``lambda - omega^2``, shape ``(frequencies, modes)``.

        Parameters
        ----------
        omega, squares
            Angular frequencies ``(frequencies,)``, and ``lambda`` of each mode.
        """
        alpha, beta = self.rayleigh
        rate = alpha + beta * squares + 2.0 * self.ratio * np.sqrt(np.maximum(squares, 0.0))
        return np.asarray(1j * (omega[:, None] * rate + self.structural * squares))

    def ratios(self, squares: Array) -> Array:
        """Return the total damping ratio of each mode, shape ``(modes,)``."""
        omega = np.sqrt(squares)
        alpha, beta = self.rayleigh
        return np.asarray(self.ratio + 0.5 * (self.structural + alpha / omega + beta * omega))
