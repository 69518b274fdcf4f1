"""Supports of end faces in scene files: of all nodes, or of their mean."""

import numpy as np

from isorod.arrays import Numbers
from isorod.errors import InputError
from isorod.model.mean import MeanSupport
from isorod.model.support import Support
from isorod.space.space import Space


def end(
    space: Space,
    which: str,
    components: str = "xyz",
    displacement: tuple[float, float, float] = (0.0, 0.0, 0.0),
    body: int = 0,
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
    center: tuple[float, float, float] | None = None,
    tied: str = "",
    during: tuple[float, float] = (0.0, 1.0),
    mean: str = "",
    axis: tuple[float, float, float] | None = None,
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    history: Numbers | None = None,
) -> Support | MeanSupport:
    """Return a support of the whole `"start"` or `"end"` face: every node is held, or their mean alone.

    Parameters
    ----------
    which
        `"start"` or `"end"`.
    components, tied
        Letters of `"xyz"`: held, and free to translate as one (`isorod.model.support.Support`).
    displacement
        At load factor 1, shape `(3,)`, units of length.
    turn
        Rotation vector at load factor 1, shape `(3,)`: along its axis, as long as its angle, which may be many whole
        turns, degrees.
    center
        The point about which it turns, shape `(3,)`; the mean of the face where not given.
    during
        Load factors between which it moves, as `[0, 0.5]`.
    mean, axis
        The face stays free to deform, and what is held is its mean displacement, in the `components`, and of `"fixed"`
        its mean rotation, of a `"hinge"` that but about its `axis`, of a `"fork"` that about the normal alone, of a
        `"pin"` none.
    spin
        Angular velocity about the `center` in motions, radians per time.
    history
        In motions the factor by time of displacement, rotation or spin: rows of time and factor, straight between them,
        or the name of a CSV file of such beside this one; the last value from there on.
    """
    if not mean and axis is None:
        return Support.end(space, which, components, displacement, body, turn, center, tied, during, spin, history)
    if np.any(turn) or np.any(spin) or center is not None or tied or tuple(during) != (0.0, 1.0):
        raise InputError(
            "mean: a face held in the mean does not turn; leave out rotation, spin, center, tied and during"
        )
    return MeanSupport.end(space, which, mean, components, displacement, axis, body, history)
