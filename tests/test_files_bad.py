"""A scene file that is wrong anywhere is refused in one line: file, line and place; nothing is written."""

import os
import random
import re

import pytest
from scene_files import BEAM, LINE, OUTLINE, VALID, mutants, text

from isorod.files.lines import lines

ALL = list(mutants())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder that the command runs in, with the data of the scenes."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "outline.csv").write_text(OUTLINE)
    (tmp_path / "line.csv").write_text(LINE)
    return tmp_path


@pytest.fixture
def refused(command, folder, recwarn):
    """Run a file of a text; return its only line of complaint, having made sure that nothing else has happened."""

    def run(content: str | bytes) -> str:
        (folder / "my.toml").write_bytes(content.encode() if isinstance(content, str) else content)
        said = command.refuses("run", "my.toml", "--output", "results")
        assert re.match(r"my\.toml:\d+: ", said), (content, said)
        assert {one.name for one in folder.iterdir()} == {"line.csv", "outline.csv", "my.toml"}
        return said.removeprefix("my.toml:")

    return run


@pytest.mark.parametrize("name", VALID)
def test_the_scenes_that_are_changed_are_right(name, folder, command):
    (folder / "my.toml").write_text(text(VALID[name]))
    command.prints("run", "my.toml")


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


ROD = "[rod.bar]\ncurve = {straight = 1.0}\nsection = {circle = 0.2}\nlaw = {NeoHookean = {E = 1.0, nu = 0.3}}\n"
TOUCHING = (
    "[obstacle.floor]\nPlane = {point = [0.0, -0.2, 0.0], normal = [0.0, 1.0, 0.0]}\n"
    "[contact.floor]\nsecond = 'floor'\nfirst = 'bar'\n"
)
ENDS = "[support.low]\nend = 'start'\n[support.high]\nend = 'end'\n"
BAR = f"analysis = 'statics'\n{ROD}"
HELD = BAR + ENDS
BARE = "analysis = 'geometry'\n[rod.bar]\n"


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
        ("title = 'a'\n", "1: analysis is missing: "),
        ("analysis = 'statics'\n", r"1: no rod is in it: \[rod.NAME\]"),
        ("analysis = 'static'\n", "1: analysis: 'static' is not known; did you mean statics?"),
        ("analysis = {}\n", "1: analysis: need one of statics, modal, buckling, harmonic, random, dynamics, geometry"),
        ("analysis = {modal = {}, statics = {}}\n", "1: analysis: need one of"),
        ("[analysis]\ntype = 'modal'\n", "2: analysis: 'type' is not known; known: statics"),
        ("rods = 1\n", "1: 'rods' is not known; did you mean rod?"),
        ("title = 1\nanalysis = 'geometry'\n", "1: title: got 1, need a text"),
        ("analysis = 'geometry'\n[[rod]]\n", r"2: rod: got \[\{\}\], need a table for each, with a name: \[rod.NAME\]"),
        ("analysis = 'geometry'\n[rod]\ncurve = {straight = 1.0}\n", r"3: rod.curve: it .*has a name: \[rod.NAME\]"),
        ("analysis = 'geometry'\nrod = {}\n", "1: no rod is in it"),
        ("analysis = 'geometry'\ntitle = 2020-01-01 00:00:00\n", "2: title: got .*, need a text"),
        # In the wrong order.
        (f"{ROD}analysis = 'statics'\n{ENDS}", "1: analysis is missing"),
        (
            f"title = 'a'\n{ROD}[analysis.statics]\n{ENDS}spin = 1\n",
            "11: support.high.spin: got 1, need 3 numbers",
        ),
        (f"{BAR}rod = 'x'\n", r"6: rod.bar: 'rod' is not known here; write it above the first \[table\]"),
        # Missing.
        (BARE, "2: rod.bar: curve is missing: one of straight"),
        (BARE + "curve = 'straight'\n", "2: rod.bar: section is missing: one of circle"),
        (BARE + "curve = 'helix'\n", "3: rod.bar.curve: radius is missing: a number"),
        (BARE + "curve = {}\n", "3: rod.bar.curve: need one of straight"),
        (f"analysis = 'statics'\n{ENDS}{ROD.rpartition('law')[0]}", "6: rod.bar: law is missing: one of LinearElastic"),
        (f"{BAR}law = []\n", "6: not TOML: Cannot overwrite"),
        (f"{HELD}[load.pull]\nend = 'end'\n", "11: load.pull.end: section load: got neither force nor moment"),
        (f"{HELD}[load.pull]\n", "10: load.pull: need one of end, section, "),
        (BAR, "1: analysis: supports: rod bar is free to move"),
        (BAR.replace("straight = 1.0", "straight = 1e300"), "2: rod.bar: rod: inf radii long, need at most 6.7e.07"),
        # Whose square is zero.
        (
            BAR.replace("section = {circle = 0.2}", "section = {circle = 1e-300}\nrings = [0, 0.5, 1]"),
            "2: rod.bar: rod: inf radii",
        ),
        (f"analysis = 'modal'\n{ROD}{ENDS}", "1: analysis: .*density"),
        (f"analysis = 'dynamics'\n{ROD}{ENDS}", "1: analysis: end_time is missing: a number"),
        # Too much.
        (
            BARE + "curve = {straight = 1.0, helix = 2.0}\n",
            "3: rod.bar.curve.helix: beside straight: need one of the two",
        ),
        (
            BARE + "curve = {straight = {length = 1.0}, length = 2.0}\n",
            "3: rod.bar.curve.length: given twice, by rod.bar.curve.straight too",
        ),
        (
            BARE + "curve = 'straight'\nsection = {airfoil = 1.0}\n",
            "4: rod.bar.section.airfoil: got 1.0, need nothing: airfoil = {}",
        ),
        (f"{HELD}[measure.dofs]\nreaction = 'low'\n", "10: measure.dofs: .*choose another"),
        (f"{HELD}[measure.a]\nreaction = 'low'\nunit = 1\n", "12: measure.a.unit: got 1"),
        (
            f"analysis = 'modal'\n{ROD}{ENDS}[measure.a]\nreaction = 'low'\n",
            "11: measure.a.reaction: not available in modal; available: frequency",
        ),
        (
            f"analysis = 'dynamics'\n{ROD}{ENDS}[measure.a]\nmoment = 'low'\n",
            "11: measure.a.moment: not available in dynamics; available: reaction",
        ),
        # At odds.
        (f"{HELD}[support.more]\nend = 'end'\ndisplacement = [1, 0, 0]\n", "12: support.more"),
        (
            f"{HELD}[obstacle.bar]\nPlane = {{point = [0, 0, 0], normal = [0, 0, 1]}}\n",
            "10: obstacle.bar: a rod has this name; choose another",
        ),
        (f"{BAR}{ROD.replace('bar', 'rod')}{ENDS}", "11: support.low.end: rod is missing: which of bar, rod?"),
        (f"{BAR}space = {{section_degree = 2, order = 2}}\n{ENDS}", "6: rod.bar.space.* order"),
        (
            f"{BAR}space = {{section_degree = 2}}\n{ENDS}[support.band]\npatch = {{around = [0, 9], along = [0, 1]}}\n",
            "12: support.band.patch: patch: .*no control points on the surface",
        ),
        (
            f"analysis = 'statics'\n{ROD.replace('0.3', '0.5')}formulation = 'displacement'\n{ENDS}",
            "6: rod.bar.formulation: material of element 0: incompressible",
        ),
        (
            f"{BARE}curve = {{straight = 1{'0' * 400}}}\n",
            "3: rod.bar.curve.straight: got 10000000000000000000..., an integer of too many digits, need a",
        ),
        (
            f"{BARE}curve = {{helix = {{turns = 3, arcs_per_turn = 1{'0' * 400}}}}}\n",
            "3: rod.bar.curve.helix.arcs_per_turn: got 10000000000000000000..., an integer of too many digits",
        ),
        (
            f"{HELD}[measure.f]\nreaction = '{'a' * 3000}'\n",
            r"11: measure.f.reaction: 'a{499}... is not known; known: low, high$",
        ),
        (
            f"{HELD}rotation = [0, 0, 36001]\n",
            "1: analysis: support: got a rotation of 100 turns, need at most 100: a load step takes a quarter turn",
        ),
        (
            "analysis = 'geometry'\n[rod.ring]\ncurve = {helix = {radius = 1.0, pitch = 0.0, turns = 1}}\n"
            "section = {circle = 2.0}\n",
            "2: rod.ring: the rod folds in element",
        ),
        # Options of PETSc name code that is run, and a file may come from somebody else.
        (
            text(BEAM | {"analysis": {"statics": {"petsc": {"pc_type": "python"}}}}),
            r"\d+: analysis.statics: 'petsc' is",
        ),
        # What the solver says names the file.
        (f"{HELD}displacement = [0.0, 0.0, -1e6]\n", "1: analysis: .*load factor .* of rod bar"),
        (f"{BAR}{ENDS}{TOUCHING}first_surface = 'inner'\n", r"\d+: contact.floor: rod bar has no hole, but its inner"),
        (
            f"{BAR}rings = [0.5, 1.0]\nspace = {{elements = 4, order = 2}}\n{ENDS}{TOUCHING}",
            r"\d+: rod.bar.space: section degree: got none",
        ),
    ],
)
def test_what_is_wrong_is_refused_where_it_is(content, said, refused):
    assert re.match(said, found := refused(content)), found


