"""What of a rod lies within another one that its end is welded to.

There the body counts twice and, held at its end face alone, strains as if nothing were round it: a rod whose axis ends
on the axis of the other is longer than it is by the other's radius.  The energy that is stored there is what a joint
gives way too much by, nearly: of rods of 0.3 and 0.6 radii in one of 1, pulled and bent at their ends, it is 0.5 to
1.6 times as much, for ends from the axis of the other on to half its radius (`tests/test_tie_flank.py`).
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.geometry.disk import circle
from isorod.geometry.quadrature import Rule, section_points
from isorod.material.along_rod import shear_laws
from isorod.model.model import Model
from isorod.model.tie import EndFace, LateralSurface
from isorod.output.state import State
from isorod.space.space import Space
from isorod.space.trace import rows_at
from isorod.tensors import determinant

# Sections to a radius, and at most; their points in each slice.
_SECTIONS, _MOST = 8, 2000
_POINTS = Rule(3, 2, 1)
_AROUND = 32

# In the place of an energy that is zero.
_TINY = float(np.finfo(float).tiny)

# Displacements of modes, over the model's size, with which their energies are taken.
_SMALL = 1e-4

# Points that are farther from the other rod, in radii, are outside.
_OUTSIDE = 1e-6


class Part(NamedTuple):
    """A part of a rod within another one.

    Attributes
    ----------
    tie
        Number of the tie.
    body, other
        The rod, and the one that it is in.
    depth
        How far it is inside from its end on, along its axis, units of length.
    wholly
        Lengths along it, from its start, between which all of its surface is inside; None if there are none.
    u, xi
        Axis parameters of sections ``(t,)`` and disk points ``(q, 2)``.
    volumes
        Of these, ``(t, q)``, zero outside of the other.
    """

    tie: int
    body: int
    other: int
    depth: float
    wholly: tuple[float, float] | None
    u: Array
    xi: Array
    volumes: Array

    def energy(self, state: State) -> float:
        """Return the energy stored there in a state, of mixed bodies that of shear."""
        body = state.model.bodies[self.body]
        laws = body.laws_at(self.u, self.xi).at(state.factor)
        laws = laws if body.pressures is None else shear_laws(laws)
        density = laws.energy(state.deformation_gradient(self.body, self.u, self.xi))
        return float(np.sum(self.volumes * density))


class Share(NamedTuple):
    """What such parts make of an answer.

    Attributes
    ----------
    error
        Their share of the energy, of frequencies half of it: the largest of all modes.
    part
        That with the largest share; None if there is no part.
    """

    error: float
    part: Part | None


def of(solution: Any) -> Share:
    """Return what the parts within other rods make of works, in motion where it goes farthest, or of frequencies.

    ``solution`` is an `isorod.statics.Equilibrium`, an `isorod.dynamics.History`, `isorod.modal.Modes` or
    `isorod.buckling.BucklingModes`.
    """
    known = parts(solution.model)
    if not known:
        return Share(0.0, None)
    if hasattr(solution, "vectors"):
        return _of_shapes(solution.model, solution.shapes(), known)
    states = [solution] if isinstance(solution, State) else [state for _, state in solution.frames()]
    state = max(states, key=lambda one: float(np.abs(one.displacement).max(initial=0.0)))
    energies = [part.energy(state) for part in known]
    stored = float(sum(state.energy(b) for b in range(len(state.model.bodies))))
    return _largest(known, [energies], max(stored, _TINY))


def _of_shapes(model: Model, shapes: Iterable[tuple[float, Array]], known: list[Part]) -> Share:
    """Return what is made of shapes, each with the energy of which a part is as large a share of the answer."""
    found = []
    for whole, vector in shapes:
        scale = _SMALL / max(float(np.abs(vector).max()) / model.size, _TINY)
        state = State(model, scale * vector)
        found.append([part.energy(state) / (scale**2 * whole) for part in known])
    return _largest(known, found, 1.0)


def _largest(known: list[Part], found: list[list[float]], whole: float) -> Share:
    """Return the largest share of energies of some states, a list each, of the same parts."""
    if not found:
        return Share(0.0, None)
    worst = max(found, key=sum)
    return Share(sum(worst) / whole, known[int(np.argmax(worst))])


def parts(model: Model) -> list[Part]:
    """Return the parts of a model's rods that are within others on whose flanks they are welded."""
    found = []
    for k, tie in enumerate(model.ties):
        for end, flank in ((tie.slave, tie.master), (tie.master, tie.slave)):
            if isinstance(end, EndFace) and isinstance(flank, LateralSurface):
                space, other = (model.bodies[one.body].space for one in (end, flank))
                part = _within(space, other, end.which == "start")
                if part is not None:
                    found.append(Part(k, end.body, flank.body, *part))
    return found


def _within(
    space: Space, other: Space, at_start: bool
) -> "tuple[float, tuple[float, float] | None, Array, Array, Array] | None":
    """Return depth, what is wholly inside, axis parameters, disk points and volumes of what is in another rod."""
    rod, length = space.rod, space.rod.arc_length
    step = rod.radius / _SECTIONS
    ways = (np.arange(min(max(1, int(length.total / step)), _MOST)) + 0.5) * step
    u = np.interp(ways if at_start else length.total - ways, length.length, length.u)
    xi, area = section_points(rod.section_points, _POINTS, rings=rod.rings)
    most = _SECTIONS
    while True:
        # As far as it is inside, and no farther.
        position, jacobian = rod.grid(xi, u[:most])
        inside = rows_at(other, position.reshape(-1, 3)).gap.reshape(position.shape[:2]) < _OUTSIDE * other.rod.radius
        whole = inside.any(axis=1)
        if not whole.all() or most >= u.size:
            break
        most *= 2
    count = int(np.argmin(whole)) if not whole.all() else whole.size
    if not count:
        return None
    # In sections across the axis a step along it is as long in the middle.
    speed = np.interp(u[:count], length.u, length.speed)
    volumes = inside[:count] * determinant(jacobian[:count]) * area * (step / speed)[:, None]
    surface = rod.grid(circle(_AROUND), u[:count])[0]
    out = rows_at(other, surface.reshape(-1, 3)).gap.reshape(surface.shape[:2]) > _OUTSIDE * other.rod.radius
    # Up to the last of these sections.
    sure = step * max(0.0, int(np.argmax([*out.any(axis=1), True])) - 0.5)
    wholly = (0.0, sure) if at_start else (length.total - sure, length.total)
    return count * step, wholly if sure else None, u[:count], xi, volumes
