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
from isorod.geometry.disk import circle
from isorod.geometry.quadrature import WHOLE, section_points
from isorod.geometry.rod import Rod
from isorod.material.law import Material
from isorod.model.body import Body
from isorod.output.places import parameters
from isorod.output.prism import Prism
from isorod.output.progress import Reporter
from isorod.output.section_forces import centroids, frames, normals
from isorod.space.basis import Functions
from isorod.space.polynomial import fine_rule, polynomials
from isorod.space.space import Space
from isorod.space.waves import Waves

# The six forces and moments in the order of rows and columns.
FORCES = ("N", "Q1", "Q2", "T", "M1", "M2")

# Section functions are fine enough if the stiffness changes by no more than this from the next coarser ones; a warning
# is given if even the finest change it by more than the second.
_ENOUGH, _WARN = 1e-3, 5e-3

# Degrees of polynomials; waves added where these are not enough; the least and largest radial degree of waves, which
# falls by two with each ring.
_DEGREES = (6, 8)
_WAVES = (4, 8, 16, 24, 32)
_RADIAL = (4, 12)

# Number of wave functions at most, but for the first two steps.
_MOST = 1000

# Relative difference of bending stiffnesses below which principal axes are undetermined.
_ROUND = 1e-9

# Largest deviation of a plane section from its plane, relative to its size.
_PLANE = 1e-2


@dataclass(frozen=True, eq=False)
class SectionProperties:
    """Stiffness and mass per length of a section, as of a prism: the rod is taken as straight there.

    Rows and columns are in the order ``N, Q1, Q2, T, M1, M2``, with the signs and directions of
    `isorod.output.section_forces.SectionForces`: axial force, positive in tension; shear forces along the first and the
    second direction of the section; torsion; bending moments about the first and the second direction.  Conjugate to
    them are stretch, the two shears, twist per length and the two curvatures of the axis: ``v' + n x w`` and ``w'`` of
    displacements ``v`` and rotations ``w`` of the section along and about normal ``n``, first and second direction.
    The mass multiplies the rates of ``v`` and ``w``.

    Attributes
    ----------
    stiffness
        Shape ``(6, 6)``: force for the block of forces, force length, force length^2 for that of moments.
    mass
        Shape ``(6, 6)``: mass / length, mass, mass length.
    point
        Their reference point in the section, shape ``(2,)``: along first and second direction from the centroid.
    angle
        Rotation of their directions from those of the section, about the normal, degrees.
    area
        Area of the section, length^2.
    centroid, frame
        Those of the section at rest in space: ``(3,)``; normal, first and second direction, a row each, ``(3, 3)``.
    u
        Axis parameter of the section.
    error
        Estimated error of the stiffness: the largest relative change of the energy of any six forces with coarser
        section functions.
    functions
        Description of the section functions.
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
        """Return the properties about another point and in rotated directions, both relative to the section.

        Parameters
        ----------
        point
            Shape ``(2,)``, from the section's centroid along its first and second direction, length, such as
            `shear_centre`, `tension_centre`, `mass_centre`.
        angle
            Angle of the new first direction from that of the section, about the normal, degrees, such as
            `principal_angle`.

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
        """The point where an axial force causes no bending, ``(2,)``: from the centroid, in the section's frame."""
        compliance = self.about().compliance
        first, second = -np.linalg.solve(compliance[4:, 4:], compliance[4:, 0])
        return np.array([-second, first])

    @property
    def shear_centre(self) -> Array:
        """The point where shear forces cause no twist (Trefftz, by energy), shape ``(2,)``, as `tension_centre`."""
        compliance = self.about().compliance
        return np.array([-compliance[3, 2], compliance[3, 1]]) / compliance[3, 3]

    @property
    def mass_centre(self) -> Array:
        """The centre of mass, shape ``(2,)``, as `tension_centre`; NaN where there is no mass."""
        mass = self.about().mass
        with np.errstate(invalid="ignore"):
            return np.array([-mass[0, 5], mass[0, 4]]) / mass[0, 0]

    @property
    def principal_angle(self) -> float:
        """Angle of the principal axes of bending from the section's directions, -45 to 45 degrees."""
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
        compliance = self.about(self.shear_centre, self.principal_angle).compliance
        return np.asarray(1.0 / np.diag(compliance)[1:3])

    @property
    def GJ(self) -> float:
        """Torsional stiffness, force length^2."""
        return float(1.0 / self.compliance[3, 3])

    @property
    def EI(self) -> Array:
        """Bending stiffness about both principal axes, force length^2, shape ``(2,)``."""
        compliance = self.about(angle=self.principal_angle).compliance
        return np.asarray(np.diag(np.linalg.inv(compliance[4:, 4:])))

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

    The rod is taken there as a long prism: straight, untwisted and of constant section.  Laws are linear, with their
    moduli at rest.  Warping, lateral contraction and shear are those of Saint-Venant's exact solutions, on section
    functions chosen for them, independent of those of the body; a warning is given if the finest two spaces differ by
    more than half a percent.

    Parameters
    ----------
    rod
        A body; or a rod alone, with ``material`` and ``density``.
    u
        Axis parameter, or ``"start"`` or ``"end"``; at a knot that of the element above.
    material, density
        Those of a rod, as for `isorod.model.body.Body`.
    progress
        Whether to show the progress of long runs on standard error (`isorod.output.progress`).

    Raises
    ------
    InputError
        If the parameter is outside the rod, a rod is given without a law or a body with one, a law is incompressible,
        or the section is not plane.
    """
    body = _body(rod, material, density)
    where = parameters(body.space, u)
    if where.size != 1:
        raise InputError(f"axis parameter u: got {where.size} of them, need one")
    where = where.reshape(1)
    prism, centroid, frame = _prism(body, where)
    with closing(Reporter()) as report:
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
    """Return the largest relative difference of two stiffnesses ``(6, 6)`` in the energy of any strains."""
    return float(np.abs(np.linalg.eigvals(np.linalg.solve(first, second)) - 1.0).max())


def _body(rod: Body | Rod, material: Material | Sequence[Material] | None, density: float | Sequence[float]) -> Body:
    """Return the given body, or that of the given rod."""
    expect("section properties", rod, Body | Rod)
    if isinstance(rod, Body):
        if material is not None or np.any(np.asarray(density) != 0.0):
            raise InputError("section properties: a body has its own material and density; give these with a Rod alone")
        return rod
    if material is None:
        raise InputError("section properties: a Rod needs material=, such as LinearElastic(E=2e5, nu=0.3)")
    # The space does not matter here.
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
    deviation, y, z = frame @ (polygon.reshape(-1, 3) - centroid).T
    if not np.abs(deviation).max() <= _PLANE * np.hypot(y, z).max():
        raise InputError(
            f"section at u = {u[0]:.4g}: its control points are off its plane by {np.abs(deviation).max():.3g}; a "
            "prism needs a plane section"
        )

    def field(points: Array) -> Array:
        """Return tangents at rest at disk points in the section's directions."""
        tangent = body.laws_at(u, points).at(0.0).tangent(np.tile(np.eye(3), (1, len(points), 1, 1)))[0]
        return np.asarray(np.einsum("raAbB,ia,jA,kb,lB->rijkl", tangent, frame, frame, frame, frame, optimize=True))

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
    """Return ten points of the disk in each ring, at which moduli are compared."""
    radii = np.array(rings)
    radius = radii[:-1, None, None, None] + np.diff(radii)[:, None, None, None] * np.array([0.25, 0.75])[:, None, None]
    return np.asarray((radius * circle(5)).reshape(-1, 2))


