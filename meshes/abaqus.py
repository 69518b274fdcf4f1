"""Meshes in the words of Abaqus, which CalculiX and others read: nodes, elements, and sets and surfaces of both."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from isorod.errors import InputError
from meshes.mesh import Array, Index, Mesh

_CUBE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], dtype=float)
_CUBE_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
# Corners of the sides S1, S2 ... of an element.
_CUBE_SIDES = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))

_SIMPLEX = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=float)
_SIMPLEX_EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
_SIMPLEX_SIDES = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))


class Element(NamedTuple):
    """The order of the mesh that an element is made of, the places of its nodes in the reference cell, its sides."""

    order: int
    nodes: Array
    sides: Sequence[Sequence[int]]


def _with_edges(corners: Array, edges: Sequence[tuple[int, int]]) -> Array:
    return np.concatenate([corners, *([0.5 * (corners[a] + corners[b])] for a, b in edges)])


_LINEAR = Element(1, _CUBE, _CUBE_SIDES)
_QUADRATIC = Element(2, _with_edges(_CUBE, _CUBE_EDGES), _CUBE_SIDES)
ELEMENTS = {
    "C3D20R": _QUADRATIC,
    "C3D20": _QUADRATIC,
    "C3D8I": _LINEAR,
    "C3D8": _LINEAR,
    "C3D8R": _LINEAR,
    "C3D4": Element(1, _SIMPLEX, _SIMPLEX_SIDES),
    "C3D10": Element(2, _with_edges(_SIMPLEX, _SIMPLEX_EDGES), _SIMPLEX_SIDES),
}

# Of bricks by the order of the mesh: that which was nearest at equal cost in CalculiX.
BRICKS = {2: "C3D20R", 1: "C3D8I"}

# The sets of all nodes and all elements.
ALL_NODES, ALL_ELEMENTS = "NALL", "EALL"

# Numbers in a line of a list, and terms in one of an equation.
_IN_LINE, _TERMS = 10, 4


def name_of(name: str) -> str:
    """Return a name of a mesh as that of a set: ``rod 0 start`` is ``ROD_0_START``."""
    return re.sub(r"[^A-Za-z0-9]+", "_", name).upper()


def lines(
    mesh: Mesh, element: str, sets: Mapping[str, Index] | None = None, nodes: int = 0, cells: int = 0
) -> tuple[str, Index]:
    """Return the lines of a mesh as elements of one kind, and the number of each node in them, 0 where left out.

    Sets of nodes and surfaces are named as the faces are, sets of elements as the regions.  Of a 27-node brick those on
    its faces and in its middle are left out: the 20-node brick's own polynomials go through the others.

    Parameters
    ----------
    mesh
        The mesh.
    element
        One of `ELEMENTS`.
    sets
        More sets of elements, cell numbers by name.
    nodes, cells
        Numbers of nodes and elements that are in the file already.

    Raises
    ------
    InputError
        If the element is not one of this order.
    """
    kind = ELEMENTS[element]
    if mesh.order != kind.order:
        raise InputError(f"element {element}: got a mesh of order {mesh.order}, need {kind.order}")
    places = [int(np.argmin(np.linalg.norm(mesh.reference - place, axis=1))) for place in kind.nodes]
    own = mesh.cells[:, places]
    used = np.unique(own)
    number = np.zeros(len(mesh.points), dtype=np.int64)
    number[used] = np.arange(nodes + 1, nodes + used.size + 1)
    lines = [f"*NODE,NSET={ALL_NODES}"]
    # CalculiX reads the first 20 characters of a number: more digits would cut an exponent.
    lines += [f"{k},{x:.12g},{y:.12g},{z:.12g}" for k, (x, y, z) in enumerate(mesh.points[used].tolist(), nodes + 1)]
    lines.append(f"*ELEMENT,TYPE={element},ELSET={ALL_ELEMENTS}")
    for k, cell in enumerate(number[own].tolist(), cells + 1):
        lines += _wrapped([k, *cell])
    for name, which in {**mesh.regions, **(sets or {})}.items():
        lines += _set_of_elements(name_of(name), which + cells + 1)
    sides = own[:, np.array(kind.sides)]
    for name, faces in mesh.faces.items():
        lines += set_of_nodes(name_of(name), np.unique(number[faces]))
        lines.append(f"*SURFACE,NAME={name_of(name)},TYPE=ELEMENT")
        lines += [f"{cells + cell + 1},S{side + 1}" for cell, side in _sides(faces, sides)]
    return "\n".join(lines), number


def set_of_nodes(name: str, numbers: Index) -> list[str]:
    """Return the lines of a set of nodes by their numbers, those without one left out."""
    return [f"*NSET,NSET={name}", *_wrapped(numbers[numbers > 0].tolist(), comma=True)]


def equation(terms: Sequence[str]) -> Iterator[str]:
    """Yield the lines of an equation of terms ``node,component,coefficient``, of which the first is given by others."""
    yield from ["*EQUATION", str(len(terms))]
    yield from (",".join(terms[k : k + _TERMS]) for k in range(0, len(terms), _TERMS))


def _set_of_elements(name: str, which: Index) -> list[str]:
    if np.array_equal(which, np.arange(which[0], which[-1] + 1)):
        return [f"*ELSET,ELSET={name},GENERATE", f"{which[0]},{which[-1]}"]
    return [f"*ELSET,ELSET={name}", *_wrapped(which.tolist(), comma=True)]


def _sides(faces: Index, sides: Index) -> list[list[int]]:
    """Return the cell and its side that each face is, of all nodes of faces and corners ``(cells, sides, corners)``."""
    ends = np.sort(sides, axis=-1)
    corners = np.unique(sides)
    # Other nodes of a face are corners of no cell.
    mine = np.sort(faces[np.isin(faces, corners)].reshape(len(faces), -1), axis=1)
    rows = np.concatenate([mine, ends.reshape(-1, ends.shape[-1])])
    _, number = np.unique(rows, axis=0, return_inverse=True)
    number = number.ravel()
    place = np.empty(number.max() + 1, dtype=np.int64)
    place[number[len(mine) :]] = np.arange(len(rows) - len(mine))
    return np.stack(np.divmod(place[number[: len(mine)]], ends.shape[1]), axis=1).tolist()


def _wrapped(numbers: list[int], comma: bool = False) -> Iterator[str]:
    """Yield lines of a list; one that goes on ends in a comma, as all lines of a set may."""
    for k in range(0, len(numbers), _IN_LINE):
        more = comma or k + _IN_LINE < len(numbers)
        yield ",".join(map(str, numbers[k : k + _IN_LINE])) + ("," if more else "")
