"""Parameters of a scene from measured curves, by least squares with exact derivatives (SciPy's ``least_squares``)."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from isorod.arrays import Array
from isorod.design.constraints import Variable
from isorod.design.curves import Curve
from isorod.design.evaluations import Evaluations, Results
from isorod.errors import InputError

# Relative tolerance on parameters, misfit and gradient.
_ALIKE = 1e-10
_MOST = 50

# The second round uses a discretisation chosen for the parameters of the first.
_ROUNDS = 2

# A parameter is not identifiable if the smallest singular value of the scaled Jacobian is below this fraction of the
# largest, or of one: changing the parameter by its own size then changes the results by less than this fraction.
_DEPENDENT = 1e-7


class Identified(NamedTuple):
    """The identified parameters.

    Attributes
    ----------
    x, covariance
        The parameters, ``(n,)``, and their covariance, estimated from the residuals.
    results
        Results of the scenes of all points, by name.
    misfit
        Root mean square of the residuals, relative to each column's largest value.
    """

    x: Array
    covariance: Array
    results: Mapping[str, float]
    misfit: float


def identify(
    evaluations: Evaluations, variables: Sequence[Variable], table: Curve, report: Callable[[str], None]
) -> Identified:
    """Return the parameters with which scenes, one for each point, fit the measured results best.

    Raises
    ------
    InputError
        If the curves do not determine a parameter.
    """
    start = np.array([one.start for one in variables])
    size = np.abs(start)
    bounds = np.array([(one.lower, one.upper) for one in variables]) / size[:, None]
    known: dict[bytes, Results] = {}

    def evaluate(y: Array) -> Results:
        key = np.ascontiguousarray(y).tobytes()
        if key not in known:
            known[key] = evaluations.evaluate(y * size)
        return known[key]

    def misfit(y: Array) -> Array:
        residuals = table.off(evaluate(y).values)
        report(f"solve {evaluations.solves}: misfit {np.sqrt(np.mean(residuals**2)):.3g}")
        return residuals

    def slopes(y: Array) -> Array:
        return table.slopes(evaluations.derivatives(y * size, evaluate(y))) * size

    y, tolerances = start / size, {"xtol": _ALIKE, "ftol": _ALIKE, "gtol": _ALIKE}
    for _ in range(_ROUNDS):
        known.clear()
        known[np.ascontiguousarray(y).tobytes()] = evaluations.freeze(y * size)
        fit = least_squares(misfit, y, slopes, bounds.T, max_nfev=_MOST, **tolerances)
        y = fit.x
    if not fit.success:
        raise InputError(f"the fit does not converge in {_MOST} steps; begin nearer (--set), or give bounds")
    _, sizes, directions = np.linalg.svd(fit.jac, full_matrices=False)
    if not sizes[-1] > _DEPENDENT * max(sizes[0], 1.0):
        worst = variables[int(np.argmax(np.abs(directions[-1])))].name
        raise InputError(f"{worst}: the measured values do not determine it; fix it, or measure what depends on it")
    free = fit.fun.size - start.size
    variance = float(fit.fun @ fit.fun) / free if free else 0.0
    covariance = variance * (directions.T / sizes**2) @ directions
    return Identified(
        fit.x * size,
        covariance * np.outer(size, size),
        evaluate(fit.x).values,
        float(np.sqrt(np.mean(fit.fun**2))),
    )
