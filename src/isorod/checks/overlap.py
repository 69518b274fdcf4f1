"""Interpenetration of bodies, or of a body with itself, with contact declared or not: its place and depth.

Two stages: pairs of sections, spaced half a radius, that may touch (`isorod.model.near`) and whose circumscribed
spheres overlap; for the deepest of them, all points of their surfaces.  Most models need the first alone.  Sections
serve any rod without loading the compiled contact search.
"""

import warnings
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array, Index
from isorod.checks.outlines import outlines
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.model.near import Stretches
from isorod.space.space import Space

# Depth, in radii of the thinner body, above which to warn: for any bodies, and for those in contact.
_DEEP = 0.01
_PRESSED = 0.1

_UNDECLARED = "no contact is defined between them; add one"

# Points round a section: for its sphere, for the distance of two sections, and for depths; factor by which spheres of
# so few points may be too small, and fraction of a radius by which distances may be too large.
_COARSE, _OUTLINE, _FINE = 8, 32, 48
_WIDER = 1.08
_SLACK = 0.05

# Sections for each radius of length, and at most in an element.
_TO_A_RADIUS = 2.0
_MOST = 200

# Pairs of sections whose depth is measured, at most, and sections of each patch.
_MEASURED = 20
_STATIONS = 9


class Overlap(NamedTuple):
    """The deepest overlap of a state.

    Attributes
    ----------
    bodies, u
        Two bodies, the same twice where one overlaps itself, and the axis parameter of each.
    depth, relative
        Penetration of a point of one in the other: length, and in radii of the thinner one.
    declared
        Whether the model declares contact between the two.
    middle
        Whether the centre line of one is in the other.
    """

    bodies: tuple[int, int]
    u: tuple[float, float]
    depth: float
    relative: float
    declared: bool
    middle: bool


# Sections up to which all pairs take less time, some milliseconds, than importing SciPy's trees.
_FEW = 300


class _Sections(NamedTuple):
    """Sections of all bodies: their places, centres ``(m, 3)``, and radii of their spheres ``(m,)``."""

    stretches: Stretches
    centre: Array
    reach: Array


def warn_at_rest(model: Model, displacement: Array | None = None) -> float:
    """Warn of the deepest initial overlap of a model with contact, on which contact acts; return its depth.

    Parameters
    ----------
    displacement
        Initial displacement ``(dofs,)``, if it is not zero.

    Raises
    ------
    InputError
        If contact is declared for two bodies of which one's centre line is in the other, or which coincide: the
        direction of separation is undetermined.
    """
    overlap = deepest(model, displacement) if model.contacts else None
    if overlap is None:
        return 0.0
    if overlap.declared and overlap.middle:
        raise InputError(
            f"initial overlap: {_message(overlap)}: too deep for contact to separate them; move one of them"
        )
    cause = "contact forces act before any load" if overlap.declared else _UNDECLARED
    warnings.warn(f"initial overlap: {_message(overlap)}: {cause}", stacklevel=3)
    return overlap.depth


def warn_in_the_end(model: Model, displacement: Array, known: float) -> None:
    """Warn of the deepest final overlap, if it is deeper than the ``known`` one of `warn_at_rest`."""
    overlap = deepest(model, displacement, _PRESSED)
    if overlap is not None and overlap.depth > 1.1 * known:
        cause = "too few contact points there, or the penalty is too low" if overlap.declared else _UNDECLARED
        warnings.warn(f"final overlap: {_message(overlap)}: {cause}", stacklevel=3)


def _message(overlap: Overlap) -> str:
    """Return the message on an overlap."""
    (first, second), (u, v) = overlap.bodies, overlap.u
    partner = "itself" if first == second else f"body {second}"
    return (
        f"body {first} at u = {u:.4g} penetrates {partner} at u = {v:.4g} by {overlap.depth:.3g}, "
        f"{overlap.relative:.2g} of the radius"
    )


