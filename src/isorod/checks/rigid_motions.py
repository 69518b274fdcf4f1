"""Rigid motions of a model: which the supports leave free, and the near-null space they make."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly.assembler import Assembler
from isorod.errors import InputError, SolveError
from isorod.model.model import Model
from isorod.petsc.matrix import orthonormalise
from isorod.space.space import Space
from isorod.tensors import motions_of

# A motion counts as free if it moves held components by less than this share of its size.
_TOLERANCE = 1e-8

# A face of this share of the rod's size holds all of its motions, without a closer look.
_FACE = 1e-4

# Width of a section over the size of its rod below which a free one has no bending modes in double precision: a hundred
# times thicker ones have none any more either.
_THIN = 1e-7


def motions(space: Space, moved: Array | float = 0.0) -> Array:
    """Return the six infinitesimal rigid motions of a space's nodes, orthonormal, shape ``(3 nodes, 6)``.

    A rod reproduces them exactly, since its functions reproduce its own map.  They are those of the rod where it has
    ``moved`` to, by ``(nodes, 3)``.
    """
    return np.linalg.qr(motions_of(_arms(space, moved), space.is_carrier))[0]


def _arms(space: Space, moved: Array | float = 0.0) -> Array:
    """Return the coefficients of the position from a point near the middle."""
    places = space.positions + moved
    return np.asarray(places - places[space.is_carrier].mean(axis=0) * space.is_carrier[:, None])


def _clamped(space: Space, free: Index) -> bool:
    """Return whether supports (``free`` as in the model, of this space) hold all of an end face that is not small."""
    if space.rod.closed:
        return False
    points = space.rod.control_points
    held = free.reshape(space.layers, -1)[[0, -1]] < 0
    for face in np.flatnonzero(held.all(axis=1)):
        arms = points[-face] - points[-face].mean(axis=0)
        spread = arms.T @ arms
        # Of the eigenvalues a >= b >= c of that, (ab + bc + ca) / (a + b + c) is 2 b at most.
        trace = spread.trace()
        second = (trace**2 - (spread * spread).sum()) / (4.0 * trace) if trace > 0.0 else 0.0
        if second > (_FACE * np.abs(points - points[0, 0]).max()) ** 2:
            return True
    return False


def free_motions(model: Model, displacement: Array | None = None) -> list[tuple[int, Array]]:
    """Return the rigid motions that the supports leave free: body, and displacements of its nodes ``(nodes, 3)``.

    They are those about a ``displacement`` ``(dofs,)``, or at rest.  What ties weld together moves as one; its motions
    are told by those of its first rod.
    """
    found: list[tuple[int, Array]] = []
    if model.ties or model.solids:
        from isorod.checks import tied_motions

        return tied_motions.free_motions(model, displacement)
    for b, body in enumerate(model.bodies):
        free = model.free[3 * model.first_node[b] : 3 * model.first_node[b + 1]]
        if _clamped(body.space, free):
            continue
        basis = motions(body.space, 0.0 if displacement is None else model.nodal(displacement, b))
        held = free < 0
        kept = basis[held]
        if model.bound.size > model.held.size:
            # What tied components move apart.
            _, first, unknown = np.unique(free, return_index=True, return_inverse=True)
            apart = (basis - basis[first[unknown]])[~held & (first[unknown] != np.arange(free.size))]
            kept = np.concatenate([kept, apart])
        # The triangular factor has the same singular values and at most six rows.
        rows = np.linalg.qr(kept, mode="r") if kept.size else np.zeros((1, 6))
        _, sizes, turns = np.linalg.svd(rows, full_matrices=True)
        full = np.zeros(6)
        full[: sizes.size] = sizes
        for k in np.flatnonzero(full < _TOLERANCE):
            found.append((b, (basis @ turns[k]).reshape(-1, 3)))
    return found


def on_unknowns(assembler: Assembler, moved: Iterable[tuple[int, Array]]) -> Iterator[PETSc.Vec]:
    """Yield motions of bodies (body, and displacements of its nodes ``(nodes, 3)``) as vectors of unknowns."""
    for body, motion in moved:
        if assembler.coupling is not None:
            from isorod.checks import tied_motions

            rods, solids = tied_motions.spread(assembler.model, body, motion)
            yield assembler.state(rods, (), solids)
            continue
        everywhere = np.zeros(assembler.model.dofs)
        assembler.model.nodal(everywhere, body)[:] = motion
        yield assembler.state(everywhere)


def near_null_space(assembler: Assembler) -> PETSc.NullSpace:
    """Return the rigid motions of all bodies on the unknowns, for algebraic multigrid."""
    model = assembler.model
    alone = list(range(len(model.bodies)))
    if assembler.coupling is not None:
        from isorod.checks.tied_motions import groups

        alone = [group.bodies[0] for group in groups(model)]
    moved = ((b, motion.reshape(-1, 3)) for b in alone for motion in motions(model.bodies[b].space).T)
    vectors = orthonormalise(on_unknowns(assembler, moved))
    assembler.note("near-null space")
    return PETSc.NullSpace().create(vectors=vectors, comm=assembler.comm)


def refuse_free(model: Model) -> None:
    """Raise `SolveError` if a rigid motion is free, and name it."""
    _refuse(model, free_motions(model))


def left_to_contact(model: Model) -> list[tuple[int, Array]]:
    """Return the free motions (as `free_motions` does) of bodies that may touch others or obstacles.

    Raises
    ------
    SolveError
        If one of another body is free.
    """
    loose, touching = free_motions(model), set[int]()
    for contact in model.contacts:
        named = {body for body, _ in contact.sides}
        # Contact with itself alone holds no body.
        touching |= named if contact.second is not None or len(named) > 1 else set()
    if model.ties:
        from isorod.checks.tied_motions import groups

        # What is tied to a body that may touch is held with it.
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
    """Return a motion of a space's nodes ``(nodes, 3)`` in words: where it goes, or about which direction it turns."""
    arm = _arms(space)
    shift = motion[space.is_carrier].mean(axis=0)
    turn, *_ = np.linalg.lstsq(
        np.concatenate([np.cross(np.eye(3)[a], arm).reshape(-1, 1) for a in range(3)], axis=1),
        (motion - shift * space.is_carrier[:, None]).ravel(),
        rcond=None,
    )
    size = np.abs(arm).max()
    turns = np.linalg.norm(turn) * size > 1e-6 * np.abs(motion).max()
    axis = turn if turns else shift
    axis = axis / np.linalg.norm(axis)
    words = ", ".join(f"{value + 0.0:.3g}" for value in np.where(np.abs(axis) < 1e-9, 0.0, axis))
    return f"turn about ({words})" if turns else f"move along ({words})"


def refuse_thin(model: Model, loose: Sequence[tuple[int, Array]]) -> None:
    """Raise `InputError` for a body that nothing holds, so thin that rounding of stretching is all of its bending.

    Eigensolvers would look for its first bending mode for ever.
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
