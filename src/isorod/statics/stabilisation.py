"""Bodies that only contact holds: a stabilisation that vanishes.

Where supports leave a rigid motion free, the stiffness is singular until contact resists.  To the forces of such a
body are added ``-a D (x - x0)``, ``D`` the diagonal of the stiffness at rest.  Load steps climb with ``x0`` at rest, so
that the way of a step shrinks with the step.  At the full load the equilibrium is sought again with ``x0`` where it was
found last and a smaller ``a`` each time (the proximal point method: Rockafellar, SIAM J. Control Optim. 14 (1976)
877-898), until nothing is left of these forces: what remains is the equilibrium without them.
"""

from collections.abc import Callable, Sequence

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.checks import rigid_motions
from isorod.errors import SolveError

# The share ``a`` of load steps: what a slender rod of twenty radii resists its bending with, and, where a body is
# softer, this part of what its softest deformation resists with (found by so many inverse iterations).
_SHARE = 1e-4
_SOFT = 0.01
_ITERATIONS = 4

# By what the share is multiplied after a solution, and after none; below the least one rounding tells no motion.
_FEWER, _MORE = 0.1, 4.0
_LEAST = 1e-10

# What may be left, relative to the forces that supports and loads carry, and the most solutions it may take.
LEFT = 1e-6
ROUNDS = 60

# A body that has gone so many times the model's size is held by nothing.
_AWAY = 10.0


class Stabilisation:
    """The forces that hold bodies until contact does.

    Attributes
    ----------
    left
        Bound of the resultant that these forces balance in the last state, with what Newton's iterations leave,
        relative to the forces that supports and loads carry.
    rounds
        Solutions at the full load in which they were let vanish.
    """

    def __init__(self, assembler: Assembler, matrix: PETSc.Mat, loose: Sequence[tuple[int, Array]]) -> None:
        model = assembler.model
        bodies = np.unique([body for body, _ in loose])
        mine = np.zeros(model.dofs)
        for body in bodies:
            # Rigid motions are of carriers alone; many others together can be near to nothing.
            model.nodal(mine, int(body))[model.bodies[body].space.is_carrier] = 1.0
        self._model, self._loose = model, loose
        self._displacement: Callable[[PETSc.Vec], Array] = lambda x: assembler.displacement(x, 1.0)
        self._stiffness = matrix.getDiagonal()
        self._stiffness.pointwiseMult(self._stiffness, assembler.state(mine))
        self._start = assembler.vector()
        self._forces = assembler.vector()
        self._share = max(_LEAST, min(_SHARE, _SOFT * self._softness(assembler, matrix)))
        self.left = 0.0
        self.rounds = 0

    def _softness(self, assembler: Assembler, matrix: PETSc.Mat) -> float:
        """Return about the least share of ``D`` with which what is loose resists a deformation: that of a spring."""
        weight, rigid = self._stiffness, list[PETSc.Vec]()

        def deform(shape: PETSc.Vec) -> None:
            """Take the rigid motions out of a shape, and scale it."""
            for motion in rigid:
                shape.axpy(-motion.dot(weight * shape), motion)
            shape.scale(1.0 / np.sqrt(shape.dot(weight * shape)))

        for motion in rigid_motions.on_unknowns(assembler, self._loose):
            deform(motion)
            rigid.append(motion)
        shifted = matrix.copy()
        shifted.setDiagonal(_LEAST * weight, PETSc.InsertMode.ADD_VALUES)
        ksp = PETSc.KSP().create(assembler.comm)
        ksp.setType(PETSc.KSP.Type.PREONLY)
        ksp.getPC().setType(PETSc.PC.Type.CHOLESKY if assembler.symmetric else PETSc.PC.Type.LU)
        ksp.getPC().setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        ksp.setOperators(shifted)
        shape, push = assembler.vector(), assembler.vector()
        # The same on any number of ranks.
        shape.array_w[:] = np.random.default_rng(0).normal(size=shape.getSize())[slice(*shape.getOwnershipRange())]
        softness = 0.0
        for _ in range(_ITERATIONS):
            deform(shape)
            push.pointwiseMult(weight, shape)
            ksp.solve(push, shape)
            softness = 1.0 / push.dot(shape) - _LEAST
        for one in (ksp, shifted):
            one.destroy()
        return softness

    def begin(self, x: PETSc.Vec) -> None:
        """Let a state be the one in which these forces are none."""
        x.copy(self._start)

    def add_forces(self, x: PETSc.Vec, out: PETSc.Vec, carried: float) -> None:
        """Add what is to vanish to the out-of-balance forces; ``carried`` is the norm of what supports and loads do."""
        self._forces.waxpy(-1.0, self._start, x)
        self._forces.pointwiseMult(self._forces, self._stiffness)
        self._forces.scale(self._share)
        # No sum over n entries is larger than sqrt(n) times their norm.
        size = np.sqrt(self._model.unknowns) * out.norm()
        self.left = size / carried if carried > 0.0 else float(size > 0.0)
        out.axpy(1.0, self._forces)

    def add_stiffness(self, out: PETSc.Mat) -> None:
        """Add its derivative to the tangent."""
        diagonal = self._stiffness.copy()
        diagonal.scale(self._share)
        out.setDiagonal(diagonal, PETSc.InsertMode.ADD_VALUES)

    def vanish(self, again: Callable[[], bool], x: PETSc.Vec) -> None:
        """Let the forces vanish.

        Parameters
        ----------
        again
            Seeks the equilibrium at the full load once more; returns whether it was found.
        x
            Where the last equilibrium is.

        Raises
        ------
        SolveError
            If they do not: nothing holds a body.
        """
        while self.left > LEFT:
            if self.rounds == ROUNDS:
                raise SolveError(self._why(x))
            self.rounds += 1
            x.copy(self._start)
            share = self._share
            self._share = max(_FEWER * share, _LEAST)
            if not again():
                # Where it flew too far in one solution, steps are made shorter.
                self._share = _MORE * share
                self.left = np.inf
            elif not self._forces.norm() > 0.0:
                # It stays where it is: what is left is rounding.
                return
            elif np.abs(self._displacement(x)).max() > _AWAY * self._model.size:
                raise SolveError(self._why(x))

    def _why(self, x: PETSc.Vec) -> str:
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
            f"supports and contact: body {body} is free to {how}, and no contact holds it in the end; hold it, or let "
            "loads press it against what holds it"
        )
