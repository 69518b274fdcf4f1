"""Hierarchical error estimate of an equilibrium: its change by the tangent on finer spaces.

There are two finer spaces (`isorod.checks.finer`), across the section and along the axis.  Their changes add up, each
extrapolated by the convergence rate of singular solutions.  The tangent at the result turns the residual on the finer
space into a correction (Bank & Weiser, Math. Comp. 44 (1985) 283-301, with the full space instead of bubbles).  The
estimate does not include errors of the geometry, nor those across sections of degree 8.  Modes:
`isorod.checks.estimate_of_modes`.
"""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.formulation import assembler_for
from isorod.checks import correction, reactions, stresses
from isorod.checks.finer import Finer
from isorod.model.model import Model
from isorod.output import held

if TYPE_CHECKING:
    from isorod.contact.result import ContactResult

# A sum below this fraction of its terms is round-off.
_CANCELS = 1e-9

# Forces below this fraction of the loads, or of moments over the width, do not count.
_LITTLE = 1e-3

# Work of supports below this many times its round-off does not count.
_ROUNDS = 100.0


class Error(NamedTuple):
    """Estimates of relative errors, None where there is none.

    Attributes
    ----------
    work
        The largest of the work of supports, loads and obstacles and of the supports' forces and moments; where there
        is no work, of the norm of displacements instead.
    stress
        That of stresses away from edges (`isorod.checks.stresses`), relative to the largest.
    """

    work: float | None
    stress: float | None


class Reached(NamedTuple):
    """An equilibrium.

    Attributes
    ----------
    displacement
        All degrees of freedom, shape ``(dofs,)``.
    work
        Work of the supports' forces and moments on prescribed displacements and rotations.
    pressures
        Coefficients of mixed bodies.
    contacts
        Results of contacts.
    carried
        Force and moment of each support, shape ``(supports, 3)`` each; None if they do not count.
    solids
        Displacements of finite element bodies on this rank; their meshes are not refined.
    """

    displacement: Array
    work: float
    pressures: Sequence[Array | None] = ()
    contacts: "Sequence[ContactResult]" = ()
    carried: tuple[Array, Array] | None = None
    solids: Sequence[Array] = ()


def of_equilibrium(model: Model, reached: Reached, directions: Sequence[str] = (), ranks: int = 1) -> Error:
    """Return estimates of the errors of an equilibrium.

    Contact on finer spaces is linearised with a fixed active set, and sticks and slips as before
    (`isorod.contact.frozen`).

    Parameters
    ----------
    model
        The model that was solved.
    directions
        Which of `isorod.checks.finer.DIRECTIONS` count, all if empty.
    ranks
        Number of ranks of the solve: 1, or all, which then call this collectively.
    """
    return Error(*correction.total(model, directions, ranks, partial(_equilibrium, reached), 2))


def of_solids(model: Model, displacements: Sequence[Array], stored: float) -> tuple[Error, Array | None]:
    """Return the error of a model's finite element bodies by recovered strains (`isorod.fenics.recovery`); collective.

    Rods are not included.  For linear bodies the error of the loads' work is twice the energy of the solution's error.
    Also returned is the point ``(3,)`` where it is largest.

    Parameters
    ----------
    displacements
        Degrees of freedom of each body on this rank.
    stored
        Energy of the rods.
    """
    recovered = [solid.recovered(result) for solid, result in zip(model.solids, displacements, strict=True)]
    known = [result for result in recovered if result is not None]
    if len(known) < len(recovered):
        return Error(None, None), None
    stored += sum(solid.energy(result, 1.0) for solid, result in zip(model.solids, displacements, strict=True))
    work = sum(result.work for result in known)
    if not (np.isfinite(work) and stored > 0.0):
        return Error(None, None), None
    return Error(work / (2.0 * stored), None), max(known, key=lambda result: result.work).place


