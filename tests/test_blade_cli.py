"""The blade from the command line: what it loads, bad input, and options of PETSc and SLEPc."""

import json
import re

import numpy as np
import pytest
from petsc4py import PETSc

from isorod import modal
from isorod.command import cli
from isorod.scenes.blade import Blade

ALONE = """
import json, sys
from isorod import material
from isorod.command import cli

def refuse(*_):
    raise AssertionError("a nonlinear law was evaluated")

for name in dir(material.NeoHookean):
    if not name.startswith("_") and callable(getattr(material.NeoHookean, name)):
        setattr(material.NeoHookean, name, refuse)
material.NeoHookean.__init__ = refuse
material.LinearElastic.stress = refuse
assert cli.main(["run", "blade", "--preset", "paper", "--no-estimate", "--elements", "5", "--json"]) == 0
print(json.dumps(sorted({name.split(".")[0] for name in sys.modules})))
"""


def test_blade_evaluates_no_nonlinear_law_and_loads_no_other_solver(python):
    done = python(ALONE)
    assert done.returncode == 0, done.stderr
    record, loaded = (json.loads(line) for line in done.stdout.splitlines())
    assert record["built"] == ["tangent", "mass"]
    assert not set(loaded) & {"dolfinx", "ufl", "basix", "gmsh", "pyvista", "vtkmodules", "matplotlib"}


@pytest.fixture
def blade(capsys):
    """Run the blade in this process; PETSc started long ago, so that its options are put where it keeps them."""
    typed = []

    def run(*arguments):
        theirs = [word for word in arguments if re.match(r"-[a-z]", word)]
        typed.extend(word[1:] for word in theirs)
        k = min((arguments.index(word) for word in theirs), default=len(arguments))
        PETSc.Options().insertString(" ".join(arguments[k:]))
        code = cli.main(["run", "blade", "--preset", "paper", "--no-estimate", *arguments])
        return (code, *capsys.readouterr())

    yield run
    for name in typed:
        PETSc.Options().delValue(name)


@pytest.fixture
def refused(blade, tmp_path):
    """Return the one line of complaint, having made sure that it is the only effect."""

    def run(*arguments):
        code, out, err = blade("--elements", "6", "--output", str(tmp_path / "results"), *arguments)
        assert (code, out) == (2, "")
        assert re.fullmatch(r"isorod: .+\n", err), err
        assert not any(tmp_path.iterdir())
        return err

    return run


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--density 0", "density of body 0: got 0, modes need a positive mass per volume"),
        ("--density -40", "density: got -40, need a finite mass per volume, not negative"),
        ("--density nan", "density: got nan, need a finite mass"),
        ("--density inf", "density: got inf, need a finite mass"),
        ("--E 0", "E: got 0, need a positive stress"),
        ("--nu 0.6", "Poisson.s ratio"),
        ("--length 0", "length: got 0, need a positive"),
        ("--length nan", "length: got nan, need a positive"),
        ("--taper 0", "taper: got 0, need a positive"),
        ("--taper -0.5", "taper: got -0.5, need a positive"),
        ("--twist nan", "twist: got nan degrees"),
        ("--twist 360", "twist: got 360 degrees, the one element of the blade carries -90 to 90"),
        ("--twist -91", "twist: got -91 degrees"),
        ("--chord 0 --airfoil 2412", "chord: got 0, need a positive length"),
        (
            "--chord 1e-6",
            r"body 0 is free to turn about \(.*\) \(rigid-body mode, to 1e-8 of its size\)"
            ".*add a support, or give a shift",
        ),
        ("--chord 1e-8", "rod: 1.66e.09 radii long, need at most 6.7e.07"),
        ("--airfoil 24", "airfoil: got '24', need a NACA 4-digit number such as 2412"),
        ("--airfoil 2400", "airfoil: got '2400'"),
        ("--airfoil clarky", "airfoil: got 'clarky'"),
        ("--airfoil 241\N{SUPERSCRIPT TWO}", "airfoil: got '241.', need a NACA"),
        ("--section-points 8", "got 8, need a multiple of the 16"),
        ("--airfoil 2412 --section-points 2", "section control points: got 2"),
        ("--order 0", "order.* got 0"),
        ("--degree 1", "axis degree: got 1, need an integer from 2 to 6"),
        ("--elements 0", "elements: got 0"),
        ("--section-degree 0", "section degree: got 0, need an integer from 1 to 8"),
        ("--section-degree 9", "section degree: got 9"),
        ("--section-degree 2.5", "--section-degree: invalid int value"),
        ("--section-degree 3 --order 2", "polynomials take the place of order and section points"),
        ("--section-degree 3 --section-points 32", "polynomials take the place of order and section points"),
        ("--quadrature best", "quadrature: got 'best'"),
        ("--modes 0", r"modes: got 0, need 1 to 336 \(number of unknowns\)"),
        ("--modes -3", "modes: got -3, need 1 to 336"),
        ("--modes 337", "modes: got 337, need 1 to 336"),
        ("--modes nan", "--modes: invalid int value: 'nan'"),
        ("-eps_nev 0", "modes: got 0, need 1 to 336"),
        ("-eps_nev 337", "modes: got 337, need 1 to 336"),
        ("-eps_nev four", "four has no integer value"),
        ("--mass heavy", "--mass: invalid choice: 'heavy'"),
        ("-eps_max_it 1 -eps_ncv 13", r"SLEPc found \d of 10 in 1 iterations .*raise -eps_max_it"),
        ("-eps_ncv 5", "value of ncv must be at least nev"),
        ("-st_type shift", r"SLEPc found \d of 10 in \d+ iterations"),
        ("-st_shift 1e6", r"SLEPc found \d+ of 10 in|were found"),
        ("-eps_largest_real", "requires a target"),
        ("-eps_type nonsense", "Unknown EPS type given: nonsense"),
        ("-eps_typo 3", "option -eps_typo 3: nothing used it"),
        ("-snes_monitor", "option -snes_monitor: nothing used it"),
    ],
)
def test_bad_input_is_one_line(arguments, message, refused):
    assert re.search(message, refused(*arguments.split()))


