"""Pictures of undeformed models: surfaces and control points, supports, loads and obstacles."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.geometry.axis import Axis
from isorod.geometry.rod import Rod
from isorod.model.body import Body
from isorod.model.contact import Cylinder, Obstacle, Plane, Sphere
from isorod.model.load import SectionLoad
from isorod.model.mean import MeanSupport
from isorod.model.model import Model
from isorod.output import picture
from isorod.output.solids import mesh_of, summary
from isorod.space.space import Space

if TYPE_CHECKING:
    from PIL.Image import Image

# Colours of rods in turn, and of everything else.
_TINTS = ("#e3b587", "#8fb7dd", "#a5cf93", "#d9a0c3", "#c9c07a", "#8ecfc9", "#c3aee0")
_POINTS, _HELD, _MOVED, _LOADED, _OBSTACLE, _LAID = "#a01c1c", "#303030", "#1f5fbf", "#d9480f", "#868c93", "#9db1c4"
_CELLS, _FIRST = "#6d7f5e", "#1b7f4d"

# Points round a section, slices of an element, and slices of a rod at most.
_AROUND = 64
_SLICES, _MOST = 16, 4000

# Pixels at the right for the legend and the axes.
_ROOM = 190

# Largest width of a letter, pixels.
_LETTER = 9

# Length of an arrow over the size of all rods, but at least over the radius of the section, to end outside of it.
_ARROW, _OUT = 0.12, 2.0


def show(
    what: Rod | Space | Body | Model | Sequence[Rod],
    view: tuple[float, float, float] | None = None,
    size: tuple[int, int] = picture.SIZE,
    title: str = "",
) -> "Image":
    """Return a picture of rods with their control points, which a notebook shows; ``save("rod.png")`` keeps it.

    For a model also supports, prescribed displacements, loads, obstacles and finite element bodies; arrows show
    directions, not magnitudes.

    Parameters
    ----------
    what
        A rod, several, or a model of them.
    view
        Direction to the camera; by default one with little foreshortening.
    size
        Width and height, pixels.
    title
        Text above the picture.

    Raises
    ------
    InputError
        If there is nothing to draw, an argument cannot be used, or pyvista is not installed.
    """
    model = what if isinstance(what, Model) else None
    rods = list(_rods(what))
    picture.check(view, size, "show")
    solids = [] if model is None else [summary(solid, f"solid {k}") for k, solid in enumerate(model.solids)]
    with picture.stage(size) as plotter:
        draw(plotter, rods, model, None, "\n".join(filter(None, [title, *solids])), view, size)
        return picture.taken(plotter)


def draw(
    plotter: Any,
    rods: Sequence[Rod],
    model: Model | None,
    start: Array | None,
    title: str,
    view: Sequence[float] | None,
    size: Sequence[int],
) -> None:
    """Draw as `show` does; ``start`` are initial displacements of a motion of the model."""
    surfaces = [_surface(rod) for rod in rods]
    visible = [rod.control_points.reshape(-1, 3) for rod in rods]
    control_points = np.concatenate(visible)
    extent = float(np.linalg.norm(np.ptp(control_points, axis=0)))
    legend = {"control points": _POINTS}
    count = sum(len(points) for points in visible)
    for k, (rod, surface) in enumerate(zip(rods, surfaces, strict=True)):
        for mesh in surface:
            plotter.add_mesh(mesh, color=_TINTS[k % len(_TINTS)], smooth_shading=True, ambient=0.15)
        breaks = rod.axis.breaks if model is None else model.bodies[k].space.axis.breaks
        picture.add_lines(plotter, list(_borders(rod, breaks)), "black", 1.0, opacity=0.6)
        picture.add_lines(plotter, list(_net(rod)), _POINTS, 1.0, opacity=0.45)
        wide = 9 if count < 300 else 6 if count < 1500 else 3
        plotter.add_points(visible[k], color=_POINTS, point_size=wide, render_points_as_spheres=True)
        centre, rim = rod.grid(np.array([[0.0, 0.0], [1.0, 0.0]]), rod.axis.breaks[:1])[0][0]
        x = _arrow(centre, rim - centre, max(0.5 * _ARROW * extent, _OUT * float(np.linalg.norm(rim - centre))))
        plotter.add_mesh(x, color=_FIRST)
        legend["x of the first section"] = _FIRST
        visible.append(x.points)
    if model is not None:
        for name, colour, points in chain(_marks(plotter, model, extent), _obstacles(plotter, model, control_points)):
            legend[name] = colour
            visible.append(points)
        for points in _cells(plotter, model):
            legend["finite elements"] = _CELLS
            visible.append(points)
        if start is not None:
            legend["as it begins"] = _LAID
            visible += _laid(plotter, model, start)
    letters = (size[0] - _ROOM) // _LETTER
    words = "\n".join(fill(line, letters) for line in f"{title}\n{_counts(rods)}".splitlines() if line)
    picture.write(plotter, words, (10, 8))
    picture.write(plotter, _extents(control_points), (10, -8), 9)
    for k, (name, colour) in enumerate(legend.items()):
        picture.write(plotter, name, (size[0] - _ROOM + 10, 8 + 22 * k), 11, colour)
    picture.add_axes(plotter, size)
    along = picture.view_of(control_points) if view is None else view
    picture.look(plotter.camera, np.concatenate(visible), along, size, room=_ROOM, words=words)


def _rods(what: Any) -> Iterator[Rod]:
    """Yield the rods to show."""
    if isinstance(what, Rod):
        yield what
    elif isinstance(what, Space):
        yield what.rod
    elif isinstance(what, Body):
        yield what.space.rod
    elif isinstance(what, Model):
        yield from (body.space.rod for body in what.bodies)
    elif isinstance(what, Iterable) and not isinstance(what, str):
        items = list(what)
        if not items:
            raise InputError("show: got no rods, need at least one")
        for item in items:
            yield from _rods(item)
    else:
        raise InputError(f"show: got {type(what).__name__}, need a Rod, several, or a Model")


def _counts(rods: Sequence[Rod]) -> str:
    """Return a text with the numbers of rods and control points."""
    count = sum(rod.distinct_control_points for rod in rods)
    several = f"{len(rods)} rods, " if len(rods) > 1 else ""
    return f"{several}{count} control points"


def _extents(points: Array) -> str:
    low, high = points.min(axis=0), points.max(axis=0)
    # Round-off is set to zero.
    low, high = (np.where(np.abs(one) < 1e-9 * np.abs(points).max(), 0.0, one) for one in (low, high))
    return "control points: " + ", ".join(
        f"{name} {a:.4g} to {b:.4g}" for name, a, b in zip("xyz", low, high, strict=True)
    )


def _circle(count: int, radius: float = 1.0) -> Array:
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _along(axis: Axis) -> Array:
    """Return axis parameters of slices, kinks included."""
    slices = max(2, min(_SLICES, _MOST // axis.elements))
    breaks = axis.breaks
    return np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * np.arange(slices) / slices).ravel(), breaks[-1])


def _surface(rod: Rod, body: Body | None = None, nodal: Array | None = None) -> list[Any]:
    """Return the surfaces of a rod: outside, hole and end faces; of a body displaced by ``nodal``."""

    def grid(xi: Array, u: Array) -> Array:
        rest = rod.grid(xi, u)[0]
        return rest if body is None or nodal is None else rest + body.space.displacement(nodal, xi, u)[0]

    hole, u = rod.rings[0], _along(rod.axis if body is None else body.space.axis)
    surfaces = [_sheet(grid(_circle(_AROUND), u))]
    if hole > 0.0:
        surfaces.append(_sheet(grid(_circle(_AROUND, hole), u)))
    if not rod.closed:
        face = _face(rod)
        surfaces += [_sheet(points.reshape(*face.shape[:2], 3)) for points in grid(face.reshape(-1, 2), u[[0, -1]])]
    return surfaces


def _face(rod: Rod) -> Array:
    """Return disk points of an end face, from the hole outwards and round, shape ``(9, m, 2)``."""
    return np.asarray(np.linspace(rod.rings[0], 1.0, 9)[:, None, None] * _circle(_AROUND))


def _sheet(points: Array) -> Any:
    """Return quadrilaterals through points ``(a, b, 3)``."""
    import pyvista

    return pyvista.StructuredGrid(*np.moveaxis(points[None], -1, 0)).extract_surface(algorithm="dataset_surface")


def _borders(rod: Rod, breaks: Array) -> Iterator[Array]:
    """Yield the circles between elements, and of open rods those between the rings of end faces."""
    yield from rod.grid(_circle(_AROUND), breaks)[0]
    for radius in rod.rings[:-1] if not rod.closed else ():
        if radius > 0.0:
            yield from rod.grid(_circle(_AROUND, radius), rod.axis.breaks[[0, -1]])[0]


def _net(rod: Rod) -> Iterator[Array]:
    """Yield the polygons of control points round the layers, and those along the rod."""
    points = rod.control_points
    yield from np.concatenate([points, points[:, :1]], axis=1)
    yield from points.swapaxes(0, 1)


def _marks(plotter: Any, model: Model, extent: float) -> Iterator[tuple[str, str, Array]]:
    """Add supports, prescribed displacements and loads; yield name, colour and points of each."""
    for support in model.supports:
        space = model.bodies[support.body].space
        if isinstance(support, MeanSupport):
            nodes, weights = support.middle(space)
            place = (weights @ space.positions[nodes])[None]
            plotter.add_points(place, color=_HELD, point_size=15, render_points_as_spheres=True)
            yield "held mean", _HELD, place
            continue
        nodes = np.asarray(support.nodes)
        held = nodes[space.is_control_point[nodes]]
        layers = np.unique(nodes // space.layer_nodes)
        place = space.positions[held].mean(axis=0)
        breaks = space.rod.axis.breaks
        clamped = nodes.size == space.layer_nodes and layers.size == 1 and layers[0] in (0, space.layers - 1)
        if clamped:
            face = _face(space.rod)
            sheet = space.rod.grid(face.reshape(-1, 2), breaks[[0 if layers[0] == 0 else -1]])[0]
            sheet = sheet.reshape(*face.shape[:2], 3)
            plotter.add_mesh(_sheet(sheet), color=_HELD, lighting=False)
            picture.add_lines(plotter, [sheet[-1]], _HELD, 5.0)
            place = sheet[0].mean(axis=0)
            yield "held end", _HELD, sheet[-1]
        else:
            plotter.add_points(space.positions[held], color=_HELD, point_size=11, render_points_as_spheres=True)
            yield "held control points", _HELD, space.positions[held]
        direction = np.atleast_2d(np.asarray(support.displacement, dtype=float)).mean(axis=0)
        direction = direction * [letter in support.components for letter in "xyz"]
        if np.linalg.norm(direction) > 1e-9 * extent:
            arrow = _arrow(place, direction, max(_ARROW * extent, _OUT * _radius(space.positions[held])))
            plotter.add_mesh(arrow, color=_MOVED)
            yield "prescribed motion", _MOVED, arrow.points
    for load in model.loads:
        if isinstance(load, SectionLoad) and any(load.force or ()):
            rod = model.bodies[load.body].space.rod
            u = rod.axis.breaks[-1] if load.u is None else load.u
            outline = rod.grid(_circle(_AROUND)[:-1], [u])[0][0]
            length = max(_ARROW * extent, _OUT * _radius(outline))
            arrow = _arrow(outline.mean(axis=0), np.asarray(load.force, dtype=float), length)
            plotter.add_mesh(arrow, color=_LOADED)
            yield "force", _LOADED, arrow.points


def _radius(points: Array) -> float:
    """Return the largest distance of points ``(m, 3)`` from their mean."""
    return float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())


def _arrow(place: Array, direction: Array, length: float) -> Any:
    import pyvista

    return pyvista.Arrow(start=place, direction=direction, scale=length, shaft_radius=0.03, tip_radius=0.08)


def _obstacles(plotter: Any, model: Model, rods: Array) -> Iterator[tuple[str, str, Array]]:
    """Add the obstacles of a model's contacts; yield as `_marks` does, with their points near the rods."""
    middle, extent = rods.mean(axis=0), float(np.linalg.norm(np.ptp(rods, axis=0)))
    for obstacle in {id(contact.second): contact.second for contact in model.contacts}.values():
        if isinstance(obstacle, Obstacle):
            mesh = _solid(obstacle, rods)
            plotter.add_mesh(mesh, color=_OBSTACLE, opacity=0.4)
            edges = mesh.extract_feature_edges(20.0)
            if edges.n_points:
                plotter.add_mesh(edges, color=_OBSTACLE, line_width=1.5, lighting=False)
            yield "obstacle", _OBSTACLE, mesh.points[np.abs(mesh.points - middle).max(axis=1) < 0.75 * extent]


