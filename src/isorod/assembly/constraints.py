"""Linear constraints of ties: what each degree of freedom of a tied surface is made of.

Of a tie, ``integral of t_i (u_slave - u_master) = 0`` over the slave's surface, for the traces ``t_i`` of its own
functions that no support holds, is solved for the slave's coefficients (`isorod.model.tie.Tie`).
"""

from typing import NamedTuple, Protocol

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.sparse import csr_array, diags, vstack

from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.model.tie import EndFace, SolidSurface, Surface, Tie
from isorod.space.trace import Rows, Trace, end_trace, lateral_trace, rows_at

# Coefficients of this share of the largest are rounding: they decay exponentially along the surface.
_DROPPED = 1e-13

# The largest gap by default, in sizes of the slave.
_GAP = 0.1


class SolidBody(Protocol):
    """What constraints ask of a finite element body (`isorod.fenics.solid.Solid`)."""

    nodes: int

    def rows(self, points: Array, facets: Index | None = None) -> Rows:
        """Return its functions at points."""

    def trace(self, facets: Index | None) -> Trace:
        """Return its functions on facets."""


class Tied(NamedTuple):
    """A tie as it is on a model's nodes.

    Attributes
    ----------
    trace
        The slave's functions on its surface.
    slaves
        Degrees of freedom that the tie determines.
    jump : (q, nodes)
        The master's less the slave's functions at the points of the trace, on all nodes.
    gap
        Largest distance of the surfaces at rest.
    """

    trace: Trace
    slaves: Index
    jump: csr_array
    gap: float


