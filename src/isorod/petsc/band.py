"""Factors ``A = L J L^T`` of a banded symmetric matrix, or of its first unknowns and a Schur complement of the others.

Of a positive definite panel the factor is Cholesky's and ``J`` is 1.  A negative pivot is a panel by itself with
``J = -1`` if few digits are lost by that; otherwise the eigenvectors of the remaining panel's diagonal block make that
block of ``L``, and ``J`` has the signs of its eigenvalues.  By Sylvester's law the signs of ``J`` count the negative
eigenvalues.  Rows are not exchanged between panels, so entries may grow; if they grow much, the factors are refused.
"""

import numpy as np
from numpy.lib.stride_tricks import as_strided
from scipy.linalg import blas

from isorod.arrays import Array, Index
from isorod.petsc import band_kernel as kernel
from isorod.petsc.band_kernel import Elimination, Ordered

# Factors are refused where panels that are not positive definite add more than this many times the largest entry to
# the diagonal: the digits lost.
_GROWTH = 1e3

# Columns of the band without keeping, in multiples of those that are needed at a time.
_CHUNK = 8


class Factors:
    """Factors of a matrix, and the Schur complement of unknowns that were not eliminated.

    Attributes
    ----------
    negative
        Number of negative eigenvalues of the eliminated block.
    border, corner
        Schur complement of the border: its coupling to the remaining unknowns, shape ``(after, s)``, and its own block.
    schur
        Schur complement of the remaining unknowns.
    """

    def __init__(self) -> None:
        self._band = np.empty((0, 1))
        self._cut: Index = np.empty(0, dtype=np.int64)
        self._end: Index = self._cut
        self.negative = 0
        self.border = self.corner = self.schur = np.empty((0, 0))

    def factorise(self, matrix: Ordered, eliminated: int, keep: bool = True, fill: float = np.inf) -> bool:
        """Eliminate the first unknowns; return whether that succeeded.

        Without ``keep`` only inertia and Schur complement remain, no factors.  A matrix whose factors would have more
        than ``fill`` times its entries is refused.
        """
        work = self._prepare(matrix, eliminated, keep, fill)
        if work is None:
            return False
        now, odd = work.progress[0], list[tuple[int, Array, Array]]()
        self.negative = 0
        self.border = self.corner = self.schur = np.empty((0, 0))
        while (k := kernel.eliminate(matrix, work)) < now["panels"]:
            factor = self._odd_panel(k, work)
            if factor is None:
                return False
            odd.append((k, *factor))
            self.negative += int(np.count_nonzero(factor[1] < 0.0))
            now["panel"] = k + 1
        self._cut, self._end = work.cut[: now["panels"] + 1], work.end[: now["panels"]]
        self.negative += int(now["negative"])
        self._odd = np.array([k for k, _, _ in odd], dtype=np.int64)
        most = max((sign.size for _, _, sign in odd), default=0)
        self._inverse = np.zeros((len(odd), most, most))
        self._sign = np.ones((len(odd), most))
        for one, (_, inverse, sign) in enumerate(odd):
            self._inverse[one, : sign.size, : sign.size] = inverse
            self._sign[one, : sign.size] = sign
        rest = matrix.own + matrix.after - eliminated
        if rest + matrix.border.shape[1]:
            lower = np.tril(self._dense(eliminated - now["band"], rest, 0, rest))
            self.schur = lower + np.tril(lower, -1).T
            low = eliminated - now["border"]
            self.border = work.border[low : low + rest].copy()
            self.corner = np.triu(work.corner) + np.triu(work.corner, 1).T
        return True

    def _prepare(self, matrix: Ordered, eliminated: int, keep: bool, fill: float) -> Elimination | None:
        """Divide the columns into panels and allocate the band; return None if ``fill`` is exceeded."""
        reach = np.zeros(eliminated, dtype=np.int64)
        column, row, _ = matrix.apart
        if column.size:
            np.maximum.at(reach, column[column < eliminated], row[column < eliminated] + 1)
        kernel.reaches(matrix, reach)
        if np.isfinite(fill) and float((reach - np.arange(eliminated)).sum()) > fill * 0.5 * (
            matrix.rows.values.size + matrix.own
        ):
            return None
        total, progress = matrix.own + matrix.after, np.zeros(1, dtype=kernel.PROGRESS)
        cut, end = np.empty(eliminated + 1, dtype=np.int64), np.empty(eliminated, dtype=np.int64)
        count = progress["panels"] = kernel.panels(reach, cut, end)
        first, last = cut[:count], cut[1 : count + 1]
        # No block has a leading dimension below its height.
        heights = np.maximum(end[:count] - first - 1, last - first)
        window = int(max(heights.max(initial=1), total - eliminated, 1)) + 1
        columns = total if keep else min(total, (_CHUNK + 1) * window)
        if self._band.shape != (columns, window):
            # Frees the old band first.
            self._band = np.empty((0, 1))
            self._band = np.empty((columns, window))
        rows, sides = matrix.border.shape
        border = np.zeros((rows + _CHUNK * window, sides))
        border[:rows] = matrix.border
        block = np.empty((kernel.MOST, kernel.MOST))
        return Elimination(cut, end, self._band, border, np.array(matrix.corner), block, progress)

    def _dense(self, column: int, columns: int, below: int, rows: int) -> Array:
        """Return a block of the band by its place in it, a view: ``below`` the diagonal, whose lower part alone is."""
        if not rows or not columns:
            return np.zeros((rows, columns))
        window = self._band.shape[1]
        return as_strided(self._band.reshape(-1)[column * window + below :], (rows, columns), (8, 8 * (window - 1)))

    def _odd_panel(self, k: int, work: Elimination) -> tuple[Array, Array] | None:
        """Eliminate a panel that is not positive definite; return the inverse of its block of ``L``, and its signs.

        None if entries grow too much.
        """
        c, c1, now = work.cut[k], work.cut[k + 1], work.progress[0]
        n, h, place = c1 - c, work.end[k] - c1, c - now["band"]
        block, border = work.block[:n, :n], work.border[c - now["border"] :]
        if not np.isfinite(block[np.triu_indices(n)]).all():
            return None
        values, vectors = np.linalg.eigh(block.T, "L")
        sizes = np.abs(values)
        # What rounding leaves of zero has no sign.
        if not sizes.min() > max(n * np.finfo(float).eps * sizes.max(), np.finfo(float).tiny):
            return None
        below = self._dense(place, n, n, h)
        inverse = vectors.T / np.sqrt(sizes)[:, None]
        sign = np.sign(values)
        below[:] = (below @ inverse.T) * sign
        if not (below[:, sign < 0.0] ** 2).sum(axis=1).max(initial=sizes.max()) <= _GROWTH * now["scale"]:
            return None
        if h:
            lower = np.tril_indices(h)
            self._dense(place + n, h, 0, h)[lower] -= ((below * sign) @ below.T)[lower]
        if border.shape[1]:
            mine = border[:n]
            mine[:] = sign[:, None] * (inverse @ mine)
            work.corner[:] -= (mine.T * sign) @ mine
            border[n : n + h] -= below @ (sign[:, None] * mine)
        return inverse, sign

    def forward(self, x: Array) -> None:
        """Solve ``L y = x`` in place; what is left of the other unknowns is their right-hand side."""
        kernel.forward(self._band, self._cut, self._end, self._odd, self._inverse, x)

    def back(self, x: Array) -> None:
        """Solve ``L^T x = J y`` in place, the other unknowns given."""
        kernel.back(self._band, self._cut, self._end, self._odd, self._inverse, self._sign, x)

    def solve(self, x: Array) -> None:
        """Solve in place where all unknowns are eliminated, for one right-hand side or the columns of several."""
        if x.ndim > 1:
            self._solve_together(x)
            return
        self.forward(x)
        self.back(x)

    def _solve_together(self, x: Array) -> None:
        """Solve for several right-hand sides, of which the band passes through memory once for all."""
        odd, panels = {int(k): one for one, k in enumerate(self._odd)}, []
        for k, bottom in enumerate(self._end):
            c, c1 = self._cut[k : k + 2]
            own, below = x[c:c1], self._dense(c, c1 - c, c1 - c, bottom - c1)
            if k in odd:
                block = self._inverse[odd[k], : c1 - c, : c1 - c]
                sign = self._sign[odd[k], : c1 - c]
                own[:] = block @ own
            else:
                block = self._dense(c, c1 - c, 0, c1 - c)
                sign = np.copysign(1.0, np.diagonal(block))
                own[:] = blas.dtrsm(1.0, block, own, lower=True)
            rest = x[c1:bottom]
            rest -= below @ own
            panels.append((own, rest, block, below, sign[:, None], k in odd))
        for own, rest, block, below, sign, is_odd in reversed(panels):
            left = sign * own - below.T @ rest
            own[:] = block.T @ left if is_odd else blas.dtrsm(1.0, block, left, lower=True, trans_a=True)
