"""Derivatives of results by parameters of a model, from finite differences of models with perturbed parameters.

These have the same discretisation (`isorod.choices`).
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from isorod import choices
from isorod.arrays import Array
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.output.largest import TIED

# Results by their names: numbers or arrays of them.
Measured = dict[str, Array]

# Building perturbed models is most of the cost of a derivative: two, at this relative step of it, are enough.
# At the same displacement forces are rounded alike, and errors are below 1e-9 of the derivative.
NEAR = 1e-6

# A larger step, where between those a point of friction happens to come into contact.
ASIDE = 1e-5

# Differences of fourth order by four models: for modes, which need more digits; and with the larger step where rounding
# differs, as of fitted values and of matrices.
BY, WIDE = 1e-4, 1e-3

# Central, or one-sided where the parameter is at a bound.
_TWO, _FOUR = ((-1, 1), (-1, -2), (1, 2)), ((-2, -1, 1, 2), (-1, -2, -3, -4), (1, 2, 3, 4))
_PLACES = {NEAR: _TWO, ASIDE: _TWO, BY: _FOUR, WIDE: _FOUR}

# There is no derivative where the slope jumps by more than this fraction of it.
APART = 1e-2

# Derivatives below this fraction of value over parameter count as zero.
_NOTHING = 1e-3


_JUMPS = "the slope of {} jumps, as where the largest of several changes its place"


class Unavailable(InputError):
    """Derivatives at a solution alone are not available, for instance as it depends on a path that is not repeated."""


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of results by parameters.

    Attributes
    ----------
    parameters
        Values of the parameters, by name.
    values
        Results, by name.
    by
        Derivatives, ``by[parameter][result]`` of the shape of the result.
    none
        Parameters without a derivative, and the reason.
    errors
        For parameters whose derivatives are finite differences of solutions (`isorod.design.differences`), the relative
        error estimates by result; empty where these were not requested.
    why
        The reason for finite differences; empty where there are none.
    means
        For parameters without a derivative because places of equal largest value have different ones, the mean of
        these.
    """

    parameters: Mapping[str, float]
    values: Measured
    by: Mapping[str, Measured]
    none: Mapping[str, str] = field(default_factory=dict)
    errors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    why: str = ""
    means: Mapping[str, Measured] = field(default_factory=dict)

    def of_peaks(self) -> "Derivatives":
        """Return them without those of places with an equal largest value, which has one where these agree."""
        by, means, none = dict[str, Measured](), dict[str, Measured](), dict(self.none)
        for name, rates in self.by.items():
            own, size = _without_ties(rates), abs(self.parameters[name])
            tied = {result: rates[result + TIED] for result in own if result + TIED in rates}
            parted = {
                result: slopes.mean(axis=-1)
                for result, slopes in tied.items()
                if largest(np.ptp(slopes, axis=-1)) > APART * scale(slopes, self.values[result], size)
            }
            if parted:
                none[name], means[name] = _JUMPS.format(next(iter(parted))), own | parted
            else:
                by[name] = own
        return replace(self, values=_without_ties(self.values), by=by, none=none, means=means)

    def averaged(self) -> "Derivatives":
        """Return them with means where places of equal value differ, which suffice to search a bound or a minimum."""
        none = {name: why for name, why in self.none.items() if name not in self.means}
        return replace(self, by={**self.by, **self.means}, none=none, means={})

    def checked(self) -> "Derivatives":
        """Return them; raises `InputError` where there is none by one of the parameters."""
        for name, why in self.none.items():
            raise InputError(f"derivative by {name}: there is none here: {why}")
        return self

    def record(self) -> dict[str, dict[str, Any]]:
        """Return the entries of a record: for each result and parameter, with the value of the parameter."""
        at, errors = self.parameters, self.errors

        def derivative(parameter: str, name: str) -> dict[str, Any]:
            entry = {"at": at[parameter], "derivative": self.by[parameter][name].tolist()}
            return entry | ({"error_estimate": errors[parameter][name]} if parameter in errors else {})

        return {name: {parameter: derivative(parameter, name) for parameter in self.by} for name in self.values}


class Kinked(Exception):
    """There is no derivative, or none at this step size; the message gives the reason."""


@dataclass(frozen=True)
class Steps:
    """Steps of a parameter, and the finite difference formulas on them.

    Attributes
    ----------
    offsets, step
        The steps in multiples of ``step``, and this.
    size
        Size of the parameter, which sets the scale of derivatives near zero.
    """

    offsets: Sequence[int]
    step: float
    size: float

    @property
    def steps(self) -> list[float]:
        """The steps."""
        return [offset * self.step for offset in self.offsets]

    @property
    def weights(self) -> Array:
        """Weights of the derivative, for values at the steps less that at zero."""
        return self._weights(1) / self.step

    def _weights(self, order: int) -> Array:
        powers = np.vander(self.offsets, len(self.offsets) + 1, increasing=True)[:, 1:].T
        weights: Array = np.linalg.solve(powers, order * np.eye(len(self.offsets))[order - 1])
        return weights

    @property
    def jumps(self) -> Array:
        """Weights of the jump of the slope, for the same; with two steps curvature counts too, but is small."""
        if self.offsets == (-2, -1, 1, 2):
            # Second differences grow with the step at a kink, with its square elsewhere.
            return np.array([-1.0, 4.0, 4.0, -1.0]) / (2.0 * self.step)
        return self._weights(2) / self.step if len(self.offsets) == 2 else np.zeros(len(self.offsets))

    def slopes(self, perturbed: Sequence[Measured], values: Measured, held: Measured | None = None) -> Measured:
        """Return the derivatives of results, from those at the steps and those at zero.

        Raises
        ------
        Kinked
            Where a slope jumps by more than a fraction of it, including the derivatives ``held``.
        """
        derivatives = {}
        for name, value in values.items():
            rows = np.array([results[name] for results in perturbed]) - value
            derivatives[name] = np.einsum("i,i...->...", self.weights, rows)
            jump = largest(np.einsum("i,i...->...", self.jumps, rows))
            slope = derivatives[name] if held is None else derivatives[name] + held[name]
            if not jump <= APART * scale(slope, value, self.size):
                raise Kinked(_JUMPS.format(name.removesuffix(TIED)))
        return derivatives


