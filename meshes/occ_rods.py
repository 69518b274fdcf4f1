"""Rods as volumes of gmsh's OpenCASCADE kernel: lateral surfaces are the rods' own NURBS, ends are plane.

An arc of a section between two joints is a conic, so that the surface of a rod is a tensor product of rational
splines of degree 2 with the axis: nothing is approximated.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from isorod.errors import InputError
from isorod.geometry.disk import circle
from isorod.geometry.rod import Rod
from meshes.mesh import Array

# How far a section may be from a plane, and rings from those of an ellipse, in radii.
_PLANE = 1e-5

# Knots so near, as a fraction of the axis, are the same.
_ROUNDING = 1e-9

# Places in each element of a rod, and points round it, where that is looked at.
_PLACES, _AROUND = 4, 24


@dataclass(frozen=True, eq=False)
class Volume:
    """One of the nested volumes of a rod: all of it within a radius, between two sections.

    Attributes
    ----------
    tag
        Of gmsh's kernel.
    ring
        0 for a hole, 1 for what is within the first radius that ends a part, and so on.
    """

    tag: int
    ring: int


def volumes(gmsh: Any, rod: Rod, radii: Sequence[float], cuts: Sequence[float]) -> list[Volume]:
    """Return the volumes of a rod, of each stretch between two cuts one within the other.

    Parameters
    ----------
    gmsh
        With a model that is open.
    radii
        Of the disk, from that of the hole, or 0, to 1: where rings meet that are parts of their own.
    cuts
        Axis parameters at which it is cut.

    Raises
    ------
    InputError
        If a section where it is cut is not plane, or rings are those of a section that is no ellipse.
    """
    low, high = rod.axis.breaks[[0, -1]]
    kinks = rod.axis.breaks[1:-1][rod.axis.multiplicities[1:-1] >= rod.axis.degree]
    knots = {_knot(rod, u) for u in cuts} | {float(u) for u in kinks if _is_plane(rod, float(u))}
    if rod.closed:
        knots.add(_knot(rod, 0.5 * (low + high)))
    if len(radii) > 2 or radii[0] > 0.0:
        _check_rings(rod, radii)
    solids = []
    for part in _cut(rod, sorted(u for u in knots if low < u < high)):
        solids += [Volume(_volume(gmsh, part, radius), k) for k, radius in enumerate(radii) if radius > 0.0]
    return solids


def _knot(rod: Rod, u: float) -> float:
    """Return a place on the axis, where it is a knot but for rounding that knot."""
    breaks = rod.axis.breaks
    nearest = breaks[np.abs(breaks - u).argmin()]
    return float(nearest if abs(nearest - u) < _ROUNDING * (breaks[-1] - breaks[0]) else u)


def _is_plane(rod: Rod, u: float) -> bool:
    outline = rod.grid(circle(4 * _AROUND), [u])[0][0]
    return float(np.linalg.svd(outline - outline.mean(axis=0))[1][2]) <= _PLANE * rod.radius * len(outline) ** 0.5


def _check_rings(rod: Rod, radii: Sequence[float]) -> None:
    """Raise `InputError` if circles of the disk are not made smaller outlines by the rod's map."""
    u = rod.axis.evenly(_PLACES)
    around = circle(_AROUND)
    middle, outline = rod.grid([[0.0, 0.0]], u)[0], rod.grid(around, u)[0]
    for radius in radii:
        away = rod.grid(radius * around, u)[0] - middle - radius * (outline - middle)
        if np.abs(away).max() > _PLANE * rod.radius:
            raise InputError("rings of a section that is neither a circle nor an ellipse are not made as one solid")


def _cut(rod: Rod, places: Sequence[float]) -> list[Rod]:
    """Return the segments of the rod, each open."""
    for u in places:
        if not _is_plane(rod, u):
            raise InputError(f"its section at u = {u:g} is not plane, where laws change or it is kinked")
        missing = rod.axis.degree - int(np.count_nonzero(rod.axis.knots == u))
        if missing > 0:
            rod = rod.insert(u, missing)
    axis, p, rods = rod.axis, rod.axis.degree, []
    ends = [axis.breaks[0], *places, axis.breaks[-1]]
    for low, high in pairwise(ends):
        # The layer that is the section at a knot stands before the first of its repetitions.
        first = 0 if low == axis.breaks[0] else int(np.searchsorted(axis.knots, low)) - 1
        last = axis.count - 1 if high == axis.breaks[-1] else int(np.searchsorted(axis.knots, high)) - 1
        inner = axis.knots[(axis.knots > low) & (axis.knots < high)]
        knots = np.concatenate([np.full(p + 1, low), inner, np.full(p + 1, high)])
        own = type(axis)(p, knots, axis.weights[first : last + 1])
        rods.append(Rod(own, rod.control_points[first : last + 1], fitted=rod.fitted))
    return rods


def _volume(gmsh: Any, rod: Rod, radius: float) -> int:
    """Return the volume within a radius of the disk."""
    occ = gmsh.model.occ
    points, weights = _poles(rod, radius)
    tags = [occ.addPoint(*point) for point in points.reshape(-1, 3)]
    knots, times = np.unique(rod.axis.knots, return_counts=True)
    n = rod.section_points
    side = occ.addBSplineSurface(
        tags,
        2 * n + 1,
        degreeU=2,
        degreeV=rod.axis.degree,
        weights=weights.ravel(),
        knotsU=np.arange(n + 1.0),
        knotsV=knots,
        multiplicitiesU=[3, *[2] * (n - 1), 3],
        multiplicitiesV=times,
    )
    occ.synchronize()
    edges = [edge for _, edge in gmsh.model.getBoundary([(2, side)], oriented=False)]
    # All edges but the seam are closed.
    rims = [edge for edge in edges if len(gmsh.model.getBoundary([(1, edge)], combined=True)) == 0]
    ends = [occ.addPlaneSurface([occ.addCurveLoop([rim])]) for rim in rims]
    volume = occ.addVolume([occ.addSurfaceLoop([side, *ends], sewing=True)])
    occ.remove([(0, tag) for tag in tags])
    return int(volume)


def _poles(rod: Rod, radius: float) -> tuple[Array, Array]:
    """Return poles ``(layers, 2 n + 1, 3)`` of the surface at a radius, and their weights: round the section first."""
    points = rod.control_points
    points = points.mean(axis=1, keepdims=True) * (1.0 - radius) + radius * points
    joints = 0.5 * (points + np.roll(points, -1, axis=1))
    both = np.stack([np.roll(joints, 1, axis=1), points], axis=2).reshape(len(points), -1, 3)
    # Of each arc the ends weigh 1, the control point between them the cosine of half its angle.
    around = np.append(np.tile([1.0, np.cos(np.pi / rod.section_points)], rod.section_points), 1.0)
    return np.concatenate([both, both[:, :1]], axis=1), np.outer(rod.axis.weights, around)
