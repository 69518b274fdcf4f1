"""What acts on sections as a whole: supports of mean motions, springs to ground, and moments, as forces on nodes.

What holds a mean motion is a stiff spring with a force that makes up for its stretch (an augmented Lagrangian); the
mean is isorod's own, over its points of the section.
"""

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from comparisons.fem.rods.elements import Elements
from isorod.assembly.twisting import Twisting, spread_of
from isorod.model.load import SectionLoad
from isorod.model.mean import MeanSupport
from isorod.model.model import Model
from isorod.space.trace import Trace
from meshes.mesh import Array, Index
from meshes.within import Places, lagrange

# Stiffness of what is held, in shear moduli times the section's size: of a rod it is that times as compliant.
_STIFF = 1e6


def on_mesh(elements: Elements, body: int, trace: Trace) -> Trace:
    """Return the mesh's functions at the points of a trace, the same nodes at each."""
    source = elements.source
    cells = source.cells[elements.cells(body)]
    found, where = Places(source.shape, source.order, source.reference, source.points[cells]).find(trace.points)
    nodes, place = np.unique(cells[found], return_inverse=True)
    values = np.zeros((len(found), len(nodes)))
    np.add.at(
        values,
        (np.arange(len(found))[:, None], place.reshape(len(found), -1)),
        lagrange(source.order, source.reference, where),
    )
    return trace._replace(nodes=np.tile(nodes, (len(found), 1)), values=values)


class Mean:
    """A `MeanSupport`, as `comparisons.fem.pressed.Touching`.

    Attributes
    ----------
    factor
        Load factor.
    carried
        Force along its ways and moments about its axes on the model, ``(k,)``, of the last forces.
    """

    def __init__(self, elements: Elements, model: Model, support: MeanSupport, unit: float) -> None:
        trace = on_mesh(elements, support.body, support.trace(model.bodies[support.body].space))
        self._nodes, self._rows = support.rows_on(trace)
        self._rest, self._support, self.factor = elements.source.points, support, 1.0
        arms = trace.points - trace.weights @ trace.points / trace.weights.sum()
        size = float(np.sqrt(trace.weights @ np.sum(arms**2, axis=1) / trace.weights.sum()))
        held = _STIFF * unit * np.repeat([size, size**3], [len(support.ways), len(support.axes)])
        self.penalty = 0.0
        self._stiffness = held if support.stiffness is None else support.stiffness
        self._wanted = support.values if support.stiffness is None else np.zeros(len(held))
        self._known = np.zeros(len(held))
        self.carried = self._known

    def add_forces(self, nodes: Array, out: Array) -> None:
        """Add what the springs pull the nodes with, positions ``(nodes, 3)``."""
        moved = np.einsum("kna,na->k", self._rows, nodes[self._nodes] - self._rest[self._nodes])
        pull = self._known + self._stiffness * (moved - self.factor * self._wanted)
        out[self._nodes] += np.einsum("k,kna->na", pull, self._rows)
        self.carried = -pull

    def tighten(self) -> None:
        """Let what holds know what it carries: with another solution nothing gives way any more."""
        if self._support.stiffness is None:
            self._known = -self.carried

    def stiffness(self, nodes: Array) -> sparse.coo_array:
        """Return the derivative of the forces, rows and columns ``3 node + component``."""
        flat = self._rows.reshape(len(self._rows), -1)
        return _dense(self._nodes, (self._stiffness * flat.T) @ flat, 3 * len(nodes))

    @property
    def resultant(self) -> tuple[Array, Array]:
        """Force and moment on the model, ``(3,)`` each."""
        ways, axes = self._support.ways, self._support.axes
        return self.carried[: len(ways)] @ ways, self.carried[len(ways) :] @ axes


class Moment(Twisting):
    """The moment of a load on a section that turns, as `comparisons.fem.pressed.Touching`."""

    def __init__(self, elements: Elements, model: Model, load: SectionLoad) -> None:
        trace = on_mesh(elements, load.body, load.trace(model.bodies[load.body].space))
        self._nodes, self._moment = trace.nodes[0], np.array(load.moment)
        self._spread = spread_of(trace.weights, trace.values)
        self.factor, self.penalty = 1.0, 0.0

    def add_forces(self, nodes: Array, out: Array) -> None:
        """Take the load's forces from those inside."""
        out[self._nodes] -= self.factor * self.forces(nodes[self._nodes])

    def stiffness(self, nodes: Array) -> sparse.coo_array:
        """Return the derivative of these, which is not symmetric."""
        return _dense(self._nodes, -self.factor * self.derivatives(nodes[self._nodes]), 3 * len(nodes))


def means_of(elements: Elements, model: Model, unit: float) -> dict[int, Mean]:
    """Return the supports of mean motions, by number; ``unit`` is a shear modulus."""
    return {k: Mean(elements, model, one, unit) for k, one in model.means.items()}


def moments_of(elements: Elements, model: Model) -> Sequence[Moment]:
    """Return the moments that depend on where sections are."""
    return [Moment(elements, model, load) for load in model.following if isinstance(load, SectionLoad)]


def _dense(nodes: Index, matrix: Array, size: int) -> sparse.coo_array:
    dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
    rows, columns = np.repeat(dofs, dofs.size), np.tile(dofs, dofs.size)
    return sparse.coo_array((matrix.ravel(), (rows, columns)), shape=(size, size))
