"""The mass of explicit dynamics: consistent, with selective mass scaling for steps longer than the critical one.

A body's consistent mass ``M0`` is the same for x, y and z, and couples neighbouring layers.  Lumping on the control
points would be wrong: a section that swells would have twice its kinetic energy and more, and waves of five elements'
length would be a sixth too slow.

The critical step is that of pressure waves across thin sections and short elements, while bending, torsion and swelling
of near-incompressible bodies are far slower.  A step ``dt`` longer than the critical one ``t0`` is made stable by mass
that grows with the wave number, in proportion to stiffness (Olovsson, Simonsson & Unosson, Int. J. Numer. Meth. Engng
63 (2005) 1436-1445; Tkachuk & Bischoff, Comput. Mech. 52 (2013) 563-570),

    M = M0 + s K,    s = safety (dt^2 - t0^2) / 4,

``K`` the tangent of the body's laws at rest in its present shape.  The inertia of a mode of frequency ``w`` grows by a
fraction ``s w^2``: most for swelling, which is fast, hardly for torsion.  Translations have none, nor has a rigid
rotation of the shape at which ``K`` was taken; as a body rotates or swells away from that, ``K`` is taken again
(`isorod.dynamics.explicit.run`).  In the biceps, in steps of 0.1 ms, twenty critical ones, the contracted muscle's
frequencies below 300 Hz fall by at most 1.9 %, those of torsion by 1.2 %.

``K`` couples x, y and z, so a body that rotates away from the shape at which it was taken would lose angular momentum.
Bodies whose supports leave a rigid motion free conserve angular momentum, and have

    G = int E grad S . grad S dV

in place of ``K``, the same for all three components, ``E`` the P-wave modulus
(`isorod.material.law.Material.modulus`).  That does not separate torsion from swelling: a rotating section has as much.
"""

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix, identity, kron

from isorod.arrays import Array, Index
from isorod.checks.groups import groups
from isorod.checks.rigid_motions import moved_freely
from isorod.dynamics.explicit.added import Elements
from isorod.dynamics.explicit.cholesky import Factor, Factors, factorise
from isorod.dynamics.explicit.exchange_kernel import NUMBERS, MassFactors, TieFactors
from isorod.dynamics.explicit.ranks import Ranks
from isorod.errors import InputError
from isorod.model.model import Model

# Safety factor of the stiffness with ``G``: 3 is a bound for isotropic bodies at rest, as ``div^2 <= 3 |grad|^2``; the
# biceps needs 1.5 at rest and 1.9 in motion, where compression and fibres stiffen it.
SAFETY = 2.5
# The same with ``K``, as bodies may have deformed since it was taken: a motion that preserves volume in one shape does
# not in another.  The biceps needs 2.1 in steps of 0.1 ms.
SAFETY_COUPLED = 4.0
# Largest inertia added to a section that rotates or swells, or shears, relative to its own.
_MOST = 2.0


