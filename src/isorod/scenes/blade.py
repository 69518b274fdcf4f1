"""The blade of a small wind turbine: twisted, tapered, clamped at its root (Lu & Zhou 2011, section 4.3, Table 2)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

import isorod
from isorod.errors import InputError, positive
from isorod.geometry import section
from isorod.geometry.axis import Axis
from isorod.geometry.rod import Rod
from isorod.scenes import Preset, option, preset
from isorod.tensors import rotation

# Control points round the section as first built.
POINTS = 16

_AXIS = Axis(2, np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]), np.ones(3))


@dataclass(frozen=True)
class Blade(Preset):
    """Airfoil section swept along z with linear twist and taper, root face clamped; vibration modes."""

    analysis: ClassVar[str] = "modal"
    units: ClassVar[dict[str, str]] = {"frequencies": "(cycles per unit of time; m, N and kg give Hz)"}

    length: float = option(8.3, "length [length]")
    twist: float = option(15.0, "turn of the tip about the axis [degrees]")
    taper: float = option(0.5, "size of the tip section relative to the root's")
    E: float = option(3.0e6, "Young's modulus [force/area]")
    nu: float = option(0.3, "Poisson's ratio")
    density: float = option(40.0, "mass per volume")
    airfoil: str = option("paper", "section: paper, or a NACA 4-digit number such as 2412")
    chord: float = option(2.0, "chord of the root section [length]")
    section_points: int | None = option(
        None, "control points round the section, with the paper's section a multiple of 16, for functions of these (16)"
    )
    elements: int | None = option(None, "elements along the blade (chosen)")
    order: int | None = option(
        None, "polyharmonic order K of functions of the control points, 1 to 6 (polynomials; paper: 1)"
    )
    section_degree: int | None = option(None, "polynomials of this degree across the section, 1 to 8 (chosen)")
    degree: int | None = option(None, "degree along the axis, 2 to 6 (5)")
    continuity: int | None = option(None, "continuity at inserted knots, below degree (degree - 3; paper: degree - 1)")
    quadrature: str | None = option(
        None, "quadrature rule: auto, full, paper, RxS or RxSxT such as 2x1x4 (one that goes with the element)"
    )
    preset: str | None = preset("order 1 (K = 1), degree 2, 20 elements, quadrature auto")

    PAPER: ClassVar[Mapping[str, Any]] = {"order": 1, "degree": 2, "elements": 20, "quadrature": "auto"}

    def rod(self) -> Rod:
        """Return the blade as first built: 16 points round the paper's section, one quadratic element along.

        Twist and scale go linearly from root to tip over its three layers of control points.
        """
        for name in ("length", "taper"):
            positive(name, getattr(self, name), "a positive number")
        if not abs(self.twist) <= 90.0:
            raise InputError(f"twist: got {self.twist:g} degrees, the one element of the blade carries -90 to 90")
        fractions = np.array([0.0, 0.5, 1.0])
        rotations = np.array([rotation((0.0, 0.0, angle)) for angle in np.radians(self.twist) * fractions])
        stretches = (1.0 + (self.taper - 1.0) * fractions)[:, None, None] * np.eye(3)
        centers = fractions[:, None] * np.array([0.0, 0.0, self.length])
        return Rod.sweep(self._outline(), _AXIS, centers, rotations, stretches)

    def _outline(self) -> Any:
        if self.airfoil == "paper":
            positive("chord", self.chord)
            return 0.5 * self.chord * section.airfoil()
        return section.naca(self.airfoil, self.section_points or POINTS, self.chord)

    def model(self) -> "isorod.Model":
        """Return the model: linear elastic, root clamped."""
        # Those of another section than the paper's are what its outline is fitted with.
        points = self.section_points if self.airfoil == "paper" else None
        space = self.space_of(self.rod(), section_points=points)
        body = isorod.Body(space, isorod.LinearElastic(self.E, self.nu), self.density)
        return isorod.Model([body], [isorod.Support.end(space, "start")])

    def measure(self, solution: "isorod.Modes") -> dict[str, object]:
        """Return the frequencies [cycles per time]."""
        return {"frequencies": solution.frequencies}
