"""An estimate of the error of frequencies, and of load factors: inverse iteration and Rayleigh-Ritz on finer spaces."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc
from scipy.linalg import eigh, eigvals

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.coriolis import coriolis
from isorod.assembly.formulation import assembler_for
from isorod.checks import correction, stresses
from isorod.checks.finer import Finer
from isorod.model.model import Model
from isorod.output.state import State

# Changes of a smaller fraction of a state are rounding.
_SETTLED = 1e-8

# The same near a load factor at which a state may move by itself, and rounding does more.
_SLIGHTLY = 1e-4

# Displacements of modes whose stresses are compared, over the size of the model: stresses are linear in them.
_TINY = 1e-7

# Shift, in first eigenvalues, with which the tangent of a free body corrects its equilibrium: rigid motions stay within
# rounding over it, and the rest converges as fast as without.
_SLIGHT = 1e-6


class Spectrum(NamedTuple):
    """Modes whose frequencies are estimated.

    Attributes
    ----------
    eigenvalues, vectors
        ``omega^2`` ``(m,)`` and shapes ``(m, dofs)`` of the modes above the rigid ones.
    free
        Whether there are rigid ones.
    lumped
        Whether with the lumped mass matrix.
    about
        The equilibrium about which they are; None for the state of rest.
    quarter
        Of a body that spins the shapes a quarter of a period later.
    solids
        Shapes ``(m, 3 nodes)`` of finite element bodies, on this rank, whose meshes stay.
    counted
        Which of the modes count, shape ``(m,)``; all where not given.
    """

    eigenvalues: Array
    vectors: Array
    free: bool = False
    lumped: bool = False
    about: State | None = None
    quarter: Array | None = None
    solids: Sequence[Array] = ()
    counted: Array | None = None


def of_modes(model: Model, modes: Spectrum, directions: Sequence[str] = (), ranks: int = 1) -> float | None:
    """Return the largest relative change of the frequencies of flexible modes; None where there is none.

    About an equilibrium its own change is in it: on finer spaces that is corrected first.

    Parameters
    ----------
    directions, ranks
        As for `isorod.checks.estimate.of_equilibrium`.
    """
    if not modes.eigenvalues.size:
        return None

    def change(finer: Finer, comm: PETSc.Comm) -> Array:
        found = _modes(finer, comm, modes)
        return np.array([np.nan if found is None else found])

    return correction.total(model, directions, ranks, change, 1)[0]


def of_stress(
    model: Model, eigenvalues: Array, vectors: Array, directions: Sequence[str] = (), ranks: int = 1
) -> float | None:
    """Return how far stresses of modes about the state of rest are off, relative to the largest, away from edges.

    Of several modes it is the worst.  On finer spaces a mode is that of one step of inverse iteration
    (`isorod.checks.stresses`).  None where there is no finer one, of free bodies, and in the mixed formulation.

    Parameters
    ----------
    eigenvalues, vectors
        ``omega^2`` ``(m,)`` and shapes ``(m, dofs)``.
    directions, ranks
        As for `isorod.checks.estimate.of_equilibrium`.
    """
    if not (eigenvalues > 0.0).all() or any(body.formulation != "displacement" for body in model.bodies):
        return None
    small = _TINY * model.size / np.abs(vectors).max(axis=1, keepdims=True) * vectors

    def change(finer: Finer, comm: PETSc.Comm) -> Array:
        assembler = assembler_for(finer.model, comm)
        matrix, mass = assembler.matrix(), assembler.mass_operator()
        ksp, found = correction.solver(assembler, matrix), assembler.vector()
        assembler.tangent(assembler.vector(), 0.0, matrix)
        ksp.setOperators(matrix)
        changes = []
        for eigenvalue, vector in zip(eigenvalues, small, strict=True):
            before = finer.displacement(vector)
            ksp.solve(float(eigenvalue) * (mass * assembler.state(before)), found)
            after = assembler.shapes(assembler.all_unknowns(found)[None])[0]
            # Both as large: stresses are told over the amplitude.
            after *= np.sqrt(before @ before / (after @ after))
            changes.append(stresses.change(finer, vector, after) / (1.0 - finer.left))
        for one in (ksp, matrix, mass):
            one.destroy()
        return np.array(changes)

    found = correction.total(model, directions, ranks, change, eigenvalues.size)
    known = [one for one in found if one is not None]
    return max(known) if len(known) == len(found) else None


def of_solids(
    model: Model, eigenvalues: Array, shapes: Sequence[Array], about: Sequence[Array] = ()
) -> tuple[float | None, Array | None]:
    """Return what recovered strains say of frequencies by a model's finite element bodies, and where most of it is.

    Modes err by ``a(e, e) / lambda`` in their eigenvalues, ``a`` the stiffness and ``e`` the error of a shape of unit
    mass (Babuska and Osborn, Handbook of Numerical Analysis II, 1991).  None where a body has no law; collective.

    Parameters
    ----------
    eigenvalues, shapes
        ``omega^2`` ``(m,)`` of modes above the rigid ones, and of each body the shapes ``(m, 3 nodes)`` on this rank.
    about
        Displacements of the bodies in the equilibrium about which they are; none of the state of rest.
    """
    if not eigenvalues.size or any(solid.law is None for solid in model.solids):
        return None, None
    errors = []
    for value, *each in zip(eigenvalues, *shapes, strict=True):
        states = about or [0.0 * one for one in each]
        found = [solid.recovered(*pair) for solid, *pair in zip(model.solids, each, states, strict=True)]
        most = max((one for one in found if one is not None), key=lambda one: one.work)
        work = sum(one.work for one in found if one is not None)
        errors.append((0.5 * work / abs(float(value)), most.place))
    error, place = max(errors, key=lambda one: one[0])
    return (error, place) if np.isfinite(error) else (None, None)


def _modes(finer: Finer, comm: PETSc.Comm, modes: Spectrum) -> float | None:
    """Return the change on finer spaces."""
    eigenvalues, vectors, free, lumped, about, quarter, solids, counted = modes
    assembler = assembler_for(finer.model, comm)
    if about is not None:
        state = finer.displacement(about.displacement)
        assembler.contact = correction.touching(finer, getattr(about, "contacts", ()), state, comm, True)  # type: ignore[assignment]
    matrix, mass = assembler.matrix(), assembler.mass(lumped) if free else assembler.mass_operator(lumped)
    # Definite, of a free body too, but for pressures.
    shift = float(eigenvalues[0]) if free else 0.0
    shapes = [finer.displacement(vector) for vector in vectors]
    whirl = None if quarter is None else coriolis(assembler, lumped)
    ksp = correction.solver(assembler, matrix)
    try:
        if about is None:
            assembler.tangent(assembler.vector(), 0.0, matrix)
        else:
            if not _tangent_about(finer, assembler, about, matrix, ksp, (_SLIGHT * shift, mass) if free else None):
                return 1.0
        if free:
            matrix.axpy(shift, mass, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        ksp.setOperators(matrix)
        if whirl is None or quarter is None:
            parts = [[one[k] for one in solids] for k in range(len(shapes))]
            pushed = [mass * assembler.state(shape, (), own or 0.0) for shape, own in zip(shapes, parts, strict=True)]
        else:
            later = [finer.displacement(vector) for vector in quarter]
            pushed = _whirled(assembler, mass, whirl, eigenvalues, shapes, later)
        if finer.wider and not free:
            pushed += [mass * assembler.state(shape) for shape in _turns(finer.model)]
        found = [assembler.vector() for _ in pushed]
        for force, better in zip(pushed, found, strict=True):
            ksp.solve(force, better)
        above, basis = correction.reduced(mass, pushed, found)
        if basis.shape[1] < eigenvalues.size:
            return None
        if whirl is None:
            values = eigh(above, eigvals_only=True)[: eigenvalues.size] - shift
        else:
            turned = np.array([[(whirl * a).dot(b) for a in found] for b in found])
            values = _squares(above, basis.T @ turned @ basis)[: eigenvalues.size]
        frequencies, better = (np.sign(one) * np.sqrt(np.abs(one)) for one in (eigenvalues, values))
    finally:
        for one in (ksp, matrix, mass, whirl):
            if one is not None:
                one.destroy()
    changes = np.abs(frequencies / better - 1.0)
    error = float((changes if counted is None else changes[counted]).max()) / (1.0 - finer.left)
    return error if np.isfinite(error) else None


def _tangent_about(
    finer: Finer,
    assembler: Assembler,
    about: State,
    matrix: PETSc.Mat,
    ksp: PETSc.KSP,
    added: tuple[float, PETSc.Mat] | None = None,
    settled: float = _SETTLED,
) -> bool:
    """Fill a matrix with the tangent about the equilibrium on finer spaces; return whether there is one nearby."""
    pressures = finer.pressures(about.pressures) if about.pressures else ()
    x = assembler.state(finer.displacement(about.displacement), pressures, about.solids or 0.0)
    sizes, *_ = correction.corrected(assembler, x, matrix, ksp, added, about.factor)
    if not sizes[-1] <= max(correction.QUICK * sizes[0], settled * x.norm()):
        return False
    assembler.extrapolate()
    assembler.tangent(x, about.factor, matrix)
    return True


class Softening(NamedTuple):
    """A shape that loses its stiffness with the load.

    Attributes
    ----------
    state
        An equilibrium short of the load factor at which there is none left: there it moves by itself.
    vector
        The shape, ``(dofs,)``.
    left, loss
        Its stiffness ``x^T K x`` there, and by how much that falls with the load factor.
    """

    state: State
    vector: Array
    left: float
    loss: float


def of_factors(
    model: Model, softening: Sequence[Softening], directions: Sequence[str] = (), ranks: int = 1
) -> float | None:
    """Return the largest relative change of load factors at which a model buckles; None where there is none.

    On finer spaces an equilibrium is corrected, and the shape by one step of inverse iteration: what stiffness it has
    less, over what it loses with the load factor, is by how much that is lower.

    Parameters
    ----------
    model
        With a density, any.
    softening
        The shapes.
    directions, ranks
        As for `isorod.checks.estimate.of_equilibrium`.
    """

    def change(finer: Finer, comm: PETSc.Comm) -> Array:
        return np.array([max(_factor(finer, comm, *one) for one in softening)])

    return correction.total(model, directions, ranks, change, 1)[0] if softening else None


def _factor(finer: Finer, comm: PETSc.Comm, about: State, vector: Array, left: float, loss: float) -> float:
    """Return the relative change of a load factor on finer spaces."""
    assembler = assembler_for(finer.model, comm)
    matrix, mass = assembler.matrix(), assembler.mass_operator()
    ksp, shape = correction.solver(assembler, matrix), assembler.state(finer.displacement(vector))
    try:
        if not _tangent_about(finer, assembler, about, matrix, ksp, settled=_SLIGHTLY):
            return 1.0
        ksp.setOperators(matrix)
        pushed, better = mass * shape, assembler.vector()
        ksp.solve(pushed, better)
        newer = pushed.dot(better) / better.dot(mass * better) * pushed.dot(shape)
        change = (newer - left) / (loss * about.factor)
    finally:
        for one in (ksp, matrix, mass):
            one.destroy()
    return float(abs(change)) / (1.0 - finer.left)


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
            carriers = space.is_control_point[:, None]
            arms = space.positions - carriers * space.positions[carriers[:, 0]].mean(axis=0)
            way = np.repeat(np.arange(space.layers) / space.layers, space.layer_nodes)
            moved.append((way[:, None] * np.cross(turn, arms)).ravel())
        found.append(np.concatenate(moved))
    return found
