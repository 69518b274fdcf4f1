"""What files measure, asked of finite elements: the same words, and the same numbers."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from comparisons.fem.rods.run import Configuration, run
from isorod import files, statics
from isorod.errors import InputError


def test_both_programs_tell_the_same_stresses_section_forces_energies_and_stiffness(tmp_path):
    file = tmp_path / "bar.toml"
    asked = {
        "at": "stress = 'bar'\nu = 0.4\nxi = [0.0, 0.9]",
        "along": "stress = 'bar'\nu = 0.6\nxi = [0.5, 0.0]\ncomponent = 'along'",
        "section": "stress = 'bar'\nu = 0.3",
        "carried": "section_force = 'bar'\nu = 0.5",
        "work": "energy = 'bar'",
        "rate": "stiffness = 'head'",
    }
    file.write_text(
        """
        analysis = "statics"
        [rod.bar]
        curve = {straight = 20.0}
        section = {circle = 2.0}
        law = {NeoHookean = {E = 200.0, nu = 0.3}}
        space = {elements = 8, degree = 4, section_degree = 4}
        [support.foot]
        end = "start"
        [support.head]
        end = "end"
        displacement = [1.0, 0.0, 0.5]
        """
        + "".join(f"[measure.{name}]\n{text}\n" for name, text in asked.items())
    )
    scene = files.find(str(file))
    own = scene.measure(statics.solve(scene.model()))
    record = run(Configuration(str(file)))
    for name, tolerance in {"at": 0.03, "along": 0.03, "section": 0.03, "work": 0.01, "rate": 0.01}.items():
        assert record[name] == pytest.approx(own[name], rel=tolerance), name
    assert record["carried"] == pytest.approx(own["carried"], abs=0.02 * np.abs(own["carried"]).max())
    assert record["places"]["section"]["u"] == 0.3
    file.write_text(file.read_text() + "slope = 'tangent'\n")
    with pytest.raises(InputError, match="slope 'tangent' is available for solutions of isorod only; use 'secant'"):
        run(Configuration(str(file)))