def deepest(model: Model, displacement: Array | None = None, pressed: float = _DEEP) -> Overlap | None:
    """Return the deepest overlap above the limit, or None.

    Parameters
    ----------
    displacement
        All degrees of freedom, shape ``(dofs,)``; zero where not given.
    pressed
        Depth, in radii, that is accepted between bodies in contact.
    """
    moved = np.zeros(model.dofs) if displacement is None else displacement
    places = [body.space.positions + model.nodal(moved, b) for b, body in enumerate(model.bodies)]
    sections = _sections(model, places)
    first, second = _near(sections)
    declared, left_out = sections.stretches.declared(model.contacts, first, second)
    left_out |= sections.stretches.tied(model.ties, first, second)
    first, second, declared = first[~left_out], second[~left_out], declared[~left_out]
    if not first.size:
        return None
    depth = _depths(model, places, sections, first, second)
    limit = np.where(declared, pressed, _DEEP)
    order = np.argsort(-depth / limit)
    best: Overlap | None = None
    excess = 1.0
    for k in order[:_MEASURED]:
        if depth[k] + _SLACK <= excess * limit[k]:
            break
        i, j = int(first[k]), int(second[k])
        overlap = _measure(model, places, sections, i, j)
        if overlap.relative > excess * limit[k]:
            excess = overlap.relative / limit[k]
            best = overlap._replace(declared=bool(declared[k]))
            if depth[k] <= 1.2 * overlap.relative:
                # The next ones are hardly deeper.
                break
    return best


def _sections(model: Model, places: list[Array]) -> _Sections:
    """Return sections of all bodies, spaced by a fraction of their radius."""
    rows = []
    for b, (body, at) in enumerate(zip(model.bodies, places, strict=True)):
        space, breaks = body.space, body.space.axis.breaks
        ends = np.sort(np.concatenate([breaks, 0.5 * (breaks[1:] + breaks[:-1])]))
        centre, sizes, _ = _circled(outlines(space, at, ends, _COARSE))
        along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(centre, axis=0), axis=1)))[::2]
        thinnest = np.minimum(np.minimum(sizes[:-2:2], sizes[1::2]), sizes[2::2])
        count = np.clip(np.ceil(_TO_A_RADIUS * np.diff(along) / thinnest), 1, _MOST).astype(np.int64)
        element = np.repeat(np.arange(count.size), count)
        fraction = (np.arange(element.size) - (np.cumsum(count) - count)[element] + 0.5) / count[element]
        u, length = (column[element] + fraction * np.diff(column)[element] for column in (breaks, along))
        period = np.full(u.size, along[-1] if space.rod.closed else np.inf)
        centre, radius, reach = _circled(outlines(space, at, u, _COARSE))
        rows.append((np.full(u.size, b), element, u, length, length, period, radius, centre, reach))
    columns = [np.concatenate(column) for column in zip(*rows, strict=True)]
    return _Sections(Stretches(*columns[:7]), *columns[7:])


def _circled(points: Array) -> tuple[Array, Array, Array]:
    """Return centres of sections ``(t, q, 3)``, and the mean and largest distance of their points from them."""
    centre = points.sum(axis=1) / points.shape[1]
    arms = points - centre[:, None]
    spokes = np.sqrt(np.einsum("tqa,tqa->tq", arms, arms))
    return centre, spokes.sum(axis=1) / points.shape[1], spokes.max(axis=1)


def _near(sections: _Sections) -> tuple[Index, Index]:
    """Return pairs of sections that may touch and whose spheres overlap."""
    stretches, centre, reach = sections
    if len(centre) <= _FEW:
        # Positions relative to the mean keep round-off of squared distances small.
        relative = centre - centre.mean(axis=0)
        size, squares = np.sum(relative**2, axis=1), relative @ relative.T
        squares *= -2.0
        squares += size[:, None]
        squares += size
        both = np.flatnonzero(squares.ravel() < (2.0 * _WIDER * float(reach.max())) ** 2)
        first, second = np.divmod(both, len(centre))
        once = first < second
        first, second = first[once], second[once]
    else:
        from scipy.spatial import cKDTree

        first, second = cKDTree(centre).query_pairs(2.0 * _WIDER * float(reach.max()), output_type="ndarray").T
    square = np.sum((centre[first] - centre[second]) ** 2, axis=1)
    near = square < (_WIDER * (reach[first] + reach[second])) ** 2
    first, second = first[near], second[near]
    may = stretches.may_touch(first, second)
    return first[may], second[may]


