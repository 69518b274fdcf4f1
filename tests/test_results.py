"""Records as JSON lines, and writing that leaves nothing half-done."""

import gc
import json
import os
import stat
import subprocess
import sys
from importlib import import_module, metadata
from pathlib import Path

import numpy as np
import pytest

from isorod.errors import InputError, SolveError
from isorod.output import results


def test_record_is_one_line_that_reads_back():
    record = {"a": np.float64(1.5), "b": np.arange(3), "c": np.int64(7), "d": np.bool_(True), "e": "x\ny", "f": None}
    text = results.line(record)
    assert "\n" not in text
    assert json.loads(text) == {"a": 1.5, "b": [0, 1, 2], "c": 7, "d": True, "e": "x\ny", "f": None}


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_no_result(value):
    with pytest.raises(SolveError, match="force is not a finite number"):
        results.line({"scene": "spring", "force": value})
    with pytest.raises(SolveError, match="not a finite number"):
        results.line({"scene": "spring", "deep": {"list": [1.0, value]}})


def test_append_adds_a_line_and_keeps_the_others(tmp_path):
    path = tmp_path / "results.jsonl"
    for k in range(3):
        results.append(path, {"k": k})
    assert path.read_text() == '{"k": 0}\n{"k": 1}\n{"k": 2}\n'
    with pytest.raises(SolveError):
        results.append(path, {"k": np.nan})
    assert path.read_text().count("\n") == 3


def test_append_from_several_processes_mixes_no_lines(tmp_path, python):
    path = tmp_path / "results.jsonl"
    script = """
import os, sys
from pathlib import Path
from isorod.output import results
who = [os.fork() == 0 for _ in range(3)]
for k in range(20):
    results.append(Path(sys.argv[1]), {"k": k, "text": "x" * 50000})
if not any(who):
    for _ in range(3):
        os.wait()
"""
    assert python(script, str(path)).returncode == 0
    lines = path.read_text().splitlines()
    assert len(lines) == 160
    assert sorted(json.loads(line)["k"] for line in lines) == sorted(8 * [*range(20)])


def test_append_to_what_is_no_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        results.append(tmp_path, {"k": 1})


def test_provenance_names_versions_commit_machine_and_time():
    import_module("petsc4py")
    found = json.loads(results.line(results.provenance()))
    assert {"isorod", "python", "numpy", "scipy", "numba", "petsc4py"} <= found["versions"].keys()
    assert found["machine"]["cores"] >= 1
    assert found["machine"]["processor"]
    assert found["time"].endswith("+00:00")
    assert "commit" in found


def test_a_package_that_came_within_another_has_the_version_of_its_module(monkeypatch):
    """And one that is not loaded has none."""

    def version(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", version)
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    found = results.provenance()["versions"]
    assert found["numpy"] == np.__version__ and "numba" not in found


@pytest.mark.parametrize("place", ["file/inside", "file", "file/far/inside"])
def test_a_folder_below_a_file_is_refused(place, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"results folder .*file.*: cannot write there"):
        results.check_folder(str(tmp_path / place))


def test_a_folder_that_takes_no_files_is_refused():
    with pytest.raises(InputError, match="results folder /proc/results"):
        results.check_folder("/proc/results")
    with pytest.raises(InputError, match=r"results folder x*: cannot write there \(File name too long\); name another"):
        results.check_folder("x" * 300)
    with pytest.raises(InputError, match="empty name"):
        results.check_folder("")


def test_checking_a_folder_makes_nothing_and_making_it_twice_is_fine(tmp_path):
    results.check_folder(str(tmp_path / "a" / "b"))
    assert not list(tmp_path.iterdir())
    for _ in range(2):
        assert results.make_folder(str(tmp_path / "a" / "b")) == tmp_path / "a" / "b"
    assert (tmp_path / "a" / "b").is_dir()


def test_write_beside_replaces_a_file_as_a_whole(tmp_path):
    path = tmp_path / "data.txt"
    path.write_text("old")

    def write(beside: Path) -> None:
        beside.write_text("new")
        assert path.read_text() == "old"
        assert beside.parent == tmp_path
        assert beside.suffix == ".txt"

    results.write_beside(path, write)
    assert path.read_text() == "new"
    assert [file.name for file in tmp_path.iterdir()] == ["data.txt"]
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~mask


def test_write_beside_that_fails_leaves_the_old_file_and_no_other(tmp_path):
    path = tmp_path / "data.txt"
    path.write_text("old")

    def write(beside: Path) -> None:
        beside.write_text("half")
        raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match=r"data.txt: cannot be written \(No space left on device\)"):
        results.write_beside(path, write)
    assert path.read_text() == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["data.txt"]


