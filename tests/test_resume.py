"""Checkpoints: a run that was killed continues to the last bit.

Files that are not there, foreign, damaged or do not fit on the disk.
"""

import dataclasses
import errno
import os
import random
import signal
import stat
import subprocess
import sys
import time

import numpy as np
import pytest

from isorod import Body, Contact, InputError, Model, Muscle, NeoHookean, Plane, Space, Support, dynamics
from isorod.output import checkpoint

# A muscle that shortens, touches a plane and then another rod, with friction, and with a step that is the run's own
# choice: all there is of state.
SCRIPT = """
import sys
sys.path.insert(0, {folder!r})
from test_resume import run
run({file!r}, {resume})
"""
SETTINGS = {"end_time": 1.5, "outputs": 300, "damping": 0.5, "ramp": 0.3}
# Outputs as far apart, though the quotient is rounded otherwise.
SHORT = {"end_time": 0.145, "outputs": 29}
SIXTY = {"end_time": 0.3, "outputs": 60}


def model(penalty=200.0, friction=0.3, points=(3, 4), touched=2):
    from conftest import straight

    law = Muscle(100.0, 0.3, sigma_max=80.0, m1=35.0, m2=0.5, activation=1.0, fibre=(0.0, 0.0, 1.0))
    muscle = Space.paper(straight(4, height=4.0), elements=4, quadrature="auto")
    rod = straight(4, height=4.0)
    rod = dataclasses.replace(rod, control_points=rod.control_points + np.array([2.02, 0.0, 0.0]))
    other = Space.paper(rod, elements=2, quadrature="paper")
    supports = [Support.end(muscle, "start"), Support.end(other, "start", body=1)]
    plane = Plane((-1.02, 0.0, 0.0), (1.0, 0.0, 0.0))
    contacts = [Contact(0, one, penalty, friction=friction, points=points) for one in (1, plane)[:touched]]
    return Model([Body(muscle, law, 2.0), Body(other, NeoHookean(50.0, 0.3), 2.0)], supports, contacts=contacts)


def run(file, resume=True, **changed):
    return dynamics.solve(
        changed.pop("model", None) or model(), checkpoint=file, every=0.0, resume=resume, **(SETTINGS | changed)
    )


def assert_same(first, second):
    """To the last bit."""
    for name in (
        "times",
        "displacement",
        "velocity",
        "reactions",
        "contact_force",
        "contact_area",
        "dissipated",
        "energy_error",
        "estimates",
    ):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name), name)
    assert first.steps == second.steps and first.time_step == second.time_step


@pytest.fixture(scope="module")
def whole():
    """The run as it is when nothing happens to it."""
    return dynamics.solve(model(), **SETTINGS)


def test_the_run_has_all_there_is_of_state(whole):
    assert whole.contact_force.max() > 0.0
    assert whole.muscle_work[-1] > 0.0
    assert whole.dissipated[-1] > 1e-4 * whole.muscle_work[-1]
    assert len(whole.estimates) > 2
    assert np.abs(whole.energy_error).max() < 1e-2


def test_a_killed_run_continues_to_the_last_bit(whole, tmp_path):
    """Killed without warning twice, at random."""
    file = tmp_path / "state"
    chance = random.Random(1)
    folder = os.path.dirname(__file__)
    script = SCRIPT.format(folder=folder, file=str(file), resume="{resume}")
    reached = []
    for attempt in range(2):
        code = script.format(resume=attempt > 0)
        process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE)
        before = file.stat().st_mtime_ns if file.exists() else 0
        while process.poll() is None and (not file.exists() or file.stat().st_mtime_ns == before):
            time.sleep(0.001)
        time.sleep(0.2 * chance.random())
        process.send_signal(signal.SIGKILL)
        _, said = process.communicate()
        assert process.returncode == -signal.SIGKILL, said.decode()
        # Nothing half-written took the file's name, and what was beside it does no harm.
        reached.append(int(checkpoint._load(file)[1]["counts"][0]))
    print("killed at outputs", reached)
    assert 0 < reached[-1] < SETTINGS["outputs"]
    history = run(file, True)
    assert history.resumed == reached[-1] * (SETTINGS["end_time"] / SETTINGS["outputs"])
    assert_same(history, whole)
    # A finished run has nothing left to do.
    again = run(file, True)
    assert_same(again, whole)
    assert again.microseconds_a_step == 0.0


