"""A rod laid over a rigid cylinder under end tension: an elastica round a capstan, with or without friction."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

import isorod
from isorod.arrays import Array
from isorod.errors import InputError, positive, within
from isorod.geometry import section
from isorod.geometry.center_line import straight
from isorod.geometry.rod import Rod
from isorod.scenes import Scene, option

POSITIVE = "radius", "ratio", "tension", "tail", "E"


@dataclass(frozen=True)
class Rope(Scene):
    """Rod that is straight at rest, laid over the top of a fixed cylinder and pulled down on either side.

    The start is pulled with a force of fixed direction.  The end is moved to where a thin rod without friction has it
    (a weightless elastica, see `tail_of`), and farther by ``haul``, which makes it slide.  Both end faces turn until
    they are normal to the pull.  Lengths are relative to the radius of the bent centre line on the cylinder,
    ``radius * ratio``, unless stated otherwise.
    """

    analysis: ClassVar[str] = "statics"
    units: ClassVar[dict[str, str]] = {
        "tensions": "(force; of start and end, along the pull)",
        "contact_force": "(force)",
        "arc": "degrees (between the outermost points in contact)",
        "relative_penetration": "(of the rod's radius)",
    }

    radius: float = option(1.0, "radius of the rod [length]")
    ratio: float = option(10.0, "radius of the centre line on the cylinder, over that of the rod")
    wrap: float = option(30.0, "angle between the directions of both pulls [degrees], 0 to 180")
    tension: float = option(1.0, "force at the start over B / Rb^2: bending stiffness, radius of the centre line there")
    haul: float = option(0.0, "what the end is pulled farther, over the radius of the centre line")
    tail: float = option(4.0, "length of the rod on either side of the cylinder's top, over that radius, besides wrap")
    E: float = option(1000.0, "Young's modulus [force/area]")
    nu: float = option(0.3, "Poisson's ratio")
    friction: float = option(0.0, "coefficient of friction")
    section_points: int = option(8, "control points round the rod, at least 3")
    elements: int = option(32, "elements along the rod")
    order: int = option(2, "polyharmonic order K of functions of the control points, 1 to 6")
    degree: int = option(3, "degree along the axis, 2 to 6")
    quadrature: str | None = option(None, "quadrature rule: auto, full, paper, RxS or RxSxT such as 2x1x4 (chosen)")

    @property
    def bend(self) -> float:
        """Radius of the centre line on the cylinder [length]."""
        return self.radius * self.ratio

    @property
    def force(self) -> float:
        """The pull at the start."""
        return self.tension * self.E * 0.25 * np.pi * self.radius**4 / self.bend**2

    @property
    def half(self) -> float:
        """Length of the rod on either side of the cylinder's top."""
        return self.bend * (self.tail + 0.5 * float(np.radians(self.wrap)))

    @property
    def cylinder(self) -> Array:
        """The point below the middle of the rod at rest through which the cylinder's axis goes."""
        return np.array([0.0, -self.bend, 0.0])

    def tail_of(self, tension: float) -> Array:
        """Return where the end of a thin rod is, relative to the top of its centre line, shape ``(2,)``.

        From where it leaves the cylinder its angle to the pull is ``a``, with ``B a'' = F sin a`` and so
        ``a' = -2 sin(a / 2) / l``, ``l^2 = B / F``.  That curvature is the cylinder's at first, if there is an arc in
        contact.  It comes forward along the pull by the length less ``2 l (1 - cos(a0 / 2))``, across it by
        ``2 l sin(a0 / 2)``.

        Parameters
        ----------
        tension
            Over B / Rb^2.
        """
        half, scale = 0.5 * float(np.radians(self.wrap)), self.bend / np.sqrt(tension)
        leaves = min(half, 2.0 * float(np.arcsin(min(0.5 / np.sqrt(tension), 1.0))))
        arc = half - leaves
        along = self.half - self.bend * arc - 2.0 * scale * (1.0 - np.cos(0.5 * leaves))
        along += self.half * self.force / (self.E * np.pi * self.radius**2)
        pull, off = np.array([np.cos(half), -np.sin(half)]), np.array([np.sin(half), np.cos(half)])
        top = self.bend * np.array([np.sin(arc), np.cos(arc) - 1.0])
        result: Array = top + along * pull + 2.0 * scale * np.sin(0.5 * leaves) * off
        return result

    def rod(self) -> Rod:
        """Return the rod at rest, straight along x, its middle over the cylinder."""
        for name in POSITIVE:
            positive(name, getattr(self, name), "a positive number")
        # Fourth powers of it are computed.
        within("radius", self.radius, 1e-50, 1e50)
        within("ratio", self.ratio, 0.0, 1e6)
        if not self.ratio > 1.0:
            raise InputError(f"ratio: got {self.ratio:g}, need more than 1, for a cylinder to be there")
        if not 0.0 < self.wrap <= 180.0:
            raise InputError(f"wrap: got {self.wrap:g} degrees, need an angle up to 180")
        line = straight(start=(-self.half, 0.0, 0.0), end=(self.half, 0.0, 0.0))
        return line.sweep(section.circle(self.section_points, self.radius))

    def model(self) -> "isorod.Model":
        """Return the model: neo-Hookean, start pulled and free to follow, end moved; both faces turned."""
        space = self.space_of(self.rod())
        half = 0.5 * float(np.radians(self.wrap))
        pull = np.array([np.cos(half), -np.sin(half)])
        x, y = self.tail_of(self.tension) + self.haul * self.bend * pull - [self.half, 0.0]
        supports = [
            isorod.Support.end(space, "start", "z", turn=(0.0, 0.0, half), tied="xy"),
            isorod.Support.end(space, "end", displacement=(float(x), float(y), 0.0), turn=(0.0, 0.0, -half)),
        ]
        force = self.force * pull
        load = isorod.SectionLoad.end(space, "start", (-float(force[0]), float(force[1]), 0.0))
        x, y, z = (float(value) for value in self.cylinder)
        cylinder = isorod.Cylinder((x, y, z), (0.0, 0.0, 1.0), self.bend - self.radius)
        body = isorod.Body(space, isorod.NeoHookean(self.E, self.nu))
        contact = isorod.Contact(0, cylinder, friction=self.friction)
        return isorod.Model([body], supports, loads=[load], contacts=[contact])

    def measure(self, solution: "isorod.Equilibrium") -> dict[str, object]:
        """Return the forces along the pull at both ends, and how the rod lies on the cylinder."""
        half = 0.5 * np.radians(self.wrap)
        (contact,) = solution.contacts
        touching = contact.pressure > 0.0
        x, y = (contact.positions[touching] - self.cylinder).T[:2]
        angles = np.degrees(np.arctan2(x, y))
        return {
            "tensions": [self.force, float(solution.reactions[1, :2] @ [np.cos(half), -np.sin(half)])],
            "contact_force": contact.force,
            "arc": float(np.ptp(angles)) if angles.size else 0.0,
            "relative_penetration": contact.relative_penetration,
        }
