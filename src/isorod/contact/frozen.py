"""Contact linearised about an equilibrium, its active points kept, on spaces that need not be the same.

Points keep their partners and, as springs, the penalty: the pressure of a point whose gap grows by ``g`` is ``p - eps
g``.  Between curved surfaces sliding changes the gap to second order: where a point moves by ``X`` along a surface
``y`` of curvature ``b`` that tilts by ``n . dy``, it is less by ``n . dy X + b X X / 2`` (P. Wriggers, Computational
Contact Mechanics (2006), chapter 4, at zero gap).

Sticking points have tangential springs of the same stiffness.  Tractions of slipping points keep their direction and
their ratio to the pressure; the tangent is then not symmetric.

Facets of finite element bodies are flat: only the curvature of the rods that they touch counts.  Their nodes are
numbered after those of rods, as by `isorod.contact.operator.ContactOperator`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc
from scipy.sparse import block_diag, csr_matrix, diags, vstack

from isorod.arrays import Array, Index
from isorod.contact.facets import nodes_of, values_of
from isorod.contact.result import ContactResult
from isorod.model.contact import Contact, Cylinder, Sphere
from isorod.model.model import Model

# Section functions smaller than this are taken as zero on a surface.
_NONE = 1e-12

# Step of differences of slopes of surfaces: fraction of an element, and angle.
_STEP = 1e-4

# Stiffness against the mean gap of a cell, in penalties.
_TIGHT = 1e4


class _Case(NamedTuple):
    """A contact of a model, nodes of facets (`isorod.contact.facets.nodes_of`), and positions of all nodes at rest."""

    model: Model
    contact: Contact
    known: Index
    rest: Array


class _Points(NamedTuple):
    """Active points, a row each, and two more rows for each that sticks: the directions along its surface.

    Attributes
    ----------
    gaps, pushes
        Derivatives of the distances from their partners, and directions of their forces, over all degrees of freedom.
    loads, springs, rates
        Forces, stiffnesses, and velocities of obstacles per unit of the load factor.
    cells
        Numbers of the cells, different ones in each direction.
    bent
        Contribution of the curvature of surfaces to the tangent.
    """

    gaps: csr_matrix
    pushes: csr_matrix
    loads: Array
    springs: Array
    rates: Array
    cells: Index
    bent: csr_matrix


class Frozen:
    """Forces and tangent of contacts about an equilibrium, as `isorod.contact.operator.ContactOperator` has them.

    Parameters
    ----------
    model
        Bodies, on any spaces.
    contacts, results
        Contacts, and their results.
    displacement
        The equilibrium on the spaces of the model, that of facets last, shape ``(dofs,)``.
    comm
        The ranks, each of which has a part of the tangent.
    tight
        Hold the mean gaps of cells, as multipliers by cells do (`isorod.statics.contact_policy`).

    Attributes
    ----------
    gaps, springs
        Derivatives of the gaps of active points, rows over all degrees of freedom, and their stiffnesses.
    friction
        True where the tangent is not symmetric, else None.
    beyond, of_rods, rows, columns, values
        As of `isorod.contact.operator.ContactOperator`: each rank has a part of the tangent.
    """

    version = 0

    def __init__(
        self,
        model: Model,
        contacts: Sequence[Contact],
        results: Sequence[ContactResult],
        displacement: Array,
        comm: PETSc.Comm,
        tight: bool = False,
    ) -> None:
        self._start = displacement
        nodes, places = nodes_of(model)
        self.beyond: Index = (3 * nodes[:, None] + np.arange(3)).ravel()
        rest = np.concatenate([*(body.space.positions for body in model.bodies), places])
        pressed = [
            _points(_Case(model, contact, nodes, rest), result, displacement)
            for contact, result in zip(contacts, results, strict=True)
        ]
        self.gaps, self._pushes = (csr_matrix(vstack([points[k] for points in pressed])) for k in range(2))
        self._loads, self.springs, self._rates = (
            np.concatenate([points[k] for points in pressed]) for k in range(2, 5)
        )
        self.friction = True if any((result.slips & (result.pressure > 0.0)).any() for result in results) else None
        stiffness = self._pushes.T @ self.gaps.multiply(self.springs[:, None])
        for points in pressed:
            stiffness = stiffness + points.bent + (_tight(points) if tight else 0.0 * points.bent)
        self._stiffness = csr_matrix(stiffness)
        self._pressed = pressed
        entries = self._stiffness.tocoo()
        self.rows, self.columns = entries.row.astype(np.int64), entries.col.astype(np.int64)
        mine = np.arange(entries.nnz) % comm.getSize() == comm.getRank()
        self.values = np.where(mine, entries.data, 0.0)
        self.of_rods = np.maximum(self.rows, self.columns) < model.dofs

    @property
    def cells(self) -> csr_matrix:
        """Matrix from gaps of active points to mean gaps of cells, times the root of the cell's stiffness."""
        return csr_matrix(block_diag([_cells(points) for points in self._pressed]))

    @property
    def means(self) -> csr_matrix:
        """The same, from all degrees of freedom."""
        return csr_matrix(vstack([_means(points) for points in self._pressed]))

    def place(self, factor: float) -> None:
        """Do nothing: obstacles stay where they are."""

    def push(self) -> float:
        """Return zero: forces of obstacles that move are among the forces."""
        return 0.0

    def forces(self, displacement: Array) -> tuple[Array, float]:
        """Return the forces on all degrees of freedom, those of facets last, and zero energy."""
        moved = displacement - self._start
        return np.asarray(self._pushes.T @ self._loads - self._stiffness @ moved), 0.0

    def tangent(self, displacement: Array) -> Array:
        """Return ``values``, minus the derivatives of the forces at ``rows`` and ``columns``."""
        return self.values

    def give(self, motions: Array) -> tuple[Array, Array]:
        """Return bounds of the compliance of tight contact in motions ``(m, dofs)``.

        Returns
        -------
        within, besides : (m,)
            Twice the energy of the springs, which is zero if all points were held, and the part that is added if
            springs also carried the mean forces of cells.
        """
        within, besides = np.zeros(len(motions)), np.zeros(len(motions))
        for points in self._pressed:
            gaps, means = points.gaps @ motions.T, _means(points)
            within += points.springs @ gaps**2
            # Tight springs carry the mean forces.
            besides += np.sum((_TIGHT * (means @ motions.T)) ** 2, axis=0)
        return within, besides

    def work(self, displacement: Array) -> Array:
        """Return the work of each point's force on the motion of its obstacle."""
        pressed = self._loads - self.springs * (self.gaps @ (displacement - self._start))
        return np.asarray(pressed * self._rates)


