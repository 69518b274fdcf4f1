"""Dynamics, explicit or implicit, with damping, activation and contact, and checks of energy and momentum."""

import warnings
from collections.abc import Mapping, Sequence
from copy import copy
from importlib import import_module
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.mass import refuse_massless
from isorod.checks import overlap, small
from isorod.checks.turning import LONGEST
from isorod.dynamics.explicit.system import System
from isorod.dynamics.history import History
from isorod.dynamics.run import Run, Settings
from isorod.errors import InputError, expect, representable, whole_number
from isorod.material.thermal import Thermal
from isorod.model.model import Model
from isorod.output import checkpoint as files
from isorod.output.progress import Progress
from isorod.output.solids import owned
from isorod.petsc.options import in_force

if TYPE_CHECKING:
    from isorod.dynamics.contact_resolution import PeakContacts

# Displacement error of implicit steps above which a warning is given.
_LARGE = 0.005

# How often a motion is repeated with more points of contact, at most.
_LOOKS = 2


def solve(
    model: Model,
    end_time: float,
    time_step: float | None = None,
    outputs: int = 50,
    damping: float = 0.0,
    ramp: float = 0.0,
    displacement: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    checkpoint: str | Path | None = None,
    every: float = 30.0,
    resume: bool = False,
    progress: bool = False,
    integrator: str = "explicit",
    petsc: Mapping[str, object] | None = None,
    comm: PETSc.Comm | None = None,
    solids: Sequence[tuple[ArrayLike, ArrayLike]] = (),
) -> History:
    """Integrate the motion of a model from time zero.

    Supports have their displacement (at load factor 1) and loads their full value from the start, unless these have a
    ``history``, a factor over time (`isorod.model.history.InTime`); supports may ``spin``.  Steps have the exact
    impulse of a load, and the exact displacement of a support, with kinks of tables anywhere.  An instantaneous support
    rotation of more than a quarter of a turn needs an initial displacement.
    Explicit steps are central differences with the consistent mass; for a step longer than the critical one mass is
    scaled selectively (`isorod.dynamics.explicit.mass`).  Implicit steps of any size conserve energy and momenta
    (`isorod.dynamics.implicit.assembler`); with contact energy is conserved to second order.  Bodies may have the mixed
    formulation in implicit steps.

    Parameters
    ----------
    model
        Bodies with densities; a warning is given where those of small-strain laws
        (`isorod.material.law.Material.objective`) have large rotations or strains.
    end_time
        Final time.
    time_step
        Largest step; the one taken divides the time between outputs.  By default 0.9 of the critical step of the
        consistent mass, reduced when the bodies stiffen; required for implicit steps.
    outputs
        Number of equal intervals between outputs.
    damping
        Mass-proportional damping ``c``, 1/time: ``M a + c M v + f = 0``.
    ramp
        Time in which the activation of muscles grows linearly to that of their laws.
    displacement, velocity
        Initial values of all degrees of freedom, shape ``(dofs,)``; those of held ones are ignored.  Velocities are by
        default those of the bodies (`isorod.model.body.Body`).  For incompressible bodies they are projected onto
        volume-preserving ones, in the norm of the mass.
    checkpoint, every, resume
        File for the state, minimum wall time between two checkpoints in seconds, and whether to continue from the file,
        with the same output interval and also to a later end time.  Without ``resume`` an existing file is not
        overwritten.
    progress
        Show the progress on standard error (`isorod.output.progress`).
    integrator
        ``"explicit"`` or ``"implicit"``.
    petsc
        PETSc options for the implicit steps of this run alone, such as ``{"snes_rtol": 1e-8}``
        (`isorod.petsc.options.in_force`).
    comm
        The ranks; all by default.
    solids
        Initial displacement and velocity of each of the model's finite element bodies, by default at rest: of their
        degrees of freedom on this rank, shape ``(3 nodes,)``, as in `isorod.statics.Equilibrium.solids`, or ``(3,)`` or
        a number for all nodes.

    Raises
    ------
    InputError
        If an argument is invalid, the instantaneous rotation of a support is too large, the explicit time step is
        unstable at the start with the largest mass scaling, or a checkpoint cannot be used.
    SolveError
        If explicit steps become unstable, with step, time, element and critical time step in the message; if an
        implicit step does not converge; or if bodies in contact would pass through each other.
    """
    expect("model", model, Model)
    start, chosen = perf_counter(), _run_of(integrator)
    model = model.in_motion(integrator)
    settings = Settings(end_time, whole_number("outputs", outputs, 1, 1_000_000), time_step, damping, ramp)
    _check(model, settings, every)
    if model.solids and integrator == "explicit":
        raise InputError("solids: not supported by explicit steps; use integrator 'implicit'")
    if displacement is None:
        _check_turns(model)
    if resume and checkpoint is None:
        raise InputError("resume: got no checkpoint, need the file that the run wrote")
    with in_force(petsc):
        ranks = comm or PETSc.COMM_WORLD
        if velocity is None:
            velocity = np.concatenate([body.initial_velocity for body in model.bodies]).ravel()
        initial = _nodal(model, "displacement", displacement), _nodal(model, "velocity", velocity)
        if model.solids:
            from isorod.dynamics.implicit.solids import initial as of_solids

            of_bodies = of_solids(model.solids, solids)
            initial = np.append(initial[0], of_bodies[0]), np.append(initial[1], of_bodies[1])
        path, looks, setup, loop = None if checkpoint is None else Path(checkpoint), 0, 0.0, 0.0
        points = _points(path, model, ranks) if model.contacts and resume and path is not None else None
        while True:
            begun = perf_counter()
            run = chosen(System(model, ranks, integrator == "explicit", points), settings)
            file = _Checkpoint(run, path, (initial[0].copy(), initial[1].copy()))
            try:
                file.begin(resume and not looks, bool(looks))
                if not looks:
                    overlapped = overlap.warn_at_rest(model, initial[0][: model.dofs])
                resumed, first = run.time, run.taken
                setup += perf_counter() - (begun if looks else start)
                spent, solver = _go(run, file, every, progress)
                loop += spent
            finally:
                file.close()
            at_peaks = _peak_contacts(run) if model.contacts else None
            points = at_peaks.better_points() if at_peaks and looks < _LOOKS and run.taken > first else None
            if points is None:
                break
            looks += 1
        overlap.warn_in_the_end(model, run.rows["displacement"][-1], overlapped)
        _warn_of_steps(run)
        touched = at_peaks.results() if at_peaks else []
        for doubt in at_peaks.doubts(touched) if at_peaks else []:
            warnings.warn(doubt, stacklevel=2)
        small.warn_of_large(
            model, np.array(run.rows["displacement"]), [owned(model, state) for state in run.rows["solid_displacement"]]
        )
    return History(
        model=_without_states(model),
        **{name: np.array(values) for name, values in run.rows.items()},
        steps=run.taken,
        time_step=run.step,
        critical_step=min(value for _, value in run.estimates),
        estimates=np.array(run.estimates),
        microseconds_a_step=1e6 * loop / max(run.taken - first, 1),
        newton_iterations=run.newton_iterations,
        cuts=run.cuts,
        resumed=resumed if resume else None,
        time_error=run.time_error,
        seconds={"setup": setup, "loop": loop, "solve": perf_counter() - start - setup},
        built=[*run.built, *(["contact"] if model.contacts else [])],
        solver=solver,
        ranks=ranks.getSize(),
        ramp=settings.ramp,
        contacts=touched,
    )


