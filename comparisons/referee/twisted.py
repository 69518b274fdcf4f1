"""Rods in line with their clamps, one of which turns, then stands still: statics to there, implicit steps from there.

Steps in time keep supports where they are.  So the rod is turned by statics, straight, which it stays whether that is
stable or not; what it starts with sideways is added at the end of the turn, and grows or decays from then on.  Up to
there frames show an even twist.  Rods that buckle are left where they have strayed far: they would go on through
themselves.
"""

from typing import Any

import numpy as np

import isorod
from comparisons.referee.motion import damping, step
from comparisons.referee.rods import CLAMPED, Placed, configuration, held, interpolation, loads, place
from isorod.arrays import Array
from isorod.tensors import rotation

# The most that a load step turns a clamp, radians.
_TURN = 1.0

_SMALL = 1e-9

# After so many frames it is looked where a rod is; one that has strayed from its line by so many lengths is left there.
_WATCHED, _FAR = 20, 0.1


def solve(scenario: Any, elements: int, frames: int, scale: float) -> list[list[tuple[Array, Array]]]:
    """Return nodes and directors (`comparisons.referee.rods.configuration`) of each rod at each frame."""
    return [_rod(scenario, rod, elements, frames, scale) for rod in scenario.rods]


def _rod(scenario: Any, given: Any, elements: int, frames: int, scale: float) -> list[tuple[Array, Array]]:
    placed = place(given, elements)
    _check(placed)
    turn = np.asarray(given.end_motion.rotation[-1], dtype=float)
    model = isorod.Model([placed.body], _supports(placed, turn), loads=loads(placed, scenario.gravity, 0))
    turned = isorod.statics.solve(model, 1 + int(np.linalg.norm(turn) / _TURN))
    times = np.linspace(0.0, scenario.duration, frames)
    first = min(int(np.searchsorted(times, given.end_motion.times[-1] - _SMALL)), frames - 1)
    configurations = [_evenly(placed, turned, time, elements) for time in times[: first + 1]]
    displacement, velocity = turned.displacement + _sideways(placed, turned).ravel(), None
    while len(configurations) < frames:
        count = min(_WATCHED, frames - len(configurations))
        history = isorod.dynamics.solve(
            model,
            float(times[len(configurations) - 1 + count] - times[len(configurations) - 1]),
            step(scenario, scale),
            outputs=count,
            damping=damping(scenario),
            displacement=displacement,
            velocity=velocity,
            integrator="implicit",
        )
        configurations[-1:] = [configuration(placed, state, 0, elements) for state in history]
        displacement, velocity = history.displacement[-1], history.velocity[-1]
        if _strayed(placed, configurations[-1][0]) > _FAR * given.length:
            configurations += [configurations[-1]] * (frames - len(configurations))
    return configurations


def _strayed(placed: Placed, nodes: Array) -> float:
    """Return the largest distance of nodes ``(n, 3)`` from the line of the rod at rest."""
    return float(np.linalg.norm(np.cross(nodes - nodes[0], placed.direction), axis=1).max())


def _check(placed: Placed) -> None:
    """Refuse scenarios other than a straight rod between two clamps, the last of which turns about it and may slide."""
    given, direction = placed.given, placed.direction
    motion = given.end_motion
    if motion is None or given.start_motion is not None or (given.start.value, given.end.value) != (CLAMPED, CLAMPED):
        raise NotImplementedError("a driven end but the second of two clamps")
    if np.abs(np.cross(np.asarray(motion.rotation, dtype=float), direction)).max() > _SMALL or np.any(
        motion.displacement
    ):
        raise NotImplementedError("a driven clamp that does not just turn about its rod: steps in time keep supports")
    if motion.slides_along is None or np.linalg.norm(np.cross(motion.axis, direction)) > _SMALL:
        raise NotImplementedError("a turning clamp that does not slide along its rod")


def _supports(placed: Placed, turn: Array) -> list[isorod.Support]:
    """Return supports: the start stays, the end turns and slides."""
    space, nodes = placed.space, placed.layer("end")
    axial = "xyz"[int(np.argmax(np.abs(placed.direction)))]
    control_point, linear = nodes[:1], nodes[1:3]
    return [
        *(isorod.Support(some, components) for some, components in held(placed, "start", CLAMPED)),
        isorod.Support(control_point, "xyz".replace(axial, "")),
        # Turned, an arm's own direction is none of space's: it keeps its length.
        isorod.Support(linear, "xyz", turn=tuple(turn), arms=space.positions[linear]),
    ]


def _sideways(placed: Placed, turned: isorod.Equilibrium) -> Array:
    """Return the displacement ``(nodes, 3)`` by what the rod starts with sideways, sections turned with it."""
    space, along = placed.space, placed.direction
    shape = (space.layers, space.layer_nodes, 3)
    initial, now = placed.initial.reshape(shape), (space.positions + turned.fields(0)["displacement"]).reshape(shape)
    control_points = space.basis.is_control_point
    off = initial[:, control_points].mean(axis=1)
    off -= (off @ along)[:, None] * along
    places, matrix = interpolation(space)
    first, _, slopes = space.axis.local(places)
    slope = (
        np.stack([row @ off[one : one + row.size] for one, row in zip(first, slopes, strict=True)])
        / placed.given.length
    )
    tilt = np.cross(along, np.linalg.solve(matrix, slope))
    result = np.where(control_points[:, None], off[:, None], np.cross(tilt[:, None], now))
    return result.reshape(-1, 3)


def _evenly(placed: Placed, turned: isorod.Equilibrium, time: float, elements: int) -> tuple[Array, Array]:
    """Return nodes and directors between rest and the turned state."""
    given, motion = placed.given, placed.given.end_motion
    total = np.linalg.norm(motion.rotation[-1])
    angle = float(np.interp(time, motion.times, np.asarray(motion.rotation) @ placed.direction))
    nodes = given.nodes(elements)
    grown = turned.centre_line(0, elements + 1) - np.stack([nodes[0]] * (elements + 1))
    grown = (grown @ placed.direction - (nodes - nodes[0]) @ placed.direction)[:, None] * placed.direction
    middle = (np.arange(elements) + 0.5) / elements
    turns = np.stack([rotation(fraction * angle * placed.direction) for fraction in middle])
    directors = np.einsum("eab,eb->ea", turns, given.directors(elements))
    return nodes + (angle / total) ** 2 * grown, directors
