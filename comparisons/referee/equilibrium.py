"""Scenarios whose result is an equilibrium, without contact: by statics, from straight rods under no load."""

from typing import Any

import numpy as np

import isorod
from comparisons.referee.rods import CLAMPED, PINNED, Placed, arms, configuration, held, loads, place
from isorod.arrays import Array

# The equal steps to start with; those that fail are cut, quick ones doubled.
STEPS = 5


def solve(scenario: Any, elements: int) -> list[tuple[Array, Array]]:
    """Return nodes and directors (`comparisons.referee.rods.configuration`) of each rod, in equilibrium."""
    return [_rod(rod, scenario.gravity, elements) for rod in scenario.rods]


def _rod(given: Any, gravity: Any, elements: int) -> tuple[Array, Array]:
    placed = place(given, elements, most=0.5)
    model = isorod.Model([placed.body], _supports(placed, gravity), loads=loads(placed, gravity, 0))
    nodes, directors = configuration(placed, isorod.statics.solve(model, STEPS), 0, elements)
    down = np.asarray(gravity, dtype=float)
    if len(placed.ends()) == 2 and (nodes.mean(axis=0) - nodes[[0, -1]].mean(axis=0)) @ down < 0.0:
        raise isorod.SolveError("statics came to the arch above the supports, which is not stable")
    return nodes, directors


def _supports(placed: Placed, gravity: Any) -> list[isorod.Support]:
    """Return supports that take the ends of a straight rod to where the scenario has them."""
    ends = dict(placed.ends())
    if CLAMPED not in ends.values() and len(ends) < 2:
        raise NotImplementedError("an equilibrium of a rod that neither a clamp nor two pins hold")
    supports = []
    for which, how in ends.items():
        nodes = placed.layer(which)
        moved = placed.initial[nodes[placed.space.basis.is_control_point]].mean(axis=0)
        if how == CLAMPED:
            _check_clamp(placed, which)
        for some, components in held(placed, which, how):
            arm, turn = _detour(moved, gravity) if how == PINNED else (None, np.zeros(3))
            given = np.zeros(3) if turn.any() else moved * placed.space.is_control_point[some, None]
            around = None if arm is None else np.tile(arm, (some.size, 1))
            supports.append(isorod.Support(some, components, given, turn=tuple(turn), arms=around))
    if CLAMPED not in ends.values():
        supports.append(_spin(placed))
    return supports


def _check_clamp(placed: Placed, which: str) -> None:
    """Refuse a clamp in which the rod is not as at rest, along a coordinate axis."""
    nodes = placed.layer(which)
    other = placed.initial[nodes[~placed.space.basis.is_control_point]]
    if np.abs(other).max() > 1e-3 * placed.given.radius:
        raise NotImplementedError(f"a clamp at the {which} that holds the rod in another direction than its chord's")


def _detour(moved: Array, gravity: Any) -> tuple[Array | None, Array]:
    """Return arm and rotation vector that take a pin to its place by half a circle, in the plane of gravity.

    The ends of a straight rod then approach with the square of the load factor, while its weight grows with the
    factor: it sags before it is pushed, and does not buckle upwards.
    """
    axis = np.cross(moved, gravity)
    size = np.linalg.norm(axis)
    if size <= 1e-9 * np.linalg.norm(moved) * np.linalg.norm(gravity):
        return None, np.zeros(3)
    return -0.5 * moved, np.pi * axis / size


def _spin(placed: Placed) -> isorod.Support:
    """Return the support that keeps a rod between two pins from turning about their line; its reaction is zero."""
    turned = np.cross(placed.direction, arms(placed.space))
    node, component = np.unravel_index(int(np.argmax(np.abs(turned))), turned.shape)
    return isorod.Support(np.array([node]), "xyz"[component])
