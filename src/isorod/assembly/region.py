"""Elements, and points of their sections, that obey one law: what compiled loops take at a time."""

from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array
from isorod.assembly import field_kernel, stiffness_kernel
from isorod.assembly.field_kernel import Functions
from isorod.assembly.pattern_kernel import Blocks
from isorod.material.along_rod import Laws, Piece
from isorod.space.space import Table

if TYPE_CHECKING:
    from isorod.assembly.extrapolation import Last

NONE = np.empty((0, 0))
_NONE = np.empty((0, 0, 0, 0))


class Region:
    """Elements ``first .. last - 1`` of a part, and points of their sections, that obey one law.

    Parameters
    ----------
    table
        Functions and geometry of the part.
    piece
        The elements, the points and the law.

    Attributes
    ----------
    table
        Functions and geometry of these elements and points.
    """

    def __init__(self, table: Table, piece: Piece) -> None:
        self.piece, self.first, self.last = piece, piece.first, piece.last
        self.table = table.part(slice(piece.first, piece.last), piece.points)

    @property
    def shape(self) -> tuple[int, ...]:
        """Elements, places along each and points in the section."""
        return self.table.weights.shape

    def own(self, values: Any) -> Any:
        """Return what arrays ``(E, ...)`` of the part's elements hold of these."""
        return values[self.first : self.last]

    def at_points(self, values: Array) -> Array:
        """Return what arrays ``(E, t, q)`` hold at these of the part's points, ``(E t, q)``; an empty one as it is."""
        if not values.size:
            return values
        return np.ascontiguousarray(self.own(values)[:, :, self.piece.points]).reshape(-1, self.shape[2])

    def _law(self, factor: float) -> tuple[Functions, Array]:
        law = self.piece.law.at(factor)
        one = law.compiled
        trace = not getattr(law, "logarithmic", True)
        fibres = law.fibres(self.shape) if law.fibrous else _NONE
        return Functions(one.point, one.block, one.tangent, trace, law.constants), fibres

    def add_forces(
        self, nodal: Array, factor: float, forces: Array, pressure: Array = NONE, wanted: bool = False
    ) -> float:
        """Add the internal forces of nodal displacements ``(E, l, n, 3)`` to those of the part's elements.

        Parameters
        ----------
        pressure
            That of the mixed formulation at the part's points ``(E, t, q)``, or an empty array.

        Returns
        -------
        energy
            That of the law, if it is wanted.
        """
        pressures = self.at_points(pressure)
        return field_kernel.add_forces(
            self.table, *self._law(factor), pressures, self.own(nodal), wanted, self.own(forces)
        )

    def add_stiffness(
        self,
        nodal: Array,
        factor: float,
        blocks: Blocks,
        entries: Array,
        pressure: Array = NONE,
        last: "Last | None" = None,
    ) -> None:
        """Add the tangents of the part's elements to entries.

        Parameters
        ----------
        pressure
            As in `add_forces`.
        last
            What the stress is extrapolated from, if it is.
        """
        before, earlier = (NONE, nodal) if last is None else (self.at_points(last.pressure), last.nodal)
        stiffness_kernel.add_stiffness(
            self.table,
            *self._law(factor),
            self.at_points(pressure),
            before,
            self.own(nodal),
            self.own(earlier),
            last is not None,
            Blocks(self.own(blocks.start), self.own(blocks.width), blocks.total),
            entries,
        )

    def set_jacobians(self, nodal: Array, out: Array) -> None:
        """Fill in ``det F`` at these of the part's points ``(E, t, q)``."""
        found = field_kernel.jacobians(self.table, self.own(nodal)).reshape(self.shape)
        self.own(out)[:, :, self.piece.points] = found


def regions(table: Table, laws: Laws) -> list[Region]:
    """Return the regions of the elements that a table has, which obey these laws."""
    return [Region(table, piece) for piece in laws.pieces]
