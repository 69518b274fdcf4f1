"""Rods welded to rods in explicit steps: beside whole rods and implicit steps, ranks, contact, restarts, bad input."""

import numpy as np
import pytest
from motions import change_of_momenta
from mpi4py import MPI
from refused import refused
from test_ties import WELD, bar

from isorod import NeoHookean, dynamics
from isorod.assembly.constraints import Constraints
from isorod.model import Body, Contact, Model, Plane, Support
from isorod.model.tie import EndFace, LateralSurface, Tie

LAW = NeoHookean(10.0, 0.3)
KINDS = {"order": 2, "degree": 3, "continuity": 0}


def welded(held=True, contacts=(), ties=(WELD,)):
    """Return two bars end on end, and one as long with the same elements."""
    lower, upper = (bar(2.0, (0.0, 0.0, z), elements=2, **KINDS) for z in (0.0, 2.0))
    models = []
    for spaces, own in (([lower, upper], ties), ([bar(4.0, elements=4, **KINDS)], ())):
        met = [Contact(first=b, second=one) for one in contacts for b in range(len(spaces))]
        supports = [Support.end(spaces[0], "start")] if held else []
        models.append(Model([Body(space, LAW, 1.0) for space in spaces], supports, ties=own, contacts=met))
    return models


def velocity(model, spin=(0.1, 0.2, 0.3), ahead=(0.0, 0.0, 0.0)):
    spaces = [body.space for body in model.bodies]
    moving = [np.cross(spin, space.positions) + space.is_control_point[:, None] * np.array(ahead) for space in spaces]
    return np.concatenate(moving).ravel()


def ends(found):
    return np.array([state.at(len(found.model.bodies) - 1, "end") for state in found])


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize(("given", "near"), [({}, 1e-11), ({"damping": 0.2}, 1e-11), ({"time_step": 0.04}, 1e-6)])
def test_two_welded_bars_move_as_a_whole_one(held, given, near):
    pair, one = (dynamics.solve(model, 4.0, outputs=4, velocity=velocity(model), **given) for model in welded(held))
    # How much mass is added to a step that is longer than the critical one is known to a thousandth.
    assert (pair.added_kinetic_share > 0.0) == ("time_step" in given)
    assert ends(pair) == pytest.approx(ends(one), abs=near)
    assert pair.reactions == pytest.approx(one.reactions, abs=10.0 * near)
    assert pair.energy_error == pytest.approx(one.energy_error, abs=near)
    assert pair.momentum_error.max() < 1e-12


def test_bars_that_fly_keep_momentum_and_angular_momentum():
    model, _ = welded(held=False)
    found = dynamics.solve(model, 4.0, outputs=4, velocity=velocity(model, ahead=(0.1, -0.2, 0.3)))
    linear, angular, whole = change_of_momenta(found)
    # Angular momentum to second order in the step.
    assert linear < 1e-12 and angular < 1e-3 * whole


def joint(kind):
    """Return a T of two rods, held at both ends of the first, or two bars end on end with a tie that is no weld."""
    if kind == "flank":
        rail, post = bar(6.0, elements=4), bar(None, (1.0, 0.0, 3.0), end=(3.0, 0.0, 3.0), radius=0.5, elements=2)
        tie = Tie(EndFace(1, "start"), LateralSurface(0, (2.0, 4.0)), gap=0.5)
        supports = [Support.end(rail, end) for end in ("start", "end")]
        return Model([Body(one, LAW, 1.0) for one in (rail, post)], supports, ties=[tie])
    model, _ = welded(ties=[Tie(WELD.slave, WELD.master, kind=kind)])
    return model


@pytest.mark.parametrize("kind", [pytest.param("flank", marks=pytest.mark.slow), "slide", "mean"])
def test_other_ties_move_as_in_implicit_steps(kind):
    model = joint(kind)
    moving = velocity(model, spin=(0.05, 0.1, 0.02), ahead=(0.0, 0.0, -0.05))
    step = 0.01
    explicit, implicit = (
        dynamics.solve(model, 0.4, step, outputs=4, velocity=moving, integrator=integrator)
        for integrator in ("explicit", "implicit")
    )
    size = np.abs(implicit.displacement).max()
    assert np.abs(explicit.displacement - implicit.displacement).max() < 5e-3 * size
    assert np.abs(explicit.energy_error).max() < 1e-4
    assert explicit.momentum_error.max() < 1e-10
    ties, moved = Constraints(model), explicit.displacement[-1]
    assert np.abs(moved[ties.slaves] - ties.rows @ moved).max() < 1e-10 * size


def test_a_welded_bar_bounces_as_a_whole_one():
    floor = Plane((0.0, 0.0, -0.05), (0.0, 0.0, 1.0))
    pair, one = (
        dynamics.solve(model, 2.0, 0.01, outputs=8, velocity=velocity(model, (0.0, 0.0, 0.0), (0.0, 0.0, -0.2)))
        for model in welded(held=False, contacts=[floor])
    )
    assert one.contact_force.max() > 0.1
    assert pair.contact_force == pytest.approx(one.contact_force, abs=1e-8)
    assert ends(pair) == pytest.approx(ends(one), abs=1e-9)


def test_a_resumed_run_is_that_which_was_not_stopped(tmp_path):
    model, _ = welded()
    given = {"velocity": velocity(model), "checkpoint": tmp_path / "kept"}
    whole = dynamics.solve(model, 2.0, 0.02, outputs=4, velocity=velocity(model))
    dynamics.solve(model, 1.0, 0.02, outputs=2, **given)
    on = dynamics.solve(model, 2.0, 0.02, outputs=4, resume=True, **given)
    assert np.array_equal(on.displacement, whole.displacement) and np.array_equal(on.kinetic, whole.kinetic)
    with pytest.raises(ValueError, match="belongs to another model"):
        other = Model(model.bodies, model.supports, ties=[Tie(WELD.slave, WELD.master, kind="slide")])
        dynamics.solve(other, 2.0, 0.02, outputs=4, resume=True, **given)


def on_these_ranks(path):
    model, _ = welded()
    for name, given in (("plain", {}), ("added", {"time_step": 0.04})):
        found = dynamics.solve(model, 1.0, outputs=2, velocity=velocity(model), **given)
        if found.ranks == 1 or MPI.COMM_WORLD.rank == 0:
            np.savez(
                f"{path}.{name}.npz", **{one: getattr(found, one) for one in ("displacement", "reactions", "kinetic")}
            )


@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_ranks_move_as_one(ranks, on_ranks, tmp_path):
    on_these_ranks(tmp_path / "one")
    on_ranks(ranks, f"test_tie_explicit.on_these_ranks({str(tmp_path / 'all')!r})")
    for name in ("plain", "added"):
        one, several = (np.load(tmp_path / f"{file}.{name}.npz") for file in ("one", "all"))
        for key in one:
            assert several[key] == pytest.approx(one[key], abs=1e-10 * np.abs(one[key]).max()), (name, key)


def explicit(model):
    return lambda: dynamics.solve(model, 1.0)


def bonded():
    model, _ = welded(ties=[Tie(WELD.slave, WELD.master, kind="slide", bond=1.0)])
    return model


def held_master():
    model, _ = welded()
    held = Support.end(model.bodies[0].space, "end")
    return Model(model.bodies, [held], ties=[WELD])


test_what_explicit_steps_refuse = refused(
    (explicit(bonded()), "tie 0: bond: not supported by explicit steps; use integrator 'implicit'"),
    (explicit(held_master()), "tie 0: supports hold some of what the start of body 1 is tied to"),
)
