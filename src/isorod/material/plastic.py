"""Metal plasticity by von Mises at large strains."""

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from isorod.arrays import Numbers
from isorod.errors import InputError, finite, numbers, positive
from isorod.material.law import Isotropic
from isorod.material.memory import Memory, Timed

# A stress beyond all others.
_NEVER = 1e200


@dataclass(frozen=True, eq=False)
class Plastic(Memory, Isotropic):
    """Von Mises plasticity: elastic up to the yield stress, then plastic flow at constant volume.

    The logarithmic strain ``ln(C)/2`` is the sum of an elastic one, on which the stress depends linearly (Hencky), and
    a plastic one (C. Miehe, N. Apel & M. Lambrecht, CMAME 191 (2002) 5383-5425).

    Parameters
    ----------
    E, nu
        Young's modulus [force/area] and Poisson's ratio.
    hardening
        Points (accumulated plastic strain, yield stress), the first at 0, linear between them, constant beyond the
        last.  Stresses are Kirchhoff stresses, force / area.
    kinematic
        Modulus ``H`` of kinematic hardening, force / area (Prager).
    recovery
        Dynamic recovery ``gamma`` of the back stress, per plastic strain (Armstrong and Frederick): in tension it is
        ``kinematic/recovery (1 - exp(-recovery p))``.
    """

    hardening: Numbers
    kinematic: float = 0.0
    recovery: float = 0.0

    kernel: ClassVar[str] = "plastic_kernel"
    kinks: ClassVar[bool] = True

    def _check(self) -> None:
        super()._check()
        table = numbers("hardening", self.hardening)
        finite("hardening", table.ravel().tolist())
        if table.ndim != 2 or table.shape[1] != 2 or not len(table):
            raise InputError("hardening: need a list of points [plastic strain, yield stress]")
        strains, stresses = table.T
        if strains[0] != 0.0 or (np.diff(strains) <= 0.0).any():
            raise InputError(f"hardening: got plastic strains {strains.tolist()}, need growing ones from 0 on")
        if stresses[0] <= 0.0 or (np.diff(stresses) < 0.0).any():
            raise InputError(
                f"hardening: got yield stresses {stresses.tolist()}, need positive ones that do not fall: where they "
                "fall, strains gather in a band as narrow as the elements"
            )
        if not (np.isfinite(self.kinematic) and self.kinematic >= 0.0):
            raise InputError(f"kinematic: got {self.kinematic:g}, need a modulus, not negative")
        if not (np.isfinite(self.recovery) and self.recovery >= 0.0):
            raise InputError(f"recovery: got {self.recovery:g}, need a number, not negative")
        if self.recovery > 0.0 and self.kinematic == 0.0:
            raise InputError("recovery: there is no back stress to recover from; give a modulus kinematic")

    @property
    def states(self) -> dict[str, int]:  # type: ignore[override]
        """Components of its state variables, with a back stress if there is kinematic hardening."""
        back = {"back_stress": 6} if self.kinematic > 0.0 else {}
        return {"plastic_strain": 6, "p": 1, **back, "dissipated": 1}

    @property
    def values(self) -> tuple[float, ...]:
        """``mu``, the kinematic modulus and recovery, three of time, and the table with the number of its points."""
        table = np.asarray(self.hardening, dtype=float)
        return self.mu, self.kinematic, self.recovery, *self._rate, float(len(table)), *table.ravel().tolist()

    @property
    def _rate(self) -> tuple[float, float, float]:
        """Time of the step, rate ``A``, and ``1/n``."""
        return 0.0, 0.0, 1.0

    @property
    def frozen(self) -> Self:
        """The law with an unreachable yield stress."""
        return self._with(hardening=[[strain, _NEVER] for strain, _ in np.asarray(self.hardening).tolist()])


@dataclass(frozen=True, eq=False)
class Viscoplastic(Timed, Plastic):
    """Viscoplasticity by Perzyna: plastic flow at a rate by the overstress.

    Accumulated plastic strain grows at the rate ``A (q / yield stress - 1)^n``, ``q`` the von Mises stress relative to
    the back stress.

    Parameters
    ----------
    E, nu, hardening, kinematic, recovery
        Those of `Plastic`.
    A, n
        Strain rate at twice the yield stress, per time, and exponent, at least 1.
    """

    A: float = 0.0
    n: float = 1.0

    clock: ClassVar[int] = 3

    def _check(self) -> None:
        super()._check()
        check_rate(self.A, self.n)

    @property
    def _rate(self) -> tuple[float, float, float]:
        """Time of the step, rate ``A``, and ``1/n``."""
        return self.step, self.A, 1.0 / self.n


def check_rate(A: float, n: float) -> None:
    """Raise `InputError` if a strain rate ``A`` or its exponent is invalid."""
    positive("A", A, "a positive rate")
    if not 1.0 <= n <= 50.0:
        raise InputError(f"n: got {n:g}, need an exponent from 1 to 50")
