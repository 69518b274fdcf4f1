"""Wires of STEP and IGES files as centre lines."""

import numpy as np
import pytest
from lines import distances

from isorod import InputError
from isorod.files.scene import FileScene
from isorod.files.wires import gmsh_session
from isorod.geometry.fitting import evaluate

pytest.importorskip("gmsh")

ROD = """
[rod.wire]
curve = {{polyline = "{}", tolerance = {}}}
section = {{circle = 0.5}}
[analysis.geometry]
"""


@pytest.fixture
def made(tmp_path, capfd):
    """Return a function that writes what another draws with gmsh's kernel into a file, and a scene of it."""

    def scene(name, draw, tolerance=1e-3):
        with gmsh_session() as gmsh:
            draw(gmsh.model.occ)
            gmsh.model.occ.synchronize()
            gmsh.write(str(tmp_path / name))
        path = tmp_path / "scene.toml"
        path.write_text(ROD.format(name, tolerance))
        return FileScene(str(path))

    yield scene
    capfd.readouterr()


def bent(occ):
    """A straight line, a quarter of a circle and a line along z, the second of them the other way round."""
    a, b, c, d, e = (occ.addPoint(*x) for x in [(0, 0, 0), (20, 0, 0), (20, 5, 0), (25, 5, 0), (25, 20, 0)])
    occ.addLine(a, b)
    occ.addCircleArc(d, c, b)
    occ.addLine(d, e)


@pytest.mark.parametrize("name", ["wire.step", "wire.stp"])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_a_wire_is_followed_within_the_tolerance(made, name, tolerance):
    scene = made(name, bent, tolerance)
    line = scene.plans["wire"].curve.make()
    angle = np.linspace(-0.5 * np.pi, 0.0, 60)
    bow = np.stack([20.0 + 5.0 * np.cos(angle), 5.0 + 5.0 * np.sin(angle), 0.0 * angle], axis=1)
    way = np.linspace(0.0, 1.0, 30)[:, None]
    sides = np.concatenate([way * [20.0, 0.0, 0.0], [25.0, 5.0, 0.0] + way * [0.0, 15.0, 0.0]])
    assert distances(np.concatenate([sides, bow]), line).max() < 1.1 * tolerance
    assert 0.0 < line.deviation < 1.1 * tolerance
    ends = evaluate(line.axis, line.centers, line.axis.breaks[[0, -1]])[0]
    ends = ends[np.argsort(ends[:, 0])]
    np.testing.assert_allclose(ends, [[0.0, 0.0, 0.0], [25.0, 20.0, 0.0]], atol=1e-6)
    assert scene.data.keys() == {name}


def iges(*entities):
    """Return the text of an IGES file with entities, each a type and its parameters."""

    def row(text, section, number):
        return f"{text:<72}{section}{number:>7}\n"

    head = "1H,,1H;,4Hwire,8Hwire.igs,4Hself,1H1,32,38,6,308,15,4Hwire,1.,2,2HMM,1,0.01,"
    head += "15H20200101.000000,1E-6,100.,,,11,0,;"
    parts = [head[k : k + 72] for k in range(0, len(head), 72)]
    text = row("wire", "S", 1) + "".join(row(part, "G", k) for k, part in enumerate(parts, 1))
    for k, (kind, _) in enumerate(entities):
        for number, fields in (
            (2 * k + 1, (kind, k + 1, *[0] * 6, "00000000")),
            (2 * k + 2, (kind, 0, 0, 1, 0, "", "", "", 0)),
        ):
            text += row("".join(f"{one:>8}" for one in fields), "D", number)
    for k, (kind, values) in enumerate(entities):
        text += row(f"{kind},{values};".ljust(64) + f"{2 * k + 1:>8}", "P", k + 1)
    return text + row(f"S{1:>7}G{len(parts):>7}D{2 * len(entities):>7}P{len(entities):>7}", "T", 1)


def test_a_wire_of_iges_is_read_and_nothing_is_printed(tmp_path, capfd):
    (tmp_path / "it.igs").write_text(iges((110, "0.,0.,0.,20.,0.,0."), (110, "30.,0.,0.,20.,0.,0.")))
    (tmp_path / "scene.toml").write_text(ROD.format("it.igs", 1e-3))
    line = FileScene(str(tmp_path / "scene.toml")).plans["wire"].curve.make()
    np.testing.assert_allclose(line.centers[[0, -1]], [[0.0, 0.0, 0.0], [30.0, 0.0, 0.0]], atol=1e-12)
    assert capfd.readouterr() == ("", "")


def apart(occ):
    occ.addLine(occ.addPoint(0, 0, 0), occ.addPoint(1, 0, 0))
    occ.addLine(occ.addPoint(2, 0, 0), occ.addPoint(3, 0, 0))


@pytest.mark.parametrize(
    "draw, said",
    [
        (lambda occ: occ.addBox(0, 0, 0, 1, 1, 1), "surfaces or volumes are in it, need a wire"),
        (apart, "2 lines that do not meet, need one polyline"),
    ],
)
def test_what_is_no_wire_is_refused(made, draw, said):
    with pytest.raises(InputError, match=rf"scene.toml:3: rod.wire.curve.polyline: it.step: {said}"):
        made("it.step", draw)


def test_a_damaged_file_is_refused(tmp_path):
    (tmp_path / "it.step").write_text("ISO-10303-21;\nHEADER;\n")
    (tmp_path / "scene.toml").write_text(ROD.format("it.step", 1e-3))
    with pytest.raises(InputError, match=r"rod.wire.curve.polyline: it.step: "):
        FileScene(str(tmp_path / "scene.toml"))
