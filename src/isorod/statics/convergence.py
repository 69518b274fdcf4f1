"""Convergence test of equilibrium iterations.

A slender rod's bending forces are smaller than its stretching forces by the square of its slenderness.  A tolerance
relative to the forces of a load step's linear predictor, which stretches where it should bend, would accept any state,
and so would one relative to the largest stiffness.  So the residual is compared with the forces that supports and loads
carry, and, component by component, with its rounding.
"""

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.gradients import deformation_gradients
from isorod.assembly.part import ROUNDING
from isorod.checks import hourglass
from isorod.material.thermal import bare
from isorod.petsc.matrix import absolute_product, has_whole_rows

# A load step is given up where the residual exceeds this multiple of that after the predictor: iterations that diverge
# like this may converge to another equilibrium.
GROWTH = 3.0

# Newton's iterations end where the correction is less than this fraction of the state, or than -snes_stol.
STEP = 1e-8

# A step that leaves less than this fraction of the volume anywhere is too large: equilibria beyond are meaningless.
SQUEEZE = 0.2

# Stretches, or inverse stretches, beyond which laws of logarithmic strain may have no stress.
_FAR = 12.0


def squeezed(assembler: Assembler, before: list[Array], x: PETSc.Vec, factor: float) -> str | None:
    """Return a message where the volume has shrunk too much since ``before`` (`Assembler.jacobians`), if it has."""
    after = assembler.jacobians(x, factor)
    ratio = min((float(np.min(b / a)) for a, b in zip(before, after, strict=True)), default=1.0)
    if min(assembler.comm.tompi4py().allgather(ratio)) > SQUEEZE:
        return None
    return worst_place(assembler, x, factor, f"det F falls below {100.0 * SQUEEZE:g} % of its previous value")


def worst_place(assembler: Assembler, x: PETSc.Vec, factor: float, problem: str) -> str:
    """Return a problem, or that an element is inverted if one is, with the place where ``det F`` is smallest."""
    det, body, element, u = assembler.smallest_jacobian(x, factor)
    text = problem if det > 0.0 else "an element inverts"
    place = f"element {element} of body {body}, axis position u = {u:.4g}: det F = {det:.3g}"
    if det > 0.0 and assembler.model.remembers and (failed := _without_stress(assembler, x, factor)):
        text, place = failed
    return f"{text} at the minimum step size; worst place: {place}{hourglass.hint(assembler.model)}"


def _without_stress(assembler: Assembler, x: PETSc.Vec, factor: float) -> tuple[str, str] | None:
    """Return the problem of a law with memory that has no stress, and the place, as text; None where all have."""
    moved = assembler.displacement(x, factor).reshape(-1, 3)
    failed = []
    for part in assembler.parts:
        F = deformation_gradients(part.table, moved[part.nodes].reshape(part.shape))
        for segment in part.laws.at(factor).segments:
            F_here = segment.of(F)
            bad = ~np.isfinite(segment.law.stress(F_here)).all(axis=(-2, -1))
            if segment.law.remembers and bad.any():
                stretches = np.linalg.svd(F_here, compute_uv=False)
                size = np.where(bad, np.abs(np.log(stretches)).max(axis=-1), -np.inf)
                entry = e, t, _ = np.unravel_index(int(np.argmax(size)), bad.shape)
                law, e = type(bare(segment.law)).__name__, e + segment.first
                own_place = part.which, int(part.table.first + e), float(part.table.u[e, t])
                least, most = float(stretches[entry].min()), float(stretches[entry].max())
                failed.append((float(size[entry]), law, own_place, least, most))
    failed = [failure for each in assembler.comm.tompi4py().allgather(failed) for failure in each]
    if not failed:
        return None
    worst, law, (body, element, at), least, most = max(failed)
    far = worst > np.log(_FAR)
    why = f"stretches beyond {_FAR:g} have no stress" if far else "its local solution does not converge"
    place = f"element {element} of body {body}, axis position u = {at:.4g}: stretches {least:.3g} to {most:.3g}"
    return f"{law}: {why}", place


