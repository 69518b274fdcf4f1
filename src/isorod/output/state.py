"""Post-processing of a solution: displacements, positions, stresses and section forces at any point of a body.

A body is named by its number in the model, or by its `Rod`, its `Space` or the `Body` itself.  Its points are pairs of
axis parameters ``u`` and disk points ``xi``: ``u`` is a number, ``"start"`` or ``"end"``, or an array of any shape;
``xi`` has the shape ``(2,)`` or ``(..., 2)`` and is the centre ``(0, 0)`` where not given; the centre of a hollow rod
is where its inner surface is in the mean, and has a displacement but no stress.  The answer is on the grid of both: its
shape is that of ``u``, then that of ``xi`` without its last axis, then that of one value.  At a knot the element above
it is meant, at a radius where two rings meet the outer one.  Every rank has the whole answer, none waits for another.
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

# A body, by its number in the model or by what it is made of.
Named = int | Rod | Space | Body

# Of `State.stress`.
KINDS = ("cauchy", "pk1", "von Mises")


class _Points(NamedTuple):
    """A grid of points of a body: parameters ``(t,)`` and ``(q, 2)``, and the shape in which they were given.

    Where ``mean``, all ``xi`` together stand for one point, the centre of a hole.
    """

    number: int
    body: Body
    u: Array
    xi: Array
    shape: tuple[int, ...]
    mean: bool = False


@dataclass(frozen=True, eq=False)
class Deformation:
    """Displacements of a model, and what they say of any point.

    Attributes
    ----------
    model
        What was solved.
    displacement
        All degrees of freedom, shape ``(dofs,)``, on every rank.
    """

    model: Model
    displacement: Array

    def frames(self) -> "list[tuple[float, Deformation]]":
        """Return what there is to show, each with its time or load factor: this alone."""
        return [(0.0, self)]

    def fields(self, body: int) -> dict[str, Array]:
        """Return a body's displacement, shape ``(nodes, 3)``."""
        return {"displacement": self.model.nodal(self.displacement, body)}

    def at(self, body: Named, u: ArrayLike, xi: ArrayLike | None = None) -> Array:
        """Return the displacement at points of a body, shape ``(..., 3)`` (for all shapes, see `isorod.output.state`).

        Raises
        ------
        InputError
            If the body is none of the model, or a parameter is no number or outside the rod.
        """
        points = self._points(body, u, xi)
        nodal = self.fields(points.number)["displacement"]
        moved, _ = points.body.space.displacement(nodal, points.xi, points.u)
        return _on_grid(moved, points)

    def position(self, body: Named, u: ArrayLike, xi: ArrayLike | None = None, scale: float = 1.0) -> Array:
        """Return where points of a body are, shape ``(..., 3)``, moved by ``scale`` times their displacement."""
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
            Number of points, both ends among them.
        scale
            By how much displacements are multiplied.

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

        Drawn off screen by pyvista, which is loaded now; grey is the outline at rest.

        Parameters
        ----------
        colour
            What the colours show: ``"von Mises"`` stress or the size of the ``"displacement"``; of a mode, whose size
            means nothing, the latter alone.
        scale
            By how much displacements are multiplied; where not given 1, of a mode so that it can be seen.
        view
            Direction from which one looks; where not given one from which little is foreshortened.
        size
            Width and height, pixels.

        Raises
        ------
        InputError
            If pyvista is not installed, or an argument cannot be used.
        """
        return next(_pictures("plot", [Moment(self)], colour, scale, view, size))

    # What `plot` can show, by default the first; whether displacements are a shape alone, whose size says nothing.
    _colours: ClassVar[tuple[str, ...]] = ("displacement",)
    _shape: ClassVar[bool] = False

    def _scale(self, largest: float) -> float:
        """Return by how much `plot` multiplies displacements, of which the largest is given."""
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
            found = [b for b, body in enumerate(bodies) if any(named is x for x in (body, body.space, body.space.rod))]
            if len(found) > 1:
                raise InputError(f"body: this {type(named).__name__} is that of bodies {found}; give the number of one")
            if self.model.remembers and not found:
                # Bodies with a past are others, and so are spaces with more points.
                rod = getattr(getattr(named, "space", named), "rod", None)
                found = [b for b, body in enumerate(bodies) if body.space.rod is rod]
            if found:
                return found[0]
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
    """A frame of an animation: a state with a share of its displacement, and what is written above it."""

    state: Deformation
    words: str = ""
    share: float = 1.0


class Animated:
    """What moves, and can be shown so."""

    def animate(
        self,
        path: str | Path,
        colour: str | None = None,
        scale: float | None = None,
        view: tuple[float, float, float] | None = None,
        size: tuple[int, int] = (800, 560),
    ) -> None:
        """Write an animated GIF: a motion or load steps one after the other, a mode as it swings.

        Colours, their scale and the place from which one looks are the same throughout.

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
        """What the states are counted in."""
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

    one = moments[0].state
    shown = one._colours[0] if colour is None else colour
    if shown not in one._colours:
        raise InputError(f"{what}: got colour {colour!r}, need {' or '.join(map(repr, one._colours))}")
    if scale is not None:
        expect("scale", scale, float)
        finite("scale", scale, "a finite number")
    picture.check(view, size, what)
    # A mode is the same in all frames.
    states = {id(moment.state): moment.state for moment in moments}
    meshes = {key: [state._mesh(b, shown) for b in range(len(one.model.bodies))] for key, state in states.items()}
    moved = np.concatenate([mesh.point_data["motion"] for own in meshes.values() for mesh in own])
    largest = float(np.linalg.norm(moved, axis=1).max())
    known = [getattr(moment.state, "stress_error", None) for moment in moments]
    notes = [words.stress_error(error) if shown == "von Mises" else "" for error in known]
    frames = [picture.Frame(meshes[id(one.state)], *one[1:], note) for one, note in zip(moments, notes, strict=True)]
    scale, title = one._scale(largest) if scale is None else scale, words.FIELDS[shown.lower().replace(" ", "_")]
    yield from picture.draw(frames, title, scale, view, size, shape=one._shape)


@dataclass(frozen=True, eq=False)
class State(Deformation):
    """Displacements with the stresses they make.

    Attributes
    ----------
    model, displacement
        As for `Deformation`.
    factor
        Load factor of the stress, which a muscle's activation follows.
    pressures
        Pressure coefficients of each body, ``(layers, count)`` of its `isorod.space.pressure.Pressures`, or None; empty
        if no body is mixed.
    solids
        Displacement of each solid's degrees of freedom on this rank (`function`).
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
        """Return the stress at points of a body, that of the mixed formulation with its pressure.

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
        given = points.body, fields["displacement"], points.xi, points.u, self.factor, fields.get("pressure")
        if kind == "von Mises":
            return stress.von_mises(stress.cauchy(*given)).reshape(points.shape)
        found = stress.first_piola(*given)[0] if kind == "pk1" else stress.cauchy(*given)
        return found.reshape(*points.shape, 3, 3)

    def state(self, name: str, body: Named, u: ArrayLike, xi: ArrayLike = (0.0, 0.0)) -> Array:
        """Return what laws with memory know at points (`isorod.output.stress.known`), shape ``(..., count)``."""
        from isorod.output import stress

        points = self._points(body, u, xi)
        given = points.body, self.fields(points.number)["displacement"], points.xi, points.u, self.factor
        return stress.known(*given, [name])[name].reshape(*points.shape, -1)

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
    """Return vectors ``(t, q, 3)`` in the shape in which the points were given."""
    return (values.mean(axis=1) if points.mean else values).reshape(*points.shape, 3)
