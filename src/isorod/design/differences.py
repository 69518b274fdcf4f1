"""Derivatives of answers as differences of whole answers beside, where those at the answer alone are not available.

That is so where the path counts: with friction where contact alone holds a body, contact of laws with memory, pressures
that follow with contact, where an increment is not balanced once more or has no derivative; and with finite element
bodies.  Answers beside are on the same discretisation (`isorod.choices`), and take the load steps of the answer, so
that a difference has none of the errors of either.  Two make a derivative.  Two more, twice as far off, say how well it
is known: errors go with the square of the step, and what contact leaves of its search, some 1e-7 of a force, over it.
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

# Answers are at this share of a parameter to both sides, or on one where there are none on the other.
APART = 2e-3
_PLACES, _BOTH = ((-1, 1), (1, 2), (-1, -2)), (-2, -1, 1, 2)

# A derivative whose parameter changes what is measured by less than this share of it, as a whole, is as none.
_NOTHING = 1e-2

# Where an increment has no derivative at the answer itself, as a point there is about to yield, differences that are
# further apart than this are none either.
_KINKED = 0.1

Make = Callable[[Mapping[str, float]], Model]
Measure = Callable[[Any], Mapping[str, object]]
Solve = Callable[[Model, Any], Any]


def solve_beside(scene: Any, model: Model, settings: Mapping[str, Any], near: Any, first: Any) -> Any:
    """Return the answer of a model near another, in statics by the load steps of a first where the path counts."""
    settings = dict(settings)
    if scene.analysis == "statics":
        # Of finite element bodies a displacement of rods alone is no state that is near.
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
    """Return derivatives of what is measured of an answer: of its own where it has them, else differences.

    Parameters
    ----------
    solution, make, at, measure
        As of `isorod.statics.derivatives.derivatives`.
    solve
        Returns the answer of a model beside another answer.
    sure
        Whether errors of differences are estimated, by two more answers for each parameter.
    begin
        Receives, before the first of them, the reason for differences and the number of answers to solve for.

    Raises
    ------
    InputError
        If a parameter is zero, or the models that are made are others.
    """
    try:
        exact = solution.derivatives(make, at, measure)
        # Somewhere on the path a point is about to yield, or slip, or touch, or an increment is not found.
        left = exact.none if _counts(solution.model) else {}
        why = next((f"not available by {name} everywhere ({one})" for name, one in left.items()), "")
    except (Unavailable, SolveError) as problem:
        with silently():
            exact = Derivatives(dict(at), numbers(measure(solution)), {})
        left, why = dict.fromkeys(at, ""), str(problem).removeprefix("derivatives: ").partition(";")[0]
    if not left:
        return exact
    if begin is not None:
        begin(why, (4 if sure else 2) * len(left))

    def answer(model: Model) -> Measured:
        with silently():
            return numbers(measure(solve(model, solution)))

    beside, found, errors = PerturbedModels(make, at, solution.model), dict(exact.by), dict[str, Mapping[str, float]]()
    none = {name: one for name, one in exact.none.items() if name not in left}
    for name, kink in left.items():
        try:
            rates, errors[name] = _by(name, beside, exact.values, answer, sure)
        except (InputError, SolveError) as problem:
            none[name] = f"models beside it cannot be solved: {problem}"
            continue
        if kink and max(errors[name].values(), default=0.0) > _KINKED:
            none[name] = kink
        else:
            found[name] = rates
    return Derivatives(
        exact.parameters,
        exact.values,
        {name: found[name] for name in at if name in found},
        none,
        {name: one for name, one in errors.items() if name not in none},
        why,
        exact.means,
    )


def _counts(model: Model) -> bool:
    """Return whether the path to an answer counts."""
    return bool(getattr(model, "remembers", False) or any(one.friction for one in model.contacts))


def _by(
    name: str, beside: PerturbedModels, values: Measured, answer: Callable[[Model], Measured], sure: bool
) -> tuple[Measured, dict[str, float]]:
    """Return the derivatives by a parameter, and their estimated errors."""
    size, known, problem = abs(beside.at[name]), dict[int, Measured](), None
    step = APART * size

    def slopes(weights: Array, offsets: Sequence[int]) -> Measured:
        for one in offsets:
            if one not in known:
                known[one] = answer(beside.model(name, one * step))
        rows = [known[one] for one in offsets]
        if any(row[one].shape != value.shape for row in rows for one, value in values.items()):
            raise SolveError("answers beside take more load steps")
        return {
            one: np.einsum("i,i...->...", weights, np.array([row[one] for row in rows]) - value)
            for one, value in values.items()
        }

    for offsets in _PLACES:
        try:
            fine = slopes(Steps(offsets, step, size).weights, offsets)
            if not sure:
                return fine, {}
            twice = [2 * one for one in offsets]
            coarse = slopes(Steps(twice, step, size).weights, twice)
        except (InputError, SolveError) as one:
            problem = problem or one
            continue
        off = {one: largest(coarse[one] - fine[one]) for one in values}
        if offsets == (-1, 1):
            # Where slopes jump both are a mean of them.
            jumps = slopes(Steps(_BOTH, step, size).jumps, _BOTH)
            off = {one: max(off[one], largest(jumps[one])) for one in values}
        sizes = {one: max(largest(fine[one]), _NOTHING * largest(value) / size) for one, value in values.items()}
        return fine, {one: off[one] / (sizes[one] or 1.0) for one in values}
    assert problem is not None
    raise problem