def _equilibrium(reached: Reached, finer: Finer, comm: PETSc.Comm) -> Array:
    """Return the errors of work and stress by a finer space, NaN where there is none."""
    displacement, work, pressures, contacts, supported, solids = reached
    state = finer.displacement(displacement)
    assembler = assembler_for(finer.model, comm)
    touching = correction.touching(finer, contacts, state, comm)
    assembler.contact = touching  # type: ignore[assignment]
    x = assembler.state(state, finer.pressures(pressures) if pressures else (), solids or 0.0)
    matrix = assembler.matrix()
    ksp = correction.solver(assembler, matrix)
    try:
        sizes, energy, first = correction.corrected(assembler, x, matrix, ksp)
        refined, corrected = assembler.displacement(x, 1.0), assembler.pressures(x)
        prescribed = finer.model.driven[finer.model.bound]
        after = reactions.carried(assembler, x, 1.0)
        # The mean of unevenly spaced nodes moves on finer spaces: moments are taken about the coarse one.
        arms = reactions.support_places(finer.model, state) - reactions.support_places(finer.coarse, displacement)
        after = after._replace(moments=after.moments + np.cross(arms, after.reactions))
        carried = after.bound
        noise = assembler.reaction_noise(x, 1.0)
        driving = _driving(assembler, x)
    finally:
        ksp.destroy()
        matrix.destroy()
    if not np.isfinite(sizes[-1]):
        # No convergence: the first increment alone, with moved supports its energy; if that fails, an error of 1.
        refined, prescribed, noise = first, prescribed * 0.0, prescribed * 0.0
        if not np.isfinite(refined).all():
            return np.ones(2)
        if not finer.model.external.any() and work:
            return np.array([energy / (abs(work) + energy) / (1.0 - finer.left), np.nan])
    # Work of moved supports and of loads, or where there is neither, the norm of displacements.
    loads, moved = finer.model.external, finer.model.prescribed(1.0)[finer.model.bound]
    rigid = float(loads @ _carried_along(finer.model, moved))
    changes = [_change(carried * prescribed, work, _ROUNDS * float(noise @ np.abs(prescribed)))]
    changes.append(_change(loads * refined, float(loads @ state), 0.0, rigid))
    if touching is not None:
        changes.append(_change(touching.work(refined), float(touching.work(state).sum())))
    known = [value for value in changes if value is not None]
    if not known:
        known = [value for value in [_change(state * refined, float(state @ state))] if value is not None]
    if supported is not None:
        known.append(_supported(finer.model, supported, after, _ROUNDS * float(np.abs(noise).sum()), driving))
    error = max(known, default=np.nan) / (1.0 - finer.left)
    # Stresses away from edges converge faster than work, to which edges contribute.
    return np.array([error, stresses.change(finer, displacement, refined, pressures, corrected, contacts)])


def _driving(assembler: Assembler, x: PETSc.Vec) -> float:
    """Return the sum of all load magnitudes, with follower loads and spin, and of stresses at rest."""
    model, parts, spin = assembler.model, assembler.parts, assembler.model.spin
    local = sum(part.expelled for part in parts)
    if spin is not None:
        rest = [np.zeros(int(part.slots.max()) + 1) for part in parts]
        local += sum(float(np.abs(part.centrifugal(at, spin)).sum()) for part, at in zip(parts, rest, strict=True))
    total = float(np.abs(model.external).sum()) + float(x.comm.tompi4py().allreduce(local))
    if model.following:
        loads = x.duplicate()
        assembler.load(model, x, 1.0, loads)
        total += loads.norm(PETSc.NormType.N1)
        loads.destroy()
    return total


def _supported(
    model: Model, before: tuple[Array, Array], carried: reactions.Carried, rounding: float, driving: float
) -> float:
    """Return the change of the supports' forces and moments, relative to the largest of each.

    Forces that are negligible beside loads or moments do not count, nor do moments beside forces.

    Parameters
    ----------
    before
        Force and moment of each support on the model's spaces.
    carried
        Those on a finer space.
    rounding
        Changes of force below this do not count.
    driving
        Sum of all load magnitudes, and of stresses at rest.
    """
    after = carried.reactions, carried.moments
    force, moment = (float(np.linalg.norm(one, axis=1).max(initial=0.0)) for one in after)
    width = max(held.width(model, b) for b in range(len(model.bodies)))
    force = max(force, rounding, _LITTLE * max(driving, moment / width))
    pairs = zip(after, before, strict=True)
    changes = (float(np.linalg.norm(new - old, axis=1).max(initial=0.0)) for new, old in pairs)
    sizes = (force, rounding), (max(moment, force * width), rounding * width)
    counted = [change / size for change, (size, none) in zip(changes, sizes, strict=True) if change > none]
    return max(counted, default=0.0)


def _change(terms: Array, before: float, noise: float = 0.0, along: float = 0.0) -> float | None:
    """Return the change of a sum relative to it, or to it without a part; None where it is round-off.

    Parameters
    ----------
    terms, before
        Terms of the sum, and its former value.
    noise
        Its round-off.
    along
        The part by a rigid translation with the supports, which may cancel the rest.
    """
    total = float(terms.sum())
    if not abs(total) > max(noise, _CANCELS * float(np.abs(terms).sum())) and not along:
        return None
    return abs(before - total) / max(abs(total), abs(total - along))


def _carried_along(model: Model, prescribed: Array) -> Array:
    """Return all degrees of freedom of a rigid translation by the mean of the supports' prescribed displacements."""
    moved = np.zeros((model.dofs // 3, 3))
    control = model.is_control_point[model.bound // 3]
    for a in range(3):
        values = prescribed[control & (model.bound % 3 == a)]
        moved[model.is_control_point, a] = values.mean() if values.size else 0.0
    return moved.ravel()
