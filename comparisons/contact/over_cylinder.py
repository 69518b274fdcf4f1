"""A rod over a fixed cylinder, solved, beside elastica and rope: ``python -m comparisons.contact.over_cylinder``.

One JSON line a run, then one a limit of a thin rod: values at several ratios of the rod's radius to that of its bent
centre line are extrapolated and set beside `comparisons.contact.capstan`.
"""

import sys
import warnings
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from comparisons.contact.capstan import Capstan, friction_ratio, heavy_rope_bound
from isorod import dynamics, options, statics
from isorod.arrays import Array
from isorod.geometry import section
from isorod.geometry.center_line import polyline
from isorod.material import NeoHookean
from isorod.model import Body, BodyForce, Contact, Cylinder, Model, SectionLoad, Support
from isorod.output import results
from isorod.space import Space

# Radius of the bent centre line over that of the rod: of rods without friction, and of ropes.
RATIOS = 10.0, 14.0, 20.0
ROPE_RATIOS = 10.0, 20.0, 40.0

# Pull F Rb^2 / B on either side of a wrap of 180 degrees; the rod touches at a point up to one half.
PULL = 1.0

# Friction and wrap of the rope that is hauled from one end.
FRICTION, WRAP = 0.3, 0.5 * np.pi

# The heavy rope: its friction, what hangs on the light side over the cylinder's radius, and the strain by the weight of
# the longest part that this holds on the other side.
HEAVY_FRICTION, LIGHT, STRAIN, HEAVY_RATIO = 0.2, 1.0, 0.05, 10.0
FRACTIONS = 0.8, 1.2
# What the longer part's end is moved down by to make it slide, over the radius of the centre line.
HAUL = 0.25

# Points of contact under ropes, round an arc and along an element: those that are chosen change the tensions by 1e-4.
ROPE_POINTS = 6, 4

# What rods that are bent at rest lie in the cylinder by, so that there is contact from the first.
OVERLAP = 5e-3

# Of the rod; its radius is 1.
E, NU, POINTS, DEGREE = 1000.0, 0.3, 8, 3
BENDING = 0.25 * np.pi * E


class Bent(NamedTuple):
    """How a bent rod lies, of one half: an arc under an even line force, and a point force at its end."""

    half_angle: float  # [rad]
    line_force: float  # times the radius of the centre line, over the pull
    end_force: float  # over the pull
    top_tension: float  # that the section in the middle is held with, over the pull


class Hauled(NamedTuple):
    """A rope that slips."""

    tensions: float  # of the hauled end, over that of the held one
    sticking: int  # points that do not slip


def graded(length: float, fine: float, size: float) -> Array:
    """Return ends of elements: even ones up to a length, then longer and longer ones to another, of up to 4 radii."""
    even = np.linspace(0.0, fine, int(np.ceil(fine / size)) + 1)
    step, rest = even[1], [0.0]
    while rest[-1] < length - fine:
        step = min(1.4 * step, 4.0)
        rest.append(rest[-1] + step)
    return np.append(even, fine + np.array(rest[1:]) * (length - fine) / rest[-1])


def along(centers: Array) -> Space:
    """Return the space of a rod of radius 1 along points in the plane of x and y, an element between any two."""
    rod = polyline(centers, 0.0, normal=(0.0, 0.0, 1.0)).sweep(section.circle(POINTS, 1.0))
    return Space(rod, elements=rod.axis.elements, degree=DEGREE, order=2)


def bent(ratio: float, pull: float, size: float = 1.0) -> Bent:
    """Return how half a rod that is straight at rest lies when pulled by a dead force over half a wrap of 180 degrees.

    The other half is its mirror image.  The end face, four times ``sqrt(B / F)`` behind the quarter of a turn, is
    turned until it is normal to the pull, which changes what happens at the cylinder by ``exp(-8)``.

    Parameters
    ----------
    ratio
        Radius of the centre line on the cylinder, over that of the rod.
    pull
        Force over ``B / Rb^2``.
    size
        Length of the elements that may touch, over the rod's radius.
    """
    quarter = 0.5 * np.pi * ratio
    places = graded(quarter + 4.0 * ratio / np.sqrt(pull), quarter + 2.0, size)
    space = along(places[:, None] * [1.0, 0.0, 0.0])
    force = pull * BENDING / ratio**2
    supports = [
        Support.end(space, "start", "x"),
        Support.end(space, "end", "z", turn=(0.0, 0.0, -0.5 * np.pi), tied="xy"),
    ]
    contact = Contact(
        0,
        Cylinder((0.0, -ratio, 0.0), (0.0, 0.0, 1.0), ratio - 1.0),
        first_elements=range(np.count_nonzero(places[1:] < quarter + 2.5)),
    )
    load = SectionLoad.end(space, "end", (0.0, -force, 0.0))
    model = Model([Body(space, NeoHookean(E, NU))], supports, loads=[load], contacts=[contact])
    solution = statics.solve(model, load_steps=8)
    (result,) = solution.contacts
    angles = np.arctan2(result.positions[:, 0], result.positions[:, 1] + ratio)
    pressed = result.areas * result.pressure / force
    return Bent(*arc_of(angles, pressed), -float(solution.reactions[0, 0]) / force)


