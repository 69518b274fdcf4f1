"""Bodies that run through each other or through themselves, whether contact is declared or not: where, and how deep.

What is near is found in three steps, each of which leaves little to the next: boxes about the elements; sections, two
to a radius, of elements whose boxes overlap; of the sections that are deepest in each other, all points round their
surfaces.  Most models end with the first.  Sections serve any rod, so that the loops of contact stay unloaded.

Of its own body a place may not meet what is less than half a turn of its radius away along the axis, as in
`isorod.contact.packed`.  Nor may it on a stretch of length ``s`` that turns by less than ``t``: its ends are no nearer
than ``s cos(t / 2)`` (A. Schur's comparison with an arc), which from half a turn of the radius on is a diameter where
``t`` is 100 degrees.
"""

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.geometry import boxes
from isorod.model.model import Model
from isorod.space.space import Space

Mask = NDArray[np.bool_]

# Depth, in radii of the thinner body, that is warned of: of any bodies, and of those that contact presses together.
_DEEP = 0.01
_PRESSED = 0.1

_UNDECLARED = "nothing keeps them apart; declare a contact"

# What a stretch turns by that does not meet itself, in radians.
_TURN = np.radians(100.0)

# Points round a section: for boxes, for the distance of two sections, and for depths; and the parts of a radius by
# which boxes are too small, and distances too large, for want of more.
_BOX, _COARSE, _FINE = 8, 32, 48
_BULGE = 0.08
_SLACK = 0.05

# Pieces of an element in boxes of their own, sections to a radius of length, and sections of an element, at most.
_BOXES = 16
_TO_A_RADIUS = 2.0
_PIECES = 200

# Pairs of sections of which depths are measured, at most, and sections by which each is.
_MEASURED = 20
_STATIONS = 9


class Overlap(NamedTuple):
    """The deepest overlap of a state.

    Attributes
    ----------
    bodies, u
        Two bodies, the same twice where one overlaps itself, and the axis parameter of each.
    depth, relative
        How deep a point of the one is in the other: length, and in radii of the thinner one.
    declared
        Whether a contact of the model is between the two places.
    middle
        Whether the centre line of one is in the other.
    """

    bodies: tuple[int, int]
    u: tuple[float, float]
    depth: float
    relative: float
    declared: bool
    middle: bool


class _Sections(NamedTuple):
    """Sections of all bodies, ``m`` in all, of ``q`` points each: what they belong to, and where they are."""

    body: Index
    element: Index
    u: Array
    along: Array
    period: Array
    points: Array
    centre: Array
    radius: Array


def warn_at_rest(model: Model, displacement: Array | None = None) -> float:
    """Warn of the deepest overlap of bodies at rest, where there is contact, which acts on it; return its depth.

    Parameters
    ----------
    displacement
        That of the start, all degrees of freedom, shape ``(dofs,)``, if it is not zero.

    Raises
    ------
    InputError
        If contact is to press apart two bodies one of whose centre lines is in the other, or which coincide: no side is
        the nearer one.
    """
    found = deepest(model, displacement) if model.contacts else None
    if found is None:
        return 0.0
    if found.declared and found.middle:
        raise InputError(f"overlap at rest: {_said(found)}: too deep for contact to part them; move one of them")
    what = "contact presses them apart before there is any load" if found.declared else _UNDECLARED
    warnings.warn(f"overlap at rest: {_said(found)}: {what}", stacklevel=3)
    return found.depth


def warn_in_the_end(model: Model, displacement: Array, known: float) -> None:
    """Warn of the deepest overlap in the end, if it is deeper than what `warn_at_rest` told of."""
    found = deepest(model, displacement, _PRESSED)
    if found is not None and found.depth > 1.1 * known:
        what = "contact has too few points there, or too low a penalty" if found.declared else _UNDECLARED
        warnings.warn(f"overlap in the end: {_said(found)}: {what}", stacklevel=3)


def _said(found: Overlap) -> str:
    """Return where and how deep an overlap is."""
    (one, other), (u, v) = found.bodies, found.u
    partner = "itself" if one == other else f"body {other}"
    return (
        f"body {one} at u = {u:.4g} is {found.depth:.3g} deep in {partner} at u = {v:.4g}, {found.relative:.2g} of the "
        "radius"
    )


