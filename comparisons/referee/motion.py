"""Scenarios whose result is a motion, or that settle in contact: by implicit steps from where they start."""

from typing import Any

import numpy as np

import isorod
from comparisons.referee.rods import configuration, loads, place, supports
from comparisons.referee.touching import contacts
from isorod.arrays import Array

# Time steps, in units of the inverse of the scenario's slowest frequency: 5e-5 of its period in error; twice as long
# where the path to the equilibrium does not matter.
STEP, STEP_SETTLING = 0.016, 0.032


def step(scenario: Any, scale: float) -> float:
    """Return the largest time step."""
    return scale * (STEP_SETTLING if scenario.quasi_static else STEP) / scenario.slowest_frequency()


def damping(scenario: Any) -> float:
    """Return the damping, 1/time: critical for the slowest motion where the scenario leaves it free, else none."""
    return 2.0 * scenario.slowest_frequency() if scenario.quasi_static else 0.0


def solve(scenario: Any, elements: int, frames: int, touching: bool, scale: float) -> list[list[tuple[Array, Array]]]:
    """Return nodes and directors (`comparisons.referee.rods.configuration`) of each rod at each frame."""
    placed = [place(rod, elements, touching) for rod in scenario.rods]
    model = isorod.Model(
        [one.body for one in placed],
        [support for k, one in enumerate(placed) for support in supports(one, k)],
        loads=[load for k, one in enumerate(placed) for load in loads(one, scenario.gravity, k)],
        contacts=contacts(scenario, placed, elements) if touching else (),
    )
    history = isorod.dynamics.solve(
        model,
        scenario.duration,
        step(scenario, scale),
        outputs=frames - 1,
        damping=damping(scenario),
        displacement=np.concatenate([one.initial for one in placed]).ravel(),
        integrator="implicit",
    )
    return [[configuration(one, state, k, elements) for state in history] for k, one in enumerate(placed)]
