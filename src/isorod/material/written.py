"""Modules of laws' functions, generated from their energies and kept as files.

Each is a file in the folders of `isorod.keeping`, so that the next process loads what Numba compiled it to.
"""

import os
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isorod import __version__, keeping
from isorod.material.points import Compiled

if TYPE_CHECKING:
    from isorod.material.energy import Energy

_OWN = Path(__file__).parent


@cache
def compiled(energy: "Energy") -> Compiled:
    """Return the compiled functions of an energy."""
    from isorod.material.generate import source

    return of_text(source(energy))


def of_text(text: str) -> Compiled:
    """Return the compiled functions of the source of a module."""
    return _functions(_name(text), lambda: text)


@cache
def named(make: Callable[..., "Energy"], *given: Any) -> Compiled:
    """Return the compiled functions of the energy that a function returns; SymPy is loaded if none are kept.

    Parameters
    ----------
    make
        A function of a module of this folder, identified by its name and the text of the folder.
    given
        Its arguments, identified by their representations.
    """

    def text() -> str:
        from isorod.material.generate import source

        return source(make(*given))

    return _functions(_name(f"{make.__module__}.{make.__qualname__}{given!r}"), text)


def _name(text: str) -> str:
    # Compiled modules hold copies of functions of this folder.
    return f"law_{sha256(f'{__version__} {_texts()} {text}'.encode()).hexdigest()[:16]}"


@cache
def _texts() -> str:
    """Return a hash of the source of energies and of the generator."""
    return sha256(b"".join(file.read_bytes() for file in sorted(_OWN.glob("*.py")))).hexdigest()


@cache
def _functions(name: str, text: Callable[[], str]) -> Compiled:
    """Return the functions of a module, which is written if not kept."""
    folders = [folder / "isorod-laws" for folder in (*keeping.places(), keeping.room())]
    path = next((path for folder in folders if (path := folder / f"{name}.law").is_file()), None)
    path = path or _write(folders[-1] / f"{name}.law", text())
    # The suffix differs from that of files of the package.
    loader = SourceFileLoader(f"isorod_{name}", str(path))
    spec = spec_from_loader(loader.name, loader)
    assert spec is not None
    module = module_from_spec(spec)
    sys.modules[loader.name] = module
    loader.exec_module(module)
    return Compiled(module.block, module.tangent, getattr(module, "update", None))


def _write(path: Path, text: str) -> Path:
    """Write a file atomically, readable by others."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, draft = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    with os.fdopen(handle, "w") as file:
        file.write(text)
    os.chmod(draft, 0o644)
    return Path(draft).replace(path)
