"""Rods on a block and through a sleeve of finite elements: compliances at the rod's free end.

Beside them those of Fourier finite elements (`comparisons.joints.meridian`).  The rod's radius is 1.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, NamedTuple

import gmsh
import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

import isorod
from comparisons.joints.scene import tetrahedra
from comparisons.joints.traction import Traction
from isorod import LinearElastic, Space, Tie, statics
from isorod.fenics import compat
from isorod.fenics.solid import Solid
from isorod.model import Body, Model
from isorod.model.tie import EndFace, LateralSurface, SolidSurface
from isorod.space import choice

Array = NDArray[np.float64]

# Of both bodies of finite elements.
RADIUS, HEIGHT = 4.0, 4.0
ROD = 8.0

# Poisson's ratio of both.
_NU = 0.3

# Largest distance of coarse facets from the rod's surface.
_GAP = 0.5

# Loads are times this, so that strains are small.
SIZE = 1e-5


def _axial(x: Array) -> Array:
    return np.tile([0.0, 0.0, 1.0 / np.pi], (len(x), 1))


def _transverse(x: Array) -> Array:
    return np.tile([1.0 / np.pi, 0.0, 0.0], (len(x), 1))


def _torsion(x: Array) -> Array:
    return np.stack([-x[:, 1], x[:, 0], 0.0 * x[:, 0]], axis=1) * 2.0 / np.pi


def _moment(x: Array) -> Array:
    return np.stack([0.0 * x[:, 0], 0.0 * x[:, 0], x[:, 0]], axis=1) * 4.0 / np.pi


LOADS = {"axial": _axial, "torsion": _torsion, "transverse": _transverse, "moment": _moment}


def _scaled(at: Callable[[Array], Array]) -> Callable[[Array], Array]:
    return lambda x: SIZE * at(x)


class Block(NamedTuple):
    """A mesh, and its facets.

    Attributes
    ----------
    mesh
        Tetrahedra.
    held
        Facets that are held.
    joined
        Facets of the hole, or of the upper face; where the rod stands if the mesh has its outline.
    """

    mesh: Any
    held: NDArray[np.int32]
    joined: NDArray[np.int32]


def block(near: float, far: float, hole: bool, outline: bool = True, order: int = 2) -> Block:
    """Return a mesh of a block ``r < 4``, 4 high, made by gmsh.

    Parameters
    ----------
    near, far
        Sizes at the rod's edge and away from it.
    hole
        Whether it has a hole for the rod; it is then held outside, else below.
    outline
        Whether the mesh has the rod's outline on the upper face.
    order
        Degree of the geometry.
    """
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Verbosity", 1)
        occ = gmsh.model.occ
        cylinder = occ.addCylinder(0, 0, 0, 0, 0, HEIGHT, RADIUS)
        if hole:
            occ.cut([(3, cylinder)], [(3, occ.addCylinder(0, 0, 0, 0, 0, HEIGHT, 1.0))])
        elif outline:
            occ.fragment([(3, cylinder)], [(2, occ.addDisk(0, 0, HEIGHT, 1.0, 1.0))])
        occ.synchronize()
        groups: dict[str, list[int]] = {"held": [], "joined": [], "free": []}
        for _, face in gmsh.model.getEntities(2):
            box = gmsh.model.getBoundingBox(2, face)
            low, high, wide = box[2], box[5], box[3]
            upright = high - low > 0.5 * HEIGHT
            if hole:
                kind = "free" if not upright else "joined" if wide < 1.5 else "held"
            else:
                on_top = not upright and low > 0.5 * HEIGHT and (wide < 1.5 or not outline)
                kind = "joined" if on_top else "held" if high < 0.5 * HEIGHT else "free"
            groups[kind].append(face)
        gmsh.model.addPhysicalGroup(3, [one for _, one in gmsh.model.getEntities(3)], 1)
        for tag, kind in enumerate(("held", "joined", "free"), 1):
            gmsh.model.addPhysicalGroup(2, groups[kind], tag)
        away = f"Abs(z-{HEIGHT})"
        height = f"Min({away},z)" if hole else away
        edge = f"Sqrt((Sqrt(x*x+y*y)-1)^2+({height})^2)"
        tetrahedra(f"Min({far},{near}+0.4*{edge})", order)
        mesh, _, facets = compat.from_gmsh(gmsh.model)[:3]
    finally:
        gmsh.finalize()
    return Block(mesh, facets.find(1), facets.find(2))


@dataclass(frozen=True)
class Result:
    """Compliances of a joint.

    Attributes
    ----------
    compliances
        By load.
    unknowns
        Of rod and block.
    jump
        The largest across the tie, relative to the displacement of the rod's end, over all loads.
    seconds
        Of one load.
    balance
        Largest relative difference of the tie's force and moment from those of the load, over all loads.
    """

    compliances: dict[str, float]
    unknowns: tuple[int, int]
    jump: float
    seconds: float
    balance: float
    equilibria: dict[str, Any] = field(repr=False)


def rod_space(hole: bool, **space: Any) -> Space:
    """Return a space on the rod, of ``z`` from 4 or, in a hole, from 0, to 12; other options are chosen."""
    line = isorod.straight(HEIGHT + ROD) if hole else isorod.straight(ROD, start=(0.0, 0.0, HEIGHT))
    rod = line.sweep(isorod.circle(8, 1.0))
    if hole:
        rod = choice.with_rim(rod)
        start = HEIGHT / (HEIGHT + ROD)
        layers = start + np.array([-0.5, -0.2, 0.0, 0.0, 0.2, 0.5]) / (HEIGHT + ROD)
        space.setdefault("knots", (*(np.array([0.2, 0.5]) / 12.0), *layers))
    return Space(rod, **space)


def solve(
    made: Block,
    space: Space,
    E: tuple[float, float],
    hole: bool,
    slave: str = "rod",
    degree: int = 2,
    loads: tuple[str, ...] = tuple(LOADS),
) -> Result:
    """Return the compliances of a rod welded on a block or through a sleeve; rod and block."""
    V = compat.function_space(made.mesh, compat.element(made.mesh, "Lagrange", degree, 3))
    held = fem.dirichletbc(fem.Function(V), fem.locate_dofs_topological(V, 2, made.held))
    solid = Solid(V, LinearElastic(E[1], _NU), conditions=[held])
    own = LateralSurface(0, (0.0, HEIGHT)) if hole else EndFace(0, "start")
    joined = SolidSurface(0, made.joined)
    tie = Tie(own, joined, _GAP) if slave == "rod" else Tie(joined, own, _GAP)
    body = Body(space, LinearElastic(E[0], _NU))
    compliances, equilibria, jump, balance = {}, {}, 0.0, 0.0
    for name in loads:
        load = Traction(EndFace(0, "end"), _scaled(LOADS[name]))
        start = perf_counter()
        solution = statics.solve(Model([body], loads=[load], ties=[tie], solids=[solid]))
        seconds = perf_counter() - start
        nodal = load.nodal(space)
        compliances[name] = float((nodal * solution.displacement.reshape(-1, 3)).sum()) / SIZE**2
        equilibria[name] = solution
        moved = np.abs(solution.at(0, "end", np.array([[1.0, 0.0], [0.0, 1.0]]))).max()
        jump = max(jump, solution.ties[0].jump / moved)
        balance = max(balance, _balance(solution, nodal, space, 1.0 if slave == "rod" else -1.0))
    return Result(compliances, (3 * space.nodes, 3 * solid.nodes), float(jump), seconds, balance, equilibria)


def _balance(solution: Any, nodal: Array, space: Space, sign: float) -> float:
    """Return how far the tie's resultants are from balancing a load, relative to force times the rod's length."""
    tie = solution.ties[0]
    control_points = space.is_control_point[:, None]
    force = (control_points * nodal).sum(axis=0)
    moment = np.cross(space.positions - control_points * tie.center, nodal).sum(axis=0)
    largest = max(np.abs(force).max() * ROD, np.abs(moment).max())
    return float(max(np.abs(sign * tie.force + force).max() * ROD, np.abs(sign * tie.moment + moment).max()) / largest)
