"""Curves of runs as pictures: ``isorod plot --curve``."""

import json
import re
import sys

import numpy as np
import pytest

from isorod import InputError
from isorod.command import cli
from isorod.output import curves, reading

pytest.importorskip("matplotlib")
Image = pytest.importorskip("PIL.Image")

STEPS = {
    "load factor": [0.0, 0.5, 1.0],
    "support lower displacement z": [0.0, 0.0, 0.0],
    "support upper displacement z": [0.0, 1.0, 2.0],
    "support lower force z": [0.0, -3.0, -6.1],
    "support upper force y": [0.0, 1e-15, -1e-15],
    "support upper force z": [0.0, 3.0, 6.1],
}


def columns(table):
    return {name: np.array(values) for name, values in table.items()}


def test_forces_are_drawn_over_the_displacements_they_make():
    own, others = curves.panels(columns(STEPS), {})
    assert own == (
        "displacement (length)",
        "force (unit of E × length²)",
        [("support upper displacement z", "support upper force z")],
    )
    # What is zero, or rounding, is left out.
    assert others == ("load factor", "force (unit of E × length²)", [("load factor", "support lower force z")])


def test_what_is_of_one_kind_shares_a_panel():
    table = {name: [0.0, 1.0] for name in ("time", "kinetic", "stored", "muscle work", "contact force", "penetration")}
    found = curves.panels(columns(table), {})
    assert [(panel.below, panel.beside, len(panel.curves)) for panel in found] == [
        ("time (unit of time)", "energy (unit of E × length³)", 3),
        ("time (unit of time)", "force (unit of E × length²)", 1),
        ("time (unit of time)", "penetration (length)", 1),
    ]


def test_axes_have_the_units_that_a_file_names():
    """What is measured stands with the forces of supports, as it is in the same unit."""
    options = {"measure": {"force": {"reaction": "upper", "unit": "(N)"}, "peak": {"stress": "wire"}}}
    units = reading.Result("rod", {"options": options}, (), None).units
    assert units == {"force": "N"}
    table = {"load factor": [0.0, 1.0], "support upper force z": [0.0, 6.0], "force (N)": [0.0, 6.0]}
    found = curves.panels(columns(table | {"work": [0.0, 1.0]}), units)
    force = [("load factor", name) for name in ("support upper force z", "force (N)")]
    assert found[0] == ("load factor", "force (N)", force)
    assert found[1].beside == "energy (unit of E × length³)"


def test_a_motion_has_displacements_over_time():
    table = {"time": [0.0, 1.0], "support 0 displacement x": [0.0, 1.0], "support 0 force x": [0.0, 1.0]}
    assert [panel.curves for panel in curves.panels(columns(table | {"kinetic": [0.0, 0.0]}), {})] == [
        [("time", "support 0 displacement x")],
        [("time", "support 0 force x")],
    ]
    # Of statics over time loops are wanted.
    assert [panel.curves for panel in curves.panels(columns(table), {})] == [
        [("support 0 displacement x", "support 0 force x")]
    ]


@pytest.mark.parametrize(
    ("name", "said"),
    [("frequency", "frequency (cycles per time)"), ("twist (degrees)", "twist (degrees)"), ("nu", "nu")],
)
def test_axes_say_quantity_and_unit(name, said):
    assert curves.axis_label(name) == said


SWEEP = """# isorod sweep spring --travel 1,2 --nu 0.3,0.4
# varied: {},nu
{},nu,f[0],f[1],error_estimate,unknowns,status
{},0.3,3,4,1e-3,36,solved
{},0.4,5,6,1e-3,36,solved
{},0.3,,,,,"refused: no, not this one"
{},0.4,7,8,1e-3,36,solved
"""


@pytest.mark.parametrize("typed", [("1", "2"), ("displacement", "mixed")])
def test_a_sweep_has_a_curve_for_each_answer_and_combination(typed):
    """Over what is varied first, numbers or words; points that could not be solved are left out."""
    first, last = typed
    text = SWEEP.format("by", "by", first, first, last, last)
    found = curves.columns(text.splitlines(), "a.csv")
    assert found.pop("by").tolist() == ([1.0, 2.0] if first == "1" else [*typed])
    expected = {
        "f[0], nu 0.3": (3, np.nan),
        "f[1], nu 0.3": (4, np.nan),
        "f[0], nu 0.4": (5, 7),
        "f[1], nu 0.4": (6, 8),
    }
    assert [*found] == [*expected]
    np.testing.assert_array_equal([*found.values()], [*expected.values()])
    (panel,) = curves.panels({"by": np.arange(2.0), **found}, {})
    assert (panel.below, panel.beside, len(panel.curves)) == ("by", "f", 4)
    with pytest.raises(InputError, match=r"^a.csv: is no table of a sweep"):
        curves.columns(text.replace("by,nu,", "on,nu,").splitlines(), "a.csv")


def write(path, table):
    rows = zip(*table.values(), strict=True)
    path.write_text("\n".join([",".join(table), *(",".join(map(repr, row)) for row in rows), ""]))
    return path


@pytest.fixture(autouse=True)
def no_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)


