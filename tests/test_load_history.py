"""Histories in statics: every load at its own table's value, kinks are met, what goes and comes back leaves nothing."""

import warnings
from importlib import resources

import numpy as np
import pytest
from refused import refused

from isorod import (
    Body,
    BodyForce,
    Contact,
    MeanSupport,
    Model,
    NeoHookean,
    ObstacleMotion,
    Plane,
    Pressure,
    SectionLoad,
    Space,
    Spin,
    Support,
    Thermal,
    buckling,
    circle,
    dynamics,
    modal,
    statics,
    straight,
)
from isorod.files.scene import FileScene
from isorod.model.history import TimeTable
from isorod.model.times import until
from isorod.statics import continuation

E, NU, RADIUS, LENGTH = 100.0, 0.3, 0.1, 1.0
AREA = np.pi * RADIUS**2
UP_AND_BACK = [[0, 0], [1, 1], [2, 1], [3, 0]]
LATER = [[0, 0], [1, 0], [2, 1], [3, 0]]


def bar(loads=(), supports=(), law=None, spin=None, **more):
    """A bar along z, held at its start, with loads made for its space."""
    space = Space(straight(LENGTH).sweep(circle(8, RADIUS)), elements=2, degree=2, continuity=1, section_degree=2)
    body = Body(space, law or NeoHookean(E=E, nu=NU), density=3.0, **more)
    held = [Support.end(space, "start"), *(one(space) for one in supports)]
    return Model([body], held, spin, loads=[one(space) for one in loads])


def pull(force, history=None):
    return lambda space: SectionLoad.end(space, "end", force, history=history)


STRETCH, BEND = (0.0, 0.0, 0.02 * E * AREA), (2e-4, 0.0, 0.0)


def test_two_loads_in_turn_are_at_each_time_what_both_are_at_once_and_leave_nothing():
    model = bar([pull(STRETCH, UP_AND_BACK), pull(BEND, LATER)])
    found = statics.solve(model, end_time=3.0, keep=True)
    times = [time for time, _ in found.frames()]
    assert times == [1.0, 2.0, 3.0] == found.curves()["time"][1:].tolist()
    for (_, state), shares in zip(found.frames(), ((1.0, 0.0), (1.0, 1.0)), strict=False):
        both = [tuple(share * x for x in force) for share, force in zip(shares, (STRETCH, BEND), strict=True)]
        alone = statics.solve(bar(map(pull, both)))
        assert state.displacement == pytest.approx(alone.displacement, abs=1e-9)
        assert state.reactions == pytest.approx(alone.reactions, abs=1e-9)
    assert np.abs(found.displacement).max() < 1e-13
    assert np.abs(found.reactions).max() < 1e-13
    # Its error is that of the state that stores most.
    assert found.largest.model.times.end == 2.0
    assert found.estimate() == pytest.approx(alone.estimate(), rel=1e-6)


@pytest.mark.parametrize(
    "made",
    [
        lambda share: bar([lambda s: Pressure(0.5 * share, follows=True)]),
        lambda share: bar([lambda s: BodyForce((0.0, 0.01 * share, 0.0))]),
        lambda share: bar(law=Thermal(NeoHookean(E=E, nu=NU), 1e-3, 20.0 * share)),
        lambda share: bar(spin=Spin((0.0, 0.3 * np.sqrt(share), 0.0))),
        lambda share: bar([pull((0.0, 1e-4 * share, 0.0))], law=NeoHookean(E=E, nu=0.4999)),
        lambda share: bar(supports=[lambda s: MeanSupport.end(s, "end", displacement=(0.0, 0.0, 0.02 * share))]),
        lambda share: bar(supports=[lambda s: Support.end(s, "end", turn=(0.0, 0.0, 1.2 * share))]),
    ],
    ids=["pressure", "body force", "temperature", "spin", "mixed", "mean support", "turn"],
)
def test_all_that_has_no_history_reaches_its_value_with_the_first_interval_and_keeps_it(made):
    model = made(1.0)
    loads = [*model.loads, SectionLoad((0.0, 0.0, 1e-9), 0.5, history=[[0, 0], [2, 0], [3, 1]])]
    found = statics.solve(Model(model.bodies, model.supports, model.spin, loads=loads), end_time=3.0, outputs=6)
    states = dict(found.frames())
    assert [*states] == pytest.approx([0.5, 1.0, 1.5, 2.0, 2.5, 3.0])
    half, whole = statics.solve(made(0.5)), statics.solve(model)
    for time, one in ((1.0, half), (2.0, whole), (3.0, whole)):
        assert states[time].displacement == pytest.approx(one.displacement, abs=1e-8)