def _stiffness(prism: Prism, report: Callable[[Callable[[], str]], None]) -> tuple[Array, float, str]:
    """Return the stiffness, its estimated error, and a description of its section functions.

    Nested section functions are refined until the stiffness converges.
    """
    before: Array | None = None
    error = np.inf
    for basis, name in _finer(prism):
        report(partial(_line, name, error))
        stiffness = prism.stiffness(basis())
        if before is not None:
            error = apart(before, stiffness)
        if error <= _ENOUGH:
            break
        before = stiffness
    return stiffness, error, name


def _line(name: str, error: float) -> str:
    """Return the line of progress."""
    return f"section on {name}" + (f", so far uncertain by {100.0 * error:.2g} %" if error < np.inf else "")


def _finer(prism: Prism) -> Iterator[tuple[Callable[[], Functions], str]]:
    """Yield constructors of section functions, from coarse to fine, and their descriptions."""
    for degree in _DEGREES if prism.rings == WHOLE else ():
        yield partial(polynomials, prism.rod, degree), f"polynomials of degree {degree}"
    rings = len(prism.rings) - 1
    radial = max(_RADIAL[0], _RADIAL[1] - 2 * rings)
    # Few waves add little to polynomials, so that the error would be underestimated.
    for waves in _WAVES if prism.rings != WHOLE else _WAVES[1:]:
        if waves <= _WAVES[1] or (2 * waves + 1) * radial * rings <= _MOST:
            yield (
                partial(Waves, prism.rod, waves, radial),
                f"polynomials of degree {_DEGREES[-1]}, {waves} waves of degree {radial}",
            )


def _motion(point: ArrayLike, angle: float) -> Array:
    """Return the transformation ``(6, 6)`` of strains about a point in rotated directions to those at the centroid."""
    (y, z), cos, sin = np.asarray(point, dtype=float), np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
    arm = np.array([[0.0, -z, y], [z, 0.0, 0.0], [-y, 0.0, 0.0]])
    return np.block([[turn, arm @ turn], [np.zeros((3, 3)), turn]])


def _symmetric(matrix: Array) -> Array:
    return np.asarray(0.5 * (matrix + matrix.T))
