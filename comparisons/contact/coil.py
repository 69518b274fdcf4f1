"""Compression spring of round wire: Love's helix under large deflections, to where its coils touch.

An inextensible, unshearable wire stays a helix of its own length, so that two numbers define its shape.  Kept from
turning about the axis, one is left: the lead.  Of a solid wire this leaves out what is of the order of (d/D)^2: the
wire's own curvature in bending and twist, shear and extension, and the ends.  Source: A. E. H. Love, A Treatise on the
Mathematical Theory of Elasticity (1927), articles 270-271.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from isorod.errors import InputError


@dataclass(frozen=True)
class Coil:
    """Spring with active coils alone, its ends kept from turning about the axis.

    Parameters
    ----------
    radius
        Of the helix at rest, length.
    wire
        Diameter of the wire, length.
    turns
        Active coils.
    lead
        Angle of the wire to the plane across the axis, at rest [rad].
    E, nu
        Young's modulus, force/area, and Poisson's ratio.
    """

    radius: float
    wire: float
    turns: float
    lead: float
    E: float
    nu: float

    @property
    def length(self) -> float:
        """Of the wire."""
        return 2.0 * np.pi * self.turns * self.radius / float(np.cos(self.lead))

    @property
    def height(self) -> float:
        """Of the helix at rest, between the wire's axis at both ends."""
        return self.length * float(np.sin(self.lead))

    @property
    def bending(self) -> float:
        """Stiffness of the wire, force x length^2."""
        return np.pi * self.E * self.wire**4 / 64.0

    @property
    def torsion(self) -> float:
        """Stiffness of the wire, force x length^2."""
        return self.bending / (1.0 + self.nu)

    def lead_at(self, shortening: float) -> float:
        """Return the lead [rad] of the spring shortened by a length.

        Raises
        ------
        InputError
            If the wire is not as long.
        """
        sine = (self.height - shortening) / self.length
        if not -1.0 < sine < 1.0:
            raise InputError(f"coil: shortened by {shortening:.4g}, which a wire of length {self.length:.4g} cannot be")
        return float(np.arcsin(sine))

    def radius_at(self, shortening: float) -> float:
        """Return the radius of the helix: turns and length are kept, so that it grows with the cosine of the lead."""
        return self.radius * float(np.cos(self.lead_at(shortening)) / np.cos(self.lead))

    def energy(self, shortening: float) -> float:
        """Return the wire's energy, force x length: curvature ``c cos(lead)``, torsion ``c sin(lead)``."""
        lead, turning = self.lead_at(shortening), np.cos(self.lead) / self.radius
        bent = turning * (np.cos(lead) - np.cos(self.lead))
        twisted = turning * (np.sin(lead) - np.sin(self.lead))
        return float(0.5 * self.length * (self.bending * bent**2 + self.torsion * twisted**2))

    def force(self, shortening: float) -> float:
        """Return the force that presses the spring, the derivative of `energy`.

        ``P = c^2 (C (sin a0 - sin a) + B (cos a - cos a0) tan a)``, ``c = cos a0 / R``.
        """
        lead, turning = self.lead_at(shortening), np.cos(self.lead) / self.radius
        twist = self.torsion * (np.sin(self.lead) - np.sin(lead))
        bend = self.bending * (np.cos(lead) - np.cos(self.lead)) * np.tan(lead)
        return float(turning**2 * (twist + bend))

    def clearance(self, shortening: float) -> float:
        """Return the gap between one coil and the next, length; negative where they overlap."""
        radius, lead = self.radius_at(shortening), self.lead_at(shortening)

        def square(turn: float) -> float:
            return float(radius**2 * (2.0 - 2.0 * np.cos(turn)) + (radius * np.tan(lead) * turn) ** 2)

        # The nearest point of the next coil is less than a whole turn on, by about tan(lead)^2.
        nearest = minimize_scalar(square, bounds=(1.5 * np.pi, 2.0 * np.pi), method="bounded", options={"xatol": 1e-10})
        return float(np.sqrt(nearest.fun)) - self.wire

    def touch(self) -> float:
        """Return the shortening, a length, at which each coil touches the next."""
        if self.clearance(0.0) <= 0.0:
            raise InputError(f"coil: the coils of wire {self.wire:.4g} touch at rest; a larger lead or a thinner wire")
        return float(brentq(self.clearance, 0.0, self.height, xtol=1e-12 * self.height))

    def flattened(self, force: float) -> float:
        """Return the shortening of active turns between two rigid ones when they press on each other.

        Each is a cylinder between two lines, of load ``q``, which approach its axis by
        ``q (1 - nu^2) / (pi E) (2 ln(4 r / b) - 1)`` each, ``b`` Hertz' half width (K. L. Johnson, Contact Mechanics
        (1985), eq. 5.57).

        Parameters
        ----------
        force
            Between turns: what the spring takes more than at touch.
        """
        line = force / (2.0 * np.pi * self.radius_at(self.touch()))
        radius, plane = 0.5 * self.wire, self.E / (1.0 - self.nu**2)
        sides = []
        for modulus in (0.5 * plane, plane):
            half_width = np.sqrt(2.0 * line * radius / (np.pi * modulus))
            sides.append(line / (np.pi * plane) * (2.0 * np.log(4.0 * radius / half_width) - 1.0))
        return float((2.0 * self.turns - 2.0) * sides[0] + 2.0 * sides[1])

    def sideways(self) -> float:
        """Return the force between turns, without friction, from which they slide off each other sideways.

        Round wires of diameter ``d`` on top of each other, one aside by ``e``, push each other on with ``F e / d``.
        What holds them is the bending of the turn between in its plane, ``E I e / (pi R^3)``: a force ``S`` across has
        the moment ``S R sin(t)``, and ends that do not turn are shifted by ``S R^3 / (E I)`` times the integral of
        ``sin(t)^2`` over the turn.
        """
        return float(self.wire * self.bending / (np.pi * self.radius**3))

    def linear_force(self, shortening: float) -> float:
        """Return the force of the engineer's formula, ``G d^4 s / (8 D^3 n)``: small leads, small shortening."""
        shear = 0.5 * self.E / (1.0 + self.nu)
        return shear * self.wire**4 * shortening / (8.0 * (2.0 * self.radius) ** 3 * self.turns)
