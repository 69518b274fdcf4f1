"""Two rods in half turns, hooked into each other at right angles and drawn apart: the orthogonal clasp."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from isorod.errors import InputError, whole_number
from isorod.geometry import section
from isorod.geometry.center_line import helix
from isorod.geometry.rod import Rod
from isorod.scenes import Scene, option

if TYPE_CHECKING:
    from isorod.model.model import Model
    from isorod.statics.analysis import Equilibrium

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
    pull: float = option(0.5, "what the ends of the two are drawn apart by [length]")
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
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"{name}: got {value:g}, need a positive length")
        if not self.bend > 2.0 * self.radius:
            raise InputError(f"bend: got {self.bend:g}, need more than twice the radius, {self.radius:g}")
        turn = helix(self.bend, 0.0, 0.5).sweep(section.circle(self.section_points, self.radius))
        # The half turns' tops are `radius` above and below the origin, inside of each other.
        up = np.array([0.0, 0.0, self.bend - self.radius])
        return [
            Rod(turn.axis, turn.control_points @ _UPPER + up, fitted=True),
            Rod(turn.axis, turn.control_points @ _LOWER - up, fitted=True),
        ]

    def model(self) -> "Model":
        """Return the model: neo-Hookean rods, both ends of the lower one held, those of the upper one drawn up."""
        from isorod.material.neo_hookean import NeoHookean
        from isorod.model.body import Body
        from isorod.model.contact import Contact
        from isorod.model.model import Model
        from isorod.model.support import Support
        from isorod.space.space import Space

        elements = whole_number("elements", self.elements, 1, 100_000)
        law, bodies, supports = NeoHookean(self.E, self.nu), [], []
        for k, rod in enumerate(self.rods()):
            rod.check()
            space = Space(
                rod,
                elements=elements,
                degree=self.degree,
                continuity=self.degree - 1,
                quadrature=self.quadrature,
                order=self.order,
            )
            bodies.append(Body(space, law))
            way = (0.0, 0.0, self.pull if k == 0 else 0.0)
            supports += [Support.end(space, end, displacement=way, body=k) for end in ("start", "end")]
        return Model(bodies, supports, contacts=[Contact(0, 1, friction=self.friction)])

    def measure(self, solution: "Equilibrium") -> dict[str, object]:
        """Return the force that draws them apart, and how they press on each other."""
        (contact,) = solution.contacts
        return {
            "force": float(solution.reactions[:2, 2].sum()),
            "contact_force": contact.force,
            "peak_pressure": float(contact.pressure.max(initial=0.0)),
            "relative_penetration": contact.relative_penetration,
        }
