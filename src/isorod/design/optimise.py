"""Design by SciPy's SLSQP (Kraft, DFVLR-FB 88-28, 1988): sequential quadratic programming with exact derivatives.

Variables and constraints are in logarithms: forces and stresses are nearly powers of lengths, so that few steps meet
targets and limits.  The objective is relative to its first value.  All solutions use one discretisation, so that they
are smooth functions; at the optimum the model is discretised and solved anew (`isorod.command.design`).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import lsq_linear, minimize

from isorod.arrays import Array
from isorod.design.constraints import Constraint, Variable
from isorod.design.evaluations import MISFIT, Evaluations, Results
from isorod.errors import InputError, SolveError

# Relative tolerances of targets and limits, and of the objective.
MET, _LEAST = 1e-4, 1e-6

# That of the misfit of a curve, which is a square and may vanish.
_LEAST_SQUARE = 1e-9
_MOST = 60

# A limit or bound is active within this relative distance.
_NEAR = 1e-3

# Solves after which a search is given up: targets and limits may be infeasible.
SOLVES = 60

# It ends too where so many solves do not reduce the violation of targets and limits by this fraction.
_STALLED, _NEARER = 10, 1e-2

# Below this fraction of the required value the logarithm continues linearly: a force may have the wrong sign at first.
_STRAIGHT = 0.5

# If two designs on either side of a target are closer than this, in logarithms, the result jumps between them.
_CLOSE = 1e-3

# Penalty on the objective of a design that cannot be solved, so that the step to it is shortened.
_BAD = 1e3

# Relative singular value below which the normalised gradients of targets are linearly dependent.
_ALIKE = 1e-5


class _Enough(Exception):
    """The limit of solves that ends a search, with a message."""


class Design(NamedTuple):
    """The optimum.

    Attributes
    ----------
    x
        The design variables.
    results
        The results there.
    violation
        The largest relative violation of targets and limits, and of which.
    prices
        Lagrange multipliers of active constraints, by their text: relative change of the objective over that of the
        constraint's value.
    trouble
        The last error of the search, or why it ended early; empty where neither.
    """

    x: Array
    results: Results
    violation: tuple[float, str]
    prices: Mapping[str, float]
    trouble: str


class Problem:
    """The objective, targets and limits of design variables.

    Parameters
    ----------
    evaluations, variables
        The results as functions of the variables, and the variables.
    constraints
        Targets and limits.
    objective
        Name of the objective, and 1 to minimise or -1 to maximise it; None: the least change from the start.
    report
        Receives a message on the progress.
    """

    def __init__(
        self,
        evaluations: Evaluations,
        variables: Sequence[Variable],
        constraints: Sequence[Constraint],
        objective: tuple[str, float] | None,
        report: Callable[[str], None],
    ) -> None:
        self._evaluations, self._constraints = evaluations, constraints
        self._objective, self._report = objective, report
        self._start = np.array([one.start for one in variables])
        self._ends = np.array([(one.lower, one.upper) for one in variables])
        self._bounds = np.sort(np.log(self._ends / self._start[:, None]), axis=1)
        self._names = [one.name for one in variables]
        self._results: dict[bytes, Results] = {}
        self._failed: dict[bytes, Exception] = {}
        self._rates: dict[bytes, dict[str, Array]] = {}
        self._first = 1.0
        self.trouble = ""

    def solve(self, x: Array, known: Results) -> Design:
        """Return the optimum from an initial design whose results are known.

        Raises
        ------
        InputError, SolveError
            If the design has no solution.
        """
        self._rates.clear()
        self._failed.clear()
        y = np.log(x / self._start)
        self._results = {y.tobytes(): known}
        self._last, self._stalled = y, 0
        self._nearest = violation(known.values, self._constraints)[0]
        if self._objective is not None:
            self._first = abs(known.values[self._objective[0]]) or 1.0
        squared = self._objective is not None and self._objective[0] == MISFIT
        kinds = {"=": "eq", "<": "ineq", ">": "ineq"}
        constraints = [
            {
                "type": kinds[constraint.relation],
                "fun": lambda z, constraint=constraint: self._margin(z, constraint)[0],
                "jac": lambda z, constraint=constraint: self._margin(z, constraint)[1],
            }
            for constraint in self._constraints
        ]
        ended, trying = "", True
        while trying:
            try:
                result = minimize(
                    lambda z: self._cost(z)[0],
                    y,
                    jac=lambda z: self._cost(z)[1],
                    bounds=self._bounds,
                    constraints=constraints,
                    method="SLSQP",
                    options={"ftol": _LEAST_SQUARE if squared else _LEAST, "maxiter": _MOST},
                )
                y, ended = result.x, "" if result.success else self._dependent(result.x) or str(result.message)
                restart = self._between(y) if ended else None
                trying, y = (False, y) if restart is None else (True, restart)
            except _Enough as problem:
                y, ended, trying = self._last, str(problem), False
        best = self._best(y)
        at_best = self._evaluate(best)
        missed = violation(at_best.values, self._constraints)
        return Design(self._at(best), at_best, missed, self._prices(best), self.trouble or ended)

    def _between(self, y: Array) -> Array | None:
        """Return where to begin again: halfway between two designs on either side of a target, if there are any.

        So a search leaves regions where the target's gradient vanishes, as of a permanent set where nothing yields.
        """
        if violation(self._evaluate(self._solvable(y)).values, self._constraints)[0] <= MET:
            return None
        tried = [np.frombuffer(key) for key in self._results]
        for target in (target for target in self._constraints if target.relation == "="):
            above = [self._evaluate(z).values[target.name] > target.value for z in tried]
            pairs = [
                (float(np.linalg.norm(z - other)), 0.5 * (z + other))
                for z, is_above in zip(tried, above, strict=True)
                for other, other_above in zip(tried, above, strict=True)
                if is_above and not other_above
            ]
            length, middle = min(pairs, key=lambda pair: pair[0], default=(0.0, y))
            if length > _CLOSE and middle.tobytes() not in self._failed:
                return middle
        return None

    def _dependent(self, y: Array) -> str:
        """Return a message on targets that are linearly dependent to first order; empty where none are."""
        targets = [target for target in self._constraints if target.relation == "="]
        rows = np.array([self._margin(y, target)[1] for target in targets])
        if len(targets) < 2 or not np.isfinite(rows).all():
            return ""
        rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), np.finfo(float).tiny)
        left, sizes, _ = np.linalg.svd(rows)
        if np.count_nonzero(sizes > _ALIKE * sizes[0]) == len(targets):
            return ""
        names = [target.name for target, size in zip(targets, np.abs(left[:, -1]), strict=True) if size > _ALIKE]
        return f"targets {', '.join(names)}: one depends on the others, whatever varies; leave one out, or vary more"

    def _best(self, y: Array) -> Array:
        """Return where the search ended or, if that violates constraints, the tried design that violates them least."""
        y = np.clip(y, *self._bounds.T)
        try:
            if violation(self._evaluate(y).values, self._constraints)[0] <= MET:
                return y
        except (InputError, SolveError) as problem:
            self.trouble = str(problem)
        tried = [np.frombuffer(key) for key in self._results]
        return min(tried, key=lambda design: violation(self._evaluate(design).values, self._constraints)[0])

    def _at(self, y: Array) -> Array:
        """Return the variables from their logarithms."""
        return np.clip(self._start * np.exp(y), *self._ends.T)

    def _evaluate(self, y: Array) -> Results:
        key = np.ascontiguousarray(y, dtype=float).tobytes()
        if key in self._failed:
            raise self._failed[key]
        if key not in self._results:
            if len(self._results) + len(self._failed) >= SOLVES:
                raise _Enough(f"no end after {SOLVES} solves")
            if self._stalled >= _STALLED and self._nearest > MET:
                raise _Enough(f"nothing comes nearer in {_STALLED} solves")
            try:
                self._stalled += 1
                self._results[key] = self._evaluations.evaluate(self._at(y))
            except (InputError, SolveError) as problem:
                # Failed solves take longest, and the objective and each constraint ask for the same one.
                self._failed[key] = problem
                raise
            violated = violation(self._results[key].values, self._constraints)[0]
            if violated < (1.0 - _NEARER) * self._nearest:
                self._nearest, self._stalled = violated, 0
            state = ", ".join(
                f"{constraint.name} {self._results[key].values[constraint.name]:.6g}"
                for constraint in self._constraints[:3]
            )
            if self._objective is not None:
                state = f"{self._objective[0]} {self._results[key].values[self._objective[0]]:.6g}, {state}"
            self._report(f"solve {self._evaluations.solves}: {state.rstrip(', ')}")
        return self._results[key]

    def _slopes(self, y: Array) -> dict[str, Array]:
        """Return the derivatives of the results with respect to the logarithms of the variables."""
        key = np.ascontiguousarray(y, dtype=float).tobytes()
        if key not in self._rates:
            rates, x = self._evaluations.derivatives(self._at(y), self._evaluate(y)), self._at(y)
            self._rates[key] = {name: slopes * x for name, slopes in rates.items()}
        return self._rates[key]

    def _margin(self, y: Array, constraint: Constraint) -> tuple[float, Array]:
        """Return the relative margin to a limit, or deviation from a target, and its derivative."""
        y = self._solvable(y)
        ratio = self._evaluate(y).values[constraint.name] / (constraint.value or 1.0)
        scale = (-1.0 if constraint.relation == "<" else 1.0) * (-1.0 if constraint.value < 0.0 else 1.0)
        near = max(ratio, _STRAIGHT)
        margin = np.log(near) + (ratio - near) / near if constraint.value else ratio
        slope = self._slopes(y)[constraint.name] / ((constraint.value * near) if constraint.value else 1.0)
        return scale * float(margin), scale * slope

    def _cost(self, y: Array) -> tuple[float, Array]:
        design = self._solvable(y)
        penalty = 0.0 if design is y else _BAD
        if sum(one.relation == "=" for one in self._constraints) >= y.size:
            # Targets determine the design, and the objective would shorten the steps to them (Maratos effect).
            return penalty, np.zeros(y.size)
        if self._objective is None:
            x = self._at(y)
            change = x / self._start - 1.0
            return penalty + float(change @ change), 2.0 * change * x / self._start
        name, sign = self._objective
        factor = sign / self._first
        return penalty + factor * self._evaluate(design).values[name], factor * self._slopes(design)[name]

    def _solvable(self, y: Array) -> Array:
        """Return the design, or the last that could be solved where this one cannot."""
        try:
            self._evaluate(y)
            # SLSQP reuses the array.
            self._last = y.copy()
        except (InputError, SolveError) as problem:
            self.trouble = str(problem)
            return self._last
        return y

    def active(self, y: Array) -> dict[str, Any]:
        """Return the gradients of active constraints and bounds, by their text."""
        gradients = {}
        for constraint in self._constraints:
            margin, slope = self._margin(y, constraint)
            if constraint.relation == "=" or margin < _NEAR:
                gradients[str(constraint)] = slope
        x = self._at(y)
        for k, ends in enumerate(self._ends):
            for side, bound in zip(("lower", "upper"), ends, strict=True):
                if abs(x[k] - bound) <= _NEAR * abs(bound):
                    sign = 1.0 if (side == "lower") == (bound > 0.0) else -1.0
                    gradients[f"{self._names[k]} at its {side} bound {bound:g}"] = sign * np.eye(y.size)[k]
        return gradients

    def _prices(self, y: Array) -> dict[str, float]:
        """Return the Lagrange multipliers of active constraints and bounds."""
        gradients = self.active(y)
        if self._objective is None or not gradients:
            return dict.fromkeys(gradients, 0.0)
        # Relative to the objective here.
        name, sign = self._objective
        gradient = sign * self._slopes(y)[name] / (abs(self._evaluate(y).values[name]) or 1.0)
        lower = [-np.inf if "=" in text.split() else 0.0 for text in gradients]
        multipliers = lsq_linear(np.array([*gradients.values()]).T, gradient, (lower, np.inf)).x
        return {name: float(value) for name, value in zip(gradients, multipliers, strict=True)}


def violation(values: Mapping[str, float], constraints: Sequence[Constraint]) -> tuple[float, str]:
    """Return the largest relative violation of targets and limits, and of which."""
    violations = [(0.0, "")]
    for constraint in constraints:
        value = values[constraint.name]
        error = (value - constraint.value) / (abs(constraint.value) or 1.0)
        error = {"=": abs(error), "<": max(error, 0.0), ">": max(-error, 0.0)}[constraint.relation]
        violations.append(
            (error, f"{constraint.name} = {value:.6g}, required {constraint.relation} {constraint.value:g}")
        )
    return max(violations)
