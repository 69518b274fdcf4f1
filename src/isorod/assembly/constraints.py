"""Linear constraints of ties and mean supports: slave degrees of freedom in terms of others.

Of a tie, ``integral of t_i (u_slave - u_master) = 0`` over the slave's surface, for the traces ``t_i`` of its own
functions that no support holds, is solved for the slave's coefficients (`isorod.model.tie.Tie`).  So are the mean
motions that are held (`isorod.model.mean.MeanSupport`).
"""

from collections.abc import Sequence
from graphlib import CycleError, TopologicalSorter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.sparse import block_diag, csr_array, diags, hstack, vstack

from isorod.arrays import Array, Index
from isorod.assembly import faces
from isorod.assembly.averages import apart, mean_of
from isorod.assembly.bonds import Bond
from isorod.assembly.faces import Passed
from isorod.assembly.multipliers import (
    Multipliers,
    of_component,
    passed_on_along,
    passed_on_near,
    projection,
    tested,
)
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.model.tie import EndFace, LateralSurface, SolidSurface, Surface, Tie
from isorod.space.trace import Mask, Rows, Trace, breaks_on, end_trace, lateral_trace, rows_at, touching

# Pivots of the multipliers' matrix below this fraction of the largest count as zero: their slaves are dropped.
_DEPENDENT = 1e-8

# At least so many points of the slave for each node of a solid that is the master, and the largest refinement of the
# points for that.
_TO_A_NODE, _FINEST = 6, 8

# The largest gap by default, in sizes of the slave.
_GAP = 0.1

# Up to which distance surfaces touch, in sizes of the slave's section: outlines are fitted to half of that.
_TOUCH = 0.01


class Tied(NamedTuple):
    """A tie in terms of a model's nodes.

    Attributes
    ----------
    trace
        The slave's functions on its surface.
    slaves, rows
        Degrees of freedom that the tie determines, ``(s,)``, and their coefficients in terms of others, which may be
        slaves of other ties, ``(s, dofs)``.
    own : (q, nodes)
        The slave's functions at the points of the trace, on all nodes.
    jump : (q, nodes)
        The master's functions less the slave's at the points of the trace, on all nodes.
    gap
        Largest distance of the surfaces at rest.
    bond
        The bond of a sliding tie, if it has one.
    multipliers
        Those of a weld, for each component.
    """

    trace: Trace
    slaves: Index
    rows: csr_array
    own: csr_array
    jump: csr_array
    gap: float
    bond: Bond | None
    multipliers: dict[int, Multipliers]


