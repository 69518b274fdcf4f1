"""End faces of rods that are welded: moments of functions, so that stresses linear across the section pass exactly.

Of such stresses the elements of a rod put forces on the nodes of its face that are moments of the functions by the
elements' own rule.  A projection makes of the slave's forces those of the master by another rule, which for functions
of high order is not the same: its rows are corrected by the least change, in L2, of the slave that does so.  Area and
second moments by both rules may differ, too: the force and the moment are then what both have in common.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from isorod.arrays import Array, Index
from isorod.space.space import Space
from isorod.space.trace import Trace, end_trace

# Faces are one and the same, and moments are nothing, to this share.
_SAME, _NOTHING = 1e-6, 1e-9

# Points, so many times as close as those of a full rule, that measure an area to the former.
_CLOSE = 4


class Moments(NamedTuple):
    """Integrals of a rod's functions over its face times linear fields, layer by layer.

    Attributes
    ----------
    fields : (nodes, 4)
        Coefficients of 1 and of the coordinates from an origin, in sizes.
    values : (nodes, 4 layers)
        The integrals.
    """

    fields: Array
    values: Array

    @property
    def resultants(self) -> Array:
        """Moments of area ``(4, 4 layers)``."""
        return np.asarray(self.fields.T @ self.values)


class Passed(NamedTuple):
    """What tractions that are linear on the slave's face do to both sides.

    Attributes
    ----------
    slave : (s, k)
        Forces on the slave's nodes.
    master : (nodes, k)
        Forces on all nodes, of the same resultants.
    shown : (s, s)
        What is added to the slave's mass on its face so that its forces are those of the tractions.
    """

    slave: Array
    master: Array
    shown: Array

    def corrected(self, rows: csr_array, mass: Array) -> csr_array:
        """Return the slave's rows ``(s, nodes)``, of a ``mass`` ``(s, s)``, that pass these tractions."""
        lifted = np.linalg.solve(mass, self.slave)
        rest = self.master.T - self.slave.T @ rows
        columns = np.flatnonzero(np.abs(rest).max(axis=0))
        change = lifted @ np.linalg.pinv(self.slave.T @ lifted, rcond=_NOTHING, hermitian=True) @ rest[:, columns]
        row = np.repeat(np.arange(rows.shape[0]), columns.size)
        return csr_array(rows + csr_array((change.ravel(), (row, np.tile(columns, len(change)))), shape=rows.shape))


def moments(space: Space, which: str, origin: Array, size: float, radii: Array) -> Moments:
    """Return the moments of a rod's functions on an end face by its elements' rule, in layers between ``radii``."""
    trace = end_trace(space, which, own=True)
    arms = space.positions - space.is_control_point[:, None] * origin
    fields = np.column_stack([space.is_control_point, arms / size])
    layer = np.searchsorted(radii, np.linalg.norm(space.section_rule(space.rule)[0], axis=1))
    nodes = trace.nodes[0]
    known = trace.weights[:, None] * (trace.values @ fields[nodes])
    values = np.zeros((space.nodes, 4 * (len(radii) + 1)))
    for k in range(len(radii) + 1):
        values[nodes, 4 * k : 4 * k + 4] = trace.values[layer == k].T @ known[layer == k]
    return Moments(fields, values)


def coincide(trace: Trace, gap: Array, size: float, slave: tuple[Space, str], master: tuple[Space, str]) -> bool:
    """Return whether two end faces are the same, of which one's points are so far from the other's body."""
    if gap.max() > _SAME * size:
        return False
    one, other = (end_trace(*face, finer=_CLOSE).weights.sum() for face in (slave, master))
    return bool(abs(one - other) < _SAME * other)


def shared_radii(slave: Space, master: Space) -> Array:
    """Return the radii at which both rods have a joint between layers, across which stresses may jump."""
    inner = np.array(slave.rod.rings[1:-1])
    return inner[[bool(np.isclose(master.rod.rings, radius).any()) for radius in inner]] if inner.size else inner


def same_resultants(values: Array, resultants: Array, wanted: Array) -> Array:
    """Return forces ``(n, k)`` of ``resultants`` ``(4, k)`` with linear ones among them added that make them others."""
    linear = values.reshape(len(values), -1, 4).sum(axis=1)
    gram = resultants.reshape(4, -1, 4).sum(axis=1)
    return np.asarray(values + linear @ np.linalg.pinv(gram, rcond=_NOTHING, hermitian=True) @ (wanted - resultants))


def passed(
    own: Moments, nodes: Index, trace: Trace, mine: csr_array, other: csr_array, master: tuple[int, Moments] | None
) -> Passed:
    """Return what linear tractions do to an end face and to what it is welded to.

    Parameters
    ----------
    own, nodes
        The slave's moments, and its nodes on the face.
    trace, mine, other
        Its face, and at its points the slave's functions of those nodes and the master's of all nodes.
    master
        Where the faces are the same, the master's first node and its moments.
    """
    moments = Moments(own.fields[nodes], own.values[nodes])
    fields = np.asarray(mine @ moments.fields)
    weighted = trace.weights[:, None] * fields
    if master is None:
        values, resultants = other.T @ weighted, fields.T @ weighted
    else:
        first, theirs = master
        values = np.zeros((other.shape[1], theirs.values.shape[1]))
        values[first : first + len(theirs.values)] = theirs.values
        resultants = theirs.resultants
    near = mine.T @ weighted
    linear = moments.values.reshape(len(nodes), -1, 4).sum(axis=1)
    inverse = np.linalg.pinv(fields.T @ weighted, rcond=_NOTHING, hermitian=True)
    return Passed(
        moments.values,
        same_resultants(values, resultants, moments.resultants),
        np.asarray((linear - near) @ inverse @ near.T),
    )
