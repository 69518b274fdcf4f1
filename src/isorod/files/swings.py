"""Stress of a harmonic response at a place, or the largest of all frequencies and where it is."""

from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array
from isorod.files.peaks import Sought
from isorod.output.largest import Peak

if TYPE_CHECKING:
    from isorod.harmonic.response import Response

# Sections of an element, and points round each, at which it is looked for the frequency of the largest stress.
_SECTIONS, _AROUND = 3, 12


def find(sought: Sought, solution: "Response") -> Any:
    """Return the stress at each frequency, complex where it has a phase, ``(n,)``; as a `Peak` with its place."""
    # A random response is all frequencies at once.
    whole = solution.whole() if hasattr(solution, "whole") else None
    if sought.u is not None and sought.xi is not None:
        size = sought.find(whole or solution.single(0))
        u, xi = sought.u, np.array(sought.xi)
        values = _at(sought, solution, u, xi)
        if whole is None:
            sought.warn(solution.single(int(np.argmax(np.abs(values)))), float(np.abs(values).max()))
        else:
            sought.warn(whole, size)
        return values
    one = whole or solution.single(_loudest(sought, solution))
    peak = sought.find(one)
    assert isinstance(peak, Peak)
    sought.warn(one, peak)
    angle = np.radians(peak.place["angle"])
    xi = peak.place["radius"] * np.array([np.cos(angle), np.sin(angle)])
    return Peak(_at(sought, solution, peak.place["u"], xi), peak.place)  # type: ignore[arg-type]


def _at(sought: Sought, solution: "Response", u: float, xi: Array) -> Array:
    """Return the stress at a point, at each frequency."""
    return solution.signed(sought.rod, np.array([u]), xi[None], sought.name)[:, 0, 0]


def _loudest(sought: Sought, solution: "Response") -> int:
    """Return the number of the frequency at which the stress is largest somewhere."""
    space = solution.model.bodies[sought.rod].space
    breaks = space.axis.breaks
    share = (np.arange(_SECTIONS) + 0.5) / _SECTIONS
    u = (breaks[:-1, None] + np.diff(breaks)[:, None] * share).ravel() if sought.u is None else np.array([sought.u])
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    xi = np.stack([np.cos(angle), np.sin(angle)], axis=1) if sought.xi is None else np.array([sought.xi])
    return int(np.argmax(np.abs(solution.signed(sought.rod, u, xi, sought.name)).max(axis=(1, 2))))
