"""Saint-Venant's solutions of a prism: 6 x 6 stiffness and mass per length of a section, of any layers and laws.

Displacements of a long prism with axial force, shear forces and moments at its ends alone are polynomials of the
coordinate along it.  Those of a section are a rigid motion and a warping ``g`` in all three directions, which includes
lateral contraction and is linear along the prism where there is shear.  With section functions instead of finite
elements this is the theory of V. Giavotto, M. Borri, P. Mantegazza, G. Ghiringhelli, V. Carmaschi, G.
C. Maffioli & F. Mussi, Anisotropic beam theory and applications, Computers & Structures 16 (1983) 403-413.  With the
energy per length

    1/2 (g' M g' + 2 g C g' + g E g),    g' = g_1 + Z e,

``Z`` the six rigid motions of the section, ``e`` the strains and curvatures of the axis, ``theta`` the six forces and
moments and ``theta' = T theta`` their equilibrium, the solutions are

    E g_1 + R e_1 = 0,                        R^T g_1 + A e_1 = theta',
    E g_0 + R e_0 = (C^T - C) g_1 + L e_1,    R^T g_0 + A e_0 = theta - L^T g_1,

with ``R = C Z, L = M Z, A = Z^T M Z``.  The energy of ``g_0``, ``g_1`` and ``e_0`` as a quadratic form of ``theta`` is
the compliance; it does not depend on which part of ``g`` is taken as rigid.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from isorod.arrays import Array, Index
from isorod.errors import FoldedRodError
from isorod.geometry.axis import Axis
from isorod.geometry.disk import harmonic_functions
from isorod.geometry.quadrature import Rule, ring_of, section_points
from isorod.geometry.rod import Rod
from isorod.space.basis import Functions
from isorod.space.polynomial import fine_rule
from isorod.space.waves import Waves

# Growth of moments along a prism with its forces, in the order of `Prism.stiffness`: M' = -n x F.
_GROWTH = np.zeros((6, 6))
_GROWTH[4, 2], _GROWTH[5, 1] = 1.0, -1.0

# Degree of polynomials whose products are integrated.
_DEGREE = 8


@dataclass(frozen=True, eq=False)
class Prism:
    """A prism along the normal of its section, whose coordinates ``(y, z)`` are those of its control points.

    Parameters
    ----------
    outline
        Control points of the section, shape ``(n, 2)``, units of length.
    rings
        Radii of its rings on the disk (`isorod.geometry.rod.Rod.rings`).
    moduli
        Tangent of each ring's law at rest, ``dP_aA/dF_bB`` in the order normal, ``y``, ``z``, force / area, shape
        ``(rings, 3, 3, 3, 3)``.
    densities
        Mass per volume of each ring, shape ``(rings,)``.
    field
        Where moduli vary within rings: those at disk points ``(q, 2)``, shape ``(q, 3, 3, 3, 3)``.
    """

    outline: Array
    rings: tuple[float, ...]
    moduli: Array
    densities: Array
    field: Callable[[Array], Array] | None = None

    @cached_property
    def rod(self) -> Rod:
        """A segment of the prism, for section functions that need a rod."""
        axis = Axis(1, np.array([0.0, 0.0, 1.0, 1.0]), np.ones(2))
        ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, self._size]])
        return Rod.sweep(self.outline, axis, ends).with_rings(self.rings)

    def stiffness(self, basis: Functions) -> Array:
        """Return the stiffness ``(6, 6)`` by section functions, about the origin of the section's coordinates.

        Forces are in the order axial force, shear along ``y``, shear along ``z``, torsion, bending moment about ``y``,
        about ``z``; conjugate to them are stretch, the two shears, twist per length and the two curvatures of the axis.
        """
        # In units of the section's size and its largest modulus.
        size, unit = self._size, float(np.abs(self.moduli).max())
        M, C, E = self._matrices(basis, unit)
        count = len(E)
        Z = self._rigid(basis)
        R, L = C @ Z, M @ Z
        # Rigid motions remove the null space of E, and the redundancy of rigid warping and strains of the axis.
        system = np.zeros((count + 12, count + 12))
        system[:count, :count] = E
        system[:count, count : count + 6], system[count : count + 6, :count] = R, R.T
        system[count : count + 6, count : count + 6] = Z.T @ L
        system[:count, count + 6 :], system[count + 6 :, :count] = Z, Z.T
        factors = lu_factor(system, overwrite_a=True)

        def solved(warping: Array, forces: Array) -> tuple[Array, Array]:
            solution = lu_solve(factors, np.concatenate([warping, forces, np.zeros((6, 6))]))
            return solution[:count], solution[count : count + 6]

        linear, linear_strains = solved(np.zeros((count, 6)), _GROWTH)
        warping, strains = solved((C.T - C) @ linear + L @ linear_strains, np.eye(6) - L.T @ linear)
        gradient = linear + Z @ strains
        mixed = warping.T @ C @ gradient
        compliance = warping.T @ E @ warping + mixed + mixed.T + gradient.T @ M @ gradient
        units = np.array([1.0, 1.0, 1.0, size, size, size])
        return np.asarray(np.linalg.inv(compliance) * np.outer(units, units) * unit * size**2)

    def mass(self) -> Array:
        """Return the mass per length ``(6, 6)`` about the origin, rows and columns in the order of `stiffness`."""
        points = self._fine
        weights = points.weight * self.densities[points.ring]
        motions = _motions(np.ones(len(weights)), *points.place.T).reshape(3, -1, 6)
        return np.asarray(np.einsum("q,aqi,aqj->ij", weights, motions, motions, optimize=True))

    def moments(self) -> tuple[float, Array]:
        """Return the section's area, and its first moments ``(2,)`` about the origin."""
        return float(self._fine.weight.sum()), np.asarray(self._fine.weight @ self._fine.place)

    @cached_property
    def _size(self) -> float:
        """A length of the section's size."""
        return float(np.sqrt(np.mean((self.outline - self.outline.mean(axis=0)) ** 2)))

    @cached_property
    def _fine(self) -> "_Points":
        """Quadrature points for polynomials across the section."""
        return self._points(fine_rule(len(self.outline), _DEGREE))

    def _points(self, rule: Rule) -> "_Points":
        """Return the points of a rule, or of a finer one where moduli vary."""
        if self.field is not None:
            rule = Rule(rule.radial + 4, 2 * rule.angular, rule.axial)
        xi, area = section_points(len(self.outline), rule, rings=self.rings)
        values, gradients = harmonic_functions(len(self.outline), xi)
        jacobian = np.einsum("qib,ia->qab", gradients, self.outline)
        det = np.linalg.det(jacobian)
        if not det.min() > 0.0:
            where = xi[np.argmin(det)]
            raise FoldedRodError(f"the section folds at disk point ({where[0]:.3f}, {where[1]:.3f}); see Rod.check()")
        return _Points(xi, np.linalg.inv(jacobian), values @ self.outline, area * det, ring_of(self.rings, xi))

    def _matrices(self, basis: Functions, unit: float) -> tuple[Array, Array, Array]:
        """Return ``M``, ``C`` and ``E``, shape ``(3 count, 3 count)``, functions running fastest."""
        points = self._points(basis.rule) if isinstance(basis, Waves) else self._fine
        values, gradients = basis.functions(points.xi)
        # Relative to the section's size.
        slopes = self._size * np.einsum("qlb,qba->qla", gradients, points.inverse)
        size = 3 * basis.count
        M, C, E = np.zeros((3, size, size))
        if self.field is not None:
            moduli = self.field(points.xi) / unit * (points.weight / self._size**2)[:, None, None, None, None]
            # Contiguous, for BLAS.
            tables = values, *(np.ascontiguousarray(slopes[..., k]) for k in range(2))
            sums = np.zeros((3, 3, 3, basis.count, 3, basis.count))
            for a, i, b, j in product(range(3), repeat=4):
                # The sums for a > b are transposes.
                if a <= b:
                    sums[a, b, i, :, j] = tables[a].T @ (moduli[:, i, a, j, b, None] * tables[b])
            M += sums[0, 0].reshape(M.shape)
            # Rows of C are derivatives in the section.
            C += (sums[0, 1] + sums[0, 2]).reshape(M.shape).T
            E += (sums[1, 1] + sums[2, 2]).reshape(M.shape)
            E += sums[1, 2].reshape(M.shape) + sums[1, 2].reshape(M.shape).T
            return M, C, E
        for r, moduli in enumerate(self.moduli / unit):
            on = points.ring == r
            root = np.sqrt(points.weight[on])[:, None] / self._size
            table = np.concatenate([root * values[on], root * slopes[on, :, 0], root * slopes[on, :, 1]], axis=1)
            products = (table.T @ table).reshape(3, basis.count, 3, basis.count)
            # The first direction is along the prism.
            M += np.einsum("ij,lm->iljm", moduli[:, 0, :, 0], products[0, :, 0]).reshape(M.shape)
            C += np.einsum("iaj,alm->iljm", moduli[:, 1:, :, 0], products[1:, :, 0]).reshape(M.shape)
            E += np.einsum("iajb,albm->iljm", moduli[:, 1:, :, 1:], products[1:, :, 1:], optimize=True).reshape(M.shape)
        return M, C, E

    def _rigid(self, basis: Functions) -> Array:
        """Return the coefficients ``(3 count, 6)`` of the section's rigid motions, in units of its size."""
        polygon = np.concatenate([np.zeros((len(self.outline), 1)), self.outline / self._size], axis=1)
        _, y, z = basis.positions(polygon[None])[0].T
        return _motions(basis.is_control_point.astype(float), y, z)


class _Points(NamedTuple):
    """Points of the disk ``(q, 2)``, ``dxi/d(y, z)`` ``(q, 2, 2)``, ``(y, z)``, area weights, and rings ``(q,)``."""

    xi: Array
    inverse: Array
    place: Array
    weight: Array
    ring: Index


def _motions(ones: Array, y: Array, z: Array) -> Array:
    """Return displacements ``(3 m, 6)`` of rigid motions: along normal, ``y``, ``z``, rotations about these."""
    motions = np.zeros((3, len(ones), 6))
    for a in range(3):
        motions[a, :, a] = ones
    motions[1, :, 3], motions[2, :, 3] = -z, y
    motions[0, :, 4], motions[0, :, 5] = z, -y
    return motions.reshape(-1, 6)
