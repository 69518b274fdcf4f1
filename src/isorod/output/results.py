"""Results as records, one JSON line a run, and writing that leaves nothing half-done."""

import fcntl
import json
import math
import os
import platform
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any, BinaryIO

from isorod import __version__
from isorod.errors import InputError, SolveError


def provenance() -> dict[str, Any]:
    """Return versions, commit, machine and time, to be kept with every result."""
    versions = {"isorod": __version__, "python": platform.python_version()}
    for name in ("numpy", "scipy", "numba", "petsc4py"):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            # It came within another package; what was not loaded had no part in the result.
            if name in sys.modules:
                versions[name] = sys.modules[name].__version__
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
    """Append the record to a file of JSON lines, as a whole even when several processes do.

    What a process killed while it wrote has left of a line is taken off first, with a warning; whole lines stay.
    """
    data = (line(record) + "\n").encode()
    try:
        with open(path, "a+b") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            data = _mend(file, path) + data
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
    except OSError as problem:
        raise InputError(f"{path}: cannot be written ({problem.strerror})") from None


def is_torn(text: bytes) -> bool:
    """Return whether a last line without its end of line is but the beginning of a record."""
    try:
        return not isinstance(json.loads(text), dict)
    except (ValueError, RecursionError):
        return True


def _mend(file: BinaryIO, path: Path) -> bytes:
    """Cut a torn last line off a file that is locked; return the end of line that a whole one lacks."""
    size = file.seek(0, os.SEEK_END)
    tail = b""
    while size > len(tail) and b"\n" not in tail:
        start = max(0, size - 2 * len(tail) - 4096)
        file.seek(start)
        tail = file.read(size - start)
    tail = tail.rpartition(b"\n")[2]
    if not tail:
        return b""
    if not is_torn(tail):
        return b"\n"
    warnings.warn(f"{path}: the last line is torn, as of a run that was killed; it is removed", stacklevel=3)
    file.truncate(size - len(tail))
    return b""


def check_folder(path: str) -> None:
    """Raise `InputError` if a results folder of that name cannot be made or written to; makes nothing."""
    if not path:
        raise InputError("results folder: got an empty name")
    place = Path(path).absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    try:
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as problem:
        raise InputError(f"results folder {path}: cannot write there ({problem.strerror}); name another") from None


def make_folder(path: str) -> Path:
    """Return the results folder, made if need be; raises `InputError`."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise InputError(f"results folder {path}: cannot be made ({problem.strerror}); name another") from None
    return folder


def write_beside(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` make a file beside ``path``, then rename it: the name never shows a half-written file."""
    name = ""
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
        os.close(handle)
        write(Path(name))
        os.chmod(name, 0o666 & ~_umask())
        os.replace(name, path)
    except OSError as problem:
        raise InputError(f"{path}: cannot be written ({problem.strerror})") from None
    finally:
        if name:
            Path(name).unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} does not go into a result")


def _commit() -> str | None:
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() or None


def _processor() -> str:
    try:
        for text in Path("/proc/cpuinfo").read_text().splitlines():
            if text.startswith("model name"):
                return text.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
