"""Design and identification: closed forms, twins, files that run again, and what cannot be had."""

import importlib
import json
import tomllib

import numpy as np
import pytest

from isorod import InputError, files
from isorod.command import solving
from isorod.design import constraints, evaluations, optimise, parameters
from isorod.files.rewritten import rewritten
from isorod.statics.differences import Unavailable

# A cantilever of slender beam theory: w = 4 F L^3 / (3 pi E r^4).
BEAM = """
title = "cantilever"   # as in books

[rod.beam]
curve = {straight = 60.0}
section = {circle = 1.0}   # its radius
law = {LinearElastic = {E = 2.1e5, nu = 0.3}}
density = 2.0
space = {elements = 4, degree = 5, section_degree = 3}

[support.wall]
end = "start"

[load.tip]
end = "end"
force = [0.0, -10.0, 0.0]

[analysis.statics]

[measure.deflection]
displacement = "beam"
component = "y"
"""

# Pulled and twisted.
TWIN = """
[rod.bar]
curve = {straight = 4.0}
section = {circle = 1.0}
law = {NeoHookean = {E = 100.0, nu = 0.3}}
density = 1.0
space = {elements = 2, degree = 4, section_degree = 3}

[support.wall]
end = "start"

[support.grip]
end = "end"
displacement = [0.0, 0.0, 0.5]
rotation = [0.0, 0.0, 20.0]

[analysis.statics]

[measure.force]
reaction = "grip"
component = "z"

[measure.torque]
moment = "grip"
component = "z"
"""

LAW = "rod.bar.law.NeoHookean"
PULL, TURN = "support.grip.displacement.2", "support.grip.rotation.2"


@pytest.fixture
def beam(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "beam.toml").write_text(BEAM)
    return tmp_path


@pytest.fixture
def twin(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "twin.toml").write_text(TWIN)
    return tmp_path


def tabled(path, header, rows):
    path.write_text("\n".join([header, *(",".join(map(repr, row)) for row in rows)]) + "\n")


def test_the_lightest_cantilever_of_a_stiffness_is_that_of_books_and_its_file_runs(command, beam):
    words = ("beam.toml", "--vary", "rod.beam.section.circle=0.5:2", "--limit", "deflection>-1", "--minimise", "mass")
    found = command.record("design", *words, "--output", "best.toml")
    radius = found["parameters"]["rod.beam.section.circle"]["after"]
    assert radius == pytest.approx((40.0 * 60.0**3 / (3.0 * np.pi * 2.1e5)) ** 0.25, rel=2e-3)
    assert found["answers"]["deflection"]["after"] == pytest.approx(-1.0, abs=2e-4)
    # The mass goes with the square of the radius, the deflection with its fourth power.
    (price,) = found["active"].values()
    assert price == pytest.approx(0.5, abs=2e-3)
    assert found["solves"] <= 30
    assert not found["missed"]
    text = (beam / "best.toml").read_text()
    assert "# as in books" in text
    assert "# its radius" in text
    again = command.record("run", "best.toml", "--no-estimate")
    assert again["deflection"] == pytest.approx(found["answers"]["deflection"]["after"], rel=1e-6)


def test_targets_alone_are_met_with_the_least_change(command, beam):
    vary = "rod.beam.section.circle=0.5:2,rod.beam.curve.straight=30:90"
    found = command.record("design", "beam.toml", "--vary", vary, "--target", "deflection=-1")
    radius, length = (one["after"] for one in found["parameters"].values())
    assert 4.0 * 10.0 * length**3 / (3.0 * np.pi * 2.1e5 * radius**4) == pytest.approx(1.0, rel=1e-2)
    # Of those of one L^3 / r^4 the nearest by shares: steps stand across the curve.
    share = length / 60.0
    assert 3.0 * (radius - 1.0) * radius == pytest.approx(-4.0 * (share - 1.0) * share, rel=1e-2)


def test_what_cannot_be_met_ends_with_2_and_says_by_how_much(command, beam, capsys):
    words = ("--vary", "rod.beam.section.circle=0.9:1.1", "--target", "deflection=-0.1")
    code, out, err = command._run(("design", "beam.toml", *words))
    assert code == 2
    assert "required = -0.1" in out
    assert "targets or limits are not met: deflection = -2.9" in err
    assert "rod.beam.section.circle at its upper bound 1.1" in err


def test_targets_that_depend_on_each_other_are_named(command, beam):
    """The mass is the volume times a density, and a third target is one more than two numbers meet."""
    vary = "rod.beam.section.circle=0.5:2,rod.beam.curve.straight=30:90"
    words = ("design", "beam.toml", "--vary", vary, "--target", "mass=300,volume=160,deflection=-4")
    code, _, err = command._run(words)
    assert code == 2
    assert "(targets mass, volume: one depends on the others, whatever varies; leave one out, or vary more)" in err


