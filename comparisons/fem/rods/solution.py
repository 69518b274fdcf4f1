"""A finite element solution of rods, evaluated by the same functions as isorod's."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from comparisons.fem.rods.places import on_rod
from isorod.checks import stresses
from isorod.errors import InputError
from isorod.files.solid import OfBody
from isorod.geometry.quadrature import Rule, section_points
from isorod.geometry.rod import Rod
from isorod.model.model import Model
from isorod.model.past import Past
from isorod.output import rotations
from isorod.output.places import parameters
from isorod.output.section_forces import SectionForces, centroids, frames, normals
from isorod.output.state import Deformation
from isorod.output.stress import von_mises
from isorod.statics.path import Step
from isorod.tensors import determinant
from meshes.joined_mesh import Joined
from meshes.mesh import Array, Index, Mesh, gauss, gradients
from meshes.within import Layers, Places, lagrange

# Gradients at the same points of all cells, or at one point of each.
_ALL, _EACH = "qnb,cna->cqab", "cnb,cna->cab"

# Points round a surface at which stresses are compared, wherever cells meet.
_AROUND = 24

# Points of a section, in each of its slices, at which its stresses are summed up.
_SECTION = Rule(6, 4, 1)


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
    pressure
        What ``theta`` of the law (`isorod.material.law.Material`) works against, force / area, where that was unknown:
        at the nodes of each cell, shape ``(cells, nodes per cell)``, NaN elsewhere.
    reactions, moments
        Force and moment of each support on the model, shape ``(supports, 3)``; moments are about the same point as
        those of `isorod.statics.Equilibrium`.
    contacts
        Outcome of each contact.
    bodies
        What holds and loads the model's bodies.
    past
        Equilibria that laws with memory have gone on from, displacements of the mesh's nodes.
    path
        The load steps of these, with the supports' forces.
    ties
        What each tie carries (`comparisons.fem.rods.ties.Carried`).
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
    pressure: Array | None = None
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
    bodies: Sequence[OfBody] = ()
    ties: Sequence[Any] = ()
    past: Sequence[Past] = ()
    path: Sequence[Step] = ()

    @property
    def cells(self) -> int:
        """Number of cells."""
        return len(self.mesh.cells)

    def at(self, rod: int, u: ArrayLike, xi: ArrayLike | None = None) -> Array:
        """Return the displacement at points of a rod, as `isorod.output.state.Deformation.at` does."""
        points, cells, where = self._located(rod, u, xi)
        values = np.einsum("mn,mna->ma", self._functions(where), self._nodal[self.mesh.cells[cells]])
        values = values.reshape(len(points.u), len(points.xi), 3)
        return (values.mean(axis=1) if points.mean else values).reshape(*points.shape, 3)

    def deformation_gradient(self, rod: int, u: ArrayLike, xi: ArrayLike = (0.0, 0.0)) -> Array:
        """Return the deformation gradient at points of a rod, as `isorod.output.state.State` does."""
        points, cells, where = self._located(rod, u, xi)
        return self._gradients(cells, where, _EACH)[0].reshape(*points.shape, 3, 3)

    def stress(self, rod: int, u: ArrayLike, xi: ArrayLike = (0.0, 0.0), kind: str = "cauchy") -> Array:
        """Return the stress at points of a rod, ``"cauchy"`` or ``"pk1"``, as `isorod.output.state.State` does."""
        points, cells, where = self._located(rod, u, xi)
        F, _ = self._gradients(cells, where, _EACH)
        gone = self._gone(cells, where, _EACH)
        values = self._pk1(cells, F[:, None], self._functions(where)[:, None], [one[:, None] for one in gone])[:, 0]
        return (values if kind == "pk1" else _cauchy(values, F)).reshape(*points.shape, 3, 3)

    def energy(self, rod: int) -> float:
        """Return the energy stored in a rod."""
        where, weights = gauss(self.mesh.shape, 2 * self.mesh.order)
        cells = self.mesh.regions[f"rod {rod}"]
        F, jacobian = self._gradients(cells, where, _ALL)
        functions = self._functions(where)
        at = np.einsum("qn,cnp->cqp", functions, self.cell_parameters[cells])
        volumes = weights * determinant(jacobian)
        total = 0.0
        for own, law in self._laws(cells, at, self._gone(cells, where, _ALL)):
            p = self._pressures(cells[own], functions)
            stored = law.energy(F[own])
            if p is not None:
                theta = np.log(determinant(F[own])) if law.logarithmic else np.trace(F[own], axis1=-2, axis2=-1) - 3.0
                stored = law.shear.energy(F[own]) + p * theta - 0.5 / law.lame * p**2
            total += float(np.sum(volumes[own] * stored))
        return total

    def internal_forces(self, cells: Index, where: Array, weights: Array) -> Array:
        """Return the nodal forces ``(nodes, 3)`` of the stress in some cells, by a rule on the reference cell."""
        F, jacobian = self._gradients(cells, where, _ALL)
        stress = self._pk1(cells, F, self._functions(where), self._gone(cells, where, _ALL))
        slopes = gradients(self.mesh.shape, self.mesh.order, self.mesh.reference, where)
        pull = stress @ np.linalg.inv(jacobian).swapaxes(2, 3) * (weights * determinant(jacobian))[:, :, None, None]
        forces = np.zeros_like(self.mesh.points)
        np.add.at(forces, self.mesh.cells[cells], np.einsum("cqab,qnb->cna", pull, slopes))
        return forces

    def section_forces(self, rod: int, u: ArrayLike) -> SectionForces:
        """Return the section forces of a rod, as `isorod.output.state.State` does, from the stress there."""
        space = self.model.bodies[rod].space
        given = parameters(space, u)
        where = given.ravel()
        xi, area = section_points(space.rod.section_points, _SECTION, rings=space.rod.rings)
        rest, jacobian = space.rod.grid(xi, where)
        pull = np.einsum("tqaA,tqA->tqa", self.stress(rod, where, xi, "pk1"), normals(jacobian, area))
        moved = self.deformation_gradient(rod, where, xi) @ jacobian
        places = rest + self.at(rod, where, xi)
        centroid = centroids(places, np.linalg.norm(normals(moved, area), axis=2))
        moment = np.cross(places - centroid[:, None], pull).sum(axis=1)
        results = pull.sum(axis=1), moment, centroid, frames(moved, area)
        return SectionForces(*(one.reshape(*given.shape, *one.shape[1:]) for one in results))

    def rotation(self, rod: int, u: ArrayLike, about: ArrayLike | None = None) -> Array:
        """Return the mean rotation of a section, as `isorod.output.state.Deformation` does, up to half a turn."""
        space = self.model.bodies[rod].space
        where = np.atleast_1d(parameters(space, u))
        xi, area = section_points(space.rod.section_points, _SECTION, rings=space.rod.rings)
        rest, jacobian = space.rod.grid(xi, where)
        weights = np.linalg.norm(normals(jacobian, area), axis=2)[0]
        arms, now = (one - weights @ one / weights.sum() for one in (rest[0], rest[0] + self.at(rod, where, xi)[0]))
        return rotations.of_points(arms, now, weights, None if about is None else rotations.direction("about", about))

    @property
    def _nodal(self) -> Array:
        if self.displacement is None:
            raise InputError("displacement: modes have shapes, and no displacement")
        return self.displacement

    def _located(self, rod: int, u: ArrayLike, xi: ArrayLike | None) -> tuple[Any, Index, Array]:
        """Return points of a rod, and the cell and the reference position of each."""
        # u and xi are checked and interpreted by isorod itself.
        points = Deformation(self.model, np.empty(0))._points(rod, u, xi)
        t, q = len(points.u), len(points.xi)
        if isinstance(self.mesh, Joined):
            grid = self.model.bodies[points.number].space.rod.grid(points.xi, points.u)[0].reshape(-1, 3)
        else:
            grid = np.concatenate([np.tile(points.xi, (t, 1)), np.repeat(points.u, q)[:, None]], axis=1)
        cell, where = self._places(points.number).find(grid)
        return points, self.mesh.regions[f"rod {points.number}"][cell], where

    def _gone(self, cells: Index, where: Array, which: str) -> list[Array]:
        """Return the deformation gradients of each past state."""
        return [self._gradients(cells, where, which, one.displacement)[0] for one in self.past]

    def _gradients(self, cells: Index, where: Array, which: str, nodal: Array | None = None) -> tuple[Array, Array]:
        """Return deformation gradients and ``dx/d`` reference position, at `_ALL` points of cells or at `_EACH`."""
        slopes = gradients(self.mesh.shape, self.mesh.order, self.mesh.reference, where)
        nodes, moved = self.mesh.cells[cells], self._nodal if nodal is None else nodal
        jacobian, change = (np.einsum(which, slopes, one[nodes]) for one in (self.mesh.points, moved))
        return np.eye(3) + change @ np.linalg.inv(jacobian), jacobian

    def _laws(self, cells: Index, parameters: Array, gone: Sequence[Array]) -> Iterator[tuple[Index, Any]]:
        """Yield which of the cells have a law, and the law at their parameters ``(cells, q, 3)``.

        Its state is that after the deformation gradients of the past states.
        """
        laws: list[tuple[Rod | None, Any]] = [(body.space.rod, law) for body in self.model.bodies for law in body.laws]
        laws += [(None, solid.law) for solid in self.model.solids]
        for k, (rod, law) in enumerate(laws):
            (own,) = np.nonzero(self.place[cells] == k)
            if own.size:
                placed = law if rod is None else law.placed(on_rod(rod, parameters[own]))
                for one, F in zip(self.past, gone, strict=True):
                    placed = placed.advanced(F[own], one.factor)
                yield own, placed.reached(1.0)

    def _pk1(self, cells: Index, F: Array, functions: Array, gone: Sequence[Array]) -> Array:
        """Return the first Piola-Kirchhoff stress at points of cells, shape of ``F`` ``(c, q, 3, 3)``.

        Parameters
        ----------
        functions
            Those of the nodes at the points: ``(q, nodes)``, or ``(c, q, nodes)`` where they differ by cell.
        """
        which = "qn,cnp->cqp" if functions.ndim == 2 else "cqn,cnp->cqp"
        stress, parameters = np.empty_like(F), np.einsum(which, functions, self.cell_parameters[cells])
        for own, law in self._laws(cells, parameters, gone):
            p = self._pressures(cells[own], functions if functions.ndim == 2 else functions[own])
            if p is None:
                stress[own] = law.stress(F[own])
            else:
                change = np.linalg.inv(F[own]).swapaxes(-1, -2) if law.logarithmic else np.eye(3)
                stress[own] = law.shear.stress(F[own]) + p[..., None, None] * change
        return stress

    def _pressures(self, cells: Index, functions: Array) -> Array | None:
        """Return the pressures ``(c, q)`` at points of cells of one law; None where there are none."""
        if self.pressure is None or np.isnan(self.pressure[cells[0], 0]):
            return None
        which = "qn,cn->cq" if functions.ndim == 2 else "cqn,cn->cq"
        return np.asarray(np.einsum(which, functions, self.pressure[cells]))

    def _functions(self, where: Array) -> Array:
        return lagrange(self.mesh.order, self.mesh.reference, where)

    def _places(self, rod: int) -> Places | Layers:
        cells = self.mesh.regions[f"rod {rod}"]
        if isinstance(self.mesh, Joined):
            nodes = self.mesh.points[self.mesh.cells[cells]]
            return Places(self.mesh.shape, self.mesh.order, self.mesh.reference, nodes)
        own = self.model.bodies[rod].space.rod
        return Layers(own, self.mesh.order, self.mesh.reference, self.cell_parameters[cells])

    def fields(self) -> dict[str, Array]:
        """Return displacement or shapes at the nodes, and the von Mises stress where it is most exact.

        Returns
        -------
        ``points`` ``(nodes, 3)``, ``parameters`` ``(nodes, 3)`` (``xi_1, xi_2, u``), ``node_rod`` ``(nodes,)``,
        ``cells``, ``weights`` ``(nodes,)`` (volumes) and ``order`` of the mesh, of tetrahedra ``reference`` (of nodes
        of bodies alone the rod is -1 for the first body, and so on, and parameters are their positions);
        ``displacement`` ``(nodes, 3)`` and, at the ``2 x 2 x 2`` Gauss points of every brick or the nodes of every
        tetrahedron, ``stress_parameters`` ``(m, 3)``, ``stress_rod`` ``(m,)``, ``stress_points`` ``(m, 3)`` (at rest)
        and ``von_mises`` ``(m,)``, of the Cauchy stress ``P F^T / det F`` (as `isorod.output.stress` has it for linear
        elastic bodies, too); ``surface_parameters``, ``surface_rod`` and ``surface_von_mises``, the same at surfaces
        (`isorod.checks.stresses`); or ``modes`` ``(modes, nodes, 3)`` with ``x^T M x = 1`` and ``frequencies``.
        """
        mesh = self.mesh
        assert mesh.parameters is not None
        node_rod = np.empty(len(mesh.points), dtype=np.int64)
        where = mesh.parameters.copy()
        for k in range(len(self.model.solids)):
            nodes = mesh.cells[mesh.regions[f"solid {k}"]]
            node_rod[nodes], where[nodes] = -1 - k, mesh.points[nodes]
        for k in reversed(range(len(self.model.bodies))):
            nodes = mesh.cells[mesh.regions[f"rod {k}"]]
            node_rod[nodes], where[nodes] = k, mesh.parameters_in(k, nodes)
        arrays = {
            "points": mesh.points,
            "parameters": where,
            "node_rod": node_rod,
            "cells": mesh.cells,
            "weights": mesh.node_volumes(),
            "order": np.array(mesh.order),
            **({"reference": mesh.reference} if mesh.shape == "tetrahedron" else {}),
        }
        if self.displacement is None:
            return arrays | {"modes": self.shapes, "frequencies": self.frequencies}
        return arrays | {"displacement": self.displacement} | self._stress() | self._surface()

    def _stress(self) -> dict[str, Array]:
        """Return the von Mises stress at Gauss points, of tetrahedra at nodes, and where these are."""
        mesh = self.mesh
        where = gauss("hexahedron", 3)[0] if mesh.shape == "hexahedron" else mesh.reference
        values = self._functions(where)
        every = np.arange(len(mesh.cells))
        F, _ = self._gradients(every, where, _ALL)
        places = np.einsum("qn,cnp->cqp", values, self.cell_parameters)
        stress = self._pk1(every, F, values, self._gone(every, where, _ALL))
        rods = np.full(len(mesh.cells), -1)
        for b, body in enumerate(self.model.bodies):
            rods[mesh.regions[f"rod {b}"]] = b
            low, high = body.space.axis.breaks[[0, -1]]
            u = places[rods == b, :, 2]
            places[rods == b, :, 2] = np.where(u > high, u - (high - low), u)
        return {
            "stress_parameters": places.reshape(-1, 3),
            "stress_rod": np.repeat(rods, len(where)),
            "stress_points": np.einsum("qn,cna->cqa", values, mesh.points[mesh.cells]).reshape(-1, 3),
            "von_mises": von_mises(_cauchy(stress, F)).ravel(),
        }

    def _surface(self) -> dict[str, Array]:
        """Return the von Mises stress at surfaces, where stresses of both methods are compared."""
        rods, parameters, values = [], [], []
        for b, body in enumerate(self.model.bodies):
            u, xi = stresses.away(self.model, b), stresses.around([body.space.rod.rings[k] for k in (0, -1)], _AROUND)
            rods.append(np.full(u.size * len(xi), b))
            parameters.append(np.column_stack([np.tile(xi, (u.size, 1)), np.repeat(u, len(xi))]))
            values.append(von_mises(self.stress(b, u, xi)).ravel() if u.size else np.empty(0))
        return {
            "surface_rod": np.concatenate(rods),
            "surface_parameters": np.concatenate(parameters),
            "surface_von_mises": np.concatenate(values),
        }


def _cauchy(stress: Array, F: Array) -> Array:
    """Return Cauchy's stress of the first Piola-Kirchhoff stress, shape of both."""
    return np.asarray(np.einsum("...aA,...bA->...ab", stress, F) / determinant(F)[..., None, None])