def deepest(model: Model, displacement: Array | None = None, pressed: float = _DEEP) -> Overlap | None:
    """Return the deepest overlap that is too deep, or None.

    Parameters
    ----------
    displacement
        All degrees of freedom, shape ``(dofs,)``; zero where not given.
    pressed
        Depth, in radii, that is right for bodies between which a contact is declared.
    """
    moved = np.zeros(model.dofs) if displacement is None else displacement
    places = [body.space.positions + model.nodal(moved, b) for b, body in enumerate(model.bodies)]
    elements = _near_elements(model, places)
    if elements is None:
        return None
    sections = _cut(model, places, elements)
    first, second, depth = _near_sections(sections)
    declared, left_out = _declared(model, sections, first, second)
    first, second, depth, declared = first[~left_out], second[~left_out], depth[~left_out], declared[~left_out]
    limit = np.where(declared, pressed, _DEEP)
    order = np.argsort(-depth / limit)
    best: Overlap | None = None
    excess = 1.0
    for k in order[:_MEASURED]:
        if depth[k] + _SLACK <= excess * limit[k]:
            break
        one, other = int(first[k]), int(second[k])
        found = _measure(model, places, sections, one, other)
        if found.relative > excess * limit[k]:
            excess = found.relative / limit[k]
            best = found._replace(declared=bool(declared[k]))
            if depth[k] <= 1.2 * found.relative:
                # What comes next is no deeper to speak of.
                break
    return best


def _outlines(space: Space, places: Array, u: Array, count: int, slope: bool = False) -> Array:
    """Return points round the sections at ``u``, or their derivatives by it, shape ``(t, count, 3)``."""
    angle = 2.0 * np.pi * np.arange(count) / count
    values = space.basis.functions(np.stack([np.cos(angle), np.sin(angle)], axis=1))[0]
    first, axial, slopes = space.axis.local(u)
    layers = (first[:, None] + np.arange(space.axis.degree + 1)) % space.layers
    near = places.reshape(space.layers, space.layer_nodes, 3)[layers]
    return np.asarray(values @ np.einsum("tj,tjia->tia", slopes if slope else axial, near))


def _size(points: Array, centre: Array) -> Array:
    """Return the mean distance of sections' points from their centres."""
    return np.asarray(np.linalg.norm(points - centre[:, None], axis=2).mean(axis=1))


def _near_elements(model: Model, places: list[Array]) -> list[Index] | None:
    """Return the elements of each body that may overlap others, or None where there are none."""
    rows = []
    for b, (body, at) in enumerate(zip(model.bodies, places, strict=True)):
        space = body.space
        pieces = _pieces(space)
        u = _divided(space.axis.breaks, 2 * pieces)
        # Points first: NumPy is slow at sums over a few numbers that lie side by side.
        points = np.ascontiguousarray(_outlines(space, at, u, _BOX).swapaxes(0, 1))
        centre = points.sum(axis=0) / _BOX
        arms = points - centre
        size = np.sqrt(np.einsum("qta,qta->qt", arms, arms).max(axis=0))
        radius = _over_three(size, np.maximum)
        sagitta = np.abs(centre[1::2] - 0.5 * (centre[:-2:2] + centre[2::2]))
        margin = _BULGE * radius[:, None] + 0.3 * sagitta
        low, high = _over_three(points.min(axis=0), np.minimum) - margin, _over_three(points.max(axis=0), np.maximum)
        legs = centre[1:] - centre[:-1]
        length = np.sqrt(np.einsum("ka,ka->k", legs, legs))
        legs /= np.maximum(length, np.finfo(float).tiny)[:, None]
        cos = np.einsum("ka,ka->k", legs, np.concatenate([legs[1:], legs[:1] if space.rod.closed else legs[-1:]]))
        turn = np.arccos(np.minimum(np.maximum(cos, -1.0), 1.0))
        if not space.rod.closed and turn.size > 1:
            turn[-1] = turn[-2]
        along, turned = (np.append(0.0, np.cumsum(one)) for one in (length, turn))
        whole = (along[-1], turned[-1]) if space.rod.closed else (np.inf, np.inf)
        own = (along[:-2:2], along[2::2], turned[:-2:2], turned[2::2], radius)
        count = radius.size
        numbers = np.full(count, b), np.arange(count) // pieces
        rows.append((*numbers, low, high + margin, *own, *(np.full(count, one) for one in whole)))
    body, element, low, high, begin, end, turn, turned, radius, period, round_it = (
        np.concatenate(one) for one in zip(*rows, strict=True)
    )
    first, second = boxes.pairs(low, high)
    # Of two pieces of one body, the stretch from where the first begins to where the second ends, or the other way.
    one, other = np.minimum(first, second), np.maximum(first, second)
    far = np.minimum(end[other] - begin[one], period[one] - (begin[other] - end[one]))
    bend = np.minimum(turned[other] - turn[one], round_it[one] - (turn[other] - turned[one]))
    own = (far < np.pi * np.maximum(radius[one], radius[other])) | (bend < _TURN)
    meet = (body[one] != body[other]) | ~own
    if not meet.any():
        return None
    near = np.unique(np.concatenate([one[meet], other[meet]]))
    return [np.unique(element[near[body[near] == b]]) for b in range(len(model.bodies))]


