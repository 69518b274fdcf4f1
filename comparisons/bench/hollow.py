"""Rods with a hole or in layers: a spring of tube, one of core and sheath, and a hollow blade, from files.

Against dolfinx alone: a law for each layer, and stresses at a place, are known to no other program here.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar

from comparisons.bench.rods import Scene
from comparisons.fem.presets import hollow as presets
from comparisons.fem.presets.family import Family
from comparisons.measure.convergence import extrapolate
from comparisons.measure.records import Record
from comparisons.measure.study import Run, Steps
from comparisons.measure.work import Curve

_FILES = Path(__file__).with_name("scenes")
_LEVELS = ("quick", "full")


def _ours(label: str, common: str, *spaces: tuple[int, int]) -> Curve:
    """Return a curve of isorod's: section degrees and elements."""
    words = (f"{common} --section-degree {degree} --elements {elements}" for degree, elements in spaces)
    return Curve(label, "cylindrical", tuple(words))


class _File(Scene):
    """A scene of a file, and what is measured of it."""

    measured: ClassVar[Sequence[str]]

    def converged(self, study: Run, steps: Steps) -> Mapping[str, Sequence[float]]:
        """Record what the finite elements of three meshes converge to, by name, and return it."""
        sizes, records = self._family(study, steps)
        limits: dict[str, list[float]] = {}
        told = 0.0
        for name in self.measured:
            every = zip(*(_values(record, name) for record in records), strict=True)
            found = [extrapolate(sizes, one) for one in every]
            limits[name] = [one.value for one in found]
            told = max([told, *(abs(one.distance / one.value) for one in found)])
        study.record("converged", {"scene": self.name, "uncertainty": told, **limits})
        return limits

    def error(self, found: Record, limits: Mapping[str, Sequence[float]]) -> float:
        """Return the largest relative error of what is measured."""
        return max(
            abs(value / limit - 1.0)
            for name in self.measured
            for value, limit in zip(_values(found, name), limits[name], strict=True)
        )


def _values(record: Record, name: str) -> list[float]:
    value = record[name]
    return [float(one) for one in value] if isinstance(value, list) else [float(value)]


class Tube(_File):
    """The spring of tube: its force."""

    name = "tube"
    file = str(_FILES / "tube.toml")
    measured: ClassVar[Sequence[str]] = ("force",)
    targets: ClassVar[Mapping[str, Sequence[float]]] = dict.fromkeys(_LEVELS, (5e-3, 1e-3))
    families: ClassVar[Mapping[str, Mapping[str, Sequence[Family]]]] = {"fem": dict.fromkeys(_LEVELS, presets.WIRE)}
    best: ClassVar[Mapping[str, Mapping[float, Sequence[str]]]] = {
        "cylindrical": dict.fromkeys((5e-3, 1e-3, 2e-2), ()),
        "fem": dict.fromkeys((5e-3, 1e-3, 2e-2), ()),
    }
    finer: ClassVar[Mapping[str, Sequence[tuple[str, int]]]] = {
        "cylindrical": (("--elements", 12), ("--section-degree", 1)),
        "fem": (("--layers", 12), ("--around", 4)),
    }
    ours: ClassVar[Mapping[str, Sequence[Curve]]] = dict.fromkeys(
        _LEVELS,
        (
            _ours("p = 3", "--degree 3", (1, 12), (2, 12), (3, 12), (3, 24)),
            _ours("p = 4", "--degree 4", (2, 12), (3, 12), (3, 24), (4, 24)),
        ),
    )
    reference: ClassVar[Mapping[str, Family]] = dict.fromkeys(_LEVELS, presets.WIRE_CONVERGED)


class TubeStresses(Tube):
    """The spring of tube: von Mises stresses outside, inside and at the side of the wire."""

    name = "tube's stresses"
    measured = ("outside", "inside", "side")
    targets: ClassVar[Mapping[str, Sequence[float]]] = dict.fromkeys(_LEVELS, (2e-2,))


class Sheath(Tube):
    """The spring of core and sheath: its force."""

    name = "core and sheath"
    file = str(_FILES / "sheath.toml")


class SheathStresses(Sheath):
    """The spring of core and sheath: von Mises stresses outside, in the core and at the side of the wire."""

    name = "core and sheath's stresses"
    measured = ("outside", "core", "side")
    targets: ClassVar[Mapping[str, Sequence[float]]] = dict.fromkeys(_LEVELS, (2e-2,))


class HollowBlade(_File):
    """The hollow blade: its six lowest frequencies."""

    name = "hollow blade"
    file = str(_FILES / "hollow.toml")
    measured = ("frequencies",)
    targets: ClassVar[Mapping[str, Sequence[float]]] = dict.fromkeys(_LEVELS, (2e-2, 1e-2))
    families: ClassVar[Mapping[str, Mapping[str, Sequence[Family]]]] = {"fem": dict.fromkeys(_LEVELS, presets.BLADE)}
    best: ClassVar[Mapping[str, Mapping[float, Sequence[str]]]] = {
        "cylindrical": dict.fromkeys((2e-2, 1e-2), ()),
        "fem": dict.fromkeys((2e-2, 1e-2), ()),
    }
    finer: ClassVar[Mapping[str, Sequence[tuple[str, int]]]] = {
        "cylindrical": (("--elements", 1), ("--section-degree", 1)),
        "fem": (("--layers", 2), ("--around", 8)),
    }
    ours: ClassVar[Mapping[str, Sequence[Curve]]] = dict.fromkeys(
        _LEVELS,
        (
            _ours("p = 6", "--degree 6", (7, 1), (8, 1), (9, 1), (10, 1)),
            _ours("p = 3", "--degree 3 --continuity 0", (7, 3), (8, 3), (9, 3), (10, 4)),
        ),
    )
    reference: ClassVar[Mapping[str, Family]] = dict.fromkeys(_LEVELS, presets.BLADE_CONVERGED)


SCENES = (Tube, TubeStresses, Sheath, SheathStresses, HollowBlade)
