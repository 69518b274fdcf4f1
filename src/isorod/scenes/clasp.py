"""Two rods in half turns, hooked into each other at right angles and drawn apart: the orthogonal clasp."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

import isorod
from isorod.errors import InputError, positive
from isorod.geometry import section
from isorod.geometry.coils import helix
from isorod.geometry.rod import Rod
from isorod.scenes import Scene, option

# Rows: where x, y and z of a half turn from x over y to -x point in the clasp.
_UPPER = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
_LOWER = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class Clasp(Scene):
    """Two half turns in planes at right angles, each through the other, touching at rest; their ends drawn apart.

    The first hangs from its ends in the plane of x and z, the second stands on its ends in that of y and z.  Where they
    touch, inside both bends, each is curved by the one's section across and by the other's bend along, so that the
    curvature between them is the same all round: under a small force Hertz' contact with the radius
    ``1 / (1 / radius - 1 / (bend - radius))``.
    """

    analysis: ClassVar[str] = "statics"
    units: ClassVar[dict[str, str]] = {
        "force": "(unit of E x length^2; mm and MPa give N)",
        "contact_force": "(unit of E x length^2)",
        "peak_pressure": "(unit of E)",
        "relative_penetration": "(of the rods' radius)",
    }

    radius: float = option(1.0, "radius of the rods [length]")
    bend: float = option(4.0, "radius of their centre lines [length], more than twice that of the rods")
    travel: float = option(0.5, "what the ends of the two are drawn apart by [length]", was="--pull")
    E: float = option(1000.0, "Young's modulus [force/area]")
    nu: float = option(0.3, "Poisson's ratio")
    friction: float = option(0.0, "coefficient of friction")
    section_points: int = option(16, "control points round a rod, at least 3")
    elements: int = option(16, "elements along a rod, a multiple of 4")
    order: int = option(2, "polyharmonic order K of functions of the control points, 1 to 6")
    degree: int = option(4, "degree along the axis, 4 to 6")
    quadrature: str | None = option(None, "quadrature rule: auto, full, paper, RxS or RxSxT such as 2x1x4 (chosen)")

    def rods(self) -> list[Rod]:
        """Return the upper rod, which hangs, and the lower one, which stands."""
        for name in ("radius", "bend"):
            positive(name, getattr(self, name))
        if not self.bend > 2.0 * self.radius:
            raise InputError(f"bend: got {self.bend:g}, need more than twice the radius, {self.radius:g}")
        turn = helix(self.bend, 0.0, 0.5).sweep(section.circle(self.section_points, self.radius))
        # The half turns' tops are `radius` above and below the origin, inside of each other.
        up = np.array([0.0, 0.0, self.bend - self.radius])
        return [
            Rod(turn.axis, turn.control_points @ _UPPER + up, fitted=True),
            Rod(turn.axis, turn.control_points @ _LOWER - up, fitted=True),
        ]

    def model(self) -> "isorod.Model":
        """Return the model: neo-Hookean rods, both ends of the lower one held, those of the upper one drawn up."""
        law, bodies, supports = isorod.NeoHookean(self.E, self.nu), [], []
        for k, rod in enumerate(self.rods()):
            space = self.space_of(rod)
            bodies.append(isorod.Body(space, law))
            moved = (0.0, 0.0, self.travel if k == 0 else 0.0)
            supports += [isorod.Support.end(space, end, displacement=moved, body=k) for end in ("start", "end")]
        return isorod.Model(bodies, supports, contacts=[isorod.Contact(0, 1, friction=self.friction)])

    def measure(self, solution: "isorod.Equilibrium") -> dict[str, object]:
        """Return the force that draws them apart, and how they press on each other."""
        (contact,) = solution.contacts
        return {
            "force": float(solution.reactions[:2, 2].sum()),
            "contact_force": contact.force,
            "peak_pressure": float(contact.pressure.max(initial=0.0)),
            "relative_penetration": contact.relative_penetration,
        }
