"""Implicit dynamics: an energy-momentum conserving step of second order, solved by SNES.

Between the states ``(u_0, v_0)`` and ``(u_1, v_1)`` of a step ``dt`` (Simo & Tarnow, ZAMP 43 (1992) 757-792; Gonzalez,
CMAME 190 (2000) 1763-1783),

    u_1 - u_0 = dt (v_0 + v_1) / 2,    M (v_1 - v_0) / dt + c M (v_0 + v_1) / 2 + f(u_0, u_1) = p,

where the loads ``p`` are their means over the step, for any history, follower pressures those in the middle of the
step, and the internal forces ``f`` do exactly the work ``W(u_1) - W(u_0)`` on ``u_1 - u_0``
(`isorod.material.law.Material.discrete`).  So energy, momentum and angular momentum are conserved for any step size but
for damping, supports, loads and activation, which is that in the middle of the step.  Contact forces are those at the
mean of both states: they conserve both momenta, and the energy to second order.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly.assembler import Assembler
from isorod.assembly.exchange import Exchange
from isorod.assembly.exerted import carried
from isorod.assembly.gradients import add_stress
from isorod.assembly.part import ROUNDING, Part
from isorod.assembly.partition import ElementRange
from isorod.assembly.pattern import add
from isorod.assembly.pattern_kernel import Blocks
from isorod.dynamics.explicit import states
from isorod.dynamics.implicit.contraction import element_matrices
from isorod.model.mean import MeanSupport
from isorod.model.model import Model

if TYPE_CHECKING:
    from isorod.dynamics.implicit.contact import MidpointContact
    from isorod.dynamics.implicit.coupling import StepCoupling
    from isorod.fenics.step import Step


class StepPart(Part):
    """The elements of one body during a step.

    Attributes
    ----------
    start
        Deformation gradients at the start of the step, shape ``(E, t, q, 3, 3)``.
    """

    def __init__(self, element_range: ElementRange, exchange: Exchange) -> None:
        super().__init__(element_range, exchange)
        self.start = np.empty((*self.table.weights.shape, 3, 3))
        self.inertia = self.largest = 0.0

    def begin(self, displacement: Array) -> None:
        """Set the initial state of a step, of this rank's degrees of freedom."""
        self.start = self.gradients(displacement)

    def set_states(self, states: Array) -> None:
        """Set the states of laws with memory at the body's points, ``(E, t, q, m)``."""
        self.laws = self.laws.knowing(states[self.table.first : self.table.first + self.table.elements])

    def add_forces(self, local: Array, factor: float, forces: Array) -> None:
        """Add the internal forces of the change ``local`` of the displacement."""
        self._add_stress(self.laws.at(factor).discrete(self.start, self.changes(local), False)[0], forces)

    def _add_stress(self, stress: Array, forces: Array) -> None:
        """Add the forces of a stress at the points."""
        add_stress(self.table, stress, self.starts, forces)

    def add_entries(self, local: Array, factor: float, blocks: Blocks, entries: Array) -> None:
        """Add the derivatives of internal and inertial forces to entries of a pattern; they are not symmetric."""
        matrices = self._matrices(local, factor)
        self.largest = float(np.abs(matrices).sum(axis=2).max())
        add(matrices, blocks, entries)

    def _matrices(self, local: Array, factor: float) -> Array:
        _, moduli = self.laws.at(factor).discrete(self.start, self.changes(local), True)
        return self._contracted(moduli)

    def _contracted(self, moduli: Array) -> Array:
        """Return the element matrices of moduli at the points, and of inertia, shape ``(E, l n 3, l n 3)``."""
        result = element_matrices(self.table, moduli)
        for a in range(3):
            result[:, :, a, :, a] += self.inertia * self.mass
        return result.reshape(len(result), 3 * result.shape[1], -1)

    def masses(self, local: Array) -> Array:
        """Return the mass matrix times a vector of this rank's degrees of freedom, shape of ``dofs``."""
        return self.padded(self.mass @ self.nodal(local).reshape(self.shape[0], -1, 3))


