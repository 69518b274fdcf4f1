"""Stiffness and mass of a model as SciPy's sparse matrices, with the data to use them elsewhere."""

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_array, triu

from isorod.arrays import Array, Index
from isorod.assembly.assembler import Assembler
from isorod.assembly.coriolis import coriolis
from isorod.assembly.formulation import assembler_for
from isorod.errors import InputError, expect
from isorod.model.model import Model
from isorod.output.state import State
from isorod.petsc.rows import local_rows


@dataclass(frozen=True, eq=False, repr=False)
class Matrices:
    """The linearised model ``M a + K x = f`` with the unknowns ``x``.

    Modes are ``K x = omega^2 M x``, with shapes ``expansion @ x`` on all degrees of freedom.  The displacement is
    ``expansion @ x + offset`` with ``K x = f``: at rest the linear response to supports and loads, about a solution
    another Newton iteration.

    Attributes
    ----------
    model
        The model.
    stiffness
        ``K``, shape ``(unknowns, unknowns)``, force per length.
    mass
        ``M``, of the same shape; None where a body has no density.
    expansion
        From the unknowns to all degrees of freedom, body by body, node by node, ``x, y, z``: shape ``(dofs,
        unknowns)``.  A row has a one, or is empty at supports; tied degrees of freedom have the same column, and
        pressures of the mixed formulation an empty one.
    offset
        Displacement at ``x = 0``, shape ``(dofs,)``: at rest that prescribed by supports, else the state.
    force
        ``f``, shape ``(unknowns,)``: at rest forces of loads and prescribed displacements, else the residual.
    symmetric
        Whether the stiffness is symmetric (that of friction is not).  The mass always is.
    lumped
        Whether the mass is lumped, not consistent.
    state
        The state of linearisation; None for the state of rest.
    gyroscopic
        Antisymmetric ``G`` of the Coriolis forces ``G v`` in the rotating frame of a spinning body, about its
        equilibrium, of the same shape: modes are ``K x + i omega G x = omega^2 M x``.  None otherwise.
    """

    model: Model
    stiffness: csr_array
    mass: csr_array | None
    expansion: csr_array
    offset: Array
    force: Array
    symmetric: bool
    lumped: bool = False
    state: State | None = None
    gyroscopic: csr_array | None = None

    def __repr__(self) -> str:
        about = "at rest" if self.state is None else "about a state"
        kind = "no mass" if self.mass is None else f"mass {self.mass.nnz}"
        return (
            f"Matrices of {self.model!r}\n  {about}, {self.force.size} unknowns; entries of the stiffness "
            f"{self.stiffness.nnz}, {kind}"
        )

    @property
    def places(self) -> tuple[Index, Index, Index]:
        """Body, node and component of each unknown, the first of those tied; -1 for pressures."""
        column = np.full(self.force.size, -1)
        rows, columns = self.expansion.nonzero()
        column[columns[::-1]] = rows[::-1]
        body = np.searchsorted(self.model.first_node, column // 3, side="right") - 1
        node = column // 3 - self.model.first_node[body]
        pressure = column < 0
        return tuple(np.where(pressure, -1, one) for one in (body, node, column % 3))  # type: ignore[return-value]


def matrices(model: Model, state: State | None = None, lumped: bool = False) -> Matrices:
    """Return stiffness and mass of a model at rest, or about a state of it, complete on every rank.

    `isorod.modal.Modes` and `isorod.statics.Equilibrium` have a method of this name.

    Parameters
    ----------
    model
        Bodies, supports, loads.  Pressures of the mixed formulation are unknowns too, without a mass.
    state
        State of this model, without contact: an `isorod.statics.Equilibrium`, or an output of an
        `isorod.dynamics.History` (and its model) at which muscles are fully active.
    lumped
        Whether to take the lumped mass matrix (`isorod.modal.solve`).

    Raises
    ------
    InputError
        If the model is no `Model`, or the state is of another one, has contacts or muscles that are not fully active.
    """
    expect("model", model, Model)
    expect("state", state, State | None)
    if state is not None and state.model is not model:
        raise InputError("matrices: the state is of another model; take its own")
    if state is not None and model.contacts:
        raise InputError("matrices about a state with contact: the active contact set is not stored; use those at rest")
    if model.coupled:
        raise InputError("matrices: not available for models with ties, solids, mean supports or springs")
    if state is not None and state.factor != 1.0:
        raise InputError(
            f"matrices about a motion: muscles are active to {state.factor:.3g} of what they will be, where loads act "
            "in full; take an output after the ramp"
        )
    # Every rank assembles the complete matrices.
    assembler = assembler_for(model, PETSc.COMM_SELF)
    factor = 0.0 if state is None else 1.0
    x = assembler.vector() if state is None else assembler.state(state.displacement, state.pressures, state.solids)
    tangent, force = assembler.matrix(), assembler.vector()
    assembler.tangent(x, factor, tangent)
    if state is None:
        assembler.load_forces(x, 0.0, 1.0, force)
    else:
        assembler.residual(x, factor, force)
    spins = state is not None and model.spin is not None and any(model.spin.velocity)
    return Matrices(
        model=model,
        stiffness=_sparse(tangent, assembler.symmetric),
        mass=_mass(assembler, lumped),
        expansion=_expansion(assembler),
        offset=model.prescribed(1.0) if state is None else state.displacement,
        force=-force.array_r,
        symmetric=assembler.symmetric,
        lumped=lumped,
        state=state,
        gyroscopic=_sparse(coriolis(assembler, lumped), False) if spins else None,
    )


def _mass(assembler: Assembler, lumped: bool) -> csr_array | None:
    """Return the mass on the unknowns, or None where a body has none."""
    if any(not body.densities.min() > 0.0 for body in assembler.model.bodies):
        return None
    return _sparse(assembler.mass(lumped), True)


def _expansion(assembler: Assembler) -> csr_array:
    """Return the matrix from the unknowns to the degrees of freedom of the model."""
    column = assembler.unknown_of
    rows = np.flatnonzero(column >= 0)
    return csr_array((np.ones(rows.size), (rows, column[rows])), shape=(column.size, assembler.unknowns))


def _sparse(matrix: PETSc.Mat, symmetric: bool) -> csr_array:
    """Return a matrix of one rank; a symmetric one from its upper triangle, which is the part that is factorised."""
    rows = local_rows(matrix).own
    result = csr_array((rows.values.copy(), rows.column.copy(), rows.start.copy()), shape=matrix.getSize())
    if symmetric:
        result = csr_array(triu(result) + triu(result, 1).T)
    result.sort_indices()
    return result
