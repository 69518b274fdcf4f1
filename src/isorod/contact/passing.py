"""Rods that would go through each other from one state to the next, or are too deep in each other.

Contact knows one state at a time.  Of a step that takes a rod from one side of another to the other, or so deep that
points are nearer to its far side, nothing is left to be seen in forces.  So centre lines, as polygons, are followed on
the straight displacement increment of the step: where two come nearer than half of what their radii add up to, and
nearer than they were made, the step is refused, and so is a state in which a point is deeper than half of the smaller
radius, or a quarter of a wall that it is inside of.  What is in a hole may be anywhere in it: there a step is refused
in which a centre line comes out through the wall.
"""

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_matrix

from isorod.arrays import Array, Index
from isorod.contact.defaults import deepest, smallest_radius
from isorod.contact.packed import Packed
from isorod.contact.result import of_contacts
from isorod.geometry import boxes
from isorod.geometry.disk import circle
from isorod.model.contact import Cylinder, Plane, Sphere
from isorod.model.near import Stretches

if TYPE_CHECKING:
    from isorod.model.model import Model

# Depth, in smaller radii, from which a point is about to come out at the far side.
DEEPEST = 0.5

# Fraction of the sum of two radii to which centre lines may come near each other in an increment, and by how much, in
# smaller radii, that must be nearer than at rest: bodies that are made to cross may.
_NEAREST = 0.5
_APPROACH = 0.1

# Depth, in smaller radii, to which bodies may enter each other in an increment, or enter farther; its least fraction.
_ENTERS, _STILL, _LEAST = 0.2, 0.02, 1e-9

# Segments of an element's centre line, and points round a hole.
_SEGMENTS, _ROUND = 4, 16