def arc_of(angles: Array, forces: Array) -> tuple[float, float, float]:
    """Return half angle, line force times radius, and end force of the arc that presses as forces at angles do.

    What they push sideways is the tension ``T`` in the rod's middle, which presses an arc by ``T / Rb``.  The rest of
    their sum is the end force, where the resultant has it: how a continuum spreads it, over about a radius, is not
    seen.
    """
    total, down, line = forces.sum(), forces @ np.cos(angles), forces @ np.sin(angles)

    def excess(half: float) -> float:
        return float(line * np.sin(half) + (total - line * half) * np.cos(half) - down)

    half = brentq(excess, 1e-3, min(0.5 * np.pi, 0.999 * total / line))
    return float(half), float(line), float(total - line * half)


def even_limit(ratios: Sequence[float], values: Sequence[float]) -> float:
    """Return the value of a thin rod without friction: of ``value + c / ratio^2`` that fits best.

    What a point force spreads over is as long before as behind it, so that nothing of first order is left.
    """
    return float(np.polyfit(1.0 / np.asarray(ratios) ** 2, values, 1)[-1])


def limit(ratios: Sequence[float], values: Sequence[float]) -> float:
    """Return the value of a thin rope: of the polynomial in ``1 / ratio`` through all values."""
    return float(np.polyfit(1.0 / np.asarray(ratios), values, len(ratios) - 1)[-1])


def laid(ratio: float, wrap: float, start: float, end: float, size: float = 1.0) -> tuple[Space, list[int]]:
    """Return the space of a rope that at rest lies on the cylinder, and which of its elements may touch that.

    It is curved over the wrap, where it has no bending moment therefore, and straight before and behind.

    Parameters
    ----------
    ratio, size
        As in `bent`.
    wrap
        Angle of the arc [rad], half of it on either side of the top; the cylinder's axis is that of z.
    start, end
        Lengths of the straight parts, over the rod's radius.
    """
    half = 0.5 * wrap * ratio
    before, behind = (graded(half + more, half + 1.0, size) for more in (start, end))
    length = np.append(-before[:0:-1], behind)
    angle = np.clip(length / ratio, -0.5 * wrap, 0.5 * wrap)
    rest = length - ratio * angle
    x, y = ratio * np.sin(angle) + rest * np.cos(angle), ratio * np.cos(angle) - rest * np.sin(angle)
    space = along(np.column_stack([x, y, 0.0 * x]))
    breaks = space.axis.breaks
    middles = space.rod.grid(np.zeros((1, 2)), 0.5 * (breaks[1:] + breaks[:-1]))[0][:, 0]
    near = np.abs(np.arctan2(middles[:, 0], middles[:, 1])) * ratio < half + 1.2
    return space, [int(e) for e in np.flatnonzero(near)]


def hauled(ratio: float, size: float = 1.0) -> Hauled:
    """Return the pulls at the ends of a rope without weight, one held, the other hauled until all slips.

    The ends are four times ``sqrt(B / F)`` off the cylinder.  With ``F`` of about ``ratio`` times ``B / Rb^2`` bending
    matters the less the thinner the rope, and so does strain.
    """
    free = 4.0 * np.sqrt(ratio)
    space, near = laid(ratio, WRAP, free, free, size)
    pull = np.array([np.cos(0.5 * WRAP), -np.sin(0.5 * WRAP), 0.0])
    grown = friction_ratio(FRICTION, WRAP)
    # Strain F / (E A) of the end that is hauled, and four fifths of that all along.
    travel = 0.8 * grown * 0.25 / ratio * (2.0 * free + WRAP * ratio) * pull
    supports = [Support.end(space, "start"), Support.end(space, "end", displacement=(travel[0], travel[1], 0.0))]
    contact = Contact(0, around(ratio), first_elements=near, points=ROPE_POINTS, friction=FRICTION)
    model = Model([Body(space, NeoHookean(E, NU))], supports, contacts=[contact])
    solution = statics.solve(model, load_steps=2)
    held, moved = solution.reactions
    return Hauled(float((moved @ pull) / (held @ (pull * [-1.0, 1.0, 1.0]))), solution.contacts[0].sticking)


