"""The study of size and ranks: its wire, its count of operations, what it makes of them on paper and on the page."""

import numpy as np
import pytest

from comparisons import scaling
from comparisons.report import scaling as page
from comparisons.scaling import cost, roofline, wire
from isorod.assembly.assembler import Assembler
from isorod.errors import InputError
from isorod.scenes.spring import Spring
from isorod.space.basis import PAPER


def test_the_wire_has_as_many_unknowns_for_each_coil():
    sizes = [wire.model("order-1", coils, False).unknowns for coils in (3, 4, 30)]
    assert sizes[0] == 1062
    assert sizes[1] - sizes[0] == 360 and sizes[2] == sizes[0] + 27 * 360


def test_as_much_is_asked_of_a_coil_however_many_there_are():
    few, many = (wire.measure("statics", "order-1", coils) for coils in (3, 6))
    assert many["value"] == pytest.approx(few["value"], rel=0.02)
    assert many["total"] > 0.0 and many["ranks"] == 1 and len(many["memory"]) == 1


@pytest.mark.parametrize(
    "arguments", [[], ["statics", "order-1"], ["statics", "cubes", "3"], ["modes", "order-1", "x"]]
)
def test_the_wire_says_what_it_needs(arguments):
    with pytest.raises(InputError, match=r"need statics\|modes\|implicit\|explicit"):
        wire.main(arguments)


def test_operations_are_those_of_the_products_written_out():
    """Sizes of the four products of matrices across, and of the sums along."""
    (part,) = Assembler(
        Spring(helix="paper", coils=1, section_points=6, order=1, elements_per_turn=4, degree=3).model()
    ).parts
    elements, along, points = part.table.weights.shape
    n, functions = part.table.section.shape[2], part.table.axial.shape[2]
    across = sum(rows * columns for rows, columns in ((3, 4), (3, 3), (9, 2), (6, 1))) * points * n * n
    pairs = functions * (functions + 1) // 2
    sums = (3 + 3 + 6) * n * n * pairs + 9 * n * n * functions**2
    assert roofline.operations(part) == 2 * elements * along * (across + sums)


def test_the_best_number_of_ranks_takes_the_least_time():
    record = {"unknowns": 10**6, "total": 15.0, "memory": [4 * 10**9], "memory_before": 10**9, "solves": 5}
    found = cost.fitted(record)
    assert found.unknown == pytest.approx(15e-6) and found.bytes == pytest.approx(3000.0)
    best = found.best(cost.LARGE)
    counts = np.unique(np.geomspace(1, 100 * best, 300).astype(int))
    times = [found.seconds(cost.LARGE, int(ranks)) for ranks in counts]
    assert found.seconds(cost.LARGE, best) <= min(times)
    # There the chain takes half of it.
    assert found.chain(best) == pytest.approx(0.5 * found.seconds(cost.LARGE, best), rel=0.01)
    assert found.nodes(cost.LARGE) == np.ceil(cost.LARGE * 3000 / (cost.NODE * 2**30))


def test_no_case_is_measured_twice_and_all_have_one_rank_beside_them():
    for level in scaling.SIZES:
        found = set(scaling.cases(level))
        assert {one._replace(ranks=1) for one in found if one.ranks > 1} <= found


def test_page_tells_what_was_measured(tmp_path):
    def record(coils, total, ranks=1, analysis="statics"):
        return {
            "part": "wire",
            "analysis": analysis,
            "family": PAPER,
            "coils": coils,
            "ranks": ranks,
            "unknowns": 360 * coils,
            "solves": 5,
            "value": 6.0 + 1e-10 * ranks,
            "seconds": {"setup": 0.1 * total, "assembly": 0.5 * total, "solve": 0.4 * total},
            "total": total,
            "first": 1.25 * total,
            "memory": [10**8 + 10**6 * coils // ranks] * ranks,
            "memory_before": 10**8,
            "level": "quick",
            "run": "abc",
        }

    kinds = {"family": "order-1", "unknowns": 7182, "points": 34560, "forces": 2e-7, "tangent": 1.5e-6}
    kinds |= {"extrapolated": 1.8e-6, "rate": 1.2e10, "dgemm": 4e10, "share": 0.3, "part": "roofline"}
    records = [record(30, 0.108), record(300, 1.296), record(300, 0.72, 2), kinds | {"level": "quick", "run": "abc"}]
    records.append({"part": "end", "level": "quick", "run": "abc", "versions": {}})
    lines = page.summary(records)
    assert lines[0].startswith("scaling: statics of 10,800 to 108,000 unknowns take 10.0 to 12.0 µs an unknown, 2.8 kB")
    assert "1.80 times as fast" in lines[1] and "30 % of DGEMM" in lines[2]
    text = "\n".join(page.section(records, tmp_path))
    assert "<td>10.0</td><td>12.5</td>" in text.replace(' class="number"', "")
    assert "100,000,000 unknowns" in text and (tmp_path / "scaling.png").stat().st_size > 10_000