def _points(path: Path, model: Model, comm: PETSc.Comm) -> list[tuple[int, int]] | None:
    """Return points of each pass of contacts of the run that wrote a checkpoint.

    Those given by a contact have precedence.  None if the file is of other contacts, which is refused when the run
    begins.
    """
    stored = files.look(path, "points", comm.tompi4py())
    user = [each.points for each in model.contacts for _ in (each.sides if each.facets is None else (None,))]
    if stored is None or len(stored) != len(user):
        return None
    return [chosen or (int(around), int(along)) for chosen, (around, along) in zip(user, stored, strict=True)]


def _without_states(model: Model) -> Model:
    """Return the model of a motion; states of laws with memory, known at quadrature points alone, are left out."""
    if not model.remembers:
        return model
    (made := copy(model))._set(bodies=[body.after(None) for body in model.bodies])
    return made


def _go(run: Run, file: "_Checkpoint", every: float, progress: bool) -> tuple[float, dict[str, str]]:
    """Take a run to its end; return the wall time of its steps, and the solver's methods."""
    loop, saved, ranks = 0.0, perf_counter(), run.system.ranks
    shown = Progress(run.time, run.settings.end_time)
    run.report = shown if progress and ranks.rank == 0 else run.report
    try:
        while run.index < run.outputs:
            loop += run.advance()
            if ranks.first(perf_counter() - saved >= every) or run.index == run.outputs:
                file.write()
                saved = perf_counter()
        return loop, run.solver()
    except KeyboardInterrupt as stop:
        stop.add_note(file.keep())
        raise
    finally:
        shown.close()
        run.end()


def _peak_contacts(run: Run) -> "PeakContacts":
    from isorod.dynamics.contact_resolution import PeakContacts

    return PeakContacts(run)


def _warn_of_steps(run: Run) -> None:
    """Warn of inaccurate implicit steps."""
    error = run.time_error
    if error is not None and error > _LARGE:
        warnings.warn(
            f"time step {run.step:.4g}: estimated displacement error {100.0 * error:.2g} % of the largest (period "
            f"elongation); use {run.step * np.sqrt(0.5 * _LARGE / error):.2g} or less",
            stacklevel=3,
        )


