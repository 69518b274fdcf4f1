"""A compression spring pushed together until its coils touch (Love, Mathematical Theory of Elasticity, art. 271)."""

import warnings
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

import isorod
from isorod.arrays import Array
from isorod.errors import InputError, positive
from isorod.geometry import bspline, section
from isorod.geometry.center_line import CenterLine
from isorod.geometry.coils import HELIX_ELEMENTS, helix
from isorod.geometry.fitting import evaluate
from isorod.geometry.rod import Rod
from isorod.scenes import Scene, option

LENGTHS = "coil_radius", "wire_radius", "pitch"
ENDS = "laid", "clamped", "closed"

# The tip of a closed end is farther from the next turn than in contact, by this fraction of the wire.
_CLEAR = 0.05

# Of steel on steel.  Between plates stabilisation acts along the load path, which friction would remember.
_FRICTION = 0.15

# Poisson's ratio above which the volume of seats matters: beside 24 elements a turn, the force of one turn pushed by 5
# mm is 0.35, 0.9, 2.9 % too high at 0.49, 0.499, 0.4999; after a tenth of that 0.8, 2 and 6 %.
_SQUEEZED = 0.49

# Straight segments of the path of seat nodes: with a single one, forces early in the travel are 3 % too low.
_LEGS = 20

# Plates are as far from the centre of the wire that lies on them, in its radii.
_SEAT = 1.0 - 1e-6


