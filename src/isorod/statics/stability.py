"""Stability of an equilibrium: the negative eigenvalues of its tangent stiffness.

Forces that have a potential are in stable balance where the tangent is positive definite; each of its negative
eigenvalues is a direction in which the model leaves the equilibrium, as a bar that is pushed beyond its buckling load
does sideways.  By Sylvester's law factors count them, and those of Newton's last iteration are there already; but they
are of the state before it, and of slender bodies with a stress that is extrapolated (`isorod.assembly.extrapolation`).
So where they count none, the direction in which they are softest is asked for its stiffness at the equilibrium itself,
by a difference of forces; where they count some, cannot tell, or were wrong, the tangent there is factorised.
"""

import warnings

import numpy as np
from petsc4py import PETSc

from isorod.errors import InputError
from isorod.model.load import Pressure
from isorod.model.model import Model
from isorod.petsc import inertia
from isorod.petsc.softest import noise, soften
from isorod.statics.newton import Newton

# Inverse iterations with the last factors towards what is softest: from all motions alike, whose stiffnesses differ by
# many powers of ten, the second leaves little but soft ones.
_ITERATIONS = 2

# Length of the difference over the least radius of a section: beside a thickness small, and far above rounding.
_STEP = 1e-3

# An eigenvalue of ``K v = l D v``, ``D`` the diagonal of the tangent ``K``, that is no further below zero is none: a
# round bar, once it is bent, turns about its axis without any force, and rounding says how much.  The first ones of the
# most slender rods are ten thousand times larger.
_NEUTRAL = 1e-12

# An edge lies in a plane if it is out of it by no more than this fraction of the model's size.
_FLAT = 1e-9

# Last factors are believed where the stiffness in their softest direction has not fallen below this fraction of theirs.
_FALLEN = 0.5


def is_told(solver: Newton) -> bool:
    """Return whether the stability of a model follows from its tangent.

    That of friction is no second derivative of an energy, nor is that of a moment or of a pressure that follows a
    surface with free edges; that of laws of small strains knows no stress, hence no buckling; a solver that has no
    factors leaves the count to whoever typed it.
    """
    model, pc = solver.assembler.model, solver.snes.getKSP().getPC()
    known = all(law.objective for body in model.bodies for law in body.laws)
    potential = all(pressed_by_potential(model, load) for load in model.following if isinstance(load, Pressure))
    return known and solver.assembler.symmetric and potential and inertia.is_factored(pc)


def refuse_untold(solver: Newton) -> None:
    """Raise `InputError` where it does not."""
    if not is_told(solver) or solver.assembler.model.remembers:
        raise InputError(
            "stable: stability is unknown with laws that have a memory, friction, moments, a follower pressure with "
            "free edges, small-strain laws (use StVenantKirchhoff), or a solver without a factorisation"
        )


def negative_eigenvalues(solver: Newton) -> int | None:
    """Return the number of negative eigenvalues of the tangent at the last equilibrium; None where unknown.

    What holds bodies until contact does (`isorod.statics.stabilisation`) counts with what is left of it, so that
    motions which nothing resists are none.
    """
    if not is_told(solver):
        return None
    # Who begins at the equilibrium has no factors yet.
    begun = solver.snes.getKSP().getOperators()[1].isAssembled()
    # In this order: where the tangent was filled since, solving brings the factors up to date.
    if begun and _holds(solver) and inertia.of_factors(solver.snes.getKSP().getPC()) == _pressures(solver):
        return 0
    return at_the_end(solver)


def at_the_end(solver: Newton) -> int:
    """Return the number of negative eigenvalues, by factors of the tangent at the last equilibrium itself."""
    matrix = solver.own_tangent()
    matrix.setDiagonal(_NEUTRAL * stiffness(solver), PETSc.InsertMode.ADD_VALUES)
    return count(solver, matrix)


def count(solver: Newton, matrix: PETSc.Mat) -> int:
    """Return the number of negative eigenvalues of a tangent beyond those of the mixed formulation."""
    return inertia.negative_eigenvalues(matrix) - _pressures(solver)


def stiffness(solver: Newton) -> PETSc.Vec:
    """Return the diagonal of the tangent that was filled last, its sizes, and zero for pressures."""
    diagonal = solver.snes.getJacobian()[0].getDiagonal()
    diagonal.abs()
    diagonal.pointwiseMult(diagonal, solver.assembler.state(np.ones(solver.assembler.model.dofs)))
    return diagonal


def _pressures(solver: Newton) -> int:
    """Return the number of pressures of the mixed formulation: so many eigenvalues are negative at any rate."""
    return solver.assembler.unknowns - solver.assembler.model.unknowns


def warn_of(negative: int | None) -> None:
    """Warn of an equilibrium that is not stable."""
    if negative:
        many = "1 negative eigenvalue" if negative == 1 else f"{negative} negative eigenvalues"
        warnings.warn(
            f"the equilibrium is unstable: the tangent stiffness has {many}, as past buckling or a limit point; "
            "--stable (stable=True) continues to a stable one",
            stacklevel=3,
        )


def pressed_by_potential(model: Model, load: Pressure) -> bool:
    """Return whether the edges of a surface that a pressure follows are held, or guided in a plane along an axis.

    What is not symmetric in the second variation of ``p`` times the volume is ``p / 2`` times the integral along the
    edges of ``t . (v x w)``, tangent and two motions: nothing if these are none, or lie in a plane with the edge.
    """
    if not load.pressure:
        return True
    space = model.bodies[load.body].space
    held = model.free.reshape(-1, 3)[model.first_node[load.body] :][: space.nodes] < 0
    direction = model.nodal(model.prescribed(1.0), load.body)
    for layer in () if space.rod.closed else (0, space.layers - 1):
        edge = slice(layer * space.layer_nodes, (layer + 1) * space.layer_nodes)
        places = (space.positions + direction)[edge][space.is_control_point[edge]]
        flat = np.ptp(places, axis=0) <= _FLAT * model.size
        if not held[edge].all() and not (held[edge].all(axis=0) & flat).any():
            return False
    return True


def _holds(solver: Newton) -> bool:
    """Return whether the equilibrium is about as stiff in the direction in which the last factors are softest."""
    assembler = solver.assembler
    direction = noise(assembler.vector())
    # Pressures are not pushed at: those of the answer are what the displacements make of them.
    moves = assembler.state(np.ones(assembler.model.dofs))
    _, push = soften(solver.snes.getKSP(), moves, direction, _ITERATIONS)
    moves.pointwiseMult(direction, moves)
    least = min(body.space.rod.radius for body in assembler.model.bodies)
    moved = moves.norm(PETSc.NormType.NORM_INFINITY)
    # A stiffness near the largest numbers there are.
    if not moved:
        return False
    length = _STEP * least / moved
    direction.scale(length)
    return bool(solver.resistance(direction).dot(direction) >= _FALLEN * length * push.dot(direction))
