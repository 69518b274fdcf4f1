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
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from isorod.arrays import Array, Index
from isorod.contact.surface_kernel import CYLINDER, FUNCTIONS, PLANE, Packed
from isorod.errors import InputError
from isorod.geometry.axis import Axis
from isorod.geometry.disk import boundary_functions
from isorod.model.contact import Contact, Cylinder, Plane

if TYPE_CHECKING:
    from isorod.model.model import Model
    from isorod.space.space import Space


@dataclass
class _Tables:
    """Rows of the arrays of `Packed`, as they grow."""

    surfaces: list[list[int]] = field(default_factory=list)
    turns: list[tuple[float, float, float]] = field(default_factory=list)
    layers: list[Index] = field(default_factory=list)
    carriers: list[Index] = field(default_factory=list)
    polynomials: list[Array] = field(default_factory=list)
    neighbours: list[list[int]] = field(default_factory=list)
    spans: list[tuple[float, float]] = field(default_factory=list)
    passes: list[list[int]] = field(default_factory=list)
    penalty: list[float] = field(default_factory=list)
    rigid: list[Array] = field(default_factory=list)
    around: list[Array] = field(default_factory=list)
    along: list[Array] = field(default_factory=list)
    areas: list[Array] = field(default_factory=list)

    def surface(self, space: "Space", first_node: int, elements: Sequence[int] | None) -> None:
        """Add a surface, to be the slave of the next pass."""
        axis = space.axis
        chosen = range(axis.elements) if elements is None else sorted({int(e) for e in elements})
        first = len(self.layers)
        rows = {e: first + k for k, e in enumerate(chosen)}
        self.surfaces.append([space.points_around, axis.degree, first, len(rows), len(self.passes)])
        alpha = np.pi / space.points_around
        self.turns.append((space.turn, np.cos(alpha), np.sin(alpha)))
        for e in chosen:
            layers = np.zeros(FUNCTIONS, dtype=np.int64)
            layers[: axis.degree + 1] = first_node + space.element_layers[e] * space.layer_nodes
            self.layers.append(layers)
            self.carriers.append((layers[: axis.degree + 1, None] + np.arange(space.points_around)).ravel())
            low, high = axis.breaks[e : e + 2]
            self.spans.append((0.5 * (low + high), 0.5 * (high - low)))
            self.polynomials.append(_polynomials(axis, e))
            beside = [(e + step) % axis.elements if space.rod.closed else e + step for step in (-1, 1)]
            self.neighbours.append([rows.get(other, -1) for other in beside])

    def slave(self, space: "Space", surface: int, master: int, contact: Contact, share: float) -> None:
        """Add the pass in which a surface is the slave."""
        across, along = contact.points or (3, space.axis.degree + 1)
        n = space.points_around
        self.passes.append(
            [surface, master, sum(a.size for a in self.areas), across, along, len(self.around), len(self.along)]
        )
        self.penalty.append(contact.penalty)
        row = np.zeros(7)
        if isinstance(contact.second, Plane):
            row[:3], row[3:6] = contact.second.point, contact.second.normal
        elif isinstance(contact.second, Cylinder):
            row[:3], row[3:6], row[6] = contact.second.point, contact.second.axis, contact.second.radius
        if master < 0:
            row[3:6] /= np.linalg.norm(row[3:6])
        self.rigid.append(row)
        x, w = np.polynomial.legendre.leggauss(across)
        local = np.pi / n * x
        self.around.extend(np.roll(boundary_functions(n, local), 1, axis=1)[:, :3])
        t, v = np.polynomial.legendre.leggauss(along)
        first, count = self.surfaces[surface][2:4]
        theta = (space.turn + 2.0 * np.pi / n * np.arange(n)[:, None] + local).ravel()
        circle = np.stack([np.cos(theta), np.sin(theta)], axis=1)
        for middle, half in self.spans[first : first + count]:
            u = middle + half * t
            values = np.zeros((along, FUNCTIONS))
            values[:, : space.axis.degree + 1] = space.axis.local(u)[1]
            self.along.extend(values)
            _, jacobian = space.rod.grid(circle, u)
            around = jacobian[..., 1] * circle[:, :1] - jacobian[..., 0] * circle[:, 1:]
            area = np.linalg.norm(np.cross(around, jacobian[..., 2]), axis=-1).reshape(along, n, across)
            scale = share * np.pi / n * w * (half * v)[:, None, None]
            self.areas.append((area * scale).ravel())


