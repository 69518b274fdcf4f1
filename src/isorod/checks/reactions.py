"""Forces and moments of the supports, and their checks: they must balance, and exceed round-off."""

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

# Largest imbalance of an equilibrium, relative to the largest support force (or moment over size).
TOLERANCE = 1e-3

# Displacements below this fraction of the size leave fewer than three digits of a slender rod's strains.
_VANISHES = 1e-11

# Angle, radians, from which moments of rotational springs are half a percent too small.
_SMALL_TURN = 0.0865

# Relative imbalance up to which loads balance each other.
_BALANCED = 1e-6

# A support force is significant above this many times its round-off, and above this fraction of the internal forces:
# Newton's iterations leave the round-off of their sum.
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
    """Raise `SolveError` where displacements vanish or support forces do not balance; warn where these are round-off.

    The deformation gradient is near one and accurate to 1e-16, so that stresses have an error of 1e-16 times the
    stiffness whatever their size.  Supports of stiff material or of a very slender rod may then report round-off alone,
    although SNES, whose tolerance takes this into account, converges.  So may supports without any part of the internal
    forces, as where a muscle shortens freely.

    Parameters
    ----------
    displacement
        All degrees of freedom, shape ``(dofs,)``.
    reactions, moments
        Force and moment of each support on the model, shape ``(supports, 3)``.
    out_of_balance
        Norm of the residual at the end.
    rtol
        Relative tolerance of SNES: that of balance is not tighter.
    most
        The largest force, or moment over size, of a support along the load path: its round-off may be left.
    """
    model, tolerance = assembler.model, max(TOLERANCE, rtol)
    moved = float(np.abs(displacement).max())
    if model.prescribed(1.0).any() and moved < _VANISHES * model.size:
        raise SolveError(
            f"displacements of {moved:.2g} are at round-off level of the model size {model.size:.2g} in double "
            "precision; prescribe larger ones: the response is linear there"
        )
    largest = float(np.linalg.norm(reactions, axis=1).max())
    # Supports may carry moments alone.
    load = max(largest, float(np.linalg.norm(moments, axis=1).max()) / model.size)
    # They carry nothing where loads balance each other, as pressure in a tube does.
    load = max(load, assembler.carried(x), most)
    # No sum over n entries is larger than sqrt(n) times their norm.
    if np.sqrt(model.unknowns) * out_of_balance <= tolerance * load:
        return
    # Mean supports hold no node, so that their forces are not in the imbalance.
    gap = float(np.linalg.norm(assembler.imbalance(x, 1.0) - reactions[list(model.means)].sum(axis=0)))
    # With contact, convergence allows round-off of the largest stiffness (`isorod.statics.convergence`).
    lost = assembler.contact is not None and out_of_balance > max(tolerance * load, gap)
    if gap <= tolerance * load and not lost:
        return
    rounding = np.linalg.norm(support_forces(model, assembler.reaction_noise(x, 1.0)), axis=1)
    # Round-off of mean supports is that of a residual.
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
    """Warn of large rotations of rotational springs; refuse loads on a support of rigid motions alone."""
    model = assembler.model
    displacement = assembler.displacement(x, 1.0)
    for k, mean in model.means.items():
        if mean.stiffness is not None and len(mean.axes):
            space = model.bodies[mean.body].space
            angle = float(np.abs(mean.turned(space, model.nodal(displacement, mean.body))).max())
            if angle > _SMALL_TURN:
                # Their potential is half the stiffness times the squared sine.
                less = 100.0 * (1.0 - 0.5 * np.sin(2.0 * angle) / angle)
                warnings.warn(
                    f"support {k}: its section turns by {np.degrees(angle):.3g} degrees; the moment of rotational "
                    f"springs, which count rotations as small, is {less:.2g} % less than stiffness times angle",
                    stacklevel=4,
                )
        force, moment = float(np.linalg.norm(reactions[k])), float(np.linalg.norm(moments[k]))
        if mean.free and max(force, moment / model.size) > _BALANCED * assembler.carried(x):
            raise SolveError(
                f"support {k}: the loads do not balance each other, and a support of rigid motions alone would carry "
                f"force {force:.3g} and moment {moment:.3g}; balance them, or add a support that carries them"
            )


