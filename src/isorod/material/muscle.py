"""Skeletal muscle: a neo-Hookean matrix with active and passive fibres (Lu & Zhou 2011, eqs. 16-19)."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from isorod.errors import InputError
from isorod.material.fibre import Fibre
from isorod.material.neo_hookean import NeoHookean

if TYPE_CHECKING:
    from isorod.material.energy import Energy


@cache
def _energy() -> "Energy":
    from isorod.material.muscle_energy import of_the_parabola

    return of_the_parabola()


@dataclass(frozen=True, eq=False)
class Muscle(NeoHookean):
    """``W = W_matrix + W_active(lambda) + W_passive(lambda)``, ``lambda = |F f|`` the stretch of a fibre along ``f``.

    ``dW_active/dlambda = activation sigma_max max(0, 1 - 4 (1 - lambda)^2)`` and ``dW_passive/dlambda = m1 lambda
    (exp(m2 (lambda^2 - 1)) - 1)`` for ``lambda > 1``, else 0 (Lu & Zhou 2011, eqs. 16-19).  Both energies are zero at
    ``lambda = 1``; the active one is that at a fixed activation.

    Parameters
    ----------
    E, nu
        Young's modulus [force/area] and Poisson's ratio of the matrix.
    sigma_max
        Largest active fibre stress, force per reference area.
    m1, m2
        Passive fibre: stress factor [force/area] and exponent, neither negative.
    activation
        From 0 (at rest) to 1.
    fibre
        Reference direction of the fibres: a vector of any length ``(3,)``, or one for each point (broadcast to
        ``F.shape[:-1]``); a direction of the rod, ``"tangent"`` along its centre line, ``"normal"``, ``"binormal"``,
        ``"radial"`` or ``"around"``; or a function of places (`isorod.material.fibre`), such as ``helix(30)``.

    Raises
    ------
    InputError
        If a value is out of its range or not finite.
    """

    families: ClassVar[int] = 1
    recipe = (_energy,)

    sigma_max: float = 0.0
    m1: float = 0.0
    m2: float = 0.0
    activation: float = 0.0
    fibre: Fibre = "tangent"

    def _check(self) -> None:
        super()._check()
        if not 0.0 <= self.activation <= 1.0:
            raise InputError(f"activation: got {self.activation:g}, need 0 (at rest) to 1 (fully active)")
        for name, what in (("sigma_max", "a stress"), ("m1", "a stress"), ("m2", "an exponent")):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"{name}: got {value:g}, need {what}, not negative")

    @property
    def values(self) -> tuple[float, ...]:
        """``mu``, active stress, ``m1, m2``."""
        # Without an exponent there is no passive stress.
        passive = (self.m1, self.m2) if self.m2 > 0.0 else (0.0, 1.0)
        return self.mu, self.activation * self.sigma_max, *passive

    @property
    def modulus(self) -> float:
        """Modulus of pressure waves along passive fibres that are just taut, force / area."""
        return super().modulus + 2.0 * self.m1 * self.m2

    @property
    def activation_work(self) -> float:
        """The work of active fibres over the whole range of their stretch, per volume: 2/3 of their stress."""
        return 2.0 / 3.0 * self.activation * self.sigma_max

    def at(self, factor: float) -> Self:
        """Return the law at a load factor: ``factor`` times the activation."""
        return self._with(activation=factor * self.activation)
