"""The surface of a section for contact: control points round a circle, and their dependence on the space's own.

Functions of control points are used directly on the outer surface.  All other functions, and all on an inner surface,
are projected on functions of enough control points to represent their traces up to `_MISSED`.  ``P``, shape ``(n,
count)``, gives these control points from a layer's coefficients, forces are mapped back by ``P^T``, and tangents are
``P^T K P``.  Constants and rotations are reproduced exactly, so that forces and moments are in balance.

Round an inner surface angles are counted backwards, so that its normal ``y_theta x y_s`` points to the axis.
"""

from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np

from isorod.arrays import Array, Index
from isorod.geometry.disk import MAX_COUNT
from isorod.geometry.section import refinement_turn
from isorod.space.basis import SectionBasis
from isorod.space.graded import Graded
from isorod.space.space import Space

# Relative error of the projection of a trace, and of those of the first three functions, the coordinates of the rod's
# own map; the fewest points.  A ring between planes, section degrees 4 and 8, changes by 1e-4 with a fiftieth.
_MISSED, _MAP, _FEWEST = 5e-3, 1e-5, 16
_PLANE = 3

# Norm of a function, or singular value, relative to the largest, that is taken as zero; Gauss points of an arc.
_LITTLE, _POINTS = 1e-2, 6


class Trace(NamedTuple):
    """The surface of a section, the same for each layer.

    Attributes
    ----------
    arc_of, arcs
        The arc of each fine arc, and ``arcs`` of `isorod.contact.packed.SURFACE`, ``(n, 7)``.
    turn
        Angle of the first control point.
    radius, sense
        Radius of the circle on the disk, and -1 where angles are counted backwards, else 1.
    dimension
        Dimension of the space of traces, the equivalent number of control points.
    lift
        ``P``, or None where control points are the first functions of a layer.
    """

    arc_of: Index
    arcs: Array
    turn: float
    radius: float
    sense: float
    dimension: int
    lift: Array | None

    def circle(self, angle: Array) -> Array:
        """Return the points of the disk at angles of the surface ``(q,)``, shape ``(q, 2)``."""
        return self.radius * np.stack([np.cos(angle), self.sense * np.sin(angle)], axis=1)


def trace(space: Space, inner: bool) -> Trace:
    """Return the outer or the inner surface of a space's sections."""
    basis = space.basis
    if basis.on_surface:
        parts = np.array(basis.arcs) if isinstance(basis, Graded) else np.ones(space.points_around, dtype=np.int64)
        return Trace(*_arcs(parts, space.turn), space.turn, 1.0, 1.0, parts.size, None)
    return _projected(cast(Any, basis), space.rod.section_points, space.rod.rings[0] if inner else 1.0, inner)


@lru_cache(maxsize=16)
def _projected(basis: SectionBasis, own: int, radius: float, inner: bool) -> Trace:
    """Return the surface at a radius of the disk; ``own`` are the control points of the rod's own sections."""
    multiple, sense = -(-_FEWEST // own), -1.0 if inner else 1.0
    while True:
        n, turn = own * multiple, refinement_turn(own, multiple)
        arc_of, arcs = _arcs(np.ones(n, dtype=np.int64), turn)
        surface = Trace(arc_of, arcs, turn, radius, sense, 0, None)
        functions, angle, weight = section_functions(surface, _POINTS)
        root = np.sqrt(weight)[:, None]
        mine = root * basis.functions(surface.circle(angle))[0]
        across = np.zeros((angle.size, n))
        for c in range(3):
            across[np.arange(angle.size), (np.repeat(np.arange(n), _POINTS) + c - 1) % n] += functions[:, c]
        lift = np.linalg.lstsq(root * across, mine, rcond=None)[0]
        norms = np.linalg.norm(mine, axis=0)
        # Functions that vanish there do not count.
        norms = np.maximum(norms, _LITTLE * norms.max())
        missed = np.linalg.norm(mine - root * across @ lift, axis=0) / norms
        sizes = np.linalg.svd(mine / norms, compute_uv=False)
        dimension = int((sizes > _LITTLE * sizes[0]).sum())
        exact = missed.max() <= _MISSED and missed[:_PLANE].max() <= _MAP
        if n >= dimension and (exact or 2 * n > MAX_COUNT):
            return surface._replace(dimension=dimension, lift=lift)
        multiple += -(-multiple // 4)


def _arcs(parts: Index, turn: float) -> tuple[Index, Array]:
    """Return the arc of each fine arc, and the rows of arcs that have so many of them, from an angle on."""
    ends = np.cumsum(parts)
    part = parts / ends[-1]
    half = np.pi * part
    middle = turn + np.pi / ends[-1] * (2.0 * ends - parts - 1.0)
    lengths = np.tan(half)
    before, after = (lengths / (lengths + np.roll(lengths, step)) for step in (1, -1))
    cos, sin = np.cos(half), np.sin(half)
    arcs = np.stack([middle, cos, cos / sin**2, 1.0 / sin, before, after, part], axis=1)
    return np.repeat(np.arange(parts.size), parts), arcs


def section_functions(surface: Trace, points: int) -> tuple[Array, Array, Array]:
    """Return the three functions of each arc at Gauss points ``(n points, 3)``, their angles and weights (radians)."""
    x, w = np.polynomial.legendre.leggauss(points)
    angle, cos, flat, steep, before, after, part = surface.arcs.T[:, :, None]
    local = np.pi * part * x
    middle, slope = (np.cos(local) - cos) * flat, np.sin(local) * steep
    left, right = 0.5 * before * (1.0 - middle - slope), 0.5 * after * (1.0 - middle + slope)
    functions = np.stack([left, 1.0 - left - right, right], axis=-1).reshape(-1, 3)
    return functions, (angle + local).ravel(), (np.pi * part * w).ravel()
