"""Contact definitions."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isorod.errors import Checked, InputError, finite, positive, whole_number
from isorod.model.moving import ObstacleMotion
from isorod.model.tie import LateralSurface, SolidSurface, Tie
from isorod.model.triangle_mesh import TriangleMesh

if TYPE_CHECKING:
    from isorod.fenics.solid import Solid
    from isorod.geometry.rod import Rod
    from isorod.space.space import Space

Vector = tuple[float, float, float]

# Gauss points along an element or round an arc, at most.
MAX_POINTS = 64

# Length over radius of a rod.  Two wires that pass each other, their ends moved by 1.5 radii: one of 25,000 radii takes
# 16 iterations, one of 250,000 radii is undone after five minutes, its stretching 1e11 times as stiff as its bending.
_SLENDEREST = 1e5


@dataclass(frozen=True)
class Plane(Checked):
    """A rigid half space with a boundary point ``point``; its ``normal``, of any length, points towards the rod.

    Parameters
    ----------
    point, normal
        A point of the plane, and the outward direction.
    travel
        Displacement along its normal at load factor 1 in statics: a plate pressed on the rods, whose force is
        ``ContactResult.resultant``.  The short form of a ``motion``.
    motion
        How it moves and turns; without, it stands.
    """

    point: Vector
    normal: Vector
    travel: float = 0.0
    motion: ObstacleMotion | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        finite("plane: point", self.point)
        _direction("plane: normal", self.normal)
        finite("plane: travel", self.travel, "a finite length")
        if self.travel and self.motion is not None:
            raise InputError("plane: travel and motion are given, need one of the two")
        if self.travel:
            displacement = self.travel * np.array(self.normal, dtype=float) / np.linalg.norm(self.normal)
            self._set(motion=ObstacleMotion(tuple(displacement)))
        if self.motion is not None:
            self._set(motion=self.motion.about(self.point))


@dataclass(frozen=True)
class Cylinder(Checked):
    """A rigid, infinite circular cylinder, which rods do not enter; ``axis``, of any length, is its direction.

    Parameters
    ----------
    point, axis, radius
        A point of its axis, the axis' direction, and its radius.
    motion
        How it moves and turns, about its own axis where no other is given; without, it stands.
    """

    point: Vector
    axis: Vector
    radius: float
    motion: ObstacleMotion | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        finite("cylinder: point", self.point)
        _direction("cylinder: axis", self.axis)
        positive("cylinder: radius", self.radius)
        if self.motion is not None:
            self._set(motion=self.motion.about(self.point, self.axis))


@dataclass(frozen=True)
class Sphere(Checked):
    """A rigid sphere, which rods do not enter.

    Parameters
    ----------
    center, radius
        Centre and radius of the sphere.
    motion
        How it moves and turns; without, it stands.
    """

    center: Vector
    radius: float
    motion: ObstacleMotion | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        finite("sphere: center", self.center)
        positive("sphere: radius", self.radius)
        if self.motion is not None:
            self._set(motion=self.motion.about(self.center))


Obstacle = Plane | Cylinder | Sphere | TriangleMesh


@dataclass(frozen=True)
class Contact(Checked):
    """Contact of bodies with others, with each other and themselves, or with a rigid obstacle.

    ``Contact(0)`` is that of a body with itself, ``Contact(range(7))`` that of seven bodies with each other and
    themselves, ``Contact(0, (1, 2))`` that of the first body with two others.

    Parameters
    ----------
    first, second
        Index of a body of the model, or of several; ``second`` may be an obstacle: `Plane`, `Cylinder`, `Sphere` or
        `TriangleMesh`, or facets of a finite element body.  Without it, those of ``first`` touch each other and
        themselves.
    penalty
        Pressure per depth of penetration, force / length^3; where not given, twice ``E / (1 - nu^2)`` of the
        softest side over the distance of its control points round the section (`isorod.contact.defaults`), of
        polynomials as many as there are functions on the surface.
    first_elements, second_elements
        Axis elements whose surfaces take part, where a side is one body; all where not given.
    points
        Gauss points round each arc of the section and along each element; of facets, points along each side, twice.
        Where not given, no farther apart than a 48th of the circumference, and more until enough are across the patch:
        in motions, without a checkpoint, at its largest force, for which they are solved again.
    penetration
        Statics solves an augmented Lagrangian (`isorod.statics.contact_policy`): multipliers are added until no point
        penetrates deeper than this length; where not given, a thousandth of the smallest radius, and, where a penalty
        is given, any.
    faces
        Removed: contact is that of lateral surfaces.
    friction
        Coulomb's coefficient: points stick up to that many times the pressure, on springs of the penalty's stiffness,
        and slip at it; 0 without friction.
    first_surface, second_surface
        ``"outer"`` or ``"inner"``: of hollow rods it may be the inner surface that touches the other side, which is in
        the hole.
    across
        Control points across a small patch for which scenes from files are solved again on closer spaces
        (`isorod.contact.patches`), 2 to 12; on these the penalty by default is 3.6 over so many times the modulus.

    Raises
    ------
    InputError
        If a number is out of range, or a body is on both sides.
    """

    first: int | Sequence[int]
    second: "int | Sequence[int] | Obstacle | SolidSurface | None" = None
    penalty: float | None = None
    first_elements: Sequence[int] | None = None
    second_elements: Sequence[int] | None = None
    points: tuple[int, int] | None = None
    penetration: float | None = None
    faces: Sequence[str] = ()
    friction: float = 0.0
    across: float = 5.0
    first_surface: str = "outer"
    second_surface: str = "outer"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.penalty is not None:
            positive("contact: penalty", self.penalty, "a positive pressure per length")
        if self.points is not None:
            for name, count in zip(("round an arc", "along an element"), self.points, strict=True):
                whole_number(f"contact: points {name}", count, 1, MAX_POINTS)
        if self.penetration is not None:
            positive("contact: penetration", self.penetration)
        if self.faces:
            raise InputError("contact: faces are given, but end faces touch nothing; leave faces out and add a support")
        if not (np.isfinite(self.friction) and self.friction >= 0.0):
            raise InputError(f"contact: got friction {self.friction:g}, need a coefficient, not negative")
        if not 2.0 <= self.across <= 12.0:
            raise InputError(f"contact: got {self.across:g} control points across a patch, need 2 to 12")
        for name in ("first_surface", "second_surface"):
            if getattr(self, name) not in ("outer", "inner"):
                raise InputError(f"contact: got {name} {getattr(self, name)!r}, need 'outer' or 'inner'")
        self._check_groups()
        self._check_surfaces()

    def _check_surfaces(self) -> None:
        """Raise `InputError` where an inner surface has no other surface in its hole to touch."""
        inner = [name == "inner" for name in (self.first_surface, self.second_surface)]
        if inner[1] and len(self.groups) == 1:
            raise InputError("contact: second_surface is given, but the second partner is rigid, facets, or none")
        if all(inner):
            raise InputError("contact: two inner surfaces never touch; take the outer surface of one rod")
        if inner[0] and self.second is None:
            raise InputError("contact: first_surface is 'inner', which touches what is in its hole; name second")

    def _check_groups(self) -> None:
        """Raise `InputError` where a side is empty, a body stands twice, or elements of several bodies are named."""
        if self.second_elements is not None and len(self.groups) == 1:
            raise InputError("contact: second_elements are given, but the second partner is rigid, facets, or none")
        for bodies, elements in zip(self.groups, (self.first_elements, self.second_elements), strict=False):
            if not bodies:
                raise InputError("contact: a side without a body; name at least one")
            if elements is not None and len(bodies) > 1:
                raise InputError("contact: elements are named, but of several bodies; take one, or leave them out")
        named = [body for bodies in self.groups for body in bodies]
        twice = {body for body in named if named.count(body) > 1}
        if twice:
            raise InputError(
                f"contact: body {min(twice)} with itself: it is named twice; leave second out for that, and for "
                "contact of all of them with each other"
            )

    @property
    def obstacle(self) -> Obstacle | None:
        """The second partner, where it is rigid."""
        return self.second if isinstance(self.second, Obstacle) else None

    @property
    def facets(self) -> SolidSurface | None:
        """The second partner, where it is a surface of a finite element body."""
        return self.second if isinstance(self.second, SolidSurface) else None

    @property
    def passes(self) -> int:
        """Number of slave surfaces: one with facets, else all sides."""
        return 1 if self.facets is not None else len(self.sides)

    def is_inner(self, body: int) -> bool:
        """Whether it is the inner surface of a body that takes part."""
        return (self.first_surface if body in self.groups[0] else self.second_surface) == "inner"

    def disk_radius(self, body: int, rod: "Rod") -> float:
        """Return the disk radius of the surface of ``body``, whose rod is given, that takes part."""
        return rod.rings[0] if self.is_inner(body) else 1.0

    @property
    def has_inner(self) -> bool:
        """Whether one side is an inner surface."""
        return "inner" in (self.first_surface, self.second_surface)

    @property
    def motion(self) -> ObstacleMotion | None:
        """How the obstacle moves, if it does."""
        return None if self.obstacle is None else self.obstacle.motion

    @property
    def groups(self) -> list[tuple[int, ...]]:
        """Rods of each side; one side where they touch each other, themselves, an obstacle or facets."""
        sides = [self.first]
        if self.second is not None and not isinstance(self.second, Obstacle | SolidSurface):
            sides.append(self.second)
        return [(side,) if isinstance(side, int | np.integer) else tuple(side) for side in sides]

    @property
    def sides(self) -> list[tuple[int, Sequence[int] | None]]:
        """Bodies that take part, each with its elements."""
        chosen = (self.first_elements, self.second_elements)
        return [(body, some) for bodies, some in zip(self.groups, chosen, strict=False) for body in bodies]

    def check(self, index: int, spaces: "Sequence[Space]", solids: int) -> None:
        """Raise `InputError` if a body or an element is not there.

        Parameters
        ----------
        index
            Index of the contact in the model.
        spaces
            Spaces of the model's bodies.
        solids
            Number of the model's finite element bodies.
        """
        where = f"contact {index}"
        if self.facets is not None and self.facets.solid >= solids:
            raise InputError(f"{where}: solid {self.facets.solid} is not one of the model's {solids}")
        for body, elements in self.sides:
            if not _is_index(body, len(spaces)):
                raise InputError(f"{where}: body {body!r} is not one of the {len(spaces)} bodies")
            if self.is_inner(body) and not spaces[body].rod.rings[0]:
                raise InputError(f"{where}: body {body} has no hole, but its inner surface is named")
            slenderness = spaces[body].rod.slenderness
            if slenderness > _SLENDEREST:
                raise InputError(
                    f"{where}: body {body} is {slenderness:.3g} radii long, rods in contact may be {_SLENDEREST:g}; "
                    "leave the contact out, or model the part that touches"
                )
            count = spaces[body].axis.elements
            if elements is None:
                continue
            if not len(elements):
                raise InputError(f"{where}: no elements of body {body} are named; leave them out to take all")
            for e in elements:
                if not _is_index(e, count):
                    raise InputError(f"{where}: element {e!r} is not in body {body}, which has {count}")


def refuse_in_motion(contacts: Sequence[Contact]) -> None:
    """Raise `InputError` for options of statics alone: motion by load factor, a largest penetration."""
    for index, contact in enumerate(contacts):
        if contact.motion is not None and contact.motion.plain:
            raise InputError(
                f"contact {index}: motion of the obstacle by load factor is for statics alone; give rows of time"
            )
        if contact.penetration is not None:
            raise InputError(f"contact {index}: a largest penetration (augmented Lagrangian) is for statics alone")


def refuse_tied(contacts: Sequence[Contact], ties: Sequence[Tie], solids: "Sequence[Solid]") -> None:
    """Raise `InputError` where a contact's surfaces are tied to each other completely: they never touch."""
    for index, contact in enumerate(contacts):
        for k, tie in enumerate(ties):
            if _same(contact, tie, solids):
                raise InputError(f"contact {index}: tie {k} holds the same surfaces; leave out one of the two")


