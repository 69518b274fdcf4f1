"""Partition of a model in motion over ranks: each has the elements of `isorod.assembly.partition`; sums over all ranks.

State vectors are those of the full model on every rank.  In an interval of steps a rank updates the entries of its
elements.  Momenta and forces of nodes shared with other ranks, those on edges, are then its contribution, velocity and
displacement the full ones.  At the outputs everything is gathered on all ranks.
"""

from ctypes import CDLL, POINTER, c_int, c_uint64, c_void_p, cast
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly.partition import ElementRange, Partition
from isorod.model.model import Model


class Ranks:
    """The part of a rank.

    Parameters
    ----------
    model
        The model.
    order
        From `isorod.dynamics.explicit.mesh.order`, shape ``(dofs,)``.
    comm
        The ranks; this one alone by default.

    Attributes
    ----------
    communicator
        The ranks as a PETSc communicator.
    size, rank
        Number of ranks, and that of this one.
    element_ranges
        The elements of this rank.
    owned
        Whether this rank owns a degree of freedom of the model; each has one owner, ``(dofs,)``.
    mine
        Places of the owned ones in a state vector.
    others
        Places of the degrees of freedom on edges that other ranks own.
    spans
        Begin and end of the entries of this rank's elements in a state vector, shape ``(s, 2)``.
    """

    def __init__(self, model: Model, order: Index, comm: PETSc.Comm | None = None) -> None:
        comm = PETSc.COMM_SELF if comm is None else comm
        self.size, self.rank = comm.getSize(), comm.getRank()
        self.communicator = comm
        self.comm: Any = comm.tompi4py() if self.size > 1 else None
        first = 3 * model.first_node
        split = Partition(model, first, [3 * body.space.layer_nodes for body in model.bodies], self.size)
        self.element_ranges: list[ElementRange] = split.element_ranges(self.rank)
        self.owned = split.owners() == self.rank
        self.mine = order[self.owned]
        self._sizes = [body.space.layer_nodes for body in model.bodies]
        # Number of ranks whose elements have each layer, and whether this one's have.
        self._counts = [np.zeros(body.space.layers, dtype=np.int64) for body in model.bodies]
        own = [np.zeros(body.space.layers, dtype=bool) for body in model.bodies]
        for rank in range(self.size):
            for elements in split.element_ranges(rank):
                layers = np.unique(elements.layers)
                self._counts[elements.which][layers] += 1
                if rank == self.rank:
                    own[elements.which][layers] = True
        self._own = own
        touched = np.concatenate([layers.repeat(3 * size) for layers, size in zip(own, self._sizes, strict=True)])
        # State vectors are ordered layer by layer, as the model's degrees of freedom are.
        ends = np.flatnonzero(np.diff(np.concatenate([[False], touched, [False]])))
        self.spans = ends.reshape(-1, 2).astype(np.uint64)
        self.others = order[touched & ~self.owned]

    def nodes(self, body: int) -> tuple[Index, Index, Index]:
        """Return nodes of a body: those of this rank's elements alone, those it shares, and those shared by any ranks.

        In the first those next to the second come last.
        """
        count, own, size = self._counts[body], self._own[body], self._sizes[body]
        inside, edge, shared = (np.flatnonzero(mask) for mask in (own & (count == 1), own & (count > 1), count > 1))
        if edge.size and inside.size and edge.max() < inside.min():
            inside = inside[::-1]
        inside, edge, shared = ((size * layers[:, None] + np.arange(size)).ravel() for layers in (inside, edge, shared))
        return inside, edge, shared

    def sums(self, array: Array) -> Array:
        """Return the sums over all ranks, the same on each."""
        if self.comm is None:
            return array
        own, total = np.ascontiguousarray(array), np.empty_like(array)
        self.comm.Allreduce(own, total)
        return total

    def whole(self, vector: Array) -> Array:
        """Return a full state vector, gathered from the degrees of freedom that each rank owns."""
        return vector if self.comm is None else self.spread(vector[self.mine], vector.size)

    def spread(self, values: Array, size: int) -> Array:
        """Return the state vector from the values at ``mine`` of each rank."""
        own = np.zeros(size)
        own[self.mine] = values
        return self.sums(own)

    def smallest(self, value: float) -> float:
        """Return the smallest value over all ranks."""
        return value if self.comm is None else float(min(self.comm.allgather(value)))

    def gather(self, value: Any) -> list[Any]:
        """Return the values of all ranks, in their order."""
        return [value] if self.comm is None else list(self.comm.allgather(value))

    def first(self, value: Any) -> Any:
        """Return the value of the first rank."""
        return value if self.comm is None else self.comm.bcast(value)

    def call(self) -> NDArray[np.uint64]:
        """Return address and handles for sums by `isorod.dynamics.explicit.exchange_kernel.all_sums`."""
        if self.comm is None:
            return np.zeros(4, dtype=np.uint64)
        from mpi4py import MPI

        address = cast(CDLL(MPI.__file__).MPI_Allreduce, c_void_p).value
        return np.array([address, *map(_handle, (MPI.DOUBLE, MPI.SUM, self.comm))], dtype=np.uint64)


def _handle(item: Any) -> int:
    """Return MPI's handle of an object of mpi4py: a pointer or an int, depending on the implementation."""
    from mpi4py import MPI

    kind = c_int if MPI._sizeof(item) == 4 else c_uint64
    value = cast(MPI._addressof(item), POINTER(kind))[0]
    return int(value) % 2**64
