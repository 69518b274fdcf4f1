"""Load cases of files: which loads act, with which values; a linear bar tells each by itself, and their sums."""

import copy
import json

import numpy as np
import pytest
from scene_files import text
from test_file_measures import bar

from isorod import InputError
from isorod.command import cli
from isorod.files.scene import FileScene

CASES = {
    "dead": {"loads": ["gravity"]},
    "both": {"loads": {"gravity": 2.0, "push": -1.5}},
    "storm": {"loads": ["push", "side"], "load": {"push": {"force": [0.0, 0.0, 3.0]}}},
    "more": {"load": {"extra": {"end": "end", "force": [0.0, 5.0, 0.0]}}},
    "held": {"supports": ["foot"], "measures": ["root"]},
}


def table(**cases):
    """Return a bar with three loads, and supports at one end or both."""
    made = bar({"components": "x"}, 0.3, root={"reaction": "foot"}, top={"reaction": "head", "component": "x"})
    made["rod"]["bar"]["density"] = 0.5
    made |= {"gravity": {"acceleration": [0.0, 0.0, -2.0]}}
    made["load"] = {
        "push": {"end": "end", "force": [0.0, 1.0, 0.0]},
        "side": {"per_length": [0.0, 0.25, 0.0]},
    }
    return made | {"case": cases or copy.deepcopy(CASES)}


@pytest.fixture
def file(tmp_path):
    def write(made):
        path = tmp_path / "my.toml"
        path.write_text(text(made))
        return path

    return write


def test_each_case_has_its_loads(file, command, tmp_path):
    """What the foot carries is what acts: weight 4 pi / 4, push 1, side 1."""
    path, weight = file(table()), np.pi
    out = tmp_path / "out"
    lines = command.prints("run", path, "--no-estimate", "--output", out).splitlines()
    assert [line.split()[0] for line in lines[:6]] == ["case", *CASES]
    found = {name: json.loads((out / name / "results.jsonl").read_text()) for name in CASES}
    assert all(one["case"] == name and "case" not in one["options"] for name, one in found.items())
    roots = {name: np.array(one["root"]) for name, one in found.items()}
    assert roots["dead"] == pytest.approx([0.0, 0.0, weight], rel=1e-6, abs=1e-9)
    assert roots["both"] == pytest.approx([0.0, 1.5, 2.0 * weight], rel=1e-6, abs=1e-9)
    assert roots["storm"] == pytest.approx([0.0, -1.0, -3.0], rel=1e-6, abs=1e-9)
    assert roots["more"] == pytest.approx([0.0, -7.0, weight], rel=1e-6, abs=1e-9)
    assert "top" not in found["held"] and roots["held"] == pytest.approx([0.0, -2.0, weight], rel=1e-6, abs=1e-9)
    # One alone has the same answer; sweeps run all, and what is typed is of loads that act.
    alone = command.record("run", path, "--case", "both", "--no-estimate")
    assert alone["root"] == pytest.approx(found["both"]["root"], rel=1e-9, abs=1e-9) and alone["case"] == "both"
    words = ["--set", "load.push.force.1=2,4", "--no-estimate", "--output", tmp_path / "a.csv", "--case", "both,dead"]
    command.prints("sweep", path, *words)
    rows = [line.split(",") for line in (tmp_path / "a.csv").read_text().splitlines() if line[0] != "#"]
    at, case = rows[0].index("root[y]"), rows[0].index("case")
    assert [(row[case], float(row[at])) for row in rows[1:]] == [("both", 3), ("dead", 0), ("both", 6), ("dead", 0)]


