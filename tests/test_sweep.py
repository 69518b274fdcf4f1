"""Sweeps: the numbers of single runs, kept point by point and gone on with."""

import csv
import json
import re
import subprocess
import sys

import pytest
from petsc4py import PETSc

from isorod.command import cli, sheet
from isorod.command import sweep as sweeping
from isorod.errors import SolveError

COARSE = "--preset paper --coils 1 --elements-per-turn 4 --section-points 3 --degree 2".split()
PULLED = [*COARSE, "--no-estimate", "--travel", "0:5:21"]


@pytest.fixture
def sweep(capsys):
    """Run a sweep in this process; return its exit code, what it prints, and what it complains of."""

    def run(*words):
        code = cli.main(["sweep", *map(str, words)])
        for word in words:
            # PETSc keeps what was typed for whatever else runs in this process.
            if re.match("-[a-z]", str(word)):
                PETSc.Options().delValue(word[1:])
        return code, *capsys.readouterr()

    return run


def rows(path):
    """Return the rows of a table, by column."""
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def records(text):
    return [json.loads(line) for line in text.splitlines()]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The table of a sweep that nothing interrupts, and its records."""
    path = tmp_path_factory.mktemp("sweep") / "force.csv"
    assert cli.main(["sweep", "spring", *PULLED, "--output", str(path)]) == 0
    return path


def test_a_table_has_the_digits_of_single_runs(whole, capsys):
    table = rows(whole)
    assert [row["travel"] for row in table[:3]] == ["0", "0.25", "0.5"] and len(table) == 21
    for row in table:
        capsys.readouterr()
        assert cli.main(["run", "spring", *COARSE, "--no-estimate", "--travel", row["travel"], "--json"]) == 0
        alone = json.loads(capsys.readouterr().out)
        assert row["force"] == sheet.cells([alone["force"]])[0]
        assert (row["unknowns"], row["status"]) == (str(alone["unknowns"]), "solved")
        assert len(row["force"].replace(".", "")) <= 7


def test_what_began_points_from_rest_is_taken_for_another_release(whole, sweep, tmp_path):
    """Every point does, now."""
    code, out, err = sweep("spring", *PULLED, "--cold", "--output", tmp_path / "cold.csv")
    assert (code, err) == (0, "isorod: warning: --cold: every point begins from rest; leave it out\n")
    assert "21 points" in out
    assert (tmp_path / "cold.csv").read_bytes() == whole.read_bytes()


KILLED = """
import os, signal, sys
from isorod.command import cli
from isorod.output import results

def killed(path, record, own=results.append):
    own(path, record)
    if record["sweep"]["point"] == 11:
        os.kill(os.getpid(), signal.SIGKILL)

