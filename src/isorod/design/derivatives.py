"""Derivatives of a scene's results with respect to its parameters."""

import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from isorod.design import differences, parameters
from isorod.errors import InputError
from isorod.output.words import duration

if TYPE_CHECKING:
    from isorod.model.model import Model
    from isorod.statics.differences import Derivatives

# Solves that take longer, in seconds, are announced; a derivative with a larger relative error is warned of.
LONG, UNSURE = 10.0, 0.01

# Keyword arguments of a run that its finite differences do not take.
_ALONE = ("checkpoint", "every", "resume", "progress")


def refuse(scene: Any) -> None:
    """Raise `InputError` for analyses whose results have no derivatives."""
    if scene.analysis not in ("statics", "modal"):
        raise InputError(f"derivatives: not available in {scene.analysis}; they are in statics and modal")


def of(
    scene: Any,
    solution: Any,
    names: "Mapping[str, float] | None" = None,
    settings: Mapping[str, Any] | None = None,
    report: Callable[[str], None] | None = None,
) -> "Derivatives":
    """Return the derivatives of a scene's results with respect to its parameters.

    Where statics has no exact ones, as with friction, they are finite differences of four solves for each parameter
    (`isorod.design.differences`); an estimated error of more than 1 % is warned of.

    Parameters
    ----------
    scene, solution
        The scene and its solution.
    names
        Parameters with their values; all where not given.
    settings
        Keyword arguments of the analysis; those of the scene where not given.
    report
        Receives a message with the number of solves, where these take long.

    Raises
    ------
    InputError
        If there are none (`isorod.statics.derivatives.derivatives`).
    """
    refuse(scene)
    parameters_at = parameters.parameters(scene) if names is None else names
    arguments = scene.settings() if settings is None else settings
    arguments = {name: value for name, value in arguments.items() if name not in _ALONE}

    def make(values: Mapping[str, float]) -> "Model":
        model: Model = parameters.at(scene, values).model()
        return model

    def solve(model: "Model", near: Any) -> Any:
        return differences.solve_beside(scene, model, arguments, near, solution)

    def begin(why: str, count: int) -> None:
        seconds = count * sum(solution.seconds.values())
        if report is not None and seconds > LONG:
            report(f"derivatives by finite differences ({why}): {count} solves, some {duration(seconds)}")

    with scene.locating():
        if scene.analysis == "modal":
            # No differences: where frequencies cross, as those of round rods, they would mix different modes.
            return solution.derivatives(make, parameters_at, scene.measure)  # type: ignore[no-any-return]
        rates = differences.derivatives(solution, make, parameters_at, scene.measure, solve, True, begin)
    uncertain = sorted(
        (error, result, name)
        for name, errors in rates.errors.items()
        for result, error in errors.items()
        if error > UNSURE
    )
    if uncertain:
        worst, result, name = uncertain[-1]
        more = f", the worst of {len(uncertain)} that are known less well than to 1 %" if len(uncertain) > 1 else ""
        warnings.warn(
            f"derivative of {result} by {name}: finite differences are {100.0 * worst:.2g} % apart{more}",
            stacklevel=2,
        )
    return rates
