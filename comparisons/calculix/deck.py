"""Input files of CalculiX: nodes, elements and faces of a `Mesh`, and the step that is asked for."""

from collections.abc import Iterator, Sequence

import numpy as np

from isorod.errors import InputError
from meshes.mesh import Index, Mesh

_CUBE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], dtype=float)
_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))

# Elements by name: the order of the mesh they are made of.
ELEMENTS = {"C3D20R": 2, "C3D20": 2, "C3D8I": 1, "C3D10": 2}

# Numbers in a line of a list.
_IN_LINE = 10


def body(mesh: Mesh, element: str, material: Sequence[str]) -> tuple[str, int]:
    """Return the lines of a mesh's cells as elements of one kind, of a material, and their number of nodes.

    Node sets are named as the faces are.  Of a 27-node brick those on its faces and in its middle are left out: the
    20-node brick's own polynomials go through the others.
    """
    wanted = _nodes(element)
    places = [int(np.argmin(np.linalg.norm(mesh.reference - place, axis=1))) for place in wanted]
    if mesh.order != ELEMENTS[element]:
        raise InputError(f"element {element}: got a mesh of order {mesh.order}, need {ELEMENTS[element]}")
    cells = mesh.cells[:, places]
    used = np.unique(cells)
    number = np.zeros(len(mesh.points), dtype=np.int64)
    number[used] = np.arange(1, used.size + 1)
    lines = ["*NODE"]
    # CalculiX reads the first 20 characters of a number: more digits would cut an exponent.
    lines += [f"{k},{x:.12g},{y:.12g},{z:.12g}" for k, (x, y, z) in enumerate(mesh.points[used].tolist(), 1)]
    lines.append(f"*ELEMENT,TYPE={element},ELSET=BODY")
    for k, cell in enumerate(number[cells].tolist(), 1):
        lines += _wrapped([k, *cell])
    for name, faces in mesh.faces.items():
        own = np.unique(number[faces])
        lines += [f"*NSET,NSET={name.upper()}", *_wrapped(own[own > 0].tolist(), comma=True)]
    lines += ["*MATERIAL,NAME=LAW", *material, "*SOLID SECTION,ELSET=BODY,MATERIAL=LAW"]
    return "\n".join(lines), int(used.size)


def _nodes(element: str) -> np.ndarray:
    """Return the places of an element's nodes in the reference cell, in CalculiX' order."""
    if element == "C3D10":
        corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=float)
        edges: Sequence[tuple[int, int]] = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
    else:
        corners, edges = _CUBE, _EDGES if ELEMENTS[element] == 2 else ()
    return np.concatenate([corners, *([0.5 * (corners[a] + corners[b])] for a, b in edges)])


def _wrapped(numbers: Index | list[int], comma: bool = False) -> Iterator[str]:
    """Yield lines of a list; one that goes on ends in a comma, as all lines of a set may."""
    for k in range(0, len(numbers), _IN_LINE):
        more = comma or k + _IN_LINE < len(numbers)
        yield ",".join(map(str, numbers[k : k + _IN_LINE])) + ("," if more else "")


def pulled(pull: float, solver: str) -> str:
    """Return the step of large displacements that moves the face ``end`` by ``pull`` along z, ``start`` held."""
    return "\n".join(
        [
            "*STEP,NLGEOM",
            f"*STATIC,SOLVER={solver},DIRECT",
            "1.,1.",
            "*BOUNDARY",
            "START,1,3,0.",
            "END,1,2,0.",
            f"END,3,3,{pull:.12g}",
            "*NODE PRINT,NSET=START,TOTALS=ONLY",
            "RF",
            "*NODE PRINT,NSET=END,TOTALS=ONLY",
            "RF",
            "*END STEP",
        ]
    )


def vibrating(modes: int, solver: str) -> str:
    """Return the step that asks for the lowest modes with the face ``start`` held."""
    return "\n".join(["*BOUNDARY", "START,1,3,0.", "*STEP", f"*FREQUENCY,SOLVER={solver}", str(modes), "*END STEP"])


# Reads the model, and stops: what it takes is no part of solving.
NOTHING = "*STEP\n*NO ANALYSIS\n*END STEP"
