"""Finite element runs: which parts of which repetition are their time, and options that do not go together."""

import itertools
from types import SimpleNamespace

import pytest
from refused import refused

pytest.importorskip("dolfinx")

from mpi4py import MPI

from comparisons.fem import runs
from comparisons.measure import timing
from isorod.errors import InputError
from isorod.fenics import compat


def clocked(monkeypatch, *lengths):
    """Return a made-up solve whose runs take so long, a quarter of it assembly, a quarter the check of the result."""
    ticks = itertools.chain.from_iterable((100.0 * k, 100.0 * k + length) for k, length in enumerate(lengths))
    monkeypatch.setattr(timing, "perf_counter", lambda: next(ticks))
    monkeypatch.setattr(timing, "process_time", lambda: 0.0)
    left = iter(lengths)
    calls = []

    def solve():
        length = next(left)
        calls.append(length)
        return SimpleNamespace(seconds={"assembly": 0.25 * length, "check": 0.25 * length}, number=len(calls))

    return solve


def test_checks_count_as_run_time_and_stay_a_part_of_their_own(monkeypatch):
    _, _, seconds = runs.timed(clocked(monkeypatch, 8.0), 1, MPI.COMM_SELF)
    assert seconds == {"assembly": 2.0, "check": 2.0, "total": 8.0, "processor": 0.0}


def test_the_time_is_the_median_of_the_warm_runs(monkeypatch):
    found, each, seconds = runs.timed(clocked(monkeypatch, 80.0, 4.0, 16.0, 8.0), 4, MPI.COMM_SELF)
    assert found.number == 4
    assert [one["total"] for one in each] == [80.0, 4.0, 16.0, 8.0]
    assert seconds == {"assembly": 2.0, "check": 2.0, "total": 8.0, "processor": 0.0}


def test_provenance_names_the_finite_elements():
    versions = runs.provenance()["versions"]
    assert versions["dolfinx"] == compat.version
    assert versions["petsc"].count(".") == 2


@pytest.mark.parametrize("bricks", [True, False])
def test_elements_that_fit_pass(bricks):
    for degree in range(1, 5 if bricks else 4):
        runs.check_element(bricks, degree, "Lagrange", 20, 2)
    if bricks:
        runs.check_element(True, 2, "S", "irons14", 2)
        runs.check_element(True, 1, "enhanced", None, 1)


test_elements_that_do_not_fit_are_refused = refused(
    ((True, 5, "Lagrange", None, 1), r"degree: got 5, need 1 to 4 on bricks"),
    ((False, 4, "Lagrange", None, 1), r"degree: got 4, need 1 to 4 on bricks, 1 to 3 on tetrahedra"),
    ((False, 0, "Lagrange", None, 1), r"degree: got 0"),
    ((False, 2, "S", None, 1), r"family S: bricks only"),
    ((True, 1, "enhanced", None, 2), r"family enhanced: .* --order 1"),
    ((True, 2, "enhanced", None, 1), r"family enhanced: .* --degree 1"),
    ((False, 2, "Lagrange", "irons14", 1), r"quadrature irons14: bricks only"),
    ((True, 2, "Lagrange", 0, 1), r"quadrature: got degree 0, need 1 to 20"),
    ((True, 2, "Lagrange", 21, 1), r"quadrature: got degree 21, need 1 to 20"),
    by=lambda given: runs.check_element(*given),
)


def test_a_mesh_that_is_refused_is_refused_on_every_rank():
    def build():
        raise InputError("layers: got 5")

    with pytest.raises(InputError, match=r"^layers: got 5$"):
        runs.distribute(build, MPI.COMM_SELF)
