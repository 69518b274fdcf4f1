"""Straight rods in and on a block: a tendon on bone, and a screw that is pulled out of a plate; mm and N."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import gmsh
import numpy as np
from numpy.typing import NDArray

import isorod
from comparisons.fem.statics import Held
from comparisons.joints import whole
from comparisons.joints.scene import Array, Scene, Sizes, by_gmsh, fixed, fragments, volumes
from comparisons.joints.whole import BLOCK, ROD, Layers, Problem, Whole
from isorod import Material, NeoHookean, Rod, Space, Tie, statics
from isorod.fenics.solid import Solid
from isorod.model import Body, Model, SectionLoad, Support
from isorod.model.tie import EndFace, LateralSurface, SolidSurface


class Column(Scene):
    """A straight rod along z in or on one block with upright sides.

    Attributes
    ----------
    radius, rise, block
        Radius of the rod, ``z`` of its ends, and of the block's.
    half
        Half sides of the block.
    """

    radius: float
    rise: tuple[float, float]
    block: tuple[float, float]
    half: tuple[float, float]

    @cached_property
    def rod(self) -> Rod:  # type: ignore[override]
        """The rod."""
        low, high = self.rise
        return isorod.straight(high - low, start=(0.0, 0.0, low)).sweep(isorod.circle(8, self.radius))

    def section(self, sizes: Sizes) -> whole.Section:
        """Return the section of rod and block."""
        outline = whole.rectangle(self.half)
        return whole.section(self.radius, sizes.around, sizes.rings, outline, sizes.near, sizes.far)

    def _edge(self, sizes: Sizes) -> str:
        """Return the size of gmsh's cells."""
        ends = [z for z in self.block if self.rise[0] - 1e-9 <= z <= self.rise[1] + 1e-9]
        edge = [f"{sizes.near}+0.5*Sqrt((Sqrt(x*x+y*y)-{self.radius})^2+(z-({z}))^2)" for z in ends]
        size = f"{sizes.far}"
        for one in edge:
            size = f"Min({size},{one})"
        return size

    def tetrahedra(self, sizes: Sizes) -> Whole:
        """Return rod and block meshed as one solid, by gmsh."""

        def make() -> str:
            box, rod = self._box(), (3, self._cylinder(*self.rise))
            volumes(fragments([box, rod], [BLOCK, ROD]))
            return f"Min({self._edge(sizes)},{sizes.wire or sizes.far}+1000*Max(0,Sqrt(x*x+y*y)-{1.001 * self.radius}))"

        mesh, tags = by_gmsh(make, True)
        return Whole(mesh, tags, self.faces(mesh))

    def _box(self) -> tuple[int, int]:
        (a, b), (low, high) = self.half, self.block
        return 3, gmsh.model.occ.addBox(-a, -b, low, 2.0 * a, 2.0 * b, high - low)

    def _cylinder(self, low: float, high: float) -> int:
        return int(gmsh.model.occ.addCylinder(0, 0, low, 0, 0, high - low, self.radius))

    def blocks(self, sizes: Sizes, shape: str) -> Sequence[Any]:
        """Return the mesh of the block alone."""
        hole = self.rise[0] < self.block[1] - 1e-9
        if shape == "hexahedron":
            own = [one._replace(inner=0 if hole else one.inner) for one in self.layers(sizes) if one.outer]
            return [whole.bricks(self.section(sizes), own, self.place)[0]]

        def make() -> str:
            box = self._box()
            if hole:
                gmsh.model.occ.cut([box], [(3, self._cylinder(*self.block))])
            gmsh.model.occ.synchronize()
            volumes({BLOCK: [tag for _, tag in gmsh.model.getEntities(3)]})
            return self._edge(sizes)

        return [by_gmsh(make, hole)[0]]


