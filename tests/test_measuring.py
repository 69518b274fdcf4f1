"""How runs are timed: what is cold, what counts, and the environment of a measurement."""

import json
import os
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest

from comparisons.__main__ import main
from comparisons.measure import rod, timing
from isorod.command import solving
from isorod.errors import SolveError
from isorod.scenes import Scene
from isorod.scenes.biceps import Biceps

SMALL = {"coils": 1, "elements_per_turn": 8, "section_points": 4}


@pytest.fixture
def clocked(monkeypatch):
    """Let `comparisons.measure.rod` measure runs of given times; return a function that says which, run by run."""
    true = solving.solve

    def say(*totals):
        left = list(totals)

        def solve(scene, settings):
            solution, seconds = true(scene, settings)
            return solution, dict.fromkeys(seconds, 0.0) | {"total": left.pop(0)}

        monkeypatch.setattr(rod.solving, "solve", solve)

    return say


def test_a_motion_is_measured_with_its_own_settings_and_its_equilibrium_with_none():
    assert Biceps(end_time=0.25).settings()["end_time"] == 0.25
    assert Biceps(statics=True).settings() == {}


def test_the_time_is_the_median_of_the_warm_runs(clocked):
    clocked(9.0, 1.0, 8.0, 2.0)
    found = rod.measure("spring", SMALL, 4)
    # With the cold one it would be five.
    assert found["seconds"]["total"] == 2.0
    assert [one["total"] for one in found["runs"]] == [9.0, 1.0, 8.0, 2.0]
    assert found["warm"] is True


def test_the_only_run_is_cold_and_its_time_counts(clocked):
    clocked(9.0)
    found = rod.measure("spring", SMALL, 1)
    assert found["seconds"]["total"] == 9.0
    assert found["warm"] is False


def test_as_isorod_run_has_it_the_estimate_counts_as_run_time(clocked, monkeypatch):
    clocked(9.0, 1.0, 2.0, 3.0)
    told = iter((50.0, 10.0, 20.0, 30.0))
    monkeypatch.setattr(rod.solving, "estimate", lambda solution: {"estimate_seconds": next(told)})
    scene = rod.find("spring", SMALL)
    found = rod.record(scene, *rod.solve(scene, {}, 4, whole=True), {})
    assert (found["seconds"]["estimate"], found["seconds"]["total"]) == (20.0, 22.0)


def test_the_checks_of_a_result_count_as_run_time_and_stay_a_part_of_their_own(monkeypatch):
    """A clock that ticks at the start, when the model is built and at the end; the analysis says what it took."""
    ticks = iter((100.0, 101.0, 109.0))
    monkeypatch.setattr(solving, "perf_counter", lambda: next(ticks))
    parts = {"setup": 1.0, "assembly": 2.0, "solve": 1.5, "check": 3.5}
    monkeypatch.setattr(solving, "import_module", lambda name: SimpleNamespace(solve=lambda model: solution))
    solution = SimpleNamespace(seconds=parts)
    scene = Scene()
    scene.analysis, scene.model = "modal", lambda: SimpleNamespace(bodies=())
    assert solving.solve(scene, {}) == (solution, parts | {"setup": 2.0, "total": 9.0})


def test_a_record_says_what_was_measured():
    found = rod.measure("spring", SMALL, 1, petsc=["-ksp_rtol", "1e-9"])
    assert (found["method"], found["scene"]) == ("cylindrical", "spring")
    assert found["options"] | SMALL == found["options"]
    assert found["petsc_options"] == "-ksp_rtol 1e-9"
    assert found["force"] > 0.0
    assert 2**20 < found["peak_memory"] < 2**36