def _depths(model: Model, places: list[Array], sections: _Sections, first: Index, second: Index) -> Array:
    """Return the depth, in radii, of one section in the other along the line of their centres."""
    stretches, centre, _ = sections
    used, number = np.unique(np.concatenate([first, second]), return_inverse=True)
    body = stretches.body[used]
    arms = np.concatenate(
        [outlines(model.bodies[b].space, at, stretches.u[used[body == b]], _OUTLINE) for b, at in enumerate(places)]
    )
    arms -= centre[used][:, None]
    line = centre[second] - centre[first]
    distance = np.linalg.norm(line, axis=1)
    line /= np.maximum(distance, np.finfo(float).tiny)[:, None]
    mine = np.einsum("kqa,ka->kq", arms[number[: first.size]], line).max(axis=1)
    theirs = np.einsum("kqa,ka->kq", arms[number[first.size :]], -line).max(axis=1)
    radii = stretches.radius[first], stretches.radius[second]
    # Centres that coincide have no line between them.
    depth = np.where(distance < 0.5 * np.minimum(*radii), radii[0] + radii[1], mine + theirs) - distance
    return np.asarray(depth / np.minimum(*radii))


def _measure(model: Model, places: list[Array], sections: _Sections, first: int, second: int) -> Overlap:
    """Return the overlap of the surfaces about two sections."""
    best, middle, at = 0.0, False, (float(sections.stretches.u[first]), float(sections.stretches.u[second]))
    numbers = int(sections.stretches.body[first]), int(sections.stretches.body[second])
    own = [
        _Patch.of(model.bodies[b].space, places[b], sections, k) for b, k in zip(numbers, (first, second), strict=True)
    ]
    for slave, master in ((0, 1), (1, 0)):
        depth, u, v, inside = own[master].deepest(own[slave])
        middle = middle or inside
        if depth > best:
            best, at = depth, (u, v) if slave == 0 else (v, u)
    smaller = float(min(sections.stretches.radius[first], sections.stretches.radius[second]))
    if numbers[0] > numbers[1]:
        numbers, at = numbers[::-1], at[::-1]
    return Overlap(numbers, at, best, best / smaller, False, middle)


class _Patch(NamedTuple):
    """The surface about a section: axis parameters ``(t,)``, points, outward normals ``(t, q, 3)``, centres, hole."""

    u: Array
    points: Array
    normals: Array
    centre: Array
    hole: float

    @classmethod
    def of(cls, space: Space, places: Array, sections: _Sections, k: int) -> "_Patch":
        """Return the patch of a section, of a length of one radius."""
        at = np.array([sections.stretches.u[k]])
        speed = float(np.linalg.norm(outlines(space, places, at, _COARSE, slope=True).mean(axis=1)))
        low, high = space.axis.breaks[[0, -1]]
        half = 0.5 * float(sections.stretches.radius[k]) / speed
        u = np.linspace(max(low, at[0] - half), min(high, at[0] + half), _STATIONS)
        points, along = (outlines(space, places, u, _FINE, slope) for slope in (False, True))
        centre = points.mean(axis=1)
        normals = np.cross(np.roll(points, -1, axis=1) - np.roll(points, 1, axis=1), along)
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        outward = np.einsum("tqa,tqa->", normals, points - centre[:, None])
        return cls(u, points, normals * np.sign(outward), centre, space.rod.rings[0])

    def deepest(self, other: "_Patch") -> tuple[float, float, float, bool]:
        """Return the largest depth of another patch's points in this body, its ``u`` and this one's.

        The last item is whether centres of the other patch are inside.
        """
        from scipy.spatial import cKDTree

        probes, u = other.points.reshape(-1, 3), np.repeat(other.u, other.points.shape[1])
        if other.hole == 0.0:
            # Centres too: if bodies coincide, neither surface is within the other.
            probes, u = np.concatenate([probes, other.centre]), np.concatenate([u, other.u])
        _, nearest = cKDTree(self.points.reshape(-1, 3)).query(probes)
        station = nearest // self.points.shape[1]
        away = probes - self.points.reshape(-1, 3)[nearest]
        depth = -np.einsum("pa,pa->p", away, self.normals.reshape(-1, 3)[nearest])
        # Points in a hole are not in the body.
        inner = np.linalg.norm(probes - self.centre[station], axis=1)
        outer = np.linalg.norm(self.points[station] - self.centre[station][:, None], axis=2).mean(axis=1)
        depth = np.minimum(depth, inner - self.hole * outer) if self.hole > 0.0 else depth
        # Points nearest to the patch's ends are beyond it, or beyond the rod.
        depth = np.where((station == 0) | (station == self.u.size - 1), 0.0, depth)
        k = int(np.argmax(depth))
        middle = bool((depth[other.points.shape[0] * other.points.shape[1] :] > 0.0).any())
        return float(depth[k]), float(u[k]), float(self.u[station[k]]), middle
