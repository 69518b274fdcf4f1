"""The blade of Lu & Zhou (2011), section 4.3, in dolfinx, and the record of a run."""

from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

from comparisons.fem import runs
from comparisons.fem.domain import Domain
from comparisons.fem.modal import DIRECT, Modes, Settings, Solid, solve
from comparisons.fem.mode_shapes import save
from isorod.errors import InputError
from isorod.scenes.blade import Blade
from meshes import blade
from meshes.mesh import Mesh


@dataclass(frozen=True)
class Configuration(runs.Configuration):
    """A mesh of the blade, an element on it, and how the equations are solved.

    Parameters
    ----------
    along, across, layers, grading, clustering
        See `meshes.blade.build`.
    modes
        Number of modes.

    Others see `comparisons.fem.runs.Configuration`.
    """

    along: int = 6
    across: int = 1
    layers: int = 12
    grading: float = 1.0
    clustering: float = 1.0
    modes: int = 10

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
    ``seconds`` is as in `comparisons.fem.runs.measured`; its ``check`` is the Sturm count.
    """
    start = perf_counter()
    where, mesh = runs.distribute(configuration.mesh, comm)
    meshing = perf_counter() - start
    found, record = runs.measured(lambda: vibrations(where, configuration), repeat, comm, meshing)
    if modes_file is not None:
        save(found, mesh, modes_file)
    return {
        "scene": "blade",
        "analysis": "modal",
        "frequencies": found.frequencies,
        "residuals": found.residuals,
        "sturm_count": found.below,
        "dofs": found.dofs,
        "unknowns": found.unknowns,
        "cells": where.cells,
        "iterations": found.iterations,
        "options": configuration.options(where.shape),
        "petsc_options": found.options,
        **record,
    }
