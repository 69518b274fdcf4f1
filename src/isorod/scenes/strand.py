"""A strand of wires, a core and layers wound round it, pulled and twisted (Costello, Theory of Wire Rope)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

import isorod
from isorod.errors import InputError, positive, whole_number, within
from isorod.geometry import section
from isorod.geometry.axis import MAX_ELEMENTS
from isorod.geometry.center_line import straight
from isorod.geometry.coils import HELIX_ELEMENTS, helix
from isorod.geometry.rod import Rod
from isorod.scenes import Scene, option

LENGTHS = "core_radius", "wire_radius", "pitch", "length"

# The penalty between layers that cross, in moduli per radius of a wire, how deep they may lie in each other, in radii
# (the force is then some 0.3 per cent lower than with less), and how far points along a wire are apart at most.
_SOFT, _DEEP, _APART = 0.1, 3e-3, 0.5

# Wires in the first layer, and as many more in each further one.
SIX = 6


@dataclass(frozen=True)
class Strand(Scene):
    """Wires between two rigid planes, which are drawn apart and turned against each other; all may touch all.

    Layer k has 6 k wires; each lies on the crests of the one within.  All have the lay angle of the first, in turn
    right- and left-handed, so that layers cross.

    Force and torque are those of the whole length.  Within about a wire's radius of either plane wires cannot tilt:
    per length they stretch and turn by as much less in between.  The stiffness of a strand without ends is the
    difference of two lengths: ``(L2 - L1) inv(L2 inv(K2) - L1 inv(K1))``.
    """

    analysis: ClassVar[str] = "statics"
    units: ClassVar[dict[str, str]] = {
        "force": "(unit of E x length^2; mm and MPa give N)",
        "torque": "(unit of E x length^3; mm and MPa give N mm)",
        "contact_force": "(unit of E x length^2)",
        "relative_penetration": "(of the smallest radius)",
    }

    layers: int = option(1, "layers of wires round the core: 7, 19, 37, 61, 91 wires in all with 1 to 5")
    core_radius: float = option(1.97, "radius of the core [length]")
    wire_radius: float = option(1.865, "radius of the other wires [length]")
    pitch: float = option(115.0, "length of strand in which a wire of the first layer goes round once [length]")
    length: float = option(57.5, "length of the strand [length]")
    strain: float = option(1e-3, "axial strain: the far plane moves by as much times the length")
    twist_rate: float = option(
        0.0, "turn of the far plane per length of strand [degrees/length], right-handed", was="--twist", radians=True
    )
    E: float = option(188e3, "Young's modulus [force/area]")
    nu: float = option(0.3, "Poisson's ratio")
    friction: float = option(0.0, "coefficient of friction")
    section_points: int = option(12, "control points round a wire, a multiple of 6")
    parts: int = option(2, f"elements that each of the core's own is cut into, which are {HELIX_ELEMENTS} a pitch")
    order: int = option(2, "polyharmonic order K of functions of the control points, 1 to 6")
    degree: int = option(4, "degree along the axis, 4 to 6")
    quadrature: str | None = option(None, "quadrature rule: auto, full, paper, RxS or RxSxT such as 2x1x4 (chosen)")

    @property
    def lay_angle(self) -> float:
        """Angle between the wires of each layer and the axis [rad]."""
        return float(np.arctan2(2.0 * np.pi * (self.core_radius + self.wire_radius), self.pitch))

    def layer_radius(self, layer: int) -> float:
        """Return the radius of the helices of a layer's wires, the first of which lie on the core [length]."""
        return self.core_radius + (2 * layer - 1) * self.wire_radius

    def rods(self) -> list[Rod]:
        """Return the core along z, then the wires of each layer from within.

        Control points of a wire lie on the line on which it touches what is within, and those of the core on the first
        layer's: there a point of contact is in the middle of an arc.
        """
        for name in LENGTHS:
            positive(name.replace("_", " "), getattr(self, name))
        layers = whole_number("layers", self.layers, 0, 100)
        points = whole_number("section points", self.section_points, SIX, 10_000)
        if points % SIX:
            raise InputError(f"section points: got {points}, need a multiple of {SIX}")
        turns = self.length / self.pitch
        within("length over pitch", turns, 0.0, MAX_ELEMENTS / HELIX_ELEMENTS)
        breaks = np.linspace(0.0, 1.0, int(np.ceil(HELIX_ELEMENTS * turns - 1e-9)) + 1)
        core = straight(self.length, tuple(breaks), degree=4)
        rods = [core.sweep(section.circle(points, self.core_radius), twist=360.0 * turns)]
        outline = section.circle(points, self.wire_radius)
        for layer in range(1, layers + 1):
            radius = self.layer_radius(layer)
            pitch = 2.0 * np.pi * radius / np.tan(self.lay_angle)
            for k in range(SIX * layer):
                phase = 360.0 * k / (SIX * layer)
                line = helix(radius, pitch, self.length / pitch, phase=phase, left=layer % 2 == 0)
                rods.append(line.sweep(outline))
        return rods

    def model(self) -> "isorod.Model":
        """Return the model: neo-Hookean wires, their start faces held, their end faces moved as one rigid plane."""
        law, bodies, supports = isorod.NeoHookean(self.E, self.nu), [], []
        rods, parts = self.rods(), whole_number("parts", self.parts, 1, 1_000)
        for k, rod in enumerate(rods):
            # Elements are about as long in all layers; those of the outer ones have longer pitches.
            own = rod.axis.elements
            space = self.space_of(rod, elements=own * -(-parts * rods[0].axis.elements // own))
            bodies.append(isorod.Body(space, law))
            supports += [
                isorod.Support.end(space, "start", body=k),
                isorod.Support.end(
                    space,
                    "end",
                    displacement=(0.0, 0.0, self.strain * self.length),
                    turn=(0.0, 0.0, float(np.radians(self.twist_rate)) * self.length),
                    center=(0.0, 0.0, self.length),
                    body=k,
                ),
            ]
        fewest = min(body.space.axis.elements for body in bodies)
        return isorod.Model(bodies, supports, contacts=[self._contact(len(rods), fewest)])

    def _contact(self, wires: int, elements: int) -> "isorod.Contact":
        """Return the contact of all wires, none of which has fewer elements."""
        from isorod.model.contact import MAX_POINTS

        # Lines of contact, narrower than points are apart, run along control points: in the middle of an arc's three.
        points = 3, self.degree + 1
        if self.layers < 2:
            return isorod.Contact(range(wires), points=points, friction=self.friction)
        # Layers cross at places, which must not lie between points.  They press on the middle of an arc: one point
        # there is as accurate as three, in a third of the time.  Before they are drawn together little
        # holds wires, which stiff penalties then throw back and forth.
        longest = self.length / np.cos(self.lay_angle) / elements
        smallest = min(self.core_radius, self.wire_radius)
        return isorod.Contact(
            range(wires),
            penalty=_SOFT * self.E / smallest,
            penetration=_DEEP * smallest,
            points=(1, min(MAX_POINTS, max(points[1], int(np.ceil(longest / (_APART * self.wire_radius)))))),
            friction=self.friction,
        )

    def measure(self, solution: "isorod.Equilibrium") -> dict[str, object]:
        """Return force and torque about the axis on the end that moves, and what wires press on each other with."""
        force = torque = 0.0
        for k in range(len(solution.model.bodies)):
            push, moment = solution.reactions[2 * k + 1], solution.moments[2 * k + 1]
            x, y, _ = solution.position(k, "end")
            force += push[2]
            torque += moment[2] + x * push[1] - y * push[0]
        (contact,) = solution.contacts
        return {
            "force": float(force),
            "torque": float(torque),
            "contact_force": contact.force,
            "relative_penetration": contact.relative_penetration,
        }
