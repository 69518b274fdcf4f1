"""Whether a quadrature rule integrates the energy of a result: too few points leave zero-energy (hourglass) modes.

Rules chosen by `isorod.geometry.quadrature` are sufficient; a user's rule with fewer points is compared with the chosen
one by evaluating the energy of the result again, without a solve.
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

# A result is refused if the better rule gives so many times the energy.  Measured: paper's rule 1.0 to 1.3, 2x1x2 on a
# spring of four quadratic elements a turn 1.9; where hourglass modes are left, 100 and far more.
FACTOR = 3.0


def better_rules(model: Model) -> dict[int, Rule]:
    """Return a better rule for each body whose rule has fewer points than the chosen one in some direction."""
    rules = {b: _better(body) for b, body in enumerate(model.bodies)}
    return {b: rule for b, rule in rules.items() if rule is not None}


def _better(body: Body) -> Rule | None:
    if body.formulation != "displacement":
        return None
    space = body.space
    chosen, rule = space.basis.auto(space.axis.degree), space.rule
    # Where elements of degree p are joined without continuous slopes, p points along each leave no zero-energy mode, as
    # no derivative of degree p - 1 vanishes at all of them.  This reduced integration avoids locking of slender rods; a
    # better rule would add the locking energy.
    multiplicity = space.axis.multiplicities
    least = chosen.axial - 1 if (multiplicity[1:-1] >= space.axis.degree).all() else chosen.axial
    better = Rule(
        max(chosen.radial, rule.radial),
        max(chosen.angular, rule.angular),
        rule.axial if rule.axial >= least else chosen.axial,
    )
    return None if better == rule else better


def check_modes(
    assembler: Assembler, rules: Mapping[int, Rule], eigenvalues: Array, vectors: Array, state: Array | None
) -> None:
    """Raise `SolveError` if better rules give a mode much more energy than those of the model.

    Parameters
    ----------
    assembler, rules
        Assembler of the model, and the better rules of its bodies.
    eigenvalues, vectors
        Modes above the rigid ones, shapes ``(m,)`` and ``(m, dofs)``, ``x^T M x = 1``.
    state
        Displacement about which they vibrate, or None.
    """
    local = assembler.local(np.zeros(assembler.model.dofs) if state is None else state)
    factor = 0.0 if state is None else 1.0
    motions = [assembler.local(vector) for vector in vectors]
    # An eigenvalue is the energy of all bodies by the model's own rules; it is not needed where all have better ones.
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
    """Return the second derivatives of a part's stored energy along motions; for a linear part twice its energy."""
    if part.body.linear:
        return np.array([2.0 * part.energy(motion, factor) for motion in motions])
    return part.curvatures(local, factor, motions)


def check_energy(
    assembler: Assembler, rules: Mapping[int, Rule], displacement: Array, energy: float, factor: float = 1.0
) -> None:
    """Raise `SolveError` if better rules give much more stored energy than the model's, or an inverted point."""
    local = assembler.local(displacement)
    # The energy by the model's rules is not needed where all bodies have better ones.
    known = assembler.contact is None and len(rules) == len(assembler.model.bodies)
    more = sum(
        better.energy(local, factor) - (0.0 if known else given.energy(local, factor))
        for given, better in assembler.by_other_rules(rules)
    )
    good = (0.0 if known else energy) + assembler.comm.tompi4py().allreduce(more)
    if not good <= FACTOR * energy:
        result = f"{good / energy:.2g} times the stored energy" if good > 0.0 and energy > 0.0 else "inverted points"
        raise SolveError(
            f"quadrature {_named(assembler.model, rules)}: {_joined(rules)} integrates {result}; under-integrated "
            "(hourglassing): use more points, or 'auto'"
        )


def hint(model: Model) -> str:
    """Return an addition to the message of a failure: empty, unless the rule may be its cause."""
    rules = better_rules(model)
    return f"; quadrature {_named(model, rules)} has fewer points than 'auto'" if rules else ""


def _named(model: Model, rules: Mapping[int, Rule]) -> str:
    """Return the model's own rules that have better ones."""
    return _joined({b: model.bodies[b].space.rule for b in rules})


def _joined(rules: Mapping[int, Rule]) -> str:
    return ", ".join(sorted({str(rule) for rule in rules.values()}))
