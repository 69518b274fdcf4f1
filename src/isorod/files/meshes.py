"""Meshes of finite element bodies, in files beside the scene's: of gmsh, or XDMF."""

from typing import Any

from isorod.errors import InputError
from isorod.files import msh, values, xdmf
from isorod.files.document import Place, shown


def _mesh(place: Place, value: Any) -> msh.Grid:
    """Return the mesh in a file."""
    if not isinstance(value, str):
        raise place.error(f"got {shown(value)}, need {MESH.words}")
    if value.lower().endswith(".xdmf"):
        return xdmf.mesh(place, value)
    content = place.data(value)
    try:
        return msh.read(content)
    except InputError as problem:
        raise place.error(f"{value}: {problem}") from None


def _facets(place: Place, value: Any) -> xdmf.Facets:
    """Return the facets in a file of their own."""
    if not isinstance(value, str) or not value.lower().endswith(".xdmf"):
        raise place.error(f"got {shown(value)}, need {FACETS.words}")
    return xdmf.Facets(place, value)


MESH = values.Kind(_mesh, "the name of a .msh or .xdmf file beside this one")
FACETS = values.Kind(_facets, "the name of an .xdmf file beside this one")
