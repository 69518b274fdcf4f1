"""Dynamics, explicit or implicit, with damping, activation and contact, and the balances that prove them."""

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
    from isorod.dynamics.sight import Sight

# Error of implicit steps above which they are warned of.
_LARGE = 0.005

# How often a motion is taken anew with more points of contact, at most.
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

    Supports keep their displacement (at load factor 1) throughout, and loads their full value from the start, but for
    what has a ``history``, a factor by time (`isorod.model.history.InTime`); supports may ``spin``.  Steps have the
    whole impulse of a load, and the exact way of a support, whether their ends are at the table's kinks or not.
    Supports that turn by more than a quarter of a turn at once want an initial displacement.
    Explicit steps are central differences with the consistent mass; for a step longer than its critical one, mass is
    added to fast waves (`isorod.dynamics.explicit.mass`).  Implicit ones conserve energy and momenta whatever the step
    (`isorod.dynamics.implicit.assembler`); contact keeps energy to second order.  Bodies may have the mixed
    formulation; explicit steps take displacements alone.

    Parameters
    ----------
    model
        Bodies with densities; those whose laws are of small strains (`isorod.material.law.Material.objective`) are
        warned of where they turn or strain by more.
    end_time
        Time to reach.
    time_step
        Largest step; the one taken divides the time between outputs.  Where not given, 0.9 of the critical step of the
        consistent mass, and made smaller when the bodies stiffen; implicit steps must be given.
    outputs
        Number of equal intervals between outputs.
    damping
        Mass-proportional damping ``c``, 1/time: ``M a + c M v + f = 0``.
    ramp
        Time in which the activation of muscles grows linearly to that of their laws.
    displacement, velocity
        Initial values of all degrees of freedom, shape ``(dofs,)``; those of held ones are not read.  Velocities that
        are not given are those of the bodies (`isorod.model.body.Body`).  Of incompressible
        bodies the nearest that change no volume are taken, in the norm of mass.
    checkpoint, every, resume
        File to keep the state in, at outputs at least this many seconds of wall time apart; whether to continue from
        it, to a later end time too if outputs are as far apart.  A file that is there is not overwritten without.
    progress
        Show how far it is on standard error (`isorod.output.progress`).
    integrator
        ``"explicit"`` or ``"implicit"``.
    petsc
        PETSc options for the implicit steps of this run alone, such as ``{"snes_rtol": 1e-8}``
        (`isorod.petsc.options.in_force`).
    comm
        The ranks, all there are where it is not given.
    solids
        Initial displacement and velocity of each of the model's finite element bodies, at rest if there are none: of
        their degrees of freedom on this rank, shape ``(3 nodes,)``, as `isorod.statics.Equilibrium.solids` has them, or
        ``(3,)`` or a number for all nodes.

    Raises
    ------
    InputError
        If a number is out of range, a support is turned too far at once, the explicit time step is not stable at the
        start with as much mass as may be added, a checkpoint cannot be used, or an option is refused.
    SolveError
        If the motion blows up: the message names step, time, element, and the critical time step; or an implicit step
        does not converge; or bodies in contact would go through each other.
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

            others = of_solids(model.solids, solids)
            initial = np.append(initial[0], others[0]), np.append(initial[1], others[1])
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
            sight = _sight(run) if model.contacts else None
            points = sight.better_points() if sight and looks < _LOOKS and run.taken > first else None
            if points is None:
                break
            looks += 1
        overlap.warn_in_the_end(model, run.rows["displacement"][-1], overlapped)
        _warn_of_steps(run)
        touched = sight.results() if sight else []
        for doubt in sight.doubts(touched) if sight else []:
            warnings.warn(doubt, stacklevel=2)
        small.warn_of_large(
            model, np.array(run.rows["displacement"]), [owned(model, one) for one in run.rows["solid_displacement"]]
        )
    return History(
        model=_untold(model),
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
    """Return points of each pass of contacts with which a run took the steps that it left in a checkpoint.

    Those that a contact gives stay.  None where they are of other contacts: that is refused when the run begins.
    """
    found = files.look(path, "points", comm.tompi4py())
    given = [one.points for one in model.contacts for _ in (one.sides if one.facets is None else (None,))]
    if found is None or len(found) != len(given):
        return None
    return [own or (int(around), int(along)) for own, (around, along) in zip(given, found, strict=True)]


def _untold(model: Model) -> Model:
    """Return the model of a motion, of which laws with memory tell nothing but at points of quadrature."""
    if not model.remembers:
        return model
    (made := copy(model))._set(bodies=[body.after(None) for body in model.bodies])
    return made


def _go(run: Run, file: "_Checkpoint", every: float, progress: bool) -> tuple[float, dict[str, str]]:
    """Take a run to its end; return the wall time of its steps, and the methods at work."""
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


def _sight(run: Run) -> "Sight":
    from isorod.dynamics.sight import Sight

    return Sight(run)


def _warn_of_steps(run: Run) -> None:
    """Warn of steps too long for what moves."""
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
    """What a run keeps in a file, if it has one."""

    def __init__(self, run: Run, path: Path | None, initial: tuple[Array, Array]) -> None:
        self._run, self._initial = run, initial
        comm = run.system.ranks.communicator.tompi4py()
        self._file = files.Kept(path, lambda: run.identity(*initial), comm)

    def begin(self, resume: bool, anew: bool) -> None:
        """Begin the run, from the file if it is to be resumed; none other may have the file until `close`."""
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
        """Let other runs have the file."""
        self._file.close()

    def write(self) -> None:
        """Keep the state."""
        if self._file.path is not None:
            self._file.write(self._run.state())

    def keep(self) -> str:
        """Keep the state of a run that is interrupted; return where it is, in words."""
        reached = f"time {self._run.time:.6g} of {self._run.settings.end_time:.6g}"
        return self._file.keep(self._run.state, reached)


def _check(model: Model, settings: Settings, every: float) -> None:
    """Raise `InputError` if a number is out of its range or the model holds what motions do not know."""
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
    for k, one in model.means.items():
        if np.any(one.displacement) and one.history is None:
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
    """Raise `InputError` if a support is turned at once by so much that the motion cannot know how often."""
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
