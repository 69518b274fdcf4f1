"""``python -m comparisons.derivatives``: solve scenes, run them, differentiate the answers, print all times.

A run is what ``isorod run`` takes: the model, its solution, an estimate of the error, and what is measured.  Times are
those of the processor, the least of some runs in turn, as other programs may run beside.  A scene that has fewer than
twenty numbers is differentiated by one of them and by all, and twenty take as much more as these.
"""

import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from time import process_time
from typing import Any

from petsc4py import PETSc

from isorod import files
from isorod.command import solving
from isorod.design import derivatives, parameters
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring

NUMBERS, RUNS = 20, 3

_OWN = Path(__file__).parent
_CATALOGUE = Path(files.__file__).parent / "examples" / "catalogue"


def scenes() -> dict[str, Any]:
    """Return the scenes by their titles, nonlinear laws first."""
    return {
        "hook, Mooney-Rivlin": files.find(str(_OWN / "hook.toml")),
        "bar bent far, Mooney-Rivlin": files.find(str(_OWN / "bar.toml")),
        "spring, neo-Hookean": Spring(section_degree=6, elements_per_turn=16),
        "spring, as it is by default": Spring(),
        "extension spring, linear": files.find(str(_CATALOGUE / "extension_spring.toml")),
        "blade's frequencies": Blade(elements=24, section_degree=6),
    }


def measured(scene: Any) -> tuple[int, int, float, float, float]:
    """Return unknowns and numbers of a scene, seconds of its solution, a run, and derivatives by twenty numbers."""
    solve = import_module(f"isorod.{scene.analysis}").solve
    numbers = dict(list(parameters.parameters(scene).items())[:NUMBERS])
    first = dict(list(numbers.items())[:1])
    model = scene.model()
    solution = solve(model, comm=PETSc.COMM_SELF, **scene.settings())
    runs: list[Callable[[], object]] = [lambda: solve(model, comm=PETSc.COMM_SELF, **scene.settings())]
    runs += [lambda: _run(scene)]
    runs += [lambda names=one: _derivatives(scene, solution, names) for one in (first, numbers)]  # type: ignore[misc]
    times = [[_seconds(run) for run in runs] for _ in range(RUNS)]
    solved, run, alone, together = (min(row) for row in zip(*times, strict=True))
    each = (together - alone) / max(len(numbers) - 1, 1)
    return model.unknowns, len(numbers), solved, run, together + (NUMBERS - len(numbers)) * each


def _run(scene: Any) -> object:
    seen, solution, _ = solving.solve_scene(scene, scene.settings())
    with warnings.catch_warnings(action="ignore"):
        solving.estimate(solution, bool(getattr(scene, "stresses", ())))
        return seen.measure(solution)


def _derivatives(scene: Any, solution: Any, names: Mapping[str, float]) -> object:
    return derivatives.of(scene, solution, names)


def _seconds(run: Callable[[], object]) -> float:
    begin = process_time()
    run()
    return process_time() - begin


def main() -> None:
    """Print a line a scene."""
    heads = f"{'unknowns':>9}{'numbers':>8}{'solve s':>9}{'run s':>8}{f'by {NUMBERS} s':>9}{'solves':>8}{'runs':>6}"
    print(f"{'scene':30}{heads}")
    for name, scene in scenes().items():
        unknowns, numbers, solved, run, rates = measured(scene)
        row = f"{name:30}{unknowns:9,}{numbers:8}{solved:9.3f}{run:8.3f}{rates:9.3f}"
        print(f"{row}{rates / solved:8.2f}{rates / run:6.2f}", flush=True)


if __name__ == "__main__":
    main()
