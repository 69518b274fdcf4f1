"""The section of a rod as rational Bezier patches: triangles about its centre, quadrilaterals in rings round it.

Each arc of the circle is a rational quadratic with the weight ``W``, and so is the triangle or the ring's piece that it
bounds.  There section functions are Bernstein polynomials of degree ``q`` over ``W^(q / 2)``: exactly on the surface,
and everywhere if they are polynomials of degree ``q / 2`` in the coordinates that the patches are laid in.  These are
those of the disk; or, where functions are polynomials of the section's own coordinates and it is seen whole from its
centroid, these.  Harmonic functions have a logarithm where arcs meet (`isorod.geometry.disk`): patches are cut until
all columns of coefficients given are met to within `TOLERANCE`.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from heapq import heappop, heappush
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array, Index
from isorod.geometry.disk import control_points, harmonic_functions
from isorod.output.bernstein import HIGHEST, Shape, shape_of
from isorod.space.graded import Graded
from isorod.space.polynomial import Polynomials
from isorod.space.space import Space

# Error of a function on a patch, relative to the largest of its coefficients.
TOLERANCE = 1e-8

# Patches of a section, at most.
MOST = 500

# Degree of patches where functions are no polynomials.
_USUAL = 8

# Control points that patches share agree to this share of the section's size.
_SAME = 1e-7

# Errors no larger are rounding.
_EXACT = 1e-11

# Fields are looked at so far inside of patches.
_SIDE = 1e-9

_NEWTON = 30


class Patch(NamedTuple):
    """A piece of the disk: its angles, radians, and radii; a triangle where the inner one is zero."""

    begin: float
    end: float
    inner: float
    outer: float


@dataclass(frozen=True, eq=False)
class Patches:
    """Patches that meet columns of coefficients.

    Attributes
    ----------
    patches
        What they are.
    shapes
        The polynomials of each.
    nodes
        Which control point belongs to each polynomial of each patch.
    weights
        Of the control points, shape ``(m,)``.
    coefficients
        Each section function's coefficient at the control points, times its weight, ``(m, count)``.
    error
        The largest error of a column, relative to what `cover` was given.
    samples, sample_weights
        Disk points ``(s, 2)`` of all patches in turn, those of `Shape.checks`, at which other fields are evaluated, and
        weights of functions there.
    """

    patches: list[Patch]
    shapes: list[Shape]
    nodes: list[Index]
    weights: Array
    coefficients: Array
    error: float
    samples: Array
    sample_weights: Array
    _plane: "_Plane"

    def disk(self, number: int, reference: Array) -> Array:
        """Return the disk points ``(s, 2)`` of a patch's reference points, as of `Shape.samples`."""
        return self._plane.disk(self.patches[number], reference)

    @cached_property
    def shared(self) -> Array:
        """How many patches have a control point, shape ``(m,)``."""
        return np.bincount(np.concatenate(self.nodes), minlength=self.weights.size).astype(float)


def within(reference: Array) -> Array:
    """Return parameters a little inside of a patch or a piece: at its borders others may be meant."""
    return np.clip(reference, _SIDE, 1.0 - _SIDE)


def cover(space: Space, columns: Array, most: int | None = None) -> Patches:
    """Return patches on which all columns of coefficients of the section's functions are met.

    Warns where they are not, to `TOLERANCE`, with as many patches as there may be.

    Parameters
    ----------
    columns
        Shape ``(count, columns)``, each of a size for which an error of `TOLERANCE` is small.
    most
        So many patches at the most, but for the last cut; `MOST` where not given.
    """
    # As many as there are functions say all; an error is no larger than what they say.
    directions, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    plane = _plane(space)
    most = MOST if most is None else most
    try:
        return _cover(plane, directions * sizes, most)
    except (ArithmeticError, np.linalg.LinAlgError):
        return _cover(_Plane(space, None, None), directions * sizes, most)


def _cover(plane: "_Plane", columns: Array, most: int) -> Patches:
    """Return what `cover` does, on a plane; raises `ArithmeticError` where that is not good enough."""
    whole = plane.degree is not None
    q = _USUAL if plane.degree is None else min(2 * plane.degree, HIGHEST)
    # Of patches that are not good enough the worst is cut first.
    heap: list[tuple[float, int, Patch, Shape, Array]] = []
    count = 0

    def add(patch: Patch) -> None:
        nonlocal count
        shape = shape_of(q, patch.inner == 0.0)
        numerators, error = _functions(plane, patch, shape, columns)
        heappush(heap, (-error, count, patch, shape, numerators))
        count += 1

    for patch in _begin(plane):
        add(patch)
    while -heap[0][0] > TOLERANCE and len(heap) < most:
        for patch in _cut(heappop(heap)[2], whole):
            add(patch)
    worst = -heap[0][0]
    found = [one[2:] for one in sorted(heap, key=lambda one: one[2])]
    if worst > TOLERANCE:
        warnings.warn(
            f"Bezier cells: {len(found)} patches of the section meet its functions to {worst:.1g} of the largest",
            stacklevel=3,
        )
    return _joined(plane, found, worst)