def _points(case: _Case, result: ContactResult, displacement: Array) -> _Points:
    """Return the active points of a contact about a displacement ``(dofs,)`` of a model."""
    contact = case.contact
    here = result.pressure > 0.0
    normals, areas, cells = result.normals[here], result.areas[here], result.cells[here]
    sliding = _sliding(case, result)
    directions, which = [normals], [np.arange(normals.shape[0])]
    sticks = np.flatnonzero(contact.friction > 0.0 and ~result.slips[here])
    if sticks.size:
        aside = np.eye(3)[np.abs(normals[sticks]).argmin(axis=1)]
        first = np.cross(normals[sticks], aside)
        first /= np.linalg.norm(first, axis=1)[:, None]
        directions += [first, np.cross(normals[sticks], first)]
        which += [sticks, sticks]
    along, rows = np.concatenate(directions), np.concatenate(which)
    number = np.repeat(np.arange(len(which)), [each.size for each in which])
    tractions = result.tractions[here]
    loads = np.concatenate([result.pressure[here], np.sum(along * tractions[rows], axis=1)[normals.shape[0] :]])
    pushing = along.copy()
    slips = np.flatnonzero(result.slips[here])
    pushing[slips] += tractions[slips] / result.pressure[here][slips, None]
    rates = np.zeros_like(normals)
    if contact.motion is not None:
        rates = contact.motion.rates(result.positions[here])
    force = np.where(np.isin(np.arange(normals.shape[0]), sticks), 0.0, areas * result.pressure[here])
    return _Points(
        _along(sliding[rows], along),
        _along(sliding[rows], pushing),
        areas[rows] * loads,
        result.penalty * areas[rows],
        np.sum(pushing * rates[rows], axis=1),
        cells[rows] + (cells.max(initial=0) + 1) * number,
        _bent(case, result, displacement, sliding, force),
    )


