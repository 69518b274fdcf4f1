"""Contact as it is in an equilibrium, linear about it: what presses where, on spaces that need not be the same.

Points keep their partners and, as springs, the penalty: one whose gap grows by ``g`` presses by ``p - eps g``.  Of
curved surfaces a gap grows also with the square of what slides: where a point moves by ``X`` along a surface ``y`` that
is bent by ``b``, and that tilts by ``n . dy``, it is less by ``n . dy X + b X X / 2`` (P. Wriggers, Computational
Contact Mechanics (2006), chapter 4, where there is no gap).

Points that stick hang on springs of the same stiffness along the surface.  Tractions of those that slip keep their
direction and their share of the pressure; the tangent is then not symmetric.

Facets of finite element bodies are flat: what curvature adds is that of the rods that they touch.  Their nodes are
numbered behind those of rods, as by `isorod.contact.operator.ContactOperator`.
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

# Section functions below that are none on a surface.
_NONE = 1e-12

# Share of an element, and angle, by which slopes of surfaces are differentiated.
_STEP = 1e-4

# Stiffness against what all points of a cell do together, in penalties.
_TIGHT = 1e4


class _Case(NamedTuple):
    """A contact of a model, the nodes of facets (`isorod.contact.facets.nodes_of`), and where all nodes are at rest."""

    model: Model
    contact: Contact
    known: Index
    rest: Array


class _Points(NamedTuple):
    """Points that are pressed, a row each, and two more of each that sticks: the directions along its surface.

    Attributes
    ----------
    gaps, pushes
        How far they go from their partners, and how their forces act, over all degrees of freedom.
    loads, springs, ways
        Forces, stiffnesses, and how fast obstacles move, a unit of the load factor.
    cells
        Numbers of the cells, other ones in each direction.
    bent
        What the curvature of surfaces adds to the tangent.
    """

    gaps: csr_matrix
    pushes: csr_matrix
    loads: Array
    springs: Array
    ways: Array
    cells: Index
    bent: csr_matrix


class Frozen:
    """Forces and tangent of contacts about an equilibrium, as `isorod.contact.operator.ContactOperator` has them.

    Parameters
    ----------
    model
        Bodies, on any spaces.
    contacts, results
        Contacts, and their outcome.
    displacement
        The equilibrium on the spaces of the model, that of facets behind it, shape ``(dofs,)``.
    comm
        The ranks, each of which has a share of the tangent.
    tight
        Let penalties give way within cells alone, as multipliers by cells leave them (`isorod.statics.contact_policy`).

    Attributes
    ----------
    gaps, springs
        How far pressed points go from their partners, rows over all degrees of freedom, and their stiffnesses.
    friction
        True where the tangent is not symmetric, else None.
    beyond, of_rods, rows, columns, values
        As of `isorod.contact.operator.ContactOperator`: the tangent has a share on each rank.
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
        found = [
            _points(_Case(model, contact, nodes, rest), one, displacement)
            for contact, one in zip(contacts, results, strict=True)
        ]
        self.gaps, self._pushes = (csr_matrix(vstack([one[k] for one in found])) for k in range(2))
        self._loads, self.springs, self._ways = (np.concatenate([one[k] for one in found]) for k in range(2, 5))
        self.friction = True if any((one.slips & (one.pressure > 0.0)).any() for one in results) else None
        stiffness = self._pushes.T @ self.gaps.multiply(self.springs[:, None])
        for one in found:
            stiffness = stiffness + one.bent + (_tight(one) if tight else 0.0 * one.bent)
        self._stiffness = csr_matrix(stiffness)
        self._found = found
        entries = self._stiffness.tocoo()
        self.rows, self.columns = entries.row.astype(np.int64), entries.col.astype(np.int64)
        mine = np.arange(entries.nnz) % comm.getSize() == comm.getRank()
        self.values = np.where(mine, entries.data, 0.0)
        self.of_rods = np.maximum(self.rows, self.columns) < model.dofs

    @property
    def cells(self) -> csr_matrix:
        """What mean gaps of cells are of those of pressed points, times the root of the cell's stiffness."""
        return csr_matrix(block_diag([_cells(one) for one in self._found]))

    @property
    def means(self) -> csr_matrix:
        """The same of all degrees of freedom."""
        return csr_matrix(vstack([_means(one) for one in self._found]))

    def place(self, factor: float) -> None:
        """Leave obstacles where they are."""

    def push(self) -> float:
        """Return what obstacles that move press: it is among the forces."""
        return 0.0

    def forces(self, displacement: Array) -> tuple[Array, float]:
        """Return the forces on all degrees of freedom, those of facets behind the others, and no energy."""
        moved = displacement - self._start
        return np.asarray(self._pushes.T @ self._loads - self._stiffness @ moved), 0.0

    def tangent(self, displacement: Array) -> Array:
        """Return ``values``, minus the derivatives of the forces at ``rows`` and ``columns``."""
        return self.values

    def give(self, motions: Array) -> tuple[Array, Array]:
        """Return, of tight contact, how sure it is how much it gives way in motions ``(m, dofs)``.

        Returns
        -------
        within, besides : (m,)
            Twice the energy of the springs, which is none if all points were held, and what it would be besides if
            springs bore the mean forces of cells too.
        """
        within, besides = np.zeros(len(motions)), np.zeros(len(motions))
        for one in self._found:
            gaps, means = one.gaps @ motions.T, _means(one)
            within += one.springs @ gaps**2
            # Mean forces are what the tight springs bear.
            besides += np.sum((_TIGHT * (means @ motions.T)) ** 2, axis=0)
        return within, besides

    def work(self, displacement: Array) -> Array:
        """Return the work of each point's force on the way that its obstacle moves."""
        pressed = self._loads - self.springs * (self.gaps @ (displacement - self._start))
        return np.asarray(pressed * self._ways)


