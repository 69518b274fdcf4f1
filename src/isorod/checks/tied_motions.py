"""Rigid motions of what ties weld together: rods and solids that move as one."""

from typing import NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.model.model import Model
from isorod.model.tie import SolidSurface

# A motion counts as free if it moves what is held by less than this share of its size.
_TOLERANCE = 1e-8


class Group(NamedTuple):
    """Numbers of the rods and of the solids that are tied to each other."""

    bodies: list[int]
    solids: list[int]


def groups(model: Model) -> list[Group]:
    """Return what is tied together, each once, rods that no tie names alone."""
    count = len(model.bodies)
    leader = list(range(count + len(model.solids)))

    def root(k: int) -> int:
        while leader[k] != k:
            k = leader[k]
        return k

    for tie in model.ties:
        first, second = (
            root(count + one.solid if isinstance(one, SolidSurface) else one.body) for one in (tie.slave, tie.master)
        )
        leader[max(first, second)] = min(first, second)
    roots = [root(k) for k in range(len(leader))]
    return [
        Group(*([k - shift for k in range(*ends) if roots[k] == one] for ends, shift in _ranges(count, len(leader))))
        for one in sorted(set(roots))
    ]


def _ranges(bodies: int, total: int) -> list[tuple[tuple[int, int], int]]:
    return [((0, bodies), 0), ((bodies, total), bodies)]


def free_motions(model: Model, group: Group, displacement: Array | None = None) -> list[tuple[int, Array]]:
    """Return the rigid motions that nothing holds, of a group as those of its first rod's nodes ``(nodes, 3)``."""
    rows, shapes = [], {}
    space = model.bodies[group.bodies[0]].space
    center = space.positions[space.is_carrier].mean(axis=0)
    for b in group.bodies:
        space = model.bodies[b].space
        places = space.positions if displacement is None else space.positions + model.nodal(displacement, b)
        arms = (places - space.is_carrier[:, None] * center) / model.size
        shapes[b] = motions(arms, space.is_carrier)
        free = model.free[3 * model.first_node[b] : 3 * model.first_node[b + 1]]
        rows.append(shapes[b][free < 0])
        # What tied components move apart.
        _, first, unknown = np.unique(free, return_index=True, return_inverse=True)
        apart = (free >= 0) & (first[unknown] != np.arange(free.size))
        rows.append((shapes[b] - shapes[b][first[unknown]])[apart])
    for k in group.solids:
        solid = model.solids[k]
        own = motions((solid.positions - center) / model.size, np.ones(len(solid.positions), dtype=bool))
        held = own[solid.held[0] - 3 * solid.owned[0]]
        rows.append(np.concatenate(solid.comm.allgather(held)))
    kept = np.concatenate(rows)
    triangle = np.linalg.qr(kept, mode="r") if kept.size else np.zeros((1, 6))
    _, sizes, turns = np.linalg.svd(triangle, full_matrices=True)
    full = np.zeros(6)
    full[: sizes.size] = sizes
    first_rod = group.bodies[0]
    return [(first_rod, (shapes[first_rod] @ turns[k]).reshape(-1, 3)) for k in np.flatnonzero(full < _TOLERANCE)]


def spread(model: Model, body: int, motion: Array) -> tuple[Array, list[Array]]:
    """Return a rigid motion of a rod's nodes ``(nodes, 3)`` as that of its whole group.

    Returns
    -------
    rods : (dofs,)
    solids
        Of each solid's degrees of freedom on this rank.
    """
    group = next(one for one in groups(model) if body in one.bodies)
    space = model.bodies[body].space
    of_body = motions(space.positions, space.is_carrier)
    amounts = np.linalg.lstsq(of_body, motion.ravel(), rcond=None)[0]
    rods = np.zeros(model.dofs)
    for b in group.bodies:
        space = model.bodies[b].space
        model.nodal(rods, b)[:] = (motions(space.positions, space.is_carrier) @ amounts).reshape(-1, 3)
    solids = []
    for k, solid in enumerate(model.solids):
        moved = motions(solid.positions, np.ones(len(solid.positions), dtype=bool)) @ amounts
        solids.append(moved if k in group.solids else 0.0 * moved)
    return rods, solids


def motions(places: Array, carriers: "np.ndarray[tuple[int], np.dtype[np.bool_]]") -> Array:
    """Return the six infinitesimal rigid motions of nodes at places ``(nodes, 3)``, shape ``(3 nodes, 6)``."""
    columns = np.zeros((len(places), 3, 6))
    for a in range(3):
        columns[carriers, a, a] = 1.0
        b, c = (a + 1) % 3, (a + 2) % 3
        columns[:, b, 3 + a], columns[:, c, 3 + a] = -places[:, c], places[:, b]
    return columns.reshape(-1, 6)
