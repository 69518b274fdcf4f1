"""Stiffness and mass per length of a rod's section, 6 x 6, as beam codes take them."""

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.errors import InputError, expect, numbers
from isorod.geometry.quadrature import WHOLE, section_points
from isorod.geometry.rod import Rod
from isorod.material.law import Material
from isorod.model.body import Body
from isorod.output.places import parameters
from isorod.output.prism import Prism
from isorod.output.progress import Teller
from isorod.output.section_forces import centroids, frames, normals
from isorod.space.basis import Functions
from isorod.space.polynomial import fine_rule, polynomials
from isorod.space.space import Space
from isorod.space.waves import Waves

# Forces of the six, and what they do work on, in the order of rows and columns.
FORCES = ("N", "Q1", "Q2", "T", "M1", "M2")

# A space of section functions is fine enough where the next coarser one changes no more than this; a warning says where
# even the finest ones differ by more than the other.
_ENOUGH, _WARN = 1e-3, 5e-3

# Degrees of polynomials; waves with them where these are not enough, of a degree along the radius that falls with the
# number of rings, by two a ring, down to the first of these.
_DEGREES = (6, 8)
_WAVES = (4, 8, 16, 24, 32)
_RADIAL = (4, 12)

# Waves times degrees at most, but for the first two.
_MOST = 1000

# A section has no principal axes of its own where its bending stiffnesses differ by less than this share.
_ROUND = 1e-9

# A section is a plane one if it is off its plane by no more than this share of its size.
_PLANE = 1e-2


@dataclass(frozen=True, eq=False)
class SectionProperties:
    """Stiffness and mass per length of a section, of the prism that has it: the rod is taken as straight there.

    Rows and columns are in the order ``N, Q1, Q2, T, M1, M2``, with the signs and directions of
    `isorod.output.section_forces.SectionForces`: axial force, positive in tension; shear forces along the first and the
    second direction of the section; torsion; bending moments about the first and the second direction.  What they do
    work on are the stretch of the axis, its two shears, its twist per length and its two curvatures: of displacements
    ``v`` and turns ``w`` of the section along and about normal ``n``, first and second direction ``v' + n x w`` and
    ``w'``.  The mass belongs to the velocities of ``v`` and ``w``.

    Attributes
    ----------
    stiffness
        Shape ``(6, 6)``: force for the block of forces, force length, force length^2 for that of moments.
    mass
        Shape ``(6, 6)``: mass / length, mass, mass length.
    point
        About which both are, in the section, shape ``(2,)``: along its first and second direction from its centroid.
    angle
        By which their directions are turned from those of the section, about the normal, degrees.
    area
        Of the section, length^2.
    centroid, frame
        Of the section at rest in space: shape ``(3,)``; normal, first and second direction, a row each, ``(3, 3)``.
    u
        Axis parameter of the section.
    error
        Estimated error of the stiffness: the most by which the energy of any six forces changes with coarser section
        functions.
    functions
        The section functions, in words.
    """

    stiffness: Array
    mass: Array
    area: float
    centroid: Array
    frame: Array
    u: float
    error: float
    functions: str
    point: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0

    def about(self, point: ArrayLike = (0.0, 0.0), angle: float = 0.0) -> "SectionProperties":
        """Return the same section's about another point, in turned directions, both those of the section itself.

        Parameters
        ----------
        point
            Shape ``(2,)``, from the section's centroid along its first and second direction, length: `shear_centre`,
            `tension_centre`, `mass_centre` are such.
        angle
            Of the new first direction from the section's own, about the normal, degrees: `principal_angle` is one.

        Raises
        ------
        InputError
            If the point has not two finite coordinates, or the angle is not finite.
        """
        place = numbers("point", point)
        if place.shape != (2,) or not np.isfinite(place).all():
            raise InputError(f"point: got {place.tolist()}, need two finite coordinates in the section")
        expect("angle", angle, float)
        if not np.isfinite(angle):
            raise InputError(f"angle: got {angle:g}, need degrees")
        change = np.linalg.solve(_motion(self.point, self.angle), _motion(place, angle))
        return replace(
            self,
            stiffness=_symmetric(change.T @ self.stiffness @ change),
            mass=_symmetric(change.T @ self.mass @ change),
            point=(float(place[0]), float(place[1])),
            angle=float(angle),
        )

    @property
    def compliance(self) -> Array:
        """The inverse of the stiffness, shape ``(6, 6)``."""
        return _symmetric(np.linalg.inv(self.stiffness))

    @property
    def tension_centre(self) -> Array:
        """Where an axial force bends nothing, shape ``(2,)``: from the centroid, in the section's own directions."""
        found = self.about().compliance
        first, second = -np.linalg.solve(found[4:, 4:], found[4:, 0])
        return np.array([-second, first])

    @property
    def shear_centre(self) -> Array:
        """Where shear forces twist nothing (Trefftz's, by energy), shape ``(2,)``, as `tension_centre`."""
        found = self.about().compliance
        return np.array([-found[3, 2], found[3, 1]]) / found[3, 3]

    @property
    def mass_centre(self) -> Array:
        """The centre of mass, shape ``(2,)``, as `tension_centre`; NaN where there is no mass."""
        found = self.about().mass
        with np.errstate(invalid="ignore"):
            return np.array([-found[0, 5], found[0, 4]]) / found[0, 0]

    @property
    def principal_angle(self) -> float:
        """By which the principal axes of bending are turned from the section's directions, -45 to 45 degrees."""
        first, mixed, _, second = np.linalg.inv(self.about().compliance[4:, 4:]).ravel()
        if np.hypot(first - second, 2.0 * mixed) <= _ROUND * (first + second):
            return 0.0
        angle = 0.5 * np.degrees(np.arctan2(2.0 * mixed, first - second))
        return float(angle - 90.0 * np.round(angle / 90.0))

    @property
    def EA(self) -> float:
        """Axial stiffness, force: of a force at the tension centre."""
        return float(1.0 / self.about(self.tension_centre).compliance[0, 0])

    @property
    def GA(self) -> Array:
        """Shear stiffness along both principal axes, force, shape ``(2,)``: of forces at the shear centre."""
        found = self.about(self.shear_centre, self.principal_angle).compliance
        return np.asarray(1.0 / np.diag(found)[1:3])

    @property
    def GJ(self) -> float:
        """Torsional stiffness, force length^2."""
        return float(1.0 / self.compliance[3, 3])

    @property
    def EI(self) -> Array:
        """Bending stiffness about both principal axes, force length^2, shape ``(2,)``."""
        found = self.about(angle=self.principal_angle).compliance
        return np.asarray(np.diag(np.linalg.inv(found[4:, 4:])))

    def __repr__(self) -> str:
        values = f"EA {self.EA:.6g}, GA {self.GA[0]:.6g} {self.GA[1]:.6g}, GJ {self.GJ:.6g}, EI {self.EI[0]:.6g} "
        return f"SectionProperties({values}{self.EI[1]:.6g}; mass {self.mass[0, 0]:.6g} per length)"


