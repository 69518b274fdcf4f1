"""Meshes of the biceps (Lu & Zhou 2011, section 5): two branches of tendon, muscle and tendon each."""

from collections.abc import Sequence

import numpy as np

from isorod.errors import InputError
from isorod.geometry.rod import Rod
from isorod.scenes.biceps import Biceps
from meshes.bricks import bricks
from meshes.free import free
from meshes.mesh import Index, Mesh, join
from meshes.template import o_grid

CELLS = ("tetrahedra", "bricks")
BRANCHES = ("first", "second")


def rods() -> tuple[Rod, Rod]:
    """Return the branches that all meshes below are meshes of."""
    return Biceps().rods()


def build(
    cells: str = "tetrahedra",
    size: float = 0.3325,
    around: int = 8,
    layers: int = 6,
    order: int = 1,
    rings: int = 1,
    cuts: int = 1,
    branches: Sequence[Rod] | None = None,
) -> Mesh:
    """Return a mesh of both branches, which have no node in common.

    Faces are named ``first start``, ``first end``, ``first belly`` (the muscle's lateral surface) and ``first tendons``
    (the tendons'), likewise ``second``; regions ``first muscle``, all axis elements but the outer two, and
    ``first tendons``, those.

    Parameters
    ----------
    cells
        ``"tetrahedra"``, unstructured, of edges about ``size`` long everywhere (0.3325: about 25,900, on 6,100 nodes;
        the paper has 25,315 on 7,413),
        or ``"bricks"``, which the rest is for.
    around, layers, rings
        Bricks: numbers round each branch, along each element of its axis, and of rings round the core.
    order
        Polynomial order of the geometry: bricks 1 to 4, tetrahedra 1 or 2.
    cuts
        Bricks: the axis elements next to the held ends are cut so often, 1 : 2 : 4 ... from the end on, before layers
        are counted.
    branches
        Two rods of at least three axis elements; the scene's if not given.
    """
    if cells not in CELLS:
        raise InputError(f"cells: got {cells!r}, need one of {', '.join(CELLS)}")
    if not 0 <= cuts <= 8:
        raise InputError(f"cuts: got {cuts}, need 0 to 8")
    parts = []
    for name, rod in zip(BRANCHES, rods() if branches is None else branches, strict=True):
        breaks = rod.axis.breaks
        if len(breaks) < 4:
            raise InputError(f"branch: got {len(breaks) - 1} axis elements, need at least 3 (tendon, muscle, tendon)")
        if cells == "tetrahedra":
            branch = free(rod, size, order)
        else:
            cut = _cut(rod, cuts)
            branch = bricks(cut, o_grid(around, rings, order), layers * cut.axis.elements)
        parts.append(_named(branch, name, breaks[1], breaks[-2]))
    return join(*parts)


def _cut(rod: Rod, cuts: int) -> Rod:
    """Return the same rod with its first and last axis element cut."""
    breaks = rod.axis.breaks
    fractions = (2.0 ** np.arange(1, cuts + 1) - 1.0) / (2.0 ** (cuts + 1) - 1.0)
    for u in (*breaks[0] + fractions * (breaks[1] - breaks[0]), *breaks[-1] - fractions * (breaks[-1] - breaks[-2])):
        rod = rod.insert(u)
    return rod


def _named(mesh: Mesh, name: str, low: float, high: float) -> Mesh:
    """Return a branch with its lateral surface and its volume divided.

    Between ``low`` and ``high`` on the axis is the muscle.
    """
    assert mesh.parameters is not None
    u = mesh.parameters[:, 2]

    def in_muscle(nodes: Index) -> Index:
        middle = u[nodes].mean(axis=1)
        return (middle > low) & (middle < high)

    lateral = mesh.faces["lateral"]
    belly, muscle = in_muscle(lateral), in_muscle(mesh.cells)
    faces = {
        "start": mesh.faces["start"],
        "end": mesh.faces["end"],
        "belly": lateral[belly],
        "tendons": lateral[~belly],
    }
    regions = {"muscle": np.flatnonzero(muscle), "tendons": np.flatnonzero(~muscle)}
    return Mesh(
        mesh.shape,
        mesh.order,
        mesh.points,
        mesh.cells,
        mesh.reference,
        {f"{name} {key}": nodes for key, nodes in faces.items()},
        mesh.face_reference,
        mesh.parameters,
        {f"{name} {key}": numbers for key, numbers in regions.items()},
    )
