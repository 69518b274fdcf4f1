"""What a finite element solution of rods answers: the same questions as isorod's, by the same names."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from comparisons.fem.rods.places import Places, lagrange, on_rod
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.output.state import Deformation
from isorod.output.stress import von_mises
from isorod.tensors import determinant
from meshes.mesh import Array, Index, Mesh, gradients


class Touch(NamedTuple):
    """The outcome of a contact, as in `isorod.contact.result.ContactResult`: ``penetration`` is not negative."""

    force: float
    area: float
    penetration: float


@dataclass(frozen=True, eq=False)
class Solution:
    """An equilibrium of rods, or their modes.

    Attributes
    ----------
    model, mesh
        What was solved, and on which mesh.
    analysis
        ``"statics"`` or ``"modal"``.
    cell_parameters
        Parameters ``xi_1, xi_2, u`` of each cell's nodes, shape ``(cells, nodes per cell, 3)``, ``u`` of closed rods
        growing on beyond the end.
    place
        Row of each cell's law among those of all bodies, one behind the other, shape ``(cells,)``.
    displacement
        Of the mesh's nodes, shape ``(nodes, 3)``; None of modes.
    reactions, moments
        Force and moment of each support on the model, shape ``(supports, 3)``; moments are about the same point as
        those of `isorod.statics.Equilibrium`.
    contacts
        Outcome of each contact.
    frequencies, eigenvalues, residuals
        Of modes, rigid ones first: cycles per time, ``omega^2``, and ``|K x - lambda M x| / (|lambda| |M x|)``.
    shapes
        Of modes, ``x^T M x = 1``, shape ``(modes, nodes, 3)``.
    rigid, below
        Numbers of rigid modes, and of eigenvalues up to the last one (Sturm count).
    dofs, unknowns, cells
        Numbers of degrees of freedom, with and without those held, and of cells.
    iterations
        Numbers of load steps, of those cut, of linear solves ...; of the eigensolver.
    seconds
        ``forms`` (symbolic work and compilation or its cache), ``setup``, ``assembly`` (with ``contact``), ``solve``
        and, of modes, ``check`` (the Sturm count); wall time.
    options
        PETSc options in force.
    peak_memory
        Largest resident set so far, bytes.
    """

    model: Model
    mesh: Mesh
    analysis: str
    cell_parameters: Array
    place: Index
    seconds: dict[str, float]
    dofs: int
    unknowns: int
    options: dict[str, str]
    peak_memory: int
    iterations: dict[str, int]
    displacement: Array | None = None
    reactions: Array = field(default_factory=lambda: np.zeros((0, 3)))
    moments: Array = field(default_factory=lambda: np.zeros((0, 3)))
    contacts: Sequence[Touch] = ()
    frequencies: Array = field(default_factory=lambda: np.zeros(0))
    eigenvalues: Array = field(default_factory=lambda: np.zeros(0))
    residuals: Array = field(default_factory=lambda: np.zeros(0))
    shapes: Array = field(default_factory=lambda: np.zeros((0, 0, 3)))
    rigid: int = 0
    below: int | None = None
    residual_norms: Sequence[float] = ()

    @property
    def cells(self) -> int:
        """Number of cells."""
        return len(self.mesh.cells)

    def at(self, rod: int, u: ArrayLike, xi: ArrayLike | None = None) -> Array:
        """Return the displacement at points of a rod, as `isorod.output.state.Deformation.at` does."""
        if self.displacement is None:
            raise InputError("displacement: modes have shapes, and no displacement")
        # What u and xi may be, and what they mean, is told by isorod itself.
        points = Deformation(self.model, np.empty(0))._points(rod, u, xi)
        t, q = len(points.u), len(points.xi)
        grid = np.concatenate([np.tile(points.xi, (t, 1)), np.repeat(points.u, q)[:, None]], axis=1)
        cell, where = self._places(points.number).find(grid)
        cells = self.mesh.cells[self.mesh.regions[f"rod {points.number}"][cell]]
        found = np.einsum("mn,mna->ma", self._functions(where), self.displacement[cells]).reshape(t, q, 3)
        return (found.mean(axis=1) if points.mean else found).reshape(*points.shape, 3)

    def _functions(self, where: Array) -> Array:
        return lagrange(self.mesh.order, self.mesh.reference, where)

    def _places(self, rod: int) -> Places:
        own = self.model.bodies[rod].space.rod
        low, high = own.axis.breaks[[0, -1]]
        cells = self.mesh.regions[f"rod {rod}"]
        period = float(high - low) if own.closed else None
        return Places(self.mesh.order, self.mesh.reference, self.cell_parameters[cells], period)

    def fields(self) -> dict[str, Array]:
        """Return displacement or shapes at the nodes, and the von Mises stress where it is most exact.

        Returns
        -------
        ``points`` ``(nodes, 3)``, ``parameters`` ``(nodes, 3)`` (``xi_1, xi_2, u``), ``node_rod`` ``(nodes,)``,
        ``cells``, ``weights`` ``(nodes,)`` (volumes) and ``order`` of the mesh; ``displacement`` ``(nodes, 3)`` and, at
        the ``2 x 2 x 2`` Gauss points of every cell, ``stress_parameters`` ``(m, 3)``, ``stress_rod`` ``(m,)``,
        ``stress_points`` ``(m, 3)`` (at rest) and ``von_mises`` ``(m,)``, of the Cauchy stress ``P F^T / det F`` (as
        `isorod.output.stress` has it for linear elastic bodies, too); or ``modes`` ``(modes, nodes, 3)`` with
        ``x^T M x = 1`` and ``frequencies``.
        """
        mesh = self.mesh
        assert mesh.parameters is not None
        node_rod = np.empty(len(mesh.points), dtype=np.int64)
        for k in range(len(self.model.bodies)):
            node_rod[mesh.cells[mesh.regions[f"rod {k}"]]] = k
        found = {
            "points": mesh.points,
            "parameters": mesh.parameters,
            "node_rod": node_rod,
            "cells": mesh.cells,
            "weights": mesh.node_volumes(),
            "order": np.array(mesh.order),
        }
        if self.displacement is None:
            return found | {"modes": self.shapes, "frequencies": self.frequencies}
        return found | {"displacement": self.displacement} | self._stress(self.displacement)

    def _stress(self, displacement: Array) -> dict[str, Array]:
        """Return the von Mises stress at Gauss points, and where these are."""
        mesh = self.mesh
        ticks = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
        where = np.stack([one.ravel() for one in np.meshgrid(ticks, ticks, ticks, indexing="ij")], axis=1)
        values = self._functions(where)
        slopes = gradients("hexahedron", mesh.order, mesh.reference, where)
        jacobian = np.einsum("qnb,cna->cqab", slopes, mesh.points[mesh.cells])
        change = np.einsum("qnb,cna->cqab", slopes, displacement[mesh.cells])
        F = np.eye(3) + change @ np.linalg.inv(jacobian)
        parameters = np.einsum("qn,cnp->cqp", values, self.cell_parameters)
        stress = np.empty_like(F)
        laws = [(b, law) for b, body in enumerate(self.model.bodies) for law in body.laws]
        rods = np.empty(len(mesh.cells), dtype=np.int64)
        for k, (b, law) in enumerate(laws):
            (cells,) = np.nonzero(self.place == k)
            if not cells.size:
                continue
            rods[cells] = b
            axis = self.model.bodies[b].space.axis
            low, high = axis.breaks[[0, -1]]
            u = parameters[cells, :, 2]
            u[u > high] -= high - low
            parameters[cells, :, 2] = u
            stress[cells] = law.placed(on_rod(self.model.bodies[b].space.rod, parameters[cells])).stress(F[cells])
        cauchy = np.einsum("cqaA,cqbA->cqab", stress, F) / determinant(F)[..., None, None]
        return {
            "stress_parameters": parameters.reshape(-1, 3),
            "stress_rod": np.repeat(rods, len(where)),
            "stress_points": np.einsum("qn,cna->cqa", values, mesh.points[mesh.cells]).reshape(-1, 3),
            "von_mises": von_mises(cauchy).ravel(),
        }
