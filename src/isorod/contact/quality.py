"""Resolution of a contact patch by points and control points, and the points that it needs.

The width of the patch is counted in points and in cells (`isorod.contact.cells`): the mean length of runs of points
under pressure, weighted by their loads, round the section or along the axis, whichever is less.  Facets of finite
element bodies have no rows: their width is that of an even load of the same second moments on the rods.  Passes that
carry less than a tenth of the largest load of a pass are left out.
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

# Points across the patch below which more are taken, the target then, the most points of an element (each search begins
# at all points of an element), and the least increase that is worth another solution.  At half and twice the
# value, the largest pressure of a bar on a plane, 36.3 (`lying` of `tests/test_held_by_contact.py`, under-resolved by
# control points), is 9.0 and 36.3 by the fewest, 25.4 and 52.5 by the requested number, 22.1 and 9.0 by the gain; the
# clasp's, 866, is 2,228 with twice the fewest.
FEWEST, TARGET, MOST, _WORTH = 5, 8, 2_000, 1.25

# Points, and cells, across the patch below which there is a warning, and the fraction by which the force may change
# with other points.
POINTS, CELLS, CHANGE = 3.9, 2.3, 0.05

# The error of the largest pressure, times the width in cells.  Measured on a cylinder pressed on a plane: 20, 5, 1, 11
# and 5 % with 1.3, 2, 2.3, 2.7 and 3.3 cells.
PEAK = 0.3

# Fraction of the largest load below which a pass is left out.  0.05, 0.2: no change of these nor of crossing bars.
_LITTLE = 0.1


# Of facets by their nodes: the degree, and the square of the points along a side per point of the rule.
_DEGREES = {3: 1, 6: 2, 10: 3, 4: 1, 9: 2}
_IN_PARTS = {3: 4.0 / 3.0, 6: 4.0 / 3.0, 10: 4.0 / 3.0, 4: 1.0, 9: 1.0}

# Fraction of the length of all facets above which the length of a patch is taken as infinite.
_WHOLE = 0.9

# Mean of the unit vectors of angles below which a load counts as all round the section.
_ROUND = 0.3


class Width(NamedTuple):
    """The patch of a pass: its load, its mean width in points along the axis and round the section, and in cells."""

    load: float
    along: float
    around: float
    cells: float


def widths(packed: Packed) -> list[Width]:
    """Return the width of the patch of each pass, of the last forces."""
    result = []
    loads = packed.areas * packed.states["pressure"]
    for pass_, load in zip(packed.passes, grids(packed, loads), strict=True):
        surface = packed.surfaces[pass_["slave"]]
        if is_facets(surface) and load.any():
            result.append(_of_facets(packed, pass_, load))
            continue
        flat = load.reshape(load.shape[0] * load.shape[1], -1)
        rows, columns = np.flatnonzero(flat.any(axis=1)), np.flatnonzero(flat.any(axis=0))
        total = float(flat.sum())
        if not total > 0.0:
            result.append(Width(0.0, 0.0, 0.0, 0.0))
            continue
        closed = bool(np.isfinite(surface["period"]))
        around = _mean(flat[rows], True)
        along = _mean(flat[:, columns].T, closed)
        cells = (
            along / pass_["along"] * surface["cells"],
            around / pass_["across"] * surface["cells_round"] / load.shape[2],
        )
        result.append(Width(total, along, around, min(cells)))
    return result


def _of_facets(packed: Packed, pass_: Row, load: Array) -> Width:
    """Return the width of the patch of facets with loads of their points, measured on the rods that they touch."""
    first, loads = int(pass_["first_point"]), load.ravel()
    pressed = np.flatnonzero(loads)
    starts, loads = packed.starts[first + pressed], loads[pressed]
    elements = packed.elements[starts["element"]]
    masters = packed.surfaces[elements["surface"]]
    lengths = elements["end"] - elements["begin"]
    places = elements["begin"] + 0.5 * (starts["s"] + 1.0) * lengths

    def mean(values: Array, groups: Array) -> Array:
        """Return at each point the mean of values over its group, weighted by loads."""
        number = np.unique(groups, return_inverse=True)[1]
        real, imaginary, total = (
            np.bincount(number, weights) for weights in (loads * values.real, loads * values.imag, loads)
        )
        return np.asarray((real + 1j * imaginary)[number] / total[number])

    spread = mean((places - mean(places, elements["surface"]).real) ** 2, elements["surface"]).real
    turned = np.abs(mean(np.exp(1j * starts["theta"]), starts["element"]))
    # The second moment of an even load of width w is w^2 / 12.
    along = np.sqrt(12.0 * spread)
    around = elements["radius"] * np.where(turned < _ROUND, np.inf, np.sqrt(24.0 * (1.0 - np.minimum(turned, 1.0))))
    slave = packed.surfaces[pass_["slave"]]
    facets = packed.elements[slave["first_element"] + pressed // int(pass_["along"])]
    longest, widest, whole = _extents(packed, slave, facets, starts["element"], first + pressed)
    along[along > _WHOLE * whole] = np.inf
    # Points along a side; nodes of the facets, and functions of the rods.
    points, nodes = np.sqrt(_IN_PARTS[int(slave["functions"])] * load.shape[1]), _DEGREES[int(slave["functions"])]
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
    """Return the extents of facets along the axes of the elements that their points touch, and across, ``(m,)``.

    Then the extent of all facets of the ``slave`` along the mean of these axes.
    """
    masters = packed.elements[touched]
    surfaces, row = packed.surfaces[masters["surface"]], np.arange(touched.size)
    ends = [masters["layers"][:, 0], masters["layers"][row, surfaces["functions"] - 1]]
    # The centre of a layer is the mean of two control points that are opposite each other, or nearly.
    first, last = (packed.before[layer] + packed.before[layer + surfaces["around"] // 2] for layer in ends)
    axis = (last - first) / np.linalg.norm(last - first, axis=1)[:, None]
    corners = packed.before[facets["layers"][:, : 4 if slave["functions"] in SQUARES else 3]]
    across = np.cross(packed.states["normal"][points], axis)
    longest, widest = (np.ptp(np.einsum("mca,ma->mc", corners, direction), axis=1) for direction in (axis, across))
    rows = packed.elements[slave["first_element"] :][: slave["elements"]]
    every = packed.before[rows["layers"][:, : slave["functions"]]]
    return longest, widest, float(np.ptp(every @ axis.mean(axis=0)))


def _mean(loads: Array, cyclic: bool) -> float:
    """Return the mean length of runs of points that carry loads, weighted by these."""
    carries = loads > 0.0
    return float(loads[carries] @ _runs(carries, cyclic)[carries] / loads.sum())


def _runs(active: NDArray[np.bool_], cyclic: bool) -> Array:
    """Return the length of the run of True in which an entry lies, infinite where all are True; 0 if False."""
    count = active.shape[1]
    wide = np.tile(active, (1, 3)) if cyclic else active
    edge = np.zeros((wide.shape[0], 1), dtype=bool)
    wide = np.concatenate([edge, wide, edge], axis=1)
    place = np.arange(wide.shape[1])
    before = np.maximum.accumulate(np.where(wide, 0, place), axis=1)
    after = np.minimum.accumulate(np.where(wide, place[-1], place)[:, ::-1], axis=1)[:, ::-1]
    lengths = np.where(wide, after - before - 1, 0)[:, 1:-1]
    own = lengths[:, count : 2 * count] if cyclic else lengths
    # A contact all round has no width.
    return np.where(own >= count, np.inf, own)


def carrying(patches: Sequence[Width]) -> list[int]:
    """Return the passes that carry most of a contact."""
    most = max((patch.load for patch in patches), default=0.0)
    return [k for k, patch in enumerate(patches) if patch.load > _LITTLE * most]


def across(packed: Packed, chosen: Sequence[int]) -> tuple[float, float]:
    """Return the width of the patch of some passes in points and in cells, the least; 0 where it has none."""
    patches = widths(packed)
    own = [chosen[k] for k in carrying([patches[k] for k in chosen])]
    if not own:
        return 0.0, 0.0
    points, cells = min(min(patches[k].along, patches[k].around) for k in own), min(patches[k].cells for k in own)
    return (points, cells) if np.isfinite(points) else (0.0, 0.0)


def more(
    packed: Packed, chosen: Sequence[int], points: Sequence[tuple[int, int]], between: bool
) -> dict[int, tuple[int, int]]:
    """Return increased points of passes, of an arc and of an element, whose patch has too few; others are left out.

    With ``between`` they are doubled where nothing touches but might between two points.
    """
    patches, changed = widths(packed), {}
    own = [chosen[k] for k in carrying([patches[k] for k in chosen])]
    for k in own or [k for k in chosen if between and _is_near(packed, k)]:
        old = points[k]
        seen = (patches[k].around, patches[k].along) if own else (TARGET / 2, TARGET / 2)
        new = [
            # The small number keeps round-off from adding a point.
            min(MAX_POINTS, int(np.ceil(count * TARGET / width - 1e-9))) if width < FEWEST else count
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
    """Whether a surface of the curvature of a pass' slave could touch between two of its points."""
    pass_ = packed.passes[k]
    slave = packed.surfaces[pass_["slave"]]
    curved = packed.surfaces[pass_["master"]] if is_facets(slave) else slave
    elements = packed.elements[curved["first_element"] :][: curved["elements"]]
    radius = float(elements["radius"].max())
    lengths = elements["end"] - elements["begin"]
    count = slave["elements"] * pass_["along"] * slave["around"] * pass_["across"]
    apart = max(float(lengths.max()) / pass_["along"], 2.0 * np.pi * radius / (slave["fine"] * pass_["across"]))
    if is_facets(slave):
        apart = float(np.sqrt(packed.areas[pass_["first_point"] :][:count].max()))
    gaps = packed.states["gap"][pass_["first_point"] :][:count]
    return bool((gaps < 0.5 * apart**2 / radius).any())
