"""Buckling: load factors at which the tangent stiffness of the primary path is singular, by SLEPc and Sturm counts."""

import warnings
from collections.abc import Mapping, Sequence
from contextlib import closing
from time import perf_counter

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.formulation import assembler_for
from isorod.buckling.critical import Point, Seeker
from isorod.buckling.linear import linear as of_pencil
from isorod.buckling.modes import BucklingModes, scaled
from isorod.buckling.path import Primary
from isorod.buckling.tangents import Tangents
from isorod.checks import rigid_motions
from isorod.checks.estimate_of_modes import Softening
from isorod.errors import InputError, SolveError, expect, whole_number
from isorod.material.law import Material
from isorod.material.thermal import Thermal, bare
from isorod.modal import loaded
from isorod.model.model import Model, unmoved
from isorod.output.progress import Reporter
from isorod.output.state import State
from isorod.petsc.options import in_force

# The first equilibrium is at this fraction of the linear factor.
_FIRST = 0.8

# Additional vibration modes of the state of rest, with which the iteration to the linear factors begins.
_MORE = 8


def solve(
    model: Model,
    modes: int = 1,
    linear_at: float | None = None,
    comm: PETSc.Comm | None = None,
    petsc: Mapping[str, object] | None = None,
    progress: bool = False,
) -> BucklingModes:
    """Return the lowest load factors at which the model buckles, and the buckling shapes.

    All loads and moved supports are multiplied by the load factor.  From the linear factors of the state of rest the
    equilibrium is followed to where its tangent stiffness is singular: deformation before buckling and follower
    pressures are included.

    Parameters
    ----------
    model
        Bodies, supports and loads.
    modes
        Number of load factors, the lowest positive ones.
    linear_at
        Linearise at the equilibrium of this load factor, by its tangent and the tangent's derivative, and follow the
        path no further: 0 is classical, linear buckling, by the stress linearised at rest.
    petsc
        PETSc and SLEPc options for this solve alone (`isorod.petsc.options.in_force`).
    progress
        Show the progress on standard error (`isorod.output.progress`).

    Raises
    ------
    InputError
        If nothing loads the model, a small-strain law has no stress in its tangent, forces have no potential, or the
        model has contact, spin or active muscles.
    SolveError
        If a rigid motion is free, SLEPc does not converge, or the path bends or ends before the first factor.
    """
    unmoved(model, "buckling")
    modes = whole_number("modes", modes, 1, 1000)
    expect("linear_at", linear_at, float | int | None)
    if linear_at is not None and not 0.0 <= linear_at < np.inf:
        raise InputError(f"linear_at: got {linear_at:g}, need a load factor from 0 on")
    refuse(model)
    with in_force(petsc), closing(Reporter()) as display:
        return _solve(model, modes, linear_at, comm, display if progress else None)


def refuse(model: Model) -> None:
    """Raise `InputError` for a model whose buckling is not known, `SolveError` where a rigid motion is free."""
    laws = [law for body in model.bodies for law in body.laws]
    for what, there in (
        ("contact", model.contacts),
        ("a spin, whose forces depend on velocities", loaded.spins(model)),
        ("finite element bodies", model.solids),
        ("active muscles", "muscles" in loaded.burdens(model)),
        ("a stiffness that depends on the temperature", any(_softens(law) for law in laws)),
        (
            "supports that move 'during' a part of the load",
            any(motion.during != (0.0, 1.0) for motion in model.motions),
        ),
    ):
        if there:
            raise InputError(f"buckling: not known with {what}; statics counts negative eigenvalues, and follows paths")
    for law in map(bare, laws):
        if law.timed or getattr(law, "recovery", False):
            why = "flows with time" if law.timed else "recovers, and has no symmetric tangent"
            raise InputError(
                f"buckling: {type(law).__name__} {why}: the load factor depends on the load path; follow a rod with a "
                "slight bend by statics over time, or take Plastic, or NeoHookean for what comes at once"
            )
    model.refuse_hold("buckling")
    loaded.refuse(model, "or leave that load out")
    if not loaded.burdens(model):
        raise InputError("buckling: nothing loads the model; add a load, or a support that moves")
    rigid_motions.refuse_free(model)


