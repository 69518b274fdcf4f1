"""The sweep towards incompressibility, quick level: what holds, what locks, and that the record says so."""

import pytest

from comparisons.stability import incompressible
from comparisons.stability.point import holds, limits, sweeps

CASES = (incompressible.SPRING, incompressible.BENT, incompressible.PINCHED)


@pytest.fixture(scope="module")
def records():
    return list(incompressible.run("quick"))


@pytest.mark.parametrize("case", CASES)
def test_mixed_formulation_is_within_half_a_percent_of_taylor_hood_elements_for_every_ratio(records, case):
    curve = sweeps(records)[case]["mixed, K = 2"]
    assert [record["nu"] for record in curve] == list(incompressible.RATIOS)
    assert all(holds(record) for record in curve)
    # Newton's method does not see the ratio either.
    assert len({record["newton"] for record in curve}) == 1


@pytest.mark.parametrize(("case", "error"), [(CASES[0], 0.4), (CASES[1], 0.8), (CASES[2], 0.15)])
def test_displacement_formulation_locks(records, case, error):
    curve = sweeps(records)[case]["displacement, K = 1"]
    # A point that fails outright would do as well.
    assert curve[-1].get("error", 1.0) > error


def test_twisted_cylinder_of_rivlin_is_exact_up_to_its_compressibility(records):
    for curve in sweeps(records)[incompressible.TWISTED.name].values():
        assert max(record["error"] for record in curve) < 1e-5


def test_limits_name_each_sweep_and_what_locks(records):
    lines = limits(records)
    assert len(lines) == 4
    assert "mixed, K = 2 up to 1e-06 (largest error " in lines[0]
    assert "displacement, K = 1 nowhere" in lines[1]
