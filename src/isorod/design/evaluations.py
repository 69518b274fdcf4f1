"""What scenes measure, and its derivatives, as functions of some of their numbers, on one discretisation."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from isorod import choices
from isorod.arrays import Array
from isorod.design import parameters
from isorod.design.curves import Curve
from isorod.errors import InputError, SolveError
from isorod.statics.derivatives import numbers
from isorod.statics.differences import Measured

# What of the rods can be asked for beside what is measured, and how far a curve is off, squared, in the mean.
OWN = ("mass", "volume")
MISFIT = "misfit"

# Where an answer has no derivatives they are differences of answers at this share of a number to both sides: errors
# go with its square, and what contact leaves of its search, some 1e-7 of a force, over it.
_APART = 2e-3


class Answer(NamedTuple):
    """What is measured of all scenes, by name, each entry of a list by itself: ``stress``, ``frequencies[0]``."""

    values: dict[str, float]
    solutions: Sequence[Any]


class Evaluations:
    """Answers of scenes as functions of numbers that all have.

    Parameters
    ----------
    several
        Scenes, load cases of one file, by their names; that of one that has none is empty.
    names
        The numbers that vary.
    settings
        Keyword arguments of the analysis.
    table
        The curve whose points the scenes are: how far it is off is among the answers.

    Attributes
    ----------
    solves
        How many analyses there were.
    untold, refused
        Why some derivatives are differences of answers, empty where none are, and whether all are.
    """

    def __init__(
        self,
        several: Mapping[str, Any],
        names: Sequence[str],
        settings: Mapping[str, Any],
        table: Curve | None = None,
    ) -> None:
        self.scenes, self.names, self.settings, self.table = dict(several), list(names), dict(settings), table
        self.solves, self.untold, self.refused = 0, "", False
        self._last: list[Any] = [None] * len(self.scenes)
        self._choices: list[choices.Choices] = []

    def freeze(self, x: Array) -> None:
        """Take the discretisation that is chosen at some numbers for all."""
        self._choices, self._last = [], [None] * len(self.scenes)
        for scene in self.scenes.values():
            with _silently(), choices.kept() as made:
                parameters.at(scene, self._named(x)).model()
            self._choices.append(made)

    def answer(self, x: Array) -> Answer:
        """Return what is measured.

        Raises
        ------
        InputError, SolveError
            If there is no such model, or no answer.
        """
        values: dict[str, float] = {}
        solutions = []
        for k, (case, scene) in enumerate(self.scenes.items()):
            solution = self._solve(scene, self._make(k, scene, self._named(x)), self._last[k])
            solutions.append(solution)
            with _silently():
                values |= of_case(case, flat(measured(scene, solution)))
        self._last = solutions
        self.add_misfit(values)
        return Answer(values, solutions)

    def add_misfit(self, values: dict[str, float]) -> None:
        """Add to answers how far the curve is off, if there is one."""
        if self.table is not None:
            values[MISFIT] = float(np.mean(self.table.off(values) ** 2))

    def derivatives(self, x: Array, answer: Answer) -> dict[str, Array]:
        """Return the derivatives of what is measured by all numbers, shape ``(numbers,)`` each."""
        found: dict[str, Array] = {}
        for k, (case, scene) in enumerate(self.scenes.items()):
            rows = self._rates(k, scene, self._named(x), answer.solutions[k])
            found |= of_case(case, {one: np.array([row[one] for row in rows]) for one in rows[0]})
        if self.table is not None:
            found[MISFIT] = 2.0 * np.mean(self.table.off(answer.values)[:, None] * self.table.slopes(found), axis=0)
        return found

    def _rates(self, k: int, scene: Any, at: dict[str, float], solution: Any) -> list[dict[str, float]]:
        """Return the derivatives of what a scene measures, by each number."""

        def make(values: Mapping[str, float]) -> Any:
            return self._make(k, scene, values)

        if self.refused:
            return [self._difference(k, scene, at, name, solution) for name in self.names]
        try:
            rates = solution.derivatives(make, at, lambda one: measured(scene, one))
        except (InputError, SolveError) as problem:
            self.untold, self.refused = str(problem).removeprefix("derivatives: ").partition(";")[0], True
            return self._rates(k, scene, at, solution)
        found, modal = [], scene.analysis == "modal"
        for name in self.names:
            if name in rates.none and solution.model.remembers:
                # Somewhere on the path a point is about to yield: designs go on past it.
                self.untold = f"not available by {name} everywhere ({rates.none[name]})"
                found.append(self._difference(k, scene, at, name, solution))
                continue
            rate = rates.by[name] if name in rates.by else rates.told().by[name]
            # Derivatives of modes are those of frequencies alone.
            found.append(flat(rate) | (self._own(make, at, name) if modal else {}))
        return found

    @staticmethod
    def _own(make: Callable[[Mapping[str, float]], Any], at: dict[str, float], name: str) -> dict[str, float]:
        """Return the derivatives of mass and volume by a number."""
        step = _APART * abs(at[name])
        less, more = (own(make(at | {name: at[name] + way})) for way in (-step, step))
        return {one: (more[one] - less[one]) / (2.0 * step) for one in less}

    def _difference(self, k: int, scene: Any, at: dict[str, float], name: str, solution: Any) -> dict[str, float]:
        """Return the derivatives by a number as differences of answers on both sides, or on one where it ends."""
        with _silently():
            ends, step = {0.0: flat(measured(scene, solution))}, _APART * abs(at[name])
            for way in (-step, step):
                try:
                    beside = self._solve(scene, self._make(k, scene, at | {name: at[name] + way}), solution)
                except (InputError, SolveError):
                    continue
                ends[way] = flat(measured(scene, beside))
        first, last = min(ends), max(ends)
        if first == last:
            raise InputError(f"derivative by {name}: there is none here: models beside it cannot be solved")
        return {one: (ends[last][one] - ends[first][one]) / (last - first) for one in ends[0.0]}

    def _named(self, x: Array) -> dict[str, float]:
        return dict(zip(self.names, map(float, x), strict=True))

    def _make(self, k: int, scene: Any, values: Mapping[str, float]) -> Any:
        # What there is to say of it is said at the end.
        with _silently(), choices.repeated(self._choices[k]):
            return parameters.at(scene, values).model()

    def _solve(self, scene: Any, model: Any, near: Any) -> Any:
        settings = dict(self.settings)
        if scene.analysis == "statics" and near is not None:
            # The answer beside it is near.
            settings["start"] = near.displacement
            if model.remembers and model.times is None:
                # With as many load steps, as it is off by these.
                settings["load_steps"] = near.load_steps
        self.solves += 1
        with _silently():
            return import_module(f"isorod.{scene.analysis}").solve(model, **settings)


def measured(scene: Any, solution: Any) -> Measured:
    """Return the numbers that a scene measures, and mass and volume of its rods."""
    return {name: np.array(value) for name, value in own(solution.model).items()} | numbers(scene.measure(solution))


def own(model: Any) -> dict[str, float]:
    """Return the volume of a model's rods, and their mass if they have one."""
    volume = mass = 0.0
    for body in model.bodies:
        table = body.space.tabulate(0, body.space.axis.elements)
        volume += float(table.weights.sum())
        mass += float((body.densities_at(table) * table.weights).sum())
    return {"volume": volume} | ({"mass": mass} if mass else {})


def flat(found: Measured) -> dict[str, float]:
    """Return numbers each by itself: entries of a list by their places, ``force[2]``."""
    return {
        name if value.ndim == 0 else f"{name}[{k}]": float(one)
        for name, value in found.items()
        for k, one in enumerate(value.ravel())
    }


def of_case(case: str, found: Mapping[str, Any]) -> dict[str, Any]:
    """Return numbers of a load case by their names, of the rods themselves without that of the case."""
    return {f"{case}.{name}" if case and name not in OWN else name: one for name, one in found.items()}


def _silently() -> warnings.catch_warnings:
    return warnings.catch_warnings(action="ignore")
