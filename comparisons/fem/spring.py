"""The spring of Lu & Zhou (2011), section 4.2, solved with dolfinx, and the record of a run."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

from comparisons.fem import runs
from comparisons.fem.domain import Domain
from comparisons.fem.fields import save
from comparisons.fem.material import neo_hookean
from comparisons.fem.statics import DIRECT, FAST, Element, Equilibrium, Held, solve
from isorod.scenes.spring import Spring
from meshes import spring
from meshes.mesh import Mesh


@dataclass(frozen=True)
class Configuration:
    """A mesh of the spring, an element on it, and how the equations are solved.

    Parameters
    ----------
    cells, around, layers, order, rings, core
        See `meshes.spring.build`; ``order`` None means the order that fits the element.
    degree, quadrature, family
        See `comparisons.fem.statics.Element`.
    solver
        PETSc options; the user's own win.
    matrix
        PETSc matrix type, None for PETSc's default.
    flags
        C compiler flags of the forms.
    """

    cells: str = "bricks"
    around: int = 8
    layers: int = 48
    order: int | None = None
    rings: int = 1
    core: float | None = None
    degree: int = 2
    quadrature: int | str | None = None
    family: str = "Lagrange"
    solver: Mapping[str, object] | None = None
    matrix: str | None = None
    flags: Sequence[str] = FAST

    def __post_init__(self) -> None:
        bricks = self.cells != "tetrahedra"
        runs.check_element(bricks, self.degree, self.family, self.quadrature, self.geometry_order)

    @property
    def geometry_order(self) -> int:
        """Order of the mesh: that of the element, at most 2 on tetrahedra; 1 on the paper's mesh."""
        if self.cells == "paper":
            return 1
        if self.order is not None:
            return self.order
        return min(self.degree, 2) if self.cells == "tetrahedra" else self.degree

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
        neo_hookean(scene.E, scene.nu),
        [Held("start"), Held("end", (0.0, 0.0, scene.pull))],
        Element(configuration.degree, configuration.quadrature, configuration.family),
        DIRECT if configuration.solver is None else configuration.solver,
        configuration.flags,
        configuration.matrix,
    )


def run(
    configuration: Configuration, repeat: int = 1, fields: Path | None = None, comm: MPI.Comm = MPI.COMM_WORLD
) -> dict[str, Any]:
    """Solve ``repeat`` times in this process and return the record, the same on every rank.

    The last solution's stress and displacement go to the file ``fields`` if one is named.  ``seconds`` is as in
    `comparisons.fem.runs.timed`.
    """
    start = perf_counter()
    where = domain(configuration, comm)
    meshing = perf_counter() - start
    found, every, median = runs.timed(lambda: equilibrium(where, configuration), repeat, comm)
    if fields is not None:
        save(found, fields)
    rule = Element(configuration.degree, configuration.quadrature).rule(where.shape)
    return {
        "scene": "spring",
        "analysis": "statics",
        "method": "fem",
        "force": float(found.reactions[1, 2]),
        "dofs": found.dofs,
        "cells": where.cells,
        "newton_iterations": found.newton_iterations,
        "linear_iterations": found.linear_iterations,
        "residual_norms": found.residual_norms,
        "seconds": {"mesh": meshing} | median,
        "warm": repeat > 1,
        "runs": every,
        "options": asdict(configuration)
        | {"order": configuration.geometry_order, "quadrature": rule, "flags": list(configuration.flags)},
        "petsc_options": found.options,
        "ranks": comm.size,
        "peak_memory": found.peak_memory,
        **runs.provenance(),
    }