class _Plane(NamedTuple):
    """What patches are laid in: the disk, or the coordinates of a section seen whole from its centroid.

    ``polygon`` is that section's, or None; ``degree`` that of the functions where they are polynomials in it.
    """

    space: Space
    degree: int | None
    polygon: Array | None

    def arc(self, patch: Patch) -> tuple[Array, float]:
        """Return the control points ``(3, 2)`` of a patch's arc of the circle, or of the outline; its middle weight."""
        half = 0.5 * (patch.end - patch.begin)
        angle = np.array([patch.begin, patch.begin + half, patch.end])
        points = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points[1] /= np.cos(half)
        if self.polygon is not None:
            n = len(self.polygon)
            i = round((patch.begin + half) * n / (2.0 * np.pi))
            ends = (np.array([i - 0.5, i + 0.5])) * 2.0 * np.pi / n
            own = np.stack(
                [
                    [*np.cos(ends), np.cos(2.0 * np.pi * i / n) / np.cos(np.pi / n)],
                    [*np.sin(ends), np.sin(2.0 * np.pi * i / n) / np.cos(np.pi / n)],
                    np.ones(3),
                ],
                axis=1,
            )
            before, middle, after = (self.polygon[(i + k) % n] for k in (-1, 0, 1))
            image = np.stack([0.5 * (before + middle), 0.5 * (middle + after), middle])
            points = np.column_stack([points, np.ones(3)]) @ np.linalg.solve(own, image)
        return points, float(np.cos(half))

    def places(self, patch: Patch, reference: Array) -> tuple[Array, Array]:
        """Return points ``(s, 2)`` of a patch by their reference points, and the weight ``W`` there, ``(s,)``."""
        (first, middle, last), weight = self.arc(patch)
        a, b = reference.T
        if patch.inner == 0.0:
            c = 1.0 - a - b
            total = a * a + b * b + 2.0 * weight * a * b + c * (c + 2.0 * (a + b))
            one = np.outer(a * (a + c), first) + np.outer(b * (b + c), last) + np.outer(2.0 * weight * a * b, middle)
            return patch.outer * one / total[:, None], total
        c = 1.0 - b
        total = c * c + b * b + 2.0 * weight * b * c
        one = np.outer(c * c, first) + np.outer(b * b, last) + np.outer(2.0 * weight * b * c, middle)
        radius = patch.inner + (patch.outer - patch.inner) * a
        return (radius / total)[:, None] * one, total

    def functions(self, places: Array) -> Array:
        """Return the section functions ``(s, count)`` at points of the plane."""
        if self.polygon is not None:
            assert isinstance(self.space.basis, Polynomials)
            return self.space.basis.at(places)
        return self.space.basis.functions(_inside(places))[0]

    def disk(self, patch: Patch, reference: Array) -> Array:
        """Return the disk points of a patch's reference points, shape ``(s, 2)``."""
        if self.polygon is None:
            return _inside(self.places(patch, reference)[0])
        guess = _Plane(self.space, None, None).places(patch, reference)[0]
        return _inverse(self.polygon, self.places(patch, reference)[0], guess)


def _inside(points: Array) -> Array:
    """Return points of the disk without what rounding adds to it."""
    return points / np.maximum(np.hypot(*points.T), 1.0)[:, None]


def _plane(space: Space) -> _Plane:
    """Return what to lay the patches in."""
    basis = space.basis
    if type(basis) is not Polynomials:
        return _Plane(space, None, None)
    n = len(basis.polygon)
    circle = np.column_stack([control_points(n), np.ones(n)])
    straight = circle @ np.linalg.lstsq(circle, basis.polygon, rcond=None)[0]
    if np.abs(straight - basis.polygon).max() < 1e-12:
        return _Plane(space, basis.degree, None)
    plane = _Plane(space, basis.degree, basis.polygon)
    for patch in _begin(plane):
        (first, middle, last), _ = plane.arc(patch)
        if min(_cross(first, middle), _cross(middle, last)) <= 0.0:
            return _Plane(space, None, None)
    return plane


