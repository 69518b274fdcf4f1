"""Residual, tangent and energy of a model as PETSc vectors and matrices; elements and rows split along the axis."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property, partial
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.entries import Entries, Numbered, joined, rows_and_columns
from isorod.assembly.exchange import Exchange, numbers
from isorod.assembly.extrapolation import Extrapolation, pays
from isorod.assembly.part import Part
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.petsc.matrix import componentwise, create_matrix, preallocate, set_values
from isorod.tensors import determinant

if TYPE_CHECKING:
    from isorod.contact.operator import ContactOperator

_SYMMETRIC = (PETSc.Mat.Option.SYMMETRIC, PETSc.Mat.Option.SYMMETRY_ETERNAL)


class Assembler:
    """Assembles a model over a communicator.

    Unknowns are the degrees of freedom that are not held, in their order, tied ones once; the displacement of a state
    ``x`` at load factor ``f`` is ``x`` on those plus what the supports prescribe (`Model.prescribed`).

    Attributes
    ----------
    contact
        Contact of the bodies (`isorod.contact.operator.ContactOperator`), or None.
    seconds
        Wall time spent in assembly so far.
    built
        Names of the operators that were built.
    carried
        Norm of the nodal forces of supports and loads at the last residual.
    free, unknowns
        As in the model; a subclass may have more degrees of freedom.
    first
        First degree of freedom of each body, and their number.
    """

    # What a subclass may add to.
    part: type[Part] = Part
    formulations: tuple[str, ...] = ("displacement",)

    def __init__(self, model: Model, comm: PETSc.Comm | None = None) -> None:
        self.model = model
        self.comm = PETSc.COMM_WORLD if comm is None else comm
        self.seconds = 0.0
        self.built: list[str] = []
        self.carried = 0.0
        # petsc4py keeps what Python has let go until it is told to destroy it, on all ranks together.
        PETSc.garbage_cleanup()
        self._stage = PETSc.Log.Stage("assembly")
        with self._timed():
            self._number()
            self._split()
            self.contact = self._contact()

    @contextmanager
    def _timed(self) -> Iterator[None]:
        start = perf_counter()
        self._stage.push()
        try:
            yield
        finally:
            self._stage.pop()
            self.seconds += perf_counter() - start

    def _note(self, operator: str) -> None:
        if operator not in self.built:
            self.built.append(operator)

    def _contact(self) -> "ContactOperator | None":
        if not self.model.contacts:
            return None
        if self.comm.getSize() > 1:
            raise InputError("contact runs on one MPI rank so far; start without mpirun")
        from isorod.contact.operator import ContactOperator

        self._note("contact")
        return ContactOperator(self.model)

    def _number(self) -> None:
        """Number the degrees of freedom, and the unknowns."""
        model = self.model
        for b, body in enumerate(model.bodies):
            if body.formulation not in self.formulations:
                raise InputError(f"body {b}: formulation {body.formulation!r} is for statics alone")
        self.free, self.unknowns = model.free, model.unknowns
        self.first = 3 * model.first_node
        self.block = 3 if model.whole_nodes else 1

    def _split(self) -> None:
        model, size, rank = self.model, self.comm.getSize(), self.comm.getRank()
        counts = np.array([body.space.axis.elements for body in model.bodies])
        first_element = np.concatenate([[0], np.cumsum(counts)])
        bounds = first_element[-1] * np.arange(size + 1) // size
        self.parts = []
        owner = np.zeros(self.first[-1], dtype=np.int64)
        for b, body in enumerate(model.bodies):
            low, high = (min(max(int(x - first_element[b]), 0), int(counts[b])) for x in bounds[rank : rank + 2])
            if high > low:
                self.parts.append(self.part(body, b, int(model.first_node[b]), int(self.first[b]), low, high))
            if size > 1:
                # A layer belongs to the rank of the first element that has it, so that rows follow the elements.
                touching = body.space.element_layers
                first_touch = np.full(body.space.layers, counts[b])
                np.minimum.at(first_touch, touching.ravel(), np.repeat(np.arange(counts[b]), touching.shape[1]))
                ranks = np.searchsorted(bounds, first_element[b] + first_touch, side="right") - 1
                owner[self.first[b] : self.first[b + 1]] = np.repeat(ranks, self.part.layer_dofs(body))

        window = None
        self.rows = self.unknowns
        if size > 1:
            self.rows = np.unique(self.free[(self.free >= 0) & (owner == rank)]).size
            window = np.unique(np.concatenate([np.empty(0, np.int64), *(part.dofs.ravel() for part in self.parts)]))
        self._owner = owner
        # No method of this object: Python would not let go of it, and of its matrices, before it looks for cycles.
        places = partial(numbers, model, self.first, self.part.layer_dofs)
        self._exchange = Exchange(self.vector() if size > 1 else None, self.free, window, places, model.bound)
        for part in self.parts:
            part.slots = self._exchange.slots(part.dofs)
            count = part.body.space.layers
            held = self.free[part.first_dof :][: count * part.width].reshape(count, -1).max(axis=1) < 0
            part.free_layers = np.where(held[part.layers], -1, part.layers)
        self._local = np.zeros(self._exchange.size)

    @cached_property
    def _constant(self) -> bool:
        """Whether no state changes the tangent, which then is not loaded; on all ranks alike, since loading one takes them all."""
        return self.contact is None and all(body.linear for body in self.model.bodies)

    @cached_property
    def _external(self) -> Array:
        """Forces of the loads at load factor 1."""
        result = np.zeros(self._exchange.size)
        if self.model.loads:
            # Each rank loads its own degrees of freedom only, so that shared ones are loaded once.
            mine = self._owner[self._exchange.places] == self.comm.getRank()
            moved, slots = self._exchange.moved
            result[slots] = np.where(mine, self.model.external, 0.0)[moved]
        return result

    def vector(self) -> PETSc.Vec:
        """Return a new zero vector of unknowns."""
        vector = PETSc.Vec().create(self.comm)
        vector.setSizes((self.rows, self.unknowns))
        vector.setBlockSize(self.block)
        vector.setFromOptions()
        vector.zeroEntries()
        return vector

    def _matrix(self, entries: Sequence[Entries], components: int = 1) -> PETSc.Mat:
        """Return a new symmetric matrix of one of several components, with room for entries."""
        rows, unknowns, block = (size // components for size in (self.rows, self.unknowns, self.block))
        alone = entries[0] if len(entries) == 1 and isinstance(entries[0], Numbered) else None
        made = create_matrix(
            self.comm,
            (rows, unknowns),
            block,
            lambda: rows_and_columns(entries),
            None if alone is None else lambda: alone.pattern.compressed_rows(alone.number, unknowns),
        )
        for option in _SYMMETRIC:
            made.setOption(option, True)
        return made

    def matrix(self) -> PETSc.Mat:
        """Return a new symmetric matrix with room for the tangent: AIJ, or what ``-mat_type`` says."""
        with self._timed():
            made = self._matrix(self._tangent_entries())
            if self.contact is not None:
                made.setAttr("contact_version", self.contact.version)
            self._note("tangent")
        return made

    def _tangent_entries(self) -> list[Entries]:
        entries: list[Entries] = [Numbered(part.pattern, self.free[part.first_dof :]) for part in self.parts]
        if self.contact is not None:
            entries.append((self.model.free[self.contact.rows], self.model.free[self.contact.columns]))
        return entries

    def _load(self, x: PETSc.Vec, factor: float) -> None:
        moved, slots = self._exchange.moved
        self._local[:] = 0.0
        self._local[slots] = self.model.prescribed(factor)[moved]
        self._exchange.add_unknowns(x, self._local)

    def _forces(self, factor: float) -> Array:
        spin = self.model.spin
        total = np.zeros(self._local.size)
        for part in self.parts:
            forces = part.forces(self._local, factor)
            if spin is not None:
                forces -= factor * part.centrifugal(self._local, spin)
            total += np.bincount(part.slots.ravel(), forces.ravel(), total.size)
        if self.contact is not None:
            total -= self.contact.forces(self._local)[0]
        return total - factor * self._external

    def extrapolate(self) -> None:
        """Let the next tangent be exact, and those of slender bodies after it extrapolate the stress (`isorod.assembly.extrapolation`)."""
        for part in self.parts:
            part.extrapolation = Extrapolation() if part.laws.objective and pays(part.body.space.rod) else None

    def residual(self, x: PETSc.Vec, factor: float, out: PETSc.Vec) -> None:
        """Fill ``out`` with the internal less the external forces on the unknowns (NaN where an element is inverted)."""
        with self._timed():
            self._load(x, factor)
            forces = self._forces(factor)
            self._exchange.store(forces, out)
            own = float(np.sum(forces[self._exchange.bound[1]] ** 2) + np.sum((factor * self._external) ** 2))
            self.carried = float(np.sqrt(self.comm.tompi4py().allreduce(own)))

    def reactions(self, x: PETSc.Vec, factor: float) -> Array:
        """Return the forces of the supports on the model, one a degree of freedom in `Model.bound`, on every rank."""
        with self._timed():
            self._load(x, factor)
            forces = np.zeros(self.model.bound.size)
            bound, slots = self._exchange.bound
            forces[bound] = self._forces(factor)[slots]
            return np.asarray(self.comm.tompi4py().allreduce(forces))

    def imbalance(self, x: PETSc.Vec, factor: float) -> tuple[Array, Array]:
        """Return the resultant ``(3,)`` of the forces on what no support holds, and what rounding makes of those in `Model.bound`.

        The latter is the change of the internal forces, none but for rounding, when everything moves by the model's
        size.
        """
        with self._timed():
            self._load(x, factor)
            moved, slots = self._exchange.moved
            carried = self.model.carries[moved // 3]
            loose = carried & ~np.isin(moved, self.model.bound)
            total = self._forces(factor)[slots]
            resultant = np.bincount(moved[loose] % 3, total[loose], 3)
            change = np.zeros(self._local.size)
            for sign in (-1.0, 1.0):
                for part in self.parts:
                    forces = part.forces(self._local, factor).ravel()
                    change += sign * np.bincount(part.slots.ravel(), forces, change.size)
                self._local[slots[carried]] += self.model.size
            noise = np.zeros(self.model.bound.size)
            bound, slots = self._exchange.bound
            noise[bound] = change[slots]
            comm = self.comm.tompi4py()
            return np.asarray(comm.allreduce(resultant)), np.asarray(comm.allreduce(noise))

    def tangent(self, x: PETSc.Vec, factor: float, out: PETSc.Mat, keep: bool = False) -> list[Array]:
        """Fill ``out`` with the tangent stiffness and return, if they are to be kept, the element matrices of this rank's parts."""
        with self._timed():
            if not self._constant:
                self._load(x, factor)
            matrices = []
            if keep or self.model.spin is not None:
                matrices = [part.matrices(self._local, factor) for part in self.parts]
                if self.model.spin is not None:
                    for part, block in zip(self.parts, matrices, strict=True):
                        block -= factor * part.softening(self.model.spin)
                merged = [part.pattern.merge(block) for part, block in zip(self.parts, matrices, strict=True)]
            else:
                merged = [part.entries(self._local, factor) for part in self.parts]
            if self.contact is not None:
                merged.append(self.contact.tangent(self._local))
                if out.getAttr("contact_version") != self.contact.version:
                    preallocate(out, *rows_and_columns(self._tangent_entries()))
                    out.setAttr("contact_version", self.contact.version)
            set_values(out, joined(merged, float))
            return matrices if keep else []

    def load_forces(self, x: PETSc.Vec, factor: float, matrices: list[Array], step: float, out: PETSc.Vec) -> None:
        """Fill ``out`` with the linearised change of the residual when the load factor grows by ``step`` at ``x``."""
        with self._timed():
            self._load(x, factor)
            moved, slots = self._exchange.moved
            move = np.zeros(self._local.size)
            move[slots] = (self.model.prescribed(factor + step) - self.model.prescribed(factor))[moved]
            total = -step * self._external
            for part, blocks in zip(self.parts, matrices, strict=True):
                change = np.einsum("eij,ej->ei", blocks, move[part.slots])
                if self.model.spin is not None:
                    change -= step * part.centrifugal(self._local, self.model.spin)
                if part.laws.loaded:
                    # Stress is linear in the activation.
                    change += step * (part.forces(self._local, 1.0) - part.forces(self._local, 0.0))
                total += np.bincount(part.slots.ravel(), change.ravel(), total.size)
            if self.contact is not None:
                total += self.contact.product(move)
            self._exchange.store(total, out)

    def mass(self, lumped: bool = False) -> PETSc.Mat:
        """Return the mass matrix of the unknowns, consistent or lumped.

        Lumped, the functions that add up to one (`Space.carries`) get their row sums over each other, so that the total
        mass is right; the others get their diagonal entries.
        """
        with self._timed():
            found = [part.mass_entries(lumped, self.model.free[a::3]) for a in range(3) for part in self.parts]
            matrix = self._matrix([entries for entries, _ in found])
            set_values(matrix, joined([merged for _, merged in found], float))
            self._note("lumped mass" if lumped else "mass")
        return matrix

    def mass_operator(self, lumped: bool = False) -> PETSc.Mat:
        """Return the mass matrix to multiply with: one component's (PETSc's MAIJ), where none of a node's is held without the others."""
        if not self.model.whole_nodes or PETSc.Options().hasName("mat_type"):
            return self.mass(lumped)
        with self._timed():
            found = [part.mass_entries(lumped, self.model.free[::3] // 3) for part in self.parts]
            one = self._matrix([entries for entries, _ in found], 3)
            set_values(one, joined([merged for _, merged in found], float))
            matrix = componentwise(one, 3)
            for option in _SYMMETRIC:
                matrix.setOption(option, True)
            one.destroy()
            self._note("lumped mass" if lumped else "mass")
        return matrix

    def energy(self, x: PETSc.Vec, factor: float) -> float:
        """Return the stored energy of the whole model, that of contact included."""
        with self._timed():
            self._load(x, factor)
            energy = sum(part.energy(self._local, factor) for part in self.parts)
            if self.contact is not None:
                energy += self.contact.forces(self._local)[1]
            return float(self.comm.tompi4py().allreduce(energy))

    def state(self, displacement: Array) -> PETSc.Vec:
        """Return the unknowns of a vector of all degrees of freedom."""
        x = self.vector()
        first, last = x.getOwnershipRange()
        x.array_w[:] = self._unknowns(displacement)[first:last]
        return x

    def _unknowns(self, displacement: Array) -> Array:
        # A tied unknown is read off the first of those that share it.
        _, first = np.unique(self.model.free, return_index=True)
        return displacement[first[first.size - self.model.unknowns :]]

    def _displacements(self, unknowns: Array) -> Array:
        """Return those unknowns that are displacements, in the model's order."""
        return unknowns

    def all_unknowns(self, x: PETSc.Vec) -> Array:
        """Return all unknowns of a vector, on every rank."""
        return self._exchange.all_unknowns(x)

    def shapes(self, unknowns: Array) -> Array:
        """Return all degrees of freedom ``(m, dofs)`` of motions ``(m, unknowns)`` that move no support."""
        result = np.zeros((unknowns.shape[0], self.model.dofs))
        is_free = self.model.free >= 0
        result[:, is_free] = unknowns[:, self.model.free[is_free]]
        return result

    def displacement(self, x: PETSc.Vec, factor: float) -> Array:
        """Return all degrees of freedom, shape ``(dofs,)``, on every rank."""
        result = self.model.prescribed(factor)
        is_free = self.model.free >= 0
        result[is_free] += self._displacements(self.all_unknowns(x))[self.model.free[is_free]]
        return result

    def pressures(self, x: PETSc.Vec) -> "Sequence[Array | None]":
        """Return the pressures of mixed bodies (`isorod.assembly.mixed`): none here."""
        return ()

    def jacobians(self, x: PETSc.Vec, factor: float) -> list[Array]:
        """Return ``det F`` at the points of this rank's parts, one where a linear law does not care."""
        self._load(x, factor)
        return [
            determinant(part.gradients(self._local)) if part.laws.objective else np.ones(part.table.weights.shape)
            for part in self.parts
        ]

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
