"""Study ``spring``: Table 1 of Lu & Zhou (2011), the converged finite element value, and error against run time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from comparisons import published, rod, timing
from comparisons.convergence import richardson
from comparisons.study import Run, Steps
from isorod import options

# Error at which run times are compared.
TARGET = 1e-3
# Runs of each configuration, the first one cold: the median is of five.
REPEAT = "6"


@dataclass(frozen=True)
class Curve:
    """A family of discretisations, coarse to fine, that makes one curve of the work-precision diagram."""

    label: str
    method: str
    arguments: tuple[str, ...]


def _cylindrical(label: str, common: str, elements: Sequence[int]) -> Curve:
    return Curve(label, "cylindrical", tuple(f"{common} --elements-per-turn {count}" for count in elements))


def _fem(label: str, common: str, meshes: Sequence[str]) -> Curve:
    return Curve(label, "fem", tuple(f"{common} {mesh}" for mesh in meshes))


def _bricks(*sizes: tuple[int, int]) -> list[str]:
    return [f"--around {around} --layers {layers}" for around, layers in sizes]


PAPER = "--degree 2 --continuity 0 --quadrature paper"
CYLINDRICAL = {
    "quick": (
        _cylindrical("p = 2, n = 4, paper rule", f"{PAPER} --section-points 4", (8, 16, 24)),
        _cylindrical("p = 3, n = 8", "--degree 3 --section-points 8", (4, 8, 12)),
        _cylindrical("p = 4, n = 8", "--degree 4 --section-points 8", (4, 8)),
    ),
    "full": (
        _cylindrical("p = 2, n = 4, paper rule", f"{PAPER} --section-points 4", (4, 8, 12, 16, 20, 24)),
        _cylindrical("p = 2, n = 8, paper rule", f"{PAPER} --section-points 8", (4, 8, 12, 16, 20, 24)),
        _cylindrical("p = 3, n = 6", "--degree 3 --section-points 6", (4, 8, 12, 16)),
        _cylindrical("p = 3, n = 8", "--degree 3 --section-points 8", (4, 8, 12, 16)),
        _cylindrical("p = 4, n = 8", "--degree 4 --section-points 8", (4, 8, 12)),
        _cylindrical("p = 5, n = 16", "--degree 5 --section-points 16", (4, 8)),
    ),
}
FEM = {
    "quick": (
        _fem("Q2 bricks", "--degree 2", _bricks((4, 36), (4, 60), (8, 60))),
        _fem("Q3 bricks", "--degree 3", _bricks((4, 24), (4, 36))),
    ),
    "full": (
        _fem("Q1 bricks", "--degree 1", _bricks((8, 96), (16, 192))),
        _fem("Q2 bricks", "--degree 2", _bricks((4, 36), (4, 48), (4, 60), (8, 60), (8, 96))),
        _fem("Q3 bricks", "--degree 3", _bricks((4, 24), (4, 36), (8, 36), (8, 48))),
    ),
}
# Uniformly refined meshes of one element, for the extrapolation.
CONVERGED = {
    "quick": ("--degree 3 --quadrature 6", ((4, 24), (4, 36), (4, 48))),
    "full": ("--degree 3 --quadrature 6", ((4, 24), (8, 48), (12, 72))),
}


def run(study: Run) -> None:
    """Run the study and append its records."""
    options.initialize([])
    curves = [*CYLINDRICAL[study.level], *FEM[study.level]]
    common, meshes = CONVERGED[study.level]
    total = len(published.SPRING_GAUSS_POINTS) + len(meshes) + 2 + sum(len(curve.arguments) for curve in curves) + 1
    with study.progress(total) as steps:
        for extra in published.SPRING_GAUSS_POINTS:
            with steps.step(f"Table 1, {extra} more Gauss points than the degree"):
                _table(study, extra)
        reference = _converged(study, steps, common, meshes)
        for degree in (1, 2):
            with steps.step(f"the paper's mesh, Q{degree}"):
                arguments = ["spring", "--cells", "paper", "--degree", str(degree)]
                study.record("paper mesh", timing.run("comparisons.fem", arguments) | {"element": f"Q{degree}"})
        for curve in curves:
            _work(study, steps, curve, reference)
        with steps.step("von Mises stress"):
            from comparisons import pictures

            pictures.spring(study)


def _table(study: Run, extra: int) -> None:
    """Record all entries of Table 1 with the paper's rule, ``t = p + extra``."""
    for points, forces in published.SPRING_FORCE.items():
        for elements, force in zip(published.SPRING_ELEMENTS_PER_TURN, forces, strict=True):
            values: dict[str, Any] = {
                "E": published.SPRING_E,
                "nu": published.SPRING_NU,
                "section_points": points,
                "elements_per_turn": elements,
                "degree": 2,
                "continuity": 0,
                "quadrature": f"2x1x{2 + extra}",
            }
            found = rod.measure("spring", values, repeat=1)
            study.record(f"table 1, t = p + {extra}", found | {"published": force})


def _converged(study: Run, steps: Steps, common: str, meshes: Sequence[tuple[int, int]]) -> float:
    """Record the extrapolated finite element value and return it."""
    forces, sizes = [], []
    for around, layers in meshes:
        with steps.step(f"converged value: {common}, {around} x {layers}"):
            arguments = ["spring", *common.split(), "--around", str(around), "--layers", str(layers)]
            found = study.record("convergence", timing.run("comparisons.fem", arguments))
        forces.append(found["force"])
        sizes.append(1.0 / layers)
    limit = richardson(sizes, forces)
    study.record(
        "converged", {"force": limit.value, "order": limit.order, "uncertainty": limit.distance, "element": common}
    )
    return limit.value


def _work(study: Run, steps: Steps, curve: Curve, reference: float) -> None:
    """Record error and warm run time along a curve."""
    module = "comparisons.rod" if curve.method == "cylindrical" else "comparisons.fem"
    for text in curve.arguments:
        with steps.step(f"{curve.label}: {text}"):
            found = timing.run(module, ["spring", *text.split(), "--repeat", REPEAT])
            error = abs(found["force"] / reference - 1.0)
            study.record("work", found | {"curve": curve.label, "arguments": text, "error": error})
