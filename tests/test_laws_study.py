"""The study of all laws beside finite elements: its table, what it counts, and one pair on coarse meshes."""

import pytest

pytest.importorskip("rich")

from comparisons import laws
from comparisons.__main__ import main
from comparisons.measure.records import newest
from comparisons.report import laws as report


def quantity(name, difference):
    return {
        "name": name,
        "isorod": 2.0 * (1.0 + difference),
        "meshes": [2.2, 2.05],
        "limit": 2.0,
        "order": None,
        "uncertainty": 0.025,
        "difference": difference,
    }


def made(law, scene, levels):
    """Return a record that nobody has computed: the torque is off by 0.2 % with Gent's law, and Yeoh's fails."""
    record = {"law": law, "scene": scene, "title": "pulled"}
    if law == "yeoh":
        return record | {"failure": "no equilibrium"}
    values = [quantity("force", 5e-4), quantity("torque", -2e-3 if law == "gent" else 1e-4)]
    return record | {
        "quantities": values,
        "newton_orders": [1.25, 1.96],
        "seconds": {"isorod": 0.5, "finite elements": [1.0, 20.0]},
    }


def test_a_law_agrees_where_all_that_is_compared_does(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(laws, "pair", made)
    asked = ["--law", "ogden", "--law", "gent", "--law", "yeoh", "--scene", "cylinder"]
    assert main(["laws", "--level", "quick", *asked, "--results", str(tmp_path)]) == 0
    table = [
        "| law | scene |  | isorod | finite elements | converged to | difference | orders of Newton's method | s | "
        "s of finite elements |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
        "| ogden | cylinder | force | 2.001 | 2 | 2.5 % | 0.05 % | 1.2 2.0 | 0.5 | 20 |",
        "| ogden | cylinder | torque | 2.0002 | 2 | 2.5 % | 0.01 % | 1.2 2.0 | 0.5 | 20 |",
        "| gent | cylinder | force | 2.001 | 2 | 2.5 % | 0.05 % | 1.2 2.0 | 0.5 | 20 |",
        "| gent | cylinder | torque | 1.996 | 2 | 2.5 % | -0.2 % | 1.2 2.0 | 0.5 | 20 |",
        "| yeoh | cylinder | no equilibrium |  |  |  |  |  |  |  |",
    ]
    assert (tmp_path / "laws.md").read_text().splitlines() == table
    records = newest(tmp_path, "laws")
    said = "laws: 1 of 3 pairs of a law and a scene within 0.1 % of finite elements of the same energy"
    assert report.summary(records)[-1] == said and said in capsys.readouterr().out
    assert "no equilibrium" in "".join(report.section(records, tmp_path))


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["spring", "--law", "gent"], "--law gent: only the study laws has laws"),
        (["laws", "--law", "yeoh", "--law", "gnet"], "--law gnet: need linear, neo-hookean,"),
        (["laws", "--scene", "ring"], "--scene ring: need cylinder, arc, spring, tube"),
        (
            ["laws", "--law", "yeoh", "--law", "hgo-wound", "--scene", "arc"],
            "--scene arc: hgo-wound is compared on tube alone",
        ),
    ],
)
def test_a_law_or_scene_that_is_not_there_is_one_line(asked, said, capsys, tmp_path):
    assert main([*asked, "--results", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"comparisons: {said}")


@pytest.mark.slow
@pytest.mark.parametrize("law", ["neo-hookean", "incompressible-mooney-rivlin"])
def test_a_pair_on_coarse_meshes(law):
    pytest.importorskip("dolfinx")
    pytest.importorskip("gmsh")
    record = laws.pair(law, "cylinder", (2, 3))
    assert [one["name"] for one in record["quantities"]] == ["force", "torque"]
    assert laws.agrees(record)
    assert len(laws.table([record])[1]) == 2
