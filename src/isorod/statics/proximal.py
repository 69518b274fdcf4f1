"""Artificial forces that vanish at equilibrium: the proximal point method.

To the forces of a model are added ``-a D (x - x0)``, ``D`` a diagonal of its stiffness.  Equilibria with them are
computed repeatedly, with the last one as ``x0`` (Rockafellar, SIAM J. Control Optim. 14 (1976) 877-898), until the
forces are negligible: the last is the equilibrium without them.  The larger ``a``, the shorter are the steps.
"""

from collections.abc import Callable

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.errors import SolveError

# Factors on the fraction after success and after failure; below the smallest fraction motions are rounding.
FEWER, MORE = 0.1, 4.0
LEAST = 1e-10

# Residual forces allowed, relative to those that supports and loads carry, and the maximum number of solutions.
LEFT = 1e-6
ROUNDS = 60

# The same for the results of intermediate load steps.
NEARLY, FEW = 1e-3, 8

# Factor on the initial fraction for a body that moves away where contact changes.
_FIRMER = 1e5

# A displacement of this multiple of the model's size means that nothing holds a body.
_AWAY = 10.0


class Proximal:
    """Forces ``-a D (x - x0)`` that hold bodies at their last state, and vanish.

    Parameters
    ----------
    assembler
        Assembler of the model.
    stiffness
        The diagonal ``D``, zero for unknowns that are not held.
    fraction
        The factor ``a``.

    Attributes
    ----------
    left
        Bound of the resultant of these forces in the last state and of the residual of Newton's iterations, relative to
        the forces that supports and loads carry.
    rounds
        Number of solutions at the full load in which they were reduced.
    """

    def __init__(self, assembler: Assembler, stiffness: PETSc.Vec, fraction: float) -> None:
        self._model = assembler.model
        self._displacement: Callable[[PETSc.Vec], Array] = lambda x: assembler.displacement(x, 1.0)
        self._stiffness = stiffness
        self._start = assembler.vector()
        self._forces = assembler.vector()
        self.fraction = max(LEAST, fraction)
        self.left = np.inf
        self.rounds = 0

    def begin(self, x: PETSc.Vec) -> None:
        """Set the state ``x0``, in which these forces are zero."""
        x.copy(self._start)

    def is_away(self, x: PETSc.Vec) -> bool:
        """Return whether a body has moved so far that nothing holds it."""
        return bool(np.abs(self._displacement(x)).max() > _AWAY * self._model.size)

    def add_forces(self, x: PETSc.Vec, out: PETSc.Vec, carried: float) -> None:
        """Add the forces to a residual; ``carried`` is the norm of those that supports and loads carry."""
        self._forces.waxpy(-1.0, self._start, x)
        self._forces.pointwiseMult(self._forces, self._stiffness)
        self._forces.scale(self.fraction)
        # No sum over n entries is larger than sqrt(n) times their norm.
        size = np.sqrt(self._model.unknowns) * out.norm()
        self.left = size / carried if carried > 0.0 else float(size > 0.0)
        out.axpy(1.0, self._forces)

    def add_stiffness(self, out: PETSc.Mat) -> None:
        """Add the derivative of the forces to the tangent."""
        diagonal = self._stiffness.copy()
        diagonal.scale(self.fraction)
        out.setDiagonal(diagonal, PETSc.InsertMode.ADD_VALUES)

    def step(self, again: Callable[[], bool], x: PETSc.Vec) -> bool:
        """Iterate to equilibrium with these forces from the last one as ``x0``; return whether that converges."""
        self.rounds += 1
        self.begin(x)
        converged = again()
        if not converged:
            self.left = np.inf
        return converged

    def keep(self) -> Callable[[], None]:
        """Return a function that restores the present forces."""
        start, fraction, left, rounds = self._start.copy(), self.fraction, self.left, self.rounds

        def back() -> None:
            start.copy(self._start)
            self.fraction, self.left, self.rounds = fraction, left, rounds

        return back

    def vanish(self, again: Callable[[], bool], x: PETSc.Vec, left: float = LEFT, rounds: int = ROUNDS) -> None:
        """Reduce the forces to zero.

        Parameters
        ----------
        again
            Iterates to equilibrium at the same load again; returns whether that converges.
        x
            The solver's last equilibrium.
        left, rounds
            Relative residual forces allowed, and maximum number of solutions.

        Raises
        ------
        SolveError
            If they do not vanish: nothing holds a body.
        """
        while self.left > left:
            if self.rounds >= rounds:
                raise SolveError(self.why(x))
            fraction = self.fraction
            self.fraction = max(FEWER * fraction, LEAST)
            if not self.step(again, x):
                # The step was too long.
                self.fraction = MORE * fraction
            elif not self._forces.norm() > 0.0:
                # The body is at rest: the remainder is rounding.
                return
            elif self.is_away(x):
                raise SolveError(self.why(x))

    def hold(self, again: Callable[[], bool], x: PETSc.Vec) -> None:
        """Reduce the forces nearly to zero again, from large ones that hold bodies in place.

        Parameters and errors are those of `vanish`.
        """
        fraction, rounds = self.fraction, self.rounds
        self.fraction, self.rounds, self.left = _FIRMER * fraction, 0, np.inf
        try:
            self.vanish(again, x, NEARLY, 2 * FEW)
        finally:
            self.fraction, self.rounds = fraction, rounds

    def why(self, x: PETSc.Vec) -> str:
        """Return why they do not vanish."""
        return "the model moves without bound" if self.is_away(x) else f"no equilibrium after {self.rounds} steps"
