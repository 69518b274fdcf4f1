"""The mass of explicit dynamics: consistent, with as much added to fast waves as a long step takes.

A body's consistent mass ``M0`` is the same for x, y and z, and couples neighbouring layers.  Lumped on the control
points it would be wrong: a section that swells would carry twice its kinetic energy and more, and waves of five
elements' length be a sixth too slow.

What limits the step is pressure waves across thin sections and short elements, while what bends and swells
near-incompressible bodies is far slower.  A step ``dt`` longer than the critical one ``t0`` is made stable by mass that
grows with the wave number, in proportion to stiffness (Olovsson, Simonsson & Unosson, Int. J. Numer. Meth. Engng 63
(2005) 1436-1445),

    M = M0 + s G,    G = int E grad S . grad S dV,    s = SAFETY (dt^2 - t0^2) / 4,

``E`` the modulus of pressure waves (`isorod.material.law.Material.modulus`).  Translations keep their mass exactly; the
error of slow motions is of second order in the step.  It is largest where sections turn about the axis: ``G`` cannot
tell that from swelling.  In the biceps, at six critical steps, stiff thin tendons that turn get 1.5 times their inertia
more, the muscle 3 %; of the contracted muscle's frequencies below 300 Hz those of twisting fall by 2 to 16 %, all
others by 1.5 % in the mean and 5 % at most.  As ``G`` is the same for x, y and z, linear and angular momentum are kept.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from isorod.arrays import Array, Index
from isorod.assembly import element_kernel
from isorod.dynamics.explicit.cholesky import Factor, Factors, factorise
from isorod.dynamics.explicit.exchange_kernel import NUMBERS, Exchange
from isorod.dynamics.explicit.ranks import Ranks
from isorod.errors import InputError
from isorod.model.body import Body
from isorod.model.model import Model
from isorod.space.space import Table

# The stiffness that is allowed for, in ``G``: three bounds that of isotropic bodies at rest, as
# ``div^2 <= 3 |grad|^2``; 1.5 was measured of the biceps at rest and 1.9 in motion, where compression and fibres
# stiffen it.
SAFETY = 2.5
# The most inertia that may be added to a section that turns or swells, of its own.
_MOST = 2.0


class Mass:
    """Mass matrices of a model's bodies, for one component.

    Parameters
    ----------
    model
        Bodies with densities.
    order
        From `isorod.dynamics.explicit.mesh.order`, shape ``(dofs,)``.
    ranks
        Which elements are this rank's; all where it is not given.

    Attributes
    ----------
    consistent, stiffness
        ``M0`` and ``G`` of each body, of this rank's elements.
    scaling, largest_scaling
        ``s`` of the module header, time squared, and the largest that `scaling_for` returns: that which trebles the
        inertia of a section that turns.
    """

    def __init__(self, model: Model, order: Index, ranks: Ranks | None = None) -> None:
        self._model, self._order = model, order
        self._ranks = Ranks(model, order) if ranks is None else ranks
        spans = [
            [(share.first, share.last) for share in self._ranks.shares if share.which == b]
            for b in range(len(model.bodies))
        ]
        parts = [_matrices(body, span) for body, span in zip(model.bodies, spans, strict=True)]
        self.consistent, self.stiffness = [part[0] for part in parts], [part[1] for part in parts]
        self.largest_scaling = _MOST * self._ranks.smallest(min(part[2] for part in parts))
        self.scaling = 0.0

    def scaling_for(self, step: float, critical: float) -> float:
        """Return the ``scaling`` for a step longer than the critical one of the consistent mass, or the largest."""
        return min(0.25 * SAFETY * (step - critical) * (step + critical), self.largest_scaling)

    def momenta(self, velocity: Array) -> Array:
        """Return the momenta, shape ``(dofs,)``, in the model's order as the velocities are; all ranks' together."""
        return self._ranks.sums(self._times(velocity, 1.0))

    def added(self, velocity: Array) -> float:
        """Return twice the kinetic energy in what was added to the consistent mass."""
        return float(velocity @ self._ranks.sums(self._times(velocity, 0.0))) if self.scaling else 0.0

    def _times(self, velocity: Array, share: float) -> Array:
        result = np.zeros((self._model.dofs // 3, 3))
        for b, (mass, stiffness) in enumerate(zip(self.consistent, self.stiffness, strict=True)):
            nodes = slice(self._model.first_node[b], self._model.first_node[b + 1])
            moving = self._model.nodal(velocity, b)
            result[nodes] = share * (mass @ moving) + self.scaling * (stiffness @ moving)
        return result.ravel()

    def factors(self) -> tuple[Factors, Exchange]:
        """Return the factors of what is free of this rank's part of the mass matrices, and what is left on its edges.

        Raises
        ------
        InputError
            If a matrix is not positive definite.
        """
        own, edges = _Rows(), _Rows()
        rows: list[Index] = []
        places: list[Index] = []
        for b, (mass, stiffness) in enumerate(zip(self.consistent, self.stiffness, strict=True)):
            dofs = 3 * np.arange(self._model.first_node[b], self._model.first_node[b + 1])[:, None] + np.arange(3)
            free = self._model.free[dofs] >= 0
            whole = mass + self.scaling * stiffness
            inside, edge, shared = self._ranks.nodes(b)
            # Components that are free at the same nodes share a matrix.
            masks, group = np.unique(free, axis=1, return_inverse=True)
            for k, mask in enumerate(masks.T):
                components = np.resize(np.flatnonzero(group.ravel() == k), 3)
                mine, common = edge[mask[edge]], shared[mask[shared]]
                chosen = np.concatenate([inside[mask[inside]], mine])
                found = factorise(csr_matrix(whole[chosen][:, chosen]), chosen.size - mine.size)
                parts = self._ranks.gather(None if found is None else (np.searchsorted(common, mine), found.left))
                left = None if None in parts else _joined(parts, common.size)
                if found is None or left is None:
                    raise InputError(f"quadrature: too few points for a positive mass of body {b}; take 'auto'")
                if chosen.size:
                    rows.append(own.count + np.arange(chosen.size - mine.size, chosen.size))
                    places.append(edges.count + parts[self._ranks.rank][0])
                    own.add(found, mine.size, self._order[dofs[chosen][:, components]].T)
                if common.size:
                    edges.add(left, 0, 3 * (edges.count + np.arange(common.size)) + np.arange(3)[:, None])
        size = 3 * edges.count + NUMBERS
        return own.factors(), Exchange(
            call=self._ranks.call(),
            edges=edges.factors(),
            rows=np.concatenate([np.empty(0, np.uint64), *rows]).astype(np.uint64),
            places=np.concatenate([np.empty(0, np.uint64), *places]).astype(np.uint64),
            reduced=np.zeros((3, own.count)),
            left=np.zeros((3, edges.count)),
            own=np.zeros(size),
            all=np.zeros(size),
        )


class _Rows:
    """Rows of `Factors`, as they grow; ``count`` of them so far."""

    def __init__(self) -> None:
        self.count = self._entries = 0
        self._systems: list[tuple[int, int, int]] = []
        self._parts: list[tuple[Factor, NDArray[np.uint64], Index]] = []

    def add(self, factor: Factor, edge: int, order: Index) -> None:
        """Add a matrix, the last ``edge`` rows of which are not eliminated, and the places of its rows, ``(3, r)``."""
        self._systems.append((factor.inverse.size - edge, self.count, edge))
        self._parts.append((factor, factor.starts + np.uint64(self._entries), order))
        self.count += factor.inverse.size
        self._entries += factor.values.size

    def factors(self) -> Factors:
        """Return them all."""
        whole, none = np.empty(0, dtype=np.uint64), np.empty(0)
        return Factors(
            systems=np.array(self._systems, dtype=np.uint64).reshape(-1, 3),
            first=np.concatenate([whole, *(factor.first for factor, _, _ in self._parts)]),
            starts=np.concatenate([whole, *(starts for _, starts, _ in self._parts)]),
            values=np.concatenate([none, *(factor.values for factor, _, _ in self._parts)]),
            inverse=np.concatenate([none, *(factor.inverse for factor, _, _ in self._parts)]),
            order=np.concatenate(
                [whole.reshape(3, 0), *(order.astype(np.uint64) for _, _, order in self._parts)], axis=1
            ),
        )


def _joined(parts: Sequence[tuple[Index, Array]], size: int) -> Factor | None:
    """Return the factor of the sum of what ranks have left of a matrix: its rows there, and the part; None as there."""
    rows = np.concatenate([np.repeat(at, at.size) for at, _ in parts])
    columns = np.concatenate([np.tile(at, at.size) for at, _ in parts])
    values = np.concatenate([part.ravel() for _, part in parts])
    return factorise(coo_matrix((values, (rows, columns)), (size, size)).tocsr(), size)


def _matrices(body: Body, spans: Sequence[tuple[int, int]]) -> tuple[csr_matrix, csr_matrix, float]:
    """Return ``M0`` and ``G``, shape ``(nodes, nodes)``, and the ``s`` that doubles a turning section's inertia.

    ``spans`` are the first of its elements, and the number after that of the last, of those it is of.
    """
    space = body.space
    chosen = np.concatenate([np.empty(0, dtype=np.int64), *(np.arange(*span) for span in spans)])
    if not chosen.size:
        return csr_matrix((space.nodes, space.nodes)), csr_matrix((space.nodes, space.nodes)), np.inf
    masses, stiffnesses, longest = [], [], np.inf
    for e in chosen.tolist():
        table = space.tabulate(e, e + 1)
        modulus, density = body.laws[e].modulus, body.densities[e]
        functions = table.axial.shape[2] * table.section.shape[2]
        masses.append(
            element_kernel.mass(table.section, table.axial, density * table.weights).reshape(functions, functions)
        )
        plane = np.einsum("tj,qdi->tqdji", table.axial[0], table.section[:, :2])
        axis = np.einsum("tj,qi->tqji", table.slopes[0], table.section[:, 2])[:, :, None]
        gradient = np.swapaxes(table.inverse[0], -1, -2) @ np.concatenate([plane, axis], axis=2).reshape(
            *table.weights.shape[1:], 3, functions
        )
        weighted = modulus * table.weights[0, :, :, None, None] * gradient
        stiffnesses.append(gradient.reshape(-1, functions).T @ weighted.reshape(-1, functions))
        longest = min(longest, density / modulus * _gyration(space.positions[space.element_nodes[e]], table))
    nodes = space.element_nodes[chosen]
    rows = np.repeat(nodes, nodes.shape[1], axis=1).ravel()
    columns = np.tile(nodes, (1, nodes.shape[1])).ravel()
    shape = (space.nodes, space.nodes)
    both = (coo_matrix((np.stack(part).ravel(), (rows, columns)), shape).tocsr() for part in (masses, stiffnesses))
    return *both, longest


def _gyration(positions: Array, table: Table) -> float:
    """Return the square of the smallest radius of gyration of an element's sections, across both principal axes."""
    nodal = positions.reshape(table.axial.shape[2], -1, 3)
    x = np.einsum("qi,tj,jia->tqa", table.section[:, 2], table.axial[0], nodal)
    share = table.weights[0] / table.weights[0].sum(axis=1, keepdims=True)
    x -= np.einsum("tq,tqa->ta", share, x)[:, None]
    # The third is that of the section's normal, if it is plane.
    return float(np.linalg.eigvalsh(np.einsum("tq,tqa,tqb->tab", share, x, x))[:, 1].min())
