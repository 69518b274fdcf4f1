"""Pairs of surfaces in an input file: ties, contacts, and the rigid obstacles that rods touch."""

from itertools import combinations

import numpy as np

from isorod.contact.defaults import penalty
from isorod.errors import InputError
from isorod.model.contact import Contact, Cylinder, Plane
from isorod.model.model import Model
from isorod.model.moving import ObstacleMotion
from isorod.model.tie import EndFace, LateralSurface, Tie
from meshes import cuts, nodal
from meshes.mesh import Array, Index, Mesh, lexicographic

# A tie's nodes may be as far from the master as its own extent, times this, where no gap is given: isorod has refused
# what is too far.
_GAP = 0.5

# Half the width of the block that is a plane, in sizes of the rods that touch it, and its height.
_WIDE, _HIGH = 2.0, 0.2

# Bricks of the second degree round a cylinder.
_ROUND = 72

# Points nearer to a cylinder, a fraction of its radius, touch it; and the smallest arc, radians.  Of a rope round
# half a drum (the example drum) the first increments diverge, or become 1/400 of the whole: with surface to surface,
# node to surface and mortar contact, penalties down to a hundredth, overlaps and gaps at rest, increments of 1 %.
_TOUCHES, _ARC = 1e-3, 0.5


def surface_of(model: Model, mesh: Mesh, surface: EndFace | LateralSurface) -> tuple[str, Index]:
    """Return the facets of a rod's surface that is tied, and the name of the face that they are all of, if any."""
    name = f"rod {surface.body} {surface.which if isinstance(surface, EndFace) else nodal.SURFACES[surface.surface]}"
    if isinstance(surface, EndFace) or surface.along is None:
        return name, mesh.faces[name]
    space = model.bodies[surface.body].space
    return "", within(mesh, surface.body, name, *cuts.between(space, surface), float(space.axis.breaks[-1]))


def within(mesh: Mesh, rod: int, name: str, low: float, high: float, end: float) -> Index:
    """Return the faces of a rod's surface between two axis parameters, of which that of its end is the last."""
    faces = mesh.faces[name]
    u = mesh.parameters_in(rod, faces)[..., 2]
    # The last layer of a closed rod ends in nodes of the start.
    last = np.ptp(u, axis=1, keepdims=True) > 0.5 * (end - u.min())
    middle = np.where(last & (u == u.min()), end, u).mean(axis=1)
    return faces[(middle > low) & (middle < high)]


def tied(tie: Tie, title: str, slave: str, master: str, extent: float) -> list[str]:
    """Return the lines of a tie of two surfaces, the slave's of that extent, a length."""
    if tie.kind != "weld":
        what = {"slide": "slides", "mean": "ties means"}[tie.kind]
        raise InputError(f"{title}: CalculiX has no tie that {what}; kind = 'weld' is written")
    far = tie.gap if tie.gap is not None else _GAP * extent
    return [f"*TIE,NAME={title},ADJUST=YES,POSITION TOLERANCE={far:.6g}", f"{slave},{master}"]


def area(mesh: Mesh, faces: Index) -> float:
    """Return the area of faces, by the quadrilaterals or triangles of their corners."""
    if mesh.shape == "tetrahedron":
        places = mesh.points[faces[:, [0, 1, 2, 2]]]
    elif len(mesh.face_reference):
        side = mesh.order + 1
        places = mesh.points[faces[:, [0, side - 1, side * side - 1, side * (side - 1)]]]
    else:
        places = mesh.points[faces[:, :4]]
    across = np.cross(places[:, 2] - places[:, 0], places[:, 3] - places[:, 1])
    return float(0.5 * np.linalg.norm(across, axis=1).sum())


def pairs(contact: Contact) -> tuple[list[tuple[int, int]], list[int]]:
    """Return the pairs of rods that a contact is of, slave first, and the rods that it lets touch themselves."""
    first, *other = contact.groups
    if other:
        return [(a, b) for a in first for b in other[0]], []
    if contact.second is None:
        return [*combinations(first, 2)], [*first]
    return [(a, -1) for a in first], []


def interaction(contact: Contact, model: Model, title: str) -> list[str]:
    """Return the lines of a contact's interaction: a pressure for each depth, and friction."""
    stiff = penalty(model, contact)
    lines = [f"*SURFACE INTERACTION,NAME={title}", "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR", f"{stiff:.12g}"]
    return lines + (["*FRICTION", f"{contact.friction:.12g},{stiff:.12g}"] if contact.friction else [])


def moved(contact: Contact, title: str, factor: float) -> list[str]:
    """Return the displacements of an obstacle at a load factor, of one that turns those of its two nodes."""
    several = {title: np.zeros(3)}
    if contact.motion is not None:
        track = contact.motion.track
        now = np.array([np.interp(factor, track[:, 0], column) for column in track.T[1:]])
        several = {title: now[:3]}
        if track[:, 4].any():
            several = {f"{title}_PLACE": now[:3], f"{title}_ROTATION": now[3] * contact.motion.direction}
    return [f"{name},{k + 1},{k + 1},{own[k]:.12g}" for name, own in several.items() for k in range(3)]


