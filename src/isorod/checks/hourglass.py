"""Whether a quadrature rule sees the energy of a result: a poor rule leaves motions without any (hourglass modes).

Rules chosen by `isorod.geometry.quadrature` themselves are good; one that a user gives, where it has fewer points, is
held against the one that would be chosen, which evaluates the result again and solves nothing.
"""

from dataclasses import astuple, replace

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.errors import SolveError
from isorod.geometry.quadrature import Rule
from isorod.model.model import Model

# A result is refused if the better rule sees this many times the energy.  Measured: paper's rule 1.0 to 1.3, 2x1x2 on a
# spring of four quadratic elements a turn 1.9; where hourglass modes are left, 100 and far more.
FACTOR = 3.0


def suspected(model: Model) -> bool:
    """Return whether a body's rule has, in some direction, fewer points than the one that would be chosen."""
    for body in model.bodies:
        if body.formulation != "displacement":
            continue
        space = body.space
        good, given = space.basis.auto(space.axis.degree), space.rule
        # Where elements of degree p are joined without continuous slopes, p points along each leave no motion free of
        # energy: the slope of no polynomial vanishes at all of them.  That is what keeps slender rods from locking, and
        # a better rule sees the very energy that locks.
        multiplicity = space.axis.multiplicities
        least = good.axial - 1 if (multiplicity[1:-1] >= space.axis.degree).all() else good.axial
        if given.radial < good.radial or given.angular < good.angular or given.axial < least:
            return True
    return False


def well(model: Model) -> Model:
    """Return the model with rules that have, in each direction, the points that would be chosen, or more."""
    bodies = []
    for body in model.bodies:
        good, given = body.space.basis.auto(body.space.axis.degree), body.space.rule
        rule = Rule(*(max(pair) for pair in zip(astuple(good), astuple(given), strict=True)))
        bodies.append(replace(body, space=replace(body.space, quadrature=str(rule))))
    return replace(model, bodies=bodies)


def check_modes(
    model: Model, eigenvalues: Array, vectors: Array, state: Array | None, lumped: bool, comm: PETSc.Comm | None
) -> None:
    """Raise `SolveError` if a good rule sees much more energy in a mode than the model's rule.

    Parameters
    ----------
    eigenvalues, vectors
        Modes above the rigid ones, shapes ``(m,)`` and ``(m, dofs)``.
    state
        Displacement about which they are, or None.
    """
    better = well(model)
    assembler = Assembler(better, comm)
    x = assembler.vector() if state is None else assembler.state(state)
    stiffness, mass = assembler.matrix(), assembler.mass(lumped)
    assembler.tangent(x, 0.0 if state is None else 1.0, stiffness)
    image = assembler.vector()
    energies = []
    for vector in vectors:
        mode = assembler.state(vector)
        stiffness.mult(mode, image)
        energy = mode.dot(image)
        mass.mult(mode, image)
        energies.append(energy / mode.dot(image))
        mode.destroy()
    for one in (x, stiffness, mass, image):
        one.destroy()
    for k, (value, energy) in enumerate(zip(eigenvalues, energies, strict=True)):
        if energy > FACTOR * abs(value):
            ratio = np.sqrt(energy / max(abs(value), 1e-300))
            raise SolveError(
                f"quadrature {_rules(model)}: {_rules(better)} gives mode {k + 1} {ratio:.2g} times the frequency; the "
                "rule does not see the energy of the mode: take more points, or 'auto'"
            )


def check_energy(model: Model, displacement: Array, energy: float, comm: PETSc.Comm | None) -> None:
    """Raise `SolveError` if a good rule sees much more stored energy than the model's rule, or an inverted point."""
    better = well(model)
    assembler = Assembler(better, comm)
    good = assembler.energy(assembler.state(displacement), 1.0)
    if not good <= FACTOR * energy:
        seen = f"{good / energy:.2g} times the stored energy" if good > 0.0 and energy > 0.0 else "inverted points"
        raise SolveError(f"quadrature {_rules(model)}: {_rules(better)} sees {seen}; take more points, or 'auto'")


def hint(model: Model) -> str:
    """Return what to add to the message of a failure: nothing, unless the rule may be its cause."""
    return f"; quadrature {_rules(model)} has fewer points than 'auto'" if suspected(model) else ""


def _rules(model: Model) -> str:
    return ", ".join(sorted({str(body.space.rule) for body in model.bodies}))
