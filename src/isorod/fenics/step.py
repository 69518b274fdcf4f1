"""A finite element body in an implicit time step.

With an energy its internal forces are those of the mean value discrete gradient, as of rods
(`isorod.material.discrete_gradient_kernel`), by four Gauss points between both states: their work is the change of
energy up to the ninth power of the change of strain.  With a small-strain law, or a form, they are those at midstep.
Loads are those at midstep.
"""

from typing import TYPE_CHECKING, Any

import dolfinx.fem
import numpy as np
import ufl
from petsc4py import PETSc
from ufl.algorithms import extract_coefficients

from isorod.arrays import Array
from isorod.fenics import compat, forms
from isorod.fenics.flags import FAST

if TYPE_CHECKING:
    from isorod.fenics.solid import Solid

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(4)


class Step:
    """Forces and tangent of a body in a step, as functions of the displacement increment on this rank, ``(3 nodes,)``.

    Parameters
    ----------
    solid
        The body.
    """

    def __init__(self, solid: "Solid") -> None:
        self._solid, size = solid, 3 * (solid.owned[1] - solid.owned[0])
        self._start, self._past = np.zeros(size), np.zeros(size)
        self._inertia = 0.0
        mesh, trial = solid.space.mesh, ufl.TrialFunction(solid.space)
        self._between = self._tangent = self._following = None
        if solid.law is None or solid.law.linear:
            return
        self._before = dolfinx.fem.Function(solid.space)
        self._place, self._weight = dolfinx.fem.Constant(mesh, 0.5), dolfinx.fem.Constant(mesh, 1.0)
        work = self._weight * forms.between(
            solid.law, self._before, solid.unknown, self._place, solid.factor, solid.rule_degree
        )
        self._between = compat.form(work, FAST)
        self._tangent = compat.form(ufl.derivative(work, solid.unknown, trial), FAST)
        if not solid.outer.empty() and solid.unknown in extract_coefficients(solid.outer):
            self._following = compat.form(-0.5 * ufl.derivative(solid.outer, solid.unknown, trial), FAST)

    def begin(self, step: float, damping: float, displacement: Array, velocity: Array) -> None:
        """Set the state that a step starts from, its length and the damping."""
        self._start, self._inertia = displacement, 2.0 / step**2 + damping / step
        self._past = self._solid.momenta(2.0 / step * velocity)

    def forces(self, change: Array, factor: float) -> tuple[Array, Array, Array]:
        """Return inertial forces, internal forces and loads; the second are NaN where ``det F <= 0``, unless linear.

        Parameters
        ----------
        change
            Increment of the displacement.
        factor
            Factor of activation; loads have their full value.
        """
        solid, middle = self._solid, self._start + 0.5 * change
        inertial = self._inertia * solid.momenta(change) - self._past
        loads = solid.loads(middle)
        if self._between is None:
            return inertial, solid.residual(middle, 1.0) + loads, loads
        internal = np.zeros(change.size)
        for _ in self._places(change, factor):
            internal += solid.assembled(self._between)
        return inertial, internal, loads

    def tangent(self, change: Array, factor: float) -> PETSc.Mat:
        """Return the derivative of the forces (AIJ), the same matrix in every call; it is not symmetric."""
        solid, middle = self._solid, self._start + 0.5 * change
        matrix = solid.tangent(middle, 1.0) if self._between is None else solid.matrix
        if self._between is None:
            matrix.scale(0.5)
        else:
            matrix.zeroEntries()
            for _ in self._places(change, factor):
                compat.add_matrix(matrix, self._tangent)
            if self._following is not None:
                solid.set(middle, factor)
                compat.add_matrix(matrix, self._following)
            matrix.assemble()
        self.largest = float(matrix.norm(PETSc.NormType.INFINITY))
        if self._inertia:
            matrix.axpy(self._inertia, solid.mass(), PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        return matrix

    def _places(self, change: Array, factor: float) -> Any:
        """Set the forms to each Gauss point between both states in turn."""
        self._solid.set(self._start + change, factor)
        compat.fill(self._before, self._start)
        for point, weight in zip(_POINTS, _WEIGHTS, strict=True):
            self._place.value, self._weight.value = 0.5 * (1.0 + point), 0.5 * weight
            yield