class Passing:
    """Watches the bodies of a model's contacts.

    Parameters
    ----------
    model
        Bodies and contacts.
    """

    def __init__(self, model: "Model") -> None:
        self._model = model
        self._limits = limits(model)
        self._crossings = []
        if any(one.facets is not None for one in model.contacts):
            from isorod.contact.crossing import Crossing

            several = enumerate(model.contacts)
            self._crossings = [(k, one, Crossing(model, one)) for k, one in several if one.facets is not None]
        self._moving = any(one.motion is not None for one in model.contacts)
        self._inside = [one for one in model.contacts if one.has_inner]
        self._reference = np.concatenate([body.space.positions for body in model.bodies])
        rows: list[Index] = []
        columns: list[Index] = []
        values: list[Array] = []
        stretches, at, count = [], [], 0
        for b in sorted({body for contact in model.contacts for body, _ in contact.sides}):
            space, first = model.bodies[b].space, int(model.first_node[b])
            breaks, degree = space.axis.breaks, space.axis.degree
            # The mean round a hole, of harmonic functions that in its centre.
            hole = space.rod.rings[0] * circle(_ROUND)
            centre = space.basis.functions(hole)[0][:, space.basis.is_control_point].mean(axis=0)
            shares = np.arange(_SEGMENTS) / _SEGMENTS
            u = np.append((breaks[:-1, None] + shares * np.diff(breaks)[:, None]).ravel(), breaks[-1])
            functions, near, _ = space.axis.local(u)
            layers = (functions[:, None] + np.arange(degree + 1)) % space.layers
            nodes = first + layers[:, :, None] * space.layer_nodes + np.arange(centre.size)
            rows.append(np.repeat(count + np.arange(u.size), nodes[0].size))
            columns.append(nodes.ravel())
            values.append((near[:, :, None] * centre).ravel())
            line = np.linalg.norm(np.diff(space.rod.grid(np.zeros((1, 2)), u)[0][:, 0], axis=0), axis=1)
            along = np.append(0.0, np.cumsum(line))
            middle, number = 0.5 * (u[1:] + u[:-1]), np.arange(u.size - 1)
            period = np.full(number.size, along[-1] if space.rod.closed else np.inf)
            owner = np.full(number.size, b), number // _SEGMENTS, middle
            stretches.append((*owner, along[:-1], along[1:], period, space.rod.radii(middle, 16)[0]))
            at.append(count + number)
            count += u.size
        self._stretches = Stretches(*(np.concatenate(one) for one in zip(*stretches, strict=True)))
        self._radius, self._at = self._stretches.radius, np.concatenate(at)
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        self._lines = csr_matrix(entries, shape=(count, self._reference.shape[0]))
        self._rest = self._ends(np.zeros(self._reference.size))

    def deep(self, packed: Packed) -> str | None:
        """Return in words which point of the last forces of the contacts is too deep, if one is."""
        if not self._limits or not np.isfinite(min(self._limits)):
            return None
        gaps = np.where(packed.states["pressure"] > 0.0, packed.states["gap"], 0.0)
        if gaps.min(initial=0.0) >= -min(self._limits):
            return None
        for k, (limit, (*_, points)) in enumerate(zip(self._limits, of_contacts(self._model, packed), strict=True)):
            depth = -float(gaps[points].min(initial=0.0))
            if depth > limit:
                return f"contact {k}: penetration is {DEEPEST * depth / limit:.2g} of the smaller radius"
        return None

    def passed(self, before: Array, after: Array, when: tuple[float, float] = (0.0, 1.0)) -> str | None:
        """Return in words which bodies go through each other between two displacements, if some do.

        They are those that contact takes (`isorod.contact.operator.ContactOperator`), at load factors or times ``when``
        of obstacles that move.
        """
        start = self._ends(before)
        increment = self._ends(after) - start
        if not (increment.any() or self._moving):
            return None
        return (
            self._each_other(start, increment)
            or self._obstacle(start, start + increment, when)
            or self._wall(start, increment)
            or self._facets(start, increment, (before, after), _NEAREST)
        )

    def free(self, before: Array, after: Array, when: tuple[float, float] = (0.0, 1.0)) -> float:
        """Return the fraction of the increment between two displacements on which none enter each other.

        Load factors ``when`` are those of `passed`.
        """
        start, way = self._ends(before), when[1] - when[0]
        increment, fraction = self._ends(after) - start, 1.0
        while (
            self._each_other(start, fraction * increment, True)
            or self._obstacle(start, start + fraction * increment, (when[0], when[0] + fraction * way), True)
            or self._wall(start, fraction * increment)
            or self._facets(start, fraction * increment, (before, before + fraction * (after - before)), 1.0 - _ENTERS)
        ):
            fraction *= 0.5
            if fraction < _LEAST:
                return 0.0
        return fraction

    def _ends(self, displacement: Array) -> Array:
        """Return where the ends of the segments are, ``(m, 2, 3)``."""
        line = self._lines @ (self._reference + displacement[: self._reference.size].reshape(-1, 3))
        return np.stack([line[self._at], line[self._at + 1]], axis=1)

    def _each_other(self, start: Array, increment: Array, enters: bool = False) -> str | None:
        """Return in words which two segments go through each other, or enter each other."""
        reach = (1.0 if enters else _NEAREST) * self._radius[:, None]
        end = start + increment
        low, high = np.minimum(start, end).min(axis=1) - reach, np.maximum(start, end).max(axis=1) + reach
        first, second = boxes.pairs(low, high)
        meet = self._stretches.may_touch(first, second)
        first, second = first[meet], second[meet]
        (meet, _), (inside, _) = (
            self._stretches.declared(contacts, first, second) for contacts in (self._model.contacts, self._inside)
        )
        meet &= ~inside
        first, second = first[meet], second[meet]
        # What two segments move by relative to each other, at most.
        relative = np.linalg.norm(
            np.abs(increment[first][:, :, None] - increment[second][:, None]).max(axis=(1, 2)), axis=1
        )
        rest = _distance(self._rest[first], self._rest[second])
        sizes = self._radius[first], self._radius[second]
        k = _nearer(
            rest, (start[first], start[second]), (increment[first], increment[second]), *sizes, relative, enters
        )
        if k is None:
            return None
        one, other = sorted((int(first[k]), int(second[k])))
        return f"tunnelling of {self._said(one)} through {self._said(other)}"

    def _obstacle(self, start: Array, end: Array, when: tuple[float, float], enters: bool = False) -> str | None:
        """Return in words which segment goes through a rigid cylinder or sphere, or enters it, as seen from there."""
        for k, contact in enumerate(self._model.contacts):
            other = contact.obstacle
            if not isinstance(other, Cylinder | Sphere) or contact.has_inner:
                continue
            mine = np.flatnonzero(self._stretches.sides(contact)[1])
            middle = np.array(other.center if isinstance(other, Sphere) else other.point)
            seen = [start[mine], end[mine]]
            if contact.motion is not None:
                seen = [contact.motion.back(places, at) for places, at in zip(seen, when, strict=True)]
            rest, ends, increments = self._rest[mine] - middle, seen[0] - middle, seen[1] - seen[0]
            if isinstance(other, Cylinder):
                # What counts is the distance from the axis.
                axis = np.array(other.axis) / np.linalg.norm(other.axis)
                rest, ends, increments = (one - (one @ axis)[..., None] * axis for one in (rest, ends, increments))
            size, still = np.full(mine.size, float(other.radius)), np.zeros_like(ends)
            relative = np.linalg.norm(increments, axis=2).max(axis=1)
            apart = _distance(rest, still)
            found = _nearer(apart, (ends, still), (increments, still), self._radius[mine], size, relative, enters)
            if found is not None:
                return f"tunnelling of {self._said(int(mine[found]))} through the obstacle of contact {k}"
        return None

    def _wall(self, start: Array, increment: Array) -> str | None:
        """Return in words which segment comes out of a tube through its wall."""
        middles, end = start.mean(axis=1), start + increment
        for contact in self._inside:
            sides = self._stretches.sides(contact)[0]
            for tube in (body for body, _ in contact.sides if contact.is_inner(body)):
                own = np.flatnonzero(self._stretches.body == tube)
                others = np.flatnonzero((sides >= 0) & (sides != sides[own[0]]))
                hole = self._model.bodies[tube].space.rod.rings[0]
                before, between, segment = _beside(middles[others], start[own])
                # What was in the hole, and is beyond the outer surface.
                was_in = between & (before < hole * self._radius[own[segment]])
                after, between, segment = _beside(end.mean(axis=1)[others], end[own])
                out = np.flatnonzero(was_in & between & (after > self._radius[own[segment]]))
                if out.size:
                    return f"tunnelling of {self._said(int(others[out[0]]))} through the wall of body {tube}"
        return None

    def _facets(self, start: Array, increment: Array, states: tuple[Array, Array], ahead: float) -> str | None:
        """Return in words which segment goes through facets of a finite element body, between two displacements.

        That is, what is so many radii ``ahead`` of its centre.
        """
        for k, contact, crossing in self._crossings:
            own = np.flatnonzero(self._stretches.sides(contact)[1])
            before, way = start[own].mean(axis=1), increment[own].mean(axis=1)
            one, other = (state[self._reference.size :] for state in states)
            found = crossing.first((before, before + way), (one, other), ahead * self._radius[own])
            if found is not None:
                return f"tunnelling of {self._said(int(own[found]))} through the facets of contact {k}"
        return None

    def _said(self, segment: int) -> str:
        return f"body {self._stretches.body[segment]} at u = {self._stretches.u[segment]:.4g}"


