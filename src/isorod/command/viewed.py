"""What ``isorod view`` shows: the states of a result, drawn one at a time, and the numbers at a place."""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.command import plot
from isorod.errors import InputError
from isorod.output import animation, picture, reading
from isorod.output.skin import Skin, skin
from isorod.output.words import FIELDS

# Parts of a field by its number of components: its magnitude, and the components, of tensors in VTK's order.
_PARTS = {1: ("",), 3: ("", "x", "y", "z"), 6: ("xx", "yy", "zz", "xy", "yz", "xz")}

# Fraction of the largest value below which values are round-off.
_ROUNDING = 1e-12


class State(NamedTuple):
    """A state that can be shown: its name, the step it is of, and the field that moves it."""

    name: str
    step: int
    motion: str = "displacement"

    @property
    def mode(self) -> bool:
        """Whether it is a mode's shape."""
        return self.motion.startswith("mode_")


class Field(NamedTuple):
    """A field as it is shown: its name for people, its unit, its array in the file, and which part of that."""

    name: str
    unit: str
    source: str
    part: str = ""

    def of(self, mesh: Any) -> Array:
        """Return the values at a mesh's points, shape ``(n,)``, not a number where it has none."""
        if self.source not in mesh.point_data:
            return np.full(mesh.n_points, np.nan)
        values = np.asarray(mesh.point_data[self.source], dtype=float)
        if values.ndim == 1:
            return values
        if self.part:
            return values[:, _PARTS[values.shape[1]].index(self.part) - (values.shape[1] == 3)]
        return np.asarray(np.linalg.norm(values, axis=1))


class Place(NamedTuple):
    """A point: the body, its number in a file, axis parameter and point of the disk; these none of other bodies."""

    body: int
    point: int
    u: float | None = None
    xi: tuple[float, ...] = ()