def turning(motion: ObstacleMotion, title: str, last: int) -> list[str]:
    """Return the nodes that an obstacle moves and turns with, behind so many nodes.

    What the second one has as displacements are components of the rotation.  Its RF are none of a moment: those of a
    torque of friction were 7 % off.
    """
    place = ",".join(f"{one:.12g}" for one in motion.middle)
    return [
        f"*NODE,NSET={title}_PLACE",
        f"{last + 1},{place}",
        f"*NODE,NSET={title}_ROTATION",
        f"{last + 2},{place}",
        f"*RIGID BODY,ELSET={title}_BRICKS,REF NODE={last + 1},ROT NODE={last + 2}",
    ]


def obstacle(contact: Contact, points: Array, name: str) -> Mesh:
    """Return bricks of that name in the place of a rigid obstacle that points ``(n, 3)`` may touch, and their face.

    The set of nodes of the face is that of all nodes of these bricks.
    """
    body = contact.obstacle
    centre, size = points.mean(axis=0), float(np.linalg.norm(np.ptp(points, axis=0)))
    if isinstance(body, Plane):
        return _block(np.array(body.point), np.array(body.normal), centre, size, name)
    if isinstance(body, Cylinder):
        if contact.friction and _laid(body, points):
            raise InputError(
                f"{name}: with friction a rod that lies round a cylinder at rest is not written to .inp: CalculiX' "
                "steps do not converge from there; let it be laid, as by a support that moves"
            )
        return _round(np.array(body.point), np.array(body.axis), body.radius, points, name)
    raise InputError(f"{type(body).__name__} as an obstacle is not written to .inp; Plane and Cylinder are")


def _laid(cylinder: Cylinder, points: Array) -> bool:
    """Return whether points touch a cylinder on an arc of it."""
    axis = np.array(cylinder.axis) / np.linalg.norm(cylinder.axis)
    rest = points - np.array(cylinder.point)
    rest -= np.outer(rest @ axis, axis)
    distance = np.linalg.norm(rest, axis=1)
    near = rest[distance < (1.0 + _TOUCHES) * cylinder.radius]
    return len(near) > 0 and bool((near @ near[0]).min() < np.cos(_ARC) * cylinder.radius**2)


def _round(point: Array, axis: Array, radius: float, points: Array, name: str) -> Mesh:
    """Return a ring of bricks round an axis, wide enough for rods in contact to move along that."""
    axis = axis / np.linalg.norm(axis)
    across = np.linalg.svd(axis[None])[2][1:]
    frame = np.stack([across[0], np.cross(axis, across[0]), axis])
    along, size = (points - point) @ axis, float(np.linalg.norm(np.ptp(points, axis=0)))
    reference = lexicographic(2, 3)
    # Numbers of nodes in a cell: from the hollow out, round, along.
    out, around, up = np.rint(2.0 * reference).astype(np.int64).T
    count = 2 * _ROUND
    cells = (2 * np.arange(_ROUND)[:, None] + around) % count + count * (out + 3 * up)
    angle = np.tile(2.0 * np.pi * np.arange(count) / count, 9)
    distance = np.tile(np.repeat(radius * np.array([1.0 - _HIGH, 1.0 - 0.5 * _HIGH, 1.0]), count), 3)
    height = np.repeat(along.mean() + size * np.array([-_WIDE, 0.0, _WIDE]), 3 * count)
    places = np.stack([distance * np.cos(angle), distance * np.sin(angle), height], axis=1)
    return Mesh(
        "hexahedron",
        2,
        point + places @ frame,
        cells,
        reference,
        {name: cells[:, out == 2]},
        lexicographic(2, 2),
        regions={f"{name} bricks": np.arange(_ROUND)},
    )


def _block(point: Array, normal: Array, centre: Array, size: float, name: str) -> Mesh:
    """Return a brick whose upper face is a plane."""
    normal = normal / np.linalg.norm(normal)
    across = np.linalg.svd(normal[None])[2][1:]
    frame = np.stack([*across, normal])
    if np.linalg.det(frame) < 0.0:
        frame[:2] = frame[1::-1]
    place = centre + normal * (normal @ (point - centre))
    reference = lexicographic(1, 3)
    scaled = (reference - (0.5, 0.5, 1.0)) * size * (2.0 * _WIDE, 2.0 * _WIDE, _HIGH)
    top = np.flatnonzero(reference[:, 2] == 1.0)
    cells = np.arange(8)[None]
    return Mesh(
        "hexahedron",
        1,
        place + scaled @ frame,
        cells,
        reference,
        {name: top[None]},
        lexicographic(1, 2),
        regions={f"{name} bricks": np.arange(1)},
    )
