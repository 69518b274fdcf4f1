"""Vibration modes: ``K x = omega^2 M x`` on the unknowns, by SLEPc."""

from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.checks import hourglass, rigid_motions
from isorod.errors import InputError, SolveError
from isorod.material.linear_elastic import LinearElastic
from isorod.modal.pencil import _ASIDE, _SHIFT, _Problem
from isorod.model.model import Model
from isorod.petsc.library import pc_name
from isorod.statics.analysis import Equilibrium

_BAD_RESIDUAL = 1e-5


@dataclass(frozen=True, eq=False)
class Modes:
    """Vibration modes, ascending.

    Attributes
    ----------
    model
        What was solved.
    frequencies
        ``omega / 2 pi``, cycles per time, shape ``(modes,)``; of an unstable state negative,
        ``-sqrt(-omega^2) / 2 pi``.
    eigenvalues
        ``omega^2``, shape ``(modes,)``; the rigid modes of a free body come first, near zero.
    vectors
        Mode shapes on all degrees of freedom, shape ``(modes, dofs)``, ``x^T M x = 1``.
    residuals
        ``|K x - lambda M x| / (|lambda| |M x|)``, shape ``(modes,)``; for rigid modes with the first flexible
        ``lambda``.
    rigid
        Number of rigid modes among them.
    below
        Number of eigenvalues below the last one returned, that one included, by the inertia of ``K - tau M`` (Sturm
        count).
    shift
        Shift of the spectral transformation.
    iterations
        Restarts of the eigensolver.
    seconds
        ``setup``, ``assembly``, ``solve`` and, for the Sturm count, ``check``, wall time.
    built, solver, ranks
        As for `isorod.statics.Equilibrium`.
    """

    model: Model
    frequencies: Array
    eigenvalues: Array
    vectors: Array
    residuals: Array
    rigid: int
    below: int
    shift: float
    iterations: int
    seconds: dict[str, float]
    built: list[str]
    solver: dict[str, str]
    ranks: int

    def record(self) -> dict[str, Any]:
        """Return what a record keeps of them."""
        return {name: getattr(self, name) for name in ("residuals", "rigid", "below", "shift", "iterations")}

    def fields(self, body: int) -> dict[str, Array]:
        """Return a body's part of each mode shape, ``(nodes, 3)``."""
        return {f"mode_{k + 1}": self.model.nodal(vector, body) for k, vector in enumerate(self.vectors)}


def solve(
    model: Model,
    modes: int = 10,
    lumped: bool = False,
    state: Equilibrium | None = None,
    comm: PETSc.Comm | None = None,
) -> Modes:
    """Return the lowest vibration modes about the state of rest, or about an equilibrium.

    Parameters
    ----------
    model
        Bodies with densities, and supports.
    modes
        Number of modes besides the rigid ones; ``-eps_nev`` wins over it.
    lumped
        Take the lumped mass matrix.  It puts all mass on control points: right for bending and stretching, but the
        polar inertia of a section is up to twice too large, and torsion up to 30 % too slow.
    state
        A static solution of the same model: modes of the deformed, prestressed (and, with a spin, softened) body;
        gyroscopic forces are left out.  A linear elastic body has no such modes: its tangent knows no stress.

    Raises
    ------
    InputError
        If a density is not positive, there are not as many unknowns as modes, or a state is of a linear elastic body.
    SolveError
        If SLEPc does not converge, a factorisation fails, or the Sturm count shows that a mode was missed.
    """
    start = perf_counter()
    for b, body in enumerate(model.bodies):
        if not body.densities.min() > 0.0:
            raise InputError(
                f"density of body {b}: got {body.densities.min():g}, modes need a positive mass per volume"
            )
        if state is not None and any(isinstance(law, LinearElastic) for law in body.laws):
            raise InputError(
                f"modes about a state: body {b} is linear elastic, whose tangent knows no stress; take NeoHookean"
            )
    typed = PETSc.Options()
    if typed.hasName("eps_nev"):
        modes = typed.getInt("eps_nev")
    loose = rigid_motions.free_motions(model) if state is None else []
    rigid_modes = len(loose)
    wanted = modes + rigid_modes
    if modes < 1 or wanted > model.unknowns:
        raise InputError(f"modes: got {modes}, need 1 to {model.unknowns - rigid_modes} (the unknowns there are)")
    assembler = Assembler(model, comm)
    problem = _Problem(assembler, lumped, loose)
    x = assembler.vector() if state is None else assembler.state(state.displacement)
    setup = perf_counter() - start
    assembler.seconds = 0.0
    assembler.tangent(x, 0.0 if state is None else 1.0, problem.stiffness)
    assembly = assembler.seconds
    shift = 0.0
    if rigid_modes:
        shift = -_SHIFT * problem.first_flexible(rigid_modes)
    eps, below = problem.solve(wanted, shift)
    eigenvalues, vectors, residuals = problem.pairs(wanted, rigid_modes)
    bad = max(_BAD_RESIDUAL, 100.0 * eps.getTolerances()[0])
    if not residuals.max() <= bad and typed.hasName("st_shift"):
        # What was factorised is singular if the shift is an eigenvalue.
        problem.found.clear()
        eps, below = problem.solve(wanted, shift, _ASIDE)
        eigenvalues, vectors, residuals = problem.pairs(wanted, rigid_modes)
    worst = int(np.argmax(residuals))
    if not residuals[worst] <= bad:
        raise SolveError(
            f"modes: the residual of mode {worst + 1} is {residuals[worst]:.2g}: -eps_tol is loose, or stiffness differs more along the model than double precision bears{hourglass.hint(model)}"
        )
    begin = perf_counter()
    if hourglass.suspected(model):
        flexible = slice(rigid_modes, None)
        about = None if state is None else state.displacement
        hourglass.check_modes(model, eigenvalues[flexible], vectors[flexible], about, lumped, comm)
    problem.check_seconds += perf_counter() - begin
    st = eps.getST()
    ksp = st.getKSP()
    return Modes(
        model=model,
        frequencies=np.sign(eigenvalues) * np.sqrt(np.abs(eigenvalues)) / (2.0 * np.pi),
        eigenvalues=eigenvalues,
        vectors=vectors,
        residuals=residuals,
        rigid=rigid_modes,
        below=below,
        shift=shift,
        iterations=eps.getIterationNumber(),
        seconds={
            "setup": setup,
            "assembly": assembly,
            "solve": perf_counter() - start - setup - assembly - problem.check_seconds,
            "check": problem.check_seconds,
        },
        built=assembler.built,
        solver={"eps": eps.getType(), "st": st.getType(), "ksp": ksp.getType(), "pc": pc_name(ksp.getPC())},
        ranks=assembler.comm.getSize(),
    )
