"""How far estimates of error are from errors: random rods, laws, loads and spaces, too coarse ones too.

``python -m comparisons.stability.estimates 200`` prints a line a rod and, in the end, the shares.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from isorod import modal, options, statics
from isorod.errors import InputError, SolveError
from isorod.geometry import section
from isorod.geometry.center_line import helix, straight
from isorod.geometry.rod import Rod
from isorod.material import NeoHookean
from isorod.model import Body, Model, SectionLoad, Support
from isorod.output import results
from isorod.space import Space, choice

# Errors below are those of the reference.
SMALLEST = 1e-6


def rod(rng: np.random.Generator) -> Rod:
    """Return a random rod: straight, twisted and tapered or a helix, of a round, elliptical or airfoil section."""
    kind = rng.integers(3)
    outline = [
        section.circle(8, 1.0),
        section.ellipse(8, 1.0, rng.uniform(0.1, 1.0)),
        section.airfoil(),
    ][kind]
    if rng.random() < 0.3:
        return helix(rng.uniform(3.0, 10.0), rng.uniform(2.5, 8.0), 1, 4).sweep(outline)
    line = straight(10.0 ** rng.uniform(0.5, 2.0))
    way = np.linspace(0.0, 1.0, line.axis.count)
    angle, size = rng.uniform(0.0, 0.8) * way, 1.0 - rng.uniform(0.0, 0.6) * way
    turns = np.zeros((way.size, 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angle)
    turns[:, 1, 0], turns[:, 0, 1] = np.sin(angle), -np.sin(angle)
    turns[:, 2, 2] = 1.0
    return Rod.sweep(outline, line.axis, line.centers, turns, size[:, None, None] * np.eye(3))


def space(rng: np.random.Generator, made: Rod) -> Space:
    """Return the space that is chosen, or a coarser one."""
    if rng.random() < 0.4:
        return Space(made)
    degree, across = int(rng.integers(2, 6)), int(rng.integers(1, 5))
    parts = int(rng.integers(1, 5))
    return Space(made, degree=degree, section_degree=across, elements=parts * made.axis.elements, continuity=0)


def solve(on: Space, what: int, vector: np.ndarray, nu: float) -> tuple[np.ndarray, Any]:
    """Return what is measured of a solution, and the solution: work of a load, of a moved end, or frequencies."""
    body = Body(on, NeoHookean(1.0, nu), 1.0)
    start = Support.end(on, "start")
    if what == 0:
        load = SectionLoad.end(on, "end", tuple(vector))
        load_solution = statics.solve(Model([body], [start], loads=[load]))
        return np.array([load.nodal(on).ravel() @ load_solution.displacement]), load_solution
    if what == 1:
        moved = statics.solve(Model([body], [start, Support.end(on, "end", displacement=tuple(vector))]))
        return np.array([moved.reactions[1] @ vector]), moved
    found = modal.solve(Model([body], [start]), 4)
    return found.frequencies, found


def compare(seed: int) -> dict[str, Any]:
    """Return true error and estimate of one random rod."""
    rng = np.random.default_rng(seed)
    made = rod(rng)
    on = space(rng, made)
    what, nu = int(rng.integers(3)), float(rng.choice([0.0, 0.3, 0.45]))
    direction = rng.normal(size=3)
    length = float(np.linalg.norm(np.ptp(made.control_points.mean(axis=1), axis=0)))
    stiff = 0.02 / max(length, 3.0) ** 2 if what == 0 else 0.01 * length
    vector = stiff * direction / np.linalg.norm(direction)
    found, solution = solve(on, what, vector, nu)
    estimate = solution.estimate()
    across = min((on.section_degree or 3) + 3, 7)
    parts = max(on.axis.elements, Space(made).axis.elements) // made.axis.elements
    fine = Space(made, elements=2 * parts * made.axis.elements, degree=6, continuity=0, section_degree=across)
    fine = replace(fine, quadrature=str(choice.rule(fine.basis, fine.axis)))
    exact, _ = solve(fine, what, vector, nu)
    error = float(np.abs(found / exact - 1.0).max())
    kind = ("load", "moved end", "modes")[what]
    return {"seed": seed, "kind": kind, "nu": nu, "space": str(on), "error": error, "estimate": estimate}


def main(arguments: Sequence[str]) -> int:
    """Run as many as are asked for."""
    options.initialize([])
    ratios = []
    for seed in range(int(arguments[0]) if arguments else 200):
        try:
            found = compare(seed)
        except (InputError, SolveError) as problem:
            print(results.line({"seed": seed, "failure": str(problem)}), flush=True)
            continue
        print(results.line(found), flush=True)
        if found["estimate"] is not None and found["error"] > SMALLEST:
            ratios.append(found["error"] / found["estimate"])
    share = float(np.mean([1.0 / 3.0 <= one <= 3.0 for one in ratios])) if ratios else float("nan")
    print(results.line({"rods": len(ratios), "within 3": share, "largest": max(ratios, default=None)}))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
