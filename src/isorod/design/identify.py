"""Numbers of a scene from measured curves, by least squares with exact derivatives (SciPy's ``least_squares``)."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from isorod.arrays import Array
from isorod.design.curves import Curve
from isorod.design.evaluations import Answer, Evaluations
from isorod.design.wanted import Vary
from isorod.errors import InputError

# It ends where neither numbers nor misfit change by more than this share.
_ALIKE = 1e-10
_MOST = 50

# The second time on the discretisation that suits what was found the first time.
_ROUNDS = 2

# A number is not told by a curve that hardly changes with it: of scaled derivatives the least singular value,
# as a share of the largest, or of one: the whole number then moves what is measured by less than so much of it.
_UNTOLD = 1e-7


class Identified(NamedTuple):
    """The identified parameters.

    Attributes
    ----------
    x, covariance
        The numbers, ``(n,)``, and their covariance, by what is left of the misfit.
    answers
        What the scenes of all points answer, by name.
    misfit
        Root of the mean square, each column by its largest value.
    """

    x: Array
    covariance: Array
    answers: Mapping[str, float]
    misfit: float


def identify(
    evaluations: Evaluations, several: Sequence[Vary], table: Curve, tell: Callable[[str], None]
) -> Identified:
    """Return the numbers with which scenes, one a point, answer as was measured.

    Raises
    ------
    InputError
        If the curves do not determine a parameter.
    """
    start = np.array([one.start for one in several])
    size = np.abs(start)
    bounds = np.array([(one.lower, one.upper) for one in several]) / size[:, None]
    answers: dict[bytes, Answer] = {}

    def answer(y: Array) -> Answer:
        key = np.ascontiguousarray(y).tobytes()
        if key not in answers:
            answers[key] = evaluations.answer(y * size)
        return answers[key]

    def misfit(y: Array) -> Array:
        found = table.off(answer(y).values)
        tell(f"solve {evaluations.solves}: misfit {np.sqrt(np.mean(found**2)):.3g}")
        return found

    def slopes(y: Array) -> Array:
        return table.slopes(evaluations.derivatives(y * size, answer(y))) * size

    y, ends = start / size, {"xtol": _ALIKE, "ftol": _ALIKE, "gtol": _ALIKE}
    for _ in range(_ROUNDS):
        answers.clear()
        answers[np.ascontiguousarray(y).tobytes()] = evaluations.freeze(y * size)
        found = least_squares(misfit, y, slopes, bounds.T, max_nfev=_MOST, **ends)
        y = found.x
    if not found.success:
        raise InputError(f"the numbers are not found in {_MOST} steps; begin nearer (--set), or give bounds")
    _, sizes, directions = np.linalg.svd(found.jac, full_matrices=False)
    if not sizes[-1] > _UNTOLD * max(sizes[0], 1.0):
        worst = several[int(np.argmax(np.abs(directions[-1])))].name
        raise InputError(f"{worst}: the measured values do not determine it; fix it, or measure what depends on it")
    free = found.fun.size - start.size
    variance = float(found.fun @ found.fun) / free if free else 0.0
    covariance = variance * (directions.T / sizes**2) @ directions
    return Identified(
        found.x * size,
        covariance * np.outer(size, size),
        answer(found.x).values,
        float(np.sqrt(np.mean(found.fun**2))),
    )