def test_each_thing_follows_its_own_table():
    tables = {
        "load": [[0, 0], [1, 1], [4, -2]],
        "warm": [[0, 0], [3, 1.5], [4, 1.5]],
        "move": [[0, 0], [2, -1], [4, 1]],
    }
    law = Thermal(NeoHookean(E=E, nu=NU), 1e-3, 20.0, history=tables["warm"])
    space = bar().bodies[0].space
    end = Support.end(space, "end", "z", (0.0, 0.0, 0.01), history=tables["move"])
    push = BodyForce((0.01, 0.0, 0.0), history=tables["load"])
    model = Model([Body(space, law)], [Support.end(space, "start"), end], loads=[push])
    found = statics.solve(model, end_time=4.0, keep=True)
    states = dict(found.frames())
    assert {1.0, 2.0, 3.0, 4.0} <= {*states}
    for time, state in states.items():
        load, warm, move = (TimeTable.of(one).at(time) for one in tables.values())
        alone = Model(
            [Body(space, Thermal(law.law, 1e-3, 20.0 * warm))],
            [Support.end(space, "start"), Support.end(space, "end", "z", (0.0, 0.0, 0.01 * move))],
            loads=[BodyForce((0.01 * load, 0.0, 0.0))],
        )
        assert state.reactions == pytest.approx(statics.solve(alone).reactions, abs=1e-8)


def test_a_load_that_jumps_goes_over_it_in_steps_of_no_time():
    history = [[0, 1], [1, 1], [1, 2], [2, 0.5]]
    found = statics.solve(bar([pull(STRETCH, history)]), end_time=2.0, keep=True)
    curves = found.curves()
    assert curves["time"].tolist() == [0.0, 0.0, 1.0, 1.0, 2.0]
    assert -curves["support 0 force z"] == pytest.approx(STRETCH[2] * np.array([0.0, 1.0, 1.0, 2.0, 0.5]), rel=1e-8)


def test_load_steps_are_those_from_kink_to_kink_and_cut_steps_leave_no_trace():
    model = bar([pull(STRETCH, [[0, 0], [0.1, 1], [10, 0]])])
    found = statics.solve(model, end_time=10.0, load_steps=4, keep=True)
    gaps = np.diff(found.curves()["time"])
    assert gaps[0] == pytest.approx(0.025) and 0.1 in found.curves()["time"]
    # A bend so large that one step does not reach it.
    far = bar([pull((0.15, 0.0, 0.0), [[0, 0], [1, 1], [2, 0]])])
    cut = statics.solve(far, end_time=2.0, keep=True)
    fine = statics.solve(far, end_time=2.0, load_steps=8, keep=True)
    assert cut.cuts > fine.cuts
    there = [dict(one.frames())[1.0].displacement for one in (cut, fine)]
    assert there[0] == pytest.approx(there[1], abs=1e-7) and np.abs(cut.displacement).max() < 1e-9


def on_plane(end, friction=0.0, load_steps=2):
    """A bar over a plane that is pressed on it and, rubbing, drawn to and fro along it."""
    space = Space(straight(4.0).sweep(circle(8, 0.5)), elements=4, degree=2, section_degree=2)
    rows = [[0, 0, 0, 0], [1, 0, 0.02, 0], [2, 0, 0.02, 0.2], [4, 0, 0.02, -0.2], [6, 0, 0.02, 0.2], [7, 0, 0, 0.2]]
    plane = Plane((0.0, -0.5, 0.0), (0.0, 1.0, 0.0), motion=ObstacleMotion(move=rows))
    held = [Support.end(space, which) for which in ("start", "end")]
    contact = Contact(0, plane, friction=friction, first_elements=[1, 2])
    return statics.solve(
        Model([Body(space, NeoHookean(E=E, nu=NU))], held, contacts=[contact]), load_steps, end_time=end, keep=True
    )


def test_contact_that_opens_again_leaves_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = on_plane(7.0)
    pressed = [one.obstacles[0] for one in found.path]
    assert abs(pressed[1][1]) > 0.1 and np.abs(pressed[-1]).max() == 0.0
    assert np.abs(found.displacement).max() < 1e-10
    # No derivative goes along its path.
    assert not found.settlings
    # What slides without friction changes nothing, and contact is as tight in the middle as in the end.
    pushes = np.array([one.push for one in found.path])
    assert pushes[1:-2] == pytest.approx(pushes[-3], rel=2e-3)


def test_a_closed_loop_of_friction_has_the_area_of_what_slips():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = on_plane(6.0, 0.3)
    forces = np.array([one.obstacles[0] for one in found.path])
    times = found.curves()["time"][1:]
    way = np.interp(times, [0, 1, 2, 4, 6], [0, 0, 0.2, -0.2, 0.2])
    # All of it slides, as Coulomb says.
    slides = np.isin(times, [2.0, 4.0, 6.0])
    assert np.abs(forces[slides, 2]) == pytest.approx(0.3 * np.abs(forces[slides, 1]), rel=1e-7)
    assert forces[times == 6.0, 2] == pytest.approx(forces[times == 2.0, 2], rel=5e-3)
    # In a step with a reversal it slides as at the end, but for what the bar gives way elastically.
    loop = np.flatnonzero(times > 2.0)
    area = float(forces[loop, 2] @ (way[loop] - way[loop - 1]))
    assert area == pytest.approx(4.0 * 0.2 * 0.3 * np.abs(forces[-1, 1]), rel=0.01)


