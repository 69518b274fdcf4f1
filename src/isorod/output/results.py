"""Results as records, one JSON line a run, and writing that leaves nothing half-done."""

import csv
import errno
import fcntl
import io
import json
import math
import os
import platform
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import cache
from io import FileIO
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import numpy as np

from isorod import __version__
from isorod.errors import InputError, SolveError

# What a disk gives room for at least.
_PAGE = 4096


def provenance() -> dict[str, Any]:
    """Return versions, commit, machine and time, to be kept with every result."""
    versions = {"isorod": __version__, "python": platform.python_version()}
    for name in ("numpy", "scipy", "numba", "petsc4py"):
        if name in sys.modules:
            versions[name] = sys.modules[name].__version__
            continue
        # Takes longer to import than many a run.
        from importlib import metadata

        # What came within another package and was not loaded had no part in the result.
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return {
        "versions": versions,
        "commit": _commit(),
        "machine": {"processor": _processor(), "cores": os.cpu_count(), "system": platform.system()},
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def line(record: Mapping[str, Any]) -> str:
    """Return the record as one line of JSON; raises `SolveError` if it has a number that is not finite."""
    try:
        return json.dumps(record, allow_nan=False, default=_plain)
    except ValueError:
        bad = [key for key, value in record.items() if isinstance(value, float) and not math.isfinite(value)]
        raise SolveError(f"result {', '.join(bad) or 'record'} is not a finite number; check the sizes given") from None


def append(path: Path, record: Mapping[str, Any]) -> None:
    """Append the record to a file of JSON lines, as a whole even when several processes do, or not at all.

    What a process killed while it wrote has left of a line is taken off first, with a warning; whole lines stay.
    """
    data = line(record)
    with locked(path) as file:
        add(file, data)


@contextmanager
def locked(path: Path) -> Iterator[FileIO]:
    """Open a file of JSON lines for `add`, by one process at a time; what is added stays only if the block ends well.

    Raises
    ------
    InputError
        If the file cannot be written; it has then the lines that it had before.
    """
    try:
        with _alone(path) as file:
            size, whole = _mend(file, path)
            try:
                if not whole:
                    add(file, "")
                yield file
                os.fsync(file.fileno())
            except BaseException:
                # Half a line, of a disk that is full, would be taken for one of a run that was killed.
                file.truncate(size)
                if size == 0:
                    path.unlink()
                raise
        _settle_names(path.parent)
    except OSError as problem:
        raise refusal(f"{path}: cannot be written", problem) from None


def add(file: FileIO, text: str) -> None:
    """Add a line to a file that `locked` has opened."""
    data = text.encode() + b"\n"
    while data:
        # A disk takes what there is room for, and refuses the rest.
        data = data[file.write(data) :]


@contextmanager
def _alone(path: Path) -> Iterator[FileIO]:
    """Open a file for appending and lock it."""
    while True:
        with open(path, "a+b", buffering=0) as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            # Who had the lock before may have taken an empty file away.
            if path.exists() and os.path.samestat(os.stat(path), os.fstat(file.fileno())):
                yield file
                return


def read(path: Path) -> list[dict[str, Any]]:
    """Return the records of a file of JSON lines; a last line that is torn is left out.

    Raises
    ------
    InputError
        If it cannot be read, or a line is no record.
    """
    try:
        lines = path.read_bytes().splitlines()
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror})") from None
    found = []
    for number, text in enumerate(lines, 1):
        if not is_torn(text):
            found.append(json.loads(text))
        elif number < len(lines):
            raise InputError(f"{path}:{number}: is no record of a run")
    return found


def is_torn(text: bytes) -> bool:
    """Return whether a last line without its end of line is but the beginning of a record."""
    try:
        return not isinstance(json.loads(text), dict)
    except (ValueError, RecursionError):
        return True


def _mend(file: FileIO, path: Path) -> tuple[int, bool]:
    """Cut a torn last line off a file that is locked; return the size that is left, and whether its last line ends."""
    size = file.seek(0, os.SEEK_END)
    if size == 0:
        return 0, True
    with mmap(file.fileno(), 0, access=ACCESS_READ) as text:
        start = text.rfind(b"\n") + 1
        if start == size or not is_torn(text[start:]):
            return size, start == size
    warnings.warn(f"{path}: the last line is torn, as of a run that was killed; it is removed", stacklevel=5)
    file.truncate(start)
    return start, True


