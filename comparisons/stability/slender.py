"""Slender cantilevers, length over radius 10 to 1e6, under a dead tip load.

Locking, conditioning, rounding, Newton's iterations.
"""

from collections.abc import Iterator
from contextlib import nullcontext
from functools import cache
from typing import Any
from unittest.mock import patch

import numpy as np

from comparisons.stability.point import Sweep
from comparisons.stability.rods import condition
from isorod import statics
from isorod.assembly.assembler import Assembler
from isorod.geometry.center_line import straight
from isorod.geometry.section import circle
from isorod.material import NeoHookean
from isorod.model import Body, Model, SectionLoad, Support
from isorod.space import Space

TITLE = "slenderness: a cantilever under a dead tip load"
COLUMNS = {
    "elastica": "against the elastica",
    "condition": "condition number",
    "scaled": "with unit diagonal",
    "newton": "Newton iterations",
    "steps": "load steps",
    "floor": "last residual / load",
}

# Deflection over length of the inextensible elastica at P L^2 / EI (elliptic integrals).
ELASTICA = {1.0: 0.30172077, 10.0: 0.81060902}

# As many points as their degree along C0 elements keep membrane and shear from locking.
REDUCED = {"elements": 8, "degree": 4, "continuity": 0, "section_degree": 3, "quadrature": "4x5x4"}
SERIES: dict[str, dict[str, Any]] = {
    "polynomials, C0, p points along": REDUCED,
    "polynomials, C0, p + 2 points (full)": REDUCED | {"quadrature": "full"},
    "polynomials, smooth, full": REDUCED | {"quadrature": "full", "continuity": 3},
    "control points, K = 2, C0, p points": {
        "elements": 8,
        "degree": 4,
        "continuity": 0,
        "order": 2,
        "section_points": 8,
        "quadrature": "4x2x4",
    },
}
PLAIN_NEWTON = "polynomials, C0, p points, Newton without extrapolated stress"
TOLERANCE = 1e-4
EXACT = "up to 1e3 the same with 16 elements of degree 5, else the inextensible elastica"


def run(level: str) -> Iterator[dict[str, Any]]:
    """Yield the points."""
    loads = (1.0,) if level == "quick" else (1.0, 10.0)
    lengths = [10.0, 1e3, 1e5] if level == "quick" else [10.0 ** (k / 2) for k in range(2, 13)]
    for load in loads:
        sweep = Sweep(f"length over radius, P L^2 / EI = {load:g}", EXACT, TOLERANCE)
        for series, space in (SERIES | {PLAIN_NEWTON: REDUCED}).items():
            yield from sweep.over(lengths, _cantilever, load, space, series == PLAIN_NEWTON, series=series)


def solve(made: Space, length: float, load: float) -> tuple[float, statics.Equilibrium]:
    """Return the deflection of the tip over the length, on a space of the cantilever, and the solution."""
    force = load * 0.25 * np.pi / length**2
    model = Model(
        [Body(made, NeoHookean(1.0, 0.0))],
        [Support.end(made, "start")],
        loads=[SectionLoad.end(made, "end", (force, 0.0, 0.0))],
    )
    solution = statics.solve(model)
    tip = made.displacement(model.nodal(solution.displacement), [[0.0, 0.0]], [1.0])[0][0, 0, 0]
    return float(tip) / length, solution


def _space(length: float, given: dict[str, Any]) -> Space:
    return Space.paper(straight(length).sweep(circle(8 if "order" in given else 4)), **given)


@cache
def reference(length: float, load: float) -> float:
    """Return the exact deflection: on a fine space, of rods longer than 1e3 radii that of the elastica."""
    if length > 1e3:
        return ELASTICA[load]
    return solve(_space(length, REDUCED | {"elements": 16, "degree": 5, "quadrature": "5x5x5"}), length, load)[0]


def _cantilever(length: float, load: float, space: dict[str, Any], plain: bool) -> dict[str, Any]:
    with patch.object(Assembler, "extrapolate", lambda self: None) if plain else nullcontext():
        tip, solution = solve(_space(length, space), length, load)
    unscaled, scaled = condition(solution.model, solution.displacement)
    return {
        "error": abs(tip / reference(length, load) - 1.0),
        "elastica": abs(tip / ELASTICA[load] - 1.0),
        "condition": unscaled,
        "scaled": scaled,
        "newton": solution.newton_iterations,
        "steps": solution.load_steps,
        "floor": solution.residual_norms[-1] * length**2 / (load * 0.25 * np.pi),
        "unknowns": solution.model.unknowns,
    }
