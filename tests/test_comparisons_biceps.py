"""What the biceps' study reports: errors, deviations of courses, its part of the page."""

import numpy as np
import pytest

from comparisons import biceps
from comparisons.measure import records
from comparisons.measure.convergence import extrapolate
from comparisons.measure.study import Run
from comparisons.report import biceps as report_biceps
from isorod.space.basis import PAPER

TIMES = [0.0, 0.1, 0.2]
REST = {"end_force": [100.0, 98.0, 100.0, 98.0], "belly_bulge": 0.2, "contact_force": 10.0, "contact_area": 3.0}


def test_error_of_the_end_forces_is_that_of_the_worst_end():
    found = REST | {"end_force": [101.0, 98.0, 100.0, 93.1], "belly_bulge": 0.19, "contact_force": 12.0}
    assert biceps.errors(found, REST) == pytest.approx({"end_force": 0.05, "belly_bulge": 0.05, "contact_force": 0.2})


def test_extrapolation_falls_back_on_the_finest_value():
    limit = extrapolate([0.4, 0.2, 0.1], [1.0 + h**2 for h in (0.4, 0.2, 0.1)])
    assert (limit.value, limit.order) == pytest.approx((1.0, 2.0))
    # Slower than first order, not monotone, two meshes alone.
    for values in ([1.0 + h**0.3 for h in (0.4, 0.2, 0.1)], [1.0, 2.0, 1.5], [2.0, 1.5]):
        limit = extrapolate([0.4, 0.2, 0.1][: len(values)], values)
        assert limit.order is None
        assert (limit.value, limit.distance) == pytest.approx((values[-1], abs(values[-1] - values[-2])))


def motion(scale=1.0):
    """Return a made-up record of the element's motion whose courses grow linearly in time."""
    force = scale * np.array(TIMES)
    return {
        "label": "K = 1",
        "method": "cylindrical",
        "discretisation": [{"family": PAPER}],
        "times": TIMES,
        "belly_bulge_history": (0.1 * force).tolist(),
        "end_force_history": np.outer(force, REST["end_force"]).tolist(),
        "contact_force": (50.0 * force).tolist(),
        "contact_area": (3.0 * force).tolist(),
        "equilibrium": REST,
        "from_equilibrium": {"end_force": 1e-3},
        "added_kinetic_share": 0.032,
        "energy_error": [0.0, 2e-3, 1e-5],
        "momentum_error": [0.0, 1e-15, 1e-15],
        "seconds": {"loop": 2.0},
        "time_step": 2.5e-5,
        "steps": 10000,
        "microseconds_a_step": 200.0,
        "dofs": 768,
        "options": {"ramp": 2.5e-3},
    }


def fem_motion():
    """Return a made-up record of the finite elements' motion, the same courses at other times."""
    times = [0.05, 0.1, 0.15]
    force = np.array(times)
    return {
        "label": "Q2 bricks",
        "time_step": 1e-5,
        "steps": 15000,
        "dofs": 20000,
        "seconds": {"step": 0.01},
        "history": {
            "time": times,
            "belly_bulge": (0.1 * force).tolist(),
            "end_force": np.outer(force, REST["end_force"]).tolist(),
            "contact_force": (50.0 * force).tolist(),
            "contact_area": (3.0 * force).tolist(),
        },
    }


@pytest.mark.parametrize("name", ["belly_bulge", "end_force", "contact_force", "contact_area"])
def test_courses_are_compared_at_the_finite_elements_times(name):
    assert report_biceps.deviation(motion(), fem_motion(), name) == pytest.approx(0.0, abs=1e-14)
    assert report_biceps.deviation(motion(0.9), fem_motion(), name) == pytest.approx(0.1)


def test_page_says_what_holds_and_what_does_not(tmp_path):
    run = Run("biceps", "quick", tmp_path)
    run.record(
        "converged", REST | {"limits": {name: {"uncertainty": 1e-3} for name in biceps.QUANTITIES}, "element": "Q2"}
    )
    run.record("motion", motion())
    run.record("fem motion", fem_motion())
    run.record("picture", {"file": "a.png", "dofs": [768, 20000]})
    run.record("end", {})
    found = records.newest(tmp_path, "biceps")
    page = "\n".join(report_biceps.section(found, tmp_path))
    # Of the six clauses only the energy's (2e-3) is broken.
    assert page.count("<td class=text>yes</td>") == 5
    assert page.count("<td class=text>no</td>") == 1
    assert (tmp_path / "biceps-motion.png").stat().st_size > 10_000
    assert "<td>3.2 %</td>" in page
    assert f"isorod ({PAPER}), K = 1, 2.0 s" in report_biceps.summary(found)[1]
