"""Values beside isorod's, computed anew on two or three meshes: bricks of dolfinx, or beams; how far they are known."""

from collections.abc import Sequence
from typing import NamedTuple

from comparisons.catalogue import FOLDER, hanger
from comparisons.measure import quantities, timing
from comparisons.measure.quantities import Converged

# Degree of bricks, and levels of meshes (`meshes.rods.build`): of degree 3 where wires are thin for their radius.
BRICKS: dict[str, tuple[int, tuple[int, ...]]] = {
    "extension_spring": (3, (1, 2)),
    "conical_spring": (3, (1, 2)),
    "torsion_spring": (3, (1, 2)),
    "wave_spring": (2, (1, 2)),
    "clock_spring": (3, (1, 2)),
    "s_hook": (2, (1, 2, 4)),
    "stabiliser_bar": (2, (1, 2, 4)),
    "paddle_shaft": (2, (1, 2, 4)),
}
# Of the hanger: how many times its beams.
BEAMS: tuple[int, ...] = (1, 2, 4)


class Computed(NamedTuple):
    """Limits of what a file measures, and what the finest mesh is, in words."""

    limits: dict[str, Converged]
    by: str


def compute(name: str, measures: Sequence[str]) -> Computed | None:
    """Return the limits for an example, None if no mesh of one is here."""
    file = FOLDER / f"{name}.toml"
    if name == "coat_hanger":
        found = [hanger.found(file, part) for part in BEAMS]
        sizes, by = BEAMS, f"frame of {BEAMS[-1] * sum(hanger.BEAMS):,} beams"
    elif name in BRICKS:
        degree, sizes = BRICKS[name]
        words = ["rods", str(file), "--degree", str(degree)]
        records = [timing.run("comparisons.fem", [*words, "--level", str(level)]) for level in sizes]
        found, by = records, f"Q{degree} bricks, {records[-1]['dofs']:,} unknowns"
    else:
        return None
    values = [quantities.values(one, measures) for one in found]
    return Computed({one.name: one for one in quantities.converged([1.0 / one for one in sizes], values)}, by)
