"""A scene of isorod's, built in or from a file, in dolfinx: the mesh of its rods, the solution, and the record."""

from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

from comparisons.fem import known, runs
from comparisons.fem.arguments import option, positive
from comparisons.fem.rods import joined
from comparisons.fem.rods.solving import solve
from comparisons.fem.statics import Element
from isorod import files
from isorod.errors import InputError
from isorod.fenics.flags import FAST
from isorod.model.model import Model
from isorod.output.results import write_arrays
from meshes import cuts, gmsh_model, rods
from meshes import joined_mesh as one_solid
from meshes.joined_mesh import Joined
from meshes.mesh import Mesh

# Attributes of the solution that a record has.
_KEPT = {
    "statics": ("residual_norms", "reactions", "moments"),
    "modal": ("residuals", "rigid", "below"),
    "dynamics": ("times", "reactions"),
}


@dataclass(frozen=True)
class Configuration:
    """A scene, its mesh, and how the equations are solved.

    Parameters
    ----------
    name
        Of a scene, or of a file that ends in ``.toml``.
    level, degree
        Of the mesh, see `meshes.rods.build`; the degree is that of displacement and geometry.
    around, across, layers
        Numbers of cells (`meshes.rods.Cells`): all three, or none for those that the mesh chooses.
    bodies
        A folder to which the mesh of each body alone goes.
    flags
        C compiler flags of the forms.
    """

    name: str
    level: int = option(1, "cells in each direction, times level 1's", "L", type=positive)
    degree: int = option(2, "degree of displacement and geometry", "P", type=positive)
    around: int | None = option(None, "cells round a hole or core, in the place of the mesh's own", "N", type=positive)
    across: int | None = option(None, "cells across each ring, in the place of the mesh's own", "N", type=positive)
    layers: int | None = option(None, "cells along the rod, in the place of the mesh's own", "N", type=positive)
    bodies: str = option("", "write the mesh of each body alone to this folder, as .msh", "FOLDER")
    flags: tuple[str, ...] = FAST

    def __post_init__(self) -> None:
        runs.check_element(True, self.degree, "Lagrange", None, self.degree)
        given = [one is not None for one in (self.around, self.across, self.layers)]
        if any(given) and not all(given):
            raise InputError("cells: around, across and layers go together")

    @property
    def counted(self) -> rods.Cells | None:
        """Numbers of cells that are given."""
        if self.around is None or self.across is None or self.layers is None:
            return None
        return rods.Cells(self.around, self.across, self.layers)


def mesh_of(model: Model, level: int = 1, degree: int = 2, cells: rods.Cells | None = None) -> Mesh:
    """Return the mesh of a model's rods, with a plane wherever laws may change, or a section is loaded."""
    return rods.build([cuts.cut(model, b) for b in range(len(model.bodies))], level, degree, cells)


def joined_mesh(scene: Any, model: Model, level: int) -> tuple[Joined, list[str]]:
    """Return the mesh of a model with ties as one solid, and notes on it."""
    planes = [cuts.planes(model, b) for b in range(len(model.bodies))]
    parts, joins, groups = joined.assembled(model, scene.bodies(), scene.rod_names(), planes)
    return one_solid.build(parts, joins, groups, level)


def run(
    configuration: Configuration, repeat: int = 1, fields: Path | None = None, comm: MPI.Comm = MPI.COMM_WORLD
) -> dict[str, Any]:
    """Solve ``repeat`` times in this process and return the record.

    What `comparisons.fem.rods.solution.Solution.fields` returns goes to the file ``fields`` if one is named.
    ``seconds`` is as in `comparisons.fem.runs.measured`.

    Raises
    ------
    InputError
        If something in the scene has no counterpart (`comparisons.fem.known`).
    """
    scene: Any = files.find(configuration.name)
    settings = known.settings_of(scene)
    with scene.locating():
        model = scene.model()
        known.refuse_scene(scene, model)
        tied = bool(model.ties or model.solids)
        bodies = scene.bodies() if tied else []
        start = perf_counter()

        def build() -> tuple[Mesh, list[str]]:
            if not tied:
                return mesh_of(model, configuration.level, configuration.degree, configuration.counted), []
            _refuse_cells(configuration)
            solid, notes = joined_mesh(scene, model, configuration.level)
            if configuration.bodies:
                for one, alone in zip(bodies, solid.bodies, strict=True):
                    gmsh_model.write(alone, one_solid.body_file(configuration.bodies, one.name))
            return solid, notes

        mesh, notes = runs.broadcast(build, comm)
        meshing = perf_counter() - start
        asked = {"steps": known.Steps(**settings)} if scene.analysis == "dynamics" else settings

        def once() -> Any:
            return solve(model, mesh, scene.analysis, flags=configuration.flags, bodies=bodies, comm=comm, **asked)

        result, record = runs.measured(once, repeat, comm, meshing)
    # Of a motion that in the end.
    solution = result[-1] if scene.analysis == "dynamics" else result
    if fields is not None and comm.rank == 0:
        write_arrays(fields, **solution.fields())
    return {
        "scene": scene.name,
        "analysis": scene.analysis,
        **scene.measure(result),
        **{name: getattr(result, name) for name in _KEPT[scene.analysis]},
        **({"contacts": [one._asdict() for one in solution.contacts]} if solution.contacts else {}),
        "dofs": solution.dofs,
        "unknowns": solution.unknowns,
        "cells": solution.cells,
        "shape": mesh.shape,
        **({"mesh_notes": notes} if notes else {}),
        **solution.iterations,
        "formulation": "mixed" if known.with_pressures(model) else "displacement",
        "units": scene.units,
        "options": asdict(configuration) | {"quadrature": Element(configuration.degree).rule(mesh.shape)},
        "scene_options": scene.options["options"],
        "settings": settings,
        "petsc_options": solution.options,
        **record,
    }


def _refuse_cells(configuration: Configuration) -> None:
    if configuration.degree != 2 or configuration.counted:
        raise InputError(
            "degree: rods that are tied are meshed as one solid, with tetrahedra of degree 2 that gmsh chooses"
        )
