"""An estimate of a result's error: what one tangent on finer spaces, at the result, changes.

There are two of these (`isorod.checks.finer`): one is finer across the section, one along the axis, and what they
change, and what is left on them by the rule for singular solutions, adds up.  In statics the tangent at the result
takes its residual there to corrections, as hierarchical error estimates do (Bank & Weiser, Math. Comp. 44 (1985)
283-301, with the whole space in the place of bubbles); modes take a step of inverse iteration and a Rayleigh-Ritz
projection.  What a finer space sees it says: nothing of the geometry, and nothing across sections of degree 8.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from petsc4py import PETSc
from scipy.linalg import eigh, eigvals

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.coriolis import coriolis
from isorod.assembly.factorisation import factorisation
from isorod.assembly.formulation import assembler_for
from isorod.checks import stresses
from isorod.checks.finer import DIRECTIONS, Finer
from isorod.checks.reactions import support_forces, support_moments
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.options import defaults
from isorod.output import held
from isorod.output.state import State

if TYPE_CHECKING:
    from isorod.contact.frozen import Frozen
    from isorod.contact.result import ContactResult

# Steps of Newton's method at most, with one tangent as long as each is this much smaller than the one before; steps of
# this share of the longest are enough.
_STEPS, _QUICK, _DONE = 8, 0.1, 1e-3

# Changes of a smaller share of a state are rounding.
_SETTLED = 1e-8

# A sum that is a smaller share of its terms is rounding.
_CANCELS = 1e-9

# Forces that are a smaller share of loads, or of moments over the width, are none.
_LITTLE = 1e-3

# Work of supports that is not so many times what rounding makes of it is none.
_ROUNDS = 100.0

_PREFIX = "estimate_"


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


def of_equilibrium(
    model: Model,
    displacement: Array,
    work: float,
    pressures: Sequence[Array | None] = (),
    directions: Sequence[str] = DIRECTIONS,
    ranks: int = 1,
    contacts: "Sequence[ContactResult]" = (),
    carried: tuple[Array, Array] | None = None,
) -> Error:
    """Return estimates of the errors of an equilibrium.

    Contact is as it was, on finer spaces linear about that (`isorod.contact.frozen`): what sticks and slips goes on to.

    Parameters
    ----------
    model
        What was solved.
    displacement
        All degrees of freedom, shape ``(dofs,)``.
    work
        Of the supports' forces on the displacements, and of their moments on the turns, that they prescribe.
    pressures
        Coefficients of mixed bodies.
    directions
        Which of `isorod.checks.finer.DIRECTIONS` count.
    ranks
        Number of those that solved it: this one alone, or all, which then call this together.
    contacts
        Their outcome.
    carried
        Force and moment of each support, shape ``(supports, 3)`` each; None if they do not count.
    """

    def change(finer: Finer, comm: PETSc.Comm) -> Array:
        return _equilibrium(finer, comm, displacement, work, pressures, contacts, carried)

    return Error(*_total(model, directions, ranks, change, 2))


def _total(
    model: Model, directions: Sequence[str], ranks: int, change: Callable[[Finer, PETSc.Comm], Array], count: int
) -> list[float | None]:
    """Return sums ``(count,)`` of what finer spaces change; None where there is none, as on some ranks of many."""
    total, comm = np.zeros(count), PETSc.COMM_SELF if ranks == 1 else PETSc.COMM_WORLD
    none: list[float | None] = [None] * count
    if ranks != comm.getSize():
        return none
    for direction in directions:
        try:
            finer = Finer.of(model, direction)
        except InputError:
            # No finer one can be had: too many elements, or points, or what they take.
            return none
        if finer is None or not model.unknowns:
            return none
        total += change(finer, comm)
    return [float(one) if np.isfinite(one) else None for one in total]


def _equilibrium(
    finer: Finer,
    comm: PETSc.Comm,
    displacement: Array,
    work: float,
    pressures: Sequence[Array | None],
    contacts: "Sequence[ContactResult]",
    supported: tuple[Array, Array] | None,
) -> Array:
    """Return the errors of work and stress that a finer space sees, NaN where there is none."""
    state = finer.displacement(displacement)
    assembler = assembler_for(finer.model, comm)
    touching = _touching(finer, contacts, state, comm)
    assembler.contact = touching  # type: ignore[assignment]
    x = assembler.state(state, finer.pressures(pressures) if pressures else ())
    matrix = assembler.matrix()
    ksp = _solver(assembler, matrix)
    try:
        sizes, gained, first = _corrected(assembler, x, matrix, ksp)
        found, corrected = assembler.displacement(x, 1.0), assembler.pressures(x)
        given = finer.model.driven[finer.model.bound]
        carried = assembler.reactions(x, 1.0)
        noise = assembler.reaction_noise(x, 1.0)
    finally:
        ksp.destroy()
        matrix.destroy()
    if not np.isfinite(sizes[-1]):
        # Too far for straight steps: the first alone, of moved supports its energy; without one nothing is right.
        found, given, noise = first, given * 0.0, given * 0.0
        if not np.isfinite(found).all():
            return np.ones(2)
        if not finer.model.external.any() and work:
            return np.array([gained / (abs(work) + gained), np.nan])
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
        known.append(_supported(finer.model, supported, found, carried, _ROUNDS * float(np.abs(noise).sum())))
    error = max(known, default=np.nan) / (1.0 - finer.left)
    # Stresses away from edges converge faster than works, of which edges have a part.
    return np.array([error, stresses.change(finer, displacement, found, pressures, corrected)])


def _supported(
    model: Model, before: tuple[Array, Array], displacement: Array, carried: Array, rounding: float
) -> float:
    """Return the change of the supports' forces and moments, relative to the largest of each.

    Forces that are next to nothing beside loads or moments do not count, nor moments that are beside forces.

    Parameters
    ----------
    before
        Force and moment of each support, as they were.
    displacement, carried
        All degrees of freedom, and forces on those that are `Model.bound`, as they are on a finer space.
    rounding
        Changes of force of less are none.
    """
    after = support_forces(model, carried), support_moments(model, displacement, carried)
    force, moment = (float(np.linalg.norm(one, axis=1).max()) for one in after)
    width = max(held.width(model, b) for b in range(len(model.bodies)))
    force = max(force, rounding, _LITTLE * max(float(np.abs(model.external).sum()), moment / width))
    changes = (float(np.linalg.norm(new - old, axis=1).max()) for new, old in zip(after, before, strict=True))
    sizes = (force, rounding), (max(moment, force * width), rounding * width)
    counted = [change / size for change, (size, none) in zip(changes, sizes, strict=True) if change > none]
    return max(counted, default=0.0)


def _corrected(
    assembler: Assembler, x: PETSc.Vec, matrix: PETSc.Mat, ksp: PETSc.KSP
) -> tuple[list[float], float, Array]:
    """Take a state to the equilibrium nearby; return the steps' sizes, and of the first its work and where it leads."""
    force, change = assembler.vector(), assembler.vector()
    sizes: list[float] = []
    # What is rolled up turns by straight steps.
    assembler.extrapolate()
    for _ in range(_STEPS):
        assembler.residual(x, 1.0, force)
        size = np.inf
        if sizes:
            ksp.solve(force, change)
            size = change.norm()
        # One tangent does, unless what slender rods turn by a straight step stretches them.
        if not sizes or not size < _QUICK * sizes[-1]:
            assembler.tangent(x, 1.0, matrix)
            ksp.setOperators(matrix)
            ksp.solve(force, change)
            size = change.norm()
        x.axpy(-1.0, change)
        sizes.append(size)
        if len(sizes) == 1:
            gained, first = abs(force.dot(change)), assembler.displacement(x, 1.0)
        if not size > _DONE * max(sizes):
            break
    return sizes, gained, first