def _pieces(space: Space) -> int:
    """Return in how many pieces the boxes of a space's elements are, each about a diameter long."""
    rod = space.rod
    points = rod.control_points.swapaxes(0, 1)
    layers = points.sum(axis=0) / rod.section_points
    legs, arms = layers[1:] - layers[:-1], points - layers
    length = np.sqrt(np.einsum("ka,ka->k", legs, legs)).sum()
    diameter = 2.0 * np.sqrt(np.einsum("qka,qka->qk", arms, arms).min(axis=0)).mean()
    return int(min(max(length / (diameter * space.axis.elements), 1), _BOXES))


def _divided(breaks: Array, pieces: int) -> Array:
    """Return the ends of equal pieces of each element, in order."""
    inner = breaks[:-1, None] + np.arange(pieces) / pieces * np.diff(breaks)[:, None]
    return np.append(inner.ravel(), breaks[-1])


def _over_three(values: Array, pick: np.ufunc) -> Array:
    """Return the extremes over begin, middle and end of each piece."""
    return np.asarray(pick(pick(values[:-2:2], values[1::2]), values[2::2]))


def _cut(model: Model, places: list[Array], elements: list[Index]) -> _Sections:
    """Return sections of elements of each body."""
    rows = []
    for b, (body, at, chosen) in enumerate(zip(model.bodies, places, elements, strict=True)):
        space, breaks = body.space, body.space.axis.breaks
        points = _outlines(space, at, _divided(breaks, 2), _BOX)
        centre = points.mean(axis=1)
        along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(centre, axis=0), axis=1)))
        radius = _size(points, centre)
        for e in chosen:
            length = along[2 * e + 2] - along[2 * e]
            pieces = int(np.clip(np.ceil(_TO_A_RADIUS * length / radius[2 * e : 2 * e + 3].min()), 1, _PIECES))
            share = (np.arange(pieces) + 0.5) / pieces
            u = breaks[e] + share * (breaks[e + 1] - breaks[e])
            period = np.full(pieces, along[-1] if space.rod.closed else np.inf)
            rows.append((np.full(pieces, b), np.full(pieces, e), u, along[2 * e] + share * length, period))
    body, element, u, along, period = (np.concatenate(one) for one in zip(*rows, strict=True))
    points = np.concatenate(
        [_outlines(model.bodies[b].space, at, u[body == b], _COARSE) for b, at in enumerate(places)]
    )
    centre = points.mean(axis=1)
    return _Sections(body, element, u, along, period, points, centre, _size(points, centre))


def _near_sections(sections: _Sections) -> tuple[Index, Index, Array]:
    """Return pairs of sections, and the depth of one in the other along the line of their centres in radii."""
    from scipy.spatial import cKDTree

    centre, points = sections.centre, sections.points
    reach = (2.0 + _SLACK) * float(np.linalg.norm(points - centre[:, None], axis=2).max())
    first, second = cKDTree(centre).query_pairs(reach, output_type="ndarray").T
    way = np.abs(sections.along[first] - sections.along[second])
    way = np.minimum(way, sections.period[first] - way)
    larger = np.maximum(sections.radius[first], sections.radius[second])
    meet = (sections.body[first] != sections.body[second]) | (way >= np.pi * larger)
    first, second = first[meet], second[meet]
    line = centre[second] - centre[first]
    distance = np.linalg.norm(line, axis=1)
    line /= np.maximum(distance, np.finfo(float).tiny)[:, None]
    mine = np.einsum("kqa,ka->kq", points[first] - centre[first][:, None], line).max(axis=1)
    theirs = np.einsum("kqa,ka->kq", points[second] - centre[second][:, None], -line).max(axis=1)
    both = sections.radius[first], sections.radius[second]
    # Sections in one place have no line between their centres.
    depth = np.where(distance < 0.5 * np.minimum(*both), both[0] + both[1], mine + theirs) - distance
    depth /= np.minimum(*both)
    deep = depth > _DEEP - _SLACK
    return first[deep], second[deep], depth[deep]


