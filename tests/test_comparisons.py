"""The pieces of the studies that decide what is reported."""

import json
import re
import sys

import numpy as np
import pytest

from comparisons.measure import mac, records, sampled, work
from comparisons.measure.convergence import richardson
from comparisons.measure.study import Run
from comparisons.report import precision
from isorod import modal
from isorod.errors import InputError, SolveError
from isorod.scenes.blade import Blade
from isorod.space.basis import POLYNOMIALS


@pytest.mark.parametrize("order", [1.0, 2.0, 3.7])
def test_richardson_recovers_limit_and_order(order):
    sizes = [0.4, 0.2, 0.13]
    found = richardson(sizes, [6.1 + 0.3 * h**order for h in sizes])
    assert found.value == pytest.approx(6.1, abs=1e-10)
    assert found.order == pytest.approx(order, abs=1e-8)
    assert found.distance == pytest.approx(0.3 * 0.13**order, rel=1e-6)


def test_richardson_takes_the_three_finest_meshes():
    """Coarser ones, not yet at the order, do not count."""
    sizes = [1.6, 0.8, 0.4, 0.2, 0.1]
    values = [9.0, 5.0, *(6.1 + 0.3 * h**2 for h in sizes[2:])]
    found = richardson(sizes, values)
    assert (found.value, found.order) == pytest.approx((6.1, 2.0), abs=1e-8)
    assert found.distance == pytest.approx(0.3 * 0.1**2, rel=1e-6)


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


FINER = (("--elements", 4), ("--points", 2))


# Of the programs that can be compared, those of the studies.
SIDES = ("cylindrical", "fem")


def rows(table):
    """Return the cells of a table of the page, row by row, without their tags."""
    cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>(.*?)</tr>", table, re.DOTALL)]
    return [[re.sub("<[^>]+>", "", cell) for cell in row] for row in cells]


def measured(forces, times, monkeypatch, tmp_path, target=1e-2, finer=FINER, slower=None, known=(), others=None):
    """Run a work-precision of made-up solvers; return the records of what reaches the target."""
    factors = slower or {}

    def run(module, words, interpreter=sys.executable):
        elements, points = int(words[words.index("--elements") + 1]), int(words[words.index("--points") + 1])
        (method,) = (name for name in work.MODULES if work.MODULES[name] == module)
        return {
            "method": method,
            "force": forces(elements, points),
            "dofs": elements * points,
            "peak_memory": 2**20,
            "discretisation": [{"family": POLYNOMIALS}],
            "versions": {"dolfinx": (others or {}).get(interpreter, "0.9")} if method == "fem" else {},
            "seconds": {"total": times(elements, points) * factors.get(method, 1.0) * factors.get(interpreter, 1.0)},
        }

    monkeypatch.setattr(work.timing, "run", run)
    study = Run("made-up", "quick", tmp_path)
    curves = [
        work.Curve(
            f"curve of {method}", method, tuple(f"--elements {n} --points {p}" for n in (4, 8, 16) for p in (4, 8))
        )
        for method in SIDES
    ]
    curves = work.with_others(curves, list(others or ()))
    with study.progress(work.steps_of(curves, [target])) as steps:
        precision_of = work.WorkPrecision(
            study, steps, "made-up", dict.fromkeys(work.MODULES, finer), lambda found: abs(found["force"] - 1.0)
        )
        precision_of.run(curves, [target], {target: known})
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
    for method in SIDES:
        best = precision.fastest(found, method, 1e-2)
        assert best is not None
        assert best["turns"] == [320.0, 64.0, 64.0]
        assert best["seconds"]["total"] == 64.0


def test_each_version_of_dolfinx_has_its_own_fastest_run(monkeypatch, tmp_path):
    """The other interpreter is faster where the solver is slow, and measured in turn with the running one."""
    others, slower = {"/else/python": "0.11"}, {"/else/python": 0.5}
    found = measured(
        lambda n, p: 1.0 + 1.0 / n**2, lambda n, p: n * p, monkeypatch, tmp_path, slower=slower, others=others
    )
    runs = [(one["interpreter"], one["versions"].get("dolfinx")) for one in records.part(found, "work")]
    assert runs == [(sys.executable, None)] * 6 + [(sys.executable, "0.9")] * 6 + [("/else/python", "0.11")] * 6
    best = [one for one in records.part(found, "confirm") if one["holds"]]
    assert [(one["versions"].get("dolfinx"), one["turns"]) for one in best] == [
        (None, [64.0] * work.TURNS),
        ("0.9", [64.0] * work.TURNS),
        ("0.11", [32.0] * work.TURNS),
    ]


