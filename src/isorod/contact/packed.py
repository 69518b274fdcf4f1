"""All contacts of a model as compiled loops take them: tables with named fields, and what calls leave behind.

A contact is a number of passes, in each of which the points of one surface, the slave, are held against a rigid
obstacle, or against the nearest of some surfaces, the masters, which may be the slave itself.  There may be any number
of surfaces, each the slave of one pass, or of none, and a master of any number of passes.

Of its own body a point meets only what is at least half a turn of its radius away along the axis: a rod that is bent
as tightly as it can, with no radius left inside, has touched itself there (its centre line then turns with the radius
of its section), and what is nearer is the point's own neighbourhood.

What `isorod.contact.force_kernel.add_forces` leaves in a `Packed` for later calls and for the caller:

- ``starts``: where each point was projected to.  Next time the search begins there, and where a point has two nearest
  points this decides: it is history, all that there is, and what a checkpoint of a motion keeps.
- ``before``, ``travel``, ``clear``, ``near``, ``counts``, ``listed``: how far the rods have gone, until when a point
  needs no search, and which elements are near which.  They save time and change no result (see
  `isorod.contact.search_kernel`).
- ``states``, ``points``: the outcome of the call, to be read before the next one; of points that need no search, places
  where they were sought last.
- ``boxes``, ``rings``: work space.

Of several ranks each looks at its ``own`` points, and leaves the others' as they are.

``multipliers`` are the caller's (`isorod.contact.operator.ContactOperator.augment`).  `Packed.forget` makes the next
call independent of all that went before.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import b1, from_dtype, types
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, F3, I1, I2
from isorod.geometry.axis import MAX_DEGREE
from isorod.geometry.disk import MAX_COUNT

# What a pass has in the place of a master surface.
PLANE, CYLINDER, SPHERE, MESH = -1, -2, -3, -4

# Elements near an element that there is room for in its list; where there are more, all are looked at.
NEAR = 96

# Functions that an element has room for: ``l``, along an axis, or of a facet of a finite element body of third degree.
FUNCTIONS = max(MAX_DEGREE + 1, 10)

# A table of rows with named fields, and one of its rows.
Table = NDArray[Any]
Row = Any

# A surface: its body, control points round its section, axis functions of an element, its elements, whether others than
# obstacles touch it, the number of equal fine arcs round its section, of which each arc has some, and the cells along
# an element and round the section (`isorod.contact.cells`); the angle of the middle of the first of these, the length
# of the whole axis where that is closed, else infinity, and of an inner surface, whose angles are counted backwards,
# how deep beyond it a point may be in the wall, else 0; of each fine arc the arc; and of each arc its middle angle, of
# the half of it ``cos``, ``cos / sin^2`` and ``1 / sin``, the shares of the control point before at its beginning and
# of that after at its end, and its part of the circle.  Facets of a finite element body are a surface whose elements
# are facets, with one control point round the section.
SURFACE = np.dtype(
    [
        *((name, np.int64) for name in ("body", "around", "functions", "first_element", "elements", "sought")),
        *((name, np.int64) for name in ("fine", "cells", "cells_round")),
        *((name, np.float64) for name in ("turn", "period", "deep")),
        ("arc_of", np.int64, MAX_COUNT),
        ("arcs", np.float64, (MAX_COUNT, 7)),
    ]
)

# An element of a surface's axis: its surface, the node (of the model) at which each layer begins, the weighted axis
# functions in powers of ``s`` in [-1, 1], the elements before and after, -1 at an end of the surface; of the undeformed
# rod, how far along the axis it begins and ends, the largest distance of its surface from the axis, and how far what
# belongs to one of its rungs may be from that; the first of its rungs, and their number; axis parameters of both ends.
ELEMENT = np.dtype(
    [
        ("surface", np.int64),
        ("layers", np.int64, FUNCTIONS),
        ("polynomials", np.float64, (FUNCTIONS, FUNCTIONS)),
        ("neighbours", np.int64, 2),
        ("begin", np.float64),
        ("end", np.float64),
        ("radius", np.float64),
        ("reach", np.float64),
        ("first_rung", np.int64),
        ("rungs", np.int64),
        ("u", np.float64, 2),
    ]
)

# A pass: slave surface; first of its master surfaces, and their number, or an obstacle's kind, and where it is a mesh
# the first of its rows in `Packed.nodes`; the first of its points;
# points round an arc and along an element; its first rows in `Packed.around` and `Packed.along`; force per volume; of
# an obstacle a point, the unit normal or axis, and the radius; how it is turned, ``R``, and the point that it turns
# about; point, direction and that at rest, its unit axis, and its first row in `Packed.tracks` and the number of these,
# none where it stands.  A mesh has its origin for its point.
PASS = np.dtype(
    [
        *((name, np.int64) for name in ("slave", "master", "masters", "first_point", "across", "along")),
        *((name, np.int64) for name in ("first_around", "first_along")),
        ("penalty", np.float64),
        ("point", np.float64, 3),
        ("direction", np.float64, 3),
        ("radius", np.float64),
        ("frame", np.float64, (3, 3)),
        *((name, np.float64, 3) for name in ("pivot", "home", "homeward", "center", "spin")),
        *((name, np.int64) for name in ("first_track", "tracks")),
    ]
)
# Of these, what says where an obstacle is now.
PLACED = ("point", "direction", "frame", "pivot")

# A box in the tree of a rigid mesh: lower and upper corner; ``count`` triangles from ``first`` on, or, if there are
# none, two boxes: the next row and row ``first``.
NODE = np.dtype([("low", np.float64, 3), ("high", np.float64, 3), ("first", np.int64), ("count", np.int64)])

# Control points of a surface whose space has none there (`isorod.contact.traces`), and the model's nodes they are of:
# the first ones, layers, control points and functions of a layer, and the first of its values in `Packed.matrices`.
LIFT = np.dtype(
    [(name, np.int64) for name in ("first_point", "first_node", "layers", "around", "functions", "first_value")]
)

# Where a search starts: element (-1: nowhere yet), angle, and ``s``.
START = np.dtype([("element", np.int64), ("theta", np.float64), ("s", np.float64)])
NOWHERE = np.array((-1, 0.0, 0.0), START)

# The result of a call at a point: gap (NaN where no projection was needed), pressure, where that is positive the unit
# normal along which it acts, and whether the closest point is on a knot with a kink.
STATE = np.dtype(
    [("gap", np.float64), ("pressure", np.float64), ("normal", np.float64, 3), ("edge", np.bool_)], align=True
)

# Friction at a point: element (0 of an obstacle, -1: no anchor), angle and ``s`` of its anchor, or the anchor's place
# on an obstacle, as that is at rest, and the traction it had.
ANCHOR = np.dtype(
    [
        ("element", np.int64),
        ("theta", np.float64),
        ("s", np.float64),
        ("place", np.float64, 3),
        ("traction", np.float64, 3),
    ]
)
NO_ANCHOR = np.array((-1, 0.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), ANCHOR)


class Packed(NamedTuple):
    """All contacts of a model; made by `isorod.contact.tables.pack`, for ``Q`` slave points in all.

    Attributes
    ----------
    surfaces, elements, passes
        Rows of `SURFACE`, of `ELEMENT` (those of all surfaces), and of `PASS`.
    around, along
        The three ``Phi`` at the points of each arc ``(., 3)``, and the ``R`` at the points along the elements
        ``(., l)``.
    shares
        Where along its element each row of ``along`` is, 0 to 1.
    rungs
        The ``R`` at sections evenly along the elements, at which searches start, ``(., l)``.
    areas
        Reference areas of the points, halved where both surfaces are slaves in turn, ``(Q,)``.
    corners, normals, nodes
        Of the triangles of all rigid meshes the corners, counterclockwise seen from outside, ``(T, 3, 3)``, and normals
        of the face, of the edges from each corner to the next, and of the corners, ``(T, 7, 3)``; rows of `NODE`.
    lifts, matrices
        Rows of `LIFT`, and what makes control points of a layer's coefficients, row by row, ``(.,)``.
    tracks
        How obstacles move (`isorod.model.moving.ObstacleMotion.track`), ``(., 5)``.
    carriers
        Control points of all surfaces: nodes of the model, and behind these those of ``lifts``.
    multipliers
        Pressures of the augmented Lagrangian, zero for a plain penalty, ``(Q,)``.
    states, points
        Rows of `STATE`, and positions of the slave points, ``(Q, 3)``.
    starts
        Rows of `START`, ``(Q,)``.
    before, travel, clear
        Positions of all these nodes in the last call, ``(nodes, 3)``; the sum of the longest distance that any control
        point has moved in each call, ``(1,)``; the ``travel`` up to which a point needs no search, ``(Q,)``.
    boxes
        Lower and upper corners of the elements, ``(E, 2, 3)``.
    rings
        Centre of the section at each of ``rungs``, and the radius of a ball that holds what is nearer to it than to
        others, ``(., 4)``.
    near, counts, listed
        Elements whose boxes were no farther than a margin from an element's, when the lists were made, ``(E, NEAR)``,
        their number ``(E,)`` (more than `NEAR`: not all are in the list), and the margin and the ``travel`` of then,
        ``(2,)``.
    own
        Whether this rank looks at a point, ``(Q,)``; an element's points are those of one rank.
    """

    surfaces: Table
    elements: Table
    passes: Table
    around: Array
    along: Array
    shares: Array
    rungs: Array
    areas: Array
    corners: Array
    normals: Array
    nodes: Table
    lifts: Table
    matrices: Array
    tracks: Array
    carriers: Index
    multipliers: Array
    states: Table
    points: Array
    starts: Table
    before: Array
    travel: Array
    clear: Array
    boxes: Array
    rings: Array
    near: Index
    counts: Index
    listed: Array
    own: NDArray[np.bool_]

    @property
    def fixed(self) -> tuple[Array | Table, ...]:
        """What no call changes."""
        passes = self.passes.copy()
        for name in PLACED:
            passes[name] = 0.0
        tables = self.surfaces, self.elements, passes, self.around, self.along, self.shares, self.rungs, self.areas
        return *tables, self.corners, self.normals, self.nodes, self.lifts, self.matrices, self.tracks

    def passes_of(self, points: Index) -> Index:
        """Return the pass of each of some points."""
        return np.searchsorted(self.passes["first_point"], points, side="right") - 1

    def forget(self) -> None:
        """Make the next call one without history; what is known to be far is still left out."""
        self.starts[:] = NOWHERE

    def look_everywhere(self) -> None:
        """Make the next call place and search all points, those too that are known to be far."""
        self.clear[:] = -np.inf


class Friction(NamedTuple):
    """Friction of all contacts of a model, for the ``Q`` slave points of its `Packed`.

    Attributes
    ----------
    coefficients
        Of each pass.
    anchors
        Rows of `ANCHOR`, ``(Q,)``: the history, all that there is.
    tractions, slipping
        Results of the last call: tractions on the points, ``(Q, 3)``, and which slip.
    start
        Work space, one row of `START`.
    """

    coefficients: Array
    anchors: Table
    tractions: Array
    slipping: Table
    start: Table

    @classmethod
    def of(cls, coefficients: Array, points: int) -> "Friction":
        """Return that of some passes with so many points, without history."""
        vectors, flags = np.zeros((points, 3)), np.zeros(points, dtype=bool)
        return cls(coefficients, np.full(points, NO_ANCHOR), vectors, flags, np.zeros(1, START))


# Numba's types of rows, and of the whole.
SURFACE_ROW, ELEMENT_ROW, PASS_ROW, START_ROW, STATE_ROW = map(from_dtype, (SURFACE, ELEMENT, PASS, START, STATE))
NODE_ROW, _LIFT_ROW = from_dtype(NODE), from_dtype(LIFT)
SURFACES, ELEMENTS, PASSES, STARTS, STATES, NODES, _LIFTS = (
    types.Array(row, 1, "C") for row in (SURFACE_ROW, ELEMENT_ROW, PASS_ROW, START_ROW, STATE_ROW, NODE_ROW, _LIFT_ROW)
)
_FIXED = (SURFACES, ELEMENTS, PASSES, F2, F2, F1, F2, F1, F3, F3, NODES, _LIFTS, F1, F2, I1)
_LEFT = (F1, STATES, F2, STARTS, F2, F1, F1, F3, F2, I2, I1, F1, types.Array(b1, 1, "C"))
PACKED = types.NamedTuple(_FIXED + _LEFT, Packed)
ANCHOR_ROW = from_dtype(ANCHOR)
ANCHORS = types.Array(ANCHOR_ROW, 1, "C")
FRICTION = types.NamedTuple((F1, ANCHORS, F2, types.Array(b1, 1, "C"), STARTS), Friction)


class Settled(NamedTuple):
    """What Uzawa's updates and finer points have left.

    Attributes
    ----------
    points
        Points round an arc and along an element, of each pass.
    multipliers : (Q,)
        Those of the points.
    penalties : (passes,)
        Those of the passes.
    """

    points: list[tuple[int, int]]
    multipliers: Array
    penalties: Array