class StepAssembler(Assembler):
    """Assembles the balance of a step; unknowns are the increments of the displacement.

    Vectors on all degrees of freedom are those of rods followed by those of solids; every rank has them all.

    Attributes
    ----------
    amount
        Sum of the norms of inertial, internal and external forces at the last residual.
    rounding
        Rounding of the residual.
    moved
        Increment prescribed by supports in the step, of all degrees of freedom.
    pressure
        All coefficients of the pressures of mixed bodies in the middle of the last step, force per area, ``(p,)``.
    """

    parts: list[StepPart]  # type: ignore[assignment]
    contact: "MidpointContact | None"
    coupling: "StepCoupling | None"

    def __init__(self, model: Model, comm: PETSc.Comm | None = None) -> None:
        super().__init__(model, comm)
        self.amount = self.rounding = 0.0
        self.pressure = np.empty(0)
        self._rates = 0.0, 0.0
        self._velocity = self._start = np.zeros(self._exchange.size)
        self.moved = np.zeros(model.dofs if self.coupling is None else self.coupling.constraints.held.size)

    def _part(self, element_range: ElementRange) -> Part:
        return StepPart(element_range, self._exchange)

    def _coupled(self) -> "StepCoupling | None":
        if not self.model.coupled:
            return None
        from isorod.dynamics.implicit.coupling import StepCoupling

        return StepCoupling(self.model, self.comm, self.unknown_of, self.rows, self.unknowns)

    @property
    def symmetric(self) -> bool:
        """Whether the tangent is symmetric: that of a step is not."""
        return False

    def _contact(self) -> "MidpointContact | None":
        if not self.model.contacts:
            return None
        from isorod.dynamics.implicit.contact import MidpointContact

        self.built.append("contact")
        return MidpointContact(self.model, self.comm)

    def at(self, begin: float, end: float) -> None:
        """Set loads to their means over a time span, or to those at a time."""
        if self.model.loads:
            self._external = self._once(self.model.loaded(begin, end))
        for pressing in self._pressing:
            pressing.at(begin, end)

    def _reach(self, factor: float, step: float | None = None) -> None:
        """Do nothing: loads are set by `at`."""

    def begin(
        self, step: float, damping: float, displacement: Array, velocity: Array, moved: Array | None = None
    ) -> None:
        """Set the initial state of a step (all degrees of freedom), its length, the damping, and prescribed increments.

        The velocity of held degrees of freedom is such that ``2 (moved / step - velocity)`` is its change.
        """
        self.moved = np.zeros_like(displacement) if moved is None else moved
        self._prescribed = None
        self._velocity, self._start = self.local(velocity), self.local(displacement)
        self._rates = 2.0 / step**2 + damping / step, 2.0 / step
        self.rounding = 0.0
        # Inertia is in the elements' tangent, and the step size may change.
        self._elements = None
        for part in self.parts:
            part.begin(self._start)
            if part.laws.remember:
                part.laws = part.laws.lasting(step)
            part.inertia = self._rates[0]
        if self.coupling is not None:
            self.coupling.begin(step, damping, displacement, velocity, self.moved)
        if self.contact is not None:
            self.contact.start = self.contact_displacement(displacement)

    def prescribed(self, factor: float) -> Array:
        """Return the increment prescribed by supports in the step, with slaves of ties, ``(dofs,)``."""
        return self.moved[: self.model.dofs].copy()

    def _state(self, x: PETSc.Vec, factor: float) -> Array:
        # The factor is that of activation, not of supports.
        return super()._state(x, 0.0)

    def _forces(self, local: Array, factor: float) -> Array:
        internal = self._internal(local, factor)
        if self.contact is not None:
            own, self._pushed = np.split(self.contact.forces(self._everywhere)[0], [self.model.dofs])
            internal -= self._once(own)
        change, past = self._rates
        inertial, loads = self._momenta(change * local - past * self._velocity), self._loads(self._middle(local))
        self.amount = sum(float(np.linalg.norm(self.everywhere(forces))) for forces in (inertial, internal, loads))
        return inertial + internal - loads

    def residual(self, x: PETSc.Vec, factor: float, out: PETSc.Vec) -> float:
        """Fill ``out`` with the balance of a step (`isorod.assembly.assembler.Assembler.residual`)."""
        carried = super().residual(x, factor, out)
        if self.coupling is not None:
            self.amount += self.coupling.amount
        return carried

    def _middle(self, local: Array) -> Array:
        """Return the displacement in the middle of a step that changes it by ``local``."""
        return self._start + 0.5 * local

    def _load_stiffness(self, k: int, local: Array, factor: float, which: Index) -> Array:
        part = self.parts[k]
        matrices = part.padded_matrices(self._pressing[k].derivatives(part.nodal(self._middle(local))))
        return -0.5 * matrices[which].reshape(which.size, *[part.dofs.shape[1]] * 2)

    def loads(self, displacement: Array) -> Array:
        """Return the forces of the loads in a state, both on all degrees of freedom of rods, on every rank."""
        if not self.model.loads:
            return np.zeros(self.model.dofs)
        return self.everywhere(self._loads(self.local(displacement)))

    def _momenta(self, velocity: Array) -> Array:
        return self._sums(part.masses(velocity) for part in self.parts)

    def change(self, x: PETSc.Vec) -> Array:
        """Return unknowns as an increment of all degrees of freedom, zero where supports hold."""
        rods: Array = self.shapes(self.all_unknowns(x)[None])[0]
        if self.coupling is None:
            return rods
        return np.append(rods, self.coupling.everywhere(self.solids(x, 0.0)) - self.moved[rods.size :])

    def guess(self, change: Array) -> PETSc.Vec:
        """Return the initial unknowns of a step's iterations, given an increment of all degrees of freedom."""
        return self.state(change, solids=self._of_solids(change))

    @property
    def _steps(self) -> "Sequence[Step]":
        return () if self.coupling is None else self.coupling.steps

    def _of_solids(self, everywhere: Array) -> list[Array]:
        """Return this rank's degrees of freedom of each solid."""
        return [] if self.coupling is None else [everywhere[own] for own in self.coupling.own_dofs]

    def onto_unknowns(self, forces: Array) -> PETSc.Vec:
        """Return forces on all degrees of freedom, the same on every rank, as those on the unknowns."""
        if self.coupling is None:
            return self.state(forces)
        out = self.vector()
        self._store(self._once(forces[: self.model.dofs]), out)
        self.coupling.add(self._of_solids(forces), out)
        return out

    def onto_masters(self, forces: Array) -> Array:
        """Return forces on all degrees of freedom with those on slaves of ties on their masters."""
        return forces if self.coupling is None else self.coupling.passed_on(forces)

    def tied(self, displacement: Array, given: Callable[[MeanSupport], float] = lambda one: 0.0) -> Array:
        """Return a displacement or velocity of all degrees of freedom, with slaves of ties by their masters.

        ``given`` returns the factor, or its rate, of prescribed mean motions.
        """
        if self.coupling is None:
            return displacement
        result, constraints = displacement.copy(), self.coupling.constraints
        means = (self.model.means[k] for k in constraints.held_means)
        values = np.concatenate([np.empty(0), *(given(mean) * mean.values for mean in means)])
        result[constraints.slaves] = constraints.rows @ displacement + constraints.offsets @ values
        return result

    def bonded(self, displacement: Array) -> tuple[Array | float, float]:
        """Return the forces of bonds in a state on all degrees of freedom, and their energy."""
        return (0.0, 0.0) if self.coupling is None else self.coupling.bonded(displacement)

    def carried_forces(self, x: PETSc.Vec, factor: float) -> Array:
        """Return the forces that supports carry during a step, on all degrees of freedom."""
        assert self.coupling is not None
        return self.coupling.passed_on(self.system_forces(x, factor))

    def averages(self, x: PETSc.Vec, factor: float) -> dict[int, Array]:
        """Return the forces of mean supports in a step (`isorod.assembly.exerted.carried`)."""
        if not self.model.means:
            return {}
        assert self.coupling is not None
        middle = self.coupling.middle(self.system_displacement(x, factor))
        return carried(self.coupling.constraints, self.system_forces(x, factor), middle)

    def contact_displacement(self, everywhere: Array) -> Array:
        """Return the degrees of freedom of contact: those of rods, and of facets that these touch."""
        rods = everywhere[: self.model.dofs]
        return rods if self.contact is None else np.append(rods, everywhere[self.contact.beyond])

    def set_states(self, known: Array) -> None:
        """Set the initial states of laws with memory (`isorod.dynamics.explicit.system.System.states`)."""
        if self.model.remembers:
            each = states.by_bodies(self.model, known)
            for part in self.parts:
                part.set_states(each[part.which])

    def accept(self, x: PETSc.Vec) -> None:
        """Keep further initial values of the next step."""

    def momenta(self, velocity: Array) -> Array:
        """Return the consistent mass matrix times a vector, both of all degrees of freedom."""
        rods = self.everywhere(self._momenta(self.local(velocity)))
        if self.coupling is None:
            return rods
        pairs = zip(self.model.solids, self._of_solids(velocity), strict=True)
        return np.append(rods, self.coupling.everywhere([solid.momenta(own) for solid, own in pairs]))

    def tangent(self, x: PETSc.Vec, factor: float, out: PETSc.Mat, lags: bool = False) -> None:
        """Fill ``out`` with the derivative of the residual."""
        super().tangent(x, factor, out, lags)
        if self.rounding == 0.0:
            sizes = [(part.largest, part.inertia * float(np.abs(part.mass).sum(axis=2).max())) for part in self.parts]
            everywhere = [pair for own in self.comm.tompi4py().allgather(sizes) for pair in own]
            largest, light = max(size for size, _ in everywhere), min(size for _, size in everywhere)
            # Inertia acts on increments, which are small, and adds hardly any rounding.
            stiffest = max(0.0, largest - light, *(step.largest for step in self._steps))
            self.rounding = ROUNDING * self.model.size * np.sqrt(self.unknowns) * stiffest
