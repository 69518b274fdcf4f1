"""Refinement of a scene's space, and an estimate of the error of what the scene measures.

The spaces nest, so the change of a quantity when the space is refined in one direction - polyharmonic order and section
points or the degree of polynomials across the section, degree, elements - tells how much that direction contributes to
its error.  The estimate is the sum of the changes.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from isorod.checks import adapt
from isorod.checks.adapt import MAX_STEPS, MAX_UNKNOWNS
from isorod.command import solving
from isorod.errors import InputError, SolveError
from isorod.geometry.axis import MAX_DEGREE
from isorod.geometry.disk import MAX_COUNT
from isorod.memory import SHORT
from isorod.space.polyharmonic import MAX_ORDER
from isorod.space.polynomial import MAX_DEGREE as MAX_SECTION_DEGREE
from isorod.space.space import Space

# What is so small a share of the largest force or displacement is none, if it changes by more than so much of itself.
_NOTHING, _WHOLE = 1e-9, 0.1

# What scenes and spaces call the number of elements.
_ALONG = "elements", "elements_per_turn", "parts"

# Directions whose change is at least this share of the largest are refined, the one with most for its cost first: an
# order or a degree is cheap, and where a patch has too few points no other direction helps.
_MARKED = 0.5

# Share of a change to which refinement of its direction makes it fall, or is trusted less, so much each time.
_FALLS, _DOUBTED = 0.7, 0.1


def finer(scene: Any) -> dict[str, Any]:
    """Return the scene on the next finer space in each direction, by the name of its option.

    The scene of a file has to be on spaces of its own (`isorod.files.scene.FileScene.on`).
    """
    if hasattr(scene, "content"):
        return _finer_file(scene)
    found = _ahead(scene)
    return {name: replace(scene, **{name: value}) for name, value in found.items()}


def _finer_file(scene: Any) -> dict[str, Any]:
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for rod, space in scene.spaces.items():
        for name, value in _ahead(SimpleNamespace(**space)).items():
            found.setdefault(name, {})[rod] = space | {name: value}
    return {name: replace(scene, spaces=scene.spaces | rods) for name, rods in found.items()}


def _ahead(one: Any) -> dict[str, int]:
    """Return the next finer number in each direction of a scene, or of a space."""
    found: dict[str, int] = {}
    if (section_degree := getattr(one, "section_degree", None)) is not None:
        if section_degree < MAX_SECTION_DEGREE:
            found["section_degree"] = section_degree + 1
    else:
        if one.order < MAX_ORDER:
            found["order"] = one.order + 1
        if 2 * one.section_points <= MAX_COUNT:
            found["section_points"] = 2 * one.section_points
    if one.degree < MAX_DEGREE:
        found["degree"] = one.degree + 1
    name = next(name for name in _ALONG if hasattr(one, name))
    found[name] = 2 * getattr(one, name)
    return found


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
    nothing
        What is as good as zero, by its name: the largest change of it, in its own unit.  It has no relative error.
    short
        In words why it is not within a tolerance; empty if it is, or none was given.
    """

    scene: Any
    solution: Any
    seconds: dict[str, float]
    error: float
    changes: dict[str, float]
    history: list[tuple[str, int, float]]
    nothing: Mapping[str, float] = dataclasses.field(default_factory=dict)
    short: str = ""


def estimate(scene: Any, settings: Mapping[str, Any], tolerance: float | None = None) -> Estimate:
    """Estimate a scene's error by refining its space in each direction, or refine until it is below a tolerance.

    To a tolerance the estimate of `isorod.checks.estimate` leads (`isorod.checks.adapt`); with contact
    the changes do: each step refines in the direction with the largest for its cost (work of a banded factorisation).

    Parameters
    ----------
    scene
        The scene of a file, or one with ``order``, ``section_points``, ``section_degree``, ``degree`` and ``elements``
        or ``elements_per_turn``.
    settings
        Keyword arguments of the scene's analysis.
    tolerance
        Relative error to reach; None for an estimate of the scene as it is.

    Raises
    ------
    InputError
        If the tolerance is out of range, or the quadrature does not follow the space.
    SolveError
        If the scene as it is cannot be solved.
    """
    if tolerance is not None:
        adapt.check(tolerance)
    model = scene.model()
    spaces = [body.space for body in model.bodies]
    for space in spaces:
        if "quadrature" not in space.chosen and space.quadrature not in ("auto", "full"):
            raise InputError(
                f"quadrature: got {space.quadrature!r}, refinement needs a rule that follows the space: auto or full"
            )
    if tolerance is not None and not model.contacts:
        return _reach(scene, settings, [_start(space, tolerance) for space in spaces], tolerance)
    if hasattr(scene, "content") or {"degree", "elements"} & {*spaces[0].chosen}:
        follows = [replace(one, quadrature="auto") if "quadrature" in one.chosen else one for one in spaces]
        scene = on(scene, follows)
    # Of this step alone: solutions of all would be memory for nothing.
    solved: dict[Any, tuple[Any, dict[str, float]]] = {}
    history: list[tuple[str, int, float]] = []
    # Of directions that were refined: the change before, and the share of a gain that is believed.
    before: dict[str, float] = {}
    trust: dict[str, float] = {}

    def solve(one: Any, near: Any = None) -> tuple[Any, dict[str, float]]:
        if one not in solved:
            # A finer space begins where the coarser one ended: from rest it takes several times as long.
            begin = None if near is None else partial(solving.start_at, near)
            solved[one] = solving.solve(one, settings, begin)
        return solved[one]

    found: Estimate | None = None
    for _ in range(MAX_STEPS + 1):
        solution, seconds = solve(scene)
        here = scene.measure(solution)
        ahead = finer(scene)
        changes, gains, nothing = {}, {}, dict[str, float]()
        try:
            for name, one in ahead.items():
                other, _ = solve(one, solution)
                changes[name] = _change(scene, here, one.measure(other), _NOTHING * _scale(solution), nothing)
                gains[name] = trust.get(name, 1.0) * changes[name] / (_work(other) - _work(solution))
        except (InputError, SolveError, MemoryError) as problem:
            if found is None:
                raise
            return replace(found, short=f"{found.short}; finer it fails: {str(problem) or SHORT}")
        error = sum(changes.values())
        if tolerance is None or error <= tolerance:
            return Estimate(scene, solution, seconds, error, changes, history, nothing)
        said = adapt.short(tolerance, error, len(history))
        found = Estimate(scene, solution, seconds, error, changes, [*history], nothing, said)
        if history and changes.get(last := history[-1][0], 0.0) > _FALLS * before[last]:
            # What does not fall where it is refined is due to another direction, as with few points in a patch.
            trust[last] = _DOUBTED * trust.get(last, 1.0)
            gains[last] *= _DOUBTED
        believed = {name: trust.get(name, 1.0) * changes[name] for name in gains}
        marked = [name for name in gains if believed[name] >= _MARKED * max(believed.values())]
        best = max(marked, key=lambda name: gains[name])
        before[best] = changes[best]
        if solved[ahead[best]][0].model.dofs > MAX_UNKNOWNS:
            break
        history.append((best, _told(ahead[best], best), error))
        scene = ahead[best]
        solved = {scene: solved[scene]}
    assert found is not None
    return found