def check_folder(path: str, told: str = "") -> None:
    """Raise `InputError`, as it is ``told``, if a folder of that name cannot be made or written to; makes nothing."""
    if not path:
        raise InputError("results folder: got an empty name")
    place = Path(path).absolute()
    try:
        while not place.exists() and place != place.parent:
            place = place.parent
        # A full disk takes the name of a file, but not its first page.
        with tempfile.TemporaryFile(dir=place, buffering=0) as file:
            file.write(bytes(_PAGE))
    except OSError as problem:
        raise refusal(told or f"results folder {path}: cannot write there", problem) from None


def make_folder(path: str) -> Path:
    """Return the results folder, made if need be; raises `InputError`."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise refusal(f"results folder {path}: cannot be made", problem) from None
    return folder


@contextmanager
def folder(path: str) -> Iterator[Path]:
    """Yield the results folder, made if need be, and taken away again if nothing comes into it; raises `InputError`."""
    there = os.path.isdir(path)
    place = make_folder(path)
    try:
        yield place
    except BaseException:
        if not there:
            with suppress(OSError):
                place.rmdir()
        raise


def write_beside(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` make a file beside ``path``, then rename it: the name never shows a half-written file.

    Raises
    ------
    InputError
        If the file cannot be written; what had its name before is then as it was, and nothing is left beside it.
    """
    name = ""
    try:
        # A device or a pipe would be no more.
        if os.path.exists(path) and not os.path.isfile(path):
            raise OSError(errno.EINVAL, "it is no plain file")
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
        os.close(handle)
        write(Path(name))
        open_to_all(Path(name), 0o666)
        settle(Path(name))
        os.replace(name, path)
        _settle_names(path.parent)
    except OSError as problem:
        raise refusal(f"{path}: cannot be written", problem) from None
    finally:
        if name:
            Path(name).unlink(missing_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, all of it or nothing, as `write_beside` does."""
    write_beside(path, lambda beside: beside.write_bytes(content))


def write_arrays(path: Path, **arrays: Any) -> None:
    """Write arrays to an ``.npz`` file, compressed, all of it or nothing."""
    content = io.BytesIO()
    # A ZIP file on a disk that is full says more than once that it cannot be closed.
    np.savez_compressed(content, **arrays)
    write_whole(path, content.getvalue())


def refusal(what: str, problem: OSError) -> InputError:
    """Return the error that says what cannot be done, for which reason, and what would help."""
    full = problem.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
    advice = "make room there, or name another" if full else "name another"
    return InputError(f"{what} ({problem.strerror or problem}); {advice}")


def _settle_names(folder: Path) -> None:
    """Have the disk take the names of files in a folder."""
    handle = os.open(folder, os.O_RDONLY)
    # Not every file system can, and the files themselves are there.
    with suppress(OSError):
        os.fsync(handle)
    os.close(handle)


def settle(path: Path) -> None:
    """Have the disk take what was written to a file; raises `OSError` if it is full, even if the writer was silent."""
    with open(path, "r+b") as file:
        size = file.seek(0, os.SEEK_END)
        # Some writers do not say that they came to the end of the disk, but there is then no room for another page.
        file.write(bytes(_PAGE))
        file.flush()
        file.truncate(size)
        os.fsync(file.fileno())


def open_to_all(path: Path, mode: int) -> None:
    """Give a file or folder made for its owner alone the mode that others have by the process's mask."""
    mask = os.umask(0)
    os.umask(mask)
    os.chmod(path, mode & ~mask)


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} does not go into a result")


@cache
def _commit() -> str | None:
    """Return the commit of the checkout this lies in; a repository around an installed isorod is another's."""
    checkout = Path(__file__).parents[3]
    if not (checkout / ".git").exists():
        return None
    command = ["git", "-C", str(checkout), "describe", "--always", "--dirty"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() or None


@cache
def _processor() -> str:
    try:
        for text in Path("/proc/cpuinfo").read_text().splitlines():
            if text.startswith("model name"):
                return text.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def row(values: Sequence[str]) -> bytes:
    """Return a line of comma-separated values, in which no name is a formula for programs that calculate."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow([_no_formula(one) for one in values])
    return text.getvalue().encode()


def _no_formula(value: str) -> str:
    """Return a value that begins as a formula does, but is no number, with an apostrophe before it."""
    if value[:1] not in ("=", "+", "-", "@", "\t", "\r") or not value:
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value
