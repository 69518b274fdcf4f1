"""Patches of a rod's lateral surface, named by angle and length."""

import numpy as np

from isorod.arrays import Index
from isorod.errors import InputError
from isorod.geometry.quadrature import WHOLE
from isorod.space.space import Space

# Points round an arc at which functions are evaluated.
_PLACES = 64
# Tolerances: of functions that vanish, and of typed lengths, relative to the whole length.
_SMALL, _ROUNDED = 1e-9, 1e-6


def patch_nodes(space: Space, around: tuple[float, float], along: tuple[float, float]) -> Index:
    """Return the nodes whose functions act on a patch (see `isorod.model.support.Support.patch`), ``(m,)``."""
    if not space.basis.on_surface:
        whole = space.rod.rings == WHOLE
        right = "give the space an order, such as 2" if whole else "no rod with a hole or layers has"
        raise InputError(f"patch: the section functions have no control points on the surface; {right}")
    first, last = (float(angle) for angle in around)
    if not (np.isfinite([first, last]).all() and 0.0 < last - first <= 360.0):
        raise InputError(f"patch: around is from {first:g} to {last:g} degrees, need a positive angle of at most 360")
    theta = np.radians(np.linspace(first, last, _PLACES * space.points_around + 1))
    values, _ = space.basis.functions(np.stack([np.cos(theta), np.sin(theta)], axis=1))
    acting = (np.abs(values) > _SMALL).any(axis=0) & space.basis.is_control_point
    layers = np.unique(space.element_layers[_elements(space, along)])
    return (layers[:, None] * space.layer_nodes + np.flatnonzero(acting)).ravel()


def _elements(space: Space, along: tuple[float, float]) -> Index:
    """Return the elements between two lengths along the centre line."""
    length, breaks = space.rod.arc_length, space.axis.breaks
    whole = length.total
    low, high = (float(length) for length in along)
    if not -_ROUNDED * whole <= low < high <= (1.0 + _ROUNDED) * whole:
        raise InputError(f"patch: along is from {low:g} to {high:g}, need lengths from 0 to {whole:g}, ascending")
    ends = length(breaks)
    return np.flatnonzero((ends[:-1] < high - _ROUNDED * whole) & (ends[1:] > low + _ROUNDED * whole))
