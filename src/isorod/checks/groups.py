"""Groups of tied rods and solids, and their rigid motions."""

from typing import NamedTuple

import numpy as np

from isorod.arrays import Array, Index
from isorod.model.model import Model
from isorod.model.tie import SolidSurface, Surface, Tie
from isorod.tensors import motions_of


class Group(NamedTuple):
    """Numbers of the rods and of the solids that are tied to each other."""

    bodies: list[int]
    solids: list[int]

    def has(self, surface: Surface) -> bool:
        """Return whether a surface belongs to the group."""
        if isinstance(surface, SolidSurface):
            return surface.solid in self.solids
        return surface.body in self.bodies


def groups(model: Model, welds: bool = False) -> list[Group]:
    """Return groups of tied bodies, untied rods alone; with ``welds`` ties that slide freely do not count."""
    count = len(model.bodies)
    leader = list(range(count + len(model.solids)))

    def root(k: int) -> int:
        while leader[k] != k:
            k = leader[k]
        return k

    for tie in model.ties:
        if welds and slides(tie):
            continue
        first, second = (
            root(count + side.solid if isinstance(side, SolidSurface) else side.body)
            for side in (tie.slave, tie.master)
        )
        leader[max(first, second)] = min(first, second)
    members: dict[int, list[int]] = {}
    for k in range(len(leader)):
        members.setdefault(root(k), []).append(k)
    return [
        Group([k for k in group if k < count], [k - count for k in group if k >= count])
        for _, group in sorted(members.items())
    ]


def slides(tie: Tie) -> bool:
    """Return whether the surfaces of a tie slide on each other without resistance."""
    return tie.kind == "slide" and not tie.bond


class Motions(NamedTuple):
    """The six infinitesimal rigid motions of a group, orthonormal over all of its nodes.

    Attributes
    ----------
    bodies : dict of (3 nodes, 6)
        Displacements of each rod's nodes, by its number.
    held : (h, 6)
        Displacements of supported degrees of freedom, and relative ones of tied components, of rods and of the solids
        of all ranks.
    center, inverse
        The motions are rotations and translations of positions relative to a centre, times a matrix ``(6, 6)``.
    """

    bodies: dict[int, Array]
    held: Array
    center: Array
    inverse: Array

    def at(self, points: Array) -> Array:
        """Return the displacements of points ``(q, 3)``, shape ``(q, 3, 6)``."""
        moved = motions_of(points - self.center, np.ones(len(points), dtype=bool))
        return np.asarray((moved @ self.inverse).reshape(-1, 3, 6))


def motions_of_group(model: Model, group: Group, displacement: Array | None) -> Motions:
    """Return the rigid motions of a group about a ``displacement`` ``(dofs,)`` of the rods, or at rest."""
    places = {
        b: model.bodies[b].space.positions + (0.0 if displacement is None else model.nodal(displacement, b))
        for b in group.bodies
    }
    control = {b: model.bodies[b].space.is_control_point for b in group.bodies}
    solids = [model.solids[s] for s in group.solids]
    if group.bodies:
        first = group.bodies[0]
        center = places[first][control[first]].mean(axis=0)
    else:
        center = np.concatenate(solids[0].comm.allgather(solids[0].positions)).mean(axis=0)
    raw = {b: motions_of(x - center * control[b][:, None], control[b]) for b, x in places.items()}
    of_solids = [motions_of(solid.positions - center, np.ones(len(solid.positions), dtype=bool)) for solid in solids]
    # Triangular factors have the same inner products.
    triangles = [np.linalg.qr(motions, mode="r") for motions in raw.values()]
    for solid, motions in zip(solids, of_solids, strict=True):
        triangles += solid.comm.allgather(np.linalg.qr(motions, mode="r"))
    inverse = np.linalg.inv(np.linalg.qr(np.concatenate(triangles), mode="r"))
    bodies = {b: motions @ inverse for b, motions in raw.items()}
    held = [np.zeros((0, 6))]
    for b, motions in bodies.items():
        held.append(_held(model.free[3 * model.first_node[b] : 3 * model.first_node[b + 1]], motions))
    for support in model.means.values():
        if support.body in bodies:
            space = model.bodies[support.body].space
            nodes, rows = support.rows(space)
            # Rotations count as displacements at the section's radius.
            sizes = np.append(np.ones(len(support.directions)), np.full(len(support.axes), support.radius(space)))
            moved = bodies[support.body].reshape(-1, 3, 6)[nodes]
            held.append(sizes[:, None] * np.einsum("kna,nam->km", rows, moved))
    for solid, motions in zip(solids, of_solids, strict=True):
        held += solid.comm.allgather(motions[solid.held[0] - 3 * solid.owned[0]] @ inverse)
    return Motions(bodies, np.concatenate(held), center, inverse)


def _held(free: Index, moved: Array) -> Array:
    """Return displacements of a rod's supported degrees of freedom, and relative ones of tied components."""
    _, first, unknown = np.unique(free, return_index=True, return_inverse=True)
    apart = (free >= 0) & (first[unknown] != np.arange(free.size))
    return np.concatenate([moved[free < 0], (moved - moved[first[unknown]])[apart]])
