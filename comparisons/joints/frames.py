"""Many rods welded: a ring of a stent, and a lattice of cells, beside finite elements of them as one solid.

``python -m comparisons.joints.frames stent`` prints frequencies of the free ring, ``lattice CELLS ...`` how stiff
blocks of so many cells in each direction are in shear, and what that costs a rod; with ``--one SIZE ...`` beside
tetrahedra of these sizes.
"""

import argparse
import json
from collections.abc import Sequence
from time import perf_counter, process_time
from typing import Any, NamedTuple

import gmsh
import numpy as np
from numpy.typing import NDArray

import isorod
from comparisons.fem.rods import solve as solve_bricks
from comparisons.fem.statics import Held
from comparisons.joints import whole
from comparisons.joints.scene import by_gmsh, volumes
from comparisons.joints.whole import ROD, Problem, Whole
from isorod import LinearElastic, Space, Tie, modal, statics
from isorod.model import Body, Model, Support
from isorod.model.tie import EndFace, LateralSurface
from isorod.space import choice
from meshes import rods as bricks

Array = NDArray[np.float64]

LAW = LinearElastic(1000.0, 0.3)

# The ring: struts, radius of the cylinder that their middles are on, half height, radius of wire and of bends.
STRUTS, RADIUS, HALF, WIRE, BEND = 24, 6.0, 1.5, 0.12, 0.3

# The lattice: side of a cell, radii of the columns, which go through, and of the struts between them.
CELL, COLUMN, STRUT = 10.0, 1.0, 0.6

# How far the top moves sideways.
_SHEAR = 1e-3


class Frame(NamedTuple):
    """Rods and the ties between them; struts end within the columns, their rims on the surface."""

    spaces: Sequence[Space]
    ties: Sequence[Tie]


def _zigzag() -> Array:
    """Return the corners of the ring, on its cylinder."""
    angle = 2.0 * np.pi * np.arange(STRUTS) / STRUTS
    up = HALF * (-1.0) ** np.arange(STRUTS)
    return np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), up], axis=1)


def stent(**space: Any) -> Frame:
    """Return the ring, of a rod for each bend, welded end on end amid the struts."""
    corners = _zigzag()
    middles = 0.5 * (corners + np.roll(corners, 1, axis=0))
    section = isorod.circle(8, WIRE)
    spaces = []
    for k in range(STRUTS):
        corner_points = np.array([middles[k], corners[k], middles[(k + 1) % STRUTS]])
        spaces.append(Space(isorod.polyline(corner_points, fillet=BEND).sweep(section), **space))
    ties = [Tie(EndFace((k + 1) % STRUTS, "start"), EndFace(k, "end")) for k in range(STRUTS)]
    return Frame(spaces, ties)


def frequencies(frame: Frame, count: int) -> Array:
    """Return the lowest frequencies of a free frame that are not zero."""
    return np.asarray(modal.solve(_model(frame, density=1.0), count).frequencies)[-count:]


def frequencies_of_bricks(count: int, level: int) -> tuple[Array, int]:
    """Return the same of bricks of the closed ring, and their unknowns."""
    rod = isorod.polyline(_zigzag(), fillet=BEND, closed=True).sweep(isorod.circle(8, WIRE))
    model = Model([Body(Space(rod), LAW, 1.0)])
    solution = solve_bricks(model, bricks.build([rod], level, 2), "modal", count)
    return np.asarray(solution.frequencies)[-count:], solution.dofs


def lattice(cells: int, **space: Any) -> Frame:
    """Return a block of cells: columns along z at all corners, struts along x and y between them on all levels.

    Columns have short elements where struts are tied, as those of files, unless spaces are given.
    """
    every, high = range(cells + 1), CELL * cells + 2.0 * COLUMN
    levels = [(COLUMN + CELL * level) / high for level in every]
    spaces: list[Space] = []
    column: dict[tuple[int, int], int] = {}
    for i in every:
        for j in every:
            column[i, j] = len(spaces)
            rod = isorod.straight(high, start=(CELL * i, CELL * j, -COLUMN)).sweep(isorod.circle(8, COLUMN))
            own = space or {"knots": choice.boundary_layers(rod, None, levels)}
            spaces.append(Space(rod, **own))
    ties = []
    inside = np.sqrt(COLUMN**2 - STRUT**2)
    pairs = [(at, to) for at in column for to in ((at[0] + 1, at[1]), (at[0], at[1] + 1)) if to in column]
    for at, to in pairs:
        start, end = (CELL * np.array([*one, 0.0]) for one in (at, to))
        along = inside * (end - start) / CELL
        for level in every:
            up = np.array([0.0, 0.0, CELL * level])
            line = isorod.straight(start=start + along + up, end=end - along + up)
            for which, one in (("start", at), ("end", to)):
                ties.append(Tie(EndFace(len(spaces), which), LateralSurface(column[one])))
            spaces.append(Space(line.sweep(isorod.circle(8, STRUT)), **space))
    return Frame(spaces, ties)


