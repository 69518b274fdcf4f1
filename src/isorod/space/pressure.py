"""The space of pressures beside a displacement space: about one degree less, across the section and along the axis."""

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array, Index
from isorod.geometry import bspline
from isorod.space.basis import monomials
from isorod.space.space import Space, Table


class Pressures:
    """Pressures ``sum_jk P_k(xi) B_j(u) p_jk`` beside the displacements of a space.

    ``P_k`` are polynomials of the section: of the disk's coordinates and of degree ``K`` (at most ``(n - 1) / 2``)
    where the displacement has order ``K``; of the section's own coordinates where it has polynomials, those whose
    products with a coordinate are among them (degree ``N - 1``). ``B_j`` are the splines of degree ``p - 1`` on the
    same knots, C^(c - 1) where the displacement is C^c.  Coefficients are numbered layer by layer like nodes; the last
    layer of an open rod has none.  The pair is inf-sup stable: measured in ``tests/test_mixed.py``.

    Raises
    ------
    InputError
        If the displacements across the section are polynomials of degree 1, or those of three control points: they
        carry no pressure that varies.
    """

    def __init__(self, space: Space) -> None:
        self.space = space
        self._knots = space.axis.knots[1:-1]
        self._powers = monomials(*space.basis.pressure_degrees)

    @property
    def count(self) -> int:
        """Number of section functions."""
        return self._powers.shape[0]

    @property
    def layers(self) -> int:
        """Number of layers that have pressures."""
        return self.space.axis.count - 1

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.layers * self.count

    @property
    def degree(self) -> int:
        """Degree along the axis."""
        return self.space.axis.degree - 1

    def section_functions(self, xi: ArrayLike) -> Array:
        """Return values ``(q, count)`` at disk points ``(q, 2)``: products of Legendre polynomials."""
        place = self.space.basis.coordinates(xi)
        tables = [np.polynomial.legendre.legvander(place[:, k], int(self._powers.max())) for k in range(2)]
        return np.ascontiguousarray(tables[0][:, self._powers[:, 0]] * tables[1][:, self._powers[:, 1]])

    def axial_functions(self, u: Array) -> tuple[Index, Array]:
        """Return the first layer ``(t,)`` and the values ``(t, p)`` of the functions at axis parameters ``(t,)``."""
        first, values, _ = bspline.table(self._knots, self.degree, u)
        return first.copy(), values.copy()

    def tabulate(self, table: Table) -> tuple[Array, Array]:
        """Return section values ``(q, count)`` and axial values ``(E, t, p)`` at the points of a table of the space."""
        axial = self.axial_functions(table.u.ravel())[1]
        return self.section_functions(table.xi), axial.reshape(*table.u.shape, -1)

    def evaluate(self, coefficients: ArrayLike, xi: ArrayLike, u: ArrayLike) -> Array:
        """Return pressures ``(t, q)`` on a grid of disk points ``(q, 2)`` and axis parameters ``(t,)``.

        Parameters
        ----------
        coefficients
            Shape ``(layers, count)``, force per area.
        """
        first, axial = self.axial_functions(np.asarray(u, dtype=float))
        near = np.asarray(coefficients, dtype=float)[first[:, None] + np.arange(axial.shape[1])]
        return np.einsum("tj,tjk->tk", axial, near) @ self.section_functions(xi).T
