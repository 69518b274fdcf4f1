"""Time-dependent laws: viscoelasticity by a Prony series, and Norton creep."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from isorod.arrays import Numbers
from isorod.errors import InputError, finite, numbers, positive
from isorod.material.law import Isotropic
from isorod.material.memory import Timed
from isorod.material.plastic import check_rate

# Maximum number of branches.
_MOST = 3


@dataclass(frozen=True, eq=False)
class Viscoelastic(Timed, Isotropic):
    """Viscoelasticity at large strains: the shear stress relaxes in part.

    In small shear held from time 0 on the stress falls by ``1 - sum g (1 - exp(-t / tau))``.  A neo-Hookean spring is
    in parallel with Maxwell branches (S. Reese & S. Govindjee, Int. J. Solids Struct. 35 (1998) 3455-3482), ``W = mu/2
    (I1bar - 3)`` each, with a fraction of ``mu``; the volume is elastic, ``(lame/2 + mu/3) (ln J)^2``.

    Parameters
    ----------
    E, nu
        Instantaneous Young's modulus [force/area] and Poisson's ratio.
    prony
        Rows of a fraction ``g`` of the shear modulus and its relaxation time ``tau``, three at most.
    """

    prony: Numbers

    kernel: ClassVar[str] = "relaxing_kernel"

    def _check(self) -> None:
        super()._check()
        rows = numbers("prony", self.prony)
        if rows.ndim != 2 or rows.shape[1] != 2 or not 1 <= len(rows) <= _MOST:
            raise InputError(f"prony: need 1 to {_MOST} rows [fraction, time]")
        finite("prony", rows.ravel().tolist())
        fractions, times = rows.T
        if not (fractions.min() > 0.0 and fractions.sum() <= 1.0):
            raise InputError(f"prony: got fractions {fractions.tolist()}, need positive ones that add up to 1 at most")
        for time in times:
            positive("prony", float(time), "a positive time")

    @property
    def states(self) -> dict[str, int]:  # type: ignore[override]
        """Components of its state variables: isochoric ``C - 1``, ``Ci - 1`` of each damper, the dissipated energy."""
        return {"strain": 6, "viscous_strain": 6 * len(np.asarray(self.prony)), "dissipated": 1}

    @property
    def values(self) -> tuple[float, ...]:
        """``mu``, the time of the step, and the rows of the series with their number ahead."""
        rows = np.asarray(self.prony, dtype=float)
        return self.mu, self.step, float(len(rows)), *rows.ravel().tolist()


@dataclass(frozen=True, eq=False)
class Creep(Timed, Isotropic):
    """Norton creep: the creep strain rate is ``A q^n``, ``q`` the von Mises stress.

    Parameters
    ----------
    E, nu
        Young's modulus [force/area] and Poisson's ratio.
    A, n
        Strain rate at stress 1, per time, and exponent, at least 1.
    """

    A: float
    n: float

    kernel: ClassVar[str] = "viscous_kernel"
    kinks: ClassVar[bool] = True
    states: ClassVar = {"strain": 6, "viscous_strain": 6, "dissipated": 1}

    def _check(self) -> None:
        super()._check()
        check_rate(self.A, self.n)

    @property
    def values(self) -> tuple[float, ...]:
        """``mu``, the time of the step, and ``c`` and ``n``: held in shear, ``q' = -c q^n``."""
        return self.mu, self.step, 3.0 * self.mu * self.A, self.n
