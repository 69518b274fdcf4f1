"""One vibration mode, and post-processing of any shape about a state."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.output.solids import WithSolids
from isorod.output.state import Animated, Deformation, Moment, Named

# Largest displacement of a mode that is drawn, over the model's size.
_EXAGGERATION = 0.12


@dataclass(frozen=True, eq=False, repr=False)
class Shape(Deformation, Animated, WithSolids):
    """A displacement of arbitrary amplitude about a state, evaluated at any point (`isorod.output.state`).

    Attributes
    ----------
    model, displacement
        What was solved, and the shape on all degrees of freedom, shape ``(dofs,)``.
    number
        Its number, from 0.
    state
        Displacement of the state, shape ``(dofs,)``: positions, centre lines and pictures add the shape to it; None for
        the state of rest.
    quarter
        Of a body that spins the shape a quarter of a period later, shape ``(dofs,)``, else None: it whirls.
    solids
        The shape of each solid's degrees of freedom on this rank (`function`).
    """

    number: int
    state: Array | None = None
    quarter: Array | None = None
    solids: Sequence[Array] = ()

    @property
    def _words(self) -> str:
        """Its title."""
        raise NotImplementedError

    def position(self, body: Named, u: ArrayLike, xi: ArrayLike | None = None, scale: float = 1.0) -> Array:
        """Return positions of points of a body, shape ``(..., 3)``: the state plus ``scale`` times the shape."""
        position = super().position(body, u, xi, scale)
        return position if self.state is None else position + Deformation(self.model, self.state).at(body, u, xi)

    def _moments(self) -> list[Moment]:
        from isorod.output.animation import amplitudes, quarters

        if self.quarter is None:
            return [Moment(self, self._words, one) for one in amplitudes()]
        places = [now * self.displacement + later * self.quarter for now, later in quarters()]
        return [Moment(replace(self, displacement=place, quarter=None), self._words) for place in places]

    _shape: ClassVar[bool] = True

    def _scale(self, largest: float) -> float:
        return _EXAGGERATION * self.model.size / largest

    def _mesh(self, body: int, colour: str) -> Any:
        mesh = super()._mesh(body, colour)
        if self.state is not None:
            mesh.points += Deformation(self.model, self.state)._mesh(body, colour).point_data["motion"]
        return mesh


@dataclass(frozen=True, eq=False, repr=False)
class Mode(Shape):
    """A mode shape, ``x^T M x = 1``.

    Attributes
    ----------
    frequency
        Cycles per time.
    """

    frequency: float = field(kw_only=True)

    def __repr__(self) -> str:
        return f"Mode {self.number} of {self.model!r}\n  frequency {self.frequency:.6g}"

    @property
    def _words(self) -> str:
        return f"mode {self.number}, frequency {self.frequency:.5g}"
