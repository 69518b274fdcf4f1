"""What laws cost: tangents and explicit forces beside those of the neo-Hookean law.

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

from comparisons.measure import timing
from isorod.assembly.assembler import Assembler
from isorod.command import ending
from isorod.dynamics.explicit.system import System
from isorod.material import LinearElastic, NeoHookean
from isorod.material.gent import Gent
from isorod.material.holzapfel_gasser_ogden import HolzapfelGasserOgden
from isorod.material.law import Material
from isorod.material.mooney_rivlin import MooneyRivlin
from isorod.material.muscle import Muscle
from isorod.material.ogden import Ogden
from isorod.material.orthotropic import Orthotropic
from isorod.material.orthotropic_kirchhoff import OrthotropicKirchhoff
from isorod.material.st_venant_kirchhoff import StVenantKirchhoff
from isorod.material.yeoh import Yeoh
from isorod.model import Model
from isorod.scenes.spring import Spring

E, NU = 2e4, 0.3
ROUNDS = 100
_AXES = (E, 0.5 * E, 0.3 * E), (0.2, 0.2, 0.2), (0.3 * E, 0.3 * E, 0.2 * E)


LAWS: dict[str, Callable[[], Material]] = {
    "LinearElastic": lambda: LinearElastic(E, NU),
    "StVenantKirchhoff": lambda: StVenantKirchhoff(E, NU),
    "Orthotropic": lambda: Orthotropic(*_AXES),
    "OrthotropicKirchhoff": lambda: OrthotropicKirchhoff(*_AXES),
    "Muscle": lambda: Muscle(E, NU, E, 0.3 * E, 0.5, 0.5),
    "MooneyRivlin": lambda: MooneyRivlin(0.3 * E, 0.1 * E, E),
    "Yeoh": lambda: Yeoh(0.4 * E, 0.01 * E, 0.01 * E, E),
    "Gent": lambda: Gent(0.8 * E, 50.0, E),
    "HolzapfelGasserOgden": lambda: HolzapfelGasserOgden(0.8 * E, 0.1 * E, 1.0, E),
    "Ogden": lambda: Ogden((0.4 * E, -0.1 * E), (2.0, -2.0), E),
}


def tangent(model: Model) -> Callable[[], object]:
    """Return what assembles a tangent of a model in a strained state."""
    assembler = Assembler(model)
    matrix = assembler.matrix()
    x = matrix.createVecRight()
    x.setArray(1e-4 * np.random.default_rng(0).normal(size=x.getSize()))
    return lambda: assembler.tangent(x, 1.0, matrix)


def forces(model: Model) -> Callable[[], object]:
    """Return what evaluates the internal forces of a model as an explicit step does."""
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

    built_in = model(NeoHookean(E, NU))
    beside = tangent(built_in), forces(built_in)
    print("law                      tangent  explicit forces  first process  next process")
    with tempfile.TemporaryDirectory() as folder:
        for name, law in LAWS.items():
            made = model(law())
            one, other = ratio(tangent(made), beside[0]), ratio(forces(made), beside[1])
            first, then = seconds(name, folder), seconds(name, folder)
            print(f"{name:24} {one:7.2f}  {other:15.2f}  {first:11.1f} s  {then:10.2f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(ending.run("comparisons.laws.cost", main))
