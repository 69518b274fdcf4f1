"""Two rods twisted round each other, without friction: each a helix that presses on the other along a line.

Source: Kirchhoff's equations of a helix under a radial load (A. E. H. Love, A Treatise on the Mathematical Theory of
Elasticity (1927), articles 254, 270), without the layers by the ends, ``sqrt(bending/tension)`` long, in which the rod
turns from the helix into the direction that its section is held in.
"""

from dataclasses import dataclass

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError


@dataclass(frozen=True)
class TwistedPair:
    """One of two equal straight rods side by side whose ends were moved along and round the axis between them.

    The end sections are moved round, not turned: a material line along the rod keeps its direction across the axis.

    Parameters
    ----------
    helix_radius
        Half the distance of the rods' axes, length.
    length
        Of a rod at rest.
    stretch
        Length of the helix over length at rest.
    turns
        Of the ends round the axis, right-handed.
    tension
        Force of a section along the rod at that stretch: ``E A (stretch - 1)`` of a beam, of a solid by its
        law.
    bending, torsion
        Stiffnesses, force x length^2; moments are those times curvature and twist per length at rest.
    """

    helix_radius: float
    length: float
    stretch: float
    turns: float
    tension: float
    bending: float
    torsion: float

    def __post_init__(self) -> None:
        """Refuse turns for which the rod is not long enough."""
        if self.stretch * self.length <= 2.0 * np.pi * abs(self.turns) * self.helix_radius:
            raise InputError(
                f"pair: a rod of length {self.stretch * self.length:.4g} does not go round {self.turns:g} times"
            )

    @property
    def _turning(self) -> float:
        """Angle round the axis per length of the helix."""
        return 2.0 * np.pi * self.turns / (self.stretch * self.length)

    @property
    def _lead(self) -> tuple[float, float]:
        """Cosine and sine of the helix' angle to the plane across the axis."""
        cosine = self.helix_radius * self._turning
        return cosine, float(np.sqrt(1.0 - cosine**2))

    @property
    def height(self) -> float:
        """Of the helix along the axis, length; by this less the rod's length its end has to move along the axis."""
        return self.stretch * self.length * self._lead[1]

    @property
    def curvature(self) -> float:
        """Of the helix, 1/length."""
        return self.helix_radius * self._turning**2

    @property
    def helix_torsion(self) -> float:
        """Of the helix, 1/length."""
        return self._turning * self._lead[1]

    @property
    def _resultants(self) -> tuple[float, float, float]:
        """Bending moment, torque, and shear along the binormal."""
        bent = self.bending * self.stretch * self.curvature
        # A frame that goes round with the helix twists by its torsion, and the sections lag behind it by all its turns.
        wound = self.torsion * self.stretch * (self.helix_torsion - self._turning)
        return bent, wound, self.curvature * wound - self.helix_torsion * bent

    def line_load(self) -> float:
        """Return the force between the rods per length of the helix.

        ``q = kappa N - tau V``, ``V = kappa H - tau M`` with tension N, torque H, bending moment M.
        """
        return self.curvature * self.tension - self.helix_torsion * self._resultants[2]

    def wrench(self) -> tuple[float, float]:
        """Return force and torque along the axis between the rods, of both together: the same at every height."""
        cosine, sine = self._lead
        bent, wound, shear = self._resultants
        round_axis = self.helix_radius * (self.tension * cosine - shear * sine)
        return 2.0 * (self.tension * sine + shear * cosine), 2.0 * (wound * sine + bent * cosine + round_axis)

    def positions(self, length: Array) -> Array:
        """Return points ``(n, 3)`` of the axis that begins at ``(helix_radius, 0, 0)``, at lengths at rest ``(n,)``."""
        part = np.asarray(length, dtype=float) / self.length
        angle = 2.0 * np.pi * self.turns * part
        return np.column_stack(
            [self.helix_radius * np.cos(angle), self.helix_radius * np.sin(angle), self.height * part]
        )
