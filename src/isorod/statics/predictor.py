"""The path's slope at the start of a load step, and the cubic predictor."""

from typing import NamedTuple

from petsc4py import PETSc


class Ahead(NamedTuple):
    """The path's slope at a load factor, and the norm of its load increment, both per load factor."""

    factor: float
    rate: PETSc.Vec
    force: float


class Before(NamedTuple):
    """The equilibrium before the last: the increment from its load factor, its state, and the path's slope there."""

    step: float
    x: PETSc.Vec
    rate: PETSc.Vec

    def bend(self, x: PETSc.Vec, rate: PETSc.Vec, step: float) -> PETSc.Vec:
        """Return the difference to a linear step of the cubic through two equilibria with their tangents.

        Parameters
        ----------
        x, rate
            The last equilibrium, and the path's slope there.
        step
            Increment of the load factor.
        """
        gap = self.x - x
        gap.axpy(self.step, rate)
        turn = self.rate - rate
        turn.scale(self.step)
        fraction = step / self.step
        # x + v t + a t^2 + b t^3 with the values and slopes of both ends.
        gap.scale(3.0 * fraction**2 + 2.0 * fraction**3)
        gap.axpy(fraction**2 + fraction**3, turn)
        return gap