def _run_of(integrator: str) -> type[Run]:
    if integrator not in ("explicit", "implicit"):
        raise InputError(f"integrator: got {integrator!r}, need 'explicit' or 'implicit'")
    chosen: type[Run] = import_module(f"isorod.dynamics.{integrator}.run").Run
    return chosen


class _Checkpoint:
    """The checkpoint of a run, if it has a file."""

    def __init__(self, run: Run, path: Path | None, initial: tuple[Array, Array]) -> None:
        self._run, self._initial = run, initial
        comm = run.system.ranks.communicator.tompi4py()
        self._file = files.Kept(path, lambda: run.identity(*initial), comm)

    def begin(self, resume: bool, anew: bool) -> None:
        """Begin the run, from the file if it is to be resumed; lock the file until `close`."""
        kept = self._file.begin(resume, anew)
        if kept is not None:
            try:
                self._run.restore(kept)
            except InputError as problem:
                raise InputError(f"checkpoint {self._file.path}: {problem}") from None
            return
        self._run.begin(*self._initial)
        self.write()

    def close(self) -> None:
        """Release the file."""
        self._file.close()

    def write(self) -> None:
        """Write the state."""
        if self._file.path is not None:
            self._file.write(self._run.state())

    def keep(self) -> str:
        """Write the state of an interrupted run; return a note on it."""
        reached = f"time {self._run.time:.6g} of {self._run.settings.end_time:.6g}"
        return self._file.keep(self._run.state, reached)


def _check(model: Model, settings: Settings, every: float) -> None:
    """Raise `InputError` if a number is out of its range, or dynamics does not support the model."""
    for name, value in (("end time", settings.end_time), ("time step", settings.time_step)):
        if value is not None and not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name}: got {value:g}, need a positive time")
    representable("end time", settings.end_time)
    for name, value, what in (
        ("damping", settings.damping, "1/time"),
        ("ramp", settings.ramp, "a time"),
        ("time between checkpoints", every, "seconds"),
    ):
        if not (np.isfinite(value) and value >= 0.0):
            raise InputError(f"{name}: got {value:g}, need {what}, not negative")
    heated = [b for b, body in enumerate(model.bodies) if any(isinstance(law, Thermal) for law in body.laws)]
    if settings.ramp and heated:
        raise InputError(
            f"ramp: activation grows with it, and the temperature of body {heated[0]} does not; leave it out"
        )
    for b in heated:
        if any(isinstance(law, Thermal) and law.history is not None for law in model.bodies[b].laws):
            raise InputError(f"temperature history of body {b}: motions have the temperature at once; leave it out")
    rigid = [b for b in heated if any(law.lame == np.inf for law in model.bodies[b].laws)]
    if rigid:
        raise InputError(
            f"temperature of body {rigid[0]}: it is there at once in motions, and an incompressible law has no other "
            "volume at once; take nu = 0.4999, or a finite bulk modulus"
        )
    if model.spin is not None:
        raise InputError("spin: dynamics in a rotating frame is not supported; give the bodies an initial velocity")
    model.refuse_hold("motions")
    for k, mean in model.means.items():
        if np.any(mean.displacement) and mean.history is None:
            raise InputError(f"support {k}: a mean motion is not displaced at once in dynamics; give it a history")
    for k, motion in enumerate(model.motions):
        if motion.tied.any():
            raise InputError(f"support {k}: tied components are not supported in dynamics")
    if not model.unknowns:
        raise InputError("supports: all degrees of freedom are constrained; leave one free")
    refuse_massless(model.bodies, "dynamics needs")
    for k, solid in enumerate(model.solids):
        if not 0.0 < solid.density < np.inf:
            raise InputError(f"solid {k} has density {solid.density:g}, dynamics needs a positive mass per volume")


def _check_turns(model: Model) -> None:
    """Raise `InputError` if the instantaneous rotation of a support is ambiguous by full turns."""
    for k, motion in enumerate(model.motions):
        turn = float(np.linalg.norm(motion.clock.at(0.0) * motion.turn))
        if turn > LONGEST:
            raise InputError(
                f"support {k}: got an instantaneous rotation of {np.degrees(turn):.4g} degrees, need at most 90; apply "
                "it in statics, and start from that displacement"
            )


def _nodal(model: Model, name: str, given: ArrayLike | None) -> Array:
    values = np.zeros(model.dofs) if given is None else np.array(given, dtype=float)
    if values.shape != (model.dofs,) or not np.isfinite(values).all():
        raise InputError(f"initial {name}: got shape {values.shape}, need ({model.dofs},) finite numbers")
    values[model.held] = (model.placed(0.0) if name == "displacement" else model.rates(0.0))[model.held]
    return values
