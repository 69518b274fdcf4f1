"""Rods with blocks, coupled and meshed as one solid: the base of such scenes, and meshes by gmsh."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from time import process_time
from typing import Any, ClassVar, NamedTuple

import gmsh
import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from comparisons.joints import whole
from comparisons.joints.whole import BLOCK, Layers, Problem, Whole
from isorod import Material, Rod, Space, statics
from isorod.fenics import compat
from isorod.fenics.solid import Solid
from isorod.model import Model
from isorod.space.choice import boundary_layers

Array = NDArray[np.float64]


class Sizes(NamedTuple):
    """Sizes of cells.

    Attributes
    ----------
    near, far
        At the edges of the joint and away from it.
    wire
        Along the rod, away from its joints and ends.
    around, rings
        Of bricks, cells round the rod and rings of its section.
    """

    near: float
    far: float
    wire: float = 0.0
    around: int = 8
    rings: int = 1


class Outcome(NamedTuple):
    """Of a run: quantities, unknowns of rod and finite elements, processor time, and the solution where coupled."""

    values: Array
    unknowns: tuple[int, int]
    seconds: float
    solution: Any = None


class Scene(ABC):
    """A rod and blocks.

    Attributes
    ----------
    quantities
        Names of what is measured.
    rod
        The rod.
    """

    quantities: tuple[str, ...]
    rod: Rod
    laws: ClassVar[Mapping[int, Material]]

    def space(self, **chosen: Any) -> Space:
        """Return a space on the rod; other options are chosen as of scene files."""
        return Space(self.rod, **chosen)

    def jointed(self, kinks: tuple[float, float], **chosen: Any) -> Space:
        """Return a space with joints of elements at two axis parameters, across which it is continuous alone."""
        knots = tuple(sorted(2 * kinks))
        if "elements" not in chosen:
            layers = boundary_layers(self.rod, chosen.get("degree"), kinks)
            knots = tuple(sorted([*{*layers}.difference(kinks), *knots]))
        return Space(self.rod, **{"knots": knots} | chosen)

    @abstractmethod
    def section(self, sizes: Sizes) -> whole.Section:
        """Return the section of rod and block."""

    @abstractmethod
    def layers(self, sizes: Sizes) -> Sequence[Layers]:
        """Return layers of bricks along the rod."""

    def place(self, along: float, points: Array) -> Array:
        """Return where points of the section are."""
        return np.column_stack([points, np.full(len(points), along)])

    @abstractmethod
    def faces(self, mesh: Any) -> Mapping[str, NDArray[np.int32]]:
        """Return the facets of the solid that are named in its problem."""

    @abstractmethod
    def problem(self) -> Problem:
        """Return the problem of the solid: laws, supports and load."""

    @abstractmethod
    def of_whole(self, solution: whole.Solution) -> Array:
        """Return the quantities of a solution of one solid."""

    def bricks(self, sizes: Sizes) -> Whole:
        """Return rod and blocks meshed as one solid, by bricks."""
        mesh, tags = whole.bricks(self.section(sizes), self.layers(sizes), self.place)
        return Whole(mesh, tags, self.faces(mesh))

    @abstractmethod
    def tetrahedra(self, sizes: Sizes) -> Whole:
        """Return rod and blocks meshed as one solid, by gmsh."""

    @abstractmethod
    def blocks(self, sizes: Sizes, shape: str) -> Sequence[Any]:
        """Return the meshes of the blocks alone."""

    @abstractmethod
    def model(self, space: Space, solids: Sequence[Solid]) -> Model:
        """Return rod and blocks, coupled."""

    @abstractmethod
    def of_coupled(self, solution: statics.Equilibrium) -> Array:
        """Return the quantities of the coupled model's solution."""

    @abstractmethod
    def held(self, block: int, space: Any) -> list[Any]:
        """Return the supports of a block, conditions of dolfinx."""

    def coupled(self, space: Space, meshes: Sequence[Any]) -> Outcome:
        """Return the coupled model's solution; time is without meshes and compilation of forms."""
        start = process_time()
        spaces = [compat.function_space(mesh, compat.element(mesh, "Lagrange", 2, 3)) for mesh in meshes]
        conditions = [self.held(k, one) for k, one in enumerate(spaces)]
        begun = process_time()
        solids = [Solid(V, self.laws[BLOCK], conditions=c) for V, c in zip(spaces, conditions, strict=True)]
        compiled = process_time() - begun
        solution = statics.solve(self.model(space, solids))
        seconds = process_time() - start - compiled
        unknowns = 3 * space.nodes, sum(3 * one.nodes for one in solids)
        return Outcome(self.of_coupled(solution), unknowns, seconds, solution)


def by_gmsh(make: Callable[[], str], curved: bool) -> tuple[Any, Any]:
    """Return the mesh of tetrahedra of a geometry made in gmsh's own kernel, and tags of its cells.

    ``make`` makes physical groups of volumes, and returns the size of cells by position.
    """
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Verbosity", 1)
        tetrahedra(make(), 2 if curved else 1)
        return tuple(compat.from_gmsh(gmsh.model)[:2])  # type: ignore[return-value]
    finally:
        gmsh.finalize()


def tetrahedra(size: str, order: int = 2) -> None:
    """Mesh the open geometry of gmsh, with cells of a size by position."""
    for name in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
        gmsh.option.setNumber(f"Mesh.MeshSize{name}", 0)
    field = gmsh.model.mesh.field.add("MathEval")
    gmsh.model.mesh.field.setString(field, "F", size)
    gmsh.model.mesh.field.setAsBackgroundMesh(field)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(order)


def volumes(tags: Mapping[int, Sequence[int]]) -> None:
    gmsh.model.occ.synchronize()
    for tag, volumes in tags.items():
        gmsh.model.addPhysicalGroup(3, volumes, tag)


def fragments(solids: Sequence[tuple[int, int]], tags: Sequence[int]) -> dict[int, list[int]]:
    """Fragment volumes of gmsh, and return those of each tag; a common fragment has the last volume's tag."""
    _, origins = gmsh.model.occ.fragment(solids[:1], solids[1:])
    of: dict[int, int] = {}
    for tag, origin in zip(tags, origins, strict=True):
        of |= {fragment: tag for dimension, fragment in origin if dimension == 3}
    return {tag: [fragment for fragment, own in of.items() if own == tag] for tag in set(of.values())}


def fixed(space: Any, on: Callable[[Array], Any], displacement: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Any:
    """Return dolfinx's condition that moves the facets that fulfil a condition."""
    nodes = fem.locate_dofs_topological(space, 2, whole.facets(space.mesh, on))
    return fem.dirichletbc(np.array(displacement), nodes, space)
