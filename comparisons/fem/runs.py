"""Common to all finite element runs: options that fit together, meshes on all ranks, repeated timing, the record."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any, ClassVar, TypeVar

from mpi4py import MPI
from petsc4py import PETSc

from comparisons.fem.arguments import option, positive, rule
from comparisons.fem.domain import Domain
from comparisons.fem.statics import Element
from comparisons.measure import timing
from isorod.errors import InputError
from isorod.fenics import compat
from isorod.fenics.flags import FAST
from isorod.output import results
from meshes.mesh import Mesh

FAMILIES = ("Lagrange", "S", "enhanced")

Result = TypeVar("Result", bound=timing.Timed)
Built = TypeVar("Built")


@dataclass(frozen=True)
class Configuration:
    """A mesh of a scene, an element on it, and how the equations are solved; a scene adds its mesh and analysis.

    Parameters
    ----------
    cells
        Kind of the mesh, see the scene's ``build`` in `meshes`.
    order
        Order of the geometry; the one that fits the element if None.
    degree, quadrature, family
        See `comparisons.fem.statics.Element`.
    solver
        PETSc options; the user's own win.
    matrix
        PETSc matrix type, None for PETSc's default.
    flags
        C compiler flags of the forms.
    """

    scene: ClassVar[str]
    analysis: ClassVar[str]

    cells: str = "bricks"
    order: int | None = option(None, "order of the geometry; the degree if not given", "N", type=positive)
    degree: int = option(2, "degree of the displacement", "P", type=positive)
    quadrature: int | str | None = option(None, "degree of the quadrature rule, or irons14", "Q", type=rule)
    family: str = option(
        "Lagrange", "bricks: S for serendipity, enhanced for 8 nodes with incompatible modes", choices=FAMILIES
    )
    solver: Mapping[str, object] | None = None
    matrix: str | None = option(None, "PETSc matrix type, such as baij", "TYPE", type=str)
    flags: Sequence[str] = FAST

    def __post_init__(self) -> None:
        bricks = self.cells != "tetrahedra"
        check_element(bricks, self.degree, self.family, self.quadrature, self.geometry_order)

    @property
    def geometry_order(self) -> int:
        """Order of the mesh: that of the element, at most 2 on tetrahedra; 1 on the paper's mesh."""
        if self.cells == "paper":
            return 1
        if self.order is not None:
            return self.order
        return min(self.degree, 2) if self.cells == "tetrahedra" else self.degree

    @property
    def element(self) -> Element:
        """The displacement element."""
        return Element(self.degree, self.quadrature, self.family)

    def options(self, shape: str) -> dict[str, Any]:
        """Return all options, as they are on cells of a shape, for the record."""
        derived = {"order": self.geometry_order, "quadrature": self.element.rule(shape), "flags": list(self.flags)}
        return asdict(self) | derived

    def mesh(self) -> Mesh:
        """Return the mesh."""
        raise NotImplementedError

    def solve(self, where: Domain) -> Any:
        """Return the solution on a mesh."""
        raise NotImplementedError

    def measure(self, result: Any) -> dict[str, Any]:
        """Return the entries of a record of a solution."""
        raise NotImplementedError


def check_element(bricks: bool, degree: int, family: str, quadrature: int | str | None, order: int) -> None:
    """Raise `InputError` if element, quadrature and order of the geometry do not go together."""
    if not 1 <= degree <= (4 if bricks else 3):
        raise InputError(f"degree: got {degree}, need 1 to 4 on bricks, 1 to 3 on tetrahedra")
    if family != "Lagrange" and not bricks:
        raise InputError(f"family {family}: bricks only; tetrahedra take Lagrange")
    if family == "enhanced" and (degree, order) != (1, 1):
        raise InputError("family enhanced: it is of degree 1 on bricks of order 1; add --degree 1 --order 1")
    if isinstance(quadrature, str) and not bricks:
        raise InputError(f"quadrature {quadrature}: bricks only; tetrahedra take a degree")
    if quadrature == 0 or (isinstance(quadrature, int) and quadrature > 20):
        raise InputError(f"quadrature: got degree {quadrature}, need 1 to 20")


def distribute(build: Callable[[], Mesh], comm: MPI.Comm) -> Domain:
    """Build a mesh on rank 0 and distribute it; an `InputError` is raised on every rank."""
    return Domain.distribute(_first(build, comm), comm)


def broadcast(build: Callable[[], Built], comm: MPI.Comm) -> Built:
    """Build an object on rank 0 and broadcast it; an `InputError` is raised on every rank."""
    built: Built = comm.bcast(_first(build, comm), root=0)
    return built


def _first(build: Callable[[], Built], comm: MPI.Comm) -> Built | None:
    built, problem = None, None
    if comm.rank == 0:
        try:
            built = build()
        except InputError as error:
            problem = str(error)
    problem = comm.bcast(problem, root=0)
    if problem is not None:
        raise InputError(problem)
    return built


def run(configuration: Configuration, repeat: int = 1, comm: MPI.Comm = MPI.COMM_WORLD) -> dict[str, Any]:
    """Solve ``repeat`` times in this process and return the record, the same on every rank.

    ``seconds`` is as in `measured`.
    """
    start = perf_counter()
    where = distribute(configuration.mesh, comm)
    meshing = perf_counter() - start
    result, record = measured(lambda: configuration.solve(where), repeat, comm, meshing)
    return {
        "scene": configuration.scene,
        "analysis": configuration.analysis,
        **configuration.measure(result),
        "dofs": result.dofs,
        "cells": where.cells,
        "options": configuration.options(where.shape),
        "petsc_options": result.options,
        **record,
    }


def timed(
    solve: Callable[[], Result], repeat: int, comm: MPI.Comm
) -> tuple[Result, list[dict[str, float]], dict[str, float]]:
    """Solve ``repeat`` times in this process.

    Returns what `comparisons.measure.timing.repeated` does, the seconds of each part being those of the slowest rank.
    """

    def begin() -> None:
        PETSc.garbage_cleanup()
        comm.Barrier()

    result, own = timing.repeated(solve, repeat, begin)
    runs = [{name: comm.allreduce(value, op=MPI.MAX) for name, value in run.items()} for run in own]
    return result, runs, timing.median(runs)


def measured(solve: Callable[[], Result], repeat: int, comm: MPI.Comm, meshing: float) -> tuple[Result, dict[str, Any]]:
    """Return the result of the last of `timed` runs, and the entries common to all records; ``meshing`` in seconds."""
    result, every, median = timed(solve, repeat, comm)
    return result, {
        "method": "fem",
        "seconds": {"mesh": meshing} | median,
        "warm": repeat > 1,
        "runs": every,
        "ranks": comm.size,
        "peak_memory": result.peak_memory,  # type: ignore[attr-defined]
        **provenance(),
    }


def provenance() -> dict[str, Any]:
    """Return isorod's provenance with the versions of dolfinx and PETSc."""
    record = results.provenance()
    record["versions"] |= {"dolfinx": compat.version, "petsc": ".".join(map(str, PETSc.Sys.getVersion()))}
    return record
