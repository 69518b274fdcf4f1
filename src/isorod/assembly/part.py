"""The elements of one body that a rank assembles: their forces, tangents and masses."""

from collections.abc import Iterable
from functools import cached_property

import numpy as np

from isorod.arrays import Array, Index
from isorod.assembly import element_kernel
from isorod.assembly.exchange import Exchange
from isorod.assembly.extrapolation import Last
from isorod.assembly.gradients import deformation_gradients, displacement_gradients
from isorod.assembly.partition import ElementRange
from isorod.assembly.pattern import Layers
from isorod.assembly.pattern_kernel import Blocks
from isorod.assembly.region import NONE, Region, regions
from isorod.geometry.quadrature import Rule
from isorod.material.along_rod import Laws
from isorod.model.load import Spin


class Part:
    """The elements of one body that this rank assembles.

    Parameters
    ----------
    element_range
        Which they are.
    exchange
        Storage of their values on this rank.
    rule
        Quadrature rule in place of the space's own.

    Attributes
    ----------
    starts
        First slot on this rank of each element's layers, whose values are contiguous, shape ``(E, l)``.
    width
        Degrees of freedom of a layer, displacements first.
    """

    def __init__(self, element_range: ElementRange, exchange: Exchange, rule: Rule | None = None) -> None:
        body = element_range.body
        self.body, self.which = body, element_range.which
        self.first_node, self.first_dof = element_range.first_node, element_range.first_dof
        self.table = body.space.tabulate(element_range.first, element_range.last, rule)
        self.laws = body.laws_at(self.table.u, self.table.xi)
        self.layers = element_range.layers
        self.width = element_range.width
        self.element_range = element_range
        self.starts = exchange.slots(self.first_dof + self.width * self.layers)
        self.shape = (*self.layers.shape, body.space.layer_nodes, 3)
        self._extrapolates = False
        self._last: Last | None = None

    @cached_property
    def dofs(self) -> Index:
        """Degrees of freedom of each element, shape ``(E, l width)``."""
        return self.element_range.dofs

    @cached_property
    def slots(self) -> Index:
        """Slots on this rank of each element's values, shape ``(E, l width)``."""
        return self.slots_of(slice(None))

    def slots_of(self, which: Index | slice) -> Index:
        """Return the slots on this rank of some elements' values, shape ``(e, l width)``."""
        slots = self.starts[which][:, :, None] + np.arange(self.width)
        return slots.reshape(slots.shape[0], -1)

    def elements_of(self, slots: Index) -> Index:
        """Return the elements with any of these slots, which must ascend."""
        before, behind = np.searchsorted(slots, self.starts), np.searchsorted(slots, self.starts + self.width)
        return np.flatnonzero((behind > before).any(axis=1))

    @cached_property
    def regions(self) -> list[Region]:
        """Regions of one law each."""
        return regions(self.table, self.laws)

    def advance(self, local: Array, factor: float) -> None:
        """Update the internal variables of laws with memory at the end of a step."""
        if self.laws.remember:
            self.obey(self.laws.advanced(self.gradients(local), factor))

    def obey(self, laws: Laws) -> None:
        """Set the laws to other internal variables."""
        self.laws = laws
        for region, segment in zip(self.regions, laws.segments, strict=True):
            region.obey(segment.law)

    @property
    def of_dofs(self) -> Layers:
        """The layers' degrees of freedom."""
        return Layers(self.first_dof + self.width * self.layers, self.width)

    @property
    def of_nodes(self) -> Layers:
        """The layers' nodes."""
        count = self.body.space.layer_nodes
        return Layers(self.first_node + count * self.layers, count)

    @property
    def nodes(self) -> Index:
        """Nodes of each element, shape ``(E, l n)``."""
        own = self.body.space.element_nodes
        return self.first_node + own[self.table.first : self.table.first + self.table.elements]

    @cached_property
    def mass(self) -> Array:
        """Element mass matrices of one component, shape ``(E, l n, l n)``."""
        t = self.table
        mass = element_kernel.mass(t.section, t.axial, self.body.densities_at(t) * t.weights)
        return mass.reshape(mass.shape[0], mass.shape[1] * mass.shape[2], -1)

    def lumped_mass(self) -> Array:
        """Return the element masses of one component, shape ``(E, l n)``."""
        space = self.body.space
        is_control_point = space.is_control_point[space.element_nodes[0]]
        diagonal = np.einsum("eii->ei", self.mass)
        return np.where(is_control_point, self.mass @ is_control_point.astype(float), diagonal)

    def centrifugal(self, local: Array, spin: Spin) -> Array:
        """Return the centrifugal forces, shape of ``dofs``."""
        space = self.body.space
        nodes = space.element_nodes[self.table.first : self.table.first + self.table.elements]
        center = space.is_control_point[nodes, None] * np.array(spin.center)
        arm = space.positions[nodes] - center + self.nodal(local).reshape(*nodes.shape, 3)
        return self.padded(self.mass @ arm @ spin.field)

    def masses_of(self, tensor: Array) -> Array:
        """Return the element mass matrices times a tensor ``(3, 3)`` of components, shape of ``matrices``."""
        size = 3 * self.mass.shape[1]
        result = self.padded_matrices(np.einsum("eij,ab->eiajb", self.mass, tensor).reshape(-1, size, size))
        return result.reshape(*self.dofs.shape, -1)

    def padded(self, nodal: Array) -> Array:
        """Return nodal forces ``(E, l n, 3)`` in the shape of ``dofs``."""
        return nodal.reshape(self.dofs.shape)

    def padded_matrices(self, matrices: Array) -> Array:
        """Return matrices of displacements with room for other degrees of freedom of a layer."""
        return matrices

    def nodal(self, local: Array) -> Array:
        """Return the nodal displacements, shape ``(E, l, n, 3)``, of this rank's degrees of freedom ``local``."""
        moves = self.shape[2] * self.shape[3]
        return local[self.starts[:, :, None] + np.arange(moves)].reshape(self.shape)

    def gradients(self, local: Array) -> Array:
        """Return the deformation gradients, shape ``(E, t, q, 3, 3)``."""
        return deformation_gradients(self.table, self.nodal(local))

    def changes(self, local: Array) -> Array:
        """Return the displacement gradients, shape ``(E, t, q, 3, 3)``."""
        return displacement_gradients(self.table, self.nodal(local))

    def jacobians(self, local: Array) -> Array:
        """Return ``det F`` at the quadrature points, shape ``(E, t, q)``."""
        if not local.any():
            return np.ones(self.table.weights.shape)
        det = np.empty(self.table.weights.shape)
        for region in self.regions:
            region.set_jacobians(local, self.starts, det)
        return det

    def smallest_jacobian(self, local: Array) -> tuple[float, int, int, float]:
        """Return the smallest ``det F``, with body, element and axis parameter."""
        det = self.jacobians(local)
        e, t, _ = np.unravel_index(int(np.argmin(det)), det.shape)
        return float(det.min()), self.which, int(self.table.first + e), float(self.table.u[e, t])

    def energy(self, local: Array, factor: float) -> float:
        """Return the stored energy."""
        nothing = np.empty(0)
        return sum(region.add_forces(local, self.starts, factor, nothing, with_energy=True) for region in self.regions)

    def curvatures(self, local: Array, factor: float, motions: Iterable[Array]) -> Array:
        """Return the second derivatives of the stored energy along displacements of this rank's degrees of freedom."""
        moves = np.stack([motion[self.slots] for motion in motions], axis=1)
        return np.asarray(np.einsum("emi,emi->m", moves @ self.matrices(local, factor), moves))

    def add_forces(self, local: Array, factor: float, forces: Array) -> None:
        """Add the internal forces to those on this rank's degrees of freedom."""
        pressure = self.pressure(local)
        for region in self.regions:
            region.add_forces(local, self.starts, factor, forces, pressure)

    def pressure(self, local: Array) -> Array:
        """Return the pressure of the mixed formulation at the quadrature points ``(E, t, q)``; empty without one."""
        return NONE

    def inside(self, local: Array, factor: float) -> Array:
        """Return the nodal forces of each element, not summed over elements, one element after the other."""
        elements, functions = self.starts.shape
        starts = self.width * np.arange(elements * functions).reshape(elements, functions)
        forces, pressure = np.zeros(starts.size * self.width), self.pressure(local)
        for region in self.regions:
            region.add_forces(local[self.slots].ravel(), starts, factor, forces, pressure)
        return forces

    def add_activation(self, local: Array, factor: float, step: float, forces: Array) -> None:
        """Add the change of the internal forces due to the laws' dependence on the load factor in a step of it."""
        # Stress is linear in the activation, almost so in thermal strains: a small step would only lose digits.
        end, begin, scale = (factor + step, factor, 1.0) if self.laws.tabled else (factor + 0.5, factor - 0.5, step)
        after, before = np.zeros((2, local.size))
        self.add_forces(local, end, after)
        self.add_forces(local, begin, before)
        forces += scale * (after - before)

    @property
    def expelled(self) -> float:
        """Sum of the absolute element forces at rest under full load, as of activation or thermal strain."""
        if not self.laws.loaded:
            return 0.0
        return float(np.abs(self.inside(np.zeros(int(self.slots.max()) + 1), 1.0)).sum())

    def add(self, values: Array, total: Array) -> None:
        """Add element values, shape of ``dofs``, to the sums ``total`` on this rank's degrees of freedom."""
        total += np.bincount(self.slots.ravel(), values.ravel(), total.size)

    def matrices(self, local: Array, factor: float, which: Index | None = None) -> Array:
        """Return the element tangents, shape ``(E, l n 3, l n 3)``, or those of some elements."""
        pressure, starts, there = self.pressure(local), self.starts, self.regions
        if which is not None:
            pressure, starts = pressure[which] if pressure.size else pressure, starts[which]
            there = regions(self.table.part(which, slice(None)), self.laws.some(which))
        elements, functions = starts.shape
        blocks = separate(elements, functions, self.width)
        entries = np.zeros(blocks.total)
        for region in there:
            region.add_stiffness(local, starts, factor, blocks, entries, pressure)
        return entries.reshape(elements, functions * self.width, -1)

    def extrapolate(self, extrapolates: bool) -> None:
        """Make the next tangent exact; ``extrapolates`` is whether later ones extrapolate the stress."""
        self._extrapolates, self._last = extrapolates, None

    def add_entries(self, local: Array, factor: float, blocks: Blocks, entries: Array) -> None:
        """Add the element tangents to entries of a pattern."""
        pressure = self.pressure(local)
        for region in self.regions:
            region.add_stiffness(local, self.starts, factor, blocks, entries, pressure, self._last)
        self._last = Last(local, pressure) if self._extrapolates else None


def separate(elements: int, functions: int, size: int) -> Blocks:
    """Return the blocks of separate, dense element matrices with ``size`` rows a layer."""
    width = functions * size
    layer = np.arange(functions)
    start = width * width * np.arange(elements)[:, None, None] + size * (width * layer[:, None] + layer)
    return Blocks(start, np.full(start.shape, width), elements * width * width)


# Round-off error of a stress over the stiffness, from rounding of the deformation gradient.
ROUNDING = 1e-15
