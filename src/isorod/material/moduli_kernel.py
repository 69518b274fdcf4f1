"""What laws that are made from energies add to the moduli of a block besides (`isorod.material.points`)."""

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.points import MODULI, ROWS, SQUARES


@njit(**FAST)
def add_rows(work: Array, k: int, row: int, x: float, values: tuple[float, ...]) -> None:
    """Add six values times ``x`` to the rows of moduli that begin at a row's place, at one point."""
    work[row + k] += x * values[0]
    work[row + ROWS[1] + k] += x * values[1]
    work[row + ROWS[2] + k] += x * values[2]
    work[row + ROWS[3] + k] += x * values[3]
    work[row + ROWS[4] + k] += x * values[4]
    work[row + ROWS[5] + k] += x * values[5]


@njit(**FAST)
def add_diagonal(work: Array, k: int, row: int, x: float) -> None:
    """Add ``x d_AB`` to the nine rows of moduli that begin at a row's place, at one point."""
    work[row + k] += x
    work[row + ROWS[4] + k] += x
    work[row + ROWS[8] + k] += x


@njit(**FAST)
def _add_nine(
    work: Array, k: int, row: int, x: float, d: tuple[float, ...], e: tuple[float, ...], a: int, b: int
) -> None:
    for A in range(3):
        for B in range(3):
            work[row + ROWS[3 * A + B] + k] += x * (d[3 * a + A] * e[3 * b + B] + e[3 * a + A] * d[3 * b + B])


@njit(**FAST)
def _add_six(work: Array, k: int, row: int, x: float, d: tuple[float, ...], e: tuple[float, ...], a: int) -> None:
    d0, d1, d2 = x * d[3 * a], x * d[3 * a + 1], x * d[3 * a + 2]
    e0, e1, e2 = e[3 * a], e[3 * a + 1], e[3 * a + 2]
    work[row + k] += 2.0 * d0 * e0
    work[row + ROWS[1] + k] += d0 * e1 + d1 * e0
    work[row + ROWS[2] + k] += d0 * e2 + d2 * e0
    work[row + ROWS[3] + k] += 2.0 * d1 * e1
    work[row + ROWS[4] + k] += d1 * e2 + d2 * e1
    work[row + ROWS[5] + k] += 2.0 * d2 * e2


@njit(**FAST)
def add_both(work: Array, k: int, x: float, d: tuple[float, ...], e: tuple[float, ...]) -> None:
    """Add ``x (d_aA e_bB + e_aA d_bB)`` to the moduli at one point."""
    _add_nine(work, k, ROWS[MODULI], x, d, e, 0, 1)
    _add_nine(work, k, ROWS[MODULI + 9], x, d, e, 0, 2)
    _add_nine(work, k, ROWS[MODULI + 18], x, d, e, 1, 2)
    _add_six(work, k, ROWS[SQUARES], x, d, e, 0)
    _add_six(work, k, ROWS[SQUARES + 6], x, d, e, 1)
    _add_six(work, k, ROWS[SQUARES + 12], x, d, e, 2)
