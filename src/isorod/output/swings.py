"""Records of transfer functions: largest amplitudes, curves and peaks."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from isorod.arrays import Array

# Components below this fraction of the largest are round-off.
_ROUNDING = 1e-9


def entries(results: Mapping[str, Any], frequencies: Array, span: bool) -> dict[str, Any]:
    """Return the entries of a record for results over frequency.

    Parameters
    ----------
    results
        Complex amplitudes ``(n,)`` or ``(n, 3)`` by name, or real ones without phase.
    frequencies
        Cycles per time, shape ``(n,)``.
    span
        Whether they resolve resonances, so that peaks are reported.

    Returns
    -------
    The largest amplitude by name; ``response`` with ``amplitude`` and ``phase`` in degrees of each, by name and
    component; ``peaks`` with rows of frequency, amplitude and phase.
    """
    record: dict[str, Any] = {}
    response: dict[str, Any] = {}
    peaks: dict[str, Any] = {}
    for name, amplitudes in results.items():
        values = np.asarray(amplitudes)
        columns = values.reshape(len(values), -1)
        sizes = np.abs(columns)
        sizes[:, sizes.max(axis=0) < _ROUNDING * sizes.max()] = 0.0
        largest = sizes.max(axis=0)
        record[name] = float(largest[0]) if values.ndim == 1 else largest
        for k, (column, size) in enumerate(zip(columns.T, sizes.T, strict=True)):
            label = name if values.ndim == 1 else f"{name}[{'xyz'[k]}]"
            phase = np.degrees(np.angle(column)) if np.iscomplexobj(column) and size.any() else None
            response[label] = {"amplitude": size} | ({} if phase is None else {"phase": phase})
            if span:
                peaks[label] = _peaks(frequencies, size, phase)
    return record | {"response": response} | ({"peaks": peaks} if span else {})


def _peaks(frequencies: Array, size: Array, phase: Array | None) -> list[list[float]]:
    """Return frequency, amplitude and phase of each peak, by a parabola through the squared reciprocal amplitude."""
    peaks = []
    for k in range(1, size.size - 1):
        if not (size[k] > size[k - 1] and size[k] >= size[k + 1]):
            continue
        x, y = frequencies[k - 1 : k + 2] - frequencies[k], (size[k] / size[k - 1 : k + 2]) ** 2
        parabola = np.polyfit(x, y, 2)
        offset = float(np.clip(-0.5 * parabola[1] / parabola[0], x[0], x[-1])) if parabola[0] > 0.0 else 0.0
        least = float(np.polyval(parabola, offset))
        height = float(size[k] / np.sqrt(least)) if least > 0.0 else float(size[k])
        phase_at = [] if phase is None else [float(np.interp(offset, x, np.unwrap(phase[k - 1 : k + 2], period=360.0)))]
        peaks.append([float(frequencies[k]) + offset, height, *phase_at])
    return peaks