def hung(ratio: float, fraction: float, haul: float | None = None, size: float = 1.0) -> Model:
    """Return a heavy rope that hangs over the cylinder, one part of it longer than the other.

    Parameters
    ----------
    ratio, size
        As in `bent`.
    fraction
        Of the longest part that friction holds (`comparisons.contact.capstan.heavy_rope_bound`).
    haul
        What the longer part's end is moved down by, over the radius of the centre line; free where it is not given.
    """
    bound = heavy_rope_bound(LIGHT * ratio, ratio, HEAVY_FRICTION)
    space, near = laid(ratio, np.pi, LIGHT * ratio, fraction * bound, size)
    last = Support.end(space, "end", "z")
    if haul is not None:
        last = Support.end(space, "end", displacement=(0.0, -haul * ratio, 0.0))
    contact = Contact(0, around(ratio), first_elements=near, points=ROPE_POINTS, friction=HEAVY_FRICTION)
    return Model(
        [Body(space, NeoHookean(E, NU), density=1.0)],
        [Support.end(space, "start", "z"), last],
        loads=[BodyForce((0.0, -STRAIN * E / bound, 0.0))],
        contacts=[contact],
    )


def heavy(ratio: float, fraction: float, haul: float | None = None, size: float = 1.0) -> statics.Equilibrium:
    """Return how that rope lies.

    Raises
    ------
    SolveError
        If both ends are free and the rope slides.
    """
    return statics.solve(hung(ratio, fraction, haul, size), load_steps=2)


def released(ratio: float, fraction: float, size: float = 1.0, lasting: float = 3.0) -> float:
    """Return how fast a heavy rope slides in the end, its longer part's end moved down by a quarter and let go.

    In implicit steps, with a damping proportional to mass that bounds the speed.  Speed is that of the longer end in
    the last third of what lasts so many times ``sqrt(Rb / g)``, over ``sqrt(g Rb)``; where it sticks, what is left of
    its swinging.
    """
    start, model = heavy(ratio, fraction, HAUL, size), hung(ratio, fraction, None, size)
    time = float(np.sqrt(ratio * heavy_rope_bound(LIGHT * ratio, ratio, HEAVY_FRICTION) / (STRAIN * E)))
    motion = dynamics.solve(
        model,
        lasting * time,
        time / 25.0,
        3,
        1.0 / time,
        displacement=start.displacement,
        integrator="implicit",
    )
    space = model.bodies[0].space
    last = np.arange(-space.layer_nodes, 0)[space.is_control_point[-space.layer_nodes :]]
    heights = motion.displacement.reshape(len(motion.times), -1, 3)[:, last, 1].mean(axis=1)
    return float((heights[-2] - heights[-1]) / ratio / (lasting / 3.0))


def reserve(ratio: float, fraction: float) -> float:
    """Return the force that makes a heavy rope slide to its longer side, over the weight of the longest part held.

    A rope that slides by itself has to be held back: by less than nothing.
    """
    return -float(heavy(ratio, fraction, HAUL).reactions[1, 1]) / (STRAIN * E * np.pi)


def around(ratio: float) -> Cylinder:
    """Return the cylinder under a rope that lies on it at rest."""
    return Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), ratio - 1.0 + OVERLAP)


def main() -> int:
    """Solve all and print each as a JSON line, then limits."""
    options.initialize([])
    # Peak pressures, which the contact warns of, are not looked at.
    warnings.filterwarnings("ignore", message="contact 0: ")
    rods, ropes = [], []
    for ratio in RATIOS:
        rods.append(bent(ratio, PULL))
        print(results.line({"run": "bent", "ratio": ratio, "pull": PULL} | rods[-1]._asdict()), flush=True)
    for ratio in ROPE_RATIOS:
        ropes.append(hauled(ratio))
        print(results.line({"run": "hauled", "ratio": ratio} | ropes[-1]._asdict()), flush=True)
    for fraction in FRACTIONS:
        record = {"run": "heavy", "ratio": HEAVY_RATIO, "share": fraction, "reserve": reserve(HEAVY_RATIO, fraction)}
        print(results.line(record | {"rope": 1.0 - fraction, "speed": released(HEAVY_RATIO, fraction)}), flush=True)
    for name, value, expected in limits(rods, ropes):
        line = {"limit": name, "value": value, "expected": expected, "error": value / expected - 1.0}
        print(results.line(line), flush=True)
    return 0


def limits(rods: Sequence[Bent], ropes: Sequence[Hauled]) -> Iterator[tuple[str, float, float]]:
    """Yield the extrapolated quantities, their values for a thin rod, and those of an elastica or a rope."""
    thin = Capstan(1.0, 1.0, np.pi, PULL)
    touch = thin.touch()
    expected = Bent(touch.half_angle, touch.line_force / PULL, touch.end_force / PULL, np.sin(touch.half_angle))
    for name in Bent._fields:
        yield name, even_limit(RATIOS, [getattr(rod, name) for rod in rods]), float(getattr(expected, name))
    # An elastica on an arc has the tension F - B / (2 Rb^2) in its middle.
    yield "threshold", even_limit(RATIOS, [PULL * (1.0 - rod.top_tension) for rod in rods]), thin.threshold
    yield (
        "tensions of the hauled rope",
        limit(ROPE_RATIOS, [rope.tensions for rope in ropes]),
        friction_ratio(FRICTION, WRAP),
    )


if __name__ == "__main__":
    sys.exit(main())
