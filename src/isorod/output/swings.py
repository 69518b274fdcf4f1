"""Records of transfer functions: largest amplitudes, curves and peaks."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from isorod.arrays import Array

# What is a smaller share of the largest component is rounding.
_ROUNDING = 1e-9


def told(found: Mapping[str, Any], frequencies: Array, span: bool) -> dict[str, Any]:
    """Return what a record keeps of what is measured at each frequency, by the names of that.

    Parameters
    ----------
    found
        Of each name complex amplitudes ``(n,)`` or ``(n, 3)``, or real ones of what has no phase.
    frequencies
        Cycles per time, shape ``(n,)``.
    span
        Whether there are enough of them round resonances to show peaks.

    Returns
    -------
    By its name the largest amplitude; ``response`` with ``amplitude`` and ``phase`` in degrees of each, by name and
    component; ``peaks`` with rows of frequency, amplitude and phase.
    """
    result: dict[str, Any] = {}
    response: dict[str, Any] = {}
    peaks: dict[str, Any] = {}
    for name, given in found.items():
        values = np.asarray(given)
        columns = values.reshape(len(values), -1)
        sizes = np.abs(columns)
        sizes[:, sizes.max(axis=0) < _ROUNDING * sizes.max()] = 0.0
        largest = sizes.max(axis=0)
        result[name] = float(largest[0]) if values.ndim == 1 else largest
        for k, (column, size) in enumerate(zip(columns.T, sizes.T, strict=True)):
            label = name if values.ndim == 1 else f"{name}[{'xyz'[k]}]"
            phase = np.degrees(np.angle(column)) if np.iscomplexobj(column) and size.any() else None
            response[label] = {"amplitude": size} | ({} if phase is None else {"phase": phase})
            if span:
                peaks[label] = _peaks(frequencies, size, phase)
    return result | {"response": response} | ({"peaks": peaks} if span else {})


def _peaks(frequencies: Array, size: Array, phase: Array | None) -> list[list[float]]:
    """Return frequency, amplitude and phase of each peak: near one the square of its reciprocal is a parabola."""
    found = []
    for k in range(1, size.size - 1):
        if not (size[k] > size[k - 1] and size[k] >= size[k + 1]):
            continue
        x, y = frequencies[k - 1 : k + 2] - frequencies[k], (size[k] / size[k - 1 : k + 2]) ** 2
        curve = np.polyfit(x, y, 2)
        place = float(np.clip(-0.5 * curve[1] / curve[0], x[0], x[-1])) if curve[0] > 0.0 else 0.0
        top = float(np.polyval(curve, place))
        height = float(size[k] / np.sqrt(top)) if top > 0.0 else float(size[k])
        there = [] if phase is None else [float(np.interp(place, x, np.unwrap(phase[k - 1 : k + 2], period=360.0)))]
        found.append([float(frequencies[k]) + place, height, *there])
    return found
