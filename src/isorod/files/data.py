"""Points that a scene file takes from a file beside it: CSV, polylines of VTK, or wires of STEP and IGES."""

import locale
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.errors import InputError
from isorod.files import values, wires
from isorod.files.document import Place
from isorod.geometry import table

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    from isorod.model.history import TimeTable

_AXES = ("x", "y", "z")
# Names under which programs that find centre lines keep the radius.
_RADIUS = ("radius", "r", "maximuminscribedsphereradius")
_VTK = (".vtk", ".vtp")


class Points:
    """Points, and what a data file says of the radius there.

    Attributes
    ----------
    array
        Shape ``(m, 2)`` or ``(m, 3)``.
    radius
        Shape ``(m,)``, or None.
    """

    def __init__(self, array: Array, radius: Array | None = None) -> None:
        self.array, self.radius = array, radius

    def make(self) -> Array:
        """Return the array."""
        return self.array


def points(place: Place, value: Any) -> Points:
    """Return points given in lists, or by the name of a file relative to the scene's.

    CSV, ``.vtk``, ``.vtp``, and of ``.step``, ``.stp``, ``.iges``, ``.igs`` points along the only wire.

    CSV has a point a line, two or three numbers and, behind them, a radius; commas, semicolons or blanks between.  A
    first line of names may say which columns are ``x``, ``y``, ``z`` and ``radius``; what begins with ``#`` is not
    read.  Of VTK (legacy ASCII or binary, or XML) a file has one polyline, in one cell or in many, and may have a
    point array ``radius``.

    Raises
    ------
    InputError
        With the line of the data file, if it cannot be read, or a value is missing, not finite or no number.
    """
    if isinstance(value, Points):
        return value
    if not isinstance(value, str):
        return Points(values.value_of(place, value, Numbers))
    content, path = place.data(value), place.document.folder / value
    if path.suffix.lower() in _VTK:
        read = _vtk(place, value, path)
    elif path.suffix.lower() in wires.ENDINGS:
        read = _wire(place, value, path)
    else:
        read = _csv(place, value, content)
    finite = np.isfinite(read.array if read.radius is None else np.column_stack([read.array, read.radius]))
    if not finite.all():
        raise place.error(f"{value}: point {np.argmin(finite.all(axis=1))} is not finite")
    if read.radius is not None and not read.radius.min() > 0.0:
        k = int(np.argmin(read.radius))
        raise place.error(f"{value}: the radius of point {k} is {read.radius[k]:g}, need a positive length")
    return read


def _bond(place: Place, value: Any) -> Points | float:
    """Return a stiffness, or points of a law."""
    return points(place, value) if isinstance(value, list | str) else float(values.value_of(place, value, float))


def _varying(place: Place, value: Any) -> Any:
    """Return a number, or several."""
    return values.value_of(place, value, Numbers if isinstance(value, list) else float)


VARYING = values.Kind(_varying, "a number, several in a list, or pairs in a list")
POINTS = values.Kind(points, "points in lists, or the name of a file beside this one")
BOND = values.Kind(_bond, "a number, or points in lists or in a file beside this one")


def rows_of(place: Place, value: Any) -> Array:
    """Return rows of numbers given in lists, or by the name of a CSV file beside the scene's."""
    if isinstance(value, str):
        return _table(place, value, place.data(value))[1]
    return np.asarray(values.value_of(place, value, Numbers), dtype=float)


def _history(place: Place, value: Any) -> "TimeTable":
    """Return a factor by time, of rows or the name of a CSV file of such beside the scene's."""
    # Loads what models are made of.
    from isorod.model.history import TimeTable

    rows = rows_of(place, value)
    if isinstance(value, str) and rows.shape[1] != 2:
        raise place.error(f"{value}: {rows.shape[1]} numbers a line, need time and factor")
    with place.locating({"history": place}):
        return TimeTable.of(rows)


HISTORY = values.Kind(_history, "rows [time, factor] in a list, or the name of a file beside this one")


def _csv(place: Place, name: str, content: bytes) -> Points:
    columns, found = _table(place, name, content)
    names = [word.strip("\"'").lower() for word in columns]
    return _named(place, name, found, names) if names else _counted(place, name, found)


def _table(place: Place, name: str, content: bytes) -> tuple[list[str], Array]:
    """Return the words of a first line of names, and the numbers of a CSV file."""
    try:
        columns, rows = table.read(content)
    except UnicodeDecodeError as problem:
        line = content.count(b"\n", 0, problem.start) + 1
        raise place.error(f"{name}:{line}: byte {content[problem.start]:#04x} is not UTF-8") from None
    for row in rows:
        if row.wrong:
            raise place.error(f"{name}:{row.line}: value {row.wrong} is no finite number")
        if len(row.values) != len(rows[0].values):
            raise place.error(
                f"{name}:{row.line}: {len(row.values)} numbers where the lines above have {len(rows[0].values)}"
            )
    if not rows:
        raise place.error(f"{name}: no points are in it")
    return columns, np.array([row.values for row in rows])