def _polynomials(axis: Axis, e: int) -> Array:
    """Return the weighted functions of an element in powers of ``s`` in [-1, 1], shape ``(l, l)``."""
    p = axis.degree
    # Chebyshev points: interpolation is exact and well conditioned.
    s = np.cos(np.pi * (np.arange(p + 1) + 0.5) / (p + 1))
    low, high = axis.breaks[e : e + 2]
    flat = Axis(p, axis.knots, np.ones(axis.count))
    first, values, _ = flat.local(0.5 * (low + high) + 0.5 * (high - low) * s)
    weighted = values * axis.weights[first[0] : first[0] + p + 1]
    result = np.zeros((FUNCTIONS, FUNCTIONS))
    result[: p + 1, : p + 1] = np.linalg.solve(np.vander(s, increasing=True), weighted).T
    return result


def pack(model: "Model", augmented: bool = False) -> Packed:
    """Return all contact pairs of a model as arrays for the compiled loops.

    Parameters
    ----------
    augmented
        True if the caller updates ``multipliers`` (see `Contact.penetration`).

    Raises
    ------
    InputError
        If a contact asks for an augmented Lagrangian and the caller has none.
    """
    tables = _Tables()
    for index, contact in enumerate(model.contacts):
        if contact.penetration is not None and not augmented:
            raise InputError(f"contact {index}: a largest penetration (augmented Lagrangian) is for statics alone")
        if contact.faces and augmented:
            raise InputError(f"contact {index}: contact of end faces is for dynamics alone")
        sides = contact.sides
        surface = len(tables.surfaces)
        for k, (body, elements) in enumerate(sides):
            space = model.bodies[body].space
            tables.surface(space, int(model.first_node[body]), elements)
            if len(sides) == 2:
                master = surface + 1 - k
            else:
                master = CYLINDER if isinstance(contact.second, Cylinder) else PLANE
            tables.slave(space, surface + k, master, contact, 1.0 / len(sides))

    areas = np.concatenate([np.empty(0), *tables.areas])
    starts = np.full((areas.size, 3), -1.0)
    return Packed(
        surfaces=np.array(tables.surfaces, dtype=np.int64).reshape(-1, 5),
        turns=np.array(tables.turns, dtype=float).reshape(-1, 3),
        layers=np.array(tables.layers, dtype=np.int64).reshape(-1, FUNCTIONS),
        polynomials=np.array(tables.polynomials).reshape(-1, FUNCTIONS, FUNCTIONS),
        neighbours=np.array(tables.neighbours, dtype=np.int64).reshape(-1, 2),
        spans=np.array(tables.spans, dtype=float).reshape(-1, 2),
        passes=np.array(tables.passes, dtype=np.int64).reshape(-1, 7),
        penalty=np.array(tables.penalty, dtype=float),
        rigid=np.array(tables.rigid).reshape(-1, 7),
        around=np.array(tables.around).reshape(-1, 3),
        along=np.array(tables.along).reshape(-1, FUNCTIONS),
        areas=areas,
        multipliers=np.zeros(areas.size),
        starts=starts,
        states=np.zeros((areas.size, 3)),
        places=np.zeros((areas.size, 3)),
        boxes=np.zeros((len(tables.layers), 6)),
        carriers=np.unique(np.concatenate([np.empty(0, dtype=np.int64), *tables.carriers])),
        before=np.zeros((int(model.first_node[-1]), 3)),
        travel=np.zeros(1),
        clear=np.full(areas.size, -np.inf),
    )
