"""One tangent on finer spaces, at a result: what it takes the result to, and what of that is an error."""

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

# Steps of Newton's method at most, with one tangent as long as each is this much smaller than the one before; steps of
# this share of the longest are enough.
_STEPS, QUICK, _DONE = 8, 0.1, 1e-3

_PREFIX = "estimate_"


def total(
    model: Model, directions: Sequence[str], ranks: int, change: Callable[[Finer, PETSc.Comm], Array], count: int
) -> list[float | None]:
    """Return sums ``(count,)`` of what finer spaces change; None where there is none, as on some ranks of many."""
    total, comm = np.zeros(count), PETSc.COMM_SELF if ranks == 1 else PETSc.COMM_WORLD
    none: list[float | None] = [None] * count
    if ranks != comm.getSize():
        return none
    for direction in directions or DIRECTIONS:
        try:
            finer = Finer.of(model, direction)
        except InputError:
            # No finer one can be had: too many elements, or points, or what they take.
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
    """Take a state to the equilibrium nearby; return the steps' sizes, and of the first its work and where it leads.

    ``added`` is a number and a matrix that make the tangent of a body with rigid-body modes definite; ``factor`` is the
    load factor.
    """
    force, change = assembler.vector(), assembler.vector()
    sizes: list[float] = []
    # What is rolled up turns by straight steps.
    assembler.extrapolate()
    for _ in range(_STEPS):
        assembler.residual(x, factor, force)
        size = np.inf
        if sizes:
            ksp.solve(force, change)
            size = change.norm()
        # One tangent does, unless what slender rods turn by a straight step stretches them.
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
            gained, first = abs(force.dot(change)), assembler.displacement(x, factor)
        if not size > _DONE * max(sizes):
            break
    return sizes, gained, first


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
        Fewer than there are motions where these depend on each other but for rounding, as many modes on few unknowns.
    """
    heavy = [mass * one for one in motions]
    above, below = (np.array([[a.dot(b) for b in motions] for a in images]) for images in (forces, heavy))
    scale = 1.0 / np.sqrt(np.diag(below))
    above, below = (0.5 * (one + one.T) * scale * scale[:, None] for one in (above, below))
    sizes, basis = eigh(below)
    kept = sizes > sizes.size * np.finfo(float).eps * sizes[-1]
    basis = basis[:, kept] / np.sqrt(sizes[kept])
    return basis.T @ above @ basis, scale[:, None] * basis


def touching(
    finer: Finer, contacts: "Sequence[ContactResult]", state: Array, comm: PETSc.Comm, tight: bool = False
) -> "Frozen | None":
    """Return contact as it is on finer spaces, if there is any."""
    if not contacts:
        return None
    from isorod.contact.frozen import Frozen

    return Frozen(finer.model, finer.coarse.contacts, contacts, state, comm, tight)


def solver(assembler: Assembler, matrix: PETSc.Mat) -> PETSc.KSP:
    """Return a direct solver, of which `-estimate_...` options say more."""
    return direct(matrix, factorisation(assembler, _PREFIX), _PREFIX)
