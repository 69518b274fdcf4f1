"""Harmonic and random vibrations from files: what is printed, kept and drawn, what is refused, and several ranks."""

import json

import numpy as np
import pytest
from refused import refused

from isorod import (
    Body,
    Contact,
    LinearElastic,
    Model,
    NeoHookean,
    Plane,
    Plastic,
    SectionLoad,
    Space,
    Spin,
    Support,
    Viscoelastic,
    Weight,
    circle,
    harmonic,
    random,
    straight,
)
from isorod.command import vibrations
from isorod.command.cli import main
from isorod.output import curves

FILE = """title = "a bar on a shaker"
[rod.bar]
curve = {straight = 100.0}
section = {circle = 4.0}
law = {LinearElastic = {E = 2.0e5, nu = 0.0}}
density = 8.0e-9
space = {elements = 4, degree = 5, section_degree = 2}
[support.root]
end = "start"
[measure.tip]
displacement = "bar"
component = "z"
unit = "mm"
[measure.root]
stress = "bar"
component = "along"
u = 0.0
[analysis.harmonic]
frequencies = {from = 1.0e3, to = 2.0e4, count = 40}
damping = {structural = 0.04}
base = [0.0, 0.0, 1.0]
"""


def written(tmp_path, text=FILE):
    path = tmp_path / "bar.toml"
    path.write_text(text)
    return str(path)


def test_a_file_has_its_peaks_curves_and_picture(tmp_path, capsys):
    file, folder = written(tmp_path), tmp_path / "out"
    assert main(["run", file, "--output", str(folder)]) == 0
    printed = capsys.readouterr().out
    # c / (4 L), and the tip of a bar there: 8 L^2 / (pi^3 eta) 2 / c^2 of the acceleration.
    height = 16.0 / (np.pi**3 * 0.04) * 1e4 / 2.5e13
    (record,) = map(json.loads, (folder / "results.jsonl").read_text().splitlines())
    (peak,) = record["peaks"]["tip"]
    assert peak == pytest.approx([12500.0, height, 90.0], rel=2e-3)
    assert record["tip"] == pytest.approx(height, rel=2e-3)
    assert f"peaks tip           {peak[1]:.5g} at {peak[0]:.6g} (phase 90)" in printed
    assert "12500 (2 %)" in printed
    columns = curves.read(folder / record["files"][0] if record["files"] else folder / "bar.csv")
    assert {"frequency", "tip amplitude (mm)", "tip phase", "root amplitude", "root phase"} == {*columns}
    assert columns["tip amplitude (mm)"].max() == pytest.approx(height, rel=2e-3)
    pytest.importorskip("matplotlib")
    assert main(["plot", str(folder), "--png", str(tmp_path / "out.png")]) == 0
    assert (tmp_path / "out.png").stat().st_size > 5000


def test_random_vibration_reads_its_density_from_a_table(tmp_path, capsys):
    (tmp_path / "profile.csv").write_text("frequency, density\n1000, 2.0\n20000, 2.0\n")
    text = FILE.replace("[analysis.harmonic]", "[analysis.random]").replace(
        "frequencies = {from = 1.0e3, to = 2.0e4, count = 40}", 'psd = "profile.csv"'
    )
    # At a place that is given whole, and where along it is largest.
    text += '[measure.middle]\nstress = "bar"\nu = 0.0\nxi = [0.5, 0.0]\n'
    assert main(["run", written(tmp_path, text), "--json", "--no-estimate"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["middle"] == pytest.approx(record["root"], rel=1e-3)
    # One mode under white noise: its mean square is the density times the square of its peak times pi f eta / 2.
    height = 16.0 / (np.pi**3 * 0.04) * 1e4 / 2.5e13
    assert record["tip"] == pytest.approx(np.sqrt(2.0 * height**2 * np.pi * 12500.0 * 0.02), rel=0.02)
    assert record["apparent"]["tip"] == pytest.approx(12500.0, rel=0.02)


def test_loads_that_swing_are_named_and_the_others_are_static(tmp_path, capsys):
    loads = '[load.pull]\nend = "end"\nforce = [0.0, 0.0, 500.0]\n[load.shake]\nend = "end"\nforce = [1.0, 0.0, 0.0]\n'
    text = FILE.replace("base = [0.0, 0.0, 1.0]", 'loads = ["shake"]').replace("LinearElastic", "NeoHookean") + loads
    assert main(["run", written(tmp_path, text), "--json", "--no-estimate"]) == 0
    assert json.loads(capsys.readouterr().out)["about"] == "the equilibrium under 1 load"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("damping = {structural = 0.04}\n", "", "damping is missing"),
        ("structural = 0.04", "structural = -1", "structural: got [-1.0], need numbers that are not negative"),
        ("structural = 0.04", "", "damping: got none, need ratio, rayleigh or structural"),
        ("structural = 0.04", "ratio = 2", "below 1, as 0.02 for 2 %"),
        ("from = 1.0e3", "from = 3.0e4", "got 30000 to 20000, need 0 or more, ascending"),
        ("count = 40", "count = 1", "count: got 1"),
        ("to = 2.0e4", "to = 1.0e9", "too many for"),
        ("base = [0.0, 0.0, 1.0]", "base = [0, 0, 0]", "base: got zeros, need an amplitude"),
        ("base = [0.0, 0.0, 1.0]", 'loads = ["push"]', "'push' is not known"),
        ("base = [0.0, 0.0, 1.0]", "", "no excitation: give a load, or base"),
        ('component = "along"', 'component = "max_principal"', "turns in a period"),
        ("[measure.tip]\ndisplacement", "[measure.tip]\nrotation", "not available in harmonic"),
    ],
)
def test_bad_input_is_one_line(old, new, said, tmp_path, capsys):
    assert old in FILE
    text = FILE.replace(old, new).replace('component = "z"\n' if "rotation" in new else "\0", "")
    assert main(["run", written(tmp_path, text)]) == 2
    error = capsys.readouterr().err.strip()
    assert "\n" not in error
    assert "bar.toml" in error
    assert said in error