def test_a_search_ends_and_the_model_solved_anew_is_judged(command, beam, monkeypatch):
    vary, design = "rod.beam.section.circle=0.5:2", importlib.import_module("isorod.command.design")
    words = ("design", "beam.toml", "--vary", vary, "--target", "deflection=-1")
    with monkeypatch.context() as patch:
        patch.setattr(optimise, "SOLVES", 2)
        code, _, err = command._run(words)
        assert code == 2 and "no end after 2 solves" in err

    def other(own, x):
        answer = own.freeze(x)
        return answer._replace(values={"deflection": -1.1, "mass": 1.0}), None, []

    monkeypatch.setattr(design, "solve_anew", other)
    code, _, err = command._run(words)
    assert code == 2 and "targets or limits are not met: deflection = -1.1, required = -1" in err


def test_a_design_that_folds_is_left_for_one_that_does_not(command, twin):
    """The first step goes to the bound, where the section reaches past the middle of the arc."""
    arc = TWIN.replace("{straight = 4.0}", "{arc = {radius = 4.0, angle = 90.0}}").replace(
        "[0.0, 0.0, 0.5]", "[0, 0, 0.1]"
    )
    (twin / "arc.toml").write_text("\n".join(line for line in arc.split("\n") if not line.startswith("rotation")))
    section = "rod.bar.section.circle"
    wanted_ = command.record("run", "arc.toml", "--no-estimate", "--set", f"{section}=1.3")["force"]
    words = ("--set", f"{section}=0.4", "--vary", f"{section}=0.2:5", "--target", f"force={wanted_!r}")
    found = command.record("design", "arc.toml", *words)
    assert found["parameters"][section]["after"] == pytest.approx(1.3, rel=1e-3)
    assert not found["missed"]


def test_a_curve_is_met_in_the_mean_and_drawn(command, beam):
    """Deflections of a cantilever are as the inverse fourth power of its radius."""
    loads = (-5.0, -20.0)
    rows = [(load, 4.0 * load * 60.0**3 / (3.0 * np.pi * 2.1e5 * 1.3**4)) for load in loads]
    tabled(beam / "wanted.csv", "load.tip.force.1,deflection", rows)
    words = ("--vary", "rod.beam.section.circle=0.5:2", "--table", "wanted.csv", "--png", "met.png")
    found = command.record("design", "beam.toml", *words)
    assert found["parameters"]["rod.beam.section.circle"]["after"] == pytest.approx(1.3, rel=2e-3)
    assert found["answers"]["misfit"]["after"] < 1e-5
    assert found["given"]["load.tip.force.1"] == [*loads]
    one = found["curves"]["deflection"]
    assert one["after"] == pytest.approx(one["wanted"], rel=1e-4)
    assert found["solves"] <= 30
    assert (beam / "met.png").stat().st_size > 0


def test_a_design_on_too_few_elements_says_how_far_it_is_off(command, beam):
    text = BEAM.replace("{elements = 4, degree = 5", "{elements = 1, degree = 2")
    text = text.replace("LinearElastic = {E = 2.1e5", "NeoHookean = {E = 2.1e4")
    (beam / "few.toml").write_text(text)
    words = ("few.toml", "--vary", "rod.beam.section.circle=0.5:2", "--target", "deflection=-20")
    code, _, err = command._run(("design", *words))
    assert code == 0
    assert "the optimal parameters have an error of this size; give the file a finer space" in err


def test_a_target_that_leaves_no_choice_is_met_at_once(command, beam):
    """A thicker beam bends less, and is heavier: steps to the target are not shortened by what is least."""
    words = ("--vary", "rod.beam.section.circle=0.5:2", "--target", "deflection=-0.6", "--minimise", "mass")
    found = command.record("design", "beam.toml", *words)
    assert found["answers"]["deflection"]["after"] == pytest.approx(-0.6, rel=1e-4)
    assert found["solves"] <= 8


def test_mass_is_worth_what_it_is_in_modes_too(command, beam):
    """Frequencies of bending go with the radius, the mass with its square."""
    modes = BEAM.replace("[analysis.statics]", "[analysis.modal]\nmodes = 2").partition("[load.tip]")[0]
    text = f"{modes}\n[analysis.modal]\nmodes = 2\n[measure.first]\nfrequency = 'beam'\nshape = 'bending'\n"
    (beam / "modes.toml").write_text(text)
    words = ("--vary", "rod.beam.section.circle=0.5:2", "--limit", "first>0.03", "--minimise", "mass")
    found = command.record("design", "modes.toml", *words)
    (price,) = found["active"].values()
    assert price == pytest.approx(2.0, abs=1e-2)


