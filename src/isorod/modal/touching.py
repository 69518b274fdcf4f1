"""Contact in small vibrations about an equilibrium: the active set is kept.

Surfaces keep the mean gaps of their cells and slide along each other, with the terms of their curvature
(`isorod.contact.frozen`); points that stick do not slide.  Penalties act as springs only within cells, where surfaces
cannot follow: as springs of all points they would be far too soft (for a cylinder on a plane, half of the patch's own
compliance more), and much stiffer ones would constrain surfaces beyond the patch.
"""

import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc
from scipy.linalg import eigh

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.formulation import assembler_for
from isorod.checks import correction, rigid_motions
from isorod.contact.frozen import Frozen
from isorod.errors import InputError
from isorod.modal.pencil import Eigenpairs
from isorod.model.model import Model
from isorod.statics.analysis import Equilibrium

if TYPE_CHECKING:
    from isorod.contact.result import ContactResult

# Root mean square change of gaps relative to that of a rigid motion: below the first it slides, above the second it is
# constrained; between them it is constrained by the width of patches, as in rolling or tipping.
_SLIDES, _HELD = 1e-6, 0.25

# Uncertainty above which there is a warning.
_UNSURE = 0.005

# Changes up to which reactions alone suffice; iterations to the frequencies of softer contact.
_SURE, _ITERATIONS = 0.01, 3

# Stiffness against a rigid motion, relative to the sum of its parts, that is rounding.
_NONE = 1e-9


def hold(assembler: Assembler, state: Equilibrium) -> list[tuple[int, Array]]:
    """Freeze the contact of an equilibrium; return unconstrained rigid motions: body, and displacement of its nodes.

    Raises
    ------
    InputError
        If points slip, or a body is constrained by the width of patches alone.
    """
    model = assembler.model
    for k, result in enumerate(state.contacts):
        if result.slipping:
            raise InputError(
                f"contact {k}: {result.slipping} of {result.active} points slip; modes are of points that stick or "
                "slide without friction: raise the friction, or leave it out"
            )
    x = assembler.state(state.displacement, state.pressures, state.solids)
    contact = Frozen(model, model.contacts, state.contacts, assembler.touching(x, 1.0), assembler.comm, tight=True)
    assembler.contact = contact  # type: ignore[assignment]
    slides = _sliding(model, state.displacement, contact, state.contacts)
    if not slides:
        return []
    matrix = assembler.matrix()
    assembler.tangent(x, 1.0, matrix)
    vectors = list(rigid_motions.on_unknowns(assembler, slides))
    sizes = matrix.getDiagonal()
    free = []
    for slide, vector in zip(slides, vectors, strict=True):
        weight = sizes.duplicate()
        weight.pointwiseMult(vector, vector)
        if abs((matrix * vector).dot(vector)) <= _NONE * abs(sizes.dot(weight)):
            free.append(slide)
    matrix.destroy()
    return free


def hold_beside(assembler: Assembler, x: PETSc.Vec, pressures: float | Array) -> Array:
    """Freeze the contact of a state near an equilibrium; return which points ``(Q,)`` are active.

    Contact starts from the equilibrium's (`isorod.statics.derivatives.Moving.perturbed`), with multipliers changed by
    ``pressures``.
    """
    contact, moved = assembler.contact, assembler.touching(x, 1.0)
    assert contact is not None
    contact.packed.multipliers[:] += pressures
    results, model = contact.results(moved), assembler.model
    assembler.contact = Frozen(model, model.contacts, results, moved, assembler.comm, tight=True)  # type: ignore[assignment]
    return np.concatenate([one.pressure > 0.0 for one in results])


def doubt(
    model: Model,
    state: Equilibrium,
    eigenvalues: Array,
    vectors: Array,
    free: bool = False,
    lumped: bool = False,
    whirls: bool = False,
) -> float:
    """Return the largest relative uncertainty of frequencies by the unknown compliance of contact patches.

    The bounds are springs at all points, which are too soft, and points that are all constrained.  The frequencies with
    springs follow by inverse iteration from these modes.  If they change little, reactions of cells, squared over
    their springs, suffice: those of adjacent cells may be large and cancel.

    Parameters
    ----------
    eigenvalues, vectors
        ``omega^2`` ``(m,)`` and shapes ``(m, dofs)`` of flexible modes.
    free, lumped
        Whether there are rigid modes, and whether the mass matrix is lumped.
    whirls
        Whether there are Coriolis forces: then the estimate is by springs in series with the body.
    """
    contact = Frozen(model, model.contacts, state.contacts, state.displacement, PETSc.COMM_SELF, tight=True)

    def softer() -> Array:
        assembler = assembler_for(model, PETSc.COMM_SELF)
        return _softer(assembler, state, eigenvalues, [assembler.state(one) for one in vectors], free, lumped)

    return _doubt(contact, eigenvalues, vectors, None if whirls else softer)


def doubt_with_solids(assembler: Assembler, state: Equilibrium, pairs: Eigenpairs, rigid: int, lumped: bool) -> float:
    """Return `doubt` of a model with solids, and warn of it: there is no other estimate for these.

    `hold` has prepared the assembler, whose contact then becomes springs at all points; ``rigid`` modes come first.
    """
    eigenvalues, vectors, contact = pairs.eigenvalues[rigid:], pairs.vectors[rigid:], assembler.contact
    assert isinstance(contact, Frozen)
    # Without prescribed displacements, which are no part of a mode.
    still = assembler.touching(assembler.vector(), 0.0)
    moved = np.array([assembler.touching(one, 0.0) - still for one in vectors])
    copies = [one.copy() for one in vectors]
    error = _doubt(
        contact, eigenvalues, moved, lambda: _softer(assembler, state, eigenvalues, copies, rigid > 0, lumped)
    )
    if error > _UNSURE:
        warnings.warn(
            f"compliance of contact patches may change frequencies by up to {100.0 * error:.2g} %: use smaller facets "
            "and shorter elements there, or a higher penalty",
            stacklevel=4,
        )
    return error


