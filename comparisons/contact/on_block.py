"""A steel rod pressed along a line on a finite element block of aluminium, in plane strain, beside Hertz' theory.

``python -m comparisons.contact.on_block [POINTS]``: elements and control points across half the patch, 5 by default.
"""

import sys
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from dolfinx import fem
from dolfinx.mesh import locate_entities_boundary
from mpi4py import MPI
from numpy.typing import NDArray

from comparisons.contact import hertz
from isorod import BodyForce, LinearElastic, Rod, circle, statics, straight
from isorod.fenics import compat
from isorod.fenics.solid import Solid
from isorod.model import Body, Contact, Model, Support
from isorod.model.tie import SolidSurface
from isorod.space.closer import Patch, closer

Array = NDArray[np.float64]

# Radius, force per length, and the block's half width and height, in half widths of the patch: far enough.
RADIUS, FORCE, FAR = 5.0, 100.0, 10.0
STEEL, ALUMINIUM = LinearElastic(210e3, 0.3), LinearElastic(70e3, 0.33)
MODULUS = hertz.modulus(STEEL.E, STEEL.nu, ALUMINIUM.E, ALUMINIUM.nu)
HALF = float(np.sqrt(4.0 * FORCE * RADIUS / (np.pi * MODULUS)))
PEAK = 2.0 * FORCE / (np.pi * HALF)


class Errors(NamedTuple):
    """Relative errors of half the patch's width, by the pressure's second moment, and of the pressure in the middle."""

    half: float
    peak: float
    unknowns: int


def _ticks(points: float) -> Array:
    """Return places of nodes from the middle on: evenly within 1.5 patches, then farther and farther apart."""
    size = HALF / points
    ticks = list(np.arange(0.0, 1.5 * HALF, size))
    while ticks[-1] < FAR * HALF:
        size *= 1.4
        ticks.append(ticks[-1] + size)
    return np.array(ticks)


def block(points: float) -> tuple[Solid, Any]:
    """Return the block, of bricks of second degree below z = 0, one of them along x, and the facets of its top."""
    half = _ticks(points)
    ticks = np.array([0.0, 1.0]), np.append(-half[:0:-1], half), -half[::-1]
    places = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(places)).reshape([one.size for one in ticks])
    low = np.indices([one.size - 1 for one in ticks]).reshape(3, -1)
    cells = np.stack(
        [number[tuple(low + np.array(corner[::-1])[:, None])] for corner in product((0, 1), repeat=3)], axis=1
    )
    mesh = compat.create_mesh(MPI.COMM_WORLD, cells.astype(np.int64), places, "hexahedron", 1)
    space = compat.function_space(mesh, compat.element(mesh, "Lagrange", 2, 3))
    part = space.sub(0)
    own, _ = compat.collapsed(part)
    every = fem.locate_dofs_geometrical((part, own), lambda x: x[0] > -1.0)
    below = fem.locate_dofs_geometrical(space, lambda x: x[2] < -half[-1] + 1e-9)
    conditions = [fem.dirichletbc(fem.Function(own), every, part), fem.dirichletbc(fem.Function(space), below)]
    mesh.topology.create_connectivity(2, 3)
    near = 1.5 * HALF + 1e-9
    top = locate_entities_boundary(mesh, 2, lambda x: (x[2] > -1e-9) & (np.abs(x[1]) < near))
    return Solid(space, ALUMINIUM, conditions=conditions), top


def model(points: float) -> Model:
    """Return the rod along x on its block, under its own weight."""
    rod = straight(1.0).sweep(circle(8, RADIUS))
    across = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    rod = Rod(rod.axis, rod.control_points @ across.T + [0.0, 0.0, RADIUS], rod.closed)
    space = closer(rod, [Patch(0.5, -0.5 * np.pi, 0.7, 1.5 * HALF / RADIUS, 1.2, HALF / points)])
    # What is nearest to the middle above: one control point of a section, or two.
    y, z = space.positions[:, 1:].T
    above = space.is_control_point & (z > RADIUS)
    middle = np.flatnonzero(above & (np.abs(y) < np.abs(y[above]).min() + 1e-6))
    supports = [Support(np.arange(space.nodes), "x"), Support(middle, "y")]
    weight = BodyForce((0.0, 0.0, -FORCE / (np.pi * RADIUS**2)))
    solid, top = block(points)
    touching = Contact(0, SolidSurface(0, top))
    return Model([Body(space, STEEL)], supports, loads=[weight], contacts=[touching], solids=[solid])


def measure(points: float) -> Errors:
    """Return the errors."""
    pressed = model(points)
    (result,) = statics.solve(pressed).contacts
    here = result.pressure > 0.0
    loads, y = result.areas[here] * result.pressure[here], result.positions[here, 1]
    half = 2.0 * float(np.sqrt(loads @ y**2 / loads.sum()))
    middle = np.abs(y) < 0.2 * HALF
    # Of an ellipse the mean over so much of the middle.
    mean_height = np.mean(np.sqrt(1.0 - np.linspace(-0.2, 0.2, 101) ** 2))
    peak = float(loads[middle].sum() / result.areas[here][middle].sum()) / mean_height
    return Errors(half / HALF - 1.0, peak / PEAK - 1.0, pressed.unknowns + 3 * pressed.solids[0].nodes)


if __name__ == "__main__":
    result = measure(float(sys.argv[1]) if len(sys.argv) > 1 else 5.0)
    print(f"half width {result.half:+.2%}, pressure {result.peak:+.2%}, {result.unknowns:,} unknowns")
