"""Which steps a motion takes where none are named: explicit where waves ask for steps near the critical one anyway."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.dynamics.explicit.system import System
from isorod.errors import InputError, SolveError
from isorod.model.history import TimeTable
from isorod.model.mean import MeanSupport
from isorod.model.model import Model
from isorod.model.support import Support

# An implicit step takes as long as so many explicit ones, about: fifteen to sixty, of ten to a thousand elements.
_COST = 30.0

# Steps of a piece of a table, at least; modes whose frequency is asked for; the error aimed at.
_IN_A_PIECE, _MODES, _AIM = 5, 8, 0.002

# A frequency is one of a rigid motion below this share of the largest found.
_RIGID = 1e-4


class Choice(NamedTuple):
    """The steps of a motion: ``time_step`` is None where it is the critical one; ``why`` in words."""

    integrator: str
    time_step: float | None
    why: str


def choose(model: Model, end_time: float, outputs: int, comm: PETSc.Comm | None) -> Choice:
    """Return the steps that are right for a motion.

    Implicit steps follow the lowest frequency to the end (an amplitude is off by ``w T (w dt)^2 / 12``), and a piece of
    a table in some steps; explicit ones are taken where these would not be longer than ``_COST`` of theirs, and where
    bodies touch: impacts are waves.
    """
    if model.solids:
        return _implicit(model, end_time, outputs, comm, "finite element bodies take no explicit steps")
    if model.contacts:
        return Choice("explicit", None, "bodies may hit each other, which sends waves")
    try:
        moved = model.in_motion("explicit")
        critical = System(moved, PETSc.COMM_WORLD if comm is None else comm, True).critical_step(
            np.zeros(model.dofs), 1.0
        )
    except InputError as problem:
        return _implicit(model, end_time, outputs, comm, f"explicit steps do not take this ({problem})")
    wanted = _implicit(model, end_time, outputs, comm, "")
    assert wanted.time_step is not None
    longer = f"steps of {wanted.time_step:.3g} follow the lowest frequency and the tables, {critical:.3g} is critical"
    if wanted.time_step < _COST * critical:
        return Choice("explicit", None, longer)
    return wanted._replace(why=longer)


def _implicit(model: Model, end_time: float, outputs: int, comm: PETSc.Comm | None, why: str) -> Choice:
    tables = [one.history for one in (*model.supports, *model.loads) if isinstance(one.history, TimeTable)]
    pieces = [
        gap / _IN_A_PIECE
        for table in tables
        for gap in np.diff([time for time in table.times if time <= end_time])
        if gap > 0.0
    ]
    step = min([end_time / outputs, *pieces])
    lowest = _lowest(model, comm)
    if lowest is not None:
        step = min(step, float(np.sqrt(12.0 * _AIM / max(lowest * end_time, 1.0)) / lowest))
    return Choice("implicit", step, why)


def _lowest(model: Model, comm: PETSc.Comm | None) -> float | None:
    """Return the lowest angular frequency of a model at rest that is none of a rigid motion; None if none is found."""
    from isorod import modal

    bodies = [replace(one, velocity=(0.0,) * 3, spin=(0.0,) * 3, spin_center=None) for one in model.bodies]
    still = replace(model, bodies=bodies, supports=_stilled(model.supports), loads=(), contacts=())
    try:
        found = modal.solve(still, _MODES, at_rest=True, comm=comm)
    except (InputError, SolveError):
        return None
    frequencies = np.asarray(found.frequencies)
    elastic = frequencies[frequencies > _RIGID * frequencies.max(initial=0.0)]
    return float(2.0 * np.pi * elastic.min()) if elastic.size else None


def _stilled(supports: Sequence[Support | MeanSupport]) -> list[Support | MeanSupport]:
    nothing = (0.0, 0.0, 0.0)
    return [
        replace(one, displacement=nothing, history=None)
        if isinstance(one, MeanSupport)
        else replace(one, displacement=nothing, turn=nothing, spin=nothing, history=None)
        for one in supports
    ]