def _softens(law: Material) -> bool:
    """Return whether a law has a table of its stiffness over the temperature."""
    return isinstance(law, Thermal) and len(law.stiffness) > 0


def _solve(
    model: Model, modes: int, linear_at: float | None, comm: PETSc.Comm | None, display: Reporter | None
) -> BucklingModes:
    start = perf_counter()
    heavy = model.of_density(1.0)
    assembler = assembler_for(heavy, comm)
    if modes > assembler.model.unknowns:
        raise InputError(f"modes: got {modes}, need 1 to {assembler.model.unknowns} (number of unknowns)")
    tangents, path, mass = Tangents(assembler), Primary(assembler), assembler.mass()
    try:
        if display is not None and assembler.comm.getRank() == 0:
            path.solver.report = display
        setup = perf_counter() - start
        assembler.seconds = 0.0
        seeker = Seeker(assembler, tangents, path, mass)
        first, points, solver = _at_rest(assembler, seeker, tangents, modes)
        if linear_at is None:
            points = _along(seeker, path, float(first[0]), modes)
        elif linear_at:
            points = seeker.linearised_at(linear_at, modes, _MORE)
        assembly, check = assembler.seconds, seeker.pencil.check_seconds
        solved = perf_counter() - start - setup - assembly - check

        def state(factor: float, x: PETSc.Vec) -> State:
            return State(model, assembler.displacement(x, factor), factor=factor, pressures=assembler.pressures(x))

        def moves(shapes: Sequence[PETSc.Vec]) -> Array:
            return assembler.shapes(np.array([assembler.all_unknowns(one) for one in shapes]))

        moved = moves([point.shape for point in points])
        scales, places = (np.array(each) for each in zip(*(scaled(model, shape) for shape in moved), strict=True))
        return BucklingModes(
            model=model,
            factors=np.array([point.factor for point in points]),
            linear=first,
            vectors=scales[:, None] * moved,
            places=[*places],
            losses=scales**2 * np.array([point.loss for point in points]),
            residuals=np.array([point.residual for point in points]),
            settled=None if linear_at is not None else max(point.settled for point in points),
            below=[point.below for point in points],
            states=[state(point.factor, point.x) for point in points],
            softening=[
                Softening(state(*softer[:2]), moves([softer[2]])[0], *softer[3:])
                for softer in (point.softer for point in points)
                # On finer spaces other points would flow.
                if softer is not None and not model.remembers
            ],
            linear_at=linear_at,
            equilibria=seeker.equilibria,
            newton_iterations=path.solver.iterations,
            seconds={"setup": setup, "assembly": assembly, "solve": solved, "check": check},
            built=assembler.built,
            solver=solver,
            ranks=assembler.comm.getSize(),
        )
    finally:
        path.destroy()
        tangents.destroy()
        mass.destroy()


def _at_rest(
    assembler: Assembler, seeker: Seeker, tangents: Tangents, modes: int
) -> tuple[Array, list[Point], dict[str, str]]:
    """Return the linear factors, their points, and the types of solvers."""
    x = assembler.vector()
    tangents.fill_at_rest(x)
    lowest = seeker.modes(modes + _MORE)
    # At a critical load factor the lowest eigenvalue is zero.
    seeker.pencil.floor = float(lowest.eigenvalues[0])
    linear = of_pencil(tangents, seeker.pencil.mass, lowest.vectors, modes, seeker.pencil.pressures)
    points = []
    for k, (factor, residual, shape) in enumerate(zip(*linear, strict=True)):
        place = x.copy()
        place.axpy(factor, tangents.rate)
        loss = -shape.dot(tangents.derivative * shape)
        points.append(Point(float(factor), place, shape, loss, float(residual), np.nan, k))
    return linear.factors, points, lowest.solver


def _along(seeker: Seeker, path: Primary, first: float, modes: int) -> list[Point]:
    """Return the points along the primary path; fewer, with a warning, where it cannot be followed further."""
    points: list[Point] = []
    for k in range(modes):
        try:
            points.append(seeker.seek(k, None if points else _FIRST * first))
        except SolveError as problem:
            if not points:
                raise
            warnings.warn(f"{k} of {modes} buckling modes computed: {problem}", stacklevel=5)
            break
        path.critical.append(points[-1].factor)
    return points
