"""The solver as the package's entry point finds it (`pyproject.toml`)."""

from typing import Any, ClassVar

import numpy as np
from cosseratbench.scenario import Scenario
from cosseratbench.solver import Capability, Diverged
from cosseratbench.trajectory import Trajectory

import isorod
from comparisons.referee import equilibrium, laid, motion, touching, twisted
from comparisons.referee.rods import DEGREE, NEARLY

STATICS, TOUCHING = "statics", "statics with contact"


class Isorod:
    """isorod behind ``cosseratbench.solvers``: rods as continua, ``n_elements`` cubic elements along each.

    Parameters
    ----------
    time_step_scale
        Multiplies the time steps of scenarios that need some.
    """

    name: ClassVar[str] = "isorod"
    backend_version: ClassVar[str] = isorod.__version__
    # What a scenario asks beyond that `run` refuses.
    capabilities: ClassVar[frozenset[Capability]] = frozenset(
        {
            Capability.STRETCH,
            Capability.SHEAR,
            Capability.ROD_CONTACT,
            Capability.ROD_FRICTION,
            Capability.CYLINDER_CONTACT,
            Capability.PLANE_CONTACT,
        }
    )

    def __init__(self, time_step_scale: float = 1.0) -> None:
        self.scale = time_step_scale

    def settings(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> dict[str, Any]:
        """Return the numerical choices for a scenario."""
        kind = _kind(scenario, n_elements)
        settings = {"solution": kind, "degree": DEGREE, "poisson_ratio_at_most": 0.5 if kind == STATICS else NEARLY}
        if kind in (STATICS, TOUCHING):
            return settings
        steps = {"time_step": motion.step(scenario, self.scale), "damping_rate": motion.damping(scenario)}
        return settings | steps

    def run(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> Trajectory:
        """Return the trajectory of a scenario, an equilibrium's from its second frame on.

        Raises
        ------
        NotImplementedError
            If isorod lacks what the scenario needs, in one line.
        Diverged
            If there is no solution.
        """
        kind = _kind(scenario, n_elements)
        try:
            if kind in (STATICS, TOUCHING):
                last = (equilibrium if kind == STATICS else laid).solve(scenario, n_elements)
                starts = [(rod.nodes(n_elements), rod.directors(n_elements)) for rod in scenario.rods]
                frames = [[start] + [end] * (n_frames - 1) for start, end in zip(starts, last, strict=True)]
            elif kind == "statics, then implicit steps":
                frames = twisted.solve(scenario, n_elements, n_frames, self.scale)
            else:
                touches = kind == "implicit steps with contact"
                frames = motion.solve(scenario, n_elements, n_frames, touches, self.scale)
        except isorod.SolveError as problem:
            raise Diverged(str(problem)) from None
        times = np.linspace(0.0, scenario.duration, n_frames)
        nodes, directors = ([np.stack([frame[k] for frame in rod]) for rod in frames] for k in (0, 1))
        return Trajectory(times, tuple(nodes), tuple(directors))


def _kind(scenario: Scenario, elements: int) -> str:
    """Return how a scenario is solved."""
    if any(rod.start_motion is not None or rod.end_motion is not None for rod in scenario.rods):
        return "statics, then implicit steps"
    if laid.takes(scenario, elements):
        return TOUCHING
    if scenario.self_contact or scenario.obstacles or touching.pairs(scenario, elements):
        return "implicit steps with contact"
    return STATICS if scenario.quasi_static else "implicit steps"
