"""An estimate of a result's error: what one tangent on a finer space, at the result, changes.

The finer space (`isorod.checks.finer`) has a degree more across the section and along the axis.  In statics the
tangent at the result takes its residual there to corrections, as hierarchical error estimates do (Bank & Weiser, Math.
Comp. 44 (1985) 283-301, with the whole space in the place of bubbles); modes take a step of inverse iteration and a
Rayleigh-Ritz projection.  What a finer space sees it says: not what no section degree tells (a singularity), nor the
geometry.
"""

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc
from scipy.linalg import eigh

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation, is_mixed
from isorod.checks.finer import Finer
from isorod.model.model import Model
from isorod.options import defaults

# Steps of Newton's method; with one tangent as long as each is this much smaller than the one before, and enough.
_STEPS, _QUICK, _DONE = 4, 0.1, 1e-3

# A sum that is a smaller share of its terms is rounding.
_CANCELS = 1e-9

_PREFIX = "estimate_"


def of_equilibrium(
    model: Model,
    displacement: Array,
    work: float,
    pressures: Sequence[Array | None] = (),
    section: bool = True,
) -> float | None:
    """Return the relative change of the work that moved supports or loads do, the larger; None where there is none.

    Where neither are, that of the displacements' size.

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
    section
        Whether the finer space is finer across the section too.
    """
    finer = Finer.of(model, section)
    if finer is None or not model.unknowns:
        return None
    state = finer.displacement(displacement)
    if is_mixed(model):
        from isorod.assembly.mixed import MixedAssembler

        mixed = MixedAssembler(finer.model)
        x = mixed.pressed(mixed.state(state), finer.pressures(pressures))
        assembler: Assembler = mixed
    else:
        assembler = Assembler(finer.model)
        x = assembler.state(state)
    matrix, force, change = assembler.matrix(), assembler.vector(), assembler.vector()
    ksp = _solver(assembler, matrix)
    try:
        size = 0.0
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
            if not size > _DONE * max(last, size):
                break
        found = assembler.displacement(x, 1.0)
        carried = assembler.reactions(x, 1.0)
    finally:
        ksp.destroy()
        matrix.destroy()
    # What moved supports do and what loads do, or where neither do, how far it goes.
    pairs = [(carried * finer.model.prescribed(1.0)[finer.model.bound], work)]
    for weights in (finer.model.external, state * (not finer.model.external.any() and not pairs[0][0].any())):
        pairs.append((weights * found, float(weights @ state)))
    changes = [abs(before / terms.sum() - 1.0) for terms, before in pairs if _counts(terms)]
    error = max(changes, default=np.nan)
    return float(error) if np.isfinite(error) else None


def _counts(terms: Array) -> bool:
    """Return whether a sum is more than what is left of terms that cancel."""
    return abs(terms.sum()) > _CANCELS * float(np.abs(terms).sum())


def of_modes(
    model: Model, eigenvalues: Array, vectors: Array, lumped: bool = False, section: bool = True
) -> float | None:
    """Return the largest relative change of the frequencies of flexible modes at rest; None where there is none.

    Parameters
    ----------
    eigenvalues, vectors
        ``omega^2`` ``(m,)`` and shapes ``(m, dofs)`` of the modes above the rigid ones.
    lumped
        Whether with the lumped mass matrix.
    section
        As for `of_equilibrium`.
    """
    finer = Finer.of(model, section)
    if finer is None or not eigenvalues.size:
        return None
    assembler = Assembler(finer.model)
    stiffness, mass = assembler.matrix(), assembler.mass(lumped)
    assembler.tangent(assembler.vector(), 0.0, stiffness)
    shifted = stiffness.duplicate(copy=True)
    ksp = _solver(assembler, shifted)
    try:
        # Definite, of a free body too.
        shifted.axpy(float(eigenvalues[0]), mass, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        ksp.setOperators(shifted)
        found, right = [], assembler.vector()
        for vector in vectors:
            mass.mult(assembler.state(finer.displacement(vector)), right)
            found.append(assembler.vector())
            ksp.solve(right, found[-1])
        below, above = (_products(matrix, found) for matrix in (mass, stiffness))
        scale = 1.0 / np.sqrt(np.diag(below))
        values = eigh(above * scale * scale[:, None], below * scale * scale[:, None], eigvals_only=True)
    finally:
        for one in (ksp, stiffness, shifted, mass):
            one.destroy()
    error = float(np.abs(np.sqrt(np.abs(eigenvalues / values)) - 1.0).max())
    return error if np.isfinite(error) else None


def _solver(assembler: Assembler, matrix: PETSc.Mat) -> PETSc.KSP:
    """Return a direct solver, of which `-estimate_...` options say more."""
    ksp = PETSc.KSP().create(assembler.comm)
    ksp.setOptionsPrefix(_PREFIX)
    ksp.setOperators(matrix)
    with defaults({f"{_PREFIX}ksp_type": "preonly"} | factorisation(assembler, _PREFIX)):
        ksp.setFromOptions()
    return ksp


def _products(matrix: PETSc.Mat, vectors: Sequence[PETSc.Vec]) -> Array:
    image = vectors[0].duplicate()
    rows = []
    for one in vectors:
        matrix.mult(one, image)
        rows.append([image.dot(other) for other in vectors])
    return np.array(rows)
