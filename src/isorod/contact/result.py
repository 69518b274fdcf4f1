"""Results of a contact: forces, area, penetration, the pressure at each point, resolution of the patch."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.contact import cells, quality
from isorod.contact.defaults import smallest_radius
from isorod.contact.packed import Friction, Packed
from isorod.contact.placing_kernel import obstacle_loads
from isorod.contact.ranks import Ranks
from isorod.model.contact import MAX_POINTS, Contact
from isorod.model.model import Model
from isorod.space.graded import ORDER, Graded

# Largest distance of facets from a smooth surface, relative to the gap or the interference at rest.
_UNEVEN = 0.05


@dataclass(frozen=True, eq=False)
class ContactResult:
    """The result of one contact.

    Attributes
    ----------
    force
        Total normal force, the integral of the pressure.
    resultant
        Force on the bodies of ``first``, shape ``(3,)``; zero where these touch each other.
    area
        Reference area in contact (the mean of both surfaces, if there are two).
    peak
        Largest pressure, force per reference area.
    penetration
        Depth of the deepest point, length, not negative.
    relative_penetration
        The same, relative to the smallest radius of the elements that take part (mean distance of a section's outline
        from its centre).
    penalty
        Pressure per depth at the end.
    active
        Number of points under pressure.
    points_across, cells_across
        Mean width of the patch in its narrower direction, round the section or along the axis, in points and in
        distances of control points (for polynomials: of functions on the surface, `isorod.contact.quality`); 0 where
        nothing touches, or all points do.
    force_error
        Relative change of the force with other points at the same displacements, an upper bound of the error of these
        points; None where that is not available, as in motions.  It does not include the error of the surface.
    peak_error
        Relative error of the largest pressure, the largest of three: its excess over the largest mean of a cell
        (`isorod.contact.cells`), its change with other points, and the error measured for patches as many cells wide
        (`isorod.contact.quality`).  None if nothing touches.
    at_lines
        Whether bodies touch on lines at which their section functions were refined (`isorod.contact.patches`).
    body
        Body whose surface each point belongs to, shape ``(q,)``; points of both bodies are listed.
    parameters
        Axis parameter ``u`` and angle round the section of the points, shape ``(q, 2)``.
    positions
        Present positions of the points, shape ``(q, 3)``.
    pressure
        Pressure at the points, force per reference area, zero out of contact, shape ``(q,)``.
    areas
        Reference areas of the points; where both bodies have points, each half counted, shape ``(q,)``.
    normals, partners, projections
        Of the points under pressure the direction of the force on them, the body that they touch, -1 an obstacle, and
        the axis parameter and angle of their projection on it, shapes ``(q, 3)``, ``(q,)`` and ``(q, 2)``.
    cells
        Numbers of the cells of the points (`isorod.contact.cells`), shape ``(q,)``.
    on_facets
        Whether the points are on facets of a finite element body, whose number comes after those of rods; parameters
        are then numbers of facets.
    uneven
        Largest distance of flat facets under pressure from the curved surface that they represent, and of points on
        them from the rods at rest, units of length; 0 and infinite where that is not known.
    tractions, slips
        Friction at the points, force per reference area, and which of those under pressure slip, ``(q, 3)``, ``(q,)``.
    friction
        Resultant of friction on the first side, shape ``(3,)``; zero in self-contact.
    sticking, slipping
        Number of points in contact, with friction, that stick and that slip.
    wanders
        Whether at another time of a motion it presses elsewhere, with at least half the force.
    """

    force: float
    resultant: Array
    area: float
    peak: float
    penetration: float
    relative_penetration: float
    penalty: float
    active: int
    points_across: float
    cells_across: float
    force_error: float | None
    peak_error: float | None
    at_lines: bool
    has_points: bool
    body: Index
    parameters: Array
    positions: Array
    pressure: Array
    areas: Array
    normals: Array
    partners: Index
    projections: Array
    cells: Index
    on_facets: bool
    uneven: tuple[float, float]
    tractions: Array
    slips: NDArray[Any]
    friction: Array
    sticking: int
    slipping: int
    wanders: bool = False

    @property
    def feet(self) -> Array:
        """`projections`, as they were called before."""
        warnings.warn("feet: they are called projections", FutureWarning, stacklevel=2)
        return self.projections

    @property
    def peak_place(self) -> str:
        """Where the pressure is largest, in words."""
        k = int(np.argmax(self.pressure))
        if self.on_facets:
            return "facets at " + ", ".join(f"{x:.4g}" for x in self.positions[k])
        return f"body {self.body[k]} at u = {self.parameters[k, 0]:.4g}"

    @property
    def stretched(self) -> float:
        """Work of friction on the elastic displacement of sticking points."""
        sticks = (self.pressure > 0.0) & ~self.slips
        return float(self.areas[sticks] @ np.sum(self.tractions[sticks] ** 2, axis=1) / self.penalty)

    def record(self) -> dict[str, Any]:
        """Return the values for a record."""
        kept = (
            "force resultant area peak penetration relative_penetration penalty active points_across cells_across "
            "force_error peak_error"
        )
        return {name: getattr(self, name) for name in kept.split()}

    def doubt(self, moving: bool = False) -> str | None:
        """Return a warning in one line: the error, its place and a remedy; None where there is none.

        ``moving`` is for motions, where no multipliers correct the penetration of the penalty.
        """
        height, apart = self.uneven
        if height > _UNEVEN * apart:
            return (
                f"facets are flat, up to {height:.2g} from a smooth surface, where gap or interference at rest is "
                f"{apart:.2g} at most; use smaller facets, or a mesh of second order, which is curved"
            )
        if not self.points_across:
            return None
        where = self.peak_place
        # The compliance of rods at lines is in the estimated error.
        if self.cells_across < quality.CELLS and not self.at_lines:
            times = min(4.0, np.ceil(1.2 * quality.CELLS / self.cells_across))
            stiff = "compliant by the penalty: impacts may be too long" if moving else "locally too stiff"
            more = f"{times:.0f} times as many section points"
            if not self.has_points:
                more = "a higher section degree, of solid rods order and section points in its place"
            if self.on_facets:
                more = "smaller facets there, " + more
            return (
                f"contact patch under-resolved: {self.cells_across:.2g} control points wide on {where}, peak pressure "
                f"accurate to about {100.0 * (self.peak_error or 0.0):.0f} %, {stiff}; use {more}, or "
                f"elements {'as much ' if self.has_points else ''}shorter there, whichever spacing is larger"
            )
        if self.points_across < quality.POINTS:
            return (
                f"contact patch under-resolved: {self.active} active quadrature points on {where}, "
                f"{self.points_across:.2g} across; increase points (at most {MAX_POINTS} an arc and an element), or "
                "use shorter elements there"
            )
        if self.force_error is not None and self.force_error > quality.CHANGE:
            return (
                f"contact force changes by {100.0 * self.force_error:.0f} % with other quadrature points on {where}; "
                "increase points"
            )
        return None


def doubts(model: Model, results: Mapping[int, ContactResult], moving: bool = False) -> list[str]:
    """Return warnings on results of contacts, by their numbers, a line for each.

    ``moving`` is as for `ContactResult.doubt`.  There are none where the user sets both penalty and points.
    """
    messages = [
        (k, result.doubt(moving))
        for k, result in sorted(results.items())
        if model.contacts[k].penalty is None or model.contacts[k].points is None
    ]
    return [f"contact {k}: {doubt}" for k, doubt in messages if doubt is not None]


def of_contacts(model: Model, packed: Packed) -> Iterator[tuple[Contact, range, slice]]:
    """Yield each contact of a model with the numbers of its passes and the range of its slave points."""
    first, end = [*packed.passes["first_point"], packed.areas.size], 0
    for contact in model.contacts:
        begin, end = end, end + contact.passes
        yield contact, range(begin, end), slice(first[begin], first[end])


def loads_of(model: Model, packed: Packed, friction: Friction, ranks: Ranks) -> Array:
    """Return force and moment of the obstacle of each contact of a model, of the last forces, ``(c, 6)``.

    Moments are about its centre of rotation, or its point; zeros where there is no obstacle.
    """
    loads = np.zeros((packed.passes.size, 6))
    obstacle_loads(packed, friction, loads)
    totals = ranks.sums(loads)[0]
    sums = [totals[passes.start : passes.stop].sum(axis=0) for _, passes, _ in of_contacts(model, packed)]
    return np.reshape(sums, (len(sums), 6))


def measure(
    model: Model,
    packed: Packed,
    friction: Friction,
    others: Sequence[tuple[float, float] | None] = (),
    uneven: Sequence[tuple[float, float]] = (),
) -> list[ContactResult]:
    """Return the result of each contact of a model, of the last forces (`isorod.contact.packed`).

    Parameters
    ----------
    model, packed, friction
        Those of the forces.
    others
        Force and largest pressure of each contact with other points at the same displacement, if known.
    uneven
        `ContactResult.uneven` of each contact, if known.
    """
    results = []
    pressures = packed.states["pressure"]
    sides = packed.surfaces["body"][packed.passes["slave"]]
    bodies = np.repeat(sides, np.diff([*packed.passes["first_point"], packed.areas.size]))
    parameters, means, numbers = cells.parameters(packed), cells.means(packed, pressures), cells.numbers(packed)
    normals = np.where(pressures[:, None] > 0.0, packed.states["normal"], 0.0)
    partners, projections = _projections(packed, np.flatnonzero(pressures > 0.0))
    refined = others or [None] * len(model.contacts)
    flat = uneven or [(0.0, np.inf)] * len(model.contacts)
    for (contact, passes, chosen), finer, rough in zip(of_contacts(model, packed), refined, flat, strict=True):
        gap, pressure, areas = packed.states["gap"][chosen], pressures[chosen], packed.areas[chosen]
        touching = pressure > 0.0
        tractions, slips = np.zeros((areas.size, 3)), np.zeros(areas.size, dtype=bool)
        if contact.friction:
            tractions[:], slips[:] = friction.tractions[chosen], friction.slipping[chosen]
        # Forces on the first side, and the reactions to those on the second.
        sign = np.where(np.isin(bodies[chosen], contact.groups[0]), 1.0, -1.0)
        if contact.second is None:
            sign[:] = 0.0
        depth = float(max(0.0, -gap[touching].min(initial=0.0)))
        force, peak = float(areas @ pressure), float(pressure.max(initial=0.0))
        points, wide = quality.across(packed, passes)
        changes = [quality.PEAK / wide] if wide else []
        if peak:
            changes.append(1.0 - float(means[chosen].max()) / peak)
            changes.append(0.0 if finer is None else abs(finer[1] / peak - 1.0))
        results.append(
            ContactResult(
                force=force,
                resultant=(sign * areas * pressure) @ normals[chosen],
                area=float(areas[touching].sum()),
                peak=peak,
                penetration=depth,
                relative_penetration=depth / smallest_radius(model, contact),
                penalty=float(packed.passes["penalty"][passes.start]),
                active=int(np.count_nonzero(touching)),
                points_across=points,
                cells_across=wide,
                force_error=None if finer is None or not force else abs(finer[0] / force - 1.0),
                peak_error=min(1.0, max(changes)) if changes else None,
                at_lines=all(_sees_lines(model.bodies[body].space.basis) for body, _ in contact.sides),
                has_points=all(model.bodies[body].space.basis.on_surface for body, _ in contact.sides),
                body=bodies[chosen],
                parameters=parameters[chosen],
                positions=packed.points[chosen].copy(),
                pressure=pressure.copy(),
                areas=areas.copy(),
                normals=normals[chosen],
                partners=partners[chosen],
                projections=projections[chosen],
                cells=numbers[chosen],
                on_facets=contact.facets is not None,
                uneven=rough,
                tractions=tractions,
                slips=slips,
                friction=(sign * areas) @ tractions,
                sticking=int((touching & ~slips).sum()) if contact.friction else 0,
                slipping=int(slips.sum()),
            )
        )
    return results


def _sees_lines(basis: object) -> bool:
    return isinstance(basis, Graded) and basis.order < ORDER


def _projections(packed: Packed, active: Index) -> tuple[Index, Array]:
    """Return of all points the body that they touch, -1 an obstacle or none, and parameter and angle of projections."""
    partners, projections = np.full(packed.areas.size, -1), np.zeros((packed.areas.size, 2))
    touching = active[packed.passes["master"][packed.passes_of(active)] >= 0]
    starts = packed.starts[touching]
    elements = packed.elements[starts["element"]]
    low, high = elements["u"].T
    surfaces = packed.surfaces[elements["surface"]]
    partners[touching], angles = surfaces["body"], cells.sense(surfaces) * starts["theta"]
    projections[touching] = np.stack([0.5 * (low + high + starts["s"] * (high - low)), angles], axis=1)
    return partners, projections
