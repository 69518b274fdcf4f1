"""Numbers of a scene from measured curves, by least squares with exact derivatives (SciPy's ``least_squares``)."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from isorod.arrays import Array
from isorod.design import parameters
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


class Curve(NamedTuple):
    """A table of measured points: numbers that are set in each, and what was measured there, by name, ``(points,)``."""

    given: Mapping[str, Array]
    measured: Mapping[str, Array]


class Identified(NamedTuple):
    """What was found.

    Attributes
    ----------
    x, covariance
        The numbers, ``(n,)``, and their covariance, by what is left of the misfit.
    fitted
        What is answered, by name, as in the curve.
    misfit
        Root of the mean square, each column by its largest value.
    """

    x: Array
    covariance: Array
    fitted: Mapping[str, Array]
    misfit: float


def curve(rows: Mapping[str, Array], scene: Any, several: Sequence[Vary]) -> Curve:
    """Return the columns of a table, by whether they are numbers of the scene or measured; raises `InputError`."""
    known, varied = parameters.parameters(scene), [one.name for one in several]
    given = {name: column for name, column in rows.items() if name in known}
    answers = [name for name in scene.units if name not in known]
    taken = [name for name in given if name in varied]
    if taken:
        raise InputError(f"{taken[0]}: it cannot both vary and be given in the table")
    found = {name: column for name, column in rows.items() if name not in given}
    strange = next((name for name in found if name.partition("[")[0] not in answers), None)
    if strange is not None:
        raise InputError(
            f"column {strange!r} is no number of the scene, nor measured; there are: {', '.join([*answers, *known])}"
        )
    if not found:
        raise InputError(f"the table has no column of what is measured: {', '.join(answers)}")
    size = len(next(iter(found.values())))
    if size * len(found) < len(several):
        raise InputError(f"{size * len(found)} measured values for {len(several)} numbers; need at least as many")
    for name, column in rows.items():
        if not np.isfinite(column).all():
            raise InputError(f"column {name!r}: got a value that is no number")
    return Curve(given, found)


def scenes_of(scene: Any, table: Curve) -> dict[str, Any]:
    """Return a scene for each point."""
    size = len(next(iter(table.measured.values())))
    rows = [{name: float(column[k]) for name, column in table.given.items()} for k in range(size)]
    return {str(k): parameters.at(scene, row) if row else scene for k, row in enumerate(rows)}


def identify(
    evaluations: Evaluations, several: Sequence[Vary], table: Curve, tell: Callable[[str], None]
) -> Identified:
    """Return the numbers with which scenes, one a point, answer as was measured.

    Raises
    ------
    InputError
        If the curves do not tell a number.
    """
    start = np.array([one.start for one in several])
    size = np.abs(start)
    bounds = np.array([(one.lower, one.upper) for one in several]) / size[:, None]
    largest = {name: float(np.abs(column).max()) or 1.0 for name, column in table.measured.items()}
    answers: dict[bytes, Answer] = {}

    def answer(y: Array) -> Answer:
        key = np.ascontiguousarray(y).tobytes()
        if key not in answers:
            answers[key] = evaluations.answer(y * size)
        return answers[key]

    def values(y: Array) -> dict[str, Array]:
        found = answer(y).values
        return {name: np.array([found[f"{k}.{name}"] for k in range(len(one))]) for name, one in table.measured.items()}

    def misfit(y: Array) -> Array:
        parts = [(values(y)[name] - wanted) / largest[name] for name, wanted in table.measured.items()]
        found = np.concatenate(parts)
        tell(f"solve {evaluations.solves}: misfit {np.sqrt(np.mean(found**2)):.3g}")
        return found

    def slopes(y: Array) -> Array:
        rates = evaluations.derivatives(y * size, answer(y))
        rows = [
            rates[f"{k}.{name}"] * size / largest[name] for name, one in table.measured.items() for k in range(len(one))
        ]
        return np.array(rows)

    y, ends = start / size, {"xtol": _ALIKE, "ftol": _ALIKE, "gtol": _ALIKE}
    for _ in range(_ROUNDS):
        evaluations.freeze(y * size)
        answers.clear()
        found = least_squares(misfit, y, slopes, bounds.T, max_nfev=_MOST, **ends)
        y = found.x
    if not found.success:
        raise InputError(f"the numbers are not found in {_MOST} steps; begin nearer (--set), or give bounds")
    _, sizes, directions = np.linalg.svd(found.jac, full_matrices=False)
    if not sizes[-1] > _UNTOLD * max(sizes[0], 1.0):
        worst = several[int(np.argmax(np.abs(directions[-1])))].name
        raise InputError(f"{worst}: the measured values do not tell it; leave it out, or measure what depends on it")
    free = found.fun.size - start.size
    variance = float(found.fun @ found.fun) / free if free else 0.0
    covariance = variance * (directions.T / sizes**2) @ directions
    return Identified(
        found.x * size,
        covariance * np.outer(size, size),
        values(found.x),
        float(np.sqrt(np.mean(found.fun**2))),
    )
