"""Forces and moments of the supports, and whether they mean anything: they must balance, and exceed rounding."""

import warnings
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly import averages, exerted
from isorod.assembly.assembler import Assembler
from isorod.errors import SolveError
from isorod.material.along_rod import Laws
from isorod.model.model import Model

# The forces of an equilibrium balance to this share of the largest support force (or moment over size), or there is no
# result.
TOLERANCE = 1e-3

# Displacements below this share of the size leave fewer than three digits of a slender rod's strains.
_VANISHES = 1e-11

# From this angle on, radians, moments of rotational springs are half a percent off.
_SMALL_TURN = 0.0865

# Loads balance each other to this share.
_BALANCED = 1e-6

# A support force counts as one if it is this many times what rounding alone makes there, or more than this share of the
# forces inside: Newton's iterations leave rounding of all that is added up there.
_SIGNIFICANT, _NOTHING = 10.0, 1e-9


def check_balance(
    assembler: Assembler,
    x: PETSc.Vec,
    displacement: Array,
    reactions: Array,
    moments: Array,
    out_of_balance: float,
    rtol: float,
    most: float = 0.0,
) -> None:
    """Raise `SolveError` where displacements vanish or support forces do not balance; warn where these are rounding.

    The deformation gradient is near one and known to 1e-16, so that stresses carry an error of 1e-16 times the
    stiffness whatever their size.  A support of stiff material, or of a very slender rod, then reports forces that are
    nothing else, and SNES, whose tolerance takes this into account, converges.  So does one that carries nothing of the
    forces inside, as where a muscle shortens freely.

    Parameters
    ----------
    displacement
        All degrees of freedom, shape ``(dofs,)``.
    reactions, moments
        Force and moment of each support on the model, shape ``(supports, 3)``.
    out_of_balance
        Norm of the residual at the end.
    rtol
        Relative tolerance of SNES: where it is looser, balance is asked for to this only.
    most
        The largest force, or moment over size, that a support had on the way: rounding of this may be left.
    """
    model, tolerance = assembler.model, max(TOLERANCE, rtol)
    moved = float(np.abs(displacement).max())
    if model.prescribed(1.0).any() and moved < _VANISHES * model.size:
        raise SolveError(
            f"displacements of {moved:.2g} are at round-off level of the model size {model.size:.2g} in double "
            "precision; prescribe larger ones: the response is linear there"
        )
    largest = float(np.linalg.norm(reactions, axis=1).max())
    # Where supports carry moments alone, their forces vanish.
    load = max(largest, float(np.linalg.norm(moments, axis=1).max()) / model.size)
    # Nor are there any where loads balance each other, as pressure in a tube does.
    load = max(load, assembler.carried(x), most)
    # No sum over n entries is larger than sqrt(n) times their norm.
    if np.sqrt(model.unknowns) * out_of_balance <= tolerance * load:
        return
    # What is held in the mean has no node that is.
    gap = float(np.linalg.norm(assembler.imbalance(x, 1.0) - reactions[list(model.means)].sum(axis=0)))
    # Contact is held against the rounding of the largest stiffness alone (`isorod.statics.convergence`).
    lost = assembler.contact is not None and out_of_balance > max(tolerance * load, gap)
    if gap <= tolerance * load and not lost:
        return
    rounding = np.linalg.norm(support_forces(model, assembler.reaction_noise(x, 1.0)), axis=1)
    # What is held in the mean has the rounding of a residual.
    rounding[list(model.means)] += np.sqrt(model.unknowns) * out_of_balance
    counts = (np.linalg.norm(reactions, axis=1) > _SIGNIFICANT * rounding).any()
    if counts and max(largest, gap, out_of_balance) > _NOTHING * assembler.inside(x, 1.0):
        if lost:
            raise SolveError(
                f"force balance violated: residual {out_of_balance:.2g}, support reactions {largest:.2g}: the "
                "stiffness contrast along the model is too large for double precision"
            )
        raise SolveError(
            f"support reactions do not balance the loads: residual {gap:.2g}, largest reaction {largest:.2g}: SNES "
            "tolerances are too loose, or displacements too small, or the stiffness contrast along the model too "
            "large for double precision"
        )
    if model.loads:
        raise SolveError(
            f"loads are at round-off level of the stiffness: residual {gap:.2g}, support reactions {largest:.2g}: the "
            "model is too slender or too stiff for them in double precision"
        )
    warnings.warn(f"support reactions are at round-off level: {largest:.2g}, accurate to {gap:.2g}", stacklevel=3)


def check_means(assembler: Assembler, x: PETSc.Vec, reactions: Array, moments: Array) -> None:
    """Warn of rotational springs that turn far; refuse a hold of rigid motions alone that carries loads."""
    model = assembler.model
    displacement = assembler.displacement(x, 1.0)
    for k, one in model.means.items():
        if one.stiffness is not None and len(one.axes):
            space = model.bodies[one.body].space
            angle = float(np.abs(one.turned(space, model.nodal(displacement, one.body))).max())
            if angle > _SMALL_TURN:
                # Their potential is half the stiffness times the squared sine.
                less = 100.0 * (1.0 - 0.5 * np.sin(2.0 * angle) / angle)
                warnings.warn(
                    f"support {k}: its section turns by {np.degrees(angle):.3g} degrees; the moment of rotational "
                    f"springs, which count rotations as small, is {less:.2g} % less than stiffness times angle",
                    stacklevel=4,
                )
        force, moment = float(np.linalg.norm(reactions[k])), float(np.linalg.norm(moments[k]))
        if one.free and max(force, moment / model.size) > _BALANCED * assembler.carried(x):
            raise SolveError(
                f"support {k}: the loads do not balance each other, and what holds rigid motions alone would carry "
                f"force {force:.3g} and moment {moment:.3g}; balance them, or take a support that says where"
            )


