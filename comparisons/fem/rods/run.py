"""A scene of isorod's, built in or from a file, in dolfinx: the mesh of its rods, the solution, and the record."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from mpi4py import MPI

from comparisons.fem import runs
from comparisons.fem.arguments import option, positive
from comparisons.fem.rods import joined
from comparisons.fem.rods.solving import solve
from comparisons.fem.statics import Element
from isorod import files
from isorod.errors import InputError
from isorod.fenics.flags import FAST
from isorod.geometry.rod import Rod
from isorod.model.load import LineLoad, PointLoad, SectionLoad, Weight
from isorod.model.model import Model
from isorod.model.support import Support
from isorod.output.results import write_arrays
from isorod.space.space import Space
from meshes import gmsh_model, rods
from meshes import joined_mesh as one_solid
from meshes.joined_mesh import Joined
from meshes.mesh import Mesh

# What is known of an analysis here.
_SETTINGS = {"statics": ("load_steps",), "modal": ("modes",)}


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
    return rods.build([_cut(model, b) for b in range(len(model.bodies))], level, degree, cells)


def joined_mesh(scene: Any, model: Model, level: int) -> tuple[Joined, list[str]]:
    """Return the mesh of a model with ties as one solid, and what was done to it, in words."""
    cuts = [_planes(model, b) for b in range(len(model.bodies))]
    parts, joins, groups = joined.assembled(model, scene.bodies(), scene.rod_names(), cuts)
    return one_solid.build(parts, joins, groups, level)


def _cut(model: Model, b: int) -> Rod:
    """Return a body's rod with knots where its mesh has to have planes."""
    rod = model.bodies[b].space.rod
    low, high = rod.axis.breaks[[0, -1]]
    for u in _planes(model, b):
        if np.abs(rod.axis.breaks - u).min() > 1e-9 * (high - low):
            rod = rod.insert(u)
    return rod


def _planes(model: Model, b: int) -> list[float]:
    """Return the axis parameters within a body's rod at which its mesh has to have planes."""
    body = model.bodies[b]
    axis, rod = body.space.axis, body.space.rod
    rings = len(rod.rings) - 1
    rows = [body.laws[e * rings : (e + 1) * rings] for e in range(axis.elements)]
    densities = body.densities.reshape(axis.elements, -1)
    where = [
        float(axis.breaks[e])
        for e in range(1, axis.elements)
        if rows[e] != rows[e - 1] or (densities[e] != densities[e - 1]).any()
    ]
    where += [float(load.u) for load in model.loads if isinstance(load, SectionLoad) and load.body == b and load.u]
    for contact in model.contacts:
        for side, chosen in contact.sides:
            if side == b and chosen is not None:
                where += [float(axis.breaks[e + end]) for e in chosen for end in (0, 1)]
    for support in model.supports:
        if isinstance(support, Support) and support.body == b:
            where += _ends_of(support, body.space)
    low, high = axis.breaks[[0, -1]]
    return [u for u in sorted(set(where)) if low < u < high]


