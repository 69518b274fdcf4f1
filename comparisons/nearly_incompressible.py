"""``python -m comparisons.nearly_incompressible biceps``: the biceps' equilibrium beside Taylor-Hood elements.

At nu = 0.4999 (`isorod.scenes.biceps`), in both formulations, beside bricks of degree 2 with pressures of degree 1
(`comparisons.fem.biceps`), of which the finest mesh asked for is the reference; ``--meshes 3`` takes some minutes.
Crossing cylinders at nu = 0.499999 beside Hertz: `comparisons.contact.crossed`.
"""

import argparse
import sys
import warnings
from collections.abc import Iterator, Sequence
from itertools import chain
from time import process_time
from typing import Any

import numpy as np

from isorod import options, statics
from isorod.scenes.biceps import Biceps

BICEPS = 0.4999

# Displacements alone, then with pressures, coarse to fine: the last is the default.
SPACES: tuple[dict[str, Any], ...] = (
    {"formulation": "displacement"},
    {"elements": 10, "section_points": 8},
    {"elements": 20, "section_points": 8},
    {},
)
# Bricks round a branch and along each element of its axis.
MESHES = (4, 2), (8, 4), (12, 6)

Quantities = dict[str, float]


def finite_elements(count: int) -> Iterator[tuple[str, Quantities]]:
    """Yield quantities of the biceps on meshes of Taylor-Hood elements."""
    from comparisons.fem.biceps.run import Configuration, run

    scene = Biceps(nu=BICEPS, statics=True)
    for around, layers in MESHES[:count]:
        record = run(Configuration(cells="bricks", around=around, layers=layers, formulation="mixed", scene=scene))
        yield f"Taylor-Hood, {around} round, {layers} along, {record['dofs']} unknowns", _quantities(record)


def rods() -> Iterator[tuple[str, Quantities]]:
    """Yield quantities of isorod's biceps."""
    for fields in SPACES:
        scene = Biceps(nu=BICEPS, statics=True, **fields)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            solution = statics.solve(scene.model())
        text = ", ".join(f"{name} {value}" for name, value in fields.items() if name != "formulation")
        yield f"{scene.model().bodies[0].formulation} {text}".strip(), _quantities(scene.measure(solution))


def _quantities(measured: dict[str, Any]) -> Quantities:
    lower, upper = np.array(measured["end_force"])[:2]
    rest = {name: float(measured[name]) for name in ("belly_bulge", "contact_force")}
    return {"lower force": float(lower), "upper force": float(upper)} | rest


def main(arguments: Sequence[str]) -> None:
    """Print a line a run as soon as it is known, with deviations from the reference in per cent."""
    parser = argparse.ArgumentParser(prog="comparisons.nearly_incompressible")
    parser.add_argument("case", choices=("biceps",))
    parser.add_argument("--meshes", type=int, choices=range(1, len(MESHES) + 1), default=2, help="how many (2)")
    given = parser.parse_args(arguments)
    options.initialize([])
    start = process_time()
    reference: Quantities = {}
    for name, values in chain(finite_elements(given.meshes), rods()):
        reference = values if name.startswith("Taylor") else reference
        off = {what: 100.0 * (value / reference[what] - 1.0) for what, value in values.items()}
        texts = [f"{what} {value:.5g} ({off[what]:+.2f} %)" for what, value in values.items()]
        print(f"{name}: {', '.join(texts)}; {process_time() - start:.0f} s", flush=True)
        start = process_time()


if __name__ == "__main__":
    main(sys.argv[1:])
