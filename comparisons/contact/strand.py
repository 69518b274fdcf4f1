"""Strand of a straight core and layers of helical wires, pulled and twisted: thin rods, without friction.

Each wire has the energy of extension, bending and torsion of a thin rod, in strains per length at rest (`Strand`), and
all sections of a layer are alike.  What holds them together is geometry: each layer lies on the crests of the one
within, and all wires contract by Poisson's ratio as they stretch.  The energy under that constraint has a symmetric
stiffness.

Assumed: small strains; ends that turn with the end planes; wires of one layer do not touch each other; no flattening
where wires touch, which makes a strand softer by a percent or less; loads between layers are spread evenly along and
around.  Between crossing layers real contacts are points, between layers of one pitch the wires may nest in the grooves
below instead: then the radii at rest are smaller, and this is no reference.

Source: A. E. H. Love, A Treatise on the Mathematical Theory of Elasticity (1927), chapter XVIII; the strand is that of
G. A. Costello, Theory of Wire Rope (1997), whose published stiffness is not symmetric because its changes of curvature
and torsion are not conjugate to the moments.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array


class Wire(NamedTuple):
    """A round wire."""

    radius: float  # length
    E: float  # Young's modulus, force/area
    nu: float  # Poisson's ratio

    @property
    def stiffness(self) -> Array:
        """Extension [force], bending and torsion [force x length^2], shape (3,)."""
        area = np.pi * self.radius**2
        bending = 0.25 * self.E * area * self.radius**2
        return np.array([self.E * area, bending, bending / (1.0 + self.nu)])


class Layer(NamedTuple):
    """Equal wires wound round the layers within."""

    wires: int
    wire: Wire
    pitch: float  # length of strand in which a wire goes round once; negative where it is left-handed


@dataclass(frozen=True)
class Strand:
    """A core and layers from within to without.

    A wire of a layer at radius r, whose strand of unit length is stretched to z and turns by t, has the length
    ``l = sqrt(z^2 + r^2 t^2)``, at rest l0.  Its strains per length at rest are ``l/l0 - 1`` and what ``r t^2/(l l0)``
    and ``z t/(l l0)``, curvature and torsion, change by.
    """

    core: Wire
    layers: tuple[Layer, ...]

    @property
    def helix_radii(self) -> Array:
        """Of the layers' wires at rest, lengths, shape (layers,)."""
        wires = np.array([layer.wire.radius for layer in self.layers])
        return self.core.radius + 2.0 * np.cumsum(wires) - wires

    @property
    def lay_angles(self) -> Array:
        """Of the layers' wires to the axis [rad], positive where right-handed, shape (layers,)."""
        return np.arctan(2.0 * np.pi * self.helix_radii / np.array([layer.pitch for layer in self.layers]))

    def strains(self) -> Array:
        """Return the wires' strains by the strand's, ``(layers, 3, 2)``.

        Extension, curvature and torsion [1/length] of a wire of each layer, by axial strain and by turn per length.
        """
        strains = []
        # Contraction of the layers within, by strain and turn: a layer's radius follows from the wires below it.
        within = np.array([self.core.nu * self.core.radius, 0.0])
        for layer, radius in zip(self.layers, self.helix_radii, strict=True):
            poisson, slopes = layer.wire.nu * layer.wire.radius, _slopes(radius, 2.0 * np.pi / layer.pitch)
            growth = -(within + poisson * slopes[0, :2]) / (1.0 + poisson * slopes[0, 2])
            strains.append(slopes[:, :2] + np.outer(slopes[:, 2], growth))
            within = within + 2.0 * poisson * strains[-1][0]
        return np.array(strains)

    def stiffness(self) -> Array:
        """Return the matrix that takes axial strain and turn per length to force and torque, shape (2, 2)."""
        extension, _, torsion = self.core.stiffness
        matrix = np.diag([extension, torsion])
        for layer, strains, angle in zip(self.layers, self.strains(), self.lay_angles, strict=True):
            matrix = matrix + layer.wires / np.cos(angle) * strains.T @ (layer.wire.stiffness[:, None] * strains)
        return matrix


def _slopes(radius: float, turn: float) -> Array:
    """Return the derivatives of a wire's strains by axial strain, turn and radius at rest, shape (3, 3)."""
    square = 1.0 + (radius * turn) ** 2
    # of the length l, over l
    length = np.array([1.0, radius**2 * turn, radius * turn**2]) / square
    curvature, torsion = radius * turn**2 / square, turn / square
    bend = np.array([0.0, 2.0 * radius * turn, turn**2]) / square - curvature * length
    twist = np.array([turn, 1.0, 0.0]) / square - torsion * length
    return np.array([length, bend, twist])