def _ends_of(support: Support, space: Space) -> list[float]:
    """Return where along the axis a patch begins and ends: whose elements have all their layers held."""
    layers = np.unique(np.asarray(support.nodes) // space.layer_nodes)
    held = np.isin(space.element_layers, layers).all(axis=1).astype(int)
    return [float(u) for u in space.axis.breaks[np.flatnonzero(np.diff(held, prepend=0, append=0))]]


def run(
    configuration: Configuration, repeat: int = 1, fields: Path | None = None, comm: MPI.Comm = MPI.COMM_WORLD
) -> dict[str, Any]:
    """Solve ``repeat`` times in this process and return the record.

    What `comparisons.fem.rods.solution.Solution.fields` returns goes to the file ``fields`` if one is named.
    ``seconds`` is as in `comparisons.fem.runs.measured`.

    Raises
    ------
    InputError
        If the scene is not one of statics or modes, or on several ranks.
    """
    if comm.size > 1:
        raise InputError("rods: only on one rank")
    scene: Any = files.find(configuration.name)
    if scene.analysis not in _SETTINGS:
        raise InputError(
            f"{configuration.name}: got {scene.analysis}; the finite element side has statics and modes only"
            + ("; biceps has a study of its own" if scene.analysis == "dynamics" else "")
        )
    given = scene.settings()
    settings = {name: given[name] for name in _SETTINGS[scene.analysis] if name in given}
    with scene.locating():
        model = scene.model()
        _refuse_unknown(model)
        if scene.analysis == "modal":
            _refuse_loaded(configuration.name, model, given)
            # Modes know no pressures.
            model = model.in_displacements()
        tied = bool(model.ties or model.solids)
        told: list[str] = []
        bodies = scene.bodies() if tied else []
        start = perf_counter()
        if tied:
            _refuse_cells(configuration)
            whole, told = joined_mesh(scene, model, configuration.level)
            mesh: Mesh = whole
            if configuration.bodies:
                for one, alone in zip(bodies, whole.bodies, strict=True):
                    gmsh_model.write(alone, one_solid.body_file(configuration.bodies, one.name))
        else:
            mesh = mesh_of(model, configuration.level, configuration.degree, configuration.counted)
        meshing = perf_counter() - start

        def once() -> Any:
            return solve(model, mesh, scene.analysis, flags=configuration.flags, bodies=bodies, **settings)

        solution, record = runs.measured(once, repeat, comm, meshing)
    if fields is not None:
        write_arrays(fields, **solution.fields())
    kept = ("residuals", "rigid", "below") if scene.analysis == "modal" else ("residual_norms", "reactions", "moments")
    return {
        "scene": scene.name,
        "analysis": scene.analysis,
        **scene.measure(solution),
        **{name: getattr(solution, name) for name in kept},
        **({"contacts": [one._asdict() for one in solution.contacts]} if solution.contacts else {}),
        "dofs": solution.dofs,
        "unknowns": solution.unknowns,
        "cells": solution.cells,
        "shape": mesh.shape,
        **({"mesh_notes": told} if told else {}),
        **solution.iterations,
        "formulation": "displacement",
        "units": scene.units,
        "options": asdict(configuration) | {"quadrature": Element(configuration.degree).rule(mesh.shape)},
        "scene_options": scene.options["options"],
        "settings": settings,
        "petsc_options": solution.options,
        **record,
    }


def _refuse_unknown(model: Model) -> None:
    """Raise `InputError` for the first support or load that the finite element side has no counterpart of."""
    for k, support in enumerate(model.supports):
        if not isinstance(support, Support):
            raise InputError(f"support {k}: mean motions and springs are not on the finite element side")
    for k, load in enumerate(model.loads):
        if load in model.following and isinstance(load, SectionLoad):
            raise InputError(f"load {k}: moments on bodies that turn are not on the finite element side")
        if isinstance(load, LineLoad | PointLoad) or (isinstance(load, Weight) and np.ptp(load.of.densities) > 0.0):
            what = "weight of several densities" if isinstance(load, Weight) else "a force on a line or at a place"
            raise InputError(f"load {k}: {what} is not on the finite element side")


def _refuse_cells(configuration: Configuration) -> None:
    if configuration.degree != 2 or configuration.counted:
        raise InputError(
            "degree: rods that are tied are meshed as one solid, with tetrahedra of degree 2 that gmsh chooses"
        )


def _refuse_loaded(name: str, model: Any, given: Mapping[str, Any]) -> None:
    """Raise `InputError` where isorod's modes are about an equilibrium: finite elements have those at rest."""
    from isorod.modal.loaded import burdens

    under = "" if given.get("at_rest") else burdens(model)
    if under:
        raise InputError(
            f"{name}: finite elements have modes at rest, and these are about the equilibrium under {under}; compare "
            "those at rest (at_rest = true), or its statics"
        )