def test_the_best_known_are_measured_again_too_whatever_the_curves_said(monkeypatch, tmp_path):
    """The machine is busy while a curve comes to the fastest: it is not the fastest there, and yet it is in the end."""
    asked = []

    def times(n, p):
        asked.append((n, p))
        return 500.0 if (n, p) == (16, 4) and asked.count((16, 4)) <= 2 else n * p

    known = ("--elements 16 --points 4", "--elements 4 --points 4")
    found = measured(lambda n, p: 1.0 + 1.0 / n**2, times, monkeypatch, tmp_path, known=known)
    for method in SIDES:
        best = precision.fastest(found, method, 1e-2)
        assert best is not None
        assert (best["arguments"], best["seconds"]["total"]) == ("--elements 16 --points 4", 64.0)
        # What is known and not within the target any more is no matter.
        assert len([one for one in records.part(found, "confirm") if one["method"] == method]) == 2


def test_errors_that_cancel_do_not_count(monkeypatch, tmp_path):
    # Axis and section errors cancel exactly at 4 elements, 4 points.
    found = measured(lambda n, p: 1.0 + 1.0 / n**2 - 1.0 / p**2, lambda n, p: n * p, monkeypatch, tmp_path)
    lucky, held = (precision.fastest(found, "cylindrical", 1e-2, holds) for holds in (False, True))
    assert lucky is not None
    assert lucky["arguments"] == "--elements 4 --points 4"
    # Where each error is small for itself, one step finer in the other stays within.
    assert held is not None
    assert held["arguments"] == "--elements 8 --points 8"


@pytest.mark.parametrize("luck", ["axis", "section"])
def test_a_run_holds_only_if_both_finer_ones_are_within_the_target(luck, monkeypatch, tmp_path):
    """At 4 elements and 4 points, one step finer in one of the two shows the luck, in the other it does not."""

    def forces(n, p):
        return 1.1 if (n, p) == {"axis": (8, 4), "section": (4, 6)}[luck] else 1.0

    found = measured(forces, lambda n, p: n * p, monkeypatch, tmp_path)
    for method in SIDES:
        lucky, held = (precision.fastest(found, method, 1e-2, holds) for holds in (False, True))
        assert lucky is not None
        assert lucky["arguments"] == "--elements 4 --points 4"
        assert [near["arguments"] for near in lucky["finer"]] == ["--elements 8 --points 4", "--elements 4 --points 6"][
            : {"axis": 1, "section": 2}[luck]
        ]
        assert held is not None
        assert held["arguments"] == "--elements 4 --points 8"
        assert [near["error"] for near in held["finer"]] == [0.0, 0.0]


def test_a_run_that_only_one_step_finer_could_check_does_not_hold(monkeypatch, tmp_path):
    """Without an option for the section nobody knows whether its error is small or cancels."""
    found = measured(lambda n, p: 1.0, lambda n, p: n, monkeypatch, tmp_path, finer=(("--elements", 4), ("--rings", 1)))
    for method in SIDES:
        assert precision.fastest(found, method, 1e-2) is None
        lucky = precision.fastest(found, method, 1e-2, holds=False)
        assert lucky is not None
        assert len(lucky["finer"]) == 1


def test_a_ratio_of_times_says_who_is_slower():
    assert precision.ratio(1.0, 4.0) == "1/4 of"
    assert precision.ratio(4.0, 1.0) == "4.0 times"
    assert precision.ratio(1.0, 1.25) == "0.8 times"


@pytest.mark.parametrize(("ours", "share"), [(3.0, "3.0 times"), (0.25, "1/4")])
def test_the_table_of_the_fastest_says_our_share_of_their_time(ours, share, monkeypatch, tmp_path):
    found = measured(
        lambda n, p: 1.0,
        lambda n, p: 1e-3 * n * p,
        monkeypatch,
        tmp_path,
        slower={"cylindrical": ours, "fem": 1.0},
    )
    head, cylindrical, fem = rows(precision.reach(found))
    assert cylindrical == [
        "1 %", "isorod, polynomials", f"{16 * ours:.1f}", share.removesuffix(" times"), "16", "curve of cylindrical",
        "0 %", "0 %, 0 %", "", "1",
    ]  # fmt: skip
    assert fem == ["1 %", "dolfinx 0.9", "16.0", "", "16", "curve of fem", "0 %", "0 %, 0 %", "", "1"]
    assert head[3] == "our share"


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


