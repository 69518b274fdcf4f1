"""Steps in time: explicit ones about the critical length and by the million, implicit ones, and where these pay."""

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np

from comparisons.stability.point import Sweep
from isorod import dynamics, modal
from isorod.arrays import Array
from isorod.dynamics.explicit.run import Run
from isorod.dynamics.explicit.system import System
from isorod.dynamics.run import Settings
from isorod.geometry.center_line import straight
from isorod.geometry.section import circle
from isorod.material import NeoHookean
from isorod.model import Body, Model, Support
from isorod.space import Space

TITLE = "steps in time, explicit and implicit"
COLUMNS = {
    "drift": "energy drift",
    "momentum": "momentum error",
    "newton": "Newton iterations a step",
    "explicit_steps": "explicit steps",
    "explicit_seconds": "explicit time (s)",
    "implicit_steps": "implicit steps",
    "implicit_seconds": "implicit time (s)",
}

# A bar of radius 1, held at its start, the first quarter of which may be a tendon; the wave speed is 7.
LENGTH, JOINT, E, DENSITY = 8.0, 2.0, 100.0, 2.0
# Random velocities of all control points: of strains that stay small, and so that some elements lose half their volume.
GENTLE, VIOLENT = 1e-3, 0.3
# How far the free end would swing if it went on swinging in the lowest mode, in lengths.
SWINGS = {"small": 1e-3, "large": 0.3}
TOLERANCE = 1e-3

# More steps are not tried for accuracy.
MOST = 4096

# Duration of the runs in different fractions of the critical step, in critical steps.
DURATION = 400

BALANCE = "energy at the start"
FRACTION = Sweep("time step / critical one", BALANCE, TOLERANCE)
LONG = Sweep("explicit steps taken, undamped", BALANCE, TOLERANCE)
LARGE = Sweep("implicit time step / critical one", BALANCE, TOLERANCE)
CONTRAST = Sweep("stiffness ratio of tendon and muscle", "the same in steps of half the length", TOLERANCE)


SERIES = "tendon clamped, muscle swinging, one period"


def run(level: str) -> Iterator[dict[str, Any]]:
    """Yield the points."""
    full = level != "quick"
    fractions = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.01, 1.05, 1.1)
    for series, size in (("explicit, all modes, small", GENTLE), ("explicit, all modes, violent", VIOLENT)):
        yield from FRACTION.over(fractions, _fraction, size, series=series)
    yield from _long(1_000_000 if full else 100_000)
    for series, size in (("implicit, all modes, small", GENTLE), ("implicit, all modes, violent", VIOLENT)):
        yield from LARGE.over((1.0, 10.0, 100.0, 1000.0), _large, size, 100 if full else 30, series=series)
    ratios = (1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6) if full else (1.0, 1e3, 1e6)
    yield from CONTRAST.over(ratios, _contrast, series=SERIES)


def _model(ratio: float = 1.0, elements: int = 4) -> Model:
    rod = straight(breaks=[0.0, JOINT, LENGTH], continuity=0).sweep(circle(8))
    space = Space.paper(rod, elements=elements, quadrature="auto")
    half = space.axis.elements // 2
    laws = [NeoHookean(ratio * E, 0.3)] * half + [NeoHookean(E, 0.3)] * half
    return Model([Body(space, laws, DENSITY)], [Support.end(space, "start")])


def _random(model: Model, size: float) -> Array:
    return size * np.random.default_rng(0).standard_normal(model.dofs)


def _swing(model: Model, size: float) -> tuple[Array, float]:
    """Return velocities of the lowest mode, of an amplitude of so many lengths, and its period."""
    solution = modal.solve(model, 1)
    frequency, shape = float(solution.frequencies[0]), solution.vectors[0]
    scale = 2.0 * np.pi * frequency * size * LENGTH / np.abs(_end(model, shape)).max()
    return scale * shape, 1.0 / frequency


def _end(model: Model, displacement: Array) -> Array:
    """Return the mean displacement of the free end."""
    space = model.bodies[0].space
    last = np.arange(space.nodes - space.layer_nodes, space.nodes)
    return np.asarray(model.nodal(displacement)[last[space.is_control_point[last]]].mean(axis=0))


