"""The cost of laws: tangents and explicit forces relative to the neo-Hookean law's.

``python -m comparisons.laws.cost`` prints ratios to that, of runs in turn in one process, and
how long the first process compiles a law, and the next one reads it.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from comparisons.laws.scenes import INCOMPRESSIBLE, LAWS
from comparisons.measure import timing
from isorod.assembly.assembler import Assembler
from isorod.command import ending
from isorod.dynamics.explicit.system import System
from isorod.material.law import Material
from isorod.model import Model
from isorod.scenes.spring import Spring

# Those of displacements alone that are compiled for all rods alike.
NAMES = tuple(name for name in LAWS if not name.startswith(INCOMPRESSIBLE) and name not in ("neo-hookean", "own"))
ROUNDS = 100


def tangent(model: Model) -> Callable[[], object]:
    """Return the function that assembles a tangent of a model in a strained state."""
    assembler = Assembler(model)
    matrix = assembler.matrix()
    x = matrix.createVecRight()
    x.setArray(1e-4 * np.random.default_rng(0).normal(size=x.getSize()))
    # Without the scene's pull, which its last element alone would bear: there exponential laws overflow.
    return lambda: assembler.tangent(x, 0.0, matrix)


def forces(model: Model) -> Callable[[], object]:
    """Return the function that evaluates the internal forces of a model as an explicit step does."""
    system = System(model.in_motion("explicit"))
    u = 1e-4 * np.random.default_rng(0).normal(size=model.dofs)
    return lambda: [system.forces(u, 1.0) for _ in range(10)]


def ratio(one: Callable[[], object], other: Callable[[], object]) -> float:
    """Return the least processor time of one call by that of the other, called in turn."""
    mine, its = timing.least([one, other], ROUNDS)
    return mine / its


def seconds(name: str, folder: str) -> float:
    """Return the processor time in which another process has a law ready, SymPy's and Numba's included."""
    script = (
        "import time; from isorod import material; from comparisons.laws.cost import LAWS; start = time.process_time();"
        f"law = LAWS[{name!r}](); law.compiled.block; law.compiled.tangent;"
        "print(time.process_time() - start)"
    )
    given = os.environ | {"NUMBA_CACHE_DIR": folder}
    done = subprocess.run([sys.executable, "-c", script], env=given, capture_output=True, text=True, check=True)
    return float(done.stdout)


def main() -> int:
    """Print the table."""
    scene = Spring(helix="paper").model()

    def model(law: Material) -> Model:
        return replace(scene, bodies=[replace(scene.bodies[0], material=law, density=1e-9, formulation="displacement")])

    built_in = model(LAWS["neo-hookean"]())
    beside = tangent(built_in), forces(built_in)
    print("law                      tangent  explicit forces  first process  next process")
    with tempfile.TemporaryDirectory() as folder:
        for name in NAMES:
            made = model(LAWS[name]())
            one, other = ratio(tangent(made), beside[0]), ratio(forces(made), beside[1])
            first, then = seconds(name, folder), seconds(name, folder)
            print(f"{name:24} {one:7.2f}  {other:15.2f}  {first:11.1f} s  {then:10.2f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(ending.run("comparisons.laws.cost", main))
