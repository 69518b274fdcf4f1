"""Strands of many wires: layers that cross, and the study's table."""

import numpy as np
import pytest

from comparisons.contact import many
from isorod import statics
from isorod.errors import InputError
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
    } | more


def test_table_says_how_far_each_space_is_from_the_finest():
    lines = many.table([record(7, 102.0, 3024), record(7, 100.0, 5040, parts=2), record(19, 5.0, 9000)]).splitlines()
    assert lines[2] == "| 7 | 6, 1 | 3,024 | 12.3 | 92 | 320 | 5.1 % | 17 | 102 | +2.00 % |"
    assert lines[3].startswith("| 7 | 6, 2 | 5,040 |") and lines[3].endswith("| 100 |  |")
    assert lines[4].startswith("| 19 |") and lines[4].endswith("| 5 |  |")


def test_plot_is_drawn_of_what_has_run_so_far(tmp_path):
    many.draw([record(7, 1.0, 10), record(7, 1.0, 20, parts=2), record(19, 1.0, 30)], tmp_path / "many.png")
    assert (tmp_path / "many.png").stat().st_size > 10_000


def test_study_refuses_other_numbers_of_wires(tmp_path):
    with pytest.raises(InputError, match="wires: got 8, need 7, 19, 37, 61, 91"):
        many.main([str(tmp_path / "new"), "7", "8"])
    assert not (tmp_path / "new").exists()


def test_layers_that_cross_are_not_missed_between_points():
    """Points along a wire are no farther apart than its radius; one layer, which touches along lines, has fewer."""
    for parts in (1, 2):
        scene = Strand(layers=2, section_points=6, parts=parts, length=60.0)
        model = scene.model()
        (contact,) = model.contacts
        fewest = min(body.space.axis.elements for body in model.bodies)
        assert 60.0 / np.cos(scene.lay_angle) / fewest / contact.points[1] <= scene.wire_radius
        assert contact.penetration == pytest.approx(1e-3 * scene.wire_radius)
    assert Strand(length=60.0).model().contacts[0].points == (3, 5)


@pytest.mark.slow
def test_nineteen_wires_are_drawn_together_in_one_step():
    """With the penalty of a single layer Newton's method throws the outer layer back and forth."""
    scene = Strand(layers=2, section_points=6, parts=1, length=60.0, strain=0.002, friction=0.115)
    solution = statics.solve(scene.model())
    found = scene.measure(solution)
    assert (solution.load_steps, solution.cuts) == (1, 0)
    assert found["relative_penetration"] < 1e-3
    # Thin wires that nothing draws inwards: an upper bound.
    wires = 1.97**2 + 18 * 1.865**2 * np.cos(scene.lay_angle) ** 3
    assert 0.95 < found["force"] / (0.002 * 188e3 * np.pi * wires) < 1.0
