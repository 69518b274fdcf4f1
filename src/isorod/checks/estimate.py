"""An estimate of a result's error: what one tangent on finer spaces, at the result, changes.

There are two of these (`isorod.checks.finer`): one is finer across the section, one along the axis, and what they
change, and what is left on them by the rule for singular solutions, adds up.  In statics the tangent at the result
takes its residual there to corrections, as hierarchical error estimates do (Bank & Weiser, Math. Comp. 44 (1985)
283-301, with the whole space in the place of bubbles); modes take a step of inverse iteration and a Rayleigh-Ritz
projection.  What a finer space sees it says: nothing of the geometry, and nothing across sections of degree 8.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc
from scipy.linalg import eigh

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation
from isorod.assembly.formulation import assembler_for
from isorod.checks.finer import DIRECTIONS, Finer
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.options import defaults

if TYPE_CHECKING:
    from isorod.contact.frozen import Frozen
    from isorod.contact.result import ContactResult

# Steps of Newton's method; with one tangent as long as each is this much smaller than the one before, and enough.
_STEPS, _QUICK, _DONE = 4, 0.1, 1e-3

# A sum that is a smaller share of its terms is rounding.
_CANCELS = 1e-9

# Work of supports that is not so many times what rounding makes of it is none.
_ROUNDS = 100.0

_PREFIX = "estimate_"


def of_equilibrium(
    model: Model,
    displacement: Array,
    work: float,
    pressures: Sequence[Array | None] = (),
    directions: Sequence[str] = DIRECTIONS,
    ranks: int = 1,
    contacts: "Sequence[ContactResult]" = (),
) -> float | None:
    """Return the relative change of the work that supports, loads or obstacles do, the largest; None if there is none.

    Where none of them do any, that of the displacements' size.  Contact is as it was, on finer spaces linear about that
    (`isorod.contact.frozen`): with friction there is none.

    Parameters
    ----------
    model
        What was solved.
    displacement
        All degrees of freedom, shape ``(dofs,)``.
    work
        Of the supports' forces on the displacements they prescribe.
    pressures
        Coefficients of mixed bodies.
    directions
        Which of `isorod.checks.finer.DIRECTIONS` count.
    ranks
        Number of those that solved it: this one alone, or all, which then call this together.
    contacts
        Their outcome.
    """
    if any(one.friction for one in model.contacts):
        return None
    return _total(
        model, directions, ranks, lambda finer, comm: _equilibrium(finer, comm, displacement, work, pressures, contacts)
    )


def _total(
    model: Model, directions: Sequence[str], ranks: int, change: Callable[[Finer, PETSc.Comm], float | None]
) -> float | None:
    """Return the sum of what finer spaces change, or None; of a communicator that is neither one rank nor all too."""
    total, comm = 0.0, PETSc.COMM_SELF if ranks == 1 else PETSc.COMM_WORLD
    if ranks != comm.getSize():
        return None
    for direction in directions:
        try:
            finer = Finer.of(model, direction)
        except InputError:
            # No finer one can be had: too many elements, or points, or what they take.
            return None
        found = None if finer is None or not model.unknowns else change(finer, comm)
        if finer is None or found is None:
            return None
        total += found / (1.0 - finer.left)
    return total


def _equilibrium(
    finer: Finer,
    comm: PETSc.Comm,
    displacement: Array,
    work: float,
    pressures: Sequence[Array | None],
    contacts: "Sequence[ContactResult]",
) -> float | None:
    """Return the change on finer spaces."""
    state = finer.displacement(displacement)
    assembler = assembler_for(finer.model, comm)
    touching = _touching(finer, contacts, state, comm)
    assembler.contact = touching  # type: ignore[assignment]
    x = assembler.state(state, finer.pressures(pressures) if pressures else ())
    matrix, force, change = assembler.matrix(), assembler.vector(), assembler.vector()
    ksp = _solver(assembler, matrix)
    try:
        size = gained = 0.0
        for _ in range(_STEPS):
            assembler.residual(x, 1.0, force)
            last, size = size, np.inf
            if last:
                ksp.solve(force, change)
                size = change.norm()
            # One tangent does, unless what slender rods turn by a straight step stretches them.
            if not size < _QUICK * last:
                assembler.tangent(x, 1.0, matrix)
                ksp.setOperators(matrix)
                ksp.solve(force, change)
                size = change.norm()
            x.axpy(-1.0, change)
            if not last:
                gained, first = abs(force.dot(change)), assembler.displacement(x, 1.0)
            if not size > _DONE * max(last, size):
                break
        found = assembler.displacement(x, 1.0)
        given = finer.model.prescribed(1.0)[finer.model.bound]
        carried = assembler.reactions(x, 1.0) if given.any() else given
        noise = assembler.reaction_noise(x, 1.0) if given.any() else given
    finally:
        ksp.destroy()
        matrix.destroy()
    if not np.isfinite(size):
        # Too far for straight steps: the first alone, of moved supports its energy; without one nothing is right.
        found, given, noise = first, given * 0.0, given * 0.0
        if not np.isfinite(found).all():
            return 1.0
        if not finer.model.external.any() and work:
            return gained / (abs(work) + gained)
    # What moved supports do and what loads do, or where neither do, how far it goes.
    loads = finer.model.external
    changes = [_change(carried * given, work, _ROUNDS * float(noise @ np.abs(given)))]
    changes.append(_change(loads * found, float(loads @ state), 0.0, float(loads @ _carried_along(finer.model, given))))
    if touching is not None:
        changes.append(_change(touching.work(found), float(touching.work(state).sum())))
    known = [one for one in changes if one is not None]
    if not known:
        known = [one for one in [_change(state * found, float(state @ state))] if one is not None]
    error = max(known, default=np.nan)
    return float(error) if np.isfinite(error) else None


def _touching(finer: Finer, contacts: "Sequence[ContactResult]", state: Array, comm: PETSc.Comm) -> "Frozen | None":
    """Return contact as it is on finer spaces, if there is any."""
    if not contacts:
        return None
    from isorod.contact.frozen import Frozen

    return Frozen(finer.model, finer.coarse.contacts, contacts, state, comm)


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
    carriers = model.is_carrier[model.bound // 3]
    for a in range(3):
        own = given[carriers & (model.bound % 3 == a)]
        moved[model.is_carrier, a] = own.mean() if own.size else 0.0
    return moved.ravel()


def of_modes(
    model: Model,
    eigenvalues: Array,
    vectors: Array,
    free: bool = False,
    lumped: bool = False,
    directions: Sequence[str] = DIRECTIONS,
    ranks: int = 1,
) -> float | None:
    """Return the largest relative change of the frequencies of flexible modes at rest; None where there is none.

    Parameters
    ----------
    eigenvalues, vectors
        ``omega^2`` ``(m,)`` and shapes ``(m, dofs)`` of the modes above the rigid ones.
    free
        Whether there are rigid ones.
    lumped
        Whether with the lumped mass matrix.
    directions, ranks
        As for `of_equilibrium`.
    """
    if not eigenvalues.size:
        return None
    return _total(model, directions, ranks, lambda finer, comm: _modes(finer, comm, eigenvalues, vectors, free, lumped))


def _modes(
    finer: Finer, comm: PETSc.Comm, eigenvalues: Array, vectors: Array, free: bool, lumped: bool
) -> float | None:
    """Return the change on finer spaces."""
    assembler = assembler_for(finer.model, comm)
    matrix, mass = assembler.matrix(), assembler.mass(lumped) if free else assembler.mass_operator(lumped)
    assembler.tangent(assembler.vector(), 0.0, matrix)
    # Definite, of a free body too, but for pressures.
    shift = float(eigenvalues[0]) if free else 0.0
    shapes = [finer.displacement(vector) for vector in vectors]
    if free:
        matrix.axpy(shift, mass, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
    elif finer.wider:
        shapes += _turns(finer.model)
    ksp = _solver(assembler, matrix)
    try:
        pushed, found, heavy = ([assembler.vector() for _ in shapes] for _ in range(3))
        for shape, force, better, image in zip(shapes, pushed, found, heavy, strict=True):
            mass.mult(assembler.state(shape), force)
            ksp.solve(force, better)
            mass.mult(better, image)
        # The shifted stiffness times a shape is the force.
        above, below = (np.array([[a.dot(b) for b in found] for a in images]) for images in (pushed, heavy))
        scale = 1.0 / np.sqrt(np.diag(below))
        above, below = (0.5 * (one + one.T) * scale * scale[:, None] for one in (above, below))
        # Of many modes on few unknowns the shapes may depend on each other, but for rounding.
        sizes, basis = eigh(below)
        kept = sizes > sizes.size * np.finfo(float).eps * sizes[-1]
        basis = basis[:, kept] / np.sqrt(sizes[kept])
        if basis.shape[1] < eigenvalues.size:
            return None
        values = eigh(basis.T @ above @ basis, eigvals_only=True)[: eigenvalues.size] - shift
    finally:
        for one in (ksp, matrix, mass):
            one.destroy()
    error = float(np.abs(np.sqrt(np.abs(eigenvalues / values)) - 1.0).max())
    return error if np.isfinite(error) else None


def _turns(model: Model) -> list[Array]:
    """Return motions of all degrees of freedom that turn the sections the more the farther along they are.

    They find modes of torsion that are lower on the finer space than those which come first on the model's.
    """
    found = []
    for turn in np.eye(3):
        moved = []
        for body in model.bodies:
            space = body.space
            carriers = space.is_carrier[:, None]
            arms = space.positions - carriers * space.positions[carriers[:, 0]].mean(axis=0)
            way = np.repeat(np.arange(space.layers) / space.layers, space.layer_nodes)
            moved.append((way[:, None] * np.cross(turn, arms)).ravel())
        found.append(np.concatenate(moved))
    return found


def _solver(assembler: Assembler, matrix: PETSc.Mat) -> PETSc.KSP:
    """Return a direct solver, of which `-estimate_...` options say more."""
    ksp = PETSc.KSP().create(assembler.comm)
    ksp.setOptionsPrefix(_PREFIX)
    ksp.setOperators(matrix)
    with defaults({f"{_PREFIX}ksp_type": "preonly"} | factorisation(assembler, _PREFIX)):
        ksp.setFromOptions()
    return ksp
