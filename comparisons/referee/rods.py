"""A scenario's shear-deformable rod as a continuum: law, space, clamps, pins, and its shape at the start.

A scenario's rod is straight and round at rest, with moduli ``E`` and ``G``.  The body is the cylinder of its radius,
of a law that has both at rest, ``nu = E / (2 G) - 1``: stiffnesses are then ``E A``, ``E I`` and ``G J``, and shear is
what it is in a cylinder, with no coefficient to choose.  A clamp holds what a rod's clamp holds, a section's place and
its directions; its outline may swell and shrink.  A pin holds the section's place alone; where functions of control
points are asked for, two points of the circle and with them the line between: a hinge.

Nothing here knows the package: scenarios are read by the names of their attributes.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import isorod
from isorod.arrays import Array, Index
from isorod.geometry import bspline

# Cubic axes, sections that bend with anticlastic curvature: the rods of the scenarios are slender.
DEGREE, SECTION_DEGREE = 3, 2

# Functions of control points where rods touch: harmonic ones.
ORDER, POINTS = 1, 8

# Poisson's ratio that displacements alone carry without locking, to 1e-4 of a deflection from ten elements on; statics
# without contact takes 0.5 itself.
NEARLY = 0.49

# A direction is along another one, and a rod straight, to this relative tolerance.
_ALONG = 1e-6

CLAMPED, PINNED = "clamped", "pinned"


@dataclass(frozen=True, eq=False)
class Placed:
    """A scenario's rod, its body at rest, straight along a coordinate axis, and where it is at the start.

    Attributes
    ----------
    given
        The scenario's rod.
    body
        As isorod takes it.
    direction, normal
        Unit vectors ``(3,)``: along the rod at rest, and the material one whose motion is reported.
    initial
        Displacement of the nodes from rest to the start, shape ``(nodes, 3)``.
    """

    given: Any
    body: isorod.Body
    direction: Array
    normal: Array
    initial: Array

    @property
    def space(self) -> isorod.Space:
        """The body's space."""
        return self.body.space

    def ends(self) -> list[tuple[str, str]]:
        """Return the ends that are held, and how."""
        both = (("start", self.given.start.value), ("end", self.given.end.value))
        return [(which, how) for which, how in both if how in (CLAMPED, PINNED)]

    def layer(self, which: str) -> Index:
        """Return the nodes of an end."""
        space = self.space
        return (0 if which == "start" else space.layers - 1) * space.layer_nodes + np.arange(space.layer_nodes)


def law(material: Any, most: float = 0.5) -> isorod.NeoHookean:
    """Return the law with a scenario's moduli, Poisson's ratio at most ``most``; then ``G`` is larger, ``E`` right."""
    nu = material.youngs_modulus / (2.0 * material.shear_modulus) - 1.0
    if not -1.0 < nu <= 0.5 + 1e-9:
        raise NotImplementedError(
            f"E = {material.youngs_modulus:g} and G = {material.shear_modulus:g} make a Poisson's ratio of {nu:.3g}; "
            "a solid has one from -1 to 0.5"
        )
    return isorod.NeoHookean(material.youngs_modulus, min(nu, most))


def place(
    given: Any, elements: int, touching: bool = False, most: float = NEARLY, rest: ArrayLike = (0.0, 0.0, 0.0)
) -> Placed:
    """Return a scenario's rod as a body of so many elements along the axis; ``touching`` ones have surface points.

    It begins, at rest, at the scenario's start, or moved from there by ``rest``, ``(3,)``.
    """
    start, end = (np.asarray(given.centerline[k], dtype=float) for k in (0, -1))
    chord, start = end - start, start + np.asarray(rest)
    direction = np.zeros(3)
    largest = int(np.argmax(np.abs(chord)))
    direction[largest] = np.sign(chord[largest])
    line = isorod.straight(start=start, end=start + given.length * direction)
    rod = line.sweep(isorod.circle(POINTS if touching else 4, given.radius))
    if touching:
        space = isorod.Space(rod, elements, DEGREE, DEGREE - 1, order=ORDER, section_points=POINTS)
    else:
        space = isorod.Space(rod, elements, DEGREE, DEGREE - 1, section_degree=SECTION_DEGREE)
    material = law(given.material, most)
    formulation = "mixed" if material.nu == 0.5 else "displacement"
    body = isorod.Body(space, material, density=given.material.density, formulation=formulation)
    normal = np.asarray(given.normal, dtype=float)
    normal = normal - (normal @ direction) * direction
    if np.linalg.norm(normal) < 1e-9:
        raise NotImplementedError("a rod whose normal is along it")
    normal /= np.linalg.norm(normal)
    return Placed(given, body, direction, normal, _initial(given, space, direction, normal, material.nu))


