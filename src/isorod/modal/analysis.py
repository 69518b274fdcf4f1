"""Vibration modes: ``K x = omega^2 M x`` on the unknowns, by SLEPc."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from time import perf_counter
from typing import Any

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation
from isorod.assembly.formulation import assembler_for
from isorod.assembly.mass import refuse_massless
from isorod.checks import hourglass, rigid_motions
from isorod.errors import InputError, SolveError, expect
from isorod.modal import loaded
from isorod.modal.eigensolvers import only_multiplies
from isorod.modal.modes import Modes
from isorod.modal.pencil import SPARE, Eigenpairs, Pencil
from isorod.model.model import Model, unmoved
from isorod.model.past import Past
from isorod.output.progress import Reporter
from isorod.petsc.options import in_force
from isorod.statics.analysis import Equilibrium


def solve(
    model: Model,
    modes: int = 10,
    lumped: bool = False,
    state: Equilibrium | None = None,
    comm: PETSc.Comm | None = None,
    petsc: Mapping[str, object] | None = None,
    load_steps: int | None = None,
    at_rest: bool = False,
    start: Array | None = None,
    progress: bool = False,
    end_time: float | None = None,
) -> Modes:
    """Return the lowest vibration modes about the equilibrium under loads, moved supports and spin, or about rest.

    For a model with any of these (or active muscles) the equilibrium is solved first, as by `isorod.statics.solve`:
    the modes are those of the deformed, prestressed and, with a spin, softened body.  Laws with memory respond
    elastically about the state reached: without flow, viscoelastic laws with their instantaneous moduli.

    Parameters
    ----------
    model
        Bodies with densities, and supports.
    modes
        Number of modes besides the rigid ones; ``-eps_nev`` overrides it.
    lumped
        Take the lumped mass matrix.  It puts all mass on control points: right for bending and stretching, but the
        polar inertia of a section is up to twice too large, and torsion up to 30 % too slow.
    state
        A static solution of the same model, used instead of solving for one.
    petsc
        PETSc and SLEPc options for this solve alone, such as ``{"eps_tol": 1e-10}`` (`isorod.petsc.options.in_force`).
    load_steps
        Initial number of equal load steps to the equilibrium, as for `isorod.statics.solve`.
    at_rest
        Leave out loads, motions of supports, spin and contact: modes about the state of rest.
    start
        Displacement ``(dofs,)`` near the equilibrium, as for `isorod.statics.solve`.
    progress
        Show progress on standard error (`isorod.output.progress`).
    end_time
        Time up to which histories are followed first, as by `isorod.statics.solve`: modes about the state at that time.

    Raises
    ------
    InputError
        If a density is not positive, there are fewer unknowns than modes, an option is refused, or modes about the
        equilibrium are not available: with a linear elastic body (no geometric stiffness), slipping contact, or a
        follower pressure on a surface with a free edge.
    SolveError
        If the equilibrium or SLEPc does not converge, a factorisation fails, or the Sturm count shows that a
        mode was missed.
    """
    unmoved(model, "modal analysis", timed=end_time is not None or at_rest or state is not None)
    expect("modes", modes, int)
    expect("state", state, Equilibrium | None)
    expect("load steps", load_steps, int | None)
    if state is not None and at_rest:
        raise InputError("modes: got a state and at_rest, need one of them")
    with in_force(petsc):
        model.refuse_hold("modes")
        refuse_massless(model.bodies, "modes need")
        began = perf_counter()
        equilibrium = state
        if state is not None:
            loaded.refuse(model)
            if model not in (state.model, None if state.model.times is None else state.model.times.of):
                raise InputError("modes: the state is of another model; take its own")
        elif not at_rest:
            equilibrium = loaded.find(model, load_steps, comm, start, end_time)
        taken = {"equilibrium": perf_counter() - began} if equilibrium is not state else {}
        with closing(Reporter()) as teller:
            # Vibrations are small: no law flows about the state reached.
            past = () if equilibrium is None else (*equilibrium.model.past, Past(1.0, equilibrium.displacement))
            settled = (model if equilibrium is None else equilibrium.model).after(past, settled=True)
            return _solve(settled, modes, lumped, equilibrium, comm, taken, teller if progress else None)


def _solve(
    model: Model,
    modes: int,
    lumped: bool,
    state: Equilibrium | None,
    comm: PETSc.Comm | None,
    taken: Mapping[str, float],
    teller: Reporter | None,
) -> Modes:
    """Return the modes about a state, by the options in force; ``taken`` are seconds spent before."""
    start = perf_counter()
    loose = rigid_motions.free_motions(model) if state is None else []
    assembler = assembler_for(model, comm)
    turns = state is not None and loaded.spins(model)
    if state is None:
        assembler.contact = None
    elif model.contacts:
        from isorod.modal import touching

        loose = touching.hold(assembler, state)
    pencil = _pencil(assembler, lumped, loose, turns)
    pencil.report = teller if assembler.comm.getRank() == 0 else None
    count = _mode_count(pencil, modes)
    x = assembler.vector() if state is None else assembler.state(state.displacement, state.pressures, state.solids)
    setup = perf_counter() - start
    assembler.seconds = 0.0
    assembler.tangent(x, 0.0 if state is None else 1.0, pencil.stiffness)
    assembly = assembler.seconds
    try:
        if turns:
            pairs = _whirling(assembler, pencil, count, lumped)
        else:
            pairs = pencil.solve(count, _shift(pencil, model, loose))
    except SolveError as problem:
        raise SolveError(f"{problem}{hourglass.hint(model)}") from None
    vectors, quarter, solids = _shapes(assembler, pairs.vectors, pairs.later)
    begin = perf_counter()
    rules = hourglass.better_rules(model)
    if rules:
        flexible = slice(len(loose), None)
        about = None if state is None else state.displacement
        hourglass.check_modes(assembler, rules, pairs.eigenvalues[flexible], vectors[flexible], about)
    patches = None
    if state is not None and model.contacts and model.solids:
        patches = touching.doubt_with_solids(assembler, state, pairs, len(loose), lumped)
    check = pencil.check_seconds + perf_counter() - begin
    seconds = {
        **taken,
        "setup": setup,
        "assembly": assembly,
        "solve": perf_counter() - start - setup - assembly - check,
        "check": check,
    }
    more = {"quarter": quarter if turns else None, "lumped": lumped, "patches": patches, "solids": solids}
    return modes_of(assembler, pairs, vectors, len(loose), state, seconds, **more)


def modes_of(
    assembler: Assembler,
    pairs: Eigenpairs,
    vectors: Array,
    rigid: int,
    state: Equilibrium | None,
    seconds: dict[str, float],
    **more: Any,
) -> Modes:
    """Return eigenpairs as modes with shapes ``(modes, dofs)``; ``more`` are further fields of `Modes`."""
    assert pairs.below is not None
    return Modes(
        model=assembler.model,
        frequencies=np.sign(pairs.eigenvalues) * np.sqrt(np.abs(pairs.eigenvalues)) / (2.0 * np.pi),
        eigenvalues=pairs.eigenvalues,
        vectors=vectors,
        residuals=pairs.residuals,
        rigid=rigid,
        below=pairs.below,
        shift=pairs.shift,
        iterations=pairs.iterations,
        seconds=seconds,
        built=assembler.built,
        solver=pairs.solver,
        ranks=assembler.comm.getSize(),
        equilibrium=state,
        about=loaded.state_of(assembler.model, state),
        falling=pairs.falling,
        **more,
    )


def _whirling(assembler: Assembler, pencil: Pencil, count: int, lumped: bool) -> Eigenpairs:
    """Return the eigenpairs of a spinning model, with Coriolis forces."""
    from isorod.assembly.coriolis import coriolis
    from isorod.modal.gyroscopic import Quadratic

    matrix = coriolis(assembler, lumped)
    try:
        return Quadratic(pencil, matrix).solve(count)
    finally:
        matrix.destroy()


def _mode_count(pencil: Pencil, modes: int) -> int:
    """Return the number of modes to solve for, the rigid ones included."""
    modes = PETSc.Options().getInt("eps_nev", modes)
    most = pencil.size - pencil.rigid
    if not 1 <= modes <= most:
        less = f", less the pressures and {SPARE}" if pencil.pressures else ""
        raise InputError(f"modes: got {modes}, need 1 to {most} (number of unknowns{less})")
    return modes + pencil.rigid


def _pencil(assembler: Assembler, lumped: bool, loose: Sequence[tuple[int, Array]], turns: bool) -> Pencil:
    """Return the pencil with the assembled mass and a stiffness yet to be filled, of a model with rigid motions."""
    stiffness = assembler.matrix()
    multiplies = not (loose or turns) and only_multiplies()
    mass = assembler.mass_operator(lumped) if multiplies else assembler.mass(lumped)
    return Pencil(
        stiffness,
        mass,
        rigid=len(loose),
        pressures=assembler.unknowns - assembler.model.unknowns,
        factors=factorisation(assembler, "st_"),
        motions=lambda: rigid_motions.on_unknowns(assembler, loose),
        # Converting it is faster than assembling it again.
        entries=(lambda: mass.convert("aij", PETSc.Mat())) if multiplies and mass.getType().endswith("maij") else None,
    )


def _shift(pencil: Pencil, model: Model, loose: Sequence[tuple[int, Array]]) -> float:
    """Return the shift to solve with; raises `SolveError` if rigid motions leave none."""
    rigid_motions.refuse_thin(model, loose)
    shift = pencil.shift()
    if shift is None:
        body, motion = loose[0]
        how = rigid_motions.describe(model.bodies[body].space, motion)
        raise SolveError(
            f"modes: body {body} is free to {how} (rigid-body mode, to 1e-8 of its size), and no flexible mode "
            "converged from which to choose the shift; add a support, or give a shift (-st_shift)"
        )
    return shift


def _shapes(
    assembler: Assembler, first: Sequence[PETSc.Vec], later: Sequence[PETSc.Vec]
) -> tuple[Array, Array, list[Array]]:
    """Return mode shapes ``(modes, dofs)``, those a quarter of a period later, if any, and those of solids.

    Each is the shape at its largest within a period, with its first largest component positive.
    """
    vectors, quarter = (
        assembler.shapes(np.array([assembler.all_unknowns(x) for x in several])) for several in (first, later or first)
    )
    if later:
        # x cos + y sin is largest where the square of x + i y, summed, is real.
        turned = (vectors + 1j * quarter) * np.exp(-0.5j * np.angle(np.sum((vectors + 1j * quarter) ** 2, axis=1)))[
            :, None
        ]
        vectors, quarter = turned.real, turned.imag
    large = np.abs(vectors) > 0.999 * np.abs(vectors).max(axis=1, keepdims=True)
    signs = np.sign(vectors[np.arange(len(vectors)), large.argmax(axis=1)])[:, None]
    solids = [signs * np.array(shapes) for shapes in zip(*(assembler.solids(x, 0.0) for x in first), strict=True)]
    return vectors * signs, quarter * signs, solids
