"""Static equilibrium of the biceps' branches in contact: continuation in the activation, Newton's method by SNES."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from comparisons.fem.biceps.branches import Branches, End
from comparisons.fem.biceps.contact import Contact, Pressing
from comparisons.fem.statics import DIRECT, NEWTON, Newton
from comparisons.measure.timing import Clock, peak_memory
from isorod.errors import SolveError
from isorod.options import defaults
from meshes.mesh import Array

# A step in the activation is halved at most this many times, and doubled after one that took no more than so many
# linear solves.
_HALVINGS = 6
_EASY = 6


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
    contact: Pressing
    steps: int
    cuts: int
    newton_iterations: int
    residual_norms: list[float]
    seconds: dict[str, float]
    options: dict[str, str]
    peak_memory: int


class _Pressed(Newton):
    """Newton's method with the contact's forces and stiffness added to the branches' own."""

    def __init__(self, branches: Branches, contact: Contact, ends: Sequence[End]) -> None:
        super().__init__(branches.state, branches.residual, branches.tangent, ends, None)
        self.branches, self.contact = branches, contact
        self.contact_seconds = 0.0
        self._pattern: sparse.csr_array | None = None
        # Pressed together the branches may be close to buckling: symmetric is all that is sure.
        self.matrix.setOption(PETSc.Mat.Option.SPD, False)
        # Contact couples nodes of which the forms know nothing.
        self.matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)

    def positions(self) -> Array:
        """Return the present positions of the nodes, numbered as the source mesh."""
        return self.branches.source.points + self.branches.to_nodes(self.state.array_r)

    def press(self, out: PETSc.Vec) -> Pressing:
        """Add the contact's forces to ``out``."""
        start = perf_counter()
        nodal = np.zeros_like(self.branches.source.points)
        pressing = self.contact.add_forces(self.positions(), nodal)
        out.array[:] += self.branches.to_dofs(nodal)
        self.contact_seconds += perf_counter() - start
        return pressing

    def add_forces(self, out: PETSc.Vec) -> None:
        """Add forces that no form knows; the ends, which are held, have none."""
        self.press(out)

    def add_stiffness(self, matrix: PETSc.Mat) -> None:
        """Add their derivative."""
        start = perf_counter()
        entries = self.contact.stiffness(self.positions())
        if entries.nnz:
            to_dof = (3 * self.branches.node_dofs[:, None] + np.arange(3)).ravel()
            entries.row, entries.col = to_dof[entries.row], to_dof[entries.col]
            csr = entries.tocsr()
            csr.sort_indices()
            pattern = csr.copy()
            pattern.data[:] = 1.0
            union = pattern if self._pattern is None else self._pattern + pattern
            # The factorisation's analysis is repeated only where bellies touch that did not before.
            known = self._pattern is not None and union.nnz == self._pattern.nnz
            self._pattern = union
            indices = csr.indptr.astype(PETSc.IntType), csr.indices.astype(PETSc.IntType)
            add = PETSc.Mat().createAIJ(csr.shape, csr=(*indices, csr.data))
            structure = PETSc.Mat.Structure
            matrix.axpy(1.0, add, structure.SUBSET_NONZERO_PATTERN if known else structure.DIFFERENT_NONZERO_PATTERN)
            add.destroy()
            if not known:
                # PETSc later than 3.18 (found in 3.22 and 3.25) gives the sum the nonzero state of any new matrix,
                # takes its pattern for the old one and puts its numbers where the old factors were.
                self.snes.getKSP().getPC().reset()
        self.contact_seconds += perf_counter() - start


def solve(
    branches: Branches,
    contact: Contact,
    activation: float = 1.0,
    steps: int = 80,
    options: Mapping[str, object] | None = None,
) -> Rest:
    """Return the equilibrium at an activation, reached from rest.

    Each step starts from the last two equilibria, extrapolated.  A step that fails is halved, one that was easy doubles
    the next.

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
    with defaults(NEWTON | dict(DIRECT if options is None else options)):
        newton = _Pressed(branches, contact, ends)
        clock.lap("setup")
        counts = _continue(newton, activation, activation / steps)
        found = Rest(
            positions=newton.positions(),
            reactions=newton.reactions(),
            stored=branches.stored(),
            contact=newton.press(newton.force),
            **counts,
            residual_norms=list(newton.norms),
            seconds=clock.seconds,
            options=dict(PETSc.Options().getAll()),
            peak_memory=peak_memory(),
        )
        clock.lap("solve")
        newton.destroy()
    found.seconds["assembly"], found.seconds["contact"] = newton.seconds, newton.contact_seconds
    found.seconds["solve"] -= newton.seconds
    return found


def _continue(newton: _Pressed, activation: float, first: float) -> dict[str, int]:
    """Lead from rest to an activation, in a first step of that size; return the counts of `Rest`."""
    done, size = 0.0, first
    counts = {"steps": 0, "cuts": 0, "newton_iterations": 0}
    last, slope, guess = newton.x.copy(), newton.x.duplicate(), newton.x.duplicate()
    slope.set(0.0)
    while done < activation * (1.0 - 1e-12):
        target = min(done + size, activation)
        newton.branches.activation.value = target
        newton.norms.clear()
        guess.waxpy(target - done, slope, last)
        try:
            newton.solve(guess)
        except SolveError as problem:
            size *= 0.5
            counts["cuts"] += 1
            if size < first * 0.5**_HALVINGS:
                raise SolveError(f"activation {target:.4g}: {problem}") from None
        else:
            slope.waxpy(-1.0, last, newton.x)
            slope.scale(1.0 / (target - done))
            newton.x.copy(last)
            done = target
            counts["steps"] += 1
            if newton.snes.getIterationNumber() <= _EASY:
                size *= 2.0
        counts["newton_iterations"] += newton.snes.getIterationNumber()
    for vector in (last, slope, guess):
        vector.destroy()
    return counts
