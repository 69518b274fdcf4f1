"""Supports on the nodes of a mesh: a node is held where all functions of the support's space that act there are."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import dolfinx.fem
import numpy as np

from comparisons.fem.rods.elements import Elements
from isorod.errors import InputError
from isorod.fenics import compat
from isorod.fenics.loads import Held
from isorod.files.solid import OfBody
from isorod.model.model import Model
from isorod.model.motion import SupportMotion
from isorod.model.support import Support
from isorod.space.space import Space
from meshes.mesh import Array, Index

# Rounding of a function that vanishes.
_SMALL = 1e-9


class Condition(NamedTuple):
    """Displacements of some degrees of freedom, as `comparisons.fem.statics.Newton` takes them."""

    condition: Any
    dofs: Index


class _Trace:
    """The functions of a rod's space at nodes of its mesh's surface.

    Attributes
    ----------
    nodes
        Of the mesh, shape ``(m,)``.
    """

    def __init__(self, space: Space, nodes: Index, parameters: Array) -> None:
        self.space, self.nodes = space, nodes
        first, self._axial, _ = space.axis.local(parameters[:, 2])
        self._layers = (first[:, None] + np.arange(space.axis.degree + 1)) % space.layers
        self._section, _ = space.basis.functions(_on_disk(parameters[:, :2]))

    def only(self, held: Any) -> "_Trace":
        """Return that of the nodes at which only functions with ``held`` ``(layers, count)`` act."""
        weights = np.abs(self._axial[:, :, None] * self._section[:, None, :])
        kept = np.where(held[self._layers], 0.0, weights).max(axis=(1, 2)) < _SMALL
        some = object.__new__(_Trace)
        some.space, some.nodes = self.space, self.nodes[kept]
        some._axial, some._layers, some._section = self._axial[kept], self._layers[kept], self._section[kept]
        return some

    def values(self, nodal: Array) -> Array:
        """Return the field with coefficients ``(nodes, 3)`` of the space at the mesh's nodes, shape ``(m, 3)``."""
        near = nodal.reshape(self.space.layers, -1, 3)[self._layers]
        return np.einsum("mj,ml,mjla->ma", self._axial, self._section, near, optimize=True)

    def carriers_of(self, values: Array, held: Any) -> Array:
        """Return the mean of the carriers among coefficients ``held`` that fit values ``(m, 3)`` best."""
        size = self.space.layers * self.space.layer_nodes
        rows = np.zeros((len(self.nodes), size))
        numbers = self._layers[:, :, None] * self.space.layer_nodes + np.arange(self.space.layer_nodes)
        weights = self._axial[:, :, None] * self._section[:, None, :]
        np.add.at(rows, (np.arange(len(rows))[:, None, None], numbers), weights)
        chosen = np.flatnonzero(held.ravel())
        found = np.linalg.lstsq(rows[:, chosen], values, rcond=None)[0]
        return np.asarray(found[self.space.is_carrier[chosen]].mean(axis=0))


class _Held:
    """One support: the nodes of the mesh that it holds, and in which components."""

    def __init__(
        self, k: int, support: Support, motion: SupportMotion, model: Model, elements: Elements, trace: _Trace
    ) -> None:
        if support.tied:
            raise InputError(f"support {k}: a tied face is not on the finite element side")
        self.motion, self.body = motion, support.body
        self.first, self.space = int(model.first_node[support.body]), trace.space
        self.components = sorted("xyz".index(letter) for letter in support.components)
        self.functions = np.zeros(self.space.nodes, dtype=bool)
        self.functions[np.asarray(support.nodes)] = True
        self.trace = trace.only(self.functions.reshape(self.space.layers, -1))
        self.nodes = self.trace.nodes
        if not len(self.nodes):
            raise InputError(f"support {k}: no node of the mesh is where it holds all that acts; refine the mesh")

    def displacement(self, factor: float) -> Array:
        """Return the displacement of the nodes at a load factor, ``(m, 3)``; zero in components that are free."""
        return self.trace.values(self._prescribed(factor))

    def _prescribed(self, factor: float) -> Array:
        nodal = np.zeros((self.space.nodes, 3))
        nodal.ravel()[self.motion.dofs - 3 * self.first] = self.motion.at(factor)
        return nodal

    def centre(self, displacement: Array) -> Array:
        """Return the mean of the held carriers' present positions, the mesh's nodes displaced by ``(nodes, 3)``."""
        carriers = self.functions & self.space.is_carrier
        moved = self._prescribed(1.0)[carriers].mean(axis=0)
        free = np.setdiff1d(np.arange(3), self.components)
        if free.size:
            moved[free] = self.trace.carriers_of(displacement[self.nodes], self.functions)[free]
        return np.asarray(self.space.positions[carriers].mean(axis=0) + moved)


