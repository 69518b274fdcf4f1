"""Boundaries between laws along a rod."""

import warnings
from collections.abc import Sequence

import numpy as np

from isorod.geometry.axis import Axis
from isorod.material.law import Material

# Ratio of moduli from which a smooth boundary is warned of: bars in series err by 4 % at 10, by 13 % at 100 (p = 3,
# four elements each).
_JUMP = 10.0


def warn_of_smooth_joints(axis: Axis, laws: Sequence[Material], rings: int) -> None:
    """Warn where stiffness jumps at a knot at which displacements are smooth: strains cannot follow.

    ``laws`` are those of each element, and of each of its ``rings``.
    """
    if all(law is laws[0] for law in laws):
        return
    moduli = np.array([np.max(getattr(law, "E", np.nan)) for law in laws]).reshape(-1, rings)
    jumps = np.exp(np.abs(np.diff(np.log(moduli), axis=0)).max(axis=1)) * (1.0 - 1e-9)
    times = np.searchsorted(axis.knots, axis.breaks[1:-1], "right") - np.searchsorted(axis.knots, axis.breaks[1:-1])
    smooth = (jumps > _JUMP) & (times < axis.degree)
    if smooth.any():
        k = int(np.argmax(np.where(smooth, jumps, 0.0)))
        warnings.warn(
            f"stiffness jumps by {jumps[k]:.3g} at u = {axis.breaks[k + 1]:.4g}, where strains are continuous: "
            "errors of a tenth and more; use continuity 0, or a rod with that knot repeated (Rod.insert)",
            stacklevel=4,
        )