class Mass:
    """Mass matrices of a model's bodies.

    Parameters
    ----------
    model
        Bodies with densities.
    order
        From `isorod.dynamics.explicit.mesh.order`, shape ``(dofs,)``.
    ranks
        The elements of this rank; all by default.

    Attributes
    ----------
    coupled
        Whether each body has ``K``: its supports leave no rigid motion free.
    consistent
        ``M0`` of each body, of this rank's elements.
    scaling
        ``s`` of the module header, time squared.
    at
        Displacement at which ``K`` is taken, ``(dofs,)``; see `place`.
    """

    def __init__(self, model: Model, order: Index, ranks: Ranks | None = None) -> None:
        self._model, self._order = model, order
        self._ranks = Ranks(model, order) if ranks is None else ranks
        self._elements = {elements.which: Elements(elements) for elements in self._ranks.element_ranges}
        turning = _turning(model)
        self.coupled = [b not in turning for b in range(len(model.bodies))]
        self._safety = SAFETY_COUPLED if any(self.coupled) else SAFETY
        empty = [csr_matrix((body.space.nodes, body.space.nodes)) for body in model.bodies]
        self.consistent = [
            self._elements[b].consistent() if b in self._elements else none for b, none in enumerate(empty)
        ]
        self.scaling = 0.0
        self.at = np.zeros(model.dofs)

    @property
    def follows(self) -> bool:
        """Whether added mass depends on the shape of a body."""
        return self.scaling > 0.0 and any(self.coupled)

    def place(self, displacement: Array) -> None:
        """Set the displacement of ``K``, in the model's order."""
        self.at = displacement.copy()
        self.__dict__.pop("stiffness", None)

    def change(self, displacement: Array) -> float:
        """Return the largest component of elements' mean gradients of a displacement, in the model's order."""
        changes = [own.change(self._model.nodal(displacement, b)) for b, own in self._elements.items()]
        return -self._ranks.smallest(-max(changes, default=0.0))

    @cached_property
    def stiffness(self) -> list[csr_matrix]:
        """``K`` of each body, or ``G``, of this rank's elements."""
        matrices = []
        for b, mass in enumerate(self.consistent):
            own, size = self._elements.get(b), mass.shape[0]
            if self.coupled[b]:
                nodal = self._model.nodal(self.at, b)
                matrices.append(csr_matrix((3 * size, 3 * size)) if own is None else own.tangent(nodal))
            else:
                matrices.append(csr_matrix((size, size)) if own is None else own.gradients())
        return matrices

    @cached_property
    def largest_scaling(self) -> float:
        """The largest ``s`` that `scaling_for` returns: it triples the inertia of a section.

        With ``G`` that of a rotating section, with ``K`` of one in shear.
        """
        scalings = [own.slowest(self.coupled[b]) for b, own in self._elements.items()]
        return _MOST * self._ranks.smallest(min(scalings, default=np.inf))

    def scaling_for(self, step: float, critical: float) -> float:
        """Return the ``scaling`` for a step longer than the critical one of the consistent mass, or the largest."""
        return min(0.25 * self._safety * (step - critical) * (step + critical), self.largest_scaling)

    def momenta(self, velocity: Array) -> Array:
        """Return the momenta of velocities, both in the model's order, shape ``(dofs,)``; summed over ranks."""
        return self._ranks.sums(self._times(velocity, 1.0))

    def added(self, velocity: Array) -> float:
        """Return twice the kinetic energy of the added mass."""
        return float(velocity @ self._ranks.sums(self._times(velocity, 0.0))) if self.scaling else 0.0

    def _times(self, velocity: Array, consistent: float) -> Array:
        result = np.zeros((self._model.dofs // 3, 3))
        for b, mass in enumerate(self.consistent):
            nodes = slice(self._model.first_node[b], self._model.first_node[b + 1])
            moving = self._model.nodal(velocity, b)
            result[nodes] = consistent * (mass @ moving)
            if self.scaling > 0.0:
                scaled = self.stiffness[b] @ (moving.ravel() if self.coupled[b] else moving)
                result[nodes] += self.scaling * scaled.reshape(-1, 3)
        return result.ravel()

    def factors(self) -> MassFactors:
        """Return the factors of the free rows of this rank's mass matrices, and of the Schur complements on edges.

        Raises
        ------
        InputError
            If a matrix is not positive definite.
        """
        own, edges = _Rows(), _Rows()
        rows: list[Index] = []
        places: list[Index] = []
        for b in range(len(self._model.bodies)):
            for matrix, mask, dofs in self._systems(b):
                components = dofs.shape[1]
                inside, edge, shared = (
                    _entries(nodes, matrix.shape[0] // self.consistent[b].shape[0]) for nodes in self._ranks.nodes(b)
                )
                mine, common = edge[mask[edge]], shared[mask[shared]]
                chosen = np.concatenate([inside[mask[inside]], mine])
                factor = factorise(csr_matrix(matrix[chosen][:, chosen]), chosen.size - mine.size)
                parts = self._ranks.gather(None if factor is None else (np.searchsorted(common, mine), factor.left))
                left = None if None in parts else _joined(parts, common.size)
                if factor is None or left is None:
                    raise InputError(f"quadrature: too few points for a positive mass of body {b}; take 'auto'")
                if chosen.size:
                    rows.append(own.count + np.arange(chosen.size - mine.size, chosen.size))
                    places.append(edges.count + parts[self._ranks.rank][0])
                    own.add(factor, mine.size, self._order[np.resize(dofs[chosen].T, (3, chosen.size))], components)
                if common.size:
                    at = 3 * (edges.count + np.arange(common.size)) + np.arange(3)[:, None]
                    edges.add(left, 0, at, components)
        size = 3 * edges.count + NUMBERS
        return MassFactors(
            inside=own.factors(),
            call=self._ranks.call(),
            edges=edges.factors(),
            rows=np.concatenate([np.empty(0, np.uint64), *rows]).astype(np.uint64),
            places=np.concatenate([np.empty(0, np.uint64), *places]).astype(np.uint64),
            reduced=np.zeros((3, own.count)),
            left=np.zeros((3, edges.count)),
            own=np.zeros(size),
            all=np.zeros(size),
            ties=TieFactors.none(),
        )

    @cached_property
    def _repeated(self) -> list[csr_matrix]:
        """``M0`` of each body, for all three components."""
        return [kron(mass, identity(3), "csr") for mass in self.consistent]

    def _systems(self, b: int) -> Iterator[tuple[csr_matrix, NDArray[np.bool_], Index]]:
        """Yield the matrices of a body to be factorised: the matrix, a mask of its free rows, and their places.

        Rows are nodes with places ``(rows, components)``, or degrees of freedom.
        """
        dofs = 3 * np.arange(self._model.first_node[b], self._model.first_node[b + 1])[:, None] + np.arange(3)
        free = self._model.free[dofs] >= 0
        if self.scaling > 0.0 and self.coupled[b]:
            yield self._repeated[b] + self.scaling * self.stiffness[b], free.ravel(), dofs.reshape(-1, 1)
            return
        matrix = self.consistent[b] + self.scaling * self.stiffness[b] if self.scaling > 0.0 else self.consistent[b]
        # Components that are free at the same nodes share a matrix.
        masks, group = np.unique(free, axis=1, return_inverse=True)
        for k, mask in enumerate(masks.T):
            yield matrix, mask, dofs[:, np.resize(np.flatnonzero(group.ravel() == k), 3)]


def _turning(model: Model) -> set[int]:
    """Return the bodies whose supports leave a rigid motion free, and all that are tied to them."""
    turning = {b for moved in moved_freely(model) for b, _ in moved}
    return {b for group in groups(model) if turning.intersection(group.bodies) for b in group.bodies}


def _entries(nodes: Index, each: int) -> Index:
    """Return the rows of nodes with ``each`` rows per node."""
    return (each * nodes[:, None] + np.arange(each)).ravel()


class _Rows:
    """Builds the rows of `Factors`, ``count`` of them so far."""

    def __init__(self) -> None:
        self.count = self._entries = 0
        self._systems: list[tuple[int, int, int, int]] = []
        self._parts: list[tuple[Factor, NDArray[np.uint64], Index]] = []

    def add(self, factor: Factor, edge: int, order: Index, components: int) -> None:
        """Add the factor of a matrix, its last ``edge`` rows not eliminated, and the places of the rows, ``(3, r)``."""
        self._systems.append((factor.inverse.size - edge, self.count, edge, components))
        self._parts.append((factor, factor.starts + np.uint64(self._entries), order))
        self.count += factor.inverse.size
        self._entries += factor.values.size

    def factors(self) -> Factors:
        """Return all rows."""
        integers, reals = np.empty(0, dtype=np.uint64), np.empty(0)
        return Factors(
            systems=np.array(self._systems, dtype=np.uint64).reshape(-1, 4),
            first=np.concatenate([integers, *(factor.first for factor, _, _ in self._parts)]),
            starts=np.concatenate([integers, *(starts for _, starts, _ in self._parts)]),
            values=np.concatenate([reals, *(factor.values for factor, _, _ in self._parts)]),
            inverse=np.concatenate([reals, *(factor.inverse for factor, _, _ in self._parts)]),
            order=np.concatenate(
                [integers.reshape(3, 0), *(order.astype(np.uint64) for _, _, order in self._parts)], axis=1
            ),
        )


def _joined(parts: Sequence[tuple[Index, Array]], size: int) -> Factor | None:
    """Return the factor of the sum of ranks' Schur complements, each with its rows; None if not positive definite."""
    rows = np.concatenate([np.repeat(at, at.size) for at, _ in parts])
    columns = np.concatenate([np.tile(at, at.size) for at, _ in parts])
    values = np.concatenate([part.ravel() for _, part in parts])
    return factorise(coo_matrix((values, (rows, columns)), (size, size)).tocsr(), size)
