"""How commands end: Ctrl-C and SIGTERM in one line wherever they come, with what is to be kept; a full disk."""

import os
import re
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest
from test_resume import SETTINGS, assert_same, model, run

from isorod import dynamics, files
from isorod.command import ending
from isorod.dynamics.explicit import run as explicit
from isorod.dynamics.explicit.system import System
from isorod.dynamics.implicit.newton import Newton
from isorod.output import checkpoint

SIGNALS = pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
WORDS = {"SIGINT": "interrupted", "SIGTERM": "ended by SIGTERM"}
SMALL = ["run", "biceps", "--elements", "5", "--end-elements", "0", "--order", "1", "--section-points", "4"]


def start(*command: str, ignored: bool = False) -> subprocess.Popen:
    """Start Python with SIGINT as a terminal leaves it, whatever the caller ignores."""

    def prepare() -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN if ignored else signal.SIG_DFL)

    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, *command], stdout=pipe, stderr=pipe, text=True, preexec_fn=prepare)


def end(*command: str, **keywords) -> tuple[int, str, str]:
    """Run to the end; return exit code and what was said."""
    process = start(*command, **keywords)
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


@SIGNALS
def test_a_motion_that_is_stopped_keeps_its_checkpoint(name, code, tmp_path):
    file = tmp_path / "state"
    motion = [*SMALL, "--end-time", "50", "--outputs", "50000", "--checkpoint", str(file), "--checkpoint-every", "1e9"]
    process = start("-m", "isorod", *motion)
    while not file.exists() and process.poll() is None:
        time.sleep(0.01)
    time.sleep(0.5)
    process.send_signal(getattr(signal, name))
    begin = time.monotonic()
    out, err = process.communicate(timeout=60)
    assert time.monotonic() - begin < 5.0
    assert (process.returncode, out) == (code, "")
    said = re.fullmatch(
        rf"isorod: {WORDS[name]}; checkpoint {file} has time (\S+) of 50, --resume goes on from there\n", err
    )
    kept = checkpoint._load(file)[1]
    assert 0 < kept["counts"][0] < 50000 and not kept["finished"]
    assert float(said[1]) == pytest.approx(kept["counts"][0] * 1e-3, rel=1e-4)
    assert [one.name for one in tmp_path.iterdir()] == ["state"]


def test_one_long_interval_is_left_within_seconds():
    process = start("-m", "isorod", *SMALL, "--end-time", "50", "--outputs", "1")
    time.sleep(3.0)
    process.send_signal(signal.SIGINT)
    begin = time.monotonic()
    out, err = process.communicate(timeout=60)
    assert time.monotonic() - begin < 5.0
    assert (process.returncode, out) == (130, "")
    assert re.fullmatch(r"(isorod: time .*\n)*isorod: interrupted(; time .* is lost: it had no --checkpoint)?\n", err)


# Where Ctrl-C comes, in the course of an interval: before, amid and after its steps, and while it is recorded.
def _while(owner, method, at, before=None):
    """Return a method that is interrupted at its so manyth call, with some of it done."""
    true, calls = getattr(owner, method), [0]

    def interrupted(self, *arguments):
        calls[0] += 1
        if calls[0] == at:
            if before:
                before(true, self, *arguments)
            raise KeyboardInterrupt
        return true(self, *arguments)

    return interrupted


