"""Segments of the bodies' centre lines: which may touch, and for which contact is defined.

Self-contact is considered only between points at least pi times the radius apart along the axis: a rod bent as tightly
as possible touches itself there (its centre line's radius of curvature is then that of its section), and nearer points
are the neighbourhood of the point itself (compiled in `isorod.contact.search_kernel`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.model.contact import Contact
from isorod.model.tie import Tie

Mask = NDArray[np.bool_]


class Stretches(NamedTuple):
    """Segments of centre lines, ``m`` in all, each field of shape ``(m,)``.

    Attributes
    ----------
    body, element, u
        Numbers of body and element, and the axis parameter in the middle.
    begin, end, period
        Arc lengths from the start of the rod to both ends, and of a whole closed rod, of an open one infinity.
    radius
        Mean distance of the outline from the centre.
    """

    body: Index
    element: Index
    u: Array
    begin: Array
    end: Array
    period: Array
    radius: Array

    def may_touch(self, first: Index, second: Index) -> Mask:
        """Return whether pairs are of two bodies, or far enough apart along the axis of one."""
        begin, end = self.begin, self.end
        gap = np.maximum(begin[first], begin[second]) - np.minimum(end[first], end[second])
        back = self.period[first] - np.maximum(end[first], end[second]) + np.minimum(begin[first], begin[second])
        far = np.minimum(gap, back) >= np.pi * np.maximum(self.radius[first], self.radius[second])
        return far | (self.body[first] != self.body[second])

    def sides(self, contact: Contact) -> tuple[Index, Mask]:
        """Return the side of a contact that each one's body is on, -1 if none, and whether its element takes part."""
        side, part = np.full(self.body.size, -1), np.zeros(self.body.size, dtype=bool)
        for number, bodies in enumerate(contact.groups):
            side[np.isin(self.body, bodies)] = number
        for body, elements in contact.sides:
            mine = self.body == body
            part |= mine if elements is None else mine & np.isin(self.element, np.asarray(elements, dtype=np.int64))
        return side, part

    def declared(self, contacts: Sequence[Contact], first: Index, second: Index) -> tuple[Mask, Mask]:
        """Return whether contact is defined for each pair, and whether for their bodies but not their elements."""
        there, bodies = np.zeros(first.size, dtype=bool), np.zeros(first.size, dtype=bool)
        for contact in contacts:
            if contact.obstacle is None and contact.facets is None:
                side, part = self.sides(contact)
                one, other = side[first], side[second]
                between = (one >= 0) & (other >= 0) & ((one != other) | (contact.second is None))
                bodies |= between
                there |= between & part[first] & part[second]
        return there, bodies & ~there

    def tied(self, ties: Sequence[Tie], first: Index, second: Index) -> Mask:
        """Return whether ties weld the bodies of each pair together: a rod's end may then be within another rod."""
        welded = np.zeros(first.size, dtype=bool)
        for tie in ties:
            one, other = (getattr(side, "body", -1) for side in (tie.slave, tie.master))
            welded |= (self.body[first] == one) & (self.body[second] == other)
            welded |= (self.body[first] == other) & (self.body[second] == one)
        return welded
