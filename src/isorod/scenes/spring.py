"""A helical spring pulled along its axis (Lu & Zhou 2011, section 4.2, Table 1)."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import isorod
from isorod import choices
from isorod.errors import InputError
from isorod.geometry import section
from isorod.geometry.coils import HELIX_ELEMENTS, helix
from isorod.geometry.rod import Rod
from isorod.scenes import Preset, option, preset

# Elements a turn of the centre lines there are.
_PER_TURN = {"even": HELIX_ELEMENTS, "paper": 4}


@dataclass(frozen=True)
class Spring(Preset):
    """Round wire wound in coils, both end faces clamped, the upper one pulled along the axis."""

    analysis: ClassVar[str] = "statics"
    units: ClassVar[dict[str, str]] = {"force": "(unit of E x length^2; mm and MPa give N)"}

    coils: float = option(3, "number of turns, not necessarily whole")
    coil_radius: float = option(6.0, "radius of the helix, to the wire's centre [length]")
    pitch: float = option(2.60258, "rise per turn [length]")
    wire_radius: float = option(1.0, "radius of the wire [length]")
    E: float = option(2.014e4, "Young's modulus [force/area]")
    nu: float = option(0.3, "Poisson's ratio, up to 0.5")
    helix: str | None = option(
        None, "centre line: even, or paper (4 circular arcs a turn, which climb unevenly) (even; preset paper: paper)"
    )
    travel: float = option(2.0, "what the spring is lengthened by [length]", was="--pull")
    section_points: int = option(8, "control points round the wire, at least 3")
    elements_per_turn: int | None = option(None, "elements a turn, a multiple of 8, of the paper's helix 4 (chosen)")
    order: int | None = option(
        None, "polyharmonic order K of functions of the control points, 1 to 6 (polynomials; paper: 1)"
    )
    section_degree: int | None = option(None, "polynomials of this degree across the section, 1 to 8 (chosen)")
    degree: int | None = option(None, "degree along the axis, 4 to 6, of the paper's helix 2 to 6 (5)")
    continuity: int | None = option(None, "continuity at inserted knots, below degree (degree - 3; paper: degree - 1)")
    formulation: str | None = option(
        None, "displacement, or mixed: displacement and pressure (mixed from nu = 0.49 on)"
    )
    quadrature: str | None = option(
        None, "quadrature rule: auto, full, paper, RxS or RxSxT such as 2x1x4 (one that goes with the element)"
    )
    preset: str | None = preset("order 1 (K = 1), degree 3, 8 elements a turn, displacements alone, quadrature auto")

    PAPER: ClassVar[Mapping[str, Any]] = {
        "helix": "paper",
        "order": 1,
        "degree": 3,
        "elements_per_turn": 8,
        "formulation": "displacement",
        "quadrature": "auto",
    }

    SUITS: ClassVar[Mapping[str, Any]] = {"helix": "even"}

    @property
    def per_turn(self) -> int:
        """Elements a turn of the wire as first built."""
        if self.helix not in _PER_TURN:
            raise InputError(f"helix: got {self.helix!r}, need {' or '.join(_PER_TURN)}")
        return _PER_TURN[self.helix]

    def rod(self) -> Rod:
        """Return the wire as first built: a quartic spline that climbs evenly, or the paper's four arcs a turn.

        The lead angle of these arcs wobbles from 3.10 to 4.38 degrees round 3.95.
        """
        arcs = None if self.per_turn == HELIX_ELEMENTS else self.per_turn
        coil = self.coil_radius, self.pitch, self.coils, arcs
        line = choices.same(coil, lambda: helix(*coil))
        return choices.same(
            (*coil, self.section_points, self.wire_radius),
            lambda: line.sweep(section.circle(self.section_points, self.wire_radius)),
        )

    def model(self) -> "isorod.Model":
        """Return the model: neo-Hookean, start clamped, end clamped and displaced by ``(0, 0, travel)``.

        Warns where neighbouring coils overlap.
        """
        space = self.space_in_turns(self.rod(), self.per_turn, self.elements_per_turn)
        if self.coils > 1 and abs(self.pitch) < 2.0 * self.wire_radius:
            warnings.warn(
                f"pitch {self.pitch:g} is less than the wire's diameter {2.0 * self.wire_radius:g}: "
                "neighbouring coils overlap and nothing keeps them apart",
                stacklevel=2,
            )
        pulled = isorod.Support.end(space, "end", displacement=(0.0, 0.0, self.travel))
        body = isorod.Body(space, isorod.NeoHookean(self.E, self.nu), formulation=self.formulation)
        return isorod.Model([body], [isorod.Support.end(space, "start"), pulled])

    def measure(self, solution: "isorod.Equilibrium") -> dict[str, object]:
        """Return the axial force that holds the upper end [force]."""
        return {"force": float(solution.reactions[1, 2])}
