"""Parts of rods embedded in other rods to which their ends are welded.

There the material counts twice and, held at its end face alone, deforms as if free: a rod whose axis ends on the axis
of the other is too long by the other's radius.  The energy stored there is about the error of the joint's compliance:
for rods of radius 0.3 and 0.6 in one of radius 1, pulled and bent at their ends, it is 0.5 to 1.6 times that, for ends
between the axis of the other and half its radius (`tests/test_tie_flank.py`).
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

# Sections for each radius of length, and at most; quadrature of each; points round it.
_SECTIONS, _MOST = 8, 2000
_POINTS = Rule(3, 2, 1)
_AROUND = 32

# Replaces a zero energy.
_TINY = float(np.finfo(float).tiny)

# Displacement of modes over the model's size at which their energies are evaluated.
_SMALL = 1e-4

# Distance from the other rod, in radii, from which points are outside.
_OUTSIDE = 1e-6


class Part(NamedTuple):
    """A part of a rod embedded in another one.

    Attributes
    ----------
    tie
        Number of the tie.
    body, other
        The rod, and the one in which it is embedded.
    depth
        Embedded length along its axis from its end, units of length.
    wholly
        Arc lengths from its start between which all of its surface is inside; None if there are none.
    u, xi
        Axis parameters of sections ``(t,)`` and disk points ``(q, 2)``.
    volumes
        Their volumes ``(t, q)``, zero outside the other rod.
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
        """Return the energy stored in the part in a state; of mixed bodies that of shear."""
        body = state.model.bodies[self.body]
        laws = body.laws_at(self.u, self.xi).at(state.factor)
        laws = laws if body.pressures is None else shear_laws(laws)
        density = laws.energy(state.deformation_gradient(self.body, self.u, self.xi))
        return float(np.sum(self.volumes * density))


class EmbeddedError(NamedTuple):
    """The error of a result by embedded parts.

    Attributes
    ----------
    error
        Their fraction of the energy, the largest of all modes; of frequencies half of it.
    part
        The part with the largest energy; None if there is none.
    """

    error: float
    part: Part | None


def of(solution: Any) -> EmbeddedError:
    """Return the error of work, frequencies or load factors by embedded parts; in motion at the largest displacement.

    ``solution`` is an `isorod.statics.Equilibrium`, an `isorod.dynamics.History`, `isorod.modal.Modes` or
    `isorod.buckling.BucklingModes`.
    """
    known = parts(solution.model)
    if not known:
        return EmbeddedError(0.0, None)
    if hasattr(solution, "vectors"):
        return _of_shapes(solution.model, solution.shapes(), known)
    states = [solution] if isinstance(solution, State) else [state for _, state in solution.frames()]
    state = max(states, key=lambda one: float(np.abs(one.displacement).max(initial=0.0)))
    energies = [part.energy(state) for part in known]
    stored = float(sum(state.energy(b) for b in range(len(state.model.bodies))))
    return _largest(known, [energies], max(stored, _TINY))


def _of_shapes(model: Model, shapes: Iterable[tuple[float, Array]], known: list[Part]) -> EmbeddedError:
    """Return the error of modes, each a shape with the energy to which those of the parts are relative."""
    energies = []
    for reference, vector in shapes:
        scale = _SMALL / max(float(np.abs(vector).max()) / model.size, _TINY)
        state = State(model, scale * vector)
        energies.append([part.energy(state) / (scale**2 * reference) for part in known])
    return _largest(known, energies, 1.0)


def _largest(known: list[Part], energies: list[list[float]], reference: float) -> EmbeddedError:
    """Return the largest sum of the parts' energies, a list for each state, over a reference."""
    if not energies:
        return EmbeddedError(0.0, None)
    worst = max(energies, key=sum)
    return EmbeddedError(sum(worst) / reference, known[int(np.argmax(worst))])


def parts(model: Model) -> list[Part]:
    """Return the parts of a model's rods that are embedded in others to whose lateral surfaces they are welded."""
    embedded = []
    for k, tie in enumerate(model.ties):
        for end, flank in ((tie.slave, tie.master), (tie.master, tie.slave)):
            if isinstance(end, EndFace) and isinstance(flank, LateralSurface):
                space, other = (model.bodies[side.body].space for side in (end, flank))
                part = _within(space, other, end.which == "start")
                if part is not None:
                    embedded.append(Part(k, end.body, flank.body, *part))
    return embedded


def _within(
    space: Space, other: Space, at_start: bool
) -> "tuple[float, tuple[float, float] | None, Array, Array, Array] | None":
    """Return depth, wholly embedded range, axis parameters, disk points and volumes of the part in another rod."""
    rod, length = space.rod, space.rod.arc_length
    step = rod.radius / _SECTIONS
    distances = (np.arange(min(max(1, int(length.total / step)), _MOST)) + 0.5) * step
    u = np.interp(distances if at_start else length.total - distances, length.length, length.u)
    xi, area = section_points(rod.section_points, _POINTS, rings=rod.rings)
    most = _SECTIONS
    while True:
        # Twice as many sections until one is outside.
        position, jacobian = rod.grid(xi, u[:most])
        inside = rows_at(other, position.reshape(-1, 3)).gap.reshape(position.shape[:2]) < _OUTSIDE * other.rod.radius
        touched = inside.any(axis=1)
        if not touched.all() or most >= u.size:
            break
        most *= 2
    count = int(np.argmin(touched)) if not touched.all() else touched.size
    if not count:
        return None
    # The volume of a slice is its area times the step along the axis at the centre.
    speed = np.interp(u[:count], length.u, length.speed)
    volumes = inside[:count] * determinant(jacobian[:count]) * area * (step / speed)[:, None]
    surface = rod.grid(circle(_AROUND), u[:count])[0]
    outside = rows_at(other, surface.reshape(-1, 3)).gap.reshape(surface.shape[:2]) > _OUTSIDE * other.rod.radius
    # Up to the last section that is enclosed.
    enclosed = step * max(0.0, int(np.argmax([*outside.any(axis=1), True])) - 0.5)
    wholly = (0.0, enclosed) if at_start else (length.total - enclosed, length.total)
    return count * step, wholly if enclosed else None, u[:count], xi, volumes
