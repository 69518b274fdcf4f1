"""Strands of many wires: layers that cross, and the study's table."""

import numpy as np
import pytest

from comparisons.contact import many
from isorod import InputError, statics
from isorod.scenes.strand import Strand


def record(wires, force, dofs, **more):
    return {
        "wires": wires,
        "section_points": 6,
        "parts": 1,
        "dofs": dofs,
        "seconds": 12.34,
        "memory": 320e6,
        "search": 0.051,
        "solves": 17,
        "force": force,
        "thin": 102.0,
    } | more


def test_table_says_how_far_each_space_is_from_the_finest():
    lines = many.table([record(7, 102.0, 3024), record(7, 100.0, 5040, parts=2), record(19, 5.0, 9000)]).splitlines()
    assert lines[2] == "| 7 | 6, 1 | 3,024 | 12.3 | 92 | 320 | 5.1 % | 17 | 102 | +2.00 % | +0.00 % |"
    assert lines[3].startswith("| 7 | 6, 2 | 5,040 |") and lines[3].endswith("| 100 |  | -1.96 % |")
    assert lines[4].startswith("| 19 |") and lines[4].endswith("| 5 |  | -95.10 % |")


def test_plot_is_drawn_of_what_has_run_so_far(tmp_path):
    many.draw([record(7, 1.0, 10), record(7, 1.0, 20, parts=2), record(19, 1.0, 30)], tmp_path / "many.png")
    assert (tmp_path / "many.png").stat().st_size > 10_000


def test_study_refuses_other_numbers_of_wires(tmp_path):
    with pytest.raises(InputError, match="wires: got 8, need 7, 19, 37, 61, 91"):
        many.main([str(tmp_path / "new"), "7", "8"])
    assert not (tmp_path / "new").exists()


def test_layers_that_cross_are_not_missed_between_points():
    """Points along a wire are no farther apart than half its radius; one layer, touching along lines, has fewer."""
    for parts in (1, 2):
        scene = Strand(layers=2, section_points=6, parts=parts, length=60.0)
        model = scene.model()
        (contact,) = model.contacts
        fewest = min(body.space.axis.elements for body in model.bodies)
        assert 60.0 / np.cos(scene.lay_angle) / fewest / contact.points[1] <= 0.5 * scene.wire_radius
    assert Strand(length=60.0).model().contacts[0].points == (3, 5)


def test_elements_are_about_as_long_in_all_layers():
    """Wires of the fifth layer go round once in five pitches, and cross those below at as many places."""
    model = Strand(layers=5, section_points=6, parts=2, length=115.0).model()
    counts = np.array([body.space.axis.elements for body in model.bodies])
    assert counts.min() == counts[0] == 16
    assert counts.max() <= 1.5 * 16


def test_thin_rods_pull_as_the_scene_does_without_bending_them():
    """All wires as straight rods at the lay angle, which nothing draws inwards: a bound that is near."""
    scene = Strand(layers=5, **many.SCENE)
    wires = 1.97**2 + 90 * 1.865**2 * np.cos(scene.lay_angle) ** 3
    assert 0.9 < many.thin(scene) / (0.002 * 188e3 * np.pi * wires) < 1.0
    assert many.thin(Strand(layers=1, strain=1.0)) == pytest.approx(1.3556e7, rel=1e-4)


@pytest.mark.slow
def test_nineteen_wires_are_drawn_together_without_a_step_that_fails():
    """With the penalty of a single layer Newton's method throws the outer layer back and forth."""
    scene = Strand(layers=2, section_points=6, parts=1, length=60.0, strain=0.002, friction=0.115)
    solution = statics.solve(scene.model(), load_steps=many.STEPS, petsc=many.PETSC)
    found = scene.measure(solution)
    assert solution.cuts == 0
    assert found["relative_penetration"] < 3e-3
    # Where the planes hold wires they cannot tilt.
    assert found["force"] == pytest.approx(many.thin(scene), rel=0.02)
