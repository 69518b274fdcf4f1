"""Meshes of finite element bodies, in files beside the scene's: of gmsh, or XDMF."""

from typing import Any, NamedTuple

from isorod.errors import InputError
from isorod.files import msh, values, xdmf
from isorod.files.document import Place, shown


class Geometry(NamedTuple):
    """A body's geometry: the name of its STEP file, and what is in it."""

    name: str
    content: bytes


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


def _geometry(place: Place, value: Any) -> Geometry:
    """Return the geometry in a file."""
    if not isinstance(value, str) or not value.lower().endswith((".step", ".stp")):
        raise place.error(f"got {shown(value)}, need {GEOMETRY.words}")
    return Geometry(value, place.data(value))


MESH = values.Kind(_mesh, "the name of a .msh or .xdmf file beside this one")
GEOMETRY = values.Kind(_geometry, "the name of a .step file beside this one")
FACETS = values.Kind(_facets, "the name of an .xdmf file beside this one")