def _half_of_the_steps(true, system, course, first, last):
    true(system, course, first, (first + last) // 2)


def _half_of_the_record(true, motion, seen):
    true(motion, dict(list(seen.items())[:5]))


@pytest.mark.parametrize(
    ("owner", "method", "at", "before"),
    [
        (System, "advance", 15, _half_of_the_steps),
        (explicit.Run, "_record", 9, _half_of_the_record),
        (explicit.Run, "_watch", 9, lambda true, *arguments: true(*arguments)),
        (checkpoint, "write", 5, None),
    ],
    ids=["steps", "record", "watch", "checkpoint"],
)
def test_an_interval_that_is_interrupted_is_taken_again_to_the_last_bit(
    owner, method, at, before, tmp_path, monkeypatch
):
    whole = dynamics.solve(model(), **SETTINGS | {"outputs": 20})
    file = tmp_path / "state"
    with monkeypatch.context() as patch:
        # An interval is one block, two at most: the calls do not depend on how fast the machine is.
        patch.setattr(explicit, "_BLOCK", 60.0)
        patch.setattr(owner, method, _while(owner, method, at, before))
        with pytest.raises(KeyboardInterrupt) as stopped:
            run(file, False, outputs=20)
    assert re.fullmatch(rf"checkpoint {file} has time \S+ of 1.5, --resume goes on .*", stopped.value.__notes__[0])
    history = run(file, True, outputs=20)
    assert 0.0 < history.resumed < 1.5
    assert_same(history, whole)


def test_an_implicit_step_that_is_interrupted_is_taken_again(tmp_path, monkeypatch):
    settings = {"end_time": 0.2, "outputs": 4, "time_step": 0.01, "integrator": "implicit", "ramp": 0.1}
    whole = dynamics.solve(model(), **settings)
    with monkeypatch.context() as patch:
        patch.setattr(Newton, "solve", _while(Newton, "solve", 8, lambda true, *arguments: true(*arguments)))
        with pytest.raises(KeyboardInterrupt):
            dynamics.solve(model(), checkpoint=tmp_path / "state", **settings)
    history = dynamics.solve(model(), checkpoint=tmp_path / "state", resume=True, **settings)
    assert history.resumed == pytest.approx(0.05)
    assert history.displacement == pytest.approx(whole.displacement, rel=1e-9, abs=1e-12)


def test_steps_are_the_same_in_blocks_of_any_length(monkeypatch):
    settings = {"end_time": 3.0, "outputs": 2, "ramp": 0.2, "damping": 0.5}
    found, blocks = [], []
    true = System.advance

    def counted(self, course, first, last):
        blocks[-1] += 1
        return true(self, course, first, last)

    monkeypatch.setattr(System, "advance", counted)
    for length in (1e-9, 1e-3, 1e9):
        blocks.append(0)
        monkeypatch.setattr(explicit, "_BLOCK", length)
        found.append(dynamics.solve(model(), **settings))
    assert blocks[0] >= found[0].steps > 2 * blocks[2]
    assert_same(found[0], found[1])
    assert_same(found[0], found[2])


IN_SNES = """
import signal, sys
from isorod.command import cli
from isorod.assembly.assembler import Assembler
true, calls = Assembler.tangent, [0]

def tangent(*arguments, **keywords):
    calls[0] += 1
    if calls[0] == 2:
        signal.raise_signal(signal.{name})
    return true(*arguments, **keywords)

Assembler.tangent = tangent
sys.exit(cli.main(["run", "spring", "--preset", "paper", "--no-estimate", "--coils", "1"]))
"""


@SIGNALS
def test_a_signal_within_petsc_is_one_line(name, code):
    assert end("-c", IN_SNES.format(name=name)) == (code, "", f"isorod: {WORDS[name]}\n")


# An import that takes any exception for a sign that something is missing, as some do.
LOADING = """
import signal
try:
    signal.raise_signal(signal.{name})
except BaseException:
    raise ImportError("cannot be loaded; a page of advice follows")
"""


@SIGNALS
def test_a_signal_while_modules_are_loaded_is_one_line(name, code, tmp_path):
    (tmp_path / "slepc4py.py").write_text(LOADING.format(name=name))
    script = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from isorod.command.cli import main; sys.exit(main())"
    assert end("-c", script, "run", "blade", "--preset", "paper", "--no-estimate", "-eps_tol", "1e-9") == (
        code,
        "",
        f"isorod: {WORDS[name]}\n",
    )


ENDING = "import signal, sys, time\nfrom isorod.command import ending\n"


def test_a_second_interrupt_ends_at_once():
    script = """
def slow():
    try:
        signal.raise_signal(signal.SIGINT)
    finally:
        signal.raise_signal(signal.SIGINT)
        time.sleep(50)

ending.run("isorod", slow)
"""
    begin = time.monotonic()
    assert end("-c", ENDING + script) == (-signal.SIGINT, "", "")
    assert time.monotonic() - begin < 20.0


def test_a_signal_that_the_caller_ignores_stays_ignored():
    script = "ending.run('isorod', lambda: print(signal.raise_signal(signal.SIGINT)) or 0)"
    assert end("-c", ENDING + script, ignored=True) == (0, "None\n", "")


@pytest.mark.parametrize("at_once", [False, True])
def test_what_a_process_does_in_signals_is_as_before(at_once):
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    assert ending.run("isorod", lambda: 3, at_once=at_once) == 3
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before
    assert signal.set_wakeup_fd(-1) == -1


@pytest.mark.mpi
@pytest.mark.parametrize("to", ["mpirun", "rank 0"])
def test_ranks_say_it_once_and_do_not_wait_for_each_other(to, launcher):
    """Rank 1 waits, in MPI, for a message that never comes."""
    script = ENDING + (
        "import os\n"
        "from mpi4py import MPI\n"
        "def wait():\n"
        "    os.write(1, b'%d %d\\n' % (MPI.COMM_WORLD.rank, os.getpid()))\n"
        "    MPI.COMM_WORLD.recv(source=0) if MPI.COMM_WORLD.rank else time.sleep(50)\n"
        "sys.exit(ending.run('isorod', wait))\n"
    )
    pipe = subprocess.PIPE
    command = [*launcher, "2", sys.executable, "-c", script]
    process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=dict(os.environ))
    ranks = dict(process.stdout.readline().split() for _ in range(2))
    assert set(ranks) == {"0", "1"}
    os.kill(process.pid if to == "mpirun" else int(ranks["0"]), signal.SIGTERM)
    begin = time.monotonic()
    _, err = process.communicate(timeout=60)
    assert time.monotonic() - begin < 20.0
    assert process.returncode != 0
    # Open MPI passes on what ranks say once it is to end itself if it finds the time, its version 5 never.
    assert err.count("isorod: ended by SIGTERM") in ((0, 1) if to == "mpirun" else (1,))
    assert "Traceback" not in err


