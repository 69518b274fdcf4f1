"""What scenes measure, and its derivatives, as functions of some of their numbers, on one discretisation."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from isorod import choices
from isorod.arrays import Array
from isorod.design import differences, parameters
from isorod.design.curves import Curve
from isorod.statics.derivatives import numbers
from isorod.statics.differences import Measured, silently

# What of the rods can be asked for beside what is measured, and how far a curve is off, squared, in the mean.
OWN = ("mass", "volume")
MISFIT = "misfit"

# Returns, of a scene and keyword arguments of its analysis, the scene on the spaces that it is solved on, and what was
# solved.
Begin = Callable[[Any, Mapping[str, Any]], Sequence[Any]]


class Answer(NamedTuple):
    """What is measured of all scenes, by name, each entry of a list by itself: ``stress``, ``frequencies[0]``."""

    values: dict[str, float]
    solutions: Sequence[Any]


class _Frozen(NamedTuple):
    """A scene on the spaces that its first answer is on, the choices of its model, and that answer."""

    scene: Any
    made: choices.Choices
    first: Any


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
    begin
        Solves a scene as if it were new.
    table
        The curve whose points the scenes are: how far it is off is among the answers.

    Attributes
    ----------
    solves
        How many analyses there were.
    untold
        Why some derivatives are differences of answers, empty where none are.
    """

    def __init__(
        self,
        several: Mapping[str, Any],
        names: Sequence[str],
        settings: Mapping[str, Any],
        begin: Begin,
        table: Curve | None = None,
    ) -> None:
        self.scenes, self.names, self.settings, self.table = dict(several), list(names), dict(settings), table
        self.solves, self.untold, self._begin = 0, "", begin
        self._frozen: list[_Frozen] = []
        self._last: Sequence[Any] = ()

    def freeze(self, x: Array) -> Answer:
        """Return what is measured of new models, whose discretisations and load steps all others will have."""
        self._frozen = []
        for scene in self.scenes.values():
            self.solves += 1
            seen, solution, *_ = self._begin(parameters.at(scene, self._named(x)), self.settings)
            with silently(), choices.kept() as made:
                # What is built anew makes all choices.
                parameters.at(seen, self._named(x)).model()
            self._frozen.append(_Frozen(seen, made, solution))
        return self._measured([one.first for one in self._frozen])

    def answer(self, x: Array) -> Answer:
        """Return what is measured.

        Raises
        ------
        InputError, SolveError
            If there is no such model, or no answer.
        """
        return self._measured(
            [self._solve(k, self._make(k, self._named(x)), near) for k, near in enumerate(self._last)]
        )

    def _measured(self, solutions: Sequence[Any]) -> Answer:
        values: dict[str, float] = {}
        for case, frozen, solution in zip(self.scenes, self._frozen, solutions, strict=True):
            with silently():
                values |= of_case(case, flat(measured(frozen.scene, solution)))
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
        for k, case in enumerate(self.scenes):
            rows = self._rates(k, self._named(x), answer.solutions[k])
            found |= of_case(case, {one: np.array([row[one] for row in rows]) for one in rows[0]})
        if self.table is not None:
            found[MISFIT] = 2.0 * np.mean(self.table.off(answer.values)[:, None] * self.table.slopes(found), axis=0)
        return found

    def _rates(self, k: int, at: dict[str, float], solution: Any) -> list[dict[str, float]]:
        """Return the derivatives of what a scene measures, by each number."""
        scene, make = self._frozen[k].scene, partial(self._make, k)
        rates = differences.derivatives(solution, make, at, lambda one: measured(scene, one), partial(self._solve, k))
        rates = rates.averaged().checked()
        self.untold = rates.why or self.untold
        # Derivatives of modes are those of frequencies alone.
        modal = scene.analysis == "modal"
        return [flat(rates.by[name]) | (self._own(make, at, name) if modal else {}) for name in self.names]

    @staticmethod
    def _own(make: Callable[[Mapping[str, float]], Any], at: dict[str, float], name: str) -> dict[str, float]:
        """Return the derivatives of mass and volume by a number."""
        step = differences.APART * abs(at[name])
        less, more = (own(make(at | {name: at[name] + way})) for way in (-step, step))
        return {one: (more[one] - less[one]) / (2.0 * step) for one in less}

    def _named(self, x: Array) -> dict[str, float]:
        return dict(zip(self.names, map(float, x), strict=True))

    def _make(self, k: int, values: Mapping[str, float]) -> Any:
        # What there is to say of it is said at the end.
        frozen = self._frozen[k]
        with silently(), choices.repeated(frozen.made):
            return parameters.at(frozen.scene, values).model()

    def _solve(self, k: int, model: Any, near: Any) -> Any:
        self.solves += 1
        scene, _, first = self._frozen[k]
        return differences.solve_beside(scene, model, self.settings, near, first)


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
