"""A rod over a fixed cylinder, solved, beside elastica and rope: ``python -m comparisons.contact.over_cylinder``.

One JSON line a run, then one a limit of a thin rod: values at several ratios of the rod's radius to that of its bent
centre line are extrapolated and set beside `comparisons.contact.capstan`.
"""

import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import fsolve

from comparisons.contact.capstan import Capstan
from isorod import options, statics
from isorod.arrays import Array
from isorod.geometry import section
from isorod.geometry.center_line import polyline
from isorod.material import NeoHookean
from isorod.model import Body, Contact, Cylinder, Model, SectionLoad, Support
from isorod.output import results
from isorod.space import Space

# Radius of the bent centre line over that of the rod.
RATIOS = 10.0, 14.0, 20.0

# Pulls F Rb^2 / B on either side of a wrap of 180 degrees; the rod touches at a point up to one half.
PULLS = 0.75, 1.0

# Of the rod; its radius is 1.
E, NU, POINTS, DEGREE = 1000.0, 0.3, 8, 3
BENDING = 0.25 * np.pi * E


class Bent(NamedTuple):
    """How a bent rod lies, of one half: an arc under an even line force, and a point force at its end."""

    half_angle: float  # [rad]
    line_force: float  # times the radius of the centre line, over the pull
    end_force: float  # over the pull
    top_tension: float  # of the section in the middle, over the pull


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
        first_elements=np.flatnonzero(places[1:] < quarter + 2.5),
    )
    load = SectionLoad.end(space, "end", (0.0, -force, 0.0))
    model = Model([Body(space, NeoHookean(E, NU))], supports, loads=[load], contacts=[contact])
    solution = statics.solve(model, load_steps=8)
    (found,) = solution.contacts
    angles = np.arctan2(found.positions[:, 0], found.positions[:, 1] + ratio)
    pressed = found.areas * found.pressure / force
    return Bent(*arc_of(angles, pressed), -float(solution.reactions[0, 0]) / force)


def arc_of(angles: Array, forces: Array) -> tuple[float, float, float]:
    """Return half angle, line force times radius, and end force of the arc that presses as forces at angles do.

    They have the same sum and the same resultant, both components: wherever else a continuum has its pressure, which
    spreads the point force over about a radius, is not seen.
    """
    total, down, out = forces.sum(), forces @ np.cos(angles), forces @ np.sin(angles)

    def excess(unknown: Array) -> list[float]:
        half, line, end = unknown
        return [
            line * half + end - total,
            line * np.sin(half) + end * np.cos(half) - down,
            line * (1.0 - np.cos(half)) + end * np.sin(half) - out,
        ]

    half, line, end = fsolve(excess, (0.5, 0.5, 0.8))
    return float(half), float(line), float(end)


def limit(ratios: Sequence[float], values: Sequence[float]) -> float:
    """Return the value of a thin rod: of ``value + c / ratio^2`` that fits best.

    What a point force spreads over is as long before as behind it, so that no first order is left.
    """
    return float(np.polyfit(1.0 / np.asarray(ratios) ** 2, values, 1)[-1])


def threshold(pulls: Sequence[float], tops: Sequence[float]) -> float:
    """Return the pull up to which the rod touches at a point: where the tension in its middle, over the pulls, begins.

    The straight line through two; an elastica has ``T = F - B / (2 Rb^2)``.
    """
    (a, b), (s, t) = pulls, np.multiply(pulls, tops)
    return float(a - s * (b - a) / (t - s))


def main() -> int:
    """Solve all and print each as a JSON line, then limits."""
    options.initialize([])
    # Peak pressures, which the contact warns of, are not looked at.
    warnings.filterwarnings("ignore", message="contact 0: the patch")
    found: dict[tuple[float, float], Bent] = {}
    for ratio in RATIOS:
        for pull in PULLS:
            found[ratio, pull] = one = bent(ratio, pull)
            print(results.line({"run": "bent", "ratio": ratio, "pull": pull} | one._asdict()), flush=True)
    for name, value, expected in limits(found):
        line = {"limit": name, "value": value, "expected": expected, "error": value / expected - 1.0}
        print(results.line(line), flush=True)
    return 0


def limits(found: Mapping[tuple[float, float], Bent]) -> Iterator[tuple[str, float, float]]:
    """Yield what is extrapolated, its value for a thin rod, and that of an elastica."""
    for pull in PULLS:
        touch = Capstan(1.0, 1.0, np.pi, pull).touch()
        expected = Bent(touch.half_angle, touch.line_force / pull, touch.end_force / pull, np.sin(touch.half_angle))
        for name in Bent._fields:
            values = [getattr(found[ratio, pull], name) for ratio in RATIOS]
            yield f"{name} at {pull:g}", limit(RATIOS, values), float(getattr(expected, name))
    thresholds = [threshold(PULLS, [found[ratio, pull].top_tension for pull in PULLS]) for ratio in RATIOS]
    yield "threshold", limit(RATIOS, thresholds), Capstan(1.0, 1.0, np.pi, 1.0).threshold


if __name__ == "__main__":
    sys.exit(main())