def stop_after(outputs, monkeypatch):
    """Let the run end with an error once so many checkpoints were written."""
    true, count = checkpoint.write, [0]

    def write(*arguments):
        true(*arguments)
        count[0] += 1
        if count[0] > outputs:
            raise KeyboardInterrupt

    monkeypatch.setattr(checkpoint, "write", write)


@pytest.fixture(scope="module")
def states(tmp_path_factory):
    """Checkpoints of a run that has ended before its activation is complete, and of one that was stopped after it."""
    files = [tmp_path_factory.mktemp("states") / name for name in ("finished", "stopped")]
    assert run(files[0], False, **SHORT).times[-1] < SETTINGS["ramp"]
    with pytest.MonkeyPatch.context() as patch:
        # After the ramp, where the critical step is not estimated at each output.
        stop_after(100, patch)
        with pytest.raises(KeyboardInterrupt):
            run(files[1], False)
    return {file.name: file.read_bytes() for file in files}


@pytest.fixture
def finished(states, tmp_path):
    (tmp_path / "state").write_bytes(states["finished"])
    return tmp_path / "state"


@pytest.fixture
def stopped(states, tmp_path):
    (tmp_path / "state").write_bytes(states["stopped"])
    return tmp_path / "state"


def test_a_finished_run_goes_on_to_a_later_end_as_if_it_had_not_stopped(finished, whole, tmp_path):
    """While the activation still grows, with times that rounding would set apart, and twice."""
    # What the run was told in between must not show either.
    again = run(finished, True, end_time=0.29, outputs=58)
    assert (again.resumed, again.times[-1]) == (0.145, 0.29)
    history = run(finished, True)
    assert history.resumed == 0.29
    assert_same(history, whole)
    # An end time that was computed is the same for all that.
    end = 0.1 + 0.1 + 0.1
    assert end != 0.3
    file = tmp_path / "other"
    run(file, False, **SHORT)
    assert_same(run(file, True, end_time=end, outputs=60), dynamics.solve(model(), **SETTINGS | SIXTY))


def test_an_unfinished_run_may_end_earlier_or_later(stopped, whole):
    early = run(stopped, True, end_time=0.55, outputs=110)
    assert np.array_equal(early.displacement, whole.displacement[:111])
    assert_same(run(stopped, True), whole)


def denser(body, density):
    other = model()
    bodies = list(other.bodies)
    bodies[body] = dataclasses.replace(bodies[body], density=density)
    return dataclasses.replace(other, bodies=bodies)


OTHERS = [
    *({"model": model(points=(4, 4))}, {"model": model(touched=1)}),
    *({"model": model(penalty=201.0)}, {"model": model(friction=0.31)}, {"velocity": np.full(model().dofs, 1e-3)}),
    *({"model": denser(*one)} for one in ((0, 2.1), (1, 2.1), (0, [2.0, 2.0, 2.0, 2.1]), (1, [2.1, 2.0]))),
]
UNLIKE = "^checkpoint .*state: output interval of the checkpoint is 0.005, requested "


@pytest.mark.parametrize(
    ("state", "changed", "message"),
    [
        ("stopped", {"resume": False}, "is of an unfinished run; continue it with --resume, or remove it"),
        ("finished", SHORT | {"resume": False}, "is of a finished run; remove it, name another file, or go on "),
        # It has 99 outputs.
        ("stopped", {"end_time": 0.4, "outputs": 80}, "has reached time 0.5, past the end time 0.4; take a later"),
        ("finished", {"end_time": 0.1, "outputs": 20}, "has reached time 0.145, past the end time 0.1; take a later"),
        ("finished", {"end_time": 1.5, "outputs": 29}, f"{UNLIKE}{1.5 / 29:.6g}; use 300 outputs to time 1.5$"),
        ("finished", {"end_time": 0.2012, "outputs": 41}, f"{UNLIKE}{0.2012 / 41:.6g}; use 40 outputs to time 0.2$"),
        ("finished", {"ramp": 0.6}, "belongs to another run: ramp 0.3 there, 0.6 here"),
        ("stopped", {"damping": 0.6}, "belongs to another run: damping 0.5 there, 0.6 here"),
        ("stopped", {"time_step": 0.001}, "belongs to another run: time step None there, 0.001 here"),
        *(("stopped", changed, "belongs to another model") for changed in OTHERS),
    ],
)
def test_what_does_not_fit_a_checkpoint_is_refused(state, changed, message, request):
    file = request.getfixturevalue(state)
    before = file.read_bytes()
    with pytest.raises(InputError, match=message):
        run(file, **changed)
    assert file.read_bytes() == before


