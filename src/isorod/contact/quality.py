"""How well points and surfaces see the patch of a contact, and what is said where they do not.

The width of the patch is counted in points and in cells (`isorod.contact.cells`), the run of points under pressure in
which each lies: its mean by their loads, round the section or along the axis, whichever is the less.  Facets of finite
element bodies have no rows: there it is that of an even load of the same second moments on the rods.  Passes that carry
less than a tenth of what the one with most does are left out.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.contact.cells import grids, is_facets
from isorod.contact.facets import MOST as MOST_OF_FACETS
from isorod.contact.facets import SQUARES
from isorod.contact.packed import Packed, Row, Table
from isorod.model.contact import MAX_POINTS

# Points across the patch below which more are taken, as many as are then looked for, and those of an element at most:
# each search begins at all points of an element.  What is gained must be worth another solution.  At half and twice the
# value, the largest pressure of a bar on a plane, 36.3 (`lying` of `tests/test_held_by_contact.py`, under-resolved by
# control points), is 9.0 and 36.3 by the fewest, 25.4 and 52.5 by the requested number, 22.1 and 9.0 by the gain; the
# clasp's, 866, is 2,228 with twice the fewest.
FEWEST, WANTED, MOST, _WORTH = 5, 8, 2_000, 1.25

# Points, and cells, across the patch below which a result is warned of, and the share by which its force may change
# with other points.
POINTS, CELLS, CHANGE = 3.9, 2.3, 0.05

# The error of the largest pressure, times the width in cells.  Measured on a cylinder pressed on a plane: 20, 5, 1, 11
# and 5 % with 1.3, 2, 2.3, 2.7 and 3.3 cells.
PEAK = 0.3

# 0.05, 0.2: no change of these nor of crossing bars.
_LITTLE = 0.1


# Degrees of facets by their nodes, and of a rule's points how many are those along a side, squared.
_DEGREES = {3: 1, 6: 2, 10: 3, 4: 1, 9: 2}
_IN_PIECES = {3: 4.0 / 3.0, 6: 4.0 / 3.0, 10: 4.0 / 3.0, 4: 1.0, 9: 1.0}

# Share of the length of all facets from which a patch has no length of its own.
_WHOLE = 0.9

# Mean of the unit vectors of angles below which a load is all round the section.
_ROUND = 0.3


class Width(NamedTuple):
    """The patch of a pass: its load, its mean width in points along the axis and round the section, and in cells."""

    load: float
    along: float
    around: float
    cells: float


def widths(packed: Packed) -> list[Width]:
    """Return the width of the patch of each pass, as the last forces left it."""
    found = []
    loads = packed.areas * packed.states["pressure"]
    for one, load in zip(packed.passes, grids(packed, loads), strict=True):
        surface = packed.surfaces[one["slave"]]
        if is_facets(surface) and load.any():
            found.append(_of_facets(packed, one, load))
            continue
        whole = load.reshape(load.shape[0] * load.shape[1], -1)
        rows, columns = np.flatnonzero(whole.any(axis=1)), np.flatnonzero(whole.any(axis=0))
        total = float(whole.sum())
        if not total > 0.0:
            found.append(Width(0.0, 0.0, 0.0, 0.0))
            continue
        closed = bool(np.isfinite(surface["period"]))
        around = _mean(whole[rows], True)
        along = _mean(whole[:, columns].T, closed)
        cells = along / one["along"] * surface["cells"], around / one["across"] * surface["cells_round"] / load.shape[2]
        found.append(Width(total, along, around, min(cells)))
    return found


def _of_facets(packed: Packed, one: Row, load: Array) -> Width:
    """Return the width of the patch of facets, whose points have some loads: as the rods that they touch see it."""
    first, loads = int(one["first_point"]), load.ravel()
    pressed = np.flatnonzero(loads)
    starts, loads = packed.starts[first + pressed], loads[pressed]
    elements = packed.elements[starts["element"]]
    masters = packed.surfaces[elements["surface"]]
    lengths = elements["end"] - elements["begin"]
    places = elements["begin"] + 0.5 * (starts["s"] + 1.0) * lengths

    def mean(values: Array, groups: Array) -> Array:
        """Return the means by loads of values at the points of each group, at these points."""
        number = np.unique(groups, return_inverse=True)[1]
        real, imaginary, total = (
            np.bincount(number, weights) for weights in (loads * values.real, loads * values.imag, loads)
        )
        return np.asarray((real + 1j * imaginary)[number] / total[number])

    spread = mean((places - mean(places, elements["surface"]).real) ** 2, elements["surface"]).real
    turned = np.abs(mean(np.exp(1j * starts["theta"]), starts["element"]))
    # Of an even load as wide as w the second moment is w^2 / 12.
    along = np.sqrt(12.0 * spread)
    around = elements["radius"] * np.where(turned < _ROUND, np.inf, np.sqrt(24.0 * (1.0 - np.minimum(turned, 1.0))))
    slave = packed.surfaces[one["slave"]]
    facets = packed.elements[slave["first_element"] + pressed // int(one["along"])]
    longest, widest, whole = _extents(packed, slave, facets, starts["element"], first + pressed)
    along[along > _WHOLE * whole] = np.inf
    # Two points a piece; nodes of the facets, and functions of the rods.
    points, nodes = np.sqrt(_IN_PIECES[int(slave["functions"])] * load.shape[1]), _DEGREES[int(slave["functions"])]
    arcs = masters["arcs"][np.arange(pressed.size), _arcs(masters, starts["theta"]), 6]
    own = 2.0 * np.pi * elements["radius"] * arcs * masters["around"] / masters["cells_round"]
    of_facets, of_rods = (along / longest, around / widest), (along / lengths * masters["cells"], around / own)
    cells = np.minimum(nodes * np.minimum(*of_facets), np.minimum(*of_rods))
    total = float(loads.sum())
    widths = (float(loads @ each / total) for each in (along / longest * points, around / widest * points, cells))
    return Width(total, *widths)


def _arcs(masters: Table, theta: Array) -> Index:
    """Return the arcs of angles on surfaces."""
    fine = np.floor((theta - masters["turn"]) / (2.0 * np.pi) * masters["fine"] + 0.5).astype(np.int64)
    return np.asarray(masters["arc_of"][np.arange(theta.size), fine % masters["fine"]])


def _extents(packed: Packed, slave: Row, facets: Table, touched: Index, points: Index) -> tuple[Array, Array, float]:
    """Return how far facets reach along the axes of the elements that points of theirs touch, and across, ``(m,)``.

    Then how far all facets of the ``slave`` reach along the mean of these axes.
    """
    masters = packed.elements[touched]
    surfaces, row = packed.surfaces[masters["surface"]], np.arange(touched.size)
    ends = [masters["layers"][:, 0], masters["layers"][row, surfaces["functions"] - 1]]
    # Of a layer the mean of two control points that are opposite each other, or nearly.
    first, last = (packed.before[layer] + packed.before[layer + surfaces["around"] // 2] for layer in ends)
    axis = (last - first) / np.linalg.norm(last - first, axis=1)[:, None]
    corners = packed.before[facets["layers"][:, : 4 if slave["functions"] in SQUARES else 3]]
    across = np.cross(packed.states["normal"][points], axis)
    longest, widest = (np.ptp(np.einsum("mca,ma->mc", corners, way), axis=1) for way in (axis, across))
    rows = packed.elements[slave["first_element"] :][: slave["elements"]]
    every = packed.before[rows["layers"][:, : slave["functions"]]]
    return longest, widest, float(np.ptp(every @ axis.mean(axis=0)))


def _mean(loads: Array, cyclic: bool) -> float:
    """Return the mean length of runs of points that carry loads, by these."""
    carries = loads > 0.0
    return float(loads[carries] @ _runs(carries, cyclic)[carries] / loads.sum())


def _runs(active: NDArray[np.bool_], cyclic: bool) -> Array:
    """Return how many True follow each other in a row where an entry lies, infinitely many where all do; 0 if False."""
    count = active.shape[1]
    wide = np.tile(active, (1, 3)) if cyclic else active
    edge = np.zeros((wide.shape[0], 1), dtype=bool)
    wide = np.concatenate([edge, wide, edge], axis=1)
    place = np.arange(wide.shape[1])
    before = np.maximum.accumulate(np.where(wide, 0, place), axis=1)
    after = np.minimum.accumulate(np.where(wide, place[-1], place)[:, ::-1], axis=1)[:, ::-1]
    lengths = np.where(wide, after - before - 1, 0)[:, 1:-1]
    own = lengths[:, count : 2 * count] if cyclic else lengths
    # What touches everywhere has no width.
    return np.where(own >= count, np.inf, own)


def carrying(found: Sequence[Width]) -> list[int]:
    """Return which of some passes carry most of a contact."""
    most = max((one.load for one in found), default=0.0)
    return [k for k, one in enumerate(found) if one.load > _LITTLE * most]


def across(packed: Packed, chosen: Sequence[int]) -> tuple[float, float]:
    """Return the width of the patch of some passes in points and in cells, the least; 0 where it has none."""
    found = widths(packed)
    own = [chosen[k] for k in carrying([found[k] for k in chosen])]
    if not own:
        return 0.0, 0.0
    points, cells = min(min(found[k].along, found[k].around) for k in own), min(found[k].cells for k in own)
    return (points, cells) if np.isfinite(points) else (0.0, 0.0)


def more(
    packed: Packed, chosen: Sequence[int], points: Sequence[tuple[int, int]], between: bool
) -> dict[int, tuple[int, int]]:
    """Return points of passes whose patch has too few, those of an arc and of an element; none where it has enough.

    Where nothing touches, but might ``between`` two points, they are twice as many, if that is asked for.
    """
    found, changed = widths(packed), {}
    own = [chosen[k] for k in carrying([found[k] for k in chosen])]
    for k in own or [k for k in chosen if between and _is_near(packed, k)]:
        old = points[k]
        seen = (found[k].around, found[k].along) if own else (WANTED / 2, WANTED / 2)
        new = [
            # Less a little: round-off does not add a point.
            min(MAX_POINTS, int(np.ceil(count * WANTED / width - 1e-9))) if width < FEWEST else count
            for count, width in zip(old, seen, strict=True)
        ]
        surface = packed.surfaces[packed.passes[k]["slave"]]
        most = min(MOST, MOST_OF_FACETS / surface["elements"]) if is_facets(surface) else MOST
        room = np.sqrt(most / (surface["around"] * new[0] * new[1]))
        across, along = (max(was, int(count * min(1.0, room))) for was, count in zip(old, new, strict=True))
        if across * along >= _WORTH * old[0] * old[1]:
            changed[k] = across, along
    return changed


def _is_near(packed: Packed, k: int) -> bool:
    """Whether a surface that bulges as the slave's of a pass does could touch between two of its points."""
    one = packed.passes[k]
    slave = packed.surfaces[one["slave"]]
    round_it = packed.surfaces[one["master"]] if is_facets(slave) else slave
    elements = packed.elements[round_it["first_element"] :][: round_it["elements"]]
    radius = float(elements["radius"].max())
    lengths = elements["end"] - elements["begin"]
    count = slave["elements"] * one["along"] * slave["around"] * one["across"]
    apart = max(float(lengths.max()) / one["along"], 2.0 * np.pi * radius / (slave["fine"] * one["across"]))
    if is_facets(slave):
        apart = float(np.sqrt(packed.areas[one["first_point"] :][:count].max()))
    gaps = packed.states["gap"][one["first_point"] :][:count]
    return bool((gaps < 0.5 * apart**2 / radius).any())
