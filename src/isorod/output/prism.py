"""Saint-Venant's solutions of a prism: 6 x 6 stiffness and mass per length of a section, of any layers and laws.

Displacements of a long prism that carries an axial force, shear forces and moments at its ends alone are polynomials of
the coordinate along it; those of its sections are a rigid motion and a warping ``g``, in all three directions and so
with what Poisson's ratio does, that is linear along the prism where there is shear.  With section functions in the
place of finite elements this is the theory of V. Giavotto, M. Borri, P. Mantegazza, G. Ghiringhelli, V. Carmaschi, G.
C. Maffioli & F. Mussi, Anisotropic beam theory and applications, Computers & Structures 16 (1983) 403-413.  With the
energy per length

    1/2 (g' M g' + 2 g C g' + g E g),    g' = g_1 + Z e,

``Z`` the six rigid motions of the section and ``e`` the strains and curvatures of the axis, ``theta`` the six forces
and moments and ``theta' = T theta`` their balance, the solutions are

    E g_1 + R e_1 = 0,                        R^T g_1 + A e_1 = theta',
    E g_0 + R e_0 = (C^T - C) g_1 + L e_1,    R^T g_0 + A e_0 = theta - L^T g_1,

with ``R = C Z, L = M Z, A = Z^T M Z``.  What the energy of ``g_0``, ``g_1`` and ``e_0`` is in ``theta`` is the
compliance: it does not depend on which part of ``g`` is called rigid.
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

# How moments grow along a prism with its forces, both in the order of `Prism.stiffness`: M' = -n x F.
_GROWTH = np.zeros((6, 6))
_GROWTH[4, 2], _GROWTH[5, 1] = 1.0, -1.0

# Degree of the polynomials that the quadrature sees products of.
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
        """A piece of the prism, for section functions that ask for a rod."""
        axis = Axis(1, np.array([0.0, 0.0, 1.0, 1.0]), np.ones(2))
        ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, self._size]])
        return Rod.sweep(self.outline, axis, ends).with_rings(self.rings)

    def stiffness(self, basis: Functions) -> Array:
        """Return the stiffness ``(6, 6)`` that section functions give, about the origin of the section's coordinates.

        Forces are in the order axial force, shear along ``y``, shear along ``z``, torsion, bending moment about ``y``,
        about ``z``; they belong to the axis's stretch, its two shears, its twist per length and its two curvatures.
        """
        # In units of the section's size and its largest modulus.
        size, unit = self._size, float(np.abs(self.moduli).max())
        M, C, E = self._matrices(basis, unit)
        count = len(E)
        Z = self._rigid(basis)
        R, L = C @ Z, M @ Z
        # The motions in the place of E's null space, and of what rigid warping and the axis's strains have in common.
        system = np.zeros((count + 12, count + 12))
        system[:count, :count] = E
        system[:count, count : count + 6], system[count : count + 6, :count] = R, R.T
        system[count : count + 6, count : count + 6] = Z.T @ L
        system[:count, count + 6 :], system[count + 6 :, :count] = Z, Z.T
        factors = lu_factor(system, overwrite_a=True)

        def solved(warping: Array, forces: Array) -> tuple[Array, Array]:
            found = lu_solve(factors, np.concatenate([warping, forces, np.zeros((6, 6))]))
            return found[:count], found[count : count + 6]

        later, rise = solved(np.zeros((count, 6)), _GROWTH)
        warping, strains = solved((C.T - C) @ later + L @ rise, np.eye(6) - L.T @ later)
        along = later + Z @ strains
        crossed = warping.T @ C @ along
        compliance = warping.T @ E @ warping + crossed + crossed.T + along.T @ M @ along
        units = np.array([1.0, 1.0, 1.0, size, size, size])
        return np.asarray(np.linalg.inv(compliance) * np.outer(units, units) * unit * size**2)

    def mass(self) -> Array:
        """Return the mass per length ``(6, 6)`` about the origin, rows and columns in the order of `stiffness`."""
        points = self._fine
        weights = points.share * self.densities[points.ring]
        motions = _motions(np.ones(len(weights)), *points.place.T).reshape(3, -1, 6)
        return np.asarray(np.einsum("q,aqi,aqj->ij", weights, motions, motions, optimize=True))

    def moments(self) -> tuple[float, Array]:
        """Return the section's area, and its first moments ``(2,)`` about the origin."""
        return float(self._fine.share.sum()), np.asarray(self._fine.share @ self._fine.place)

    @cached_property
    def _size(self) -> float:
        """A length of the section's size."""
        return float(np.sqrt(np.mean((self.outline - self.outline.mean(axis=0)) ** 2)))

    @cached_property
    def _fine(self) -> "_Points":
        """Points for polynomials across the section."""
        return self._points(fine_rule(len(self.outline), _DEGREE))

    def _points(self, rule: Rule) -> "_Points":
        """Return points of a rule, of more where moduli are one of the factors."""
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
        # Of lengths over the size.
        slopes = self._size * np.einsum("qlb,qba->qla", gradients, points.inverse)
        size = 3 * basis.count
        M, C, E = np.zeros((3, size, size))
        if self.field is not None:
            moduli = self.field(points.xi) / unit * (points.share / self._size**2)[:, None, None, None, None]
            # Strided, products would not be BLAS's.
            tables = values, *(np.ascontiguousarray(slopes[..., k]) for k in range(2))
            sums = np.zeros((3, 3, 3, basis.count, 3, basis.count))
            for a, i, b, j in product(range(3), repeat=4):
                # The last direction of ``moduli`` counts for ``b``, which is the transpose where it is less.
                if a <= b:
                    sums[a, b, i, :, j] = tables[a].T @ (moduli[:, i, a, j, b, None] * tables[b])
            M += sums[0, 0].reshape(M.shape)
            # Its rows are what varies in the section.
            C += (sums[0, 1] + sums[0, 2]).reshape(M.shape).T
            E += (sums[1, 1] + sums[2, 2]).reshape(M.shape)
            E += sums[1, 2].reshape(M.shape) + sums[1, 2].reshape(M.shape).T
            return M, C, E
        for r, moduli in enumerate(self.moduli / unit):
            own = points.ring == r
            root = np.sqrt(points.share[own])[:, None] / self._size
            table = np.concatenate([root * values[own], root * slopes[own, :, 0], root * slopes[own, :, 1]], axis=1)
            products = (table.T @ table).reshape(3, basis.count, 3, basis.count)
            # The first derivative is that along the prism.
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
    """Points of the disk ``(q, 2)``, ``dxi/d(y, z)`` ``(q, 2, 2)``, ``(y, z)``, shares of the area, rings ``(q,)``."""

    xi: Array
    inverse: Array
    place: Array
    share: Array
    ring: Index


def _motions(one: Array, y: Array, z: Array) -> Array:
    """Return displacements ``(3 m, 6)`` of rigid motions: along normal, ``y``, ``z``, turns about these."""
    found = np.zeros((3, len(one), 6))
    for a in range(3):
        found[a, :, a] = one
    found[1, :, 3], found[2, :, 3] = -z, y
    found[0, :, 4], found[0, :, 5] = z, -y
    return found.reshape(-1, 6)
