"""What `isorod run` prints: the answer first, in words, on one screen; JSON alone on standard output; progress."""

import io
import json
import re
import sys
from itertools import pairwise

import numpy as np
import pytest
from test_motion_steps import MUSCLE, bar

from isorod import SolveError, dynamics, modal, scenes, statics
from isorod.command import cli, printing, solving
from isorod.dynamics.explicit import run as explicit
from isorod.geometry import center_line, section
from isorod.material import NeoHookean
from isorod.model import Body, Contact, Model, Plane, Support
from isorod.output import progress
from isorod.output.section_properties import section_properties
from isorod.output.words import duration
from isorod.space import Space
from isorod.space.basis import PAPER, POLYNOMIALS

SPRING = {"preset": "paper", "coils": 1, "elements_per_turn": 4, "section_points": 4}
BICEPS = {"elements": 5, "end_elements": 0, "order": 1, "section_points": 4, "end_time": 2e-3, "outputs": 4}
SOLVED = [
    ("spring", SPRING),
    ("spring", {"coils": 1, "section_points": 4, "nu": 0.5, "formulation": "mixed"}),
    ("blade", {"elements": 4}),
    ("biceps", BICEPS),
    ("biceps", BICEPS | {"statics": True, "activation": 0.2}),
]


def words_of(options):
    given = {key: value for key, value in options.items() if value is not True}
    return [f"--{key.replace('_', '-')}={value}" for key, value in given.items()] + [
        f"--{key}" for key in options if options[key] is True
    ]


def printed(capsys, *words):
    assert cli.main(["run", *words]) == 0
    return capsys.readouterr().out.splitlines()


def test_every_number_a_scene_measures_has_its_unit():
    for name, options in SOLVED:
        scene = scenes.find(name)(**options)
        settings = scene.settings() if scene.analysis == "dynamics" else {}
        solution, _ = solving.solve(scene, settings)
        assert scene.measure(solution).keys() <= scene.units.keys()


@pytest.mark.parametrize(
    ("words", "first"),
    [
        ("spring --coils 1", r"force +18\.89\d* \(unit of E x length\^2; mm and MPa give N\)"),
        ("blade --elements 4", r"frequencies +0\.\d+, 0\.\d+, .*"),
        ("biceps --order 1 --end-time 0.02", r"end force +\d+\.\d+, \d+\.\d+, \d+\.\d+, \d+\.\d+ N \(at lower and .*"),
        ("biceps --statics --order 1", r"end force +\d+\.\d+, \d+\.\d+, \d+\.\d+, \d+\.\d+ N \(at lower and .*"),
        ("flower", r"volume +6\.23844 \(cube of the unit that lengths are in\)"),
        ("ring", r"volume +118\.435 \(cube of the unit that lengths are in\)"),
    ],
)
def test_the_answer_comes_first_and_all_is_on_one_screen(words, first, capsys):
    lines = printed(capsys, *words.split())
    assert re.fullmatch(first, lines[0])
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80
    labels = [line[:19].strip() for line in lines if not line.startswith(" ")]
    assert labels[-1] == "more"
    if "ring" not in words.split() and "flower" not in words:
        family = PAPER if "--order 1" in words else POLYNOMIALS
        assert [line[20:].startswith(family) for line in lines if line.startswith("element ")] == [True]
        places = [labels.index(label) for label in ("size", "time", "convergence", "scene", "method", "versions")]
        assert places == sorted(places)


def test_the_numbers_are_those_of_the_record(capsys):
    whole = " ".join(" ".join(printed(capsys, "biceps", *words_of(BICEPS))).split())
    record = json.loads(printed(capsys, "biceps", "--json", *words_of(BICEPS))[0])
    assert ", ".join(f"{force:.6g}" for force in record["end_force"]) + " N" in whole
    force = record["contact_force"]
    largest = f" at the end, largest {max(force):.6g}" if max(force) > force[-1] else ""
    assert f"contact force {force[-1]:.6g}{largest} N" in whole
    assert f"{record['unknowns']:,} unknowns ({record['dofs']:,} degrees of freedom)" in whole
    assert f"{record['steps']:,} time steps of {record['time_step']:.4g}; energy within" in whole
    assert "biceps, dynamics; end time 0.002, outputs 4" in whole
    record |= {"contact_force": np.array([0.0, 3.0, 2.0, 1.5, 1.0]), "times": np.arange(5.0)}
    said = printing.summary(record, scenes.find("biceps")(**BICEPS))
    assert "contact force       1 at the end, largest 3 N" in said