def _cells(plotter: Any, model: Model) -> Iterator[Array]:
    """Add the surfaces of finite element bodies with the edges of their cells, and yield points of each."""
    for solid in model.solids:
        outer = mesh_of(solid).extract_surface(algorithm="dataset_surface")
        # Transparent, so that the inside is visible.
        plotter.add_mesh(outer, color=_CELLS, opacity=0.35, lighting=False)
        plotter.add_mesh(outer.extract_all_edges(), color=_CELLS, line_width=1.0, lighting=False)
        yield outer.points


def _laid(plotter: Any, model: Model, displacement: Array) -> Iterator[Array]:
    """Add the displaced rods, and yield their points."""
    for b, body in enumerate(model.bodies):
        for mesh in _surface(body.space.rod, body, model.nodal(displacement, b)):
            plotter.add_mesh(mesh, color=_LAID, smooth_shading=True)
            yield mesh.points


def _solid(obstacle: Obstacle, points: Array) -> Any:
    """Return the mesh of an obstacle; an infinite one is cut off near the points ``(m, 3)``."""
    import pyvista

    middle, extent = points.mean(axis=0), float(np.linalg.norm(np.ptp(points, axis=0)))
    if isinstance(obstacle, Plane):
        normal = np.asarray(obstacle.normal) / np.linalg.norm(obstacle.normal)
        below = middle - ((middle - obstacle.point) @ normal) * normal
        return pyvista.Plane(
            center=below, direction=normal, i_size=extent, j_size=extent, i_resolution=1, j_resolution=1
        )
    if isinstance(obstacle, Cylinder):
        axis = np.asarray(obstacle.axis) / np.linalg.norm(obstacle.axis)
        along = (points - obstacle.point) @ axis
        length = np.ptp(along) + max(0.1 * extent, 0.5 * obstacle.radius)
        center = np.asarray(obstacle.point) + 0.5 * (along.min() + along.max()) * axis
        return pyvista.Cylinder(center=center, direction=axis, radius=obstacle.radius, height=length, resolution=96)
    if isinstance(obstacle, Sphere):
        return pyvista.Sphere(radius=obstacle.radius, center=obstacle.center, theta_resolution=64, phi_resolution=48)
    return pyvista.PolyData.from_regular_faces(
        np.asarray(obstacle.vertices, dtype=float), np.asarray(obstacle.triangles)
    )
