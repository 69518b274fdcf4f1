"""The published numbers, in comparisons.measure.published alone: sums of the printed tables guard every digit.

Other tests compare the tables with what the element gives (test_spring, test_blade); that alone would not see the last
digits where the parameters inferred for the paper leave a tenth of a percent.
"""

import numpy as np
import pytest

from comparisons.measure import published
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring


def sums(table, unit):
    """Return the sums of rows and of columns in units of the last printed digit, exact."""
    counts = np.array([[round(value / unit) for value in row] for row in table.values()])
    assert counts * unit == pytest.approx(np.array(list(table.values())), abs=1e-9), "more digits than printed"
    return counts.sum(axis=1).tolist(), counts.sum(axis=0).tolist()


def test_digits_of_table_1():
    assert published.SPRING_ELEMENTS_PER_TURN == (4, 8, 12, 16, 20, 24)
    assert list(published.SPRING_FORCE) == [4, 8, 16]
    rows, columns = sums(published.SPRING_FORCE, 1e-5)
    assert rows == [3905095, 3897407, 3897386]
    assert columns == [2467044, 1888546, 1844291, 1835411, 1832790, 1831806]


def test_digits_of_table_2():
    assert list(published.BLADE_FREQUENCIES) == [5, 10, 15, 20, 25, 30]
    rows, columns = sums(published.BLADE_FREQUENCIES, 1e-6)
    assert rows == [50364580, 37578360, 35469880, 35099670, 34993542, 34952347]
    assert columns == [
        1131708, 4854841, 8603670, 12380170, 15717800, 24300560, 30959670, 37176420, 42317910, 51015630,
    ]  # fmt: skip


def test_tables_fall_with_refinement_as_rayleigh_and_ritz_demand():
    for row in published.SPRING_FORCE.values():
        assert (np.diff(row) < 0.0).all()
    for points in ((4, 8), (8, 16)):
        coarse, fine = (np.array(published.SPRING_FORCE[n]) for n in points)
        assert (fine < coarse).all()
    frequencies = np.array(list(published.BLADE_FREQUENCIES.values()))
    assert (np.diff(frequencies, axis=0) < 0.0).all()
    assert (np.diff(frequencies, axis=1) > 0.0).all()


def test_digits_of_the_papers_finite_elements():
    assert published.SPRING_FEM_FORCE == 6.0100
    # Sections of 97 nodes and 84 quadrilaterals, 72 layers; the paper counts three degrees of freedom to a node.
    assert (published.SPRING_FEM_NODES, published.SPRING_FEM_ELEMENTS) == (73 * 97, 72 * 84)
    assert 3 * published.SPRING_FEM_NODES == 21243
    assert 3 * published.BLADE_FEM_NODES == 3105
    # Sections of 69 nodes and 49 quadrilaterals, 14 layers.
    assert (published.BLADE_FEM_NODES, published.BLADE_FEM_ELEMENTS) == (15 * 69, 14 * 49)
    frequencies = published.BLADE_FEM_FREQUENCIES
    assert sums({"": frequencies}, 1e-4)[0] == [345896]
    assert len(frequencies) == 10 and sorted(frequencies) == list(frequencies)


def test_inferred_parameters_are_those_of_the_scenes():
    """What they were fitted to, test_spring and test_blade check."""
    assert (published.SPRING_E, published.SPRING_NU) == (Spring().E, Spring().nu)
    blade = Blade(preset="paper")
    assert (published.BLADE_LENGTH, published.BLADE_TWIST, published.BLADE_TAPER) == (
        blade.length,
        blade.twist,
        blade.taper,
    )
