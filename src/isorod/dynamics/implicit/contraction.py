"""The sums over points of an implicit step, section by section: few functions at a time."""

import numpy as np

from isorod.arrays import Array
from isorod.assembly.gradients import pulled_stress
from isorod.dynamics.implicit.contract_kernel import pull_back
from isorod.space.space import Table

# Numbers in the products of section functions that are there at a time.
_MOST = 4_000_000


class Contraction:
    """Forces of a body's elements from stresses, and element matrices from moduli.

    All are sums of products of functions across the section and along the axis.  At each place along the axis it is
    summed up over one of both at a time; so are the tangents of statics (`isorod.assembly.stiffness_kernel`).
    """

    def __init__(self, table: Table) -> None:
        x, y = table.axial, table.slopes
        elements, along, points = table.weights.shape
        self._shape = (elements, along, points, x.shape[2], table.section.shape[2])
        self._table = table
        self._rooted = np.sqrt(table.weights).reshape(-1, 1) * table.inverse.reshape(-1, 9)
        # Derivatives across, one direction behind the other, and values: ``(2 q, n)`` and ``(q, n)``.
        self._across = np.concatenate([table.section[:, 0], table.section[:, 1]])
        self._section = np.ascontiguousarray(table.section[:, 2])
        # Of each element, pairs of functions by places along it; one array for each of the four pairs of derivatives.
        pairs = [(x, x), (x, y), (y, x), (y, y)]
        self._axial = [np.einsum("etj,etm->ejmt", one, two).reshape(elements, -1, along) for one, two in pairs]

    def forces(self, stress: Array) -> Array:
        """Return the forces of stresses ``(E, t, q, 3, 3)`` on coefficients, shape ``(E, l n, 3)``."""
        elements, along, _, functions, n = self._shape
        across, axial = pulled_stress(self._table, stress)
        plane, other = across @ self._across, axial @ self._section
        sums = np.swapaxes(self._table.axial, 1, 2) @ plane.reshape(elements, along, -1)
        sums += np.swapaxes(self._table.slopes, 1, 2) @ other.reshape(elements, along, -1)
        return sums.reshape(elements, functions, 3, n).swapaxes(2, 3).reshape(elements, -1, 3)

    def matrices(self, moduli: Array) -> Array:
        """Return the element matrices, which need not be symmetric, shape ``(E, l n, 3, l n, 3)``.

        Parameters
        ----------
        moduli
            Derivatives of the stress, shape ``(E, t, q, 3, 3, 3, 3)``.
        """
        elements, along, points, functions, n = self._shape
        places = elements * along
        pulled = [np.empty((places, 9, pairs, points)) for pairs in (4, 2, 2, 1)]
        # The memory's order is NumPy's choice, and another one in its later versions.
        pull_back(self._rooted, np.ascontiguousarray(moduli).reshape(-1, 3, 3, 3, 3), *pulled)
        result = np.zeros((elements, functions * functions, 9 * n * n))
        plane, axis = self._across.reshape(2, points, n), self._section[None]
        step = max(1, _MOST // (4 * n * n))
        for axial, values, left, right in zip(
            self._axial, pulled, (plane, plane, axis, axis), (plane, axis, plane, axis), strict=True
        ):
            sums = np.zeros((places * 9, n * n))
            for q in range(0, points, step):
                some = slice(q, q + step)
                products = np.einsum("dqi,eqk->deqik", left[:, some], right[:, some]).reshape(-1, n * n)
                sums += values[..., some].reshape(places * 9, -1) @ products
            result += axial @ sums.reshape(elements, along, -1)
        whole = result.reshape(elements, functions, functions, 3, 3, n, n).transpose(0, 1, 5, 3, 2, 6, 4)
        return np.ascontiguousarray(whole).reshape(elements, functions * n, 3, functions * n, 3)
