"""Implicit steps of bodies with the mixed formulation: energy and momenta are conserved, up to ``nu = 0.5``.

Between states 0 and 1 of a step the energy ``psi + kappa/2 theta^2`` (`isorod.assembly.mixed`) has the forces

    f = f_psi(u_0, u_1) + integral of p D theta(u_0, u_1),    integral of q (theta_0 + theta_1 - 2 p / kappa) = 0

for all pressures ``q``: ``D theta``, a discrete gradient (Gonzalez, J. Nonlinear Sci. 6 (1996) 449-467), does exactly
the work ``theta_1 - theta_0``, so that the pressure at the middle of the step, ``p``, the mean of those at its ends,
does that of ``p^2 / (2 kappa)``.  In a fully incompressible body the constraint is ``theta_1 = 0``: rounding does not
accumulate, and ``p`` does no work.  With other energies ``U(theta)`` it is ``theta_0 + theta_1 = 2 U*'(p)``, and energy
is conserved to second order in the change of the pressure.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.exchange import Exchange
from isorod.assembly.mixed import MixedAssembler, MixedPart, coupling
from isorod.assembly.part import Part
from isorod.assembly.partition import ElementRange
from isorod.assembly.pattern import Pattern, add
from isorod.assembly.pattern_kernel import Blocks
from isorod.dynamics.implicit.assembler import StepAssembler, StepPart
from isorod.material.along_rod import complementary, volume_between, volume_change
from isorod.model.model import Model
from isorod.petsc.matrix import set_values, zeros
from isorod.tensors import inverse

# Attribute of a matrix of mass and constraints: the pattern of the parts' entries.
_PATTERN = "isorod_saddle"

# Compliance of incompressible elements, times the shear modulus, in bodies with others.
_LEAST = 1e-9


class MixedStepPart(MixedPart, StepPart):
    """The elements of one mixed body during a step.

    Attributes
    ----------
    rigid, soft
        Whether it is incompressible somewhere, or compressible somewhere.
    """

    def __init__(self, element_range: ElementRange, exchange: Exchange) -> None:
        super().__init__(element_range, exchange)
        rigid = [law.lame == np.inf for law in element_range.body.laws]
        self.rigid, self.soft = any(rigid), not all(rigid)
        self._before: Array | float = 0.0

    def begin(self, displacement: Array) -> None:
        """Set the initial state of a step, of this rank's degrees of freedom."""
        super().begin(displacement)
        if self.soft:
            self._before = volume_change(self.volumes, self.start)[0]

    def add_forces(self, local: Array, factor: float, forces: Array) -> None:
        """Add the internal forces of the change of the displacement and the pressure in ``local``, and the gaps."""
        change, p = self.changes(local), self.pressure(local)
        stress, _ = self.laws.at(factor).discrete(self.start, change, False)
        stress += p[..., None, None] * volume_between(self.volumes, self.start, change, False)[0]
        self._add_stress(stress, forces)
        after = volume_change(self.volumes, self.start + change)[0]
        self.add_volumes(self._before + after - 2.0 * complementary(self.volumes, p)[1], forces)

    def add_entries(self, local: Array, factor: float, blocks: Blocks, entries: Array) -> None:
        """Add the derivatives of the forces of `add_forces`, and of inertial forces, to entries of a pattern."""
        StepPart.add_entries(self, local, factor, blocks, entries)

    def _matrices(self, local: Array, factor: float) -> Array:
        change, p = self.changes(local), self.pressure(local)
        _, moduli = self.laws.at(factor).discrete(self.start, change, True)
        gradient, slope = volume_between(self.volumes, self.start, change, True)
        assert slope is not None
        moduli += p[..., None, None, None, None] * slope
        result = self.padded_matrices(self._contracted(moduli))
        right = coupling(self.table, gradient, self.across, self.along)
        own = self.own(slice(None), 2.0 * complementary(self.volumes, p)[2])
        self.set_coupling(result, right, self._slopes(self.start + change), own)
        return result.reshape(*self.dofs.shape, -1)

    def _slopes(self, F: Array) -> Array:
        """Return the derivatives of the integrals of ``theta`` (`isorod.assembly.mixed.coupling`)."""
        return coupling(self.table, volume_change(self.volumes, F)[1], self.across, self.along)

    def saddle(self, local: Array, fraction: float, compliance: Array) -> Array:
        """Return matrices of mass, ``fraction`` times the derivatives of the integrals of ``theta``, and compliance.

        Parameters
        ----------
        local
            The displacement.
        fraction, compliance
            A factor, and the compliances at the points ``(E, t, q)``.
        """
        layers, width = self.layers.shape[1], self.width
        result = self.masses_of(np.eye(3)).reshape(-1, layers, width, layers, width)
        both = fraction * self._slopes(self.gradients(local))
        self.set_coupling(result, both, both, self.own(slice(None), compliance))
        return result.reshape(*self.dofs.shape, -1)

    def add_integrals(self, local: Array, volumes: Array) -> None:
        """Add the integrals of ``theta`` in a state."""
        self.add_volumes(volume_change(self.volumes, self.gradients(local))[0], volumes)

    def complement(self, p: Array) -> tuple[Array, Array, Array]:
        """Return ``U*`` of the pressures in ``p`` and its derivatives, shapes ``(E, t, q)``.

        Incompressible elements, in a body with others, have a negligible compliance so that it is not singular.
        """
        at_points = self.pressure(p)
        value, slope, bend = complementary(self.volumes, at_points)
        least = np.where(bend == 0.0, _LEAST / self.body.pressure_unit, 0.0)
        return value + 0.5 * least * at_points**2, slope + least * at_points, bend + least

    def add_gaps(self, local: Array, volumes: Array) -> None:
        """Add the integrals of ``theta`` over incompressible elements, which are to be zero."""
        self.add_volumes(self._held * volume_change(self.volumes, self.gradients(local))[0], volumes)

    def add_rates(self, local: Array, velocity: Array, volumes: Array) -> None:
        """Add the rates of the integrals of ``theta`` over incompressible elements."""
        slope = volume_change(self.volumes, self.gradients(local))[1]
        self.add_volumes(self._held * np.sum(slope * self.changes(velocity), axis=(-2, -1)), volumes)

    @cached_property
    def _held(self) -> NDArray[np.bool_]:
        """Whether points are incompressible, ``(E, t, q)``."""
        return complementary(self.volumes, np.zeros(self.table.weights.shape))[2] == 0.0

    def add_bends(self, local: Array, velocity: Array, volumes: Array) -> None:
        """Add the second rates of the integrals of ``theta = ln J`` at zero acceleration."""
        rate = self.changes(velocity) @ inverse(self.gradients(local))[0]
        self.add_volumes(-np.einsum("...ab,...ba->...", rate, rate), volumes)

    def add_pressure(self, local: Array, p: Array, forces: Array) -> None:
        """Add the forces of the pressures in ``p`` in a state."""
        slope = volume_change(self.volumes, self.gradients(local))[1]
        self._add_stress(self.pressure(p)[..., None, None] * slope, forces)