class PerturbedModels:
    """Models with perturbed parameters, on the discretisation of a given one.

    Parameters
    ----------
    make
        Returns the model of parameters by their names.
    at
        The parameters of the given model.
    like
        The given model, whose unknowns they must have.

    Raises
    ------
    InputError
        If a parameter is zero, or ``make`` does not return the given model.
    """

    def __init__(self, make: Callable[[Mapping[str, float]], Model], at: Mapping[str, float], like: Model) -> None:
        for name, value in at.items():
            if not value or not np.isfinite(value):
                raise InputError(f"{name}: got {value:g}: a derivative is found by small shares of it, need a size")
        self.at, self._make, self._like = dict(at), make, like
        with silently(), choices.kept() as self._choices:
            self._refuse(make(self.at), "parameters")

    def models(self, name: str, fraction: float) -> tuple[Steps, list[Model]]:
        """Return models at steps of a fraction of a parameter, one-sided where there are none on the other side.

        Raises
        ------
        Kinked
            If there are none on either side.
        """
        size, why = abs(self.at[name]), ""
        for offsets in _PLACES[fraction]:
            steps = Steps(offsets, fraction * size, size)
            try:
                return steps, [self.model(name, step) for step in steps.steps]
            except InputError as problem:
                why = why or f"there is no model with a slightly different value: {problem}"
        raise Kinked(why)

    def model(self, name: str, step: float) -> Model:
        """Return the model at a step from a parameter; raises `InputError` where there is none."""
        with silently(), choices.repeated(self._choices, near=True):
            model = self._make(self.at | {name: self.at[name] + step})
        self._refuse(model, name)
        return model

    def _refuse(self, model: Model, name: str) -> None:
        if not np.array_equal(model.free, self._like.free):
            raise InputError(f"{name}: the discretisation changes with it, or is not that of the solution")

    def derivatives(
        self,
        values: Measured,
        begin: Callable[[Steps, Sequence[Model]], Any],
        fractions: Sequence[float],
        go_on: Callable[[Sequence[Any]], Sequence[Callable[[], Measured]]],
    ) -> Derivatives:
        """Return derivatives by all parameters.

        Parameters
        ----------
        values
            The results.
        begin
            Returns the data needed of the models at steps from a parameter, which are then released, or raises
            `Kinked`.
        fractions
            Relative steps, tried in this order until there is no kink.
        go_on
            Takes these data of several parameters, and returns for each a function that returns the derivatives by it,
            or raises `Kinked`.
        """
        by, none, left = {}, dict[str, str](), list(self.at)
        for fraction in fractions:
            begun = {}
            with silently():
                for name in left:
                    try:
                        begun[name] = begin(*self.models(name, fraction))
                    except Kinked as problem:
                        none[name] = str(problem)
                for name, end in zip(begun, go_on(list(begun.values())), strict=True):
                    try:
                        by[name] = end()
                    except Kinked as problem:
                        none[name] = str(problem)
            left = [name for name in left if name not in by]
        # In the order of the parameters.
        by = {name: by[name] for name in self.at if name in by}
        return Derivatives(self.at, values, by, {name: none[name] for name in left}).of_peaks()


def near(ask: Callable[..., Measured], *at: Any) -> tuple[Measured, Callable[..., Measured]]:
    """Return the results of a state, and a function for those near it, with the choices made there."""
    with silently(), choices.kept() as made:
        values = ask(*at)

    def asked(*there: Any) -> Measured:
        try:
            with choices.repeated(made, near=True):
                return ask(*there)
        except InputError as problem:
            raise Kinked(f"results are not available at a slightly different value: {problem}") from problem

    # The function adds places of equal value.  What fails here does so for each parameter, where it is reported.
    with suppress(Kinked):
        values = asked(*at)
    return values, asked


def _without_ties(measured: Measured) -> Measured:
    """Return the results without the values of places of equal value."""
    return {name: value for name, value in measured.items() if not name.endswith(TIED)}


def scale(rate: Array, value: Array, size: float) -> float:
    """Return the size of a derivative by a parameter, relative to which its errors are."""
    return max(largest(rate), _NOTHING * largest(value) / size) or 1.0


def largest(values: Array) -> float:
    """Return the largest magnitude of some values, infinite where one is not a number."""
    size = np.abs(values).max(initial=0.0)
    return float(size) if np.isfinite(size) else np.inf


def silently() -> warnings.catch_warnings:
    """Suppress warnings, which the model itself has raised."""
    return warnings.catch_warnings(action="ignore")
