"""Each analysis with each feature and each option has an answer, or one line that says why not."""

import combinations
import pytest


@pytest.mark.slow
@pytest.mark.parametrize("option", combinations.OPTIONS)
@pytest.mark.parametrize("feature", combinations.FEATURES)
@pytest.mark.parametrize("analysis", combinations.ANALYSES)
def test_a_combination_is_answered_or_refused_in_one_line(analysis, feature, option, tmp_path):
    print(combinations.refusal(*combinations.outcome(analysis, feature, option, tmp_path / "cell", 600.0)))
