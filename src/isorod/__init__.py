"""Rods as full 3-D continua, solved through surface control points alone."""

import sys
from importlib import import_module, util
from importlib.abc import MetaPathFinder
from typing import Any

__version__ = "0.1.0"


class _MpiFirst(MetaPathFinder):
    """Loads MPI when PETSc is first asked for: the wheels' PETSc finds its library only if that is there already."""

    def find_spec(self, fullname: str, *_: Any) -> None:
        """Find nothing itself."""
        if fullname in ("petsc4py", "slepc4py"):
            sys.meta_path.remove(self)
            import_module("mpi4py.MPI")


if util.find_spec("dolfinx_solver"):
    sys.meta_path.insert(0, _MpiFirst())
