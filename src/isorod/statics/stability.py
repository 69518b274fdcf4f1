"""Stability of an equilibrium: the negative eigenvalues of its tangent stiffness.

With forces that have a potential the equilibrium is stable where the tangent is positive definite; each negative
eigenvalue is a direction of instability, as a bar loaded beyond its buckling load moves sideways.  By Sylvester's law
of inertia the tangent's factors count them.  Those of Newton's last iteration exist already, but are of the state
before it and, for slender bodies, of an extrapolated stress (`isorod.assembly.extrapolation`).  So if they count none,
the stiffness of their softest direction is computed at the equilibrium itself, by a difference of forces.  If they
count some, have no inertia, or that stiffness is too small, the tangent there is factorised.
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

# Inverse iterations with the last factors to the softest direction: as stiffnesses differ by many powers of ten, two
# leave little but soft motions.
_ITERATIONS = 2

# Length of the difference over the smallest radius of a section: small beside a thickness, and far above rounding.
_STEP = 1e-3

# Eigenvalues of ``K v = l D v``, ``D`` the diagonal of the tangent ``K``, above minus this do not count as negative: a
# bent round bar rotates about its axis without force, up to rounding.  The lowest eigenvalues of the most slender rods
# are ten thousand times larger.
_NEUTRAL = 1e-12

# An edge lies in a plane if it is out of it by no more than this fraction of the model's size.
_FLAT = 1e-9

# The last factors are trusted where the stiffness of their softest direction is at least this fraction of theirs.
_FALLEN = 0.5


def is_known(solver: Newton) -> bool:
    """Return whether the stability of a model follows from its tangent.

    With friction, moments and follower pressures on surfaces with free edges it is no second derivative of an energy;
    with small-strain laws it does not contain the stress, hence no buckling; and a solver without factors has no count.
    """
    model, pc = solver.assembler.model, solver.snes.getKSP().getPC()
    known = all(law.objective for body in model.bodies for law in body.laws)
    potential = all(pressed_by_potential(model, load) for load in model.following if isinstance(load, Pressure))
    return known and solver.assembler.symmetric and potential and inertia.is_factored(pc)


def refuse_unknown(solver: Newton) -> None:
    """Raise `InputError` where it does not."""
    if not is_known(solver) or solver.assembler.model.remembers:
        raise InputError(
            "stable: stability is unknown with laws that have a memory, friction, moments, a follower pressure with "
            "free edges, small-strain laws (use StVenantKirchhoff), or a solver without a factorisation"
        )


def negative_eigenvalues(solver: Newton) -> int | None:
    """Return the number of negative eigenvalues of the tangent at the last equilibrium; None where unknown.

    The remainder of a stabilisation (`isorod.statics.stabilisation`) is included, so that free motions do not count.
    """
    if not is_known(solver):
        return None
    # A solver that begins at the equilibrium has no factors yet.
    begun = solver.snes.getKSP().getOperators()[1].isAssembled()
    # In this order: if the tangent was filled since, the solve of the first updates the factors.
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
    """Return the number of pressures of the mixed formulation: that many eigenvalues are always negative."""
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
    """Return whether the edges of a surface under follower pressure are held, or guided in a plane normal to an axis.

    The unsymmetric part of the second variation of ``p`` times the volume is ``p / 2`` times the integral along the
    edges of ``t . (v x w)``, tangent and two motions: zero if these vanish, or lie in a plane with the edge.
    """
    if not load.pressure:
        return True
    space = model.bodies[load.body].space
    held = model.free.reshape(-1, 3)[model.first_node[load.body] :][: space.nodes] < 0
    direction = model.nodal(model.prescribed(1.0), load.body)
    for layer in () if space.rod.closed else (0, space.layers - 1):
        edge = slice(layer * space.layer_nodes, (layer + 1) * space.layer_nodes)
        positions = (space.positions + direction)[edge][space.is_control_point[edge]]
        flat = np.ptp(positions, axis=0) <= _FLAT * model.size
        if not held[edge].all() and not (held[edge].all(axis=0) & flat).any():
            return False
    return True


def _holds(solver: Newton) -> bool:
    """Return whether the equilibrium is about as stiff as the last factors in their softest direction."""
    assembler = solver.assembler
    direction = noise(assembler.vector())
    # Displacements alone: the pressures of the response follow from them.
    moves = assembler.state(np.ones(assembler.model.dofs))
    _, push = soften(solver.snes.getKSP(), moves, direction, _ITERATIONS)
    moves.pointwiseMult(direction, moves)
    least = min(body.space.rod.radius for body in assembler.model.bodies)
    moved = moves.norm(PETSc.NormType.NORM_INFINITY)
    # The stiffness is near the largest floating-point number.
    if not moved:
        return False
    length = _STEP * least / moved
    direction.scale(length)
    return bool(solver.resistance(direction).dot(direction) >= _FALLEN * length * push.dot(direction))
