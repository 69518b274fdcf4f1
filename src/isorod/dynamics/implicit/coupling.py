"""Ties and finite element bodies during an implicit step: unknowns are displacement increments."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly.coupling import Coupling
from isorod.errors import InputError
from isorod.model.model import Model

if TYPE_CHECKING:
    from isorod.fenics.solid import Solid
    from isorod.fenics.step import Step


class StepCoupling(Coupling):
    """Ties between increments of rods and solids; forces of bonds are those at the mean of both states.

    Attributes
    ----------
    steps
        The solids during the step (`isorod.fenics.step.Step`).
    amount
        Sum of the norms of the solids' inertial and internal forces and loads at the last residual.
    """

    _bond_factor = 0.5

    def __init__(self, model: Model, comm: PETSc.Comm, unknown_of: Index, rows: int, unknowns: int) -> None:
        for k, tie in enumerate(model.ties):
            if tie.law is not None and not tie.law.linear:
                raise InputError(
                    f"tie {k}: bond: a law of traction over slip is for statics and modes; give a stiffness"
                )
        super().__init__(model, comm, unknown_of, rows, unknowns)
        self.steps = _steps(model.solids)
        self.amount = 0.0
        self._start = self._moved = np.zeros(self.constraints.held.size)

    def begin(self, step: float, damping: float, displacement: Array, velocity: Array, moved: Array) -> None:
        """Set the initial state of a step (all degrees of freedom), its length, the damping, prescribed increments."""
        self._start, self._moved = displacement, moved
        for solid, own in zip(self.steps, self.own_dofs, strict=True):
            solid.begin(step, damping, displacement[own], velocity[own])

    def given(self, factor: float) -> Array:
        """Return the prescribed increments of all degrees of freedom."""
        return self._moved.copy()

    def solid_forces(self, x: PETSc.Vec, factor: float) -> list[Array]:
        """Return the inertial and internal less the external forces of each solid's degrees of freedom here."""
        forces = [step.forces(change, factor) for step, change in zip(self.steps, self.solids(x, factor), strict=True)]
        squares = [sum(float(force @ force) for force in kind) for kind in zip(*forces, strict=True)]
        self.amount = float(np.sqrt(self._comm.tompi4py().allreduce(np.array(squares or [0.0]))).sum())
        return [inertial + internal - loads for inertial, internal, loads in forces]

    def tangents(self, x: PETSc.Vec, factor: float) -> list[PETSc.Mat]:
        """Return the derivatives of these forces."""
        pairs = zip(self.steps, self.solids(x, factor), strict=True)
        return [step.tangent(change, factor) for step, change in pairs]

    def carried(self, forces: list[Array], factor: float) -> float:  # type: ignore[override]
        """Return zero: steps use the ``amount``."""
        return 0.0

    def middle(self, change: Array) -> Array:
        """Return the mean of both states, from the increment between them."""
        return self._start + self._bond_factor * change

    def _seen(self, moved: Array) -> Array:
        return self.middle(moved)

    def bonded(self, displacement: Array) -> tuple[Array | float, float]:
        """Return the forces of bonds in a state on all degrees of freedom, and their energy."""
        if self.bonds is None:
            return 0.0, 0.0
        return self.bonds.forces(displacement), self.bonds.energy(displacement)


def _steps(solids: "Sequence[Solid]") -> "list[Step]":
    if not solids:
        return []
    from isorod.fenics.step import Step

    return [Step(solid) for solid in solids]
