"""Tunnelling: rods that go through each other from one state to the next, or penetrate too deep.

Contact is computed from one state at a time: forces do not show that a step has taken a rod to the other side of
another, or so deep that points are nearer to its far side.  So centre lines, as polygons, are followed along the
straight displacement increment of the step.  A step is refused where two come nearer than half the sum of their radii,
and nearer than at rest; so is a state in which a point is deeper than half of the smaller radius, or than a quarter of
the wall of a tube around it.  A rod in a hole may be anywhere in it: a step is refused where a centre line comes out
through the wall.
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

# Largest penetration, in smaller radii: beyond it a point may come out at the far side.
DEEPEST = 0.5

# Smallest distance of centre lines in an increment, as a fraction of the sum of two radii; and by how much, in smaller
# radii, the distance must be below that at rest, since bodies may be built to cross.
_NEAREST = 0.5
_APPROACH = 0.1

# Penetration, in smaller radii, allowed in an increment, and its increase; the least fraction of an increment.
_ENTERS, _STILL, _LEAST = 0.2, 0.02, 1e-9

# Segments of an element's centre line, and points round a hole.
_SEGMENTS, _ROUND = 4, 16


class Tunnelling:
    """Checks the bodies of a model's contacts for tunnelling.

    Parameters
    ----------
    model
        Bodies and contacts.
    """

    def __init__(self, model: "Model") -> None:
        self._model = model
        self._limits = limits(model)
        self._crossings = []
        on_facets = [(k, contact) for k, contact in enumerate(model.contacts) if contact.facets is not None]
        if on_facets:
            from isorod.contact.crossing import Crossing

            self._crossings = [(k, contact, Crossing(model, contact)) for k, contact in on_facets]
        self._moving = any(contact.motion is not None for contact in model.contacts)
        self._inside = [contact for contact in model.contacts if contact.has_inner]
        self._reference = np.concatenate([body.space.positions for body in model.bodies])
        rows: list[Index] = []
        columns: list[Index] = []
        values: list[Array] = []
        stretches, at, count = [], [], 0
        for b in sorted({body for contact in model.contacts for body, _ in contact.sides}):
            space, first = model.bodies[b].space, int(model.first_node[b])
            breaks, degree = space.axis.breaks, space.axis.degree
            # The mean round a hole; of harmonic functions this is the value at its centre.
            hole = space.rod.rings[0] * circle(_ROUND)
            centre = space.basis.functions(hole)[0][:, space.basis.is_control_point].mean(axis=0)
            fractions = np.arange(_SEGMENTS) / _SEGMENTS
            u = np.append((breaks[:-1, None] + fractions * np.diff(breaks)[:, None]).ravel(), breaks[-1])
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
        self._stretches = Stretches(*(np.concatenate(column) for column in zip(*stretches, strict=True)))
        self._radius, self._at = self._stretches.radius, np.concatenate(at)
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        self._lines = csr_matrix(entries, shape=(count, self._reference.shape[0]))
        self._rest = self._ends(np.zeros(self._reference.size))

    def deep(self, packed: Packed) -> str | None:
        """Return a message on a point of the last forces that is too deep, if there is one."""
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
        """Return a message on bodies that go through each other between two displacements, if there are any.

        Displacements are as for `isorod.contact.operator.ContactOperator`; ``when`` are load factors or times of
        obstacles that move.
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
        """Return the fraction of the increment between two displacements on which no bodies penetrate each other.

        Load factors ``when`` are those of `passed`.
        """
        start, change = self._ends(before), when[1] - when[0]
        increment, fraction = self._ends(after) - start, 1.0
        while (
            self._each_other(start, fraction * increment, True)
            or self._obstacle(start, start + fraction * increment, (when[0], when[0] + fraction * change), True)
            or self._wall(start, fraction * increment)
            or self._facets(start, fraction * increment, (before, before + fraction * (after - before)), 1.0 - _ENTERS)
        ):
            fraction *= 0.5
            if fraction < _LEAST:
                return 0.0
        return fraction

    def _ends(self, displacement: Array) -> Array:
        """Return positions of the ends of the segments, ``(m, 2, 3)``."""
        line = self._lines @ (self._reference + displacement[: self._reference.size].reshape(-1, 3))
        return np.stack([line[self._at], line[self._at + 1]], axis=1)

    def _each_other(self, start: Array, increment: Array, enters: bool = False) -> str | None:
        """Return a message on two segments that go through each other, or penetrate if ``enters``."""
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
        # Largest relative displacement of two segments.
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
        low_segment, high_segment = sorted((int(first[k]), int(second[k])))
        return f"tunnelling of {self._described(low_segment)} through {self._described(high_segment)}"

    def _obstacle(self, start: Array, end: Array, when: tuple[float, float], enters: bool = False) -> str | None:
        """Return a message on a segment that goes through a cylinder or sphere, or penetrates it if ``enters``."""
        for k, contact in enumerate(self._model.contacts):
            other = contact.obstacle
            if not isinstance(other, Cylinder | Sphere) or contact.has_inner:
                continue
            segments = np.flatnonzero(self._stretches.sides(contact)[1])
            middle = np.array(other.center if isinstance(other, Sphere) else other.point)
            states = [start[segments], end[segments]]
            if contact.motion is not None:
                states = [contact.motion.back(places, at) for places, at in zip(states, when, strict=True)]
            rest, ends, increments = self._rest[segments] - middle, states[0] - middle, states[1] - states[0]
            if isinstance(other, Cylinder):
                # Distances are from the axis.
                axis = np.array(other.axis) / np.linalg.norm(other.axis)
                rest, ends, increments = (one - (one @ axis)[..., None] * axis for one in (rest, ends, increments))
            size, still = np.full(segments.size, float(other.radius)), np.zeros_like(ends)
            relative = np.linalg.norm(increments, axis=2).max(axis=1)
            apart = _distance(rest, still)
            pair = _nearer(apart, (ends, still), (increments, still), self._radius[segments], size, relative, enters)
            if pair is not None:
                return f"tunnelling of {self._described(int(segments[pair]))} through the obstacle of contact {k}"
        return None

    def _wall(self, start: Array, increment: Array) -> str | None:
        """Return a message on a segment that comes out of a tube through its wall."""
        middles, end = start.mean(axis=1), start + increment
        for contact in self._inside:
            sides = self._stretches.sides(contact)[0]
            for tube in (body for body, _ in contact.sides if contact.is_inner(body)):
                wall = np.flatnonzero(self._stretches.body == tube)
                outside = np.flatnonzero((sides >= 0) & (sides != sides[wall[0]]))
                hole = self._model.bodies[tube].space.rod.rings[0]
                before, between, segment = _beside(middles[outside], start[wall])
                # Segments that were in the hole and are now outside the outer surface.
                was_in = between & (before < hole * self._radius[wall[segment]])
                after, between, segment = _beside(end.mean(axis=1)[outside], end[wall])
                out = np.flatnonzero(was_in & between & (after > self._radius[wall[segment]]))
                if out.size:
                    return f"tunnelling of {self._described(int(outside[out[0]]))} through the wall of body {tube}"
        return None

    def _facets(self, start: Array, increment: Array, states: tuple[Array, Array], ahead: float) -> str | None:
        """Return a message on a segment that goes through facets of a finite element body between two displacements.

        The point checked is so many radii ``ahead`` of its centre.
        """
        for k, contact, crossing in self._crossings:
            segments = np.flatnonzero(self._stretches.sides(contact)[1])
            before, path = start[segments].mean(axis=1), increment[segments].mean(axis=1)
            first, second = (state[self._reference.size :] for state in states)
            hit = crossing.first((before, before + path), (first, second), ahead * self._radius[segments])
            if hit is not None:
                return f"tunnelling of {self._described(int(segments[hit]))} through the facets of contact {k}"
        return None

    def _described(self, segment: int) -> str:
        return f"body {self._stretches.body[segment]} at u = {self._stretches.u[segment]:.4g}"


