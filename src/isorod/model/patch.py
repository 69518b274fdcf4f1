"""Patches of a rod's lateral surface, named by angle and length."""

import numpy as np

from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.geometry.rod import Rod
from isorod.space.space import Space

# Points in an element at which its length is measured, and round an arc at which functions are looked at.
_FINE = 64
# Rounding of a function that vanishes, and of a length.
_SMALL = 1e-9


def patch_nodes(space: Space, around: tuple[float, float], along: tuple[float, float]) -> Index:
    """Return the nodes whose functions act on a patch (see `isorod.model.support.Support.patch`), ``(m,)``."""
    if not space.basis.on_surface:
        raise InputError("patch: the section functions have no control points on the surface; leave out section_degree")
    first, last = (float(angle) for angle in around)
    if not (np.isfinite([first, last]).all() and 0.0 < last - first <= 360.0):
        raise InputError(f"patch: around is from {first:g} to {last:g} degrees, need a positive angle of at most 360")
    theta = np.radians(np.linspace(first, last, _FINE * space.points_around + 1))
    values, _ = space.basis.functions(np.stack([np.cos(theta), np.sin(theta)], axis=1))
    acting = (np.abs(values) > _SMALL).any(axis=0) & space.basis.is_carrier
    layers = np.unique(space.element_layers[_elements(space, along)])
    return (layers[:, None] * space.layer_nodes + np.flatnonzero(acting)).ravel()


def _elements(space: Space, along: tuple[float, float]) -> Index:
    """Return the elements between two lengths along the centre line."""
    u, lengths = centre_lengths(space.rod)
    whole = float(lengths[-1])
    low, high = (float(length) for length in along)
    if not -_SMALL * whole <= low < high <= (1.0 + _SMALL) * whole:
        raise InputError(f"patch: along is from {low:g} to {high:g}, need lengths from 0 to {whole:g}, ascending")
    start, end = np.interp([low, high], lengths, u)
    breaks = space.axis.breaks
    margin = _SMALL * (breaks[-1] - breaks[0])
    return np.flatnonzero((breaks[:-1] < end - margin) & (breaks[1:] > start + margin))


def centre_lengths(rod: Rod) -> tuple[Array, Array]:
    """Return axis parameters and the lengths of the centre line up to there, both ``(m,)``."""
    breaks = rod.axis.breaks
    u = np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * np.arange(_FINE) / _FINE).ravel(), breaks[-1])
    points = rod.grid([[0.0, 0.0]], u)[0][:, 0]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return u, np.concatenate([[0.0], np.cumsum(steps)])
