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


@njit(**FAST)
def add_turned(
    work: Array,
    k: int,
    x: float,
    y: float,
    n: tuple[float, ...],
    v: tuple[float, ...],
    m: tuple[float, ...],
    w: tuple[float, ...],
) -> None:
    """Add ``2 x s s + 2 y t t`` to the moduli at one point, with ``s = n w + m v`` and ``t = n w - m v``."""
    first, second = outer(n, w), outer(m, v)
    both = combined(1.0, first, 1.0, second)
    add_both(work, k, x, both, both)
    apart = combined(1.0, first, -1.0, second)
    add_both(work, k, y, apart, apart)


@njit(**FAST)
def outer(n: tuple[float, ...], v: tuple[float, ...]) -> tuple[float, ...]:
    """Return the nine ``n_a v_A``."""
    return (
        *(n[0] * v[0], n[0] * v[1], n[0] * v[2]),
        *(n[1] * v[0], n[1] * v[1], n[1] * v[2]),
        *(n[2] * v[0], n[2] * v[1], n[2] * v[2]),
    )


@njit(**FAST)
def scaled(x: float, d: tuple[float, ...]) -> tuple[float, ...]:
    """Return ``x d`` of nine components."""
    return (x * d[0], x * d[1], x * d[2], x * d[3], x * d[4], x * d[5], x * d[6], x * d[7], x * d[8])


@njit(**FAST)
def combined(x: float, d: tuple[float, ...], y: float, e: tuple[float, ...]) -> tuple[float, ...]:
    """Return ``x d + y e`` of nine components."""
    return (
        *(x * d[0] + y * e[0], x * d[1] + y * e[1], x * d[2] + y * e[2]),
        *(x * d[3] + y * e[3], x * d[4] + y * e[4], x * d[5] + y * e[5]),
        *(x * d[6] + y * e[6], x * d[7] + y * e[7], x * d[8] + y * e[8]),
    )
