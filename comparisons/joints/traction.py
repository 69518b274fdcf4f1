"""Tractions that vary over a rod's surface, as exact solutions have them."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from isorod.model.history import InTime
from isorod.model.tie import EndFace, LateralSurface
from isorod.space.space import Space
from isorod.space.trace import end_trace, lateral_trace

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Traction(InTime):
    """Dead tractions on an end face or the lateral surface of a rod.

    Parameters
    ----------
    surface
        Where they act.
    at
        Tractions ``(q, 3)`` at positions ``(q, 3)``, force per area at load factor 1.
    """

    surface: EndFace | LateralSurface
    at: Callable[[Array], Array] = field(repr=False)

    @property
    def body(self) -> int:
        """Index of the body in the model."""
        return self.surface.body

    def nodal(self, space: Space) -> Array:
        """Return the consistent nodal forces, shape ``(nodes, 3)``."""
        if isinstance(self.surface, EndFace):
            trace = end_trace(space, self.surface.which)
        else:
            trace = lateral_trace(space, self.surface.along, self.surface.surface)
        force = trace.weights[:, None] * self.at(trace.points)
        result = np.zeros((space.nodes, 3))
        for a in range(3):
            result[:, a] = np.bincount(trace.nodes.ravel(), (trace.values * force[:, a, None]).ravel(), space.nodes)
        return result
