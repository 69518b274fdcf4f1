"""What flows with time: viscoelasticity by a Prony series, and Norton's creep."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Self

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.errors import InputError, finite, numbers, positive
from isorod.material.law import Isotropic
from isorod.material.memory import Memory
from isorod.material.points import Compiled

# Branches at most, and a time that no run reaches.
_MOST, _EVER = 3, 1e300


@cache
def _compiled() -> Compiled:
    from isorod.material.viscous_kernel import block, tangent, update

    return Compiled(block, tangent, update)


class Timed(Memory, Isotropic):
    """A law whose stress relaxes with time (`isorod.material.viscous_kernel`): of the volume it never does."""

    timed: ClassVar[bool] = True
    clock: ClassVar[int] = 1

    # Time of the state, and from there to where the law is asked; that where it is the same whatever the load factor.
    since: float = 0.0
    step: float = 0.0
    during: float | None = None

    @property
    def branches(self) -> Array:
        """Share of the shear modulus, ``c`` and ``n`` of each branch, shape ``(count, 3)``."""
        raise NotImplementedError

    @property
    def states(self) -> dict[str, int]:  # type: ignore[override]
        """What its state is: the strain, the viscous strain of each branch, and what was dissipated."""
        return {"strain": 6, "viscous_strain": 6 * len(self.branches), "dissipated": 1}

    @property
    def values(self) -> tuple[float, ...]:
        """``mu``, the time of the step, and the branches with their number ahead."""
        return self.mu, self.step, float(len(self.branches)), *self.branches.ravel().tolist()

    @property
    def compiled(self) -> Compiled:
        """The addresses of its compiled functions."""
        return _compiled()

    def at(self, factor: float) -> Self:
        """Return the law at a time."""
        return self._with(step=max(factor - self.since, 0.0) if self.during is None else self.during)

    def lasting(self, step: float) -> Self:
        """Return the law in a step that takes so long."""
        return self._with(step=step, during=step)

    @property
    def frozen(self) -> Self:
        """The law in no time."""
        return self.lasting(0.0)

    def growing(self, over: "Callable[[Any], Callable[[float], float]]") -> Self:
        """Return the law as one that knows the time at a load factor."""
        return self._with(grows=over(((0.0, 0.0), (_EVER, _EVER))))

    def advanced(self, F: Array, factor: float) -> Self:
        """Return the law with the state at the end of a step, and its time."""
        law = super().advanced(F, factor)
        return law._with(since=self.since + self.reached(factor).step)


@dataclass(frozen=True, eq=False)
class Viscoelastic(Timed):
    """A solid whose shear stress relaxes in part, linear in the logarithmic strain at large strains too.

    In shear held from time 0 on the stress falls by ``1 - sum g (1 - exp(-t / tau))``.

    Parameters
    ----------
    E, nu
        Young's modulus [force/area] and Poisson's ratio of what is fast.
    prony
        Rows of a share ``g`` of the shear modulus and its time ``tau``, three at most.
    """

    prony: Numbers

    def _check(self) -> None:
        super()._check()
        rows = numbers("prony", self.prony)
        if rows.ndim != 2 or rows.shape[1] != 2 or not 1 <= len(rows) <= _MOST:
            raise InputError(f"prony: need 1 to {_MOST} rows [share, time]")
        finite("prony", rows.ravel().tolist())
        shares, times = rows.T
        if not (shares.min() > 0.0 and shares.sum() <= 1.0):
            raise InputError(f"prony: got shares {shares.tolist()}, need positive ones that add up to 1 at most")
        for time in times:
            positive("prony", float(time), "a positive time")

    @property
    def branches(self) -> Array:
        """Of each row of the series one with ``q' = -q / tau``."""
        shares, times = np.asarray(self.prony, dtype=float).T
        return np.column_stack([shares, 1.0 / times, np.ones(len(times))])


@dataclass(frozen=True, eq=False)
class Creep(Timed):
    """Metal that creeps, by Norton: the strain grows by ``A q^n``, ``q`` von Mises' stress.

    Parameters
    ----------
    E, nu
        Young's modulus [force/area] and Poisson's ratio.
    A, n
        Rate of strain at stress 1, per time, and exponent, at least 1.
    """

    A: float
    n: float

    kinks: ClassVar[bool] = True

    def _check(self) -> None:
        super()._check()
        positive("A", self.A, "a positive rate")
        if not 1.0 <= self.n <= 50.0:
            raise InputError(f"n: got {self.n:g}, need an exponent from 1 to 50")

    @property
    def branches(self) -> Array:
        """The one of all of the shear modulus: held in shear, ``q' = -3 mu A q^n``."""
        return np.array([[1.0, 3.0 * self.mu * self.A, self.n]])
