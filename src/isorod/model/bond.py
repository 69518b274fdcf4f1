"""Laws of bonds: traction over slip."""

from collections.abc import Sequence

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError, finite


class BondLaw:
    """Magnitude of the tangential traction by that of the slip: linear between points, constant after the last.

    Elastic: unloading follows the same curve.

    Parameters
    ----------
    bond
        A stiffness, force / length^3; or points ``(slip, traction)``, length and force / length^2, from ``(0, 0)`` on,
        slips ascending.

    Attributes
    ----------
    linear
        Whether the traction is a stiffness times any slip.

    Raises
    ------
    InputError
        If the stiffness is negative, or points are no such law.
    """

    def __init__(self, bond: float | Sequence[tuple[float, float]]) -> None:
        self.linear = np.ndim(bond) == 0
        if self.linear:
            finite("bond", bond, "a stiffness, not negative")
            if bond < 0.0:  # type: ignore[operator]
                raise InputError(f"bond: got {bond:g}, need a stiffness, not negative")
            self._slips, self._tractions, self._slopes = np.zeros(1), np.zeros(1), np.array([bond], dtype=float)
        else:
            points = np.array(bond, dtype=float)
            _check(points)
            self._slips, self._tractions = points.T
            self._slopes = np.append(np.diff(self._tractions) / np.diff(self._slips), 0.0)
        areas = 0.5 * np.diff(self._slips) * (self._tractions[1:] + self._tractions[:-1])
        self._energies = np.append(0.0, np.cumsum(areas))

    def at(self, slip: Array) -> tuple[Array, Array, Array]:
        """Return secant and tangent stiffness and the energy per area of slips, ``(q,)`` all."""
        k = np.searchsorted(self._slips, slip, side="right") - 1
        more, slope, start = slip - self._slips[k], self._slopes[k], self._tractions[k]
        traction = start + slope * more
        secant = np.divide(traction, slip, out=np.full_like(slip, self._slopes[0]), where=slip > 0.0)
        return secant, slope, self._energies[k] + more * (start + 0.5 * slope * more)


def _check(points: Array) -> None:
    """Raise `InputError` if points do not define a law."""
    need = "need slips that ascend from (0, 0), and tractions, the first positive, none negative"
    if not np.isfinite(points).all():
        raise InputError(f"bond: got points of which some are not finite, {need}")
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
        raise InputError(f"bond: got points of shape {points.shape}, need two or more of (slip, traction)")
    if points[0].any():
        raise InputError(f"bond: got ({points[0, 0]:g}, {points[0, 1]:g}) first, {need}")
    wrong = (np.diff(points[:, 0]) <= 0.0) | (points[1:, 1] < 0.0)
    if points[1, 1] <= 0.0 or wrong.any():
        k = 1 if points[1, 1] <= 0.0 else 1 + int(np.argmax(wrong))
        raise InputError(f"bond: got ({points[k, 0]:g}, {points[k, 1]:g}) as point {k}, {need}")
