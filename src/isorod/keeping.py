"""Where compiled code is kept: folders for Numba's cache, each for one state of the sources.

Numba notices a change of the file that a function stands in, but not of the functions and numbers that it takes from
other files.  Therefore the code of each file has a folder whose name is a hash of the file and of those that it
imports.

All of these folders stand in ``NUMBA_CACHE_DIR`` if that is set, else beside the package, else, where that cannot be
written to, in the user's folder of caches, or in a temporary one.  Numba reads only where it can write: links lead from
there to what is compiled beside the package, as where an administrator has installed it.
"""

import atexit
import fcntl
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numba
from llvmlite.binding import get_host_cpu_name

_PACKAGE = Path(__file__).parent
_BESIDE = _PACKAGE / "__pycache__" / "isorod"
_IMPORT = re.compile(r"^from (isorod[\w.]*) import", re.MULTILINE)

_CONFIG: Any = numba.config
_TYPED = _CONFIG.CACHE_DIR


def places() -> list[Path]:
    """Return the folders that last and may have what is kept, in the order in which they are asked for room."""
    if _TYPED:
        return [Path(_TYPED)]
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    # Without a home it is no path from the root.
    return [_BESIDE, *([Path(caches) / "isorod"] if os.path.isabs(caches) else [])]


@cache
def room() -> Path:
    """Return the folder that is written to: the first that takes files, or a temporary one."""
    for folder in places():
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            return folder
    with suppress(OSError):
        folder = Path(tempfile.mkdtemp(prefix="isorod-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        return folder
    # Without even that, Numba refuses to keep anything.
    return _BESIDE


def lasting() -> bool:
    """Return whether what is compiled now can be kept."""
    return room() in places() and os.access(room(), os.W_OK)


@cache
def folder(file: str) -> Path:
    """Return the folder for what is compiled of a file, with links to what is there already beside the package."""
    text = b"".join(one.read_bytes() for one in sorted(_sources(Path(file))))
    name = sha256(_system().encode() + text).hexdigest()[:16]
    result = room() / name
    if not _TYPED and room() != _BESIDE:
        for one in (_BESIDE / name).glob("*/*.nb?"):
            link = result / one.relative_to(_BESIDE / name)
            with suppress(OSError):
                link.parent.mkdir(parents=True, exist_ok=True)
                link.symlink_to(one)
    return result


@cache
def _system() -> str:
    return f"{numba.__version__} {sys.implementation.cache_tag} {get_host_cpu_name()}"


@cache
def _sources(file: Path) -> frozenset[Path]:
    """Return a file with functions to compile and the files that it imports, theirs too if they have such functions."""
    text, result = file.read_text(encoding="utf-8"), {file}
    if "njit(" in text:
        for module in _IMPORT.findall(text):
            imported = _PACKAGE.parent.joinpath(*module.split(".")).with_suffix(".py")
            if imported.is_file():
                result |= _sources(imported)
    return frozenset(result)


@contextmanager
def cache_in(folder: Path, name: str) -> Iterator[None]:
    """Let Numba keep there what it is asked to, while other processes that need the same function wait.

    Locks end with their process, so that none is left behind.
    """
    before = _CONFIG.CACHE_DIR
    with ExitStack() as stack:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            fcntl.flock(stack.enter_context(open(folder / f"{name}.lock", "w")), fcntl.LOCK_EX)
        _CONFIG.CACHE_DIR = str(folder)
        try:
            yield
        finally:
            _CONFIG.CACHE_DIR = before
