"""Terms of the moduli of a block for laws generated from energies (more in `isorod.material.points`)."""

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
def add_dyad(work: Array, k: int, row: int, x: float, p: tuple[float, ...]) -> None:
    """Add ``x p_A p_B`` to the nine rows of moduli that begin at a row's place, at one point."""
    xx, xy, xz = x * p[0] * p[0], x * p[0] * p[1], x * p[0] * p[2]
    yy, yz, zz = x * p[1] * p[1], x * p[1] * p[2], x * p[2] * p[2]
    work[row + k] += xx
    work[row + ROWS[1] + k] += xy
    work[row + ROWS[2] + k] += xz
    work[row + ROWS[3] + k] += xy
    work[row + ROWS[4] + k] += yy
    work[row + ROWS[5] + k] += yz
    work[row + ROWS[6] + k] += xz
    work[row + ROWS[7] + k] += yz
    work[row + ROWS[8] + k] += zz


@njit(**FAST)
def add_diagonal(work: Array, k: int, row: int, x: float) -> None:
    """Add ``x d_AB`` to the nine rows of moduli that begin at a row's place, at one point."""
    work[row + k] += x
    work[row + ROWS[4] + k] += x
    work[row + ROWS[8] + k] += x


@njit(**FAST)
def _add_nine(
    work: Array,
    k: int,
    row: int,
    p: tuple[float, ...],
    q: tuple[float, ...],
    u: tuple[float, ...],
    v: tuple[float, ...],
) -> None:
    """Add ``p_A q_B + u_A v_B`` to the nine rows of moduli that begin at a row's place, at one point."""
    # An inner loop over components would prevent vectorisation over points.
    work[row + k] += p[0] * q[0] + u[0] * v[0]
    work[row + ROWS[1] + k] += p[0] * q[1] + u[0] * v[1]
    work[row + ROWS[2] + k] += p[0] * q[2] + u[0] * v[2]
    work[row + ROWS[3] + k] += p[1] * q[0] + u[1] * v[0]
    work[row + ROWS[4] + k] += p[1] * q[1] + u[1] * v[1]
    work[row + ROWS[5] + k] += p[1] * q[2] + u[1] * v[2]
    work[row + ROWS[6] + k] += p[2] * q[0] + u[2] * v[0]
    work[row + ROWS[7] + k] += p[2] * q[1] + u[2] * v[1]
    work[row + ROWS[8] + k] += p[2] * q[2] + u[2] * v[2]


@njit(**FAST)
def _add_six(work: Array, k: int, row: int, p: tuple[float, ...], q: tuple[float, ...]) -> None:
    """Add ``p_A q_B + q_A p_B`` to the six rows of moduli that begin at a row's place, at one point."""
    work[row + k] += 2.0 * p[0] * q[0]
    work[row + ROWS[1] + k] += p[0] * q[1] + p[1] * q[0]
    work[row + ROWS[2] + k] += p[0] * q[2] + p[2] * q[0]
    work[row + ROWS[3] + k] += 2.0 * p[1] * q[1]
    work[row + ROWS[4] + k] += p[1] * q[2] + p[2] * q[1]
    work[row + ROWS[5] + k] += 2.0 * p[2] * q[2]


@njit(**FAST)
def add_both(work: Array, k: int, x: float, d: tuple[float, ...], e: tuple[float, ...]) -> None:
    """Add ``x (d_aA e_bB + e_aA d_bB)`` to the moduli at one point."""
    p, q, r = (x * d[0], x * d[1], x * d[2]), (x * d[3], x * d[4], x * d[5]), (x * d[6], x * d[7], x * d[8])
    u, v, w = (e[0], e[1], e[2]), (e[3], e[4], e[5]), (e[6], e[7], e[8])
    _add_nine(work, k, ROWS[MODULI], p, v, u, q)
    _add_nine(work, k, ROWS[MODULI + 9], p, w, u, r)
    _add_nine(work, k, ROWS[MODULI + 18], q, w, v, r)
    _add_six(work, k, ROWS[SQUARES], p, u)
    _add_six(work, k, ROWS[SQUARES + 6], q, v)
    _add_six(work, k, ROWS[SQUARES + 12], r, w)


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
