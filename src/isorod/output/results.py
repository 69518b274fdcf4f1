"""Results as records, one JSON line for each run, and atomic writing of files."""

import csv
import errno
import fcntl
import io
import json
import math
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, is_dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from isorod import __version__
from isorod.errors import InputError, SolveError

# Bytes of the smallest allocation on a disk.
_PAGE = 4096


def provenance() -> dict[str, Any]:
    """Return versions, commit, machine and time, to be stored with every result."""
    versions = {"isorod": __version__, "python": platform.python_version()}
    for name in ("numpy", "scipy", "numba", "petsc4py"):
        if name in sys.modules:
            versions[name] = sys.modules[name].__version__
            continue
        # Imported here, as it takes longer than many a run.
        from importlib import metadata

        # A package without metadata that is not loaded had no part in the result.
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
    """Append the record to a file of JSON lines, all of it or nothing, also with concurrent processes.

    Raises
    ------
    InputError
        If the file cannot be written; it is then unchanged.
    """
    text = line(record)
    with locked(path.parent):
        add(path, text)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder until the block or this process ends."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError as problem:
        raise refusal(f"{folder}: cannot be written", problem) from None
    try:
        # Not every file system has locks.
        with suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def add(path: Path, text: str) -> None:
    """Add a line to a file in a folder that is `locked`, all of it or nothing; raises `InputError`."""
    try:
        with open(path, "a+b", buffering=0) as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - 1))
            # A process killed while writing leaves an incomplete line.
            data = (b"\n" if file.read() not in (b"", b"\n") else b"") + text.encode() + b"\n"
            try:
                while data:
                    # A full disk may write a part.
                    data = data[file.write(data) :]
                os.fsync(file.fileno())
            except BaseException:
                file.truncate(size)
                if size == 0:
                    path.unlink()
                raise
    except OSError as problem:
        raise refusal(f"{path}: cannot be written", problem) from None


def read(path: Path) -> list[dict[str, Any]]:
    """Return the records of a file of JSON lines; other lines, as of a killed run, are warned of.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    try:
        lines = path.read_bytes().splitlines()
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror})") from None
    records = [_record(text) for text in lines]
    bad = [number for number, record in enumerate(records, 1) if record is None]
    if bad:
        warnings.warn(f"{path}:{bad[0]}: is no record of a run, and left out ({len(bad)} such lines)", stacklevel=2)
    return [record for record in records if record is not None]


def _record(text: bytes) -> dict[str, Any] | None:
    """Return the record in a line, None if there is none."""
    try:
        record = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return record if isinstance(record, dict) else None


def check_folder(path: str, what: str = "") -> None:
    """Raise `InputError` with the text ``what`` if a folder cannot be made or written to; makes nothing."""
    if not path:
        raise InputError("results folder: got an empty name")
    place = Path(path).absolute()
    try:
        while not place.exists() and place != place.parent:
            place = place.parent
        # A full disk may create a file, but not write its first page.
        with tempfile.TemporaryFile(dir=place, buffering=0) as file:
            file.write(bytes(_PAGE))
    except OSError as problem:
        raise refusal(what or f"results folder {path}: cannot write there", problem) from None


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
    """Yield the results folder, made if need be, and removed after an error if it is empty; raises `InputError`."""
    existed = os.path.isdir(path)
    place = make_folder(path)
    try:
        yield place
    except BaseException:
        if not existed:
            with suppress(OSError):
                place.rmdir()
        raise


def write_beside(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` make a temporary file or folder, then rename it to ``path``: an atomic write.

    Raises
    ------
    InputError
        If it cannot be written; the former file or folder is then unchanged, and nothing else is left.
    """
    beside = path.with_name(f".{uuid4().hex}{path.suffix}")
    try:
        # A device or a pipe would be replaced.
        if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
            raise OSError(errno.EINVAL, "it is no plain file")
        write(beside)
        for file in (beside, *beside.glob("*")):
            handle = os.open(file, os.O_RDONLY)
            # A full disk may be reported only now.
            os.fsync(handle)
            os.close(handle)
        os.replace(beside, path)
    except OSError as problem:
        raise refusal(f"{path}: cannot be written", problem) from None
    finally:
        with suppress(OSError):
            beside.unlink()
        shutil.rmtree(beside, ignore_errors=True)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, all of it or nothing, as `write_beside` does."""
    write_beside(path, lambda beside: beside.write_bytes(content))


def write_arrays(path: Path, **arrays: Any) -> None:
    """Write arrays to an ``.npz`` file, compressed, all of it or nothing."""
    content = io.BytesIO()
    # Written to memory first: on a full disk closing a ZIP file raises repeatedly.
    np.savez_compressed(content, **arrays)
    write_whole(path, content.getvalue())


def refusal(what: str, problem: OSError) -> InputError:
    """Return the error on a failed operation, with its reason and advice."""
    full = problem.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
    advice = "make room there, or name another" if full else "name another"
    return InputError(f"{what} ({problem.strerror or problem}); {advice}")


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    raise TypeError(f"{type(value).__name__} does not go into a result")


@cache
def _commit() -> str | None:
    """Return the commit of this checkout, None for an installed isorod, whatever repository is around it."""
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
    """Return a line of comma-separated values without formulas for spreadsheet programs."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow([_no_formula(one) for one in values])
    return text.getvalue().encode()


def _no_formula(value: str) -> str:
    """Return a value, with an apostrophe before it if it begins like a formula and is no number."""
    if value[:1] not in ("=", "+", "-", "@", "\t", "\r") or not value:
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value