def limits(model: "Model") -> list[float]:
    """Return how deep a point of each contact may be; infinite at a plane, which nothing comes out of."""
    found = []
    for contact in model.contacts:
        other, own = contact.obstacle, smallest_radius(model, contact)
        smaller = min(own, other.radius) if isinstance(other, Cylinder | Sphere) else own
        walls = [deepest(model.bodies[body].space, contact.is_inner(body)) for body, _ in contact.sides]
        smaller = min([smaller, *(wall for wall in walls if wall > 0.0)])
        found.append(np.inf if isinstance(other, Plane) else DEEPEST * smaller)
    return found


def _beside(points: Array, ends: Array) -> tuple[Array, Array, Index]:
    """Return how far points are from a line of segments, whether beside it, not beyond its ends, and the segments.

    Parameters
    ----------
    points, ends
        Shapes ``(m, 3)`` and ``(s, 2, 3)``.
    """
    way = ends[:, 1] - ends[:, 0]
    share = np.einsum("msa,sa->ms", points[:, None] - ends[:, 0], way) / np.einsum("sa,sa->s", way, way)
    off = points[:, None] - ends[:, 0] - np.clip(share, 0.0, 1.0)[:, :, None] * way
    distance = np.linalg.norm(off, axis=2)
    nearest, rows = distance.argmin(axis=1), np.arange(len(points))
    closed = np.allclose(ends[0, 0], ends[-1, 1])
    beyond = ((nearest == 0) & (share[rows, nearest] < 0.0)) | (
        (nearest == len(ends) - 1) & (share[rows, nearest] > 1.0)
    )
    return distance[rows, nearest], closed | ~beyond, nearest


