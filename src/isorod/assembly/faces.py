"""Welded end faces of rods: moments of functions, so that stresses linear across the section are transmitted exactly.

Under such stresses the nodal forces on a rod's face are moments of its functions by the elements' own rule.  The
projection turns the slave's forces into the master's by another rule, which differs for functions of high order: its
rows are corrected by the smallest change of the slave in L2.  Area and second moments by both rules may differ, too:
force and moment are then the same on both sides.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from isorod.arrays import Array, Index
from isorod.space.space import Space
from isorod.space.trace import Trace, end_trace

# Relative tolerances: of coinciding faces, and of vanishing moments.
_SAME, _NOTHING = 1e-6, 1e-9

# Refinement of a full rule that measures areas to the first of these.
_CLOSE = 4


class Moments(NamedTuple):
    """Integrals of a rod's functions over its face times linear fields, layer by layer.

    Attributes
    ----------
    fields : (nodes, 4)
        Coefficients of 1 and of the coordinates from an origin, scaled by a size.
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
    """Forces on both sides of tractions that are linear on the slave's face.

    Attributes
    ----------
    slave : (s, k)
        Forces on the slave's nodes.
    master : (nodes, k)
        Forces on all nodes with the same resultants.
    shown : (s, s)
        Correction of the slave's mass on its face by which its forces are those of the tractions.
    """

    slave: Array
    master: Array
    shown: Array

    def corrected(self, rows: csr_array, mass: Array) -> csr_array:
        """Return the slave's rows ``(s, nodes)``, corrected to transmit these tractions; ``mass`` is ``(s, s)``."""
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
    """Return whether two end faces coincide, given the gaps of the slave's points to the master's body."""
    if gap.max() > _SAME * size:
        return False
    one, other = (end_trace(*face, finer=_CLOSE).weights.sum() for face in (slave, master))
    return bool(abs(one - other) < _SAME * other)


def common_radii(slave: Space, master: Space) -> Array:
    """Return the radii at which both rods have a boundary between rings, where stresses may jump."""
    inner = np.array(slave.rod.rings[1:-1])
    return inner[[bool(np.isclose(master.rod.rings, radius).any()) for radius in inner]] if inner.size else inner


def same_resultants(values: Array, resultants: Array, targets: Array) -> Array:
    """Return forces ``(n, k)`` corrected by linear ones, so that ``resultants`` ``(4, k)`` become the targets."""
    linear = values.reshape(len(values), -1, 4).sum(axis=1)
    gram = resultants.reshape(4, -1, 4).sum(axis=1)
    return np.asarray(values + linear @ np.linalg.pinv(gram, rcond=_NOTHING, hermitian=True) @ (targets - resultants))


def passed(
    own: Moments, nodes: Index, trace: Trace, mine: csr_array, other: csr_array, master: tuple[int, Moments] | None
) -> Passed:
    """Return the forces of linear tractions on an end face and on the surface it is welded to.

    Parameters
    ----------
    own, nodes
        The slave's moments, and its nodes on the face.
    trace, mine, other
        Its face, and at its points the slave's functions of those nodes and the master's functions of all nodes.
    master
        If the faces coincide, the master's first node and its moments.
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
