"""The pieces of the studies that decide what is reported."""

import json

import numpy as np
import pytest

from comparisons.measure import mac, published, records, work
from comparisons.measure.convergence import richardson
from comparisons.measure.study import Run
from comparisons.report import precision
from isorod import modal
from isorod.errors import InputError, SolveError
from isorod.scenes.blade import Blade


@pytest.mark.parametrize("order", [1.0, 2.0, 3.7])
def test_richardson_recovers_limit_and_order(order):
    sizes = [0.4, 0.2, 0.13]
    found = richardson(sizes, [6.1 + 0.3 * h**order for h in sizes])
    assert found.value == pytest.approx(6.1, abs=1e-10)
    assert found.order == pytest.approx(order, abs=1e-8)
    assert found.distance == pytest.approx(0.3 * 0.13**order, rel=1e-6)


@pytest.mark.parametrize("values", [(1.0, 2.0, 1.5), (1.0, 1.0, 1.0), (1.0, 2.0, 4.0)])
def test_richardson_refuses_values_that_do_not_converge(values):
    with pytest.raises(SolveError, match="no order of convergence"):
        richardson([0.4, 0.2, 0.1], values)


def test_richardson_wants_meshes_that_refine():
    with pytest.raises(SolveError, match="must decrease"):
        richardson([0.4, 0.4, 0.1], [1.0, 1.1, 1.2])


def test_a_record_keeps_its_own_part_even_when_made_from_another(tmp_path):
    run = Run("spring", "quick", tmp_path)
    first = run.record("work", {"force": 1.0})
    second = run.record("confirm", first | {"target": 0.1})
    assert (first["part"], second["part"]) == ("work", "confirm")
    assert [json.loads(line)["part"] for line in run.path.read_text().splitlines()] == ["work", "confirm"]


def test_newest_is_the_last_complete_run(tmp_path):
    for closing in (True, True, False):
        run = Run("spring", "quick", tmp_path)
        run.record("work", {"force": 1.0})
        if closing:
            run.record("end", {})
            complete = run.identity
    assert {record["run"] for record in records.newest(tmp_path, "spring")} == {complete}


def test_no_complete_run_is_no_records(tmp_path):
    Run("spring", "quick", tmp_path).record("work", {"force": 1.0})
    assert records.newest(tmp_path, "spring") == []


def test_a_damaged_line_is_named(tmp_path):
    for text in ('{"run": 1, "pa', '{"run": 1}', '{"run": 1, "part": "one", "force": NaN}', "[1]", "\xff"):
        (tmp_path / "spring.jsonl").write_bytes(b'{"run": 1, "part": "end"}\n' + text.encode("latin-1") + b"\n")
        with pytest.raises(InputError, match="line 2 is not JSON"):
            records.newest(tmp_path, "spring")


def test_a_torn_last_line_is_left_out_with_a_word(tmp_path):
    (tmp_path / "spring.jsonl").write_text('{"run": 1, "part": "end"}\n{"run": 1, "pa')
    with pytest.warns(UserWarning, match="last line is torn"):
        assert records.newest(tmp_path, "spring") == [{"run": 1, "part": "end"}]


def measured(forces, times, monkeypatch, tmp_path, target=1e-2):
    """Run a work-precision of made-up solvers; return the records of what reaches the target."""

    def run(module, words):
        elements, points = int(words[words.index("--elements") + 1]), int(words[words.index("--points") + 1])
        return {
            "method": "cylindrical" if module == "comparisons.measure.rod" else "fem",
            "force": forces(elements, points),
            "dofs": elements * points,
            "peak_memory": 2**20,
            "seconds": {"total": times(elements, points)},
        }

    monkeypatch.setattr(work.timing, "run", run)
    study = Run("made-up", "quick", tmp_path)
    finer = {method: (("--elements", 4), ("--points", 2)) for method in work.MODULES}
    curves = [
        work.Curve(
            f"curve of {method}", method, tuple(f"--elements {n} --points {p}" for n in (4, 8, 16) for p in (4, 8))
        )
        for method in work.MODULES
    ]
    with study.progress(work.steps_of(curves, [target])) as steps:
        precision_of = work.WorkPrecision(study, steps, "made-up", finer, lambda found: abs(found["force"] - 1.0))
        precision_of.run(curves, [target])
    study.record("end", {})
    return records.newest(tmp_path, "made-up")


