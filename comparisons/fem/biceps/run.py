"""The biceps of Lu & Zhou (2011), section 5, in dolfinx: equilibrium or motion, and the record of a run."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from mpi4py import MPI

from comparisons.fem import fields, runs
from comparisons.fem.arguments import option, positive
from comparisons.fem.biceps import dynamics, statics
from comparisons.fem.biceps.branches import Branches
from comparisons.fem.contact.facets import surface_points
from comparisons.fem.contact.surfaces import Contact
from comparisons.fem.statics import DIRECT, Element
from isorod.errors import InputError
from isorod.fenics.flags import FAST
from isorod.model.body import FORMULATIONS
from isorod.output.results import write_arrays
from isorod.scenes.biceps import Biceps
from meshes import biceps
from meshes.mesh import Array, Index, Mesh

ANALYSES = ("statics", "dynamics")

# Parts of a facet's edge between points at which the surface is measured.
_MEASURED = 8

# Small cells along a brick's edge in pictures.
_SMALL = 3

# Attributes of an equilibrium, and of a motion, that the record of a run has.
_AT_REST: tuple[str, ...] = ("steps", "cuts", "newton_iterations", "residual_norms")
_MOVING: tuple[str, ...] = ("steps", "time_step", "critical_step")


@dataclass(frozen=True)
class Configuration:
    """A mesh of the biceps, an element on it, and the analysis.

    Parameters
    ----------
    analysis
        ``"statics"``: the equilibrium at full activation; ``"dynamics"``: the motion, by explicit central differences.
    cells, size, around, layers, rings, cuts
        See `meshes.biceps.build`.
    degree
        Degree of displacement and geometry, 1 or 2.
    formulation
        ``"displacement"``; ``"mixed"`` in statics, of degree 2, with pressures of one degree less (Taylor-Hood).
    quadrature
        Degree of the rule in every form; None: 1 point on linear tetrahedra, else as in
        `comparisons.fem.statics.Element`.
    parts
        See `comparisons.fem.contact.surfaces.Contact`; None: 3 for statics; for dynamics the nodes on degree 1, else 1.
    time_step
        Seconds; None: `comparisons.fem.biceps.dynamics.SAFETY` of the critical one.
    solver
        PETSc options of statics; the user's own win.
    flags
        C compiler flags of the forms; those of `comparisons.fem.statics`, or of `comparisons.fem.biceps.dynamics`, if
        empty.
    scene
        The parameters of the biceps; of dynamics too, but for the time step.
    """

    analysis: str = option("statics", "equilibrium or motion", choices=ANALYSES)
    cells: str = option("tetrahedra", "kind of the mesh", choices=biceps.CELLS)
    size: float = option(0.3325, "tetrahedra: length of the edges [cm]", "H")
    around: int = option(8, "bricks round a branch, a multiple of 4", "N")
    layers: int = option(6, "bricks along each element of the axis", "N")
    rings: int = option(1, "bricks: rings round the core", "N")
    cuts: int = option(1, "bricks: cuts of the axis elements at held ends", "N")
    degree: int = option(2, "degree of displacement and geometry", "P", type=positive)
    formulation: str = option("displacement", "statics: mixed, Taylor-Hood", choices=FORMULATIONS)
    quadrature: int | None = option(None, "degree of the quadrature rule", "Q", type=positive)
    parts: int | None = option(None, "contact: rules to a facet's edge; 0: points at the nodes", "N", type=int)
    time_step: float | None = option(None, "dynamics: time step [s] (0.9 of the critical step)", "DT", type=float)
    solver: Mapping[str, object] | None = None
    flags: Sequence[str] = ()
    scene: Biceps = field(default_factory=Biceps)

    def __post_init__(self) -> None:
        if self.analysis not in ANALYSES:
            raise InputError(f"analysis: got {self.analysis!r}, need one of {', '.join(ANALYSES)}")
        if self.degree not in (1, 2):
            raise InputError(f"degree: got {self.degree}, need 1 or 2")
        if self.formulation not in FORMULATIONS:
            raise InputError(f"formulation: got {self.formulation!r}, need one of {', '.join(FORMULATIONS)}")
        if self.formulation == "mixed" and (self.analysis != "statics" or self.degree != 2):
            raise InputError("formulation: mixed is for statics, with degree 2")
        runs.check_element(self.cells == "bricks", self.degree, "Lagrange", self.quadrature, self.degree)
        scene = self.scene
        if not 0.0 <= scene.activation <= 1.0:
            raise InputError(f"activation: got {scene.activation:g}, need 0 (at rest) to 1 (fully active)")
        if scene.fibre not in ("y", "tangent"):
            raise InputError(f"fibre: got {scene.fibre!r}, need 'y' or 'tangent'")
        for name in ("damping", "ramp"):
            value = getattr(scene, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"{name}: got {value:g}, need a finite number, not negative")
        if self.analysis == "dynamics" and not (
            scene.outputs >= 1 and np.isfinite(scene.end_time) and scene.end_time > 0.0
        ):
            raise InputError(
                f"outputs: got {scene.outputs} up to {scene.end_time:g} s, need at least 1 and a positive time"
            )
        if self.parts is not None and not 0 <= self.parts <= 8:
            raise InputError(f"parts: got {self.parts}, need 0 to 8")
        if self.time_step is not None and not (np.isfinite(self.time_step) and self.time_step > 0.0):
            raise InputError(f"time step: got {self.time_step:g}, need a positive time")

    @property
    def compiler_flags(self) -> Sequence[str]:
        """C compiler flags."""
        return self.flags or (FAST if self.analysis == "statics" else dynamics.FASTER)

    @property
    def contact_parts(self) -> int:
        """Parts of a contact facet's edge, 0 for its nodes."""
        if self.parts is not None:
            return self.parts
        if self.analysis == "statics":
            return 3
        return 0 if self.degree == 1 else 1

    def mesh(self) -> Mesh:
        """Return the mesh."""
        return biceps.build(
            self.cells, self.size, self.around, self.layers, self.degree, self.rings, self.cuts, self.scene.rods()
        )


