"""How a rod is discretised where nothing is given: what suits its shape, by rules that were measured.

Across the section polynomials of the lowest degree whose torsion constant is right, or functions of control points
where polynomials do not suit; along the axis elements of degree 5, as many as the rod turns or is long, so smooth
that slender ones do not lock, and shorter ones towards the ends (`boundary_layers`).
"""

from collections.abc import Sequence
from functools import lru_cache
from math import ceil, inf, pi
from typing import Any, NamedTuple, cast

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.geometry.axis import MAX_DEGREE
from isorod.geometry.disk import circle
from isorod.geometry.quadrature import WHOLE, Rule
from isorod.geometry.rod import Rod
from isorod.geometry.section import refinement_turn
from isorod.space.polyharmonic import Polyharmonic
from isorod.space.polynomial import MAX_DEGREE as MAX_SECTION_DEGREE
from isorod.space.polynomial import polynomials
from isorod.space.shape import ROUND, Shape, shape_of
from isorod.space.torsion import MAX_RINGED, of_polynomials, torsion

DEGREE = 5

# Chosen elements have so many functions of their own, if their degree allows: those of degree 5 are twice continuously
# differentiable.  Ten modes of straight rods err by 0.13 % at the most with five of them, by 0.14 % with four; with two
# functions of their own by 0.5 % with six.
_OWN = 3

# Angle, degrees, that an element of these may turn by, bent or twisted, and the least elements of a rod, by degree; a
# closed rod takes twice as many.
ANGLES = {1: 5.0, 2: 11.25, 3: 30.0, 4: 45.0, 5: 60.0, 6: 60.0}
ELEMENTS = {1: 64, 2: 32, 3: 12, 4: 7, 5: 5, 6: 4}

# Elements that supports turn may turn by so many times as much: of straight bars twisted by up to ten turns and rolled
# up twice moments then err by 1e-3 at the most.
_TURNED = 2.0

# Share of the torsion constant that a section degree may miss, and the most it may be.
WARPING = 2e-3
MOST = 6

# The least section degree, by how many times as long as wide a rod is at the most: the shorter, the more what happens
# at its held faces makes up of it.  Forces of round bars of any ratio of Poisson, pulled, sheared, twisted and bent,
# err by 0.4 % at the most from 3.5 widths on, and by 0.7 % at 2.
LEAST = {4.0: 5, 10.0: 4, inf: 3}

# Share of the largest stress in torsion that it may miss in statics, if one up to the most there can do with less.
TWISTED, MOST_TWISTED = 0.01, 7

# Degree of the functions of the thickness by which shear warps a section.
CUBIC = 3

# What is left of a series in the radius times the curvature that ends with the section degree, in statics.
CURVED = 0.005

# Rods with a hole or in layers, at least: springs of tube, holes of 0.6, 0.8 and 0.93, err by 0.02, 0.12 and 0.19 %
# with 4, a core in its sheath by less; in statics, with 5, their stresses by 2 %, for 4 %.  Hollow airfoils want 8 to
# 10.
RINGED, RINGED_STRESSED, MOST_RINGED = 4, 5, 10

# The same where pressure lets a pipe buckle into an oval: load factors of holes of 0.9 are 34 % too high with 4, 0.5 %
# with 5, 0.001 % with 6.
RINGED_BUCKLED = 6

# At the rim of a hole that a rod is bonded in, or of a held face, stresses rise along the surface: polynomials across
# converge slowly, rings do not.  A rod through a block of 0.1, 1 and 10 times its stiffness is 0.4, 0.5 and 0.5 % too
# stiff across its axis, with polynomials of degree 4 alone 0.45, 1.0 and 1.7 % (`comparisons.joints.weld`).  Fibres
# carry what is at their ends: stresses of bars 5 radii long, 20 times as stiff along them, are 0.3 % off in shear, with
# polynomials 1.9 and 2.1 %.
RIM = (0.0, 0.8, 1.0)

# Points of an outline whose waves tell whether it is an ellipse, and the share of the first that others may have.
_WAVES, _SAME = 16, 1e-9

# How many times as many elements a rod in contact has.  Measured on crossing wires and on a ring pressed by a plane:
# their forces err by 0.2 and 0.4 % with twice as many.
TOUCHING = 2.4

# Points round a section at which contact is looked for: 24 err by 0.4 % more there.
AROUND = 48

# Points along a radius, and round a section, of laws whose stress has kinks.  Torques of round bars that yield to a
# half or two thirds of their radius err by 2 % with 4 along it, by 1, 0.2, 0.1 and 0.06 % with 5, 8, 12 and 16; moments
# of bent ones by 3, 1.4 and 0.15 % with 8, 16 and 32 round the section.
KINKED, KINKED_AROUND = 12, 32