def section_properties(
    rod: Body | Rod,
    u: ArrayLike = "start",
    material: Material | Sequence[Material] | None = None,
    density: float | Sequence[float] = 0.0,
    progress: bool = False,
) -> SectionProperties:
    """Return stiffness and mass per length of a rod's section at an axis parameter.

    It is the section of a long prism: the rod is taken as straight there, and as untwisted and of one section.  Laws
    are linear, with their moduli at rest.  Warping, Poisson's effect and shear are those of Saint-Venant's exact
    solutions, on section functions that are chosen for it, whatever those of the body are; where two spaces of them
    differ by more than half a percent a warning says so.

    Parameters
    ----------
    rod
        A body; or a rod alone, with ``material`` and ``density``.
    u
        Axis parameter, or ``"start"`` or ``"end"``; at a knot the element above it is meant.
    material, density
        Of a rod, as `isorod.model.body.Body` takes them.
    progress
        Show how far it is on standard error, if it is long (`isorod.output.progress`).

    Raises
    ------
    InputError
        If the parameter is outside of the rod, a rod comes without a law or a body with one, a law is incompressible,
        or the section is not plane.
    """
    body = _body(rod, material, density)
    where = parameters(body.space, u)
    if where.size != 1:
        raise InputError(f"axis parameter u: got {where.size} of them, need one")
    where = where.reshape(1)
    prism, centroid, frame = _prism(body, where)
    with closing(Teller()) as report:
        stiffness, error, functions = _stiffness(prism, report if progress else lambda line: None)
    if not error <= _WARN:
        warnings.warn(
            f"section at u = {where[0]:.4g}: the stiffness is uncertain by {100.0 * error:.2g} %, by which the energy "
            f"of some forces changes to {functions}; there are no finer section functions",
            stacklevel=2,
        )
    return SectionProperties(
        stiffness=_symmetric(stiffness),
        mass=_symmetric(prism.mass()),
        area=prism.moments()[0],
        centroid=centroid,
        frame=frame,
        u=float(where[0]),
        error=error,
        functions=functions,
    )


def apart(first: Array, second: Array) -> float:
    """Return the largest share by which two stiffnesses ``(6, 6)`` differ in the energy of any strains."""
    return float(np.abs(np.linalg.eigvals(np.linalg.solve(first, second)) - 1.0).max())


def _body(rod: Body | Rod, material: Material | Sequence[Material] | None, density: float | Sequence[float]) -> Body:
    """Return the body that was given, or is made of what was given."""
    expect("section properties", rod, Body | Rod)
    if isinstance(rod, Body):
        if material is not None or np.any(np.asarray(density) != 0.0):
            raise InputError("section properties: a body has its own material and density; give these with a Rod alone")
        return rod
    if material is None:
        raise InputError("section properties: a Rod needs material=, such as LinearElastic(E=2e5, nu=0.3)")
    # Its space counts for nothing here.
    return Body(Space.paper(rod, section_degree=None if rod.rings == WHOLE else 1), material, density)


