"""The elements of a model on a rank, preallocated matrices for them, and their masses."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from time import perf_counter

import numpy as np
from petsc4py import PETSc

from isorod import memory
from isorod.arrays import Array, Index
from isorod.assembly.mass import masses
from isorod.assembly.part import Part
from isorod.assembly.partition import ElementRange
from isorod.assembly.pattern import Pattern
from isorod.assembly.unknowns import Unknowns
from isorod.model.model import Model
from isorod.petsc.matrix import componentwise, create_matrix, keep_symmetric, set_values

# Bytes for an entry of the tangent at least: value, column, work space, and the factor.
_TO_AN_ENTRY = 40.0


class Parts(Unknowns):
    """The elements of a model's rods over a communicator.

    Attributes
    ----------
    seconds
        Wall time spent in assembly so far.
    built
        Names of the operators that were built.
    parts
        The elements of each body on this rank.
    """

    def __init__(self, model: Model, comm: PETSc.Comm | None = None) -> None:
        self.seconds = 0.0
        self.built: list[str] = []
        # petsc4py destroys garbage only on this collective call.
        PETSc.garbage_cleanup()
        self._stage = PETSc.Log.Stage("assembly")
        with self._timed():
            super().__init__(model, comm)
            memory.ask(_TO_AN_ENTRY * sum(one.couplings for one in self.element_ranges), "the tangent with its factor")
            self.parts = [self._part(element_range) for element_range in self.element_ranges]

    def _part(self, element_range: ElementRange) -> Part:
        """Return the elements of a body that this rank has."""
        return Part(element_range, self._exchange)

    @contextmanager
    def _timed(self) -> Iterator[None]:
        start = perf_counter()
        self._stage.push()
        try:
            yield
        finally:
            self._stage.pop()
            self.seconds += perf_counter() - start

    def note(self, operator: str) -> None:
        """Add to the names of the operators that were built."""
        if operator not in self.built:
            self.built.append(operator)

    def _matrix(
        self, indices: Callable[[], tuple[Index, Index]], pattern: Pattern | None = None, components: int = 1
    ) -> PETSc.Mat:
        """Return a new matrix of one of several components, with room for entries."""
        rows, unknowns, block = (size // components for size in (self.rows, self.unknowns, self.block))
        known = (None, 0) if pattern is None else (pattern.layout, pattern.total)
        return create_matrix(self.comm, (rows, unknowns), block, indices, *known)

    def _ranks(self, components: int = 1) -> tuple[PETSc.Comm, int] | None:
        """Return communicator and rows for a pattern of one of several components; None if ``-mat_type`` is given."""
        return None if PETSc.Options().hasName("mat_type") else (self.comm, self.rows // components)

    def _sums(self, values: Iterable[Array]) -> Array:
        """Return the sums on this rank's degrees of freedom of its parts' element values, shape of `Part.dofs` each."""
        total = np.zeros(self._exchange.size)
        for part, own in zip(self.parts, values, strict=True):
            part.add(own, total)
        return total

    def mass(self, lumped: bool = False) -> PETSc.Mat:
        """Return the mass matrix of the unknowns, consistent or lumped.

        Lumped, control points (`Space.is_control_point`) get their row sums over control points, so that the total mass
        is right; other nodes get their diagonal entries.  Pressures of the mixed formulation have no mass.
        """
        with self._timed():
            rods = self._mass(lumped, [self.unknown_of[a::3] for a in range(3)])
            if self.coupling is None:
                return rods
            solids = [solid.mass() for solid in self.model.solids]
            made = self.coupling.matrix(rods, solids, True, stiffness=False)
            self.coupling.fill(made, solids)
            return made

    def mass_products(self, motions: Sequence[PETSc.Vec], lumped: bool = False) -> Array:
        """Return ``x^T M y`` of all pairs of motions, ``(m, m)``, summed over elements of rods only."""
        with self._timed():
            products, moved = np.zeros((len(motions), len(motions))), np.zeros((len(motions), self._exchange.size))
            for motion, local in zip(motions, moved, strict=True):
                self._exchange.add_unknowns(motion if self.coupling is None else self.coupling.to_rods(motion), local)
            for part in self.parts:
                nodal = np.stack([part.nodal(local) for local in moved], axis=-1)
                own = nodal.reshape(nodal.shape[0], -1, 3 * len(motions))
                pushed = part.lumped_mass()[:, :, None] * own if lumped else part.mass @ own
                products += np.tensordot(nodal, pushed.reshape(nodal.shape), ((0, 1, 2, 3), (0, 1, 2, 3)))
            return np.asarray(self.comm.tompi4py().allreduce(products))

    def mass_operator(self, lumped: bool = False) -> PETSc.Mat:
        """Return the mass matrix to multiply with.

        If the components of each node are held together or not at all, it stores one component (PETSc's MAIJ).
        """
        if self.block == 1 or PETSc.Options().hasName("mat_type"):
            return self.mass(lumped)
        with self._timed():
            component = self._mass(lumped, [self.model.free[::3] // 3])
            matrix = keep_symmetric(componentwise(component, 3))
            component.destroy()
            return matrix

    def _mass(self, lumped: bool, numbers: Sequence[Index]) -> PETSc.Mat:
        """Return the mass matrix of three components, or one, given the nodes' unknowns for each."""
        result = masses(self.parts, numbers, lumped, self._ranks(3))
        matrix = keep_symmetric(self._matrix(result.indices, result.pattern, 3 // len(numbers)))
        set_values(matrix, np.tile(result.entries, len(numbers)))
        self.note("lumped mass" if lumped else "mass")
        return matrix
