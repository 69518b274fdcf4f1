"""The command: what it prints, which PETSc options it takes, and bad input answered in one line with nothing left
behind.
"""

import json
import re
import subprocess
import sys

import pytest

from isorod import __version__, scenes, statics
from isorod.command import cli

COARSE = "--preset paper --no-estimate --coils 1 --elements-per-turn 4 --section-points 3 --degree 2".split()


@pytest.fixture
def refused(capsys, tmp_path, recwarn):
    """Run in this process; return the one line of complaint, having made sure that it is the only effect."""

    def run(*arguments: str, output: bool = True) -> str:
        folder = tmp_path / "new" / "results"
        code = cli.main([*arguments, "--output", str(folder)] if output else list(arguments))
        out, err = capsys.readouterr()
        assert (code, out) == (2, "")
        assert re.fullmatch(r"isorod: .+\n", err), err
        assert not any(tmp_path.iterdir())
        return err

    return run


BAD = [
    ("--section-points 2", "section control points: got 2, need an integer"),
    ("--section-points 0", "section control points: got 0"),
    ("--section-points -3", "section control points: got -3"),
    ("--section-points 3.5", "--section-points: invalid int value: '3.5'"),
    ("--section-points nan", "--section-points: invalid int value: 'nan'"),
    ("--section-points", "--section-points: expected one argument"),
    ("--coils 0", "got 0 turns"),
    ("--coil-radius 0", "radius: got 0, need a positive length"),
    ("--coil-radius -6", "radius: got -6, need a positive length"),
    ("--coil-radius nan", "radius: got nan, need a positive length"),
    ("--coil-radius inf", "radius: got inf"),
    ("--coil-radius six", "--coil-radius: invalid float value: 'six'"),
    ("--wire-radius 0", "got 0, need a positive length"),
    ("--wire-radius -1", "got -1, need a positive length"),
    ("--wire-radius nan", "got nan, need a positive length"),
    (
        "--wire-radius 7 --pitch 14.1",
        r"folds in element \d+ at u = .*position \(.*Jacobian determinant -.*must be positive",
    ),
    ("--coil-radius 0.4", r"folds in element \d+ at u"),
    ("--pitch nan", "pitch: got nan, need a finite length"),
    ("--pitch=-inf", "pitch: got -inf, need a finite length"),
    ("--travel nan", "displacement .*nan.* is not finite"),
    ("--travel inf", "displacement .*inf.* is not finite"),
    ("--E 0", "E: got 0, need a positive stress"),
    ("--E -5", "E: got -5, need a positive stress"),
    ("--E nan", "E: got nan, need a positive stress"),
    ("--E inf", "E: got inf, need a positive stress"),
    ("--nu 0.5 --formulation displacement", "incompressible \\(nu = 0.5, or .*\\); that takes formulation .mixed."),
    ("--nu 0.7", "nu: got 0.7, need"),
    ("--nu -1", "nu: got -1, need"),
    ("--nu nan", "nu: got nan, need"),
    ("--elements-per-turn 6", "elements a turn: got 6, need a multiple of 8"),
    ("--elements-per-turn 0", "elements a turn: got 0"),
    ("--elements-per-turn -4", "elements a turn: got -4"),
    ("--degree 3", "degree: got 3, need an integer from 4 to 6"),
    ("--helix paper --degree 1", "degree: got 1, need an integer from 2 to 6"),
    ("--degree 7", "degree: got 7"),
    ("--degree 4 --continuity 4", "continuity: got 4, need an integer from 0 to 3"),
    ("--continuity -1", "continuity: got -1"),
    ("--quadrature best", "quadrature: got 'best', need .*'paper', 'full' or RxSxT"),
    ("--quadrature 2x1x3x4", "quadrature: got '2x1x3x4'"),
    ("--quadrature 0x1x3", "radial points: got 0, need an integer from 1 to 64"),
    ("--load-steps 0", "load steps: got 0, need at least 1"),
    ("--load-steps -2", "load steps: got -2"),
    ("--section-point 4", "option --section-point is not known; did you mean --section-points?"),
    ("--push 4", "option --push is not known; of the scene there are: --coils, "),
    ("stray", "stray"),
    ("--section-points 5000", "section control points: got 5000, need an integer from 3 to"),
    ("--coils 100000000", "too many; at most"),
    ("--elements-per-turn 400000000", "got .*, need an integer from 1 to"),
    ("--travel 1e6", r"load factor .* element \d+ of body 0, axis position u = .*: det F = "),
    ("--coil-radius 1e300", "need 1e-100 to 1e100"),
]


