"""The study of all laws in motion: energy is kept by explicit and implicit steps, and what the table says."""

import pytest

pytest.importorskip("rich")

from comparisons.laws import motion


@pytest.mark.parametrize("kind", motion.KINDS)
@pytest.mark.parametrize("law", ["neo-hookean", "hgo-two"])
def test_a_short_motion_keeps_its_energy(law, kind):
    record = motion.moved(law, kind, 100)
    assert motion.keeps(record) and record["steps"] == 100
    assert record["energy_error"] < (1e-9 if kind.startswith("implicit") else motion.TOLERANCE)
    # It moves far enough to strain.
    assert record["stored"] > 0.1
    assert motion.table([record])[1][0][:2] == (law, kind)


@pytest.mark.slow
@pytest.mark.parametrize("kind", motion.KINDS)
@pytest.mark.parametrize("law", motion.LAWS)
def test_energy_is_kept_for_ten_thousand_steps(law, kind):
    if law in motion.WHOLE and kind.endswith("mixed"):
        pytest.skip("it does not split")
    record = motion.moved(law, kind, motion.STEPS["full"])
    print(record)
    assert record["steps"] == 10_000 and motion.keeps(record)


def test_what_fails_is_told_in_the_table():
    record = {"law": "gent", "kind": motion.KINDS[0], "steps": 5, "failure": "no way"}
    head, (row,) = motion.table([record])
    assert not motion.keeps(record) and row[2] == "no way" and len(row) == len(head)
