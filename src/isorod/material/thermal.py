"""Thermal expansion of any law: the stress is that of the strain minus the free expansion."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array, Index
from isorod.errors import InputError, finite, numbers
from isorod.material.fibre import Fibre
from isorod.material.law import Material
from isorod.material.memory import compiled_in, has_memory, states_after
from isorod.material.orthotropic import Orthotropic, TransverselyIsotropic
from isorod.material.places import Places
from isorod.material.points import STATES, Compiled

if TYPE_CHECKING:
    from isorod.material.energy import Energy

# Larger free strains are taken for a mistaken unit.
_MOST = 0.2

# Excess of a temperature over the range of its table, relative to this, that is rounding.
_ROUNDED = 1e-9


def _expanded(module: str, name: str, kind: tuple[int, int, bool], *given: Any) -> "Energy":
    """Return the expanded energy of a function given by module and name, which are the same in all processes."""
    from isorod.material.expansion import expanded

    return expanded(getattr(import_module(module), name)(*given), *kind)


def bare(law: Material) -> Material:
    """Return a law without its thermal expansion."""
    return law.law if isinstance(law, Thermal) else law


@dataclass(frozen=True, eq=False)
class Thermal(Material):
    """A law with thermal expansion, and with moduli that depend on the temperature.

    Parameters
    ----------
    law
        The law at the reference temperature.
    expansion
        Coefficient of linear expansion, 1 / temperature; or several: along the fibres of a law with one family and
        across them, or along the three axes of an orthotropic one.
    temperature
        Change of temperature from the stress-free state at full load; it grows with the load factor.  A number, or a
        function of the rod's places (`isorod.material.places.Places`) that returns one for each.
    stiffness
        Factor of the law's stiffness: points ``(temperature, factor)``, temperatures ascending, linear between them;
        1 at all temperatures if not given.
    history
        In statics the factor of the temperature by time, rows of time and factor (`isorod.model.history.InTime`).

    Raises
    ------
    InputError
        If a value is not finite, a free strain is above 0.2, the number of coefficients does not fit the law, or a
        temperature lies outside the table.
    """

    law: Material
    expansion: float | Sequence[float]
    temperature: float | Callable[[Places], ArrayLike]
    stiffness: Sequence[tuple[float, float]] = ()
    history: Any = None

    # Current factor of the temperature.
    _heat: ClassVar[float] = 1.0

    def _check(self) -> None:
        if isinstance(self.law, Thermal):
            raise InputError("law: got one that expands already")
        if self.law.remembers and len(self.stiffness):
            raise InputError(
                f"stiffness: constants of {type(self.law).__name__} do not depend on the temperature; leave it out"
            )
        if self.law.width + self._field > STATES:
            raise InputError("temperature: the law has too many states for one that differs by place; give a number")
        along = numbers("expansion", self.expansion)
        finite("expansion", along.ravel())
        along_and_across = self.law.families == 1 or isinstance(self.law, TransverselyIsotropic)
        most = 3 if isinstance(self.law, Orthotropic) else 2 if along_and_across else 1
        if along.ndim > 1 or along.size not in (1, most):
            several = {1: "", 2: ", or two: along its fibres and across", 3: ", or three along its axes"}[most]
            raise InputError(f"expansion: got {along.size} numbers, need one{several}")
        self._check_table()
        if not callable(self.temperature):
            finite("temperature", self.temperature)
            self._refuse(np.asarray(float(self.temperature)))
        if along.size > 1:
            # Raises if there is no such energy.
            _ = self.stored

    def _check_table(self) -> None:
        table = self._table
        if not (table.ndim == 2 and table.shape[1] == 2 and len(table) != 1 and np.isfinite(table).all()):
            raise InputError("stiffness: need two or more points (temperature, factor of the stiffness), all finite")
        if not (np.diff(table[:, 0]) > 0.0).all():
            raise InputError("stiffness: temperatures must ascend")
        if not (table[:, 1] > 0.0).all():
            raise InputError(f"stiffness: got a factor of {table[:, 1].min():g}, need positive ones")

    def _refuse(self, temperature: Array) -> None:
        """Raise `InputError` for temperatures that are too high, or outside the table of stiffness."""
        if not np.isfinite(temperature).all():
            raise InputError("temperature: it is not finite everywhere")
        # All temperatures up to that at full load are passed.
        ends = np.outer(self._factors, [temperature.min(initial=0.0), temperature.max(initial=0.0)])
        low, high = float(ends.min(initial=0.0)), float(ends.max(initial=0.0))
        strain = max(map(abs, self._along)) * max(-low, high)
        if not strain <= _MOST:
            raise InputError(f"temperature: expansion times temperature is {strain:g}, need a strain up to {_MOST:g}")
        if len(self._table):
            first, last = (float(one) for one in self._table[[0, -1], 0])
            rounded = _ROUNDED * (last - first)
            if not first - rounded <= low <= high <= last + rounded:
                outside = low if low < first - rounded else high
                raise InputError(
                    f"stiffness: its table is from {first:g} to {last:g}, the temperature runs through {outside:g}"
                )

    @cached_property
    def _along(self) -> tuple[float, ...]:
        return tuple(float(one) for one in np.ravel(self.expansion))

    @cached_property
    def _table(self) -> Array:
        return numbers("stiffness", self.stiffness) if len(self.stiffness) else np.zeros((0, 2))

    @property
    def _factors(self) -> Array:
        """Factors of the temperature that bound all others."""
        if self.history is None:
            return np.ones(1)
        factors = getattr(self.history, "factors", None)
        return np.ravel(np.asarray(self.history, dtype=float)[:, 1] if factors is None else factors)

    @property
    def _field(self) -> bool:
        """Whether the temperature differs by point."""
        return callable(self.temperature) or isinstance(self.temperature, np.ndarray)

    @property
    def kind(self) -> tuple[int, int, bool]:
        """Number of coefficients and of points of the table of stiffness, and whether temperatures differ by point."""
        return len(self._along), len(self._table), self._field

    @property
    def _uniform(self) -> float:
        """The constant ``heat``: the temperature, or its current factor if it differs by point."""
        return self._heat if self._field else self._heat * cast(float, self.temperature)

    @property
    def heated(self) -> bool:
        """Whether there is a free strain, or the stiffness changes."""
        hot = self._field or bool(self.temperature)
        return hot and (any(self._along) or bool((self._table[:, 1] != 1.0).any()))

    @property
    def values(self) -> tuple[float, ...]:
        """The law's constants, coefficients of expansion, ``heat``, and the table."""
        if has_memory(self.law):
            kernels, loses = self.law.compiled, "dissipated" in self.law.states
            given = kernels.block, kernels.tangent, kernels.update, self.law.width, loses
            return (*map(float, given), *self._along, self._uniform, float(self._field), *self.law.constants)
        return (*self.law.constants, *self._along, self._uniform, *self._table[:, 0], *self._table[:, 1])

    @cached_property
    def constants(self) -> Array:
        """The values of the symbols of its energy's constants, shape ``(c,)``."""
        return np.array(self.values)

    @cached_property
    def stored(self) -> "Energy":
        """Its energy as an expression."""
        from isorod.material.expansion import expanded

        return expanded(self.law.stored, *self.kind)

    @property
    def compiled(self) -> Compiled:
        """The addresses of its compiled functions."""
        from isorod.material.written import compiled, named

        if self.law.remembers:
            return compiled_in("warm_kernel")
        if not hasattr(self.law, "recipe"):
            return compiled(self.stored)
        make, *given = self.law.recipe
        return named(_expanded, make.__module__, make.__qualname__, self.kind, *given)

    @property
    def identity(self) -> str:
        """A text that identifies the law in any process."""
        given = self._along, self._field or self.temperature, self._table.tolist(), self.history
        return f"{type(self).__name__} {self.kind} {given} {self.law.identity}"

    @property
    def objective(self) -> bool:  # type: ignore[override]
        """Whether the law is objective."""
        return self.law.objective

    @property
    def linear(self) -> bool:  # type: ignore[override]
        """Whether its tangent is the same in all states, at all temperatures."""
        return self.law.linear and not len(self._table)

    @property
    def families(self) -> int:  # type: ignore[override]
        """Number of directions of the law."""
        return self.law.families

    @property
    def splits(self) -> bool:  # type: ignore[override]
        """Whether the law has a volumetric energy."""
        return self.law.splits

    @property
    def logarithmic(self) -> bool:  # type: ignore[override]
        """Whether the law's ``theta`` is ``ln J``."""
        return self.law.logarithmic

    @property
    def lame(self) -> float:  # type: ignore[override]
        """The modulus of the law's volumetric energy, force / area."""
        return self.law.lame

    @property
    def E(self) -> Any:
        """Young's modulus of the law, NaN if it has none."""
        return getattr(self.law, "E", np.nan)

    @property
    def nu(self) -> Any:
        """Poisson's ratio of the law, 0 if it has none."""
        return getattr(self.law, "nu", 0.0)

    @property
    def shear(self) -> Self:
        """The law without its volumetric energy."""
        return self._with(law=self.law.shear)

    def complementary(self, p: Array) -> tuple[Array, Array, Array]:
        """Return the Legendre transform of the volumetric energy, ``theta`` without that of the free expansion."""
        field = cast(Array, self.temperature) if self._field else 1.0
        temperature = np.broadcast_to(self._uniform * field, p.shape)
        strains = [one * temperature for one in self._along]
        strains = [*strains, *[strains[-1]] * (3 - len(strains))]
        free, size = sum(strains), np.ones(p.shape)
        if self.logarithmic:
            free = sum(np.log1p(one) for one in strains)
            size = np.exp(free)
        if len(self._table):
            size = size * np.interp(temperature, *self._table.T)
        value, slope, bend = self.law.complementary(p / size)
        return p * free + size * value, free + slope, bend / size

    @property
    def follows(self) -> bool:
        """Whether law or temperature depend on the rod's places and lack them (`placed`)."""
        return self.law.follows or callable(self.temperature)

    def placed(self, places: Places) -> Self:
        """Return the law at places of a rod."""
        temperature: Any = self.temperature
        if callable(temperature):
            values = numbers("temperature", temperature(places))
            try:
                temperature = np.array(np.broadcast_to(values, places.shape))
            except ValueError:
                raise InputError(
                    f"temperature: the function returns shape {values.shape}, need what broadcasts to {places.shape}"
                ) from None
            self._refuse(temperature)
        return self._with(law=self.law.placed(places), temperature=temperature)

    def some(self, places: Index) -> Self:
        """Return the law at some of its places."""
        temperature = self.temperature[places] if isinstance(self.temperature, np.ndarray) else self.temperature
        return self._with(law=self.law.some(places), temperature=temperature)

    @property
    def width(self) -> int:
        """Number of values for each point: the law's, and the temperature if it differs by point."""
        return self.law.width + self._field

    def known(self, shape: tuple[int, ...]) -> Array:
        """Return its values at points of some shape, ``(*shape, width)``."""
        values = self.law.known(shape)
        if not self._field:
            return values
        if callable(self.temperature):
            raise InputError("temperature: only a body knows its rod's places; give the law to one")
        temperature = np.broadcast_to(cast(Array, self.temperature), shape)
        return np.concatenate([values, temperature[..., None]], axis=-1)

    def fibres(self, shape: tuple[int, ...]) -> Array:
        """Return the unit vectors along the law's fibres at points."""
        return self.law.fibres(shape)

    def _fibres(self) -> tuple[Fibre, ...]:
        # The law has checked its own.
        return ()

    def at(self, factor: float) -> Self:
        """Return the law at a load factor: ``factor`` times the change of temperature."""
        return self._with(law=self.law.at(factor), _heat=factor * self._heat)

    def growing(self, over: "Callable[[Any], Callable[[float], float]]") -> Self:
        """Return the law with a temperature that grows by its own table, or the common one."""
        return self._with(law=self.law.growing(over), grows=over(self.history))

    def reached(self, factor: float) -> Self:
        """Return the law at a load factor, by its tables if it has some."""
        if self.grows is None:
            return self.at(factor)
        return self.at(self.grows(factor))._with(law=self.law.reached(factor))

    @property
    def remembers(self) -> bool:  # type: ignore[override]
        """Whether the law has memory."""
        return self.law.remembers

    @property
    def timed(self) -> bool:  # type: ignore[override]
        """Whether the law depends on time."""
        return self.law.timed

    @property
    def kinks(self) -> bool:  # type: ignore[override]
        """Whether the law has kinks."""
        return self.law.kinks

    @property
    def clock(self) -> int:  # type: ignore[override]
        """Number of the time's constant; the law's constants are the last ones."""
        return self.law.clock if self.law.clock < 0 else len(self.values) - self.law.constants.size + self.law.clock

    @property
    def states(self) -> Mapping[str, int]:  # type: ignore[override]
        """State variables of the law, at the strain without expansion."""
        return self.law.states

    @property
    def stores(self) -> bool:
        """Whether its energy is the stored energy."""
        return not has_memory(self.law) or self.law.stores

    def advanced(self, F: Array, factor: float) -> Self:
        """Return the law with its state at the end of a step, of ``F`` and load factor there."""
        return self.knowing(states_after(self, F, factor), factor) if self.remembers else self

    def knowing(self, states: Array, factor: float | None = None) -> Self:
        """Return the law with states at a load factor (`isorod.material.memory.Memory.knowing`)."""
        return self._with(law=self.law.knowing(states, factor)) if has_memory(self.law) else self

    def lasting(self, step: float) -> Self:
        """Return the law in a step of a motion of some time."""
        return self._with(law=self.law.lasting(step)) if has_memory(self.law) else self

    @property
    def frozen(self) -> Self:
        """The law without flow."""
        return self._with(law=self.law.frozen) if has_memory(self.law) else self

    @property
    def shear_modulus(self) -> float:
        """Smallest modulus of plane waves of the law, force / area."""
        return self.law.shear_modulus

    @property
    def modulus(self) -> float:
        """Modulus of pressure waves of the law, force / area."""
        return self.law.modulus

    @property
    def surface_modulus(self) -> float:
        """Stiffness of a surface of the law, force / area."""
        return self.law.surface_modulus

    @property
    def activation_work(self) -> float:
        """Maximum work of activation of the law, force / area."""
        return self.law.activation_work
