"""Study ``blade``: Table 2 and Fig. 13 of Lu & Zhou (2011), mode shapes, and error against run time for ten modes."""

from collections.abc import Sequence
from typing import Any

from comparisons.fem.presets import blade as presets
from comparisons.measure import mac, published, rod, sampled, timing
from comparisons.measure.scene import Scene
from comparisons.measure.study import Run
from comparisons.measure.work import Curve, fem_curves, with_others
from comparisons.report import rod_pictures
from isorod import options, scenes

# Largest error of the ten frequencies at which run times are compared.
TARGETS = {"quick": (1e-2, 5e-3), "full": (1e-2, 5e-3, 3e-3, 1e-3, 5e-4)}

# One step finer along the axis, and one in the section, by method.
FINER = {
    "cylindrical": (("--elements", 4), ("--section-points", 16), ("--section-degree", 1)),
    "fem": presets.FINER,
}

# What the element is without and with more than harmonic functions of the section.
ELEMENTS: dict[str, dict[str, Any]] = {
    "K = 1, paper rule": {"section_points": 16, "elements": 20, "degree": 2, "quadrature": "paper"},
    "K = 1, full rule": {"section_points": 16, "elements": 20, "degree": 2, "quadrature": "full"},
    "K = 2, n = 16": {"section_points": 16, "elements": 16, "degree": 3, "order": 2, "quadrature": "full"},
    "K = 2, n = 32": {"section_points": 32, "elements": 16, "degree": 3, "order": 2, "quadrature": "full"},
    "K = 3, n = 32": {"section_points": 32, "elements": 16, "degree": 3, "order": 3, "quadrature": "full"},
    "polynomials, N = 3": {"section_degree": 3, "elements": 12, "degree": 4},
    "polynomials, N = 5": {"section_degree": 5, "elements": 20, "degree": 5},
}


# On a mesh of the paper's density: 14 layers of 49 straight-sided bricks.
PAPER = {
    "8-node bricks, displacements only,": "--preset paper-q1",
    "8-node enhanced-strain bricks (9 modes)": "--preset paper-enhanced",
    "27-node bricks (Q2 displacement)": "--preset paper-q2",
}


def _cylindrical(label: str, common: str, elements: Sequence[int]) -> Curve:
    arguments = tuple(f"--preset paper {common} --elements {count}" for count in elements)
    return Curve(label, "cylindrical", arguments)


def _half_smooth(degree: int, rule: str, elements: Sequence[int]) -> Curve:
    """Return the curve of C3 axes of degree 6.

    Of all degrees and continuities the fewest unknowns, with 5 points along an element.
    """
    common = f"--section-degree {degree} --degree 6 --continuity 3 --quadrature {rule}"
    return _cylindrical(f"polynomials N = {degree}, p = 6, C3, {rule}", common, elements)