class Carried(NamedTuple):
    """Forces and moments of supports on a model.

    Attributes
    ----------
    bound
        Forces on the degrees of freedom `Model.bound`.
    reactions, moments
        Force of each, and moment about the present mean of its nodes or section, ``(supports, 3)``.
    work
        Sum of forces times prescribed displacements, and of moments times prescribed rotations.
    """

    bound: Array
    reactions: Array
    moments: Array
    work: float


def carried(assembler: Assembler, x: PETSc.Vec, factor: float, acting: Array | None = None) -> Carried:
    """Return forces and moments of all supports in a state, mean ones and springs too; ``acting`` may be known."""
    model, displacement = assembler.model, assembler.displacement(x, factor)
    acting = assembler.acting(x, factor) if acting is None else acting
    forces = assembler.on_supports(acting)
    reactions, moments = support_forces(model, forces), support_moments(model, displacement, forces)
    # Without times, prescribed displacements are those at full load.
    driven = model.driven if model.times is None else model.drives(factor)
    work, on_means = float(forces @ driven[model.bound]), exerted.in_equilibrium(assembler, x, factor, acting)
    reactions += averages.forces_of(model, on_means)
    places = _places(model, displacement) if on_means else displacement
    for k, amounts in on_means.items():
        mean = averages.mean_of(model, model.means[k])
        nodal, control = mean.pushed(amounts, model.dofs // 3), model.is_control_point[:, None]
        weights = averages.centroid_weights(model, model.means[k])
        moments[k] = np.cross(places - control * (weights @ places), nodal).sum(axis=0)
        fraction = 1.0 if model.times is None else model.amplitude(model.means[k].history, factor)
        work += fraction * float(amounts @ model.means[k].values)
    return Carried(forces, reactions, moments, work)


def _places(model: Model, displacement: Array) -> Array:
    """Return present positions of nodes; with a small-strain law those at rest, in which its stress balances."""
    moved = (Laws.of(body.laws).objective * model.nodal(displacement, b) for b, body in enumerate(model.bodies))
    return np.concatenate([body.space.positions + change for body, change in zip(model.bodies, moved, strict=True)])


def support_forces(model: Model, forces: Array) -> Array:
    """Return the force of each support, ``(supports, 3)``, from forces on the degrees of freedom `Model.bound`."""
    result = np.zeros((max(len(model.supports), 1), 3))
    # Only control points, whose functions add up to one, contribute to the virtual work of a translation.
    carried = model.is_control_point[model.bound // 3]
    np.add.at(result, (model.support_of[carried], model.bound[carried] % 3), forces[carried])
    return result


def support_displacements(model: Model, displacement: Array) -> Array:
    """Return the mean displacement of each support's control points, ``(supports, 3)``."""
    return _means(model, displacement.reshape(-1, 3))


def support_places(model: Model, displacement: Array) -> Array:
    """Return the reference points of moments of `support_moments` and `carried`, ``(supports, 3)``."""
    return _means(model, _places(model, displacement))


def _means(model: Model, nodal: Array) -> Array:
    """Return the mean of nodal values ``(nodes, 3)`` over each support's nodes, ``(supports, 3)``; zero without."""
    nodes = model.bound // 3
    result = np.zeros((len(model.supports), 3))
    for k in range(len(model.supports)):
        mine = np.unique(nodes[model.support_of == k])
        control = mine[model.is_control_point[mine]]
        result[k] = nodal[control].mean(axis=0) if control.size else 0.0
    for k, mean in model.means.items():
        result[k] = averages.centroid_weights(model, mean) @ nodal
    return result


def by_name(kind: str, name: str, rows: Array) -> dict[str, Array]:
    """Return named columns of vectors ``(rows, supports, 3)`` of supports or ties."""
    return {f"{kind} {k} {name} {axis}": rows[:, k, a] for k in range(rows.shape[1]) for a, axis in enumerate("xyz")}


def support_moments(model: Model, displacement: Array, forces: Array) -> Array:
    """Return the moment of each support about the mean of its nodes' present positions, shape ``(supports, 3)``.

    It is the virtual work of the forces on the degrees of freedom `Model.bound` in a rotation, in which coefficients
    rotate like positions.  The stress of a small-strain law balances in the positions at rest, which are used there.
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
        of_support = np.where(owner[mine] == k, nodal[mine], 0.0)
        work = arms.T @ of_support
        result[k] = work[1, 2] - work[2, 1], work[2, 0] - work[0, 2], work[0, 1] - work[1, 0]
    return result
