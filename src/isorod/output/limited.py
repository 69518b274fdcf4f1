"""Fields that are no functions of Bezier cells, at their control points: approximated, and never beyond the field.

Programs that draw such cells take the coefficients for values at points, and the largest of these for the largest of
the field.  Those of the best approximation are far beyond it where it waves, as near the edges of held faces.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.output.bernstein import Shape, bernstein
from isorod.output.patches import Patches, within


class Limited:
    """Approximations of fields on pieces of a rod, each with the same patches.

    Parameters
    ----------
    patches
        Of the section.
    degree
        Of the Bernstein polynomials along a piece.

    Attributes
    ----------
    samples
        Parameters ``(t,)`` from 0 to 1 along a piece, next to both ends too, at which a field is evaluated; across it
        the points are `Patches.samples`.
    """

    def __init__(self, patches: Patches, degree: int) -> None:
        self.patches = patches
        self.samples = within(np.linspace(0.0, 1.0, 2 * degree + 2))
        self._values = bernstein(degree, self.samples)
        self._fit: Array = np.linalg.pinv(self._values)
        middle = np.arange(degree + 1) / degree
        self._near = np.abs(middle[:, None] - self.samples) <= 1.0 / degree + 1e-9

    def controls(self, values: Array, weights: Array) -> Array:
        """Return values at the control points.

        They are coefficients of the function of the cells' kind that fits the field best, but no larger and no smaller
        than the field is near by (at the samples next to where a control point's own function is largest): what is
        drawn is then between values of the field too.  At the corners of cells it is the field itself.  Where patches
        share a control point it has their mean.

        Parameters
        ----------
        values
            Of some fields at the samples of some pieces, shape ``(e, t, s, fields)``.
        weights
            Of the pieces' control points along the rod, shape ``(e, p + 1)``.

        Returns
        -------
        Array of shape ``(e, p + 1, m, fields)``.
        """
        patches = self.patches
        numerators = np.einsum("kt,et,etsc->eksc", self._fit, weights @ self._values.T, values, optimize=True)
        low, high = (_extremes(values, self._near, 1, one) for one in (np.min, np.max))
        found = np.zeros((*weights.shape, patches.weights.size, values.shape[-1]))
        for shape, nodes, samples in self._alike:
            weighted = numerators[:, :, samples] * patches.sample_weights[samples, None]
            own = np.einsum("ms,ekPsc->ekPmc", shape.approximation, weighted, optimize=True)
            own /= (weights[:, :, None, None] * patches.weights[nodes])[..., None]
            own = np.clip(
                own,
                _extremes(low[:, :, samples], shape.near, 3, np.min),
                _extremes(high[:, :, samples], shape.near, 3, np.max),
            )
            corner, at = shape.corners
            for k in (0, -1):
                own[:, k][:, :, corner] = values[:, k][:, samples[:, at]]
            np.add.at(found.transpose(2, 0, 1, 3), nodes, own.transpose(2, 3, 0, 1, 4))
        return np.asarray(found / patches.shared[:, None])

    def shown(self, controls: Array, weights: Array) -> Array:
        """Return what cells show at the samples, ``(e, t, s, fields)``, of values at their control points."""
        patches = self.patches
        numerators = np.einsum("tk,ek,ekmc->etmc", self._values, weights, controls, optimize=True)
        found = np.empty((*numerators.shape[:2], len(patches.samples), controls.shape[-1]))
        for shape, nodes, samples in self._alike:
            own = numerators[:, :, nodes] * patches.weights[nodes][..., None]
            found[:, :, samples] = np.einsum("sm,etPmc->etPsc", shape.check, own, optimize=True)
        total = (weights @ self._values.T)[:, :, None] * patches.sample_weights
        return np.asarray(found / total[..., None])

    @cached_property
    def _alike(self) -> list[tuple[Shape, Index, Index]]:
        """The shapes there are, with nodes ``(P, m)`` and numbers of samples ``(P, s)`` of all patches of each."""
        shapes = self.patches.shapes
        starts = np.cumsum([0, *(len(shape.checks) for shape in shapes)])
        found = []
        for own in dict.fromkeys(map(id, shapes)):
            which = [k for k, shape in enumerate(shapes) if id(shape) == own]
            shape = shapes[which[0]]
            nodes = np.stack([self.patches.nodes[k] for k in which])
            found.append((shape, nodes, starts[which][:, None] + np.arange(len(shape.checks))))
        return found


def _extremes(values: Array, near: NDArray[np.bool_], axis: int, extreme: Callable[..., Array]) -> Array:
    """Return extremes of values over those of an axis that are near each of several places, in its place."""
    rows = np.ascontiguousarray(np.moveaxis(values, axis, 0))
    return np.moveaxis(np.stack([extreme(rows[own], axis=0) for own in near]), 0, axis)
