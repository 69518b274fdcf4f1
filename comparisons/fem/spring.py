"""The spring of Lu & Zhou (2011), section 4.2, solved with dolfinx, and the record of a run."""

from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

from comparisons.fem import runs
from comparisons.fem.domain import Domain
from comparisons.fem.fields import save
from comparisons.fem.statics import DIRECT, Equilibrium, Held, solve
from comparisons.fem.stored import energy_of
from isorod.material import NeoHookean
from isorod.scenes.spring import Spring
from meshes import spring
from meshes.mesh import Mesh


@dataclass(frozen=True)
class Configuration(runs.Configuration):
    """A mesh of the spring, an element on it, and how the equations are solved.

    Parameters
    ----------
    around, layers, rings, core
        See `meshes.spring.build`.

    Others see `comparisons.fem.runs.Configuration`.
    """

    around: int = 8
    layers: int = 48
    rings: int = 1
    core: float | None = None

    def mesh(self) -> Mesh:
        """Return the mesh."""
        return spring.build(self.cells, self.around, self.layers, self.geometry_order, self.rings, self.core)


def domain(configuration: Configuration, comm: MPI.Comm = MPI.COMM_WORLD) -> Domain:
    """Build the mesh on rank 0 and share it out; an `InputError` is raised on every rank."""
    return runs.distribute(configuration.mesh, comm)[0]


def equilibrium(where: Domain, configuration: Configuration) -> Equilibrium:
    """Return the spring's equilibrium: lower end clamped, upper end displaced along the axis."""
    scene = Spring()
    return solve(
        where,
        energy_of(NeoHookean(scene.E, scene.nu)),
        [Held("start"), Held("end", (0.0, 0.0, scene.pull))],
        configuration.element,
        DIRECT if configuration.solver is None else configuration.solver,
        configuration.flags,
        configuration.matrix,
    )


def run(
    configuration: Configuration, repeat: int = 1, fields: Path | None = None, comm: MPI.Comm = MPI.COMM_WORLD
) -> dict[str, Any]:
    """Solve ``repeat`` times in this process and return the record, the same on every rank.

    The last solution's stress and displacement go to the file ``fields`` if one is named.  ``seconds`` is as in
    `comparisons.fem.runs.measured`.
    """
    start = perf_counter()
    where = domain(configuration, comm)
    meshing = perf_counter() - start
    found, record = runs.measured(lambda: equilibrium(where, configuration), repeat, comm, meshing)
    if fields is not None:
        save(found, fields)
    return {
        "scene": "spring",
        "analysis": "statics",
        "force": float(found.reactions[1, 2]),
        "dofs": found.dofs,
        "cells": where.cells,
        "newton_iterations": found.newton_iterations,
        "linear_iterations": found.linear_iterations,
        "residual_norms": found.residual_norms,
        "options": configuration.options(where.shape),
        "petsc_options": found.options,
        **record,
    }
