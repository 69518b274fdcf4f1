"""Forces that hold bodies on their way to an equilibrium, and vanish there: the proximal point method.

To the forces of a model are added ``-a D (x - x0)``, ``D`` a diagonal of its stiffness.  The equilibrium with them is
sought again and again with ``x0`` where it was found last (Rockafellar, SIAM J. Control Optim. 14 (1976) 877-898),
until nothing is left of them: what remains is the equilibrium without them.  The larger ``a``, the shorter steps are.
"""

from collections.abc import Callable

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.errors import SolveError

# By what the fraction is multiplied after a solution, and after none; below the least one rounding tells no motion.
FEWER, MORE = 0.1, 4.0
LEAST = 1e-10

# What may be left, relative to the forces that supports and loads carry, and the most solutions it may take.
LEFT = 1e-6
ROUNDS = 60

# The same of what is told of load steps on the way.
NEARLY, FEW = 1e-3, 8

# How many times as firmly a body is held first that flies off where contact changes.
_FIRMER = 1e5

# A body that has gone so many times the model's size is held by nothing.
_AWAY = 10.0


class Proximal:
    """Forces ``-a D (x - x0)`` that hold bodies where they were last, and vanish.

    Parameters
    ----------
    assembler
        Of the model.
    stiffness
        The diagonal ``D``, zero for what is not held.
    fraction
        The factor ``a``.

    Attributes
    ----------
    left
        Bound of the resultant that these forces balance in the last state, with what Newton's iterations leave,
        relative to the forces that supports and loads carry.
    rounds
        Solutions at the full load in which they were let vanish.
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
        """Let a state be the one in which these forces are none."""
        x.copy(self._start)

    def is_away(self, x: PETSc.Vec) -> bool:
        """Return whether a body has gone so far that nothing holds it."""
        return bool(np.abs(self._displacement(x)).max() > _AWAY * self._model.size)

    def add_forces(self, x: PETSc.Vec, out: PETSc.Vec, carried: float) -> None:
        """Add what is to vanish to the out-of-balance forces; ``carried`` is the norm of what supports and loads do."""
        self._forces.waxpy(-1.0, self._start, x)
        self._forces.pointwiseMult(self._forces, self._stiffness)
        self._forces.scale(self.fraction)
        # No sum over n entries is larger than sqrt(n) times their norm.
        size = np.sqrt(self._model.unknowns) * out.norm()
        self.left = size / carried if carried > 0.0 else float(size > 0.0)
        out.axpy(1.0, self._forces)

    def add_stiffness(self, out: PETSc.Mat) -> None:
        """Add its derivative to the tangent."""
        diagonal = self._stiffness.copy()
        diagonal.scale(self.fraction)
        out.setDiagonal(diagonal, PETSc.InsertMode.ADD_VALUES)

    def step(self, again: Callable[[], bool], x: PETSc.Vec) -> bool:
        """Seek the equilibrium with these forces, which are none where it was last; return whether it is found."""
        self.rounds += 1
        self.begin(x)
        found = again()
        if not found:
            self.left = np.inf
        return found

    def keep(self) -> Callable[[], None]:
        """Return what takes these forces back to what they are now."""
        start, fraction, left, rounds = self._start.copy(), self.fraction, self.left, self.rounds

        def back() -> None:
            start.copy(self._start)
            self.fraction, self.left, self.rounds = fraction, left, rounds

        return back

    def vanish(self, again: Callable[[], bool], x: PETSc.Vec, left: float = LEFT, rounds: int = ROUNDS) -> None:
        """Let the forces vanish.

        Parameters
        ----------
        again
            Seeks the equilibrium at the same load once more; returns whether it was found.
        x
            Where the last equilibrium is.
        left, rounds
            What may be left, and how many solutions there may be.

        Raises
        ------
        SolveError
            If they do not: nothing holds a body.
        """
        while self.left > left:
            if self.rounds >= rounds:
                raise SolveError(self.why(x))
            fraction = self.fraction
            self.fraction = max(FEWER * fraction, LEAST)
            if not self.step(again, x):
                # It flew too far in one solution: steps are made shorter than they were.
                self.fraction = MORE * fraction
            elif not self._forces.norm() > 0.0:
                # It stays where it is: what is left is rounding.
                return
            elif self.is_away(x):
                raise SolveError(self.why(x))

    def hold(self, again: Callable[[], bool], x: PETSc.Vec) -> None:
        """Let the forces vanish, nearly, anew: firm ones at first, which hold bodies where they are.

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
