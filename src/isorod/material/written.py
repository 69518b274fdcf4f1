"""Where the modules of laws that are made from energies are kept, and what is read from them.

Each stands in a file of its own, named by its text, in ``NUMBA_CACHE_DIR`` if that is set, else in the user's folder
of caches: so that what Numba compiles it to is found by the next process.
"""

import atexit
import os
import shutil
import sys
import tempfile
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from numba import config

from isorod.material.energy import Energy
from isorod.material.generate import source
from isorod.material.points import Compiled


@cache
def compiled(energy: Energy) -> Compiled:
    """Return the compiled functions of an energy."""
    module = _module(source(energy))
    return Compiled(module.block, module.tangent)


@cache
def _module(text: str) -> Any:
    """Return the module of a text, which is in a file from then on."""
    name = f"law_{sha256(text.encode()).hexdigest()[:16]}"
    path = _folder() / f"{name}.py"
    if not path.is_file() or path.read_text() != text:
        handle, draft = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        with os.fdopen(handle, "w") as file:
            file.write(text)
        # Other processes see the whole file or none.
        Path(draft).replace(path)
    spec = spec_from_file_location(f"isorod_{name}", path)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@cache
def _folder() -> Path:
    """Return a folder that can be written to; where there is none, one that is gone with the process."""
    settings: Any = config
    base = settings.CACHE_DIR or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    with suppress(OSError):
        found = Path(base) / "isorod-laws"
        found.mkdir(parents=True, exist_ok=True)
        if os.access(found, os.W_OK):
            return found
    found = Path(tempfile.mkdtemp(prefix="isorod-laws-"))
    atexit.register(shutil.rmtree, found, ignore_errors=True)
    return found
