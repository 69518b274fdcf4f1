"""The contacts of a scenario as contacts of isorod."""

from collections.abc import Sequence
from typing import Any

import numpy as np

import isorod
from comparisons.referee.rods import Placed
from isorod.arrays import Index

# Pressure per depth, in moduli per radius: no stiffer than implicit steps follow; a rope of which a length of 400 radii
# weighs on a cylinder fifty times as thick sinks in by a fifteenth of its radius.
PENALTY = 0.02

# Elements that start no farther from the other rod than so many diameters take part, at points no farther apart than
# this fraction of a radius.
NEAR, SPACING = 4.0, 0.3

_MOST_POINTS = 64


def pairs(scenario: Any, elements: int) -> list[tuple[int, int]]:
    """Return the pairs of rods of which elements start near each other."""
    pairs = []
    for i, one in enumerate(scenario.rods):
        for j, other in enumerate(scenario.rods[:i]):
            if near(one, other, elements).size:
                pairs.append((j, i))
    return pairs


def contacts(scenario: Any, placed: Sequence[Placed], elements: int) -> list[isorod.Contact]:
    """Return the contacts of rods, placed in this order, with each other, themselves and obstacles."""
    contacts = []
    for first, second in pairs(scenario, elements):
        one, other = placed[first].given, placed[second].given
        contacts.append(
            isorod.Contact(
                first,
                second,
                _penalty(one, other),
                near(one, other, elements).tolist(),
                near(other, one, elements).tolist(),
                points=_points(placed[first], elements),
                friction=max(one.friction, other.friction),
            )
        )
    for k, rod in enumerate(placed):
        if scenario.self_contact:
            own = _points(rod, elements)
            contacts.append(isorod.Contact(k, penalty=_penalty(rod.given), points=own, friction=rod.given.friction))
        for obstacle in scenario.obstacles:
            points, friction = _points(rod, elements), max(rod.given.friction, obstacle.friction)
            contacts.append(isorod.Contact(k, _rigid(obstacle), _penalty(rod.given), points=points, friction=friction))
    return contacts


def _rigid(obstacle: Any) -> isorod.Plane | isorod.Cylinder:
    """Return an obstacle as isorod knows it: cylinders have no ends."""
    if obstacle.kind == "plane":
        return isorod.Plane(tuple(obstacle.point), tuple(obstacle.normal))
    return isorod.Cylinder(tuple(obstacle.center), tuple(obstacle.axis), obstacle.radius)


def _penalty(*rods: Any) -> float:
    return PENALTY * min(rod.material.youngs_modulus / rod.radius for rod in rods)


def _points(placed: Placed, elements: int) -> tuple[int, int]:
    """Return the points round an arc and along an element."""
    apart = SPACING * placed.given.radius
    arc = 2.0 * np.pi * placed.given.radius / placed.space.points_around
    lengths = arc, placed.given.length / elements
    around, along = (min(int(np.ceil(length / apart)), _MOST_POINTS) for length in lengths)
    return around, along


def near(rod: Any, other: Any, elements: int) -> Index:
    """Return the elements of a rod that start near another rod."""
    nodes, others = rod.nodes(8 * elements), other.nodes(8 * elements)
    gaps = np.linalg.norm(nodes[:, None] - others, axis=2).min(axis=1)
    close = gaps <= NEAR * (rod.radius + other.radius)
    return np.flatnonzero([close[8 * e : 8 * e + 9].any() for e in range(elements)])