def _critical(model: Model) -> float:
    return dynamics.solve(model, 1e-9, outputs=1).critical_step


class _Bold(Run):
    """Explicit steps that get no mass added for their length, and are not refused for it."""

    def _add_mass(self, critical: float) -> None:
        """Add none."""


def _fraction(fraction: float, size: float) -> dict[str, Any]:
    model = _model()
    step = fraction * _critical(model)
    steps = round(DURATION / 8 / fraction)
    motion = _Bold(System(model), Settings(8 * steps * step, 8, step))
    motion.begin(np.zeros(model.dofs), np.where(model.free >= 0, _random(model, size), 0.0))
    while motion.index < motion.outputs:
        motion.advance()
    return _balances(motion.rows)


def _balances(rows: Any) -> dict[str, Any]:
    return {
        "error": float(np.abs(rows["energy_error"]).max()),
        "momentum": float(np.abs(rows["momentum_error"]).max()),
    }


def _long(steps: int) -> Iterator[dict[str, Any]]:
    """Yield points of one run a series.

    The energy error up to so many steps, and its mean there less that at the start.
    """
    model = _model(elements=2)
    critical = _critical(model)
    for name, fraction in (("small", 0.9), ("large", 0.9), ("large", 0.5)):
        velocity, _ = _swing(model, SWINGS[name])

        @cache
        def errors(fraction: float = fraction, velocity: Array = velocity) -> Array:
            step = fraction * critical
            return dynamics.solve(model, steps * step, step, outputs=1000, velocity=velocity).energy_error

        def point(count: float, errors: Callable[[], Array] = errors) -> dict[str, Any]:
            here = errors()[: 1 + 1000 * int(count) // steps]
            tenth = max(1, here.size // 10)
            drift = float(abs(here[-tenth:].mean() - here[1 : tenth + 1].mean()))
            return {"error": float(np.abs(here).max()), "drift": drift}

        counts = [float(10**k) for k in range(3, 7) if 10**k <= steps]
        yield from LONG.over(counts, point, series=f"{name} swing, {fraction} critical steps")


def _large(steps: float, size: float, count: int) -> dict[str, Any]:
    model = _model()
    step = steps * _critical(model)
    motion = dynamics.solve(model, count * step, step, outputs=10, velocity=_random(model, size), integrator="implicit")
    rows = {"energy_error": motion.energy_error, "momentum_error": motion.momentum_error}
    return _balances(rows) | {"newton": motion.newton_iterations / motion.steps, "implicit_steps": motion.steps}


def _contrast(ratio: float) -> dict[str, Any]:
    model = _model(ratio)
    velocity, end_time = _swing(model, SWINGS["large"])

    def end(steps: int, integrator: str) -> tuple[Array, dynamics.History]:
        motion = dynamics.solve(model, end_time, end_time / steps, outputs=1, velocity=velocity, integrator=integrator)
        return _end(model, motion.displacement[-1]), motion

    def enough(steps: int, integrator: str) -> tuple[float, dynamics.History]:
        """Return the error and the run with the fewest steps that are enough, of those and 2, 4 ... times as many."""
        place, motion = end(steps, integrator)
        while True:
            finer, next_one = end(2 * steps, integrator)
            error = float(np.abs(finer - place).max() / (SWINGS["large"] * LENGTH))
            if error <= TOLERANCE or steps >= MOST:
                return error, motion
            steps, place, motion = 2 * steps, finer, next_one

    error, implicit = enough(64, "implicit")
    stable = int(np.ceil(end_time / (0.9 * _critical(model))))
    # So many steps that stability asks for are enough for accuracy.
    explicit_error, explicit = enough(stable, "explicit") if stable < MOST else (0.0, end(stable, "explicit")[1])
    return {
        "error": max(error, explicit_error),
        "explicit_steps": explicit.steps,
        "explicit_seconds": explicit.seconds["loop"],
        "implicit_steps": implicit.steps,
        "implicit_seconds": implicit.seconds["loop"],
        "newton": implicit.newton_iterations / implicit.steps,
    }