def _same(contact: Contact, tie: Tie, solids: "Sequence[Solid]") -> bool:
    """Whether a tie joins the whole lateral surfaces of a contact to its other side."""
    rods = [one for one in (tie.slave, tie.master) if isinstance(one, LateralSurface)]
    if not rods or any(one.along is not None for one in rods):
        return False
    groups = contact.groups
    if any(all(one.body not in bodies for bodies in groups) for one in rods):
        return False
    if any((one.surface == "inner") != contact.is_inner(one.body) for one in rods):
        return False
    if contact.facets is None:
        across = len(groups) == 2 and (rods[0].body in groups[0]) != (rods[-1].body in groups[0])
        return len(rods) == 2 and (across or contact.second is None)
    held = next((one for one in (tie.slave, tie.master) if isinstance(one, SolidSurface)), None)
    if held is None or held.solid != contact.facets.solid:
        return False
    mine, other = contact.facets.facets, held.facets
    # Facets are each rank's own.
    meet = mine is None or other is None or np.intersect1d(mine, other).size > 0
    return bool(solids[held.solid].comm.allreduce(int(meet)))


def _is_index(value: object, count: int) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and 0 <= int(value) < count


def _direction(name: str, vector: Vector) -> None:
    finite(name, vector)
    if not np.any(vector):
        raise InputError(f"{name}: got {vector}, need a direction")
