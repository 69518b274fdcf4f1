"""Stationary random vibrations: transfer functions times a spectral density, integrated over frequency."""

from collections.abc import Mapping, Sequence
from dataclasses import fields

import numpy as np
from petsc4py import PETSc

from isorod import harmonic
from isorod.arrays import Array, Numbers
from isorod.errors import InputError, numbers
from isorod.harmonic import Damping, Span
from isorod.harmonic.response import Response
from isorod.model.model import Model
from isorod.random.response import RandomResponse

# Gauss points on each interval between rows of the table and frequencies round resonances, in half-widths of peaks.
_POINTS = 8
_ROUND = np.array([0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0])


def solve(
    model: Model,
    psd: Numbers,
    damping: Damping | None = None,
    base: tuple[float, float, float] | None = None,
    base_displacement: tuple[float, float, float] | None = None,
    loads: Sequence[int] | None = None,
    load_steps: int = 1,
    comm: PETSc.Comm | None = None,
    petsc: Mapping[str, object] | None = None,
    progress: bool = False,
) -> RandomResponse:
    """Return the stationary response to random loads or base motion, all by one signal.

    Parameters
    ----------
    model
        Bodies with densities, supports and loads.
    psd
        One-sided spectral density of the signal: rows of frequency [cycles per time] and value [signal squared per
        frequency]; linear between them in logarithms of both, zero beyond.
    damping
        As for `isorod.harmonic.solve`.
    base, base_displacement
        Acceleration, or displacement, of the supports for a signal of 1, shape ``(3,)``.
    loads
        The loads that the signal multiplies, as for `isorod.harmonic.solve`.
    load_steps, petsc, progress
        As for `isorod.harmonic.solve`.

    Raises
    ------
    InputError
        If the density is invalid, or as `isorod.harmonic.solve` does.
    SolveError
        As `isorod.harmonic.solve` does.
    """
    table = numbers("psd", psd)
    if table.ndim != 2 or table.shape[1] != 2 or len(table) < 2:
        raise InputError("psd: need two rows [frequency, value] or more")
    if not (np.isfinite(table).all() and (table > 0.0).all() and (np.diff(table[:, 0]) > 0.0).all()):
        raise InputError("psd: need frequencies that ascend, and values, all above 0")
    span = Span(float(table[0, 0]), float(table[-1, 0]), 2)
    whole = harmonic.solve(
        model, span, damping, base, base_displacement, loads, load_steps, comm=comm, petsc=petsc, progress=progress
    )
    points, weights = _rule(table[:, 0], whole)
    density = np.exp(np.interp(np.log(points), *np.log(table.T)))
    there = whole.over(points)
    own = {one.name: getattr(there, one.name) for one in fields(Response)}
    own["coordinates"] = np.sqrt(density)[:, None] * there.coordinates
    return RandomResponse(**own, density=density, weights=weights)


def _rule(rows: Array, response: Response) -> tuple[Array, Array]:
    """Return frequencies and weights of the integral over the range of a table."""
    away = np.concatenate([-_ROUND[:0:-1], _ROUND])
    near = (response.resonances[:, None] * (1.0 + response.ratios[:, None] * away)).ravel()
    first, last = rows[[0, -1]]
    # Intervals at round-off level are left out.
    ends = np.unique(np.concatenate([rows, near[(near > first) & (near < last)]]))
    ends = ends[np.append(True, np.diff(ends) > 1e-9 * last)]
    place, weight = np.polynomial.legendre.leggauss(_POINTS)
    half = 0.5 * np.diff(ends)[:, None]
    return (ends[:-1, None] + half * (1.0 + place)).ravel(), (half * weight).ravel()
