"""The tangent stiffness along the primary path, and its derivative with the load factor."""

import numpy as np
from petsc4py import PETSc

from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation
from isorod.buckling.path import Known
from isorod.errors import InputError, SolveError
from isorod.options import defaults
from isorod.petsc.direct import direct, room

# Change of the load factor by which forces are differentiated.
_DELTA = 1e-6

# The tangents are differenced along the path's tangent, in both directions, where the largest displacement is this
# fraction of the smallest radius: errors are of second order, and rounding is far smaller.
_STEP = 1e-3

# The fraction of that by which laws with memory are loaded first, so that plastic flow continues.
_LITTLE = 1e-2

_PREFIX = "buckling_"


class Tangents:
    """``K``, the tangent stiffness at an equilibrium, and ``K'``, its derivative with the load factor along the path.

    ``K'`` includes the geometric stiffness of the stress, the displacements before buckling, the change of the moduli
    with the stress, and the load stiffness of follower pressures.

    Attributes
    ----------
    stiffness, derivative
        ``K`` and ``K'``; those of the last `fill`.  Of laws with memory they are those of further loading.
    rate
        Derivative of the unknowns with the load factor.
    ksp
        Solver with ``K``.
    """

    def __init__(self, assembler: Assembler) -> None:
        self._assembler = assembler
        self.stiffness, self.derivative, self._other = (assembler.matrix() for _ in range(3))
        self.rate, self._force = assembler.vector(), assembler.vector()
        self.ksp = direct(self.stiffness, factorisation(assembler, _PREFIX), _PREFIX)

    def fill(self, equilibrium: Known) -> None:
        """Set all of them at an equilibrium."""
        if self._assembler.model.remembers:
            self._fill_loaded(equilibrium)
            return
        x, factor = equilibrium.x, equilibrium.factor
        self._fill(x, factor)
        step = self._step(factor)
        place = x.copy()
        place.axpy(step, self.rate)
        self._tangent(place, factor + step, self.derivative)
        place.axpy(-2.0 * step, self.rate)
        self._tangent(place, factor - step, self._other)
        self.derivative.axpy(-1.0, self._other, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self.derivative.scale(0.5 / step)
        place.destroy()

    def _fill_loaded(self, equilibrium: Known) -> None:
        """Set all of them at an equilibrium of laws with memory, by tangents of further loading.

        They are those a little farther along the path: where material flows it continues to (F. R. Shanley, J.
        Aeronautical Sci. 14 (1947) 261-268), and by so short an increment the algorithmic moduli are those of the law.
        """
        assembler, place = self._assembler, equilibrium.x.copy()
        equilibrium.rate.copy(self.rate)
        little = _LITTLE * self._step(equilibrium.factor)
        place.axpy(little, self.rate)
        self._fill(place, equilibrium.factor + little)
        step = self._step(equilibrium.factor)
        place.axpy(step, self.rate)
        assembler.advance(place, equilibrium.factor + little + step)
        place.axpy(little, self.rate)
        self._tangent(place, equilibrium.factor + 2.0 * little + step, self.derivative)
        assembler.obey(equilibrium.laws)
        self.derivative.axpy(-1.0, self.stiffness, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self.derivative.scale(1.0 / (step + little))
        place.destroy()

    def _fill(self, x: PETSc.Vec, factor: float) -> None:
        """Set the tangent and the path's slope."""
        assembler = self._assembler
        self._tangent(x, factor, self.stiffness)
        assembler.load_forces(x, factor, _DELTA, self._force)
        self._force.scale(-1.0 / _DELTA)
        self.ksp.setOperators(self.stiffness)
        with defaults(room(assembler.comm, _PREFIX)):
            self.ksp.solve(self._force, self.rate)

    def fill_at_rest(self, x: PETSc.Vec) -> None:
        """Set all of them at rest, ``K'`` being the geometric and the load stiffness alone."""
        own = self._assembler.laws
        # At rest nothing flows.
        self._assembler.obey([laws.frozen for laws in own])
        self._fill(x, 0.0)
        self._assembler.geometric_stiffness(self.rate, self._step(0.0), self.derivative)
        self._assembler.obey(own)

    def _tangent(self, x: PETSc.Vec, factor: float, out: PETSc.Mat) -> None:
        self._assembler.extrapolate()
        self._assembler.tangent(x, factor, out)

    def _step(self, factor: float) -> float:
        """Return the change of the load factor over which tangents are differenced."""
        assembler, model = self._assembler, self._assembler.model
        moved = assembler.displacement(self.rate, 0.0)
        driven = (model.prescribed(factor + _DELTA) - model.prescribed(factor)) / _DELTA
        fastest = max(float(np.abs(one).max(initial=0.0)) for one in (moved, driven))
        if fastest == 0.0:
            raise InputError(
                "buckling: the loads act on what supports hold alone, and move nothing; free it along them"
            )
        if not np.isfinite(fastest):
            raise SolveError(f"load factor {factor:.6g}: the tangent stiffness is singular")
        return _STEP * min(body.space.rod.radius for body in model.bodies) / fastest

    def destroy(self) -> None:
        """Give back matrices, factors and vectors."""
        for item in (self.ksp, self.stiffness, self.derivative, self._other, self.rate, self._force):
            item.destroy()