@pytest.mark.parametrize("mode", [0, 1, 4])
@pytest.mark.parametrize("more", [(), ("-eps_purify", "1")], ids=["default", "purified"])
def test_a_shift_at_an_eigenvalue_does_no_harm(mode, more, blade):
    """K - shift M is singular: its own direction blows up and no other.

    Where vectors are purified with it the shift is moved.
    """
    expected = modal.solve(Blade(preset="paper", elements=6).model())
    shift = ("-st_shift", repr(float(expected.eigenvalues[mode])))
    code, out, err = blade("--elements", "6", "--json", *shift, *more)
    assert (code, err) == (0, "")
    assert json.loads(out)["frequencies"] == pytest.approx(expected.frequencies, rel=1e-7)


@pytest.mark.parametrize(
    "options",
    [
        "-eps_nev 4",
        "-eps_type arnoldi",
        "-eps_type subspace",
        "-eps_type lapack",
        "-eps_type lobpcg",
        "-eps_type gd",
        "-eps_type rqcg",
        "-eps_tol 1e-6",
        "-eps_ncv 60",
        "-st_pc_type lu",
        "-st_pc_type cholesky -st_pc_factor_mat_solver_type petsc",
        "-st_pc_factor_mat_solver_type mumps",
        "-st_ksp_type gmres -st_ksp_rtol 1e-12",
        "-st_shift -1",
        "-st_shift 100",
        "-eps_target 5",
        "-eps_lanczos_reorthog full -eps_type lanczos",
    ],
)
def test_options_of_slepc_reach_it_and_change_no_frequency(options, blade):
    """To 1e-6, since some of them only take a looser tolerance."""
    expected = modal.solve(Blade(preset="paper", elements=8).model(), 4)
    code, out, err = blade("--elements", "8", "--modes", "4", "--json", *options.split())
    assert (code, err) == (0, "")
    record = json.loads(out)
    assert np.abs(np.array(record["frequencies"]) / expected.frequencies - 1.0).max() < 1e-6
    assert max(record["residuals"]) < 1e-5
    typed = dict(re.findall(r"-(\w+_type) (\w+)", options))
    assert record["solver"]["eps"] == typed.get("eps_type", "krylovschur")
    assert record["solver"]["ksp"] == typed.get("st_ksp_type", record["solver"]["ksp"])
    assert record["solver"]["pc"] == typed.get("st_pc_type", record["solver"]["pc"])


def test_slepc_options_in_a_fresh_process(isorod):
    """The number of modes typed for SLEPc wins; its monitors write to standard error, beside the record."""
    typed = "-eps_nev 3 -eps_type arnoldi -st_pc_factor_mat_solver_type mumps -eps_monitor -eps_view"
    done = isorod(
        "run",
        "blade",
        "--preset",
        "paper",
        "--no-estimate",
        "--elements",
        "6",
        "--modes",
        "9",
        "--json",
        *typed.split(),
    )
    assert done.returncode == 0
    lines = done.stderr.splitlines()
    assert any(re.search(r"EPS nconv=\d+", line) for line in lines)
    assert "  type: arnoldi" in lines
    assert len(json.loads(done.stdout)["frequencies"]) == 3


@pytest.mark.parametrize("typed", ["-eps_max_it 1 -eps_ncv 13", "-eps_typo 3", "-eps_nev 400"])
def test_errors_of_a_fresh_process_are_one_line(typed, isorod):
    done = isorod("run", "blade", "--preset", "paper", "--no-estimate", "--elements", "6", "--json", *typed.split())
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(
        r"isorod: (modes: SLEPc found \d|PETSc option -eps_typo 3|modes: got 400, need).+\n", done.stderr
    )


def test_lumped_mass_from_the_command_line(capsys):
    assert cli.main("run blade --preset paper --no-estimate --elements 6 --json --mass lumped".split()) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["built"] == ["tangent", "lumped mass"]
    assert record["settings"]["lumped"] is True
    assert record["frequencies"] == pytest.approx(
        modal.solve(Blade(preset="paper", elements=6).model(), lumped=True).frequencies
    )


def test_modes_are_written_for_pictures(tmp_path, capsys):
    pyvista = pytest.importorskip("pyvista")
    assert (
        cli.main(
            [
                "run",
                "blade",
                "--preset",
                "paper",
                "--no-estimate",
                "--elements",
                "6",
                "--modes",
                "3",
                "--output",
                str(tmp_path),
            ]
        )
        == 0
    )
    mesh = pyvista.read(tmp_path / "blade-0.vtu")
    assert {"mode_1", "mode_2", "mode_3"} <= set(mesh.array_names)
    root = np.abs(mesh.points[:, 2]) < 1e-9
    assert root.any()
    assert not np.abs(mesh["mode_1"][root]).max()
