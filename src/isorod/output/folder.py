"""A results folder: records of runs, and the files named in them."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

from isorod.arrays import Array
from isorod.model.body import Body
from isorod.output import results, vtk
from isorod.output.words import STRESS_ERROR

if TYPE_CHECKING:
    from isorod.fenics.solid import Solid

RECORDS = "results.jsonl"


class Frame(NamedTuple):
    """A state to be written.

    Attributes
    ----------
    time
        Its time, or load factor.
    fields
        Fields of each body by name, as for `isorod.output.vtk.grid`.
    factor
        Load factor of the stress.
    solids
        Fields of each finite element body by name, each ``(3 nodes,)``; none where they are not known.
    activation
        Factor of the activation of their laws.
    """

    time: float
    fields: Sequence[Mapping[str, Array]]
    factor: float = 1.0
    solids: Sequence[Mapping[str, Array]] = ()
    activation: float = 1.0


def frames(solution: Any) -> list[Frame]:
    """Return the states of a solution's ``frames()``."""
    bodies, solids = (range(len(several)) for several in (solution.model.bodies, solution.model.solids))
    result = []
    for time, state in solution.frames():
        factor = getattr(state, "factor", 1.0)
        fields = [state.fields(b) for b in bodies], factor, [state.solid_fields(k) for k in solids]
        result.append(Frame(time, *fields, solution.model.amplitude(None, factor)))
    return result


def add(
    folder: Path,
    record: Mapping[str, Any],
    bodies: Sequence[Body],
    states: Sequence[Frame],
    curves: Mapping[str, Array] | None = None,
    cells: str = "auto",
    solids: "Sequence[Solid]" = (),
) -> dict[str, Any]:
    """Write states and curves to files, and append the record that names them; all of it or nothing.

    A single state is a file ``SCENE-BODY.vtu`` for each body; several are in a folder ``SCENE-frames``.  ``SCENE.pvd``
    names several files with times and bodies.  Curves are columns of ``SCENE.csv``.  No file is overwritten, even by
    concurrent runs: later runs have ``SCENE-runN`` instead of ``SCENE``.  An estimate of the error of stresses is field
    data of the last state.

    Parameters
    ----------
    folder
        The results folder; records go to ``results.jsonl`` there.
    record
        Record of `isorod.command.solving.record`.
    bodies, states
        Bodies, and the fields of each in each state.
    curves
        Columns by their names.
    cells
        One of `isorod.output.words.CELLS`; ``"auto"`` are linear cells where there is contact pressure, else curved
        ones.
    solids
        Finite element bodies, which are numbered behind the others; of one rank.

    Returns
    -------
    The record as it was written, with the names of the files, relative to the folder, as ``files``.

    Raises
    ------
    InputError
        If something cannot be written; the folder is then unchanged.
    SolveError
        If the record has a number that is not finite; nothing is written.
    """
    results.line(record)
    names: list[str] = []
    # Names are chosen under the lock.
    with results.locked(folder), ExitStack() as undo:

        def write(name: str, content: bytes) -> None:
            path = folder / name
            if not path.parent.exists():
                results.make_folder(str(path.parent))
                undo.callback(path.parent.rmdir)
            undo.callback(path.unlink, missing_ok=True)
            results.write_whole(path, content)
            names.append(name)

        run = _free_name(folder, str(record["scene"]), len(bodies) + len(solids))
        entries = []
        contents: list[Iterator[bytes | None]]
        contents = [_contents(body, states, b, cells, record.get(STRESS_ERROR)) for b, body in enumerate(bodies)]
        contents += [_of_solid(solid, states, number) for number, solid in enumerate(solids)]
        for b, grids in enumerate(contents):
            for k, (state, content) in enumerate(zip(states, grids, strict=True)):
                if content is None:
                    continue
                name = f"{run}-{b}.vtu" if len(states) == 1 else f"{run}-frames/{b}-{k:04d}.vtu"
                write(name, content)
                entries.append((state.time, b, name))
        if len(entries) > 1:
            write(f"{run}.pvd", _collection(sorted(entries)))
        if curves:
            write(f"{run}.csv", _table(curves))
        kept = {**record, "files": names}
        results.add(folder / RECORDS, results.line(kept))
        undo.pop_all()
    return kept


def _contents(
    body: Body, states: Sequence[Frame], number: int, cells: str, stress_error: float | None
) -> Iterator[bytes | None]:
    """Yield the ``.vtu`` file of a body in each state."""
    touched = any("contact_pressure" in state.fields[number] for state in states)
    curved = cells == "curved" or (cells == "auto" and not touched)
    for state in states:
        mesh = vtk.grid(body, state.fields[number], factor=state.factor, curved=curved)
        if stress_error is not None and state is states[-1]:
            mesh.field_data[STRESS_ERROR] = [stress_error]
        yield vtk.content(mesh)


def _of_solid(solid: "Solid", states: Sequence[Frame], number: int) -> Iterator[bytes | None]:
    """Yield the ``.vtu`` file of a finite element body in each state, None where its fields are not known."""
    from isorod.output.solids import grid

    for state in states:
        yield vtk.content(grid(solid, state.solids[number], state.activation)) if any(state.solids) else None


def _collection(entries: Sequence[tuple[float, int, str]]) -> bytes:
    """Return the content of a ``.pvd`` file of ``.vtu`` files, each of a time and a body."""
    lines = [
        f'    <DataSet timestep="{time!r}" group="" part="{b}" file={quoteattr(name)}/>' for time, b, name in entries
    ]
    return "\n".join(
        [
            '<?xml version="1.0"?>',
            '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
            "  <Collection>",
            *lines,
            "  </Collection>",
            "</VTKFile>\n",
        ]
    ).encode()


def _table(curves: Mapping[str, Array]) -> bytes:
    """Return the content of a file of comma-separated values, with all digits."""
    rows = np.column_stack(list(curves.values())).tolist()
    return b"".join([results.row(list(curves)), *(results.row([repr(one) for one in row]) for row in rows)])


def _free_name(folder: Path, scene: str, bodies: int) -> str:
    """Return a prefix for the files of a run that no file of the folder or of a record has."""
    taken = {path.name for path in folder.iterdir()}
    records = (folder / RECORDS).read_bytes() if (folder / RECORDS).is_file() else b""
    for run in chain([scene], (f"{scene}-run{number}" for number in count(2))):
        names = [f"{run}-frames", f"{run}.pvd", f"{run}.csv", *(f"{run}-{b}.vtu" for b in range(bodies))]
        # Records keep the names of files that were moved elsewhere.
        if not any(name in taken or f'"{name}'.encode() in records for name in names):
            break
    return run
