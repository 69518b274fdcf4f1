"""Static equilibrium: SNES with load continuation."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path as File
from time import perf_counter

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.formulation import assembler_for
from isorod.checks import hourglass, overlap, rigid_motions, small
from isorod.checks.reactions import carried, check_balance, check_means
from isorod.checks.tie_result import at_load
from isorod.checks.turning import refuse_small
from isorod.errors import InputError, whole_number
from isorod.model.mean import MeanSupport
from isorod.model.model import Model, unmoved
from isorod.model.times import until
from isorod.output.progress import Reporter
from isorod.petsc.library import solver_types
from isorod.petsc.options import in_force
from isorod.statics import stability
from isorod.statics.checkpoints import CheckpointOptions, CheckpointWriter
from isorod.statics.climb import begin, climb, descend
from isorod.statics.contact_policy import outcome, warn_of
from isorod.statics.equilibrium import Equilibrium
from isorod.statics.newton import Newton
from isorod.statics.path import Path

# Maximum number of load steps from one kink of a table to the next with laws with memory, unless more are requested.
_MOST_STEPS = 256


def solve(
    model: Model,
    load_steps: int | None = None,
    comm: PETSc.Comm | None = None,
    petsc: Mapping[str, object] | None = None,
    start: Array | None = None,
    keep: bool = False,
    stable: bool = False,
    progress: bool = False,
    outputs: int | None = None,
    end_time: float | None = None,
    steps_tolerance: float = 2.5e-3,
    checkpoint: str | File | None = None,
    every: float = 30.0,
    resume: bool = False,
    like: Equilibrium | None = None,
) -> Equilibrium:
    """Increase supports and loads to their full values, or follow their histories, and return the equilibrium.

    In a load step no support rotates by more than a quarter of a turn, and no section of its body by half a turn, so
    that full turns are counted (`isorod.checks.turning`).  Each step starts with a predictor, linear from the last
    equilibrium or, once there are two, the cubic through both with their tangents; SNES follows, with the convergence
    test of `isorod.statics.convergence`.  A step in which SNES diverges, an element inverts (``det F <= 0``) or loses
    most of its volume, a section rotates too far, or bodies in contact pass through each other, is halved and repeated;
    after quick steps the step size doubles.  At the end multipliers and points of contact are added as needed
    (`isorod.statics.contact_policy`).  With friction, which depends on the path, that is done in each step, which
    starts from the stick points at the end of the one before.

    Parameters
    ----------
    model
        Bodies and supports; a rigid motion that these leave free must be held by contact at the end
        (`isorod.statics.stabilisation`).
    load_steps
        Initial number of equal steps; over time, from each kink of a table to the next.  By default one, and for laws
        with memory as many as ``steps_tolerance`` requires.
    petsc
        PETSc options for this solve alone, such as ``{"snes_rtol": 1e-10}`` (`isorod.petsc.options.in_force`).
    start
        Initial guess of the displacement ``(dofs,)`` at the full load, such as that on another space
        (`isorod.space.transfer`).  If this does not converge, or has not as many turns as the supports, the load path
        starts from rest.  With friction, which depends on the path, it is the initial guess of the first step if
        ``load_steps`` is 1.  Over time it is ignored, as results depend on the path.
    keep
        Keep the state of each load step (`Equilibrium.path`).
    stable
        Continue from an unstable equilibrium to a stable one, along the path that the model would take.
    progress
        Show the progress on standard error (`isorod.output.progress`).
    outputs
        Number of equilibria, evenly spaced in load factor or time, that are kept and make the curves
        (`Equilibrium.path`); by default those of the load steps, if these are kept.
    end_time
        Time to which histories are followed (`isorod.model.times.until`): load steps end at each kink of a table, and
        contact settles in each.
    steps_tolerance
        For laws with memory without ``load_steps``: the number of steps is doubled, up to 256, while the relative error
        by it (`Equilibrium.steps_error`) is larger.
    checkpoint, every, resume
        File for the last equilibrium, minimum wall time between two checkpoints in seconds, and whether to continue
        from the file.  Without ``resume`` an existing file is not overwritten.  Not available with contact, ties, mean
        supports and finite element bodies; laws with memory need ``load_steps``.
    like
        Solution of another model: with memory or friction its load steps are taken, whatever ``load_steps`` and
        ``steps_tolerance`` are, so that a difference of both solutions has no error by other steps.

    Raises
    ------
    InputError
        If an argument is invalid, a body of a small-strain law is rotated by more than a quarter of a turn, or
        ``stable`` is set where stability is unknown (`isorod.statics.stability`).
    SolveError
        If a rigid motion is free; if a step fails after ten halvings, with element, axis position and ``det F``, or the
        bodies, in the message; if penetration does not fall to its limit; or if there is no stable equilibrium.
    """
    unmoved(model, "statics", timed=end_time is not None)
    if end_time is None:
        _refuse_timed(model)
    model = model if end_time is None else until(model, end_time)
    _warn_of_flowing_layers(model)
    steps = 1 if load_steps is None else whole_number("load steps", load_steps, 1, 1_000_000)
    if resume and checkpoint is None:
        raise InputError("resume: got no checkpoint, need the file that the run wrote")
    if checkpoint is not None and load_steps is None and model.remembers:
        raise InputError("checkpoint: give load steps, which else are doubled until their error is small")
    kept = None if checkpoint is None else CheckpointOptions(File(checkpoint), every, resume)
    stops: Sequence[float] = ()
    if like is not None and (model.remembers or any(contact.friction for contact in model.contacts)):
        steps, stops = 1, like.factors
    with in_force(petsc):
        reached = _solve(model, steps, comm, start, (keep, outputs), stable, progress, kept, stops)
        if load_steps is None and model.remembers and not stops:
            return _in_enough_steps(reached, (keep, outputs), stable, steps_tolerance)
    return reached


def _refuse_timed(model: Model) -> None:
    """Raise `InputError` for laws whose stress depends on time, in analyses without time."""
    for b, body in enumerate(model.bodies):
        law = next((law for law in body.laws if law.timed), None)
        if law is not None:
            raise InputError(f"material of body {b}: {type(law).__name__} flows with time; give an end_time")


def _warn_of_flowing_layers(model: Model) -> None:
    """Warn of mean supports over layers of several laws that flow: they are weighted by moduli, unlike the stress."""
    for support in model.supports:
        if not isinstance(support, MeanSupport) or support.ring:
            continue
        body = model.bodies[support.body]
        if body.remembers and len(body.space.rod.rings) > 2 and len({*map(id, body.laws)}) > 1:
            warnings.warn(
                f"mean support of body {support.body}: layers are held by shares of their elastic moduli, so that the "
                "section gives way where one of them flows, by some per cent; hold the face, or a longer rod",
                stacklevel=4,
            )
            return


def _in_more_steps(steps: int, kept: tuple[bool, int | None], stable: bool, solution: Equilibrium) -> Equilibrium:
    """Return the equilibrium with twice as many load steps; collective."""
    comm = PETSc.COMM_SELF if solution.ranks == 1 else PETSc.COMM_WORLD
    with warnings.catch_warnings():
        # The first solution has raised them.
        warnings.simplefilter("ignore")
        return _solve(solution.model.after(()), 2 * steps, comm, None, kept, stable, False)


def _in_enough_steps(
    solution: Equilibrium, kept: tuple[bool, int | None], stable: bool, tolerance: float
) -> Equilibrium:
    """Return the equilibrium with as many load steps as a tolerance requires; collective."""
    steps, seconds = 1, solution.seconds
    while steps < _MOST_STEPS and (steps == 1 or (solution.steps_error or 0.0) > tolerance):
        finer = _in_more_steps(steps, kept, stable, solution)
        seconds = {name: value + finer.seconds[name] for name, value in seconds.items()}
        solution, steps = replace(finer, coarser=replace(solution, coarser=None)), 2 * steps
    return replace(solution, seconds=seconds)


def _solve(
    model: Model,
    load_steps: int,
    comm: PETSc.Comm | None,
    start_at: Array | None,
    kept: tuple[bool, int | None],
    stable: bool,
    progress: bool,
    saved: CheckpointOptions | None = None,
    stops: Sequence[float] = (),
) -> Equilibrium:
    """Return the result of `solve`, with the options in force."""
    start = perf_counter()
    refuse_small(model)
    loose = rigid_motions.left_to_contact(model)
    if loose and model.times is not None:
        raise InputError(
            f"end_time: body {loose[0][0]} is held by contact alone, and its position is undetermined where that "
            "opens along the load path; add a support, or a soft spring"
        )
    overlapped = overlap.warn_at_rest(model)
    assembler = assembler_for(model, comm)
    if assembler.contact is not None and start_at is not None:
        # The matrix includes the entries of the contacts there.
        assembler.contact.tangent(np.pad(start_at, (0, assembler.contact.beyond.size)))
    solver, display, writer = Newton(assembler, loose), Reporter(), None
    if progress and assembler.comm.getRank() == 0:
        solver.report = display
    try:
        if stable:
            stability.refuse_unknown(solver)
        setup = perf_counter() - start
        assembler.seconds = 0.0
        path = Path(assembler, *kept)
        if saved is not None:
            writer = CheckpointWriter(solver, path, saved, (load_steps, kept))
        begun = None if path.outputs or model.times is not None or saved else begin(solver, start_at, path)
        augmentations = climb(solver, load_steps, path, start_at, writer, stops) if begun is None else begun
        held = solver.settle()
        if stable:
            augmentations += descend(solver, path)
        displacement = assembler.displacement(solver.x, 1.0)
        _, reactions, moments, work = carried(assembler, solver.x, 1.0)
        rtol = solver.snes.getTolerances()[0]
        assembly, solved = assembler.seconds, perf_counter()
        check_balance(assembler, solver.x, displacement, reactions, moments, solver.norms[-1], rtol, path.most)
        check_means(assembler, solver.x, reactions, moments)
        overlap.warn_in_the_end(model, displacement, overlapped)
        small.warn_of_large(model, displacement[None], [assembler.solids(solver.x, 1.0)])
        rules, turn = hourglass.better_rules(model), path.largest
        stored = assembler.energy(solver.x, 1.0) if rules or turn is not None else 0.0
        if turn is not None and turn.energy <= stored:
            turn = None
        if turn is not None:
            # After unloading the last state does not show these.
            small.warn_of_large(model, turn.displacement[None], [turn.solids])
            warn_of(assembler.contact, turn.contacts)
        if rules and not model.remembers:
            about = (displacement, stored) if turn is None else (turn.displacement, turn.energy, turn.factor)
            hourglass.check_energy(assembler, rules, *about)
        contacts = () if assembler.contact is None else outcome(assembler.contact, assembler.touching(solver.x, 1.0))
        stabilisation = None if held is None else (held.left, held.rounds)
        negative = stability.negative_eigenvalues(solver)
        stability.warn_of(negative)
        seconds = {"setup": setup, "assembly": assembly, "solve": solved - start - setup - assembly}
        seconds["check"] = perf_counter() - solved
        reached = Equilibrium(
            model=model.after(path.past),
            displacement=displacement,
            reactions=reactions,
            moments=moments,
            work=work,
            load_steps=len(path.steps),
            in_more_steps=None if stops else partial(_in_more_steps, load_steps, (False, None), False),
            cuts=solver.cuts,
            newton_iterations=solver.iterations,
            linear_iterations=solver.linear_iterations,
            residual_norms=solver.norms,
            seconds=seconds,
            built=assembler.built,
            solver=solver_types(solver.snes),
            ranks=assembler.comm.getSize(),
            contacts=contacts,
            settled=None if assembler.contact is None else assembler.contact.settled(),
            settlings=() if solver.policy is None else solver.policy.settlings,
            augmentations=augmentations,
            pressures=assembler.pressures(solver.x),
            stabilisation=stabilisation,
            path=path.steps if any(kept) or assembler.contact is not None or model.times is not None else (),
            negative_eigenvalues=negative,
            ties=at_load(assembler, solver.x, 1.0),
            solids=assembler.solids(solver.x, 1.0),
        )
        return reached.with_largest(turn)
    except KeyboardInterrupt as stop:
        if writer is not None:
            stop.add_note(writer.keep())
        raise
    finally:
        display.close()
        if writer is not None:
            writer.close()
        solver.destroy()