def _prism(body: Body, u: Array) -> tuple[Prism, Array, Array]:
    """Return the prism of a body's section at ``u`` ``(1,)`` about its centroid, the centroid, and the frame."""
    rod = body.space.rod
    xi, area = section_points(rod.section_points, fine_rule(rod.section_points, _DEGREES[-1]), rings=rod.rings)
    place, jacobian = rod.grid(xi, u)
    frame = frames(jacobian, area)[0]
    centroid = centroids(place, np.linalg.norm(normals(jacobian, area), axis=2))[0]
    first, values, _ = rod.axis.local(u)
    polygon = values[0] @ rod.control_points[first[0] + np.arange(rod.axis.degree + 1)].reshape(len(values[0]), -1)
    off, y, z = frame @ (polygon.reshape(-1, 3) - centroid).T
    if not np.abs(off).max() <= _PLANE * np.hypot(y, z).max():
        raise InputError(
            f"section at u = {u[0]:.4g}: its control points are off its plane by {np.abs(off).max():.3g}; a prism "
            "needs a plane section"
        )

    def field(points: Array) -> Array:
        """Return tangents at rest at disk points in the section's directions."""
        found = body.laws_at(u, points).at(0.0).tangent(np.tile(np.eye(3), (1, len(points), 1, 1)))[0]
        return np.asarray(np.einsum("raAbB,ia,jA,kb,lB->rijkl", found, frame, frame, frame, frame, optimize=True))

    moduli = field(_samples(rod.rings)).reshape(len(rod.rings) - 1, -1, 3, 3, 3, 3)
    if not np.isfinite(moduli).all():
        raise InputError("section properties: an incompressible law (nu = 0.5) has no moduli; take one near it, 0.4999")
    varies = bool(np.abs(moduli - moduli[:, :1]).max() > 1e-9 * np.abs(moduli).max())
    element = np.searchsorted(body.space.axis.breaks[1:-1], u[0], side="right")
    densities = body.densities.reshape(body.space.axis.elements, -1)[element]
    return (
        Prism(np.stack([y, z], axis=1), rod.rings, moduli[:, 0], densities, field if varies else None),
        centroid,
        frame,
    )


def _samples(rings: Sequence[float]) -> Array:
    """Return ten points of the disk in each ring, the first where moduli that do not vary are taken from."""
    radii, angles = np.array(rings), 2.0 * np.pi * np.arange(5) / 5
    radius = radii[:-1, None, None, None] + np.diff(radii)[:, None, None, None] * np.array([0.25, 0.75])[:, None, None]
    return np.asarray((radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)).reshape(-1, 2))


def _stiffness(prism: Prism, report: Callable[[Callable[[], str]], None]) -> tuple[Array, float, str]:
    """Return the stiffness, its estimated error, and the section functions it is from in words.

    Finer and finer functions, each among the next ones, are taken until they agree.
    """
    before: Array | None = None
    error = np.inf
    for basis, name in _finer(prism):
        report(partial(_line, name, error))
        found = prism.stiffness(basis())
        if before is not None:
            error = apart(before, found)
        if error <= _ENOUGH:
            break
        before = found
    return found, error, name


def _line(name: str, error: float) -> str:
    """Return what is said of how far it is."""
    return f"section on {name}" + (f", so far uncertain by {100.0 * error:.2g} %" if error < np.inf else "")


def _finer(prism: Prism) -> Iterator[tuple[Callable[[], Functions], str]]:
    """Yield what makes section functions, each finer than the ones before, and what they are in words."""
    for degree in _DEGREES if prism.rings == WHOLE else ():
        yield partial(polynomials, prism.rod, degree), f"polynomials of degree {degree}"
    rings = len(prism.rings) - 1
    radial = max(_RADIAL[0], _RADIAL[1] - 2 * rings)
    # Few waves add little to polynomials, and would say that these are right.
    for waves in _WAVES if prism.rings != WHOLE else _WAVES[1:]:
        if waves <= _WAVES[1] or (2 * waves + 1) * radial * rings <= _MOST:
            yield (
                partial(Waves, prism.rod, waves, radial),
                f"polynomials of degree {_DEGREES[-1]}, {waves} waves of degree {radial}",
            )


def _motion(point: ArrayLike, angle: float) -> Array:
    """Return the strains ``(6, 6)`` at the centroid by those about a point and in turned directions."""
    (y, z), cos, sin = np.asarray(point, dtype=float), np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
    arm = np.array([[0.0, -z, y], [z, 0.0, 0.0], [-y, 0.0, 0.0]])
    return np.block([[turn, arm @ turn], [np.zeros((3, 3)), turn]])


def _symmetric(matrix: Array) -> Array:
    return np.asarray(0.5 * (matrix + matrix.T))
