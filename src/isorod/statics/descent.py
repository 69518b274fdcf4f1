"""From an equilibrium that is not stable to one that is: the way that the model would go, without its inertia.

A small push along the lowest eigenvector of ``K v = l D v``, ``D`` the diagonal of the tangent ``K``, takes the model
off its saddle.  Steps of the proximal point method (`isorod.statics.proximal`) then go down the energy: with a fraction
of ``2 |l|`` the first of them double the push, and each has an equilibrium near.  The fraction falls where the tangent
with the rest of it is definite too, and the forces vanish.  Where that is a saddle too, all begins again.
"""

import numpy as np
from petsc4py import PETSc

from isorod.assembly.assembler import Assembler
from isorod.errors import SolveError
from isorod.petsc.softest import soften
from isorod.statics import stability
from isorod.statics.newton import Newton
from isorod.statics.proximal import FEWER, LEAST, LEFT, MORE, Proximal

# The push over the least radius of a section.
_ASIDE = 0.05

# Inverse iterations for the lowest eigenvector; how far a shift below it may be off.
_ITERATIONS = 30
_COARSE = 10.0

# Wave vectors in the model's size, one a row for each component of a motion without symmetry, and phases.
_WAVES = np.array([[1.7, 2.3, 1.3], [2.1, 1.1, 1.9], [1.3, 1.7, 2.9]])
_PHASES = np.array([1.0, 0.4, 0.7])

# Steps from a saddle, and saddles, at most.
_STEPS = 100
_SADDLES = 10


def descend(solver: Newton) -> None:
    """Lead a solver from its equilibrium at the full load, if that is not stable, to one that is.

    Raises
    ------
    SolveError
        If none is reached.
    """
    held = solver.stabilisation
    try:
        for _ in range(_SADDLES):
            if not stability.negative_eigenvalues(solver):
                return
            _leave(solver)
            solver.stabilisation = held
            if held is not None:
                held.vanish(solver.again, solver.x)
    except SolveError as problem:
        raise SolveError(f"stable: no stable equilibrium: {problem}") from None
    raise SolveError(f"stable: no stable equilibrium after {_SADDLES} unstable ones")


def _lowest(solver: Newton, weight: PETSc.Vec) -> tuple[float, PETSc.Vec]:
    """Return the lowest eigenvalue of ``K v = l D v``, and its vector, of displacements alone."""
    assembler = solver.assembler
    matrix, fraction, before = solver.own_tangent(), LEAST, 0.0
    while True:
        matrix.setDiagonal((fraction - before) * weight, PETSc.InsertMode.ADD_VALUES)
        if stability.count(solver, matrix) == 0:
            break
        fraction, before = _COARSE * fraction, fraction
    ksp = solver.snes.getKSP()
    ksp.setOperators(matrix)
    direction = _waves(assembler)
    value, _ = soften(ksp, weight, direction, _ITERATIONS)
    direction.pointwiseMult(direction, assembler.state(np.ones(assembler.model.dofs)))
    return value - fraction, direction


def _waves(assembler: Assembler) -> PETSc.Vec:
    """Return a smooth motion without symmetry, about the same on all spaces: it says which of two ways to buckle."""
    model, moved = assembler.model, np.zeros(assembler.model.dofs)
    for b, body in enumerate(model.bodies):
        carriers = body.space.is_control_point
        model.nodal(moved, b)[carriers] = np.sin(body.space.positions[carriers] @ _WAVES.T / model.size + _PHASES)
    return assembler.state(moved)


def _leave(solver: Newton) -> None:
    """Go from a saddle to another equilibrium."""
    weight = stability.stiffness(solver)
    lowest, direction = _lowest(solver, weight)
    least = min(body.space.rod.radius for body in solver.assembler.model.bodies)
    direction.scale(_ASIDE * least / direction.norm(PETSc.NormType.NORM_INFINITY))
    solver.forget_path()
    solver.x.axpy(1.0, direction)
    forces = Proximal(solver.assembler, weight, 2.0 * abs(lowest))
    while forces.left > LEFT:
        if forces.rounds == _STEPS:
            raise SolveError(forces.why(solver.x))
        fraction, solver.stabilisation = forces.fraction, None
        matrix = solver.own_tangent()
        matrix.setDiagonal(FEWER * fraction * weight, PETSc.InsertMode.ADD_VALUES)
        if stability.count(solver, matrix) == 0:
            forces.fraction = max(FEWER * fraction, LEAST)
        solver.stabilisation = forces
        if not forces.step(solver.again, solver.x):
            forces.fraction = MORE * fraction
        if forces.is_away(solver.x):
            raise SolveError(forces.why(solver.x))
    # What is left then is small, but a bar that turns freely about its axis has no stiffness to measure it by.
    forces.step(solver.again, solver.x)
