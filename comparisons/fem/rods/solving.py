"""The one call: a model of isorod's on a mesh of its rods."""

from collections.abc import Mapping, Sequence
from typing import Any

from mpi4py import MPI

from comparisons.fem.known import Steps, refuse
from comparisons.fem.rods import equilibrium, motion, remembered
from comparisons.fem.rods import modes as modes_of_rods
from comparisons.fem.rods.task import Task
from comparisons.fem.statics import Element
from isorod.errors import InputError
from isorod.fenics.flags import FAST
from isorod.files.solid import OfBody
from isorod.model.model import Model
from meshes.joined_mesh import Joined
from meshes.mesh import Mesh


def solve(
    model: Model,
    mesh: Mesh,
    analysis: str,
    modes: int = 10,
    options: Mapping[str, object] | None = None,
    flags: Sequence[str] = FAST,
    load_steps: int | None = None,
    end_time: float | None = None,
    bodies: Sequence[OfBody] = (),
    steps: Steps | None = None,
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Any:
    """Return a `Solution`, or of dynamics a `motion.Motion`, of displacement elements with the nodes of the mesh.

        Parameters
        ----------
        model
            Rods, supports, loads and contacts; with ties and bodies on a mesh of all as one solid.
        mesh
            Hexahedra of the rods with parameters, regions ``"rod 0"`` ... and faces ``"rod 0 start"`` ...
            (`meshes.rods.build`), or tetrahedra of rods and bodies (`meshes.joined_mesh.build`).
        analysis
            ``"statics"``, ``"modal"`` about the state of rest, or ``"dynamics"``.
        modes
            Number of modes besides the rigid ones.
        options
            PETSc options that the user's own override; MUMPS if not given.
        flags
            C compiler flags for the forms.
        load_steps
            Equal steps to start with (statics): 1, or with laws with memory as many as their error needs.
        end_time
            Of histories of laws with memory (statics).
        bodies
            What holds and loads the model's bodies, which have that of their own meshes alone.
        steps
            Those of dynamics.
        comm
            The ranks; each has the whole model and mesh, and all of the solution.

        Raises
        ------
        InputError
    If finite elements do not have something of the model.
        SolveError
            If no solution is reached.
    """
    refuse(model, analysis, bodies)
    if (model.ties or model.solids) and not isinstance(mesh, Joined):
        raise InputError("ties and finite element bodies: need a mesh of all as one solid, and got each rod for itself")
    rule = Element(mesh.order).rule(mesh.shape)
    assert isinstance(rule, int)
    task = Task(model, mesh, rule, options, flags, bodies, comm)
    if analysis == "statics" and model.remembers:
        return remembered.solve(task, load_steps, end_time)
    if analysis == "statics":
        return equilibrium.solve(task, load_steps or 1)
    if analysis == "modal":
        return modes_of_rods.solve(task, modes)
    if analysis == "dynamics" and steps is not None:
        return motion.solve(task, steps)
    raise InputError(f"analysis {analysis}: the finite element side has statics, modes and dynamics only")
