"""An elliptical ring, exact and closed (Lu & Zhou 2011, Fig. 4); geometry only."""

from dataclasses import dataclass
from typing import ClassVar

from isorod.geometry import section
from isorod.geometry.coils import helix
from isorod.geometry.rod import Rod
from isorod.scenes import GEOMETRY_UNITS, Scene, option


@dataclass(frozen=True)
class Ring(Scene):
    """Ring of elliptical section about the z axis; the first and the last section are one."""

    analysis: ClassVar[str] = "geometry"
    units: ClassVar[dict[str, str]] = GEOMETRY_UNITS

    radius: float = option(4.0, "radius of the centre line [length]")
    a: float = option(1.0, "half axis of the section in the ring's plane [length]")
    b: float = option(1.5, "half axis of the section along z [length]")
    section_points: int = option(4, "control points round the section, at least 3")

    def rod(self) -> Rod:
        """Return the ring: four rational quadratic arcs, 8 distinct layers of control points."""
        line = helix(self.radius, 0.0, 1, 4)
        outline = section.ellipse(self.section_points, self.a, self.b)
        return line.sweep(outline, closed=True)
