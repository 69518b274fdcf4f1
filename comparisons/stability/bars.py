"""What several cases share: straight bars on any knots, and PETSc options for one point."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from isorod.geometry.axis import Axis
from isorod.geometry.rod import Rod
from isorod.geometry.section import circle


def bar(
    breaks: Sequence[float],
    degree: int = 2,
    continuity: int | None = None,
    section: ArrayLike | None = None,
    radius: float = 1.0,
) -> Rod:
    """Return a straight bar along z on given knots, of which the height is the axis parameter.

    Parameters
    ----------
    breaks
        Distinct knots, units of length.
    continuity
        At the inner knots, ``degree - 1`` where not given.
    section
        Control polygon ``(n, 2)``; a circle of 8 points and the given radius where not given.
    """
    times = degree - (degree - 1 if continuity is None else continuity)
    inner = np.repeat(np.array(breaks[1:-1], dtype=float), times)
    knots = np.concatenate([np.full(degree + 1, breaks[0]), inner, np.full(degree + 1, breaks[-1])])
    count = knots.size - degree - 1
    heights = np.array([knots[j + 1 : j + degree + 1].mean() for j in range(count)])
    outline = circle(8, radius) if section is None else section
    return Rod.sweep(outline, Axis(degree, knots, np.ones(count)), heights[:, None] * np.array([0.0, 0.0, 1.0]))


@contextmanager
def petsc(values: Mapping[str, Any]) -> Iterator[None]:
    """Set PETSc options as a user would type them, within."""
    from petsc4py import PETSc

    options = PETSc.Options()
    for name, value in values.items():
        options[name] = value
    try:
        yield
    finally:
        for name in values:
            options.delValue(name)
