"""Error estimates of frequencies and buckling loads: inverse iteration and Rayleigh-Ritz on finer spaces."""

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

# Changes below this fraction of a state are round-off.
_SETTLED = 1e-8

# That near a critical load factor, where the tangent is almost singular and amplifies round-off.
_SLIGHTLY = 1e-4

# Displacement of modes over the model's size at which stresses are compared: stresses are linear there.
_TINY = 1e-7

# Shift, relative to the first eigenvalue, of the tangent that corrects the equilibrium of a free body: rigid motions
# stay at round-off over it, and convergence is as fast as without.
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
        Whether the mass matrix is lumped.
    about
        The equilibrium about which they vibrate; None for the state of rest.
    quarter
        For a spinning body the shapes a quarter of a period later.
    solids
        Shapes ``(m, 3 nodes)`` of finite element bodies on this rank; their meshes are not refined.
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

    For modes about an equilibrium this includes the error of the equilibrium, which is corrected first.

    Parameters
    ----------
    directions, ranks
        As for `isorod.checks.estimate.of_equilibrium`.
    """
    if not modes.eigenvalues.size:
        return None

    def change(finer: Finer, comm: PETSc.Comm) -> Array:
        error = _modes(finer, comm, modes)
        return np.array([np.nan if error is None else error])

    return correction.total(model, directions, ranks, change, 1)[0]


def of_stress(
    model: Model, eigenvalues: Array, vectors: Array, directions: Sequence[str] = (), ranks: int = 1
) -> float | None:
    """Return the largest error of stresses of modes about the state of rest, relative to the largest, away from edges.

    On finer spaces modes are corrected by one step of inverse iteration (`isorod.checks.stresses`).  None where there
    is no finer space, for free bodies, and in the mixed formulation.

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
        ksp, corrected = correction.solver(assembler, matrix), assembler.vector()
        assembler.tangent(assembler.vector(), 0.0, matrix)
        ksp.setOperators(matrix)
        changes = []
        for eigenvalue, vector in zip(eigenvalues, small, strict=True):
            before = finer.displacement(vector)
            ksp.solve(float(eigenvalue) * (mass * assembler.state(before)), corrected)
            after = assembler.shapes(assembler.all_unknowns(corrected)[None])[0]
            # Equal amplitudes, as stresses are relative to the amplitude.
            after *= np.sqrt(before @ before / (after @ after))
            changes.append(stresses.change(finer, vector, after) / (1.0 - finer.left))
        for item in (ksp, matrix, mass):
            item.destroy()
        return np.array(changes)

    errors = correction.total(model, directions, ranks, change, eigenvalues.size)
    known = [error for error in errors if error is not None]
    return max(known) if len(known) == len(errors) else None


def of_solids(
    model: Model, eigenvalues: Array, shapes: Sequence[Array], about: Sequence[Array] = ()
) -> tuple[float | None, Array | None]:
    """Return the error of frequencies by recovered strains of finite element bodies, and the point where it is largest.

    The relative error of an eigenvalue is ``a(e, e) / lambda``, ``a`` the stiffness and ``e`` the error of a shape of
    unit mass (Babuska and Osborn, Handbook of Numerical Analysis II, 1991).  None where a body has no law; collective.

    Parameters
    ----------
    eigenvalues, shapes
        ``omega^2`` ``(m,)`` of modes above the rigid ones, and the shapes ``(m, 3 nodes)`` of each body on this rank.
    about
        Displacements of the bodies in the equilibrium of the modes; none for the state of rest.
    """
    if not eigenvalues.size or any(solid.law is None for solid in model.solids):
        return None, None
    errors = []
    for value, *shapes_of_mode in zip(eigenvalues, *shapes, strict=True):
        states = about or [0.0 * result for result in shapes_of_mode]
        recovered = [solid.recovered(*pair) for solid, *pair in zip(model.solids, shapes_of_mode, states, strict=True)]
        worst = max((result for result in recovered if result is not None), key=lambda result: result.work)
        work = sum(result.work for result in recovered if result is not None)
        errors.append((0.5 * work / abs(float(value)), worst.place))
    error, place = max(errors, key=lambda result: result[0])
    return (error, place) if np.isfinite(error) else (None, None)


