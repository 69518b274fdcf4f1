"""An estimate of an equilibrium's error: what one tangent on finer spaces, at the result, changes.

There are two of these (`isorod.checks.finer`): one is finer across the section, one along the axis, and what they
change, and what is left on them by the rule for singular solutions, adds up.  The tangent at the result takes its
residual there to corrections, as hierarchical error estimates do (Bank & Weiser, Math. Comp. 44 (1985) 283-301, with
the whole space in the place of bubbles).  What a finer space sees it says: nothing of the geometry, and nothing across
sections of degree 8.  Those of modes: `isorod.checks.estimate_of_modes`.
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

# A sum that is a smaller share of its terms is rounding.
_CANCELS = 1e-9

# Forces that are a smaller share of loads, or of moments over the width, are none.
_LITTLE = 1e-3

# Work of supports that is not so many times what rounding makes of it is none.
_ROUNDS = 100.0


class Error(NamedTuple):
    """Estimates of relative errors, None where there is none.

    Attributes
    ----------
    work
        Of the work that supports, loads or obstacles do and of the supports' forces and moments, the largest; where
        none do any work, of the displacements' size in its place.
    stress
        Of stresses away from edges (`isorod.checks.stresses`), relative to the largest.
    """

    work: float | None
    stress: float | None


class Reached(NamedTuple):
    """What is known of an equilibrium.

    Attributes
    ----------
    displacement
        All degrees of freedom, shape ``(dofs,)``.
    work
        Of the supports' forces on the displacements, and of their moments on the turns, that they prescribe.
    pressures
        Coefficients of mixed bodies.
    contacts
        Their outcome.
    carried
        Force and moment of each support, shape ``(supports, 3)`` each; None if they do not count.
    solids
        Displacements of finite element bodies, on this rank, whose meshes stay.
    """

    displacement: Array
    work: float
    pressures: Sequence[Array | None] = ()
    contacts: "Sequence[ContactResult]" = ()
    carried: tuple[Array, Array] | None = None
    solids: Sequence[Array] = ()


def of_equilibrium(model: Model, reached: Reached, directions: Sequence[str] = (), ranks: int = 1) -> Error:
    """Return estimates of the errors of an equilibrium.

    Contact is as it was, on finer spaces linear about that (`isorod.contact.frozen`): what sticks and slips goes on to.

    Parameters
    ----------
    model
        What was solved.
    directions
        Which of `isorod.checks.finer.DIRECTIONS` count, all if empty.
    ranks
        Number of those that solved it: this one alone, or all, which then call this together.
    """
    return Error(*correction.total(model, directions, ranks, partial(_equilibrium, reached), 2))


def of_solids(model: Model, displacements: Sequence[Array], stored: float) -> tuple[Error, Array | None]:
    """Return what recovered strains say of a model's finite element bodies (`isorod.fenics.recovery`); collective.

    Rods are not among them.  Of linear bodies the error of what loads do is twice the energy of the solution's error.
    With it comes where most of it is, ``(3,)``.

    Parameters
    ----------
    displacements
        Of each body's degrees of freedom on this rank.
    stored
        Energy of the rods.
    """
    found = [solid.recovered(one) for solid, one in zip(model.solids, displacements, strict=True)]
    known = [one for one in found if one is not None]
    if len(known) < len(found):
        return Error(None, None), None
    stored += sum(solid.energy(one, 1.0) for solid, one in zip(model.solids, displacements, strict=True))
    work = sum(one.work for one in known)
    if not (np.isfinite(work) and stored > 0.0):
        return Error(None, None), None
    return Error(work / (2.0 * stored), None), max(known, key=lambda one: one.work).place


def _equilibrium(reached: Reached, finer: Finer, comm: PETSc.Comm) -> Array:
    """Return the errors of work and stress that a finer space sees, NaN where there is none."""
    displacement, work, pressures, contacts, supported, solids = reached
    state = finer.displacement(displacement)
    assembler = assembler_for(finer.model, comm)
    touching = correction.touching(finer, contacts, state, comm)
    assembler.contact = touching  # type: ignore[assignment]
    x = assembler.state(state, finer.pressures(pressures) if pressures else (), solids or 0.0)
    matrix = assembler.matrix()
    ksp = correction.solver(assembler, matrix)
    try:
        sizes, gained, first = correction.corrected(assembler, x, matrix, ksp)
        found, corrected = assembler.displacement(x, 1.0), assembler.pressures(x)
        given = finer.model.driven[finer.model.bound]
        after = reactions.carried(assembler, x, 1.0)
        # Supports of unevenly spaced nodes have others in the middle of finer ones.
        arms = reactions.support_places(finer.model, state) - reactions.support_places(finer.coarse, displacement)
        after = after._replace(moments=after.moments + np.cross(arms, after.reactions))
        carried = after.bound
        noise = assembler.reaction_noise(x, 1.0)
        driving = _driving(assembler, x)
    finally:
        ksp.destroy()
        matrix.destroy()
    if not np.isfinite(sizes[-1]):
        # Too far for straight steps: the first alone, of moved supports its energy; without one nothing is right.
        found, given, noise = first, given * 0.0, given * 0.0
        if not np.isfinite(found).all():
            return np.ones(2)
        if not finer.model.external.any() and work:
            return np.array([gained / (abs(work) + gained) / (1.0 - finer.left), np.nan])
    # What moved supports do and what loads do, or where neither do, how far it goes.
    loads, moved = finer.model.external, finer.model.prescribed(1.0)[finer.model.bound]
    along = float(loads @ _carried_along(finer.model, moved))
    changes = [_change(carried * given, work, _ROUNDS * float(noise @ np.abs(given)))]
    changes.append(_change(loads * found, float(loads @ state), 0.0, along))
    if touching is not None:
        changes.append(_change(touching.work(found), float(touching.work(state).sum())))
    known = [one for one in changes if one is not None]
    if not known:
        known = [one for one in [_change(state * found, float(state @ state))] if one is not None]
    if supported is not None:
        known.append(_supported(finer.model, supported, after, _ROUNDS * float(np.abs(noise).sum()), driving))
    error = max(known, default=np.nan) / (1.0 - finer.left)
    # Stresses away from edges converge faster than works, of which edges have a part.
    return np.array([error, stresses.change(finer, displacement, found, pressures, corrected, contacts)])


def _driving(assembler: Assembler, x: PETSc.Vec) -> float:
    """Return the size of all forces of loads, those that depend on the state and a spin's too, and of laws at rest."""
    model, parts, spin = assembler.model, assembler.parts, assembler.model.spin
    own = sum(part.expelled for part in parts)
    if spin is not None:
        rest = [np.zeros(int(part.slots.max()) + 1) for part in parts]
        own += sum(float(np.abs(part.centrifugal(at, spin)).sum()) for part, at in zip(parts, rest, strict=True))
    found = float(np.abs(model.external).sum()) + float(x.comm.tompi4py().allreduce(own))
    if model.following:
        loads = x.duplicate()
        assembler.load(model, x, 1.0, loads)
        found += loads.norm(PETSc.NormType.N1)
        loads.destroy()
    return found


