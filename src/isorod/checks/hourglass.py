"""Whether a quadrature rule sees the energy of a result: a poor rule leaves motions without any (hourglass modes).

Rules chosen by `isorod.geometry.quadrature` themselves are good; one that a user gives, where it has fewer points, is
held against the one that would be chosen, which evaluates the energy of the result again and solves nothing.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.part import Part
from isorod.errors import SolveError
from isorod.geometry.quadrature import Rule
from isorod.model.body import Body
from isorod.model.model import Model

# A result is refused if the better rule sees this many times the energy.  Measured: paper's rule 1.0 to 1.3, 2x1x2 on a
# spring of four quadratic elements a turn 1.9; where hourglass modes are left, 100 and far more.
FACTOR = 3.0


def better_rules(model: Model) -> dict[int, Rule]:
    """Return, for each body whose rule has in some direction fewer points than would be chosen, one that has not."""
    found = {b: _better(body) for b, body in enumerate(model.bodies)}
    return {b: rule for b, rule in found.items() if rule is not None}


def _better(body: Body) -> Rule | None:
    if body.formulation != "displacement":
        return None
    space = body.space
    good, given = space.basis.auto(space.axis.degree), space.rule
    # Where elements of degree p are joined without continuous slopes, p points along each leave no motion free of
    # energy: the slope of no polynomial vanishes at all of them.  That is what keeps slender rods from locking, and a
    # better rule sees the very energy that locks.
    multiplicity = space.axis.multiplicities
    least = good.axial - 1 if (multiplicity[1:-1] >= space.axis.degree).all() else good.axial
    better = Rule(
        max(good.radial, given.radial),
        max(good.angular, given.angular),
        given.axial if given.axial >= least else good.axial,
    )
    return None if better == given else better


def check_modes(
    assembler: Assembler, rules: Mapping[int, Rule], eigenvalues: Array, vectors: Array, state: Array | None
) -> None:
    """Raise `SolveError` if better rules see much more energy in a mode than those of the model.

    Parameters
    ----------
    assembler, rules
        Of the model, and by which rules to see its bodies.
    eigenvalues, vectors
        Modes above the rigid ones, shapes ``(m,)`` and ``(m, dofs)``, ``x^T M x = 1``.
    state
        Displacement about which they are, or None.
    """
    local = assembler.local(np.zeros(assembler.model.dofs) if state is None else state)
    factor = 0.0 if state is None else 1.0
    motions = [assembler.local(vector) for vector in vectors]
    # An eigenvalue is the energy of all bodies by the model's own rules: where each has a better one, it is known.
    known = state is None and assembler.contact is None and len(rules) == len(assembler.model.bodies)
    more = np.zeros(eigenvalues.size)
    for given, better in assembler.by_other_rules(rules):
        more += _curvatures(better, local, factor, motions)
        if not known:
            more -= _curvatures(given, local, factor, motions)
    energies = (0.0 if known else eigenvalues) + assembler.comm.tompi4py().allreduce(more)
    for k, (value, energy) in enumerate(zip(eigenvalues, energies, strict=True)):
        if not energy <= FACTOR * abs(value):
            ratio = np.sqrt(energy / max(abs(value), 1e-300))
            raise SolveError(
                f"quadrature {_named(assembler.model, rules)}: {_joined(rules)} gives mode {k + 1} {ratio:.2g} times "
                "the frequency; under-integrated: the rule misses the strain energy of the mode (hourglassing); use "
                "more points, or 'auto'"
            )


def _curvatures(part: Part, local: Array, factor: float, motions: Sequence[Array]) -> Array:
    """Return the second derivatives of a part's stored energy: of a linear one twice the energy, in any state."""
    if part.body.linear:
        return np.array([2.0 * part.energy(motion, factor) for motion in motions])
    return part.curvatures(local, factor, motions)


def check_energy(
    assembler: Assembler, rules: Mapping[int, Rule], displacement: Array, energy: float, factor: float = 1.0
) -> None:
    """Raise `SolveError` if better rules see much more than the stored energy of the model's, or an inverted point."""
    local = assembler.local(displacement)
    # Where each body has a better rule, that of all by their own is known.
    known = assembler.contact is None and len(rules) == len(assembler.model.bodies)
    more = sum(
        better.energy(local, factor) - (0.0 if known else given.energy(local, factor))
        for given, better in assembler.by_other_rules(rules)
    )
    good = (0.0 if known else energy) + assembler.comm.tompi4py().allreduce(more)
    if not good <= FACTOR * energy:
        seen = f"{good / energy:.2g} times the stored energy" if good > 0.0 and energy > 0.0 else "inverted points"
        raise SolveError(
            f"quadrature {_named(assembler.model, rules)}: {_joined(rules)} integrates {seen}; under-integrated "
            "(hourglassing): use more points, or 'auto'"
        )


def hint(model: Model) -> str:
    """Return what to add to the message of a failure: nothing, unless the rule may be its cause."""
    rules = better_rules(model)
    return f"; quadrature {_named(model, rules)} has fewer points than 'auto'" if rules else ""


def _named(model: Model, rules: Mapping[int, Rule]) -> str:
    """Return the model's own rules where there are better ones."""
    return _joined({b: model.bodies[b].space.rule for b in rules})


def _joined(rules: Mapping[int, Rule]) -> str:
    return ", ".join(sorted({str(rule) for rule in rules.values()}))