def _points(case: _Case, one: ContactResult, displacement: Array) -> _Points:
    """Return the pressed points of a contact about a displacement ``(dofs,)`` of a model."""
    contact = case.contact
    here = one.pressure > 0.0
    normals, areas, cells = one.normals[here], one.areas[here], one.cells[here]
    sliding = _sliding(case, one)
    directions, which = [normals], [np.arange(normals.shape[0])]
    sticks = np.flatnonzero(contact.friction > 0.0 and ~one.slips[here])
    if sticks.size:
        aside = np.eye(3)[np.abs(normals[sticks]).argmin(axis=1)]
        first = np.cross(normals[sticks], aside)
        first /= np.linalg.norm(first, axis=1)[:, None]
        directions += [first, np.cross(normals[sticks], first)]
        which += [sticks, sticks]
    along, rows = np.concatenate(directions), np.concatenate(which)
    number = np.repeat(np.arange(len(which)), [one.size for one in which])
    tractions = one.tractions[here]
    loads = np.concatenate([one.pressure[here], np.sum(along * tractions[rows], axis=1)[normals.shape[0] :]])
    pushing = along.copy()
    slips = np.flatnonzero(one.slips[here])
    pushing[slips] += tractions[slips] / one.pressure[here][slips, None]
    ways = np.zeros_like(normals)
    if contact.motion is not None:
        ways = contact.motion.rates(one.positions[here])
    force = np.where(np.isin(np.arange(normals.shape[0]), sticks), 0.0, areas * one.pressure[here])
    return _Points(
        _along(sliding[rows], along),
        _along(sliding[rows], pushing),
        areas[rows] * loads,
        one.penalty * areas[rows],
        np.sum(pushing * ways[rows], axis=1),
        cells[rows] + (cells.max(initial=0) + 1) * number,
        _bent(case, one, displacement, sliding, force),
    )


