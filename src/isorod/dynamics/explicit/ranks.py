"""How ranks share a model in motion: each has the elements of `isorod.assembly.split`; sums over all are taken here.

State vectors are those of the whole model on every rank.  In an interval of steps a rank keeps what belongs to its
elements up to date.  Momenta, and forces, of nodes that it shares with others - those of edges - are then its part, the
velocity and displacement whole.  At the outputs everything is gathered on all ranks.
"""

from ctypes import CDLL, POINTER, c_int, c_uint64, c_void_p, cast
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly.split import ElementRange, Partition
from isorod.model.model import Model


class Ranks:
    """The share of a rank.

    Parameters
    ----------
    model
        The model.
    order
        From `isorod.dynamics.explicit.mesh.order`, shape ``(dofs,)``.
    comm
        The ranks; this one alone where there is none.

    Attributes
    ----------
    communicator
        They, as PETSc has them.
    size, rank
        Number of ranks, and that of this one.
    shares
        The elements of this rank.
    owned
        Whether a degree of freedom, of the model's, is this rank's: each is of one, ``(dofs,)``.
    mine
        Their places in a state vector.
    others
        Places of the degrees of freedom on edges that are another rank's.
    spans
        Where in a state vector what belongs to this rank's elements begins and ends, shape ``(s, 2)``.
    """

    def __init__(self, model: Model, order: Index, comm: PETSc.Comm | None = None) -> None:
        comm = PETSc.COMM_SELF if comm is None else comm
        self.size, self.rank = comm.getSize(), comm.getRank()
        self.communicator = comm
        self.comm: Any = comm.tompi4py() if self.size > 1 else None
        first = 3 * model.first_node
        split = Partition(model, first, [3 * body.space.layer_nodes for body in model.bodies], self.size)
        self.shares: list[ElementRange] = split.element_ranges(self.rank)
        self.owned = split.owners() == self.rank
        self.mine = order[self.owned]
        self._sizes = [body.space.layer_nodes for body in model.bodies]
        # By how many ranks' elements each layer is had, and whether by this one's.
        self._counts = [np.zeros(body.space.layers, dtype=np.int64) for body in model.bodies]
        own = [np.zeros(body.space.layers, dtype=bool) for body in model.bodies]
        for rank in range(self.size):
            for share in split.element_ranges(rank):
                layers = np.unique(share.layers)
                self._counts[share.which][layers] += 1
                if rank == self.rank:
                    own[share.which][layers] = True
        self._own = own
        touched = np.concatenate([one.repeat(3 * size) for one, size in zip(own, self._sizes, strict=True)])
        # State vectors go layer by layer as the model's degrees of freedom do.
        ends = np.flatnonzero(np.diff(np.concatenate([[False], touched, [False]])))
        self.spans = ends.reshape(-1, 2).astype(np.uint64)
        self.others = order[touched & ~self.owned]

    def nodes(self, body: int) -> tuple[Index, Index, Index]:
        """Return nodes of a body: those that this rank's elements alone have, those it shares, and all that are shared.

        The first are in an order in which those beside the second come last.
        """
        count, own, size = self._counts[body], self._own[body], self._sizes[body]
        inside, edge, shared = (np.flatnonzero(one) for one in (own & (count == 1), own & (count > 1), count > 1))
        if edge.size and inside.size and edge.max() < inside.min():
            inside = inside[::-1]
        inside, edge, shared = ((size * layers[:, None] + np.arange(size)).ravel() for layers in (inside, edge, shared))
        return inside, edge, shared

    def sums(self, array: Array) -> Array:
        """Return the sums over all ranks, the same on each."""
        if self.comm is None:
            return array
        own, found = np.ascontiguousarray(array), np.empty_like(array)
        self.comm.Allreduce(own, found)
        return found

    def whole(self, vector: Array) -> Array:
        """Return a state vector of which each rank has its own degrees of freedom."""
        return vector if self.comm is None else self.spread(vector[self.mine], vector.size)

    def spread(self, values: Array, size: int) -> Array:
        """Return the state vector whose values at ``mine`` each rank gives."""
        own = np.zeros(size)
        own[self.mine] = values
        return self.sums(own)

    def smallest(self, value: float) -> float:
        """Return the smallest of all ranks' values."""
        return value if self.comm is None else float(min(self.comm.allgather(value)))

    def gather(self, value: Any) -> list[Any]:
        """Return what each rank gives, in their order."""
        return [value] if self.comm is None else list(self.comm.allgather(value))

    def first(self, value: Any) -> Any:
        """Return what the first rank gives."""
        return value if self.comm is None else self.comm.bcast(value)

    def call(self) -> NDArray[np.uint64]:
        """Return what compiled code adds up with (`isorod.dynamics.explicit.exchange_kernel.all_sums`)."""
        if self.comm is None:
            return np.zeros(4, dtype=np.uint64)
        from mpi4py import MPI

        address = cast(CDLL(MPI.__file__).MPI_Allreduce, c_void_p).value
        return np.array([address, *map(_handle, (MPI.DOUBLE, MPI.SUM, self.comm))], dtype=np.uint64)


def _handle(thing: Any) -> int:
    """Return MPI's own handle of a thing of mpi4py's: a pointer or an int, as the implementation has it."""
    from mpi4py import MPI

    kind = c_int if MPI._sizeof(thing) == 4 else c_uint64
    found = cast(MPI._addressof(thing), POINTER(kind))[0]
    return int(found) % 2**64
