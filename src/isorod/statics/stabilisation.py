"""Stabilisation of bodies that only contact holds, reduced to zero at the full load.

Where supports leave a rigid-body mode free, the stiffness is singular until contact resists.  Such a body is held by
forces ``-a D (x - x0)`` (`isorod.statics.proximal`), ``D`` the diagonal of the stiffness at rest.  In load steps ``x0``
is the state of rest, so that the increment shrinks with the step.  At the full load the forces are reduced to zero,
with a smaller ``a`` in each step.
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

# The fraction ``a`` of load steps: about the bending stiffness of a slender rod of twenty radii and, where a body is
# softer, this part of the stiffness of its softest deformation (by so many inverse iterations).
_FRACTION = 1e-4
_SOFT = 0.01
_ITERATIONS = 4

_PREFIX = "stabilisation_"


class Stabilisation(Proximal):
    """Artificial stiffness of bodies until contact holds them."""

    def __init__(self, assembler: Assembler, matrix: PETSc.Mat, loose: Sequence[tuple[int, Array]]) -> None:
        model = assembler.model
        bodies = np.unique([body for body, _ in loose])
        mine = np.zeros(model.dofs)
        for body in bodies:
            # Control points alone: the other functions may be nearly dependent.
            model.nodal(mine, int(body))[model.bodies[body].space.is_control_point] = 1.0
        self._loose = loose
        stiffness = matrix.getDiagonal()
        stiffness.pointwiseMult(stiffness, assembler.state(mine))
        super().__init__(assembler, stiffness, LEAST)
        self.left = 0.0
        self.fraction = max(LEAST, min(_FRACTION, _SOFT * self._softness(assembler, matrix)))

    def _softness(self, assembler: Assembler, matrix: PETSc.Mat) -> float:
        """Return roughly the smallest ratio of stiffness to ``D`` of deformations of the loose bodies."""
        weight, rigid = self._stiffness, list[PETSc.Vec]()

        def purge(shape: PETSc.Vec) -> None:
            """Remove the rigid motions from a shape."""
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
        for item in (ksp, shifted):
            item.destroy()
        return softness - LEAST

    def why(self, x: PETSc.Vec) -> str:
        """Return a message with the free motion."""
        moved = self._displacement(x)
        moving = []
        for body in sorted({body for body, _ in self._loose}):
            own = [motion for other, motion in self._loose if other == body]
            parts = [float(np.sum(motion * self._model.nodal(moved, body))) for motion in own]
            total = sum(part * motion for part, motion in zip(parts, own, strict=True))
            moving.append((float(np.linalg.norm(parts)), body, total))
        _, body, motion = max(moving, key=lambda entry: entry[0])
        how = rigid_motions.describe(self._model.bodies[body].space, np.asarray(motion))
        return (
            f"supports and contact: body {body} is free to {how} (rigid-body mode), no active contact at the end; "
            "add a support, or loads that press it against its partner"
        )
