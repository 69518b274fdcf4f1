"""The unknowns of a model and their partition over ranks: rows and elements are split along the axis."""

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly.exchange import Exchange
from isorod.assembly.partition import Partition
from isorod.errors import InputError
from isorod.model.body import Body
from isorod.model.model import Model

if TYPE_CHECKING:
    from isorod.assembly.coupling import Coupling


class Unknowns:
    """Unknowns of a model over a communicator: degrees of freedom that are not held, in their order, tied ones once.

    The displacement of a state ``x`` at load factor ``f`` is ``x`` on those plus the prescribed displacements
    (`Model.prescribed`).

    Attributes
    ----------
    free, unknowns
        As in the model; a subclass may have more degrees of freedom.
    first
        First degree of freedom of each body, and their number.
    rows, block
        Number of unknowns of this rank, and how many make a block.
    element_ranges
        The elements of this rank.
    coupling
        Transformation of the unknowns by ties and solids (`isorod.assembly.coupling.Coupling`), None without.  With it,
        vectors and matrices are those of the whole system.
    """

    # Subclasses may add others.
    formulations: tuple[str, ...] = ("displacement",)

    def __init__(self, model: Model, comm: PETSc.Comm | None = None) -> None:
        self.model = model
        self.comm = PETSc.COMM_WORLD if comm is None else comm
        for b, body in enumerate(model.bodies):
            if body.formulation not in self.formulations:
                raise InputError(f"body {b}: formulation {body.formulation!r}, which needs the mixed assembler")
        # Prescribed displacements on this rank at the last load factor.
        self._prescribed: tuple[float, Array] | None = None
        self._number()
        self._split()
        self.coupling = self._coupled()

    @staticmethod
    def layer_dofs(body: Body) -> int:
        """Return the number of degrees of freedom of a layer."""
        return 3 * body.space.layer_nodes

    def _number(self) -> None:
        """Number the degrees of freedom, and the unknowns."""
        model = self.model
        self.free, self.unknowns = model.free, model.unknowns
        self.first = 3 * model.first_node
        self.block = 3 if model.whole_nodes and not model.coupled else 1

    def _split(self) -> None:
        """Take this rank's elements and rows."""
        size, rank = self.comm.getSize(), self.comm.getRank()
        partition = Partition(self.model, self.first, [self.layer_dofs(body) for body in self.model.bodies], size)
        self.element_ranges = partition.element_ranges(rank)
        window = None
        self.rows = self.unknowns
        self._owned = np.ones(self.first[-1], dtype=bool)
        if size > 1:
            self._owned = partition.owners() == rank
            self.rows = np.unique(self.free[(self.free >= 0) & self._owned]).size
            dofs = [element_range.dofs.ravel() for element_range in self.element_ranges]
            window = np.unique(np.concatenate([np.empty(0, np.int64), *dofs]))
        vector = self._own_vector() if size > 1 else None
        self._exchange = Exchange(vector, self.free, window, partition.numbers(), self.model.bound)

    def _coupled(self) -> "Coupling | None":
        if not self.model.coupled:
            return None
        from isorod.assembly.coupling import Coupling

        return Coupling(self.model, self.comm, self.unknown_of, self.rows, self.unknowns)

    def vector(self) -> PETSc.Vec:
        """Return a new zero vector of unknowns."""
        return self._own_vector() if self.coupling is None else self.coupling.vector()

    def _own_vector(self) -> PETSc.Vec:
        """Return a new zero vector of the rods' unknowns."""
        vector = PETSc.Vec().create(self.comm)
        vector.setSizes((self.rows, self.unknowns))
        vector.setBlockSize(self.block)
        vector.setFromOptions()
        vector.zeroEntries()
        return vector

    def _state(self, x: PETSc.Vec, factor: float) -> Array:
        """Return this rank's degrees of freedom at a load factor: prescribed displacements plus unknowns."""
        if self._prescribed is None or self._prescribed[0] != factor:
            self._prescribed = factor, self.local(self.prescribed(factor))
        local = self._prescribed[1].copy()
        self._exchange.add_unknowns(x if self.coupling is None else self.coupling.to_rods(x), local)
        return local

    def prescribed(self, factor: float) -> Array:
        """Return prescribed displacements at a load factor, those of ties' slaves included, ``(dofs,)``."""
        if self.coupling is None:
            return self.model.prescribed(factor)
        return self.coupling.given(factor)[: self.model.dofs]

    def _store(self, local: Array, out: PETSc.Vec) -> None:
        """Fill a vector of unknowns with the sums over ranks of the values in their slots."""
        if self.coupling is None:
            self._exchange.store(local, out)
        else:
            self.coupling.from_rods(lambda own: self._exchange.store(local, own), out)

    def local(self, displacement: Array) -> Array:
        """Return this rank's slots filled from all degrees of freedom, shape ``(dofs,)``."""
        moved, slots = self._exchange.moved
        local = np.zeros(self._exchange.size)
        local[slots] = displacement[moved]
        return local

    def _moves(self, local: Array) -> Array:
        """Return the model's degrees of freedom, ``(dofs,)``, from slots of this rank, which has them all."""
        return local if local.size == self.model.dofs else local[self._exchange.numbers]

    def _once(self, forces: Array) -> Array:
        """Return forces on this rank's own degrees of freedom, zero in other slots, so that ranks add up to all."""
        if self.comm.getSize() > 1:
            forces = np.where(self._owned[self._exchange.numbers], forces, 0.0)
        return self.local(forces)

    @cached_property
    def _supported(self) -> Index:
        """The slots of degrees of freedom with supports, those of mean motions included."""
        bound = self._exchange.bound[1]
        if not self.model.means:
            return bound
        assert self.coupling is not None
        moved, slots = self._exchange.moved
        return np.append(bound, slots[np.isin(moved, self.coupling.constraints.averaged)])

    def _bound(self, local: Array) -> Array:
        """Return the sums over all ranks on `Model.bound`, on every rank."""
        everywhere = np.zeros(self.model.bound.size)
        bound, slots = self._exchange.bound
        everywhere[bound] = local[slots]
        return np.asarray(self.comm.tompi4py().allreduce(everywhere))

    def state(
        self, displacement: Array, pressures: Sequence[Array | None] = (), solids: Sequence[Array] | float = 0.0
    ) -> PETSc.Vec:
        """Return the vector of unknowns from all degrees of freedom.

        Parameters
        ----------
        displacement
            Shape ``(dofs,)``.
        pressures
            Coefficients of mixed bodies (`isorod.assembly.mixed`), force per area; where not given, zero.
        solids
            Displacements of each solid's degrees of freedom on this rank, or one value for all.
        """
        unknowns = self._unknowns(displacement, pressures)
        if self.coupling is not None:
            return self.coupling.state(unknowns, solids)
        x = self.vector()
        first, last = x.getOwnershipRange()
        x.array_w[:] = unknowns[first:last]
        return x

    def _unknowns(self, displacement: Array, pressures: Sequence[Array | None]) -> Array:
        # A tied unknown is that of its first degree of freedom.
        _, first = np.unique(self.model.free, return_index=True)
        return displacement[first[first.size - self.model.unknowns :]]

    def _displacements(self, unknowns: Any) -> Any:
        """Return the displacements among unknowns ``(..., unknowns)``, in the model's order."""
        return unknowns

    @cached_property
    def unknown_of(self) -> Index:
        """Unknown of each degree of freedom of the model, -1 if it is held, shape ``(dofs,)``."""
        unknown = self.model.free.copy()
        unknown[unknown >= 0] = self._displacements(np.arange(self.unknowns))[unknown[unknown >= 0]]
        return unknown

    def all_unknowns(self, x: PETSc.Vec) -> Array:
        """Return all unknowns of rods in a vector, on every rank."""
        return self._exchange.all_unknowns(x if self.coupling is None else self.coupling.to_rods(x))

    def everywhere(self, local: Array) -> Array:
        """Return the sums over all ranks of the slots' values, for all the model's degrees of freedom."""
        moved, slots = self._exchange.moved
        own = np.zeros(self.model.dofs)
        own[moved] = local[slots]
        return own if self.comm.getSize() == 1 else np.asarray(self.comm.tompi4py().allreduce(own))

    def system_displacement(self, x: PETSc.Vec, factor: float) -> Array:
        """Return all degrees of freedom, of rods and of solids, on every rank."""
        assert self.coupling is not None
        return np.append(self.displacement(x, factor), self.coupling.everywhere(self.coupling.solids(x, factor)))

    def solids(self, x: PETSc.Vec, factor: float) -> list[Array]:
        """Return the displacement of each solid's degrees of freedom on this rank."""
        return [] if self.coupling is None else self.coupling.solids(x, factor)

    def shapes(self, unknowns: Array) -> Array:
        """Return all degrees of freedom ``(m, dofs)`` of motions ``(m, unknowns)`` that move no support."""
        result = np.zeros((unknowns.shape[0], self.model.dofs))
        is_free = self.model.free >= 0
        result[:, is_free] = self._displacements(unknowns)[:, self.model.free[is_free]]
        return result

    def displacement(self, x: PETSc.Vec, factor: float) -> Array:
        """Return all degrees of freedom, shape ``(dofs,)``, on every rank."""
        result = self.prescribed(factor)
        is_free = self.model.free >= 0
        result[is_free] += self._displacements(self.all_unknowns(x))[self.model.free[is_free]]
        return result
