"""Rods in sleeves of finite elements, beside exact solutions: errors of energy, displacement and traction."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

import isorod
from comparisons.joints import exact
from comparisons.joints.lattice import Ring, circle, ring, square
from isorod import LinearElastic, Space, Tie, statics
from isorod.fenics import compat
from isorod.fenics.solid import Solid
from isorod.model import Body, Model, Support
from isorod.model.tie import LateralSurface, SolidSurface

Array = NDArray[np.float64]

# The rod's shape in all of them.
RADIUS, POINTS = 1.0, 8

# Displacements are times this: laws of small strains are meant.
AMPLITUDE = 1e-3

# Elements of dolfinx: shape of cells, degree of displacements, degree of geometry.
ELEMENTS = {
    "P1 bricks": ("hexahedron", 1, 1),
    "P2 bricks": ("hexahedron", 2, 2),
    "P1 tetrahedra": ("tetrahedron", 1, 1),
    "P2 tetrahedra": ("tetrahedron", 2, 2),
    "P2 straight tetrahedra": ("tetrahedron", 2, 1),
}


@dataclass(frozen=True)
class Problem:
    """A rod in a sleeve, both linear, with an exact solution.

    Attributes
    ----------
    solution
        With ``displacement(x, body)`` of rod (0) and sleeve (1), and ``traction(x)`` of the rod on its surface.
    E, nu
        Of rod and sleeve.
    outline
        The sleeve's outer surface.
    length
        Of both.
    ends
        Components that are prescribed at both ends.
    outside
        Whether displacements are prescribed on the outer surface; else it is free of tractions.
    """

    solution: Any
    E: tuple[float, float]
    nu: tuple[float, float]
    outline: Callable[[Array], Array]
    length: float
    ends: str
    outside: bool = True


def torsion(contrast: float = 10.0, length: float = 5.0) -> Problem:
    """Torsional transfer: the rod's shear modulus is ``contrast``, the sleeve's 1."""
    nu = 0.3
    E = (2.0 * contrast * (1.0 + nu), 2.0 * (1.0 + nu))
    return Problem(exact.Torsion((contrast, 1.0), RADIUS, 3.0, length), E, (nu, nu), circle(3.0), length, "xyz")


def axial(contrast: float = 10.0, length: float = 5.0) -> Problem:
    """Axial transfer."""
    E, nu = (contrast, 1.0), (0.3, 0.3)
    return Problem(exact.Axial(E, nu, RADIUS, 3.0, length), E, nu, circle(3.0), length, "z")


def inclusion(E: tuple[float, float] = (10.0, 1.0), nu: tuple[float, float] = (0.3, 0.3)) -> Problem:
    """Rod in a box under tension across, plane strain; constants of rod and box."""
    return Problem(exact.Inclusion(E[::-1], nu[::-1]), E, nu, square(3.0), 1.0, "z")


def composite(E: tuple[float, float] = (10.0, 1.0), nu: tuple[float, float] = (0.2, 0.4)) -> Problem:
    """Composite cylinder under axial strain, free outside."""
    return Problem(exact.Composite(E, nu, RADIUS, 3.0), E, nu, circle(3.0), 2.0, "z", outside=False)


def patch() -> Problem:
    """A constant strain of rod and box of one law: the only error is that of the hole's shape."""
    gradient = np.array([[0.8, -0.5, 0.0], [0.3, -0.4, 0.0], [0.0, 0.0, 0.6]])
    return Problem(exact.Uniform(1.0, 0.3, gradient), (1.0, 1.0), (0.3, 0.3), square(3.0), 2.0, "xyz")


PROBLEMS = {"torsion": torsion, "axial": axial, "inclusion": inclusion, "composite": composite, "patch": patch}


@dataclass(frozen=True)
class Result:
    """The errors of a solution.

    Attributes
    ----------
    energy, rod, traction
        Relative errors: of the stored energy (with its sign), of the displacement on the rod's surface and of the
        traction there, in L2.
    jump
        Largest distance of displacements across the tie, relative to the largest displacement.
    gap
        Largest distance of the surfaces at rest, in radii.
    unknowns
        Of rod and sleeve.
    seconds
        Of set-up and solution.
    equilibrium
        The solution.
    """

    energy: float
    rod: float
    traction: float
    jump: float
    gap: float
    unknowns: tuple[int, int]
    seconds: float
    equilibrium: Any = field(repr=False)


def rod_space(length: float, elements: int = 4, order: int = 2, degree: int = 3) -> Space:
    """Return a space on the rod."""
    rod = isorod.straight(length).sweep(isorod.circle(POINTS, RADIUS))
    return Space(rod, order=order, elements=elements, degree=degree)


