"""A finite element body during an implicit step, in which it goes from one state to another.

With an energy its forces are those of the mean value discrete gradient, as of rods
(`isorod.material.discrete_gradient_kernel`), by four Gauss points on the way from one state to the other: they do its
work but for the ninth power of the change of strain.  With a law of small strains, or with a form, they are those in
the middle of the step.  Loads are as in the middle.
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
    """What a step asks of a body, as functions of the change of its displacement on this rank, ``(3 nodes,)``.

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
        self._place, self._share = dolfinx.fem.Constant(mesh, 0.5), dolfinx.fem.Constant(mesh, 1.0)
        work = self._share * forms.between(
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
        """Return inertial and internal forces and loads, the second NaN where a nonlinear law meets ``det F <= 0``.

        Parameters
        ----------
        change
            Of the displacement.
        factor
            That activation follows; loads have their full value.
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
        """Go to each of the places between both states."""
        self._solid.set(self._start + change, factor)
        compat.fill(self._before, self._start)
        for point, weight in zip(_POINTS, _WEIGHTS, strict=True):
            self._place.value, self._share.value = 0.5 * (1.0 + point), 0.5 * weight
            yield
