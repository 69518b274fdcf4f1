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

from isorod.assembly.extrapolation import radius
from isorod.model.model import Model
from isorod.petsc import inertia
from isorod.statics.newton import Newton

# Inverse iterations with the last factors towards what is softest: from all motions alike, whose stiffnesses differ by
# many powers of ten, the second leaves little but soft ones.
_ITERATIONS = 2

# Length of the difference over the least radius of a section: beside a thickness small, and far above rounding.
_STEP = 1e-3

# An edge lies in a plane if it is out of it by no more than this share of the model's size.
_FLAT = 1e-9

# Last factors are believed where the stiffness in their softest direction has not fallen below this share of theirs.
_FALLEN = 0.5


def negative_eigenvalues(solver: Newton) -> int | None:
    """Return the number of negative eigenvalues of the tangent at the last equilibrium; None where they do not tell.

    The tangent of friction is no second derivative of an energy, nor is that of a pressure that follows a surface with
    free edges; that of laws of small strains knows no stress, hence no buckling; a solver that has no factors leaves
    the count to whoever typed it.  What holds bodies until contact does
    (`isorod.statics.stabilisation`) counts with what is left of it, so that motions which nothing resists are none.
    As many as there are pressures are negative by the mixed formulation, and not counted.
    """
    assembler = solver.assembler
    pc = solver.snes.getKSP().getPC()
    model = assembler.model
    known = all(law.objective for body in model.bodies for law in body.laws)
    if not (known and assembler.symmetric and _pressed_by_potential(model) and inertia.is_factored(pc)):
        return None
    pressures = assembler.unknowns - model.unknowns
    found = inertia.of_factors(pc)
    if found != pressures or not _holds(solver):
        found = inertia.negative_eigenvalues(solver.own_tangent())
    return found - pressures


def _pressed_by_potential(model: Model) -> bool:
    """Return whether the edges of surfaces that pressures follow are held, or guided in a plane along an axis.

    What is not symmetric in the second variation of ``p`` times the volume is ``p / 2`` times the integral along the
    edges of ``t . (v x w)``, tangent and two motions: nothing if these are none, or lie in a plane with the edge.
    """
    for load in model.following:
        space = model.bodies[load.body].space
        held = model.free.reshape(-1, 3)[model.first_node[load.body] :][: space.nodes] < 0
        way = model.nodal(model.prescribed(1.0), load.body)
        for layer in () if space.rod.closed else (0, space.layers - 1):
            edge = slice(layer * space.layer_nodes, (layer + 1) * space.layer_nodes)
            places = (space.positions + way)[edge][space.is_carrier[edge]]
            flat = np.ptp(places, axis=0) <= _FLAT * model.size
            if not held[edge].all() and not (held[edge].all(axis=0) & flat).any():
                return False
    return True


def warn_of(negative: int | None) -> None:
    """Warn of an equilibrium that is not stable."""
    if negative:
        many = "a direction" if negative == 1 else f"{negative} directions"
        warnings.warn(
            f"the equilibrium is unstable: the model would leave it in {many} (negative eigenvalues of the tangent "
            "stiffness), as past buckling or a limit point; a small load in the way of the buckle leads to the other",
            stacklevel=3,
        )


def _holds(solver: Newton) -> bool:
    """Return whether the equilibrium is about as stiff in the direction in which the last factors are softest."""
    assembler = solver.assembler
    way = assembler.vector()
    push = way.duplicate()
    # Pressures are not pushed at: those of the answer are what the displacements make of them.
    moves = assembler.state(np.ones(assembler.model.dofs))
    # The same on any number of ranks.
    way.array_w[:] = np.random.default_rng(0).normal(size=way.getSize())[slice(*way.getOwnershipRange())]
    for _ in range(_ITERATIONS):
        push.pointwiseMult(way, moves)
        push.normalize()
        solver.snes.getKSP().solve(push, way)
    moves.pointwiseMult(way, moves)
    least = min(radius(body.space.rod) for body in assembler.model.bodies)
    length = _STEP * least / moves.norm(PETSc.NormType.NORM_INFINITY)
    way.scale(length)
    return bool(solver.resistance(way).dot(way) >= _FALLEN * length * push.dot(way))
