"""A model with ties and finite element bodies as one system, in terms of its independent unknowns.

The rods' assembler and the solids keep their own unknowns ``y``, some of which depend on others.  With ``y = T x + g``
residuals are ``T^T r`` and tangents ``T^T K T``: symmetric, and definite where those of the parts are.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array

from isorod.arrays import Array, Index
from isorod.assembly.bonds import Bond, Bonds, Spring
from isorod.assembly.condensed import Condensed, groups
from isorod.assembly.constraints import Constraints
from isorod.model.model import Model
from isorod.petsc.matrix import create_matrix, fits, keep_symmetric, preallocate, renewed, set_values

if TYPE_CHECKING:
    from isorod.contact.operator import ContactOperator

# Attributes of a matrix of the system: the rods' own matrix, and the contributions of rods and solids.
_RODS, _ADDED = "isorod_rods", "isorod_added"

# Attribute of the same: the version of contact's pattern that it is preallocated for.
_CONTACT = "isorod_contact"


class Coupling:
    """Transformation of the unknowns of a model's rods and solids by ties.

    Parameters
    ----------
    model, comm
        The model, over a communicator.
    unknown_of
        Unknown of the rods' assembler of each degree of freedom of theirs, -1 where it is held, shape ``(dofs,)``.
    rows, unknowns
        Number of the rods' unknowns on this rank and in all.

    Attributes
    ----------
    constraints
        The ties.
    own_dofs
        This rank's degrees of freedom of each solid among all.
    rows, unknowns
        Number of unknowns of the system, on this rank and in all.
    """

    # Derivative by the unknowns of the displacement at which bonds are evaluated.
    _bond_factor = 1.0

    def __init__(self, model: Model, comm: PETSc.Comm, unknown_of: Index, rows: int, unknowns: int) -> None:
        self._model, self._comm = model, comm
        self.constraints = constraints = Constraints(model)
        count, slaves = unknown_of.size, constraints.slaves
        owned = np.array(comm.tompi4py().allgather(rows))
        # Rods' unknowns and solids' degrees of freedom that are unknowns of the system.
        rods = np.ones(unknowns, dtype=bool)
        rods[unknown_of[slaves[slaves < count]]] = False
        solids = ~constraints.held[count:]
        solids[slaves[slaves >= count] - count] = False
        ranks = np.arange(owned.size)
        rank = np.concatenate(
            [np.repeat(ranks, owned)[rods], np.concatenate([ranks[:0], *constraints.ranks_of_solids])[solids]]
        )
        # On each rank first those of rods, then of solids.
        number = np.empty(rank.size, dtype=np.int64)
        number[np.argsort(rank, kind="stable")] = np.arange(rank.size)
        self.unknowns, self.rows = rank.size, int(np.count_nonzero(rank == comm.getRank()))
        self._of_rods, of_solids = np.full(unknowns, -1), np.full(solids.size, -1)
        self._of_rods[rods], of_solids[solids] = np.split(number, [np.count_nonzero(rods)])
        of_dofs = np.concatenate([np.where(unknown_of >= 0, self._of_rods[unknown_of], -1), of_solids])
        dependent = _renumbered(constraints.rows, of_dofs, self.unknowns)
        mine = np.arange(rows) + owned[: comm.getRank()].sum()
        slave_of = np.full(unknowns, -1)
        slave_of[unknown_of[slaves[slaves < count]]] = np.flatnonzero(slaves < count)
        self._groups = groups(dependent)
        self._slave_of_rods = slave_of
        self._rods = self._transformation(self._of_rods[mine], slave_of[mine], dependent)
        self._inner = self._rods.createVecLeft()
        slave_of = np.full(of_dofs.size, -1)
        slave_of[slaves] = np.arange(slaves.size)
        self.own_dofs = [
            3 * first + np.arange(3 * solid.owned[0], 3 * solid.owned[1])
            for first, solid in zip(constraints.first_node[len(model.bodies) :], model.solids, strict=False)
        ]
        self._of_solids = [of_dofs[own] for own in self.own_dofs]
        # The same for all degrees of freedom of each solid.
        starts = 3 * constraints.first_node[len(model.bodies) :]
        self._of_solid = [(of_dofs[begin:end], slave_of[begin:end]) for begin, end in pairwise(starts)]
        self._solids = [self._transformation(of_dofs[own], slave_of[own], dependent) for own in self.own_dofs]
        # The solids' last state, load factor and tangents, each with PETSc's counter of its changes.
        self._known: tuple[list[Array], float, list[tuple[PETSc.Mat, int]]] = [], np.nan, []
        # The matrix T of all degrees of freedom.
        plain = np.flatnonzero(of_dofs >= 0)
        whole = csr_array((np.ones(plain.size), (plain, of_dofs[plain])), shape=(of_dofs.size, self.unknowns))
        place = csr_array((np.ones(slaves.size), (slaves, np.arange(slaves.size))), shape=(of_dofs.size, slaves.size))
        self._whole = whole = csr_array(whole + place @ dependent)
        bonds: list[Bond | Spring] = [tied.bond for tied in constraints.ties if tied.bond is not None]
        bonds += [Spring.of(one) for one in constraints.means.values() if not one.held]
        # Linear bonds always add the same.
        self._kept: tuple[Condensed | None, Array] = None, np.empty(0)
        self.bonds = Bonds(bonds, of_dofs.size // 3, comm) if bonds else None
        if self.bonds is not None:
            first = int(np.count_nonzero(rank < comm.getRank()))
            self._pushed = csr_array(whole.T.tocsr()[first : first + self.rows])
            self._of_dofs = of_dofs, slave_of
            self.bonds.set(np.zeros(of_dofs.size), self._bond_factor)

    def _transformation(self, number: Index, slave: Index, dependent: csr_array) -> PETSc.Mat:
        """Return this rank's rows of ``T``: one entry at a ``number``, or the row of a ``slave``, or none."""
        plain = np.flatnonzero(number >= 0)
        free = csr_array((np.ones(plain.size), (plain, number[plain])), shape=(number.size, self.unknowns))
        some = np.flatnonzero(slave >= 0)
        place = csr_array((np.ones(some.size), (some, slave[some])), shape=(number.size, dependent.shape[0]))
        whole = csr_array(free + place @ dependent)
        whole.sort_indices()
        arrays = whole.indptr.astype(PETSc.IntType), whole.indices.astype(PETSc.IntType), whole.data
        sizes = (number.size, None), (self.rows, self.unknowns)
        made = PETSc.Mat().createAIJ(sizes, csr=arrays, comm=self._comm)
        made.assemble()
        return made

    def vector(self) -> PETSc.Vec:
        """Return a new zero vector of the system."""
        vector = PETSc.Vec().create(self._comm)
        vector.setSizes((self.rows, self.unknowns))
        vector.setFromOptions()
        vector.zeroEntries()
        return vector

    def fields(self) -> tuple[PETSc.IS, PETSc.IS]:
        """Return the unknowns of the system on this rank that are rods', and those that are solids'."""
        first = self.vector().getOwnershipRange()[0]
        numbers = [number[number >= 0] for number in self._of_solids]
        solids = np.zeros(self.rows, dtype=bool)
        solids[np.concatenate([np.empty(0, dtype=np.int64), *numbers]) - first] = True
        rods, others = (
            PETSc.IS().createGeneral((first + np.flatnonzero(some)).astype(PETSc.IntType), self._comm)
            for some in (~solids, solids)
        )
        return rods, others

    def to_rods(self, x: PETSc.Vec) -> PETSc.Vec:
        """Return ``T x`` of the rods, valid until the next call."""
        self._rods.mult(x, self._inner)
        return self._inner

    def from_rods(self, fill: Callable[[PETSc.Vec], None], out: PETSc.Vec) -> None:
        """Set ``out`` to ``T^T r`` of the rods' ``r``, which ``fill`` fills in."""
        fill(self._inner)
        self._rods.multTranspose(self._inner, out)

    def given(self, factor: float) -> Array:
        """Return ``g`` of all degrees of freedom, first those of rods, then of solids."""
        result = self._model.amplitude(None, factor) * self.constraints.values
        own = self._model.prescribed(factor)
        result[: own.size] = own
        constraints = self.constraints
        result[constraints.slaves] = constraints.rows @ result + constraints.offsets @ self._means(factor)
        return result

    def _means(self, factor: float) -> Array:
        """Return the values of the mean motions that are held."""
        means = [self._model.means[k] for k in self.constraints.held_means]
        return np.concatenate(
            [np.empty(0), *(self._model.amplitude(one.history, factor) * one.values for one in means)]
        )

    def passed_on(self, forces: Array) -> Array:
        """Return forces on all degrees of freedom, or of rods alone, with those on slaves moved to their masters."""
        constraints = self.constraints
        everywhere = np.zeros(constraints.held.size)
        everywhere[: forces.size] = forces
        carried = everywhere[constraints.slaves]
        everywhere[constraints.slaves] = 0.0
        return (everywhere + constraints.rows.T @ carried)[: forces.size]

    def solids(self, x: PETSc.Vec, factor: float) -> list[Array]:
        """Return the displacement of each solid's degrees of freedom on this rank."""
        if not self._solids:
            return []
        displacements, given = [], self.given(factor)
        for own, transformation in zip(self.own_dofs, self._solids, strict=True):
            moved = transformation.createVecLeft()
            transformation.mult(x, moved)
            displacements.append(given[own] + moved.array_r)
        return displacements

    def everywhere(self, own: Sequence[Array]) -> Array:
        """Return the values that ranks have of each solid, gathered on every rank, solid by solid."""
        values = [np.concatenate(self._comm.tompi4py().allgather(one)) for one in own]
        return np.concatenate([np.empty(0), *values])

    def push(self, forces: Array, where: Index, to: Sequence[Array] | None = None) -> Sequence[Array]:
        """Add forces on degrees of freedom ``where``, the same on all ranks, to those of each solid on this rank."""
        to = [np.zeros(own.size) for own in self.own_dofs] if to is None else to
        for own, force in zip(self.own_dofs, to, strict=True):
            if own.size:
                here = (where >= own[0]) & (where <= own[-1])
                force[where[here] - own[0]] += forces[here]
        return to

    def solid_forces(self, x: PETSc.Vec, factor: float) -> list[Array]:
        """Return the internal less the external forces of each solid's degrees of freedom on this rank."""
        return [
            solid.residual(moved, self._model.amplitude(None, factor))
            for solid, moved in zip(self._model.solids, self.solids(x, factor), strict=True)
        ]

    def add(self, forces: Sequence[Array], out: PETSc.Vec) -> None:
        """Add ``T^T r`` of the forces ``r`` of each solid on this rank."""
        for force, transformation in zip(forces, self._solids, strict=True):
            row = transformation.createVecLeft()
            row.array_w[:] = force
            transformation.multTransposeAdd(row, out, out)

    def add_bonds(self, x: PETSc.Vec, factor: float, out: PETSc.Vec) -> None:
        """Add the forces of bonds."""
        if self.bonds is not None:
            out.array_w[:] += self._pushed @ self.bond_forces(self._everything(x, factor))

    def bond_forces(self, moved: Array) -> Array:
        """Return the forces of bonds on all degrees of freedom at displacements of these."""
        return np.zeros(moved.size) if self.bonds is None else self.bonds.forces(self._seen(moved))

    def set_bonds(self, x: PETSc.Vec, factor: float) -> None:
        """Update the tangent of bonds to a state."""
        if self.bonds is not None and not self.bonds.linear:
            self.bonds.set(self._seen(self._everything(x, factor)), self._bond_factor)

    def _everything(self, x: PETSc.Vec, factor: float) -> Array:
        """Return all degrees of freedom, on every rank."""
        unknowns = np.concatenate(self._comm.tompi4py().allgather(np.array(x.array_r)))
        return np.asarray(self._whole @ unknowns + self.given(factor))

    def _seen(self, moved: Array) -> Array:
        """Return the displacements at which bonds are evaluated, given those at the end of a step."""
        return moved

    def carried(self, forces: Sequence[Array], factor: float) -> float:
        """Return the sum of squares of the solids' loads and support forces on this rank."""
        held = (force[self.constraints.held[own]] for own, force in zip(self.own_dofs, forces, strict=True))
        loads = (self._model.amplitude(None, factor) * solid.external() for solid in self._model.solids)
        return float(sum(np.sum(one**2) for one in (*held, *loads)))

    def unheld(self, forces: Sequence[Array]) -> Array:
        """Return the resultant ``(3,)`` of the solids' forces on this rank on unsupported nodes."""
        result = np.zeros(3)
        for own, force in zip(self.own_dofs, forces, strict=True):
            result += np.where(self.constraints.held[own], 0.0, force).reshape(-1, 3).sum(axis=0)
        return result

    def add_load_forces(self, x: PETSc.Vec, factor: float, step: float, out: PETSc.Vec) -> None:
        """Add the linearised change of the solids' residuals when the load factor grows by ``step`` at ``x``."""
        change, forces = self.given(factor + step) - self.given(factor), []
        if self.bonds is not None:
            out.array_w[:] += self._pushed @ self.bonds.change(self._everything(x, factor), change)
        for own, solid, tangent in zip(self.own_dofs, self._model.solids, self.tangents(x, factor), strict=True):
            move, force = tangent.createVecs()
            move.array_w[:] = change[own]
            tangent.mult(move, force)
            forces.append(force.array_r - self._model.amplitude(None, factor, step) * solid.external())
        self.add(forces, out)

    def tangents(self, x: PETSc.Vec, factor: float) -> list[PETSc.Mat]:
        """Return the solids' own tangents, assembled only if the state has changed."""
        moved = self.solids(x, factor)
        if not self._is_known(moved, factor):
            amplitude = self._model.amplitude(None, factor)
            made = [solid.tangent(one, amplitude) for solid, one in zip(self._model.solids, moved, strict=True)]
            self._known = moved, factor, [(one, one.stateGet()) for one in made]
        return [matrix for matrix, _ in self._known[2]]

    def _is_known(self, moved: Sequence[Array], factor: float) -> bool:
        """Return whether the last tangents are of this state, and no other system has refilled the matrices."""
        known, at, matrices = self._known
        same = at == factor and all(map(np.array_equal, moved, known))
        return self._comm.tompi4py().allreduce(
            same and all(matrix.stateGet() == state for matrix, state in matrices), op=MPI.LAND
        )

    def state(self, rods: Array, solids: Sequence[Array] | float) -> PETSc.Vec:
        """Return the system's vector from the rods' unknowns ``(unknowns,)`` and the solids' degrees of freedom.

        The latter are those of each solid on this rank, or one value for all.
        """
        x = self.vector()
        known = self._of_rods >= 0
        first, last = x.getOwnershipRange()
        here = known & (self._of_rods >= first) & (self._of_rods < last)
        x.array_w[self._of_rods[here] - first] = rods[here]
        values = [np.array(solids)] * len(self._solids) if isinstance(solids, float) else solids
        for value, number in zip(values, self._of_solids, strict=True):
            x.array_w[number[number >= 0] - first] = np.broadcast_to(value, number.shape)[number >= 0]
        return x

    def matrix(
        self, rods: PETSc.Mat, solids: Sequence[PETSc.Mat], symmetric: bool, stiffness: bool = True
    ) -> PETSc.Mat:
        """Return a new matrix of the system, preallocated for ``T^T K T`` and, if it is a stiffness, for bonds."""
        added = [self._added(k, one) for k, one in enumerate((rods, *solids))]
        if stiffness and self.bonds is not None:
            added.append(Condensed(self.bonds.matrix, *self._of_dofs, self._groups))
        made = create_matrix(self._comm, (self.rows, self.unknowns), 1, lambda: self._places(added))
        # Both are new and not yet factorised: reset their flags.
        renewed(rods), renewed(made)
        made.setAttr(_RODS, rods)
        made.setAttr(_ADDED, added)
        return keep_symmetric(made) if symmetric else made

    @staticmethod
    def of_rods(matrix: PETSc.Mat) -> PETSc.Mat:
        """Return the rods' own matrix that belongs to a matrix of the system."""
        return matrix.getAttr(_RODS)

    def fill(self, matrix: PETSc.Mat, solids: Sequence[PETSc.Mat], contact: "ContactOperator | None" = None) -> None:
        """Fill a matrix of the system from the rods' own, which is filled, the solids', and their contact with rods."""
        rods, added = self.of_rods(matrix), matrix.getAttr(_ADDED)
        entries = self._of_contact(contact)
        if renewed(rods):
            # New contact has changed the pattern.
            added[0] = self._added(0, rods)
            matrix.setAttr(_CONTACT, None)
        version = None if contact is None else contact.version
        if self._comm.tompi4py().allreduce(matrix.getAttr(_CONTACT) != version):
            rows, columns = self._places(added)
            if not (matrix.getAttr(_CONTACT) is not None and fits(matrix, rows.size, *entries[:2])):
                preallocate(matrix, np.append(rows, entries[0]), np.append(columns, entries[1]))
            matrix.setAttr(_CONTACT, version)
        parts = [rods, *solids]
        values = [one.values(own) for one, own in zip(added[: len(parts)], parts, strict=True)]
        if len(added) > len(parts):
            values.append(self._of_bonds(added[-1]))
        set_values(matrix, np.concatenate([*values, entries[2]]))

    def _of_bonds(self, added: Condensed) -> Array:
        """Return the values that bonds add to a matrix."""
        assert self.bonds is not None
        if not (self.bonds.linear and self._kept[0] is added):
            self._kept = added, added.values(self.bonds.matrix)
        return self._kept[1]

    def _of_contact(self, contact: "ContactOperator | None") -> tuple[Index, Index, Array]:
        """Return rows, columns and values of this rank's contact entries, those between rods excepted."""
        if contact is None or not contact.beyond.size:
            return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0)
        some, whole = np.flatnonzero(~np.asarray(contact.of_rods)), self._whole
        dofs = np.append(np.arange(self._model.dofs), contact.beyond)
        row, column = dofs[contact.rows[some]], dofs[contact.columns[some]]
        counts = np.diff(whole.indptr)
        each = counts[row] * counts[column]
        entry = np.repeat(np.arange(some.size), each)
        down, across = np.divmod(np.arange(entry.size) - np.repeat(np.cumsum(each) - each, each), counts[column][entry])
        down, across = whole.indptr[row][entry] + down, whole.indptr[column][entry] + across
        values = contact.values[some][entry] * whole.data[down] * whole.data[across]
        return whole.indices[down].astype(np.int64), whole.indices[across].astype(np.int64), values

    def _added(self, k: int, own: PETSc.Mat) -> Condensed:
        """Return the contribution of the matrix of rods, or of a solid."""
        number, slave = self._of_solid[k - 1] if k else (self._of_rods, self._slave_of_rods)
        return Condensed(own, number, slave, self._groups)

    def _places(self, added: Sequence[Condensed]) -> tuple[Index, Index]:
        """Return row and column in the system of all entries of the contributions."""
        rows, columns = (np.concatenate(each) for each in zip(*((one.rows, one.columns) for one in added), strict=True))
        return rows, columns


def _renumbered(rows: csr_array, number: Index, count: int) -> csr_array:
    """Return rows with renumbered columns ``(s, count)``; those with a negative number are dropped."""
    kept = number[rows.indices] >= 0
    row = np.repeat(np.arange(rows.shape[0]), np.diff(rows.indptr))[kept]
    return csr_array((rows.data[kept], (row, number[rows.indices[kept]])), shape=(rows.shape[0], count))
