"""A compression spring pushed together until its coils touch (Love, Mathematical Theory of Elasticity, art. 271)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from isorod.arrays import Array
from isorod.errors import Checked, InputError
from isorod.geometry import section
from isorod.geometry.center_line import HELIX_ELEMENTS, helix
from isorod.geometry.rod import Rod
from isorod.scenes import option

if TYPE_CHECKING:
    from isorod.model.model import Model
    from isorod.model.support import Support
    from isorod.space.space import Space
    from isorod.statics.analysis import Equilibrium

LENGTHS = "coil_radius", "wire_radius"
ENDS = "laid", "clamped"


@dataclass(frozen=True)
class Coil(Checked):
    """Round wire in coils whose ends are kept from turning about the axis and moved together; it touches itself.

    Love's wire stays a helix: its end faces turn about the radial line through them as the coils lie down, and move
    outwards as these widen (``ends`` ``"laid"``).  All coils of that helix touch at once, and frictionless coils that
    lie on each other slide off sideways under a small force more.
    """

    analysis: ClassVar[str] = "statics"
    units: ClassVar[dict[str, str]] = {
        "force": "(unit of E x length^2; mm and MPa give N)",
        "contact_force": "(unit of E x length^2)",
        "relative_penetration": "(of the wire's radius)",
    }

    coils: int = option(5, "number of turns")
    coil_radius: float = option(10.0, "radius of the helix, to the wire's centre [length]")
    lead: float = option(10.0, "lead angle of the wire [degrees]")
    wire_radius: float = option(1.0, "radius of the wire [length]")
    E: float = option(210e3, "Young's modulus [force/area]")
    nu: float = option(0.3, "Poisson's ratio")
    push: float = option(40.0, "what the spring is shortened by [length]")
    ends: str = option("laid", "end faces: laid (they lie down with the coils), or clamped (as they are)")
    friction: float = option(0.0, "coefficient of friction")
    section_points: int = option(8, "control points round the wire, at least 3")
    elements_per_turn: int = option(HELIX_ELEMENTS, f"elements a turn, a multiple of {HELIX_ELEMENTS}")
    order: int = option(2, "polyharmonic order K of functions of the control points, 1 to 6")
    degree: int = option(4, "degree along the axis, 4 to 6")
    quadrature: str | None = option(None, "quadrature rule: auto, full, paper, RxS or RxSxT such as 2x1x4 (chosen)")

    @property
    def height(self) -> float:
        """Of the helix at rest, between the wire's centre at both ends [length]."""
        return 2.0 * np.pi * self.coil_radius * float(np.tan(np.radians(self.lead))) * self.coils

    def rod(self) -> Rod:
        """Return the wire as first built, a quartic spline that climbs evenly."""
        for name in LENGTHS:
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"{name.replace('_', ' ')}: got {value:g}, need a positive length")
        if not 0.0 < self.lead < 90.0:
            raise InputError(f"lead: got {self.lead:g} degrees, need an angle between 0 and 90")
        line = helix(self.coil_radius, self.height / max(self.coils, 1), self.coils)
        return line.sweep(section.circle(self.section_points, self.wire_radius))

    def model(self) -> "Model":
        """Return the model: neo-Hookean, start and end face held, the end moved towards the start by ``push``."""
        from isorod.material.neo_hookean import NeoHookean
        from isorod.model.body import Body
        from isorod.model.contact import Contact
        from isorod.model.model import Model
        from isorod.space.space import Space

        rod = self.rod()
        rod.check()
        each = self.elements_per_turn
        if each < HELIX_ELEMENTS or each % HELIX_ELEMENTS:
            raise InputError(f"elements a turn: got {each}, need a multiple of {HELIX_ELEMENTS}")
        space = Space(rod, elements=self.coils * each, degree=self.degree, quadrature=self.quadrature, order=self.order)
        body = Body(space, NeoHookean(self.E, self.nu), formulation="displacement")
        # Lines of contact, narrower than points are apart, run along control points: in the middle of an arc's three.
        contact = Contact(0, points=(3, self.degree + 1), friction=self.friction)
        return Model([body], self._supports(space), contacts=[contact])

    def _supports(self, space: "Space") -> "list[Support]":
        from isorod.model.support import Support

        if self.ends not in ENDS:
            raise InputError(f"ends: got {self.ends!r}, need {' or '.join(ENDS)}")
        down, outwards, turn = np.array([0.0, 0.0, -self.push]), np.zeros(3), (0.0, 0.0, 0.0)
        if self.ends == "laid":
            # Both ends are on the x axis, seen from above.
            lead, sine = np.radians(self.lead), (self.height - self.push) / self._length
            if not abs(sine) < 1.0:
                raise InputError(f"push: got {self.push:g}, the wire is not as long")
            lies = np.arcsin(sine)
            outwards[0] = self.coil_radius * (np.cos(lies) / np.cos(lead) - 1.0)
            turn = (float(lies - lead), 0.0, 0.0)
        return [
            Support.end(space, "start", displacement=_three(outwards), turn=turn),
            Support.end(space, "end", displacement=_three(outwards + down), turn=turn),
        ]

    @property
    def _length(self) -> float:
        """Of the wire."""
        return self.height / float(np.sin(np.radians(self.lead)))

    def measure(self, solution: "Equilibrium") -> dict[str, object]:
        """Return the force that pushes the end, and the force of the coils on each other."""
        (contact,) = solution.contacts
        return {
            "force": -float(solution.reactions[1, 2]),
            "contact_force": contact.force,
            "relative_penetration": contact.relative_penetration,
        }


def _three(vector: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in vector)
    return x, y, z
