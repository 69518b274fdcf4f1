"""Ends of rods that are shaped as the sections between them are, so that strains are the same all along.

At the edges of an end that is held as it is, stress grows without limit: no mesh is as good there as elsewhere.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from isorod import statics
from isorod.model import Support
from isorod.space import Space
from meshes.mesh import Array

Vector = tuple[float, float, float]

ZERO = (0.0, 0.0, 0.0)

# Points of the disk at which sections are looked at: circles of these radii, and so many points on each.
_RADII, _AROUND = np.linspace(0.05, 1.0, 12), 24


class Shape:
    """The shape of a section.

    Parameters
    ----------
    solution
        Of one rod.
    """

    def __init__(self, solution: statics.Equilibrium) -> None:
        space = solution.model.bodies[0].space
        middle = float(space.axis.breaks[[0, -1]].mean())
        self._xi = _points(space)
        self._places = solution.position(0, middle, self._xi)

    def at(self, space: Space, which: str, move: Vector = ZERO, turn: Vector = ZERO) -> Support:
        """Return the support of an end of a space that moves and turns, with this shape in the place of its own."""
        plain = Support.end(space, which)
        u = space.axis.breaks[0 if which == "start" else -1]
        rest = space.rod.grid(self._xi, [u])[0][0]
        centre = rest.mean(axis=0)
        own = self._places - self._places.mean(axis=0)
        own = Rotation.align_vectors(rest - centre, own)[0].apply(own)
        moved = np.array(move) + Rotation.from_rotvec(turn).apply(own) + centre - rest
        functions, _ = space.basis.functions(self._xi)
        coefficients = np.linalg.lstsq(functions, moved, rcond=None)[0]
        return Support(plain.nodes, "xyz", coefficients, space=space)


def _points(space: Space) -> Array:
    """Return points of a space's disk, without its hole, ``(m, 2)``."""
    hole = space.rod.rings[0]
    radius, angle = np.meshgrid(hole + (1.0 - hole) * _RADII, 2.0 * np.pi * np.arange(_AROUND) / _AROUND)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1).reshape(-1, 2)
