"""Supports that turn: how far in a step, and whether the rod between them has followed every whole turn.

A support turned by a whole turn more has its nodes in the same places, so that balance alone does not determine
how often a rod is wound.  Its path does: from one equilibrium to the next no section may turn by half a turn.  Of a
state that comes without its path, the rotation of the sections is followed from one end of the rod to the other.
"""

import numpy as np

from isorod.arrays import Array
from isorod.checks.outlines import outlines
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.model.moving import refuse_late
from isorod.model.support import Support
from isorod.output.rotations import APART, angles, followed, nearest, steps
from isorod.tensors import rotation

# Largest turn in a load step, radians, of a support, or of one against another of its body.
LONGEST = 0.5 * np.pi

# That of an obstacle, and of one with friction: what slips goes along the chord, which is off by half of this.
_OBSTACLE, _RUBBING = 0.5 * np.pi, 0.2

# Most whole turns of a support: a load step has a quarter of one.
_MOST = 100

# A section that turns by more than this in a step may have turned the other way.
_LOST = 0.75 * np.pi

# Sections looked at an element, and places round each.
_SECTIONS, _AROUND = 8, 8


class Turning:
    """What the supports of a model that turn ask of load steps, and of states.

    Attributes
    ----------
    watches
        Whether any does.

    Raises
    ------
    InputError
        If one turns by more whole turns than load steps can take, or an obstacle moves after load factor 1.
    """

    def __init__(self, model: Model) -> None:
        self._model = model
        refuse_late([contact.motion for contact in model.contacts])
        self._turned = _turned(model)
        self.watches = bool(self._turned)
        self._obstacles = [
            (contact.motion, _RUBBING if contact.friction else _OBSTACLE)
            for contact in model.contacts
            if contact.motion is not None
        ]
        turns = max((one.farthest for one in model.motions), default=0.0) / (2.0 * np.pi)
        if turns > _MOST:
            raise InputError(
                f"support: got a rotation of {turns:.4g} turns, need at most {_MOST}: a load step takes a quarter turn"
            )

    def longest_step(self, factor: float) -> float:
        """Return the longest load step from a load factor, infinity where nothing turns.

        It ends where supports and obstacles begin or cease to move at the latest (`Model.stages`).
        """
        fastest = 0.0
        for b in self._turned:
            rates = [np.zeros(3)]
            for support, motion in zip(self._model.supports, self._model.motions, strict=True):
                begin, end = motion.during
                if support.body == b and begin <= factor < end:
                    rates.append(self._model.pace(motion.clock.table, factor) * motion.turn / (end - begin))
            # About axes that stay, the angle between two grows by this at most.
            fastest = max(fastest, max(float(np.linalg.norm(one - other)) for one in rates for other in rates))
        slowest = LONGEST / fastest if fastest else np.inf
        return min([slowest, *(most / rate for one, most in self._obstacles if (rate := one.fastest(factor)))])

    def lost(self, before: Array, after: Array) -> str | None:
        """Return in words where a body with a turned support has turned too far between two states to be followed.

        Parameters
        ----------
        before, after
            Displacements, shape ``(dofs,)``.
        """
        for b in self._turned:
            turned = nearest(*(self._arms(b, state) for state in (before, after)))
            if angles(turned).max() > _LOST or angles(steps(turned)).max() > APART:
                return (
                    f"sections of body {b} rotate by half a turn at the minimum step size: snap-through to "
                    "another equilibrium, or loss of a full turn between its supports"
                )
        return None

    def follows(self, displacement: Array) -> bool:
        """Return whether a state, ``(dofs,)``, is seen to be wound as often as the supports turn.

        It is where a body is held at the whole of one end or both and nowhere else, and the turn about the axis of the
        one end against the other can be followed along it.
        """
        return all(self._winds(b, displacement) for b in self._turned)

    def _arms(self, body: int, displacement: Array) -> Array:
        """Return where places round sections of a body are, from the middle of these, shape ``(t, q, 3)``."""
        space = self._model.bodies[body].space
        breaks = space.axis.breaks
        share = np.arange(_SECTIONS) / _SECTIONS
        u = np.append((breaks[:-1, None] + share * np.diff(breaks)[:, None]).ravel(), breaks[-1])
        found = outlines(space, space.positions + self._model.nodal(displacement, body), u, _AROUND)
        return found - found.mean(axis=1, keepdims=True)

    def _winds(self, body: int, displacement: Array) -> bool:
        model, space = self._model, self._model.bodies[body].space
        if any(one.body == body for one in model.means.values()):
            return False
        held = [
            (support, motion)
            for support, motion in zip(model.supports, model.motions, strict=True)
            if support.body == body and isinstance(support, Support)
        ]
        if len(held) == 1:
            # Whatever turns, all turns with it.
            return True
        ends: dict[int, Array] = {}
        for support, motion in held:
            layers, count = np.unique(np.asarray(support.nodes) // space.layer_nodes, return_counts=True)
            whole = layers.size == 1 and count[0] == space.layer_nodes and layers[0] in (0, space.layers - 1)
            if not whole or space.rod.closed or {*support.components, *support.tied} != {*"xyz"}:
                return False
            ends[int(layers[0])] = motion.turn
        if len(ends) < 2:
            return False
        first, last = ends[0], ends[space.layers - 1]
        turned = nearest(self._arms(body, np.zeros_like(displacement)), self._arms(body, displacement))
        # As the supports say: from the turn of the one end back to none, and on to that of the other.
        count = 2 + int(max(np.linalg.norm(first), np.linalg.norm(last)) / APART * 4.0)
        share = np.linspace(0.0, 1.0, count)
        wanted = np.array([*(rotation(f * first) for f in share[::-1]), *(rotation(f * last) for f in share[1:])])
        about = last - first if np.linalg.norm(last - first) > 0.0 else last
        both = [followed(path, about / np.linalg.norm(about)) for path in (turned, wanted)]
        return abs(both[0] - both[1]) < APART


def refuse_small(model: Model) -> None:
    """Raise `InputError` if a body whose law is of small strains is turned by more than a quarter of a turn."""
    for k, (support, motion) in enumerate(zip(model.supports, model.motions, strict=True)):
        angle = motion.farthest
        small = next((law for law in model.bodies[support.body].laws if not law.objective), None)
        if small is not None and angle > LONGEST:
            raise InputError(
                f"support {k}: got a rotation of {np.degrees(angle):.4g} degrees, but {type(small).__name__} is a "
                "small-strain law; use a finite-strain law such as StVenantKirchhoff"
            )


def _turned(model: Model) -> list[int]:
    """Return the bodies that supports turn, in order."""
    return sorted({one.body for one, motion in zip(model.supports, model.motions, strict=True) if motion.turn.any()})
