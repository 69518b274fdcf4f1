"""Post-processing of a solution: displacements, positions, stresses and section forces at any point of a body.

A body is named by its number in the model, or by its `Rod`, its `Space` or the `Body` itself.  Its points are pairs of
axis parameters ``u`` and disk points ``xi``: ``u`` is a number, ``"start"`` or ``"end"``, or an array of any shape;
``xi`` has the shape ``(2,)`` or ``(..., 2)`` and is the centre ``(0, 0)`` where not given; the centre of a hollow rod
is the mean of its inner surface, and has a displacement but no stress.  Results are on the grid of both: their shape is
that of ``u``, then that of ``xi`` without its last axis, then that of a value.  At a knot they belong to the element
above, at a radius where two rings meet to the outer one.  Every rank has all results; no call is collective.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.errors import InputError, expect, finite, whole_number
from isorod.geometry.rod import Rod
from isorod.model.body import Body
from isorod.model.model import Model
from isorod.output.places import numbers_in, parameters
from isorod.space.space import Space

if TYPE_CHECKING:
    from PIL.Image import Image

    from isorod.output.section_forces import SectionForces

# A body, by its number in the model or by itself, its space or its rod.
Named = int | Rod | Space | Body

# Kinds of `State.stress`.
KINDS = ("cauchy", "pk1", "von Mises")


class _Points(NamedTuple):
    """A grid of points of a body: parameters ``(t,)`` and ``(q, 2)``, and the shape in which they were given.

    If ``mean``, the mean over all ``xi`` is taken for the centre of a hole.
    """

    number: int
    body: Body
    u: Array
    xi: Array
    shape: tuple[int, ...]
    mean: bool = False


@dataclass(frozen=True, eq=False)
class Deformation:
    """Displacements of a model, evaluated at any point.

    Attributes
    ----------
    model
        The model that was solved.
    displacement
        All degrees of freedom, shape ``(dofs,)``, on every rank.
    """

    model: Model
    displacement: Array

    def frames(self) -> "list[tuple[float, Deformation]]":
        """Return the states to show, each with its time or load factor: this one alone."""
        return [(0.0, self)]

    def fields(self, body: int) -> dict[str, Array]:
        """Return a body's displacement, shape ``(nodes, 3)``."""
        return {"displacement": self.model.nodal(self.displacement, body)}

    def at(self, body: Named, u: ArrayLike, xi: ArrayLike | None = None) -> Array:
        """Return the displacement at points of a body, shape ``(..., 3)`` (for all shapes, see `isorod.output.state`).

        Raises
        ------
        InputError
            If the body is not of the model, or a parameter is no number or outside the rod.
        """
        points = self._points(body, u, xi)
        nodal = self.fields(points.number)["displacement"]
        moved, _ = points.body.space.displacement(nodal, points.xi, points.u)
        return _on_grid(moved, points)

    def position(self, body: Named, u: ArrayLike, xi: ArrayLike | None = None, scale: float = 1.0) -> Array:
        """Return positions of points of a body, shape ``(..., 3)``, displaced by ``scale`` times their displacement."""
        points = self._points(body, u, xi)
        expect("scale", scale, float)
        finite("scale", scale, "a finite number")
        rest, _ = points.body.space.rod.grid(points.xi, points.u)
        return _on_grid(rest, points) + scale * self.at(body, u, xi)

    def rotation(self, body: Named, u: float | str, about: ArrayLike | None = None) -> Array:
        """Return the mean rotation of a section, radians (`isorod.output.rotations.of_section`): its vector ``(3,)``.

        About an axis ``about``, a vector ``(3,)`` of any length, the angle alone.
        """
        from isorod.output import rotations

        number = self._number(body)
        axis = None if about is None else rotations.direction("about", about)
        place, factor = float(parameters(self.model.bodies[number].space, u)), getattr(self, "factor", 1.0)
        return rotations.of_section(self.model, self.displacement, number, place, axis, factor)

    def centre_line(self, body: Named, count: int = 101, scale: float = 1.0) -> Array:
        """Return the deformed centre line, of a hollow rod that of its hole, at evenly spaced axis parameters.

        Parameters
        ----------
        count
            Number of points, including both ends.
        scale
            Factor of displacements.

        Returns
        -------
        Array of shape ``(count, 3)``.
        """
        breaks = self.model.bodies[self._number(body)].space.axis.breaks
        number = whole_number("centre line: points", count, 2, 10_000_000)
        return self.position(body, np.linspace(breaks[0], breaks[-1], number), scale=scale)

    def plot(
        self,
        colour: str | None = None,
        scale: float | None = None,
        view: tuple[float, float, float] | None = None,
        size: tuple[int, int] = (1000, 700),
    ) -> "Image":
        """Return a picture of all bodies, which a notebook shows; its ``save("name.png")`` keeps it.

        It is drawn off screen by pyvista; the outline at rest is grey.

        Parameters
        ----------
        colour
            What the colours show: ``"von Mises"`` stress or the magnitude of the ``"displacement"``; for a mode, of
            arbitrary amplitude, the latter alone.
        scale
            Factor of displacements; by default 1, for a mode one that makes it visible.
        view
            Direction to the camera; by default one with little foreshortening.
        size
            Width and height, pixels.

        Raises
        ------
        InputError
            If pyvista is not installed, or an argument cannot be used.
        """
        return next(_pictures("plot", [Moment(self)], colour, scale, view, size))

    # Colours of `plot`, the first by default; whether displacements are a mode shape of arbitrary amplitude.
    _colours: ClassVar[tuple[str, ...]] = ("displacement",)
    _shape: ClassVar[bool] = False

    def _scale(self, largest: float) -> float:
        """Return the factor of displacements in `plot`, given the largest displacement."""
        return 1.0

    def _mesh(self, body: int, colour: str) -> Any:
        """Return a body at rest as small cells with its ``motion`` and the ``colour``."""
        from isorod.output import vtk

        mesh = vtk.grid(self.model.bodies[body], {"motion": self.fields(body)["displacement"]})
        mesh.point_data["colour"] = np.linalg.norm(mesh.point_data["motion"], axis=1)
        return mesh

    def _number(self, named: Named) -> int:
        """Return the number of a body."""
        bodies = self.model.bodies
        if isinstance(named, Rod | Space | Body):
            hits = [b for b, body in enumerate(bodies) if any(named is x for x in (body, body.space, body.space.rod))]
            if len(hits) > 1:
                raise InputError(f"body: this {type(named).__name__} is that of bodies {hits}; give the number of one")
            if self.model.remembers and not hits:
                # Bodies with a history, and their spaces with more points, are copies of those given.
                rod = getattr(getattr(named, "space", named), "rod", None)
                hits = [b for b, body in enumerate(bodies) if body.space.rod is rod]
            if hits:
                return hits[0]
            raise InputError(f"body: this {type(named).__name__} is that of none of the model's {len(bodies)} bodies")
        if isinstance(named, bool) or not isinstance(named, int | np.integer) or not 0 <= named < len(bodies):
            shown = f"{named!r:.40}" if isinstance(named, Real | str | None) else type(named).__name__
            raise InputError(f"body: got {shown}, need a number from 0 to {len(bodies) - 1}, or a Rod of the model")
        return int(named)

    def _points(self, named: Named, u: ArrayLike, xi: ArrayLike | None) -> _Points:
        """Return points of a body by their parameters."""
        number = self._number(named)
        body = self.model.bodies[number]
        hole = body.space.rod.rings[0]
        if xi is None and hole > 0.0:
            along, angle = parameters(body.space, u), np.linspace(0.0, 2.0 * np.pi, 65)[:-1]
            round_it = hole * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            return _Points(number, body, along.ravel(), round_it, along.shape, mean=True)
        along, across = parameters(body.space, u), numbers_in((0.0, 0.0) if xi is None else xi)
        if across is None or across.ndim == 0 or across.shape[-1] != 2 or not across.size:
            raise InputError("disk points xi: need two numbers, or an array of shape (..., 2)")
        if (np.linalg.norm(across, axis=-1) < hole * (1.0 - 1e-12)).any():
            raise InputError(f"disk points xi: the rod is hollow, need points from {hole:g} to 1 away from the centre")
        shape = (*along.shape, *across.shape[:-1])
        return _Points(number, body, along.ravel(), across.reshape(-1, 2), shape)


