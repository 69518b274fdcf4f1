"""Crossed rods of a file thrown at each other: when they touch, what they exchange, and what is said of it."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from isorod import dynamics, files

E, NU, LENGTH, GAP = 1000.0, 0.3, 4.0, 0.05

ROD = """
[rod.{name}]
curve = {{start = {start}, direction = {along}, normal = {normal}, chain = [{{straight = 4.0}}]}}
section = {{circle = 1.0}}
law = {{NeoHookean = {{E = 1000.0, nu = 0.3}}}}
density = 1.0
velocity = [0.0, 0.0, {speed}]
"""


def thrown(folder, speed):
    """The model of a file: bars of radius 1 whose axes cross at a right angle, a gap apart, each at this speed."""
    text = ROD.format(name="a", start=[-2.0, 0.0, 0.0], along=[1, 0, 0], normal=[0, 1, 0], speed=speed)
    text += ROD.format(name="b", start=[0.0, -2.0, 2.0 + GAP], along=[0, 1, 0], normal=[1, 0, 0], speed=-speed)
    text += '[contact.hit]\nfirst = "a"\nsecond = "b"\n[analysis.dynamics]\nend_time = 1.0\n'
    (folder / "hit.toml").write_text(text)
    return files.find(str(folder / "hit.toml")).model()


def duration(speed):
    """How long spheres of that mass and these radii touch (Hertz; Johnson, Contact Mechanics, section 11.4)."""
    stiffness, mass, closing = 4.0 / 3.0 * E / (2.0 * (1.0 - NU**2)), 0.5 * np.pi * LENGTH, 2.0 * speed
    return 2.943 * (5.0 * mass * closing**2 / (4.0 * stiffness)) ** 0.4 / closing


def touch(found):
    """When forces begin, which grow as a power 3/2 of the way from there on."""
    way = found.contact_force ** (2.0 / 3.0)
    k = np.flatnonzero(way)[0] + 1
    return found.times[k] - way[k] * (found.times[k + 1] - found.times[k]) / (way[k + 1] - way[k])


@pytest.fixture(scope="module")
def hit(tmp_path_factory):
    model = thrown(tmp_path_factory.mktemp("hit"), 0.5)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        return dynamics.solve(model, 0.65, outputs=100), [str(one.message) for one in said]


def test_they_touch_when_they_meet_and_part_with_each_others_velocity(hit):
    found, _ = hit
    assert touch(found) == pytest.approx(GAP, abs=0.01 * duration(0.5))
    # Both momenta are opposite, and all but what the bars go on ringing with is exchanged.
    assert not found.contact_force[-1] and np.abs(found.momentum_error).max() < 1e-9
    impulse = (found.times[1] - found.times[0]) * found.contact_force.sum()
    assert 0.95 < impulse / (2.0 * np.pi * LENGTH * 0.5) < 1.0
    assert np.abs(found.energy_error).max() < 1e-3


def test_a_patch_that_control_points_do_not_see_is_warned_of(hit):
    _, said = hit
    assert any("contact patch under-resolved" in one and "section points" in one for one in said)


def test_points_follow_the_patch_of_a_slow_hit_which_the_first_ones_do_not_see(tmp_path):
    model, speed = thrown(tmp_path, 0.02), 0.02
    end = 0.5 * GAP / speed + 0.5 * duration(speed)
    found = {}
    for points in (None, (6, 6)):
        contacts = [replace(one, points=points) for one in model.contacts]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found[points] = dynamics.solve(replace(model, contacts=contacts), end, outputs=60)
    late = {points: (touch(one) - 0.5 * GAP / speed) / duration(speed) for points, one in found.items()}
    assert abs(late[None]) < 0.02 < late[6, 6]
