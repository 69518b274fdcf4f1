"""Ties in explicit steps: projection of velocities onto those that ties allow, in the norm of the mass.

With ties ``G v = 0`` momenta ``p`` have the velocity

    v = M^-1 (p - G^T l),    G M^-1 G^T l = G M^-1 p,

which is that of the condensed mass, ``T (T^T M T)^-1 T^T p``.  Bodies keep their own factors of the mass, coupled by
``Z = M^-1 G^T (G M^-1 G^T)^-1``, a row of numbers for each degree of freedom near a tie: away from it ``M^-1 G^T``
decays exponentially.
"""

from collections.abc import Callable

import numpy as np
from scipy.sparse import csc_array, csr_array, hstack, vstack
from scipy.sparse.linalg import splu

from isorod.arrays import Array, Index
from isorod.assembly.constraints import Constraints
from isorod.dynamics.explicit.exchange_kernel import TieFactors
from isorod.dynamics.explicit.ranks import Ranks
from isorod.errors import InputError
from isorod.model.model import Model

# Entries below this fraction of the largest are rounding.
_NONE = 1e-17

# Number of rows solved at a time.
_TOGETHER = 1000


class Ties:
    """The ties of a model of rods in explicit steps.

    Parameters
    ----------
    model, order, ranks
        As for `isorod.dynamics.explicit.mass.Mass`.

    Raises
    ------
    InputError
        If a tie has a bond, or supports hold masters of a slave.
    """

    def __init__(self, model: Model, order: Index, ranks: Ranks) -> None:
        for k, tie in enumerate(model.ties):
            if tie.bond:
                raise InputError(f"tie {k}: bond: not supported by explicit steps; use integrator 'implicit'")
        constraints = Constraints(model)
        self._slaves, self._rows = constraints.slaves, constraints.rows
        for k, tied in enumerate(constraints.ties):
            if constraints.held[tied.rows.indices].any():
                raise InputError(
                    f"tie {k}: supports hold some of what the {model.ties[k].slave} is tied to, where explicit steps "
                    "do not count what they carry; use integrator 'implicit'"
                )
        count = self._slaves.size
        chosen = csr_array((np.ones(count), (np.arange(count), self._slaves)), shape=self._rows.shape)
        self._ties, self._order, self._ranks = csr_array(chosen - self._rows), order, ranks

    def tied(self, displacement: Array) -> Array:
        """Return a displacement or a velocity in the model's order, with slaves by their masters."""
        result = displacement.copy()
        result[self._slaves] = self._rows @ displacement
        return result

    def factors(self, velocity: Callable[[Array], Array]) -> TieFactors:
        """Return the factors of the projection.

        Parameters
        ----------
        velocity
            Returns the velocity of momenta without ties, both state vectors.
        """
        count, size = self._ties.shape
        columns = []
        for k in range(count):
            momenta = np.zeros(size)
            momenta[self._order] = self._ties[[k]].toarray()[0]
            columns.append(_kept(velocity(momenta)[:, None]))
        moved = csr_array(hstack(columns, format="csr"))
        gram = csc_array(self._ties @ moved[self._order])
        factor = splu(csc_array(0.5 * (gram + gram.T)))
        mine = np.zeros(size, dtype=bool)
        for first, last in self._ranks.spans:
            mine[first:last] = True
        places = np.flatnonzero(mine & (np.diff(moved.indptr) > 0))
        parts = [csr_array((0, count))]
        for begin in range(0, places.size, _TOGETHER):
            some = moved[places[begin : begin + _TOGETHER]].toarray()
            parts.append(_kept(factor.solve(some.T).T))
        spread = csr_array(vstack(parts, format="csr"))
        own = csr_array(self._ties.multiply(self._ranks.owned[None, :].astype(float)))
        own.eliminate_zeros()
        return TieFactors(
            first=own.indptr.astype(np.uint64),
            columns=self._order[own.indices].astype(np.uint64),
            values=own.data,
            places=places.astype(np.uint64),
            starts=spread.indptr.astype(np.uint64),
            which=spread.indices.astype(np.uint64),
            spread=spread.data,
            own=np.zeros(count),
            all=np.zeros(count),
        )


def _kept(values: Array) -> csr_array:
    """Return values as a sparse matrix, without those at round-off level of the largest."""
    return csr_array(np.where(np.abs(values) > _NONE * np.abs(values).max(initial=0.0), values, 0.0))
