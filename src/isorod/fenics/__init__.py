"""Finite element bodies of dolfinx, which is loaded only if a scene has one."""

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from isorod.errors import InputError

if TYPE_CHECKING:
    from isorod.fenics.solid import Rows as Rows
    from isorod.fenics.solid import Solid as Solid
    from isorod.fenics.solid import Trace as Trace

__all__ = ["Rows", "Solid", "Trace"]


def __getattr__(name: str) -> Any:
    """Load a public name, and dolfinx with it."""
    if name not in __all__:
        raise AttributeError(f"module 'isorod.fenics' has no attribute {name!r}")
    if find_spec("dolfinx") is None:
        raise InputError("finite element bodies need dolfinx, which is not installed: see docker/install")
    from isorod.fenics import solid

    return getattr(solid, name)
