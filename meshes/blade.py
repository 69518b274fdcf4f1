"""Meshes of the blade (Lu & Zhou 2011, section 4.3)."""

from isorod.errors import InputError
from isorod.geometry.rod import Rod
from isorod.scenes.blade import Blade
from meshes.bricks import bricks
from meshes.mesh import Mesh
from meshes.split import fan, layered
from meshes.strip import paper_section, strip

CELLS = ("bricks", "tetrahedra", "paper")

# Layers of the mesh whose counts the paper gives.
_PAPER_LAYERS = 14


def rod() -> Rod:
    """Return the blade that all meshes below are meshes of."""
    return Blade().rod()


def build(
    cells: str = "bricks",
    along: int = 6,
    across: int = 1,
    layers: int = 12,
    order: int = 2,
    grading: float = 1.0,
    corners: tuple[float, float] = (4.0, 10.0),
    clustering: float = 1.0,
) -> Mesh:
    """Return a mesh of the blade.

    Parameters
    ----------
    cells
        ``"bricks"``, ``"tetrahedra"`` (of order 2), or ``"paper"``: straight 8-node bricks with the
        counts that the paper gives (15 layers of 69 nodes, 14 x 49 = 686 bricks), to which the other parameters do not
        apply.
    along, across, layers
        Numbers of bricks along the chord, across the thickness and from root to tip.
    order
        Polynomial order of the geometry: bricks 1 to 4, tetrahedra 2.
    grading
        Thinner layers towards the clamped root, see `meshes.bricks.axis_positions`.
    corners, clustering
        See `meshes.strip.strip`.
    """
    body = rod()
    # The paper's outline starts half an arc below the chord's front end.
    turn = -180.0 / body.section_points
    if cells == "paper":
        return bricks(body, paper_section(turn=turn), _PAPER_LAYERS)
    if cells not in CELLS:
        raise InputError(f"cells: got {cells!r}, need one of {', '.join(CELLS)}")
    if cells == "tetrahedra":
        if order != 2:
            raise InputError(f"order of tetrahedra: got {order}, need 2")
        return layered(body, fan(along, across, clustering, turn), layers, grading)
    return bricks(body, strip(along, across, order, corners, clustering, turn), layers, grading)
