"""Each analysis with each feature and each option has an answer, or one line that says why not; so says the page."""

from pathlib import Path

import combinations
import numpy as np
import pytest

from tests import combinations_page

# Cells of different paths that take a second or two; the others are slow.
QUICK = [
    ("statics", "hollow", "--tolerance"),
    ("statics", "friction", "--tolerance"),
    ("modes", "contact", "alone"),
    ("modes", "spin", "--set"),
    ("implicit", "fibres", "--output"),
    ("implicit", "self-contact", "alone"),
    ("explicit", "turned ends", "--checkpoint"),
    ("explicit", "plain", "--tolerance"),
]
CELLS = [
    (analysis, feature, option)
    for analysis in combinations.ANALYSES
    for feature in combinations.FEATURES
    for option in combinations.OPTIONS
]


@pytest.mark.parametrize(
    ("analysis", "feature", "option"),
    [pytest.param(*cell, marks=() if cell in QUICK else pytest.mark.slow) for cell in CELLS],
)
def test_a_combination_is_answered_or_refused_in_one_line_as_it_was_recorded(
    analysis, feature, option, tmp_path, command
):
    """Whether, not in which words: these may be of other numbers."""
    cell = analysis, feature, option
    here = command._run if cell in QUICK else None
    refused = combinations.refusal(*combinations.outcome(*cell, tmp_path / "cell", 600.0, here))
    before = combinations_page.read()[analysis][feature][option]
    assert "unfinished" in before or bool(refused) == bool(before["refused"]), refused


@pytest.mark.parametrize("section", combinations.SECTIONS)
@pytest.mark.parametrize("case", [case for case, given in combinations.CASES.items() if given[-1] == 1])
def test_a_section_is_answered_or_refused_in_one_line_as_it_was_recorded(case, section, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(combinations.of_section(case, section))
    before = combinations_page.read()["sections"][case][section]["refused"]
    if before:
        assert command.refuses("run", "scene.toml", "--json") == before
    else:
        assert command.record("run", "scene.toml")["analysis"]


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("section", combinations.SECTIONS)
@pytest.mark.parametrize("case", [case for case, given in combinations.CASES.items() if given[-1] > 1])
def test_a_section_takes_ranks_as_it_was_recorded(case, section, tmp_path):
    refused = combinations.refusal(*combinations.outcome("sections", case, section, tmp_path / "cell", 600.0))
    assert refused == combinations_page.read()["sections"][case][section]["refused"]


FORCE = '[measure.push]\nreaction = "hand"\ncomponent = "y"\n[analysis'


@pytest.mark.parametrize("case", ["statics", "prestressed modes", "mixed: statics", "mixed: prestressed modes"])
def test_layers_of_one_law_are_the_solid_rod(case, command, tmp_path):
    """Their functions include the solid one's: forces and frequencies are within a per cent, and no higher."""
    path, found = tmp_path / "scene.toml", []
    for section in ("polynomials", "layered"):
        text = combinations.of_section(case, section, second=combinations.CASES[case][0])
        path.write_text(text if "modes" in case else text.replace("[analysis", FORCE))
        record = command.record("run", path)
        found.append(np.array(record["frequencies"] if "modes" in case else [record["push"]]))
    assert np.abs(found[1] / found[0] - 1.0).max() < 1e-2


def test_the_page_is_what_the_record_makes():
    assert combinations_page.PAGE.read_text() == combinations_page.page(combinations_page.read())


def test_the_record_has_every_cell_which_is_an_answer_or_a_line_or_marked_as_not_finished():
    record = combinations_page.read()
    assert list(record) == list(combinations.TABLES)
    for table, found in record.items():
        rows, columns = combinations.TABLES[table]
        assert list(found) == list(rows)
        for name, row in found.items():
            assert list(row) == list(columns)
            for column, cell in row.items():
                where = table, name, column
                if "unfinished" in cell:
                    assert set(cell) == {"unfinished"} and (cell["unfinished"] == 0.0 or cell["unfinished"] >= 60.0), (
                        where
                    )
                    continue
                assert set(cell) == {"refused", "seconds"} and cell["seconds"] > 0.0, where
                assert "\n" not in cell["refused"] and "Error" not in cell["refused"], where


def test_a_page_tells_answers_lines_and_what_is_open():
    """A line that several cells have stands once; what is broken is no page."""
    cells = {option: {"refused": "", "seconds": 1.0} for option in combinations.OPTIONS}
    cells |= {"--tolerance": {"refused": "no: such", "seconds": 1.0}, "--set": {"refused": "no: such", "seconds": 2.0}}
    cells |= {"--output": {"refused": "", "seconds": 33.3}, "compare": {"unfinished": 90.0}}
    text = combinations_page.page({"statics": {"plain": cells}})
    assert "Of 7 combinations 4 are answered and 2 are refused; of 1 nobody waited" in text
    assert "| plain | yes | no (1) | yes, 33 s | no (1) | yes | yes | ? 90 s |" in text
    assert text.count("no: such") == 1
    cells["alone"] = {"broken": "Traceback"}
    with pytest.raises(SystemExit, match="broken"):
        combinations_page.page({"statics": {"plain": cells}})
