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
from isorod.modal.pencil import SPARE, Found, Pencil
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

    Where a model has any of these (or active muscles) its equilibrium is solved for first, as `isorod.statics.solve`
    does: the modes are those of the deformed, prestressed and, with a spin, softened body.  Of laws with memory they
    are elastic about the state reached: nothing flows, and what relaxes is as stiff as it is at once.

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
        A static solution of the same model, in the place of the one that would be solved for.
    petsc
        PETSc and SLEPc options for this solve alone, such as ``{"eps_tol": 1e-10}`` (`isorod.petsc.options.in_force`).
    load_steps
        Number of equal steps to the equilibrium to start with, as for `isorod.statics.solve`.
    at_rest
        Leave out loads, motions of supports, spin and contact: modes about the state of rest.
    start
        Displacement ``(dofs,)`` near the equilibrium, as for `isorod.statics.solve`.
    progress
        Show how far it is on standard error (`isorod.output.progress`).
    end_time
        Time to which histories are followed before, as by `isorod.statics.solve`: the modes are those there.

    Raises
    ------
    InputError
        If a density is not positive, there are not as many unknowns as modes, an option is refused, or modes about the
        equilibrium cannot be had: of a linear elastic body, whose tangent knows no stress, with contact, or under a
        pressure that follows a surface with a free edge.
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
        found = state
        if state is not None:
            loaded.refuse(model)
            if model not in (state.model, None if state.model.times is None else state.model.times.of):
                raise InputError("modes: the state is of another model; take its own")
        elif not at_rest:
            found = loaded.find(model, load_steps, comm, start, end_time)
        taken = {"equilibrium": perf_counter() - began} if found is not state else {}
        with closing(Reporter()) as told:
            # Vibrations are small: what flows does not, whatever state it has reached.
            past = () if found is None else (*found.model.past, Past(1.0, found.displacement))
            there = (model if found is None else found.model).after(past, settled=True)
            return _solve(there, modes, lumped, found, comm, taken, told if progress else None)


def _solve(
    model: Model,
    modes: int,
    lumped: bool,
    state: Equilibrium | None,
    comm: PETSc.Comm | None,
    taken: Mapping[str, float],
    told: Reporter | None,
) -> Modes:
    """Return the modes about a state, as the options in force say; some time was ``taken`` to find that."""
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
    pencil.tell = told if assembler.comm.getRank() == 0 else None
    wanted = _wanted(pencil, modes)
    x = assembler.vector() if state is None else assembler.state(state.displacement, state.pressures, state.solids)
    setup = perf_counter() - start
    assembler.seconds = 0.0
    assembler.tangent(x, 0.0 if state is None else 1.0, pencil.stiffness)
    assembly = assembler.seconds
    try:
        if turns:
            found = _whirling(assembler, pencil, wanted, lumped)
        else:
            found = pencil.solve(wanted, _shift(pencil, model, loose))
    except SolveError as problem:
        raise SolveError(f"{problem}{hourglass.hint(model)}") from None
    vectors, quarter, solids = _shapes(assembler, found.vectors, found.later)
    begin = perf_counter()
    rules = hourglass.better_rules(model)
    if rules:
        flexible = slice(len(loose), None)
        about = None if state is None else state.displacement
        hourglass.check_modes(assembler, rules, found.eigenvalues[flexible], vectors[flexible], about)
    patches = None
    if state is not None and model.contacts and model.solids:
        patches = touching.doubt_with_solids(assembler, state, found, len(loose), lumped)
    check = pencil.check_seconds + perf_counter() - begin
    seconds = {
        **taken,
        "setup": setup,
        "assembly": assembly,
        "solve": perf_counter() - start - setup - assembly - check,
        "check": check,
    }
    more = {"quarter": quarter if turns else None, "lumped": lumped, "patches": patches, "solids": solids}
    return modes_of(assembler, found, vectors, len(loose), state, seconds, **more)


def modes_of(
    assembler: Assembler,
    found: Found,
    vectors: Array,
    rigid: int,
    state: Equilibrium | None,
    seconds: dict[str, float],
    **more: Any,
) -> Modes:
    """Return an eigensolver's eigenpairs as modes, of shapes ``(modes, dofs)``; ``more`` are other fields of them."""
    assert found.below is not None
    return Modes(
        model=assembler.model,
        frequencies=np.sign(found.eigenvalues) * np.sqrt(np.abs(found.eigenvalues)) / (2.0 * np.pi),
        eigenvalues=found.eigenvalues,
        vectors=vectors,
        residuals=found.residuals,
        rigid=rigid,
        below=found.below,
        shift=found.shift,
        iterations=found.iterations,
        seconds=seconds,
        built=assembler.built,
        solver=found.solver,
        ranks=assembler.comm.getSize(),
        equilibrium=state,
        about=loaded.state_of(assembler.model, state),
        falling=found.falling,
        **more,
    )


def _whirling(assembler: Assembler, pencil: Pencil, wanted: int, lumped: bool) -> Found:
    """Return the modes of what turns, with Coriolis forces."""
    from isorod.assembly.coriolis import coriolis
    from isorod.modal.gyroscopic import Quadratic

    matrix = coriolis(assembler, lumped)
    try:
        return Quadratic(pencil, matrix).solve(wanted)
    finally:
        matrix.destroy()


def _wanted(pencil: Pencil, modes: int) -> int:
    """Return the number of modes to solve for, the rigid ones included."""
    modes = PETSc.Options().getInt("eps_nev", modes)
    most = pencil.size - pencil.rigid
    if not 1 <= modes <= most:
        less = f", less the pressures and {SPARE}" if pencil.pressures else ""
        raise InputError(f"modes: got {modes}, need 1 to {most} (number of unknowns{less})")
    return modes + pencil.rigid


def _pencil(assembler: Assembler, lumped: bool, loose: Sequence[tuple[int, Array]], turns: bool) -> Pencil:
    """Return the pencil with the mass, and room for the stiffness, of a model with some rigid motions."""
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
        # What PETSc knows it writes down faster than it is assembled once more.
        entries=(lambda: mass.convert("aij", PETSc.Mat())) if multiplies and mass.getType().endswith("maij") else None,
    )


def _shift(pencil: Pencil, model: Model, loose: Sequence[tuple[int, Array]]) -> float:
    """Return the shift to solve with; refuse a model for whose rigid motions none is found."""
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
    """Return mode shapes, shape ``(modes, dofs)``, those a quarter of a period later, if any, and those of solids.

    The shape is the largest of a period; of its largest components the first is positive.
    """
    vectors, quarter = (
        assembler.shapes(np.array([assembler.all_unknowns(x) for x in one])) for one in (first, later or first)
    )
    if later:
        # x cos + y sin is largest where the square of x + i y, summed, is real.
        turned = (vectors + 1j * quarter) * np.exp(-0.5j * np.angle(np.sum((vectors + 1j * quarter) ** 2, axis=1)))[
            :, None
        ]
        vectors, quarter = turned.real, turned.imag
    large = np.abs(vectors) > 0.999 * np.abs(vectors).max(axis=1, keepdims=True)
    signs = np.sign(vectors[np.arange(len(vectors)), large.argmax(axis=1)])[:, None]
    solids = [signs * np.array(of_one) for of_one in zip(*(assembler.solids(x, 0.0) for x in first), strict=True)]
    return vectors * signs, quarter * signs, solids
