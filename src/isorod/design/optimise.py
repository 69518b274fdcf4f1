"""Design by SciPy's SLSQP (Kraft, DFVLR-FB 88-28, 1988): sequential quadratic programming with exact derivatives.

What varies, and what is wanted, is told by its logarithm: forces and stresses are nearly powers of lengths, so that a
step meets what is wanted nearly at once.  What is least is told as a share of its first value.  Answers are on one
discretisation, so that they are smooth; where the best is found the model is solved as if it were new
(`isorod.command.design`).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import lsq_linear, minimize

from isorod.arrays import Array
from isorod.design.evaluations import MISFIT, Answer, Evaluations
from isorod.design.wanted import Vary, Wanted
from isorod.errors import InputError, SolveError

# What is wanted is met to this share, and what is least does not fall any more by this one.
MET, _LEAST = 1e-4, 1e-6

# The same of the misfit of a curve, which is a square and may vanish.
_LEAST_SQUARE = 1e-9
_MOST = 60

# A limit or a bound is active that is as near as this.
_NEAR = 1e-3

# Solves after which a search that has not ended does not: what is wanted may not be possible.
SOLVES = 60

# It ends too where in so many solves nothing comes nearer to what is wanted by this share of what it is missed by.
_STALLED, _NEARER = 10, 1e-2

# Below this share of what is wanted the logarithm goes on along its tangent: a force may have the wrong sign at first.
_STRAIGHT = 0.5

# Designs to both sides of a target that are as near as this in logarithms, and miss it, have a jump between them.
_CLOSE = 1e-3

# What a design that cannot be solved counts, so that the step to it is shortened.
_BAD = 1e3

# Slopes of targets, by their sizes, that lie in fewer directions than there are targets, but for so much.
_ALIKE = 1e-5


class _Enough(Exception):
    """As many solves as a search may take: says which."""


class Design(NamedTuple):
    """The optimum.

    Attributes
    ----------
    x
        The numbers that vary.
    answer
        What is measured there.
    missed
        The largest relative violation of targets and limits, and of which.
    prices
        Of what is active, in words, by how much what is least would change, as a share, if it gave way by 1 %.
    trouble
        What went wrong on the way last, if that ended it; empty where it did not.
    """

    x: Array
    answer: Answer
    missed: tuple[float, str]
    prices: Mapping[str, float]
    trouble: str


class Problem:
    """The objective, targets and limits, of parameters that vary.

    Parameters
    ----------
    evaluations, several
        Answers, and what varies.
    wanted
        Targets and limits.
    objective
        Name of what is to be least, and 1, or -1 where it is to be largest; None: the least change from the start.
    tell
        Is told in words how far it is.
    """

    def __init__(
        self,
        evaluations: Evaluations,
        several: Sequence[Vary],
        wanted: Sequence[Wanted],
        objective: tuple[str, float] | None,
        tell: Callable[[str], None],
    ) -> None:
        self._evaluations, self._wanted, self._objective, self._tell = evaluations, wanted, objective, tell
        self._start = np.array([one.start for one in several])
        self._ends = np.array([(one.lower, one.upper) for one in several])
        self._bounds = np.sort(np.log(self._ends / self._start[:, None]), axis=1)
        self._names = [one.name for one in several]
        self._answers: dict[bytes, Answer] = {}
        self._failed: dict[bytes, Exception] = {}
        self._rates: dict[bytes, dict[str, Array]] = {}
        self._first = 1.0
        self.trouble = ""

    def solve(self, x: Array, known: Answer) -> Design:
        """Return the best near some numbers, whose answer is known.

        Raises
        ------
        InputError, SolveError
            If they have no answer.
        """
        self._rates.clear()
        self._failed.clear()
        y = np.log(x / self._start)
        self._answers = {y.tobytes(): known}
        self._last, self._vain = y, 0
        self._nearest = missed_by(known.values, self._wanted)[0]
        if self._objective is not None:
            self._first = abs(known.values[self._objective[0]]) or 1.0
        squared = self._objective is not None and self._objective[0] == MISFIT
        kinds = {"=": "eq", "<": "ineq", ">": "ineq"}
        constraints = [
            {
                "type": kinds[one.relation],
                "fun": lambda z, one=one: self._room(z, one)[0],
                "jac": lambda z, one=one: self._room(z, one)[1],
            }
            for one in self._wanted
        ]
        ended, trying = "", True
        while trying:
            try:
                found = minimize(
                    lambda z: self._cost(z)[0],
                    y,
                    jac=lambda z: self._cost(z)[1],
                    bounds=self._bounds,
                    constraints=constraints,
                    method="SLSQP",
                    options={"ftol": _LEAST_SQUARE if squared else _LEAST, "maxiter": _MOST},
                )
                y, ended = found.x, "" if found.success else self._dependent(found.x) or str(found.message)
                between = self._between(y) if ended else None
                trying, y = (False, y) if between is None else (True, between)
            except _Enough as problem:
                y, ended, trying = self._last, str(problem), False
        best = self._best(y)
        answer = self._answer(best)
        missed = missed_by(answer.values, self._wanted)
        return Design(self._at(best), answer, missed, self._prices(best), self.trouble or ended)

    def _between(self, y: Array) -> Array | None:
        """Return where to begin again, halfway between two designs that miss a target to both sides, if there are any.

        So a search comes back from where a target does not change any more, as a set where nothing yields.
        """
        if missed_by(self._answer(self._solvable(y)).values, self._wanted)[0] <= MET:
            return None
        tried = [np.frombuffer(key) for key in self._answers]
        for one in (one for one in self._wanted if one.relation == "="):
            over = [self._answer(z).values[one.name] > one.value for z in tried]
            pairs = [
                (float(np.linalg.norm(z - other)), 0.5 * (z + other))
                for z, above in zip(tried, over, strict=True)
                for other, beyond in zip(tried, over, strict=True)
                if above and not beyond
            ]
            length, middle = min(pairs, key=lambda pair: pair[0], default=(0.0, y))
            if length > _CLOSE and middle.tobytes() not in self._failed:
                return middle
        return None

    def _dependent(self, y: Array) -> str:
        """Return in words which targets depend on each other to first order; empty where none do."""
        targets = [one for one in self._wanted if one.relation == "="]
        rows = np.array([self._room(y, one)[1] for one in targets])
        if len(targets) < 2 or not np.isfinite(rows).all():
            return ""
        rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), np.finfo(float).tiny)
        left, sizes, _ = np.linalg.svd(rows)
        if np.count_nonzero(sizes > _ALIKE * sizes[0]) == len(targets):
            return ""
        found = [one.name for one, part in zip(targets, np.abs(left[:, -1]), strict=True) if part > _ALIKE]
        return f"targets {', '.join(found)}: one depends on the others, whatever varies; leave one out, or vary more"

    def _best(self, y: Array) -> Array:
        """Return where it ended, or where of all that was tried least is missed, if there that is too much."""
        y = np.clip(y, *self._bounds.T)
        try:
            if missed_by(self._answer(y).values, self._wanted)[0] <= MET:
                return y
        except (InputError, SolveError) as problem:
            self.trouble = str(problem)
        tried = [np.frombuffer(key) for key in self._answers]
        return min(tried, key=lambda one: missed_by(self._answer(one).values, self._wanted)[0])

    def _at(self, y: Array) -> Array:
        """Return the numbers of their logarithms."""
        return np.clip(self._start * np.exp(y), *self._ends.T)

    def _answer(self, y: Array) -> Answer:
        key = np.ascontiguousarray(y, dtype=float).tobytes()
        if key in self._failed:
            raise self._failed[key]
        if key not in self._answers:
            if len(self._answers) + len(self._failed) >= SOLVES:
                raise _Enough(f"no end after {SOLVES} solves")
            if self._vain >= _STALLED and self._nearest > MET:
                raise _Enough(f"nothing comes nearer in {_STALLED} solves")
            try:
                self._vain += 1
                self._answers[key] = self._evaluations.answer(self._at(y))
            except (InputError, SolveError) as problem:
                # What cannot be solved takes longest, and is asked for by what is least and each that is wanted.
                self._failed[key] = problem
                raise
            missed = missed_by(self._answers[key].values, self._wanted)[0]
            if missed < (1.0 - _NEARER) * self._nearest:
                self._nearest, self._vain = missed, 0
            told = ", ".join(f"{one.name} {self._answers[key].values[one.name]:.6g}" for one in self._wanted[:3])
            if self._objective is not None:
                told = f"{self._objective[0]} {self._answers[key].values[self._objective[0]]:.6g}, {told}"
            self._tell(f"solve {self._evaluations.solves}: {told.rstrip(', ')}")
        return self._answers[key]

    def _slopes(self, y: Array) -> dict[str, Array]:
        """Return the derivatives by logarithms of numbers; of what cannot be solved those of what was tried last."""
        key = np.ascontiguousarray(y, dtype=float).tobytes()
        if key not in self._rates:
            found, x = self._evaluations.derivatives(self._at(y), self._answer(y)), self._at(y)
            self._rates[key] = {name: one * x for name, one in found.items()}
        return self._rates[key]

    def _room(self, y: Array, one: Wanted) -> tuple[float, Array]:
        """Return what is left to a limit, or what a target is missed by, as a share of it, and its derivative."""
        y = self._solvable(y)
        share = self._answer(y).values[one.name] / (one.value or 1.0)
        scale = (-1.0 if one.relation == "<" else 1.0) * (-1.0 if one.value < 0.0 else 1.0)
        near = max(share, _STRAIGHT)
        left = np.log(near) + (share - near) / near if one.value else share
        slope = self._slopes(y)[one.name] / ((one.value * near) if one.value else 1.0)
        return scale * float(left), scale * slope

    def _cost(self, y: Array) -> tuple[float, Array]:
        there = self._solvable(y)
        bad = 0.0 if there is y else _BAD
        if sum(one.relation == "=" for one in self._wanted) >= y.size:
            # Targets leave no choice, and what is least would shorten the steps to them (Maratos).
            return bad, np.zeros(y.size)
        if self._objective is None:
            x = self._at(y)
            change = x / self._start - 1.0
            return bad + float(change @ change), 2.0 * change * x / self._start
        name, sign = self._objective
        share = sign / self._first
        return bad + share * self._answer(there).values[name], share * self._slopes(there)[name]

    def _solvable(self, y: Array) -> Array:
        """Return the numbers, or the last that could be solved where these cannot."""
        try:
            self._answer(y)
            # SLSQP goes on in the same array.
            self._last = y.copy()
        except (InputError, SolveError) as problem:
            self.trouble = str(problem)
            return self._last
        return y

    def active(self, y: Array) -> dict[str, Any]:
        """Return the slopes of what is active, as what is left of it, by its name in words."""
        found = {}
        for one in self._wanted:
            left, slope = self._room(y, one)
            if one.relation == "=" or left < _NEAR:
                found[str(one)] = slope
        x = self._at(y)
        for k, ends in enumerate(self._ends):
            for side, bound in zip(("lower", "upper"), ends, strict=True):
                if abs(x[k] - bound) <= _NEAR * abs(bound):
                    way = 1.0 if (side == "lower") == (bound > 0.0) else -1.0
                    found[f"{self._names[k]} at its {side} bound {bound:g}"] = way * np.eye(y.size)[k]
        return found

    def _prices(self, y: Array) -> dict[str, float]:
        """Return Lagrange's multipliers of what is active."""
        held = self.active(y)
        if self._objective is None or not held:
            return dict.fromkeys(held, 0.0)
        # As a share of what it is here.
        name, sign = self._objective
        gradient = sign * self._slopes(y)[name] / (abs(self._answer(y).values[name]) or 1.0)
        lower = [-np.inf if "=" in one.split() else 0.0 for one in held]
        found = lsq_linear(np.array([*held.values()]).T, gradient, (lower, np.inf)).x
        return {name: float(price) for name, price in zip(held, found, strict=True)}


def missed_by(values: Mapping[str, float], wanted: Sequence[Wanted]) -> tuple[float, str]:
    """Return the largest relative violation of targets and limits, and of which."""
    found = [(0.0, "")]
    for one in wanted:
        value = values[one.name]
        off = (value - one.value) / (abs(one.value) or 1.0)
        off = {"=": abs(off), "<": max(off, 0.0), ">": max(-off, 0.0)}[one.relation]
        found.append((off, f"{one.name} = {value:.6g}, required {one.relation} {one.value:g}"))
    return max(found)
