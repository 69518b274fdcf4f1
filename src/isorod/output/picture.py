"""Pictures of deformed rods, drawn without a display or in a window."""

import ctypes
import logging
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from ctypes.util import find_library
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError, whole_number
from isorod.output import vtk
from isorod.output.results import write_beside
from isorod.output.skin import Skin, skin

if TYPE_CHECKING:
    from PIL.Image import Image

# Direction of view of bodies with the same extent in all directions, another for rods along the first; width and height
# of a picture in pixels.
VIEW: tuple[float, float, float] = (1.0, -1.4, 0.55)
_OTHER = (-1.0, -1.4, 0.55)
SIZE: tuple[int, int] = (1000, 700)

# A perceptually uniform colour map, also in grey and for the colour-blind.
COLOURS = "viridis"

# The colour bar at the right of a picture, and the pixels of the width for it.
_BAR = {"vertical": True, "color": "black", "fmt": "%.4g", "title_font_size": 16, "label_font_size": 15}
_ROOM = 150

# Pixels below the colour bar for the axes, and above these for text; and above the bar.
_AXES, _WORDS, _ABOVE = 100, 90, 26

# Height of pictures in pixels below which there is no room for axes, nor for numbers inside the colour bar.
_LOW = 400

# Intervals of the colour bar at most, with round ends; values that differ by less than this fraction are equal.
_PARTS, _ALIKE = 5, 1e-3

# Foreshortening of long directions: 0 is none.
_FORESHORTENED = 0.12

# Letters in a line below the colour bar.
_NARROW = 14

# Height of a line of text, pixels.
_LINE = 20

# Fraction of the picture left empty round the rods.
_MARGIN = 0.08

# Angle of view of the height of a picture, degrees.
_ANGLE = 12.0


class Frame(NamedTuple):
    """Bodies at rest, as meshes with ``motion`` and ``colour`` at their points, and the text above them.

    ``amplitude`` is the factor of the motion, ``note`` the text below the colour bar, after least and largest value.
    """

    meshes: Sequence[Any]
    words: str = ""
    amplitude: float = 1.0
    note: str = ""


def check(view: Sequence[float] | None, size: Sequence[int], what: str = "plot") -> None:
    """Raise `InputError` for an invalid direction of view or size of a picture, or if pyvista is not installed."""
    vtk.require("pictures")
    without_display()
    check_size(size, what)
    if view is None:
        return
    try:
        along = np.asarray(view, dtype=float)
    except (TypeError, ValueError):
        along = np.zeros(0)
    if along.shape != (3,) or not np.isfinite(along).all() or not along.any():
        raise InputError(f"{what}: got view {view!r:.40}, need a direction such as (1, -1, 0.5)")


def check_size(size: Sequence[int], what: str = "plot") -> None:
    """Raise `InputError` for an invalid size of a picture."""
    if np.shape(size) != (2,):
        raise InputError(f"{what}: got size {size!r:.40}, need width and height in pixels")
    for name, pixels in zip(("width", "height"), size, strict=True):
        whole_number(f"{what}: {name} in pixels", pixels, 200, 16384)


def draw(
    frames: Sequence[Frame],
    title: str,
    scale: float = 1.0,
    view: Sequence[float] | None = None,
    size: Sequence[int] = SIZE,
    window: bool = False,
    shape: bool = False,
) -> "Iterator[Image]":
    """Yield a picture of each frame, all with the same colour bar and camera.

    The outline of the bodies at rest is grey.

    Parameters
    ----------
    title
        Title of the colour bar.
    scale
        Factor of the motions.
    view
        Direction to the camera; by default that of `view_of`.
    size
        Width and height, pixels.
    window
        Show each in a window instead, until that is closed.
    shape
        Whether motions are a mode shape of arbitrary size: colours are then relative to the largest value.
    """
    skins = {id(mesh): skin(mesh) for frame in frames for mesh in frame.meshes}
    if shape:
        largest = max(float(shown_skin.faces.point_data["colour"].max()) for shown_skin in skins.values())
        for shown_skin in skins.values():
            shown_skin.faces.point_data["colour"] /= largest or 1.0
        title = f"{title.splitlines()[0]}\n(largest is 1)"
    factor = "" if shape else f"displacements × {scale:.3g}"
    values = np.concatenate([shown_skin.faces.point_data["colour"] for shown_skin in skins.values()])
    lowest, highest = 0.0 if shape else float(np.nanmin(values)), float(np.nanmax(values))
    ticks = scaled(lowest, highest)
    limits, colour_bar = (float(ticks[0]), float(ticks[-1])), bar(title, size, len(ticks))
    range_text = f"least {lowest:.3g}\nlargest {highest:.3g}" if highest > lowest and not shape else ""
    points: list[Array] = [shown_skin.faces.points for shown_skin in skins.values()]
    for frame in frames:
        points += [skins[id(mesh)].moved(scale * frame.amplitude).faces.points for mesh in frame.meshes]
    all_points = np.concatenate(points)
    texts = [f"{frame.words}\n{factor}".strip() for frame in frames]
    for frame, text in zip(frames, texts, strict=True):
        with stage(size, window) as plotter:
            for k, mesh in enumerate(frame.meshes):
                shown_skin = skins[id(mesh)]
                if scale * frame.amplitude:
                    plotter.add_silhouette(shown_skin.whole, color="grey", line_width=1.5)
                moved = shown_skin.moved(scale * frame.amplitude)
                add_skin(plotter, moved, "colour", limits, colour_bar if k == 0 else None)
            write(plotter, text, (10, 8))
            write(
                plotter,
                f"{range_text}\n{fill(frame.note, _NARROW)}".strip(),
                (size[0] - _ROOM + 10, -6 if size[1] < _LOW else -_AXES),
            )
            if size[1] >= _LOW:
                add_axes(plotter, size)
            look(plotter.camera, all_points, view, size, words=texts[0])
            if not window:
                yield taken(plotter)
            else:
                wait(plotter)