def test_runs_are_repeated_six_times_and_checks_run_once_and_every_step_is_shown(monkeypatch, tmp_path, capsys):
    repeats = []

    def spy(module, words, interpreter):
        repeats.append(int(words[words.index("--repeat") + 1]))
        return made_up(module, words, interpreter)

    measured(lambda n, p: 1.0, lambda n, p: n * p, monkeypatch, tmp_path)
    made_up = work.timing.run
    monkeypatch.setattr(work.timing, "run", spy)
    study = Run("again", "quick", tmp_path)
    curves = [work.Curve("c", method, ("--elements 4 --points 4",)) for method in SIDES]
    total = work.steps_of(curves, [1e-2, 1e-3])
    capsys.readouterr()
    finer = dict.fromkeys(work.MODULES, FINER)
    with study.progress(total) as steps:
        first = work.WorkPrecision(study, steps, "x", finer, lambda found: 0.0)
        first.run(curves, [1e-2, 1e-3], {1e-2: (), 1e-3: ()})
    # Two along the curves, and two finer ones of either side; for each target both again in turn.
    assert repeats == [6, 6, 1, 1, 1, 1, *2 * 6 * [6]]
    shown = re.findall(r"\[(\d+)/(\d+)\]", capsys.readouterr().err)
    assert shown == [(str(k), str(total)) for k in range(1, total + 1)]
    # A scene that asks something else of the same rods measures anew what stands side by side, and nothing else.
    repeats.clear()
    with study.progress(total) as steps:
        other = work.WorkPrecision(study, steps, "y", finer, lambda found: 1e-3, kept=first.kept)
        other.run(curves, [1e-2], {1e-2: ()})
    assert repeats == 6 * [6]
    of_other = [line for line in map(json.loads, study.path.read_text().splitlines()) if line.get("scene") == "y"]
    assert len(of_other) == 4
    assert {line["error"] for line in of_other} == {1e-3}
    again = [json.loads(line) for line in study.path.read_text().splitlines()]
    assert precision.targets(again) == [1e-2, 1e-3]
    for record in again:
        assert {"commit", "versions", "machine"} <= record.keys()


def test_the_table_of_every_run_says_its_parts_and_its_solver():
    """Error and time come first: what is behind them may be out of sight."""
    seconds = {"setup": 0.001, "forms": 0.002, "assembly": 0.004, "solve": 0.2, "total": 0.207}
    one = {"curve": "c", "arguments": "--a 1", "dofs": 1234, "error": 0.0123, "seconds": seconds}
    fem = one | {"petsc_options": {"ksp_type": "cg", "empty": ""}, "newton_iterations": 7}
    fem |= {"method": "fem", "versions": {"dolfinx": "0.9"}}
    modes = one | {"petsc_options": "", "solver": {"eps": "krylovschur"}, "iterations": 3}
    modes |= {
        "method": "cylindrical",
        "versions": {},
        "discretisation": [{"family": POLYNOMIALS}],
        "seconds": seconds | {"check": 0.03, "total": 0.237},
    }
    head, first, second = rows(precision.runs([fem, modes]))
    assert head[1:4] == ["element", "error", "total ms"]
    parts = ["1,234", "3.0", "4.0", "200"]
    assert first == ["dolfinx 0.9: c", "", "1.2 %", "207", *parts, "", "7", "--a 1", "-ksp_type cg"]
    assert second == ["isorod: c", "polynomials", "1.2 %", "237", *parts, "30.0", "3", "--a 1", "eps krylovschur"]


def test_mac_of_modes_with_themselves_is_the_identity_on_the_diagonal():
    found = modal.solve(Blade(preset="paper", elements=6).model(), 4)
    rng = np.random.default_rng(1)
    radius, angle = np.sqrt(rng.random(60)), 2.0 * np.pi * rng.random(60)
    xi = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    u = np.repeat(np.linspace(0.0, 1.0, 12), 5)
    shapes = sampled.fields(found, sampled.Places(np.zeros(len(u), dtype=int), xi, u, *np.zeros((3, 0))))["modes"]
    matrix = mac.matrix(shapes, -3.0 * shapes)
    assert np.diag(matrix) == pytest.approx(1.0)
    assert (matrix <= 1.0 + 1e-12).all()
    assert np.abs(matrix - np.diag(np.diag(matrix))).max() < 0.9