class _HeldFacets:
    """What holds facets of a body."""

    def __init__(self, elements: Elements, solid: int, held: Held) -> None:
        self.nodes: Index = np.unique(elements.source.faces[f"solid {solid} {held.group}"])
        self.components = sorted("xyz".index(letter) for letter in held.components)
        self._moved = np.where(np.isin(np.arange(3), self.components), held.displacement, 0.0)

    def displacement(self, factor: float) -> Array:
        """Return the displacement of the nodes at a load factor, ``(m, 3)``; zero in components that are free."""
        return np.tile(factor * self._moved, (len(self.nodes), 1))


class Supports:
    """All supports of a model, and what holds its bodies.

    Attributes
    ----------
    conditions
        For `comparisons.fem.statics.Newton`.
    held
        Degrees of freedom under them, sorted.
    whole
        Whether every node is held in all components or none.
    """

    def __init__(self, elements: Elements, model: Model, bodies: Sequence[OfBody] = ()) -> None:
        self._elements = elements
        traces: dict[int, _Trace] = {}
        self._all: list[_Held] = []
        for k, (support, motion) in enumerate(zip(model.supports, model.motions, strict=True)):
            if not isinstance(support, Support):
                raise InputError(f"support {k}: mean motions and springs are not on the finite element side")
            b = support.body
            if b not in traces:
                traces[b] = _surface(elements, b, model.bodies[b].space)
            self._all.append(_Held(k, support, motion, model, elements, traces[b]))
        # Of several supports on a node the last one holds it, as in isorod, and those of rods what bodies share.
        self._owner = np.full((len(elements.source.points), 3), -1)
        facets = [_HeldFacets(elements, k, held) for k, body in enumerate(bodies) for held in body.held]
        count = len(self._all)
        self._every: list[tuple[int, _Held | _HeldFacets]] = [*enumerate(facets, count), *enumerate(self._all)]
        for k, one in self._every:
            self._owner[one.nodes[:, None], one.components] = k
        self._nodal = np.zeros_like(elements.source.points)
        rows, components = np.nonzero(self._owner >= 0)
        self.held: Index = np.sort(3 * elements.node_dofs[rows] + components)
        count = (self._owner >= 0).sum(axis=1)
        self.whole = bool(np.isin(count, (0, 3)).all())
        self._values: list[tuple[Any, Any]] = []
        self.conditions: list[Condition] = self._conditions(np.unique(rows), rows, components)

    def _conditions(self, nodes: Index, rows: Index, components: Index) -> list[Condition]:
        space, blocks = self._elements.space, self._elements.node_dofs
        if not len(nodes):
            return []
        if self.whole:
            value = dolfinx.fem.Function(space)
            self._values = [(value, None)]
            held = np.sort(blocks[nodes]).astype(np.int32)
            return [Condition(dolfinx.fem.dirichletbc(value, held), self.held)]
        found = []
        for c in range(3):
            part = space.sub(c)
            plain, back = compat.collapsed(part)
            value = dolfinx.fem.Function(plain)
            here = np.empty(3 * len(blocks), dtype=np.int32)
            here[back] = np.arange(len(back))
            dofs = np.sort(3 * blocks[rows[components == c]] + c)
            self._values.append((value, back))
            both = [dofs.astype(np.int32), here[dofs]]
            found.append(Condition(dolfinx.fem.dirichletbc(value, both, part), dofs))
        return found

    def move(self, factor: float) -> None:
        """Set the displacements of a load factor."""
        for k, one in self._every:
            mine = self._owner[one.nodes] == k
            self._nodal[one.nodes] = np.where(mine, one.displacement(factor), self._nodal[one.nodes])
        coefficients = self._elements.to_dofs(self._nodal)
        for value, back in self._values:
            value.x.array[:] = coefficients if back is None else coefficients[back]

    def forces(self, nodal: Array, displacement: Array) -> tuple[Array, Array]:
        """Return force and moment of each support, both ``(supports, 3)``, at least one row.

        Moments are about the mean of the present positions of its carriers, as isorod's.

        Parameters
        ----------
        nodal
            What holds the nodes: internal forces less loads, shape ``(nodes, 3)``.
        displacement
            Shape ``(nodes, 3)``.
        """
        reactions, moments = (np.zeros((max(1, len(self._all)), 3)) for _ in range(2))
        for k, one in enumerate(self._all):
            own = np.where(self._owner[one.nodes] == k, nodal[one.nodes], 0.0)
            arms = self._elements.source.points[one.nodes] + displacement[one.nodes] - one.centre(displacement)
            reactions[k], moments[k] = own.sum(axis=0), np.cross(arms, own).sum(axis=0)
        return reactions, moments


def _surface(elements: Elements, body: int, space: Space) -> _Trace:
    """Return the functions of a body's space at the nodes of the surface of its mesh."""
    source = elements.source
    faces: Sequence[Index] = [nodes for name, nodes in source.faces.items() if name.startswith(f"rod {body} ")]
    nodes = np.unique(np.concatenate([face.ravel() for face in faces]))
    return _Trace(space, nodes, source.parameters_in(body, nodes))


def _on_disk(xi: Array) -> Array:
    """Return disk points, those beyond the circle by rounding on it."""
    return xi / np.maximum(1.0, np.linalg.norm(xi, axis=1, keepdims=True))
