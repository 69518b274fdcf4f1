"""The sums over points of an implicit step, section by section: few functions at a time."""

import numpy as np

from isorod.arrays import Array
from isorod.dynamics.implicit.contract_kernel import pull_back, pull_stress, push_forward
from isorod.space.space import Table

# Numbers in the products of section functions that are there at a time.
_MOST = 4_000_000


class Contraction:
    """Gradients at the points of a body's elements, forces from stresses, and element matrices from moduli.

    All are sums of products of functions across the section and along the axis.  At each place along the axis it is
    summed up over one of both at a time; so are the tangents of statics (`isorod.assembly.stiffness_kernel`).
    """

    def __init__(self, table: Table) -> None:
        x, y = table.axial, table.slopes
        elements, along, points = table.weights.shape
        self._shape = (elements, along, points, x.shape[2], table.section.shape[2])
        self._weights = np.ascontiguousarray(table.weights).reshape(-1, points)
        self._inverse = np.ascontiguousarray(table.inverse).reshape(-1, 9)
        self._rooted = np.sqrt(self._weights).reshape(-1, 1) * self._inverse
        self._values, self._slopes = x, y
        # Derivatives across, one direction behind the other, and values: ``(2 q, n)`` and ``(q, n)``.
        self._across = np.concatenate([table.section[:, 0], table.section[:, 1]])
        self._section = np.ascontiguousarray(table.section[:, 2])
        # Of each element, pairs of functions by places along it; one array for each of the four pairs of derivatives.
        pairs = [(x, x), (x, y), (y, x), (y, y)]
        self._axial = [np.einsum("etj,etm->ejmt", one, two).reshape(elements, -1, along) for one, two in pairs]

    def gradients(self, nodal: Array) -> Array:
        """Return gradients in space, shape ``(E, t, q, 3, 3)``, from coefficients ``(E, l n, 3)``."""
        elements, along, points, functions, n = self._shape
        values = np.ascontiguousarray(nodal.reshape(elements, functions, n, 3).swapaxes(2, 3))
        values = values.reshape(elements, functions, -1)
        across = (self._values @ values).reshape(-1, n) @ self._across.T
        slopes = (self._slopes @ values).reshape(-1, n) @ self._section.T
        places = elements * along
        out = np.empty((places * points, 3, 3))
        push_forward(self._inverse, across.reshape(places, 3, -1), slopes.reshape(places, 3, -1), out)
        return out.reshape(elements, along, points, 3, 3)

    def forces(self, stress: Array) -> Array:
        """Return the forces of stresses ``(E, t, q, 3, 3)`` on coefficients, shape ``(E, l n, 3)``."""
        elements, along, points, functions, n = self._shape
        places = elements * along
        across, axial = np.empty((places, 3, 2 * points)), np.empty((places, 3, points))
        given = np.ascontiguousarray(stress).reshape(-1, 3, 3)
        pull_stress(self._weights, self._inverse, given, across, axial)
        plane = (across.reshape(3 * places, -1) @ self._across).reshape(elements, along, -1)
        other = (axial.reshape(3 * places, -1) @ self._section).reshape(elements, along, -1)
        sums = np.swapaxes(self._values, 1, 2) @ plane + np.swapaxes(self._slopes, 1, 2) @ other
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