def test_a_file_that_is_too_long_is_refused(folder, command):
    (folder / "my.toml").write_text("x" * 1_100_000)
    said = command.refuses("run", "my.toml")
    assert re.match("my.toml: longer than .* bytes; arrays go into files beside it", said)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("no.toml", "no.toml: cannot be read .No such file or directory.; 'isorod new'"),
        ("a.toml", "a.toml: cannot be read .Is a directory."),
        ("a.toml/b.toml", "a.toml/b.toml: cannot be read"),
        ("my.tom", "scene 'my.tom' is not known; there are: .*; a file's name ends in .toml"),
    ],
)
def test_what_is_no_file_is_refused(name, said, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    os.mkdir("a.toml")
    assert re.match(said, command.refuses("run", name, "--output", "results"))
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


@pytest.mark.parametrize(
    ("analysis", "option", "why"),
    [
        ("modal", "--checkpoint=state", "only statics and dynamics can be restarted"),
        ("modal", "--resume", "only statics and dynamics"),
        ("dynamics", "--no-estimate", "no error estimate in dynamics; compare runs"),
        ("dynamics", "--tolerance=0.1", "no error estimate in dynamics"),
    ],
)
def test_options_of_other_analyses_say_whose_they_are(analysis, option, why, tmp_path, command):
    path = tmp_path / "bar.toml"
    told = "end_time = 1.0\noutputs = 1\n" if analysis == "dynamics" else ""
    path.write_text(f"{ROD}density = 1.0\n{ENDS}[analysis.{analysis}]\n{told}")
    assert re.match(f"option {option.split('=')[0]}: {why}", command.refuses("run", path, option))
