"""Pictures of deformed rods, drawn without a display."""

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError, whole_number
from isorod.output import vtk

if TYPE_CHECKING:
    from PIL.Image import Image

# The scale of colours, at the right of a picture, and how many pixels of its width are for that.
_BAR = {"vertical": True, "position_y": 0.15, "height": 0.7, "color": "black", "fmt": "%.3g", "title_font_size": 16}
_ROOM = 150

# Share of the picture that is left empty round the rods.
_MARGIN = 0.08

# Of the height of a picture, degrees.
_ANGLE = 12.0


def check(view: Sequence[float], size: Sequence[int]) -> None:
    """Raise `InputError` if a direction is none, the size of a picture cannot be one, or pyvista is not installed."""
    vtk.require()
    without_display()
    try:
        along = np.asarray(view, dtype=float)
    except (TypeError, ValueError):
        along = np.zeros(0)
    if along.shape != (3,) or not np.isfinite(along).all() or not along.any():
        raise InputError(f"plot: got view {view!r:.40}, need a direction such as (1, -1, 0.5)")
    if np.shape(size) != (2,):
        raise InputError(f"plot: got size {size!r:.40}, need width and height in pixels")
    for name, pixels in zip(("width", "height"), size, strict=True):
        whole_number(f"plot: {name} in pixels", pixels, 200, 16384)


def draw(
    meshes: Sequence[Any],
    lines: Sequence[Array],
    title: str,
    scale: float,
    view: Sequence[float],
    size: Sequence[int],
) -> "Image":
    """Return a picture of meshes moved by their ``motion`` and coloured by their ``colour``, on one scale of colours.

    Parameters
    ----------
    meshes
        Bodies at rest, as `isorod.output.vtk.grid` makes them.
    lines
        Their centre lines at rest, shape ``(m, 3)`` each, drawn thin and grey.
    title
        What the colours are.
    scale
        By how much motions are multiplied.
    view
        Direction from which one looks.
    size
        Width and height, pixels.
    """
    import pyvista
    from PIL import Image

    values = np.concatenate([mesh.point_data["colour"] for mesh in meshes])
    plotter = pyvista.Plotter(off_screen=True, window_size=list(size), border=False)
    try:
        plotter.set_background("white")
        for k, mesh in enumerate(meshes):
            mesh.point_data["motion"] = scale * mesh.point_data["motion"]
            own = bar(title, size) if k == 0 else None
            add_flat(plotter, mesh, "colour", (float(values.min()), float(values.max())), "turbo", own, "motion")
        for line in lines:
            plotter.add_mesh(pyvista.lines_from_points(line), color="grey", line_width=1.5, lighting=False)
        shown = [mesh.points + mesh.point_data["motion"] for mesh in meshes]
        look(plotter.camera, np.concatenate([*shown, *lines]), np.asarray(view, dtype=float), size)
        return Image.fromarray(plotter.screenshot(return_img=True))
    finally:
        plotter.close()


def bar(title: str, size: Sequence[int]) -> dict[str, Any]:
    """Return what describes the scale of colours of a picture, or of a panel, of a size in pixels."""
    return _BAR | {"title": title, "position_x": 1.0 - 0.7 * _ROOM / size[0], "width": 0.5 * _ROOM / size[0]}


def look(camera: Any, points: Array, view: Array, size: Sequence[int], up: Array | None = None) -> None:
    """Look at points ``(m, 3)`` so that they fill what the scale of colours leaves of the picture, from far away.

    Upright is ``up``; where not given z, or y where one looks along z.
    """
    towards = view / np.linalg.norm(view)
    if up is None:
        up = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(towards, right), towards])
    low, high = (points @ axes.T).min(axis=0), (points @ axes.T).max(axis=0)
    extent = np.maximum(high - low, 1e-6 * (high - low).max())
    height = max(extent[1], extent[0] * size[1] / (size[0] - _ROOM)) / (1.0 - 2.0 * _MARGIN)
    # Silhouettes want a point to look from; what is nearest fits.
    distance = 0.5 * height / np.tan(np.radians(0.5 * _ANGLE)) + 0.5 * extent[2]
    middle = axes.T @ (0.5 * (low + high))
    camera.focal_point, camera.position, camera.up = middle, middle + distance * towards, axes[1]
    camera.view_angle = _ANGLE
    camera.clipping_range = (0.5 * (distance - 0.5 * extent[2]), distance + extent[2])
    camera.SetWindowCenter(_ROOM / size[0], 0.0)


def without_display() -> None:
    """Let VTK draw off screen; must come before pyvista is imported."""
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


def add_flat(
    plotter: Any,
    mesh: Any,
    field: str,
    scale: tuple[float, float],
    colours: str,
    bar: dict[str, Any] | None,
    motion: str = "displacement",
) -> None:
    """Add the surface of a mesh moved by its ``motion``, in the very colours that the scale has for a field.

    Light and shade would falsify them, so lines show the shape: the outline, and the edges of the mesh's pieces, which
    are what shares points.  ``bar`` describes the scale.
    """
    moved = mesh.warp_by_vector(motion)
    surface = moved.extract_surface(algorithm="dataset_surface")
    actor = plotter.add_mesh(
        surface,
        scalars=field,
        clim=scale,
        cmap=colours,
        lighting=False,
        show_scalar_bar=bar is not None,
        scalar_bar_args=bar,
    )
    # Behind its own lines.
    actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
    actor.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(2.0, 2.0)
    outline = moved.clean(tolerance=1e-6).extract_surface(algorithm="dataset_surface")
    edges = surface.extract_feature_edges(40.0)
    plotter.add_mesh(edges, color="black", line_width=1.0, opacity=0.5, lighting=False)
    plotter.add_silhouette(outline, color="black", line_width=2.5)
