"""Factors of a banded symmetric matrix, of its first unknowns alone if the others are wanted: ``A = L J L^T``.

Where a panel is positive definite, its part is Cholesky's and ``J`` is 1.  A negative pivot, of which there are as many
as negative eigenvalues, is a panel by itself, whose ``J`` is -1, where little is lost by that; where much is, the
eigenvectors of the diagonal block of what is left of the panel make that block of ``L``, and ``J`` has their signs: by
Sylvester's law they count the negative eigenvalues.  Nothing is exchanged between panels, so that entries may grow;
where they do by much, the factors are refused.
"""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided

from isorod.arrays import Array, Index
from isorod.petsc import band_kernel as kernel
from isorod.petsc.rows import Compressed

# Factors are refused where the panels that are not positive definite add more than this many times the largest entry
# to the diagonal: so many digits are lost.
_GROWTH = 1e3

# Without keeping, factors are forgotten after so many times the columns that are needed.
_CHUNK = 8

_NOTHING = np.empty(0, dtype=np.int64)


class Ordered(NamedTuple):
    """Rows in the order of elimination, see `band_kernel.reaches` and, of what is given apart, `eliminate`.

    ``after`` more unknowns come behind them; ``border``, shape ``(own, s)``, couples ``s`` more to the first of all,
    and ``corner``, shape ``(s, s)``, is their own block.
    """

    rows: Compressed
    first: int
    own: int
    backward: bool = False
    apart: tuple[Index, Index, Array] = (_NOTHING, _NOTHING, np.empty(0))
    after: int = 0
    border: Array = np.empty((1, 0))
    corner: Array = np.empty((0, 0))


