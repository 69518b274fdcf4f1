"""Fields on a rod as VTK files."""

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.model.body import Body
from isorod.output import stress
from isorod.output.results import write_whole

if TYPE_CHECKING:
    import pyvista


def require() -> None:
    """Raise `InputError` if pyvista, which writes the files, is not installed."""
    if find_spec("pyvista") is None:
        raise InputError("VTK files need pyvista, which is not installed: pip install pyvista")


def grid(
    body: Body, fields: Mapping[str, Array], rings: int = 4, around: int = 32, slices: int = 6, factor: float = 1.0
) -> "pyvista.UnstructuredGrid":
    """Return the undeformed rod as small cells, vector fields as point data, ``von_mises`` beside ``displacement``.

    With a field ``pressure``, the coefficients of the mixed formulation (`isorod.statics.Equilibrium.pressures`), comes
    ``mean_stress``.

    Every element, and every ring of the section, gets points of its own, so that what jumps between them is shown as
    it is.

    Parameters
    ----------
    fields
        Values at the body's nodes by name, shape ``(nodes, 3)`` each.
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

    xi, cells = _disk(body.space.rod.rings, rings, around)
    axis = body.space.axis
    inside = np.linspace(0.0, 1.0, slices + 1)
    # Stay inside the element: at a knot the next one would be meant.
    inside[-1] -= 1e-9
    u = (axis.breaks[:-1, None] + np.diff(axis.breaks)[:, None] * inside).ravel()
    points, _ = body.space.rod.grid(xi, u)

    below = np.arange(axis.elements)[:, None] * (slices + 1) + np.arange(slices)
    lower = cells[None, :, :] + xi.shape[0] * below.reshape(-1, 1, 1)
    corners = np.concatenate([lower, lower + xi.shape[0]], axis=2).reshape(-1, 8)
    mesh = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: corners}, points.reshape(-1, 3))
    pressure = fields.get("pressure")
    for name, nodal in fields.items():
        if name == "pressure":
            continue
        values, _ = body.space.displacement(nodal, xi, u)
        mesh.point_data[name] = values.reshape(-1, 3)
        if name == "displacement":
            cauchy = stress.cauchy(body, nodal, xi, u, factor, pressure)
            mesh.point_data["von_mises"] = stress.von_mises(cauchy).ravel()
            if pressure is not None:
                mesh.point_data["mean_stress"] = np.trace(cauchy, axis1=-2, axis2=-1).ravel() / 3.0
    return mesh


def write(body: Body, fields: Mapping[str, Array], path: Path) -> None:
    """Write the fields of `grid` to a ``.vtu`` file; raises `InputError` if it cannot be written."""
    write_whole(path, content(body, fields))


def content(body: Body, fields: Mapping[str, Array]) -> bytes:
    """Return what a ``.vtu`` file of the fields of `grid` holds."""
    mesh = grid(body, fields)
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(mesh)
    # To memory: of a disk that is full the writer says nothing, or dies.
    writer.WriteToOutputStringOn()
    writer.Write()
    return str(writer.GetOutputString()).encode()


def _disk(bounds: Sequence[float], rings: int, around: int) -> tuple[Array, np.ndarray]:
    """Return points and quadrilaterals of the rings of the disk; those at its centre have one corner twice."""
    angle = 2.0 * np.pi * np.arange(around) / around
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
