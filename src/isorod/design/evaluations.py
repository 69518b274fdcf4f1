"""What scenes measure, and its derivatives, as functions of some of their numbers, on one discretisation."""

import warnings
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from isorod import choices
from isorod.arrays import Array
from isorod.design import parameters
from isorod.statics.derivatives import numbers
from isorod.statics.differences import Measured

# What of the rods can be asked for beside what is measured.
OWN = ("mass", "volume")


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

    Attributes
    ----------
    solves
        How many analyses there were.
    """

    def __init__(self, several: Mapping[str, Any], names: Sequence[str], settings: Mapping[str, Any]) -> None:
        self.scenes, self.names, self.settings = dict(several), list(names), dict(settings)
        self.solves = 0
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
            solution = self._solve(k, scene, self._make(k, scene, self._named(x)))
            solutions.append(solution)
            with _silently():
                values |= of_case(case, flat(measured(scene, solution)))
        self._last = solutions
        return Answer(values, solutions)

    def derivatives(self, x: Array, answer: Answer) -> dict[str, Array]:
        """Return the derivatives of what is measured by all numbers, shape ``(numbers,)`` each."""
        found: dict[str, Array] = {}
        for k, (case, scene) in enumerate(self.scenes.items()):
            rates = (
                answer.solutions[k]
                .derivatives(
                    lambda values, k=k, scene=scene: self._make(k, scene, values),
                    self._named(x),
                    lambda solution, scene=scene: measured(scene, solution),
                )
                .told()
            )
            rows = [flat(rates.by[name]) for name in self.names]
            found |= of_case(case, {one: np.array([row[one] for row in rows]) for one in rows[0]})
        return found

    def _named(self, x: Array) -> dict[str, float]:
        return dict(zip(self.names, map(float, x), strict=True))

    def _make(self, k: int, scene: Any, values: Mapping[str, float]) -> Any:
        # What there is to say of it is said at the end.
        with _silently(), choices.repeated(self._choices[k]):
            return parameters.at(scene, values).model()

    def _solve(self, k: int, scene: Any, model: Any) -> Any:
        settings, before = dict(self.settings), self._last[k]
        if scene.analysis == "statics" and before is not None:
            # The answer beside it is near.
            settings["start"] = before.displacement
        self.solves += 1
        with _silently():
            return import_module(f"isorod.{scene.analysis}").solve(model, **settings)


def measured(scene: Any, solution: Any) -> Measured:
    """Return the numbers that a scene measures, and mass and volume of its rods."""
    found = numbers(scene.measure(solution))
    volume = mass = 0.0
    for body in solution.model.bodies:
        table = body.space.tabulate(0, body.space.axis.elements)
        volume += float(table.weights.sum())
        mass += float((body.densities_at(table) * table.weights).sum())
    own = {"volume": volume} | ({"mass": mass} if mass else {})
    return {name: np.array(value) for name, value in own.items()} | found


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
