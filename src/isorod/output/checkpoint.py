"""Checkpoints: the state of a run in one file, from which it continues bit for bit."""

import fcntl
import hashlib
import io
import json
import os
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.output.results import write_whole

# Raised whenever the content, or what is computed from it, changes.
_FORMAT = 10
_HEAD = b"isorod checkpoint "
_DAMAGED = "is damaged or no checkpoint; remove it, or name another file"


def write(path: Path, identity: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
    """Write a checkpoint to a temporary file, then rename it, so that the last one stays until the new one is complete.

    Parameters
    ----------
    identity
        What a run must have in common with the checkpoint to continue from it: plain numbers and strings.
    arrays
        The state, with ``finished``.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    content = io.BytesIO()
    np.savez(content, identity=np.array(json.dumps({"format": _FORMAT} | dict(identity))), **arrays)
    data = content.getvalue()

    head = _HEAD + hashlib.sha256(data).hexdigest().encode() + b"\n"
    try:
        write_whole(path, head + data)
    except InputError as problem:
        raise InputError(f"checkpoint {problem}") from None


def read(path: Path, identity: Mapping[str, Any]) -> dict[str, Array]:
    """Return the state in a checkpoint.

    Raises
    ------
    InputError
        If there is none, it cannot be read, is damaged, or belongs to another run: the message states the difference.
    """
    stored, arrays = _load(path)
    expected = {"format": _FORMAT} | dict(identity)
    for name in expected:
        if stored.get(name) != expected[name]:
            label = name.replace("_", " ")
            if name == "model":
                raise InputError(
                    f"checkpoint {path}: belongs to another model; give the same scene options, or another file"
                )
            raise InputError(
                f"checkpoint {path}: belongs to another run: {label} {stored.get(name)} there, {expected[name]} here"
            )
    return arrays


class Claim:
    """The claim of one run on a checkpoint: a lock on a file beside it, released when its process ends."""

    def __init__(self, path: Path) -> None:
        if not path.name:
            raise InputError(f"checkpoint {path}: is no file; name another")
        self._lock = path.with_name(f".{path.name}.lock")
        self._file: int | None = None
        while self._file is None:
            try:
                file = os.open(self._lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
            except (OSError, ValueError):
                # An unwritable place is refused when the checkpoint is written.
                return
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(file)
                raise InputError(f"checkpoint {path}: another run keeps its state there; name another file") from None
            except OSError:
                # Not every file system has locks.
                pass
            # The former owner of the lock may have removed the file.
            if self._lock.exists() and os.path.samestat(os.stat(self._lock), os.fstat(file)):
                self._file = file
            else:
                os.close(file)

    def release(self) -> None:
        """Release the claim."""
        if self._file is not None:
            self._lock.unlink(missing_ok=True)
            os.close(self._file)
            self._file = None


class Kept:
    """The checkpoint of a run, if it has one: used by the first rank, with errors raised on all.

    Parameters
    ----------
    path
        The file, or None.
    identity
        Returns what a run must have in common with the file to continue from it.
    comm
        Communicator of mpi4py.
    """

    def __init__(self, path: Path | None, identity: Callable[[], Mapping[str, Any]], comm: Any) -> None:
        self.path, self._comm = path, comm
        self._identity = {} if path is None else identity()
        self._claim: Claim | None = None

    def begin(self, resume: bool, anew: bool = False) -> dict[str, Array] | None:
        """Return the state to continue from, None at the start; the file is claimed until `close`.

        With ``anew`` an existing checkpoint is overwritten.
        """
        if self.path is None:
            return None
        self._on_first(self._take)
        if resume:
            state: dict[str, Array] = self._on_first(read, self.path, self._identity)
            return state
        if not anew:
            self._on_first(refuse_overwriting, self.path)
        return None

    def _take(self) -> None:
        assert self.path is not None
        self._claim = Claim(self.path)

    def keep(self, state: Callable[[], Mapping[str, Array]], reached: str) -> str:
        """Write the state of an interrupted run, which has ``reached`` so far; return a message."""
        if self.path is None:
            return f"{reached} is lost: it had no --checkpoint"
        try:
            self.write(state())
        except InputError as problem:
            return str(problem)
        return f"checkpoint {self.path} has {reached}, --resume goes on from there"

    def write(self, state: Mapping[str, Array]) -> None:
        """Write a state."""
        if self.path is not None:
            self._on_first(write, self.path, self._identity, state)

    def close(self) -> None:
        """Release the claim on the file."""
        if self._claim is not None:
            self._claim.release()

    def _on_first(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return _on_first(self._comm, function, *arguments)


def look(path: Path, name: str, comm: Any) -> Array | None:
    """Return an array of a checkpoint without checking its run, None if there is none of that name, or no file."""
    array: Array | None = _on_first(comm, lambda: _load(path)[1].get(name) if os.path.exists(path) else None)
    return array


def _on_first(comm: Any, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function on the first rank, and return its result, or raise its `InputError`, on all."""
    result = None
    if comm.Get_rank() == 0:
        try:
            result = function(*arguments)
        except InputError as problem:
            result = problem
    result = comm.bcast(result)
    if isinstance(result, InputError):
        raise result
    return result


def refuse_overwriting(path: Path) -> None:
    """Raise `InputError` if the file exists."""
    # Impossible names are refused when the checkpoint is written.
    if not os.path.exists(path):
        return
    _, arrays = _load(path)
    if not arrays["finished"]:
        raise InputError(f"checkpoint {path}: is of an unfinished run; continue it with --resume, or remove it")
    raise InputError(
        f"checkpoint {path}: is of a finished run; remove it, name another file, or go on from it with --resume and a "
        "later end time"
    )


def _load(path: Path) -> tuple[dict[str, Any], dict[str, Array]]:
    """Return identity and arrays of a checkpoint; raises `InputError` if it is no checkpoint, or damaged."""
    if os.path.exists(path) and not path.is_file():
        raise InputError(f"checkpoint {path}: is no file; name another")
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"checkpoint {path}: there is none; start without --resume") from None
    except OSError as problem:
        raise InputError(f"checkpoint {path}: cannot be read ({problem.strerror})") from None
    line, _, data = content.partition(b"\n")
    if line != _HEAD + hashlib.sha256(data).hexdigest().encode():
        raise InputError(f"checkpoint {path}: {_DAMAGED}")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        return json.loads(str(arrays.pop("identity"))), arrays
    except (ValueError, KeyError, EOFError, AttributeError, NotImplementedError, zipfile.BadZipFile, zlib.error):
        raise InputError(f"checkpoint {path}: {_DAMAGED}") from None
