"""Meshes of the spring (Lu & Zhou 2011, section 4.2)."""

from isorod.errors import InputError
from isorod.geometry.rod import Rod
from isorod.scenes.spring import Spring
from meshes.bricks import bricks
from meshes.mesh import Mesh
from meshes.template import o_grid
from meshes.tetrahedra import tetrahedra

CELLS = ("bricks", "tetrahedra", "paper")


def rod() -> Rod:
    """Return the wire that all meshes below are meshes of."""
    return Spring(helix="paper").rod()


def build(
    cells: str = "bricks",
    around: int = 8,
    layers: int = 48,
    order: int = 2,
    rings: int = 1,
    core: float | None = None,
) -> Mesh:
    """Return a mesh of the spring.

    Parameters
    ----------
    cells
        ``"bricks"``, ``"tetrahedra"``, or ``"paper"``: the mesh whose counts the paper gives (7081 nodes, 6048
        straight-sided 8-node bricks: a 6 x 6 core and two rings, 72 layers), to which the other parameters do not
        apply.
    around, layers
        Numbers of cells round the wire and along it.
    order
        Polynomial order of the geometry: bricks 1 to 4, tetrahedra 1 or 2.
    rings, core
        Bricks only: rings round the core and radius of the core's corners.
    """
    if cells == "paper":
        return bricks(rod(), o_grid(24, 2, 1), 72)
    if cells == "tetrahedra":
        return tetrahedra(rod(), around, layers, order)
    if cells == "bricks":
        return bricks(rod(), o_grid(around, rings, order, core), layers)
    raise InputError(f"cells: got {cells!r}, need one of {', '.join(CELLS)}")