def on(scene: Any, spaces: Sequence[Space]) -> Any:
    """Return the scene on spaces of its rods; one of a class has the same for all."""
    if hasattr(scene, "content"):
        return scene.on(spaces)
    space = spaces[0]
    names = {field.name for field in dataclasses.fields(scene)}
    kept = ("order", "section_degree", "degree", "continuity", "quadrature")
    fields = {name: getattr(space, name) for name in kept if name in names}
    if space.section_degree is None:
        fields["section_points"] = space.points_around
    elements = cast(int, space.elements)
    fields |= {"elements": elements} if "elements" in names else {"elements_per_turn": elements // scene.coils}
    return replace(scene, **fields)


def _start(space: Space, tolerance: float) -> Space:
    """Return a space whose section, if it was chosen, misses as much as the tolerance lets it."""
    if not ({"section_degree", "section_points"} & {*space.chosen}):
        return space
    rule = None if "quadrature" in space.chosen else space.quadrature
    section: dict[str, Any] = dict.fromkeys(("order", "section_points", "section_degree"))
    return replace(space, quadrature=rule, **section | adapt.section(space.rod, tolerance))


def _reach(scene: Any, settings: Mapping[str, Any], spaces: Sequence[Space], tolerance: float) -> Estimate:
    """Refine until the estimate is below the tolerance."""
    tried: dict[int, tuple[Any, dict[str, float]]] = {}

    def solve(spaces: Sequence[Space]) -> Any:
        one = on(scene, spaces)
        solution, seconds = solving.solve(one, settings)
        tried[id(solution)] = one, seconds
        return solution

    solution, _, steps, short = adapt.reach(solve, spaces, tolerance, bool(getattr(scene, "stresses", ())))
    history = [
        (name if hasattr(scene, name) else "elements_per_turn", value, before.error)
        for before, step in pairwise(steps)
        for name, value in step.changed.items()
    ]
    one, seconds = tried[id(solution)]
    return Estimate(one, solution, seconds, steps[-1].error, {}, history, short=short)


def _change(
    scene: Any, here: Mapping[str, Any], there: Mapping[str, Any], little: float, nothing: dict[str, float]
) -> float:
    """Return the largest relative change of what is measured: of each frequency, or of a vector's size.

    What is no more than a ``little``, and changes by as much as it is, is ``nothing``: its change is noted there.
    """
    changes = [0.0]
    for name, value in here.items():
        # Where a largest value is may be another place.
        if name not in scene.units:
            continue
        a, b = (np.atleast_1d(np.asarray(one, float)) for one in (value, there[name]))
        size, other, change = (float(np.linalg.norm(one)) for one in (a, b, b - a))
        if scene.analysis == "modal":
            changes.append(float(np.abs(b / a - 1.0).max()))
        elif max(size, other) <= little and change > _WHOLE * size:
            nothing[name] = max(change, nothing.get(name, 0.0))
        elif size > 0.0:
            changes.append(change / size)
    return max(changes)


def _scale(solution: Any) -> float:
    """Return what is large in an equilibrium: the largest force there is, or displacement; 0 of others."""
    model = solution.model
    given = [np.abs(np.asarray(getattr(solution, name, 0.0))) for name in ("reactions", "displacement")]
    moments = np.abs(np.asarray(getattr(solution, "moments", 0.0))) / model.size
    return max(float(one.max(initial=0.0)) for one in (*given, moments, np.abs(model.external)))


def _told(scene: Any, name: str) -> Any:
    """Return a number of a scene's space, of several rods those of the first."""
    return next(iter(scene.spaces.values()))[name] if hasattr(scene, "content") else getattr(scene, name)


def _work(solution: Any) -> float:
    """Return the work of a banded factorisation, up to a factor: unknowns times the square of an element's."""
    return float(sum(3 * body.space.nodes * body.space.element_nodes.shape[1] ** 2 for body in solution.model.bodies))
