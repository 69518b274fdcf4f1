"""Hertz' theory: contact of elastic bodies at a point or along a line.

Both bodies are half spaces to the pressure: the contact must be small beside every radius of curvature, and beside the
bodies.  No friction, small strains, isotropic.  Source: K. L. Johnson, Contact Mechanics (1985), sections 4.1 and
4.2; the integrals over the ellipse are Carlson's, in which neither the circle nor the order of the axes is special.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import elliprd, elliprf

from isorod.errors import InputError


def modulus(E: float, nu: float, other_E: float = np.inf, other_nu: float = 0.0) -> float:
    """Return the contact modulus ``E*``, force/area: ``1/E* = (1 - nu^2)/E + ...``, the other body rigid by default."""
    return 1.0 / ((1.0 - nu**2) / E + (1.0 - other_nu**2) / other_E)


class Gap(NamedTuple):
    """Distance of the undeformed surfaces, ``flat x^2 + steep y^2``; both coefficients 1/length."""

    flat: float
    steep: float


def gap(first: tuple[float, float], second: tuple[float, float] = (0.0, 0.0), angle: float = 0.0) -> Gap:
    """Return the gap between two surfaces that touch at a point.

    Parameters
    ----------
    first, second
        Principal curvatures, 1/length, negative where hollow: ``(1/R, 0)`` of a cylinder, ``(1/R, 1/R)`` of a sphere,
        ``(1/r, -1/(R - r))`` inside a hook whose axis has the radius R.  The second is a plane by default.
    angle
        Between the first principal directions of both [rad].

    Raises
    ------
    InputError
        If the surfaces cross.
    """
    total = 0.5 * (sum(first) + sum(second))
    one, other = first[0] - first[1], second[0] - second[1]
    # Deviators of the two curvature tensors add up like vectors at twice the angle.
    difference = 0.5 * abs(one + other * np.exp(2j * angle))
    result = Gap(float(0.5 * (total - difference)), float(0.5 * (total + difference)))
    if result.flat < -1e-12 * abs(result.steep):
        raise InputError(f"gap: the surfaces cross near the point where they touch, curvature {2.0 * result.flat:.4g}")
    return result


class PointContact(NamedTuple):
    """Hertz' solution of a point contact under a normal force."""

    long: float  # semi-axis along which the gap is flat, length
    short: float  # the other semi-axis, length
    approach: float  # of points far from the contact, length
    peak: float  # largest pressure, force/area: 3/2 of the mean


def point_contact(force: float, modulus: float, gap: Gap) -> PointContact:
    """Return ellipse, approach and pressure of two bodies pressed together at a point.

    The pressure ``p0 sqrt(1 - x^2/a^2 - y^2/b^2)`` lowers the surfaces by ``approach - flat x^2 - steep y^2``: with
    ``R_F``, ``R_D`` of Carlson ``approach = 3F/(2 pi E*) R_F(0, a^2, b^2)``, ``flat = F/(2 pi E*) R_D(0, b^2, a^2)``
    and ``steep = F/(2 pi E*) R_D(0, a^2, b^2)``.

    Parameters
    ----------
    force
        Normal force.
    modulus
        Contact modulus, force/area.
    gap
        From `gap`; bodies that touch along a line have no ellipse (`line_contact`).

    Raises
    ------
    InputError
        If the bodies touch along a line.
    """
    if gap.flat <= 1e-12 * gap.steep:
        raise InputError("point_contact: the bodies touch along a line; line_contact takes the force per length")

    def excess(log_ratio: float) -> float:
        square = np.exp(2.0 * log_ratio)
        return float(np.log(elliprd(0.0, square, 1.0) / elliprd(0.0, 1.0, square) * gap.steep / gap.flat))

    # flat/steep < b/a <= 1; the bounds leave room for the circle's rounding.
    ratio = float(np.exp(brentq(excess, np.log(gap.flat / gap.steep) - 1.0, 1e-9, xtol=1e-14)))
    unit = force / (2.0 * np.pi * modulus)
    long = float(np.cbrt(unit * elliprd(0.0, ratio**2, 1.0) / gap.flat))
    return PointContact(
        long=long,
        short=ratio * long,
        approach=float(3.0 * unit * elliprf(0.0, ratio**2, 1.0) / long),
        peak=1.5 * force / (np.pi * ratio * long**2),
    )


def crossed_cylinders(
    force: float, modulus: float, radii: tuple[float, float], angle: float = 0.5 * np.pi
) -> PointContact:
    """Return the contact of two cylinders whose axes cross at an angle [rad]; radii are lengths."""
    return point_contact(force, modulus, gap((1.0 / radii[0], 0.0), (1.0 / radii[1], 0.0), angle))


class LineContact(NamedTuple):
    """Hertz' solution of a line contact under a force per length."""

    half_width: float  # length
    peak: float  # largest pressure, force/area: 4/pi of the mean


def line_contact(line_load: float, modulus: float, radii: tuple[float, float]) -> LineContact:
    """Return half width and peak pressure of parallel cylinders, in plane strain.

    ``b = 2 sqrt(q R/(pi E*))``, ``p0 = 2 q/(pi b)``.  There is no approach: the displacement under a line load grows
    with the logarithm of the distance, so that of the axes depends on where and how each body is held.

    Parameters
    ----------
    line_load
        Normal force per length.
    modulus
        Contact modulus, force/area.
    radii
        Lengths; infinite of a plane, negative of a groove.
    """
    radius = 1.0 / (1.0 / radii[0] + 1.0 / radii[1])
    half_width = float(2.0 * np.sqrt(line_load * radius / (np.pi * modulus)))
    return LineContact(half_width, 2.0 * line_load / (np.pi * half_width))
