"""Values beside isorod's, computed anew on two or three meshes of bricks of dolfinx, and how far they are known."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from comparisons.catalogue import FOLDER
from comparisons.measure import quantities, timing
from comparisons.measure.quantities import Converged

_NESTED, _CUBIC = ((2, 1), (2, 2), (2, 4)), ((3, 1), (3, 2))
# Degree of bricks and level of mesh (`meshes.rods.build`), best last: of degree 3 where wires are thin for their
# radius. Sections of the flat wave spring are meshed unevenly: level 3 of degree 2 has 0.4 % too much inertia, level 2
# 0.1 % too little, level 1 of degree 3 0.03 % too much.
BRICKS: dict[str, tuple[tuple[int, int], ...]] = {
    "extension_spring": _CUBIC,
    "conical_spring": _CUBIC,
    "torsion_spring": _CUBIC,
    "wave_spring": ((2, 2), (3, 1)),
    "clock_spring": _CUBIC,
    "coat_hanger": _CUBIC,
    "s_hook": _NESTED,
    "stabiliser_bar": _NESTED,
    "paddle_shaft": _NESTED,
}
# What bricks have in the place of a file: a weld they do not, and tetrahedra of one solid are known to 2.6 % only.
APART = {"coat_hanger": Path(__file__).parent / "hanger.toml"}


class Computed(NamedTuple):
    """Limits of a file's measures, and a description of the finest mesh."""

    limits: dict[str, Converged]
    by: str


def compute(name: str, measures: Sequence[str]) -> Computed | None:
    """Return the limits for an example, None if no mesh of one is here."""
    if name not in BRICKS:
        return None
    file, meshes = APART.get(name, FOLDER / f"{name}.toml"), BRICKS[name]
    records = [
        timing.run("comparisons.fem", ["rods", str(file), "--degree", str(degree), "--level", str(level)])
        for degree, level in meshes
    ]
    values = [quantities.values(one, measures) for one in records]
    limits = quantities.converged([1.0 / level for _, level in meshes], values)
    by = f"Q{meshes[-1][0]} bricks, {records[-1]['dofs']:,} unknowns"
    return Computed({one.name: one for one in limits}, by)