CURVES = {
    "quick": (
        _cylindrical("paper", "--section-points 16 --degree 2 --quadrature paper", (5, 10, 20)),
        _cylindrical("K = 2, p = 3, n = 16", "--section-points 16 --order 2 --degree 3", (8, 16)),
        _cylindrical("K = 2, p = 3, n = 32", "--section-points 32 --order 2 --degree 3", (16,)),
        _cylindrical("polynomials N = 3, p = 6, 3x1x3", "--section-degree 3 --degree 6 --quadrature 3x1x3", (4, 5, 6)),
        _half_smooth(3, "3x1x5", (2, 3)),
        _cylindrical("polynomials N = 4, p = 4", "--section-degree 4 --degree 4", (8, 12, 16)),
        *fem_curves(presets.QUICK),
    ),
    "full": (
        _cylindrical("paper", "--section-points 16 --degree 2 --quadrature paper", (5, 10, 15, 20, 25, 30)),
        _cylindrical("K = 1, p = 3, n = 16", "--section-points 16 --degree 3", (6, 12, 18)),
        _cylindrical("K = 2, p = 2, n = 32", "--section-points 32 --order 2 --degree 2", (8, 16, 24)),
        _cylindrical("K = 2, p = 3, n = 16", "--section-points 16 --order 2 --degree 3", (4, 8, 12, 16)),
        _cylindrical("K = 2, p = 4, n = 16", "--section-points 16 --order 2 --degree 4", (4, 6, 8, 12)),
        _cylindrical("K = 2, p = 3, n = 32", "--section-points 32 --order 2 --degree 3", (8, 12, 16)),
        _cylindrical("K = 3, p = 3, n = 32", "--section-points 32 --order 3 --degree 3", (12, 16)),
        _cylindrical(
            "polynomials N = 3, p = 4, 3x1x2", "--section-degree 3 --degree 4 --quadrature 3x1x2", (6, 8, 9, 10, 12)
        ),
        _cylindrical(
            "polynomials N = 3, p = 6, 3x1x3", "--section-degree 3 --degree 6 --quadrature 3x1x3", (4, 5, 6, 7, 8)
        ),
        _cylindrical("polynomials N = 3, p = 4", "--section-degree 3 --degree 4", (8, 10, 12, 16)),
        _cylindrical("polynomials N = 4, p = 4", "--section-degree 4 --degree 4", (8, 10, 12, 16, 20)),
        _cylindrical(
            "polynomials N = 4, p = 6, 4x2x3", "--section-degree 4 --degree 6 --quadrature 4x2x3", (5, 6, 8, 10, 12)
        ),
        _cylindrical(
            "polynomials N = 5, p = 5, 4x2x3", "--section-degree 5 --degree 5 --quadrature 4x2x3", (8, 10, 12, 14)
        ),
        _cylindrical("polynomials N = 5, p = 5", "--section-degree 5 --degree 5", (8, 10, 12, 16, 20)),
        _half_smooth(3, "3x1x5", (2, 3, 4)),
        _half_smooth(4, "4x2x5", (2, 3, 4)),
        _half_smooth(5, "4x2x5", (2, 3, 4)),
        *fem_curves(presets.FULL),
    ),
}

# Ours, as `comparisons.fem.presets.blade.BEST` are theirs.
BEST = {
    1e-2: _half_smooth(3, "3x1x5", (2,)).arguments,
    5e-3: _half_smooth(3, "3x1x5", (2,)).arguments,
    3e-3: _half_smooth(4, "4x2x5", (2,)).arguments,
    1e-3: _half_smooth(4, "4x2x5", (4,)).arguments,
    5e-4: _half_smooth(5, "4x2x5", (3,)).arguments,
}


def run(study: Run, others: Sequence[str] = ()) -> None:
    """Run the study and append its records; ``others`` are interpreters whose dolfinx is measured too."""
    options.initialize([])
    known = {target: (*BEST[target], *presets.BEST[target]) for target in TARGETS[study.level]}
    curves, family = with_others(CURVES[study.level], others), presets.CONVERGED[study.level]
    measured = Scene("blade", ("frequencies",), family, curves, known, FINER)
    with study.progress(1 + len(PAPER) + len(ELEMENTS) + measured.steps + 1) as steps:
        with steps.step("Table 2"):
            _table(study)
        for name, arguments in PAPER.items():
            with steps.step(f"the paper's mesh, {name}"):
                record = timing.run("comparisons.fem", ["blade", *arguments.split()])
                study.record("paper mesh", record | {"element": name})
        for label, values in ELEMENTS.items():
            with steps.step(f"element {label}"):
                record = rod.measure("blade", values | {"preset": "paper"}, repeat=1)
                study.record("element", record | {"label": label})
        measured.run(study, steps)
        with steps.step("mode shapes"):
            _shapes(study)


def _table(study: Run) -> None:
    """Record all entries of Table 2 with the paper's rule."""
    for elements, frequencies in published.BLADE_FREQUENCIES.items():
        values: dict[str, Any] = {
            "preset": "paper",
            "length": published.BLADE_LENGTH,
            "twist": published.BLADE_TWIST,
            "taper": published.BLADE_TAPER,
            "elements": elements,
            "degree": 2,
            "quadrature": "paper",
        }
        record = rod.measure("blade", values, repeat=1)
        study.record("table 2", record | {"published": frequencies, "elements": elements})


def _shapes(study: Run) -> None:
    """Draw the first mode shapes of both sides, and record the MAC matrix."""
    scene = scenes.find("blade")(preset="paper", section_points=32, elements=16, degree=3, order=2)
    fields, theirs = rod_pictures.of_scene(study, scene)
    assert theirs.modes is not None
    matrix = mac.matrix(sampled.fields(fields, theirs.places)["modes"], theirs.modes)
    study.record("mac", {"matrix": matrix.tolist(), "dofs": [fields.model.dofs, theirs.points.size]})