@pytest.mark.parametrize(("arguments", "message"), BAD)
def test_bad_input_to_the_spring_is_one_line(arguments, message, refused):
    assert re.search(message, refused("run", "spring", *arguments.split()))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("run ring --a 4.5", "folds in element"),
        ("run ring --a 0", "got 0, need a positive length"),
        ("run ring --radius nan", "got nan, need a positive length"),
        ("run ring --section-points 2", "section control points: got 2"),
        ("run ring --load-steps 2", "option --load-steps is not known"),
        ("run ring -snes_monitor", "option -snes_monitor: .* is geometry only"),
        ("run flower --depth 0.95", r"folds in element 0 at u .*disk point .*position"),
        ("run flower --depth 1", "depth: got 1, need 0 <= depth < 1"),
        ("run flower --depth nan", "depth: got nan"),
        ("run flower --length 0", "length: got 0, need a positive length"),
        ("run flower --radius 1e200", "not a finite number|folds"),
        ("run coils", "scene 'coils' is not known; there are: .*spring"),
    ],
)
def test_bad_input_to_other_scenes_is_one_line(arguments, message, refused):
    assert re.search(message, refused(*arguments.split()))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["walk"], "invalid choice: 'walk'"),
        (["--nonsense"], "option --nonsense is not known"),
        (["list", "more"], "more"),
        (["list", "-snes_monitor"], "PETSc options go with 'isorod run SCENE'"),
        (["-snes_monitor", "run", "ring"], "option -snes_monitor: PETSc options go with 'isorod run SCENE'"),
        (["--json", "run", "ring"], "option --json: put it after the command: isorod run SCENE --json"),
        (
            ["run", "--json", "rng"],
            "scene missing; known: biceps, blade, clasp, coil, creep, flower, knot, ring, rope, set, spring, strand; "
            "put it first",
        ),
        (["run", "--radius", "2"], "scene missing; .*put it first: isorod run SCENE --radius"),
        (["run", "--output", "ring"], "scene missing; "),
        (
            ["run", "-snes_monitor", "spring"],
            "scene missing: spring was read as the value of -snes_monitor; put it first: "
            "isorod run spring -snes_monitor",
        ),
        (["run", ""], "scene '' is not known"),
        (["run", "spring", "--output", ""], "results folder"),
        (["run", "spring", "--output"], "--output: expected one argument"),
        (["run", "spring", "--output", "/proc/results"], "results folder /proc/results: cannot write there"),
        (["run", "spring", "--output", "/dev/null/results"], "results folder /dev/null/results: cannot write there"),
        (["run", "ring", "--output", "/dev/null"], "results folder /dev/null: cannot write there"),
        (["run", "spring", "--json=yes"], "--json"),
    ],
)
def test_bad_command_is_one_line(arguments, message, refused):
    assert re.search(message, refused(*arguments, output=False))


@pytest.mark.parametrize(
    "words",
    ["--json ring", "--radius 5 --json ring", "--json --radius=5 ring --a 1.1", "--output ring ring --json"],
)
def test_options_may_come_before_the_scene(words, capsys, tmp_path, monkeypatch):
    """A name that is an option's value is not taken for the scene's."""
    monkeypatch.chdir(tmp_path)
    assert cli.main(["run", *words.split()]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["scene"] == "ring"
    assert record["options"]["radius"] == (5.0 if "radius" in words else 4.0)
    assert record["options"]["a"] == (1.1 if "--a" in words else 1.0)
    assert [one.name for one in tmp_path.iterdir()] == (["ring"] if "output" in words else [])


def test_the_package_runs_as_the_command(tmp_path):
    done = subprocess.run([sys.executable, "-m", "isorod", "--version"], capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"isorod {__version__}\n", "")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("-nosuch 3", "PETSc option -nosuch 3: nothing used it"),
        ("-snes_rtoll 1e-3", "PETSc option -snes_rtoll 1e-3: nothing used it"),
        ("-snes_rtol abc", "abc"),
        ("-ksp_type nosuch", "nosuch"),
        ("-snes_linesearch_type nosuch", "nosuch"),
        ("-mat_type nosuch", "nosuch"),
        ("-pc_factor_mat_solver_type nosuch", "nosuch"),
        ("-ksp_type cg -pc_type none -ksp_max_it 2", "linear solver failed"),
        ("-options_file /no/such/file", "/no/such/file"),
    ],
)
def test_bad_petsc_option_is_one_line(options, message, command, tmp_path):
    said = command.refuses("run", "spring", *COARSE, "--json", "--output", tmp_path / "new", *options.split())
    assert message in said
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "solver"),
    [
        ("-ksp_type gmres -pc_type lu", {"ksp": "gmres", "pc": "lu"}),
        ("-ksp_type cg -pc_type gamg -ksp_rtol 1e-9", {"ksp": "cg", "pc": "gamg"}),
        ("-pc_type cholesky", {"ksp": "preonly", "pc": "cholesky"}),
        ("-pc_factor_mat_solver_type mumps", {"pc": "lu", "factor": "mumps"}),
        ("-snes_type newtontr -snes_rtol 1e-12", {"snes": "newtontr"}),
        ("-mat_type baij", {"pc": "lu"}),
    ],
)
def test_petsc_options_of_the_user_win_and_the_force_is_the_same(options, solver, command):
    record = command.record("run", "spring", *COARSE, *options.split())
    assert solver.items() <= record["solver"].items()
    assert record["petsc_options"] == options
    assert record["force"] == pytest.approx(coarse_force(), rel=1e-6)