def _touching(
    finer: Finer, contacts: "Sequence[ContactResult]", state: Array, comm: PETSc.Comm, tight: bool = False
) -> "Frozen | None":
    """Return contact as it is on finer spaces, if there is any."""
    if not contacts:
        return None
    from isorod.contact.frozen import Frozen

    return Frozen(finer.model, finer.coarse.contacts, contacts, state, comm, tight)


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
    about: State | None = None,
    quarter: Array | None = None,
    ranks: int = 1,
) -> float | None:
    """Return the largest relative change of the frequencies of flexible modes; None where there is none.

    About an equilibrium its own change is in it: on finer spaces that is corrected first.

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
    about
        The equilibrium about which they are; None for the state of rest.
    quarter
        Of a body that spins the shapes a quarter of a period later.
    """
    if not eigenvalues.size:
        return None

    def change(finer: Finer, comm: PETSc.Comm) -> Array:
        found = _modes(finer, comm, eigenvalues, vectors, free, lumped, about, quarter)
        return np.array([np.nan if found is None else found])

    return _total(model, directions, ranks, change, 1)[0]


def _modes(
    finer: Finer,
    comm: PETSc.Comm,
    eigenvalues: Array,
    vectors: Array,
    free: bool,
    lumped: bool,
    about: State | None,
    quarter: Array | None,
) -> float | None:
    """Return the change on finer spaces."""
    assembler = assembler_for(finer.model, comm)
    if about is not None:
        state = finer.displacement(about.displacement)
        assembler.contact = _touching(finer, getattr(about, "contacts", ()), state, comm, True)  # type: ignore[assignment]
    matrix, mass = assembler.matrix(), assembler.mass(lumped) if free else assembler.mass_operator(lumped)
    if about is None:
        assembler.tangent(assembler.vector(), 0.0, matrix)
    # Definite, of a free body too, but for pressures.
    shift = float(eigenvalues[0]) if free else 0.0
    shapes = [finer.displacement(vector) for vector in vectors]
    whirl = None if quarter is None else coriolis(assembler, lumped)
    if free:
        matrix.axpy(shift, mass, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
    ksp = _solver(assembler, matrix)
    try:
        if about is not None:
            x = assembler.state(state, finer.pressures(about.pressures) if about.pressures else ())
            sizes, *_ = _corrected(assembler, x, matrix, ksp)
            if not sizes[-1] <= max(_QUICK * sizes[0], _SETTLED * x.norm()):
                # There is none nearby.
                return 1.0
            assembler.extrapolate()
            assembler.tangent(x, 1.0, matrix)
            ksp.setOperators(matrix)
        if whirl is None or quarter is None:
            pushed = [mass * assembler.state(shape) for shape in shapes]
        else:
            later = [finer.displacement(vector) for vector in quarter]
            pushed = _whirled(assembler, mass, whirl, eigenvalues, shapes, later)
        if finer.wider and not free:
            pushed += [mass * assembler.state(shape) for shape in _turns(finer.model)]
        found, heavy = ([assembler.vector() for _ in pushed] for _ in range(2))
        for force, better, image in zip(pushed, found, heavy, strict=True):
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
        above = basis.T @ above @ basis
        if whirl is None:
            values = eigh(above, eigvals_only=True)[: eigenvalues.size] - shift
        else:
            turned = np.array([[(whirl * a).dot(b) for a in found] for b in found])
            values = _squares(above, basis.T @ (turned * scale * scale[:, None]) @ basis)[: eigenvalues.size]
        frequencies, better = (np.sign(one) * np.sqrt(np.abs(one)) for one in (eigenvalues, values))
    finally:
        for one in (ksp, matrix, mass, whirl):
            if one is not None:
                one.destroy()
    error = float(np.abs(frequencies / better - 1.0).max()) / (1.0 - finer.left)
    return error if np.isfinite(error) else None


def _whirled(
    assembler: Assembler, mass: PETSc.Mat, whirl: PETSc.Mat, eigenvalues: Array, first: list[Array], later: list[Array]
) -> list[PETSc.Vec]:
    """Return what the stiffness has to hold in modes ``x cos(omega t) + y sin(omega t)`` with Coriolis forces."""
    pushed = []
    for value, *pair in zip(eigenvalues, first, later, strict=True):
        x, y = (assembler.state(one) for one in pair)
        if value <= 0.0:
            pushed.append(mass * x)
            continue
        for own, other, rate in ((x, y, -np.sqrt(value)), (y, x, np.sqrt(value))):
            force = mass * own
            force.scale(value)
            force.axpy(rate, whirl * other)
            pushed.append(force)
    return pushed


def _squares(stiffness: Array, whirl: Array) -> Array:
    """Return ``omega^2``, ascending, of ``x'' + G x' + K x = 0``: negative of motions that grow."""
    size = len(stiffness)
    rates = eigvals(np.block([[np.zeros((size, size)), np.eye(size)], [-stiffness, -whirl]]))
    swings = np.abs(rates.imag) > np.abs(rates.real)
    squares = np.where(swings, rates.imag**2, -(rates.real**2))
    return np.sort(squares[np.where(swings, rates.imag, rates.real) > 0.0])


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