class Moment(NamedTuple):
    """A frame of an animation: a state, the text above it, and a factor of its displacement."""

    state: Deformation
    words: str = ""
    amplitude: float = 1.0


class Animated:
    """A result that can be animated."""

    def animate(
        self,
        path: str | Path,
        colour: str | None = None,
        scale: float | None = None,
        view: tuple[float, float, float] | None = None,
        size: tuple[int, int] = (800, 560),
    ) -> None:
        """Write an animated GIF of a motion, of load steps, or of a mode over its period.

        Colour bar and camera are the same in all frames.

        Parameters
        ----------
        path
            The file.
        colour, scale, view, size
            As for `Deformation.plot`.

        Raises
        ------
        InputError
            If there is one state alone, pyvista is not installed, an argument cannot be used, or the file cannot be
            written.
        """
        from isorod.output import animation

        animation.save(_pictures("animate", self._moments(), colour, scale, view, size), Path(path))

    @property
    def _counted(self) -> str:
        """The variable of the states: time or load factor."""
        return "time"

    def frames(self) -> Sequence[tuple[float, Deformation]]:
        """Return the states with their times or load factors."""
        raise NotImplementedError

    def _moments(self) -> list[Moment]:
        """Return the frames of the animation."""
        from isorod.output.animation import written

        frames = self.frames()
        if len(frames) == 1:
            raise InputError("animate: got a single state; statics.solve(..., keep=True) keeps those of the load path")
        digits = written([time for time, _ in frames])
        return [Moment(state, f"{self._counted} {time:{digits}}") for time, state in frames]


