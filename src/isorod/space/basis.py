"""Protocol of section functions of a space: a new kind of basis is one more file."""

from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isorod.arrays import Array, Index
from isorod.geometry.quadrature import Rule

# The families of elements, by their names in prints, records, pages and documents: harmonic functions of control
# points, those of a higher order, and polynomials across the section.
PAPER, POLYHARMONIC, POLYNOMIALS = FAMILIES = "the paper's element", "polyharmonic", "polynomials"


def family_of(order: int) -> str:
    """Return the family of functions of control points, by their polyharmonic order."""
    return PAPER if order == 1 else POLYHARMONIC


class Functions(Protocol):
    """Functions on the unit disk; those of control points (`isorod.space.Space.is_control_point`) add up to one."""

    @property
    def count(self) -> int:
        """Number of functions."""

    @property
    def is_control_point(self) -> NDArray[np.bool_]:
        """Whether a function is of a control point, shape ``(count,)``."""

    def functions(self, xi: ArrayLike) -> tuple[Array, Array]:
        """Return values ``(q, count)`` and gradients ``(q, count, 2)`` at points of the closed disk ``(q, 2)``."""

    def positions(self, polygons: Array) -> Array:
        """Return coefficients ``(layers, count, 3)`` of the map of the rod's control points ``(layers, n, 3)``."""


class SectionBasis(Functions, Protocol):
    """Functions that a space can have; their text is what a run prints, the family first.

    Attributes
    ----------
    on_surface
        Whether control points are round the surface and come first; otherwise contact takes the traces
        (`isorod.contact.traces`).
    """

    on_surface: ClassVar[bool]

    @property
    def family(self) -> str:
        """The family of elements that they make: one of `FAMILIES`, or a name of their own."""

    def auto(self, degree: int) -> Rule:
        """Return the cheapest rule with an error below that of the space, for a degree along the axis."""

    def full(self, degree: int) -> Rule:
        """Return a rule whose error is small beside that of the functions, thin sections included."""

    @property
    def pressure_count(self) -> int:
        """Number of section functions of the pressures for these displacements.

        Raises
        ------
        InputError
            If these allow no varying pressure.
        """

    def pressures(self, xi: ArrayLike) -> Array:
        """Return values ``(q, pressure_count)`` of these at points of the closed disk; 1 is in their span."""


def monomials(degree: int, second: int) -> Index:
    """Return exponents ``(m, 2)`` of the monomials of a total degree, and a degree in the second coordinate at most."""
    pairs = [(total - b, b) for total in range(degree + 1) for b in range(min(total, second) + 1)]
    return np.array(pairs, dtype=np.int64)