def test_an_estimated_error_is_part_of_the_answer_with_a_word_that_once_asked_for_it_too(capsys):
    lines = printed(capsys, "spring", *words_of(SPRING))
    assert re.match(r"error +about \S+ %, of stresses \S+ %, by a finer space", lines[1])
    assert cli.main(["run", "spring", *words_of(SPRING), "--refine"]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[1] == lines[1]
    assert "isorod: warning: --refine: the error is estimated without it; leave it out\n" in err


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.0123, "12.3 ms"), (2.14, "2.1 s"), (59.9, "59.9 s"), (192.4, "3 min 12 s"), (3900.0, "1 h 5 min")],
)
def test_times_are_in_words(seconds, words):
    assert duration(seconds) == words


@pytest.mark.parametrize("options", ["-snes_monitor -ksp_view", "-log_view", "-help"])
def test_json_is_alone_on_standard_output(options, isorod):
    done = isorod("run", "spring", "--preset", "paper", "--no-estimate", *words_of(SPRING), "--json", *options.split())
    assert done.returncode == 0
    assert done.stdout.count("\n") == 1
    assert json.loads(done.stdout)["scene"] == "spring"
    for word in {"-log_view": ["Mflop"], "-help": ["-snes_rtol"]}.get(options, ["SNES Function norm", "KSP Object"]):
        assert word in done.stderr


def test_standard_output_is_given_back(python):
    script = "from isorod.command import cli; import os\ncli.main(['run', 'ring', '--json']); os.system('echo after')"
    lines = python(script).stdout.splitlines()
    assert json.loads(lines[0])["scene"] == "ring"
    assert lines[1:] == ["after"]


@pytest.fixture
def talkative(monkeypatch):
    """Let every call be the time to say something."""
    monkeypatch.setattr(progress, "_FIRST", 0.0)
    monkeypatch.setattr(progress, "_BETWEEN", 0.0)


@pytest.mark.parametrize("settings", [{}, {"integrator": "implicit", "time_step": 0.1}])
def test_progress_is_a_line_now_and_then_also_within_an_interval(settings, talkative, monkeypatch, capsys):
    monkeypatch.setattr(explicit, "_BLOCK", 1e-9)
    dynamics.solve(bar(law=MUSCLE), 1.0, outputs=2, ramp=0.5, progress=True, **settings)
    lines = capsys.readouterr().err.splitlines()
    found = [re.fullmatch(r"isorod: time (\S+) of 1, (\d+)%, about \S+ m?s to go", line) for line in lines]
    times = [float(one[1]) for one in found]
    assert len(times) >= 4
    assert times == sorted(times) and times[-1] == 1.0
    assert [int(one[2]) for one in found] == pytest.approx([100 * time for time in times], abs=0.51)


def test_statics_say_how_far_they_are(talkative, capsys):
    space = Space(center_line.straight(10.0).sweep(section.circle(8)), order=1, elements=4, degree=3)
    below = Contact(0, Plane((0.0, -1.05, 0.0), (0.0, 1.0, 0.0)), penalty=10.0)
    held = Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, -0.06, 0.0))
    statics.solve(Model([Body(space, NeoHookean(1.0, 0.3))], held, contacts=[below]), load_steps=2, progress=True)
    lines = capsys.readouterr().err.splitlines()
    number = r"-?[\d.]+(?:e[+-]\d+)?"
    told = rf"isorod: load factor ({number}), iteration (\d+), residual force {number}, ([\d,]+) points in contact"
    found = [re.fullmatch(rf"{told}(, \d+ steps cut)?", line) for line in lines]
    assert found and all(found), lines
    assert {float(one[1]) for one in found} >= {0.5, 1.0}
    assert int(found[-1][3]) > 0