def _pictures(
    what: str,
    moments: Sequence[Moment],
    colour: str | None,
    scale: float | None,
    view: tuple[float, float, float] | None,
    size: tuple[int, int],
) -> "Iterator[Image]":
    """Yield a picture of each moment (`Deformation.plot`)."""
    from isorod.output import picture, words

    first = moments[0].state
    shown = first._colours[0] if colour is None else colour
    if shown not in first._colours:
        raise InputError(f"{what}: got colour {colour!r}, need {' or '.join(map(repr, first._colours))}")
    if scale is not None:
        expect("scale", scale, float)
        finite("scale", scale, "a finite number")
    picture.check(view, size, what)
    # All frames of a mode have the same state.
    states = {id(moment.state): moment.state for moment in moments}
    meshes = {key: [state._mesh(b, shown) for b in range(len(first.model.bodies))] for key, state in states.items()}
    moved = np.concatenate([mesh.point_data["motion"] for of_state in meshes.values() for mesh in of_state])
    largest = float(np.linalg.norm(moved, axis=1).max())
    known = [getattr(moment.state, "stress_error", None) for moment in moments]
    notes = [words.stress_error(error) if shown == "von Mises" else "" for error in known]
    frames = [picture.Frame(meshes[id(one.state)], *one[1:], note) for one, note in zip(moments, notes, strict=True)]
    scale, title = first._scale(largest) if scale is None else scale, words.FIELDS[shown.lower().replace(" ", "_")]
    yield from picture.draw(frames, title, scale, view, size, shape=first._shape)