def model(law=None, density=1.0, supports=True, **more):
    space = Space(straight(10.0).sweep(circle(8, 1.0)), section_degree=2, degree=3, elements=2)
    body = Body(space, law or NeoHookean(E=100.0, nu=0.3), density=density)
    loads = [SectionLoad.end(space, "end", (1.0, 0.0, 0.0))]
    return Model([body], [Support.end(space, "start")] if supports else [], **{"loads": loads} | more)


def solve(law=None, *, damping=None, frequencies=(0.1,), how=(), **more):
    return harmonic.solve(model(law, **more), frequencies, damping or harmonic.Damping(ratio=0.1), **dict(how))


BASE = {"base": (1.0, 0.0, 0.0)}
test_what_cannot_be_told_is_refused = refused(
    (lambda: solve(contacts=[Contact(0, Plane((0.0, 0.0, -5.0), (0.0, 0.0, 1.0)))]), "contact 0: a response is linear"),
    (lambda: solve(spin=Spin(velocity=(0.1, 0.0, 0.0)), how=BASE), "base: the frame turns with the spin"),
    (lambda: solve(supports=False, loads=[], how=BASE), "base: body 0 is free to"),
    (lambda: solve(how=BASE | {"base_displacement": (1.0, 0.0, 0.0)}), "base_displacement: beside base"),
    (lambda: solve(how=BASE | {"loads": [0]}), "loads: beside base"),
    (lambda: solve(how={"loads": [1]}), "loads: got 1"),
    (lambda: solve(density=0.0), "density of body 0"),
    (lambda: solve(Plastic(E=100.0, nu=0.3, hardening=[[0.0, 1.0]])), "Plastic is not linear for small stresses"),
    (lambda: solve(Viscoelastic(E=100.0, nu=0.495, prony=[[0.5, 1.0]])), "viscoelastic in the mixed formulation"),
    (
        lambda: solve(Viscoelastic(E=100.0, nu=0.3, prony=[[0.5, 1.0]]), how=BASE),
        "body 0 is viscoelastic, whose response is available about the state of rest only",
    ),
    (lambda: solve(frequencies=[-1.0]), "frequencies: got -1"),
    (lambda: solve(frequencies=[]), "frequencies: need one or more"),
    (lambda: solve(frequencies=["a"]), "frequencies: got"),
    (lambda: solve().over([5.0]), "frequencies: got 5, beyond 0.1"),
    (lambda: random.solve(model(), [[1.0, 1.0]], harmonic.Damping(ratio=0.1)), "psd: need two rows"),
    (lambda: random.solve(model(), [[1.0, 1.0], [0.5, 1.0]], harmonic.Damping(ratio=0.1)), "psd: need frequencies"),
)


def test_gravity_does_not_swing():
    found = model(LinearElastic(E=100.0, nu=0.3))
    heavy = Weight((0.0, 0.0, -1e-3), found.bodies[0], 0)
    with pytest.raises(ValueError, match="no excitation"):
        harmonic.solve(model(loads=[heavy]), [0.1], harmonic.Damping(ratio=0.1))


def test_two_ranks_have_the_same(on_ranks):
    on_ranks(2, "test_harmonic_files.shaken()")


def shaken():
    """Hold what all ranks together tell against what one tells alone."""
    from petsc4py import PETSc

    span, damping = harmonic.Span(0.001, 0.1, 5), harmonic.Damping(rayleigh=(1e-4, 1e-3))
    both, one = (
        harmonic.solve(model(), span, damping, comm=comm).over([0.001, 0.05, 0.1])
        for comm in (PETSc.COMM_WORLD, PETSc.COMM_SELF)
    )
    assert both.ranks == 2
    assert both.at(0, "end") == pytest.approx(one.at(0, "end"), rel=1e-8, abs=1e-10)
    at = 0, 0.5, (0.6, 0.6)
    scale = np.abs(one.stress(*at)).max()
    assert both.stress(*at) == pytest.approx(one.stress(*at), abs=1e-6 * scale)


def test_the_highest_peaks_are_printed_by_frequency():
    peaks = [[float(10 * k), size] for k, size in enumerate((3.0, 1.0, 7.0, 2.0, 5.0, 6.0, 0.5, 4.0), 1)]
    record = {"peaks": {"tip_z": peaks}, "resonances": [], "ratios": [], "about": "rest"}
    (name, text), *_ = vibrations.rows(record | {"left_out": {"shapes": 1, "modes": 1, "share": 1e-3}})
    assert name == "peaks tip z"
    assert text == "3 at 10; 7 at 30; 2 at 40; 5 at 50; 6 at 60; 4 at 80; 2 lower ones"
