"""Rod pulled over a fixed cylinder: Euler's elastica without friction; friction of ropes without bending.

The rod is weightless, inextensible and thin beside the cylinder: a solid rod differs by the order of its radius over
that of the cylinder, and spreads the point forces over about its own radius.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipeinc, ellipj, ellipkinc, ellipkm1

from isorod.arrays import Array
from isorod.errors import InputError


class Touch(NamedTuple):
    """Where and how the rod presses on the cylinder."""

    half_angle: float  # of the arc in contact [rad]; 0 of a point
    lift_angle: float  # between the pull and the rod where it lifts off [rad]
    line_force: float  # along the arc, force/length of the rod's axis; 0 of a point
    end_force: float  # at each end of the arc; without an arc both act at the one point


@dataclass(frozen=True)
class Capstan:
    """A rod over a cylinder, both ends pulled by dead forces, without moments.

    On the free parts ``B psi'' = F sin psi``, psi from the pull to the rod, so that the curvature is
    ``2 w sqrt(sin^2(psi/2) - m^2)`` with ``w = sqrt(F/B)`` and ``m = sin(psi/2)`` of the end: ``cos(psi/2) = k sn u``,
    ``k^2 = 1 - m^2``, where u grows by w times the length (Love, A Treatise on the Mathematical Theory of Elasticity
    (1927), articles 262-263).  The rod lies on the cylinder where it would be bent more than the cylinder is: there its
    moment is constant, its tension ``F cos theta``, and at both ends of the arc the shear ``F sin theta`` ends in a
    point force; theta is the lift angle.

    Parameters
    ----------
    bending
        Stiffness ``B = E I`` of the rod, force x length^2.
    radius
        Of the rod's axis where it lies on the cylinder: cylinder and rod, length.
    wrap
        Angle from one pull's line to the other's [rad], less than 2 pi: pi where both pull in the same direction.
    force
        Of each pull.
    half_length
        Of the rod from its middle to an end, length; infinite by default.
    """

    bending: float
    radius: float
    wrap: float
    force: float
    half_length: float = np.inf

    def __post_init__(self) -> None:
        """Refuse wrap angles that are not between 0 and a whole turn."""
        if not 0.0 < self.wrap < 2.0 * np.pi:
            raise InputError(f"capstan: wrap {self.wrap:.4g} rad; the elastica takes one between 0 and a whole turn")

    @property
    def threshold(self) -> float:
        """The force up to which an infinite rod touches at one point: ``B / (4 R^2 sin^2(wrap/4))``."""
        return float(self.bending / (2.0 * self.radius * np.sin(0.25 * self.wrap)) ** 2)

    @property
    def _rate(self) -> float:
        return float(np.sqrt(self.force / self.bending))

    def _lift_angle(self, end: float) -> float:
        """Return theta by ``m``: the rod is bent as the cylinder, or it touches in the middle only."""
        sine = np.hypot(end, 0.5 / (self._rate * self.radius))
        return float(min(0.5 * self.wrap, 2.0 * np.arcsin(min(sine, 1.0))))

    def _start(self, end: float) -> float:
        """Return ``u`` where the rod lifts off, by ``m``."""
        square = 1.0 - end**2
        ratio = np.cos(0.5 * self._lift_angle(end)) / np.sqrt(square)
        return float(ellipkinc(np.arcsin(min(ratio, 1.0)), square))

    @cached_property
    def _end(self) -> float:
        """The sine of half the angle from the pull to the rod's end, m; it falls with the length as exp(-w length)."""
        if self._rate * self.half_length > 40.0:
            return 0.0

        def excess(log_end: float) -> float:
            end = float(np.exp(log_end))
            arc = self.radius * (0.5 * self.wrap - self._lift_angle(end))
            return arc + (float(ellipkm1(end**2)) - self._start(end)) / self._rate - self.half_length

        most = np.log(np.sin(0.25 * self.wrap))
        return float(np.exp(brentq(excess, most - 60.0, most, xtol=1e-13)))

    @property
    def end_angle(self) -> float:
        """From the pull to the rod at its end [rad]; 0 of an infinite rod."""
        return 2.0 * float(np.arcsin(self._end))

    def touch(self) -> Touch:
        """Return arc and forces: ``theta = arccos(1 - B/(2 F R^2))`` of an infinite rod above the threshold."""
        lift = self._lift_angle(self._end)
        half = 0.5 * self.wrap - lift
        line = self.force * np.cos(lift) / self.radius if half > 0.0 else 0.0
        return Touch(half, lift, float(line), float(self.force * np.sin(lift)))

    def positions(self, length: Array) -> Array:
        """Return points of the axis at lengths along the rod from its middle, ``(n,)``; shape ``(n, 2)``.

        The cylinder's axis is the origin, the middle at ``(0, radius)``, and the second half goes to positive x.
        """
        touch = self.touch()
        side, along = np.sign(length), np.abs(np.asarray(length, dtype=float))
        angle = np.minimum(along / self.radius, touch.half_angle)
        free = np.maximum(along - self.radius * touch.half_angle, 0.0)

        square = 1.0 - self._end**2
        start = self._start(self._end)
        _, cosine, _, amplitude = ellipj(start + self._rate * free, square)
        _, first, _, first_amplitude = ellipj(start, square)
        integral = ellipeinc(amplitude, square) - ellipeinc(first_amplitude, square)
        forward = free - 2.0 / self._rate * integral
        sideways = 2.0 / self._rate * np.sqrt(square) * (first - cosine)

        pull = np.array([np.cos(0.5 * self.wrap), -np.sin(0.5 * self.wrap)])
        across = np.array([-pull[1], pull[0]])
        points = self.radius * np.column_stack([np.sin(angle), np.cos(angle)])
        points += np.outer(forward, pull) + np.outer(sideways, across)
        points[:, 0] *= side
        return points


def friction_ratio(friction: float, angle: float) -> float:
    """Return the largest ratio of tensions of a thin flexible rope that holds over an angle [rad]: ``exp(mu phi)``."""
    return float(np.exp(friction * angle))


def heavy_rope_bound(hanging: float, radius: float, friction: float) -> float:
    """Return the longest part of a heavy rope that a part hanging on the other side of a cylinder holds, length.

    ``h2 = exp(mu pi) h1 + R 2 mu/(1 + mu^2) (exp(mu pi) + 1)`` integrates ``T' = w R cos a + mu (T + w R sin a)`` over
    the upper half of a horizontal cylinder: tension carries the weight w per length, and friction what tension and
    weight press.

    Parameters
    ----------
    hanging
        Length below the cylinder's axis of the part that rises.
    radius
        Of the cylinder, length.
    friction
        Coefficient.
    """
    grown = np.exp(np.pi * friction)
    return float(grown * hanging + radius * 2.0 * friction / (1.0 + friction**2) * (grown + 1.0))


def incline_acceleration(angle: float, friction: float, gravity: float) -> float:
    """Return the acceleration of a rod along a plane inclined by an angle [rad]: 0 where it sticks, ``tan a <= mu``.

    Where it slides ``g (sin a - mu cos a)``: it lies along the slope, or across it and is kept from rolling.
    """
    return max(0.0, gravity * float(np.sin(angle) - friction * np.cos(angle)))