class Constraints:
    """The ties and mean supports of a model.

    Attributes
    ----------
    first_node
        First node of each rod, then of each solid, and their number.
    slaves : (s,)
        Degrees of freedom that ties determine, ascending.
    rows : (s, dofs)
        Their coefficients in terms of others, none of which is a slave.
    held, values : (dofs,)
        Whether a degree of freedom is held, and the prescribed displacements of solids at load factor 1.
    ranks_of_solids
        Rank of each degree of freedom of each solid.
    ties, order
        Each tie on the nodes, and an order in which no tie's slaves are masters of later ties.
    means
        Each mean support on the nodes, by its number.
    averaged, held_means
        The slaves of mean supports, and the numbers of those that are held, in the order of their motions.
    offsets : (s, h)
        Coefficients of the slaves in terms of the held mean motions.

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
        for k, tie in enumerate(model.ties):
            try:
                self.ties.append(self._tied(tie))
            except InputError as problem:
                raise InputError(f"tie {k}: {problem}") from None
        self.means = {k: mean_of(model, one) for k, one in model.means.items()}
        known = [(tied.slaves, tied.rows, np.zeros((tied.slaves.size, 0))) for tied in self.ties]
        sets = apart({k: one for k, one in self.means.items() if one.held})
        known += [self._averaged(several) for several in sets]
        slaves = np.concatenate([np.empty(0, dtype=np.int64), *(slaves for slaves, _, _ in known)])
        order = np.argsort(slaves)
        self.slaves = slaves[order]
        rows = csr_array(vstack([csr_array((0, 3 * self._nodes)), *(rows for _, rows, _ in known)], format="csr"))
        self.averaged = slaves[sum(tied.slaves.size for tied in self.ties) :]
        self.order = self._ordered()
        # Columns of the given mean motions follow those of the degrees of freedom.
        whole = csr_array(
            hstack([rows, block_diag([csr_array((0, 0)), *(csr_array(one) for _, _, one in known)])], format="csr")
        )
        whole = self._resolved(whole[order])
        self.rows, self.offsets = whole[:, : 3 * self._nodes], whole[:, 3 * self._nodes :].toarray()
        self.held_means = [k for several in sets for k in several]

    def _averaged(self, several: Sequence[int]) -> tuple[Index, csr_array, Array]:
        """Return the slaves of mean supports, their rows, and their coefficients in terms of the mean motions."""
        known = [self.means[k] for k in several]
        nodes = np.unique(np.concatenate([one.nodes for one in known]))
        # Rotations and displacements have different units: scale them.
        sizes = [np.linalg.norm(one.rows, axis=(1, 2)) for one in known]
        whole = [one.on_dofs(1.0 / size, 3 * self._nodes) for one, size in zip(known, sizes, strict=True)]
        for last in range(1, len(known) + 1):
            slaves, rows, values = self._solved(csr_array(vstack(whole[:last], format="csr")), nodes)
            if slaves.size < sum(map(len, sizes[:last])):
                raise InputError(
                    f"support {several[last - 1]}: other supports or ties hold the section already, or some of its "
                    "mean motions; leave one of them out"
                )
        self._taken[slaves] = True
        return slaves, rows, values / np.concatenate(sizes)

    def _nodes_of(self, surface: Surface) -> tuple[int, int]:
        """Return the first node of a surface's body, and the one after its last."""
        k = len(self._model.bodies) + surface.solid if isinstance(surface, SolidSurface) else surface.body
        return int(self.first_node[k]), int(self.first_node[k + 1])

    def _first(self, surface: Surface) -> int:
        return self._nodes_of(surface)[0]

    def body_of(self, surface: Surface) -> slice:
        """Return the degrees of freedom of a surface's body."""
        first, last = self._nodes_of(surface)
        return slice(3 * first, 3 * last)

    def _rows(self, surface: Surface, points: Array) -> Rows:
        if isinstance(surface, SolidSurface):
            return Rows(*self._model.solids[surface.solid].rows(points, surface.facets))
        return rows_at(self._model.bodies[surface.body].space, points)

    def _on_nodes(self, surface: Surface, nodes: Index, values: Array) -> csr_array:
        """Return functions of a body at points as a matrix ``(q, nodes)`` over all nodes."""
        points, functions = nodes.shape
        start = np.arange(points + 1) * functions
        columns = self._first(surface) + nodes.ravel()
        return csr_array((values.ravel(), columns, start), shape=(points, self._nodes))

    def _tied(self, tie: Tie) -> Tied:
        """Return a tie in terms of the nodes."""
        trace, near = self._met(tie)
        self._refuse_gap(tie, trace, near)
        own = self._on_nodes(tie.slave, trace.nodes, trace.values)
        other = self._on_nodes(tie.master, near.nodes, near.values)
        jump = csr_array(other - own)
        candidates = self._first(tie.slave) + trace.independent
        multipliers: dict[int, Multipliers] = {}
        passed = self._passed(tie, trace, own, other, near, candidates)
        slaves, rows = (
            self._welded(tie, trace, own, jump, candidates, passed, multipliers)
            if tie.kind == "weld"
            else self._condensed(tested(tie.kind, trace, own[:, candidates]), jump, candidates)
        )
        if not slaves.size:
            raise InputError(f"supports or other ties hold all of the {tie.slave}; leave one of them out")
        self._taken[slaves] = True
        bond = None
        if tie.law is not None:
            nodes = np.hstack([self._first(tie.slave) + trace.nodes, self._first(tie.master) + near.nodes])
            values = np.hstack([-trace.values, near.values])
            bond = Bond(jump, nodes, values, trace.normals, trace.weights, tie.law)
        return Tied(trace, slaves, rows, own, jump, float(near.gap.max()), bond, multipliers)

    def _welded(
        self,
        tie: Tie,
        trace: Trace,
        own: csr_array,
        jump: csr_array,
        candidates: Index,
        passed: Passed | None,
        multipliers: dict[int, Multipliers],
    ) -> tuple[Index, csr_array]:
        """Return the slaves of a weld and their rows, the same for each component unless supports hold some of them.

        Their multipliers are added to ``multipliers``, by component.
        """
        tests = trace.weights[:, None] * own[:, candidates].toarray()
        slaves, rows = [], []
        known: dict[bytes, tuple[csr_array, Multipliers]] = {}
        for a in range(3):
            free = ~self._taken[3 * candidates + a]
            mine = candidates[free]
            key = mine.tobytes()
            if mine.size and key not in known:
                chosen = tests[:, free]
                if mine.size < candidates.size:
                    chosen = chosen + tests[:, ~free] @ self._passed_on(tie.slave, trace, own, candidates, free)
                mass = np.asarray(own[:, mine].T @ chosen)
                solution = projection(jump, mine, chosen, mass)
                if passed is not None and mine.size == candidates.size:
                    solution, mass = passed.corrected(solution, mass), mass + passed.shown
                known[key] = solution, Multipliers(csr_array(chosen / trace.weights[:, None]), mass)
            if mine.size:
                slaves.append(3 * mine + a)
                rows.append(of_component(known[key][0], a))
                multipliers[a] = known[key][1]
        nothing = np.empty(0, dtype=np.int64), csr_array((0, 3 * self._nodes))
        return (np.concatenate(slaves), csr_array(vstack(rows, format="csr"))) if slaves else nothing

    def _passed_on(
        self, surface: Surface, trace: Trace, own: csr_array, candidates: Index, free: NDArray[np.bool_]
    ) -> csr_array:
        """Return the weights with which traces of held functions are added to free ones, ``(held, free)``."""
        if isinstance(surface, SolidSurface):
            return passed_on_near(trace.points, trace.weights, own[:, candidates], free)
        return passed_on_along(self._model.bodies[surface.body].space, candidates - self._first(surface), free)

    def _condensed(self, tests: Array, jump: csr_array, candidates: Index) -> tuple[Index, csr_array]:
        """Return slaves and their rows for vector-valued multipliers ``(k, q, 3)``, weights included."""
        on_dofs = [of_component(csr_array(csr_array(tests[:, :, a]) @ jump), a) for a in range(3)]
        return self._solved(csr_array(on_dofs[0] + on_dofs[1] + on_dofs[2]), candidates)[:2]

    def _solved(self, whole: csr_array, nodes: Index) -> tuple[Index, csr_array, Array]:
        """Return the slaves among nodes that equations ``whole u = value`` ``(k, dofs)`` determine.

        With them their coefficients in terms of other degrees of freedom, and of the values ``(slaves, k)``.
        """
        free = (3 * nodes[:, None] + np.arange(3)).ravel()
        free = free[~self._taken[free]]
        # Independent equations only: as many as there are slaves for them.
        basis, triangle, order = qr(whole[:, free].toarray(), mode="economic", pivoting=True)
        sizes = np.abs(np.diag(triangle))
        count = int(np.count_nonzero(sizes > _DEPENDENT * sizes.max(initial=0.0)))
        slaves = free[order[:count]]
        equations = csr_array(csr_array(basis[:, :count].T) @ whole)
        left = equations[:, slaves].toarray()
        drop = np.ones(whole.shape[1])
        drop[slaves] = 0.0
        rest = csr_array(equations @ csr_array(diags(drop)))
        columns = np.unique(rest.indices)
        solution = csr_array(np.linalg.solve(left, -rest[:, columns].toarray()))
        rows = csr_array((solution.data, columns[solution.indices], solution.indptr), shape=(count, whole.shape[1]))
        return slaves, rows, np.linalg.solve(left, basis[:, :count].T)

    def _met(self, tie: Tie) -> tuple[Trace, Rows]:
        """Return the traces of slave and master at the same points, enough of them for the master's nodes."""
        finer = 1
        while True:
            trace = trace_of(self._model, tie.slave, finer, tie.master)
            near = self._rows(tie.master, trace.points)
            if isinstance(tie.slave, LateralSurface) and tie.slave.touching:
                space = self._model.bodies[tie.slave.body].space
                most = _TOUCH * space.rod.radius if tie.gap is None else tie.gap
                kept = touching(space, trace, near.gap, most, finer)
                trace = trace_of(self._model, tie.slave, finer, tie.master, kept)
                near = self._rows(tie.master, trace.points)
            if isinstance(tie.slave, SolidSurface) or finer == _FINEST:
                return trace, near
            if len(trace.points) >= _TO_A_NODE * np.unique(near.nodes).size or not isinstance(tie.master, SolidSurface):
                return trace, near
            finer *= 2

    def _refuse_gap(self, tie: Tie, trace: Trace, near: Rows) -> None:
        """Raise `InputError` where the gap between the surfaces is too large."""
        apart, most = near.gap, _GAP * _size(trace) if tie.gap is None else tie.gap
        if isinstance(tie.master, EndFace):
            # Points inside the rod have no gap to it: measure their distance from the plane of its end.
            face = trace_of(self._model, tie.master, 1, tie.slave).points
            normal = np.linalg.svd(face - face.mean(axis=0), full_matrices=False)[2][-1]
            uneven = np.abs((face - face.mean(axis=0)) @ normal).max()
            apart = np.maximum(apart, np.abs((trace.points - face.mean(axis=0)) @ normal) - uneven)
        gap = float(apart.max())
        if gap > most:
            where = ", ".join(f"{x:.4g}" for x in trace.points[np.argmax(apart)])
            raise InputError(
                f"the surfaces are {gap:.3g} apart at ({where}), more than {most:.3g}; move the bodies together, name "
                "other surfaces, or give a larger gap"
            )

    def _passed(
        self, tie: Tie, trace: Trace, own: csr_array, other: csr_array, near: Rows, candidates: Index
    ) -> Passed | None:
        """Return the forces of linear tractions on both sides, if the slave is an end face."""
        if not isinstance(tie.slave, EndFace):
            return None
        space, which = self._model.bodies[tie.slave.body].space, tie.slave.which
        origin, size = trace.points.mean(axis=0), _size(trace)
        radii, theirs = np.empty(0), None
        if isinstance(tie.master, EndFace):
            master = self._model.bodies[tie.master.body].space, tie.master.which
            if faces.coincide(trace, near.gap, size, (space, which), master):
                radii = faces.common_radii(space, master[0])
                theirs = self._first(tie.master), faces.moments(*master, origin, size, radii)
        mine = faces.moments(space, which, origin, size, radii)
        nodes = candidates - self._first(tie.slave)
        return faces.passed(mine, nodes, trace, csr_array(own[:, candidates]), other, theirs)

    def _ordered(self) -> list[int]:
        """Return the ties in an order in which no tie's slaves are masters of later ties."""
        owner = np.full(3 * self._nodes, -1)
        for k, tied in enumerate(self.ties):
            owner[tied.slaves] = k
        masters = {k: {*owner[tied.rows.indices].tolist()} - {-1, k} for k, tied in enumerate(self.ties)}
        try:
            return [*TopologicalSorter(masters).static_order()][::-1]
        except CycleError:
            raise InputError("ties go round in a circle, each slave the master of another; turn one round") from None

    def _resolved(self, rows: csr_array) -> csr_array:
        """Return the slaves' rows with slaves of other ties eliminated."""
        keep = np.ones(rows.shape[1])
        keep[self.slaves] = 0.0
        for _ in range(len(self.ties) + len(self.means) + 1):
            if not (inner := csr_array(rows[:, self.slaves])).count_nonzero():
                return rows
            rows = csr_array(rows @ csr_array(diags(keep)) + inner @ rows)
        raise InputError("a tie and a mean support are on the same section, each the master of the other; move one")


def trace_of(
    model: Model, surface: Surface, finer: int = 1, other: Surface | None = None, kept: Mask | None = None
) -> Trace:
    """Return the functions of a surface's body on it.

    There are ``finer`` times as many points in each direction as by default (`isorod.space.trace.end_trace`).  Gauss
    rules end at element boundaries of ``other`` if that is a rod's lateral surface; ``kept`` restricts the surface.
    """
    if isinstance(surface, SolidSurface):
        if surface.facets is None:
            raise InputError(f"the slave is solid {surface.solid}: name its facets")
        trace = model.solids[surface.solid].trace(surface.facets)
        return Trace(*trace[:-1], independent=np.unique(trace.nodes))
    space = model.bodies[surface.body].space
    if isinstance(surface, EndFace):
        return end_trace(space, surface.which, finer)
    breaks = None
    if isinstance(other, LateralSurface):
        breaks = breaks_on(space, model.bodies[other.body].space)
    return lateral_trace(space, surface.along, surface.surface, finer, breaks, kept)


def _size(trace: Trace) -> float:
    """Return the radius of a circle of a surface's area."""
    return float(np.sqrt(trace.weights.sum() / np.pi))
