"""Correction of a result on finer spaces by Newton's method with, if possible, one tangent."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc
from scipy.linalg import eigh

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation, unscaled
from isorod.checks.finer import DIRECTIONS, Finer
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.options import defaults
from isorod.petsc.direct import direct, room

if TYPE_CHECKING:
    from isorod.contact.frozen import Frozen
    from isorod.contact.result import ContactResult

# Newton iterations at most; reduction by each for which the tangent is kept; fraction of the largest at which they end.
_STEPS, QUICK, _DONE = 8, 0.1, 1e-3

_PREFIX = "estimate_"


def total(
    model: Model, directions: Sequence[str], ranks: int, change: Callable[[Finer, PETSc.Comm], Array], count: int
) -> list[float | None]:
    """Return sums ``(count,)`` of changes on finer spaces; None where there are none, as on a part of the ranks."""
    total, comm = np.zeros(count), PETSc.COMM_SELF if ranks == 1 else PETSc.COMM_WORLD
    none: list[float | None] = [None] * count
    if ranks != comm.getSize():
        return none
    for direction in directions or DIRECTIONS:
        try:
            finer = Finer.of(model, direction)
        except InputError:
            # The finer space would have too many elements or points.
            return none
        if finer is None or not model.unknowns:
            return none
        total += change(finer, comm)
    return [float(one) if np.isfinite(one) else None for one in total]


def corrected(
    assembler: Assembler,
    x: PETSc.Vec,
    matrix: PETSc.Mat,
    ksp: PETSc.KSP,
    added: tuple[float, PETSc.Mat] | None = None,
    factor: float = 1.0,
) -> tuple[list[float], float, Array]:
    """Move a state to the nearby equilibrium; return sizes of increments, and work and displacement of the first.

    ``added`` is a factor and a matrix that make the tangent of a body with rigid-body modes definite; ``factor`` is the
    load factor.
    """
    force, change = assembler.vector(), assembler.vector()
    sizes: list[float] = []
    # Coiled bodies rotate by linear increments.
    assembler.extrapolate()
    for _ in range(_STEPS):
        assembler.residual(x, factor, force)
        size = np.inf
        if sizes:
            ksp.solve(force, change)
            size = change.norm()
        # One tangent is enough, unless a linear increment that rotates slender rods stretches them.
        if not sizes or not size < QUICK * sizes[-1]:
            assembler.tangent(x, factor, matrix)
            if added:
                matrix.axpy(*added, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            ksp.setOperators(matrix)
            with defaults(room(assembler.comm, _PREFIX) | unscaled(assembler, _PREFIX)):
                ksp.solve(force, change)
            size = change.norm()
        x.axpy(-1.0, change)
        sizes.append(size)
        if len(sizes) == 1:
            work, first = abs(force.dot(change)), assembler.displacement(x, factor)
        if not size > _DONE * max(sizes):
            break
    return sizes, work, first


def reduced(mass: PETSc.Mat, forces: Sequence[PETSc.Vec], motions: Sequence[PETSc.Vec]) -> tuple[Array, Array]:
    """Return a stiffness on a basis of motions of unit mass (Rayleigh-Ritz), and the basis.

    Parameters
    ----------
    mass
        Matrix to multiply with.
    forces, motions
        The stiffness times each motion, and the motions, ``m`` of each.

    Returns
    -------
    stiffness : (k, k)
    basis : (m, k)
        Fewer than the motions where these are linearly dependent to round-off, as many modes on few unknowns.
    """
    inertia = [mass * motion for motion in motions]
    stiffness, masses = (np.array([[a.dot(b) for b in motions] for a in images]) for images in (forces, inertia))
    scale = 1.0 / np.sqrt(np.diag(masses))
    stiffness, masses = (0.5 * (one + one.T) * scale * scale[:, None] for one in (stiffness, masses))
    sizes, basis = eigh(masses)
    independent = sizes > sizes.size * np.finfo(float).eps * sizes[-1]
    basis = basis[:, independent] / np.sqrt(sizes[independent])
    return basis.T @ stiffness @ basis, scale[:, None] * basis


def touching(
    finer: Finer, contacts: "Sequence[ContactResult]", state: Array, comm: PETSc.Comm, tight: bool = False
) -> "Frozen | None":
    """Return the frozen contact on finer spaces, if there is any."""
    if not contacts:
        return None
    from isorod.contact.frozen import Frozen

    return Frozen(finer.model, finer.coarse.contacts, contacts, state, comm, tight)


def solver(assembler: Assembler, matrix: PETSc.Mat) -> PETSc.KSP:
    """Return a direct solver with the options `-estimate_...`."""
    return direct(matrix, factorisation(assembler, _PREFIX), _PREFIX)
