"""Reading of results folders: records of runs, and the files that they name."""

import locale
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

from isorod.errors import InputError
from isorod.output import results, vtk
from isorod.output.folder import RECORDS

# Quantities of measures in scene files.
MEASURED = {
    "reaction": "force",
    "contact_force": "force",
    "tie_force": "force",
    "moment": "moment",
    "tie_moment": "moment",
    "displacement": "length",
    "stress": "stress",
    "energy": "energy",
}


class Step(NamedTuple):
    """A stored state: its time, or load factor, and a file for each body."""

    time: float
    files: tuple[Path, ...]


class Result(NamedTuple):
    """The result of a run, or the content of a file.

    Attributes
    ----------
    name
        Name of the scene, or of the file.
    record
        The run's record; empty for a file.
    steps
        The stored states, in order.
    curves
        The file of its curves, if there is one.
    """

    name: str
    record: Mapping[str, Any]
    steps: tuple[Step, ...]
    curves: Path | None

    @property
    def title(self) -> str:
        """Title for pictures: that of the scene file, or the name."""
        return str(dict(self.record.get("options", {})).get("title", self.name))

    @property
    def counted(self) -> str:
        """The variable of its states: load factor or time."""
        return "load factor" if self.analysis == "statics" and "end_time" not in self.record else "time"

    @property
    def units(self) -> dict[str, str]:
        """Units of ``"force"``, ``"length"`` and so on (`MEASURED`), as given with measures in the scene file."""
        units: dict[str, str] = {}
        for measure in dict(dict(self.record.get("options", {})).get("measure", {})).values():
            for word, quantity in MEASURED.items():
                # A unit may be in brackets.
                if word in measure and (unit := str(measure.get("unit", "")).strip("() ")):
                    units.setdefault(quantity, unit)
        return units

    @property
    def analysis(self) -> str | None:
        """The analysis, where that is known."""
        return self.record.get("analysis")


def find(place: str, run: int | None = None) -> Result:
    """Return a run's result.

    Parameters
    ----------
    place
        A results folder, or a ``.vtu``, ``.pvd`` or ``.csv`` file.
    run
        Which of the folder's runs, from 1; the last where not given.

    Raises
    ------
    InputError
        If there is no such folder, file or run.
    """
    path = Path(place)
    if os.path.isdir(path):
        return _run(path, run)
    if os.path.exists(path) and not os.path.isfile(path):
        raise InputError(f"{place}: is no plain file; need a results folder, or a .vtu, .pvd or .csv file")
    if not os.path.exists(path):
        raise InputError(f"{place}: there is no such folder or file; isorod run SCENE --output DIR makes one")
    if run is not None:
        raise InputError(f"--run goes with a results folder, and {place} is a file")
    match path.suffix.lower():
        case ".vtu":
            return Result(path.stem, {}, (Step(0.0, (path,)),), None)
        case ".pvd":
            return Result(path.stem, {}, _series(path), None)
        case ".csv":
            return Result(path.stem, {}, (), path)
    raise InputError(f"{place}: need a results folder, or a .vtu, .pvd or .csv file")


def _run(folder: Path, run: int | None) -> Result:
    """Return the result of one of a folder's runs."""
    records = _records(folder / RECORDS)
    count = len(records)
    if run is not None and not 1 <= run <= count:
        need = f"need 1 to {count}" if count > 1 else "it has one alone"
        raise InputError(f"{folder}: there is no run {run}; {need}")
    record = records[-1 if run is None else run - 1]
    files = [folder / name for name in record.get("files", ())]
    kinds = {kind: [file for file in files if file.suffix == kind] for kind in (".pvd", ".vtu", ".csv")}
    steps: tuple[Step, ...] = ()
    if kinds[".pvd"]:
        steps = _series(kinds[".pvd"][0])
    elif kinds[".vtu"]:
        steps = (Step(0.0, tuple(kinds[".vtu"])),)
    return Result(str(record.get("scene", folder.name)), record, steps, next(iter(kinds[".csv"]), None))


def _records(path: Path) -> list[dict[str, Any]]:
    """Return the records of a folder."""
    if not path.exists():
        raise InputError(f"{path.parent}: no run has left its results there; isorod run SCENE --output DIR does")
    records = results.read(path)
    if not records:
        raise InputError(f"{path}: there is no run in it")
    return records


def _series(path: Path) -> tuple[Step, ...]:
    """Return the states that a ``.pvd`` file names."""
    try:
        sets = ElementTree.parse(path).getroot().findall("Collection/DataSet")
        entries = [(float(row.get("timestep", "0")), int(row.get("part", "0")), row.attrib["file"]) for row in sets]
    except (OSError, ElementTree.ParseError, KeyError, ValueError) as problem:
        raise InputError(f"{path}: cannot be read ({problem})") from None
    if not entries:
        raise InputError(f"{path}: no file is named in it")
    steps: dict[float, list[Path]] = {}
    for time, _, name in sorted(entries):
        steps.setdefault(time, []).append(path.parent / name)
    return tuple(Step(time, tuple(files)) for time, files in steps.items())


def mesh(path: Path) -> Any:
    """Return the mesh of a ``.vtu`` file with its fields, curved cells split into small ones.

    Raises
    ------
    InputError
        If there is none, or it cannot be read.
    """
    import pyvista

    if not os.path.isfile(path):
        raise InputError(f"{path}: there is no such file, though the run's record names it")
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    with _silently():
        reader.Update()
    grid = pyvista.wrap(reader.GetOutput())
    if not grid.n_cells:
        raise InputError(f"{path}: no cells can be read from it; need a .vtu file of isorod's")
    return vtk.small_cells(grid)


@contextmanager
def _silently() -> Iterator[None]:
    """Silence VTK's messages on bad files, and restore the C locale."""
    from vtkmodules.vtkCommonCore import vtkObject

    shown, kept = vtkObject.GetGlobalWarningDisplay(), locale.setlocale(locale.LC_ALL)
    vtkObject.GlobalWarningDisplayOff()
    try:
        yield
    finally:
        vtkObject.SetGlobalWarningDisplay(shown)
        locale.setlocale(locale.LC_ALL, kept)
