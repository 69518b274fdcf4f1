"""Residual, tangent and energy of a model as PETSc vectors and matrices; elements and rows split along the axis."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly.extrapolation import pays
from isorod.assembly.loaded import Loaded
from isorod.assembly.part import Part
from isorod.assembly.pattern import Pattern, add
from isorod.geometry.quadrature import Rule
from isorod.material.along_rod import Laws
from isorod.model.model import Model
from isorod.petsc.matrix import fits, keep_symmetric, preallocate, set_values, zeros

if TYPE_CHECKING:
    from isorod.contact.operator import ContactOperator

# Attribute of a tangent: the pattern of the parts' entries.
_PATTERN = "isorod_pattern"


class Assembler(Loaded):
    """Assembles a model over a communicator.

    Attributes
    ----------
    contact
        Contact of the bodies (`isorod.contact.operator.ContactOperator`), or None.
    """

    def __init__(self, model: Model, comm: PETSc.Comm | None = None) -> None:
        # The elements' entries of the last tangent, kept where there is contact.
        self._elements: Array | None = None
        # With contact: the model's displacement at the last local state, followed by that of the facets that rods
        # touch, and the contact forces on these facets.
        self._everywhere: Array = np.empty(0)
        self._pushed: Array = np.empty(0)
        super().__init__(model, comm)
        with self._timed():
            self.contact = self._contact()

    def _contact(self) -> "ContactOperator | None":
        if not self.model.contacts:
            return None
        from isorod.contact.operator import ContactOperator

        self.note("contact")
        return ContactOperator(self.model, self.comm)

    def _state(self, x: PETSc.Vec, factor: float) -> Array:
        local = super()._state(x, factor)
        if self.contact is not None:
            self.contact.place(factor)
            # Surfaces meet those of other ranks' elements.
            moved = self.displacement(x, factor) if self.comm.getSize() > 1 else self._moves(local)
            self._everywhere = self._with_facets(moved, x, factor)
        return local

    def _with_facets(self, moved: Array, x: PETSc.Vec, factor: float) -> Array:
        """Return a displacement of the rods ``(dofs,)``, followed by that of the facets that they touch."""
        if self.coupling is None or self.contact is None or not self.contact.beyond.size:
            return moved
        solids = self.coupling.everywhere(self.coupling.solids(x, factor))
        return np.append(moved, solids[self.contact.beyond - self.model.dofs])

    def touching(self, x: PETSc.Vec, factor: float) -> Array:
        """Return the displacement for contact: all degrees of freedom of the rods, then those of the facets."""
        return self._with_facets(self.displacement(x, factor), x, factor)

    @property
    def symmetric(self) -> bool:
        """Whether the tangent is symmetric: not with friction, nor with moments on bodies that rotate."""
        return (self.contact is None or self.contact.friction is None) and self.model.has_potential

    @cached_property
    def _constant(self) -> bool:
        """Whether the tangent is the same in all states; the same on all ranks, since `_state` is collective."""
        return self.contact is None and not self.model.following and self._linear

    @cached_property
    def _linear(self) -> bool:
        """Whether all laws are linear."""
        return all(body.linear for body in self.model.bodies)

    def matrix(self) -> PETSc.Mat:
        """Return a new matrix with room for the tangent: AIJ, or the ``-mat_type`` given."""
        rods = self._own_matrix()
        if self.coupling is None:
            return rods
        with self._timed():
            return self.coupling.matrix(rods, self.coupling.tangents(self.vector(), 0.0), self.symmetric)

    def _own_matrix(self) -> PETSc.Mat:
        """Return a new matrix with room for the rods' tangent."""
        with self._timed():
            ranks = self._ranks() if self.contact is None else None
            pattern = Pattern([part.of_dofs for part in self.parts], self.free, ranks)
            made = self._matrix(lambda: self._indices(pattern), pattern)
            made.setAttr(_PATTERN, pattern)
            if self.symmetric:
                keep_symmetric(made)
            if self.contact is not None:
                made.setAttr("contact_version", self.contact.version)
            self.note("tangent")
        return made

    def _indices(self, pattern: Pattern | None) -> tuple[Index, Index]:
        """Return row and column of each entry, or of contact alone; negative for held degrees of freedom."""
        entries = [] if pattern is None else [pattern.indices()]
        if self.contact is not None:
            some = self.contact.of_rods
            entries.append((self.unknown_of[self.contact.rows[some]], self.unknown_of[self.contact.columns[some]]))
        rows, columns = zip(*entries, strict=True)
        return (rows[0], columns[0]) if len(entries) == 1 else (np.concatenate(rows), np.concatenate(columns))

    def _internal(self, local: Array, factor: float) -> Array:
        """Return the internal forces on this rank's degrees of freedom."""
        total = np.zeros(self._exchange.size)
        for part in self.parts:
            part.add_forces(local, factor, total)
        return total

    def _forces(self, local: Array, factor: float) -> Array:
        """Return the internal less the external forces, those of supports included, at a state of this rank."""
        spin = self.model.spin
        total = self._internal(local, factor)
        if spin is not None:
            amplitude = self.model.amplitude(spin.history, factor)
            total -= amplitude * self._sums(part.centrifugal(local, spin) for part in self.parts)
        if self.contact is not None:
            forces = self.contact.forces(self._everywhere)[0]
            own, self._pushed = np.split(forces, [self.model.dofs])
            total -= self._once(own)
        self._reach(factor)
        return total - self._loads(local)

    def _solid_forces(self, x: PETSc.Vec, factor: float) -> list[Array]:
        """Return the forces on this rank's solids; `_forces` must have been called for the same state."""
        assert self.coupling is not None
        forces = self.coupling.solid_forces(x, factor)
        if self.contact is not None and self._pushed.size:
            self.coupling.push(-self._pushed, self.contact.beyond, forces)
        return forces

    def advance(self, x: PETSc.Vec, factor: float) -> None:
        """Update the internal variables of laws with memory at the end of a step."""
        with self._timed():
            local = self._state(x, factor)
            for part in self.parts:
                part.advance(local, factor)

    @property
    def laws(self) -> list[Laws]:
        """The laws of this rank's parts, with their internal variables."""
        return [part.laws for part in self.parts]

    def obey(self, laws: Sequence[Laws]) -> None:
        """Set laws with memory to other internal variables (`laws`)."""
        for part, own in zip(self.parts, laws, strict=True):
            if own.remember:
                part.obey(own)

    def extrapolate(self) -> None:
        """Make the next tangent exact; later ones of slender bodies extrapolate (`isorod.assembly.extrapolation`)."""
        for part in self.parts:
            part.extrapolate(part.laws.objective and pays(part.body.space.rod))

    def residual(self, x: PETSc.Vec, factor: float, out: PETSc.Vec) -> float:
        """Fill ``out`` with the internal less the external forces on the unknowns (NaN where an element is inverted).

        Returns
        -------
        carried_force
            Norm of the nodal forces of supports and loads, and of the push of obstacles that move.
        """
        with self._timed():
            local = self._state(x, factor)
            forces = self._forces(local, factor)
            self._store(forces, out)
            own = float(np.sum(forces[self._supported] ** 2) + np.sum(self._loads(local) ** 2))
            if self.coupling is not None:
                solids = self._solid_forces(x, factor)
                self.coupling.add(solids, out)
                self.coupling.add_bonds(x, factor, out)
                own += self.coupling.carried(solids, factor)
            return float(np.sqrt(self.comm.tompi4py().allreduce(own) + self._push() ** 2))

    def _push(self) -> float:
        return 0.0 if self.contact is None else self.contact.push()

    def reactions(self, x: PETSc.Vec, factor: float) -> Array:
        """Return the forces of the supports on the model, one a degree of freedom in `Model.bound`, on every rank."""
        return self.on_supports(self.acting(x, factor))

    def on_supports(self, acting: Array) -> Array:
        """Return the support forces in `acting`; forces on slaves of ties are distributed to the masters."""
        return acting if self.coupling is None else self.coupling.passed_on(acting)[self.model.bound]

    def acting(self, x: PETSc.Vec, factor: float, out: PETSc.Vec | None = None) -> Array:
        """Return the internal less the external forces on `Model.bound`, or with ties on all, on every rank.

        ``out`` is filled with those on the unknowns.
        """
        if self.coupling is not None:
            if out is not None:
                self.residual(x, factor, out)
            return self.system_forces(x, factor)
        with self._timed():
            forces = self._forces(self._state(x, factor), factor)
            if out is not None:
                self._store(forces, out)
            return self._bound(forces)

    def system_forces(self, x: PETSc.Vec, factor: float) -> Array:
        """Return the internal less the external forces on all degrees of freedom, solids' too, on every rank."""
        assert self.coupling is not None
        with self._timed():
            rods = self.everywhere(self._forces(self._state(x, factor), factor))
            forces = np.append(rods, self.coupling.everywhere(self._solid_forces(x, factor)))
            return forces + self.coupling.bond_forces(self.system_displacement(x, factor))

    def carried(self, x: PETSc.Vec) -> float:
        """Return the norm of the nodal forces of loads, solids' supports and moving obstacles at load factor 1."""
        self._reach(1.0)
        own = self._loads(self._state(x, 1.0)) if self.model.loads else np.zeros(1)
        coupling = self.coupling
        solids = 0.0 if coupling is None else coupling.carried(coupling.solid_forces(x, 1.0), 1.0)
        return float(np.sqrt(self.comm.tompi4py().allreduce(float(own @ own) + solids) + self._push() ** 2))

    def imbalance(self, x: PETSc.Vec, factor: float) -> Array:
        """Return the resultant ``(3,)`` of the forces on unsupported nodes."""
        with self._timed():
            moved, slots = self._exchange.moved
            loose = self.model.is_control_point[moved // 3] & ~np.isin(moved, self.model.bound)
            total = self._forces(self._state(x, factor), factor)[slots]
            own: Array = np.bincount(moved[loose] % 3, total[loose], 3).astype(float)
            if self.coupling is not None:
                own = own + self.coupling.unheld(self._solid_forces(x, factor))
            return np.asarray(self.comm.tompi4py().allreduce(own))

    def inside(self, x: PETSc.Vec, factor: float) -> float:
        """Return the norm of the element forces before they are summed at the nodes."""
        local = self._state(x, factor)
        own = sum(float(np.sum(part.inside(local, factor) ** 2)) for part in self.parts)
        return float(np.sqrt(self.comm.tompi4py().allreduce(own)))

    def reaction_noise(self, x: PETSc.Vec, factor: float) -> Array:
        """Return the round-off errors of the forces on `Model.bound`, on every rank.

        They are the largest change of the internal forces under rigid translations by about the model's size: several,
        since one of them may by chance change next to nothing somewhere.
        """
        with self._timed():
            local = self._state(x, factor)
            moved, slots = self._exchange.moved
            before, lost = self._internal(local, factor), np.zeros(self.model.bound.size)
            for fraction in (1.0, -1.7, 0.3):
                local[slots[self.model.is_control_point[moved // 3]]] += fraction * self.model.size
                lost = np.maximum(lost, np.abs(self._bound(self._internal(local, factor) - before)))
            return lost

    def tangent(self, x: PETSc.Vec, factor: float, out: PETSc.Mat, lags: bool = False) -> None:
        """Fill ``out`` with the tangent stiffness; if it lags, the elements' is the last one, contact's is new."""
        with self._timed():
            local = np.zeros(self._exchange.size) if self._constant else self._state(x, factor)
            system, out = out, out if self.coupling is None else self.coupling.of_rods(out)
            pattern: Pattern = out.getAttr(_PATTERN)
            # Contact changes all the time.
            lags = lags or (self._linear and self.model.spin is None and not self.model.following)
            entries = self._elements if lags and self._elements is not None else zeros(out, pattern.total)
            if entries is not self._elements:
                self._add_stiffness(pattern, local, factor, entries)
            if self.contact is not None:
                self._elements = entries
                entries = np.concatenate([entries, self.contact.tangent(self._everywhere)[self.contact.of_rods]])
                # On any rank.
                if self.comm.tompi4py().allreduce(out.getAttr("contact_version") != self.contact.version):
                    if not fits(out, pattern.total, *self._indices(None)):
                        preallocate(out, *self._indices(pattern))
                    out.setAttr("contact_version", self.contact.version)
            set_values(out, entries)
            if self.coupling is not None:
                self.coupling.set_bonds(x, factor)
                self.coupling.fill(system, self.coupling.tangents(x, factor), self.contact)

    def _add_stiffness(self, pattern: Pattern, local: Array, factor: float, entries: Array) -> None:
        """Add the parts' tangents to the entries of a pattern."""
        loaded = self.model.spin is not None or bool(self._pressing)
        self._reach(factor)
        for k, (part, blocks) in enumerate(zip(self.parts, pattern.blocks, strict=True)):
            part.add_entries(local, factor, blocks, entries)
            if loaded:
                add(self._load_stiffness(k, local, factor, np.arange(part.layers.shape[0])), blocks, entries)

    def geometric_stiffness(self, rate: PETSc.Vec, step: float, out: PETSc.Mat) -> None:
        """Fill ``out`` with the geometric stiffness of the loads at rest (`isorod.assembly.prestress`).

        ``rate`` is the derivative of the unknowns by the load factor there, ``step`` a small load factor.
        """
        from isorod.assembly.prestress import entries

        with self._timed():
            states = [self._state(f * rate, f).copy() for f in (-step, 0.0, step)]
            own = out if self.coupling is None else self.coupling.of_rods(out)
            self._reach(1.0)
            set_values(own, entries(self.parts, own.getAttr(_PATTERN), states, step, self._pressing))
            if self.coupling is not None:
                self.coupling.fill(out, ())

    def load_forces(self, x: PETSc.Vec, factor: float, step: float, out: PETSc.Vec) -> None:
        """Fill ``out`` with the linearised change of the residual when the load factor grows by ``step`` at ``x``.

        Parameters
        ----------
        x, factor
            The unknowns and the load factor.
        step
            Change of the load factor.
        out
            A vector of unknowns.
        """
        with self._timed():
            local = self._state(x, factor)
            increment = self.prescribed(factor + step) - self.prescribed(factor)
            move = self.local(increment)
            self._reach(factor, step)
            total = -self._loads(local)
            self._reach(factor)
            for k in range(len(self.parts)):
                self._add_change(k, local, factor, move, step, total)
            pushed = np.empty(0)
            if self.contact is not None:
                if self.contact.beyond.size:
                    assert self.coupling is not None
                    change = self.coupling.given(factor + step) - self.coupling.given(factor)
                    increment = np.append(increment, change[self.contact.beyond])
                change = self.contact.product(increment) - self.contact.carried_along(self._everywhere, factor, step)
                own, pushed = np.split(change, [self.model.dofs])
                total += self._once(own)
            self._store(total, out)
            if self.coupling is not None:
                self.coupling.add_load_forces(x, factor, step, out)
                if self.contact is not None and pushed.size:
                    self.coupling.add(self.coupling.push(pushed, self.contact.beyond), out)

    def _add_change(self, k: int, local: Array, factor: float, move: Array, step: float, total: Array) -> None:
        """Add a part's contribution to `load_forces`; ``move`` is the prescribed displacement."""
        part = self.parts[k]
        # Only elements at supports.
        self._add_product(k, local, factor, move, part.elements_of(np.flatnonzero(move)), total)
        if self.model.spin is not None:
            amplitude = self.model.amplitude(self.model.spin.history, factor, step)
            part.add(-amplitude * part.centrifugal(local, self.model.spin), total)
        if part.laws.loaded:
            part.add_activation(local, factor, step, total)

    def energy(self, x: PETSc.Vec, factor: float) -> float:
        """Return the stored energy of the whole model, that of contact included."""
        with self._timed():
            local = self._state(x, factor)
            energy = self.comm.tompi4py().allreduce(sum(part.energy(local, factor) for part in self.parts))
            for solid, moved in zip(self.model.solids, self.solids(x, factor), strict=True):
                energy += solid.energy(moved, self.model.amplitude(None, factor))
            if self.coupling is not None and self.coupling.bonds is not None:
                energy += self.coupling.bonds.energy(self.system_displacement(x, factor))
            return float(energy if self.contact is None else energy + self.contact.forces(self._everywhere)[1])

    def by_other_rules(self, rules: Mapping[int, Rule]) -> list[tuple[Part, Part]]:
        """Return this rank's parts of the bodies with other rules, each with the same elements by its rule."""
        return [
            (part, Part(element_range, self._exchange, rules[part.which]))
            for part, element_range in zip(self.parts, self.element_ranges, strict=True)
            if part.which in rules
        ]

    def pressures(self, x: PETSc.Vec) -> "Sequence[Array | None]":
        """Return the pressures of mixed bodies (`isorod.assembly.mixed`): none here."""
        return ()

    def jacobians(self, x: PETSc.Vec, factor: float) -> list[Array]:
        """Return ``det F`` at the points of this rank's parts; 1 for linear laws, which do not depend on it."""
        local = self._state(x, factor)
        return [
            part.jacobians(local) if part.laws.objective else np.ones(part.table.weights.shape) for part in self.parts
        ]

    def smallest_jacobian(self, x: PETSc.Vec, factor: float) -> tuple[float, int, int, float]:
        """Return the smallest ``det F`` over all ranks, with its body, element and axis parameter ``u``."""
        local = self._state(x, factor)
        smallest = min((part.smallest_jacobian(local) for part in self.parts), default=(np.inf, -1, -1, np.nan))
        return min(self.comm.tompi4py().allgather(smallest))