def test_the_fastest_run_within_the_target_is_reported(monkeypatch, tmp_path):
    found = measured(lambda n, p: 1.0 + 1.0 / n**2 + 0.01 / p**2, lambda n, p: n * p, monkeypatch, tmp_path)
    best = precision.fastest(found, "fem", 1e-2)
    assert best is not None
    assert best["arguments"] == "--elements 16 --points 4"
    assert precision.fastest(found, "fem", 1e-2, holds=False) is None


def test_the_fastest_of_both_sides_are_measured_again_in_turn(monkeypatch, tmp_path):
    """Along the curves the machine is busy, and in the first turn again."""
    fastest = []

    def times(n, p):
        if (n, p) == (16, 4):
            fastest.append(len(fastest))
        return n * p * (1.0 if len(fastest) > 4 else 5.0)

    found = measured(lambda n, p: 1.0 + 1.0 / n**2, times, monkeypatch, tmp_path)
    assert len(fastest) == 2 + 2 * work.TURNS
    for method in work.MODULES:
        best = precision.fastest(found, method, 1e-2)
        assert best is not None
        assert best["turns"] == [320.0, 64.0, 64.0]
        assert best["seconds"]["total"] == 64.0


def test_errors_that_cancel_do_not_count(monkeypatch, tmp_path):
    # Axis and section errors cancel exactly at 4 elements, 4 points.
    found = measured(lambda n, p: 1.0 + 1.0 / n**2 - 1.0 / p**2, lambda n, p: n * p, monkeypatch, tmp_path)
    lucky, held = (precision.fastest(found, "cylindrical", 1e-2, holds) for holds in (False, True))
    assert lucky is not None
    assert lucky["arguments"] == "--elements 4 --points 4"
    assert held is None or held["seconds"]["total"] > lucky["seconds"]["total"]


def test_a_refused_run_is_recorded_and_the_study_goes_on(monkeypatch, tmp_path):
    def forces(n, p):
        if n == 4 or (n, p) == (16, 10):
            raise SolveError(f"too few & far between: {n}")
        return 1.0 + 1.0 / n**2

    found = measured(forces, lambda n, p: n * p, monkeypatch, tmp_path)
    refused = records.part(found, "refused")
    assert len(refused) == 4
    assert "too few &amp; far between: 4" in "".join(precision.refused(found))
    assert precision.refused([]) == []
    # With 16 and 8, one step finer in the section is refused: that does not hold.
    best = precision.fastest(found, "fem", 1e-2)
    assert best is not None
    assert best["arguments"] == "--elements 16 --points 4"
    tight = measured(forces, lambda n, p: n * (20 - p), monkeypatch, tmp_path, 5e-3)
    lucky = precision.fastest(tight, "fem", 5e-3, holds=False)
    assert lucky is not None
    assert lucky["arguments"] == "--elements 16 --points 8"


def test_published_tables_have_the_paper_s_sizes():
    assert sum(len(forces) for forces in published.SPRING_FORCE.values()) == 18
    assert sum(len(frequencies) for frequencies in published.BLADE_FREQUENCIES.values()) == 60


def test_mac_of_modes_with_themselves_is_the_identity_on_the_diagonal():
    found = modal.solve(Blade(elements=6).model(), 4)
    rng = np.random.default_rng(1)
    radius, angle = np.sqrt(rng.random(60)), 2.0 * np.pi * rng.random(60)
    xi = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    u = np.repeat(np.linspace(0.0, 1.0, 12), 5)
    shapes = mac.shapes_at(found, xi, u)
    matrix = mac.matrix(shapes, -3.0 * shapes)
    assert np.diag(matrix) == pytest.approx(1.0)
    assert (matrix <= 1.0 + 1e-12).all()
    assert np.abs(matrix - np.diag(np.diag(matrix))).max() < 0.9