def coarse_force():
    scene = scenes.find("spring")(preset="paper", coils=1, elements_per_turn=4, section_points=3, degree=2)
    return statics.solve(scene.model()).reactions[1, 2]


def test_snes_monitor_and_tolerances(isorod):
    done = isorod("run", "spring", *COARSE, "-snes_monitor", "-snes_rtol", "1e-14", "--json")
    assert done.returncode == 0
    norms = [float(line.split()[-1]) for line in done.stderr.splitlines() if "SNES Function norm" in line]
    record = json.loads(done.stdout)
    assert norms == pytest.approx(record["residual_norms"][1:], rel=1e-6)
    loose = isorod("run", "spring", *COARSE, "--json", "-snes_rtol", "0.1")
    assert len(json.loads(loose.stdout)["residual_norms"]) < len(record["residual_norms"])


def test_help_of_petsc_and_of_the_scene(isorod, capsys):
    assert "-snes_rtol" in isorod("run", "spring", *COARSE, "-help").stdout
    with pytest.raises(SystemExit) as ended:
        cli.main(["run", "spring", "--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    for option in (
        "--section-points",
        "--elements-per-turn",
        "--degree",
        "--continuity",
        "--quadrature",
        "--json",
        "--output",
    ):
        assert option in text


def test_json_line_of_the_papers_model(capsys):
    options = "--section-points 4 --elements-per-turn 24 --degree 2 --continuity 0 --quadrature paper --order 1"
    options += " --helix paper --json"
    assert cli.main(["run", "spring", *options.split()]) == 0
    out, err = capsys.readouterr()
    # Its stiffness is 0.4 % off, and its force across the axis more.
    assert (out.count("\n"), err.count("\n")) == (1, 1)
    assert err.startswith("isorod: warning: estimated error 1 %")
    record = json.loads(out)
    assert record["scene"] == "spring"
    assert record["dofs"] == 1740
    assert record["force"] == pytest.approx(6.11448, rel=2e-3)
    assert record["newton_iterations"] >= 2
    assert {"setup", "assembly", "solve"} <= record["seconds"].keys()
    assert all(value >= 0 for value in record["seconds"].values())
    assert record["built"] == ["tangent"]
    assert record["quadrature"] == ["2x1x3"]
    assert {"versions", "commit", "machine", "time", "ranks", "solver", "petsc_options", "unknowns"} <= record.keys()


def test_without_json_the_result_is_in_words(capsys):
    assert cli.main(["run", "spring", *COARSE]) == 0
    out = capsys.readouterr().out
    assert float(re.match(r"force +(\S+) ", out)[1]) == pytest.approx(coarse_force(), rel=1e-5)
    assert re.search(r"^time +.*s \(set-up .*, assembly .*, solve ", out, re.M)


@pytest.mark.parametrize("pitch", ["1.9", "0", "-1"])
def test_pitch_below_the_wires_diameter_warns_in_one_line_and_goes_on(pitch, capsys):
    assert cli.main(["run", "spring", "--coils", "2", *COARSE[:3], *COARSE[5:], f"--pitch={pitch}", "--json"]) == 0
    out, err = capsys.readouterr()
    # Pulled, the coils of the first pitch come apart.
    still = "" if pitch == "1.9" else "isorod: warning: final overlap: body 0 .* penetrates itself .*\n"
    assert re.fullmatch(rf"isorod: warning: pitch .* is less than the wire's diameter 2: .*\n{still}", err)
    assert json.loads(out)["scene"] == "spring"


def test_pitch_above_the_wires_diameter_does_not_warn(capsys):
    assert cli.main(["run", "spring", *COARSE, "--pitch", "2.1", "--json"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("value", ["-1e-3", "-1E-3", "-.001", "-0.001"])
def test_negative_numbers_are_values(value, capsys):
    assert cli.main(["run", "spring", *COARSE, "--travel", value, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["options"]["travel"] == -0.001
    assert record["force"] < 0


def test_output_holds_the_records_and_the_fields(command, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    folder = tmp_path / "far" / "results"
    records = []
    for k in range(2):
        records.append(command.record("run", "spring", *COARSE, "--output", folder))
        assert [json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines()] == records, k
    assert sorted(file.name for file in folder.iterdir()) == [
        "results.jsonl",
        "spring-0.vtu",
        "spring-run2-0.vtu",
        "spring-run2.csv",
        "spring.csv",
    ]
    assert [record["files"] for record in records] == [
        ["spring-0.vtu", "spring.csv"],
        ["spring-run2-0.vtu", "spring-run2.csv"],
    ]
    mesh = pyvista.read(folder / "spring-0.vtu")
    assert {"displacement", "von_mises"} <= set(mesh.point_data.keys())
    assert mesh.point_data["displacement"][-1] == pytest.approx([0, 0, 2], abs=1e-6)


def test_output_of_a_geometry_scene_is_its_record(capsys, tmp_path):
    assert cli.main(["run", "ring", "--json", "--output", str(tmp_path)]) == 0
    assert (tmp_path / "results.jsonl").read_text() == capsys.readouterr().out


def test_results_that_cannot_be_written_are_printed_and_it_is_said_in_one_line(capsys, tmp_path):
    (tmp_path / "results.jsonl").mkdir()
    assert cli.main(["run", "ring", "--json", "--output", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert json.loads(out)["scene"] == "ring"
    assert re.fullmatch(r"isorod: .*results.jsonl.*\n", err)


def test_output_without_pyvista_says_so_before_anything_is_made(python, tmp_path):
    script = (
        "import sys; sys.modules['pyvista'] = None\nfrom isorod.command import cli; sys.exit(cli.main(sys.argv[1:]))"
    )
    done = python(script, "run", "spring", *COARSE, "--output", str(tmp_path / "new"))
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(r"isorod: .*pyvista.*\n", done.stderr), done.stderr
    assert not any(tmp_path.iterdir())


@pytest.mark.mpi
@pytest.mark.parametrize("scene", ["spring", "ring"])
def test_two_ranks_print_one_line(scene, mpirun, tmp_path):
    done = mpirun(2, "run", scene, "--json", "--output", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") == 1
    assert (tmp_path / "results.jsonl").read_text() == done.stdout


@pytest.mark.mpi
@pytest.mark.parametrize("arguments", ["--nosuch 1", "-ksp_type nosuch"])
def test_two_ranks_complain_once(arguments, mpirun):
    done = mpirun(2, "run", "spring", *arguments.split())
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("isorod:") == 1


def test_output_that_nobody_reads_is_no_traceback():
    script = "import sys; from isorod.command.cli import main; sys.exit(main(['list']))"
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    process.wait()
    assert b"Traceback" not in process.stderr.read()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "flower", "--length=--"], "argument --length: expected one argument"),
        (["run", "spring", "--elements-per-turn=--"], "argument --elements-per-turn: expected one argument"),
        (["run", "spring", "--no\nsense"], "option --no sense is not known"),
        (
            ["run", "flower", "--petals=851173383449305907028419411968"],
            "flower petals: got 851173383449305907028419411968",
        ),
        (
            ["run", "spring", f"--section-points={10**310}"],
            "Spring: section_points: got 10000000000000000000..., an integer of too many",
        ),
        (["run", "spring", f"--coils={10**310}"], "helix: got inf turns, need a positive number"),
        (["run", "spring", "--coils=10000000000000000"], "arcs are too many; at most 100000"),
        (["run", "blade", "--section-points=1000000000"], "section control points: got 1000000000"),
    ],
)
def test_what_generated_input_found_is_one_line(arguments, message, refused):
    assert message in refused(*arguments)
