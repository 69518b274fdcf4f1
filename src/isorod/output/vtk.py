"""Fields on a rod as VTK files."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib.util import find_spec
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from isorod import memory
from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.model.body import Body
from isorod.output import stress
from isorod.space.graded import Graded
from isorod.space.polyharmonic import Polyharmonic

if TYPE_CHECKING:
    import pyvista


# Lines that contact may add round the section, and along an element, at most.
_MOST = 100

# Degree of curved cells in each direction, how many are along an element, and round the section at least.
_DEGREE, _ALONG, _ROUND = 4, 3, 8

# Memory for a point with its stress, bytes.
_BYTES = 900.0

# Share of their range by which lines are apart.
_CLOSE = 1e-6


def require(what: str = "VTK files") -> None:
    """Raise `InputError` if pyvista, which writes the files and draws pictures, is not installed."""
    if find_spec("pyvista") is None:
        raise InputError(f"{what} need pyvista, which is not installed: pip install pyvista")


def grid(
    body: Body,
    fields: Mapping[str, Array],
    rings: int = 4,
    around: int = 32,
    slices: int = 6,
    factor: float = 1.0,
    curved: bool = False,
) -> "pyvista.UnstructuredGrid":
    """Return the undeformed rod as small cells, vector fields as point data, ``von_mises`` beside ``displacement``.

    With ``displacement`` come the states of laws with memory by their names too, strains in VTK's order.  With a field
    ``pressure``, the coefficients of the mixed formulation (`isorod.statics.Equilibrium.pressures`), comes
    ``mean_stress``; with ``contact_pressure`` (`isorod.statics.Equilibrium.fields`) the same on the lateral surface, by
    linear interpolation between the points of contact, in cells that have corners at those under pressure.

    Every element, and every ring of the section, gets points of its own, so that what jumps between them is shown as
    it is.

    Parameters
    ----------
    fields
        Values at the body's nodes by name, shape ``(nodes, 3)`` each but for those two.
    rings, around, slices
        Cells along the radius (one a ring at least), round the section and along an element.
    factor
        Load factor of the stress, which a muscle's activation follows.
    curved
        Make fewer cells that interpolate by polynomials of degree 4 (VTK's Lagrange hexahedra; Cauchy's stress with
        them, ``cauchy``, six components in VTK's order): three along an element, one a ring, and eight or more round
        the section, with edges where the outline's arcs meet.

    Raises
    ------
    InputError
        If pyvista is not installed.
    """
    require()
    import pyvista

    degree = _DEGREE if curved else 1
    touched = fields.get("contact_pressure", np.empty((0, 5)))
    if curved:
        angles, slices = _curved_angles(body), _ALONG * degree
    else:
        angles = _with(np.linspace(0.0, 2.0 * np.pi, around, endpoint=False), _touched(touched, 1) % (2.0 * np.pi))
    bounds = body.space.rod.rings
    xi, numbers = _disk(bounds, [degree if curved else max(1, round(rings * w)) for w in np.diff(bounds)], angles)
    axis = body.space.axis
    lines = []
    for low, high in pairwise(axis.breaks):
        line = np.linspace(low, high, slices + 1)
        if not curved:
            places = _touched(touched, 0)
            inside = np.abs(places - 0.5 * (low + high)) < (0.5 - _CLOSE) * (high - low)
            line = _with(line, places[inside])
        # Stay inside the element: at a knot the next one would be meant.
        line[-1] -= 1e-9 * (high - low)
        lines.append(line)
    u = np.concatenate(lines)
    memory.ask((_BYTES + 24.0 * len(fields)) * u.size * len(xi), f"a .vtu file of {u.size * len(xi):,} points")
    points, _ = body.space.rod.grid(xi, u)

    cells = _cells(numbers, [line.size for line in lines], len(xi), degree)
    kind = pyvista.CellType.LAGRANGE_HEXAHEDRON if curved else pyvista.CellType.HEXAHEDRON
    mesh = pyvista.UnstructuredGrid(
        np.insert(cells, 0, cells.shape[1], axis=1).ravel(), np.full(len(cells), kind), points.reshape(-1, 3)
    )
    # Where the points are: those of the disk, at each of the axis parameters.
    mesh.field_data["u"], mesh.field_data["xi"] = u, xi
    pressure = fields.get("pressure")
    for name, nodal in fields.items():
        if name == "contact_pressure":
            mesh.point_data[name] = _contact_pressure(nodal, xi, u).ravel()
        if name in ("pressure", "contact_pressure"):
            continue
        values, _ = body.space.displacement(nodal, xi, u)
        mesh.point_data[name] = values.reshape(-1, 3)
        if name == "displacement" and body.past is not None:
            mesh.point_data.update(_states(body, nodal, xi, u, factor))
            cauchy = stress.cauchy(body, nodal, xi, u, factor, pressure)
            mesh.point_data["von_mises"] = stress.von_mises(cauchy).ravel()
            if curved:
                mesh.point_data["cauchy"] = cauchy[..., [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]].reshape(-1, 6)
            if pressure is not None:
                mesh.point_data["mean_stress"] = np.trace(cauchy, axis1=-2, axis2=-1).ravel() / 3.0
    return mesh


def _states(body: Body, nodal: Array, xi: Array, u: Array, factor: float) -> dict[str, Array]:
    """Return what laws with memory know at the points by name; of several tensors each by its number from 1."""
    names = list(dict.fromkeys(name for law in body.laws for name in law.states if name[0] != "_"))
    found = {}
    for name, values in (stress.known(body, nodal, xi, u, factor, names) if names else {}).items():
        flat = values.reshape(-1, values.shape[-1])
        tensors = [flat[:, k : k + 6] for k in range(0, flat.shape[1], 6)] if flat.shape[1] % 6 == 0 else [flat]
        for number, one in enumerate(tensors, 1):
            own = one[:, [0, 3, 5, 1, 4, 2]] if one.shape[1] == 6 else one.squeeze(axis=1)
            found[name if len(tensors) == 1 else f"{name}_{number}"] = own
    return found


def small_cells(mesh: "pyvista.UnstructuredGrid") -> "pyvista.UnstructuredGrid":
    """Return Lagrange hexahedra of one degree as the linear ones between their points; other cells as they are."""
    import pyvista

    if not mesh.n_cells or (mesh.celltypes != pyvista.CellType.LAGRANGE_HEXAHEDRON).any():
        return mesh
    cells = mesh.cell_connectivity.reshape(mesh.n_cells, -1)
    degree = round(cells.shape[1] ** (1.0 / 3.0)) - 1
    lattice = np.empty(cells.shape[1], dtype=np.int64)
    lattice[_order(degree)] = np.arange(lattice.size)
    small = _windows(lattice.reshape(3 * (degree + 1,)), 1).reshape(-1, 8)[:, _order(1)]
    found = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: cells[:, small].reshape(-1, 8)}, mesh.points)
    for kept, given in ((found.point_data, mesh.point_data), (found.field_data, mesh.field_data)):
        for name, values in given.items():
            kept[name] = values
    return found


def _curved_angles(body: Body) -> Array:
    """Return angles of points of curved cells, whose edges are where arcs of the outline or of functions meet."""
    space = body.space
    if isinstance(space.basis, Graded):
        joints = space.basis.joints
    else:
        several = isinstance(space.basis, Polyharmonic)
        n, turn = (space.points_around, space.turn) if several else (space.rod.section_points, 0.0)
        joints = turn + 2.0 * np.pi / n * (np.arange(n + 1) - 0.5)
    parts = _DEGREE * -(-_ROUND // (len(joints) - 1))
    return np.concatenate([np.linspace(low, high, parts, endpoint=False) for low, high in pairwise(joints)])


def _windows(lattice: Index, degree: int) -> Index:
    """Return the numbers ``(cells, degree + 1, ...)`` of points of cells in a lattice of numbers of any dimension."""
    shape = (degree + 1,) * lattice.ndim
    steps = (slice(None, None, degree),) * lattice.ndim
    return sliding_window_view(lattice, shape)[steps].reshape(-1, *shape)


@lru_cache
def _order(degree: int) -> Index:
    """Return which point of the lattice ``(i, j, k)`` of a hexahedron each of VTK's is."""
    from vtkmodules.vtkCommonDataModel import vtkHigherOrderHexahedron

    order = 3 * [degree]
    lattice = np.ndindex(degree + 1, degree + 1, degree + 1)
    return np.argsort([vtkHigherOrderHexahedron.PointIndexFromIJK(i, j, k, order) for i, j, k in lattice])


def _cells(numbers: Sequence[Index], sizes: Sequence[int], count: int, degree: int) -> Index:
    """Return the points of all cells: of each ring of the section, between slices of each element."""
    around = [np.concatenate([ring, ring[:, :1]], axis=1) for ring in numbers]
    section = np.concatenate([_windows(ring, degree) for ring in around])
    below = np.concatenate([np.arange(0, m - 1, degree) for m in sizes]) + np.repeat(
        np.cumsum([0, *sizes[:-1]]), [(m - 1) // degree for m in sizes]
    )
    layers = below[:, None] + np.arange(degree + 1)
    cells = section[None, ..., None] + count * layers[:, None, None, None, :]
    return np.asarray(cells.reshape(-1, (degree + 1) ** 3)[:, _order(degree)])


def _touched(points: Array, which: int) -> Array:
    """Return axis parameters (0) or angles (1) of points under pressure, and of those beside them."""
    found = []
    for contact in np.unique(points[:, 3]):
        rows = points[points[:, 3] == contact]
        places, of_place = np.unique(rows[:, which].round(9), return_inverse=True)
        near = np.unique(of_place[rows[:, 2] > 0.0][:, None] + np.array([-1, 0, 1]))
        found.append(places[near[(near >= 0) & (near < places.size)]])
    return np.unique(np.concatenate([np.empty(0), *found]))


def _with(lines: Array, more: Array) -> Array:
    """Return lines and more of them, no more than there is room for, and none as good as on another."""
    more = more[:: -(-more.size // _MOST)] if more.size else more
    found = np.unique(np.concatenate([lines, more]))
    apart = np.diff(found) > 0.5 * _CLOSE * (found[-1] - found[0])
    return found[np.concatenate([[True], apart])]


def _contact_pressure(points: Array, xi: Array, u: Array) -> Array:
    """Return the sum of the pressures of all contacts on a grid, shape ``(u, xi)``; zero off surfaces.

    ``points`` ``(m, 5)`` are rows of axis parameter, angle, pressure, number of the contact, and radius on the disk.
    """
    from scipy.interpolate import RegularGridInterpolator

    found = np.zeros((u.size, len(xi)))
    for contact in np.unique(points[:, 3]):
        rows = points[points[:, 3] == contact]
        on = np.flatnonzero(np.abs(np.linalg.norm(xi, axis=1) - rows[0, 4]) < 1e-9)
        angles = np.arctan2(xi[on, 1], xi[on, 0])
        places, of_place = np.unique(rows[:, 0].round(9), return_inverse=True)
        turns, of_turn = np.unique(rows[:, 1].round(9), return_inverse=True)
        values = np.zeros((places.size, turns.size))
        values[of_place, of_turn] = rows[:, 2]
        # Once round and a little more.
        turns = np.concatenate([[turns[-1] - 2.0 * np.pi], turns, [turns[0] + 2.0 * np.pi]])
        values = np.concatenate([values[:, -1:], values, values[:, :1]], axis=1)
        if places.size == 1:
            places, values = places + np.array([-1e-9, 1e-9]), np.repeat(values, 2, axis=0)
        seen = RegularGridInterpolator((places, turns), values, bounds_error=False, fill_value=0.0)
        where = turns[0] + (angles - turns[0]) % (2.0 * np.pi)
        found[:, on] += seen(tuple(np.meshgrid(u, where, indexing="ij")))
    return found


def content(mesh: "pyvista.UnstructuredGrid") -> bytes:
    """Return what the ``.vtu`` file of a mesh holds."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(mesh)
    # To memory: of a disk that is full the writer says nothing, or dies.
    writer.WriteToOutputStringOn()
    writer.Write()
    return str(writer.GetOutputString()).encode()


def _disk(bounds: Sequence[float], parts: Sequence[int], angle: Array) -> tuple[Array, list[Index]]:
    """Return points of the rings of the disk, and their numbers ``(radii, angles)`` ring by ring; one is its centre."""
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points: list[Array] = []
    numbers = []
    count = 0
    for (inner, outer), n in zip(pairwise(bounds), parts, strict=True):
        # Stay inside the ring: where two meet the outer one would be meant.
        radius = np.linspace(inner, outer if outer == bounds[-1] else outer * (1.0 - 1e-9), n + 1)
        centre = [np.zeros((1, 2))] if inner == 0.0 else []
        points += [*centre, (radius[len(centre) :, None, None] * circle).reshape(-1, 2)]
        rows = count + len(centre) + np.arange((n + 1 - len(centre)) * angle.size).reshape(-1, angle.size)
        numbers.append(np.concatenate([np.full((len(centre), angle.size), count), rows]))
        count = int(rows[-1, -1]) + 1
    return np.concatenate(points), numbers
