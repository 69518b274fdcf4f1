"""Many rods welded beside finite elements of them as one solid, small: a ring of few struts and a lattice of a cell."""

import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from comparisons.joints import frames, whole


def test_a_welded_ring_has_the_frequencies_of_a_closed_rod(monkeypatch):
    monkeypatch.setattr(frames, "STRUTS", 8)
    monkeypatch.setattr(frames, "RADIUS", 2.0)
    ring = frames.stent()
    assert len(ring.spaces) == len(ring.ties) == 8
    found = frames.frequencies(ring, 3)
    bricks, _ = frames.frequencies_of_bricks(3, 1)
    # Those of the coarsest bricks are a third of a per cent low.
    assert found == pytest.approx(bricks, rel=6e-3)


def test_a_lattice_of_one_cell_is_as_stiff_as_one_solid():
    cell = frames.lattice(1)
    assert (len(cell.spaces), len(cell.ties)) == (4 + 2 * 4, 2 * 2 * 4)
    force = frames.sheared(cell, 1).reactions[1::2, 0].sum()
    one = whole.solve(frames.as_one(1, 0.4), frames.PROBLEM)
    assert force == pytest.approx(one.reactions[1, 0], rel=0.05)
