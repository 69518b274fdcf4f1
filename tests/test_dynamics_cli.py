"""`isorod run` of a scene that asks for dynamics: the record, checkpoints, one-line errors, and what is not loaded."""

import json

import numpy as np
import pytest

SMALL = "run biceps --elements 5 --end-elements 0 --order 1 --end-time 0.004 --outputs 8".split()


def test_record_and_checkpoints_that_do_not_fit(isorod, command, tmp_path):
    file = str(tmp_path / "state")
    first = isorod(*SMALL, "--json", "--checkpoint", file, "--checkpoint-every", "0")
    assert first.returncode == 0, first.stderr
    # No progress bar where there is no terminal.
    assert first.stderr == ""
    record = json.loads(first.stdout)
    assert record["analysis"] == "dynamics"
    assert record["steps"] == 104 and record["time_step"] == pytest.approx(0.004 / 104)
    assert len(record["times"]) == len(record["kinetic"]) == len(record["contact_force"]) == 9
    assert np.shape(record["reactions"]) == (9, 4, 3)
    assert record["microseconds_a_step"] > 0.0
    assert np.abs(record["energy_error"]).max() < 1e-3
    assert np.abs(record["momentum_error"]).max() < 1e-10
    # No tangent.
    assert set(record["built"]) == {"mass", "contact"}
    # The text shows the last output.
    (force,) = [line.split()[2] for line in command.prints(*SMALL).splitlines() if line.startswith("contact force ")]
    assert float(force) == pytest.approx(record["contact_force"][-1], rel=1e-5)
    assert "other run: damping" in command.refuses(*SMALL, "--checkpoint", file, "--resume", "--damping", 1)
    assert "there is none; start without --resume" in command.refuses(*SMALL, "--checkpoint", file + "x", "--resume")


# The command in a process that dies, without a word, as the third output's checkpoint is on the disk.
DIES = """
import os, sys
from isorod.command import cli
from isorod.output import checkpoint
true, count = checkpoint.write, [0]

def write(*arguments):
    true(*arguments)
    count[0] += 1
    if count[0] == 4:
        os._exit(9)

checkpoint.write = write
cli.main(sys.argv[1:])
"""


def test_a_run_that_died_is_resumed_from_the_command_line(command, python, tmp_path):
    file = str(tmp_path / "state")
    whole = command.record(*SMALL)
    assert whole["resumed"] is None
    died = python(DIES, *SMALL, "--json", "--checkpoint", file, "--checkpoint-every", "0")
    assert (died.returncode, died.stdout) == (9, "")
    record = command.record(*SMALL, "--checkpoint", file, "--resume")
    # Neither from the start nor at the end already.
    assert 0.0 < record["resumed"] < 0.004
    for name in ("times", "reactions", "kinetic", "contact_force", "steps"):
        assert record[name] == whole[name], name


def test_a_finished_run_is_kept_and_goes_on_from_the_command_line(command, tmp_path):
    file = tmp_path / "state"
    keep = *SMALL, "--checkpoint", file
    first = command.record(*keep)
    before = file.read_bytes()
    said = "is of a finished run; remove it, name another file, or go on from it with --resume and a later"
    assert said in command.refuses(*keep)
    # The same run has nothing left to do and is shown again.
    again = command.record(*keep, "--resume")
    assert (again["resumed"], again["end_force"], again["steps"]) == (0.004, first["end_force"], 104)
    later = "--end-time", "0.006"
    said = "output interval of the checkpoint is 0.0005, requested 0.00075; use 12 outputs to time 0.006"
    assert said in command.refuses(*keep, "--resume", *later)
    assert file.read_bytes() == before
    later = *later, "--outputs", 12
    further, whole = command.record(*keep, "--resume", *later), command.record(*SMALL, *later)
    assert (further["resumed"], further["steps"]) == (0.004, 156)
    for name in ("times", "reactions", "kinetic", "contact_force", "energy_error", "belly_bulge_history"):
        assert further[name] == whole[name], name


def test_one_line_errors(command):
    assert "unstable, the critical time step is" in command.refuses(*SMALL, "--time-step", "1e-3")
    # What was typed, and what was made of it.
    said = command.refuses(*SMALL, "--time-step", "7e-3")
    assert "time step 0.007 (0.0005 taken, 1 to each of 8 outputs): unstable" in said
    assert "resume: got no checkpoint" in command.refuses(*SMALL, "--resume")
    assert "density" in command.refuses(*SMALL, "--density", 0)


@pytest.mark.slow
@pytest.mark.mpi
def test_another_number_of_ranks_resumes_a_run_and_all_complain_once(isorod, mpirun, tmp_path):
    file = str(tmp_path / "state")
    begun = mpirun(2, *SMALL, "--json", "--checkpoint", file)
    assert begun.returncode == 0, begun.stderr
    assert json.loads(begun.stdout)["ranks"] == 2
    longer = (*SMALL[:-4], "--end-time", "0.005", "--outputs", "10", "--json")
    resumed, whole = isorod(*longer, "--checkpoint", file, "--resume"), isorod(*longer)
    assert resumed.returncode == 0, resumed.stderr
    found, expected = (json.loads(done.stdout) for done in (resumed, whole))
    assert found["resumed"] == 0.004
    for name in ("reactions", "kinetic", "stored", "contact_force", "muscle_work"):
        one, other = np.array(found[name]), np.array(expected[name])
        assert np.abs(one - other).max() < 1e-10 * np.abs(other).max(), name
    again = mpirun(2, *SMALL, "--checkpoint", file)
    assert again.returncode != 0 and not again.stdout
    lines = [line for line in again.stderr.splitlines() if line.startswith("isorod:")]
    assert len(lines) == 1 and "is of a finished run" in lines[0]
    assert "Traceback" not in again.stderr


def test_a_model_without_contact_loads_none(python):
    script = """
import sys
from isorod import options
options.initialize([])
from isorod import dynamics
from isorod.material import NeoHookean
from isorod.model import Body, Model
from isorod.scenes.spring import Spring
from isorod.space import Space
space = Space.paper(Spring(helix="paper", coils=1, section_points=4).rod())
dynamics.solve(Model([Body(space, NeoHookean(1.0, 0.3), 1.0)]), 1e-3, outputs=1)
unwanted = ("isorod.contact", "isorod.dynamics.explicit.contact", "slepc4py")
print([name for name in sys.modules if name.startswith(unwanted)])
"""
    result = python(script)
    assert result.stdout.strip() == "[]", result.stderr
