"""The blade of Lu & Zhou (2011), section 4.3, in dolfinx, and the record of a run."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

from comparisons.fem import runs
from comparisons.fem.domain import Domain
from comparisons.fem.modal import DIRECT, Modes, Settings, Solid, solve
from comparisons.fem.mode_shapes import save
from comparisons.fem.statics import FAST, Element
from isorod.errors import InputError
from isorod.scenes.blade import Blade
from meshes import blade
from meshes.mesh import Mesh


@dataclass(frozen=True)
class Configuration:
    """A mesh of the blade, an element on it, and how the equations are solved.

    Parameters
    ----------
    cells, along, across, layers, order, grading, clustering
        See `meshes.blade.build`; ``order`` None means the order that fits the element.
    degree, quadrature, family
        See `comparisons.fem.statics.Element`.
    modes
        Number of modes.
    solver
        PETSc and SLEPc options; the user's own win.
    matrix
        PETSc type of the stiffness matrix, see `comparisons.fem.modal.solve`.
    flags
        C compiler flags of the forms.
    """

    cells: str = "bricks"
    along: int = 6
    across: int = 1
    layers: int = 12
    order: int | None = None
    grading: float = 1.0
    clustering: float = 1.0
    degree: int = 2
    quadrature: int | str | None = None
    family: str = "Lagrange"
    modes: int = 10
    solver: Mapping[str, object] | None = None
    matrix: str | None = None
    flags: Sequence[str] = FAST

    def __post_init__(self) -> None:
        if self.modes < 1:
            raise InputError(f"modes: got {self.modes}, need at least 1")
        bricks = self.cells != "tetrahedra"
        runs.check_element(bricks, self.degree, self.family, self.quadrature, self.geometry_order)

    @property
    def geometry_order(self) -> int:
        """Order of the mesh: that of the element, 2 on tetrahedra; 1 on the paper's mesh."""
        if self.cells == "paper":
            return 1
        if self.order is not None:
            return self.order
        return 2 if self.cells == "tetrahedra" else self.degree

    @property
    def element(self) -> Element:
        """The displacement element."""
        return Element(self.degree, self.quadrature, self.family)

    def mesh(self) -> Mesh:
        """Return the mesh."""
        return blade.build(
            self.cells,
            self.along,
            self.across,
            self.layers,
            self.geometry_order,
            self.grading,
            clustering=self.clustering,
        )


def vibrations(where: Domain, configuration: Configuration) -> Modes:
    """Return the blade's modes, its root clamped."""
    scene = Blade()
    return solve(
        where,
        Solid(scene.E, scene.nu, scene.density),
        ["start"],
        configuration.modes,
        configuration.element,
        Settings(
            DIRECT if configuration.solver is None else configuration.solver,
            configuration.flags,
            configuration.matrix,
        ),
    )


def run(
    configuration: Configuration, repeat: int = 1, modes_file: Path | None = None, comm: MPI.Comm = MPI.COMM_WORLD
) -> dict[str, Any]:
    """Solve ``repeat`` times in this process and return the record, the same on every rank.

    The last solution's mode shapes go to ``modes_file`` if one is named (see `comparisons.fem.mode_shapes.save`).
    ``seconds`` is as in `comparisons.fem.runs.timed`; its ``check`` is the Sturm count.
    """
    start = perf_counter()
    where, mesh = runs.distribute(configuration.mesh, comm)
    meshing = perf_counter() - start
    found, every, median = runs.timed(lambda: vibrations(where, configuration), repeat, comm)
    if modes_file is not None:
        save(found, mesh, modes_file)
    return {
        "scene": "blade",
        "analysis": "modal",
        "method": "fem",
        "frequencies": found.frequencies,
        "residuals": found.residuals,
        "sturm_count": found.below,
        "dofs": found.dofs,
        "unknowns": found.unknowns,
        "cells": where.cells,
        "iterations": found.iterations,
        "seconds": {"mesh": meshing} | median,
        "warm": repeat > 1,
        "runs": every,
        "options": asdict(configuration)
        | {
            "order": configuration.geometry_order,
            "quadrature": configuration.element.rule(where.shape),
            "flags": list(configuration.flags),
        },
        "petsc_options": found.options,
        "ranks": comm.size,
        "peak_memory": found.peak_memory,
        **runs.provenance(),
    }