def test_modes_say_how_far_they_are(talkative, capsys):
    space = Space(center_line.straight(10.0).sweep(section.circle(8)), order=1, elements=4, degree=3)
    model = Model([Body(space, NeoHookean(1.0, 0.3), 1.0)], [Support.end(space, "start")])
    modal.solve(model, 4, progress=True)
    first, *lines = capsys.readouterr().err.splitlines()
    assert first == f"isorod: modes: {model.unknowns} unknowns, assembled"
    found = [re.fullmatch(r"isorod: modes: \d+ unknowns, restart (\d+), (\d+) of 5 found", line) for line in lines]
    assert found and all(found), lines
    assert int(found[-1][2]) >= 4
    modal.solve(model, 4)
    assert capsys.readouterr().err == ""


def test_sections_say_how_far_they_are(talkative, capsys):
    rod = center_line.straight(10.0).sweep(section.circle(8))
    section_properties(rod, material=NeoHookean(1.0, 0.3), progress=True)
    first, second, *_ = capsys.readouterr().err.splitlines()
    assert re.fullmatch(r"isorod: section on polynomials of degree \d", first)
    assert re.match(r"isorod: section on polynomials of degree \d", second)
    section_properties(rod, material=NeoHookean(1.0, 0.3))
    assert capsys.readouterr().err == ""


def test_the_time_to_go_is_that_of_the_way_left(talkative, monkeypatch, capsys):
    clock = iter([100.0, 110.0, 110.0, 130.0, 130.0])
    monkeypatch.setattr(progress, "perf_counter", lambda: next(clock))
    shown = progress.Progress(2.0, 10.0)
    shown(4.0)
    shown(8.0)
    assert capsys.readouterr().err == (
        "isorod: time 4 of 10, 40%, about 30.0 s to go\nisorod: time 8 of 10, 80%, about 10.0 s to go\n"
    )


def test_lines_are_seconds_apart_and_short_runs_say_nothing(monkeypatch, capsys):
    clock = [0.0]
    monkeypatch.setattr(progress, "perf_counter", lambda: clock[0])
    shown, said = progress.Progress(0.0, 100.0), []
    for second in range(1, 101):
        clock[0] = second
        shown(float(second))
        if capsys.readouterr().err:
            said.append(second)
    assert 5 <= said[0] <= 10
    assert {10 <= later - sooner <= 30 for sooner, later in pairwise(said)} == {True}
    dynamics.solve(bar(), 0.2, outputs=2, progress=True)
    assert capsys.readouterr().err == ""


def test_a_terminal_gets_a_bar_whose_line_is_ended(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", stream)
    for name in ("_FIRST_SHOWN", "_BETWEEN_SHOWN"):
        monkeypatch.setattr(progress, name, 0.0)
    monkeypatch.setattr(explicit, "_BLOCK", 1e9)
    dynamics.solve(bar(), 1.0, outputs=4, progress=True)
    first, *bars = stream.getvalue().split("\r")
    assert first == "" and len(bars) >= 4
    assert re.match(r"\[={30}\] time 1 of 1, 100%, about 0 ms to go", bars[-1])
    assert bars[-1].endswith("\n")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([0.0, -2.0, -0.5], "-0.5 at the end, largest -2 length"),
        ([0.0, 3.0, -0.5], "-0.5 at the end, largest 3 length"),
        ([0.0, -0.5], "-0.5 length"),
        ([0.0, 0.5], "0.5 length"),
    ],
)
def test_the_largest_of_a_motion_is_that_in_size(values, words):
    record = {"times": list(range(len(values))), "sag": values}
    assert list(printing._answer(record, {"sag": "length"}, ())) == [("sag", words)]


def test_a_model_that_takes_long_says_so_before_it_begins(monkeypatch, capsys):
    """Nothing is said of one that does not."""

    def stopped(model, **settings):
        raise SolveError("begun")

    monkeypatch.setattr(statics, "solve", stopped)
    for words, said in (([], ""), (["--section-points=100"], "36,000 degrees of freedom, 3,000 of them in an element")):
        assert cli.main(["run", "coil", *words]) == 2
        assert (
            capsys.readouterr().err
            == (f"isorod: {said}: each iteration takes long\n" if said else "") + "isorod: begun\n"
        )
