"""Choice of the time integration where a file names none: explicit where waves need steps as short anyway."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from isorod.errors import InputError, SolveError

if TYPE_CHECKING:
    from isorod.dynamics.history import History
    from isorod.model.mean import MeanSupport
    from isorod.model.model import Model
    from isorod.model.support import Support

# An implicit step takes as long as so many explicit ones: 340 with two iterations, of bars of 10 and of 80 elements.
_COST = 300.0

# Steps in an interval of a table, at least; modes computed; the target of the error, and its limit;
# attempts with shorter implicit steps.
_IN_AN_INTERVAL, _MODES, _AIM, _LARGE, _ATTEMPTS = 5, 8, 0.002, 0.005, 4

# A frequency below this fraction of the largest is that of a rigid motion.
_RIGID = 1e-4


class Steps(NamedTuple):
    """The steps of a motion: ``time_step`` is None where it is the critical one; ``why`` in words."""

    integrator: str
    time_step: float | None
    why: str


def are_open(scene: Any, settings: Mapping[str, Any]) -> bool:
    """Return whether the steps of a scene's motion are to be chosen: a file names no time step, and not explicit ones.

    Runs with a checkpoint go on with the steps that it was written with, so that these are to be named.
    """
    return (
        scene.analysis == "dynamics"
        and bool(scene.content)
        and settings.get("time_step") is None
        and settings.get("integrator") != "explicit"
        and settings.get("checkpoint") is None
    )


def solve(model: "Model", **settings: Any) -> "History":
    """Return a motion with steps that are chosen, implicit ones shorter where they turn out to be off by 0.5 %."""
    from isorod import dynamics

    known = settings.pop("integrator", None)
    steps = _choose(model, settings["end_time"], settings.get("outputs", 50), known)
    step = steps.time_step
    for attempt in range(_ATTEMPTS):
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            history = dynamics.solve(model, **settings | {"time_step": step, "integrator": steps.integrator})
        error = history.time_error
        if error is None or step is None or error <= _LARGE or attempt == _ATTEMPTS - 1:
            break
        # Errors are of second order in the step, where they are small.
        step = 0.5 * step if error > 0.1 else step * float(np.sqrt(0.5 * _LARGE / error))
    for warning in warned:
        warnings.warn(warning.message, warning.category, stacklevel=3)
    history.solver["steps"] = f"{steps.integrator}, of {history.time_step:.3g}, chosen: {steps.why}"
    return history


def _choose(model: "Model", end_time: float, outputs: int, known: str | None) -> Steps:
    """Return the steps that are right for a motion.

    Implicit steps follow the lowest frequency to the end (the displacement is off by ``w T (w dt)^2 / 12``), and a
    interval of a table in some steps; explicit ones are taken where these would not be longer than ``_COST`` of theirs,
    and where bodies touch: impacts are waves.
    """
    if known is not None:
        return implicit(model, end_time, outputs, "they follow the lowest frequency and the tables")
    if model.solids:
        return implicit(model, end_time, outputs, "finite element bodies take no explicit steps")
    if model.contacts:
        return Steps("explicit", None, "bodies may hit each other, which sends waves")
    from petsc4py import PETSc

    from isorod.dynamics.explicit.system import System

    try:
        system = System(model.in_motion("explicit"), PETSc.COMM_WORLD)
        critical = system.critical_step(np.zeros(model.dofs), 1.0)
    except InputError as problem:
        return implicit(model, end_time, outputs, f"explicit steps do not take this ({problem})")
    steps = implicit(model, end_time, outputs, "")
    assert steps.time_step is not None
    longer = f"steps of {steps.time_step:.3g} follow the lowest frequency and the tables, {critical:.3g} is critical"
    if steps.time_step < _COST * critical:
        return Steps("explicit", None, longer)
    return steps._replace(why=longer)


def implicit(model: "Model", end_time: float, outputs: int, why: str) -> Steps:
    """Return implicit steps that are right for a motion."""
    from isorod.model.history import TimeTable

    tables = [one.history for one in (*model.supports, *model.loads) if isinstance(one.history, TimeTable)]
    intervals = [
        gap / _IN_AN_INTERVAL
        for table in tables
        for gap in np.diff([time for time in table.times if time <= end_time])
        if gap > 0.0
    ]
    step = min([end_time / outputs, *intervals])
    lowest = _lowest(model)
    if lowest is not None:
        step = min(step, float(np.sqrt(12.0 * _AIM / max(lowest * end_time, 1.0)) / lowest))
    return Steps("implicit", step, why)


def _lowest(model: "Model") -> float | None:
    """Return the lowest angular frequency of a model at rest except rigid motions; None if there is none."""
    from isorod import modal

    bodies = [replace(one, velocity=(0.0,) * 3, spin=(0.0,) * 3, spin_center=None) for one in model.bodies]
    still = replace(model, bodies=bodies, supports=_stilled(model.supports), loads=(), contacts=())
    try:
        modes = modal.solve(still, _MODES, at_rest=True)
    except (InputError, SolveError):
        return None
    frequencies = np.asarray(modes.frequencies)
    elastic = frequencies[frequencies > _RIGID * frequencies.max(initial=0.0)]
    return float(2.0 * np.pi * elastic.min()) if elastic.size else None


def _stilled(supports: "Sequence[Support | MeanSupport]") -> "list[Support | MeanSupport]":
    from isorod.model.mean import MeanSupport

    nothing = (0.0, 0.0, 0.0)
    return [
        replace(one, displacement=nothing, history=None)
        if isinstance(one, MeanSupport)
        else replace(one, displacement=nothing, turn=nothing, spin=nothing, history=None)
        for one in supports
    ]