def _modes(finer: Finer, comm: PETSc.Comm, modes: Spectrum) -> float | None:
    """Return the largest relative change of frequencies on finer spaces."""
    eigenvalues, vectors, free, lumped, about, quarter, solids, counted = modes
    assembler = assembler_for(finer.model, comm)
    if about is not None:
        state = finer.displacement(about.displacement)
        assembler.contact = correction.touching(finer, getattr(about, "contacts", ()), state, comm, True)  # type: ignore[assignment]
    matrix, mass = assembler.matrix(), assembler.mass(lumped) if free else assembler.mass_operator(lumped)
    # The shift makes the matrix definite for a free body too, but for pressures.
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
            meshes = [[one[k] for one in solids] for k in range(len(shapes))]
            forces = [mass * assembler.state(shape, (), own or 0.0) for shape, own in zip(shapes, meshes, strict=True)]
        else:
            quarters = [finer.displacement(vector) for vector in quarter]
            forces = _whirled(assembler, mass, whirl, eigenvalues, shapes, quarters)
        if finer.wider and not free:
            forces += [mass * assembler.state(shape) for shape in _turns(finer.model)]
        images = [assembler.vector() for _ in forces]
        for force, better in zip(forces, images, strict=True):
            ksp.solve(force, better)
        stiffness, basis = correction.reduced(mass, forces, images)
        if basis.shape[1] < eigenvalues.size:
            return None
        if whirl is None:
            values = eigh(stiffness, eigvals_only=True)[: eigenvalues.size] - shift
        else:
            gyroscopic = np.array([[(whirl * a).dot(b) for a in images] for b in images])
            values = _squares(stiffness, basis.T @ gyroscopic @ basis)[: eigenvalues.size]
        frequencies, better = (np.sign(one) * np.sqrt(np.abs(one)) for one in (eigenvalues, values))
    finally:
        for item in (ksp, matrix, mass, whirl):
            if item is not None:
                item.destroy()
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
        An equilibrium just below the critical load factor.
    vector
        The shape, ``(dofs,)``.
    left, loss
        Its stiffness ``x^T K x`` there, and the decrease of that with the load factor.
    """

    state: State
    vector: Array
    left: float
    loss: float


def of_factors(
    model: Model, softening: Sequence[Softening], directions: Sequence[str] = (), ranks: int = 1
) -> float | None:
    """Return the largest relative change of load factors at which a model buckles; None where there is none.

    On finer spaces the equilibrium is corrected, and the shape by one step of inverse iteration: the decrease of its
    stiffness over the loss of stiffness with the load factor is the decrease of the critical load factor.

    Parameters
    ----------
    model
        Any density will do.
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
        force, corrected = mass * shape, assembler.vector()
        ksp.solve(force, corrected)
        stiffness = force.dot(corrected) / corrected.dot(mass * corrected) * force.dot(shape)
        change = (stiffness - left) / (loss * about.factor)
    finally:
        for item in (ksp, matrix, mass):
            item.destroy()
    return float(abs(change)) / (1.0 - finer.left)


def _whirled(
    assembler: Assembler, mass: PETSc.Mat, whirl: PETSc.Mat, eigenvalues: Array, first: list[Array], later: list[Array]
) -> list[PETSc.Vec]:
    """Return inertial and Coriolis forces of modes ``x cos(omega t) + y sin(omega t)``."""
    forces = []
    for value, *pair in zip(eigenvalues, first, later, strict=True):
        x, y = (assembler.state(one) for one in pair)
        if value <= 0.0:
            forces.append(mass * x)
            continue
        for own, other, rate in ((x, y, -np.sqrt(value)), (y, x, np.sqrt(value))):
            force = mass * own
            force.scale(value)
            force.axpy(rate, whirl * other)
            forces.append(force)
    return forces


def _squares(stiffness: Array, whirl: Array) -> Array:
    """Return ``omega^2``, ascending, of ``x'' + G x' + K x = 0``: negative for motions that grow."""
    size = len(stiffness)
    rates = eigvals(np.block([[np.zeros((size, size)), np.eye(size)], [-stiffness, -whirl]]))
    oscillates = np.abs(rates.imag) > np.abs(rates.real)
    squares = np.where(oscillates, rates.imag**2, -(rates.real**2))
    return np.sort(squares[np.where(oscillates, rates.imag, rates.real) > 0.0])


def _turns(model: Model) -> list[Array]:
    """Return displacements ``(dofs,)`` that rotate sections in proportion to the distance along the axis.

    They find torsional modes that are lower on the finer space than the first ones of the model.
    """
    motions = []
    for turn in np.eye(3):
        moved = []
        for body in model.bodies:
            space = body.space
            control = space.is_control_point[:, None]
            arms = space.positions - control * space.positions[control[:, 0]].mean(axis=0)
            distance = np.repeat(np.arange(space.layers) / space.layers, space.layer_nodes)
            moved.append((distance[:, None] * np.cross(turn, arms)).ravel())
        motions.append(np.concatenate(moved))
    return motions