class MixedStepAssembler(MixedAssembler, StepAssembler):
    """Assembles the balance of a step; unknowns are displacement increments and pressures in the middle of the step."""

    def __init__(self, model: Model, comm: PETSc.Comm | None = None) -> None:
        super().__init__(model, comm)
        self.pressure = np.zeros(sum(body.pressures.size for body in model.bodies if body.pressures is not None))

    def _part(self, element_range: ElementRange) -> Part:
        kind = StepPart if element_range.body.pressures is None else MixedStepPart
        return kind(element_range, self._exchange)

    @property
    def mixed_parts(self) -> list[MixedStepPart]:
        """The elements of mixed bodies on this rank."""
        return [part for part in self.parts if isinstance(part, MixedStepPart)]

    def guess(self, change: Array) -> PETSc.Vec:
        """Return the initial unknowns of a step's iterations, with the pressures of the last step."""
        return self.state(change, self.model.split_pressures(self.pressure), self._of_solids(change))

    def accept(self, x: PETSc.Vec) -> None:
        """Keep the pressures of a step."""
        self.pressure = self.all_pressures(x)

    def saddle(self) -> PETSc.Mat:
        """Return a new matrix with the pattern of mass and constraints (`fill_saddle`)."""
        pattern = Pattern([part.of_dofs for part in self.parts], self.free)
        matrix = self._matrix(pattern.indices, pattern)
        matrix.setAttr(_PATTERN, pattern)
        return matrix if self.coupling is None else self.coupling.matrix(matrix, self._masses, True, stiffness=False)

    @property
    def _masses(self) -> list[PETSc.Mat]:
        return [solid.mass() for solid in self.model.solids]

    def fill_saddle(
        self, displacement: Array, how: Callable[[MixedStepPart], tuple[float, Array]], out: PETSc.Mat
    ) -> None:
        """Fill a matrix with mass and constraints (`MixedStepPart.saddle`); ``how`` returns fraction and compliance."""
        with self._timed():
            system, out = out, out if self.coupling is None else self.coupling.of_rods(out)
            pattern: Pattern = out.getAttr(_PATTERN)
            local, entries = self.local(displacement), zeros(out, pattern.total)
            for part, blocks in zip(self.parts, pattern.blocks, strict=True):
                if isinstance(part, MixedStepPart):
                    add(part.saddle(local, *how(part)), blocks, entries)
                else:
                    add(part.masses_of(np.eye(3)), blocks, entries)
            set_values(out, entries)
            if self.coupling is not None:
                self.coupling.fill(system, self._masses)

    def gather(self, local: Array, out: PETSc.Vec) -> None:
        """Fill a vector with the sums over all ranks of local values."""
        self._store(local, out)

    def pressed_by(self, displacement: Array, x: PETSc.Vec) -> Array:
        """Return the forces of the pressures in ``x`` in a state, on all degrees of freedom."""
        local, p, forces = self.local(displacement), self._state(x, 0.0), np.zeros(self._exchange.size)
        for part in self.mixed_parts:
            part.add_pressure(local, p, forces)
        pressed = np.zeros(displacement.size)
        pressed[: self.model.dofs] = self.everywhere(forces)
        return pressed

    def pressures_of(self, x: PETSc.Vec) -> Array:
        """Return a vector's degrees of freedom of this rank, which contain the parts' pressures."""
        return self._state(x, 0.0)

    def all_pressures(self, x: PETSc.Vec) -> Array:
        """Return the coefficients of all bodies' pressures, concatenated, force per area, shape ``(p,)``."""
        return np.concatenate([each.ravel() for each in self.pressures(x) if each is not None])
