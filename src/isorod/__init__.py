"""Rods as full 3-D continua, solved through surface control points alone.

What a script needs is here by name: rods (`helix`, `circle`, ...), models (`Space`, `Body`, `Model`, ...) and the
analyses (`statics.solve`, `modal.solve`, `buckling.solve`, `harmonic.solve`, `random.solve`, `dynamics.solve`).  Each
is loaded when it is first asked for.
"""

import ast
import sys
from functools import cache
from importlib import import_module, util
from importlib.abc import MetaPathFinder
from pathlib import Path
from typing import Any

# The one place of the version: pyproject.toml reads it here, and CITATION.cff repeats it with the date.
__version__ = "0.2.0"


def __getattr__(name: str) -> Any:
    """Load what is offered under a name."""
    if name == "__all__":
        return list(_places())
    module, original = _places().get(name, ("", ""))
    if not module:
        raise AttributeError(f"module 'isorod' has no attribute {name!r}", name=name, obj=sys.modules["isorod"])
    exported = import_module(f"isorod.{name}") if module == "isorod" else getattr(import_module(module), original)
    globals()[name] = exported
    return exported


def __dir__() -> list[str]:
    return sorted({*(name for name in globals() if name.startswith("__")), *_places()})


@cache
def _places() -> dict[str, tuple[str, str]]:
    """Return for each name of ``__init__.pyi`` its module and its name there."""
    nodes = ast.parse(Path(__file__).with_suffix(".pyi").read_text()).body
    imports = [node for node in nodes if isinstance(node, ast.ImportFrom)]
    return {alias.asname: (node.module, alias.name) for node in imports for alias in node.names}


class _MpiFirst(MetaPathFinder):
    """Loads MPI when PETSc is first asked for: the wheels' PETSc finds its library only if that is there already."""

    def find_spec(self, fullname: str, *_: Any) -> None:
        """Find nothing itself."""
        if fullname in ("petsc4py", "slepc4py"):
            sys.meta_path.remove(self)
            import_module("mpi4py.MPI")


if util.find_spec("dolfinx_solver"):
    sys.meta_path.insert(0, _MpiFirst())
