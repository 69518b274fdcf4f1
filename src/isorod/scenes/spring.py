"""A helical spring pulled along its axis (Lu & Zhou 2011, section 4.2, Table 1)."""

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from isorod.errors import Checked, InputError
from isorod.geometry import section
from isorod.geometry.center_line import HELIX_ELEMENTS, helix
from isorod.geometry.rod import Rod
from isorod.scenes import option

if TYPE_CHECKING:
    from isorod.model.model import Model
    from isorod.statics.analysis import Equilibrium

ARCS_PER_TURN = 4

# Elements a turn of the centre lines there are.
_PER_TURN = {"paper": ARCS_PER_TURN, "even": HELIX_ELEMENTS}


@dataclass(frozen=True)
class Spring(Checked):
    """Round wire wound in coils, both end faces clamped, the upper one pulled along the axis."""

    analysis: ClassVar[str] = "statics"
    units: ClassVar[dict[str, str]] = {"force": "(unit of E x length^2; mm and MPa give N)"}

    coils: int = option(3, "number of turns")
    coil_radius: float = option(6.0, "radius of the helix, to the wire's centre [length]")
    pitch: float = option(2.60258, "rise per turn [length]")
    wire_radius: float = option(1.0, "radius of the wire [length]")
    E: float = option(2.014e4, "Young's modulus [force/area]")
    nu: float = option(0.3, "Poisson's ratio, up to 0.5")
    helix: str = option(
        "paper", "centre line: paper (4 circular arcs a turn, which climb unevenly), or even (degree 4 or more)"
    )
    pull: float = option(2.0, "displacement of the upper end along the axis [length]")
    section_points: int = option(8, "control points round the wire, at least 3")
    elements_per_turn: int = option(8, "elements a turn, a multiple of 4 (even helix: 8)")
    order: int = option(1, "polyharmonic order K of the section functions, 1 to 6 (paper: 1)")
    section_degree: int | None = option(
        None, "polynomials of this degree across the section, 1 to 8, in place of order and section points (none)"
    )
    degree: int = option(3, "degree along the axis, 2 to 6")
    continuity: int | None = option(None, "continuity at inserted knots, 0 to degree - 1 (degree - 1)")
    formulation: str = option(
        "displacement", "displacement, or mixed: displacement and pressure, for nu near or at 0.5"
    )
    quadrature: str = option("auto", "quadrature rule: auto, full, paper, RxS or RxSxT such as 2x1x4")

    def rod(self) -> Rod:
        """Return the wire as first built: four quadratic arcs a turn, or a quartic spline that climbs evenly.

        The lead angle of the paper's arcs wobbles from 3.10 to 4.38 degrees round 3.95.
        """
        if self.helix not in _PER_TURN:
            raise InputError(f"helix: got {self.helix!r}, need {' or '.join(_PER_TURN)}")
        arcs = ARCS_PER_TURN if self.helix == "paper" else None
        line = helix(self.coil_radius, self.pitch, self.coils, arcs)
        outline = section.circle(self.section_points, self.wire_radius)
        return line.sweep(outline)

    def model(self) -> "Model":
        """Return the model: neo-Hookean, start clamped, end clamped and displaced by ``(0, 0, pull)``.

        Warns where neighbouring coils overlap.
        """
        from isorod.material.neo_hookean import NeoHookean
        from isorod.model.body import Body
        from isorod.model.model import Model
        from isorod.model.support import Support
        from isorod.space.space import Space

        rod = self.rod()
        own = _PER_TURN[self.helix]
        if self.elements_per_turn < own or self.elements_per_turn % own:
            raise InputError(f"elements a turn: got {self.elements_per_turn}, need a multiple of {own}")
        rod.check()
        if self.coils > 1 and abs(self.pitch) < 2.0 * self.wire_radius:
            warnings.warn(
                f"pitch {self.pitch:g} is less than the wire's diameter {2.0 * self.wire_radius:g}: "
                "neighbouring coils overlap and nothing keeps them apart",
                stacklevel=2,
            )
        space = Space(
            rod,
            elements=self.coils * self.elements_per_turn,
            degree=self.degree,
            continuity=self.continuity,
            quadrature=self.quadrature,
            order=self.order,
            section_degree=self.section_degree,
        )
        ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, self.pull))
        return Model([Body(space, NeoHookean(self.E, self.nu), formulation=self.formulation)], ends)

    def measure(self, solution: "Equilibrium") -> dict[str, object]:
        """Return the axial force that holds the upper end [force]."""
        return {"force": float(solution.reactions[1, 2])}
