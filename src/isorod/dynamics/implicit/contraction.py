"""The sums over points of an implicit step, section by section, a few functions at a time."""

import numpy as np

from isorod.arrays import Array
from isorod.dynamics.implicit.contract_kernel import pull_back
from isorod.space.space import Table

# Maximum size of the products of section functions at a time.
_MOST = 4_000_000


def element_matrices(table: Table, moduli: Array) -> Array:
    """Return the element matrices of moduli, which need not be symmetric, shape ``(E, l n, 3, l n, 3)``.

    They are sums of products of functions across the section and along the axis: first over the section at each place
    along the axis, then along it, as tangents of statics (`isorod.assembly.stiffness_kernel`).

    Parameters
    ----------
    moduli
        Derivatives of the stress, shape ``(E, t, q, 3, 3, 3, 3)``.
    """
    x, y = table.axial, table.slopes
    elements, along, points = table.weights.shape
    places, functions, n = elements * along, x.shape[2], table.section.shape[2]
    rooted = np.sqrt(table.weights).reshape(-1, 1) * table.inverse.reshape(-1, 9)
    pulled = [np.empty((places, 9, pairs, points)) for pairs in (4, 2, 2, 1)]
    # The memory order depends on NumPy's version.
    pull_back(rooted, np.ascontiguousarray(moduli).reshape(-1, 3, 3, 3, 3), *pulled)
    result = np.zeros((elements, functions * functions, 9 * n * n))
    plane, axis = table.section[:, :2].swapaxes(0, 1), table.section[None, :, 2]
    step = max(1, _MOST // (4 * n * n))
    for one, two, values, left, right in zip(
        (x, x, y, y), (x, y, x, y), pulled, (plane, plane, axis, axis), (plane, axis, plane, axis), strict=True
    ):
        sums = np.zeros((places * 9, n * n))
        for q in range(0, points, step):
            some = slice(q, q + step)
            products = np.einsum("dqi,eqk->deqik", left[:, some], right[:, some]).reshape(-1, n * n)
            sums += values[..., some].reshape(places * 9, -1) @ products
        pairs = np.einsum("etj,etm->ejmt", one, two).reshape(elements, -1, along)
        result += pairs @ sums.reshape(elements, along, -1)
    matrices = result.reshape(elements, functions, functions, 3, 3, n, n).transpose(0, 1, 5, 3, 2, 6, 4)
    return np.ascontiguousarray(matrices).reshape(elements, functions * n, 3, functions * n, 3)
