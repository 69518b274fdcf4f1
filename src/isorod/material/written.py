"""Where the modules of laws' functions are kept, which are made from their energies, and what is read from them.

Each stands in a file of its own, so that what Numba compiles it to is found by the next process.  Like Numba's own
these files stand in ``NUMBA_CACHE_DIR`` if that is set, else beside the laws, else, where that cannot be written to, in
the user's folder of caches.
"""

import atexit
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numba import config

from isorod import __version__
from isorod.material.points import Compiled

if TYPE_CHECKING:
    from isorod.material.energy import Energy

_OWN = Path(__file__).parent


@cache
def compiled(energy: "Energy") -> Compiled:
    """Return the compiled functions of an energy."""
    from isorod.material.generate import source

    text = source(energy)
    return _functions(_name(text), lambda: text)


@cache
def named(make: Callable[..., "Energy"], *given: Any) -> Compiled:
    """Return the compiled functions of the energy that a function returns; SymPy is loaded where none are kept.

    Parameters
    ----------
    make
        A function of a module of this folder, which is known by its name and the text of the folder.
    given
        What it is called with, known by their representations.
    """

    def text() -> str:
        from isorod.material.generate import source

        return source(make(*given))

    return _functions(_name(f"{make.__module__}.{make.__qualname__}{given!r} {_texts()}"), text)


def _name(text: str) -> str:
    return f"law_{sha256(f'{__version__} {text}'.encode()).hexdigest()[:16]}"


@cache
def _texts() -> str:
    """Return what energies and what writes their functions are made of, in short."""
    return sha256(b"".join(file.read_bytes() for file in sorted(_OWN.glob("*.py")))).hexdigest()


@cache
def _functions(name: str, text: Callable[[], str]) -> Compiled:
    """Return the functions of a module, which is kept from then on."""
    path = next((path for one in _folders() if (path := one / f"{name}.law").is_file()), None) or _kept(name, text())
    # Its name does not end as those do that are taken for files of the package.
    loader = SourceFileLoader(f"isorod_{name}", str(path))
    spec = spec_from_loader(loader.name, loader)
    assert spec is not None
    module = module_from_spec(spec)
    sys.modules[loader.name] = module
    loader.exec_module(module)
    return Compiled(module.block, module.tangent)


def _folders() -> list[Path]:
    """Return where modules may be."""
    settings: Any = config
    if settings.CACHE_DIR:
        return [Path(settings.CACHE_DIR) / "isorod-laws"]
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    # Without a home it is no path from the root.
    own = [Path(caches) / "isorod-laws"] if os.path.isabs(caches) else []
    return [_OWN / "__pycache__" / "isorod-laws", *own]


def _kept(name: str, text: str) -> Path:
    """Return the file of a module, in the first folder that takes it."""
    for folder in _folders():
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            return _write(folder / f"{name}.law", text)
    # One that is gone with the process.
    folder = Path(tempfile.mkdtemp(prefix="isorod-laws-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return _write(folder / f"{name}.law", text)


def _write(path: Path, text: str) -> Path:
    """Write a file that others may read; they see the whole of it or none."""
    handle, draft = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    with os.fdopen(handle, "w") as file:
        file.write(text)
    os.chmod(draft, 0o644)
    return Path(draft).replace(path)
