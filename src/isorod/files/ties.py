"""Ties of a scene file: surfaces by their names, as ``"spring.end"``."""

from collections.abc import Mapping
from dataclasses import replace

from isorod.errors import InputError
from isorod.model.tie import EndFace, LateralSurface, Surface, Tie


def surfaces(rods: Mapping[str, int]) -> dict[str, Surface]:
    """Return the surfaces that a file may name, of rods by their numbers.

    ``ROD.start`` and ``ROD.end`` are the end faces, ``ROD.outer`` the lateral surface, ``ROD.inner`` that of the hole.
    """
    found: dict[str, Surface] = {}
    for name, number in rods.items():
        found |= {f"{name}.{which}": EndFace(number, which) for which in ("start", "end")}
        found |= {f"{name}.{which}": LateralSurface(number, surface=which) for which in ("outer", "inner")}
    return found


def tie(slave: Surface, master: Surface, along: tuple[float, float] | None = None, gap: float | None = None) -> Tie:
    """Return the weld of two surfaces, whose meshes need not match (`isorod.model.tie.Tie`).

    Parameters
    ----------
    slave, master
        `"ROD.start"`, `"ROD.end"`, `"ROD.outer"` (the lateral surface) or `"ROD.inner"` (that of the hole).  The finer
        of the two, or the one that the other covers wholly, is the slave.
    along
        Lengths along the slave's centre line, from the start, the first below the second, between which its lateral
        surface is tied; all of it where not given.
    gap
        The largest distance between the two at rest that is no mistake, units of length; where not given a tenth of
        the slave's size, the root of its area over pi.
    """
    if along is not None:
        if not isinstance(slave, LateralSurface):
            raise InputError("along: it goes with a lateral surface, ROD.outer or ROD.inner, and no other")
        slave = replace(slave, along=along)
    return Tie(slave, master, gap)