def test_derivatives_of_each_case_stand_below_the_table(file, command):
    """The foot carries -1.5 times the push of a case with that factor, and what another says in its place."""
    path, push = file(table(both=CASES["both"], storm=CASES["storm"])), "load.push.force.1"
    lines = command.prints("run", path, "--no-estimate", "--derivatives").splitlines()
    at = {name: lines.index(f"case {name}:") for name in ("both", "storm")}
    both, storm = lines[at["both"] : at["storm"]], lines[at["storm"] :]

    def by(block, name, entry):
        start = next(k for k, line in enumerate(block) if line.startswith(f"root[{entry}] = "))
        return float(next(line.split()[1] for line in block[start:] if line.split()[:1] == [name]))

    assert by(both, push, 1) == pytest.approx(1.5, rel=1e-6)
    assert by(both, "case.both.loads.push", 1) == pytest.approx(-1.0, rel=1e-6)
    assert by(storm, "case.storm.load.push.force.2", 2) == pytest.approx(-1.0, rel=1e-6)
    # Its own name alone has the number that a case says itself; those of other cases change nothing.
    assert not any(push in line or "case.both" in line for line in storm)


def test_a_design_knows_a_case_by_what_the_file_says(file, command):
    """Where a case multiplies a load, it begins at the load of the file; what a case says itself has its name there."""
    path, push = file(table(both={"loads": {"push": -1.5}}, storm=CASES["storm"])), "load.push.force.1"
    for case in ((), ("--case", "both")):
        name = "root[1]" if case else "both.root[1]"
        words = ("--vary", f"rod.bar.section,{push}", "--target", f"{name}=3")
        if not case:
            assert f"'{push}' is no parameter of the scene" in command.refuses("design", path, *words)
            continue
        found = command.record("design", path, *case, *words)
        assert found["answers"][name]["before"] == pytest.approx(1.5, rel=1e-6)
        assert found["parameters"][push]["after"] == pytest.approx(2.0, rel=1e-4)


def test_a_case_that_cannot_be_solved_leaves_the_others(file, capsys):
    """A rod whose supports a case takes away is free; the table says so, and the exit code is 2."""
    path = file(table(good={"loads": ["push"]}, free={"supports": ["head"], "measures": []}))
    assert cli.main(["run", str(path), "--no-estimate"]) == 2
    out, err = capsys.readouterr()
    assert "load cases not solved: free" in err
    (line,) = [line for line in out.splitlines() if line.split()[:1] == ["free"]]
    assert "rod bar is free to" in line


@pytest.mark.parametrize(
    ("case", "said"),
    [
        ({"loads": ["pushed"]}, r"my.toml:\d+: case.one.loads: 'pushed' is not known; did you mean push"),
        ({"loads": "push"}, "case.one.loads: got 'push', need names in a list, or a factor for each"),
        ({"loads": {"push": "a"}}, "case.one.loads.push: got 'a', need a number"),
        ({"supports": {"foot": 2.0}}, "case.one.supports: got .*, need names in a list"),
        ({"analysis": "modal"}, "case.one.analysis: it is the same in all cases"),
        ({"loads": ["side"], "load": {"push": {"force": [0, 0, 1]}}}, "push is changed in this case, but not among"),
        ({"load": {"push": {"fore": [0, 0, 1]}}}, r"my.toml:\d+: load.push: 'fore' is not known; did you mean force"),
    ],
)
def test_what_a_case_cannot_have_is_one_line(case, said, file):
    path = file(table(one=case))
    FileScene(str(path))
    with pytest.raises(InputError, match=said) as problem:
        FileScene(str(path), case="one")
    assert "\n" not in str(problem.value)


def test_errors_of_a_case_stand_at_its_line(file):
    made = table()
    del made["case"]
    path = file(made)
    line = len(path.read_text().splitlines()) + 2
    path.write_text(path.read_text() + "\n[case.one]\nload.push.force = [0, 1]\n".lstrip())
    with pytest.raises(InputError, match=f"my.toml:{line}: load.push.force: "):
        FileScene(str(path), case="one")


def test_what_takes_one_model_asks_which_case(file, command):
    path = file(table())
    said = command.refuses("matrices", path, "--output", path.parent / "m")
    assert "several load cases; choose one: --case dead or both" in said
    assert "did you mean storm" in command.refuses("run", path, "--case", "strom")
    assert "need a table" in command.refuses("run", file(table(one=3)))
    del (plain := table())["case"]
    path = file(plain)
    assert "option --case is not known" in command.refuses("run", path, "--case", "dead")
    path.write_text(path.read_text() + '\n[case."a b"]\nloads = []\n')
    assert "'a b' is no name" in command.refuses("run", path)
