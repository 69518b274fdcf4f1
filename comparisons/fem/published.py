"""Spring and blade of Lu & Zhou (2011), sections 4.2 and 4.3, in dolfinx, on meshes of their own.

Apart from `comparisons.fem.rods`, whose unknowns are the nodes of the mesh: the fastest elements here, serendipity
bricks on Irons' points, have other unknowns, as have incompatible modes and displacements of a higher degree than the
cells.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from comparisons.fem import modal, runs, statics
from comparisons.fem.arguments import option
from comparisons.fem.domain import Domain
from comparisons.fem.statics import Equilibrium, Held
from isorod.errors import InputError
from isorod.fenics.stored import energy_of
from isorod.material import NeoHookean
from isorod.scenes import blade as scene_of_blade
from isorod.scenes import spring as scene_of_spring
from meshes import blade, spring
from meshes.mesh import Mesh

PAPER = "paper: the mesh whose counts the paper gives"


@dataclass(frozen=True)
class Spring(runs.Configuration):
    """A mesh of the spring, an element on it, and how the equations are solved.

    Parameters
    ----------
    around, layers, rings, core
        See `meshes.spring.build`.

    Others see `comparisons.fem.runs.Configuration`.
    """

    scene: ClassVar[str] = "spring"
    analysis: ClassVar[str] = "statics"

    cells: str = option("bricks", PAPER, choices=spring.CELLS)
    around: int = option(8, "cells round the wire", "N")
    layers: int = option(48, "cells along the wire, a multiple of 12", "N")
    rings: int = option(1, "bricks: rings round the core", "N")
    core: float | None = option(None, "bricks: radius of the core's corners", "R", type=float)

    def mesh(self) -> Mesh:
        """Return the mesh."""
        return spring.build(self.cells, self.around, self.layers, self.geometry_order, self.rings, self.core)

    def solve(self, where: Domain) -> Equilibrium:
        """Return the equilibrium: lower end clamped, upper end displaced along the axis."""
        scene = scene_of_spring.Spring(helix="paper")
        held = [Held("start"), Held("end", (0.0, 0.0, scene.travel))]
        law = energy_of(NeoHookean(scene.E, scene.nu))
        options = statics.DIRECT if self.solver is None else self.solver
        return statics.solve(where, law, held, self.element, options, self.flags, self.matrix)

    def measure(self, result: Equilibrium) -> dict[str, Any]:
        """Return the entries of a record of its solution."""
        return {
            "force": float(result.reactions[1, 2]),
            "newton_iterations": result.newton_iterations,
            "linear_iterations": result.linear_iterations,
            "residual_norms": result.residual_norms,
        }


@dataclass(frozen=True)
class Blade(runs.Configuration):
    """A mesh of the blade, an element on it, and how the equations are solved.

    Parameters
    ----------
    along, across, layers, grading, clustering
        See `meshes.blade.build`.
    modes
        Number of modes.

    Others see `comparisons.fem.runs.Configuration`.
    """

    scene: ClassVar[str] = "blade"
    analysis: ClassVar[str] = "modal"

    cells: str = option("bricks", PAPER, choices=blade.CELLS)
    along: int = option(6, "cells along the chord", "N")
    across: int = option(1, "cells across the thickness", "N")
    layers: int = option(12, "cells from root to tip", "N")
    grading: float = option(1.0, "layer k of N starts at (k / N)^G of the span", "G")
    clustering: float = option(1.0, "0: cells equally long along the chord", "C")
    modes: int = option(10, "number of modes", "N")

    def __post_init__(self) -> None:
        if self.modes < 1:
            raise InputError(f"modes: got {self.modes}, need at least 1")
        super().__post_init__()

    @property
    def geometry_order(self) -> int:
        """As of all scenes, but 2 on all tetrahedra."""
        return 2 if self.cells == "tetrahedra" and self.order is None else super().geometry_order

    def mesh(self) -> Mesh:
        """Return the mesh."""
        counts = self.along, self.across, self.layers
        return blade.build(self.cells, *counts, self.geometry_order, self.grading, clustering=self.clustering)

    def solve(self, where: Domain) -> modal.Modes:
        """Return the modes, the root clamped."""
        scene = scene_of_blade.Blade()
        settings = modal.Settings(modal.DIRECT if self.solver is None else self.solver, self.flags, self.matrix)
        solid = modal.Solid(scene.E, scene.nu, scene.density)
        return modal.solve(where, solid, ["start"], self.modes, self.element, settings)

    def measure(self, result: modal.Modes) -> dict[str, Any]:
        """Return the entries of a record of its modes; ``check`` of its ``seconds`` is the Sturm count."""
        return {
            "frequencies": result.frequencies,
            "residuals": result.residuals,
            "sturm_count": result.below,
            "unknowns": result.unknowns,
            "iterations": result.iterations,
        }


run = runs.run
