"""Values in the place of a scene file's own, of runs and sweeps."""

import re

import pytest
from test_sweep import rows

from isorod.command import sheet

COIL = """
[rod.wire]
curve = {helix = {radius = 10.0, pitch = 5.0, turns = 1.0}}
section = {circle = {radius = 1.0, n = 3}}
law = {NeoHookean = {E = 2.0e5, nu = 0.3}}
space = {order = 1, degree = 4, elements = 8}
[support.lower]
end = "start"
[support.upper]
end = "end"
displacement = [0.0, 0.0, 3.0]
[analysis.statics]
[measure.force]
reaction = "upper"
"""


def test_what_a_file_says_is_varied_by_its_path(command, tmp_path):
    file, path, lift = tmp_path / "coil.toml", tmp_path / "out.csv", "support.upper.displacement.2"
    file.write_text(COIL)
    words = ["sweep", str(file), "--set", f"{lift}=0:4:9", "--output", str(path), "--png", str(tmp_path / "out.svg")]
    command.prints(*words)
    assert "<svg" in (tmp_path / "out.svg").read_text()
    table = rows(path)
    assert [row[lift] for row in table] == ["0", "0.5", "1", "1.5", "2", "2.5", "3", "3.5", "4"]
    for row in table[::3]:
        alone = command.record("run", file, "--set", f"{lift}={row[lift]}")
        assert [row[f"force[{a}]"] for a in "xyz"] == sheet.cells(alone["force"])
        assert alone["options"]["support"]["upper"]["displacement"][2] == float(row[lift])
        assert row["error_estimate"] == (f"{alone['error_estimate']:.2g}" if "error_estimate" in alone else "")
    # Another file under the same name is another sweep.
    file.write_text(COIL.replace("nu = 0.3", "nu = 0.2"))
    assert "is of another sweep (file: " in command.refuses(*words)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("support.uper.end=start", r"coil.toml:\d+: support: 'uper' is not known; did you mean upper\?"),
        (
            "support.upper.displacement.3=1",
            r"coil.toml:11: support.upper.displacement: got place 3, need one from 0 to 2",
        ),
        ("rod.wire.law.NeoHookean.E.x=1", r"coil.toml:5: rod.wire.law.NeoHookean.E: it is 200000.0, in which there is"),
        ("rod.wire.law.NeoHookean.E=much", r"coil.toml:5: rod.wire.law.NeoHookean.E: got 'much', need a number"),
        ("rod.wire.law.NeoHookean.rho=1", r"coil.toml:5: .*rho"),
        ("analysis.modal=3", "can be set in the file only"),
        ("support", "need a path in the file and a value"),
        ("=3", "need a path in the file and a value"),
    ],
)
def test_a_change_that_leads_nowhere_is_one_line(change, message, command, tmp_path):
    (tmp_path / "coil.toml").write_text(COIL)
    assert re.search(message, command.refuses("run", tmp_path / "coil.toml", "--set", change))


def test_a_number_that_is_noise_is_that_of_a_single_run_too(command, tmp_path):
    """What a straight bar does sideways as it is pulled is rounding, and no neighbour says which."""
    file, path, pull = tmp_path / "bar.toml", tmp_path / "bar.csv", "support.upper.displacement.2"
    straight = re.sub(r"curve = .*", "curve = {straight = 50.0}", COIL)
    file.write_text(straight.replace("degree = 4", "degree = 2") + 'component = "x"\n')
    command.prints("sweep", file, "--set", f"{pull}=0.5:4:8", "--no-estimate", "--output", path)
    for row in rows(path)[3::2]:
        alone = command.record("run", file, "--set", f"{pull}={row[pull]}", "--no-estimate")
        assert abs(alone["force"]) < 1e-6
        assert row["force"] == sheet.cells([alone["force"]])[0]
