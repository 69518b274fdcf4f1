"""Laws whose stress depends on the history: their state variables at points, and their update.

In a step from one equilibrium to the next, the state is that at the start of the step, and the stress a function of the
deformation gradient at its end alone: evaluating residuals and tangents changes nothing.  After the step has been
accepted, `Memory.advanced` returns the law with the state at its end.
"""

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeGuard

import numpy as np

from isorod.arrays import Array, Index
from isorod.compiled import flat
from isorod.errors import InputError
from isorod.material.law import Material
from isorod.material.points import Compiled, next_states

if TYPE_CHECKING:
    from isorod.material.energy import Energy


# A time beyond all runs.
_EVER = 1e300


class Memory(Material):
    """A law with a state at each point.

    Attributes
    ----------
    states
        Motions require that the last is ``dissipated``, the dissipated energy per volume.  Names that begin with an
        underscore are internal and not written to files of fields.
    stores
        Whether its energy is the stored energy.
    state
        The state variables at points at the start of a step, shape ``(..., m)``; None at rest, where all are zero.
    kernel
        Module of its compiled functions, in this folder.
    """

    remembers: ClassVar[bool] = True
    stores: ClassVar[bool] = True
    state: Array | None = None
    kernel: ClassVar[str]

    @property
    def stored(self) -> "Energy":
        """Raises `InputError`: a law with memory has no energy of ``F`` alone."""
        raise InputError(f"{type(self).__name__}: a law with memory, which finite elements do not take")

    @property
    def identity(self) -> str:
        """A text that identifies the law in any process."""
        return f"{type(self).__name__} {self.constants.tolist()}"

    @property
    def compiled(self) -> Compiled:
        """The addresses of its compiled functions."""
        return compiled_in(self.kernel)

    @property
    def width(self) -> int:
        """Number of components of its state at a point."""
        return sum(self.states.values())

    def known(self, shape: tuple[int, ...]) -> Array:
        """Return the state at points, shape ``(*shape, m)``."""
        width = self.width
        return np.zeros((*shape, width)) if self.state is None else np.broadcast_to(self.state, (*shape, width))

    def advanced(self, F: Array, factor: float) -> Self:
        """Return the law with the state at the end of a step.

        Parameters
        ----------
        F
            Deformation gradients at the end, shape ``(..., 3, 3)``.
        factor
            The load factor there.
        """
        return self.knowing(states_after(self, F, factor), factor)

    def knowing(self, states: Array, factor: float | None = None) -> Self:
        """Return the law with states ``(..., m)``, further values behind them ignored, at a load factor."""
        return self._with(state=np.ascontiguousarray(states[..., : self.width]))

    @property
    def frozen(self) -> Self:
        """The law without flow; raises `InputError` if it defines none."""
        raise InputError(f"{type(self).__name__}: modes and motions do not take this law; leave them out")

    def lasting(self, step: float) -> Self:
        """Return the law in a step of a motion of some time: itself if independent of time."""
        return self

    def some(self, places: Index) -> Self:
        """Return the law with its state at some of the places, along the first axis."""
        return self if self.state is None else self._with(state=self.state[places])


class Timed(Memory):
    """A law with memory whose stress depends on time."""

    timed: ClassVar[bool] = True
    clock: ClassVar[int] = 1

    # Time of the state; time from there to the evaluation; the latter if it does not depend on the load factor.
    since: float = 0.0
    step: float = 0.0
    during: float | None = None

    def at(self, factor: float) -> Self:
        """Return the law at a time."""
        return self._with(step=max(factor - self.since, 0.0) if self.during is None else self.during)

    def lasting(self, step: float) -> Self:
        """Return the law in a step of some time."""
        return self._with(step=step, during=step)

    @property
    def frozen(self) -> Self:
        """The law in a step of zero time."""
        return self.lasting(0.0)

    def growing(self, over: Callable[[Any], Callable[[float], float]]) -> Self:
        """Return the law with the time by load factor."""
        return self._with(grows=over(((0.0, 0.0), (_EVER, _EVER))))

    def knowing(self, states: Array, factor: float | None = None) -> Self:
        """Return the law with states and their time."""
        law = super().knowing(states)
        return law if factor is None else law._with(since=self.since + self.reached(factor).step)


def states_after(law: Material, F: Array, factor: float) -> Array:
    """Return the states of a law at the end of a step (`Memory.advanced`), with its other values behind them."""
    states, now = law._flat_known(F.shape[:-2]), law.reached(factor)
    next_states(now.compiled.update, flat(F), now.constants, states)
    # A ring may have no points.
    return states.reshape(*F.shape[:-2], states.shape[-1])


@cache
def compiled_in(kernel: str) -> Compiled:
    """Return the compiled functions in a module of this folder."""
    module = import_module(f"isorod.material.{kernel}")
    return Compiled(module.block, module.tangent, module.update)


def has_memory(law: Material) -> TypeGuard[Memory]:
    """Return whether a law has memory, and with it the methods of `Memory`."""
    return law.remembers