def _doubt(contact: Frozen, eigenvalues: Array, moved: Array, springs: Callable[[], Array] | None) -> float:
    """Return `doubt` of modes with displacements ``moved`` ``(m, dofs)`` as contact takes them.

    ``springs``, if any, returns the relative decrease of frequencies with springs at all points.
    """
    within, besides = (one / np.abs(eigenvalues) for one in contact.compliance(moved))
    softer = 1.0 - 1.0 / np.sqrt(1.0 + besides)
    # Small changes need no further factorisation.
    if springs is not None and softer.max(initial=0.0) > _SURE:
        softer = springs()
    return float(np.max(0.5 * within + softer, initial=0.0))


def _softer(
    assembler: Assembler, state: Equilibrium, eigenvalues: Array, shapes: list[PETSc.Vec], free: bool, lumped: bool
) -> Array:
    """Return the relative decrease ``(m,)`` of frequencies by springs at all points; overwrites the shapes."""
    model, x = assembler.model, assembler.state(state.displacement, state.pressures, state.solids)
    contact = Frozen(model, model.contacts, state.contacts, assembler.touching(x, 1.0), assembler.comm)
    assembler.contact = contact  # type: ignore[assignment]
    matrix, mass = assembler.matrix(), assembler.mass(lumped) if free else assembler.mass_operator(lumped)
    assembler.tangent(x, 1.0, matrix)
    shift = float(np.abs(eigenvalues[0])) if free else 0.0
    if free:
        matrix.axpy(shift, mass, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
    ksp = correction.solver(assembler, matrix)
    try:
        for _ in range(_ITERATIONS):
            pushed = [mass * shape for shape in shapes]
            for force, shape in zip(pushed, shapes, strict=True):
                ksp.solve(force, shape)
        values = eigh(correction.reduced(mass, pushed, shapes)[0], eigvals_only=True) - shift
    finally:
        for handle in (ksp, matrix, mass):
            handle.destroy()
    ratio = np.sort(values) / np.sort(eigenvalues)
    return np.asarray(1.0 - np.sqrt(np.clip(ratio, 0.0, 1.0)))


def _sliding(
    model: Model, displacement: Array, contact: Frozen, results: "Sequence[ContactResult]"
) -> list[tuple[int, Array]]:
    """Return rigid motions free of supports and contact; raises `InputError` for one that only patches constrain."""
    free = rigid_motions.free_motions(model, displacement)
    weights = np.sqrt(contact.springs / max(float(contact.springs.sum()), 1e-300))
    normals = np.concatenate([np.zeros((0, 3)), *(one.normals[one.pressure > 0.0] for one in results)])
    sliding, everywhere = [], []
    for b in sorted({b for b, _ in free}):
        moved = np.stack([motion.ravel() for body, motion in free if body == b], axis=1)
        moved = np.linalg.qr(moved)[0] * np.sqrt(model.bodies[b].space.is_control_point.sum())
        displacements = np.zeros((contact.gaps.shape[1], moved.shape[1]))
        for column, shape in zip(displacements.T, moved.T, strict=True):
            model.nodal(column[: model.dofs], b)[:] = shape.reshape(-1, 3)
        rows = weights[:, None] * (contact.gaps @ displacements)
        everywhere.append(rows)
        _, sizes, turns = np.linalg.svd(np.concatenate([rows, np.zeros((moved.shape[1], moved.shape[1]))]))
        for size, turn in zip(sizes, turns, strict=True):
            motion = (moved @ turn).reshape(-1, 3)
            if size < _HELD and (size > _SLIDES or _tilts(model, displacement, b, motion, normals) > _SLIDES):
                how = rigid_motions.describe(model.bodies[b].space, motion)
                raise InputError(
                    f"equilibrium: body {b} is free to {how} but for the width of contact patches (rolling, tipping): "
                    "such modes are not computed; add a support"
                )
            if size <= _SLIDES:
                sliding.append((b, motion))
    together = np.concatenate(everywhere, axis=1) if everywhere else np.zeros((1, 0))
    least = np.linalg.svd(together.T @ together, compute_uv=False) if together.size else np.empty(0)
    if int((least <= _SLIDES**2).sum()) > len(sliding):
        raise InputError(
            "equilibrium: bodies have a common rigid-body mode, constrained by no support or contact; support one"
        )
    return sliding


def _tilts(model: Model, displacement: Array, body: int, motion: Array, normals: Array) -> float:
    """Return how much a rigid motion of a body's nodes ``(nodes, 3)`` tilts contact normals, in sizes of the body."""
    space = model.bodies[body].space
    places = (space.positions + model.nodal(displacement, body))[space.is_control_point]
    arms = places - places.mean(axis=0)
    rows = np.concatenate([np.cross(axis, arms).reshape(-1, 1) for axis in np.eye(3)], axis=1)
    moved = motion[space.is_control_point]
    turn = np.linalg.lstsq(rows, (moved - moved.mean(axis=0)).ravel(), rcond=None)[0]
    return float(np.abs(np.cross(turn, normals)).max(initial=0.0) * np.abs(arms).max())
