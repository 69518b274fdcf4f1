"""Files as a user writes them, with supports and loads of beams, against closed forms."""

from pathlib import Path

import numpy as np
import pytest

FILES = Path(__file__).parent / "supported"


@pytest.fixture
def answer(command):
    def run(name):
        return command.record("run", str(FILES / f"{name}.toml"))

    return run


def test_uniaxial_tension_has_no_edges(answer):
    """``P = E / 2 (l^2 - 1) l`` of this law, and nothing across."""
    found, stretch = answer("uniaxial"), 1.1
    force = 0.5 * 10.0 * (stretch**2 - 1.0) * stretch * np.pi
    wider = 1.0 - 0.3 * (stretch**2 - 1.0)
    assert found["force"] == pytest.approx(force, rel=1e-8)
    assert found["along"] == pytest.approx(force / (np.pi * wider), rel=1e-8)
    assert abs(found["across"]) < 1e-8


def test_a_shaft_in_bearings_twists_and_bends(answer):
    """Twist ``T L / G Ip``; reactions by the lever; the overhang of Timoshenko's beam."""
    found = answer("shaft")
    twist = 200.0 * 40.0 / (2.1e5 / 2.6 * np.pi / 2.0)
    assert found["torque"] == pytest.approx(-200.0, rel=1e-9)
    assert [found["near"], found["far"]] == pytest.approx([10.0 / 3.0, -40.0 / 3.0], rel=1e-9)
    assert found["side"] - found["middle"] == pytest.approx(twist, rel=1e-3)
    bending, shear = 2.1e5 * np.pi / 4.0, 7.8 / 8.8 * np.pi * 2.1e5 / 2.6
    span, over = 24.0, 8.0
    sag = 10.0 * over**2 * (span + over) / (3.0 * bending) + 10.0 * (over + over**2 / span) / shear
    assert found["middle"] == pytest.approx(sag, rel=5e-3)


def test_a_simply_supported_beam_sags_as_timoshenko_has_it(answer):
    area, bending = np.pi / 4.0, 2.1e5 * np.pi / 64.0
    shear, spread = 7.8 / 8.8 * area * 2.1e5 / 2.6, 0.1 + 0.1 * area
    sag = 20.0**3 / 48.0 / bending + 5.0 / shear + spread * (5.0 * 20.0**4 / 384.0 / bending + 50.0 / shear)
    assert answer("simply_supported")["sag"] == pytest.approx(-sag, rel=1e-3)


@pytest.mark.filterwarnings("ignore:final overlap")
def test_a_cantilever_rolls_up_to_a_full_circle(answer):
    assert answer("roll")["tip"] == pytest.approx(-20.0, rel=1e-3)