# Functions of control points, where sections are no affine images of each other or have petals: polyharmonic of this
# order, of this many points at least.
ORDER, POINTS = 2, 24


class Layer(NamedTuple):
    """Elements near an end: the first so many radii long, each next one so many times as long."""

    first: float
    rise: float


# What a held, loaded or welded end does to stresses decays within a diameter where the law is isotropic, later where
# fibres are stiff; the layer in which a cable bends at its ends is longer still.  Elements that resolve all of these
# grow until they are as long as the others; a knot is left out where another one is as near as these shares of its
# element's length, before and after it.  Measured (`comparisons.stability.stresses`): stresses of round bars from a
# diameter off the ends on err by 0.5 % at the most, where even elements err by 55 %.
LAYER = Layer(0.4, 3.0)
_BEFORE, _AFTER = 0.6, 0.4

# What the first element is where a section is flat, so that its thickness counts, or under pressure, whose own stresses
# are small beside what the ends do: of airfoils in tension 0.3 % off for 1.1, under pressure 0.6 for 1.4.
_FINE = 0.2

# Where fibres are stiff elements grow more slowly: with those 20 times as stiff round bars are off by 0.5 % under
# pressure, for 1.2, ellipses in torsion by 0.8, for 1.2.  In tubes, too, under pressure: 0.2 % off, for 1.3.
_SLOW = 2.0

# Rods that are longer, in widths, have none: with some, Newton's method loses to rounding from 5e4 widths on, without
# from 5e5.
_SLENDEREST = 1e4

# At these knots functions are that often differentiable: as right as C0, with two fifths of the unknowns it adds.
SMOOTH = 3


class Along(NamedTuple):
    """What a space is along the axis: even elements, their degree and continuity, and further knots."""

    elements: int
    degree: int
    continuity: int
    knots: tuple[float, ...]


def axis(
    rod: Rod,
    elements: int | None,
    degree: int | None,
    continuity: int | None,
    knots: tuple[float, ...] | None = None,
    angle: float = 0.0,
) -> Along:
    """Return elements, degree, continuity and further knots, those that are None chosen.

    To elements that are chosen come knots near the ends (`boundary_layers`).  There are more where supports turn the
    rod by an ``angle``, radians, in all.
    """
    own = rod.axis.elements
    if degree is None:
        degree = max(DEGREE, rod.axis.degree)
    smooth = max(degree - _OWN, 0)
    continuity = smooth if continuity is None else continuity
    if elements is not None:
        return Along(elements, degree, continuity, knots or ())
    # What is out of range is for the axis to refuse.
    known = min(max(int(degree), 1), MAX_DEGREE) if np.isfinite(degree) else DEGREE
    shape = shape_of(rod)
    least = ELEMENTS[known] * max(1 + rod.closed, shape.walls / ELEMENTS[DEGREE])
    functions = max(degree - smooth, 1)
    # At the rod's own knots an element has more of its own, if they are less smooth.
    rough = max(0, smooth - rod.axis.degree + int(rod.axis.multiplicities[1:-1].min(initial=degree))) if own > 1 else 0
    turns = np.degrees(shape.angle + angle / (_TURNED * own)) / ANGLES[known]
    turning = ceil(turns - 0.1 - rough / functions)
    parts = max(turning, ceil(least / own - rough / functions), 1)
    if knots is None:
        knots = () if rod.closed else _boundary_layers(rod, parts, shape)
    return Along(parts * own, degree, continuity, knots)


def boundary_layers(
    rod: Rod, degree: int | None, places: Sequence[float], angle: float = 0.0, layer: Layer = LAYER
) -> tuple[float, ...]:
    """Return the ``knots`` of a space that resolve boundary layers at both ends and on both sides of more places.

    Parameters
    ----------
    degree
        Of the space along the axis, None if it is chosen.
    places
        Axis parameters, such as those of knots at which laws differ, or of loads on sections.  Those that are no knots
        of the rod are among the knots, twice: functions have kinks there.
    angle
        As for `axis`.
    layer
        How long the elements are.
    """
    parts = axis(rod, None, degree, None, (), angle).elements // rod.axis.elements
    kinks = [u for u in set(places) if not np.isin(u, rod.axis.breaks)]
    return tuple(sorted([*_boundary_layers(rod, parts, shape_of(rod), places, layer), *2 * kinks]))


