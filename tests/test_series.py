"""Motions and load steps as time series, which VTK opens frame by frame, and curves beside them."""

import json

import numpy as np
import pytest

from isorod import dynamics
from isorod.command import cli
from isorod.output import vtk
from isorod.scenes.biceps import Biceps

pyvista = pytest.importorskip("pyvista")

READER = """
import json, sys
import numpy as np
import pyvista

reader = pyvista.PVDReader(sys.argv[1])
frames = []
for number, time in enumerate(reader.time_values):
    reader.set_active_time_point(number)
    bodies = reader.read()
    frames.append([time, [[one.n_points, one.point_data["displacement"].max(), one.point_data["velocity"].max(),
                           one.point_data["von_mises"].max()] for one in bodies]])
print(json.dumps(frames))
"""


def run(capsys, *words):
    assert cli.main(["run", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def columns(path):
    names = path.read_text().splitlines()[0].split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


def test_the_biceps_opens_frame_by_frame(tmp_path, capsys, python):
    words = ("biceps", "--section-points", "4", "--time-step", "1e-4", "--end-time", "0.01", "--outputs", "4")
    record = run(capsys, *words, "--output", str(tmp_path))
    assert "biceps.pvd" in record["files"]
    done = python(READER, str(tmp_path / "biceps.pvd"))
    assert done.returncode == 0, done.stderr
    frames = json.loads(done.stdout)
    assert [time for time, _ in frames] == record["times"]
    assert all(len(bodies) == 2 for _, bodies in frames)
    scene = Biceps(section_points=4, time_step=1e-4, end_time=0.01, outputs=4)
    history = dynamics.solve(scene.model(), **scene.settings())
    for instant, (_, bodies) in zip(history, frames, strict=True):
        for b, seen in enumerate(bodies):
            mesh = vtk.grid(history.model.bodies[b], instant.fields(b), factor=instant.factor, curved=True)
            largest = [mesh.point_data[name].max() for name in ("displacement", "velocity", "von_mises")]
            assert seen == pytest.approx([mesh.n_points, *largest], rel=1e-9)
    assert frames[0][1][0][1] == 0.0 < frames[-1][1][0][1]
    curves = columns(tmp_path / "biceps.csv")
    assert np.array_equal(curves["time"], record["times"])
    for name in ("kinetic", "stored", "contact_energy", "muscle_work", "energy_error"):
        assert np.array_equal(curves[name.replace("_", " ")], record[name])
    for k, axis in enumerate("xyz"):
        assert np.array_equal(curves[f"support 1 force {axis}"], np.array(record["reactions"])[:, 1, k])


def test_load_steps_are_frames_and_points_of_a_curve(tmp_path, capsys):
    coarse = ("--coils", "1", "--load-steps", "3", "--no-estimate", "--output", str(tmp_path))
    record = run(capsys, "spring", *coarse)
    steps = record["load_steps"]
    reader = pyvista.PVDReader(tmp_path / "spring.pvd")
    assert len(reader.time_values) == steps > 1
    curves = columns(tmp_path / "spring.csv")
    assert np.array_equal(curves["load factor"], [0.0, *reader.time_values])
    assert curves["support 1 displacement z"] == pytest.approx(2.0 * curves["load factor"])
    force = curves["support 1 force z"]
    assert force[0] == 0.0 and force[-1] == pytest.approx(record["force"], rel=1e-12)
    # A spring that is pulled straight is the stiffer.
    assert np.all(np.diff(force / np.maximum(curves["load factor"], 1e-9))[1:] > 0.0)
    for number, time in enumerate(reader.time_values):
        reader.set_active_time_point(number)
        (mesh,) = reader.read()
        # The last control points are those of the end that is pulled.
        assert mesh.point_data["displacement"][-20:, 2] == pytest.approx(2.0 * time)


def test_a_support_of_many_control_points_moves_as_their_mean(tmp_path, capsys):
    run(capsys, "spring", "--preset", "paper", "--coils", "1", "--no-estimate", "--output", str(tmp_path))
    curves = columns(tmp_path / "spring.csv")
    assert curves["support 1 displacement z"] == pytest.approx(2.0 * curves["load factor"])
    assert not curves["support 0 displacement z"].any()


def test_frequencies_are_a_table_and_names_are_those_of_the_file(tmp_path, capsys, monkeypatch):
    record = run(capsys, "blade", "--modes", "4", "--no-estimate", "--output", str(tmp_path))
    assert np.array_equal(columns(tmp_path / "blade.csv")["frequency"], record["frequencies"])
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", "bar.toml", "--from", "bar"]) == 0
    capsys.readouterr()
    run(capsys, "bar.toml", "--no-estimate", "--output", "results")
    names = columns(tmp_path / "results" / "bar.csv")
    assert not any("support 0" in name for name in names)


def test_activation_of_a_motions_output_is_that_of_its_stress():
    scene = Biceps(section_points=4, time_step=1e-4, end_time=0.01, outputs=2)
    history = dynamics.solve(scene.model(), **scene.settings())
    (_, first), *_, (time, last) = history.frames()
    assert first.factor == 0.0 and 0.0 < last.factor <= 1.0 and time == history.times[-1]
    assert last.fields(0).keys() == {"displacement", "velocity"}
