"""Refinement of a scene's space, and an estimate of the error of what the scene measures.

The spaces nest, so the change of a quantity when the space is refined in one direction - polyharmonic order and section
points or the degree of polynomials across the section, degree, elements - tells how much that direction contributes to
its error.  The estimate is the sum of the changes.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.checks import adapt
from isorod.checks.adapt import MAX_STEPS, MAX_UNKNOWNS
from isorod.command import run
from isorod.errors import InputError, SolveError
from isorod.geometry.axis import MAX_DEGREE
from isorod.geometry.disk import MAX_COUNT
from isorod.space.polyharmonic import MAX_ORDER
from isorod.space.polynomial import MAX_DEGREE as MAX_SECTION_DEGREE
from isorod.space.space import Space


def finer(scene: Any) -> dict[str, Any]:
    """Return the scene on the next finer space in each direction, by the name of its option."""
    found: dict[str, int] = {}
    if scene.section_degree is not None:
        if scene.section_degree < MAX_SECTION_DEGREE:
            found["section_degree"] = scene.section_degree + 1
    else:
        if scene.order < MAX_ORDER:
            found["order"] = scene.order + 1
        if 2 * scene.section_points <= MAX_COUNT:
            found["section_points"] = 2 * scene.section_points
    if scene.degree < MAX_DEGREE:
        found["degree"] = scene.degree + 1
    name = "elements" if hasattr(scene, "elements") else "elements_per_turn"
    found[name] = 2 * getattr(scene, name)
    ahead = {name: dataclasses.replace(scene, **{name: value}) for name, value in found.items()}
    if "degree" in ahead and scene.continuity is None:
        # With the continuity that goes with the higher degree the spaces would not nest.
        ahead["degree"] = dataclasses.replace(ahead["degree"], continuity=scene.degree - 1)
    return ahead


@dataclasses.dataclass(frozen=True, eq=False)
class Estimate:
    """A solved scene with an estimate of its relative error.

    Attributes
    ----------
    scene, solution, seconds
        The scene, its solution, and the wall time of its run.
    error
        Estimate of the largest relative error of the quantities measured: the sum of the changes.
    changes
        Largest relative change when the space is refined in one direction, by the direction; empty where a tolerance
        was reached, by the error's own estimate.
    history
        Options changed so far, with the error before: ``(option, value, error before)``.
    """

    scene: Any
    solution: Any
    seconds: dict[str, float]
    error: float
    changes: dict[str, float]
    history: list[tuple[str, int, float]]


def estimate(scene: Any, settings: Mapping[str, Any], tolerance: float | None = None) -> Estimate:
    """Estimate a scene's error by refining its space in each direction, or refine until it is below a tolerance.

    To a tolerance the estimate of `isorod.checks.estimate` leads (`isorod.checks.adapt`); with contact, which has none,
    the changes do: each step refines in the direction with the largest for its cost (work of a banded factorisation).

    Parameters
    ----------
    scene
        A scene with ``order``, ``section_points``, ``section_degree``, ``degree`` and ``elements`` or
        ``elements_per_turn``.
    settings
        Keyword arguments of the scene's analysis.
    tolerance
        Relative error to reach; None for an estimate of the scene as it is.

    Raises
    ------
    InputError
        If the tolerance is out of range, or the quadrature does not follow the space.
    SolveError
        If the tolerance is not reached within 24 refinements or 400,000 unknowns.
    """
    if tolerance is not None:
        adapt.check(tolerance)
    if scene.quadrature not in ("auto", "full", None):
        raise InputError(
            f"quadrature: got {scene.quadrature!r}, refinement needs a rule that follows the space: auto or full"
        )
    if tolerance is not None and scene.order is None and scene.section_degree is None and _free(scene):
        # A section that may miss as much as the tolerance lets it.
        scene = replace(scene, **adapt.section(scene.rod(), tolerance))
    model = scene.model()
    space = model.bodies[0].space
    if tolerance is not None and not model.contacts:
        return _reach(scene, settings, space, tolerance)
    if {"degree", "elements"} & {*space.chosen}:
        scene = on(scene, replace(space, quadrature=scene.quadrature or "auto"))
    solved: dict[Any, tuple[Any, dict[str, float]]] = {}
    history: list[tuple[str, int, float]] = []

    def solve(one: Any) -> tuple[Any, dict[str, float]]:
        if one not in solved:
            solved[one] = run.solve(one, settings)
        return solved[one]

    for _ in range(MAX_STEPS + 1):
        solution, seconds = solve(scene)
        here = _quantities(scene, solution)
        ahead = finer(scene)
        changes, gains = {}, {}
        for name, one in ahead.items():
            other, _ = solve(one)
            changes[name] = float(np.max(np.abs(_quantities(one, other) / here - 1.0)))
            gains[name] = changes[name] / (_work(other) - _work(solution))
        error = sum(changes.values())
        if tolerance is None or error <= tolerance:
            return Estimate(scene, solution, seconds, error, changes, history)
        best = max(gains, key=lambda name: gains[name])
        if solved[ahead[best]][0].model.dofs > MAX_UNKNOWNS:
            break
        history.append((best, getattr(ahead[best], best), error))
        scene = ahead[best]
    raise SolveError(
        f"tolerance {tolerance:g} is not reached: the estimate is {error:.2g} after {len(history)} refinements"
    )


def on(scene: Any, space: Space) -> Any:
    """Return the scene on a space of its rod."""
    names = {field.name for field in dataclasses.fields(scene)}
    kept = ("order", "section_degree", "degree", "continuity", "quadrature")
    fields = {name: getattr(space, name) for name in kept if name in names}
    if space.section_degree is None:
        fields["section_points"] = space.points_around
    elements = space.axis.elements
    fields |= {"elements": elements} if "elements" in names else {"elements_per_turn": elements // scene.coils}
    return replace(scene, **fields)


def _reach(scene: Any, settings: Mapping[str, Any], space: Space, tolerance: float) -> Estimate:
    """Refine until the estimate is below the tolerance."""
    tried: dict[int, tuple[Any, dict[str, float]]] = {}

    def solve(space: Space) -> Any:
        one = on(scene, space)
        solution, seconds = run.solve(one, settings)
        tried[id(solution)] = one, seconds
        return solution

    solution, _, steps = adapt.reach(solve, space, tolerance)
    history = [
        (name if hasattr(scene, name) else "elements_per_turn", value, before.error)
        for before, step in pairwise(steps)
        for name, value in step.changed.items()
    ]
    one, seconds = tried[id(solution)]
    return Estimate(one, solution, seconds, steps[-1].error, {}, history)


def _free(scene: Any) -> bool:
    """Return whether control points round the section are not asked for: those of a spring are its shape's."""
    return hasattr(scene, "elements_per_turn") or scene.section_points is None


def _quantities(scene: Any, solution: Any) -> Array:
    """Return what the scene measures as one vector."""
    return np.concatenate([np.atleast_1d(np.asarray(value, float)) for value in scene.measure(solution).values()])


def _work(solution: Any) -> float:
    """Return the work of a banded factorisation, up to a factor: unknowns times the square of an element's."""
    return float(sum(3 * body.space.nodes * body.space.element_nodes.shape[1] ** 2 for body in solution.model.bodies))