def _cells(one: _Points) -> csr_matrix:
    """Return sums over the points of cells of the springs' forces, over the root of the cell's stiffness."""
    numbers, cell = np.unique(one.cells, return_inverse=True)
    sums = csr_matrix((one.springs, (cell, np.arange(cell.size))), shape=(numbers.size, cell.size))
    total = np.asarray(sums.sum(axis=1)).ravel()
    return csr_matrix(diags(1.0 / np.sqrt(total)) @ sums)


def _means(one: _Points) -> csr_matrix:
    """Return mean gaps of cells, rows over all degrees of freedom, times the root of the cell's stiffness."""
    return csr_matrix(_cells(one) @ one.gaps)


def _tight(one: _Points) -> csr_matrix:
    """Return the stiffness against mean gaps of cells."""
    means = _means(one)
    return csr_matrix(_TIGHT * (means.T @ means))


def _bent(case: _Case, one: ContactResult, displacement: Array, sliding: csr_matrix, loads: Array) -> csr_matrix:
    """Return what the curvature of surfaces adds to the tangent, where points slide under loads ``(m,)``.

    ``sliding`` has their displacements less those of their partners, rows over all nodes.
    """
    here = one.pressure > 0.0
    normals, bodies, projections = one.normals[here], one.partners[here], one.projections[here]
    obstacle = case.contact.obstacle
    if isinstance(obstacle, Cylinder | Sphere):
        ways = [np.cross(normals, _axis(obstacle, normals))]
        if isinstance(obstacle, Sphere):
            ways.append(np.cross(normals, ways[0]))
        rows = csr_matrix(vstack([_along(sliding, way / np.linalg.norm(way, axis=1)[:, None]) for way in ways]))
        return csr_matrix(rows.T @ rows.multiply(-np.tile(loads, len(ways))[:, None] / obstacle.radius))
    if obstacle is not None:
        return csr_matrix((case.rest.size, case.rest.size))
    places = case.rest + displacement.reshape(-1, 3)
    slopes = [_functions(case, bodies, projections, k) for k in range(2)]
    y = np.stack([one @ places for one in slopes], axis=1)
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
    """Return, of each normal, the axis of a cylinder, or any direction that is not along it."""
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
    found = [np.stack([_functions(case, bodies, end, k) @ places for k in range(2)], axis=1) for end in ends]
    length = ends[1, :, which] - ends[0, :, which]
    return np.asarray((found[1] - found[0]) / np.where(length > 0.0, length, 1.0)[:, None, None])


def _sliding(case: _Case, one: ContactResult) -> csr_matrix:
    """Return how pressed points move less their partners do, rows over all nodes, the same for each component."""
    here = one.pressure > 0.0
    if one.on_facets:
        own = values_of(case.model, case.contact, case.known, one.pressure.size)[here]
    else:
        own = _functions(case, one.body[here], one.parameters[here])
    return csr_matrix(own - _functions(case, one.partners[here], one.projections[here]))


def _along(functions: csr_matrix, directions: Array) -> csr_matrix:
    """Return rows over all degrees of freedom: how far what functions say of nodes goes in directions ``(m, 3)``."""
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
        round_it = contact.disk_radius(b, space.rod) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        across, gradients = space.basis.functions(round_it)
        if slope == 1:
            across = np.einsum("qia,qa->qi", gradients, np.stack([-round_it[:, 1], round_it[:, 0]], axis=1))
        first, *along = space.axis.local(u)
        ahead = along[1 if slope == 0 else 0]
        layers = (first[:, None] + np.arange(ahead.shape[1])) % space.layers
        nodes = int(model.first_node[b]) + layers[:, :, None] * space.layer_nodes + np.arange(across.shape[1])
        entries = ahead[:, :, None] * across[:, None, :]
        kept = np.broadcast_to(np.abs(across[:, None, :]) > _NONE, entries.shape)
        values.append(entries[kept])
        rows.append(np.broadcast_to(here[:, None, None], entries.shape)[kept])
        columns.append(nodes[kept])
    every = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return csr_matrix(every, shape=(bodies.size, len(case.rest)))
