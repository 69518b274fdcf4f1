"""Rigid motions of what ties weld together: rods and solids that move as one."""

from typing import NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.assembly.constraints import trace_of
from isorod.errors import InputError, SolveError
from isorod.model.model import Model
from isorod.model.tie import SolidSurface, Surface, Tie
from isorod.tensors import motions_of

# A motion counts as free if it moves what is held by less than this share of its size.
_TOLERANCE = 1e-8


class Group(NamedTuple):
    """Numbers of the rods and of the solids that are tied to each other."""

    bodies: list[int]
    solids: list[int]


def groups(model: Model, welds: bool = False) -> list[Group]:
    """Return what is tied together, rods that no tie names alone; of ``welds`` but for what slides freely."""
    count = len(model.bodies)
    leader = list(range(count + len(model.solids)))

    def root(k: int) -> int:
        while leader[k] != k:
            k = leader[k]
        return k

    for tie in model.ties:
        if welds and _slides(tie):
            continue
        first, second = (
            root(count + one.solid if isinstance(one, SolidSurface) else one.body) for one in (tie.slave, tie.master)
        )
        leader[max(first, second)] = min(first, second)
    roots = [root(k) for k in range(len(leader))]
    members = ([k for k in range(len(leader)) if roots[k] == one] for one in sorted(set(roots)))
    return [Group([k for k in one if k < count], [k - count for k in one if k >= count]) for one in members]


def _slides(tie: Tie) -> bool:
    """Return whether nothing resists that the surfaces of a tie slide on each other."""
    return tie.kind == "slide" and not tie.bond


def free_motions(model: Model, displacement: Array | None = None) -> list[tuple[int, Array]]:
    """Return the rigid motions that nothing holds, each as that of the nodes of a rod ``(nodes, 3)`` that it moves.

    Raises
    ------
    SolveError
        If one moves solids alone.
    """
    parts = groups(model, welds=True)
    part_of = {("body", b): k for k, part in enumerate(parts) for b in part.bodies}
    part_of |= {("solid", s): k for k, part in enumerate(parts) for s in part.solids}
    found = []
    for group in groups(model):
        mine = sorted({part_of["body", b] for b in group.bodies} | {part_of["solid", s] for s in group.solids})
        columns = {k: slice(6 * n, 6 * n + 6) for n, k in enumerate(mine)}
        size, center = _frame(model, group)
        rows, shapes = [np.zeros((1, 6 * len(mine)))], {}

        def add(k: int, kept: Array, columns: dict[int, slice] = columns, rows: list[Array] = rows) -> None:
            wide = np.zeros((len(kept), rows[0].shape[1]))
            wide[:, columns[k]] = kept
            rows.append(wide)

        for b in group.bodies:
            space = model.bodies[b].space
            places = space.positions if displacement is None else space.positions + model.nodal(displacement, b)
            shapes[b] = motions_of((places - space.is_carrier[:, None] * center) / size, space.is_carrier)
            free = model.free[3 * model.first_node[b] : 3 * model.first_node[b + 1]]
            add(part_of["body", b], shapes[b][free < 0])
            # What tied components move apart.
            _, first, unknown = np.unique(free, return_index=True, return_inverse=True)
            apart = (free >= 0) & (first[unknown] != np.arange(free.size))
            add(part_of["body", b], (shapes[b] - shapes[b][first[unknown]])[apart])
        for s in group.solids:
            solid = model.solids[s]
            own = motions_of((solid.positions - center) / size, np.ones(len(solid.positions), dtype=bool))
            held = own[solid.held[0] - 3 * solid.owned[0]]
            add(part_of["solid", s], np.concatenate(solid.comm.allgather(held)))
        for tie in model.ties:
            sides = [part_of[_key(one)] for one in (tie.slave, tie.master)]
            if _slides(tie) and sides[0] in columns:
                along = _normal_motions(model, tie, center, size)
                wide = np.zeros((len(along), 6 * len(mine)))
                wide[:, columns[sides[0]]] += along
                wide[:, columns[sides[1]]] -= along
                rows.append(wide)
        triangle = np.linalg.qr(np.concatenate(rows), mode="r")
        _, sizes, turns = np.linalg.svd(triangle, full_matrices=True)
        full = np.zeros(6 * len(mine))
        full[: sizes.size] = sizes
        for turn in turns[full < _TOLERANCE]:
            moving = [b for b in group.bodies if np.abs(turn[columns[part_of["body", b]]]).max() > _TOLERANCE]
            if not moving:
                raise SolveError("supports: a solid is free to move as a rigid body; add a condition")
            found.append((moving[0], (shapes[moving[0]] @ turn[columns[part_of["body", moving[0]]]]).reshape(-1, 3)))
    return found


def _key(surface: Surface) -> tuple[str, int]:
    return ("solid", surface.solid) if isinstance(surface, SolidSurface) else ("body", surface.body)


def _frame(model: Model, group: Group) -> tuple[float, Array]:
    """Return size and middle of a group, about which its motions are measured."""
    if group.bodies:
        space = model.bodies[group.bodies[0]].space
        return model.size, space.positions[space.is_carrier].mean(axis=0)
    return model.size, np.zeros(3)


def _normal_motions(model: Model, tie: Tie, center: Array, size: float) -> Array:
    """Return what each rigid motion moves the points of a tie's slave along its normals, shape ``(q, 6)``."""
    trace = trace_of(model, tie.slave)
    moved = motions_of((trace.points - center) / size, np.ones(len(trace.points), dtype=bool)).reshape(-1, 3, 6)
    return np.asarray(np.einsum("qa,qak->qk", trace.normals, moved))


def spread(model: Model, body: int, motion: Array) -> tuple[Array, list[Array]]:
    """Return a rigid motion of a rod's nodes ``(nodes, 3)`` as that of its whole group.

    Returns
    -------
    rods : (dofs,)
    solids
        Of each solid's degrees of freedom on this rank.
    """
    if any(_slides(tie) for tie in model.ties):
        raise InputError("modes: what slides freely has rigid motions; give the tie a bond, or support the body")
    group = next(one for one in groups(model) if body in one.bodies)
    space = model.bodies[body].space
    of_body = motions_of(space.positions, space.is_carrier)
    amounts = np.linalg.lstsq(of_body, motion.ravel(), rcond=None)[0]
    rods = np.zeros(model.dofs)
    for b in group.bodies:
        space = model.bodies[b].space
        model.nodal(rods, b)[:] = (motions_of(space.positions, space.is_carrier) @ amounts).reshape(-1, 3)
    solids = []
    for k, solid in enumerate(model.solids):
        moved = motions_of(solid.positions, np.ones(len(solid.positions), dtype=bool)) @ amounts
        solids.append(moved if k in group.solids else 0.0 * moved)
    return rods, solids
