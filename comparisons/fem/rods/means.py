"""Nodal forces of what acts on whole sections: supports of mean motions, springs to ground, and moments.

A mean motion is held by a stiff spring and a multiplier that replaces its stretch (augmented Lagrangian).
"""

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from comparisons.fem.contact.facets import facet_of, gauss
from comparisons.fem.rods.elements import Elements
from isorod.assembly.section_moment import SectionMoment, spread_of
from isorod.model.load import SectionLoad
from isorod.model.mean import MeanSupport
from isorod.model.model import Model
from isorod.space.trace import Trace
from meshes.mesh import Array, Index
from meshes.within import Layers, lagrange

# Stiffness of held motions, in shear moduli times the section's size.  Stiffer springs, without a force of their own,
# are as good as rigid in modes, and lose that many digits of what they carry.
STIFF, RIGID = 1e4, 1e6

# Updates of the multipliers, each of which leaves less than 1e-3 of the stretch.
TIMES = 2

# Points on the line round a section.
_AROUND = 720


def section_on(elements: Elements, body: int, u: float) -> Trace:
    """Return the mesh's functions on a section between its cells, the same nodes at each point."""
    points = gauss(elements.source, facet_of(elements.source), elements.section(body, u))
    places = np.einsum("qn,qna->qa", points.shares, elements.source.points[points.supports])
    return _trace(places, points.weights, points.supports, points.shares)


def ring_on(elements: Elements, body: int, u: float) -> Trace:
    """Return the functions on the line round a section, at many points a cell; weights are lengths."""
    source, rod = elements.source, elements.rods[body]
    angles = 2.0 * np.pi * (np.arange(_AROUND) + 0.5) / _AROUND
    xi = rod.rings[-1] * np.column_stack([np.cos(angles), np.sin(angles)])
    position, jacobian = rod.grid(xi, [u])
    weights = np.linalg.norm(jacobian[0, ..., 1] * xi[:, :1] - jacobian[0, ..., 0] * xi[:, 1:], axis=1)
    own = elements.cells(body)
    layers = Layers(rod, source.order, source.reference, elements.parameters[own])
    rows, where = layers.find(np.column_stack([xi, np.full(len(xi), u)]))
    functions = lagrange(source.order, source.reference, where)
    return _trace(position[0], weights * 2.0 * np.pi / _AROUND, source.cells[own[rows]], functions)


def _trace(points: Array, weights: Array, supports: Index, functions: Array) -> Trace:
    nodes, place = np.unique(supports, return_inverse=True)
    values = np.zeros((len(points), len(nodes)))
    np.add.at(values, (np.arange(len(points))[:, None], place.reshape(supports.shape)), functions)
    return Trace(points, np.zeros_like(points), weights, np.tile(nodes, (len(points), 1)), values, nodes)


class Mean:
    """A `MeanSupport`, as `comparisons.fem.pressed.Touching`.

    Attributes
    ----------
    factor
        Load factor.
    carried
        Last forces along its directions and moments about its axes, on the model, ``(k,)``.
    """

    def __init__(self, elements: Elements, support: MeanSupport, unit: float, stiff: float) -> None:
        trace = (ring_on if support.ring else section_on)(elements, support.body, support.u)
        self._nodes, self._rows = support.rows_on(trace)
        self._rest, self._support, self.factor = elements.source.points, support, 1.0
        arms = trace.points - trace.weights @ trace.points / trace.weights.sum()
        size = float(np.sqrt(trace.weights @ np.sum(arms**2, axis=1) / trace.weights.sum()))
        held = stiff * unit * np.repeat([size, size**3], [len(support.directions), len(support.axes)])
        self.penalty = 0.0
        self._stiffness = held if support.stiffness is None else support.stiffness
        self._targets = support.values if support.stiffness is None else np.zeros(len(held))
        self._known = np.zeros(len(held))
        self.carried = self._known

    def add_forces(self, nodes: Array, out: Array) -> None:
        """Add the springs' nodal forces at positions ``(nodes, 3)``."""
        moved = np.einsum("kna,na->k", self._rows, nodes[self._nodes] - self._rest[self._nodes])
        pull = self._known + self._stiffness * (moved - self.factor * self._targets)
        out[self._nodes] += np.einsum("k,kna->na", pull, self._rows)
        self.carried = -pull

    def tighten(self) -> None:
        """Set the multipliers to the last forces: with another solution the stretch of the springs nearly vanishes."""
        if self._support.stiffness is None:
            self._known = -self.carried

    def stiffness(self, nodes: Array) -> sparse.coo_array:
        """Return the derivative of the forces, rows and columns ``3 node + component``."""
        flat = self._rows.reshape(len(self._rows), -1)
        return _dense(self._nodes, (self._stiffness * flat.T) @ flat, 3 * len(nodes))

    @property
    def resultant(self) -> tuple[Array, Array]:
        """Force and moment on the model, ``(3,)`` each."""
        directions, axes = self._support.directions, self._support.axes
        return self.carried[: len(directions)] @ directions, self.carried[len(directions) :] @ axes


class Moment(SectionMoment):
    """The moment of a load on a section that turns, as `comparisons.fem.pressed.Touching`."""

    def __init__(self, elements: Elements, model: Model, load: SectionLoad) -> None:
        breaks = model.bodies[load.body].space.axis.breaks
        trace = section_on(elements, load.body, float(breaks[-1] if load.u is None else load.u))
        self._nodes, self._moment = trace.nodes[0], np.array(load.moment)
        self._spread = spread_of(trace.weights, trace.values)
        self.factor, self.penalty = 1.0, 0.0

    def add_forces(self, nodes: Array, out: Array) -> None:
        """Subtract the load's forces."""
        out[self._nodes] -= self.factor * self.forces(nodes[self._nodes])

    def stiffness(self, nodes: Array) -> sparse.coo_array:
        """Return the derivative of these, which is not symmetric."""
        return _dense(self._nodes, -self.factor * self.derivatives(nodes[self._nodes]), 3 * len(nodes))


def means_of(elements: Elements, model: Model, unit: float, stiff: float = STIFF) -> dict[int, Mean]:
    """Return the supports of mean motions, by number; ``unit`` is a shear modulus."""
    return {k: Mean(elements, one, unit, stiff) for k, one in model.means.items()}


def moments_of(elements: Elements, model: Model) -> Sequence[Moment]:
    """Return the moments that depend on where sections are."""
    return [Moment(elements, model, load) for load in model.following if isinstance(load, SectionLoad)]


def _dense(nodes: Index, matrix: Array, size: int) -> sparse.coo_array:
    dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
    rows, columns = np.repeat(dofs, dofs.size), np.tile(dofs, dofs.size)
    return sparse.coo_array((matrix.ravel(), (rows, columns)), shape=(size, size))
