"""Vibration modes: ``K x = omega^2 M x`` on the unknowns, by SLEPc."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation
from isorod.assembly.formulation import assembler_for
from isorod.checks import hourglass, rigid_motions
from isorod.errors import InputError, SolveError, expect, whole_number
from isorod.modal import loaded
from isorod.modal.eigensolvers import only_multiplies
from isorod.modal.mode import Mode
from isorod.modal.pencil import SPARE, Found, Pencil
from isorod.model.model import Model
from isorod.output.progress import Teller
from isorod.petsc.options import in_force
from isorod.statics.analysis import Equilibrium

if TYPE_CHECKING:
    from isorod.contact.result import ContactResult
    from isorod.output.matrices import Matrices


@dataclass(frozen=True, eq=False)
class Modes:
    """Vibration modes, ascending: ``modes[k]`` is the `Mode` ``k``, which answers for any point of it.

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
        Restarts of the eigensolver, those of all its rounds.
    seconds
        ``setup``, ``assembly``, ``solve`` and, for the Sturm count, ``check``, wall time; ``equilibrium`` where that
        was solved for.
    built, solver, ranks
        As for `isorod.statics.Equilibrium`.
    equilibrium
        What they are about, or None for the state of rest.
    about
        That in words.
    quarter
        Of a body that spins, in the frame that turns: shapes a quarter of a period later, shape ``(modes, dofs)``; at
        time ``t`` it is ``vectors cos(omega t) + quarter sin(omega t)``, and the sum of both ``x^T M x`` is 1.
    falling
        Of a body that spins the number of motions that its stiffness alone would not hold, as beyond a critical speed.
    lumped
        Whether the mass matrix is lumped.
    patches
        `contact_error` of models with finite element bodies, None of others.
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
    equilibrium: Equilibrium | None = None
    about: str = "the state of rest"
    quarter: Array | None = None
    falling: int = 0
    lumped: bool = False
    patches: float | None = None

    @property
    def state(self) -> Array | None:
        """Displacement about which they are, shape ``(dofs,)``, or None for the state of rest."""
        return None if self.equilibrium is None else self.equilibrium.displacement

    @property
    def contacts(self) -> "Sequence[ContactResult]":
        """Outcome of each contact in the equilibrium about which they are."""
        return () if self.equilibrium is None else self.equilibrium.contacts

    def __len__(self) -> int:
        return self.frequencies.size

    def __getitem__(self, number: int) -> Mode:
        """Return a mode, the first (of a free body a rigid one) by 0, the last by -1; raises `InputError`."""
        k = whole_number("mode", number, -len(self), len(self) - 1) % len(self)
        later = None if self.quarter is None else self.quarter[k]
        return Mode(self.model, self.vectors[k], k, float(self.frequencies[k]), self.state, later)

    def __iter__(self) -> Iterator[Mode]:
        return (self[k] for k in range(len(self)))

    def __repr__(self) -> str:
        values = ", ".join(f"{one:.6g}" for one in self.frequencies[:6])
        more = ", ..." if self.frequencies.size > 6 else ""
        return (
            f"Modes of {self.model!r}\n  about {self.about}\n"
            f"  {self.frequencies.size} modes, {self.rigid} of them rigid, residuals up to "
            f"{self.residuals.max():.3g}\n  frequencies {values}{more}"
        )

    def estimate(self, *directions: str) -> float | None:
        """Return an estimate of the frequencies' largest relative error (`isorod.checks.estimate_of_modes`).

        None where there is none.  It takes about as long as the modes.  It is the sum of those across the ``"section"``
        and along the ``"axis"``, and of `contact_error`; of one direction alone where that is asked for.
        """
        from isorod.checks.estimate_of_modes import of_modes

        modes = self.eigenvalues[self.rigid :], self.vectors[self.rigid :], self.rigid > 0, self.lumped
        found = of_modes(self.model, *modes, directions, self.equilibrium, self.quarter, self.ranks)
        return found if found is None or directions else found + self.contact_error()

    def contact_error(self) -> float:
        """Return a bound on the frequencies' relative error by how much patches of contact give way; 0 without."""
        if self.equilibrium is None or not self.contacts:
            return 0.0
        if self.patches is not None:
            return self.patches
        from isorod.modal import touching

        modes = self.eigenvalues[self.rigid :], self.vectors[self.rigid :], self.rigid > 0, self.lumped
        return touching.doubt(self.model, self.equilibrium, *modes, self.quarter is not None)

    def matrices(self) -> "Matrices":
        """Return the stiffness and the mass whose modes they are (`isorod.output.matrices.matrices`)."""
        from isorod.output.matrices import matrices

        return matrices(self.model, self.equilibrium, self.lumped)

    def record(self) -> dict[str, Any]:
        """Return what a record keeps of them, and of how the equilibrium was found."""
        kept = ("about", "residuals", "rigid", "below", "shift", "iterations")
        found = {name: getattr(self, name) for name in kept}
        if self.falling:
            found["falling"] = self.falling
        return found if self.equilibrium is None else self.equilibrium.record() | found

    def frames(self) -> "list[tuple[float, Modes]]":
        """Return what there is to show: these modes."""
        return [(0.0, self)]

    def curves(self) -> dict[str, Array]:
        """Return number, frequency and residual of each mode, a row a mode."""
        numbers = np.arange(1.0, len(self) + 1.0)
        return {"mode": numbers, "frequency": self.frequencies, "residual": self.residuals}

    def fields(self, body: int) -> dict[str, Array]:
        """Return a body's part of each mode shape, ``(nodes, 3)``, and the fields of what they are about, if any."""
        found = {} if self.equilibrium is None else self.equilibrium.fields(body)
        later = () if self.quarter is None else self.quarter
        for name, vectors in (("mode", self.vectors), ("quarter", later)):
            found |= {f"{name}_{k + 1}": self.model.nodal(vector, body) for k, vector in enumerate(vectors)}
        return found


