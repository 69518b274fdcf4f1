"""Study ``spring``: Table 1 of Lu & Zhou (2011), the converged finite element value, and error against run time."""

from collections.abc import Sequence
from typing import Any

from comparisons.fem.presets import spring as presets
from comparisons.measure import published, rod, timing
from comparisons.measure.scene import Scene
from comparisons.measure.study import Run
from comparisons.measure.work import Curve, fem_curves, with_others
from comparisons.report import rod_pictures
from isorod import options, scenes

# Errors at which run times are compared: the quick level's reference is not good for the last.
TARGETS = {"quick": (1e-2, 1e-3), "full": (1e-2, 1e-3, 1e-4)}

# One step finer along the axis, and one in the section, by method.
FINER = {
    "cylindrical": (("--elements-per-turn", 8), ("--section-points", 2), ("--section-degree", 1)),
    "fem": (("--layers", 12), ("--around", 4)),
}


def _cylindrical(label: str, common: str, elements: Sequence[int]) -> Curve:
    arguments = tuple(f"--preset paper {common} --elements-per-turn {count}" for count in elements)
    return Curve(label, "cylindrical", arguments)


PAPER = "--degree 2 --continuity 0 --quadrature paper"
CURVES = {
    "quick": (
        _cylindrical("paper, n = 4", f"{PAPER} --section-points 4", (8, 16, 24)),
        _cylindrical("K = 1, p = 2, n = 4, 2x1x2", "--degree 2 --section-points 4 --quadrature 2x1x2", (4, 8, 12)),
        _cylindrical("K = 1, p = 2, n = 5, 2x1x2", "--degree 2 --section-points 5 --quadrature 2x1x2", (4, 8, 12)),
        _cylindrical("K = 1, p = 2, n = 6, 2x1x2", "--degree 2 --section-points 6 --quadrature 2x1x2", (4, 8, 12)),
        _cylindrical("K = 1, p = 3, 2x1x3", "--degree 3 --section-points 6 --quadrature 2x1x3", (4, 8, 12)),
        _cylindrical("K = 2, p = 4", "--order 2 --degree 4 --section-points 8", (4, 8)),
        _cylindrical("polynomials N = 3, p = 4", "--section-degree 3 --degree 4", (4, 8)),
        *fem_curves(presets.QUICK),
    ),
    "full": (
        _cylindrical("paper, n = 4", f"{PAPER} --section-points 4", (4, 8, 12, 16, 20, 24)),
        _cylindrical("paper, n = 8", f"{PAPER} --section-points 8", (4, 8, 12, 16, 20, 24)),
        _cylindrical("K = 1, p = 2, n = 4, 2x1x2", "--degree 2 --section-points 4 --quadrature 2x1x2", (4, 8, 12, 16)),
        _cylindrical("K = 1, p = 2, n = 5, 2x1x2", "--degree 2 --section-points 5 --quadrature 2x1x2", (4, 8, 12, 16)),
        _cylindrical("K = 1, p = 2, n = 6, 2x1x2", "--degree 2 --section-points 6 --quadrature 2x1x2", (4, 8, 12, 16)),
        _cylindrical("K = 1, p = 3, 2x1x3", "--degree 3 --section-points 6 --quadrature 2x1x3", (4, 8, 12, 16)),
        _cylindrical("K = 1, p = 3, n = 8", "--degree 3 --section-points 8", (4, 8, 12, 16)),
        _cylindrical("K = 1, p = 4, n = 8", "--degree 4 --section-points 8", (4, 8, 12)),
        _cylindrical("K = 2, p = 3, n = 8", "--order 2 --degree 3 --section-points 8", (4, 8, 16)),
        _cylindrical("K = 2, p = 4, n = 12", "--order 2 --degree 4 --section-points 12", (4, 8, 12)),
        _cylindrical("K = 2, p = 5, n = 12", "--order 2 --degree 5 --section-points 12", (4, 8)),
        _cylindrical("K = 3, p = 4, n = 12", "--order 3 --degree 4 --section-points 12", (4, 8)),
        _cylindrical("polynomials N = 2, p = 3", "--section-degree 2 --degree 3 --quadrature 2x1x3", (4, 8, 12)),
        _cylindrical("polynomials N = 3, p = 4", "--section-degree 3 --degree 4", (4, 8, 12, 16)),
        *fem_curves(presets.FULL),
    ),
}
# Ours, as `comparisons.fem.presets.spring.BEST` are theirs.
BEST = {
    1e-2: ("--preset paper --degree 2 --section-points 4 --quadrature 2x1x2 --elements-per-turn 8",),
    1e-3: tuple(
        f"--preset paper --degree 2 --section-points {n} --quadrature 2x1x2 --elements-per-turn 8" for n in (5, 6)
    ),
    1e-4: ("--preset paper --degree 2 --section-points 6 --quadrature 2x1x2 --elements-per-turn 8",),
}
PAPER_MESH = {"quick": ("paper-q1", "paper-enhanced"), "full": ("paper-q1", "paper-q2", "paper-enhanced")}


def run(study: Run, others: Sequence[str] = ()) -> None:
    """Run the study and append its records; ``others`` are interpreters whose dolfinx is measured too."""
    options.initialize([])
    known = {target: (*BEST[target], *presets.BEST[target]) for target in TARGETS[study.level]}
    curves = with_others(CURVES[study.level], others)
    scene = Scene("spring", ("force",), presets.CONVERGED[study.level], curves, known, FINER)
    total = len(published.SPRING_GAUSS_POINTS) + len(PAPER_MESH[study.level]) + scene.steps + 1
    with study.progress(total) as steps:
        for extra in published.SPRING_GAUSS_POINTS:
            with steps.step(f"Table 1, {extra} more Gauss points than the degree"):
                _table(study, extra)
        for name in PAPER_MESH[study.level]:
            with steps.step(f"the paper's mesh, {name}"):
                record = timing.run("comparisons.fem", ["spring", "--preset", name])
                study.record("paper mesh", record | {"element": name.removeprefix("paper-")})
        scene.run(study, steps)
        with steps.step("von Mises stress"):
            rod_pictures.of_scene(study, scenes.find("spring")())


def _table(study: Run, extra: int) -> None:
    """Record all entries of Table 1 with the paper's rule, ``t = p + extra``."""
    for points, forces in published.SPRING_FORCE.items():
        for elements, force in zip(published.SPRING_ELEMENTS_PER_TURN, forces, strict=True):
            values: dict[str, Any] = {
                "preset": "paper",
                "E": published.SPRING_E,
                "nu": published.SPRING_NU,
                "section_points": points,
                "elements_per_turn": elements,
                "degree": 2,
                "continuity": 0,
                "quadrature": f"2x1x{2 + extra}",
            }
            record = rod.measure("spring", values, repeat=1)
            study.record(f"table 1, t = p + {extra}", record | {"published": force})
