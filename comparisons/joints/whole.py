"""A rod and the blocks that it is welded to, meshed as one solid: bricks of degree 2 whose columns go on in the blocks.

A section is an O-grid of the rod's circle and rings of quadrilaterals round it, out to the outline of a block; layers
of it along the rod's axis have the cells of the circle, of the rings, or both.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import process_time
from typing import Any, NamedTuple

import dolfinx
import numpy as np
import ufl
from mpi4py import MPI
from numpy.typing import NDArray

from comparisons.fem.statics import DIRECT, NEWTON, Held, Newton, Support, variations
from isorod import Material
from isorod.fenics import compat, stored
from isorod.fenics.flags import FAST
from isorod.options import defaults
from meshes.mesh import lexicographic, match
from meshes.template import Template, blocks, o_grid

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Tags of cells.
ROD, BLOCK = 1, 2

# How much sizes of cells grow with the distance from where they are small.
_GROWTH = 0.5


@dataclass(frozen=True, eq=False)
class Whole:
    """A mesh with tags of its cells and named faces.

    Attributes
    ----------
    mesh
        The dolfinx mesh.
    tags
        `ROD` or `BLOCK` of each of its cells.
    faces
        Facets by name.
    """

    mesh: Any
    tags: Any
    faces: Mapping[str, NDArray[np.int32]]

    def facets(self, name: str) -> NDArray[np.int32]:
        """Return the facets of a face."""
        return self.faces[name]


class Section(NamedTuple):
    """Quadrilaterals of degree 2: nodes ``(n, 2)`` in the plane, cells ``(q, 9)``, and which are of the circle."""

    points: Array
    quads: Index
    inner: NDArray[np.bool_]


def circle(radius: float) -> Callable[[Array], Array]:
    """Return an outline by angle, a circle."""
    return lambda angle: radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def rectangle(half: tuple[float, float]) -> Callable[[Array], Array]:
    """Return an outline by angle, a rectangle with these half sides whose corners are at odd multiples of 45 degrees.

    Between corners angles go evenly along the sides.
    """

    def outline(angle: Array) -> Array:
        side, position = np.divmod(angle + 0.25 * np.pi, 0.5 * np.pi)
        along = position / (0.25 * np.pi) - 1.0
        corner = np.stack([np.ones_like(along), along], axis=1)
        turned = np.stack([-corner[:, 1], corner[:, 0]], axis=1)
        quarter = np.mod(np.rint(side), 4)[:, None]
        square = np.select([quarter == 0, quarter == 1, quarter == 2], [corner, turned, -corner], -turned)
        return np.asarray(square * np.array(half))

    return outline


def section(
    radius: float, around: int, rings: int, outline: Callable[[Array], Array], near: float, far: float
) -> Section:
    """Return the section of a rod in a block.

    Parameters
    ----------
    radius
        Of the rod.
    around, rings
        Cells round the circle, a multiple of 4, and rings of its O-grid.
    outline
        Of the block, by angle.
    near, far
        Sizes of the rings between circle and outline, at the circle and away from it.
    """
    disk: Template = o_grid(around, rings)
    rim = disk.rim[:, :-1].ravel()
    angle = np.arctan2(disk.points[rim, 1], disk.points[rim, 0])
    edge = outline(angle)
    width = float(np.linalg.norm(edge - radius * disk.points[rim], axis=1).mean())
    fraction = spaced((0.0, width), far, (near, None))[1:, None, None] / width
    points = (1.0 - fraction) * radius * disk.points[rim] + fraction * edge
    number = np.concatenate([rim[None], len(disk.points) + np.arange(points[..., 0].size).reshape(-1, rim.size)])
    rest = blocks(np.concatenate([number, number[:, :1]], axis=1).T, 2)
    inner = np.repeat([True, False], [len(disk.quads), len(rest)])
    nodes = np.concatenate([radius * disk.points, points.reshape(-1, 2)])
    return Section(nodes, np.concatenate([disk.quads, rest]), inner)


def spaced(ends: tuple[float, float], far: float, near: tuple[float | None, float | None] = (None, None)) -> Array:
    """Return nodes ``(2 cells + 1,)`` of cells of degree 2 between two ends.

    Parameters
    ----------
    far
        Size of the cells away from the ends, at most.
    near
        That at either end where it is smaller.
    """
    low, high = ends
    t = np.linspace(low, high, 2001)
    size = np.full(t.size, far)
    for small, distance in zip(near, (t - low, high - t), strict=True):
        if small is not None:
            size = np.minimum(size, small + _GROWTH * distance)
    passed = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (1.0 / size[1:] + 1.0 / size[:-1]))])
    count = max(1, int(np.ceil(passed[-1] - 0.1)))
    corners = np.interp(np.linspace(0.0, passed[-1], count + 1), passed, t)
    return np.sort(np.concatenate([corners, 0.5 * (corners[1:] + corners[:-1])]))


class Layers(NamedTuple):
    """So many layers of cells along the axis.

    Attributes
    ----------
    along : (2 layers + 1,)
        Places of their nodes.
    inner, outer
        Tag of the cells of the circle and of the rings, 0 for none.
    """

    along: Array
    inner: int
    outer: int


def bricks(cut: Section, layers: Sequence[Layers], place: Callable[[float, Array], Array]) -> tuple[Any, Any]:
    """Return a dolfinx mesh of bricks and the tags of its cells.

    Parameters
    ----------
    cut
        The section.
    layers
        Along the axis; each begins where the one before ends.
    place
        Positions ``(n, 3)`` of the section's nodes at a place along the axis.
    """
    along = np.concatenate([layers[0].along, *(one.along[1:] for one in layers[1:])])
    points = np.concatenate([place(float(t), cut.points) for t in along])
    cells, tags, first = [], [], 0
    for part in layers:
        count = (part.along.size - 1) // 2
        tag = np.where(cut.inner, part.inner, part.outer)
        quads = cut.quads[tag > 0]
        numbers = len(cut.points) * (first + 2 * np.arange(count)[:, None] + np.arange(3))
        cells.append((numbers[:, None, :, None] + quads[:, None]).reshape(-1, 27))
        tags.append(np.tile(tag[tag > 0], count))
        first += 2 * count
    used, every = np.unique(np.concatenate(cells), return_inverse=True)
    order = match(lexicographic(2, 3), compat.reference_nodes("hexahedron", 2))
    mesh = compat.create_mesh(
        MPI.COMM_SELF, every.reshape(-1, 27)[:, order].astype(np.int64), points[used], "hexahedron", 2
    )
    own = np.concatenate(tags)[compat.original_cells(mesh)].astype(np.int32)
    return mesh, dolfinx.mesh.meshtags(mesh, 3, np.arange(own.size, dtype=np.int32), own)


def facets(mesh: Any, on: Callable[[Array], Any]) -> NDArray[np.int32]:
    """Return the exterior facets all of whose corners ``(3, m)`` fulfil a condition."""
    mesh.topology.create_connectivity(2, 3)
    return np.asarray(dolfinx.mesh.locate_entities_boundary(mesh, 2, on), dtype=np.int32)


@dataclass(frozen=True)
class Problem:
    """A problem of a solid.

    Parameters
    ----------
    laws
        By tag.
    held
        Supports on named faces.
    force
        In all on the face ``"pulled"``, or nothing.
    """

    laws: Mapping[int, Material]
    held: Sequence[Held]
    force: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Solution:
    """A solution.

    Attributes
    ----------
    reactions : (supports, 3)
        Force of each support on the solid.
    moved : (3,)
        Mean displacement of the face ``"pulled"``; NaN without a force.
    unknowns
        Degrees of freedom, held ones among them.
    seconds
        Of the processor, without the mesh and the compilation of forms.
    """

    reactions: Array
    moved: Array
    unknowns: int
    seconds: float


def solve(whole: Whole, problem: Problem, options: Mapping[str, object] | None = None, degree: int = 2) -> Solution:
    """Return the equilibrium, in one load step.

    Parameters
    ----------
    options
        Of PETSc; MUMPS if not given.
    degree
        Of the displacement.
    """
    start = process_time()
    mesh = whole.mesh
    space = compat.function_space(mesh, compat.element(mesh, "Lagrange", degree, 3))
    state = dolfinx.fem.Function(space)
    begun = process_time()
    is_bricks = str(mesh.topology.cell_name()) == "hexahedron"
    rule = {"quadrature_degree": 2 * degree if is_bricks else max(1, 2 * degree - 2)}
    dx = ufl.Measure("dx", domain=mesh, subdomain_data=whole.tags, metadata=rule)
    F = ufl.Identity(3) + ufl.grad(state)
    energy: Any = 0.0
    for tag, law in problem.laws.items():
        given = [dolfinx.fem.Constant(mesh, one) for one in stored.constants_of(law)]
        values = dict(zip(law.stored.constants, given, strict=True))
        energy += stored.density(law.stored.expression, F, values) * dx(tag)
    pull, area = None, np.nan
    if problem.force is not None:
        on = np.sort(whole.faces["pulled"])
        marks = dolfinx.mesh.meshtags(mesh, 2, on, np.ones(on.size, dtype=np.int32))
        ds = ufl.Measure("ds", domain=mesh, subdomain_data=marks)(1)
        area = dolfinx.fem.assemble_scalar(compat.form(dolfinx.fem.Constant(mesh, 1.0) * ds, FAST))
        energy -= ufl.inner(dolfinx.fem.Constant(mesh, np.array(problem.force) / area), state) * ds
        pull = [compat.form(state[a] * ds, FAST) for a in range(3)]
    forms = variations(energy, state, FAST)
    compiled = process_time() - begun
    supports = [Support(space, whole, one) for one in problem.held]
    with defaults(NEWTON | dict(DIRECT if options is None else options)):
        newton = Newton(state, *forms, supports, None)
        newton.solve()
        reactions = newton.reactions()
        newton.destroy()
    seconds = process_time() - start - compiled
    moved = np.full(3, np.nan)
    if pull is not None:
        moved = np.array([dolfinx.fem.assemble_scalar(one) for one in pull]) / area
    return Solution(reactions, moved, 3 * int(space.dofmap.index_map.size_global), seconds)
