"""Rods with a hole or in layers: a spring of tube, one of core and sheath, and a hollow blade, from files.

Against dolfinx alone: no other program here has a law for each layer, or stresses at a place.
"""

from collections.abc import Sequence
from pathlib import Path

from comparisons.bench.rods import every, with_default
from comparisons.fem.presets import hollow as presets
from comparisons.measure.records import Record
from comparisons.measure.scene import Scene
from comparisons.measure.work import Curve

_FILES = Path(__file__).with_name("scenes")


def _ours(label: str, common: str, *spaces: tuple[int, int]) -> Curve:
    """Return a curve of isorod's: section degrees and elements."""
    words = (f"{common} --section-degree {degree} --elements {elements}" for degree, elements in spaces)
    return Curve(label, "cylindrical", tuple(words))


WIRE = (
    _ours("p = 3", "--degree 3", (1, 12), (2, 12), (3, 12), (3, 24)),
    _ours("p = 4", "--degree 4", (2, 12), (3, 12), (3, 24), (4, 24)),
)
BLADE = (
    _ours("p = 6", "--degree 6", (7, 1), (8, 1), (9, 1), (10, 1)),
    _ours("p = 3", "--degree 3 --continuity 0", (7, 3), (8, 3), (9, 3), (10, 4)),
)
FINER_WIRE = {
    "cylindrical": (("--elements", 12), ("--section-degree", 1)),
    "fem": (("--layers", 12), ("--around", 4)),
}
FINER_BLADE = {
    "cylindrical": (("--elements", 1), ("--section-degree", 1)),
    "fem": (("--layers", 2), ("--around", 8)),
}

# No arguments that were the fastest in earlier runs.
_NONE: dict[str, tuple[str, ...]] = {"cylindrical": (), "fem": ()}

# File, name, measured quantities (forces, von Mises stresses), and target errors.
_WIRES = (
    ("tube", "tube", ("force",), (5e-3, 1e-3)),
    ("tube", "tube's stresses", ("outside", "inside", "side"), (2e-2,)),
    ("sheath", "core and sheath", ("force",), (5e-3, 1e-3)),
    ("sheath", "core and sheath's stresses", ("outside", "core", "side"), (2e-2,)),
)


def scenes(others: Sequence[str]) -> list[Scene]:
    """Return all of them; ``others`` are interpreters whose dolfinx is measured too."""
    kept: dict[str, dict[tuple[str, ...], Record]] = {"tube": {}, "sheath": {}}
    result = []
    for file, name, measured, targets in _WIRES:
        known = dict.fromkeys(targets, _NONE)
        curves, path = every(WIRE, presets.WIRE, known, others), str(_FILES / f"{file}.toml")
        fast = with_default(known)
        result.append(Scene(name, measured, presets.WIRE_CONVERGED, curves, fast, FINER_WIRE, path, kept[file]))
    known = dict.fromkeys((2e-2, 1e-2), _NONE)
    curves, path = every(BLADE, presets.BLADE, known, others), str(_FILES / "hollow.toml")
    blade = Scene(
        "hollow blade", ("frequencies",), presets.BLADE_CONVERGED, curves, with_default(known), FINER_BLADE, path
    )
    return [*result, blade]
