"""Derivatives of what is measured by numbers of a model, from differences of models that are built beside it.

These are on the same discretisation (`isorod.choices`).
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from isorod import choices
from isorod.arrays import Array
from isorod.errors import InputError, SolveError
from isorod.model.model import Model

# What is measured, by its name: numbers or arrays of them.
Measured = dict[str, Array]

# Returns what is measured at steps from a parameter of a name.
Along = Callable[[str, Sequence[float]], list[Measured]]

# Builds are what a derivative costs.  Two models do, this share of the parameter from it, where what is measured bends
# by no more than ``_BENT`` of its slope over the step: of what goes with a power of the parameter the slope is then
# right to the square of that.
NEAR, _BENT = 2e-4, 1e-3

# On both sides of it; or on one, where the number may not be larger, or smaller.
_SIDES = ((-1, 1), (-1, -2), (1, 2))

# Where it bends more they are at so many steps, of which a derivative is of sixth order, of the inner four of fourth.
_OFFSETS = (-3, -2, -1, 1, 2, 3)
_WHOLE, _INNER = (0, 6), (1, 5)

# The first step, as a share of the parameter: rounding of forces, some 1e-16 of what elements pass on to each other,
# falls with it.  It is taken anew, shorter, where the two differ by more than ``_ALIKE``, and there is no derivative
# where they still differ by ``_APART``.
_STEP, _SHORTEST, _ATTEMPTS = 8e-3, 1e-5, 3
_ALIKE, _APART = 3e-8, 1e-2

# At a kink what lies evenly about it cancels: of second differences what grows with the step, not with its square, is
# the jump of the slope.
_JUMP = np.array([-1.0, 0.0, 9.0, 9.0, 0.0, -1.0]) / 6.0

# Less than so much of the value for the whole parameter counts as none.
_NOTHING = 1e-3


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
    """

    parameters: Mapping[str, float]
    values: Measured
    by: Mapping[str, Measured]
    none: Mapping[str, str] = field(default_factory=dict)

    def told(self) -> "Derivatives":
        """Return them; raises `InputError` where there is none by one of the parameters."""
        for name, why in self.none.items():
            raise InputError(f"derivative by {name}: there is none here: {why}")
        return self

    def record(self) -> dict[str, dict[str, Any]]:
        """Return them as a record keeps them: of what is measured, by each parameter, with the value that it has."""
        at = self.parameters
        return {
            name: {one: {"at": at[one], "derivative": rates[name].tolist()} for one, rates in self.by.items()}
            for name in self.values
        }


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

    def models(self, name: str, steps: Sequence[float]) -> list[Model]:
        """Return the models at steps from a parameter."""
        found = []
        for step in steps:
            with silently(), choices.repeated(self._choices):
                found.append(self._make(self.at | {name: self.at[name] + step}))
            self._refuse(found[-1], name)
        return found

    def _refuse(self, model: Model, name: str) -> None:
        if not np.array_equal(model.free, self._like.free):
            raise InputError(f"{name}: the discretisation changes with it, or is not that of the answer")

    def derivatives(self, values: Measured, along: Along) -> Derivatives:
        """Return derivatives by all parameters.

        Parameters
        ----------
        values
            What is measured.
        along
            Returns the same at steps from a parameter.
        """
        found = {name: self._by(name, values, along) for name in self.at}
        by = {name: one for name, one in found.items() if not isinstance(one, str)}
        return Derivatives(self.at, values, by, {name: one for name, one in found.items() if isinstance(one, str)})

    def _near(self, name: str, values: Measured, along: Along) -> Measured | None:
        """Return the derivatives of what hardly bends near a parameter, or None."""
        step = NEAR * abs(self.at[name])
        for offsets in _SIDES:
            try:
                with silently():
                    several = along(name, [offset * step for offset in offsets])
            except InputError:
                continue
            except SolveError:
                return None
            found = {}
            for one, value in values.items():
                rows = np.array([each[one] for each in several]) - value
                found[one] = _summed(weights(offsets), rows) / step
                bent = _largest(_summed(weights(offsets, 2), rows))
                if not bent <= _BENT * 2.0 * step * _scale(found[one], value, abs(self.at[name])):
                    return None
            return found
        return None

    def _by(self, name: str, values: Measured, along: Along) -> Measured | str:
        """Return the derivatives by a parameter, or why there are none."""
        near = self._near(name, values, along)
        if near is not None:
            return near
        best: Measured = {}
        size, least, jump, share = abs(self.at[name]), np.inf, np.inf, _STEP
        for _ in range(_ATTEMPTS):
            try:
                with silently():
                    several = along(name, [offset * share * size for offset in _OFFSETS])
            except (InputError, SolveError) as problem:
                why = f"models beside it cannot be had: {problem}"
                apart = np.inf
            else:
                rows = {one: np.array([each[one] for each in several]) - values[one] for one in values}
                found, fourth = (
                    {
                        one: _summed(weights(_OFFSETS[first:last]), row[first:last]) / (share * size)
                        for one, row in rows.items()
                    }
                    for first, last in (_WHOLE, _INNER)
                )
                offs, jumps = {}, []
                for one, value in values.items():
                    scale = _scale(found[one], value, size)
                    offs[one] = _largest(found[one] - fourth[one]) / scale
                    jumps.append(_largest(_summed(_JUMP, rows[one])) / (share * size * scale))
                worst = max(offs, key=lambda one: offs[one])
                why = f"differences of {worst} do not agree, as where the largest of several changes its place"
                apart = offs[worst]
                # Of a kink it stays as steps get shorter.
                jump = min(jump, max(jumps))
            if apart < least:
                best, least = found, apart
            if max(least / _ALIKE, jump / _APART) <= 1.0 or share == _SHORTEST:
                break
            cut = 0.05 if not apart < np.inf else np.clip(0.7 * (_ALIKE / max(apart, 1e-300)) ** 0.25, 0.03, 0.5)
            share = max(float(cut) * share, _SHORTEST)
        if least <= _APART < jump:
            why = "its slope jumps"
        return best if max(least, jump) <= _APART else why


def weights(offsets: Sequence[float], order: int = 1) -> Array:
    """Return the weights of a derivative, of values at offsets less that at none."""
    powers = np.vander(offsets, len(offsets) + 1, increasing=True)[:, 1:].T
    found: Array = np.linalg.solve(powers, order * np.eye(len(offsets))[order - 1])
    return found


def _summed(shares: Array, rows: Array) -> Array:
    found: Array = np.einsum("i,i...->...", shares, rows)
    return found


def _scale(rate: Array, value: Array, size: float) -> float:
    """Return the size of a derivative by a parameter, to which what it misses is compared."""
    return max(_largest(rate), _NOTHING * _largest(value) / size) or 1.0


def _largest(values: Array) -> float:
    """Return the largest size of some values, without bound where one is none."""
    found = np.abs(values).max(initial=0.0)
    return float(found) if np.isfinite(found) else np.inf


def silently() -> warnings.catch_warnings:
    """Say nothing: it was said of the model itself."""
    return warnings.catch_warnings(action="ignore")
