"""Supports on the nodes of a mesh: a node is held where all functions of the support's space that act there are."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from isorod.errors import InputError
from isorod.model.model import Model
from isorod.model.support import Support
from isorod.space.space import Space
from meshes.mesh import Array, Index, Mesh

# Rounding of a function that vanishes.
_SMALL = 1e-9


class Trace:
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

    def only(self, held: Any) -> "Trace":
        """Return that of the nodes at which only functions with ``held`` ``(layers, count)`` act."""
        weights = np.abs(self._axial[:, :, None] * self._section[:, None, :])
        kept = np.where(held[self._layers], 0.0, weights).max(axis=(1, 2)) < _SMALL
        some = object.__new__(Trace)
        some.space, some.nodes = self.space, self.nodes[kept]
        some._axial, some._layers, some._section = self._axial[kept], self._layers[kept], self._section[kept]
        return some

    def values(self, nodal: Array) -> Array:
        """Return the field with coefficients ``(nodes, 3)`` of the space at the mesh's nodes, shape ``(m, 3)``."""
        near = nodal.reshape(self.space.layers, -1, 3)[self._layers]
        return np.einsum("mj,ml,mjla->ma", self._axial, self._section, near, optimize=True)

    def control_point_mean(self, values: Array, held: Any) -> Array:
        """Return the mean of the control points among coefficients ``held`` that fit values ``(m, 3)`` best."""
        size = self.space.layers * self.space.layer_nodes
        rows = np.zeros((len(self.nodes), size))
        numbers = self._layers[:, :, None] * self.space.layer_nodes + np.arange(self.space.layer_nodes)
        weights = self._axial[:, :, None] * self._section[:, None, :]
        np.add.at(rows, (np.arange(len(rows))[:, None, None], numbers), weights)
        chosen = np.flatnonzero(held.ravel())
        coefficients = np.linalg.lstsq(rows[:, chosen], values, rcond=None)[0]
        return np.asarray(coefficients[self.space.is_control_point[chosen]].mean(axis=0))


class Held:
    """One support: the nodes of the mesh that it holds, and in which components.

    Attributes
    ----------
    nodes
        Of the mesh, shape ``(m,)``.
    components, tied
        Numbers of the components that it holds, and that it ties.

    Raises
    ------
    InputError
        If it holds no node.
    """

    def __init__(self, k: int, model: Model, trace: Trace) -> None:
        support, motion = model.supports[k], model.motions[k]
        assert isinstance(support, Support), "whoever asks has refused mean motions and springs"
        self.motion, self.body = motion, support.body
        self._fraction = partial(model.amplitude, motion.clock.table)
        self.first, self.space = int(model.first_node[support.body]), trace.space
        self.components, self.tied = (
            sorted("xyz".index(letter) for letter in letters) for letters in (support.components, support.tied)
        )
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
        nodal.ravel()[self.motion.dofs - 3 * self.first] = self.motion.at(self._fraction(factor))
        return nodal

    def centre(self, displacement: Array, moved: bool) -> Array:
        """Return the mean of the held control points at rest, or with the mesh's nodes displaced by ``(nodes, 3)``."""
        control_points = self.functions & self.space.is_control_point
        if not moved:
            return np.asarray(self.space.positions[control_points].mean(axis=0))
        change = self._prescribed(1.0)[control_points].mean(axis=0)
        free = np.setdiff1d(np.arange(3), self.components)
        if free.size:
            change[free] = self.trace.control_point_mean(displacement[self.nodes], self.functions)[free]
        return np.asarray(self.space.positions[control_points].mean(axis=0) + change)


def all_of(source: Mesh, model: Model) -> dict[int, Held]:
    """Return the supports that hold nodes, by number, on a mesh of rods (`meshes.rods.build`), or raise as `Held`."""
    holding = {k: support for k, support in enumerate(model.supports) if isinstance(support, Support)}
    traces = {b: surface(source, b, model.bodies[b].space) for b in {one.body for one in holding.values()}}
    return {k: Held(k, model, traces[support.body]) for k, support in holding.items()}


def surface(source: Mesh, body: int, space: Space) -> Trace:
    """Return the functions of a body's space at the nodes of the surface of its mesh."""
    faces: Sequence[Index] = [nodes for name, nodes in source.faces.items() if name.startswith(f"rod {body} ")]
    nodes = np.unique(np.concatenate([face.ravel() for face in faces]))
    return Trace(space, nodes, source.parameters_in(body, nodes))


def _on_disk(xi: Array) -> Array:
    """Return disk points, those beyond the circle by rounding on it."""
    return xi / np.maximum(1.0, np.linalg.norm(xi, axis=1, keepdims=True))
