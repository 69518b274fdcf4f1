"""Fields on a rod as VTK files."""

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from isorod import memory
from isorod.arrays import Array
from isorod.errors import InputError
from isorod.model.body import Body
from isorod.output import stress
from isorod.output.results import write_whole

if TYPE_CHECKING:
    import pyvista


# Lines that contact may add round the section, and along an element, at most.
_MOST = 100

# Memory for a point with its stress, bytes.
_BYTES = 900.0

# Share of their range by which lines are apart.
_CLOSE = 1e-6


def require(what: str = "VTK files") -> None:
    """Raise `InputError` if pyvista, which writes the files and draws pictures, is not installed."""
    if find_spec("pyvista") is None:
        raise InputError(f"{what} need pyvista, which is not installed: pip install pyvista")


def grid(
    body: Body, fields: Mapping[str, Array], rings: int = 4, around: int = 32, slices: int = 6, factor: float = 1.0
) -> "pyvista.UnstructuredGrid":
    """Return the undeformed rod as small cells, vector fields as point data, ``von_mises`` beside ``displacement``.

    With a field ``pressure``, the coefficients of the mixed formulation (`isorod.statics.Equilibrium.pressures`), comes
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

    Raises
    ------
    InputError
        If pyvista is not installed.
    """
    require()
    import pyvista

    touched = fields.get("contact_pressure", np.empty((0, 4)))
    angles = _with(np.linspace(0.0, 2.0 * np.pi, around, endpoint=False), _touched(touched, 1) % (2.0 * np.pi))
    xi, cells = _disk(body.space.rod.rings, rings, angles)
    axis = body.space.axis
    lines = []
    for low, high in pairwise(axis.breaks):
        places = _touched(touched, 0)
        inside = np.abs(places - 0.5 * (low + high)) < (0.5 - _CLOSE) * (high - low)
        line = _with(np.linspace(low, high, slices + 1), places[inside])
        # Stay inside the element: at a knot the next one would be meant.
        line[-1] -= 1e-9 * (high - low)
        lines.append(line)
    u = np.concatenate(lines)
    memory.ask((_BYTES + 24.0 * len(fields)) * u.size * len(xi), f"a .vtu file of {u.size * len(xi):,} points")
    points, _ = body.space.rod.grid(xi, u)

    below = np.delete(np.arange(u.size), np.cumsum([line.size for line in lines]) - 1)
    lower = cells[None, :, :] + xi.shape[0] * below.reshape(-1, 1, 1)
    corners = np.concatenate([lower, lower + xi.shape[0]], axis=2).reshape(-1, 8)
    mesh = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: corners}, points.reshape(-1, 3))
    pressure = fields.get("pressure")
    for name, nodal in fields.items():
        if name == "contact_pressure":
            mesh.point_data[name] = _contact_pressure(nodal, xi, u).ravel()
        if name in ("pressure", "contact_pressure"):
            continue
        values, _ = body.space.displacement(nodal, xi, u)
        mesh.point_data[name] = values.reshape(-1, 3)
        if name == "displacement":
            cauchy = stress.cauchy(body, nodal, xi, u, factor, pressure)
            mesh.point_data["von_mises"] = stress.von_mises(cauchy).ravel()
            if pressure is not None:
                mesh.point_data["mean_stress"] = np.trace(cauchy, axis1=-2, axis2=-1).ravel() / 3.0
    return mesh


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
    """Return the sum of the pressures of all contacts on a grid, shape ``(u, xi)``; zero inside.

    ``points`` ``(m, 4)`` are rows of axis parameter, angle, pressure and number of the contact.
    """
    from scipy.interpolate import RegularGridInterpolator

    found = np.zeros((u.size, len(xi)))
    outer = np.flatnonzero(np.linalg.norm(xi, axis=1) > 1.0 - 1e-9)
    angles = np.arctan2(xi[outer, 1], xi[outer, 0])
    for contact in np.unique(points[:, 3]):
        rows = points[points[:, 3] == contact]
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
        found[:, outer] += seen(tuple(np.meshgrid(u, where, indexing="ij")))
    return found


def write(body: Body, fields: Mapping[str, Array], path: Path) -> None:
    """Write the fields of `grid` to a ``.vtu`` file; raises `InputError` if it cannot be written."""
    write_whole(path, content(grid(body, fields)))


def content(mesh: "pyvista.UnstructuredGrid") -> bytes:
    """Return what the ``.vtu`` file of a mesh holds."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(mesh)
    # To memory: of a disk that is full the writer says nothing, or dies.
    writer.WriteToOutputStringOn()
    writer.Write()
    return str(writer.GetOutputString()).encode()


def _disk(bounds: Sequence[float], rings: int, angle: Array) -> tuple[Array, np.ndarray]:
    """Return points and quadrilaterals of the rings of the disk; those at its centre have one corner twice."""
    around = angle.size
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    here = np.arange(around)
    following = (here + 1) % around
    points: list[Array] = []
    cells = []
    count = 0
    for inner, outer in pairwise(bounds):
        # Stay inside the ring: where two meet the outer one would be meant.
        last = outer if outer == bounds[-1] else outer * (1.0 - 1e-9)
        radius = np.linspace(inner, last, max(1, round(rings * (outer - inner))) + 1)
        if inner == 0.0:
            points.append(np.zeros((1, 2)))
            cells.append(np.stack([np.zeros_like(here), 1 + here, 1 + following, np.zeros_like(here)], axis=1))
            radius, count = radius[1:], 1
        points.append((radius[:, None, None] * circle).reshape(-1, 2))
        for k in range(radius.size - 1):
            low = count + k * around
            cells.append(np.stack([low + here, low + around + here, low + around + following, low + following], axis=1))
        count += radius.size * around
    return np.concatenate(points), np.concatenate(cells)