def belly_bulge(mesh: Mesh, positions: Array) -> float:
    """Return half the growth of the bellies' extent in z, the larger one, as `Biceps.measure` does [length]."""
    bulges = []
    for branch in biceps.BRANCHES:
        supports, functions = surface_points(mesh, f"{branch} belly", 1 if mesh.order == 1 else _MEASURED)
        now, rest = (np.einsum("mb,mb->m", functions, nodes[supports, 2]) for nodes in (positions, mesh.points))
        bulges.append(0.5 * (np.ptp(now) - np.ptp(rest)))
    return float(max(bulges))


def run(
    configuration: Configuration, repeat: int = 1, file: Path | None = None, comm: MPI.Comm = MPI.COMM_WORLD
) -> dict[str, Any]:
    """Solve ``repeat`` times in this process and return the record.

    ``seconds`` is as in `comparisons.fem.runs.measured`; of dynamics ``step`` is that of one step, without samples and
    critical steps. The last state goes to ``file``, an ``.npz`` with ``points``, ``positions``, ``cells`` and
    ``belly_0`` and ``belly_1``, if one is named; of bricks also all samples, ``times`` ``(s,)``, ``displacement``
    ``(s, m, 3)`` and ``von_mises`` ``(s, m)`` on small cells, ``small_points`` and ``small_cells``.
    """
    if comm.size > 1:
        raise InputError("biceps: only on one rank")
    if file is not None and configuration.formulation == "mixed":
        raise InputError("fields: got a file, which takes displacements alone, not a mixed formulation")
    scene = configuration.scene
    start = perf_counter()
    mesh = configuration.mesh()
    meshing = perf_counter() - start
    element = Element(configuration.degree, configuration.quadrature)
    rule = element.rule(mesh.shape)
    assert isinstance(rule, int)

    def once() -> statics.Rest | dynamics.Motion:
        mixed = configuration.formulation == "mixed"
        branches = Branches(scene, mesh, rule, configuration.compiler_flags, mixed)
        first, second = (f"{branch} belly" for branch in biceps.BRANCHES)
        contact = Contact(mesh, first, second, scene.penalty, configuration.contact_parts)
        if configuration.analysis == "statics":
            options = DIRECT if configuration.solver is None else configuration.solver
            return statics.solve(branches, contact, scene.activation, options=options)
        times = [scene.end_time * (k + 1) / scene.outputs for k in range(scene.outputs)]
        return dynamics.solve(
            branches,
            contact,
            scene.density,
            times,
            lambda time: scene.activation * (min(time / scene.ramp, 1.0) if scene.ramp > 0.0 else 1.0),
            scene.damping,
            configuration.time_step,
        )

    result, record = runs.measured(once, repeat, comm, meshing)
    last: statics.Rest | dynamics.Sample
    more: dict[str, Any]
    if isinstance(result, statics.Rest):
        last, kept, more = result, _AT_REST, {"petsc_options": result.options}
        states = [(0.0, scene.activation, result.positions)]
    else:
        last, kept, more = result.samples[-1], _MOVING, {"history": _history(mesh, result.samples)}
        states = [(one.time, one.activation, one.positions) for one in result.samples]
    specific = _state(mesh, last) | {name: getattr(result, name) for name in kept} | more
    if file is not None:
        _save(file, mesh, last.positions, Branches(scene, mesh, rule, configuration.compiler_flags), states)
    return {
        "scene": "biceps",
        "analysis": configuration.analysis,
        **specific,
        "dofs": 3 * len(mesh.points) + getattr(result, "pressures", 0),
        "nodes": len(mesh.points),
        "cells": len(mesh.cells),
        "options": asdict(configuration)
        | {"quadrature": rule, "parts": configuration.contact_parts, "flags": list(configuration.compiler_flags)},
        **record,
    }