@contextmanager
def stage(size: Sequence[int], window: bool = False, **more: Any) -> Iterator[Any]:
    """Open an empty white picture, a pyvista plotter with options ``more``, and close it at the end."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=not window, window_size=list(size), border=False, **more)
    try:
        plotter.set_background("white")
        yield plotter
    finally:
        plotter.close()


def taken(plotter: Any) -> "Image":
    """Return the picture."""
    from PIL import Image

    return Image.fromarray(plotter.screenshot(return_img=True))


def wait(plotter: Any) -> None:
    """Show the picture in its window until that is closed; Ctrl-C, which VTK ignores, ends the program."""
    before = signal.signal(signal.SIGINT, signal.SIG_DFL), signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        plotter.show(title="isorod")
    finally:
        for number, handler in zip((signal.SIGINT, signal.SIGTERM), before, strict=True):
            signal.signal(number, handler)


def write(plotter: Any, words: str, place: tuple[int, int], size: int = 11, colour: str = "black") -> None:
    """Write text, the first line at a place: pixels from the left, and from above or, where negative, from below."""
    across, below = place
    height = plotter.window_size[1]
    text = plotter.add_text(words, position=(across, height - below if below >= 0 else -below), color=colour)
    text.prop.font_size = round(1.5 * size)
    text.prop.justification_vertical = "top" if below >= 0 else "bottom"


def label(plotter: Any, words: str, place: Array) -> None:
    """Write text that begins with a dot, with the dot at a point ``(3,)``, in front of everything."""
    import pyvista

    text = pyvista.Text(words)
    text.GetPositionCoordinate().SetCoordinateSystemToWorld()
    text.GetPositionCoordinate().SetValue(*place)
    text.prop.font_size, text.prop.color = 15, "black"
    text.prop.background_color, text.prop.background_opacity = "white", 0.85
    text.prop.justification_vertical = "center"
    plotter.add_actor(text, reset_camera=False)


def add_lines(plotter: Any, lines: Sequence[Array], colour: str, width: float, **more: Any) -> None:
    """Add lines through points, shape ``(m, 3)`` each."""
    import pyvista

    counts = [len(line) for line in lines]
    starts = np.concatenate([[0], np.cumsum(counts)])
    cells = [
        np.concatenate([[count], start + np.arange(count)]) for count, start in zip(counts, starts[:-1], strict=True)
    ]
    mesh = pyvista.PolyData(np.concatenate(lines), lines=np.concatenate(cells))
    plotter.add_mesh(mesh, color=colour, line_width=width, lighting=False, **more)


def scaled(low: float, high: float) -> Array:
    """Return the round numbers of a colour bar for values from ``low`` to ``high``."""
    from matplotlib.ticker import MaxNLocator

    if high - low <= _ALIKE * max(abs(low), abs(high)):
        # A constant but for round-off.
        low, high = min(low, 0.0), max(high, 0.0)
    return np.asarray(MaxNLocator(_PARTS, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high))


def bar(title: str, size: Sequence[int], numbers: int) -> dict[str, Any]:
    """Return the settings of the colour bar of a picture, or of a panel, of a size in pixels, with so many numbers."""
    low = size[1] < _LOW
    below = (_WORDS + (0 if low else _AXES)) / size[1]
    place = {"position_x": 1.0 - 0.8 * _ROOM / size[0], "width": 0.5 * _ROOM / size[0]}
    place |= {"position_y": below, "height": 1.0 - _ABOVE / size[1] - below}
    return _BAR | place | {"title": f"{title}\n ", "n_labels": 2 if low else numbers}


def add_axes(plotter: Any, size: Sequence[int]) -> None:
    """Add the directions of x, y and z, in the corner below the colour bar."""
    plotter.add_axes(color="black", line_width=2, viewport=(1.0 - _AXES / size[0], 0.0, 1.0, _AXES / size[1]))


def view_of(points: Array) -> Array:
    """Return the direction from which points ``(m, 3)`` are seen with little foreshortening.

    It is `VIEW` with small components along the principal axes of large extent.
    """
    spread = np.cov(points.T)
    spread /= np.trace(spread)

    def across(view: Array) -> Array:
        direction = np.linalg.solve(spread + _FORESHORTENED * np.eye(3), view)
        return np.asarray(direction / np.linalg.norm(direction))

    first, other = (across(np.array(one)) for one in (VIEW, _OTHER))
    return other if other @ spread @ other < first @ spread @ first - 0.5 * _FORESHORTENED else first


def look(
    camera: Any,
    points: Array,
    view: Sequence[float] | Array | None,
    size: Sequence[int],
    up: Array | None = None,
    room: int = _ROOM,
    words: str = "",
) -> None:
    """Set a distant camera so that points ``(m, 3)`` fill the picture beside the colour bar.

    The direction is ``view``, or that of `view_of`.  Upright is ``up``, by default z, or y in a view along z.  ``room``
    are the pixels of the colour bar; above is room for ``words``.
    """
    above = _LINE * (words.count("\n") + 1) if words else 0
    along = view_of(points) if view is None else np.asarray(view, dtype=float)
    towards = along / np.linalg.norm(along)
    if up is None:
        up = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(towards, right), towards])
    low, high = (points @ axes.T).min(axis=0), (points @ axes.T).max(axis=0)
    extent = np.maximum(high - low, 1e-6 * (high - low).max())
    upright, wide = extent[1] * size[1] / (size[1] - above), extent[0] * size[1] / (size[0] - room)
    height = max(upright, wide) / (1.0 - 2.0 * _MARGIN)
    # Silhouettes need a camera at a finite distance; the nearest points fit.
    distance = 0.5 * height / np.tan(np.radians(0.5 * _ANGLE)) + 0.5 * extent[2]
    middle = axes.T @ (0.5 * (low + high))
    camera.focal_point, camera.position, camera.up = middle, middle + distance * towards, axes[1]
    camera.view_angle = _ANGLE
    camera.clipping_range = (0.5 * (distance - 0.5 * extent[2]), distance + extent[2])
    camera.SetWindowCenter(room / size[0], above / size[1])


def without_display() -> None:
    """Let VTK draw off screen, and silence Matplotlib; must come before pyvista is imported."""
    quiet()
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


def quiet() -> None:
    """Silence Matplotlib's messages on the folder of its font cache."""
    logging.getLogger("matplotlib").setLevel(logging.ERROR)


