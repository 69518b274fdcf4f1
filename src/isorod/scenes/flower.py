"""A bar with a concave, flower-shaped section (Lu & Zhou 2011, Fig. 3); geometry only."""

from dataclasses import dataclass
from typing import ClassVar

from isorod.geometry import section
from isorod.geometry.center_line import straight
from isorod.geometry.rod import Rod
from isorod.scenes import GEOMETRY_UNITS, Scene, option


@dataclass(frozen=True)
class Flower(Scene):
    """Straight bar along z; its map folds where the petals are too deep."""

    analysis: ClassVar[str] = "geometry"
    units: ClassVar[dict[str, str]] = GEOMETRY_UNITS

    radius: float = option(1.0, "mean radius of the control polygon, before the factor 1/cos(pi/n) [length]")
    petals: int = option(4, "number of petals")
    depth: float = option(0.3, "depth of the petals, relative to the radius, 0 to 1")
    length: float = option(2.0, "length of the bar [length]")
    section_points: int = option(16, "control points round the section, at least 3")

    def rod(self) -> Rod:
        """Return the bar, one quadratic element."""
        return straight(self.length).sweep(section.flower(self.section_points, self.petals, self.radius, self.depth))