def _boundary_layers(
    rod: Rod, parts: int, shape: Shape, places: Sequence[float] = (), layer: Layer = LAYER
) -> tuple[float, ...]:
    """Return knots that, with the rod's elements cut in so many parts, resolve boundary layers."""
    if shape.slenderness > _SLENDEREST:
        return ()
    there = np.interp(rod.axis.evenly(parts), shape.u, shape.way)
    ends = [] if rod.closed else [0.0, shape.way[-1]]
    middles = np.unique([*ends, *np.interp(places, shape.u, shape.way)])
    found: list[float] = []
    for middle in middles:
        for side in (-1.0, 1.0):
            others = side * (middles - middle)
            room = 0.5 * min(others[others > 0.0], default=0.0)
            even = side * (there - middle)
            element = min(even[even > 1e-9 * shape.way[-1]], default=0.0)
            way, size = 0.0, layer.first * shape.radius
            while size < element:
                way += size
                off = side * (np.append(there, found) - middle)
                near = (off > way - _BEFORE * size) & (off < way + _AFTER * size)
                if not near.any() and way + _AFTER * size < room:
                    found.append(middle + side * way)
                size *= layer.rise
    return tuple(np.sort(np.interp(found, shape.way, shape.u)).tolist())


def halved(space: Any) -> dict[str, object]:
    """Return elements and knots, as keyword arguments of `Space`, that cut each element of a space in two or more."""
    breaks, elements = space.axis.breaks, 2 * cast(int, space.elements)
    even = space.rod.axis.refine(elements // space.rod.axis.elements, space.degree, space.continuity).breaks
    more = np.sort(np.concatenate([space.knots or (), 0.5 * (breaks[:-1] + breaks[1:])]))
    apart = np.abs(more[:, None] - even).min(axis=1) > 1e-9 * (breaks[-1] - breaks[0])
    # A kink may be at an even one.
    kinks = np.array([np.count_nonzero(more == u) == 2 for u in more])
    return {"elements": elements, "knots": tuple(map(float, more[apart | kinks]))}


def turned(rod: Rod, angle: float, degree: int | None, continuity: int | None) -> dict[str, Any]:
    """Return elements and knots, as keyword arguments of `isorod.space.Space`, of a rod that supports turn (`axis`)."""
    chosen = axis(rod, None, degree, continuity, None, angle)
    return {"elements": chosen.elements, "knots": chosen.knots}


def touching(
    rod: Rod,
    elements: int | None = None,
    degree: int | None = None,
    continuity: int | None = None,
    angle: float = 0.0,
) -> dict[str, int]:
    """Return elements, degree and continuity, as keyword arguments of `isorod.space.Space`, of a rod in contact.

    Its surface has no kinks, on which closest points would jump, but its curvature may, as it does under a force at a
    point; and elements are shorter (`TOUCHING`).
    """
    chosen, degree, *_ = axis(rod, None, degree, None, (), angle)
    own = rod.axis.elements
    return {
        "elements": own * ceil(TOUCHING * chosen / own - 1e-9) if elements is None else elements,
        "degree": degree,
        "continuity": min(1, degree - 1) if continuity is None else continuity,
    }


def touching_points(rod: Rod, n: int, elements: int, degree: int, least: int, most: int) -> tuple[int, int]:
    """Return the points of a contact round an arc and along an element: as close along as round (`AROUND`).

    Where two round bodies touch is about as long as wide, and what lies between two points is not seen.

    Parameters
    ----------
    rod
        One of those that touch.
    n, elements, degree
        Of its space: points round the section, elements, and their degree.
    least, most
        Points round an arc at least, and of either at most.
    """
    shape = shape_of(rod)
    across = min(max(least, ceil(AROUND / n)), most)
    # Of a round section, on which points are 2 pi r / (n across) apart.
    along = ceil(shape.slenderness * n * across / (pi * elements))
    return across, min(max(along, degree + 1), most)


# A rod's functions are asked for several times as its space is chosen.
@lru_cache(maxsize=8)
def section(rod: Rod, missed: float = WARPING) -> dict[str, int]:
    """Return the section functions as keyword arguments of `isorod.space.Space`: polynomials where these suit.

    ``missed`` is the share of the torsion constant that they may miss.
    """
    slenderness = shape_of(rod).slenderness
    least = next(degree for most, degree in LEAST.items() if slenderness <= most)
    if rod.rings != WHOLE:
        from isorod.space.ringed import Ringed

        best, _ = torsion(rod, Ringed(rod, MAX_RINGED))
        for degree in range(max(RINGED, least), MOST_RINGED):
            if torsion(rod, Ringed(rod, degree))[0] <= (1.0 + missed) * best:
                return {"section_degree": degree}
        return {"section_degree": MOST_RINGED}
    multiple = ceil(POINTS / rod.section_points)
    points = {"order": ORDER, "section_points": multiple * rod.section_points}
    try:
        best, _ = of_polynomials(rod, MAX_SECTION_DEGREE)
    except InputError:
        return points
    for degree in range(least, MOST + 1):
        constant, _ = of_polynomials(rod, degree)
        if constant <= (1.0 + missed) * best:
            return {"section_degree": degree}
    turn = refinement_turn(rod.section_points, multiple)
    harmonic = torsion(rod, Polyharmonic(points["section_points"], ORDER, turn))[0]
    return points if harmonic * (1.0 + missed) < constant else {"section_degree": MOST}


def with_rim(rod: Rod) -> Rod:
    """Return a rod of ellipses in rings that resolve its rim (`RIM`), any other as it is.

    Rings represent no other section exactly.
    """
    waves = np.abs(np.fft.rfft(rod.grid(circle(_WAVES), rod.axis.breaks)[0], axis=1))
    round_ = waves[:, 2:].max() <= _SAME * waves[:, 1].max()
    return rod.with_rings(RIM) if round_ and rod.rings == WHOLE and "section_degree" in section(rod) else rod


def layer(rod: Rod, reach: float, pressed: bool) -> Layer:
    """Return the elements near ends with which stresses are right, as for `stressed`."""
    fine = pressed or shape_of(rod).thinness < ROUND
    slow = reach or (pressed and rod.rings[0])
    return Layer(_FINE if fine else LAYER.first, _SLOW if slow else LAYER.rise)


def is_short(rod: Rod, reach: float) -> bool:
    """Return whether what is done to one end of a rod reaches the other in its fibres (`isorod.material.law.reach`)."""
    return reach > 2.0 * shape_of(rod).slenderness


def buckling(rod: Rod) -> dict[str, int]:
    """Return the section functions, as `section` does, with which thin pipes buckle into ovals where they should."""
    found = section(rod)
    return found if rod.rings == WHOLE else {"section_degree": max(found["section_degree"], RINGED_BUCKLED)}


def stressed(rod: Rod, reach: float, pressed: bool = False) -> dict[str, int]:
    """Return the section functions, as `section` does, with which stresses are right too, not works alone.

    Parameters
    ----------
    reach
        Of the laws (`isorod.material.law.reach`), 0 without fibres.
    pressed
        Whether pressures act on the surface.
    """
    found = section(rod)
    if rod.rings != WHOLE:
        # One more where the ends of fibres count everywhere: ellipses in torsion are 0.4 % off, for 1.2.
        least = RINGED_STRESSED + is_short(rod, reach)
        return {"section_degree": max(found["section_degree"], least)}
    if "section_degree" not in found:
        return found
    best = of_polynomials(rod, MAX_SECTION_DEGREE)[1]
    # Stresses of a curved bar are a power series in the radius over that of its axis.
    series = ceil(np.log(CURVED) / np.log(np.clip(shape_of(rod).bend, CURVED, 0.5)))
    # What pressure does is small beside what held ends do to stiff fibres.
    most, fibres = (MAX_SECTION_DEGREE, reach) if pressed else (MOST, 0.5 * reach)
    degree = max(found["section_degree"], min(max(ceil(2.0 + fibres), series), most))
    # Shear warps a section by cubic functions of its thickness.
    while degree < MOST and polynomials(rod, degree).across < CUBIC:
        degree += 1
    missed = [_missed(rod, one, best) for one in range(degree, max(degree, MOST_TWISTED) + 1)]
    return {
        "section_degree": degree + next(k for k, one in enumerate(missed) if one <= max(TWISTED, 1.01 * missed[-1]))
    }


def _missed(rod: Rod, degree: int, best: Array) -> float:
    """Return by how much stresses in torsion are off, as a share of the largest."""
    off = np.linalg.norm(of_polynomials(rod, degree)[1] - best, axis=1).max()
    return float(off / np.linalg.norm(best, axis=1).max())


def rule(space: Any) -> Rule:
    """Return the quadrature rule: ``auto``, but as many points as the degree along elements joined without slopes.

    The short elements of boundary layers take part in that, smooth as they are.
    """
    axis, degree = space.axis, space.axis.degree
    found, even = space.basis.auto(degree), ~np.isin(axis.breaks[1:-1], space.knots or ())
    sharp = degree > 1 and (axis.multiplicities[1:-1][even] >= degree).all()
    return Rule(found.radial, found.angular, degree) if sharp else found


def kinked(space: Any) -> Rule:
    """Return the quadrature rule of a law whose stress has kinks somewhere in a section, as where metal begins to flow.

    They lie anywhere between the points.
    """
    found, around = space.rule, ceil(KINKED_AROUND / space.points_around)
    return Rule(max(found.radial, KINKED), max(found.angular, around), found.axial)