def need_display(instead: str) -> None:
    """Raise `InputError` if there is no display for a window; ``instead`` is the option that needs none."""
    if sys.platform == "darwin":
        return
    name = os.environ.get("DISPLAY")
    if not name:
        raise InputError(f"there is no display for a window; give {instead}")
    # VTK would end the process.
    library = ctypes.CDLL(find_library("X11") or "libX11.so.6")
    library.XOpenDisplay.restype = ctypes.c_void_p
    opened = library.XOpenDisplay(name.encode())
    if not opened:
        raise InputError(f"the display {name} cannot be opened for a window; give {instead}")
    library.XCloseDisplay(ctypes.c_void_p(opened))


def save(image: "Image", path: Path) -> None:
    """Write a PNG file, all of it or nothing; raises `InputError` if it cannot be written."""
    write_beside(path, lambda where: image.save(where, format="PNG"))


def add_flat(
    plotter: Any,
    mesh: Any,
    field: str,
    scale: tuple[float, float],
    bar: dict[str, Any] | None,
    motion: str = "displacement",
) -> None:
    """Add the surface of a mesh moved by its ``motion``, in the exact colours of a field.

    Shading would falsify them, so lines show the shape: the outline, and the edges of connected parts of the mesh.
    ``bar`` describes the colour bar.
    """
    add_skin(plotter, skin(mesh).moved(1.0, motion), field, scale, bar)


def add_skin(plotter: Any, surface: Skin, field: str, scale: tuple[float, float], bar: dict[str, Any] | None) -> Any:
    """Add a skin as `add_flat` does, and return the actor of its faces."""
    actor = plotter.add_mesh(
        surface.faces,
        scalars=field,
        clim=scale,
        cmap=COLOURS,
        lighting=False,
        show_scalar_bar=bar is not None,
        scalar_bar_args=bar,
    )
    # Drawn behind the lines of its edges.
    actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
    actor.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(2.0, 2.0)
    if surface.edges.n_cells:
        plotter.add_mesh(surface.edges, color="black", line_width=1.0, opacity=0.5, lighting=False)
    plotter.add_silhouette(surface.whole, color="black", line_width=2.5)
    return actor