def test_a_curve_is_where_its_numbers_are(tmp_path, capsys):
    """One panel: the marks of a straight line rise from lower left to upper right, at equal distances."""
    file = write(tmp_path / "line.csv", {"time": [0.0, 1.0, 2.0, 3.0], "height": [0.0, 1.0, 2.0, 3.0]})
    png = tmp_path / "line.png"
    assert cli.main(["plot", str(file), "--png", str(png), "--size", "500x400"]) == 0
    assert capsys.readouterr().out == f"{png}: 500 x 400 pixels\n"
    with Image.open(png) as image:
        assert image.size == (500, 400)
        pixels = np.asarray(image.convert("RGB")).astype(int)
    # Matplotlib's first colour; what the axis says needs no legend.
    rows, places = np.nonzero((np.abs(pixels - [31, 119, 180]) < 30).all(axis=2))
    assert np.ptp(places) > 250 and np.ptp(rows) > 250
    assert np.corrcoef(rows, places)[0, 1] < -0.999


def test_curves_of_a_run_and_of_a_file(tmp_path):
    words = ["run", "blade", "--elements", "1", "--order", "1", "--modes", "2", "--no-estimate"]
    assert cli.main([*words, "--output", str(tmp_path)]) == 0
    files = [tmp_path / name for name in ("run.png", "file.png")]
    shape = ["--size", "400x300"]
    assert cli.main(["plot", str(tmp_path), "--curve", "--png", str(files[0]), *shape]) == 0
    assert (
        cli.main(["plot", str(tmp_path), "--curve", str(tmp_path / "blade.csv"), "--png", str(files[1]), *shape]) == 0
    )
    with Image.open(files[0]) as one, Image.open(files[1]) as other:
        assert np.array_equal(np.asarray(one), np.asarray(other))


MEASURED = """
title = "bar"
rod.bar = {curve = {straight = 4.0}, section = {circle = 1.0}, law = {NeoHookean = {E = 1.0, nu = 0.3}}, density = 1.0}
support.foot.end = "start"
load.push = {end = "end", force = [0.001, 0.0, 0.0]}
measure.tip = {displacement = "bar", unit = "mm"}
measure.root = {section_force = "bar", component = "bending_2", u = 0.0}
measure.held = {moment = "foot"}
"""


@pytest.mark.parametrize(
    "analysis",
    ["statics.load_steps = 3", 'dynamics = {end_time = 1.0, outputs = 4, integrator = "implicit", time_step = 0.25}'],
)
def test_what_is_measured_is_a_curve_that_ends_where_the_record_does(analysis, tmp_path, capsys):
    """At rest nothing is measured in statics."""
    text = MEASURED if "statics" in analysis else MEASURED.partition("measure.held")[0]
    (tmp_path / "bar.toml").write_text(f"{text}\nanalysis.{analysis}\n")
    assert cli.main(["run", str(tmp_path / "bar.toml"), "--json", "--output", str(tmp_path / "out")]) == 0
    record = json.loads(capsys.readouterr().out.splitlines()[-1])
    (file,) = (tmp_path / "out").glob("*.csv")
    found = curves.read(file)
    own = {name: values for name, values in found.items() if name.startswith(("tip", "root", "held"))}
    held = [f"held[{a}]" for a in "xyz"] if "statics" in analysis else []
    assert [*own] == ["tip[x] (mm)", "tip[y] (mm)", "tip[z] (mm)", "root", *held]
    last = [*np.reshape(record["tip"], (-1, 3))[-1], np.ravel(record["root"])[-1], *record.get("held", ())]
    np.testing.assert_allclose([values[-1] for values in own.values()], last, rtol=1e-12)
    assert np.isnan(own["root"][0]) == ("statics" in analysis)
    if "statics" in analysis:
        np.testing.assert_allclose(own["root"][1:] / own["root"][-1], found["load factor"][1:], rtol=1e-3)


def test_without_matplotlib_the_error_says_how_to_get_it_and_pyvista_is_not_missed(tmp_path, monkeypatch, capsys):
    file = write(tmp_path / "line.csv", {"time": [0.0, 1.0], "kinetic": [0.0, 1.0]})
    words = ["plot", str(file), "--png", str(tmp_path / "a.png"), "--size", "300x200"]
    monkeypatch.setitem(sys.modules, "pyvista", None)
    assert cli.main(words) == 0
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert cli.main(words) == 2
    assert re.fullmatch(r"isorod: curves need matplotlib, .*: pip install matplotlib\n", capsys.readouterr().err)


BAD = {
    "": r"need two columns or more, names in the first line and numbers below",
    "time\n1.0\n": r"need two columns or more, .*",
    "time,force\n": r"need two columns or more, .*",
    "time,force\n0,1\n1,much\n": r":3: got '1,much', need numbers with commas between",
    "time,force\n0,1,2\n": r":2: 3 numbers below 2 names",
}


@pytest.mark.parametrize("content", BAD)
def test_what_is_no_table_is_one_line(content, tmp_path, capsys):
    file = tmp_path / "bad.csv"
    file.write_text(content)
    assert cli.main(["plot", str(file), "--png", str(tmp_path / "a.png")]) == 2
    said = capsys.readouterr().err
    assert re.fullmatch(rf"isorod: \S*bad.csv:? ?{BAD[content]}\n", said), said
    assert [one.name for one in tmp_path.iterdir()] == ["bad.csv"]


def test_no_file_is_one_line(tmp_path):
    with pytest.raises(InputError, match=r"none.csv: there is no such file$"):
        curves.read(tmp_path / "none.csv")
