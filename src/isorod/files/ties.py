"""Ties of a scene file: surfaces by their names, as ``"spring.end"``."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.geometry.rod import Rod
from isorod.model.tie import EndFace, LateralSurface, SolidSurface, Surface, Tie
from isorod.space.shape import shape_of

# Parts of an element in which the place nearest to a tied end is looked for.
_LOOKS = 16

# Ends that are nearer to each other along the rod, in its radii, meet it in one place.
_ONE_PLACE = 0.2

# The tolerance, as a fraction of such a part.
_EXACT = 1e-9


class Facets(NamedTuple):
    """The facets of a group of a solid, by its number, or all of its surface."""

    solid: int
    group: str | None


def surfaces(rods: Mapping[str, int], solids: Mapping[str, Sequence[str]]) -> dict[str, Surface | Facets]:
    """Return the surfaces that a file may name, of rods by their numbers, of solids with their groups.

    ``ROD.start`` and ``ROD.end`` are the end faces, ``ROD.outer`` the lateral surface, ``ROD.inner`` that of the hole;
    ``SOLID.GROUP`` are the facets of a group, ``SOLID`` the whole surface.
    """
    by_name: dict[str, Surface | Facets] = {}
    for name, number in rods.items():
        by_name |= {f"{name}.{which}": EndFace(number, which) for which in ("start", "end")}
        by_name |= {f"{name}.{which}": LateralSurface(number, surface=which) for which in ("outer", "inner")}
    for k, (name, groups) in enumerate(solids.items()):
        by_name |= {name: Facets(k, None)} | {f"{name}.{group}": Facets(k, group) for group in groups}
    return by_name


def built(surface: Surface | Facets, facets: Sequence[Mapping[str, Index]]) -> Surface:
    """Return a surface, that of a solid with the numbers of its facets, which are those of each solid's groups."""
    if not isinstance(surface, Facets):
        return surface
    return SolidSurface(surface.solid, None if surface.group is None else facets[surface.solid][surface.group])


def landed(rod: int, ties: Sequence[tuple[Any, Any]], rods: Sequence[Callable[[], Rod]]) -> list[float]:
    """Return the axis parameters of a rod, by its number, that are nearest to end faces tied to its lateral surface.

    Those of ends that meet it in one place, as from two sides, are one; the rod's own ends are none.  ``ties`` are
    slaves and masters; ``rods`` make those of the file.
    """
    projections = []
    for pair in (*ties, *((master, slave) for slave, master in ties)):
        end, flank = pair
        if not (isinstance(end, EndFace) and isinstance(flank, LateralSurface) and flank.body == rod):
            continue
        other, own = rods[end.body](), rods[rod]()
        place = other.grid(np.zeros((1, 2)), other.axis.breaks[[0 if end.which == "start" else -1]])[0][0, 0]
        projections.append(_nearest(own, place))
    if not projections:
        return []
    shape = shape_of(rods[rod]())
    distances = np.interp(sorted(projections), shape.u, shape.lengths)
    near, end = _ONE_PLACE * shape.radius, shape.lengths[-1]
    apart = (np.diff(distances, prepend=-np.inf) > near) & (distances > near) & (distances < end - near)
    return np.interp(distances[apart], shape.lengths, shape.u).tolist()


def _nearest(rod: Rod, place: Array) -> float:
    """Return the axis parameter of a rod's centre that is nearest to a place ``(3,)``."""

    def away(u: float) -> float:
        return float(np.linalg.norm(rod.grid(np.zeros((1, 2)), [u])[0][0, 0] - place))

    places = rod.axis.evenly(_LOOKS)
    near = int(np.argmin([away(u) for u in places]))
    low, high = places[max(near - 1, 0)], places[min(near + 1, places.size - 1)]
    return float(
        minimize_scalar(away, bounds=(low, high), method="bounded", options={"xatol": _EXACT * (high - low)}).x
    )


def tie(
    slave: Surface,
    master: Surface,
    along: tuple[float, float] | None = None,
    gap: float | None = None,
    kind: str = "weld",
    bond: float | Sequence[tuple[float, float]] = 0.0,
    touching: bool = False,
) -> Tie:
    """Return the weld of two surfaces, whose meshes need not match (`isorod.model.tie.Tie`).

    Parameters
    ----------
    slave, master
        `"ROD.start"`, `"ROD.end"`, `"ROD.outer"` (the lateral surface) or `"ROD.inner"` (that of the hole);
        `"SOLID.GROUP"`, the facets of a group, or `"SOLID"`, those of its surface that are near.  The slave is the one
        that the other covers wholly; of a rod and a solid, the rod.
    along
        Lengths along the slave's centre line, from the start, the first below the second, between which its lateral
        surface is tied; all of it where not given.
    gap
        The largest distance between the two at rest that is no mistake, units of length; where not given a tenth of
        the slave's size, the root of its area over pi.
    kind
        `"weld"`; `"slide"`: displacements along the normal alone are the same; or `"mean"`: mean displacement and
        rotation of the slave alone (a distributing coupling).
    bond
        Of what slides: tangential traction per slip, force / length^3; or a law: points `[slip, traction]` from
        `[0, 0]` on, slips ascending, straight between them, the last traction beyond. It is elastic, unloading goes
        back on the same curve; statics and modes alone take it.
    touching
        Whether what of the slave's lateral surface touches the master is tied alone, as one side of a strip on another;
        surfaces touch up to `gap`, or a hundredth of the section's size.
    """
    if along is not None:
        if not isinstance(slave, LateralSurface):
            raise InputError("along: it goes with a lateral surface, ROD.outer or ROD.inner, and no other")
        slave = replace(slave, along=along)
    if touching:
        if not isinstance(slave, LateralSurface):
            raise InputError("touching: it goes with a lateral surface, ROD.outer or ROD.inner, and no other")
        slave = replace(slave, touching=True)
    return Tie(slave, master, gap, kind, bond)
