"""Estimates by recovered strains beside known errors of finite element bodies with rods in or on them.

``python -m comparisons.joints.recovered [PART...]`` prints a line for each of the cases of some parts, ``weld``,
``welded facets``, ``linear`` and ``sleeve``, or of all: the error of works, the estimate, and their ratio.
"""

import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

from comparisons.joints import meridian, sleeve, weld
from isorod.checks import estimate

CONTRASTS = (1.0, 1.0), (10.0, 1.0), (1.0, 10.0)


class Case(NamedTuple):
    """A name, the true relative error, not negative, and the estimate."""

    name: str
    true: float
    estimate: float


def of_meshes(solution: Any) -> float:
    """Return the estimate of an equilibrium's meshes alone."""
    stored = sum(solution.energy(b) for b in range(len(solution.model.bodies)))
    return float(estimate.of_solids(solution.model, solution.solids, stored)[0].work or 0.0)


def welds(near: float, contrast: tuple[float, float], slave: str = "rod", degree: int = 2) -> Iterator[Case]:
    """Yield true and estimated errors of a rod on a block under its four loads."""
    made = weld.block(near, 1.5, hole=False, order=degree)
    result = weld.solve(made, weld.rod_space(False), contrast, False, slave, degree=degree)
    exact = meridian.weld(contrast)
    for name, equilibrium in result.equilibria.items():
        true = abs(result.compliances[name] / exact[name] - 1.0)
        what = f"weld {name}, {contrast[0]:g}:{contrast[1]:g}, size {near}, P{degree}, {slave}"
        yield Case(what, true, of_meshes(equilibrium))


def sleeve_case(name: str, element: str, cells: tuple[int, int, int]) -> Case:
    """Return true and estimated error of a rod in a sleeve."""
    problem = sleeve.torsion() if name == "torsion" else sleeve.axial()
    result = sleeve.solve(problem, sleeve.rod_space(problem.length), cells, element)
    return Case(f"{name}, {element} {cells}, rod", abs(result.energy), of_meshes(result.equilibrium))


def cases(part: str) -> Iterator[Case]:
    """Yield the cases of a part."""
    if part == "sleeve":
        for name in ("torsion", "axial"):
            for element in ("P1 bricks", "P1 tetrahedra"):
                for cells in ((2, 8, 4), (4, 16, 8)):
                    yield sleeve_case(name, element, cells)
            for element in ("P2 bricks", "P2 tetrahedra"):
                for cells in ((1, 4, 2), (2, 8, 4)):
                    yield sleeve_case(name, element, cells)
    else:
        degree, sizes, slave = {
            "weld": (2, (0.5, 0.3, 0.2), "rod"),
            "welded facets": (2, (0.5, 0.3), "solid"),
            "linear": (1, (0.5, 0.25), "rod"),
        }[part]
        for near in sizes:
            for contrast in CONTRASTS:
                yield from welds(near, contrast, slave, degree)


def main(parts: list[str]) -> int:
    """Print the cases; return how many estimates are wrong by more than a factor of three."""
    wrong, count = 0, 0
    for part in parts or ["weld", "welded facets", "linear", "sleeve"]:
        for case in cases(part):
            ratio = case.estimate / case.true
            wrong, count = wrong + (not 1.0 / 3.0 < ratio < 3.0), count + 1
            print(f"{case.name:44s} {100 * case.true:8.3f} % {100 * case.estimate:8.3f} % {ratio:6.2f}", flush=True)
    print(f"{wrong} of {count} wrong by more than a factor of three")
    return wrong


if __name__ == "__main__":
    main(sys.argv[1:])
