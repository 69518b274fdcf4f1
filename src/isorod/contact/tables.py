"""Frictionless contact between the lateral surfaces of rods, and of rods with rigid obstacles.

The penalty energy ``1/2 eps g^2`` per reference area, ``g`` the gap from a point of one surface (the slave) to the
closest point of the other (the master), is integrated over both surfaces in turn with half the weight each, so that
neither is preferred (Lu, CMAME 200 (2011) 726-741, on the paper's surface).  Forces are its exact derivative.

A point whose closest point lies on the open end of the master, or on the border of its named elements, is not in
contact: it is beyond the surface.

The energy has a continuous gradient, and a Hessian that jumps where points come and go and where feet cross joints of
arcs.  Newton's method converges quadratically once that has settled; a load step in which it does not settle runs out
of iterations and is cut (see `isorod.statics`).
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array, Index
from isorod.contact.packed import (
    CYLINDER,
    ELEMENT,
    FUNCTIONS,
    NOWHERE,
    PASS,
    PLANE,
    STATE,
    SURFACE,
    Packed,
)
from isorod.geometry.axis import Axis
from isorod.geometry.disk import boundary_functions
from isorod.model.contact import Contact, Cylinder, Plane

if TYPE_CHECKING:
    from isorod.model.model import Model
    from isorod.space.space import Space


class _Tables:
    """Rows of the tables of `Packed`, as they grow."""

    def __init__(self) -> None:
        self.surfaces: list[Any] = []
        self.elements: list[Any] = []
        self.passes: list[Any] = []
        self.carriers: list[Index] = []
        self.around: list[Array] = []
        self.along: list[Array] = []
        self.areas: list[Array] = []

    def surface(self, space: "Space", first_node: int, chosen: Sequence[int]) -> None:
        """Add a surface, to be the slave of the next pass."""
        axis, n = space.axis, space.points_around
        first = len(self.elements)
        rows = {e: first + k for k, e in enumerate(chosen)}
        alpha = np.pi / n
        row = (n, axis.degree + 1, first, len(rows), len(self.passes), space.turn, np.cos(alpha), np.sin(alpha))
        self.surfaces.append(row)
        for e in chosen:
            layers = np.zeros(FUNCTIONS, dtype=np.int64)
            layers[: axis.degree + 1] = first_node + space.element_layers[e] * space.layer_nodes
            self.carriers.append((layers[: axis.degree + 1, None] + np.arange(n)).ravel())
            beside = [(e + step) % axis.elements if space.rod.closed else e + step for step in (-1, 1)]
            self.elements.append((layers, _polynomials(axis, e), [rows.get(other, -1) for other in beside]))

    def slave(self, space: "Space", chosen: Sequence[int], master: int, contact: Contact, share: float) -> None:
        """Add the pass in which the last surface is the slave.

        Parameters
        ----------
        space, chosen
            Its space, and the elements of it that may touch.
        master
            Number of the other surface, or of an obstacle.
        contact
            What the user says.
        share
            Part of the energy that this pass gets.
        """
        across, along = contact.points or (3, space.axis.degree + 1)
        first_point = sum(areas.size for areas in self.areas)
        starts = (first_point, across, along, len(self.around), len(self.along))
        row = (len(self.surfaces) - 1, master, *starts, contact.penalty, *_obstacle(contact))
        self.passes.append(row)
        x, w = np.polynomial.legendre.leggauss(across)
        t, v = np.polynomial.legendre.leggauss(along)
        n = space.points_around
        local = np.pi / n * x
        self.around.extend(np.roll(boundary_functions(n, local), 1, axis=1)[:, :3])
        theta = (space.turn + 2.0 * np.pi / n * np.arange(n)[:, None] + local).ravel()
        circle = np.stack([np.cos(theta), np.sin(theta)], axis=1)
        for e in chosen:
            middle, half = _span(space.axis, e)
            u = middle + half * t
            values = np.zeros((along, FUNCTIONS))
            values[:, : space.axis.degree + 1] = space.axis.local(u)[1]
            self.along.extend(values)
            _, jacobian = space.rod.grid(circle, u)
            around = jacobian[..., 1] * circle[:, :1] - jacobian[..., 0] * circle[:, 1:]
            area = np.linalg.norm(np.cross(around, jacobian[..., 2]), axis=-1).reshape(along, n, across)
            scale = share * np.pi / n * w * (half * v)[:, None, None]
            self.areas.append((area * scale).ravel())


def _obstacle(contact: Contact) -> tuple[Array, Array, float]:
    """Return point, unit direction and radius of a rigid obstacle; zeros where the partner is a body."""
    other = contact.second
    if isinstance(other, Plane):
        point, direction, radius = other.point, np.array(other.normal, dtype=float), 0.0
    elif isinstance(other, Cylinder):
        point, direction, radius = other.point, np.array(other.axis, dtype=float), other.radius
    else:
        return np.zeros(3), np.zeros(3), 0.0
    return np.array(point, dtype=float), direction / np.linalg.norm(direction), radius


def _span(axis: Axis, e: int) -> tuple[float, float]:
    """Return middle and half length of an element in ``u``."""
    low, high = axis.breaks[e : e + 2]
    return 0.5 * (low + high), 0.5 * (high - low)


def _polynomials(axis: Axis, e: int) -> Array:
    """Return the weighted functions of an element in powers of ``s`` in [-1, 1], shape ``(l, l)``."""
    p = axis.degree
    # Chebyshev points: interpolation is exact and well conditioned.
    s = np.cos(np.pi * (np.arange(p + 1) + 0.5) / (p + 1))
    middle, half = _span(axis, e)
    flat = Axis(p, axis.knots, np.ones(axis.count))
    first, values, _ = flat.local(middle + half * s)
    weighted = values * axis.weights[first[0] : first[0] + p + 1]
    result = np.zeros((FUNCTIONS, FUNCTIONS))
    result[: p + 1, : p + 1] = np.linalg.solve(np.vander(s, increasing=True), weighted).T
    return result


def pack(model: "Model") -> Packed:
    """Return all contacts of a model as tables for the compiled loops."""
    tables = _Tables()
    for contact in model.contacts:
        sides = contact.sides
        first = len(tables.surfaces)
        for k, (body, elements) in enumerate(sides):
            space = model.bodies[body].space
            chosen = range(space.axis.elements) if elements is None else sorted({int(e) for e in elements})
            if len(sides) == 2:
                master = first + 1 - k
            else:
                master = CYLINDER if isinstance(contact.second, Cylinder) else PLANE
            tables.surface(space, int(model.first_node[body]), chosen)
            tables.slave(space, chosen, master, contact, 1.0 / len(sides))
    areas = np.concatenate([np.empty(0), *tables.areas])
    return Packed(
        surfaces=np.array(tables.surfaces, SURFACE),
        elements=np.array(tables.elements, ELEMENT),
        passes=np.array(tables.passes, PASS),
        around=np.array(tables.around).reshape(-1, 3),
        along=np.array(tables.along).reshape(-1, FUNCTIONS),
        areas=areas,
        carriers=np.unique(np.concatenate([np.empty(0, dtype=np.int64), *tables.carriers])),
        multipliers=np.zeros(areas.size),
        states=np.zeros(areas.size, STATE),
        points=np.zeros((areas.size, 3)),
        starts=np.full(areas.size, NOWHERE),
        before=np.zeros((int(model.first_node[-1]), 3)),
        travel=np.zeros(1),
        clear=np.full(areas.size, -np.inf),
        boxes=np.zeros((len(tables.elements), 2, 3)),
    )