def _nearer(
    rest: Array,
    start: tuple[Array, Array],
    increment: tuple[Array, Array],
    one: Array,
    other: Array,
    relative: Array,
    enters: bool,
) -> int | None:
    """Return which pair of segments comes too near in an increment, if one does.

    Parameters
    ----------
    rest
        Distances at rest, ``(m,)``.
    start, increment
        Ends of both segments of each pair, and their increments, ``(m, 2, 3)``.
    one, other, relative
        Radii of both, and how far they move relative to each other at most, ``(m,)``.
    enters
        Whether it is too near where one is deeper in the other than `_ENTERS`, and deeper than at the start.
    """
    limit, approach = _NEAREST * (one + other), _APPROACH * np.minimum(one, other)
    if enters:
        depth = np.minimum(one, other)
        limit = np.minimum(one + other - _ENTERS * depth, _distance(*start) - _STILL * depth)
    pair, time, shortest = np.arange(relative.size), np.zeros(relative.size), 0.5 * limit
    while pair.size:
        now = time[pair, None, None]
        there = _distance(*(at[pair] + now * along[pair] for at, along in zip(start, increment, strict=True)))
        through = (there < (limit if enters else np.minimum(limit, rest - approach))[pair]) & (time[pair] > 0.0)
        if through.any():
            return int(pair[np.argmax(through)])
        # Before they have gone so far they cannot be nearer than the limit.
        free = np.maximum(there - limit[pair], shortest[pair])
        pair, free = pair[time[pair] < 1.0], free[time[pair] < 1.0]
        with np.errstate(divide="ignore"):
            time[pair] = np.minimum(1.0, time[pair] + free / relative[pair])
    return None


def _distance(one: Array, other: Array) -> Array:
    """Return the distances of pairs of segments ``(m, 2, 3)`` (Ericson, Real-Time Collision Detection, 5.1.9)."""
    d1, d2, r = one[:, 1] - one[:, 0], other[:, 1] - other[:, 0], one[:, 0] - other[:, 0]

    def dot(a: Array, b: Array) -> Array:
        return np.asarray(np.einsum("ma,ma->m", a, b))

    a, e, f, b, c = dot(d1, d1), dot(d2, d2), dot(d2, r), dot(d1, d2), dot(d1, r)
    tiny = np.finfo(float).tiny
    det = a * e - b * b
    s = np.where(det > 1e-12 * a * e, np.clip((b * f - c * e) / np.maximum(det, tiny), 0.0, 1.0), 0.0)
    t = np.clip((b * s + f) / np.maximum(e, tiny), 0.0, 1.0)
    s = np.clip((b * t - c) / np.maximum(a, tiny), 0.0, 1.0)
    return np.linalg.norm(r + s[:, None] * d1 - t[:, None] * d2, axis=1)
