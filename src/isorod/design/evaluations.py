"""Results of scenes and their derivatives as functions of parameters, on a fixed discretisation."""

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

# Results of all rods besides those measured, and the mean square misfit of a curve.
OWN = ("mass", "volume")
MISFIT = "misfit"

# Returns, for a scene and keyword arguments of its analysis, the scene on the spaces on which it was solved, and its
# solution.
Begin = Callable[[Any, Mapping[str, Any]], Sequence[Any]]


class Results(NamedTuple):
    """Results of all scenes as single numbers by name, ``stress`` or ``frequencies[0]``, and the solutions."""

    values: dict[str, float]
    solutions: Sequence[Any]


class _Frozen(NamedTuple):
    """A scene on the spaces of its first solution, the discretisation choices of its model, and that solution."""

    scene: Any
    made: choices.Choices
    first: Any


class Evaluations:
    """Results of scenes as functions of parameters common to all.

    Parameters
    ----------
    several
        Scenes, load cases of one file, by their names; a single one has an empty name.
    names
        The parameters that vary.
    settings
        Keyword arguments of the analysis.
    begin
        Solves a scene with a discretisation chosen anew.
    table
        The curve whose points the scenes are: its misfit is then among the results.

    Attributes
    ----------
    solves
        Number of analyses.
    fallback
        Why some derivatives are finite differences, empty where none are.
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
        self.solves, self.fallback, self._begin = 0, "", begin
        self._frozen: list[_Frozen] = []
        self._last: Sequence[Any] = ()

    def freeze(self, x: Array) -> Results:
        """Return the results of new models, and fix their discretisations and load steps for all later ones."""
        self._frozen = []
        for scene in self.scenes.values():
            self.solves += 1
            seen, solution, *_ = self._begin(parameters.at(scene, self._named(x)), self.settings)
            with silently(), choices.kept() as made:
                # Building the model anew records all of its choices.
                parameters.at(seen, self._named(x)).model()
            self._frozen.append(_Frozen(seen, made, solution))
        return self._measured([one.first for one in self._frozen])

    def evaluate(self, x: Array) -> Results:
        """Return the results.

        Raises
        ------
        InputError, SolveError
            If there is no such model, or no solution.
        """
        return self._measured(
            [self._solve(k, self._make(k, self._named(x)), near) for k, near in enumerate(self._last)]
        )

    def _measured(self, solutions: Sequence[Any]) -> Results:
        values: dict[str, float] = {}
        for case, frozen, solution in zip(self.scenes, self._frozen, solutions, strict=True):
            with silently():
                values |= of_case(case, flat(measured(frozen.scene, solution)))
        self._last = solutions
        self.add_misfit(values)
        return Results(values, solutions)

    def add_misfit(self, values: dict[str, float]) -> None:
        """Add the mean square misfit of the curve to results, if there is a curve."""
        if self.table is not None:
            values[MISFIT] = float(np.mean(self.table.off(values) ** 2))

    def derivatives(self, x: Array, results: Results) -> dict[str, Array]:
        """Return the derivatives of each result with respect to the parameters, shape ``(parameters,)``."""
        rates: dict[str, Array] = {}
        for k, case in enumerate(self.scenes):
            rows = self._rates(k, self._named(x), results.solutions[k])
            rates |= of_case(case, {key: np.array([row[key] for row in rows]) for key in rows[0]})
        if self.table is not None:
            rates[MISFIT] = 2.0 * np.mean(self.table.off(results.values)[:, None] * self.table.slopes(rates), axis=0)
        return rates

    def _rates(self, k: int, at: dict[str, float], solution: Any) -> list[dict[str, float]]:
        """Return the derivatives of a scene's results, for each parameter."""
        scene, make = self._frozen[k].scene, partial(self._make, k)
        rates = differences.derivatives(solution, make, at, lambda near: measured(scene, near), partial(self._solve, k))
        rates = rates.averaged().checked()
        self.fallback = rates.why or self.fallback
        # Modal derivatives are of frequencies alone, not of mass and volume.
        modal = scene.analysis == "modal"
        return [flat(rates.by[name]) | (self._own(make, at, name) if modal else {}) for name in self.names]

    @staticmethod
    def _own(make: Callable[[Mapping[str, float]], Any], at: dict[str, float], name: str) -> dict[str, float]:
        """Return the derivatives of mass and volume with respect to a parameter."""
        step = differences.APART * abs(at[name])
        less, more = (own(make(at | {name: at[name] + change})) for change in (-step, step))
        return {key: (more[key] - less[key]) / (2.0 * step) for key in less}

    def _named(self, x: Array) -> dict[str, float]:
        return dict(zip(self.names, map(float, x), strict=True))

    def _make(self, k: int, values: Mapping[str, float]) -> Any:
        # Warnings about the model are given for the final one.
        frozen = self._frozen[k]
        with silently(), choices.repeated(frozen.made):
            return parameters.at(frozen.scene, values).model()

    def _solve(self, k: int, model: Any, near: Any) -> Any:
        self.solves += 1
        scene, _, first = self._frozen[k]
        return differences.solve_beside(scene, model, self.settings, near, first)


def measured(scene: Any, solution: Any) -> Measured:
    """Return the results of a scene, and mass and volume of its rods."""
    return {name: np.array(value) for name, value in own(solution.model).items()} | numbers(scene.measure(solution))


def own(model: Any) -> dict[str, float]:
    """Return the volume of a model's rods, and their mass if they have one."""
    volume = mass = 0.0
    for body in model.bodies:
        table = body.space.tabulate(0, body.space.axis.elements)
        volume += float(table.weights.sum())
        mass += float((body.densities_at(table) * table.weights).sum())
    return {"volume": volume} | ({"mass": mass} if mass else {})


def flat(results: Measured) -> dict[str, float]:
    """Return results as single numbers: entries of a list by their index, ``force[2]``."""
    return {
        name if value.ndim == 0 else f"{name}[{k}]": float(entry)
        for name, value in results.items()
        for k, entry in enumerate(value.ravel())
    }


def of_case(case: str, results: Mapping[str, Any]) -> dict[str, Any]:
    """Return results with the load case before their names, but for mass and volume of the rods."""
    return {f"{case}.{name}" if case and name not in OWN else name: value for name, value in results.items()}
