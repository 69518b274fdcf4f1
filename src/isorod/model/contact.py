"""What a user says of contact."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isorod.errors import Checked, InputError, whole_number

if TYPE_CHECKING:
    from isorod.space.space import Space

Vector = tuple[float, float, float]

# Gauss points along an element or round an arc, at most.
MAX_POINTS = 64


@dataclass(frozen=True)
class Plane(Checked):
    """A rigid half space that ends at ``point``; ``normal``, of any length, points out of it, to where the rod is."""

    point: Vector
    normal: Vector

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_vector("plane: point", self.point, False)
        _check_vector("plane: normal", self.normal, True)


@dataclass(frozen=True)
class Cylinder(Checked):
    """A rigid circular cylinder without ends, which rods stay out of; ``axis``, of any length, is its direction."""

    point: Vector
    axis: Vector
    radius: float

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_vector("cylinder: point", self.point, False)
        _check_vector("cylinder: axis", self.axis, True)
        if not (np.isfinite(self.radius) and self.radius > 0.0):
            raise InputError(f"cylinder: got radius {self.radius:g}, need a positive length")


@dataclass(frozen=True)
class Contact(Checked):
    """Frictionless contact of a body with another one, or with a rigid obstacle.

    Parameters
    ----------
    first, second
        Indices of two bodies of the model; ``second`` may be a `Plane` or a `Cylinder`.
    penalty
        Pressure per depth of penetration, force / length^3.
    first_elements, second_elements
        Axis elements whose surfaces take part; all where not given.
    points
        Gauss points round each arc of the section and along each element; 3 and degree + 1 where not given; in
        the statics of scene files so many that they are no farther apart than a 48th of the way round.
    penetration
        If given, statics solves an augmented Lagrangian: multipliers are added until no point penetrates deeper than
        this length.
    faces
        End faces of the first body, ``"start"`` or ``"end"``, that meet a plane besides its lateral surface (dynamics
        alone).

    Raises
    ------
    InputError
        If a number is out of range, or the body is in contact with itself.
    """

    first: int
    second: "int | Plane | Cylinder"
    penalty: float
    first_elements: Sequence[int] | None = None
    second_elements: Sequence[int] | None = None
    points: tuple[int, int] | None = None
    penetration: float | None = None
    faces: Sequence[str] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (np.isfinite(self.penalty) and self.penalty > 0.0):
            raise InputError(f"contact: got penalty {self.penalty:g}, need a positive pressure per length")
        if self.first == self.second:
            raise InputError(f"contact: body {self.first} with itself; contact needs two different bodies")
        if self.points is not None:
            if len(self.points) != 2:
                raise InputError(f"contact: got points {self.points}, need two numbers: round an arc, along an element")
            for name, count in zip(("round an arc", "along an element"), self.points, strict=True):
                whole_number(f"contact: points {name}", count, 1, MAX_POINTS)
        if self.penetration is not None and not (np.isfinite(self.penetration) and self.penetration > 0.0):
            raise InputError(f"contact: got penetration {self.penetration:g}, need a positive length")
        if self.faces and not isinstance(self.second, Plane):
            raise InputError("contact: faces are given, but end faces meet planes alone")
        if set(self.faces) - {"start", "end"}:
            raise InputError(f"contact: got faces {tuple(self.faces)}, need some of 'start' and 'end'")
        if self.rigid and self.second_elements is not None:
            raise InputError("contact: second_elements are given, but the second partner is rigid and has none")

    @property
    def rigid(self) -> bool:
        """True if the second partner is an obstacle."""
        return isinstance(self.second, Plane | Cylinder)

    @property
    def sides(self) -> list[tuple[int, Sequence[int] | None]]:
        """Bodies that take part, each with its elements."""
        sides: list[tuple[int, Sequence[int] | None]] = [(self.first, self.first_elements)]
        if not isinstance(self.second, Plane | Cylinder):
            sides.append((self.second, self.second_elements))
        return sides

    def check(self, index: int, spaces: "Sequence[Space]") -> None:
        """Raise `InputError` if a body or an element is not there.

        Parameters
        ----------
        index
            The contact's own in the model.
        spaces
            Those of the model's bodies.
        """
        where = f"contact {index}"
        for body, elements in self.sides:
            if not _is_index(body, len(spaces)):
                raise InputError(f"{where}: body {body!r} is not one of the {len(spaces)} bodies")
            if not spaces[body].basis.on_surface:
                raise InputError(
                    f"{where}: body {body} has section functions without control points, which contact needs"
                )
            count = spaces[body].axis.elements
            if elements is None:
                continue
            if not len(elements):
                raise InputError(f"{where}: no elements of body {body} are named; leave them out to take all")
            for e in elements:
                if not _is_index(e, count):
                    raise InputError(f"{where}: element {e!r} is not in body {body}, which has {count}")


def refuse(contacts: Sequence[Contact], *, penetration: bool = False, faces: bool = False) -> None:
    """Raise `InputError` if a contact asks for what the caller has not: a largest penetration, end faces."""
    for index, contact in enumerate(contacts):
        if penetration and contact.penetration is not None:
            raise InputError(f"contact {index}: a largest penetration (augmented Lagrangian) is for statics alone")
        if faces and contact.faces:
            raise InputError(f"contact {index}: contact of end faces is for explicit dynamics alone")


def _is_index(value: object, count: int) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and 0 <= int(value) < count


def _check_vector(name: str, vector: Vector, direction: bool) -> None:
    values = np.asarray(vector, dtype=float)
    if values.shape != (3,) or not np.isfinite(values).all():
        raise InputError(f"{name}: got {vector}, need three finite numbers")
    if direction and not values.any():
        raise InputError(f"{name}: got {vector}, need a direction")
