"""Rotating supports: the largest rotation in a step, and whether the rod between them has followed every full turn.

A support rotated by a full turn more has its nodes in the same places, so that equilibrium alone does not determine
the number of turns of a rod.  The load path does: no section may rotate by half a turn between two equilibria.  For a
state without its path, the rotation of sections is followed from one end of the rod to the other.
"""

import numpy as np

from isorod.arrays import Array
from isorod.checks.outlines import outlines
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.model.moving import refuse_late
from isorod.output.rotations import APART, AROUND, angles, clamped_layer, followed, nearest, sections, steps
from isorod.tensors import rotation

# Largest rotation in a load step, radians, of a support, alone or relative to another of its body.
LONGEST = 0.5 * np.pi

# That of an obstacle, and with friction: slip follows the chord, whose direction is off by half of this angle.
_OBSTACLE, _RUBBING = 0.5 * np.pi, 0.2

# Full turns of a support at most: a load step makes a quarter of one.
_MOST = 100

# A section that rotates by more than this in a step may have rotated in the other sense.
_LOST = 0.75 * np.pi


class Turning:
    """Limits of rotating supports on load steps, and checks of states.

    Attributes
    ----------
    watches
        Whether any support rotates.

    Raises
    ------
    InputError
        If one rotates by too many turns, or an obstacle moves after load factor 1.
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
        """Return the longest load step from a load factor, infinity where nothing rotates.

        It ends at the latest where supports or obstacles begin or cease to move (`Model.stages`).
        """
        fastest = 0.0
        for b in self._turned:
            rates = [np.zeros(3)]
            for support, motion in zip(self._model.supports, self._model.motions, strict=True):
                begin, end = motion.during
                if support.body == b and begin <= factor < end:
                    rates.append(self._model.pace(motion.clock.table, factor) * motion.turn / (end - begin))
            # About fixed axes, the relative angle of two grows by at most the difference of their rates.
            fastest = max(fastest, max(float(np.linalg.norm(one - other)) for one in rates for other in rates))
        slowest = LONGEST / fastest if fastest else np.inf
        return min([slowest, *(most / rate for one, most in self._obstacles if (rate := one.fastest(factor)))])

    def lost(self, before: Array, after: Array) -> str | None:
        """Return a message if a body with a rotated support has rotated too far between two states to be followed.

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
        """Return whether a state, ``(dofs,)``, provably has as many turns as the supports.

        That takes bodies clamped at one or both end faces and nowhere else, along which the relative rotation of the
        ends about the axis can be followed.
        """
        return all(self._winds(b, displacement) for b in self._turned)

    def _arms(self, body: int, displacement: Array) -> Array:
        """Return points round sections of a body relative to their centres, shape ``(t, q, 3)``."""
        space = self._model.bodies[body].space
        points = outlines(space, space.positions + self._model.nodal(displacement, body), sections(space), AROUND)
        return points - points.mean(axis=1, keepdims=True)

    def _winds(self, body: int, displacement: Array) -> bool:
        model, space = self._model, self._model.bodies[body].space
        if any(one.body == body for one in model.means.values()):
            return False
        pairs = zip(model.supports, model.motions, strict=True)
        supports = [(support, motion) for support, motion in pairs if support.body == body]
        if len(supports) == 1:
            # The body rotates with its only support.
            return True
        ends: dict[int, Array] = {}
        for support, motion in supports:
            if (layer := clamped_layer(space, support)) is None:
                return False
            ends[layer] = motion.turn
        if len(ends) < 2:
            return False
        first, last = ends[0], ends[space.layers - 1]
        turned = nearest(self._arms(body, np.zeros_like(displacement)), self._arms(body, displacement))
        # Prescribed: from the rotation of one end back to zero, and on to that of the other end.
        count = 2 + int(max(np.linalg.norm(first), np.linalg.norm(last)) / APART * 4.0)
        fractions = np.linspace(0.0, 1.0, count)
        target = np.array(
            [*(rotation(f * first) for f in fractions[::-1]), *(rotation(f * last) for f in fractions[1:])]
        )
        axis = last - first if np.linalg.norm(last - first) > 0.0 else last
        both = [followed(path, axis / np.linalg.norm(axis)) for path in (turned, target)]
        return abs(both[0] - both[1]) < APART


def refuse_small(model: Model) -> None:
    """Raise `InputError` if a support rotates a body with a small-strain law by more than a quarter of a turn."""
    for k, (support, motion) in enumerate(zip(model.supports, model.motions, strict=True)):
        angle = motion.farthest
        small = next((law for law in model.bodies[support.body].laws if not law.objective), None)
        if small is not None and angle > LONGEST:
            raise InputError(
                f"support {k}: got a rotation of {np.degrees(angle):.4g} degrees, but {type(small).__name__} is a "
                "small-strain law; use a finite-strain law such as StVenantKirchhoff"
            )


def _turned(model: Model) -> list[int]:
    """Return the bodies that supports rotate, in order."""
    return sorted({one.body for one, motion in zip(model.supports, model.motions, strict=True) if motion.turn.any()})
