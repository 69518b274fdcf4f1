"""Rigid-body modes of a model: those that the supports leave free, and the near-null space."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from petsc4py import PETSc
from scipy.linalg import block_diag

from isorod.arrays import Array, Index
from isorod.assembly.assembler import Assembler
from isorod.checks.groups import Group, Motions, groups, motions_of_group, slides
from isorod.errors import InputError, SolveError
from isorod.model.model import Model
from isorod.model.tie import Tie
from isorod.petsc.matrix import orthonormalise
from isorod.space.space import Space
from isorod.tensors import motions_of

# A motion is free if it moves supported components by less than this fraction of its norm.
_TOLERANCE = 1e-8

# An end face larger than this fraction of the rod's size holds all rigid motions when clamped.
_FACE = 1e-4

# Width of a section over the size of its rod below which an unsupported one has no bending modes in double precision.
_THIN = 1e-7


def motions(space: Space, moved: Array | float = 0.0) -> Array:
    """Return the six infinitesimal rigid motions of a space's nodes, orthonormal, shape ``(3 nodes, 6)``.

    A rod contains them exactly, since its functions contain its geometry map.  They are about the configuration
    displaced by ``moved``, ``(nodes, 3)``.
    """
    return np.linalg.qr(motions_of(_arms(space, moved), space.is_control_point))[0]


def _arms(space: Space, moved: Array | float = 0.0) -> Array:
    """Return the coefficients of positions relative to their mean."""
    places = space.positions + moved
    return np.asarray(places - places[space.is_control_point].mean(axis=0) * space.is_control_point[:, None])


def _clamped(space: Space, free: Index) -> bool:
    """Return whether supports (the model's ``free`` of this space) clamp an end face that is not small."""
    if space.rod.closed:
        return False
    points = space.rod.control_points
    held = free.reshape(space.layers, -1)[[0, -1]] < 0
    for face in np.flatnonzero(held.all(axis=1)):
        arms = points[-face] - points[-face].mean(axis=0)
        spread = arms.T @ arms
        # For its eigenvalues a >= b >= c, (ab + bc + ca) / (a + b + c) is 2 b at most.
        trace = spread.trace()
        second = (trace**2 - (spread * spread).sum()) / (4.0 * trace) if trace > 0.0 else 0.0
        if second > (_FACE * np.abs(points - points[0, 0]).max()) ** 2:
            return True
    return False


def free_motions(model: Model, displacement: Array | None = None) -> list[tuple[int, Array]]:
    """Return the rigid motions that the supports leave free: body, and displacements of its nodes ``(nodes, 3)``.

    They are about a ``displacement`` ``(dofs,)``, or at rest.  Welded bodies move as one and are represented by their
    first rod.

    Raises
    ------
    SolveError
        If a motion moves finite element bodies alone.
    """
    motions = moved_freely(model, displacement)
    if not all(motions):
        raise SolveError("supports: a solid is free to move as a rigid body; add a condition")
    return [rods[0] for rods in motions]


def moved_freely(model: Model, displacement: Array | None = None) -> list[list[tuple[int, Array]]]:
    """Return the rods that each free motion moves, with displacements of their nodes; empty where solids alone move."""
    free: list[list[tuple[int, Array]]] = []
    parts = groups(model, welds=True)
    for group in groups(model):
        welded = [
            part for part in parts if set(part.bodies) <= set(group.bodies) and set(part.solids) <= set(group.solids)
        ]
        if len(welded) == 1 and any(_clamped(model.bodies[b].space, _free(model, b)) for b in group.bodies):
            continue
        moving = [motions_of_group(model, part, displacement) for part in welded]
        rows = block_diag(*(motions.held for motions in moving))
        for tie in model.ties:
            if slides(tie) and group.has(tie.slave):
                rows = np.concatenate([rows, _apart(model, tie, welded, moving)])
        # The triangular factor has the same singular values and number of columns.
        triangle = np.linalg.qr(rows, mode="r") if len(rows) else np.zeros((1, rows.shape[1]))
        _, sizes, turns = np.linalg.svd(triangle, full_matrices=True)
        padded = np.zeros(rows.shape[1])
        padded[: sizes.size] = sizes
        for turn in turns[padded < _TOLERANCE].reshape(-1, len(welded), 6):
            free.append(
                [
                    (b, (motions.bodies[b] @ amounts).reshape(-1, 3))
                    for motions, amounts in zip(moving, turn, strict=True)
                    for b in motions.bodies
                    if np.abs(amounts).max() > _TOLERANCE
                ]
            )
    return free


def _free(model: Model, b: int) -> Index:
    """Return the number of the unknown of each degree of freedom of a rod, negative if supported."""
    return model.free[3 * model.first_node[b] : 3 * model.first_node[b + 1]]


def _apart(model: Model, tie: Tie, parts: Sequence[Group], moving: Sequence[Motions]) -> Array:
    """Return the relative normal displacement of a sliding tie's surfaces in motions of parts."""
    from isorod.assembly.constraints import trace_of

    trace = trace_of(model, tie.slave)
    along = [np.einsum("qa,qak->qk", trace.normals, motions.at(trace.points)) for motions in moving]
    signs = [float(part.has(tie.slave)) - float(part.has(tie.master)) for part in parts]
    return np.concatenate([sign * motions for sign, motions in zip(signs, along, strict=True)], axis=1)


def _spread(model: Model, body: int, motion: Array) -> tuple[Array, list[Array]]:
    """Return the rigid motion of a group, given that of the nodes ``(nodes, 3)`` of one of its rods.

    Returns
    -------
    rods : (dofs,)
    solids
        For each solid its degrees of freedom on this rank.
    """
    if any(slides(tie) for tie in model.ties):
        raise InputError("modes: what slides freely has rigid motions; give the tie a bond, or support the body")
    group = next(group for group in groups(model) if body in group.bodies)
    space = model.bodies[body].space
    amounts = np.linalg.lstsq(motions_of(space.positions, space.is_control_point), motion.ravel(), rcond=None)[0]
    rods = np.zeros(model.dofs)
    for b in group.bodies:
        space = model.bodies[b].space
        model.nodal(rods, b)[:] = (motions_of(space.positions, space.is_control_point) @ amounts).reshape(-1, 3)
    solids = []
    for k, solid in enumerate(model.solids):
        moved = motions_of(solid.positions, np.ones(len(solid.positions), dtype=bool)) @ amounts
        solids.append(moved if k in group.solids else 0.0 * moved)
    return rods, solids


def on_unknowns(assembler: Assembler, moved: Iterable[tuple[int, Array]]) -> Iterator[PETSc.Vec]:
    """Yield motions (body, and displacements of its nodes ``(nodes, 3)``) as vectors of unknowns."""
    for body, motion in moved:
        if assembler.coupling is not None:
            rods, solids = _spread(assembler.model, body, motion)
            yield assembler.state(rods, (), solids)
            continue
        everywhere = np.zeros(assembler.model.dofs)
        assembler.model.nodal(everywhere, body)[:] = motion
        yield assembler.state(everywhere)


def near_null_space(assembler: Assembler) -> PETSc.NullSpace:
    """Return the rigid motions of all bodies on the unknowns, for algebraic multigrid."""
    model = assembler.model
    alone = [group.bodies[0] for group in groups(model) if group.bodies]
    moved = ((b, motion.reshape(-1, 3)) for b in alone for motion in motions(model.bodies[b].space).T)
    vectors = orthonormalise(on_unknowns(assembler, moved))
    assembler.note("near-null space")
    return PETSc.NullSpace().create(vectors=vectors, comm=assembler.comm)


def refuse_free(model: Model) -> None:
    """Raise `SolveError` with the first free rigid motion, if there is one."""
    _refuse(model, free_motions(model))


def left_to_contact(model: Model) -> list[tuple[int, Array]]:
    """Return the free motions (`free_motions`), all of bodies that may touch others or obstacles.

    Raises
    ------
    SolveError
        If another body has a free motion.
    """
    loose, touching = free_motions(model), set[int]()
    for contact in model.contacts:
        sides = {body for body, _ in contact.sides}
        # Self-contact holds no body.
        touching |= sides if contact.second is not None or len(sides) > 1 else set()
    # Contact holds tied bodies too.
    touching = {b for group in groups(model) if touching.intersection(group.bodies) for b in group.bodies}
    _refuse(model, [(body, motion) for body, motion in loose if body not in touching])
    return loose


def _refuse(model: Model, loose: list[tuple[int, Array]]) -> None:
    if loose:
        body, motion = loose[0]
        how = describe(model.bodies[body].space, motion)
        raise SolveError(
            f"supports: body {body} is free to {how} (rigid-body mode); add a support, or a contact in statics"
        )


def describe(space: Space, motion: Array) -> str:
    """Return a text for a motion of nodes ``(nodes, 3)``: the direction of its translation, or axis of its rotation."""
    arm = _arms(space)
    shift = motion[space.is_control_point].mean(axis=0)
    turn, *_ = np.linalg.lstsq(
        np.concatenate([np.cross(np.eye(3)[a], arm).reshape(-1, 1) for a in range(3)], axis=1),
        (motion - shift * space.is_control_point[:, None]).ravel(),
        rcond=None,
    )
    size = np.abs(arm).max()
    turns = np.linalg.norm(turn) * size > 1e-6 * np.abs(motion).max()
    axis = turn if turns else shift
    axis = axis / np.linalg.norm(axis)
    words = ", ".join(f"{value + 0.0:.3g}" for value in np.where(np.abs(axis) < 1e-9, 0.0, axis))
    return f"turn about ({words})" if turns else f"move along ({words})"


def refuse_thin(model: Model, loose: Sequence[tuple[int, Array]]) -> None:
    """Raise `InputError` for an unsupported body so thin that round-off of stretching exceeds its bending stiffness.

    Eigensolvers would not converge to its bending modes.
    """
    bodies = [body for body, _ in loose]
    for b in {body for body in bodies if bodies.count(body) == 6}:
        places = model.bodies[b].space.rod.control_points
        thin = float(np.ptp(places, axis=1).max() / np.ptp(places, axis=(0, 1)).max())
        if thin < _THIN:
            raise InputError(
                f"modes: body {b} is unsupported and its section {thin:.1g} of its length, below {_THIN:g}: its "
                "bending stiffness is lost in round-off; support it, or use a thicker section"
            )
