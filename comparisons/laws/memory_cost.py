"""The cost of laws with memory: steps of motions and tangents of a bar relative to the same bar of neo-Hooke.

``python -m comparisons.laws.memory_cost`` prints processor times in turn in one process.  A step is all of an explicit
one, of a copper bar that is pulled by a uniform rate, or hits a wall at 60 m/s and is crushed there to p = 2.  All have
the same points of quadrature: those of metal, 12 along the radius.
"""

import sys
from collections.abc import Callable
from time import process_time

import numpy as np

from isorod import Body, Model, Space, Support, circle, straight
from isorod.assembly.assembler import Assembler
from isorod.command import ending
from isorod.dynamics.explicit.step_kernel import DONE, Course
from isorod.dynamics.explicit.system import System
from isorod.errors import SolveError
from isorod.material import NeoHookean
from isorod.material.law import Material
from isorod.material.plastic import Plastic, Viscoplastic
from isorod.material.viscous import Creep, Viscoelastic

# Copper in N, mm, t; the bar, its speed, and the pull in which flow has begun.
E, NU, RHO = 117e3, 0.35, 8.93e-9
LENGTH, RADIUS, SPEED, RATE, PULLED = 32.4, 3.2, 60e3, 190e3, 6e-3
STEPS, ROUNDS = 200, 7
_TABLE = [[0.0, 400.0], [1.0, 1400.0]]

LAWS: dict[str, Callable[[], Material]] = {
    "NeoHookean": lambda: NeoHookean(E, NU),
    "Plastic, elastic": lambda: Plastic(E, NU, [[0.0, 1e5]]),
    "Plastic": lambda: Plastic(E, NU, _TABLE),
    "Plastic, recovery": lambda: Plastic(E, NU, _TABLE, 1e3, 20.0),
    "Viscoplastic": lambda: Viscoplastic(E, NU, _TABLE, A=1e4, n=5.0),
    "Viscoelastic, 1 row": lambda: Viscoelastic(E, NU, [[0.5, 1e-5]]),
    "Viscoelastic, 2 rows": lambda: Viscoelastic(E, NU, [[0.3, 1e-5], [0.3, 1e-4]]),
    "Creep": lambda: Creep(E, NU, 1e-9, 3.0),
}


def bar(law: Material) -> Model:
    """Return the bar, held at one end."""
    space = Space(
        straight(LENGTH).sweep(circle(8, RADIUS)), section_degree=3, elements=16, degree=3, quadrature="12x4x6"
    )
    return Model([Body(space, law, RHO)], [Support.end(space, "start")])


class Motion:
    """A bar in explicit steps, which begins anew each time it is called; ``speed`` is that of the hit, or 0."""

    def __init__(self, law: Material, speed: float) -> None:
        self.system = System(bar(law).in_motion("explicit"), explicit=True)
        along = self.system.model.bodies[0].space.positions * [0.0, 0.0, 1.0]
        self.start, self.velocity = np.zeros(self.system.model.dofs), np.zeros(self.system.model.dofs)
        if speed:
            self.velocity[self.system.order] = np.broadcast_to([0.0, 0.0, -speed], along.shape).ravel()
        else:
            self.start[self.system.order] = PULLED * along.ravel()
            self.velocity[self.system.order] = RATE / LENGTH * along.ravel()
        self.step = 0.35 * self.system.critical_step(np.zeros(self.start.size), 1.0)

    def __call__(self) -> float:
        """Return the processor time of a step."""
        system, state = self.system, self.system.state
        state.displacement[:], state.velocity[:] = self.start, self.velocity
        system.settle()
        if system.model.remembers:
            system.mesh.fibres[:] = 0.0
        begin = process_time()
        taken, outcome = system.advance(Course(0.0, self.step, 0.0, 0.0, np.inf), 0, STEPS)
        if outcome != DONE:
            raise SolveError(f"step {taken}: outcome {outcome}")
        return (process_time() - begin) / STEPS


class Tangent:
    """The tangent of a bar that is pulled, as a step of statics assembles it."""

    def __init__(self, law: Material) -> None:
        model = bar(law)
        self.assembler = Assembler(model)
        self.matrix = self.assembler.matrix()
        self.x = self.matrix.createVecRight()
        pulled = PULLED * (model.bodies[0].space.positions * [0.0, 0.0, 1.0]).ravel()
        self.x.setArray(pulled[model.free >= 0])

    def __call__(self) -> float:
        """Return the processor time of a tangent."""
        begin = process_time()
        self.assembler.tangent(self.x, 1.0, self.matrix)
        return process_time() - begin


def ratios(works: dict[str, Callable[[], float]]) -> dict[str, float]:
    """Return the least times of works in turn, by that of the first."""
    times = {name: [work() for _ in range(2)][1:] for name, work in works.items()}
    for _ in range(ROUNDS):
        for name, work in works.items():
            times[name].append(work())
    least = {name: min(values) for name, values in times.items()}
    return {name: time / least["NeoHookean"] for name, time in least.items()}


def main() -> int:
    """Print the table."""
    pulled = ratios({name: Motion(law(), 0.0) for name, law in LAWS.items()})
    hit = ratios({name: Motion(law(), SPEED) for name, law in LAWS.items() if name != "Plastic, elastic"})
    tangents = ratios({name: Tangent(law()) for name, law in LAWS.items()})
    print(f"{'law':22} step, pulled  step, hit  tangent")
    for name, value in pulled.items():
        struck = f"{hit[name]:9.2f}" if name in hit else " " * 9
        print(f"{name:22} {value:12.2f}  {struck}  {tangents[name]:7.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(ending.run("comparisons.laws.memory_cost", main))
