"""The list of studies: each can be run, and has its part of the report page."""

from importlib import import_module

import pytest

pytest.importorskip("rich")

from comparisons import STUDIES


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_runs_and_has_its_part_of_the_page(name):
    study, part = (import_module(f"{package}.{name}") for package in ("comparisons", "comparisons.report"))
    assert callable(study.run) and callable(part.summary) and callable(part.section)


@pytest.mark.parametrize("name", ["spring", "blade"])
def test_every_level_measures_the_best_known_of_both_sides_for_each_of_its_targets(name):
    """Else a quick answer compares with slower opponents than the full one does."""
    study, presets = import_module(f"comparisons.{name}"), import_module(f"comparisons.fem.presets.{name}")
    assert set(study.BEST) == set(presets.BEST) == set(study.TARGETS["full"])
    for level, targets in study.TARGETS.items():
        measured = {
            method: {one for curve in study.CURVES[level] if curve.method == method for one in curve.arguments}
            for method in ("cylindrical", "fem")
        }
        for target in targets:
            assert set(study.BEST[target]) <= measured["cylindrical"]
            assert set(presets.BEST[target]) <= measured["fem"]
