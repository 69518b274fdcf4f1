"""Many solves in one process: what one has used, the next gets; memory stays flat."""

import subprocess
import sys

import pytest

SCRIPT = """
import sys
from importlib import import_module
from isorod import options
options.initialize([])
from isorod import scenes

analysis, name, options, first, last = sys.argv[1], sys.argv[2], eval(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5])
solve = import_module("isorod." + analysis).solve
scene = scenes.find(name)(**options)
settings = scene.settings() if analysis == "dynamics" else {}

def resident():
    with open("/proc/self/smaps_rollup") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("Rss"))

for k in range(last):
    solve(scene.model(), **settings)
    if k + 1 == first:
        before = resident()
print((resident() - before) / before)
"""

BICEPS = {"elements": 5, "section_points": 4, "end_elements": 0, "activation": 0.1}
CASES = {
    "statics": ("statics", "spring", {"coils": 1, "elements_per_turn": 4, "section_points": 4, "degree": 2}),
    "mixed": ("statics", "spring", {"coils": 1, "elements_per_turn": 4, "section_points": 4, "formulation": "mixed"}),
    "modes": ("modal", "blade", {"elements": 2}),
    "contact": ("statics", "biceps", BICEPS | {"statics": True}),
    "dynamics": ("dynamics", "biceps", BICEPS | {"end_time": 2e-4, "outputs": 2}),
}


def growth(case: str, first: int, last: int) -> float:
    """Return by which share memory grows from one solve to another."""
    analysis, scene, options = CASES[case]
    command = [sys.executable, "-c", SCRIPT, analysis, scene, repr(options), str(first), str(last)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=580, check=False)
    assert done.returncode == 0, done.stderr
    return float(done.stdout.splitlines()[-1])


# Where solvers wait for Python's collector of cycles, the spring's memory grows by 1.3 % here.
@pytest.mark.parametrize("case", ["statics", "modes"])
def test_memory_is_flat_from_the_tenth_solve_on(case):
    assert growth(case, 10, 50) < 0.005


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_memory_is_flat_over_five_hundred_solves(case):
    assert growth(case, 50, 500) < 0.01