def solve(
    model: Model,
    modes: int = 10,
    lumped: bool = False,
    state: Equilibrium | None = None,
    comm: PETSc.Comm | None = None,
    petsc: Mapping[str, object] | None = None,
    load_steps: int = 1,
    at_rest: bool = False,
    start: Array | None = None,
    progress: bool = False,
) -> Modes:
    """Return the lowest vibration modes about the equilibrium under loads, moved supports and spin, or about rest.

    Where a model has any of these (or active muscles) its equilibrium is solved for first, as `isorod.statics.solve`
    does: the modes are those of the deformed, prestressed and, with a spin, softened body.

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
        Number of equal steps to the equilibrium to start with.
    at_rest
        Leave out loads, motions of supports, spin and contact: modes about the state of rest.
    start
        Displacement ``(dofs,)`` near the equilibrium, as for `isorod.statics.solve`.
    progress
        Show how far it is on standard error (`isorod.output.progress`).

    Raises
    ------
    InputError
        If a density is not positive, there are not as many unknowns as modes, an option is refused, or modes about the
        equilibrium cannot be had: of a linear elastic body, whose tangent knows no stress, with contact, or under a
        pressure that follows a surface with a free edge.
    SolveError
        If the equilibrium is not found, SLEPc does not converge, a factorisation fails, or the Sturm count shows that a
        mode was missed.
    """
    expect("model", model, Model)
    expect("modes", modes, int)
    expect("state", state, Equilibrium | None)
    expect("load steps", load_steps, int)
    if state is not None and at_rest:
        raise InputError("modes: got a state and at_rest, need one of them")
    with in_force(petsc):
        loaded.refuse_massless(model)
        began = perf_counter()
        found = state
        if state is not None:
            loaded.refuse(model)
            if state.model is not model:
                raise InputError("modes: the state is of another model; take its own")
        elif not at_rest:
            found = loaded.find(model, load_steps, comm, start)
        taken = {"equilibrium": perf_counter() - began} if found is not state else {}
        with closing(Teller()) as told:
            return _solve(model, modes, lumped, found, comm, taken, told if progress else None)


def _solve(
    model: Model,
    modes: int,
    lumped: bool,
    state: Equilibrium | None,
    comm: PETSc.Comm | None,
    taken: Mapping[str, float],
    told: Teller | None,
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
    vectors, quarter = _shapes(assembler, found.vectors, found.later)
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
    assert found.below is not None
    return Modes(
        model=model,
        frequencies=np.sign(found.eigenvalues) * np.sqrt(np.abs(found.eigenvalues)) / (2.0 * np.pi),
        eigenvalues=found.eigenvalues,
        vectors=vectors,
        residuals=found.residuals,
        rigid=len(loose),
        below=found.below,
        shift=found.shift,
        iterations=found.iterations,
        seconds={
            **taken,
            "setup": setup,
            "assembly": assembly,
            "solve": perf_counter() - start - setup - assembly - check,
            "check": check,
        },
        built=assembler.built,
        solver=found.solver,
        ranks=assembler.comm.getSize(),
        equilibrium=state,
        about=loaded.state_of(model, state),
        quarter=quarter if turns else None,
        falling=found.falling,
        lumped=lumped,
        patches=patches,
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


def _shapes(assembler: Assembler, first: Sequence[PETSc.Vec], later: Sequence[PETSc.Vec]) -> tuple[Array, Array]:
    """Return mode shapes, shape ``(modes, dofs)``, and those a quarter of a period later, if there are any.

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
    return vectors * signs, quarter * signs
