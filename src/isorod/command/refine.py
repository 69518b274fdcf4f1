"""Refinement of a scene's spaces until the error of what it measures is estimated to be within a tolerance."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

from isorod.checks import adapt
from isorod.command import solving
from isorod.errors import InputError
from isorod.space.space import Space


class Refined(NamedTuple):
    """A scene on refined spaces, and its solution.

    Attributes
    ----------
    scene, solution, seconds
        The scene, its solution, and the wall time of its run.
    error
        Estimate of its relative error (`isorod.checks.estimate`).
    history
        What was changed so far of the first space refined, with the error before: ``(name, value, error before)``.
    short
        Why the error is not within the tolerance; empty if it is.
    """

    scene: Any
    solution: Any
    seconds: dict[str, float]
    error: float
    history: list[tuple[str, int, float]]
    short: str


def refine(scene: Any, settings: Mapping[str, Any], tolerance: float) -> Refined:
    """Refine a scene's spaces until the estimate of its error is within a tolerance (`isorod.checks.adapt`).

    Parameters
    ----------
    scene
        The scene of a file, or one with ``order``, ``section_points``, ``section_degree``, ``degree`` and ``elements``
        or ``elements_per_turn``.
    settings
        Keyword arguments of the scene's analysis.
    tolerance
        Relative error to reach.

    Raises
    ------
    InputError
        If the tolerance is out of range, the quadrature does not follow the space, or the error has no estimate.
    SolveError
        If the scene on its first spaces cannot be solved.
    """
    adapt.check(tolerance)
    model = scene.model()
    if model.solids:
        raise InputError("--tolerance: the meshes of finite element bodies are not refined; compare with finer meshes")
    spaces = [body.space for body in model.bodies]
    for space in spaces:
        if "quadrature" not in space.chosen and space.quadrature not in ("auto", "full"):
            raise InputError(
                f"quadrature: got {space.quadrature!r}, refinement needs a rule that follows the space: auto or full"
            )
    solved: dict[int, tuple[Any, dict[str, float]]] = {}
    begin, remembers = None, model.remembers and scene.analysis == "statics"
    # Half of the tolerance is for the spaces, half for the load steps, which are few while spaces are refined.
    spaces_tolerance = 0.5 * tolerance if remembers else tolerance
    few = {"load_steps": 1, **settings} if remembers else settings

    def solve(spaces: Sequence[Space], settings: Mapping[str, Any] = few) -> Any:
        nonlocal begin
        refined = scene.on(spaces)
        solution, seconds = solving.solve(refined, settings, begin)
        solved[id(solution)] = refined, seconds
        # Contact takes several times as long from the state of rest.
        begin = partial(solving.start_at, solution) if model.contacts else None
        return solution

    first = [_start(space, spaces_tolerance) for space in spaces]
    solution, reached, steps, short = adapt.reach(solve, first, spaces_tolerance, bool(scene.stresses))
    history = [(name, value, before.error) for before, step in pairwise(steps) for name, value in step.changed.items()]
    refined, seconds = solved[id(solution)]
    if scene.analysis == "modal" and (bound := solution.contact_error()) > tolerance:
        warnings.warn(
            f"estimated error of the spaces alone; compliance of under-resolved contact patches may change frequencies "
            f"by up to {100.0 * bound:.2g} % more",
            stacklevel=2,
        )
    error = steps[-1].error
    if remembers:
        solution = solve(reached, {"steps_tolerance": spaces_tolerance, **settings})
        refined, seconds = solved[id(solution)]
        error += solution.steps_error
        if error > tolerance:
            short = adapt.short(tolerance, error, len(steps) - 1, "" if short else "; most of it by few load steps")
        else:
            short = ""
    return Refined(refined, solution, seconds, error, history, short)


def _start(space: Space, tolerance: float) -> Space:
    """Return a space whose section, if it was chosen, misses as much as the tolerance lets it."""
    if not ({"section_degree", "section_points"} & {*space.chosen}):
        return space
    rule = None if "quadrature" in space.chosen else space.quadrature
    section: dict[str, Any] = dict.fromkeys(("order", "section_points", "section_degree"))
    return replace(space, quadrature=rule, **section | adapt.section(space.rod, tolerance))