class Constraints:
    """The ties of a model.

    Attributes
    ----------
    first_node
        First node of each rod, then of each solid, and their number.
    slaves : (s,)
        Degrees of freedom that ties determine, ascending.
    rows : (s, dofs)
        What they are of others, none of which is a slave.
    held, values : (dofs,)
        Whether a degree of freedom is held, and of solids where to at load factor 1.
    ranks_of_solids
        Rank of each degree of freedom of each solid.
    ties
        Each tie as it is on the nodes.

    Raises
    ------
    InputError
        If a tie's surfaces are apart, or supports hold all of it.
    """

    def __init__(self, model: Model) -> None:
        counts = [body.space.nodes for body in model.bodies] + [solid.nodes for solid in model.solids]
        self.first_node = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        self._model, self._nodes = model, int(self.first_node[-1])
        self.held = np.zeros(3 * self._nodes, dtype=bool)
        self.held[model.held] = True
        self.values = np.zeros(3 * self._nodes)
        self.ranks_of_solids = []
        for first, solid in zip(self.first_node[len(model.bodies) :], model.solids, strict=False):
            for dofs, values in solid.comm.allgather(solid.held):
                self.held[3 * first + dofs] = True
                self.values[3 * first + dofs] = values
            owned = [end - begin for begin, end in solid.comm.allgather(solid.owned)]
            self.ranks_of_solids.append(np.repeat(np.arange(len(owned)), 3 * np.array(owned)))
        self._taken = self.held.copy()
        self._taken[model.bound] = True
        self.ties: list[Tied] = []
        slaves, rows = [np.empty(0, dtype=np.int64)], []
        for k, tie in enumerate(model.ties):
            try:
                tied, row = self._tied(tie)
            except InputError as problem:
                raise InputError(f"tie {k}: {problem}") from None
            self.ties.append(tied)
            slaves.append(tied.slaves)
            rows.append(row)
        found = np.concatenate(slaves)
        order = np.argsort(found)
        self.slaves = found[order]
        stacked = vstack(rows, format="csr") if rows else csr_array((0, 3 * self._nodes))
        self.rows = self._resolved(csr_array(stacked)[order])

    def _first(self, surface: Surface) -> int:
        bodies = len(self._model.bodies)
        return int(self.first_node[bodies + surface.solid if isinstance(surface, SolidSurface) else surface.body])

    def _trace(self, surface: Surface) -> Trace:
        if isinstance(surface, SolidSurface):
            return self._model.solids[surface.solid].trace(surface.facets)
        space = self._model.bodies[surface.body].space
        if isinstance(surface, EndFace):
            return end_trace(space, surface.which)
        return lateral_trace(space, surface.along, surface.surface)

    def _rows(self, surface: Surface, points: Array) -> Rows:
        if isinstance(surface, SolidSurface):
            return self._model.solids[surface.solid].rows(points, surface.facets)
        return rows_at(self._model.bodies[surface.body].space, points)

    def _on_nodes(self, surface: Surface, nodes: Index, values: Array) -> csr_array:
        """Return functions of a body at points as a matrix ``(q, nodes)`` of all nodes."""
        points, functions = nodes.shape
        start = np.arange(points + 1) * functions
        columns = self._first(surface) + nodes.ravel()
        return csr_array((values.ravel(), columns, start), shape=(points, self._nodes))

    def _tied(self, tie: Tie) -> tuple[Tied, csr_array]:
        """Return a tie on the nodes, and its slaves in terms of other degrees of freedom."""
        trace = self._trace(tie.slave)
        near = self._rows(tie.master, trace.points)
        size = float(np.sqrt(trace.weights.sum() / np.pi))
        gap, most = float(near.gap.max()), _GAP * size if tie.gap is None else tie.gap
        if gap > most:
            where = ", ".join(f"{x:.4g}" for x in trace.points[np.argmax(near.gap)])
            raise InputError(
                f"the surfaces are {gap:.3g} apart at ({where}), more than {most:.3g}; move the bodies together, name "
                "other surfaces, or give a larger gap"
            )
        own = self._on_nodes(tie.slave, trace.nodes, trace.values)
        jump = csr_array(self._on_nodes(tie.master, near.nodes, near.values) - own)
        candidates = self._first(tie.slave) + trace.independent
        weights = csr_array(diags(trace.weights))
        slaves, rows, known = [], [], {}
        for a in range(3):
            mine = candidates[~self._taken[3 * candidates + a]]
            key = mine.tobytes()
            if mine.size and key not in known:
                known[key] = _projection(own, jump, mine, weights)
            if mine.size:
                slaves.append(3 * mine + a)
                rows.append(_of_component(known[key], a))
        if not slaves:
            raise InputError(f"supports or other ties hold all of the {tie.slave}; leave one of them out")
        found = np.concatenate(slaves)
        self._taken[found] = True
        return Tied(trace, found, jump, gap), csr_array(vstack(rows, format="csr"))

    def _resolved(self, rows: csr_array) -> csr_array:
        """Return the slaves' rows with slaves of other ties replaced by what these are of others."""
        for _ in range(len(self.ties) + 1):
            inner = csr_array(rows[:, self.slaves])
            if not inner.nnz:
                return rows
            keep = np.ones(rows.shape[1])
            keep[self.slaves] = 0.0
            rows = csr_array(rows @ csr_array(diags(keep)) + inner @ rows)
            rows.eliminate_zeros()
        raise InputError("ties: they go round in a circle, each slave the master of another; turn one round")


def _projection(own: csr_array, jump: csr_array, mine: Index, weights: csr_array) -> csr_array:
    """Return the coefficients of some of the slave's nodes in terms of all nodes ``(m, nodes)``."""
    traces = own[:, mine]
    left = (traces.T @ weights @ traces).toarray()
    # What is left when the functions that are solved for are taken out of the jump.
    drop = np.ones(jump.shape[1])
    drop[mine] = 0.0
    right = csr_array(traces.T @ weights @ jump @ csr_array(diags(drop)))
    columns = np.unique(right.indices)
    scale = 1.0 / np.sqrt(np.diag(left))
    try:
        factor = cho_factor(left * scale * scale[:, None])
    except LinAlgError:
        raise InputError(
            "the slave's functions are not independent on its surface; take the whole surface, or the other as slave"
        ) from None
    found = scale[:, None] * cho_solve(factor, scale[:, None] * right[:, columns].toarray())
    found[np.abs(found) < _DROPPED * np.abs(found).max(initial=0.0)] = 0.0
    small = csr_array(found)
    return csr_array((small.data, columns[small.indices], small.indptr), shape=(mine.size, jump.shape[1]))


def _of_component(rows: csr_array, a: int) -> csr_array:
    """Return rows on nodes as rows on degrees of freedom, of one component."""
    return csr_array((rows.data, 3 * rows.indices + a, rows.indptr), shape=(rows.shape[0], 3 * rows.shape[1]))