class Convergence:
    """Convergence test of Newton's iterations: the residual is a small fraction of the forces carried, or rounding.

    Parameters
    ----------
    assembler
        The model's assembler.

    Attributes
    ----------
    carried_force
        Norm of the forces of supports and loads at the last residual (`Assembler.residual`), set together with it.
    guarded
        Whether a solution is given up where the residual grows (`GROWTH`).
    """

    def __init__(self, assembler: Assembler) -> None:
        self.assembler = assembler
        spaces = [body.space for body in assembler.model.bodies]
        self.size = max(float(np.ptp(space.positions[space.is_control_point], axis=0).max()) for space in spaces)
        # Unknowns that are not displacements, and contact, have units and rounding of their own.
        self._forces_alone = assembler.unknowns == assembler.model.unknowns
        self.plain = assembler.contact is None and self._forces_alone
        # One for displacements, zero for other unknowns; None where there are no others.
        self._moves = None if self._forces_alone else assembler.state(np.ones(assembler.model.dofs), solids=1.0)
        self._sizes: Array | None = None
        # Of each unknown of this rank, which may have none; None where the common floor applies.
        self._rounding: Array | None = None
        self.carried_force = 0.0
        self.guarded = True
        self._scale = 0.0
        self._near = False
        self._floor = 0.0
        self._first = 0.0

    def update(self, matrix: PETSc.Mat, scale: float | None) -> None:
        """Prepare a load step: its tangent, and the norm of its predictor's force; None where there is no predictor.

        Without predictor the test is by the forces carried or, with other unknowns or contact, by rounding.
        """
        self._scale = scale if scale is not None else np.inf if self.plain else 0.0
        self._near = scale is None
        self._rounding = None
        if self.plain and has_whole_rows(matrix):
            if self._sizes is None:
                self._sizes = self._displacements()
            self._rounding = ROUNDING * absolute_product(matrix, self._sizes)
        else:
            self._floor = ROUNDING * self.size * matrix.norm(PETSc.NormType.INFINITY)

    def _displacements(self) -> Array:
        """Return the size of each unknown of this rank: that of the rod at control points, else of the section."""
        sizes = []
        for body in self.assembler.model.bodies:
            space = body.space
            coefficients = np.abs(space.positions[~space.is_control_point])
            sizes.append(np.where(space.is_control_point, self.size, coefficients.max(initial=0.0)))
        everywhere = np.repeat(np.concatenate(sizes), 3)
        state = self.assembler.state(everywhere, solids=self.size)
        sizes_here = np.array(state.array_r)
        state.destroy()
        return sizes_here

    def reached(self, residual: PETSc.Vec, force: float, rtol: float) -> bool:
        """Return whether the residual, of norm ``force``, is small enough."""
        if self._rounding is None:
            carried = min(self._scale, self.carried_force)
            forces = force if self._moves is None else (residual * self._moves).norm()
            return force <= max(rtol * self._scale, self._floor) and forces <= max(rtol * carried, self._floor)
        lost = int(np.count_nonzero(np.abs(residual.array_r) > self._rounding))
        if self.assembler.comm.tompi4py().allreduce(lost) == 0:
            return True
        return force <= rtol * min(self._scale, self.carried_force)

    def reuses_tangent(self, before: float, force: float, snes: PETSc.SNES) -> bool:
        """Return whether one more iteration with the last tangent should suffice.

        The last iteration took the norm of the residual from ``before`` to ``force``.  Newton's method brings an error
        ``e`` to ``c e^2``, and with the tangent of the iteration before to ``2 c e e_before``: the residual falls by
        twice the last ratio.  A margin of five is added.
        """
        target = snes.getTolerances()[0] * min(self._scale, self.carried_force)
        return 10.0 * force * force <= target * before

    def test(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> PETSc.SNES.ConvergedReason:
        """Return SNES's reason to stop, if any; ``norms`` are those of state, correction and residual."""
        reasons = PETSc.SNES.ConvergedReason
        state, change, force = norms
        if not np.isfinite(force):
            return reasons.DIVERGED_FNORM_NAN
        if iteration == 0:
            self._first = force
        rtol, _, stol, _ = snes.getTolerances()
        # Near an equilibrium a second step is cheap, with the factors of the first.
        first = self._near and iteration < 2
        if self.reached(snes.getFunction()[0], force, 0.0 if first else rtol):
            return reasons.CONVERGED_FNORM_ABS
        if self.plain and self.guarded and force > GROWTH * self._first:
            return reasons.DIVERGED_DTOL
        if iteration > 0 and not first and change < max(stol, STEP) * state:
            return reasons.CONVERGED_SNORM_RELATIVE
        return reasons.CONVERGED_ITERATING