def _declared(model: Model, sections: _Sections, first: Index, second: Index) -> tuple[Mask, Mask]:
    """Return whether a contact is between two sections, or between their bodies but names elements, and not theirs."""
    there, named = np.zeros(first.size, dtype=bool), np.zeros(first.size, dtype=bool)
    for contact in model.contacts:
        if contact.obstacle is not None:
            continue
        groups = contact.groups
        side, mine = np.full(sections.body.size, -1), np.zeros(sections.body.size, dtype=bool)
        for body, elements in contact.sides:
            own = sections.body == body
            side[own] = next(k for k, group in enumerate(groups) if body in group)
            mine |= own if elements is None else own & np.isin(sections.element, np.asarray(elements, dtype=np.int64))
        one, other = side[first], side[second]
        between = (one >= 0) & (other >= 0) & ((one != other) if len(groups) == 2 else True)
        there |= between & mine[first] & mine[second]
        named |= between
    return there, named & ~there


def _measure(model: Model, places: list[Array], sections: _Sections, first: int, second: int) -> Overlap:
    """Return how deep the surfaces about two sections are in each other."""
    best, middle, at = 0.0, False, (float(sections.u[first]), float(sections.u[second]))
    numbers = int(sections.body[first]), int(sections.body[second])
    own = [
        _Patch.of(model.bodies[b].space, places[b], sections, k) for b, k in zip(numbers, (first, second), strict=True)
    ]
    for slave, master in ((0, 1), (1, 0)):
        depth, u, v, inside = own[master].deepest(own[slave])
        middle = middle or inside
        if depth > best:
            best, at = depth, (u, v) if slave == 0 else (v, u)
    smaller = float(min(sections.radius[first], sections.radius[second]))
    if numbers[0] > numbers[1]:
        numbers, at = numbers[::-1], at[::-1]
    return Overlap(numbers, at, best, best / smaller, False, middle)


class _Patch(NamedTuple):
    """The surface about a section: stations ``(t,)``, points and outward normals ``(t, q, 3)``, centres, and hole."""

    u: Array
    points: Array
    normals: Array
    centre: Array
    hole: float

    @classmethod
    def of(cls, space: Space, places: Array, sections: _Sections, k: int) -> "_Patch":
        """Return that of a section, a radius long."""
        at = np.array([sections.u[k]])
        speed = float(np.linalg.norm(_outlines(space, places, at, _BOX, slope=True).mean(axis=1)))
        low, high = space.axis.breaks[[0, -1]]
        half = 0.5 * float(sections.radius[k]) / speed
        u = np.linspace(max(low, at[0] - half), min(high, at[0] + half), _STATIONS)
        points, along = (_outlines(space, places, u, _FINE, slope) for slope in (False, True))
        centre = points.mean(axis=1)
        normals = np.cross(np.roll(points, -1, axis=1) - np.roll(points, 1, axis=1), along)
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        outward = np.einsum("tqa,tqa->", normals, points - centre[:, None])
        return cls(u, points, normals * np.sign(outward), centre, space.rod.rings[0])

    def deepest(self, other: "_Patch") -> tuple[float, float, float, bool]:
        """Return how deep points of another patch are in this one's body, and where: its ``u`` and this one's.

        The last is whether its centres are.
        """
        from scipy.spatial import cKDTree

        probes, u = other.points.reshape(-1, 3), np.repeat(other.u, other.points.shape[1])
        if other.hole == 0.0:
            # The centre too: of bodies in the same place no surface is within the other.
            probes, u = np.concatenate([probes, other.centre]), np.concatenate([u, other.u])
        _, nearest = cKDTree(self.points.reshape(-1, 3)).query(probes)
        station = nearest // self.points.shape[1]
        away = probes - self.points.reshape(-1, 3)[nearest]
        depth = -np.einsum("pa,pa->p", away, self.normals.reshape(-1, 3)[nearest])
        # What lies in a hole is not in the body.
        inner = np.linalg.norm(probes - self.centre[station], axis=1)
        outer = np.linalg.norm(self.points[station] - self.centre[station][:, None], axis=2).mean(axis=1)
        depth = np.minimum(depth, inner - self.hole * outer) if self.hole > 0.0 else depth
        # Beyond the patch, or the rod, is what is nearest to its rim.
        depth = np.where((station == 0) | (station == self.u.size - 1), 0.0, depth)
        k = int(np.argmax(depth))
        middle = bool((depth[other.points.shape[0] * other.points.shape[1] :] > 0.0).any())
        return float(depth[k]), float(u[k]), float(self.u[station[k]]), middle