def test_modes_are_those_of_the_state_at_the_time():
    def pulled(share, history=None):
        return bar(supports=[lambda s: Support.end(s, "end", displacement=(0.0, 0.0, 0.05 * share), history=history)])

    model = pulled(1.0, [[0, 0], [1, 1], [2, 0.5]])
    for time, share in ((0.5, 0.5), (1.0, 1.0), (2.0, 0.5)):
        found = modal.solve(model, 3, end_time=time)
        assert found.frequencies == pytest.approx(modal.solve(pulled(share), 3).frequencies, rel=1e-8)
        assert f"at time {time:g}" in found.about
    state = statics.solve(model, end_time=2.0)
    assert modal.solve(model, 3, state=state).frequencies == pytest.approx(found.frequencies, rel=1e-8)
    spun = bar(spin=Spin((0.0, 0.0, 2.0), (-1.0, 0.0, 0.0), history=[[0, 0], [1, 0.25]]))
    slow = bar(spin=Spin((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)))
    assert modal.solve(spun, 3, end_time=1.0).frequencies == pytest.approx(modal.solve(slow, 3).frequencies, rel=1e-8)


TABLE = [[0, 0], [1, 1]]


def moved(**more):
    return bar(supports=[lambda s: Support.end(s, "end", displacement=(0.0, 0.0, 0.01), **more)])


test_what_makes_no_sense_is_refused = refused(
    (
        lambda: statics.solve(bar([pull(STRETCH, TABLE)]), end_time=2.0),
        "load 0: history: it ends at time 1, before end_time 2",
    ),
    (lambda: statics.solve(bar([pull(STRETCH, TABLE)])), "load 0: history: there is no time in statics without"),
    (lambda: buckling.solve(bar([pull(STRETCH, TABLE)])), "load 0: history: one factor multiplies all"),
    (lambda: modal.solve(bar([pull(STRETCH, TABLE)])), "load 0: history: there is no time in modal analysis without"),
    (lambda: statics.solve(moved(), end_time=-1.0), "end_time: got -1, need a positive time"),
    (lambda: statics.solve(moved(during=(0.0, 0.5)), end_time=1.0), "support 1: during: it is of load factors"),
    (
        lambda: statics.solve(bar(spin=Spin((0.0, 0.1, 0.0), history=[[0, 0], [1, -1]])), end_time=1.0),
        "spin: history: got a negative factor",
    ),
    (lambda: moved(history=[[0, 0], [2, 1], [1, 1]]), "history: times run back from 2 to 1"),
    (
        lambda: dynamics.solve(bar(law=Thermal(NeoHookean(E=E, nu=NU), 1e-3, 20.0, history=TABLE)), 1.0),
        "temperature history of body 0: motions have the temperature at once",
    ),
    (lambda: continuation.follow(bar([pull(STRETCH, TABLE)]), 0.1, 2), "load 0: history: one factor multiplies all"),
)


def test_times_that_are_but_rounding_apart_are_one():
    model = bar([pull(STRETCH, [[0, 0], [0.3, 1], [1, 1]]), pull(BEND, [[0, 0], [0.1 * 3, 1], [1, 1]])])
    timed = until(model, 1.0)
    assert timed.stages == [0.3, 1.0]
    assert [timed.times.time(place) for place in timed.stages] == [0.3, 1.0]
    assert timed.times.place(0.3) == 0.3 and timed.amplitude(None, 0.15) == pytest.approx(0.5)


def test_finite_element_bodies_go_along_and_are_kept_at_each_time(tmp_path):
    pytest.importorskip("dolfinx")
    examples = resources.files("isorod.files") / "examples"
    for name in ("tendon.toml", "tendon.msh", "tendon.step"):
        (tmp_path / name).write_bytes((examples / name).read_bytes())
    scene = FileScene(str(tmp_path / "tendon.toml"))
    there = statics.solve(scene.model())
    steps = "[[step]]\ntime = 1.0\nsupport.hand = 1.0\n[[step]]\ntime = 1.0\nunload = true\n"
    (tmp_path / "tendon.toml").write_text((tmp_path / "tendon.toml").read_text() + steps)
    scene = FileScene(str(tmp_path / "tendon.toml"))
    found = statics.solve(scene.model(), **scene.settings(), keep=True)
    (_, first), (_, last) = found.frames()
    assert first.solids[0] == pytest.approx(there.solids[0], abs=1e-9)
    assert np.abs(first.solids[0]).max() > 0.01 and np.abs(last.solids[0]).max() < 1e-12
    assert first.reactions == pytest.approx(there.reactions, rel=1e-8, abs=1e-8)