def test_rod_prints_one_line_of_json_and_refuses_in_one(capsys):
    small = ["--coils", "1", "--elements-per-turn", "8", "--section-points", "4"]
    assert rod.main(["spring", *small, "--repeat", "2"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert len(json.loads(line)["runs"]) == 2
    for wrong, said in ((["sprong"], "sprong"), (["spring", "--coils", "-1"], "got -1 turns")):
        assert rod.main(wrong) == 2
        out, err = capsys.readouterr()
        (line,) = err.splitlines()
        assert out == "" and line.startswith("comparisons.measure.rod: ") and said in line


THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
SPEAKER = """
import json, os, sys
print("not the record")
if sys.argv[1:] == ["fail"]:
    print("first", file=sys.stderr)
    print("it is too short", file=sys.stderr)
    sys.exit(3)
print(json.dumps({"environment": dict(os.environ), "arguments": sys.argv[1:]}))
"""


@pytest.fixture
def speaker(monkeypatch, tmp_path):
    """A module that prints the environment it runs in."""
    (tmp_path / "speaker.py").write_text(SPEAKER)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return "speaker"


def test_a_measurement_has_one_thread_whatever_the_caller_has(speaker, monkeypatch):
    for name in THREADS:
        monkeypatch.setenv(name, "4")
    monkeypatch.setenv("ISOROD_OTHER", "kept")
    monkeypatch.delenv("PYTHONNOUSERSITE", raising=False)
    found = timing.run(speaker, ["--a", "1"])
    assert [found["environment"][name] for name in THREADS] == ["1", "1"]
    assert found["environment"]["PYTHONNOUSERSITE"] == "1"
    assert found["environment"]["ISOROD_OTHER"] == "kept"
    assert found["arguments"] == ["--a", "1"]


def test_a_measurement_that_fails_says_its_last_line(speaker):
    with pytest.raises(SolveError, match=r"^python -m speaker fail: exit code 3: it is too short$"):
        timing.run(speaker, ["fail"])


def test_another_interpreter_has_the_checkout_and_its_own_programs(speaker, tmp_path, monkeypatch):
    other = tmp_path / "else" / "python"
    other.parent.mkdir()
    other.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    other.chmod(0o755)
    # The module is found by a PYTHONPATH that is this interpreter's alone.
    with pytest.raises(SolveError, match=r"No module named '?speaker"):
        timing.run(speaker, [], interpreter=str(other))
    (tmp_path / "here" / "speaker").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "here")
    (tmp_path / "here" / "speaker" / "__main__.py").write_text(f"import comparisons, isorod, meshes\n{SPEAKER}")
    found = timing.run(speaker, ["--a"], interpreter=str(other))
    assert found["arguments"] == ["--a"]
    assert found["environment"]["PATH"].split(os.pathsep)[0] == str(other.parent)


@pytest.mark.parametrize(
    ("program", "said"),
    [
        ("/no/such/python", "no such program"),
        ("mute", r"finite elements do not run there \(no output\)"),
        ("bare", r"finite elements do not run there \(.*No module named '?\w+"),
        ("same", "is measured already"),
    ],
)
def test_an_interpreter_without_another_dolfinx_is_one_line(program, said, tmp_path, monkeypatch, capsys):
    """Before anything runs or is written."""
    pytest.importorskip("dolfinx")
    scripts = {"mute": "exit 1", "bare": f'exec {sys.executable} -S "$@"', "same": f'exec {sys.executable} "$@"'}
    for name, text in scripts.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{text}\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    results = tmp_path / "results"
    assert main(["spring", "--dolfinx", program, "--results", str(results)]) == 2
    out, err = capsys.readouterr()
    assert re.fullmatch(rf"comparisons: --dolfinx {program}: .*{said}.*\n", err) and not out
    assert not results.exists()


def test_ranks_are_started_by_mpirun(monkeypatch):
    seen = []

    def start(command, **keywords):
        seen.append((command, keywords))
        return subprocess.CompletedProcess(command, 0, 'noise\n{"force": 1.0}\n', "")

    monkeypatch.setattr(timing.subprocess, "run", start)
    assert timing.run("some.module", ["x"], timeout=5.0) == {"force": 1.0}
    assert timing.run("some.module", ["x"], ranks=3) == {"force": 1.0}
    alone, three = (command for command, _ in seen)
    assert alone == [sys.executable, "-m", "some.module", "x"]
    assert three[0] == "mpirun" and three[three.index("-n") + 1] == "3"
    assert three[-len(alone) :] == alone
    assert seen[0][1]["timeout"] == 5.0
    assert all(keywords["env"]["OMP_NUM_THREADS"] == "1" for _, keywords in seen)


def test_peak_memory_is_this_process_own_and_grows(python):
    """A child of a large parent does not start from the parent's peak."""
    ballast = bytearray(300 * 2**20)
    ballast[::4096] = b"x" * len(ballast[::4096])
    script = (
        "from comparisons.measure.timing import peak_memory; before = peak_memory(); more = bytearray(200 * 2**20);"
        "more[::4096] = b'x' * len(more[::4096]); print(before, peak_memory())"
    )
    done = python(script)
    before, after = map(int, done.stdout.split())
    assert timing.peak_memory() > 300 * 2**20
    assert before < 250 * 2**20
    assert after - before == pytest.approx(200 * 2**20, rel=0.05)
