"""A model on a finer, nested space: of a higher degree across the section, or along the axis.

In sections with half-turn symmetry even and odd functions are independent: warping in torsion is even, that of shear by
bending odd, and one degree more adds functions of one parity alone.  The degree is then raised by two; from degree 1 it
is always raised to 4, the first with which a square warps.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, pi
from typing import Any

import numpy as np

from isorod.arrays import Array, Index
from isorod.geometry.axis import MAX_DEGREE
from isorod.geometry.disk import MAX_COUNT
from isorod.geometry.quadrature import MAX_POINTS, WHOLE, Rule, axis_points
from isorod.geometry.rod import Rod
from isorod.model.body import Body
from isorod.model.load import Weight
from isorod.model.mean import MeanSupport
from isorod.model.model import Model
from isorod.model.past import Past
from isorod.model.support import Support
from isorod.space import choice
from isorod.space.graded import ORDER, Graded
from isorod.space.polyharmonic import MAX_ORDER
from isorod.space.polynomial import MAX_DEGREE as MAX_SECTION_DEGREE
from isorod.space.pressure import Pressures
from isorod.space.space import Space

# Directions of refinement.
DIRECTIONS = ("section", "axis")

# Convergence order of the error at the edge of a clamped face, in the degree or the number of points or elements, from
# which the error left on a finer space follows; for smooth solutions less is left.  Measured over random rods, most of
# them on coarse spaces.
_POWER = 4

# Fraction of the error left at lines of contact when knot spans round the section there are halved.
_AT_LINES = 0.25

# Degree of the warping of a square in torsion.
_SQUARE = 4

# Degree of polynomials in rings, used beyond the largest degree without rings.
_RINGED = 6

# Matrix entries of all elements of a body beyond which its control points are not doubled: a gigabyte.
_MOST = 2**27

# Tolerance on section functions that another basis contains.
_EXACT = 1e-6
# Relative tolerance on the symmetry of sections.
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Finer:
    """A model on finer spaces.

    Attributes
    ----------
    coarse, model
        The model, and its copy on the finer spaces.
    across
        For each body its section functions in terms of those of the finer space, shape ``(finer count, count)``.
    left
        Largest fraction of the error left on a finer space.
    """

    coarse: Model
    model: Model
    across: Sequence[Array]
    left: float

    @classmethod
    def of(cls, model: Model, direction: str) -> "Finer | None":
        """Return the model on spaces finer in one of `DIRECTIONS`, without contacts.

        None if a support does not fit, or with contact beside solids, whose meshes are not refined.
        """
        if model.solids and model.contacts:
            return None
        spaces = [_finer(body, direction) for body in model.bodies]
        across = [_across(body.space, fine) for body, fine in zip(model.bodies, spaces, strict=True)]
        supports: list[Support | MeanSupport] = []
        for support in model.supports:
            if isinstance(support, MeanSupport):
                supports.append(replace(support, space=None))
                continue
            moved = _support(support, model.bodies[support.body].space, spaces[support.body], across[support.body])
            if moved is None:
                return None
            supports.append(moved)
        with warnings.catch_warnings():
            # The model itself has warned already.
            warnings.simplefilter("ignore")
            bodies = [_body(body, fine) for body, fine in zip(model.bodies, spaces, strict=True)]
            loads = [_load(load, bodies) for load in model.loads]
            left = max(map(_left, (body.space for body in model.bodies), spaces))
            made = Model(
                bodies, supports, model.spin, loads=loads, ties=model.ties, solids=model.solids, times=model.times
            )
        result = cls(model, made, across, left)
        if not model.remembers:
            return result
        past = [Past(factor, result.displacement(moved)) for factor, moved in model.past]
        return replace(result, model=made.after(past, any(body.settled for body in model.bodies)))

    @property
    def wider(self) -> bool:
        """Whether a body has more section functions."""
        return any(one.shape[0] > one.shape[1] for one in self.across)

    def displacement(self, displacement: Array) -> Array:
        """Return a vector of all degrees of freedom on the finer spaces."""
        parts = []
        for b, (body, fine) in enumerate(zip(self.coarse.bodies, self.model.bodies, strict=True)):
            space = body.space
            nodal = self.coarse.nodal(displacement, b).reshape(space.layers, space.layer_nodes, 3)
            if fine.space.layers != space.layers:
                layers = np.concatenate([nodal, nodal[: space.rod.closed]])
                nodal = space.axis.transfer(fine.space.axis, layers)[: fine.space.layers]
            parts.append((self.across[b] @ nodal).ravel())
        return np.concatenate(parts)

    def pressures(self, coefficients: Sequence[Array | None]) -> list[Array | None]:
        """Return pressure coefficients on the finer spaces."""
        refined: list[Array | None] = []
        for b, values in enumerate(coefficients):
            coarse, fine = self.coarse.bodies[b].pressures, self.model.bodies[b].pressures
            if values is None or coarse is None or fine is None:
                refined.append(None)
                continue
            xi = _points(fine.space)
            across = _inclusion(coarse.section_functions(xi), fine.section_functions(xi))
            u = axis_points(fine.space.axis, fine.degree + 1)[0].ravel()
            along = _inclusion(*(_table(one, u) for one in (coarse, fine)))
            refined.append((along @ values @ across.T)[: fine.layers])
        return refined


def _finer(body: Body, direction: str) -> Space:
    space, across = body.space, _across_as_is(body.space)
    along: dict[str, Any] = {"elements": space.elements, "degree": space.axis.degree, "knots": space.knots}
    if direction == "section":
        across |= _more_across(body)
    else:
        along |= more_along(space)
    rod = space.rod
    if direction == "section" and across == _across_as_is(space) == {"section_degree": MAX_SECTION_DEGREE}:
        # At the highest degree, rings resolve the rim instead, with another degree.
        rod = choice.with_rim(rod)
        across = {"section_degree": _RINGED if rod is not space.rod else MAX_SECTION_DEGREE}
    made = Space(rod, continuity=space.continuity, quadrature="auto", **along, **across)
    rule, chosen = space.rule, choice.rule(made)
    radial, angular, axial = map(max, zip(vars(rule).values(), vars(chosen).values(), strict=True))
    if body.remembers and direction == "section":
        radial = min(2 * radial, MAX_POINTS)
    return made.integrated(Rule(radial, angular, axial))


def more_along(space: Space) -> dict[str, Any]:
    """Return the change of a space that refines it along the axis: a degree more, or twice the elements."""
    return {"degree": space.axis.degree + 1} if space.axis.degree < MAX_DEGREE else choice.halved(space)


def _across_as_is(space: Space) -> dict[str, Any]:
    """Return a space's settings of its section functions."""
    names = ("order", "section_points", "section_degree", "section_basis")
    return {name: getattr(space, name) for name in names if getattr(space, name) is not None}