def test_where_answers_tell_no_derivatives_they_are_differences(twin, monkeypatch):
    scene = files.find("twin.toml")
    own = evaluations.Evaluations({"": scene}, [f"{LAW}.E", f"{LAW}.nu"], {}, solving.solve_scene)
    x = np.array([100.0, 0.3])
    answer = own.freeze(x)
    exact = own.derivatives(x, answer)
    assert not own.fallback

    def refuse(*given):
        raise Unavailable("derivatives: not told with contact; isorod sweep varies the parameter")

    monkeypatch.setattr(type(answer.solutions[0]), "derivatives", refuse)
    found = own.derivatives(x, answer)
    assert own.fallback == "not told with contact"
    assert own.solves == 1 + 2 * len(x)
    for name in ("force", "torque"):
        assert found[name] == pytest.approx(exact[name], rel=1e-5, abs=1e-5 * np.abs(exact[name]).max())


REFUSED = [
    (("--vary", "rod.beam.section.circle", "--png", "x.png"), "--png: it plots a target curve; give one with --table"),
    (
        ("--vary", "rod.beam.section.circle", "--table", "beam.csv", "--minimise", "mass"),
        "--minimise: with --table the curve's misfit is least",
    ),
    (
        ("--vary", "rod.beam.section.circle", "--table", "beam.csv", "--limit", "sag<1"),
        "--limit sag: not measured; there are: volume, mass, deflection",
    ),
    (("--vary", "rod.beam.section.round"), "'rod.beam.section.round' is no parameter of the scene that can vary"),
    (("--vary", "rod.beam.section.circle=1.5:2"), "it begins at 1, need bounds about that"),
    (("--vary", "rod.beam.section.circle=2:1"), "need a lower bound below the upper one"),
    (("--vary", "rod.beam.section.circle=-1:2"), "bounds on both sides of zero"),
    (("--vary", "rod.beam.section.circle=1"), "need bounds lower:upper"),
    (("--vary", "rod.beam.section.circle"), "design: no objective or constraint"),
    ((), "--vary: name what may change"),
    (("--vary", "rod.beam.section.circle", "--target", "sag=1"), "--target sag: not measured; there are: volume"),
    (("--vary", "rod.beam.section.circle", "--target", "deflection<1"), "--target deflection<1: need a name, = and"),
    (("--vary", "rod.beam.section.circle", "--limit", "deflection<x"), "got 'x', need a number"),
    (("--vary", "rod.beam.section.circle", "--minimise", "mass", "--output", "x.txt"), "a name that ends in .toml"),
    (
        ("--vary", "rod.beam.section.circle", "--set", "rod.beam.space.continuity=2", "--output", "x.toml"),
        "rod.beam.space.continuity: its number does not stand in the file; write it there",
    ),
]


