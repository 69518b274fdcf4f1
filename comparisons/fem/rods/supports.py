"""Supports on the nodes of a mesh: a node is held where all functions of the support's space that act there are."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import dolfinx.fem
import numpy as np

from comparisons.fem.rods.elements import Elements
from isorod.fenics import compat
from isorod.fenics.loads import Held as HeldGroup
from isorod.files.solid import OfBody
from isorod.model.model import Model
from meshes.held import Held, all_of
from meshes.mesh import Array, Index


class Condition(NamedTuple):
    """Displacements of some degrees of freedom, as `comparisons.fem.statics.Newton` takes them."""

    condition: Any
    dofs: Index


class _HeldFacets:
    """A support of facets of a body."""

    def __init__(self, elements: Elements, solid: int, held: HeldGroup) -> None:
        self.nodes: Index = np.unique(elements.source.faces[f"solid {solid} {held.group}"])
        self.components = sorted("xyz".index(letter) for letter in held.components)
        self._moved = np.where(np.isin(np.arange(3), self.components), held.displacement, 0.0)

    def displacement(self, factor: float) -> Array:
        """Return the displacement of the nodes at a load factor, ``(m, 3)``; zero in components that are free."""
        return np.tile(factor * self._moved, (len(self.nodes), 1))


class Supports:
    """All supports of a model and of its bodies.

    Attributes
    ----------
    conditions
        For `comparisons.fem.statics.Newton`.
    held
        Degrees of freedom of this rank under them, and pressures that are idle, sorted.
    free
        Number of those of all ranks that are free.
    whole
        Whether every node is held in all components or none, and there are no pressures.
    """

    def __init__(self, elements: Elements, model: Model, bodies: Sequence[OfBody] = ()) -> None:
        self._elements = elements
        self._objective = [all(law.objective for law in body.laws) for body in model.bodies]
        self._all, self._count = all_of(elements.source, model), max(1, len(model.supports))
        # Of several supports on a node the last one holds it, as in isorod; supports of rods come after bodies'.
        self._owner = np.full((len(elements.source.points), 3), -1)
        facets = [_HeldFacets(elements, k, held) for k, body in enumerate(bodies) for held in body.held]
        count = len(model.supports)
        self._every: list[tuple[int, Held | _HeldFacets]] = [*enumerate(facets, count), *self._all.items()]
        for k, support in self._every:
            self._owner[support.nodes[:, None], support.components] = k
        self._nodal = np.zeros_like(elements.source.points)
        count = (self._owner >= 0).sum(axis=1)
        rows, components = np.nonzero((self._owner >= 0) & (elements.node_dofs >= 0)[:, None])
        self.held: Index = np.sort(np.concatenate([elements.places[rows, components], elements.idle]))
        self.free = elements.dofs - int(count.sum())
        self.whole = elements.split[1] is None and bool(np.isin(count, (0, 3)).all())
        self._values: list[tuple[Any, Any]] = []
        self.conditions: list[Condition] = self._conditions(np.unique(rows), rows, components)

    def _conditions(self, nodes: Index, rows: Index, components: Index) -> list[Condition]:
        elements = self._elements
        space, blocks = elements.space, elements.node_dofs
        if self.whole:
            # Also if no held node is this rank's: making a function is collective.
            if (self._owner < 0).all():
                return []
            value = dolfinx.fem.Function(space)
            self._values = [(value, None)]
            held = np.sort(blocks[nodes]).astype(np.int32)
            return [Condition(dolfinx.fem.dirichletbc(value, held), self.held)]
        unknowns = elements.state.function_space
        displacements = unknowns if elements.split[1] is None else unknowns.sub(0)
        every = [(displacements.sub(c), np.sort(elements.places[rows[components == c], c])) for c in range(3)]
        if elements.split[1] is not None:
            every.append((unknowns.sub(1), elements.idle))
        conditions = []
        for part, dofs in every:
            plain, back = compat.collapsed(part)
            value = dolfinx.fem.Function(plain)
            here = np.empty(elements.unknowns, dtype=np.int32)
            here[back] = np.arange(len(back))
            self._values.append((value, back))
            both = [dofs.astype(np.int32), here[dofs]]
            conditions.append(Condition(dolfinx.fem.dirichletbc(value, both, part), dofs))
        return conditions

    def move(self, factor: float) -> None:
        """Set the displacements of a load factor."""
        for k, support in self._every:
            mine = self._owner[support.nodes] == k
            self._nodal[support.nodes] = np.where(mine, support.displacement(factor), self._nodal[support.nodes])
        coefficients = self._elements.to_dofs(self._nodal)
        for value, back in self._values:
            value.x.array[:] = coefficients if back is None else coefficients[back]

    def forces(self, nodal: Array, displacement: Array) -> tuple[Array, Array]:
        """Return force and moment of each support that holds nodes, both ``(supports, 3)``, at least one row.

        Moments are about the mean of its control points, as isorod's: in present positions, and in those at rest where
        a body has a law of small strains, whose stress balances there.

        Parameters
        ----------
        nodal
            Reactions at nodes: internal forces less loads, shape ``(nodes, 3)``.
        displacement
            Shape ``(nodes, 3)``.
        """
        reactions, moments = (np.zeros((self._count, 3)) for _ in range(2))
        for k, support in self._all.items():
            own = np.where(self._owner[support.nodes] == k, nodal[support.nodes], 0.0)
            moved = self._objective[support.body]
            arms = self._elements.source.points[support.nodes] + moved * displacement[support.nodes]
            arms -= support.centre(displacement, moved)
            reactions[k], moments[k] = own.sum(axis=0), np.cross(arms, own).sum(axis=0)
        return reactions, moments