def _more_across(body: Body) -> dict[str, Any]:
    """Return settings of more section functions than a body has."""
    space = body.space
    if space.section_degree is not None:
        degree = space.section_degree
        symmetric = space.rod.rings == WHOLE and _turns_onto_itself(space.rod)
        target = degree + 1 + symmetric if degree > 1 else _SQUARE
        return {"section_degree": min(target, getattr(space.basis, "most", degree))}
    if isinstance(space.section_basis, Graded):
        # `isorod.contact.quality` checks the resolution of small patches; at lines of contact knot spans are halved.
        basis = space.section_basis if space.section_basis.order >= ORDER else space.section_basis.finer()
        return {"section_basis": replace(basis, order=basis.order + 1)}
    if space.order is None:
        return {}
    # From biharmonic functions on, the error is in the angular direction.
    entries = space.axis.elements * (6 * space.element_nodes.shape[1]) ** 2
    if space.order > 1 and 2 * space.points_around <= MAX_COUNT and entries <= _MOST:
        return {"section_points": 2 * space.points_around}
    return {"order": space.order + 1 if space.order < MAX_ORDER else space.order}


def _left(space: Space, fine: Space) -> float:
    """Return the fraction of the error left on the finer space."""
    numbers = [(space.axis.elements, fine.axis.elements), (space.axis.degree, fine.axis.degree)]
    if space.section_degree is not None and fine.section_degree is not None:
        numbers.append((space.section_degree, fine.section_degree))
    elif space.section_basis is None:
        numbers.append((space.points_around * (space.order or 1), fine.points_around * (fine.order or 1)))
    ratio = min(coarse / more for coarse, more in numbers)
    if isinstance(fine.section_basis, Graded) and fine.points_around > space.points_around:
        return _AT_LINES
    return float(ratio**_POWER) if ratio < 1.0 else 0.0