results.append = killed
cli.main(sys.argv[1:])
"""


def test_a_sweep_that_was_killed_goes_on_and_ends_with_the_same_bytes(whole, sweep, python, tmp_path):
    path = tmp_path / "force.csv"
    done = python(KILLED, "sweep", "spring", *PULLED, "--output", str(path))
    assert done.returncode == -9
    lines = path.with_suffix(".jsonl")
    assert not path.exists() and len(records(lines.read_text())) == 12
    code, out, err = sweep("spring", *PULLED, "--output", path)
    assert code == 0, err
    assert "21 points" in out and "12 of them there before" in out
    assert path.read_bytes() == whole.read_bytes()
    assert [one["sweep"]["point"] for one in records(lines.read_text())] == [*range(21)]
    # Once more there is nothing to do.
    before = lines.read_bytes()
    assert "21 of them there before" in sweep("spring", *PULLED, "--output", path)[1]
    assert lines.read_bytes() == before


def test_a_sweep_of_another_commit_goes_on_with_a_warning(whole, sweep, tmp_path):
    """Who works on isorod commits between; numbers of another version are those of another sweep."""
    path = tmp_path / "force.csv"
    text = whole.with_suffix(".jsonl").read_text()
    lines = [json.dumps({**record, "commit": "abc"}) for record in records(text)[:20]]
    path.with_suffix(".jsonl").write_text("\n".join(lines) + "\n")
    code, out, err = sweep("spring", *PULLED, "--output", path)
    assert code == 0 and "20 of them there before" in out
    assert re.fullmatch(r"isorod: warning: points that are there are of commit abc; this is .*\n", err)
    assert path.read_bytes() == whole.read_bytes()


def test_ctrl_c_says_how_to_go_on(whole, sweep, tmp_path, monkeypatch):
    own = sweeping._solve

    def solve(number, *others):
        if number == 5:
            raise KeyboardInterrupt
        return own(number, *others)

    path = tmp_path / "force.csv"
    monkeypatch.setattr(sweeping, "_solve", solve)
    code, out, err = sweep("spring", *PULLED, "--output", path)
    assert (code, out) == (130, "")
    assert err == f"isorod: interrupted; 5 of 21 points are in {path}; the same command goes on\n"
    assert len(rows(path)) == 5
    monkeypatch.undo()
    assert sweep("spring", *PULLED, "--output", path)[0] == 0
    assert path.read_bytes() == whole.read_bytes()


@pytest.mark.parametrize(
    ("words", "spoil", "message"),
    [
        (["--nu", "0.2"], None, r"force.jsonl is of another sweep \(command: isorod sweep spring .*--nu 0.2\)"),
        (["-ksp_type", "preonly"], None, r"another sweep \(petsc_options: ; here -ksp_type preonly\)"),
        ([], lambda path: path.with_suffix(".jsonl").unlink(), "is there, without the records of a sweep"),
        ([], lambda path: path.with_suffix(".jsonl").write_text('{"force": 1}\n'), "jsonl:1 is no record of a sweep"),
    ],
)
def test_the_file_of_something_else_is_left_alone(words, spoil, message, whole, sweep, tmp_path):
    path = tmp_path / "force.csv"
    for suffix in (".csv", ".jsonl"):
        path.with_suffix(suffix).write_bytes(whole.with_suffix(suffix).read_bytes())
    if spoil:
        spoil(path)
    before = {one.name: one.read_bytes() for one in tmp_path.iterdir()}
    code, out, err = sweep("spring", *PULLED, *words, "--output", path)
    assert (code, out) == (2, "")
    assert re.search(message, err) and "--overwrite" in err and err.count("\n") == 1
    assert {one.name: one.read_bytes() for one in tmp_path.iterdir()} == before


def test_overwrite_begins_anew(sweep, tmp_path):
    path = tmp_path / "force.csv"
    path.write_text("mine")
    code, *_ = sweep("spring", *COARSE, "--no-estimate", "--travel", "1,2", "--output", path, "--overwrite")
    assert code == 0
    assert [row["travel"] for row in rows(path)] == ["1", "2"]


def test_two_sweeps_at_once_fill_one_table(whole, python, tmp_path):
    """Each solves all points; records of a point are the same, and none is lost."""
    path = tmp_path / "force.csv"
    words = [sys.executable, "-m", "isorod", "sweep", "spring", *PULLED, "--output", str(path)]
    both = [subprocess.Popen(words, stdout=subprocess.DEVNULL) for _ in range(2)]
    assert [one.wait() for one in both] == [0, 0]
    assert {one["sweep"]["point"] for one in records(path.with_suffix(".jsonl").read_text())} == {*range(21)}
    assert path.read_bytes() == whole.read_bytes()


def test_a_point_that_cannot_be_solved_is_a_row(sweep, tmp_path):
    path = tmp_path / "force.csv"
    code, out, err = sweep("spring", *COARSE, "--nu", "0.7,0.3,0.4", "--travel", "1,1e6", "--output", path)
    assert code == 2
    assert err.splitlines()[-1] == "isorod: 4 of 6 points could not be solved; see the table's status column"
    assert re.fullmatch(r"isorod: warning: nu 0.3, travel 1: estimated error .*", err.splitlines()[0])
    table = rows(path)
    told = [(row["nu"], row["travel"], row["status"].partition(":")[0], bool(row["force"])) for row in table]
    assert told == [
        ("0.7", "1", "refused", False),
        ("0.7", "1e6", "refused", False),
        ("0.3", "1", "solved", True),
        ("0.3", "1e6", "failed", False),
        ("0.4", "1", "solved", True),
        ("0.4", "1e6", "failed", False),
    ]
    assert "got 0.7, need -1 < nu <= 0.5" in table[0]["status"] and "det F" in table[3]["status"]
    assert float(table[2]["error_estimate"]) > 0 and table[0]["error_estimate"] == ""
    assert "need -1 < nu" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["spring"], "nothing is varied"),
        (["spring", "--nu", "0.3"], "nothing is varied; .*--travel 0:10:21"),
        (["spring", "--travel", "0:10"], "nothing is varied|invalid float"),
        (["spring", "--travel", "0:10:x"], "travel: got 0:10:x, need from:to:count"),
        (["spring", "--travel", "0:inf:3"], "travel: got 0:inf:3, need from:to:count"),
        (["spring", "--travel", "0:10:1"], "need a count from 2 to"),
        (["spring", "--travel", "2:2:5"], "whose ends are the same"),
        (["spring", "--travel", "1,,2"], "a value is empty"),
        (["spring", "--travel", "1,2,1"], "which has 1 twice"),
        (["spring", "--travel", "1,2", "--travel", "3,4"], "travel: varied twice"),
        (["spring", "--nu", "0.1:0.4:1000", "--travel", "0:1:1000"], "1,000,000 points; a sweep has at most"),
        (["spring", "--nu", "0.3,0.7,x"], "argument --nu: invalid float value: 'x'"),
        (["spring", "--nuu", "0.3,0.4"], "option --nuu is not known; did you mean --nu"),
        (["spring", "--nu", "0.6,0.7"], r"none of 2 points can be solved; the first: .*got 0.6"),
        (["spring", "--nu", "0.3,0.4", "--wire-radius", "0"], "none of 2 points can be solved; .*positive length"),
        (["spring", "--nu", "0.3,0.4", "--png", "a.xyz"], "need a name that ends in .png"),
        (["spring", "--nu", "0.3,0.4", "--output", "a.txt"], "the name of a sweep's table ends in .csv"),
        (["spring", "--nu", "0.3,0.4", "--refine"], "option --refine is not known"),
        (["ring", "--radius", "3,4"], "geometry only"),
        (["--nu", "0.3,0.4"], "scene missing"),
    ],
)
def test_bad_input_is_one_line(words, message, sweep, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = sweep(*words)
    assert (code, out) == (2, "")
    assert re.fullmatch(r"isorod: .+\n", err) and re.search(message, err), err
    assert not any(tmp_path.iterdir())


def test_an_option_of_petscs_that_nothing_uses_is_named(command, tmp_path):
    words = "sweep", "spring", *PULLED, "-snes_foo", "3", "--output", tmp_path / "force.csv"
    assert "-snes_foo" in command.refuses(*words)
    assert not any(tmp_path.iterdir())


def test_every_point_is_a_line_of_json_and_a_table_for_people(sweep, capsys):
    words = "spring", *COARSE, "--no-estimate", "--nu", "0.3,0.4", "--travel", "1,2"
    found = records(sweep(*words, "--json")[1])
    assert [tuple(one["sweep"]["values"].values()) for one in found] == [
        ("0.3", "1"),
        ("0.3", "2"),
        ("0.4", "1"),
        ("0.4", "2"),
    ]
    assert {"versions", "commit", "machine", "force", "options"} <= found[0].keys()
    lines = sweep(*words)[1].splitlines()
    assert lines[0].split() == ["nu", "travel", "force", "Newton"]
    assert [float(line.split()[2]) for line in lines[1:5]] == pytest.approx([one["force"] for one in found], rel=1e-5)
    assert re.fullmatch(r"4 points in .*; .* Newton iterations each", lines[5])


def test_modes_have_a_column_each(sweep, tmp_path):
    path = tmp_path / "modes.csv"
    words = "blade", "--order", "1", "--section-points", "16", "--elements", "2", "--modes", "2,3", "--no-estimate"
    code, _, err = sweep(*words, "--output", path, "--png", tmp_path / "modes.png", "--of", "frequencies[1]")
    assert (code, err) == (0, "isorod: warning: --of: the plot has all answers; leave it out\n")
    first, second = rows(path)
    assert [name for name in second if "freq" in name] == [f"frequencies[{k}]" for k in range(3)]
    assert first["frequencies[2]"] == "" and float(second["frequencies[2]"]) > float(first["frequencies[1]"]) > 0
    assert cli.main(["plot", str(path), "--png", str(tmp_path / "again.png")]) == 0
    own, again = ((tmp_path / name).stat().st_size for name in ("modes.png", "again.png"))
    assert (tmp_path / "modes.png").read_bytes().startswith(b"\x89PNG") and abs(own - again) < 0.1 * own


def test_numbers_of_a_list_have_the_places_of_the_largest():
    assert sheet.cells([1234.56789, -1.23456789, 1e-9, 0.0]) == ["1234.568", "-1.235", "0", "0"]
    assert sheet.cells([-6.0990517424]) == ["-6.099052"]
    assert sheet.cells([9.99999996]) == ["10"]


@pytest.mark.slow
@pytest.mark.mpi
def test_two_ranks_fill_the_same_table(mpirun, whole, tmp_path):
    path = tmp_path / "force.csv"
    done = mpirun(2, "sweep", "spring", *PULLED, "--output", str(path))
    assert done.returncode == 0, done.stderr
    assert path.read_bytes() == whole.read_bytes()
    assert done.stdout.count("21 points") == 1


def test_a_failure_within_a_sweep_is_not_the_next_points(sweep, monkeypatch):
    from isorod.command import solving

    own = solving.solve

    def solve(scene, settings, begin=None):
        if scene.travel == 1.0:
            raise SolveError("no\nluck")
        return own(scene, settings, begin)

    monkeypatch.setattr(solving, "solve", solve)
    code, out, err = sweep("spring", *PULLED, "--json")
    found = records(out)
    assert code == 2 and "1 of 21 points" in err
    assert [one["sweep"]["status"] for one in found if one["sweep"]["status"] != "solved"] == ["failed: no luck"]
