"""Many solves in one process: what one has used, the next gets; memory stays flat."""

import gc
import subprocess
import sys
from dataclasses import replace
from importlib import import_module

import pytest

from isorod import dynamics, scenes, statics
from isorod.statics import continuation

SCRIPT = """
import sys
from importlib import import_module
from isorod import options
options.initialize([])
from isorod import scenes

analysis, name, options, counts = sys.argv[1], sys.argv[2], eval(sys.argv[3]), [int(text) for text in sys.argv[4:]]
solve = import_module("isorod." + analysis).solve
scene = scenes.find(name)(**options)
settings = scene.settings() if analysis == "dynamics" else {}

def resident():
    with open("/proc/self/smaps_rollup") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("Rss"))

sizes = []
for k in range(counts[-1]):
    solve(scene.model(), **settings)
    if k + 1 in counts:
        sizes.append(resident())
print(min((after - before) / before for before, after in zip(sizes, sizes[1:])))
"""

BICEPS = {"elements": 5, "section_points": 4, "end_elements": 0, "activation": 0.1}
CASES = {
    "statics": (
        "statics",
        "spring",
        {"coils": 1, "helix": "paper", "elements_per_turn": 4, "section_points": 4, "degree": 2},
    ),
    "mixed": ("statics", "spring", {"coils": 1, "elements_per_turn": 8, "section_points": 4, "formulation": "mixed"}),
    "modes": ("modal", "blade", {"elements": 2}),
    "contact": ("statics", "biceps", BICEPS | {"statics": True}),
    "dynamics": ("dynamics", "biceps", BICEPS | {"end_time": 2e-4, "outputs": 2}),
}


def growth(case: str, *counts: int) -> float:
    """Return by which share memory grows from one count of solves to the next, the least: a leak is in each.

    The allocator's pages come and go by 0.7 % in some.
    """
    analysis, scene, options = CASES[case]
    command = [sys.executable, "-c", SCRIPT, analysis, scene, repr(options), *map(str, counts)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=580, check=False)
    assert done.returncode == 0, done.stderr
    return float(done.stdout.splitlines()[-1])


def once(case: str) -> None:
    """Solve a case."""
    analysis, name, options = CASES[case]
    scene = scenes.find(name)(**options)
    settings = scene.settings() if analysis == "dynamics" else {}
    import_module(f"isorod.{analysis}").solve(scene.model(), **settings)


def with_friction() -> None:
    model = scenes.find("biceps")(**BICEPS, statics=True).model()
    statics.solve(replace(model, contacts=[replace(one, friction=0.2) for one in model.contacts]))


def in_implicit_steps() -> None:
    scene = scenes.find("biceps")(**BICEPS, end_time=2e-4, outputs=2)
    dynamics.solve(scene.model(), **scene.settings() | {"integrator": "implicit", "time_step": 1e-4})


def along_a_path() -> None:
    _, name, options = CASES["statics"]
    continuation.follow(scenes.find(name)(**options).model(), 0.5, 2)


SOLVES = [
    *(pytest.param(once, (case,), id=case) for case in CASES),
    pytest.param(with_friction, (), id="friction"),
    pytest.param(in_implicit_steps, (), id="implicit"),
    pytest.param(along_a_path, (), id="path"),
]


@pytest.mark.parametrize(("solve", "arguments"), SOLVES)
def test_nothing_of_a_solve_waits_for_the_collector_of_cycles(solve, arguments):
    """What does is kept for some fifty solves, models and matrices with it, and memory grows by what lies between."""
    solve(*arguments)
    gc.collect()
    gc.disable()
    try:
        solve(*arguments)
        gc.set_debug(gc.DEBUG_SAVEALL)
        gc.collect()
        left = {f"{type(one).__module__}.{type(one).__qualname__}" for one in gc.garbage}
    finally:
        gc.set_debug(0)
        gc.garbage.clear()
        gc.enable()
    assert [name for name in left if name.startswith(("isorod.", "petsc4py.", "slepc4py."))] == []


@pytest.mark.parametrize("case", ["statics", "modes"])
def test_memory_is_flat_from_the_tenth_solve_on(case):
    assert growth(case, 10, 50, 90) < 0.005


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_memory_is_flat_over_five_hundred_solves(case):
    assert growth(case, 50, 500) < 0.01
