"""Checkpoints: the state of a run in one file, from which it continues to the last bit."""

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

# Raised whenever what is stored, or what is computed from it, changes.
_FORMAT = 10
_HEAD = b"isorod checkpoint "
_DAMAGED = "is damaged or no checkpoint; remove it, or name another file"


def write(path: Path, identity: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
    """Write a checkpoint: beside the name, then renamed, so that the last one stays until the new one is complete.

    Parameters
    ----------
    identity
        What a run must have in common with the checkpoint to continue from it: plain numbers and strings.
    arrays
        The state, ``finished`` among it.

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
        If there is none, it cannot be read, is damaged, or belongs to another run: the message says in what they
        differ.
    """
    found, arrays = _load(path)
    expected = {"format": _FORMAT} | dict(identity)
    for name in expected:
        if found.get(name) != expected[name]:
            what = name.replace("_", " ")
            if name == "model":
                raise InputError(
                    f"checkpoint {path}: belongs to another model; give the same scene options, or another file"
                )
            raise InputError(
                f"checkpoint {path}: belongs to another run: {what} {found.get(name)} there, {expected[name]} here"
            )
    return arrays


class Claim:
    """A checkpoint's name, held by one run at a time: a lock on a file beside it, which ends with its process."""

    def __init__(self, path: Path) -> None:
        if not path.name:
            raise InputError(f"checkpoint {path}: is no file; name another")
        self._lock = path.with_name(f".{path.name}.lock")
        self._file: int | None = None
        while self._file is None:
            try:
                file = os.open(self._lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
            except (OSError, ValueError):
                # What cannot be written to is refused when it is.
                return
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(file)
                raise InputError(f"checkpoint {path}: another run keeps its state there; name another file") from None
            except OSError:
                # Not every file system has locks.
                pass
            # Who had the lock before may have taken the file away.
            if self._lock.exists() and os.path.samestat(os.stat(self._lock), os.fstat(file)):
                self._file = file
            else:
                os.close(file)

    def release(self) -> None:
        """Let other runs have it."""
        if self._file is not None:
            self._lock.unlink(missing_ok=True)
            os.close(self._file)
            self._file = None


class Kept:
    """The file that a run keeps its state in, if it has one; the first rank has it, what it raises all ranks raise.

    Parameters
    ----------
    path
        The file, or None.
    identity
        Returns what a run must have in common with the file to continue from it.
    comm
        The ranks, as mpi4py has them.
    """

    def __init__(self, path: Path | None, identity: Callable[[], Mapping[str, Any]], comm: Any) -> None:
        self.path, self._comm = path, comm
        self._identity = {} if path is None else identity()
        self._claim: Claim | None = None

    def begin(self, resume: bool, anew: bool = False) -> dict[str, Array] | None:
        """Return the state to go on from, None at the start; no other run may have the file until `close`.

        A run that begins ``anew`` takes the place of what it left there before.
        """
        if self.path is None:
            return None
        self._on_first(self._take)
        if resume:
            found: dict[str, Array] = self._on_first(read, self.path, self._identity)
            return found
        if not anew:
            self._on_first(refuse_overwriting, self.path)
        return None

    def _take(self) -> None:
        assert self.path is not None
        self._claim = Claim(self.path)

    def keep(self, state: Callable[[], Mapping[str, Array]], reached: str) -> str:
        """Keep the state of a run that is interrupted, having ``reached`` so far; return where it is, in words."""
        if self.path is None:
            return f"{reached} is lost: it had no --checkpoint"
        try:
            self.write(state())
        except InputError as problem:
            return str(problem)
        return f"checkpoint {self.path} has {reached}, --resume goes on from there"

    def write(self, state: Mapping[str, Array]) -> None:
        """Keep a state."""
        if self.path is not None:
            self._on_first(write, self.path, self._identity, state)

    def close(self) -> None:
        """Let other runs have the file."""
        if self._claim is not None:
            self._claim.release()

    def _on_first(self, do: Callable[..., Any], *given: Any) -> Any:
        return _on_first(self._comm, do, *given)


def look(path: Path, name: str, comm: Any) -> Array | None:
    """Return one array of a checkpoint whose run is not known yet, None if there is none of that name, or no file."""
    found: Array | None = _on_first(comm, lambda: _load(path)[1].get(name) if os.path.exists(path) else None)
    return found


def _on_first(comm: Any, do: Callable[..., Any], *given: Any) -> Any:
    """Do something on the first rank, and return what it returns, or raise the `InputError` it raises, on all."""
    found = None
    if comm.Get_rank() == 0:
        try:
            found = do(*given)
        except InputError as problem:
            found = problem
    found = comm.bcast(found)
    if isinstance(found, InputError):
        raise found
    return found


def refuse_overwriting(path: Path) -> None:
    """Raise `InputError` if the file is there: no run begins where another has left its state."""
    # A name that no file can have is refused where it is written.
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
    """Return identity and arrays of a checkpoint; raises `InputError` if it is none, or damaged."""
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