def limits(model: "Model") -> list[float]:
    """Return the largest penetration of each contact; infinite at a plane, which cannot be passed."""
    result = []
    for contact in model.contacts:
        other, radius = contact.obstacle, smallest_radius(model, contact)
        smaller = min(radius, other.radius) if isinstance(other, Cylinder | Sphere) else radius
        walls = [deepest(model.bodies[body].space, contact.is_inner(body)) for body, _ in contact.sides]
        smaller = min([smaller, *(wall for wall in walls if wall > 0.0)])
        result.append(np.inf if isinstance(other, Plane) else DEEPEST * smaller)
    return result


def _beside(points: Array, ends: Array) -> tuple[Array, Array, Index]:
    """Return distances of points from a polyline, whether they are between its ends, and their nearest segments.

    Parameters
    ----------
    points, ends
        Shapes ``(m, 3)`` and ``(s, 2, 3)``.
    """
    chord = ends[:, 1] - ends[:, 0]
    fraction = np.einsum("msa,sa->ms", points[:, None] - ends[:, 0], chord) / np.einsum("sa,sa->s", chord, chord)
    off = points[:, None] - ends[:, 0] - np.clip(fraction, 0.0, 1.0)[:, :, None] * chord
    distance = np.linalg.norm(off, axis=2)
    nearest, rows = distance.argmin(axis=1), np.arange(len(points))
    closed = np.allclose(ends[0, 0], ends[-1, 1])
    beyond = ((nearest == 0) & (fraction[rows, nearest] < 0.0)) | (
        (nearest == len(ends) - 1) & (fraction[rows, nearest] > 1.0)
    )
    return distance[rows, nearest], closed | ~beyond, nearest


