"""Residual, tangent and energy of a model as PETSc vectors and matrices; elements and rows split along the axis."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from time import perf_counter

import numpy as np
from petsc4py import PETSc

from isorod import kernel, rigid
from isorod.disk import Array
from isorod.model import Body, Model, Spin
from isorod.pattern import Pattern
from isorod.petsc import preallocate_coo, set_values_coo
from isorod.small import determinant
from isorod.space import Table
from isorod.spline import Index


class _Part:
    """The elements of one body that this rank assembles."""

    def __init__(self, body: Body, index: int, first_node: int, first: int, last: int) -> None:
        self.body = body
        self.index = index
        self.table: Table = body.space.tabulate(first, last)
        nodes = first_node + body.space.element_nodes[first:last]
        self.dofs: Index = (3 * nodes[:, :, None] + np.arange(3)).reshape(nodes.shape[0], -1)
        degree = body.space.axis.degree
        self.shape = (nodes.shape[0], degree + 1, body.space.layer_nodes, 3)
        self.slots: Index = np.empty(0, dtype=np.int64)
        self.first_node = first_node
        self.layers = body.space.element_layers[first:last]

    @cached_property
    def pattern(self) -> Pattern:
        """Pattern of the degrees of freedom."""
        return Pattern(self.layers, 3 * self.body.space.layer_nodes)

    @cached_property
    def mass(self) -> Array:
        """Element mass matrices of one component, shape ``(E, l n, l n)``."""
        t = self.table
        mass = kernel.mass(t.section, t.axial, self.body.density * t.weights)
        return mass.reshape(mass.shape[0], mass.shape[1] * mass.shape[2], -1)

    def lumped_mass(self) -> Array:
        """Return the element masses of one component, shape ``(E, l n)``."""
        space = self.body.space
        carries = space.carries[space.element_nodes[0]]
        diagonal = np.einsum("eii->ei", self.mass)
        return np.where(carries, self.mass @ carries.astype(float), diagonal)

    def centrifugal(self, local: Array, spin: Spin) -> Array:
        """Return the centrifugal forces, shape of ``dofs``."""
        space = self.body.space
        nodes = space.element_nodes[self.table.first : self.table.first + self.table.elements]
        center = space.carries[nodes, None] * np.array(spin.center)
        arm = space.positions[nodes] - center + local[self.slots].reshape(*nodes.shape, 3)
        return (self.mass @ arm @ spin.field).reshape(self.dofs.shape)

    def softening(self, spin: Spin) -> Array:
        """Return the derivatives of the centrifugal forces, shape of ``matrices``."""
        size = self.dofs.shape[1]
        return np.einsum("eij,ab->eiajb", self.mass, spin.field).reshape(-1, size, size)

    def gradients(self, local: Array) -> Array:
        t = self.table
        nodal = local[self.slots].reshape(self.shape)
        return kernel.deformation_gradients(t.section, t.axial, t.slopes, t.inverse, nodal)

    def forces(self, F: Array) -> Array:
        t = self.table
        stress = self.body.material.stress(F)
        forces = kernel.internal_forces(t.section, t.axial, t.slopes, t.inverse, t.weights, stress)
        return forces.reshape(self.dofs.shape)

    def matrices(self, F: Array) -> Array:
        t = self.table
        tangent = np.ascontiguousarray(self.body.material.tangent(F))
        matrices = kernel.stiffness(t.section, t.axial, t.slopes, t.inverse, t.weights, tangent)
        return matrices.reshape(*self.dofs.shape, self.dofs.shape[1])


class Assembler:
    """Assembles a model over a communicator.

    Unknowns are the degrees of freedom that are not held, in their order; the displacement of a state ``x`` at
    load factor ``f`` is ``x`` on those and ``f`` times the prescribed value on the others.

    Attributes
    ----------
    seconds
        Wall time spent in assembly so far.
    built
        Names of the operators that were built.
    """

    def __init__(self, model: Model, comm: PETSc.Comm | None = None) -> None:
        self.model = model
        self.comm = PETSc.COMM_WORLD if comm is None else comm
        self.seconds = 0.0
        self.built: list[str] = []
        # petsc4py keeps what Python has let go until it is told to destroy it, on all ranks together.
        PETSc.garbage_cleanup()
        self._stage = PETSc.Log.Stage("assembly")
        with self._timed():
            self._split()

    @contextmanager
    def _timed(self) -> Iterator[None]:
        start = perf_counter()
        self._stage.push()
        try:
            yield
        finally:
            self._stage.pop()
            self.seconds += perf_counter() - start

    def _split(self) -> None:
        model, size, rank = self.model, self.comm.getSize(), self.comm.getRank()
        counts = np.array([body.space.axis.elements for body in model.bodies])
        first_element = np.concatenate([[0], np.cumsum(counts)])
        bounds = first_element[-1] * np.arange(size + 1) // size
        self.parts = []
        owner = np.empty(model.first_node[-1], dtype=np.int64)
        for b, body in enumerate(model.bodies):
            low, high = (int(np.clip(x - first_element[b], 0, counts[b])) for x in bounds[rank : rank + 2])
            if high > low:
                self.parts.append(_Part(body, b, int(model.first_node[b]), low, high))
            # A layer belongs to the rank of the first element that has it, so that rows follow the elements.
            touching = body.space.element_layers
            first_touch = np.full(body.space.layers, counts[b])
            np.minimum.at(first_touch, touching.ravel(), np.repeat(np.arange(counts[b]), touching.shape[1]))
            ranks = np.searchsorted(bounds, first_element[b] + first_touch, side="right") - 1
            owner[model.first_node[b] : model.first_node[b + 1]] = np.repeat(ranks, body.space.layer_nodes)

        is_free = model.free >= 0
        self.rows = int(np.count_nonzero(is_free & (np.repeat(owner, 3) == rank)))
        window = np.unique(np.concatenate([np.empty(0, np.int64), *(part.dofs.ravel() for part in self.parts)]))
        for part in self.parts:
            part.slots = np.searchsorted(window, part.dofs)
        self._local = np.zeros(window.size)
        self._free_slots = np.flatnonzero(is_free[window])
        self._held_slots = np.flatnonzero(~is_free[window])
        self._held_index = np.searchsorted(model.held, window[self._held_slots])
        free = model.free[window[self._free_slots]].astype(PETSc.IntType)
        x = self.vector()
        self._near = PETSc.Vec().createSeq(free.size)
        self._scatter = PETSc.Scatter().create(x, PETSc.IS().createGeneral(free, PETSc.COMM_SELF), self._near, None)
        self._everything: tuple[PETSc.Scatter, PETSc.Vec] | None = None

    def vector(self) -> PETSc.Vec:
        """Return a new zero vector of unknowns."""
        vector = PETSc.Vec().create(self.comm)
        vector.setSizes((self.rows, self.model.unknowns))
        if self.model.whole_nodes:
            vector.setBlockSize(3)
        vector.setFromOptions()
        vector.zeroEntries()
        return vector

    def _empty_matrix(self) -> PETSc.Mat:
        sizes = (self.rows, self.model.unknowns)
        matrix = PETSc.Mat().create(self.comm)
        matrix.setSizes((sizes, sizes))
        if self.model.whole_nodes:
            matrix.setBlockSize(3)
        matrix.setType(PETSc.Mat.Type.AIJ)
        matrix.setFromOptions()
        return matrix

    def matrix(self) -> PETSc.Mat:
        """Return a new symmetric AIJ matrix, preallocated for the tangent (COO)."""
        with self._timed():
            matrix = self._empty_matrix()
            indices = []
            for part in self.parts:
                free = self.model.free[3 * part.first_node :]
                indices.append([free[index] for index in part.pattern.indices()])
            preallocate_coo(matrix, *_joined(indices))
            matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
            self.built.append("tangent")
        return matrix

    def near_null_space(self) -> PETSc.NullSpace:
        """Return the rigid motions of all bodies on the unknowns, for algebraic multigrid."""
        vectors: list[PETSc.Vec] = []
        for b, body in enumerate(self.model.bodies):
            for motion in rigid.motions(body.space).T:
                everywhere = np.zeros(self.model.dofs)
                everywhere[3 * self.model.first_node[b] : 3 * self.model.first_node[b + 1]] = motion
                vector = self.state(everywhere)
                for other in vectors:
                    vector.axpy(-vector.dot(other), other)
                vector.normalize()
                vectors.append(vector)
        self.built.append("near-null space")
        return PETSc.NullSpace().create(vectors=vectors, comm=self.comm)

    def _load(self, x: PETSc.Vec, factor: float) -> None:
        self._scatter.scatter(x, self._near, PETSc.InsertMode.INSERT_VALUES, PETSc.ScatterMode.FORWARD)
        self._local[self._free_slots] = self._near.array_r
        self._local[self._held_slots] = factor * self.model.values[self._held_index]

    def _store(self, local: Array, out: PETSc.Vec) -> None:
        self._near.array_w[:] = local[self._free_slots]
        out.zeroEntries()
        self._scatter.scatter(self._near, out, PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.REVERSE)

    def _forces(self, factor: float) -> Array:
        spin = self.model.spin
        total = np.zeros(self._local.size)
        for part in self.parts:
            forces = part.forces(part.gradients(self._local))
            if spin is not None:
                forces -= factor * part.centrifugal(self._local, spin)
            total += np.bincount(part.slots.ravel(), forces.ravel(), total.size)
        return total

    def residual(self, x: PETSc.Vec, factor: float, out: PETSc.Vec) -> None:
        """Fill ``out`` with the internal forces on the unknowns (NaN where an element is inverted)."""
        with self._timed():
            self._load(x, factor)
            self._store(self._forces(factor), out)

    def reactions(self, x: PETSc.Vec, factor: float) -> Array:
        """Return the forces of the supports on the model, one a degree of freedom in `Model.held`, on every rank."""
        with self._timed():
            self._load(x, factor)
            forces = np.zeros(self.model.held.size)
            forces[self._held_index] = self._forces(factor)[self._held_slots]
            return np.asarray(self.comm.tompi4py().allreduce(forces))

    def tangent(self, x: PETSc.Vec, factor: float, out: PETSc.Mat) -> list[Array]:
        """Fill ``out`` with the tangent stiffness and return the element matrices of this rank's parts."""
        with self._timed():
            self._load(x, factor)
            matrices = [part.matrices(part.gradients(self._local)) for part in self.parts]
            if self.model.spin is not None:
                for part, block in zip(self.parts, matrices, strict=True):
                    block -= factor * part.softening(self.model.spin)
            merged = [part.pattern.merge(block) for part, block in zip(self.parts, matrices, strict=True)]
            set_values_coo(out, np.concatenate([np.empty(0), *merged]))
            return matrices

    def load_forces(self, x: PETSc.Vec, factor: float, matrices: list[Array], step: float, out: PETSc.Vec) -> None:
        """Fill ``out`` with the linearised change of the residual when the load factor grows by ``step`` at ``x``."""
        with self._timed():
            self._load(x, factor)
            move = np.zeros(self._local.size)
            move[self._held_slots] = step * self.model.values[self._held_index]
            total = np.zeros(move.size)
            for part, blocks in zip(self.parts, matrices, strict=True):
                change = np.einsum("eij,ej->ei", blocks, move[part.slots])
                if self.model.spin is not None:
                    change -= step * part.centrifugal(self._local, self.model.spin)
                total += np.bincount(part.slots.ravel(), change.ravel(), total.size)
            self._store(total, out)

    def mass(self, lumped: bool = False) -> PETSc.Mat:
        """Return the mass matrix of the unknowns, consistent or lumped.

        Lumped, the functions that add up to one (`Space.carries`) get their row sums over each other, so that the total mass is
        right; the others get their diagonal entries.
        """
        with self._timed():
            matrix = self._empty_matrix()
            indices, values = [], [np.empty(0)]
            for part in self.parts:
                if lumped:
                    nodes = part.dofs[:, ::3].ravel() // 3
                    places, merged = (nodes, nodes), part.lumped_mass().ravel()
                else:
                    pattern = Pattern(part.layers, part.body.space.layer_nodes)
                    row, column = pattern.indices()
                    places, merged = (part.first_node + row, part.first_node + column), pattern.merge(part.mass)
                for a in range(3):
                    indices.append([self.model.free[3 * nodes + a] for nodes in places])
                    values.append(merged)
            preallocate_coo(matrix, *_joined(indices))
            set_values_coo(matrix, np.concatenate(values))
            matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
            self.built.append("lumped mass" if lumped else "mass")
        return matrix

    def energy(self, x: PETSc.Vec, factor: float) -> float:
        """Return the stored energy of the whole model."""
        with self._timed():
            self._load(x, factor)
            energy = 0.0
            for part in self.parts:
                energy += float(np.sum(part.table.weights * part.body.material.energy(part.gradients(self._local))))
            return float(self.comm.tompi4py().allreduce(energy))

    def state(self, displacement: Array) -> PETSc.Vec:
        """Return the unknowns of a vector of all degrees of freedom."""
        x = self.vector()
        first, last = x.getOwnershipRange()
        x.array_w[:] = displacement[self.model.free >= 0][first:last]
        return x

    def displacement(self, x: PETSc.Vec, factor: float) -> Array:
        """Return all degrees of freedom, shape ``(dofs,)``, on every rank."""
        if self._everything is None:
            self._everything = PETSc.Scatter.toAll(x)
        scatter, everything = self._everything
        scatter.scatter(x, everything, PETSc.InsertMode.INSERT_VALUES, PETSc.ScatterMode.FORWARD)
        result = np.empty(self.model.dofs)
        result[self.model.free >= 0] = everything.array_r
        result[self.model.held] = factor * self.model.values
        return result

    def smallest_jacobian(self, x: PETSc.Vec, factor: float) -> tuple[float, int, int, float]:
        """Return the smallest ``det F`` over all ranks, with its body, element and axis parameter ``u``."""
        self._load(x, factor)
        found = [(np.inf, -1, -1, np.nan)]
        for part in self.parts:
            det = determinant(part.gradients(self._local))
            e, t, _ = np.unravel_index(int(np.argmin(det)), det.shape)
            table = part.table
            found.append((float(det.min()), part.index, int(table.first + e), float(table.u[e, t])))
        return min(self.comm.tompi4py().allgather(min(found)))


def _joined(indices: Sequence[Sequence[Index]]) -> list[Index]:
    """Return rows and columns of all parts, those of held degrees of freedom negative."""
    empty = np.empty(0, dtype=np.int64)
    return [np.concatenate([empty, *(pair[k] for pair in indices)]) for k in range(2)]
