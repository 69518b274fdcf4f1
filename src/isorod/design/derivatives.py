"""Derivatives of what a scene measures by its parameters."""

import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from isorod.design import differences, parameters
from isorod.errors import InputError
from isorod.output.words import duration

if TYPE_CHECKING:
    from isorod.model.model import Model
    from isorod.statics.differences import Derivatives

# What takes longer is announced, in seconds; a derivative that is known less well is warned of.
LONG, UNSURE = 10.0, 0.01

# Keyword arguments of a run that differences of it do not have.
_ALONE = ("checkpoint", "every", "resume", "progress")


def refuse(scene: Any) -> None:
    """Raise `InputError` for analyses whose answers are not differentiated."""
    if scene.analysis not in ("statics", "modal"):
        raise InputError(f"derivatives: not available in {scene.analysis}; they are in statics and modal")


def of(
    scene: Any,
    solution: Any,
    names: "Mapping[str, float] | None" = None,
    settings: Mapping[str, Any] | None = None,
    tell: Callable[[str], None] | None = None,
) -> "Derivatives":
    """Return the derivatives of what a scene measures of its solution, by parameters of it.

    Where those at the solution are not available in statics, as with friction, they are differences of answers, four
    for each parameter (`isorod.design.differences`); one that they tell to more than 1 % is warned of.

    Parameters
    ----------
    scene, solution
        The scene, and what was solved of it.
    names
        Parameters with their values; all where not given.
    settings
        Keyword arguments of the analysis; those of the scene where not given.
    tell
        Is told how many solves there will be, where these take long.

    Raises
    ------
    InputError
        If there are none (`isorod.statics.derivatives.derivatives`).
    """
    refuse(scene)
    asked = parameters.parameters(scene) if names is None else names
    given = scene.settings() if settings is None else settings
    given = {name: value for name, value in given.items() if name not in _ALONE}

    def make(values: Mapping[str, float]) -> "Model":
        model: Model = parameters.at(scene, values).model()
        return model

    def solve(model: "Model", near: Any) -> Any:
        return differences.solve_beside(scene, model, given, near, solution)

    def begin(why: str, count: int) -> None:
        seconds = count * sum(solution.seconds.values())
        if tell is not None and seconds > LONG:
            tell(f"derivatives by differences of answers ({why}): {count} solves, some {duration(seconds)}")

    with scene.locating():
        if scene.analysis == "modal":
            # Of frequencies that cross, as those of round rods, differences are of now one and now the other.
            return solution.derivatives(make, asked, scene.measure)  # type: ignore[no-any-return]
        found = differences.derivatives(solution, make, asked, scene.measure, solve, True, begin)
    off = sorted(
        (error, one, name) for name, errors in found.errors.items() for one, error in errors.items() if error > UNSURE
    )
    if off:
        worst, one, name = off[-1]
        more = f", the worst of {len(off)} that are known less well than to 1 %" if len(off) > 1 else ""
        warnings.warn(
            f"derivative of {one} by {name}: differences of answers are {100.0 * worst:.2g} % apart{more}", stacklevel=2
        )
    return found