def test_arrays_that_find_no_room_leave_the_old_ones_and_are_said_once(tmp_path, room, monkeypatch):
    path, said = tmp_path / "fields.npz", []
    results.write_arrays(path, a=np.arange(3))
    monkeypatch.setattr(sys, "unraisablehook", said.append)
    for size in (0, 5000):
        with (
            room(size),
            pytest.raises(InputError, match=r"fields.npz: cannot be written \(File too large\); make room"),
        ):
            results.write_arrays(path, b=np.random.default_rng(0).random(10000))
        gc.collect()
    assert not said
    assert [file.name for file in tmp_path.iterdir()] == ["fields.npz"]
    assert np.load(path)["a"].tolist() == [0, 1, 2]


def test_what_is_renamed_is_on_the_disk(tmp_path, monkeypatch):
    calls, own = [], (os.fsync, os.replace)
    monkeypatch.setattr(os, "fsync", lambda handle: (calls.append("fsync"), own[0](handle)))
    monkeypatch.setattr(os, "replace", lambda *names: (calls.append("replace"), own[1](*names)))
    results.write_whole(tmp_path / "data", b"new")
    assert calls == ["fsync", "replace"]


@pytest.mark.parametrize("last", ['{"k": 0}\n', '{"k": 0}'])
def test_a_record_that_finds_no_room_leaves_nothing_of_its_line(last, tmp_path, room):
    path = tmp_path / "results.jsonl"
    path.write_text(last)
    with room(4000), pytest.raises(InputError, match=r"results.jsonl: cannot be written \(File too large\); make room"):
        results.append(path, {"k": 1, "text": "x" * 8000})
    assert path.read_text() == last
    results.append(path, {"k": 2})
    assert [one["k"] for one in results.read(path)] == [0, 2]
    with room(4000), pytest.raises(InputError, match="make room"):
        results.append(tmp_path / "new", {"k": 1, "text": "x" * 8000})
    assert [file.name for file in tmp_path.iterdir()] == ["results.jsonl"]


def test_a_full_disk_is_known_before_the_work(tmp_path, room):
    with (
        room(0),
        pytest.raises(InputError, match=r"results folder .*: cannot write there \(File too large\); make room"),
    ):
        results.check_folder(str(tmp_path / "new"))
    assert not list(tmp_path.iterdir())


WRITERS = """
import os, sys
from pathlib import Path
from isorod.output import folder
folder._contents = lambda body, states, number, *_: [one.fields[number]["content"] * 1000 for one in states]
who = [os.fork() == 0 for _ in range(2)]
for k in range(5):
    content = repr((who, k))
    fields = {"content": content.encode()}
    record = {"scene": "spring", "content": content}
    folder.add(Path(sys.argv[1]), record, [None, None], [folder.Frame(0.0, [fields, fields])])
if not any(who):
    for _ in range(2):
        os.wait()
"""


def test_runs_that_share_a_folder_keep_their_files(tmp_path, python):
    # Of an older run, which no record names.
    (tmp_path / "spring-1.vtu").write_text("old")
    done = python(WRITERS, str(tmp_path))
    assert (done.returncode, done.stderr) == (0, "")
    records = [json.loads(line) for line in (tmp_path / "results.jsonl").read_text().splitlines()]
    assert len(records) == len({record["content"] for record in records}) == 20
    for record in records:
        *written, both = record["files"]
        assert len(written) == 2 and both.endswith(".pvd")
        for name in written:
            assert (tmp_path / name).read_text() == 1000 * record["content"]
    names = [name for record in records for name in record["files"]]
    assert sorted([*names, "results.jsonl", "spring-1.vtu"]) == sorted(file.name for file in tmp_path.iterdir())
    assert (tmp_path / "spring-1.vtu").read_text() == "old"


WRITER = """
import sys
from pathlib import Path
from isorod.output import results
for k in range(100000):
    results.append(Path(sys.argv[1]), {"who": sys.argv[2], "k": k, "text": "x" * 100000})
    print(k, flush=True)
"""


def test_writers_that_are_killed_lose_no_line(tmp_path):
    """And what one leaves of a line takes no other with it."""
    path, promised = tmp_path / "results.jsonl", set()
    words = [sys.executable, "-c", WRITER, str(path)]
    running = [subprocess.Popen([*words, str(who)], stdout=subprocess.PIPE) for who in range(4)]
    for who, process in enumerate(running):
        for _ in range(5):
            promised.add((str(who), int(process.stdout.readline())))
        process.kill()
        process.communicate()
    with open(path, "ab") as file:
        file.write(b'{"who": "torn')
    results.append(path, {"who": "last", "k": 0})
    with pytest.warns(UserWarning, match="is no record of a run"):
        records = results.read(path)
    assert promised | {("last", 0)} <= {(record["who"], record["k"]) for record in records}


def test_rows_of_values_have_no_formulas():
    """Programs that calculate take words that begin so for formulas; numbers stay numbers, and names names."""
    line = results.row(["a, b", '=HYPERLINK("x")', "-1.5e3", "+cmd", "@sum", "-inf", ""])
    assert line == b'"a, b","\'=HYPERLINK(""x"")",-1.5e3,\'+cmd,\'@sum,-inf,\n'
