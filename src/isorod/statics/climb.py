"""The load path to an equilibrium at the full load: in steps from rest, from a nearby state, or on to a stable one."""

import warnings
from collections.abc import Sequence
from itertools import pairwise

from isorod.arrays import Array
from isorod.errors import SolveError
from isorod.statics import stability
from isorod.statics.checkpoints import CheckpointWriter, Reached
from isorod.statics.newton import Newton
from isorod.statics.path import Path
from isorod.statics.proximal import NEARLY
from isorod.statics.steps import Diverged
from isorod.statics.tuning import CONTROL


def begin(solver: Newton, start: Array | None, path: Path) -> int | None:
    """Iterate from a displacement to equilibrium; return the number of multiplier updates, None if it fails."""
    policy = solver.policy
    in_steps, remembers = policy is not None and policy.in_steps, solver.assembler.model.remembers
    if start is None or in_steps or remembers or not solver.begin(start):
        return None
    solver.settle()
    updates = 0 if policy is None else policy.settle_in_the_end()
    path.reached(solver.x, 1.0)
    return updates


def descend(solver: Newton, path: Path) -> int:
    """Go to a stable equilibrium at the full load; return the number of multiplier updates."""
    if not stability.negative_eigenvalues(solver):
        return 0
    from isorod.statics import descent

    descent.descend(solver)
    updates = 0
    if solver.policy is not None:
        updates = solver.policy.settle_in_the_end()
        if stability.negative_eigenvalues(solver):
            raise SolveError("stable: no stable equilibrium: none is left at the final penetration")
    path.steps.pop()
    path.reached(solver.x, 1.0)
    return updates


def climb(
    solver: Newton,
    load_steps: int,
    path: Path,
    start: Array | None = None,
    writer: CheckpointWriter | None = None,
    stops: Sequence[float] = (),
) -> int:
    """Follow the load path to its end, from a checkpoint if any; fill ``path``; return how many multiplier updates.

    Steps end at ``stops`` and the path's outputs.  With friction ``start``, a displacement near the end, is the initial
    guess of a path of one load step.
    """
    policy, model = solver.policy, solver.assembler.model
    in_steps, stages = policy is not None and policy.in_steps, model.stages
    if in_steps and start is not None and load_steps == 1 and model.times is None and len(stops) < 2:
        solver.guess = solver.assembler.state(start)
    stops = sorted({*stages, *path.outputs, *stops})
    solver.left = path.left

    def first(factor: float) -> float:
        """Return the initial step: a fraction of the path or, over time, of that up to the next kink of a table."""
        return (1.0 if model.times is None else _stage_length(stages, factor)) / load_steps

    reached = Reached(0.0, first(0.0), 0, 0, 0.0)
    factor, step, augmentations, quick, loose = reached if writer is None else writer.begun(reached)
    while factor < 1.0:
        end = next(stop for stop in stops if stop > factor)
        longest = solver.steps.turning.longest_step(factor)
        there = factor + min(step, longest)
        target = end if there > end - 1e-12 else there
        guessed = solver.guess is not None
        try:
            if policy is not None and in_steps:
                solves, updates = policy.step(factor, target)
            else:
                solves, updates = solver.advance(factor, target), 0
        except Diverged as problem:
            if guessed:
                # Again, without the guess.
                continue
            if solver.steps.watched and not solver.steps.careful:
                solver.steps.careful = True
                continue
            if policy is not None and policy.failed(problem):
                continue
            solver.cuts += 1
            step = 0.5 * (target - factor)
            if step < min(first(factor), longest) / 2**CONTROL.halvings:
                rubs = solver.assembler.contact is not None and solver.assembler.contact.friction is not None
                cure = "; an equilibrium without friction may exist" if rubs else ""
                raise SolveError(f"{model.when(target)}: {problem}{cure}") from None
            continue
        factor = target
        if factor in stages:
            solver.forget_path()
        if factor == 1.0:
            solver.settle()
            if policy is not None and (not in_steps or solver.stabilisation is not None):
                updates += policy.settle_in_the_end()
        augmentations += updates
        loose = loose if _note(solver, path, factor) else factor
        quick = quick + 1 if solves <= (CONTROL.quick if policy is None else CONTROL.quick_touching) else 0
        if factor in stages:
            step, quick = first(factor), 0
        elif quick > (0 if policy is None else min(solver.cuts, CONTROL.wary)):
            step, quick = 2.0 * step, 0
            if in_steps or model.remembers:
                # Results depend on the path: steps are no longer than requested.
                step = min(step, first(factor))
        if writer is not None:
            writer.note(Reached(factor, step, augmentations, quick, loose))
    if loose:
        warnings.warn(
            f"up to load factor {loose:.4g} rigid-body modes are constrained by artificial stiffness, not yet by "
            "contact: its forces are part of the intermediate load steps, not of the last",
            stacklevel=5,
        )
    return augmentations


def _stage_length(stages: Sequence[float], factor: float) -> float:
    """Return the distance between the stages before and after a load factor."""
    return next((end - begin for begin, end in pairwise([0.0, *stages]) if end > factor), 0.0)


def _note(solver: Newton, path: Path, factor: float) -> bool:
    """Record the end of a load step; return whether contact holds all bodies there.

    Before the full load a stabilisation bears some per cent of the load: the state is recorded without it if possible.
    """
    held = solver.stabilisation
    if held is not None and factor < 1.0 and held.left > NEARLY:
        try:
            with solver.let_go(factor):
                if solver.policy is not None:
                    solver.policy.settle(factor)
                path.reached(solver.x, factor)
        except (Diverged, SolveError):
            path.reached(solver.x, factor)
            return False
        return True
    path.reached(solver.x, factor)
    return True
