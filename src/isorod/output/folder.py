"""A results folder: the records of its runs, and the files they name."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from isorod.arrays import Array
from isorod.model.body import Body
from isorod.output import results, vtk

RECORDS = "results.jsonl"


def add(folder: Path, record: Mapping[str, Any], fields: Sequence[tuple[Body, Mapping[str, Array]]]) -> dict[str, Any]:
    """Write the fields of each body to a file of its own, and append the record that names them; all of it or nothing.

    No file is overwritten, whatever else runs and writes there: the first run's are ``SCENE-BODY.vtu``, those of later
    ones ``SCENE-runN-BODY.vtu``.

    Parameters
    ----------
    folder
        The results folder; records go to ``results.jsonl`` there.
    record
        What `isorod.command.run.record` returns.
    fields
        Each body with its fields by name, as for `isorod.output.vtk.grid`.

    Returns
    -------
    The record as it was written, with the names of the files, relative to the folder, as ``files``.

    Raises
    ------
    InputError
        If something cannot be written; the folder then holds what it held before.
    SolveError
        If the record has a number that is not finite; nothing is written.
    """
    results.line(record)
    contents = [vtk.content(body, nodal) for body, nodal in fields]
    written: list[Path] = []
    # Whoever has the records also has the choice of names.
    with results.locked(folder / RECORDS) as file:
        try:
            file.seek(0)
            names = _free_names(folder, file.readall(), str(record["scene"]), len(contents))
            for name, content in zip(names, contents, strict=True):
                written.append(folder / name)
                results.write_whole(folder / name, content)
            whole = {**record, "files": names}
            results.add(file, results.line(whole))
        except BaseException:
            for path in written:
                path.unlink(missing_ok=True)
            raise
    return whole


def _free_names(folder: Path, records: bytes, scene: str, count: int) -> list[str]:
    """Return names of the bodies' files that neither the folder nor a record has."""
    taken = {path.name for path in folder.iterdir()}
    number = 0
    while True:
        number += 1
        run = f"{scene}-run{number}" if number > 1 else scene
        names = [f"{run}-{k}.vtu" for k in range(count)]
        # A file that was moved elsewhere is still the one that its record names.
        if not any(name in taken or f'"{name}"'.encode() in records for name in names):
            return names
