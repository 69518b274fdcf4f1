"""Skeletal muscle with a user-defined tension curve of active fibres."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.errors import InputError, numbers
from isorod.material.muscle import Muscle

if TYPE_CHECKING:
    import sympy as sp

    from isorod.material.energy import Energy

# Range of stretches in which the work of activation is computed, and an integral is checked.
_LEAST, _MOST = 0.25, 2.5


@dataclass(frozen=True, eq=False)
class ActiveMuscle(Muscle):
    """`Muscle` with ``dW_active/dlambda = activation sigma_max curve(lambda)``.

    Parameters
    ----------
    E, nu, sigma_max, m1, m2, activation, fibre
        As those of `Muscle`.
    curve
        Tension of active fibres by their stretch, relative to ``sigma_max``.  Points ``(stretch, tension)``, shape
        ``(n, 2)``, joined by monotone cubics (Fritsch & Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300-304) and
        constant beyond the first and the last; or a SymPy expression of one symbol, the stretch.

    Raises
    ------
    InputError
        If a value is out of its range or not finite; SymPy finds no integral of the expression.
    """

    curve: Any = None

    def _check(self) -> None:
        super()._check()
        if self.curve is None:
            raise InputError("curve: need points (stretch, tension) or a SymPy expression of the stretch")
        if not hasattr(self.curve, "free_symbols"):
            object.__setattr__(self, "curve", _checked(self.curve))
            return
        _ = self.stored

    @property
    def recipe(self) -> tuple[Any, ...]:  # type: ignore[override]
        """Its energy, of its curve."""
        return _energy, self.curve

    @property
    def activation_work(self) -> float:
        """The work of active fibres over the whole range of their stretch, per volume."""
        return self.activation * self.sigma_max * _work(self.curve)


def _checked(curve: Any) -> tuple[tuple[float, float], ...]:
    """Return the points of a curve; raises `InputError` if they are invalid."""
    points = numbers("curve", curve)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise InputError(f"curve: got shape {points.shape}, need three or more points (stretch, tension)")
    if not np.isfinite(points).all():
        raise InputError(f"curve: point {np.argmin(np.isfinite(points).all(axis=1))} is not finite")
    stretches, tensions = points.T
    if not (stretches[0] > 0.0 and (np.diff(stretches) > 0.0).all()):
        raise InputError("curve: stretches must be positive and rise from point to point")
    if not tensions.min() >= 0.0:
        raise InputError(f"curve: got a tension of {tensions.min():g}, need none that is negative")
    return tuple((float(x), float(y)) for x, y in points)


@cache
def _energy(curve: Any) -> "Energy":
    from isorod.material.muscle_energy import of_fibres

    return of_fibres(_stored(curve))


@cache
def _work(curve: Any) -> float:
    """Return the maximum work of fibres with a curve, for a largest stress of 1."""
    import sympy as sp

    from isorod.material.muscle_energy import STRETCH

    values = sp.lambdify(STRETCH, _stored(curve), ["scipy", "numpy"])(np.linspace(_LEAST, _MOST, 1000))
    return float(np.ptp(np.broadcast_to(values, 1000)))


@cache
def _stored(curve: Any) -> "sp.Expr":
    """Return the integral of a curve from 1."""
    import sympy as sp

    from isorod.material.muscle_energy import STRETCH

    if isinstance(curve, tuple):
        return _integral_of_points(curve, STRETCH)
    free = sorted(curve.free_symbols, key=str)
    if len(free) != 1:
        names = ", ".join(map(str, free)) or "nothing"
        raise InputError(f"curve: got an expression of {names}, need one of the stretch")
    tension = curve.subs(free[0], STRETCH).rewrite((sp.Max, sp.Min, sp.Abs), sp.Piecewise)
    integral = sp.integrate(sp.piecewise_fold(tension), STRETCH)
    if integral.has(sp.Integral) or not _holds(integral, tension, STRETCH):
        raise InputError(f"curve: SymPy finds no integral of {curve}; give points (stretch, tension) of it")
    return integral - integral.subs(STRETCH, 1)


def _holds(candidate: "sp.Expr", tension: "sp.Expr", stretch: "sp.Symbol") -> bool:
    """Whether an expression is the integral of another, jumps and all."""
    import sympy as sp
    from scipy.integrate import quad

    integral, rate = (sp.lambdify(stretch, one, ["scipy", "numpy"]) for one in (candidate, tension))
    ends = np.linspace(_LEAST, _MOST, 7)
    grown = np.diff([float(integral(one)) for one in ends])
    exact = [quad(rate, a, b, limit=200)[0] for a, b in pairwise(ends)]
    return bool(np.abs(grown - exact).max() < 1e-6 * max(1.0, np.abs(exact).max()))


def _integral_of_points(points: Sequence[tuple[float, float]], stretch: "sp.Symbol") -> "sp.Expr":
    """Return the integral from 1 of the cubic interpolant."""
    import sympy as sp
    from scipy.interpolate import PchipInterpolator

    x, y = np.array(points).T
    curve = PchipInterpolator(x, y)
    before = curve.antiderivative()
    # 1 may lie beyond the points.
    inside = min(max(1.0, x[0]), x[-1])
    start = float(before(inside) + curve(inside) * (1.0 - inside))
    branches = [(y[0] * (stretch - x[0]) - start, stretch < x[0])]
    for k in range(len(x) - 1):
        d, value = stretch - x[k], sp.Float(0)
        for coefficient in before.c[:, k]:
            value = value * d + float(coefficient)
        branches.append((value - start, stretch < x[k + 1]))
    last = float(before(x[-1]))
    return sp.Piecewise(*branches, (last - start + y[-1] * (stretch - x[-1]), True))