def test_a_damaged_checkpoint_is_refused(stopped):
    content = stopped.read_bytes()
    chance = random.Random(2)
    for _ in range(40):
        damaged = bytearray(content)
        damaged[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
        stopped.write_bytes(damaged)
        with pytest.raises(InputError, match="is damaged or no checkpoint"):
            run(stopped, True)
    for wrong in (b"", content[:-1], content[: len(content) // 2], b"hello\n", content + b"x"):
        stopped.write_bytes(wrong)
        with pytest.raises(InputError, match="is damaged or no checkpoint"):
            run(stopped, True)
        with pytest.raises(InputError, match="is damaged or no checkpoint"):
            run(stopped, False)


@pytest.mark.parametrize(
    ("place", "resume", "message"),
    [
        ("state", True, "state: there is none; start without --resume"),
        ("nowhere/state", False, r"/nowhere/state: cannot be written \(No such file or directory\); name another"),
        ("x" * 300, False, r"cannot be written \(File name too long\); name another"),
        ("x" * 300, True, r"cannot be read \(File name too long\)"),
        # A device would be read for ever.
        *((place, resume, "is no file; name another") for place in (".", "/", "/dev/full") for resume in (False, True)),
    ],
)
def test_a_place_that_will_not_do_is_known_before_the_first_step(place, resume, message, tmp_path):
    with pytest.raises(InputError, match=f"^checkpoint .*{message}"):
        run(tmp_path / place, resume)


def test_a_full_disk_leaves_the_last_checkpoint(tmp_path, monkeypatch, whole):
    """The disk is full at the tenth checkpoint: one line says so, and the ninth is good to continue from."""
    file = tmp_path / "state"
    true, count = os.fsync, [0]

    def fsync(descriptor):
        count[0] += stat.S_ISREG(os.fstat(descriptor).st_mode)
        if count[0] == 10:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        true(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fsync)
        with pytest.raises(
            InputError, match=r"^checkpoint .*state: cannot be written \(No space left on device\); make room[^\n]*$"
        ):
            run(file, False)
    assert [path.name for path in tmp_path.iterdir()] == ["state"]
    assert int(checkpoint._load(file)[1]["counts"][0]) == 8
    assert_same(run(file, True), whole)


def test_two_runs_do_not_keep_their_state_in_one_file(tmp_path):
    file = tmp_path / "state"
    claim = checkpoint.Claim(file)
    for resume in (False, True):
        with pytest.raises(
            InputError, match=f"^checkpoint {file}: another run keeps its state there; name another file$"
        ):
            run(file, resume, **SHORT)
    claim.release()
    # A lock that a killed run has left is none.
    (tmp_path / ".state.lock").touch()
    run(file, False, **SHORT)
    assert [one.name for one in tmp_path.iterdir()] == ["state"]


def test_who_waits_for_a_lock_that_is_taken_away_has_the_next(tmp_path, monkeypatch):
    true, calls = checkpoint.fcntl.flock, []

    def late(file, kind):
        if not calls:
            (tmp_path / ".state.lock").unlink()
        calls.append(file)
        return true(file, kind)

    monkeypatch.setattr(checkpoint.fcntl, "flock", late)
    claim = checkpoint.Claim(tmp_path / "state")
    assert len(calls) == 2
    with pytest.raises(InputError, match="another run"):
        checkpoint.Claim(tmp_path / "state")
    claim.release()
