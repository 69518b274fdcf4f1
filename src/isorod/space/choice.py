"""Default discretisation of a rod, from its shape, by measured rules.

Across the section polynomials of the lowest degree whose torsion constant is accurate, or functions of control points
where polynomials are not; along the axis elements of degree 5, their number from the rod's curvature, twist and length,
smooth enough that slender ones do not lock, and shorter ones towards the ends (`boundary_layers`).
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

# Functions per chosen element, if its degree allows: those of degree 5 are C2.  Ten modes of straight rods err by at
# most 0.13 % with five elements, by 0.14 % with four; with two functions per element by 0.5 % with six.
_OWN = 3

# Largest rotation of such an element by bending or twist, degrees, and the least elements of a rod, by degree; a closed
# rod takes twice as many.
ANGLES = {1: 5.0, 2: 11.25, 3: 30.0, 4: 45.0, 5: 60.0, 6: 60.0}
ELEMENTS = {1: 64, 2: 32, 3: 12, 4: 7, 5: 5, 6: 4}

# Factor of that angle for rotations by supports: moments of straight bars twisted by up to ten turns and rolled up
# twice then err by at most 1e-3.
_TURNED = 2.0

# Relative error of the torsion constant allowed for a section degree, and the largest degree.
WARPING = 2e-3
MOST = 6

# The least section degree, by the largest slenderness for it: the shorter a rod, the more the strains at its held faces
# count.  Forces of round bars of any ratio of Poisson, pulled, sheared, twisted and bent,
# err by at most 0.4 % from 3.5 widths on, and by 0.7 % at 2.
LEAST = {4.0: 5, 10.0: 4, inf: 3}

# Error of stresses in torsion allowed in statics, relative to the largest, and the largest degree tried for it.
TWISTED, MOST_TWISTED = 0.01, 7

# Degree in the thickness of the warping by shear.
CUBIC = 3

# Remainder allowed in statics of a power series in radius times curvature, cut at the section degree.
CURVED = 0.005

# Least degree of rods with a hole or in layers: springs of tube, holes of 0.6, 0.8 and 0.93, err by 0.02, 0.12 and
# 0.19 % with 4, a core in its sheath by less; in statics, with 5, their stresses by 2 %, with 4 by 4 %.  Hollow
# airfoils need 8 to 10.
RINGED, RINGED_STRESSED, MOST_RINGED = 4, 5, 10

# The same where pressure lets a pipe buckle into an oval: load factors of holes of 0.9 are 34 % too high with 4, 0.5 %
# with 5, 0.001 % with 6.
RINGED_BUCKLED = 6

# At the rim of a hole that a rod is bonded in, or of a held face, stresses rise towards the surface: polynomials across
# converge slowly, rings fast.  A rod through a block of 0.1, 1 and 10 times its stiffness is 0.4, 0.5 and 0.5 % too
# stiff across its axis, with polynomials of degree 4 alone 0.45, 1.0 and 1.7 % (`comparisons.joints.weld`).  Fibres
# carry end effects far: stresses of bars 5 radii long, 20 times as stiff along them, are 0.3 % off in shear, with
# polynomials 1.9 and 2.1 %.
RIM = (0.0, 0.8, 1.0)

# Points of an outline whose waves show whether it is an ellipse, and the largest ratio of other waves to the first.
_WAVES, _SAME = 16, 1e-9

# Factor of the number of elements of a rod in contact.  Measured on crossing wires and on a ring pressed by a plane:
# their forces err by 0.2 and 0.4 % with twice as many.
TOUCHING = 2.4

# Contact points round a section: 24 err by 0.4 % more there.
AROUND = 48

# Points along a radius, and round a section, of laws whose stress has kinks.  Torques of round bars that yield to a
# half or two thirds of their radius err by 2 % with 4 along it, by 1, 0.2, 0.1 and 0.06 % with 5, 8, 12 and 16; moments
# of bent ones by 3, 1.4 and 0.15 % with 8, 16 and 32 round the section.
KINKED, KINKED_AROUND = 12, 32

# Order and least points of polyharmonic functions of control points, where sections are not affine images of each other
# or have petals.
ORDER, POINTS = 2, 24


class Layer(NamedTuple):
    """Elements near an end: length of the first in radii, and ratio of each next one to the last."""

    first: float
    rise: float


# Stresses of a held, loaded or welded end decay within a diameter where the law is isotropic, later where fibres are
# stiff; the layer in which a cable bends at its ends is longer still.  Elements that resolve all of these grow to the
# length of the others; a knot is left out where another one is within these fractions of its element's length, before
# and after it.  Measured (`comparisons.stability.stresses`): stresses of round bars from a
# diameter off the ends on err by at most 0.5 %, with even elements by 55 %.
LAYER = Layer(0.4, 3.0)
_BEFORE, _AFTER = 0.6, 0.4

# The first element where a section is flat, so that its thickness counts, or under pressure, whose stresses are small
# beside those of the ends: airfoils in tension are 0.3 % off instead of 1.1, under pressure 0.6 instead of 1.4.
_FINE = 0.2

# Slower growth where fibres are stiff: with fibres 20 times as stiff round bars are off by 0.5 % under pressure,
# instead of 1.2, ellipses in torsion by 0.8, instead of 1.2.  Also in tubes under pressure: 0.2 % off instead of 1.3.
_SLOW = 2.0

# Longer rods, in widths, have no boundary layers: with them Newton's method fails by round-off from 5e4 widths on,
# without from 5e5.
_SLENDEREST = 1e4

# Continuity at these knots: as accurate as C0, with two fifths of its additional unknowns.
SMOOTH = 3


class Along(NamedTuple):
    """A space along the axis: even elements, their degree and continuity, and further knots."""

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
    """Return elements, degree, continuity and further knots; those that are None are chosen.

    Chosen elements have further knots near the ends (`boundary_layers`).  There are more elements where supports rotate
    the rod by an ``angle``, radians, in all.
    """
    own = rod.axis.elements
    if degree is None:
        degree = max(DEGREE, rod.axis.degree)
    smooth = max(degree - _OWN, 0)
    continuity = smooth if continuity is None else continuity
    if elements is not None:
        return Along(elements, degree, continuity, knots or ())
    # Degrees out of range are refused by the axis.
    valid_degree = min(max(int(degree), 1), MAX_DEGREE) if np.isfinite(degree) else DEGREE
    shape = shape_of(rod)
    least = ELEMENTS[valid_degree] * max(1 + rod.closed, shape.walls / ELEMENTS[DEGREE])
    functions = max(degree - smooth, 1)
    # There are more functions per element at the rod's own knots, if these are less smooth.
    rough = max(0, smooth - rod.axis.degree + int(rod.axis.multiplicities[1:-1].min(initial=degree))) if own > 1 else 0
    turns = np.degrees(shape.angle + angle / (_TURNED * own)) / ANGLES[valid_degree]
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
        Axis parameters, such as those where laws change, or of loads on sections.  Those that are not knots of the rod
        are added as double knots: functions have kinks there.
    angle
        As for `axis`.
    layer
        Lengths of the elements.
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
    there = np.interp(rod.axis.evenly(parts), shape.u, shape.lengths)
    ends = [] if rod.closed else [0.0, shape.lengths[-1]]
    middles = np.unique([*ends, *np.interp(places, shape.u, shape.lengths)])
    knots: list[float] = []
    for middle in middles:
        for side in (-1.0, 1.0):
            distances = side * (middles - middle)
            room = 0.5 * min(distances[distances > 0.0], default=0.0)
            even = side * (there - middle)
            element = min(even[even > 1e-9 * shape.lengths[-1]], default=0.0)
            distance, size = 0.0, layer.first * shape.radius
            while size < element:
                distance += size
                off = side * (np.append(there, knots) - middle)
                near = (off > distance - _BEFORE * size) & (off < distance + _AFTER * size)
                if not near.any() and distance + _AFTER * size < room:
                    knots.append(middle + side * distance)
                size *= layer.rise
    return tuple(np.sort(np.interp(knots, shape.lengths, shape.u)).tolist())


def halved(space: Any) -> dict[str, object]:
    """Return elements and knots, as keyword arguments of `Space`, that cut each element of a space in two or more."""
    breaks, elements = space.axis.breaks, 2 * cast(int, space.elements)
    even = space.rod.axis.refine(elements // space.rod.axis.elements, space.degree, space.continuity).breaks
    more = np.sort(np.concatenate([space.knots or (), 0.5 * (breaks[:-1] + breaks[1:])]))
    apart = np.abs(more[:, None] - even).min(axis=1) > 1e-9 * (breaks[-1] - breaks[0])
    # A double knot may be at an even one.
    kinks = np.array([np.count_nonzero(more == u) == 2 for u in more])
    return {"elements": elements, "knots": tuple(map(float, more[apart | kinks]))}


def turned(rod: Rod, angle: float, degree: int | None, continuity: int | None) -> dict[str, Any]:
    """Return elements and knots, as keyword arguments of `isorod.space.Space`, of a rod that supports rotate."""
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

    Its surface is C1, since closest points would jump at kinks, but its curvature may jump, as under a point force; and
    elements are shorter (`TOUCHING`).
    """
    chosen, degree, *_ = axis(rod, None, degree, None, (), angle)
    rod_elements = rod.axis.elements
    return {
        "elements": rod_elements * ceil(TOUCHING * chosen / rod_elements - 1e-9) if elements is None else elements,
        "degree": degree,
        "continuity": min(1, degree - 1) if continuity is None else continuity,
    }


