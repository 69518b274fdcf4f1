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


# Largest number of grid lines added for contact, round the section and along an element.
_MOST = 100

# Degree of curved cells, their number along an element, and round the section at least.
_DEGREE, _ALONG, _ROUND = 4, 3, 8

# Memory for each point with its stress, bytes.
_BYTES = 900.0

# Distance of grid lines over their range, at least.
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

    ``displacement`` also gives state variables of laws with memory by name, strains in VTK's order.  A field
    ``pressure``, coefficients of the mixed formulation (`isorod.statics.Equilibrium.pressures`), gives
    ``mean_stress``; ``contact_pressure`` (`isorod.statics.Equilibrium.fields`) is interpolated linearly on the lateral
    surface, in cells with corners at the contact points under pressure.

    Every element and every ring of the section has its own points, so that fields may jump between them.

    Parameters
    ----------
    fields
        Values at the body's nodes by name, shape ``(nodes, 3)`` each but for the two pressures.
    rings, around, slices
        Cells along the radius (at least one for each ring), round the section and along an element.
    factor
        Load factor, which scales a muscle's activation.
    curved
        Whether to make fewer cells of degree 4 (VTK's Lagrange hexahedra), with the Cauchy stress ``cauchy``, six
        components in VTK's order: three along an element, one for each ring, and eight or more round the section, with
        edges at the knots of the outline.

    Raises
    ------
    InputError
        If pyvista is not installed.
    """
    require()
    import pyvista

    degree = _DEGREE if curved else 1
    contact = fields.get("contact_pressure", np.empty((0, 5)))
    if curved:
        angles, slices = _curved_angles(body), _ALONG * degree
    else:
        angles = _merged(np.linspace(0.0, 2.0 * np.pi, around, endpoint=False), _pressed(contact, 1) % (2.0 * np.pi))
    bounds = body.space.rod.rings
    xi, numbers = _disk(bounds, [degree if curved else max(1, round(rings * w)) for w in np.diff(bounds)], angles)
    axis = body.space.axis
    lines = []
    for low, high in pairwise(axis.breaks):
        line = np.linspace(low, high, slices + 1)
        if not curved:
            places = _pressed(contact, 0)
            inside = np.abs(places - 0.5 * (low + high)) < (0.5 - _CLOSE) * (high - low)
            line = _merged(line, places[inside])
        # Stay inside the element: a knot belongs to the next one.
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
    # The points: those of the disk, at each axis parameter.
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
    """Return state variables of laws with memory at the points by name, several tensors with numbers from 1."""
    names = list(dict.fromkeys(name for law in body.laws for name in law.states if name[0] != "_"))
    result = {}
    for name, values in (stress.known(body, nodal, xi, u, factor, names) if names else {}).items():
        flat = values.reshape(-1, values.shape[-1])
        tensors = [flat[:, k : k + 6] for k in range(0, flat.shape[1], 6)] if flat.shape[1] % 6 == 0 else [flat]
        for number, tensor in enumerate(tensors, 1):
            components = tensor[:, [0, 3, 5, 1, 4, 2]] if tensor.shape[1] == 6 else tensor.squeeze(axis=1)
            result[name if len(tensors) == 1 else f"{name}_{number}"] = components
    return result


def small_cells(mesh: "pyvista.UnstructuredGrid") -> "pyvista.UnstructuredGrid":
    """Return a mesh of Lagrange hexahedra of one degree split into linear ones; other meshes unchanged."""
    import pyvista

    if not mesh.n_cells or (mesh.celltypes != pyvista.CellType.LAGRANGE_HEXAHEDRON).any():
        return mesh
    cells = mesh.cell_connectivity.reshape(mesh.n_cells, -1)
    degree = round(cells.shape[1] ** (1.0 / 3.0)) - 1
    lattice = np.empty(cells.shape[1], dtype=np.int64)
    lattice[_order(degree)] = np.arange(lattice.size)
    small = _windows(lattice.reshape(3 * (degree + 1,)), 1).reshape(-1, 8)[:, _order(1)]
    split = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: cells[:, small].reshape(-1, 8)}, mesh.points)
    for target, source in ((split.point_data, mesh.point_data), (split.field_data, mesh.field_data)):
        for name, values in source.items():
            target[name] = values
    return split


def _curved_angles(body: Body) -> Array:
    """Return angles of points of curved cells, whose edges are at knots of the outline or of section functions."""
    space = body.space
    if isinstance(space.basis, Graded):
        joints = space.basis.joints
    else:
        own_points = isinstance(space.basis, Polyharmonic)
        n, turn = (space.points_around, space.turn) if own_points else (space.rod.section_points, 0.0)
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
    """Return the index in the lattice ``(i, j, k)`` of a hexahedron for each point in VTK's order."""
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


def _pressed(points: Array, column: int) -> Array:
    """Return axis parameters (column 0) or angles (1) of contact points under pressure and of their neighbours."""
    result = []
    for contact in np.unique(points[:, 3]):
        rows = points[points[:, 3] == contact]
        places, of_place = np.unique(rows[:, column].round(9), return_inverse=True)
        chosen = np.unique(of_place[rows[:, 2] > 0.0][:, None] + np.array([-1, 0, 1]))
        result.append(places[chosen[(chosen >= 0) & (chosen < places.size)]])
    return np.unique(np.concatenate([np.empty(0), *result]))


def _merged(lines: Array, more: Array) -> Array:
    """Return grid lines with a limited number of additional ones, without near duplicates."""
    more = more[:: -(-more.size // _MOST)] if more.size else more
    merged = np.unique(np.concatenate([lines, more]))
    apart = np.diff(merged) > 0.5 * _CLOSE * (merged[-1] - merged[0])
    return merged[np.concatenate([[True], apart])]


def _contact_pressure(points: Array, xi: Array, u: Array) -> Array:
    """Return the sum of the pressures of all contacts on a grid, shape ``(u, xi)``; zero off surfaces.

    ``points`` ``(m, 5)`` are rows of axis parameter, angle, pressure, number of the contact, and radius on the disk.
    """
    from scipy.interpolate import RegularGridInterpolator

    total = np.zeros((u.size, len(xi)))
    for contact in np.unique(points[:, 3]):
        rows = points[points[:, 3] == contact]
        on = np.flatnonzero(np.abs(np.linalg.norm(xi, axis=1) - rows[0, 4]) < 1e-9)
        angles = np.arctan2(xi[on, 1], xi[on, 0])
        places, of_place = np.unique(rows[:, 0].round(9), return_inverse=True)
        turns, of_turn = np.unique(rows[:, 1].round(9), return_inverse=True)
        values = np.zeros((places.size, turns.size))
        values[of_place, of_turn] = rows[:, 2]
        # Periodic round the section.
        turns = np.concatenate([[turns[-1] - 2.0 * np.pi], turns, [turns[0] + 2.0 * np.pi]])
        values = np.concatenate([values[:, -1:], values, values[:, :1]], axis=1)
        if places.size == 1:
            places, values = places + np.array([-1e-9, 1e-9]), np.repeat(values, 2, axis=0)
        interpolated = RegularGridInterpolator((places, turns), values, bounds_error=False, fill_value=0.0)
        wrapped = turns[0] + (angles - turns[0]) % (2.0 * np.pi)
        total[:, on] += interpolated(tuple(np.meshgrid(u, wrapped, indexing="ij")))
    return total


def content(mesh: "pyvista.UnstructuredGrid") -> bytes:
    """Return the content of the ``.vtu`` file of a mesh."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(mesh)
    # To memory: on a full disk the writer reports nothing, or crashes.
    writer.WriteToOutputStringOn()
    writer.Write()
    return str(writer.GetOutputString()).encode()


def _disk(bounds: Sequence[float], parts: Sequence[int], angle: Array) -> tuple[Array, list[Index]]:
    """Return points of the rings of the disk, and their numbers ``(radii, angles)`` for each ring."""
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points: list[Array] = []
    numbers = []
    count = 0
    for (inner, outer), n in zip(pairwise(bounds), parts, strict=True):
        # Stay inside the ring: a common radius belongs to the outer one.
        radius = np.linspace(inner, outer if outer == bounds[-1] else outer * (1.0 - 1e-9), n + 1)
        centre = [np.zeros((1, 2))] if inner == 0.0 else []
        points += [*centre, (radius[len(centre) :, None, None] * circle).reshape(-1, 2)]
        rows = count + len(centre) + np.arange((n + 1 - len(centre)) * angle.size).reshape(-1, angle.size)
        numbers.append(np.concatenate([np.full((len(centre), angle.size), count), rows]))
        count = int(rows[-1, -1]) + 1
    return np.concatenate(points), numbers
