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
from isorod.statics.climb import begin, climb, descend
from isorod.statics.contact_policy import outcome, warn_of
from isorod.statics.equilibrium import Equilibrium
from isorod.statics.kept import Keeper, Kept
from isorod.statics.newton import Newton
from isorod.statics.path import Path

# Laws with memory take at most so many load steps from one kink of a table to the next where nobody asks for more.
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
    """Bring supports and loads to their full values, or follow their histories, and return the equilibrium.

    In a load step no support turns by more than a quarter of a turn, and no section of its body by half a turn, so that
    whole turns are counted (`isorod.checks.turning`).  Each step starts with a predictor, linear from the last
    equilibrium or, once there are two, the cubic through both with their tangents, then SNES
    (`isorod.statics.convergence` says when it has converged).  A step in which SNES diverges, an element inverts
    (``det F <= 0``) or loses most of its volume, a section turns too far, or bodies in contact go through each other,
    is halved and tried again; after quick steps the step doubles.  In the end multipliers of contact are added, and
    points of it, as far as these are wanted (`isorod.statics.contact_policy`).  With friction, which depends on the
    path, that is done in each step, and each goes on from where points stick and slip at the end of the one before.

    Parameters
    ----------
    model
        Bodies and supports; a rigid motion that these leave free must be held by contact in the end
        (`isorod.statics.stabilisation`).
    load_steps
        Number of equal steps to start with; over time, from each kink of a table to the next.  By default one, and for
        laws with memory as many as ``steps_tolerance`` asks for.
    petsc
        PETSc options for this solve alone, such as ``{"snes_rtol": 1e-10}`` (`isorod.petsc.options.in_force`).
    start
        Displacement ``(dofs,)`` near that at the full load, such as that on another space
        (`isorod.space.transfer`): the equilibrium is looked for there and, where it is not found, or not seen to be
        wound as often as supports turn, from rest.  With friction, which depends on the path, it is where the first
        step looks for its equilibrium if ``load_steps`` is 1.  Over time it is not read: all of the way counts.
    keep
        Keep the state of each load step (`Equilibrium.path`).
    stable
        Go on from an equilibrium that is not stable to one that is, the way that the model would go.
    progress
        Show on standard error how far it is (`isorod.output.progress`).
    outputs
        Number of equilibria, evenly spaced in load factor or time, that are kept and make the curves
        (`Equilibrium.path`); where not given those of the load steps taken, if they are kept.
    end_time
        Time to which histories are followed (`isorod.model.times.until`): load steps end at each kink of a table, and
        contact settles in each.
    steps_tolerance
        Of laws with memory, where ``load_steps`` is not given, the relative error by few load steps
        (`Equilibrium.steps_error`) from which on these are doubled, up to 256 times as many.
    checkpoint, every, resume
        File to keep the last equilibrium in, at load steps at least this many seconds of wall time apart; whether to
        continue from it.  A file that is there is not overwritten without.  Without contact, ties, mean supports and
        finite element bodies; of laws with memory ``load_steps`` are to be given.
    like
        The answer of a model beside: where the path counts (memory, friction) its load steps are taken, whatever
        ``load_steps`` and ``steps_tolerance`` are, so that a difference of both is none of their errors.

    Raises
    ------
    InputError
        If it is not a model, the number of steps none, an option is refused, a body whose law is of small strains is
        turned by more than a quarter of a turn, or what is to be stable has no stability (`isorod.statics.stability`).
    SolveError
        If a rigid motion is free, or a step was halved ten times in vain: the message names element, axis position and
        ``det F``, or the bodies; or penetration does not fall to what the contact asks for; or no stable equilibrium is
        found.
    """
    unmoved(model, "statics", timed=end_time is not None)
    if end_time is None:
        _refuse_timed(model)
    model = model if end_time is None else until(model, end_time)
    _warn_of_flowing_layers(model)
    asked = 1 if load_steps is None else whole_number("load steps", load_steps, 1, 1_000_000)
    if resume and checkpoint is None:
        raise InputError("resume: got no checkpoint, need the file that the run wrote")
    if checkpoint is not None and load_steps is None and model.remembers:
        raise InputError("checkpoint: give load steps, which else are doubled until their error is small")
    kept = None if checkpoint is None else Kept(File(checkpoint), every, resume)
    stops: Sequence[float] = ()
    if like is not None and (model.remembers or any(one.friction for one in model.contacts)):
        asked, stops = 1, like.factors
    with in_force(petsc):
        found = _solve(model, asked, comm, start, (keep, outputs), stable, progress, kept, stops)
        if load_steps is None and model.remembers and not stops:
            return _in_enough_steps(found, (keep, outputs), stable, steps_tolerance)
    return found


def _refuse_timed(model: Model) -> None:
    """Raise `InputError` for laws whose stress depends on time where there is none."""
    for b, body in enumerate(model.bodies):
        law = next((law for law in body.laws if law.timed), None)
        if law is not None:
            raise InputError(f"material of body {b}: {type(law).__name__} flows with time; give an end_time")


def _warn_of_flowing_layers(model: Model) -> None:
    """Warn of means over layers of several laws that flow: they are weighed by moduli, as no stress then is."""
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


def _in_more_steps(asked: int, kept: tuple[bool, int | None], stable: bool, found: Equilibrium) -> Equilibrium:
    """Return the equilibrium that twice as many load steps as asked for reach; collective."""
    comm = PETSc.COMM_SELF if found.ranks == 1 else PETSc.COMM_WORLD
    with warnings.catch_warnings():
        # They were said of the first.
        warnings.simplefilter("ignore")
        return _solve(found.model.after(()), 2 * asked, comm, None, kept, stable, False)


def _in_enough_steps(found: Equilibrium, kept: tuple[bool, int | None], stable: bool, tolerance: float) -> Equilibrium:
    """Return the equilibrium of as many load steps as a tolerance asks for; collective."""
    steps, seconds = 1, found.seconds
    while steps < _MOST_STEPS and (steps == 1 or (found.steps_error or 0.0) > tolerance):
        finer = _in_more_steps(steps, kept, stable, found)
        seconds = {name: value + finer.seconds[name] for name, value in seconds.items()}
        found, steps = replace(finer, coarser=replace(found, coarser=None)), 2 * steps
    return replace(found, seconds=seconds)


def _solve(
    model: Model,
    load_steps: int,
    comm: PETSc.Comm | None,
    start_at: Array | None,
    kept: tuple[bool, int | None],
    stable: bool,
    progress: bool,
    saved: Kept | None = None,
    stops: Sequence[float] = (),
) -> Equilibrium:
    """Return what `solve` does, as the options in force say."""
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
        # The matrix is made with room for what touches there.
        assembler.contact.tangent(np.pad(start_at, (0, assembler.contact.beyond.size)))
    solver, told, keeper = Newton(assembler, loose), Reporter(), None
    if progress and assembler.comm.getRank() == 0:
        solver.tell = told
    try:
        if stable:
            stability.refuse_untold(solver)
        setup = perf_counter() - start
        assembler.seconds = 0.0
        path = Path(assembler, *kept)
        if saved is not None:
            keeper = Keeper(solver, path, saved, (load_steps, kept))
        found = None if path.outputs or model.times is not None or saved else begin(solver, start_at, path)
        augmentations = climb(solver, load_steps, path, start_at, keeper, stops) if found is None else found
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
            # What is let go shows nothing of what it went through.
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
        if keeper is not None:
            stop.add_note(keeper.keep())
        raise
    finally:
        told.close()
        if keeper is not None:
            keeper.close()
        solver.destroy()