def _turns_onto_itself(rod: Rod) -> bool:
    """Return whether the sections have half-turn symmetry about their centres."""
    polygons = rod.control_points - rod.control_points.mean(axis=1, keepdims=True)
    turned = np.roll(polygons, rod.section_points // 2, axis=1)
    return rod.section_points % 2 == 0 and bool(np.abs(polygons + turned).max() < _SAME * np.abs(polygons).max())


def _points(space: Space) -> Array:
    """Return points of the disk that determine functions of the highest degree."""
    waves = 2 + ceil(pi * MAX_SECTION_DEGREE / space.points_around)
    return space.section_rule(Rule(MAX_SECTION_DEGREE + 2, 2 * waves, 1))[0]


def _inclusion(own: Array, fine: Array) -> Array:
    return np.linalg.lstsq(fine, own, rcond=1e-12)[0]


def _table(pressures: Pressures, u: Array) -> Array:
    """Return the axial functions, which may jump at knots, at parameters ``(t,)``, shape ``(t, layers)``."""
    first, values = pressures.axial_functions(u)
    table = np.zeros((u.size, pressures.layers))
    np.put_along_axis(table, first[:, None] + np.arange(values.shape[1]), values, axis=1)
    return table


def _across(space: Space, fine: Space) -> Array:
    if _across_as_is(fine) == _across_as_is(space):
        return np.eye(space.basis.count)
    xi = _points(fine)
    return _inclusion(space.basis.functions(xi)[0], fine.basis.functions(xi)[0])


def _body(body: Body, space: Space) -> Body:
    rings, breaks = len(body.space.rod.rings) - 1, space.axis.breaks
    more = (len(space.rod.rings) - 1) // rings
    inside = np.searchsorted(body.space.axis.breaks, 0.5 * (breaks[:-1] + breaks[1:])) - 1

    def on_elements(given: Any) -> Any:
        finer = [[*given[e * rings : (e + 1) * rings]] * more for e in inside]
        return finer if rings * more > 1 else [row[0] for row in finer]

    return Body(space, on_elements(body.laws), on_elements(body.densities), body.formulation)


def _load(load: Any, bodies: Sequence[Body]) -> Any:
    """Return a load on finer bodies."""
    if isinstance(load, Weight):
        return replace(load, of=bodies[load.body])
    return replace(load, space=None) if hasattr(load, "space") else load


def _support(support: Support, space: Space, fine: Space, across: Array) -> Support | None:
    """Return a support on the finer space, of an end face or of the same functions on it; None if it does not fit."""
    layer, function = np.divmod(np.asarray(support.nodes, dtype=np.int64), space.layer_nodes)
    last = space.layers - 1
    if space.rod.closed or not layer.size or not np.isin(layer, (0, last)).all():
        return None
    functions = range(across.shape[0])
    nodes: list[int] = []
    rows: list[Array] = []
    for end in np.unique(layer):
        here = np.flatnonzero(layer == end)
        onto = np.zeros((across.shape[0], function.size))
        onto[:, here] = across[:, function[here]]
        if np.unique(function[here]).size == space.layer_nodes:
            chosen: Index = np.arange(across.shape[0])
        else:
            # Functions that the finer space has too.
            chosen = np.array([int(np.argmax(np.abs(column))) for column in onto[:, here].T])
            if np.abs(onto[chosen, here] - 1.0).max() > _EXACT or np.abs(onto).sum(axis=0)[here].max() > 1.0 + _EXACT:
                return None
        first = 0 if end == 0 else fine.layers - 1
        nodes += [first * len(functions) + int(i) for i in chosen]
        rows += list(onto[chosen])
    onto = np.array(rows)

    def moved(displacement: Any) -> Array:
        return onto @ np.broadcast_to(np.asarray(displacement, dtype=float), (function.size, 3))

    arms = None if support.arms is None else moved(support.arms)
    displacement = moved(support.displacement)
    result = Support(np.array(nodes), support.components, displacement, support.body, support.turn, arms, support.tied)
    return replace(result, history=support.history)
