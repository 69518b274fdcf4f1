"""Bodies that only contact holds: a stabilisation that vanishes.

Where supports leave a rigid motion free, the stiffness is singular until contact resists.  Such a body is held by
forces ``-a D (x - x0)`` (`isorod.statics.proximal`), ``D`` the diagonal of the stiffness at rest.  Load steps climb
with ``x0`` at rest, so that the increment shrinks with the step.  At the full load these forces vanish, with a
smaller ``a`` in each step.
"""

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import SPARSE
from isorod.checks import rigid_motions
from isorod.petsc.direct import direct
from isorod.petsc.softest import noise, soften
from isorod.statics.proximal import LEAST, Proximal

# The fraction ``a`` of load steps: what a slender rod of twenty radii resists its bending with, and, where a body is
# softer, this part of what its softest deformation resists with (found by so many inverse iterations).
_SHARE = 1e-4
_SOFT = 0.01
_ITERATIONS = 4

_PREFIX = "stabilisation_"


class Stabilisation(Proximal):
    """The forces that hold bodies until contact does."""

    def __init__(self, assembler: Assembler, matrix: PETSc.Mat, loose: Sequence[tuple[int, Array]]) -> None:
        model = assembler.model
        bodies = np.unique([body for body, _ in loose])
        mine = np.zeros(model.dofs)
        for body in bodies:
            # Rigid motions are of control points alone; many others together can be near to nothing.
            model.nodal(mine, int(body))[model.bodies[body].space.is_control_point] = 1.0
        self._loose = loose
        stiffness = matrix.getDiagonal()
        stiffness.pointwiseMult(stiffness, assembler.state(mine))
        super().__init__(assembler, stiffness, LEAST)
        self.left = 0.0
        self.fraction = max(LEAST, min(_SHARE, _SOFT * self._softness(assembler, matrix)))

    def _softness(self, assembler: Assembler, matrix: PETSc.Mat) -> float:
        """Return about the least fraction of ``D`` with which what is loose resists a deformation: that of a spring."""
        weight, rigid = self._stiffness, list[PETSc.Vec]()

        def purge(shape: PETSc.Vec) -> None:
            """Take the rigid motions out of a shape."""
            for motion in rigid:
                shape.axpy(-motion.dot(weight * shape), motion)

        for motion in rigid_motions.on_unknowns(assembler, self._loose):
            purge(motion)
            motion.scale(1.0 / np.sqrt(motion.dot(weight * motion)))
            rigid.append(motion)
        shifted = matrix.copy()
        shifted.setDiagonal(LEAST * weight, PETSc.InsertMode.ADD_VALUES)
        kind = SPARSE | {"pc_type": "cholesky" if assembler.symmetric else "lu"}
        ksp = direct(shifted, {f"{_PREFIX}{name}": value for name, value in kind.items()}, _PREFIX)
        softness, _ = soften(ksp, weight, noise(assembler.vector()), _ITERATIONS, purge)
        for one in (ksp, shifted):
            one.destroy()
        return softness - LEAST

    def why(self, x: PETSc.Vec) -> str:
        """Return which free motion goes on."""
        moved = self._displacement(x)
        found = []
        for body in sorted({body for body, _ in self._loose}):
            own = [motion for other, motion in self._loose if other == body]
            parts = [float(np.sum(motion * self._model.nodal(moved, body))) for motion in own]
            whole = sum(part * motion for part, motion in zip(parts, own, strict=True))
            found.append((float(np.linalg.norm(parts)), body, whole))
        _, body, motion = max(found, key=lambda one: one[0])
        how = rigid_motions.describe(self._model.bodies[body].space, np.asarray(motion))
        return (
            f"supports and contact: body {body} is free to {how} (rigid-body mode), no active contact at the end; "
            "add a support, or loads that press it against its partner"
        )