def _nearer(
    rest: Array,
    start: tuple[Array, Array],
    increment: tuple[Array, Array],
    first: Array,
    second: Array,
    relative: Array,
    enters: bool,
) -> int | None:
    """Return a pair of segments that comes too near in an increment, if there is one.

    Parameters
    ----------
    rest
        Distances at rest, ``(m,)``.
    start, increment
        Ends of both segments of each pair, and their increments, ``(m, 2, 3)``.
    first, second, relative
        Radii of both, and their largest relative displacements, ``(m,)``.
    enters
        Take as too near a penetration above `_ENTERS` that is deeper than at the start.
    """
    limit, approach = _NEAREST * (first + second), _APPROACH * np.minimum(first, second)
    if enters:
        depth = np.minimum(first, second)
        limit = np.minimum(first + second - _ENTERS * depth, _distance(*start) - _STILL * depth)
    pair, time, shortest = np.arange(relative.size), np.zeros(relative.size), 0.5 * limit
    while pair.size:
        now = time[pair, None, None]
        there = _distance(*(at[pair] + now * along[pair] for at, along in zip(start, increment, strict=True)))
        through = (there < (limit if enters else np.minimum(limit, rest - approach))[pair]) & (time[pair] > 0.0)
        if through.any():
            return int(pair[np.argmax(through)])
        # Until they have moved so far they cannot be nearer than the limit.
        free = np.maximum(there - limit[pair], shortest[pair])
        pair, free = pair[time[pair] < 1.0], free[time[pair] < 1.0]
        with np.errstate(divide="ignore"):
            time[pair] = np.minimum(1.0, time[pair] + free / relative[pair])
    return None


def _distance(first: Array, second: Array) -> Array:
    """Return the distances of pairs of segments ``(m, 2, 3)`` (Ericson, Real-Time Collision Detection, 5.1.9)."""
    d1, d2, r = first[:, 1] - first[:, 0], second[:, 1] - second[:, 0], first[:, 0] - second[:, 0]

    def dot(a: Array, b: Array) -> Array:
        return np.asarray(np.einsum("ma,ma->m", a, b))

    a, e, f, b, c = dot(d1, d1), dot(d2, d2), dot(d2, r), dot(d1, d2), dot(d1, r)
    tiny = np.finfo(float).tiny
    det = a * e - b * b
    s = np.where(det > 1e-12 * a * e, np.clip((b * f - c * e) / np.maximum(det, tiny), 0.0, 1.0), 0.0)
    t = np.clip((b * s + f) / np.maximum(e, tiny), 0.0, 1.0)
    s = np.clip((b * t - c) / np.maximum(a, tiny), 0.0, 1.0)
    return np.linalg.norm(r + s[:, None] * d1 - t[:, None] * d2, axis=1)