def touching_points(rod: Rod, n: int, elements: int, degree: int, least: int, most: int) -> tuple[int, int]:
    """Return the points of a contact round an arc and along an element: as dense along as round (`AROUND`).

    The patch of two round bodies is about as long as wide, and must not fall between points.

    Parameters
    ----------
    rod
        A rod in contact.
    n, elements, degree
        Points round the section of its space, elements, and their degree.
    least, most
        Least points round an arc, and most of both.
    """
    shape = shape_of(rod)
    across = min(max(least, ceil(AROUND / n)), most)
    # Of a round section, on which points are 2 pi r / (n across) apart.
    along = ceil(shape.slenderness * n * across / (pi * elements))
    return across, min(max(along, degree + 1), most)


# A rod's functions are needed several times as its space is chosen.
@lru_cache(maxsize=8)
def section(rod: Rod, missed: float = WARPING) -> dict[str, int]:
    """Return the section functions as keyword arguments of `isorod.space.Space`: polynomials where these are accurate.

    ``missed`` is the relative error allowed for the torsion constant.
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
    """Return a rod of elliptical sections with rings that resolve its rim (`RIM`), any other unchanged.

    Rings represent no other section exactly.
    """
    waves = np.abs(np.fft.rfft(rod.grid(circle(_WAVES), rod.axis.breaks)[0], axis=1))
    round_ = waves[:, 2:].max() <= _SAME * waves[:, 1].max()
    return rod.with_rings(RIM) if round_ and rod.rings == WHOLE and "section_degree" in section(rod) else rod


def layer(rod: Rod, reach: float, pressed: bool) -> Layer:
    """Return the elements near ends for accurate stresses, as for `stressed`."""
    fine = pressed or shape_of(rod).thinness < ROUND
    slow = reach or (pressed and rod.rings[0])
    return Layer(_FINE if fine else LAYER.first, _SLOW if slow else LAYER.rise)


def is_short(rod: Rod, reach: float) -> bool:
    """Return whether end effects of a rod reach the other end along its fibres (`isorod.material.law.reach`)."""
    return reach > 2.0 * shape_of(rod).slenderness


def buckling(rod: Rod) -> dict[str, int]:
    """Return the section functions, as `section` does, for ovalisation of thin pipes in buckling."""
    functions = section(rod)
    return functions if rod.rings == WHOLE else {"section_degree": max(functions["section_degree"], RINGED_BUCKLED)}


def stressed(rod: Rod, reach: float, pressed: bool = False) -> dict[str, int]:
    """Return the section functions, as `section` does, for accurate stresses, not only energies.

    Parameters
    ----------
    reach
        Of the laws (`isorod.material.law.reach`), 0 without fibres.
    pressed
        Whether pressures act on the surface.
    """
    functions = section(rod)
    if rod.rings != WHOLE:
        # One more where end effects of fibres count everywhere: ellipses in torsion are 0.4 % off instead of 1.2.
        least = RINGED_STRESSED + is_short(rod, reach)
        return {"section_degree": max(functions["section_degree"], least)}
    if "section_degree" not in functions:
        return functions
    best = of_polynomials(rod, MAX_SECTION_DEGREE)[1]
    # Stresses of a curved bar are a power series in its radius over that of its axis.
    series = ceil(np.log(CURVED) / np.log(np.clip(shape_of(rod).bend, CURVED, 0.5)))
    # Effects of pressure are small beside those of held ends with stiff fibres.
    most, fibres = (MAX_SECTION_DEGREE, reach) if pressed else (MOST, 0.5 * reach)
    degree = max(functions["section_degree"], min(max(ceil(2.0 + fibres), series), most))
    # Shear warps a section by cubic functions of its thickness.
    while degree < MOST and polynomials(rod, degree).across < CUBIC:
        degree += 1
    missed = [_missed(rod, error, best) for error in range(degree, max(degree, MOST_TWISTED) + 1)]
    return {
        "section_degree": degree + next(k for k, error in enumerate(missed) if error <= max(TWISTED, 1.01 * missed[-1]))
    }


def _missed(rod: Rod, degree: int, best: Array) -> float:
    """Return the error of stresses in torsion, relative to the largest."""
    off = np.linalg.norm(of_polynomials(rod, degree)[1] - best, axis=1).max()
    return float(off / np.linalg.norm(best, axis=1).max())


def rule(space: Any) -> Rule:
    """Return the quadrature rule: ``auto``, but as many points as the degree along elements joined C0.

    This includes the short elements of boundary layers, although these are smoother.
    """
    axis, degree = space.axis, space.axis.degree
    auto, even = space.basis.auto(degree), ~np.isin(axis.breaks[1:-1], space.knots or ())
    sharp = degree > 1 and (axis.multiplicities[1:-1][even] >= degree).all()
    return Rule(auto.radial, auto.angular, degree) if sharp else auto


def kinked(space: Any) -> Rule:
    """Return the quadrature rule of a law whose stress has kinks in a section, as at the edge of a plastic zone.

    Kinks may be anywhere between the points.
    """
    regular, around = space.rule, ceil(KINKED_AROUND / space.points_around)
    return Rule(max(regular.radial, KINKED), max(regular.angular, around), regular.axial)