def _cells(points: _Points) -> csr_matrix:
    """Return sums over the points of cells of the springs' forces, over the root of the cell's stiffness."""
    numbers, cell = np.unique(points.cells, return_inverse=True)
    sums = csr_matrix((points.springs, (cell, np.arange(cell.size))), shape=(numbers.size, cell.size))
    total = np.asarray(sums.sum(axis=1)).ravel()
    return csr_matrix(diags(1.0 / np.sqrt(total)) @ sums)


def _means(points: _Points) -> csr_matrix:
    """Return mean gaps of cells, rows over all degrees of freedom, times the root of the cell's stiffness."""
    return csr_matrix(_cells(points) @ points.gaps)


def _tight(points: _Points) -> csr_matrix:
    """Return the stiffness against mean gaps of cells."""
    means = _means(points)
    return csr_matrix(_TIGHT * (means.T @ means))


def _bent(case: _Case, result: ContactResult, displacement: Array, sliding: csr_matrix, loads: Array) -> csr_matrix:
    """Return the contribution of curvature to the tangent, where points slide under loads ``(m,)``.

    ``sliding`` gives their displacements relative to those of their partners, rows over all nodes.
    """
    here = result.pressure > 0.0
    normals, bodies, projections = result.normals[here], result.partners[here], result.projections[here]
    obstacle = case.contact.obstacle
    if isinstance(obstacle, Cylinder | Sphere):
        directions = [np.cross(normals, _axis(obstacle, normals))]
        if isinstance(obstacle, Sphere):
            directions.append(np.cross(normals, directions[0]))
        units = [direction / np.linalg.norm(direction, axis=1)[:, None] for direction in directions]
        rows = csr_matrix(vstack([_along(sliding, unit) for unit in units]))
        return csr_matrix(rows.T @ rows.multiply(-np.tile(loads, len(directions))[:, None] / obstacle.radius))
    if obstacle is not None:
        return csr_matrix((case.rest.size, case.rest.size))
    places = case.rest + displacement.reshape(-1, 3)
    slopes = [_functions(case, bodies, projections, k) for k in range(2)]
    y = np.stack([slope @ places for slope in slopes], axis=1)
    second = np.stack([_slope_change(case, bodies, projections, k, places) for k in range(2)], axis=1)
    bend = np.einsum("mabi,mi->mab", 0.5 * (second + second.swapaxes(1, 2)), normals)
    dual = np.einsum("mab,mbi->mai", np.linalg.inv(np.einsum("mai,mbi->mab", y, y)), y)
    moves = [_along(sliding, dual[:, k]) for k in range(2)]
    tilts = [_along(slope, normals) for slope in slopes]
    total = csr_matrix((case.rest.size, case.rest.size))
    for k in range(2):
        mixed = moves[k].T @ tilts[k].multiply(loads[:, None])
        total = total + mixed + mixed.T
        for j in range(2):
            total = total + moves[k].T @ moves[j].multiply((loads * bend[:, k, j])[:, None])
    return csr_matrix(total)