@dataclass(frozen=True)
class Coil(Scene):
    """Round wire in coils whose ends are kept from turning about the axis and moved together; it touches itself.

    Love's wire stays a helix of so many turns, which widens as its coils lie down.  It goes on for a turn at either
    end, held in a seat that lies down with it (``ends`` ``"laid"``).  So all coils touch at once, each bears the next
    on its whole length, and the stack is as stiff as wires that are flattened.  Without friction coils that press on
    each other slide off sideways, the sooner the thinner the wire.

    A spring as it is bought (``"closed"``) has one turn more at either end, which lies flat on a rigid plate until it
    has to rise above its own tip.  The upper plate moves; the plates hold the wire, but for the tips of its ends, which
    stay above each other (supports that keep ``x`` and ``y``).
    """

    analysis: ClassVar[str] = "statics"
    units: ClassVar[dict[str, str]] = {
        "force": "(unit of E x length^2; mm and MPa give N)",
        "travels": "(at each load step)",
        "forces": "(there)",
        "contact_force": "(unit of E x length^2)",
        "relative_penetration": "(of the wire's radius)",
    }
    load_steps: ClassVar[int] = 10

    coils: float = option(5, "number of turns, not necessarily whole, between those at the ends")
    coil_radius: float = option(10.0, "radius of the helix, to the wire's centre [length]")
    pitch: float = option(11.079, "rise per turn [length]")
    wire_radius: float = option(1.0, "radius of the wire [length]")
    E: float = option(210e3, "Young's modulus [force/area]")
    nu: float = option(0.3, "Poisson's ratio")
    travel: float | None = option(
        None, "what the spring is shortened by [length] (45.4; 20 between plates)", was="--push"
    )
    ends: str = option(
        "laid", "laid (in seats that lie down with the coils), clamped (end faces as they are), closed (between plates)"
    )
    friction: float | None = option(None, "coefficient of friction (0.15; none between plates)")
    section_points: int = option(8, "control points round the wire, at least 3")
    elements_per_turn: int = option(HELIX_ELEMENTS, f"elements a turn, a multiple of {HELIX_ELEMENTS}")
    order: int = option(2, "polyharmonic order K of functions of the control points, 1 to 6")
    degree: int = option(4, "degree along the axis, 4 to 6")
    quadrature: str | None = option(None, "quadrature rule: auto, full, paper, RxS or RxSxT such as 2x1x4 (chosen)")

    @property
    def shortening(self) -> float:
        """Shortening of the spring [length]: to solid, or, between plates, half as far."""
        if self.travel is not None:
            return self.travel
        return 20.0 if self.ends == "closed" else 45.4

    @property
    def height(self) -> float:
        """Of the helix at rest, between the wire's centre at both ends [length]."""
        return self.pitch * self.coils

    @property
    def lead(self) -> float:
        """Angle between the wire and the planes across the axis [radians]."""
        return float(np.arctan2(self.pitch, 2.0 * np.pi * self.coil_radius))

    def rod(self) -> Rod:
        """Return the wire as first built, a quartic spline that climbs evenly."""
        for name in LENGTHS:
            positive(name.replace("_", " "), getattr(self, name))
        pitch, room = self.pitch, 2.0 * (1.0 + _CLEAR) * self.wire_radius
        if self.ends == "closed" and not pitch > room:
            raise InputError(f"pitch: got {pitch:g}; closed ends need more than {room:.3g}")
        if (self.coils > 1 or self.ends == "laid") and not pitch > 2.0 * self.wire_radius:
            raise InputError(
                f"pitch: got {pitch:g}; coils that do not lie in each other need more than {2.0 * self.wire_radius:g}"
            )
        turns = self.coils + (0 if self.ends == "clamped" else 2)
        line = self._closed(pitch) if self.ends == "closed" else helix(self.coil_radius, pitch, turns)
        return line.sweep(section.circle(self.section_points, self.wire_radius))

    def _closed(self, pitch: float) -> CenterLine:
        """Return the centre line with one more turn at either end, flat until it has to leave the tip room."""
        line, radius = helix(self.coil_radius, 0.0, self.coils + 2), self.coil_radius
        axis, each = line.axis, line.axis.breaks[-1] / (self.coils + 2)
        flat = each * (1.0 - 2.0 * (1.0 + _CLEAR) * self.wire_radius / pitch)
        # Flat control points make the spline flat, and those that rise evenly make it rise so.
        heights = (
            pitch / each * (np.clip(bspline.greville(axis.knots, axis.degree), flat, axis.breaks[-1] - flat) - flat)
        )
        centers = line.centers.copy()
        centers[:, 2] = heights

        def frames(u: Array) -> Array:
            angle = 2.0 * np.pi / each * u
            slope = np.arctan(evaluate(axis, heights, u)[1] * each / (2.0 * np.pi * radius))
            cos, sin, flat, up = np.cos(angle), np.sin(angle), np.cos(slope), np.sin(slope)
            radial = np.stack([cos, sin, 0.0 * u], axis=1)
            return np.stack([radial, np.stack([-up * sin, up * cos, -flat], axis=1)], axis=2)

        return CenterLine(axis, centers, frames=frames)

    def model(self) -> "isorod.Model":
        """Return the model: neo-Hookean, both ends held or between plates, one moved to the other by ``travel``."""
        rod = self.rod()
        space = self.space_in_turns(rod, HELIX_ELEMENTS, self.elements_per_turn)
        # Lines of contact, narrower than points are apart, run along control points: in the middle of an arc's three.
        points = 3, self.degree + 1
        others: list[isorod.Plane | None] = [None]
        if self.ends == "closed":
            # Plates that touch at rest, if only just, take the wire along from the first step.
            low, high = (float(z) for z in rod.grid([[0.0, 0.0]], rod.axis.breaks[[0, -1]])[0][:, 0, 2])
            others.append(isorod.Plane((0.0, 0.0, low - _SEAT * self.wire_radius), (0.0, 0.0, 1.0)))
            others.append(
                isorod.Plane((0.0, 0.0, high + _SEAT * self.wire_radius), (0.0, 0.0, -1.0), travel=self.shortening)
            )
        usual = 0.0 if self.ends == "closed" else _FRICTION
        friction = usual if self.friction is None else self.friction
        contacts = [isorod.Contact(0, other, points=points, friction=friction) for other in others]
        body = isorod.Body(space, isorod.NeoHookean(self.E, self.nu))
        return isorod.Model([body], self._supports(space), contacts=contacts)

    def _supports(self, space: "isorod.Space") -> "list[isorod.Support]":
        if self.ends not in ENDS:
            raise InputError(f"ends: got {self.ends!r}, need {' or '.join(ENDS)}")
        if self.ends == "closed":
            return [isorod.Support.end(space, end, "xy") for end in ("start", "end")]
        if self.ends == "clamped":
            down = (0.0, 0.0, -self.shortening)
            return [isorod.Support.end(space, "start"), isorod.Support.end(space, "end", displacement=down)]
        return self._laid(space)

    def _laid(self, space: "isorod.Space") -> "list[isorod.Support]":
        """Return supports of the turns beyond the active ones, which move as Love's helix does."""
        if self.nu > _SQUEEZED:
            warnings.warn(
                f"nu: got {self.nu:g}; end coils in laid seats are only approximately volume-preserving: spurious "
                "contact forces, up to 3 % (early on the load path 6 %) towards nu = 0.5; use ends clamped, or nu up "
                "to 0.49",
                stacklevel=3,
            )
        axis = space.axis
        places, (first, last) = bspline.greville(axis.knots, axis.degree), axis.breaks[[0, -1]]
        turn = (last - first) / (self.coils + 2)
        nodes = np.arange(space.nodes).reshape(space.layers, -1)
        ends = nodes[places < first + turn + 1e-9].ravel(), nodes[places > last - turn - 1e-9].ravel()
        path = np.array([self._helix(space, share) for share in np.linspace(0.0, 1.0, _LEGS + 1)[1:]])
        return [isorod.Support(end, displacement=path[-1, end], space=space, waypoints=path[:-1, end]) for end in ends]

    def _helix(self, space: "isorod.Space", fraction: float) -> Array:
        """Return the displacements of all nodes ``(nodes, 3)`` to Love's helix at a fraction of the travel."""
        rod, down = space.rod, fraction * self.shortening / self.coils
        sine = (self.height - fraction * self.shortening) / self._length
        if not abs(sine) < 1.0:
            raise InputError(f"travel: got {self.shortening:g}, the wire is not as long")
        wider = np.cos(np.arcsin(sine)) / np.cos(self.lead)
        laid = helix(self.coil_radius * wider, self.pitch - down, self.coils + 2)
        there = laid.sweep(section.circle(self.section_points, self.wire_radius))
        change = rod.axis.transfer(space.axis, there.control_points - rod.control_points)
        moved = space.basis.positions(change).reshape(-1, 3)
        moved[space.is_control_point, 2] += down
        return np.asarray(moved)

    @property
    def _length(self) -> float:
        """Of the wire."""
        return self.height / float(np.sin(self.lead))

    def measure(self, solution: "isorod.Equilibrium") -> dict[str, object]:
        """Return the force on the moved end, at the end and over the load steps, and the force between the coils."""
        contact, *plates = solution.contacts
        pushed = plates[-1].resultant if plates else solution.reactions[1]
        return {
            "force": -float(pushed[2]),
            "travels": [step.factor * self.shortening for step in solution.path],
            "forces": [step.push if plates else -float(step.reactions[1, 2]) for step in solution.path],
            "contact_force": contact.force,
            "relative_penetration": max(one.relative_penetration for one in solution.contacts),
        }