def _supported(
    model: Model, before: tuple[Array, Array], carried: reactions.Carried, rounding: float, driving: float
) -> float:
    """Return the change of the supports' forces and moments, relative to the largest of each.

    Forces that are next to nothing beside loads or moments do not count, nor moments that are beside forces.

    Parameters
    ----------
    before
        Force and moment of each support, as they were.
    carried
        What supports exert on a finer space.
    rounding
        Changes of force of less are none.
    driving
        Size of all forces of loads, and of laws that act by themselves.
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
    """Return the change of a sum relative to it, or to what it is without a part; None where it is rounding.

    Parameters
    ----------
    terms, before
        Of the sum, and what it was.
    noise
        What rounding makes of it.
    along
        The part that is the same in a frame that moves along, and may cancel the rest.
    """
    total = float(terms.sum())
    if not abs(total) > max(noise, _CANCELS * float(np.abs(terms).sum())) and not along:
        return None
    return abs(before - total) / max(abs(total), abs(total - along))


def _carried_along(model: Model, given: Array) -> Array:
    """Return all degrees of freedom where everything moves as supports do on average, given how their nodes move."""
    moved = np.zeros((model.dofs // 3, 3))
    carriers = model.is_control_point[model.bound // 3]
    for a in range(3):
        own = given[carriers & (model.bound % 3 == a)]
        moved[model.is_control_point, a] = own.mean() if own.size else 0.0
    return moved.ravel()