def _state(mesh: Mesh, state: statics.Rest | dynamics.Sample) -> dict[str, Any]:
    """Return the quantities of `Biceps.measure`, and energies."""
    reactions, contact = state.reactions, state.contact
    return {
        "end_force": np.linalg.norm(reactions, axis=1),
        "end_force_x": reactions[:, 0],
        "end_force_y": reactions[:, 1],
        "belly_bulge": belly_bulge(mesh, state.positions),
        "contact_force": contact.normal_force,
        "contact_resultant": contact.force,
        "contact_area": contact.area,
        "penetration": max(0.0, -contact.gap),
        "stored_energy": state.stored,
        "contact_energy": contact.energy,
    }


def _history(mesh: Mesh, samples: Sequence[dynamics.Sample]) -> dict[str, Any]:
    """Return the history of the motion, one entry a sample."""
    states = [_state(mesh, sample) for sample in samples]
    common = ("end_force", "belly_bulge", "contact_force", "contact_area", "stored_energy", "contact_energy")
    own = {"time": "time", "activation": "activation", "kinetic_energy": "kinetic", "dissipated_energy": "dissipated"}
    return {name: [getattr(sample, key) for sample in samples] for name, key in own.items()} | {
        name: [state[name] for state in states] for name in common
    }


def _save(
    path: Path, mesh: Mesh, positions: Array, branches: Branches, states: Sequence[tuple[float, float, Array]]
) -> None:
    """Write mesh and last positions, and of bricks the fields at every state.

    Time, activation, positions of the nodes.
    """
    arrays: dict[str, Array | Index] = {"points": mesh.points, "positions": positions, "cells": mesh.cells}
    arrays |= {f"belly_{k}": mesh.faces[f"{branch} belly"] for k, branch in enumerate(biceps.BRANCHES)}
    if mesh.shape == "hexahedron":
        sampler = fields.Sampler(branches.state, branches.laws(), _SMALL)
        sampled = []
        for _, activation, nodes in states:
            branches.state.x.array[:] = branches.to_dofs(nodes - mesh.points)
            branches.activation.value = activation
            sampled.append(sampler.state())
        arrays |= {"small_points": sampler.points, "small_cells": sampler.cells}
        arrays |= {"times": np.array([time for time, _, _ in states])}
        arrays |= {
            "displacement": np.array([one for one, _ in sampled]),
            "von_mises": np.array([one for _, one in sampled]),
        }
    write_arrays(path, **arrays)