def _counted(place: Place, name: str, rows: Array) -> Points:
    count = rows.shape[1]
    if count not in (2, 3, 4):
        raise place.error(f"{name}: {count} numbers a line, need x, y[, z][, radius]")
    return Points(rows[:, :3], rows[:, 3] if count == 4 else None)


def _named(place: Place, name: str, rows: Array, columns: list[str]) -> Points:
    if len(columns) != rows.shape[1]:
        raise place.error(f"{name}: {len(columns)} names of columns for {rows.shape[1]} numbers a line")
    axes = [columns.index(axis) for axis in _AXES if axis in columns]
    if len(axes) < 2 or [columns[k] for k in axes] != list(_AXES[: len(axes)]):
        raise place.error(f"{name}: its first line names other columns, need x, y[, z][, radius]")
    radius = next((rows[:, columns.index(one)] for one in _RADIUS if one in columns), None)
    return Points(rows[:, axes], radius)


def _vtk(place: Place, name: str, path: Path) -> Points:
    try:
        from vtkmodules.util.numpy_support import vtk_to_numpy

        mesh = _polydata(path)
    except ImportError:
        raise place.error(f"{name}: VTK files need vtk, which is not installed: pip install vtk") from None
    lines = mesh.GetLines()
    if not mesh.GetNumberOfPoints() or not lines.GetNumberOfCells():
        raise place.error(f"{name}: no polyline is in it")
    ends = vtk_to_numpy(lines.GetOffsetsArray())
    numbers = vtk_to_numpy(lines.GetConnectivityArray())
    if np.diff(ends, prepend=0, append=len(numbers)).min() < 0:
        raise place.error(f"{name}: its lines are damaged")
    if numbers.size and not 0 <= numbers.min() <= numbers.max() < mesh.GetNumberOfPoints():
        wrong = numbers.min() if numbers.min() < 0 else numbers.max()
        raise place.error(f"{name}: a line has point {wrong}, there are points 0 to {mesh.GetNumberOfPoints() - 1}")
    pieces = [list(numbers[first:last]) for first, last in pairwise(ends) if last > first]
    if not pieces:
        raise place.error(f"{name}: no polyline is in it")
    try:
        order = _joined(pieces)
    except InputError as problem:
        raise place.error(f"{name}: {problem}") from None
    array = np.array(vtk_to_numpy(mesh.GetPoints().GetData()), dtype=float)[order]
    data = mesh.GetPointData()
    arrays = {data.GetArrayName(k).lower(): data.GetArray(k) for k in range(data.GetNumberOfArrays())}
    radius = next((arrays[one] for one in _RADIUS if arrays.get(one) is not None), None)
    return Points(array, None if radius is None else np.array(vtk_to_numpy(radius), dtype=float).reshape(-1)[order])


def _wire(place: Place, name: str, path: Path) -> Points:
    try:
        array, pieces = wires.edges(path)
        return Points(array[_joined(pieces)])
    except InputError as problem:
        raise place.error(f"{name}: {problem}") from None


def _polydata(path: Path) -> "vtkPolyData":
    """Return what VTK reads from a file; nothing is in it if it cannot be read."""
    from vtkmodules.vtkCommonCore import vtkObject

    reader: Any
    if path.suffix.lower() == ".vtp":
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

        reader = vtkXMLPolyDataReader()
    else:
        from vtkmodules.vtkIOLegacy import vtkPolyDataReader

        reader = vtkPolyDataReader()
    reader.SetFileName(str(path))
    # What it says of bad files are many lines, from C++; and it leaves the C locale, in which Python reads ASCII alone.
    shown, kept = vtkObject.GetGlobalWarningDisplay(), locale.setlocale(locale.LC_ALL)
    vtkObject.GlobalWarningDisplayOff()
    try:
        reader.Update()
    finally:
        vtkObject.SetGlobalWarningDisplay(shown)
        locale.setlocale(locale.LC_ALL, kept)
    return reader.GetOutput()


def _joined(segments: list[list[int]]) -> list[int]:
    """Return the points of lines that continue each other, in order; raises `InputError` if they do not."""
    order = segments.pop(0)
    while segments:
        for k, segment in enumerate(segments):
            if order[-1] in (segment[0], segment[-1]):
                order += segment[1:] if segment[0] == order[-1] else segment[-2::-1]
            elif order[0] in (segment[0], segment[-1]):
                order = (segment[:-1] if segment[-1] == order[0] else segment[:0:-1]) + order
            else:
                continue
            del segments[k]
            break
        else:
            raise InputError(f"{len(segments) + 1} lines that do not meet, need one polyline")
    return order