class Factors:
    """Factors of a matrix, and what is left of the unknowns that were not eliminated.

    Attributes
    ----------
    negative
        Number of negative eigenvalues of what was eliminated.
    border, corner
        Schur complement of the border: what couples it to the unknowns that come after, shape ``(after, s)``, and its
        own block.
    schur
        Schur complement of the unknowns that come after.
    """

    def __init__(self) -> None:
        self._band = np.empty((0, 1))
        self._cut: Index = _NOTHING
        self._end: Index = _NOTHING
        self._count = self._width = 0
        self.negative = 0
        self.border = self.corner = self.schur = np.empty((0, 0))

    def factorise(self, matrix: Ordered, eliminated: int, keep: bool = True, fill: float = np.inf) -> bool:
        """Eliminate the first unknowns; return whether that went well.

        Without keeping, there is an inertia and a Schur complement, but no factors are kept.  A matrix whose factors
        would have more than ``fill`` times its entries is refused.
        """
        if not self._layout(matrix, eliminated, keep, fill):
            return False
        window, sides = self._width + 1, matrix.border.shape[1]
        border = np.zeros((0, 0))
        if sides:
            border = np.zeros((_CHUNK * window + matrix.border.shape[0], sides))
            border[: matrix.border.shape[0]] = matrix.border
        corner = np.array(matrix.corner)
        block = np.empty((kernel.MOST, kernel.MOST))
        state, scale = np.zeros(8, dtype=np.int64), np.zeros(1)
        state[kernel.COUNT] = self._count
        numbers = np.zeros(5, dtype=np.int32)
        self.negative = 0
        self.border = self.corner = self.schur = np.empty((0, 0))
        odd: list[tuple[int, Array, Array]] = []
        while True:
            k = kernel.eliminate(
                *matrix.rows,
                matrix.first,
                matrix.own,
                matrix.own + matrix.after,
                matrix.backward,
                *matrix.apart,
                self._cut,
                self._end,
                self._band.reshape(-1),
                self._width,
                border.reshape(-1),
                corner,
                block,
                state,
                scale,
                kernel.WORD,
                numbers,
                kernel.UNIT,
            )
            self._count = int(state[kernel.COUNT])
            if k == self._count:
                break
            found = self._odd_panel(k, block, border, corner, state, float(scale[0]))
            if found is None:
                return False
            odd.append((k, *found))
            self.negative += int(np.count_nonzero(found[1] < 0.0))
            state[kernel.PANEL] = k + 1
        self._cut, self._end = self._cut[: self._count + 1], self._end[: self._count]
        self.negative += int(state[kernel.NEGATIVE])
        self._odd = np.array([k for k, _, _ in odd], dtype=np.int64)
        most = max((sign.size for _, _, sign in odd), default=0)
        self._inverse = np.zeros((len(odd), most, most))
        self._sign = np.ones((len(odd), most))
        for one, (_, inverse, sign) in enumerate(odd):
            self._inverse[one, : sign.size, : sign.size] = inverse
            self._sign[one, : sign.size] = sign
        rest = matrix.own + matrix.after - eliminated
        if not rest + sides:
            return True
        lower = np.tril(self._dense(eliminated - int(state[kernel.BASE]), rest, 0, rest))
        self.schur = lower + np.tril(lower, -1).T
        low = eliminated - int(state[kernel.BORDER_BASE])
        self.border = border[low : low + rest].copy()
        self.corner = np.triu(corner) + np.triu(corner, 1).T
        return True

    def _layout(self, matrix: Ordered, eliminated: int, keep: bool, fill: float) -> bool:
        """Cut the columns into panels, and make room for the band; return whether it is as narrow as it should."""
        reach = np.zeros(eliminated, dtype=np.int64)
        column, row, _ = matrix.apart
        if column.size:
            np.maximum.at(reach, column[column < eliminated], row[column < eliminated] + 1)
        kernel.reaches(*matrix.rows[:2], matrix.first, matrix.own, matrix.backward, reach)
        if np.isfinite(fill) and float((reach - np.arange(eliminated)).sum()) > fill * 0.5 * (
            matrix.rows.values.size + matrix.own
        ):
            return False
        total = matrix.own + matrix.after
        cut, end = np.empty(eliminated + 1, dtype=np.int64), np.empty(eliminated, dtype=np.int64)
        self._cut, self._end, self._count = cut, end, int(kernel.panels(reach, cut, end))
        first, last = cut[: self._count], cut[1 : self._count + 1]
        # No block has a leading dimension below its height.
        heights = np.maximum(end[: self._count] - first - 1, last - first)
        self._width = int(max(heights.max(initial=1), total - eliminated, 1))
        columns = total if keep else min(total, (_CHUNK + 1) * (self._width + 1))
        if self._band.shape != (columns, self._width + 1):
            # Less is in memory than two of them at any time.
            self._band = np.empty((0, 1))
            self._band = np.empty((columns, self._width + 1))
        return True

    def _dense(self, column: int, columns: int, below: int, rows: int) -> Array:
        """Return a block of the band by its place in it, a view: ``below`` the diagonal, whose lower part alone is."""
        flat = self._band.reshape(-1)
        first = column * (self._width + 1) + below
        if not rows or not columns:
            return np.zeros((rows, columns))
        return as_strided(flat[first:], (rows, columns), (8, 8 * self._width))

    def _odd_panel(
        self, k: int, block: Array, border: Array, corner: Array, state: Index, scale: float
    ) -> tuple[Array, Array] | None:
        """Eliminate a panel that is not positive definite; return the inverse of its block of ``L``, and its signs.

        None if entries grow too much.
        """
        c, c1, bottom = int(self._cut[k]), int(self._cut[k + 1]), int(self._end[k])
        n, h, place = c1 - c, bottom - c1, c - int(state[kernel.BASE])
        if not np.isfinite(block[:n, :n][np.triu_indices(n)]).all():
            return None
        values, vectors = np.linalg.eigh(block[:n, :n].T, "L")
        sizes = np.abs(values)
        # What rounding leaves of zero has no sign.
        if not sizes.min() > max(n * np.finfo(float).eps * sizes.max(), np.finfo(float).tiny):
            return None
        below = self._dense(place, n, n, h)
        inverse = vectors.T / np.sqrt(sizes)[:, None]
        sign = np.sign(values)
        below[:] = (below @ inverse.T) * sign
        if not (below[:, sign < 0.0] ** 2).sum(axis=1).max(initial=sizes.max()) <= _GROWTH * scale:
            return None
        if h:
            lower = np.tril_indices(h)
            self._dense(place + n, h, 0, h)[lower] -= ((below * sign) @ below.T)[lower]
        if border.shape[1]:
            low = c - int(state[kernel.BORDER_BASE])
            border[low : low + n] = sign[:, None] * (inverse @ border[low : low + n])
            mine = border[low : low + n]
            corner -= (mine.T * sign) @ mine
            border[low + n : low + n + h] -= below @ (sign[:, None] * mine)
        return inverse, sign

    def forward(self, x: Array) -> None:
        """Solve ``L y = x`` in place; what is left of the other unknowns is their right-hand side."""
        kernel.forward(self._band, self._cut, self._end, self._odd, self._inverse, x)

    def back(self, x: Array) -> None:
        """Solve ``L^T x = J y`` in place, the other unknowns given."""
        kernel.back(self._band, self._cut, self._end, self._odd, self._inverse, self._sign, x)

    def solve(self, x: Array) -> None:
        """Solve in place where all unknowns are eliminated."""
        self.forward(x)
        self.back(x)
