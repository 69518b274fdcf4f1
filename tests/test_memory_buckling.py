"""Buckling of what yields, from files: Shanley's tangent modulus, Euler below yield; and modes, which are elastic."""

import numpy as np
import pytest

from isorod import SolveError, files
from isorod.command import solving

COLUMN = """
[rod.column]
curve = {{straight = {length}}}
section = {{circle = 1.0}}
law = {law}
density = 1e-6
[support.foot]
end = "start"
mean = "fixed"
[load.press]
end = "end"
force = [0.0, 0.0, -100.0]
[analysis.buckling]
"""
E, PLASTIC = 200e3, "{{Plastic = {{E = 200e3, nu = 0.3, hardening = [[0, {first}], [0.05, {last}]]}}}}"


def _solved(tmp_path, text, **settings):
    path = tmp_path / "column.toml"
    path.write_text(text)
    scene = files.find(str(path))
    return solving.solve(scene, scene.settings() | settings)[0]


def _column(length, first, last):
    return COLUMN.format(length=length, law=PLASTIC.format(first=first, last=last))


def _load(modulus, length):
    return np.pi**2 / 4.0 * modulus * np.pi / 4.0 / length**2


def test_a_column_beyond_yield_buckles_at_the_tangent_modulus_load(tmp_path):
    """F. R. Shanley: what flows flows on, by ``E_t = E H / (E + H)``."""
    found = _solved(tmp_path, _column(30.0, 20.0, 2020.0))
    shanley = _load(E * 40e3 / (E + 40e3), 30.0)
    # Shortened and thicker by its strain of 3e-4.
    assert 100.0 * found.factors[0] == pytest.approx(shanley, rel=2e-3)
    assert 100.0 * found.linear[0] == pytest.approx(_load(E, 30.0), rel=5e-3)
    assert 100.0 * found.factors[0] > 20.0 * np.pi and found.estimate() is None


def test_a_slender_column_buckles_before_it_yields(tmp_path):
    text = _column(40.0, 400.0, 500.0)
    plastic, elastic = (_solved(tmp_path, one) for one in (text, _column(40.0, 4e6, 5e6)))
    assert plastic.factors[0] == pytest.approx(elastic.factors[0], rel=1e-8)
    assert 100.0 * plastic.factors[0] == pytest.approx(_load(E, 40.0), rel=2e-3)


@pytest.mark.slow
def test_a_column_whose_stiffness_falls_at_once_buckles_as_it_yields(tmp_path):
    with pytest.raises(SolveError, match=r"buckles as it yields, at load factor 12\.5"):
        _solved(tmp_path, _column(10.0, 400.0, 410.0))


MODES = """
[rod.bar]
curve = {{straight = 20.0}}
section = {{circle = 1.0}}
law = {{Plastic = {{E = 200e3, nu = 0.0, hardening = [[0, {first}], [0.05, {last}]]}}}}
density = 1e-6
[support.left]
end = "start"
mean = "fixed"
[support.right]
end = "end"
mean = "fixed"
displacement = [0.0, 0.0, {pull}]
[analysis.modal]
modes = 8
"""


def test_modes_about_a_yielded_state_are_elastic(tmp_path):
    """Bars of so much stress that have and have not yielded for it vibrate alike, but for their length."""
    yielded = _solved(tmp_path, MODES.format(first=200.0, last=210.0, pull=0.1))
    elastic = _solved(tmp_path, MODES.format(first=2000.0, last=2100.0, pull=0.02))
    assert "1 moved support, elastic" in yielded.about
    # A plastic tangent would make them a thirtieth.
    assert yielded.frequencies == pytest.approx(elastic.frequencies, rel=0.01)
