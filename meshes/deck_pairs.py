"""What joins surfaces in an input file: ties, contacts, and the rigid obstacles that rods touch."""

from itertools import combinations

import numpy as np

from isorod.contact.defaults import penalty
from isorod.errors import InputError
from isorod.model.contact import Contact, Plane
from isorod.model.model import Model
from isorod.model.tie import EndFace, LateralSurface, Tie
from meshes import cuts, nodal
from meshes.mesh import Array, Index, Mesh, lexicographic

# A tie's nodes may be as far from the master as its own extent, times this, where no gap is given: isorod has refused
# what is too far.
_GAP = 0.5

# Half the width of the block that is a plane, in sizes of the rods that touch it, and its height.
_WIDE, _HIGH = 2.0, 0.2


def surface_of(model: Model, mesh: Mesh, one: EndFace | LateralSurface) -> tuple[str, Index]:
    """Return the facets of a rod's surface that is tied, and the name of the face that they are all of, if any."""
    name = f"rod {one.body} {one.which if isinstance(one, EndFace) else nodal.SURFACES[one.surface]}"
    if isinstance(one, EndFace) or one.along is None:
        return name, mesh.faces[name]
    space = model.bodies[one.body].space
    return "", within(mesh, one.body, name, *cuts.between(space, one), float(space.axis.breaks[-1]))


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
    """Return the lines of what acts between surfaces in contact: a pressure for each depth, and friction."""
    stiff = penalty(model, contact)
    lines = [f"*SURFACE INTERACTION,NAME={title}", "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR", f"{stiff:.12g}"]
    return lines + (["*FRICTION", f"{contact.friction:.12g},{stiff:.12g}"] if contact.friction else [])


def moved(contact: Contact, title: str, factor: float) -> list[str]:
    """Return the displacements of an obstacle at a load factor."""
    way = np.zeros(3) if contact.motion is None else contact.motion.at(factor)[1]
    return [f"{title},{k + 1},{k + 1},{way[k]:.12g}" for k in range(3)]


def obstacle(contact: Contact, points: Array, name: str) -> Mesh:
    """Return bricks of that name in the place of a rigid obstacle that points ``(n, 3)`` may touch, and their face.

    The set of nodes of the face is that of all nodes of these bricks.
    """
    one = contact.obstacle
    if contact.motion is not None and (len(contact.motion.track) > 2 or contact.motion.track[:, 4].any()):
        raise InputError("an obstacle that turns or moves along a path is not written to .inp; a shifted one is")
    centre, size = points.mean(axis=0), float(np.linalg.norm(np.ptp(points, axis=0)))
    if isinstance(one, Plane):
        return _block(np.array(one.point), np.array(one.normal), centre, size, name)
    raise InputError(f"{type(one).__name__} as an obstacle is not written to .inp; Plane is")


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
        regions={name: np.arange(1)},
    )
