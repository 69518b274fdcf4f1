"""A scene file that is wrong anywhere is refused in one line: file, line and place; nothing is written."""

import copy
import os
import random
import re

import pytest

from isorod.command import cli
from isorod.files.lines import lines
from tests.scene_files import BEAM, LINE, OUTLINE, VALID, mutants, text

ALL = list(mutants())


@pytest.fixture
def refused(capsys, tmp_path, monkeypatch, recwarn):
    """Run a file of a text; return its only line of complaint, having made sure that nothing else has happened."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "outline.csv").write_text(OUTLINE)
    (tmp_path / "line.csv").write_text(LINE)

    def run(content: str | bytes) -> str:
        (tmp_path / "my.toml").write_bytes(content.encode() if isinstance(content, str) else content)
        code = cli.main(["run", "my.toml", "--output", "results"])
        out, err = capsys.readouterr()
        assert (code, out) == (2, ""), (content, out, err)
        assert re.fullmatch(r"isorod: my\.toml:\d+: .+\n", err), (content, err)
        assert {one.name for one in tmp_path.iterdir()} == {"line.csv", "outline.csv", "my.toml"}
        return err.removeprefix("isorod: my.toml:").rstrip("\n")

    return run


@pytest.mark.parametrize("name", VALID)
def test_the_scenes_that_are_changed_are_right(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "outline.csv").write_text(OUTLINE)
    (tmp_path / "line.csv").write_text(LINE)
    (tmp_path / "my.toml").write_text(text(VALID[name]))
    assert cli.main(["run", "my.toml"]) == 0, capsys.readouterr().err


def test_there_are_more_than_a_thousand_changes_of_every_kind():
    assert len(ALL) > 1000
    assert {one.change for one in ALL} == {"key", "type", "range", "NaN", "unit", "data"}


@pytest.mark.parametrize("part", range(10))
def test_a_change_is_refused_where_it_is(part, refused):
    """Three hundred of them, drawn by chance."""
    for one in random.Random(1).sample(ALL, 300)[part::10]:
        content = text(one.table)
        number, _, said = refused(content).partition(": ")
        where = lines(content)
        ways = [one.place[:k] for k in range(1, len(one.place) + 1)]
        assert int(number) in {where[way] for way in ways if way in where}, (content, one, said)
        # What is not right, or the table that it is in.
        assert str(one.place[-1]) in said or str(one.place[-2]) in said, (one, said)
        if one.change == "key":
            near = re.search(r"'(.*)' is not known; did you mean (.*)\?", said)
            assert near and near[1] == one.place[-1], (one, said)
            assert near[2].lower() in str(one.place[-1]).lower(), (one, said)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "1: empty file; 'isorod new' writes a scene to begin with"),
        ("\n# words\n", "1: empty file"),
        ("\ufeff", "1: empty file"),
        ("title = 'a'\ntitle = 'b'\n", "2: not TOML: Cannot overwrite a value, column 12"),
        ("[rod.a]\n[rod.a]\n", "2: not TOML: Cannot declare .*twice"),
        ("analysis = modal\n", "1: not TOML: Invalid value, column 12"),
        ("[rod.a]\nlength = 5 mm\n", "2: not TOML: Expected newline or end of document"),
        ("analysis = 'modal\n", "1: not TOML: "),
        ("a = [1,\n2\n", r"[23]: not TOML: Unclosed array"),
        ("title = 'x'\n[rod.a", "2: not TOML: "),
        (b"title = 'a'\nanalysis = '\xff'\n", "2: byte 0xff is not UTF-8; save it as UTF-8"),
        (b"title = '\x00'\n", "1: not TOML: "),
        ("a = " + "[" * 5000, "1: not TOML: "),
        ("x" * 1_100_000, None),
        ("title = 'a'\n", "1: analysis is missing: "),
        ("analysis = 'statics'\n", r"1: no rod is in it: \[rod.NAME\]"),
        ("analysis = 'static'\n", "1: analysis: 'static' is not known; did you mean statics?"),
        ("analysis = {}\n", "1: analysis: need one of statics, modal, dynamics, geometry"),
        ("analysis = {modal = {}, statics = {}}\n", "1: analysis: need one of"),
        ("[analysis]\ntype = 'modal'\n", "2: analysis: 'type' is not known; known: statics"),
        ("rods = 1\n", "1: 'rods' is not known; did you mean rod?"),
        ("title = 1\nanalysis = 'geometry'\n", "1: title: got 1, need a text"),
        ("analysis = 'geometry'\n[[rod]]\n", r"2: rod: got \[\{\}\], need a table for each, with a name: \[rod.NAME\]"),
        ("analysis = 'geometry'\n[rod]\ncurve = {straight = 1.0}\n", r"3: rod.curve: it .*has a name: \[rod.NAME\]"),
        ("analysis = 'geometry'\nrod = {}\n", "1: no rod is in it"),
        ("analysis = 'geometry'\ntitle = 2020-01-01 00:00:00\n", "2: title: got .*, need a text"),
    ],
)
def test_a_file_that_is_none_is_refused_with_the_line(content, said, refused, tmp_path, monkeypatch, capsys):
    if said is None:
        monkeypatch.chdir(tmp_path)
        (tmp_path / "my.toml").write_text(content)
        assert cli.main(["run", "my.toml"]) == 2
        assert re.search("my.toml: longer than .* bytes; arrays go into files beside it", capsys.readouterr().err)
        return
    assert re.match(said, refused(content)), refused(content)


ROD = "[rod.bar]\ncurve = {straight = 1.0}\nsection = {circle = 0.2}\nlaw = {NeoHookean = {E = 1.0, nu = 0.3}}\n"
ENDS = "[support.low]\nend = 'start'\n[support.high]\nend = 'end'\n"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        # In the wrong order.
        (f"{ROD}analysis = 'statics'\n{ENDS}", "1: analysis is missing"),
        (
            f"title = 'a'\n{ROD}[analysis.statics]\n{ENDS}spin = 1\n",
            "11: support.high: 'spin' is not known here; write",
        ),
        (
            f"analysis = 'statics'\n{ROD}rod = 'x'\n",
            r"6: rod.bar: 'rod' is not known here; write it above the first \[table\]",
        ),
        # Missing.
        ("analysis = 'geometry'\n[rod.bar]\n", "2: rod.bar: curve is missing: one of straight"),
        ("analysis = 'geometry'\n[rod.bar]\ncurve = 'straight'\n", "2: rod.bar: section is missing: one of circle"),
        ("analysis = 'geometry'\n[rod.bar]\ncurve = 'helix'\n", "3: rod.bar.curve: radius is missing: a number"),
        ("analysis = 'geometry'\n[rod.bar]\ncurve = {}\n", "3: rod.bar.curve: need one of straight"),
        (f"analysis = 'statics'\n{ENDS}{ROD.rpartition('law')[0]}", "6: rod.bar: law is missing: one of LinearElastic"),
        (f"analysis = 'statics'\n{ROD}law = []\n", "6: not TOML: Cannot overwrite"),
        (
            f"analysis = 'statics'\n{ROD}{ENDS}[load.pull]\nend = 'end'\n",
            "11: load.pull.end: force is missing: 3 numbers",
        ),
        (f"analysis = 'statics'\n{ROD}{ENDS}[load.pull]\n", "10: load.pull: need one of end, section, "),
        (f"analysis = 'statics'\n{ROD}", "1: analysis: supports: rod bar is free to move"),
        (f"analysis = 'modal'\n{ROD}{ENDS}", "1: analysis: .*density"),
        (f"analysis = 'dynamics'\n{ROD}{ENDS}", "1: analysis: end_time is missing: a number"),
        # Too much.
        (
            "analysis = 'geometry'\n[rod.bar]\ncurve = {straight = 1.0, helix = 2.0}\n",
            "3: rod.bar.curve.helix: beside straight: need one of the two",
        ),
        (
            "analysis = 'geometry'\n[rod.bar]\ncurve = {straight = {length = 1.0}, length = 2.0}\n",
            "3: rod.bar.curve.length: given twice, by rod.bar.curve.straight too",
        ),
        (
            "analysis = 'geometry'\n[rod.bar]\ncurve = 'straight'\nsection = {airfoil = 1.0}\n",
            "4: rod.bar.section.airfoil: got 1.0, need nothing: airfoil = {}",
        ),
        (f"analysis = 'statics'\n{ROD}{ENDS}[measure.dofs]\nreaction = 'low'\n", "10: measure.dofs: .*choose another"),
        (f"analysis = 'statics'\n{ROD}{ENDS}[measure.a]\nreaction = 'low'\nunit = 1\n", "12: measure.a.unit: got 1"),
        (f"analysis = 'modal'\n{ROD}{ENDS}[measure.a]\nreaction = 'low'\n", "10: measure: no measures in"),
        (
            f"analysis = 'dynamics'\n{ROD}{ENDS}[measure.a]\nmoment = 'low'\n",
            "11: measure.a: 'moment' is not known; known: reaction, displacement",
        ),
        # At odds.
        (
            f"analysis = 'statics'\n{ROD}{ENDS}[support.more]\nend = 'end'\ndisplacement = [1, 0, 0]\n",
            "12: support.more",
        ),
        (
            f"analysis = 'statics'\n{ROD}{ENDS}[obstacle.bar]\nPlane = {{point = [0, 0, 0], normal = [0, 0, 1]}}\n",
            "10: obstacle.bar: a rod has this name; choose another",
        ),
        (
            f"analysis = 'statics'\n{ROD}{ROD.replace('bar', 'rod')}{ENDS}",
            "11: support.low.end: rod is missing: which of bar, rod?",
        ),
        (f"analysis = 'statics'\n{ROD}space = {{section_degree = 2, order = 2}}\n{ENDS}", "6: rod.bar.space.* order"),
        (
            f"analysis = 'statics'\n{ROD}space = {{section_degree = 2}}\n{ENDS}"
            "[support.band]\npatch = {around = [0, 9], along = [0, 1]}\n",
            "12: support.band.patch: patch: .*no control points on the surface",
        ),
        (
            f"analysis = 'statics'\n{ROD.replace('0.3', '0.5')}formulation = 'displacement'\n{ENDS}",
            "6: rod.bar.formulation: material of element 0: incompressible",
        ),
        (
            f"analysis = 'geometry'\n[rod.bar]\ncurve = {{straight = 1{'0' * 400}}}\n",
            "3: rod.bar.curve.straight: got 10000000000000000000..., an integer of too many digits, need a",
        ),
        (
            f"analysis = 'geometry'\n[rod.bar]\ncurve = {{helix = {{turns = 3, arcs_per_turn = 1{'0' * 400}}}}}\n",
            "3: rod.bar.curve.helix.arcs_per_turn: got 10000000000000000000..., an integer of too many digits",
        ),
        (
            f"analysis = 'statics'\n{ROD}{ENDS}[measure.f]\nreaction = '{'a' * 3000}'\n",
            r"11: measure.f.reaction: 'a{499}... is not known; known: low, high$",
        ),
        (
            f"analysis = 'statics'\n{ROD}{ENDS}rotation = [0, 0, 36001]\n",
            "1: analysis: support: got a rotation of 100 turns, need at most 100: a load step takes a quarter turn",
        ),
        (
            "analysis = 'geometry'\n[rod.ring]\ncurve = {helix = {radius = 1.0, pitch = 0.0, turns = 1}}\n"
            "section = {circle = 2.0}\n",
            "2: rod.ring: the rod folds in element",
        ),
    ],
)
def test_what_does_not_fit_is_refused_where_it_is(content, said, refused):
    assert re.match(said, found := refused(content)), found


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("no.toml", "no.toml: cannot be read .No such file or directory.; 'isorod new'"),
        ("a.toml", "a.toml: cannot be read .Is a directory."),
        ("a.toml/b.toml", "a.toml/b.toml: cannot be read"),
        ("my.tom", "scene 'my.tom' is not known; there are: .*; a file's name ends in .toml"),
    ],
)
def test_what_is_no_file_is_refused(name, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    os.mkdir("a.toml")
    assert cli.main(["run", name, "--output", "results"]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert re.match(f"isorod: {said}", err), err
    assert os.listdir() == ["a.toml"]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ("", "line.csv: no points are in it"),
        ("x,y,z\n", "line.csv: no points are in it"),
        ("0,0,0\n1,zero,0\n", "line.csv:2: value 2 is no finite number"),
        ("0,0,0\n# nothing\n\n1,nan,0\n", "line.csv:4: value 2 is no finite number"),
        ("0,0,0\n1,1_0,0\n", "line.csv:2: value 2 is no finite number"),
        ("0,0,0\n1,0\n", "line.csv:2: 2 numbers where the lines above have 3"),
        ("0,0,0,0,0\n", "line.csv: 5 numbers a line, need x, y"),
        ("a,b,c\n0,0,0\n", "line.csv: its first line names other columns, need x, y"),
        ("x,y,z\n0,0\n", "line.csv: 3 names of columns for 2 numbers a line"),
        ("0,0,0,1\n0,0,1,-1\n", "line.csv: the radius of point 1 is -1, need a positive length"),
        (b"0,0,0\n1,\xff,0\n", "line.csv:2: byte 0xff is not UTF-8"),
        ("0,0\n1,1\n", "polyline: got shape .2, 2., need .m, 3."),
        ("0,0,0\n0,0,0\n1,1,1\n", "polyline: point 0 coincides with the next one"),
    ],
)
def test_bad_data_are_refused_with_their_line(data, said, refused, tmp_path):
    (tmp_path / "line.csv").write_bytes(data if isinstance(data, bytes) else data.encode())
    assert re.match(rf"4: rod.wire.curve.polyline: {said}", found := refused(text(VALID["wire"]))), found


def test_an_error_of_the_solver_names_the_file(refused):
    table = copy.deepcopy(BEAM)
    table["support"]["tip"]["displacement"] = [0.0, 0.0, -1e6]
    assert re.match(r"2: analysis: .*load factor .* of rod beam", refused(text(table)))


def test_options_of_petsc_are_not_for_files(refused):
    """They name code that is run, and a file may come from somebody else."""
    table = copy.deepcopy(BEAM)
    table["analysis"] = {"statics": {"petsc": {"pc_type": "python"}}}
    assert re.match(r"\d+: analysis.statics: 'petsc' is not known", found := refused(text(table))), found


@pytest.mark.parametrize("space", ["", "space = {elements = 4, degree = 3, order = 2}\n"])
def test_contact_of_a_hollow_rod_is_refused_with_what_to_leave_out(space, refused):
    touching = (
        "[obstacle.floor]\nPlane = {point = [0.0, -0.2, 0.0]}\n[contact.floor]\nsecond = 'floor'\nfirst = 'bar'\n"
    )
    said = refused(f"analysis = 'statics'\n{ROD}rings = [0.5, 1.0]\n{space}{ENDS}{touching}")
    assert re.search(
        r"\d+: contact.floor.first: contact needs .* rod bar has a hole or layers; leave out its rings, or this", said
    )


@pytest.mark.parametrize(
    ("analysis", "option", "why"),
    [
        ("statics", "--checkpoint=state", r"only dynamics \(\[analysis.dynamics\]\) can be restarted"),
        ("modal", "--resume", "only dynamics"),
        ("dynamics", "--no-estimate", "no error estimate in dynamics; compare runs"),
        ("dynamics", "--tolerance=0.1", "no error estimate in dynamics"),
    ],
)
def test_options_of_other_analyses_say_whose_they_are(analysis, option, why, tmp_path, capsys):
    path = tmp_path / "bar.toml"
    told = "end_time = 1.0\noutputs = 1\n" if analysis == "dynamics" else ""
    path.write_text(f"{ROD}density = 1.0\n{ENDS}[analysis.{analysis}]\n{told}")
    assert cli.main(["run", str(path), option]) == 2
    assert re.match(f"isorod: option {option.split('=')[0]}: {why}", capsys.readouterr().err)
