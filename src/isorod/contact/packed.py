"""All contacts of a model as compiled loops take them: tables with named fields, and the state between calls.

A contact has one or more passes.  In each the points of one surface, the slave, are checked against a rigid obstacle,
or against the nearest of some surfaces, the masters, which may be the slave itself.  There may be any number of
surfaces, each the slave of one pass or of none, and a master of any number of passes.

Self-contact is considered only between points at least pi times the radius apart along the axis: a rod bent as tightly
as possible, whose centre line turns with the radius of its section, touches itself there; nearer points are the point's
own neighbourhood.

State that `isorod.contact.force_kernel.add_forces` leaves in a `Packed` for later calls and for the caller:

- ``starts``: the projection of each point.  The next search begins there, which decides where a point has two closest
  points.  It is the only history, and a checkpoint of a motion keeps it.
- ``before``, ``travel``, ``clear``, ``near``, ``counts``, ``listed``: how far the rods have moved, until when a point
  needs no search, and which elements are near which.  They save time and change no result (see
  `isorod.contact.search_kernel`).
- ``states``, ``points``: the result of the call, to be read before the next one; points that need no search have the
  position of their last search.
- ``boxes``, ``rings``: work space.

Each rank computes its ``own`` points, and leaves the others unchanged.

``multipliers`` are the caller's (`isorod.contact.operator.ContactOperator.augment`).  `Packed.forget` makes the next
call independent of all earlier ones.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import b1, from_dtype, types
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, F3, I1, I2
from isorod.geometry.axis import MAX_DEGREE
from isorod.geometry.disk import MAX_COUNT

# Kinds of obstacles, which a pass has in place of a master surface.
PLANE, CYLINDER, SPHERE, MESH = -1, -2, -3, -4

# Capacity of an element's list of near elements; where there are more, all are searched.
NEAR = 96

# Capacity of functions of an element: ``l``, along an axis, or of a facet of a finite element body of third degree.
FUNCTIONS = max(MAX_DEGREE + 1, 10)

# A table of rows with named fields, and one of its rows.
Table = NDArray[Any]
Row = Any

# A surface: its body, control points round its section, axis functions of an element, its elements, whether bodies (not
# only obstacles) touch it, the number of equal fine arcs round its section, each a part of an arc, and the cells along
# an element and round the section (`isorod.contact.cells`); the middle angle of the first fine arc, the length of the
# axis where that is closed, else infinity, and for an inner surface, whose angles are counted backwards, how deep a
# point may be in the wall, else 0; the arc of each fine arc; and of each arc its middle angle, ``cos``, ``cos / sin^2``
# and ``1 / sin`` of its half, the weight of the control point before at its beginning and of the control point after at
# its end, and its fraction of the circle.  Facets of a finite element body are a surface whose elements are facets,
# with one control point round the section.
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
# rod, the arc length at its ends, the largest distance of its surface from the axis, and the largest distance of a
# point of the surface from its nearest rung; the first of its rungs, and their number; axis parameters of both ends.
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
# the first of its rows in `Packed.nodes`; the first of its points; points round an arc and along an element; its first
# rows in `Packed.around` and `Packed.along`; penalty, force per volume; of an obstacle a point, the unit normal or
# axis, and the radius; its rotation ``R``, and the centre of rotation; point, direction and centre of rotation at rest,
# the unit axis of rotation, and its first row in `Packed.tracks` and the number of these, zero where it does not move.
# The point of a mesh is its origin.
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
# The fields that hold the present placement of an obstacle.
PLACED = ("point", "direction", "frame", "pivot")

# A box in the tree of a rigid mesh: lower and upper corner; ``count`` triangles from ``first`` on, or, if ``count`` is
# 0, two boxes: the next row and row ``first``.
NODE = np.dtype([("low", np.float64, 3), ("high", np.float64, 3), ("first", np.int64), ("count", np.int64)])

# Control points of a surface whose space has none there (`isorod.contact.traces`), and the model's nodes that they
# depend on: the first of both, layers, control points and functions of a layer, and the first of the values in
# `Packed.matrices`.
LIFT = np.dtype(
    [(name, np.int64) for name in ("first_point", "first_node", "layers", "around", "functions", "first_value")]
)

# Where a search starts: element (-1: none yet), angle, and ``s``.
START = np.dtype([("element", np.int64), ("theta", np.float64), ("s", np.float64)])
NOWHERE = np.array((-1, 0.0, 0.0), START)

# The result of a call at a point: gap (NaN where no projection was needed), pressure, where that is positive the unit
# normal in which it acts, and whether the closest point is on a knot with a kink.
STATE = np.dtype(
    [("gap", np.float64), ("pressure", np.float64), ("normal", np.float64, 3), ("edge", np.bool_)], align=True
)

# Friction at a point: element (0 of an obstacle, -1: no anchor), angle and ``s`` of its anchor, or the anchor's
# position on an obstacle at rest, and the last traction.
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
        The three section functions ``Phi`` at the points of each arc ``(., 3)``, and the axis functions ``R`` at the
        points along the elements ``(., l)``.
    fractions
        Position along its element of each row of ``along``, 0 to 1.
    rungs
        The ``R`` at sections evenly along the elements, at which searches start, ``(., l)``.
    areas
        Reference areas of the points, halved where both surfaces are slaves in turn, ``(Q,)``.
    corners, normals, nodes
        Corners of the triangles of all rigid meshes, counterclockwise seen from outside, ``(T, 3, 3)``, and normals
        of the faces, of the edges from each corner to the next, and of the corners, ``(T, 7, 3)``; rows of `NODE`.
    lifts, matrices
        Rows of `LIFT`, and the matrices from a layer's coefficients to control points, row by row, ``(.,)``.
    tracks
        How obstacles move (`isorod.model.moving.ObstacleMotion.track`), ``(., 5)``.
    control_points
        Control points of all surfaces: nodes of the model, then those of ``lifts``.
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
        Centre of the section at each of ``rungs``, and the radius of a ball that holds all points of the surface
        nearer to it than to other centres, ``(., 4)``.
    near, counts, listed
        Elements whose boxes were within a margin of an element's when the lists were made, ``(E, NEAR)``, their number
        ``(E,)`` (above `NEAR` the list is incomplete), and that margin and the ``travel`` then, ``(2,)``.
    own
        Whether a point is this rank's, ``(Q,)``; all points of an element belong to one rank.
    """

    surfaces: Table
    elements: Table
    passes: Table
    around: Array
    along: Array
    fractions: Array
    rungs: Array
    areas: Array
    corners: Array
    normals: Array
    nodes: Table
    lifts: Table
    matrices: Array
    tracks: Array
    control_points: Index
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
        """The tables that no call changes."""
        passes = self.passes.copy()
        for name in PLACED:
            passes[name] = 0.0
        tables = self.surfaces, self.elements, passes, self.around, self.along, self.fractions, self.rungs, self.areas
        return *tables, self.corners, self.normals, self.nodes, self.lifts, self.matrices, self.tracks

    def passes_of(self, points: Index) -> Index:
        """Return the pass of each of some points."""
        return np.searchsorted(self.passes["first_point"], points, side="right") - 1

    def forget(self) -> None:
        """Drop the history; points known to be far are still not searched."""
        self.starts[:] = NOWHERE

    def look_everywhere(self) -> None:
        """Make the next call search all points, also those known to be far."""
        self.clear[:] = -np.inf


class Friction(NamedTuple):
    """Friction of all contacts of a model, for the ``Q`` slave points of its `Packed`.

    Attributes
    ----------
    coefficients
        Of each pass.
    anchors
        Rows of `ANCHOR`, ``(Q,)``: the only history.
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
        """Return the tables for the coefficients of passes with so many points, without history."""
        vectors, flags = np.zeros((points, 3)), np.zeros(points, dtype=bool)
        return cls(coefficients, np.full(points, NO_ANCHOR), vectors, flags, np.zeros(1, START))


# Numba's types of rows, and of all tables.
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
    """Points, multipliers and penalties at the end of a solution.

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