class Carried(NamedTuple):
    """What supports exert on a model.

    Attributes
    ----------
    bound
        Forces on the degrees of freedom `Model.bound`.
    reactions, moments
        Force of each, and moment about the mean of its nodes, or of its section, as these are now, ``(supports, 3)``.
    work
        Sum of their forces times the displacements, and moments times the turns, that they prescribe.
    """

    bound: Array
    reactions: Array
    moments: Array
    work: float


def carried(assembler: Assembler, x: PETSc.Vec, factor: float, acting: Array | None = None) -> Carried:
    """Return what supports exert in a state, those of mean motions and springs too; ``acting`` may be known."""
    model, displacement = assembler.model, assembler.displacement(x, factor)
    acting = assembler.acting(x, factor) if acting is None else acting
    forces = assembler.on_supports(acting)
    reactions, moments = support_forces(model, forces), support_moments(model, displacement, forces)
    # Without times what is driven is told at the full load alone.
    driven = model.driven if model.times is None else model.drives(factor)
    work, own = float(forces @ driven[model.bound]), exerted.in_equilibrium(assembler, x, factor, acting)
    reactions += averages.forces_of(model, own)
    places = _places(model, displacement) if own else displacement
    for k, amounts in own.items():
        mean = averages.mean_of(model, model.means[k])
        nodal, carriers = mean.pushed(amounts, model.dofs // 3), model.is_control_point[:, None]
        shares = averages.centroid_weights(model, model.means[k])
        moments[k] = np.cross(places - carriers * (shares @ places), nodal).sum(axis=0)
        share = 1.0 if model.times is None else model.amplitude(model.means[k].history, factor)
        work += share * float(amounts @ model.means[k].values)
    return Carried(forces, reactions, moments, work)


def _places(model: Model, displacement: Array) -> Array:
    """Return where nodes are, at rest of bodies that have a law of small strains, in which their stress balances."""
    moved = (Laws.of(body.laws).objective * model.nodal(displacement, b) for b, body in enumerate(model.bodies))
    return np.concatenate([body.space.positions + change for body, change in zip(model.bodies, moved, strict=True)])


def support_forces(model: Model, forces: Array) -> Array:
    """Return the force of each support, shape ``(supports, 3)``, of those on the degrees of freedom `Model.bound`."""
    result = np.zeros((max(len(model.supports), 1), 3))
    # Only functions that add up to one take part in the virtual work of a translation.
    carried = model.is_control_point[model.bound // 3]
    np.add.at(result, (model.support_of[carried], model.bound[carried] % 3), forces[carried])
    return result


def support_displacements(model: Model, displacement: Array) -> Array:
    """Return the mean displacement of each support's nodes, those that move with their rods, ``(supports, 3)``."""
    return _means(model, displacement.reshape(-1, 3))


def support_places(model: Model, displacement: Array) -> Array:
    """Return the points about which moments of `support_moments` and `carried` are, ``(supports, 3)``."""
    return _means(model, _places(model, displacement))


def _means(model: Model, nodal: Array) -> Array:
    """Return the mean of nodal values ``(nodes, 3)`` over each support's nodes, ``(supports, 3)``; zero without."""
    nodes = model.bound // 3
    result = np.zeros((len(model.supports), 3))
    for k in range(len(model.supports)):
        mine = np.unique(nodes[model.support_of == k])
        carriers = mine[model.is_control_point[mine]]
        result[k] = nodal[carriers].mean(axis=0) if carriers.size else 0.0
    for k, one in model.means.items():
        result[k] = averages.centroid_weights(model, one) @ nodal
    return result


def by_name(kind: str, name: str, rows: Array) -> dict[str, Array]:
    """Return columns, by their names, of what each support, or tie, has: vectors ``(rows, supports, 3)``."""
    return {f"{kind} {k} {name} {axis}": rows[:, k, a] for k in range(rows.shape[1]) for a, axis in enumerate("xyz")}


def support_moments(model: Model, displacement: Array, forces: Array) -> Array:
    """Return the moment of each support about the mean of its nodes' present positions, shape ``(supports, 3)``.

    It is the work of the nodal forces, those on the degrees of freedom `Model.bound`, on a rotation, in which
    coefficients turn like positions.  The stress of a linear elastic law balances in the positions at rest, which are
    taken where a body has one.
    """
    nodal = np.zeros((model.dofs // 3, 3))
    nodal.ravel()[model.bound] = forces
    owner = np.full((model.dofs // 3, 3), -1)
    owner.ravel()[model.bound] = model.support_of
    is_control_point = model.is_control_point
    places = _places(model, displacement)
    result = np.zeros((max(len(model.supports), 1), 3))
    for k in range(len(model.supports)):
        mine = (owner == k).any(axis=1)
        carries = mine & is_control_point
        if not carries.any():
            continue
        arms = places[mine] - is_control_point[mine, None] * places[carries].mean(axis=0)
        own = np.where(owner[mine] == k, nodal[mine], 0.0)
        work = arms.T @ own
        result[k] = work[1, 2] - work[2, 1], work[2, 0] - work[0, 2], work[0, 1] - work[1, 0]
    return result