@dataclass(frozen=True, eq=False)
class State(Deformation):
    """Displacements with stresses.

    Attributes
    ----------
    model, displacement
        As for `Deformation`.
    factor
        Load factor, which scales a muscle's activation.
    pressures
        Pressure coefficients of each body, ``(layers, count)`` of its `isorod.space.pressure.Pressures`, or None; empty
        if no body is mixed.
    solids
        Displacements of each solid on this rank (`function`).
    """

    factor: float = field(default=1.0, kw_only=True)
    pressures: Sequence[Array | None] = field(default=(), kw_only=True)
    solids: Sequence[Array] = field(default=(), kw_only=True)

    def deformation_gradient(self, body: Named, u: ArrayLike, xi: ArrayLike = (0.0, 0.0)) -> Array:
        """Return the deformation gradient at points of a body, shape ``(..., 3, 3)``."""
        points = self._points(body, u, xi)
        nodal = self.fields(points.number)["displacement"]
        _, gradient = points.body.space.displacement(nodal, points.xi, points.u)
        return gradient.reshape(*points.shape, 3, 3)

    def stress(self, body: Named, u: ArrayLike, xi: ArrayLike = (0.0, 0.0), kind: str = "cauchy") -> Array:
        """Return the stress at points of a body, with the pressure of the mixed formulation.

        Parameters
        ----------
        body, u, xi
            The points (`isorod.output.state`).
        kind
            ``"cauchy"``, force per present area, shape ``(..., 3, 3)``; ``"pk1"``, the first Piola-Kirchhoff stress,
            force per area at rest, the second index that of the normal at rest; ``"von Mises"`` of Cauchy's, ``(...)``.

        Raises
        ------
        InputError
            As for `at`, or if the kind is not known.
        """
        from isorod.output import stress

        if kind not in KINDS:
            raise InputError(f"stress: got kind {kind!r}, need one of {', '.join(map(repr, KINDS))}")
        points = self._points(body, u, xi)
        fields = self.fields(points.number)
        arguments = points.body, fields["displacement"], points.xi, points.u, self.factor, fields.get("pressure")
        if kind == "von Mises":
            return stress.von_mises(stress.cauchy(*arguments)).reshape(points.shape)
        values = stress.first_piola(*arguments)[0] if kind == "pk1" else stress.cauchy(*arguments)
        return values.reshape(*points.shape, 3, 3)

    def state(self, name: str, body: Named, u: ArrayLike, xi: ArrayLike = (0.0, 0.0)) -> Array:
        """Return a state variable of laws with memory at points (`isorod.output.stress.known`), ``(..., count)``."""
        from isorod.output import stress

        points = self._points(body, u, xi)
        arguments = points.body, self.fields(points.number)["displacement"], points.xi, points.u, self.factor
        return stress.known(*arguments, [name])[name].reshape(*points.shape, -1)

    def section_forces(self, body: Named, u: ArrayLike) -> "SectionForces":
        """Return normal force, shear forces, torsion and bending moments in sections of a body, from the stress.

        Their sign and directions are those of `isorod.output.section_forces.SectionForces`.
        """
        from isorod.output.section_forces import section_forces

        number = self._number(body)
        fields, owner = self.fields(number), self.model.bodies[number]
        at = parameters(owner.space, u)
        return section_forces(owner, fields["displacement"], at, self.factor, fields.get("pressure"))

    def energy(self, body: Named) -> float:
        """Return the energy stored in a body (`isorod.output.energy.stored`)."""
        from isorod.output import energy

        number = self._number(body)
        return energy.stored(self.model.bodies[number], self.fields(number), self.factor)

    _colours: ClassVar[tuple[str, ...]] = ("von Mises", "displacement")

    def _mesh(self, body: int, colour: str) -> Any:
        if colour != "von Mises":
            return super()._mesh(body, colour)
        from isorod.output import vtk

        mesh = vtk.grid(self.model.bodies[body], self.fields(body), factor=self.factor)
        mesh.point_data["colour"] = mesh.point_data["von_mises"]
        mesh.point_data["motion"] = mesh.point_data["displacement"]
        return mesh


def _on_grid(values: Array, points: _Points) -> Array:
    """Return vectors ``(t, q, 3)`` in the shape of the given points."""
    return (values.mean(axis=1) if points.mean else values).reshape(*points.shape, 3)
