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

# The path's tangent is followed both ways until something moves by this share of the least radius: the difference of
# the tangents there is their derivative but for its square, and far above rounding.
_STEP = 1e-3

# The share of that by which laws with memory go on, so that what flows does.
_LITTLE = 1e-2

_PREFIX = "buckling_"


class Tangents:
    """``K``, the tangent stiffness at an equilibrium, and ``K'``, its derivative with the load factor along the path.

    ``K'`` has all that the load changes: the geometric stiffness of the stress, the displacements before buckling, what
    stress makes of the moduli, and the load stiffness of pressures that follow.

    Attributes
    ----------
    stiffness, derivative
        ``K`` and ``K'``; those of the last `fill`.  Of laws with memory they are of a load that goes on to grow.
    rate
        How the unknowns grow with the load factor.
    ksp
        Solver with ``K``.
    """

    def __init__(self, assembler: Assembler) -> None:
        self._assembler = assembler
        self.stiffness, self.derivative, self._other = (assembler.matrix() for _ in range(3))
        self.rate, self._force = assembler.vector(), assembler.vector()
        self.ksp = direct(self.stiffness, factorisation(assembler, _PREFIX), _PREFIX)

    def fill(self, one: Known) -> None:
        """Set all of them at an equilibrium."""
        if self._assembler.model.remembers:
            self._fill_loaded(one)
            return
        x, factor = one.x, one.factor
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

    def _fill_loaded(self, one: Known) -> None:
        """Set all of them at an equilibrium of laws with memory, by tangents of a load that goes on to grow.

        They are those a little farther along the path: what flows there flows on (F. R. Shanley, J. Aeronautical Sci.
        14 (1947) 261-268), and what the moduli of a long load step have less, none of the law, is not in them.
        """
        assembler, place = self._assembler, one.x.copy()
        one.rate.copy(self.rate)
        little = _LITTLE * self._step(one.factor)
        place.axpy(little, self.rate)
        self._fill(place, one.factor + little)
        step = self._step(one.factor)
        place.axpy(step, self.rate)
        assembler.advance(place, one.factor + little + step)
        place.axpy(little, self.rate)
        self._tangent(place, one.factor + 2.0 * little + step, self.derivative)
        assembler.obey(one.laws)
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
        # No step leads to where something flows.
        self._assembler.obey([one.frozen for one in own])
        self._fill(x, 0.0)
        self._assembler.geometric_stiffness(self.rate, self._step(0.0), self.derivative)
        self._assembler.obey(own)

    def solve(self, force: PETSc.Vec) -> PETSc.Vec:
        """Return what a force displaces, by the tangent at the equilibrium."""
        found = force.duplicate()
        self.ksp.solve(force, found)
        return found

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
        for one in (self.ksp, self.stiffness, self.derivative, self._other, self.rate, self._force):
            one.destroy()