@dataclass(frozen=True)
class Tendon(Column):
    """The example ``tendon``: a tendon that grows out of a block of bone, pulled aside at its end."""

    quantities = ("pull", "push")
    radius, rise, block, half = 3.0, (0.0, 30.0), (-12.0, 0.0), (12.0, 8.0)
    laws: ClassVar[Mapping[int, Material]] = {ROD: NeoHookean(200.0, 0.4), BLOCK: NeoHookean(1000.0, 0.3)}
    hand = (2.0, 0.0, 1.0)

    def layers(self, sizes: Sizes) -> Sequence[Layers]:
        """Return layers of bricks along the rod."""
        lower = whole.spaced(self.block, sizes.far, (None, sizes.near))
        upper = whole.spaced(self.rise, sizes.wire, (sizes.near, 0.5 * sizes.wire))
        return [Layers(lower, BLOCK, BLOCK), Layers(upper, ROD, 0)]

    def faces(self, mesh: Any) -> Mapping[str, NDArray[np.int32]]:
        """Return the facets that are held."""
        return {
            "bottom": whole.facets(mesh, lambda x: np.abs(x[2] + 12.0) < 1e-6),
            "hand": whole.facets(mesh, lambda x: np.abs(x[2] - 30.0) < 1e-6),
        }

    def problem(self) -> Problem:
        """Return the problem of the solid."""
        return Problem(self.laws, [Held("bottom"), Held("hand", self.hand)])

    def of_whole(self, solution: whole.Solution) -> Array:
        """Return the force at the hand, along and across."""
        return np.asarray(solution.reactions[1, [2, 0]])

    def held(self, block: int, space: Any) -> list[Any]:
        """Return the supports of the block."""
        return [fixed(space, lambda x: np.abs(x[2] + 12.0) < 1e-6)]

    def model(self, space: Space, solids: Sequence[Solid]) -> Model:
        """Return tendon and bone."""
        top = whole.facets(solids[0].space.mesh, lambda x: np.abs(x[2]) < 1e-6)
        hand = Support.end(space, "end", displacement=self.hand)
        tie = Tie(EndFace(0, "start"), SolidSurface(0, top))
        return Model([Body(space, self.laws[ROD])], [hand], ties=[tie], solids=solids)

    def of_coupled(self, solution: statics.Equilibrium) -> Array:
        """Return the force at the hand, along and across."""
        return np.asarray(solution.reactions[0, [2, 0]])


@dataclass(frozen=True)
class Screw(Column):
    """The example ``screw``: a screw bonded in the hole of a plate, pulled out of it."""

    quantities = ("rise",)
    radius, rise, block, half = 2.0, (0.0, 12.0), (2.0, 8.0), (8.0, 8.0)
    laws: ClassVar[Mapping[int, Material]] = {ROD: NeoHookean(1.1e5, 0.34), BLOCK: NeoHookean(1.0e4, 0.35)}
    pull = (0.0, 0.0, 500.0)

    def layers(self, sizes: Sizes) -> Sequence[Layers]:
        """Return layers of bricks along the rod."""
        (start, end), (low, high) = self.rise, self.block
        parts = [
            whole.spaced((start, low), sizes.wire, (None, sizes.near)),
            whole.spaced((low, high), sizes.far, (sizes.near, sizes.near)),
            whole.spaced((high, end), sizes.wire, (sizes.near, None)),
        ]
        return [Layers(parts[0], ROD, 0), Layers(parts[1], ROD, BLOCK), Layers(parts[2], ROD, 0)]

    def _sides(self, x: Array) -> Any:
        return np.maximum(np.abs(x[0]), np.abs(x[1])) > 8.0 - 1e-6

    def faces(self, mesh: Any) -> Mapping[str, NDArray[np.int32]]:
        """Return the facets that are held and pulled."""
        return {
            "sides": whole.facets(mesh, self._sides),
            "pulled": whole.facets(mesh, lambda x: np.abs(x[2] - 12.0) < 1e-6),
        }

    def problem(self) -> Problem:
        """Return the problem of the solid."""
        return Problem(self.laws, [Held("sides")], self.pull)

    def of_whole(self, solution: whole.Solution) -> Array:
        """Return how far the end rises."""
        return solution.moved[2:]

    def held(self, block: int, space: Any) -> list[Any]:
        """Return the supports of the plate."""
        return [fixed(space, self._sides)]

    def space(self, **chosen: Any) -> Space:
        """Return a space with joints of elements where the plate begins and ends."""
        low, high = (z / self.rise[1] for z in self.block)
        return self.jointed((low, high), **chosen)

    def model(self, space: Space, solids: Sequence[Solid]) -> Model:
        """Return screw and plate."""
        hole = whole.facets(solids[0].space.mesh, lambda x: np.hypot(x[0], x[1]) < 1.001 * self.radius)
        tie = Tie(SolidSurface(0, hole), LateralSurface(0, self.block))
        load = SectionLoad.end(space, "end", self.pull)
        return Model([Body(space, self.laws[ROD])], [], loads=[load], ties=[tie], solids=solids)

    def of_coupled(self, solution: statics.Equilibrium) -> Array:
        """Return how far the end rises."""
        load = solution.model.loads[0]
        nodal = load.nodal(solution.model.bodies[0].space)
        work = float((nodal * solution.displacement.reshape(-1, 3)).sum())
        return np.array([work / self.pull[2]])