def arms(space: isorod.Space) -> Array:
    """Return the coefficients of the section's points from its centre at rest, shape ``(layer_nodes, 3)``."""
    first, control_points = space.positions[: space.layer_nodes], space.basis.is_control_point
    return first - control_points[:, None] * first[control_points].mean(axis=0)


def interpolation(space: isorod.Space) -> tuple[Array, Array]:
    """Return relative lengths along the rod, one a layer, and the matrix of the axis functions there."""
    axis = space.axis
    places = bspline.greville(axis.knots, axis.degree)
    first, values, _ = axis.local(places)
    matrix = np.zeros((places.size, axis.count))
    for row, column, some in zip(matrix, first, values, strict=True):
        row[column : column + axis.degree + 1] = some
    return places, matrix


def _initial(given: Any, space: isorod.Space, direction: Array, normal: Array, nu: float) -> Array:
    """Return the displacement of a rod from rest to its start: sections turn with its curve and thin by stretch."""
    # Loaded where a scenario is run.
    from scipy.interpolate import CubicSpline

    count = max(len(given.centerline) - 1, 8)
    s = np.linspace(0.0, given.length, count + 1)
    curve = CubicSpline(s, given.nodes(count))
    material = CubicSpline(0.5 * (s[1:] + s[:-1]), given.directors(count))
    places, matrix = interpolation(space)
    along = places * given.length
    slope = curve(along, 1)
    stretch = np.linalg.norm(slope, axis=1, keepdims=True)
    tangent = slope / stretch
    first = material(along)
    first -= np.einsum("ta,ta->t", first, tangent)[:, None] * tangent
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    now = np.stack([first, np.cross(tangent, first)], axis=2) * stretch[:, :, None] ** -nu
    at_rest = arms(space) @ np.stack([normal, np.cross(direction, normal)], axis=1)
    centres = space.basis.is_control_point[:, None] * curve(along)[:, None]
    targets = centres + np.einsum("tab,nb->tna", now, at_rest)
    moved = np.linalg.solve(matrix, targets.reshape(places.size, -1))
    return moved.reshape(-1, 3) - space.positions


def held(placed: Placed, which: str, how: str) -> list[tuple[Index, str]]:
    """Return which nodes and components of an end a clamp or a pin holds."""
    space, nodes = placed.space, placed.layer(which)
    control_points = space.basis.is_control_point
    if how == PINNED and control_points.sum() == 1:
        return [(nodes[control_points], "xyz")]
    if how == PINNED:
        off = np.linalg.norm(np.cross(arms(space), placed.normal), axis=1)
        hinge = control_points & (off < _ALONG * placed.given.radius)
        if hinge.sum() != 2:
            raise NotImplementedError("a pin of a rod that touches another, its normal not across a coordinate plane")
        return [(nodes[hinge], "xyz")]
    if control_points.sum() != 1:
        raise NotImplementedError("a clamped rod that touches something")
    groups = [(nodes[control_points], "xyz")]
    for node, arm in zip(nodes, arms(space), strict=True):
        if not arm.any():
            continue
        # Along itself an arm may swell and shrink.
        own = "xyz"[int(np.argmax(np.abs(arm)))]
        if np.abs(arm).max() < (1.0 - _ALONG) * np.linalg.norm(arm):
            raise NotImplementedError("a clamp of a section whose axes are not those of space")
        groups.append((np.array([node]), "xyz".replace(own, "")))
    return groups


def supports(placed: Placed, body: int) -> list[isorod.Support]:
    """Return supports that hold a rod's ends where they are at the start."""
    return [
        isorod.Support(nodes, components, placed.initial[nodes], body=body)
        for which, how in placed.ends()
        for nodes, components in held(placed, which, how)
    ]


def loads(placed: Placed, gravity: Any, body: int) -> list[Any]:
    """Return a rod's weight and the forces on its ends."""
    loads: list[Any] = []
    if any(gravity):
        density = placed.given.material.density
        loads.append(isorod.BodyForce(tuple(density * component for component in gravity), body))
    for load in placed.given.loads:
        loads.append(isorod.SectionLoad.end(placed.space, load.at.value, tuple(load.force), body))
    return loads


def configuration(placed: Placed, state: Any, body: int, elements: int) -> tuple[Array, Array]:
    """Return a state in the package's form: nodes ``(elements + 1, 3)`` and directors ``(elements, 3)``."""
    rod = placed.space.rod
    _, jacobian = rod.grid([(0.0, 0.0)], [0.0])
    xi = np.linalg.lstsq(jacobian[0, 0, :, :2], placed.given.radius * placed.normal, rcond=None)[0]
    nodes = state.centre_line(body, elements + 1)
    middle = (np.arange(elements) + 0.5) / elements
    across = state.position(body, middle, xi) - state.position(body, middle)
    tangent = np.diff(nodes, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across -= np.einsum("ea,ea->e", across, tangent)[:, None] * tangent
    return nodes, across / np.linalg.norm(across, axis=1, keepdims=True)
