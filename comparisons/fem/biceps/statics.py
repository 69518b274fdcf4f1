"""Static equilibrium of the biceps' branches in contact: continuation in the activation, Newton's method by SNES."""

from collections.abc import Mapping
from dataclasses import dataclass

from petsc4py import PETSc

from comparisons.fem.biceps.branches import Branches
from comparisons.fem.contact.surfaces import Contact, Pressing
from comparisons.fem.continuation import lead
from comparisons.fem.pressed import Pressed
from comparisons.fem.statics import DIRECT, NEWTON
from comparisons.measure.timing import Clock, peak_memory
from isorod.options import defaults
from meshes.mesh import Array


@dataclass(frozen=True, eq=False)
class Rest:
    """A static solution.

    Attributes
    ----------
    positions
        Nodes where they are in the end, shape ``(nodes, 3)``, numbered as the source mesh.
    reactions
        Force of each end's support on its branch, shape ``(4, 3)``, in the order of
        `comparisons.fem.biceps.branches.ENDS`.
    stored
        Energy of tendons and muscles.
    contact
        The contact's state.
    pressures
        Number of these, if they are unknowns too.
    steps, cuts, newton_iterations
        Numbers of load steps taken, of those tried in vain, and of linear solves in all.
    residual_norms
        Of the last step.
    seconds, options, peak_memory
        As in `comparisons.fem.statics.Equilibrium`; ``contact`` is the part of the assembly that is the contact's.
    """

    positions: Array
    reactions: Array
    stored: float
    pressures: int
    contact: Pressing
    steps: int
    cuts: int
    newton_iterations: int
    residual_norms: list[float]
    seconds: dict[str, float]
    options: dict[str, str]
    peak_memory: int


def solve(
    branches: Branches,
    contact: Contact,
    activation: float = 1.0,
    steps: int = 80,
    options: Mapping[str, object] | None = None,
) -> Rest:
    """Return the equilibrium at an activation, reached from rest.

    Parameters
    ----------
    steps
        The first step is ``activation / steps``: the slack tendons straighten in it.
    options
        PETSc options that the user's own override.

    Raises
    ------
    SolveError
        If it fails however small the step.
    """
    clock = Clock()
    branches.compile()
    clock.lap("forms")
    ends = branches.ends()

    def activate(level: float) -> None:
        branches.activation.value = level

    with defaults(NEWTON | dict(DIRECT if options is None else options)):
        newton = Pressed(branches, branches.residual, branches.tangent, ends, [contact])
        clock.lap("setup")
        counts = lead(newton, activate, activation, activation / steps, "activation")
        (pressing,) = newton.press(newton.force)
        assert pressing is not None
        result = Rest(
            positions=newton.positions(),
            reactions=newton.reactions(),
            stored=branches.stored(),
            pressures=branches.unknowns - 3 * len(branches.source.points),
            contact=pressing,
            **{name: counts[name] for name in ("steps", "cuts", "newton_iterations")},
            residual_norms=list(newton.norms),
            seconds=clock.seconds,
            options=dict(PETSc.Options().getAll()),
            peak_memory=peak_memory(),
        )
        clock.lap("solve")
        newton.destroy()
    result.seconds["assembly"], result.seconds["contact"] = newton.seconds, newton.contact_seconds
    result.seconds["solve"] -= newton.seconds
    return result
