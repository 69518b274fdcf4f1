"""Places of rods by parameters of the nodes of their mesh."""

import numpy as np

from isorod.geometry.rod import Rod
from isorod.material import places
from meshes.mesh import Array


def on_rod(rod: Rod, parameters: Array) -> places.Places:
    """Return the places of a rod at parameters ``xi_1, xi_2, u``, shape ``(..., 3)``, ``u`` perhaps beyond its end.

    What interpolation between nodes takes out of the disk is taken back to its edge.
    """
    low, high = rod.axis.breaks[[0, -1]]
    xi, u = parameters[..., :2], parameters[..., 2]
    radius = np.linalg.norm(xi, axis=-1, keepdims=True)
    return places.Places(rod, np.where(u > high, u - (high - low), u).clip(low, high), xi / np.maximum(radius, 1.0))