def _cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _inverse(polygon: Array, places: Array, xi: Array) -> Array:
    """Return the disk points whose harmonic map of a polygon are given places, near ``xi``, by Newton's method."""
    n = len(polygon)
    for _ in range(_NEWTON):
        values, gradients = harmonic_functions(n, xi)
        gap = values @ polygon - places
        if np.abs(gap).max() < 1e-13:
            return xi
        slopes = np.einsum("qib,ia->qab", gradients, polygon)
        xi = _inside(xi - np.linalg.solve(slopes, gap[:, :, None])[:, :, 0])
    raise ArithmeticError("no disk point found")


def _begin(plane: _Plane) -> list[Patch]:
    """Return the patches to begin with: one an arc, and each ring apart."""
    space, basis = plane.space, plane.space.basis
    n = space.points_around
    if isinstance(basis, Graded):
        joints = basis.joints
    elif plane.degree is not None and plane.polygon is None:
        joints = np.linspace(0.0, 2.0 * np.pi, 5)
    else:
        n = space.rod.section_points if plane.polygon is not None else n
        turn = 0.0 if plane.polygon is not None else space.turn
        joints = turn + 2.0 * np.pi / n * (np.arange(n + 1) - 0.5)
    rings = list(pairwise(space.rod.rings))
    return [Patch(*arc, *ring) for arc in pairwise(joints.tolist()) for ring in rings]


def _cut(patch: Patch, polynomial: bool) -> list[Patch]:
    """Return the pieces of a patch.

    Polynomials need narrower triangles alone; of others it is the outer edge that wants finer ones.
    """
    middle, half = 0.5 * (patch.begin + patch.end), 0.5 * (patch.inner + patch.outer)
    if patch.inner == 0.0 and not polynomial:
        return [patch._replace(outer=half), patch._replace(inner=half)]
    sides = [patch._replace(end=middle), patch._replace(begin=middle)]
    if patch.inner == 0.0:
        return sides
    return [piece for side in sides for piece in (side._replace(outer=half), side._replace(inner=half))]


def _functions(plane: _Plane, patch: Patch, shape: Shape, columns: Array) -> tuple[Array, float]:
    """Return the section functions' coefficients ``(m, count)``, times weights, and the largest error of a column."""
    half = 0.5 * shape.degrees[-1]
    places, weight = plane.places(patch, shape.samples)
    numerators = shape.fit @ (plane.functions(places) * weight[:, None] ** half)
    there, weight = plane.places(patch, shape.checks)
    gap = shape.check @ numerators / weight[:, None] ** half - plane.functions(there)
    return numerators, float(np.linalg.norm(gap @ columns, axis=1).max())


def _joined(plane: _Plane, found: Sequence[tuple[Patch, Shape, Array]], error: float) -> Patches:
    """Return patches with one control point where several have the same."""
    keys, weights, samples, sample_weights = [], [], [], []
    for patch, shape, _ in found:
        half = 0.5 * shape.degrees[-1]
        places, weight = plane.places(patch, shape.samples)
        own = shape.fit @ weight**half
        points = shape.fit @ (places * weight[:, None] ** half) / own[:, None]
        # Half a step aside: round numbers are what most points have.
        keys.append(np.round(np.column_stack([points, own]) / _SAME + 0.25))
        weights.append(own)
        # Of triangles both parameters are less than what is left.
        inside = within((1.0 - 3.0 * _SIDE) * shape.checks + (_SIDE if patch.inner == 0.0 else 0.0))
        samples.append(plane.disk(patch, inside))
        sample_weights.append(plane.places(patch, inside)[1] ** half)
    # Coefficients of what is met but nearly differ by more than the functions do.
    own = np.arange(len(found)) if error > _EXACT else np.zeros(len(found))
    # Where rings meet, fields may jump.
    ring = np.concatenate(
        [
            np.full(len(key), np.searchsorted(plane.space.rod.rings, 0.5 * (patch.inner + patch.outer)))
            for key, (patch, _, _) in zip(keys, found, strict=True)
        ]
    )
    each = np.repeat(own, [len(key) for key in keys])
    _, first, which = np.unique(
        np.column_stack([np.concatenate(keys), ring, each]), axis=0, return_index=True, return_inverse=True
    )
    sizes = [len(key) for key in keys]
    nodes = np.split(which.ravel(), np.cumsum(sizes)[:-1])
    numerators = np.concatenate([one for _, _, one in found])
    return Patches(
        patches=[patch for patch, _, _ in found],
        shapes=[shape for _, shape, _ in found],
        nodes=nodes,
        weights=np.concatenate(weights)[first],
        coefficients=numerators[first],
        error=error,
        samples=np.concatenate(samples),
        sample_weights=np.concatenate(sample_weights),
        _plane=plane,
    )
