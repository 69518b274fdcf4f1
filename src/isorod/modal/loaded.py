"""What loads a model, and the equilibrium about which its modes are."""

import warnings

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.material.thermal import Thermal, bare
from isorod.model.load import Pressure
from isorod.model.model import Model
from isorod.statics import analysis, stability
from isorod.statics.analysis import Equilibrium


def burdens(model: Model) -> str:
    """Return a text that names what moves a model from its state of rest; empty if nothing does."""
    following = [load for load in model.following if not isinstance(load, Pressure) or load.pressure]
    loads = len(model.loads) if following or model.external.any() else 0
    moved = sum(bool(one.path.any() or (one.turn.any() and one.arms.any())) for one in model.motions)
    moved += sum(bool((one.directions @ np.array(one.displacement)).any()) for one in model.means.values())
    laws = [law for body in model.bodies for law in body.laws]
    heated = any(isinstance(law, Thermal) and law.heated for law in laws)
    grown = [law for law in map(bare, laws) if not law.timed and law.at(0.5) is not law]
    muscles = any(np.any(getattr(law, "activation", 1.0)) for law in grown)
    parts = [
        _count(loads, "load"),
        _count(moved, "moved support"),
        "spin" if spins(model) else "",
        _count(len(model.contacts), "contact"),
        "active muscles" if muscles else "",
        "a change of temperature" if heated else "",
    ]
    words = [one for one in parts if one]
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def spins(model: Model) -> bool:
    """Return whether a model turns."""
    return model.spin is not None and any(model.spin.velocity)


def state_of(model: Model, state: Equilibrium | None) -> str:
    """Return a text that names the state about which modes are."""
    under = burdens(model)
    if state is None:
        return "the state of rest" + (f", without {under}" if under else "")
    when = "" if model.times is None else f" at time {model.times.end:.6g}"
    elastic = ", elastic from there: nothing flows" if model.remembers else ""
    if not under:
        return f"an equilibrium without loads{when}{elastic}"
    pressed = sum(one.active for one in state.contacts)
    touching = f" with {_count(pressed, 'point') or 'no point'} in contact" if model.contacts else ""
    turning = ", in the frame that turns" if spins(model) else ""
    return f"the equilibrium under {under}{touching}{when}{turning}{elastic}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}" if number else ""


def find(
    model: Model,
    load_steps: int | None,
    comm: PETSc.Comm | None = None,
    start: Array | None = None,
    end_time: float | None = None,
) -> Equilibrium | None:
    """Return the equilibrium of a model, None if nothing moves it from rest (`burdens`).

    PETSc's options act on it as on `isorod.statics.solve`.

    Raises
    ------
    InputError, SolveError
        If modes about it are not available (`refuse`), or it does not converge.
    """
    if not burdens(model):
        return None
    refuse(model)
    with warnings.catch_warnings():
        # Reactions are not reported here.
        warnings.filterwarnings("ignore", "support reactions are at round-off level")
        return analysis.solve(model, load_steps, comm, start=start, end_time=end_time)


def refuse(model: Model, advice: str = "or use modes of the undeformed state (at_rest)") -> None:
    """Raise `InputError` if the tangent about an equilibrium is not that of small motions; the text ends in ``advice``.

    A linear elastic body has no geometric stiffness.  The load stiffness of a follower pressure is made symmetric,
    which is right unless the surface has edges at free ends.
    """
    laws = [(f"body {b}", law) for b, body in enumerate(model.bodies) for law in body.laws]
    laws += [(f"solid {k}", solid.law) for k, solid in enumerate(model.solids) if solid.law is not None]
    for name, law in laws:
        if law.linear:
            raise InputError(
                f"equilibrium: {name} is linear elastic, without geometric stiffness; use NeoHookean, {advice}"
            )
    for k, load in enumerate(model.loads):
        if load not in model.following:
            continue
        if not isinstance(load, Pressure):
            raise InputError(
                f"load {k}: a moment that stays the same in space has no potential, nor its tangent real modes for "
                f"certain; give a couple of forces, or a support that turns, {advice}"
            )
        if not stability.pressed_by_potential(model, load):
            raise InputError(
                f"equilibrium: the load stiffness of the follower pressure on body {load.body} is symmetric only if "
                f"both ends are supported, or guided in a plane; support both, leave out 'follows', {advice}"
            )
