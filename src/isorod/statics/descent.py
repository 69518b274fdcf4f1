"""From an unstable equilibrium to a stable one, along the path that the model would take without inertia.

A small perturbation along the lowest eigenvector of ``K v = l D v``, ``D`` the diagonal of the tangent ``K``, takes the
model off its saddle.  Steps of the proximal point method (`isorod.statics.proximal`) then descend in energy: with a
fraction of ``2 |l|`` the first of them double the perturbation, and each has an equilibrium near.  The fraction falls
where the tangent with a smaller one is definite too, until the forces vanish.  From another saddle this is repeated.
"""

import numpy as np
from petsc4py import PETSc

from isorod.assembly.assembler import Assembler
from isorod.errors import SolveError
from isorod.petsc.softest import soften
from isorod.statics import stability
from isorod.statics.newton import Newton
from isorod.statics.proximal import FEWER, LEAST, LEFT, MORE, Proximal

# The perturbation over the smallest radius of a section.
_ASIDE = 0.05

# Inverse iterations for the lowest eigenvector; factor by which the shift below it grows until it is definite.
_ITERATIONS = 30
_COARSE = 10.0

# Wave vectors in the model's size, one a row for each component of a motion without symmetry, and phases.
_WAVES = np.array([[1.7, 2.3, 1.3], [2.1, 1.1, 1.9], [1.3, 1.7, 2.9]])
_PHASES = np.array([1.0, 0.4, 0.7])

# Maximum number of steps from a saddle, and of saddles.
_STEPS = 100
_SADDLES = 10


def descend(solver: Newton) -> None:
    """Take a solver from an unstable equilibrium at the full load to a stable one.

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
    """Return a smooth motion without symmetry, similar on all spaces, which selects the side to buckle to."""
    model, moved = assembler.model, np.zeros(assembler.model.dofs)
    for b, body in enumerate(model.bodies):
        control = body.space.is_control_point
        model.nodal(moved, b)[control] = np.sin(body.space.positions[control] @ _WAVES.T / model.size + _PHASES)
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
    # The remainder is small, but a bar that rotates freely about its axis has no stiffness that would bound it.
    forces.step(solver.again, solver.x)