@pytest.mark.parametrize(("words", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_what_makes_no_design_is_refused(command, beam, words, message):
    tabled(beam / "beam.csv", "load.tip.force.1,deflection", [(-10.0, -1.0)])
    assert message in command.refuses("design", "beam.toml", *words)


def test_modulus_and_ratio_of_poisson_are_found_again(command, twin):
    scene, rows = files.find("twin.toml"), []
    from isorod import statics

    for pull, turn in ((0.2, 10.0), (0.6, 5.0)):
        one = parameters.at(scene, {f"{LAW}.E": 137.0, f"{LAW}.nu": 0.41, PULL: pull, TURN: turn})
        answer = one.measure(statics.solve(one.model()))
        rows.append((pull, turn, answer["force"], answer["torque"]))
    tabled(twin / "twin.csv", f"{PULL},{TURN},force,torque", rows)
    vary = f"{LAW}.E=50:300,{LAW}.nu=0.1:0.48"
    found = command.record("identify", "twin.toml", "--table", "twin.csv", "--vary", vary)
    assert found["parameters"][f"{LAW}.E"]["found"] == pytest.approx(137.0, rel=1e-6)
    assert found["parameters"][f"{LAW}.nu"]["found"] == pytest.approx(0.41, rel=1e-6)
    assert found["misfit"] < 1e-8
    assert 0.0 < found["error_estimate"] < 0.05
    assert np.array(found["covariance"]).shape == (2, 2)


def test_standard_errors_are_those_of_a_straight_line(command, twin):
    """The force is proportional to the modulus: its error is that of the mean of ratios."""
    scene = files.find("twin.toml")
    from isorod import statics

    rows, forces, noise = [], [], np.array([0.01, -0.02, 0.015])
    for k, pull in enumerate((0.2, 0.3, 0.4)):
        one = parameters.at(scene, {PULL: pull})
        forces.append(float(one.measure(statics.solve(one.model()))["force"]))
        rows.append((pull, forces[-1] + float(noise[k])))
    tabled(twin / "twin.csv", f"{PULL},force", rows)
    found = command.record("identify", "twin.toml", "--table", "twin.csv", "--vary", f"{LAW}.E=50:300")
    shape = np.array(forces) / 100.0
    modulus = shape @ (np.array(forces) + noise) / (shape @ shape)
    rest = np.array(forces) + noise - modulus * shape
    error = np.sqrt(rest @ rest / 2.0 / (shape @ shape))
    one = found["parameters"][f"{LAW}.E"]
    assert one["found"] == pytest.approx(modulus, rel=1e-6)
    assert one["standard_error"] == pytest.approx(error, rel=1e-3)


def test_a_fit_on_too_few_elements_says_how_far_it_is_off(command, beam):
    text = BEAM.replace("{elements = 4, degree = 5", "{elements = 1, degree = 2")
    (beam / "beam.toml").write_text(text.replace("LinearElastic = {E = 2.1e5", "NeoHookean = {E = 2.1e4"))
    tabled(beam / "beam.csv", "load.tip.force.1,deflection", [(-10.0, -20.0)])
    code, out, err = command._run(("identify", "beam.toml", "--table", "beam.csv", "--vary", "rod.beam.section.circle"))
    assert code == 0
    assert "; error about" in out and "+-" not in out
    assert "the optimal parameters have an error of this size" in err


TABLES = [
    (f"force,{PULL}\n1.0,0.1\n", (f"{LAW}.E", f"{LAW}.nu"), "1 measured values for 2 numbers"),
    (f"sag,{PULL}\n1.0,0.1\n", (f"{LAW}.E",), "column 'sag' is no parameter of the scene, nor measured"),
    (f"{PULL},{TURN}\n1.0,5.0\n", (f"{LAW}.E",), "no column of what is measured"),
    (f"{LAW}.E,force\n1.0,2.0\n", (f"{LAW}.E",), "it cannot both vary and be given in the table"),
    (
        f"torque,{TURN}\n2.0,5.0\n3.0,6.0\n",
        ("rod.bar.density",),
        "rod.bar.density: the measured values do not determine it",
    ),
]


@pytest.mark.parametrize(("table", "names", "message"), TABLES, ids=[message for *_, message in TABLES])
def test_tables_that_tell_nothing_are_refused(command, twin, table, names, message):
    (twin / "t.csv").write_text(table)
    words = ("twin.toml", "--table", "t.csv", "--vary", ",".join(names))
    assert message in command.refuses("identify", *words)


def test_a_file_is_rewritten_in_place():
    text = 'a = 1 # one\n[b]\nc = {d = 2.5, e = [1, 2,\n 3]}\n[[f]]\ng = 1e3\n"h.i" = "7"\n'
    new = rewritten(text, {"b.c.d": 0.25, "b.c.e.2": 9.0, "f.0.g": -1.0})
    assert new == text.replace("2.5", "0.25").replace(" 3]", " 9]").replace("1e3", "-1")
    assert tomllib.loads(new)["f"][0]["g"] == -1
    with pytest.raises(InputError, match="does not stand in the file"):
        rewritten(text, {"b.x": 1.0})


def test_what_varies_may_be_all_of_a_table(beam):
    scene = files.find("beam.toml")
    names = [one.name for one in constraints.varied(["rod.beam.law"], scene)]
    assert names == ["rod.beam.law.LinearElastic.E", "rod.beam.law.LinearElastic.nu"]


@pytest.mark.slow
def test_the_stiffest_cantilever_of_a_volume(command, beam):
    """Its radius is as the cube root of the way from the tip, its compliance 81 / 125 of that of the uniform one."""
    points = ", ".join(["1.0"] * 9)
    curve = "{straight = {length = 100.0, breaks = [0, 1, 2, 3, 4, 5, 6, 7, 8]}}"
    text = BEAM.replace("{straight = 60.0}", f"{curve}\nscale = [{points}]")
    (beam / "taper.toml").write_text("\n".join(line for line in text.split("\n") if not line.startswith("space")))
    words = ("--vary", "rod.beam.scale=0.3:1.6", "--target", f"volume={100.0 * np.pi!r}", "--maximise", "deflection")
    found = command.record("design", "taper.toml", *words)
    one = found["answers"]["deflection"]
    assert one["after"] / one["before"] == pytest.approx(81.0 / 125.0, rel=5e-3)
    assert found["solves"] <= 30
    json.dumps(found)
