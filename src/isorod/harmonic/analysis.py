"""Steady vibrations under harmonic loads: ``(K + i omega C - omega^2 M) x = f`` in a space of modes and residuals."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from time import perf_counter

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Numbers
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation
from isorod.assembly.formulation import assembler_for
from isorod.assembly.mass import refuse_massless
from isorod.checks import hourglass, rigid_motions
from isorod.errors import InputError, SolveError, expect
from isorod.harmonic.basis import Basis, Softer, System
from isorod.harmonic.damping import Damping
from isorod.harmonic.drive import Drive, driven, shear_stiffness
from isorod.harmonic.frequencies import Span, checked
from isorod.harmonic.response import Response, Ritz
from isorod.modal import loaded
from isorod.modal.analysis import modes_of
from isorod.modal.pencil import Pencil
from isorod.model.model import Model, unmoved
from isorod.options import defaults
from isorod.output.progress import Reporter
from isorod.petsc.direct import direct, room
from isorod.petsc.options import in_force
from isorod.statics.analysis import Equilibrium

# Modes up to this multiple of the highest frequency; those above respond nearly statically.
_BEYOND = 1.5

# Relative truncation error in the energy norm above which shapes are added; rounds of that; frequencies checked.
_LEFT, _ROUNDS, _LOOKS = 1e-4, 4, 12

_PREFIX = "harmonic_"


def solve(
    model: Model,
    frequencies: Span | Numbers,
    damping: Damping | None = None,
    base: tuple[float, float, float] | None = None,
    base_displacement: tuple[float, float, float] | None = None,
    loads: Sequence[int] | None = None,
    load_steps: int = 1,
    comm: PETSc.Comm | None = None,
    petsc: Mapping[str, object] | None = None,
    progress: bool = False,
) -> Response:
    """Return the steady response to oscillating loads or supports: amplitude and phase at each frequency.

    It is linear, about the state of rest or the equilibrium under static loads, moved supports and a spin, with
    Coriolis forces.

    Parameters
    ----------
    model
        Bodies with densities, supports and loads.
    frequencies
        Cycles per time: a list, or a `Span`, refined round each resonance.
    damping
        Ratio, Rayleigh's or structural (`Damping`); required unless a law is viscoelastic, whose damping is included.
    base
        Amplitude of the common acceleration of all supports, shape ``(3,)``.
    base_displacement
        The same of their displacement.
    loads
        The oscillating loads, all in phase, their values the amplitudes.  Default: all, or none with base
        excitation.  The others are static.
    load_steps
        Initial number of equal load steps to the equilibrium.
    petsc, progress
        As for `isorod.modal.solve`.

    Raises
    ------
    InputError
        If there is no excitation, an argument is invalid, or the response is not available: with contact, finite
        element bodies, laws with memory other than viscoelastic ones, or an equilibrium without modes.
    SolveError
        If the equilibrium does not converge or is unstable, or modes are missed.
    """
    unmoved(model, "harmonic response")
    expect("damping", damping, Damping | None)
    expect("load steps", load_steps, int)
    asked = checked(frequencies)
    drive = driven(model, base, base_displacement, loads)
    if damping is None and not drive.soft:
        raise InputError("damping is missing: ratio, rayleigh or structural; at resonance nothing else bounds it")
    with in_force(petsc), closing(Reporter()) as teller:
        model.refuse_hold("modes")
        refuse_massless(model.bodies, "modes need")
        began = perf_counter()
        if loaded.burdens(drive.still):
            loaded.refuse(drive.still, "or leave out what is static")
            if drive.soft:
                raise InputError(
                    f"equilibrium: body {min(drive.soft)} is viscoelastic, whose response is available about the state "
                    "of rest only; leave out what is static"
                )
        state = loaded.find(drive.still, load_steps, comm)
        taken = {} if state is None else {"equilibrium": perf_counter() - began}
        return _solve(drive, asked, damping, state, comm, taken, teller if progress else None)


def _solve(
    drive: Drive,
    asked: "Span | Array",
    damping: Damping | None,
    state: Equilibrium | None,
    comm: PETSc.Comm | None,
    taken: Mapping[str, float],
    teller: Reporter | None,
) -> Response:
    start = perf_counter()
    model = drive.still
    loose = rigid_motions.free_motions(model) if state is None else []
    if drive.base.any() and loose:
        how = rigid_motions.describe(model.bodies[loose[0][0]].space, loose[0][1])
        raise InputError(f"base: body {loose[0][0]} is free to {how}, and no support shakes it; hold it, or give loads")
    assembler = assembler_for(model, comm)
    matrix, mass = assembler.matrix(), assembler.mass()
    x = assembler.vector() if state is None else assembler.state(state.displacement, state.pressures)
    factor = 0.0 if state is None else 1.0
    assembler.tangent(x, factor, matrix)
    pencil = Pencil(
        matrix,
        mass,
        rigid=len(loose),
        pressures=assembler.unknowns - model.unknowns,
        factors=factorisation(assembler, "st_"),
        motions=lambda: rigid_motions.on_unknowns(assembler, loose),
    )
    pencil.report = teller if assembler.comm.getRank() == 0 else None
    setup = perf_counter() - start
    rigid_motions.refuse_thin(model, loose)
    shift = pencil.shift()
    if shift is None:
        raise SolveError("harmonic: no flexible mode converged from which to choose the shift; add a support")
    top = _BEYOND * (asked.last if isinstance(asked, Span) else float(asked.max()))
    most = pencil.size - pencil.rigid
    count = pencil.count_below((2.0 * np.pi * top) ** 2) - pencil.rigid
    if count > most // 2:
        raise InputError(
            f"frequencies: {count} modes lie below {top:.4g}, too many for {model.unknowns} unknowns; end lower, or "
            "use more elements"
        )
    pairs = pencil.solve(max(count, 1) + pencil.rigid, shift)
    if pairs.eigenvalues[pencil.rigid] <= 0.0:
        raise SolveError("harmonic: the equilibrium is unstable, motions about it grow; check it with modes")
    # The modes that span the response are without Coriolis forces.
    vectors = assembler.shapes(np.array([assembler.all_unknowns(x) for x in pairs.vectors]))
    modes = modes_of(assembler, pairs, vectors, pencil.rigid, state, {})
    if rules := hourglass.better_rules(model):
        flexible = slice(pencil.rigid, None)
        hourglass.check_modes(assembler, rules, modes.eigenvalues[flexible], modes.vectors[flexible], modes.state)
    shifted = pencil.shifted(shift) if shift else matrix
    ksp = direct(shifted, factorisation(assembler, _PREFIX), _PREFIX)
    force = drive.forces(assembler, x, factor)
    coriolis = _coriolis(assembler) if loaded.spins(model) else None
    softer = [Softer(shear_stiffness(model, b, assembler.comm), prony) for b, prony in drive.soft.items()]
    basis = Basis(System(matrix, mass, damping, coriolis, softer), force, drive.by_square, ksp, shift)
    with defaults(room(assembler.comm, _PREFIX)):
        basis.grow([one.array_r.copy() for one in pairs.vectors])
        left = _complete(basis, force, asked, top)
    resonances, ratios = basis.resonances()
    values = asked.around(resonances, ratios) if isinstance(asked, Span) else asked
    kept = resonances <= top / _BEYOND
    return Response(
        model=model,
        frequencies=values,
        coordinates=basis.coordinates(values),
        ritz=_shapes(assembler, basis.vectors),
        base=drive.base,
        asked=asked,
        resonances=resonances[kept],
        ratios=ratios[kept],
        truncation=left,
        modes=modes,
        soft=drive.soft,
        basis=basis,
        seconds={
            **taken,
            "setup": setup,
            "solve": perf_counter() - start - setup - pencil.check_seconds,
            "check": pencil.check_seconds,
        },
        built=assembler.built,
        solver=pairs.solver,
        ranks=assembler.comm.getSize(),
        about=loaded.state_of(model, state),
    )


def _shapes(assembler: Assembler, vectors: Array) -> list[Ritz]:
    """Return displacements and pressures of shapes ``(n, m)`` given on this rank's unknowns."""
    ritz, x = [], assembler.vector()
    for column in vectors.T:
        x.array_w[:] = column
        displacement = assembler.shapes(assembler.all_unknowns(x)[None])[0]
        ritz.append(Ritz(assembler.model, displacement, pressures=assembler.pressures(x)))
    x.destroy()
    return ritz


def _complete(basis: Basis, force: PETSc.Vec, asked: "Span | Array", top: float) -> float:
    """Add residual vectors; return the remaining relative truncation error in the energy norm."""
    basis.grow(basis.static())
    lowest, last = (asked.first, asked.last) if isinstance(asked, Span) else (float(asked.min()), float(asked.max()))
    between = np.array([one for one in basis.resonances()[0] if lowest <= one <= last])
    looks = between[np.unique(np.linspace(0, between.size - 1, _LOOKS).astype(int))] if between.size else between
    looks = np.unique([lowest, *looks, last])
    for rest in range(_ROUNDS, -1, -1):
        errors, shapes = basis.left(looks)
        # Modes left out lie above `top`: by this factor they respond more than statically.
        errors /= 1.0 - (looks / (top or 1.0)) ** 2
        bad = np.flatnonzero(errors > _LEFT)
        if not (rest and bad.size):
            break
        basis.grow([one for k in bad for one in shapes[2 * k : 2 * k + 2] if one.any()])
    return float(errors.max())


def _coriolis(assembler: Assembler) -> PETSc.Mat:
    from isorod.assembly.coriolis import coriolis

    return coriolis(assembler)
