"""Solves with the mass in implicit steps: reactions at an output and, with pressures, a consistent initial state."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.dynamics.implicit.assembler import StepAssembler
from isorod.errors import InputError, SolveError
from isorod.material.along_rod import complementary
from isorod.petsc.direct import direct

if TYPE_CHECKING:
    from isorod.dynamics.implicit.mixed import MixedStepAssembler, MixedStepPart

# Maximum number of Newton's iterations to volume-preserving states or to pressures; relative residual of the former.
_MOST, _NONE = 20, 1e-12

# A correction this small relative to the model is the last: the next one would be its square.
_CLOSE = 1e-7

# MUMPS delays pivots that are too small, which takes more memory than it estimates: percent more, tried in this order.
_ROOM = (100, 400, 1600)

_PREFIX = "inertia_"


class Inertia:
    """Solves with the mass of a model without pressures."""

    def __init__(self, assembler: StepAssembler) -> None:
        self.assembler = assembler
        self._matrix = self._made()
        # PETSc's own factors are for bands.
        sparse = assembler.comm.getSize() > 1 or bool(assembler.model.solids)
        package = {f"{_PREFIX}pc_factor_mat_solver_type": "mumps"} if sparse else {}
        self._ksp = direct(self._matrix, {f"{_PREFIX}pc_type": "lu"} | package, _PREFIX)

    def _made(self) -> PETSc.Mat:
        return self.assembler.mass()

    def destroy(self) -> None:
        """Give back matrix and factors."""
        self._ksp.destroy()
        self._matrix.destroy()

    def prepare(self, displacement: Array, velocity: Array, step: float) -> tuple[Array, Array]:
        """Return the nearest admissible initial state: the given one, with slaves of ties by their masters."""
        return self.assembler.tied(displacement), self.assembler.tied(velocity)

    def settle(
        self, balance: Array, displacement: Array, velocity: Array, driven: Array, step: float
    ) -> tuple[Array, Array]:
        """Return the forces of supports and ties, shape ``(dofs,)``, and all pressures.

        Parameters
        ----------
        balance
            Internal forces without those of pressures, less external ones, shape ``(dofs,)``.
        displacement, velocity, step
            The state, and the time step.
        driven
            Accelerations that supports prescribe, ``(dofs,)``.
        """
        balance = balance + self.assembler.momenta(driven)
        solution = self.assembler.vector()
        self._ksp.solve(self.assembler.onto_unknowns(balance), solution)
        held = balance - self.assembler.momenta(self.assembler.change(solution))
        return held, np.empty(0)

    def stored(self, displacement: Array) -> float:
        """Return the energy of pressures."""
        return 0.0


class MixedInertia(Inertia):
    """Solves with mass and the constraints of pressures, ``M`` and ``B``, and their compliance ``C``.

    In a state the pressure is ``C p = g``, ``g`` the integrals of ``theta``, or without compliance the multiplier of
    ``g'' = B a + b = 0``.  Both follow from

        M a + B^T p = -f,    t^2 (B a + b) + g - C p = 0

    but for an error of second order in ``t``, half a time step: of pressure waves faster than the steps it is the mean.
    """

    assembler: "MixedStepAssembler"

    def __init__(self, assembler: "MixedStepAssembler") -> None:
        super().__init__(assembler)
        # A saddle point needs pivoting.
        self._ksp.getPC().setFactorSolverType("mumps")
        kinds = [(part.rigid, part.soft) for part in assembler.mixed_parts]
        self._rigid, self._soft = np.any(sum(assembler.comm.tompi4py().allgather(kinds), [(False, False)]), axis=0)

    def _made(self) -> PETSc.Mat:
        return self.assembler.saddle()

    def prepare(self, displacement: Array, velocity: Array, step: float) -> tuple[Array, Array]:
        """Return the nearest state, in the norm of the mass, that preserves the volume of incompressible bodies.

        Raises
        ------
        InputError
            If there is none.
        """
        displacement, velocity = super().prepare(displacement, velocity, step)
        if not self._rigid:
            return displacement, velocity
        assembler, short = self.assembler, (1e-3 * step) ** 2
        volume = self._sums(lambda part, sums: part.add_volumes(np.ones(part.table.weights.shape), sums)).norm()

        def correction_for(displacement: Array, grown: PETSc.Vec) -> Array:
            """Return the smallest displacement that reduces the integrals of ``theta`` by so much."""
            self._fill(
                displacement,
                lambda part: (float(part.rigid), complementary(part.volumes, 0.0 * part.table.weights)[2] / short),
            )
            grown.scale(-1.0)
            return assembler.change(self._solved(grown))

        for _ in range(_MOST):
            grown = self._sums(partial(_gaps, assembler.local(displacement)), lambda part: part.rigid)
            size = grown.norm()
            if size <= _NONE * volume:
                break
            if np.isfinite(size):
                correction = correction_for(displacement, grown)
                displacement = displacement + correction
                # In partly compressible bodies some integrals need not be zero.
                if np.abs(correction).max() <= _CLOSE * assembler.model.size:
                    break
        else:
            raise InputError(
                "initial displacement: its projection onto volume-preserving states did not converge (incompressible "
                "bodies); start from rest, or from a solution of statics"
            )
        local, moving = assembler.local(displacement), assembler.local(velocity)
        grown = self._sums(lambda part, sums: part.add_rates(local, moving, sums), lambda part: part.rigid)
        return displacement, velocity + correction_for(displacement, grown)

    def settle(
        self, balance: Array, displacement: Array, velocity: Array, driven: Array, step: float
    ) -> tuple[Array, Array]:
        """Return the forces of supports and ties, ``(dofs,)``, and all pressures (`Inertia.settle`)."""
        assembler, half = self.assembler, 0.5 * step
        balance = balance + assembler.momenta(driven)
        local, moving = assembler.local(displacement), assembler.local(velocity)
        fixed = self._sums(lambda part, sums: part.add_bends(local, moving, sums))
        if driven.any():
            pushed = assembler.local(driven)
            fixed.axpy(1.0, self._sums(lambda part, sums: part.add_rates(local, pushed, sums)))
        fixed.scale(-half)
        fixed.axpy(-1.0 / half, self._sums(lambda part, sums: part.add_integrals(local, sums), lambda part: part.soft))
        fixed.axpy(-1.0, assembler.onto_unknowns(balance))

        def solved(p: Array) -> PETSc.Vec:
            # Unknowns are pressures times half a step, with rows scaled alike: the matrix is symmetric.
            self._fill(displacement, lambda part: (half, complementary(part.volumes, part.pressure(p))[2]))
            right = self._sums(lambda part, sums: part.add_volumes(_beyond(part, p), sums))
            right.aypx(1.0 / half, fixed)
            return self._solved(right)

        x = self._iterated(solved, half)
        acceleration = assembler.change(x)
        x.scale(half)
        held = balance + assembler.momenta(acceleration) + assembler.pressed_by(displacement, x)
        return held, assembler.all_pressures(x)

    def stored(self, displacement: Array) -> float:
        """Return the energy ``U(theta)`` of pressures, ``p^2 / (2 kappa)``."""
        if not self._soft:
            return 0.0
        assembler = self.assembler
        local = assembler.local(displacement)
        grown = self._sums(lambda part, sums: part.add_integrals(local, sums), lambda part: part.soft)
        grown.scale(-1.0)

        def solved(p: Array) -> PETSc.Vec:
            self._fill(displacement, lambda part: (0.0, part.complement(p)[2]))
            right = self._sums(lambda part, sums: part.add_volumes(_beyond(part, p), sums), lambda part: part.soft)
            right.axpy(1.0, grown)
            return self._solved(right)

        x = self._iterated(solved, 1.0)
        p = assembler.pressures_of(x)
        own = sum(
            float(np.sum(part.table.weights * part.complement(p)[0])) for part in assembler.mixed_parts if part.soft
        )
        return -float(grown.dot(x)) - float(assembler.comm.tompi4py().allreduce(own))

    def _iterated(self, solved: Callable[[Array], PETSc.Vec], scale: float) -> PETSc.Vec:
        """Return the converged unknowns of Newton's iterations; ``solved`` returns the next ones from pressures."""
        x, before = self.assembler.vector(), np.inf
        for _ in range(_MOST):
            y = solved(scale * self.assembler.pressures_of(x))
            x.axpy(-1.0, y)
            change, x = float(x.norm()), y
            # With linear pressures the second correction is rounding.
            if not change < 0.5 * before or change <= 1e-10 * float(y.norm()):
                break
            before = change
        return x

    def _sums(
        self,
        integrate: "Callable[[MixedStepPart, Array], None]",
        which: "Callable[[MixedStepPart], bool] | None" = None,
    ) -> PETSc.Vec:
        """Return the sum of integrals over mixed parts, or over some of these."""
        total, out = self.assembler.local(np.zeros(self.assembler.model.dofs)), self.assembler.vector()
        for part in self.assembler.mixed_parts:
            if which is None or which(part):
                integrate(part, total)
        self.assembler.gather(total, out)
        return out

    def _fill(self, displacement: Array, how: "Callable[[MixedStepPart], tuple[float, Array]]") -> None:
        """Fill the matrix at a state; ``how`` returns the factor of each part's constraints, and the compliance."""
        self.assembler.fill_saddle(displacement, how, self._matrix)
        self._ksp.setOperators(self._matrix)

    def _solved(self, right: PETSc.Vec) -> PETSc.Vec:
        solution = self.assembler.vector()
        for room in (0, *_ROOM):
            if room:
                factors = self._ksp.getPC()
                factors.reset()
                self._ksp.setOperators(self._matrix)
                factors.setFactorSetUpSolverType()
                factors.getFactorMatrix().setMumpsIcntl(14, room)
            self._ksp.solve(right, solution)
            if self._ksp.getConvergedReason() > 0:
                return solution
        raise SolveError("pressures of the mixed formulation: MUMPS cannot factorise the mass and the constraints")


def _gaps(local: Array, part: "MixedStepPart", sums: Array) -> None:
    """Add the integrals of ``theta`` of a displacement over incompressible elements."""
    part.add_gaps(local, sums)


def _beyond(part: "MixedStepPart", p: Array) -> Array:
    """Return ``U*'(p) - U*''(p) p`` at the points, zero where pressures are linear."""
    at_points = part.pressure(p)
    _, slope, bend = complementary(part.volumes, at_points)
    return slope - bend * at_points