OTHERS = {
    "comparisons": "from comparisons import __main__ as it\nit.results.check_folder = stop\n"
    "it.main(['report', '--results', '/nowhere'])",
    "comparisons.measure.rod": "from comparisons.measure import rod as it\nit.solve = stop\nit.main(['spring'])",
    "meshes.study": "from meshes import study as it\nit.spring.build = stop\nit.main(['spring'])",
    "isorod": "from meshes import __main__ as it\nit.rods.build = stop\nit.main(['spring', 'spring.inp'])",
    "comparisons.fem": "from comparisons.fem import __main__ as it\nit._run = stop\nit.main(['spring'])",
}


@pytest.mark.parametrize("program", OTHERS)
def test_studies_and_meshes_end_in_one_line_too(program):
    for needed in {"meshes.study": ["gmsh"], "comparisons.fem": ["dolfinx", "gmsh"], "comparisons": ["rich"]}.get(
        program, []
    ):
        pytest.importorskip(needed)
    *lines, call = OTHERS[program].splitlines()
    script = "\n".join([ENDING, "def stop(*_, **__): signal.raise_signal(signal.SIGINT); time.sleep(50)", *lines])
    found, out, err = end("-c", f"{script}\nsys.exit({call})")
    kept = "; the records written so far are kept" if program == "comparisons" else ""
    assert (found, out, err) == (130, "", f"{program}: interrupted{kept}\n")


@pytest.mark.parametrize(
    "words",
    ["run ring", "run spring --json -log_view", "run spring --help", "list", "doctor"],
)
def test_a_full_disk_behind_standard_output_is_one_line(words):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "isorod", *words.split()], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 2
    said = "isorod: standard output: cannot be written (No space left on device)\n"
    assert done.stderr[-len(said) :] == said if "-log_view" not in words else said in done.stderr
    assert done.stderr.count("isorod:") == 1 and "Traceback" not in done.stderr


def test_errors_of_the_program_are_not_hidden():
    with pytest.raises(ZeroDivisionError):
        ending.run("isorod", lambda: 1 // 0)
    with pytest.raises(FileNotFoundError):
        ending.run("isorod", lambda: len(open("/no/such/file").read()))


@pytest.fixture
def pipes(tmp_path):
    """Return the name, without its ending, of pipes that nobody writes to or reads."""
    for one in ("toml", "csv", "pvd", "vtu", "png"):
        os.mkfifo(tmp_path / f"pipe.{one}")
    yield tmp_path / "pipe"
    assert all(stat.S_ISFIFO(os.stat(one).st_mode) for one in tmp_path.iterdir())


@pytest.mark.parametrize(
    "words",
    [
        "run {pipe}.toml",
        "plot {pipe}.csv --png a.png",
        "plot {pipe}.pvd --png a.png",
        "plot {pipe}.vtu --png a.png",
        "show ring --png {pipe}.png",
        "section {bar} --output {pipe}.csv",
    ],
)
def test_a_pipe_is_neither_waited_for_nor_overwritten(words, pipes, command):
    bar = Path(files.__file__).parent / "examples" / "bar.toml"
    assert "is no plain file" in command.refuses(*words.format(pipe=pipes, bar=bar).split())


def test_a_picture_where_nothing_can_be_written_is_refused_before_it_is_drawn(command):
    said = command.refuses("show", "ring", "--png", "/proc/a.png")
    assert re.fullmatch(r"/proc/a.png: cannot be written \(.*\); name another", said)
