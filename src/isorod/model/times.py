"""Histories in statics: loads and supports along a load path from rest to an end time.

The path parameter runs from 0 to 1, as load factors do.  It is time over end time, except where a table jumps: a jump
takes a segment of the path at constant time, so that loads cross it in steps as they do elsewhere.  Each table becomes
one over the path, with the points of all tables.
"""

import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError, positive
from isorod.material.thermal import Thermal
from isorod.model.history import Times, TimeTable
from isorod.model.model import Model
from isorod.model.support import Support

# Times that differ by less than this fraction of the end time are the same.
_SAME = 1e-9


def until(model: Model, end_time: float) -> Model:
    """Return a model for statics up to an end time, with tables over the load path.

    What has no history reaches its full value at the first time in a table, and keeps it.

    Raises
    ------
    InputError
        If the time is not positive, a table or the motion of an obstacle does not reach it, or something moves by load
        factor or spins.
    """
    if model.times is not None:
        model = model.times.of
    positive("end_time", end_time, "a positive time")
    _refuse_by_factor(model)
    known = {name: TimeTable.of(one.history) for name, one in _several(model) if one.history is not None}
    tables = [*known.values()]
    for name, table in known.items():
        _refuse_short(f"{name}: history", table.times[-1] if len(table.times) > 1 else np.inf, end_time)
    tracks = {k: one.motion.track[:, 0] for k, one in enumerate(model.contacts) if one.motion and not one.motion.plain}
    for k, when in tracks.items():
        _refuse_short(f"contact {k}: motion of the obstacle", when[-1], end_time)
    kinks = _kinks([np.array(table.times) for table in tables] + [*tracks.values()], end_time)
    snapped = [_snapped(table, kinks) for table in tables]
    jumps = {float(time) for time in kinks if any(_jumps(table, time) for table in snapped)}
    times = np.repeat(kinks, [1 + (time in jumps) for time in kinks])
    early = np.append(np.diff(times) == 0.0, False)
    gaps = np.diff(times)
    lengths = np.where(gaps > 0.0, gaps, end_time / max(len(kinks) - 1, 1))
    path = np.append(0.0, np.cumsum(lengths)) / lengths.sum() if jumps else times / end_time
    path[-1] = 1.0
    ramp = TimeTable(tuple(path.tolist()), tuple(np.minimum(times / kinks[1], 1.0).tolist()))

    def over(history: Any) -> TimeTable:
        if history is None:
            return ramp
        table = _snapped(TimeTable.of(history), kinks)
        values = [table.at(time, before) for time, before in zip(times, early, strict=True)]
        # From rest on.
        return TimeTable(ramp.times, (0.0, *values[1:]))

    def timed(one: Any) -> Any:
        return replace(one, history=over(one.history)) if isinstance(one.history, TimeTable) else one

    def moved(one: Any) -> Any:
        if one.motion is None:
            return one
        track = one.motion.track
        when = np.array(ramp.factors) if one.motion.plain else times
        rows = np.column_stack([path, *(np.interp(when, track[:, 0], column) for column in track.T[1:])])
        motion = replace(one.motion, move=rows[:, :4], angle=rows[:, [0, 4]])
        return replace(one, second=replace(one.obstacle, motion=motion))

    with warnings.catch_warnings():
        # The model itself has given these warnings.
        warnings.simplefilter("ignore")
        return replace(
            model,
            bodies=[body.growing(lambda history: over(history).at) for body in model.bodies],
            supports=[timed(one) for one in model.supports],
            loads=[timed(one) for one in model.loads],
            spin=model.spin and timed(model.spin),
            contacts=[moved(one) for one in model.contacts],
            times=Times(path, times, ramp, model),
        )


def _several(model: Model) -> Iterator[tuple[str, Any]]:
    """Yield what may have a history, with its name in messages."""
    for kind, several in (("support", model.supports), ("load", model.loads)):
        yield from ((f"{kind} {k}", one) for k, one in enumerate(several))
    if model.spin is not None:
        yield "spin", model.spin
    for b, body in enumerate(model.bodies):
        yield from ((f"body {b}: temperature", law) for law in set(body.laws) if isinstance(law, Thermal))


def _refuse_short(what: str, last: float, end_time: float) -> None:
    if last < end_time * (1.0 - _SAME):
        raise InputError(
            f"{what}: it ends at time {last:g}, before end_time {end_time:g}; add a row for that time, the last value "
            "again if it stays"
        )


def _refuse_by_factor(model: Model) -> None:
    """Raise `InputError` for what is given by load factors, which do not go with an end time."""
    for k, one in enumerate(model.supports):
        if isinstance(one, Support) and tuple(one.during) != (0.0, 1.0):
            raise InputError(f"support {k}: during: it is of load factors, and end_time is given; give a history")
    for k, contact in enumerate(model.contacts):
        motion = contact.motion
        if motion is not None and motion.plain and max(len(np.asarray(motion.move)), len(np.asarray(motion.angle))) > 2:
            raise InputError(f"contact {k}: motion of the obstacle: give rows of time for both, move and angle")
    if model.spin is not None and isinstance(model.spin.history, TimeTable) and min(model.spin.history.factors) < 0.0:
        raise InputError("spin: history: got a negative factor of the centrifugal force; need none")


def _kinks(several: list[Array], end: float) -> Array:
    """Return the times from 0 to the end at which tables have points, merged where they differ by rounding."""
    times = np.unique(np.concatenate([np.array([0.0, end]), *several]))
    times = times[(times >= 0.0) & (times <= end)]
    kept = times[np.append(True, np.diff(times) > _SAME * end)]
    kept[-1] = end
    return np.asarray(kept)


def _snapped(table: TimeTable, kinks: Array) -> TimeTable:
    """Return a table whose points are moved to the kinks from which they differ by rounding."""
    times = np.array(table.times)
    near = kinks[np.abs(times[:, None] - kinks).argmin(axis=1)]
    snapped = np.where(np.abs(times - near) <= _SAME * kinks[-1], near, times)
    return TimeTable(tuple(snapped.tolist()), table.factors)


def _jumps(table: TimeTable, time: float) -> bool:
    """Return whether a table jumps at a time; at the start, whether it jumps from zero."""
    return table.at(time) != (table.at(time, True) if time > 0.0 else 0.0)
