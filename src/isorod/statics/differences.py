"""Derivatives of what is measured by numbers of a model, from differences of models that are built beside it.

These are on the same discretisation (`isorod.choices`).
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

# What is measured, by its name: numbers or arrays of them.
Measured = dict[str, Array]

# Models beside are what a derivative costs: two at this share of the parameter do.  At one displacement forces are
# rounded alike, and less than 1e-9 of a derivative is lost.
NEAR = 1e-6

# Where a point of friction happens to begin to touch elsewhere between these, two that are farther off.
ASIDE = 1e-5

# Four are of fourth order: for modes, which ask for more digits; and further off where rounding is not alike, as of
# what is fitted, and of matrices.
BY, WIDE = 1e-4, 1e-3

# On both sides; or on one, where the number may not be larger, or smaller.
_TWO, _FOUR = ((-1, 1), (-1, -2), (1, 2)), ((-2, -1, 1, 2), (-1, -2, -3, -4), (1, 2, 3, 4))
_PLACES = {NEAR: _TWO, ASIDE: _TWO, BY: _FOUR, WIDE: _FOUR}

# A slope that jumps by more than this share of it is none.
APART = 1e-2

# Less than so much of the value for the whole parameter counts as none.
_NOTHING = 1e-3


_JUMPS = "the slope of {} jumps, as where the largest of several changes its place"


class Unavailable(InputError):
    """Derivatives at an answer alone are not available: it depends on a path that is not taken again, or the like."""


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of what is measured by parameters.

    Attributes
    ----------
    parameters
        Their values, by name.
    values
        What is measured, by name.
    by
        Derivatives, ``by[parameter][measured]`` of the shape of what is measured.
    none
        Parameters by which there is no derivative, and why.
    errors
        Of parameters by which they are differences of whole answers (`isorod.design.differences`), the estimated error
        of each that is measured, as a share of it; without any where it was not asked for.
    why
        Why these are differences; empty where none are.
    means
        Of parameters by which there is none as places that tie for a largest value part, the mean of theirs.
    """

    parameters: Mapping[str, float]
    values: Measured
    by: Mapping[str, Measured]
    none: Mapping[str, str] = field(default_factory=dict)
    errors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    why: str = ""
    means: Mapping[str, Measured] = field(default_factory=dict)

    def of_peaks(self) -> "Derivatives":
        """Return them without those of places that tie for a largest value, which has one where theirs agree."""
        by, means, none = dict[str, Measured](), dict[str, Measured](), dict(self.none)
        for name, rates in self.by.items():
            own, size = _without_ties(rates), abs(self.parameters[name])
            tied = {one: rates[one + TIED] for one in own if one + TIED in rates}
            parted = {
                one: several.mean(axis=-1)
                for one, several in tied.items()
                if largest(np.ptp(several, axis=-1)) > APART * scale(several, self.values[one], size)
            }
            if parted:
                none[name], means[name] = _JUMPS.format(next(iter(parted))), own | parted
            else:
                by[name] = own
        return replace(self, values=_without_ties(self.values), by=by, none=none, means=means)

    def averaged(self) -> "Derivatives":
        """Return them with means where places that tie part, which will do in a search for a limit or a minimum."""
        none = {name: why for name, why in self.none.items() if name not in self.means}
        return replace(self, by={**self.by, **self.means}, none=none, means={})

    def told(self) -> "Derivatives":
        """Return them; raises `InputError` where there is none by one of the parameters."""
        for name, why in self.none.items():
            raise InputError(f"derivative by {name}: there is none here: {why}")
        return self

    def record(self) -> dict[str, dict[str, Any]]:
        """Return them as a record keeps them: of what is measured, by each parameter, with the value that it has."""
        at, errors = self.parameters, self.errors

        def one(parameter: str, name: str) -> dict[str, Any]:
            found = {"at": at[parameter], "derivative": self.by[parameter][name].tolist()}
            return found | ({"error_estimate": errors[parameter][name]} if parameter in errors else {})

        return {name: {parameter: one(parameter, name) for parameter in self.by} for name in self.values}


class Kinked(Exception):
    """There is no derivative, or it is not seen so near: says why."""


@dataclass(frozen=True)
class Steps:
    """Steps from a number, and of what is there the derivative by it.

    Attributes
    ----------
    offsets, step
        Steps in units of one.
    size
        How much the number may change as a whole, to which a derivative that hardly is one is compared.
    """

    offsets: Sequence[int]
    step: float
    size: float

    @property
    def steps(self) -> list[float]:
        """The steps."""
        return [one * self.step for one in self.offsets]

    @property
    def weights(self) -> Array:
        """Weights of the derivative, of values at the steps less that at none."""
        return self._weights(1) / self.step

    def _weights(self, order: int) -> Array:
        powers = np.vander(self.offsets, len(self.offsets) + 1, increasing=True)[:, 1:].T
        found: Array = np.linalg.solve(powers, order * np.eye(len(self.offsets))[order - 1])
        return found

    @property
    def jumps(self) -> Array:
        """Weights of the jump of the slope, of the same: of two steps what bends counts too, but that is little."""
        if self.offsets == (-2, -1, 1, 2):
            # Second differences grow with the step at a kink, with its square elsewhere.
            return np.array([-1.0, 4.0, 4.0, -1.0]) / (2.0 * self.step)
        return self._weights(2) / self.step if len(self.offsets) == 2 else np.zeros(len(self.offsets))

    def slopes(self, several: Sequence[Measured], values: Measured, others: Measured | None = None) -> Measured:
        """Return the derivatives of what is measured.

        Raises
        ------
        Kinked
            Where a slope jumps by more than a share of all that there is, that of ``others`` too.
        """
        found = {}
        for name, value in values.items():
            rows = np.array([one[name] for one in several]) - value
            found[name] = np.einsum("i,i...->...", self.weights, rows)
            jump = largest(np.einsum("i,i...->...", self.jumps, rows))
            whole = found[name] if others is None else found[name] + others[name]
            if not jump <= APART * scale(whole, value, self.size):
                raise Kinked(_JUMPS.format(name.removesuffix(TIED)))
        return found


