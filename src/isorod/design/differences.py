"""Derivatives as finite differences of solutions at neighbouring parameters, where exact ones are not available.

That is so where results depend on the load path: with friction where contact alone holds a body, contact of laws with
memory, follower loads with contact, where an increment does not converge again or has no derivative; and with finite
element bodies.  Neighbouring solutions use the same discretisation (`isorod.choices`) and load steps, so that their
errors cancel in differences.  Two solutions make a derivative.  Two more, at twice the distance, estimate its error:
truncation goes with the square of the step, the error left by contact (some 1e-7 of a force) with its inverse.
"""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError, SolveError
from isorod.model.model import Model
from isorod.statics.derivatives import numbers
from isorod.statics.differences import Derivatives, Measured, PerturbedModels, Steps, Unavailable, largest, silently

# Relative step of a parameter, to both sides, or to one side where the other has no solution.
APART = 2e-3
_PLACES, _BOTH = ((-1, 1), (1, 2), (-1, -2)), (-2, -1, 1, 2)

# Errors are relative to the derivative, but at least to this fraction of result / parameter.
_NOTHING = 1e-2

# Where an increment has no derivative at the solution, as a point is about to yield, differences with a larger relative
# error are discarded too.
_KINKED = 0.1

Make = Callable[[Mapping[str, float]], Model]
Measure = Callable[[Any], Mapping[str, object]]
Solve = Callable[[Model, Any], Any]


def solve_beside(scene: Any, model: Model, settings: Mapping[str, Any], near: Any, first: Any) -> Any:
    """Return the solution of a model near another, in statics by the load steps of ``first`` where the path matters."""
    settings = dict(settings)
    if scene.analysis == "statics":
        # With finite element bodies the displacement of the rods alone is no initial guess.
        settings |= {"like": first, "start": None if model.solids else near.displacement}
    with silently():
        return import_module(f"isorod.{scene.analysis}").solve(model, **settings)


def derivatives(
    solution: Any,
    make: Make,
    at: Mapping[str, float],
    measure: Measure,
    solve: Solve,
    sure: bool = False,
    begin: Callable[[str, int], None] | None = None,
) -> Derivatives:
    """Return derivatives of the results of a solution: exact ones where available, else finite differences.

    Parameters
    ----------
    solution, make, at, measure
        As of `isorod.statics.derivatives.derivatives`.
    solve
        Returns the solution of a model near another solution.
    sure
        Whether errors of differences are estimated, by two more solutions for each parameter.
    begin
        Receives, before the first of them, the reason for differences and the number of solves.

    Raises
    ------
    InputError
        If a parameter is zero, or changed models have other degrees of freedom.
    """
    try:
        exact = solution.derivatives(make, at, measure)
        # Somewhere on the path a point is about to yield, slip or touch, or an increment does not converge.
        missing = exact.none if _counts(solution.model) else {}
        why = next((f"not available by {name} everywhere ({reason})" for name, reason in missing.items()), "")
    except (Unavailable, SolveError) as problem:
        with silently():
            exact = Derivatives(dict(at), numbers(measure(solution)), {})
        missing, why = dict.fromkeys(at, ""), str(problem).removeprefix("derivatives: ").partition(";")[0]
    if not missing:
        return exact
    if begin is not None:
        begin(why, (4 if sure else 2) * len(missing))

    def evaluate(model: Model) -> Measured:
        with silently():
            return numbers(measure(solve(model, solution)))

    beside, rates, errors = PerturbedModels(make, at, solution.model), dict(exact.by), dict[str, Mapping[str, float]]()
    none = {name: reason for name, reason in exact.none.items() if name not in missing}
    for name, kink in missing.items():
        try:
            slopes, errors[name] = _by(name, beside, exact.values, evaluate, sure)
        except (InputError, SolveError) as problem:
            none[name] = f"models beside it cannot be solved: {problem}"
            continue
        if kink and max(errors[name].values(), default=0.0) > _KINKED:
            none[name] = kink
        else:
            rates[name] = slopes
    return Derivatives(
        exact.parameters,
        exact.values,
        {name: rates[name] for name in at if name in rates},
        none,
        {name: reason for name, reason in errors.items() if name not in none},
        why,
        exact.means,
    )


def _counts(model: Model) -> bool:
    """Return whether results depend on the load path."""
    return bool(getattr(model, "remembers", False) or any(one.friction for one in model.contacts))


def _by(
    name: str, beside: PerturbedModels, values: Measured, evaluate: Callable[[Model], Measured], sure: bool
) -> tuple[Measured, dict[str, float]]:
    """Return the derivatives by a parameter, and their estimated errors."""
    size, known, problem = abs(beside.at[name]), dict[int, Measured](), None
    step = APART * size

    def slopes(weights: Array, offsets: Sequence[int]) -> Measured:
        for key in offsets:
            if key not in known:
                known[key] = evaluate(beside.model(name, key * step))
        rows = [known[key] for key in offsets]
        if any(row[key].shape != value.shape for row in rows for key, value in values.items()):
            raise SolveError("neighbouring solutions take more load steps")
        return {
            key: np.einsum("i,i...->...", weights, np.array([row[key] for row in rows]) - value)
            for key, value in values.items()
        }

    for offsets in _PLACES:
        try:
            fine = slopes(Steps(offsets, step, size).weights, offsets)
            if not sure:
                return fine, {}
            twice = [2 * key for key in offsets]
            coarse = slopes(Steps(twice, step, size).weights, twice)
        except (InputError, SolveError) as one:
            problem = problem or one
            continue
        off = {one: largest(coarse[one] - fine[one]) for one in values}
        if offsets == (-1, 1):
            # At a kink both central differences are the mean of the one-sided slopes.
            jumps = slopes(Steps(_BOTH, step, size).jumps, _BOTH)
            off = {one: max(off[one], largest(jumps[one])) for one in values}
        sizes = {one: max(largest(fine[one]), _NOTHING * largest(value) / size) for one, value in values.items()}
        return fine, {one: off[one] / (sizes[one] or 1.0) for one in values}
    assert problem is not None
    raise problem
