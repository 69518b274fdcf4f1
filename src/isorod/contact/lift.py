"""Contact of rods whose control points are not evenly spaced: it is that of a finer surface, which is the same.

The loops of contact know surfaces with control points evenly spaced round the section.  Where a rod has others
(`isorod.space.graded`), they see it through those of all fine arcs, which are linear in its own.
"""

from dataclasses import replace

import numpy as np
from scipy.sparse import block_diag, csr_matrix, identity, kron

from isorod.arrays import Array, Index
from isorod.contact import quality
from isorod.contact.result import ContactResult
from isorod.model.body import Body
from isorod.model.model import Model
from isorod.space.graded import Graded
from isorod.space.space import Space


class Lift:
    """From the degrees of freedom of a model to those of its surfaces, and back.

    Parameters
    ----------
    model
        A body of which, or several, have graded section functions.

    Attributes
    ----------
    model
        The same bodies, on spaces of evenly spaced control points, and contacts.
    graded
        Bodies with such functions.
    rows, columns
        Of the entries of the last matrix (`matrix`).
    """

    def __init__(self, model: Model) -> None:
        self.model = Model([_surface(body) for body in model.bodies], contacts=model.contacts)
        nodes = block_diag([_nodes(body.space) for body in model.bodies])
        self._forth = csr_matrix(kron(nodes, identity(3)))
        self._back = csr_matrix(self._forth.T)
        self._version = 0
        self._bases = [body.space.basis for body in model.bodies]
        self.graded = {k for k, basis in enumerate(self._bases) if isinstance(basis, Graded)}
        self.rows = self.columns = np.empty(0, dtype=np.int64)

    def displacement(self, own: Array) -> Array:
        """Return the displacement of the surfaces' nodes."""
        return np.asarray(self._forth @ own)

    def forces(self, surface: Array) -> Array:
        """Return forces on the model's degrees of freedom that do the work of those on the surfaces'."""
        return np.asarray(self._back @ surface)

    def values(self, rows: Index, columns: Index, values: Array, version: int) -> Array:
        """Return the entries, at ``rows`` and ``columns`` of this, of a matrix given by entries on the surfaces.

        ``version`` counts the patterns of these.
        """
        size = self._forth.shape[0]
        if version != self._version:
            # Of positive numbers none is lost.
            there = csr_matrix((np.ones(rows.size), (rows, columns)), (size, size))
            found = csr_matrix(abs(self._back) @ there @ abs(self._forth))
            found.sort_indices()
            pattern = found.tocoo()
            self.rows, self.columns = pattern.row.astype(np.int64), pattern.col.astype(np.int64)
            self._version = version
        count = self._forth.shape[1]
        own = (self._back @ csr_matrix((values, (rows, columns)), (size, size)) @ self._forth).tocoo()
        entries = np.zeros(self.rows.size)
        keys = self.rows * count + self.columns
        entries[np.searchsorted(keys, own.row.astype(np.int64) * count + own.col)] = own.data
        return entries

    def seen(self, result: ContactResult) -> ContactResult:
        """Return a result, told of fine arcs, by the arcs that are where its pressure is largest."""
        k = int(np.argmax(result.pressure))
        basis = self._bases[result.body[k]]
        if not (result.cells_across and isinstance(basis, Graded)):
            return result
        place = (result.parameters[k, 1] - basis.joints[0]) % (2.0 * np.pi) + basis.joints[0]
        arc = min(int(np.searchsorted(basis.joints, place, side="right")) - 1, len(basis.arcs) - 1)
        cells = result.cells_across / basis.arcs[arc]
        error = max(result.peak_error or 0.0, min(1.0, quality.PEAK / cells))
        return replace(result, cells_across=cells, peak_error=error)


def _surface(body: Body) -> Body:
    """Return a body whose control points are evenly spaced: of the same surface, not of the same inside."""
    space = body.space
    if not isinstance(space.section_basis, Graded):
        return body
    even = replace(space, section_basis=None, section_points=space.points_around, order=1, quadrature="paper")
    return Body(even, body.laws)


def _nodes(space: Space) -> csr_matrix:
    """Return the matrix from the nodes of a space to those of `_surface`."""
    basis = space.section_basis
    if not isinstance(basis, Graded):
        return csr_matrix(identity(space.nodes))
    section = np.zeros((basis.fine, basis.count))
    section[:, : len(basis.arcs)] = basis.among_fine
    return csr_matrix(kron(identity(space.layers), csr_matrix(section)))
