"""The space of pressures for a displacement space: of one degree or order less, across and along the axis."""

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array, Index
from isorod.geometry import bspline
from isorod.space.space import Space, Table


class Pressures:
    """Pressures ``sum_jk P_k(xi) B_j(u) p_jk`` beside the displacements of a space.

    ``P_k`` are functions of the section.  Where the displacement has order ``K`` they are polyharmonic of order
    ``K - 1`` (in equilibrium, where displacements are biharmonic, pressures are harmonic), so that they
    resolve local effects such as contact, and polynomials of degree ``K``; they have fewer waves than displacements
    (`isorod.space.polyharmonic.Polyharmonic.pressures`).  Where it has polynomials they are those of the section's own
    coordinates whose products with a coordinate are among them (degree ``N - 1``); for a section with a hole or in
    layers those of each ring by itself (`isorod.space.ringed.Ringed.pressures`), so that they jump where laws do.
    ``B_j`` are the splines of degree ``p - 1`` on the same knots, C^(c - 1) where the displacement is C^c.
    Coefficients are numbered layer by layer like nodes; the last layer of an open rod has none.  The pair is inf-sup
    stable: measured in ``tests/test_mixed.py`` and ``test_rings_mixed.py``.

    Attributes
    ----------
    count
        Number of section functions.

    Raises
    ------
    InputError
        If the displacements across the section are polynomials of degree 1, or those of three control points: they
        allow no varying pressure.
    """

    def __init__(self, space: Space) -> None:
        self.space = space
        self._knots = space.axis.knots[1:-1]
        self.count = space.basis.pressure_count

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
        """Return values ``(q, count)`` at disk points ``(q, 2)``."""
        return self.space.basis.pressures(xi)

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