def sleeve(problem: Problem, cells: tuple[int, int, int], element: str) -> tuple[Ring, Solid]:
    """Return the mesh of the sleeve, and the sleeve with its boundary conditions."""
    shape, degree, geometry = ELEMENTS[element]
    made = ring(RADIUS, problem.outline, problem.length, cells, shape, geometry)
    mesh = made.mesh
    space = vectors(mesh, degree)
    given = fem.Function(space)
    given.interpolate(lambda x: AMPLITUDE * problem.solution.displacement(x.T.copy(), 1).T)
    conditions = []
    if problem.outside:
        conditions.append(fem.dirichletbc(given, fem.locate_dofs_topological(space, 2, made.outside)))
    else:
        conditions += pinned(space, float(problem.outline(np.zeros(1))[0, 0]))
    for letter in problem.ends:
        part = space.sub("xyz".index(letter))
        own, back = compat.collapsed(part)
        value = fem.Function(own)
        value.x.array[:] = given.x.array[back]
        dofs = fem.locate_dofs_topological((part, own), 2, made.ends)
        conditions.append(fem.dirichletbc(value, dofs, part))
    return made, Solid(space, LinearElastic(problem.E[1], problem.nu[1]), conditions=conditions)


def vectors(mesh: Any, degree: int) -> Any:
    """Return the space of vectors of a degree."""
    return compat.function_space(mesh, compat.element(mesh, "Lagrange", degree, 3))


def pinned(space: Any, radius: float) -> list[Any]:
    """Return conditions at three points of the outer surface that hold what symmetry holds."""
    conditions = []
    for letter, place in (("y", (radius, 0.0)), ("y", (-radius, 0.0)), ("x", (0.0, radius))):
        part = space.sub("xyz".index(letter))
        own, _ = compat.collapsed(part)
        at = np.array([*place, 0.0])[:, None]
        dofs = fem.locate_dofs_geometrical((part, own), lambda x, at=at: np.linalg.norm(x - at, axis=0) < 1e-9)
        conditions.append(fem.dirichletbc(fem.Function(own), dofs, part))
    return conditions


def rod_supports(problem: Problem, space: Space) -> Sequence[Support]:
    """Return the supports of the rod's ends, whose displacements are linear in the positions."""
    layers = np.arange(space.nodes).reshape(space.layers, -1)
    supports = []
    for which in ("start", "end"):
        nodes = layers[space.end(which)]
        corners = np.eye(3) * [RADIUS, RADIUS, 0.0] + [0.0, 0.0, problem.length * (which == "end")]
        moved = problem.solution.displacement(corners, 0)
        # Of functions that are no control points positions are nothing, and so is what does not move with these.
        weights = space.positions[nodes, :2] / RADIUS
        rest = space.is_control_point[nodes] - weights.sum(axis=1)
        given = np.column_stack([weights, rest]) @ moved
        supports.append(Support(nodes, problem.ends, displacement=AMPLITUDE * given, space=space))
    return supports


def solve(
    problem: Problem, space: Space, cells: tuple[int, int, int], element: str, slave: str = "rod", gap: float = 0.5
) -> Result:
    """Return the errors of a rod's space in a sleeve of so many cells; slave is the ``"rod"`` or the ``"solid"``."""
    made, solid = sleeve(problem, cells, element)
    own, hole = LateralSurface(0), SolidSurface(0, made.hole)
    tie = Tie(own, hole, gap) if slave == "rod" else Tie(hole, own, gap)
    model = Model(
        [Body(space, LinearElastic(problem.E[0], problem.nu[0]))],
        rod_supports(problem, space),
        ties=[tie],
        solids=[solid],
    )
    start = perf_counter()
    solution = statics.solve(model)
    seconds = perf_counter() - start
    energy = solution.energy(0) + solid.energy(solution.solids[0], 1.0)
    carried = solution.ties[0]
    expected = problem.solution.traction(carried.points) * (1.0 if slave == "rod" else -1.0)
    angle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    along = np.linspace(0.0, 1.0, 21)
    xi = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    where = space.rod.grid(xi, along)[0]
    moved = problem.solution.displacement(where.reshape(-1, 3), 0).reshape(where.shape)
    return Result(
        energy=energy / AMPLITUDE**2 / stored(problem) - 1.0,
        rod=distance(solution.at(0, along, xi) / AMPLITUDE, moved),
        traction=distance(carried.traction / AMPLITUDE, expected),
        jump=carried.jump / (AMPLITUDE * float(np.abs(moved).max())),
        gap=carried.gap / RADIUS,
        unknowns=(3 * space.nodes, 3 * solid.nodes),
        seconds=seconds,
        equilibrium=solution,
    )


def distance(values: Array, expected: Array) -> float:
    """Return the relative distance of fields, in the mean of squares of points."""
    return float(np.linalg.norm(values - expected) / np.linalg.norm(expected))


def stored(problem: Problem) -> float:
    """Return the exact stored energy, where the solution has none by integration of the outer work."""
    solution = problem.solution
    if hasattr(solution, "energy"):
        return float(solution.energy)
    if isinstance(solution, exact.Uniform):
        return float(solution.density * 4.0 * problem.outline(np.zeros(1))[0, 0] ** 2 * problem.length)
    if isinstance(solution, exact.Composite):
        return 0.5 * solution.force * solution.strain * problem.length
    return float(solution.box(float(problem.outline(np.zeros(1))[0, 0])) * problem.length)


def order(coarse: float, fine: float, ratio: float = 2.0) -> float:
    """Return the order of convergence of errors on meshes whose sizes have a ratio."""
    return float(np.log(abs(coarse / fine)) / np.log(ratio))
