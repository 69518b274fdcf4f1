"""Laws whose stress depends on what was before: their state at points, and how it goes on.

In a step from one equilibrium to the next, the state is that of the step's beginning and the stress a function of the
deformation gradient at its end alone: residuals and tangents, however often and wherever they are asked for, change
nothing.  Where the step has been accepted, `Memory.advanced` returns the law with the state of its end.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeGuard

import numpy as np

from isorod.arrays import Array, Index
from isorod.compiled import flat
from isorod.errors import InputError
from isorod.material.law import Material
from isorod.material.points import Compiled, next_states

if TYPE_CHECKING:
    from isorod.material.energy import Energy


# A time that no run reaches.
_EVER = 1e300


class Memory(Material):
    """A law with a state at each point.

    Attributes
    ----------
    states
        Motions ask that the last of it is ``dissipated``: what was, per volume.  Names that begin with an underscore
        are the law's own, which no file of fields has.
    stores
        Whether its energy is what it stores.
    state
        The state at points of one step's beginning, shape ``(..., m)``; None at rest, where all are zero.
    """

    remembers: ClassVar[bool] = True
    stores: ClassVar[bool] = True
    state: Array | None = None

    @property
    def stored(self) -> "Energy":
        """None: raises."""
        raise InputError(f"{type(self).__name__}: a law with memory, which finite elements do not take")

    @property
    def identity(self) -> str:
        """Identifies the law, in any process."""
        return f"{type(self).__name__} {self.constants.tolist()}"

    @property
    def compiled(self) -> Compiled:
        """The addresses of its compiled functions."""
        raise NotImplementedError

    @property
    def width(self) -> int:
        """Number of values of its state at a point."""
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
        """Return the law with states ``(..., m)``, or more than its own behind them, of a load factor."""
        return self._with(state=np.ascontiguousarray(states[..., : self.width]))

    @property
    def frozen(self) -> Self:
        """The law where nothing flows: raises where it does not say."""
        raise InputError(f"{type(self).__name__}: modes and motions do not take this law; leave them out")

    def lasting(self, step: float) -> Self:
        """Return the law in a step of a motion that takes so long: itself where no time counts."""
        return self

    def some(self, places: Index) -> Self:
        """Return the law at some of the places, along the first axis, of its state."""
        return self if self.state is None else self._with(state=self.state[places])


class Timed(Memory):
    """A law with memory whose stress depends on the time that goes by."""

    timed: ClassVar[bool] = True
    clock: ClassVar[int] = 1

    # Time of the state, and from there to where the law is asked; that where it is the same whatever the load factor.
    since: float = 0.0
    step: float = 0.0
    during: float | None = None

    def at(self, factor: float) -> Self:
        """Return the law at a time."""
        return self._with(step=max(factor - self.since, 0.0) if self.during is None else self.during)

    def lasting(self, step: float) -> Self:
        """Return the law in a step that takes so long."""
        return self._with(step=step, during=step)

    @property
    def frozen(self) -> Self:
        """The law in no time."""
        return self.lasting(0.0)

    def growing(self, over: Callable[[Any], Callable[[float], float]]) -> Self:
        """Return the law as one that knows the time at a load factor."""
        return self._with(grows=over(((0.0, 0.0), (_EVER, _EVER))))

    def knowing(self, states: Array, factor: float | None = None) -> Self:
        """Return the law with states, and their time."""
        law = super().knowing(states)
        return law if factor is None else law._with(since=self.since + self.reached(factor).step)


def states_after(law: Material, F: Array, factor: float) -> Array:
    """Return the states of a law at the end of a step (`Memory.advanced`), and what else it knows behind them."""
    states, now = law._flat_known(F.shape[:-2]), law.reached(factor)
    next_states(now.compiled.update, flat(F), now.constants, states)
    return states.reshape(*F.shape[:-2], states.shape[-1])


def has_memory(law: Material) -> TypeGuard[Memory]:
    """Return whether a law has a memory: it does what `Memory` does."""
    return law.remembers
