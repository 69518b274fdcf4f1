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
from functools import cached_property, lru_cache
from heapq import heappop, heappush
from itertools import pairwise
from math import comb, factorial
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array, Index
from isorod.geometry.disk import control_points, harmonic_functions
from isorod.space.graded import Graded
from isorod.space.polynomial import Polynomials
from isorod.space.space import Space

# Error of a function on a patch, relative to the largest of its coefficients.
TOLERANCE = 1e-8

# Patches of a section, at most.
MOST = 500

# The highest degree of patches: a cell has 512 points at most in VTK's fixed arrays, of degree 6 along the axis too.
HIGHEST = 10
_ROOM = 512 // 7

# Degree of patches where functions are no polynomials.
_USUAL = 8

# Control points that patches share agree to this share of the section's size.
_SAME = 1e-7

_NEWTON = 30


class Patch(NamedTuple):
    """A piece of the disk: its angles, radians, and radii; a triangle where the inner one is zero."""

    begin: float
    end: float
    inner: float
    outer: float


class Shape(NamedTuple):
    """Bernstein polynomials of patches of one shape.

    Attributes
    ----------
    degrees
        ``(q,)`` of a triangle, along the radius and round the section of a quadrilateral.
    powers
        Index of each polynomial by the corners of a triangle, or the directions of a quadrilateral, ``(m, 2)``.
    samples, checks
        Reference points ``(s, 2)`` from which polynomials are found, and others up to the edges.
    fit
        Coefficients by values at the samples, ``(m, s)``.
    check
        Polynomials at the other points, ``(c, m)``.
    """

    degrees: tuple[int, ...]
    powers: Index
    samples: Array
    checks: Array
    fit: Array
    check: Array


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
    samples
        Disk points ``(s, 2)`` of all patches in turn, at which other fields are evaluated for `fit`.
    """

    patches: list[Patch]
    shapes: list[Shape]
    nodes: list[Index]
    weights: Array
    coefficients: Array
    error: float
    samples: Array
    _sample_weights: Array

    def fit(self, values: Array) -> Array:
        """Return coefficients ``(..., m)``, times the weights, of a field of values ``(..., s)`` at the samples."""
        found = np.zeros((*values.shape[:-1], self.weights.size))
        weighted, start = values * self._sample_weights, 0
        for shape, nodes in zip(self.shapes, self.nodes, strict=True):
            own = weighted[..., start : start + len(shape.samples)] @ shape.fit.T
            start += len(shape.samples)
            found[..., nodes] += own
        return found / self._shared

    @cached_property
    def _shared(self) -> Array:
        """How many patches have a control point, shape ``(m,)``."""
        return np.bincount(np.concatenate(self.nodes), minlength=self.weights.size).astype(float)


def cover(space: Space, columns: Array) -> Patches:
    """Return patches on which all columns of coefficients of the section's functions are met.

    Warns where they are not, to `TOLERANCE`, with `MOST` patches.

    Parameters
    ----------
    columns
        Shape ``(count, columns)``, each of a size for which an error of `TOLERANCE` is small.
    """
    # As many as there are functions say all; an error is no larger than what they say.
    directions, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    columns = directions * sizes
    plane = _plane(space)
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

    for patch in _begin(space, plane):
        add(patch)
    while -heap[0][0] > TOLERANCE and len(heap) < MOST:
        for patch in _cut(heappop(heap)[2], whole):
            add(patch)
    worst = -heap[0][0]
    found = [one[2:] for one in sorted(heap, key=lambda one: one[2])]
    if worst > TOLERANCE:
        warnings.warn(
            f"Bezier cells: {len(found)} patches of the section meet its functions to {worst:.1g} of the largest",
            stacklevel=2,
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
    try:
        for patch in _begin(space, plane):
            (first, middle, last), _ = plane.arc(patch)
            if min(_cross(first, middle), _cross(middle, last)) <= 0.0:
                return _Plane(space, None, None)
            plane.disk(patch, shape_of(_USUAL, True).samples)
    except ArithmeticError:
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


def _begin(space: Space, plane: _Plane) -> list[Patch]:
    """Return the patches to begin with: one an arc, and each ring apart."""
    basis, n = space.basis, space.points_around
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
        samples.append(plane.disk(patch, shape.samples))
        sample_weights.append(weight**half)
    # Where rings meet, fields may jump.
    ring = np.concatenate(
        [
            np.full(len(key), np.searchsorted(plane.space.rod.rings, 0.5 * (patch.inner + patch.outer)))
            for key, (patch, _, _) in zip(keys, found, strict=True)
        ]
    )
    _, first, which = np.unique(
        np.column_stack([np.concatenate(keys), ring]), axis=0, return_index=True, return_inverse=True
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
        _sample_weights=np.concatenate(sample_weights),
    )


def bernstein(degree: int, t: Array) -> Array:
    """Return the Bernstein polynomials ``(s, degree + 1)`` at parameters ``t`` ``(s,)`` from 0 to 1."""
    k = np.arange(degree + 1)
    return np.array([comb(degree, i) for i in k]) * t[:, None] ** k * (1.0 - t[:, None]) ** (degree - k)


def _triangular(q: int, powers: Index, reference: Array) -> Array:
    """Return the Bernstein polynomials of a triangle at reference points, shape ``(s, m)``."""
    i, j = powers.T
    k = q - i - j
    a, b = reference[:, :1], reference[:, 1:]
    share = np.array(
        [factorial(q) // (factorial(x) * factorial(y) * factorial(z)) for x, y, z in zip(i, j, k, strict=True)]
    )
    return share * a**i * b**j * (1.0 - a - b) ** k


@lru_cache(maxsize=16)
def shape_of(q: int, triangle: bool) -> Shape:
    """Return the polynomials of a triangle of degree ``q``, or of a quadrilateral of that degree round the section."""
    if triangle:
        powers = np.array([(i, j) for j in range(q + 1) for i in range(q + 1 - j)])
        inner, edge = (
            np.array([(i + shift, j + shift) for j in range(m + 1) for i in range(m + 1 - j)]) / (m + 3.0 * shift)
            for m, shift in ((2 * q, 1.0 / 3.0), (2 * q + 1, 0.0))
        )
        values, check = (_triangular(q, powers, points) for points in (inner, edge))
        return Shape((q,), powers, inner, edge, np.linalg.pinv(values), check)
    across = min(q, _ROOM // (q + 1) - 1)
    powers = np.array([(i, j) for j in range(q + 1) for i in range(across + 1)])

    def tensor(points: tuple[Array, Array]) -> tuple[Array, Array]:
        first, second = np.meshgrid(*points, indexing="ij")
        values = (bernstein(across, first.ravel()), bernstein(q, second.ravel()))
        return np.column_stack([first.ravel(), second.ravel()]), values[0][:, powers[:, 0]] * values[1][:, powers[:, 1]]

    inner, values = tensor((_chebyshev(across + 4), _chebyshev(q + 4)))
    edge, check = tensor((np.linspace(0.0, 1.0, 2 * across + 2), np.linspace(0.0, 1.0, 2 * q + 2)))
    return Shape((across, q), powers, inner, edge, np.linalg.pinv(values), check)


def _chebyshev(count: int) -> Array:
    """Return as many zeros of Chebyshev's polynomial, from 0 to 1."""
    return 0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 0.5) / count)