def sheared(frame: Frame, cells: int) -> statics.Equilibrium:
    """Return the equilibrium of a lattice whose columns are held below, and moved sideways above."""
    supports = []
    for k in range((cells + 1) ** 2):
        supports.append(Support.end(frame.spaces[k], "start", body=k))
        supports.append(Support.end(frame.spaces[k], "end", displacement=(_SHEAR, 0.0, 0.0), body=k))
    return statics.solve(_model(frame, supports))


def _model(frame: Frame, supports: Sequence[Support] = (), density: float = 0.0) -> Model:
    return Model([Body(space, LAW, density) for space in frame.spaces], list(supports), ties=list(frame.ties))


def as_one(cells: int, size: float) -> Whole:
    """Return the lattice as one solid of curved tetrahedra, of that size where flanks meet and up to four times that.

    At these edges stresses are singular: with cells of one size errors fall as the size alone.
    """

    def make() -> str:
        occ, every = gmsh.model.occ, range(cells + 1)
        high = CELL * cells + 2.0 * COLUMN
        cylinders = [
            (3, occ.addCylinder(CELL * i, CELL * j, -COLUMN, 0, 0, high, COLUMN)) for i in every for j in every
        ]
        for level in every:
            for j in every:
                # Struts in a line are one cylinder: what is within the columns is theirs already.
                cylinders.append((3, occ.addCylinder(0, CELL * j, CELL * level, CELL * cells, 0, 0, STRUT)))
                cylinders.append((3, occ.addCylinder(CELL * j, 0, CELL * level, 0, CELL * cells, 0, STRUT)))
        occ.fuse(cylinders[:1], cylinders[1:])
        occ.synchronize()
        volumes({ROD: [tag for _, tag in gmsh.model.getEntities(3)]})
        # Seams are of one face, the edges of ends of a plane one too.
        sides = {edge: gmsh.model.getAdjacencies(1, edge)[0] for _, edge in gmsh.model.getEntities(1)}
        edges = [
            edge
            for edge, faces in sides.items()
            if len(faces) == 2 and all(gmsh.model.getType(2, face) == "Cylinder" for face in faces)
        ]
        away = gmsh.model.mesh.field.add("Distance")
        gmsh.model.mesh.field.setNumbers(away, "CurvesList", edges)
        gmsh.model.mesh.field.setNumber(away, "NumPointsPerCurve", 2 * int(np.ceil(2.0 * np.pi * STRUT / size)))
        return f"Min({4.0 * size},{size}+0.5*F{away})"

    mesh, tags = by_gmsh(make, True)
    low = whole.facets(mesh, lambda x: x[2] < 1e-6 - COLUMN)
    return Whole(mesh, tags, {"low": low, "high": whole.facets(mesh, lambda x: x[2] > CELL * cells + COLUMN - 1e-6)})


PROBLEM = Problem({ROD: LAW}, [Held("low"), Held("high", (_SHEAR, 0.0, 0.0))])


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("frame", choices=("stent", "lattice"))
    parser.add_argument("cells", type=int, nargs="*")
    parser.add_argument("--one", type=float, nargs="*", default=[], help="sizes of tetrahedra")
    parser.add_argument("--levels", type=int, nargs="*", default=[1, 2], help="of the ring's bricks")
    parser.add_argument("--space", type=json.loads, default={}, help="options of the rods' spaces, as JSON")
    given = parser.parse_args()
    options = given.space
    if given.frame == "stent":
        for _ in range(2):
            frame = stent(**options)
            start = perf_counter(), process_time()
            values = frequencies(frame, 6)
            print("rods", 3 * sum(one.nodes for one in frame.spaces), values, *_since(start), flush=True)
        for level in given.levels:
            start = perf_counter(), process_time()
            values, unknowns = frequencies_of_bricks(6, level)
            print("bricks", level, unknowns, values, *_since(start), flush=True)
        return
    for cells in given.cells:
        frame = lattice(cells, **options)
        for _ in range(2):
            start = perf_counter(), process_time()
            solution = sheared(frame, cells)
            took = _since(start)
        force = float(solution.reactions[1::2, 0].sum())
        count = len(frame.spaces)
        unknowns = 3 * sum(space.nodes for space in frame.spaces)
        print(
            "lattice",
            cells,
            count,
            len(frame.ties),
            unknowns,
            force,
            took,
            took[1] / count,
            solution.seconds,
            flush=True,
        )
        for size in given.one:
            mesh = as_one(cells, size)
            start = perf_counter(), process_time()
            solid = whole.solve(mesh, PROBLEM)
            print("one solid", size, solid.unknowns, solid.reactions[1, 0], *_since(start), flush=True)


def _since(start: tuple[float, float]) -> tuple[float, float]:
    return perf_counter() - start[0], process_time() - start[1]


if __name__ == "__main__":
    main()