class View:
    """A result on a stage of pyvista's.

    Attributes
    ----------
    states
        All that can be shown, in order.
    place
        Where numbers are read off; None at first.
    """

    def __init__(self, result: reading.Result, plotter: Any) -> None:
        self.result, self._plotter = result, plotter
        self.place: Place | None = None
        self._drawn: list[tuple[Any, Skin]] = []
        # A few steps alone: a file of a fine mesh takes a while, and room.
        self._read = lru_cache(4)(lambda step: [reading.mesh(path) for path in result.steps[step].files])
        self._skins = lru_cache(4)(self._skins_of)
        self.states = list(self._all())
        # Of each array and part over all steps, so that colours mean the same in all.
        self._limits: dict[tuple[str, str], tuple[float, float]] = {}
        for step in range(len(result.steps)):
            self._widen(step)

    def _all(self) -> Iterator[State]:
        steps, last = self.result.steps, self._read(len(self.result.steps) - 1)
        modes = plot.modes_of(last)
        if not modes:
            digits = animation.written([step.time for step in steps])
            for k, step in enumerate(steps):
                yield State(f"{self.result.counted} {step.time:{digits}}" if len(steps) > 1 else "", k)
            return
        if "displacement" in last[0].point_data:
            yield State("equilibrium", len(steps) - 1)
        for k, mode in enumerate(modes, 1):
            yield State(f"mode {k}{plot.frequency(self.result, k)}", len(steps) - 1, mode)

    def _widen(self, step: int) -> None:
        """Let the limits hold what a step has."""
        for state in (state for state in self.states if state.step == step):
            for field in self.fields(state).values():
                values = np.concatenate([field.of(mesh) for mesh in self._read(step)])
                low, high = self._limits.get(field[2:], (np.inf, -np.inf))
                self._limits[field[2:]] = min(low, float(np.nanmin(values))), max(high, float(np.nanmax(values)))

    def _skins_of(self, step: int) -> list[Skin]:
        skins = []
        for mesh in self._read(step):
            bare = mesh.copy(deep=False)
            bare.clear_data()
            bare.point_data["place"] = np.arange(mesh.n_points)
            skins.append(skin(bare))
        return skins

    def fields(self, state: State) -> dict[str, Field]:
        """Return what can be shown of a state, by names as in the file with the part behind."""
        fields, meshes = {}, self._read(state.step)
        sources = {"displacement": state.motion} if state.mode else {name: name for name in plot.field_names(meshes)}
        for name, source in sources.items():
            if name.startswith(("mode_", "quarter_")):
                continue
            title, _, unit = FIELDS.get(name, name.replace("_", " ")).partition("\n")
            values = next(mesh.point_data[source] for mesh in meshes if source in mesh.point_data)
            for part in _PARTS.get(1 if values.ndim == 1 else values.shape[1], ("",)):
                field = Field(f"{title} {part}".rstrip(), "" if state.mode else unit, source, part)
                fields[f"{name} {part}".rstrip()] = field
        return fields

    def scale(self, state: State) -> float:
        """Return the default deformation scale factor: 1, for modes automatic."""
        if not state.mode:
            return 1.0
        size = max(float(np.ptp(mesh.points, axis=0).max()) for mesh in self._read(state.step))
        largest = self._limits[state.motion, ""][1]
        return plot.SEEN * size / largest if largest > 0.0 else 1.0

    def draw(self, state: State, field: Field, scale: float) -> None:
        """Draw a state, its motion ``scale`` times as large, in the colours of a field; the eye stays where it is."""
        plotter, (low, high) = self._plotter, self._limits[field[2:]]
        # Between values of both signs that differ by rounding, the middle of the scale is 0.
        low = -high if abs(low + high) < 1e-9 * high else low
        ticks = picture.scaled(low, high)
        limits = float(ticks[0]), float(ticks[-1])
        # Each of what is added would be drawn at once.
        plotter.suppress_rendering = True
        plotter.clear_actors()
        plotter.scalar_bars.clear()
        self._follow(state)
        bar: dict[str, Any] | None = picture.bar(
            f"{field.name}\n{field.unit}".rstrip(), plotter.window_size, len(ticks)
        )
        self._drawn = []
        for k, (mesh, rest) in enumerate(zip(self._read(state.step), self._skins(state.step), strict=True)):
            motion, colour = scale * _vectors(mesh, state.motion), field.of(mesh)
            if state.mode:
                # About an equilibrium.
                motion += _vectors(mesh, "displacement")
            for part in rest:
                if part.n_points:
                    part.point_data["motion"] = motion[part.point_data["place"]]
                    part.point_data["colour"] = colour[part.point_data["place"]]
            plotter.add_silhouette(rest.whole, color="grey", line_width=1.5)
            moved = rest.moved(1.0)
            self._drawn.append((picture.add_skin(plotter, moved, "colour", limits, bar), moved))
            bar = None
            if self.place is not None and self.place.body == k:
                point = self.place.point
                words = f"\u2022 {field.name} {self._number(field, colour[point])}"
                picture.label(plotter, words, mesh.points[point] + motion[point])
        plotter.suppress_rendering = False

    def fit(self, view: Sequence[float], up: Array | None = None) -> None:
        """Look from a direction at all that is drawn."""
        points = np.concatenate([one.faces.points for _, one in self._drawn])
        picture.look(self._plotter.camera, points, np.asarray(view, dtype=float), self._plotter.window_size, up)

    def pick(self, state: State, x: float, y: float) -> None:
        """Take the file's point nearest to what is seen at a pixel, counted from below; beside the rods none."""
        from vtkmodules.vtkRenderingCore import vtkCellPicker

        picker = vtkCellPicker()
        # A tenth of a pixel, so that no ray passes between adjacent cells.
        picker.SetTolerance(1e-4)
        picker.PickFromListOn()
        for actor, _ in self._drawn:
            picker.AddPickList(actor)
        picker.Pick(x, y, 0.0, self._plotter.renderer)
        self.place = None
        for body, (actor, moved) in enumerate(self._drawn):
            if actor is picker.GetActor():
                near = np.linalg.norm(moved.faces.points - np.asarray(picker.GetPickPosition()), axis=1)
                self._take(state, body, int(moved.faces.point_data["place"][np.argmin(near)]))

    def go(self, state: State, body: int, u: float, xi: Sequence[float]) -> None:
        """Take the file's point nearest to an axis parameter of a rod and a point of the unit disk."""
        bodies = self._read(state.step)
        if not 0 <= body < len(bodies):
            raise InputError(f"body: got {body}, need 0 to {len(bodies) - 1}")
        given = bodies[body].field_data
        if "u" not in given:
            raise InputError(f"body {body} has no axis parameters in its file; click on it")
        along, disk = int(np.argmin(np.abs(np.asarray(given["u"]) - u))), np.asarray(given["xi"])
        self._take(state, body, along * len(disk) + int(np.argmin(np.linalg.norm(disk - np.asarray(xi), axis=1))))

    def _take(self, state: State, body: int, point: int) -> None:
        given, place = self._read(state.step)[body].field_data, Place(body, point)
        if "u" in given:
            along, within = divmod(point, len(given["xi"]))
            place = Place(body, point, float(given["u"][along]), tuple(map(float, given["xi"][within])))
        self.place = place

    def _follow(self, state: State) -> None:
        """Find the place in a state, whose file may have other points, as contact has them."""
        before = self.place
        if before is not None and before.u is not None:
            if before.point < self._read(state.step)[before.body].n_points:
                self._take(state, before.body, before.point)
            if self.place != before:
                self.go(state, before.body, before.u, before.xi)

    def at_rest(self, state: State) -> str:
        """Return the undeformed position of the place as text."""
        if self.place is None:
            return ""
        point = self._read(state.step)[self.place.body].points[self.place.point]
        return ", ".join(f"{x:.5g}" for x in np.where(np.abs(point) < 1e-9, 0.0, point))

    def numbers(self, state: State) -> list[tuple[str, str]]:
        """Return the names of all fields at the place, with their values."""
        if self.place is None:
            return []
        mesh = self._read(state.step)[self.place.body]
        values = [(field, field.of(mesh)[self.place.point]) for field in self.fields(state).values()]
        return [(field.name, self._number(field, value)) for field, value in values if np.isfinite(value)]

    def note(self, state: State) -> str:
        """Return the note on the stress error; empty without stresses."""
        stresses = any(field.source in plot.STRESSES for field in self.fields(state).values())
        return plot.note_of(self._read(state.step)) if stresses else ""

    def _number(self, field: Field, value: float) -> str:
        largest = max(map(abs, self._limits[field[2:]]))
        return f"{value if abs(value) > _ROUNDING * largest else 0.0:.5g}"


def _vectors(mesh: Any, name: str) -> Array:
    return np.asarray(mesh.point_data[name] if name in mesh.point_data else np.zeros((mesh.n_points, 3)), dtype=float)