def _axis(obstacle: Cylinder | Sphere, normals: Array) -> Array:
    """Return for each normal the axis of a cylinder, or any direction that is not parallel to the normal."""
    if isinstance(obstacle, Cylinder):
        axis = np.array(obstacle.axis, dtype=float)
        return np.broadcast_to(axis if obstacle.motion is None else obstacle.motion.at(1.0)[0] @ axis, normals.shape)
    return np.eye(3)[np.abs(normals).argmin(axis=1)]


def _slope_change(case: _Case, bodies: Index, projections: Array, which: int, places: Array) -> Array:
    """Return derivatives of both slopes of surfaces by axis parameter (0) or angle (1), shape ``(m, 2, 3)``."""
    ends = np.zeros((2, bodies.size, 2))
    for b, body in enumerate(case.model.bodies):
        here, breaks = bodies == b, body.space.axis.breaks
        step = _STEP * (np.diff(breaks).min() if which == 0 else 1.0)
        for side, end in zip((-1.0, 1.0), ends, strict=True):
            end[here] = projections[here]
            end[here, which] += side * step
            end[here, 0] = np.clip(end[here, 0], breaks[0], breaks[-1])
    slopes = [np.stack([_functions(case, bodies, end, k) @ places for k in range(2)], axis=1) for end in ends]
    length = ends[1, :, which] - ends[0, :, which]
    return np.asarray((slopes[1] - slopes[0]) / np.where(length > 0.0, length, 1.0)[:, None, None])


def _sliding(case: _Case, result: ContactResult) -> csr_matrix:
    """Return displacements of active points relative to their partners, rows over all nodes, for each component."""
    here = result.pressure > 0.0
    if result.on_facets:
        own = values_of(case.model, case.contact, case.known, result.pressure.size)[here]
    else:
        own = _functions(case, result.body[here], result.parameters[here])
    return csr_matrix(own - _functions(case, result.partners[here], result.projections[here]))


def _along(functions: csr_matrix, directions: Array) -> csr_matrix:
    """Return rows over all degrees of freedom: components in directions ``(m, 3)`` of fields given by functions."""
    entries = functions.tocoo()
    rows, columns = np.repeat(entries.row, 3), (3 * entries.col[:, None].astype(np.int64) + np.arange(3)).ravel()
    values = (entries.data[:, None] * directions[entries.row]).ravel()
    return csr_matrix((values, (rows, columns)), shape=(functions.shape[0], 3 * functions.shape[1]))


def _functions(case: _Case, bodies: Index, places: Array, slope: int | None = None) -> csr_matrix:
    """Return the functions of nodes at points of surfaces, rows over all nodes.

    Parameters
    ----------
    case
        Which surfaces touch.
    bodies, places
        Body of each point, -1 where it is an obstacle's, its axis parameter and its angle, shapes ``(m,)``, ``(m, 2)``.
    slope
        Take derivatives by the axis parameter (0) or the angle (1).
    """
    model, contact = case.model, case.contact
    values, rows, columns = [np.empty(0)], [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for b, body in enumerate(model.bodies):
        here, space = np.flatnonzero(bodies == b), body.space
        if not here.size:
            continue
        u, angle = places[here].T
        disk = contact.disk_radius(b, space.rod) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        across, gradients = space.basis.functions(disk)
        if slope == 1:
            across = np.einsum("qia,qa->qi", gradients, np.stack([-disk[:, 1], disk[:, 0]], axis=1))
        first, *along = space.axis.local(u)
        axial = along[1 if slope == 0 else 0]
        layers = (first[:, None] + np.arange(axial.shape[1])) % space.layers
        nodes = int(model.first_node[b]) + layers[:, :, None] * space.layer_nodes + np.arange(across.shape[1])
        entries = axial[:, :, None] * across[:, None, :]
        kept = np.broadcast_to(np.abs(across[:, None, :]) > _NONE, entries.shape)
        values.append(entries[kept])
        rows.append(np.broadcast_to(here[:, None, None], entries.shape)[kept])
        columns.append(nodes[kept])
    triplets = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return csr_matrix(triplets, shape=(bodies.size, len(case.rest)))
