"""The list of studies: each can be run, and has its part of the report page."""

from importlib import import_module

import pytest

pytest.importorskip("rich")

from comparisons import STUDIES


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_runs_and_has_its_part_of_the_page(name):
    study, part = (import_module(f"{package}.{name}") for package in ("comparisons", "comparisons.report"))
    assert callable(study.run) and callable(part.summary) and callable(part.section)