class Beside:
    """Models beside one: of other parameters, on the same discretisation.

    Parameters
    ----------
    make
        Returns the model of parameters by their names.
    at
        Those of the one.
    like
        A model whose unknowns theirs must be.

    Raises
    ------
    InputError
        If a parameter has no size, or the model that is made is another one.
    """

    def __init__(self, make: Callable[[Mapping[str, float]], Model], at: Mapping[str, float], like: Model) -> None:
        for name, value in at.items():
            if not value or not np.isfinite(value):
                raise InputError(f"{name}: got {value:g}: a derivative is found by small shares of it, need a size")
        self.at, self._make, self._like = dict(at), make, like
        with silently(), choices.kept() as self._choices:
            self._refuse(make(self.at), "parameters")

    def models(self, name: str, share: float) -> tuple[Steps, list[Model]]:
        """Return models at steps of a share of a parameter, on one side of it where there are none on the other.

        Raises
        ------
        Kinked
            If there are none.
        """
        size, why = abs(self.at[name]), ""
        for offsets in _PLACES[share]:
            steps = Steps(offsets, share * size, size)
            try:
                return steps, [self.model(name, one) for one in steps.steps]
            except InputError as problem:
                why = why or f"models beside it cannot be had: {problem}"
        raise Kinked(why)

    def model(self, name: str, step: float) -> Model:
        """Return the model at a step from a parameter; raises `InputError` where there is none."""
        with silently(), choices.repeated(self._choices, near=True):
            model = self._make(self.at | {name: self.at[name] + step})
        self._refuse(model, name)
        return model

    def _refuse(self, model: Model, name: str) -> None:
        if not np.array_equal(model.free, self._like.free):
            raise InputError(f"{name}: the discretisation changes with it, or is not that of the answer")

    def derivatives(
        self,
        values: Measured,
        begin: Callable[[Steps, Sequence[Model]], Any],
        shares: Sequence[float],
        go_on: Callable[[Sequence[Any]], Sequence[Callable[[], Measured]]],
    ) -> Derivatives:
        """Return derivatives by all parameters.

        Parameters
        ----------
        values
            What is measured.
        begin
            Returns what is needed of models at steps from a parameter, which are then let go, or raises `Kinked`.
        shares
            How far off these are, one after the other until there is no kink.
        go_on
            Returns, of what is needed by several parameters, what returns the derivatives by each, or raises `Kinked`.
        """
        found, none, left = {}, dict[str, str](), list(self.at)
        for share in shares:
            begun = {}
            with silently():
                for name in left:
                    try:
                        begun[name] = begin(*self.models(name, share))
                    except Kinked as problem:
                        none[name] = str(problem)
                for name, end in zip(begun, go_on(list(begun.values())), strict=True):
                    try:
                        found[name] = end()
                    except Kinked as problem:
                        none[name] = str(problem)
            left = [name for name in left if name not in found]
        # In the order of the parameters.
        by = {name: found[name] for name in self.at if name in found}
        return Derivatives(self.at, values, by, {name: none[name] for name in left}).of_peaks()


def near(ask: Callable[..., Measured], *at: Any) -> tuple[Measured, Callable[..., Measured]]:
    """Return what is measured somewhere, and what asks for it near there, with the choices made there."""
    with silently(), choices.kept() as made:
        values = ask(*at)

    def asked(*there: Any) -> Measured:
        try:
            with choices.repeated(made, near=True):
                return ask(*there)
        except InputError as problem:
            raise Kinked(f"what is measured cannot be had beside it: {problem}") from problem

    # Beside them there are places that tie; what cannot be had again cannot by any parameter.
    with suppress(Kinked):
        values = asked(*at)
    return values, asked


def _without_ties(found: Measured) -> Measured:
    """Return what is measured without the values of places that tie."""
    return {name: one for name, one in found.items() if not name.endswith(TIED)}


def scale(rate: Array, value: Array, size: float) -> float:
    """Return the size of a derivative by a parameter, to which what it misses is compared."""
    return max(largest(rate), _NOTHING * largest(value) / size) or 1.0


def largest(values: Array) -> float:
    """Return the largest size of some values, without bound where one is none."""
    found = np.abs(values).max(initial=0.0)
    return float(found) if np.isfinite(found) else np.inf


def silently() -> warnings.catch_warnings:
    """Say nothing: it was said of the model itself."""
    return warnings.catch_warnings(action="ignore")
