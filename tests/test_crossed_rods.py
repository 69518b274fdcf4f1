"""Crossed rods of a file thrown at each other: when they touch, what they exchange, and what is said of it."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from isorod import dynamics, files
from isorod.command import solving
from isorod.contact.patches import patches

E, NU, LENGTH, GAP = 1000.0, 0.3, 4.0, 0.05

ROD = """
[rod.{name}]
curve = {{start = {start}, direction = {along}, normal = {normal}, chain = [{{straight = 4.0}}]}}
section = {{circle = 1.0}}
law = {{NeoHookean = {{E = 1000.0, nu = 0.3}}}}
density = 1.0
velocity = [0.0, 0.0, {speed}]
"""


def written(folder, speed, end_time=1.0, gap=GAP):
    """The scene of a file: bars of radius 1 whose axes cross at a right angle, a gap apart, each at this speed."""
    text = ROD.format(name="a", start=[-2.0, 0.0, 0.0], along=[1, 0, 0], normal=[0, 1, 0], speed=speed)
    text += ROD.format(name="b", start=[0.0, -2.0, 2.0 + gap], along=[0, 1, 0], normal=[1, 0, 0], speed=-speed)
    text += '[contact.hit]\nfirst = "a"\nsecond = "b"\n[analysis.dynamics]\noutputs = 200\n'
    text += f"end_time = {end_time}\n"
    (folder / "hit.toml").write_text(text)
    return files.find(str(folder / "hit.toml"))


def thrown(folder, speed):
    """The model of that file."""
    return written(folder, speed).model()


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


@pytest.mark.filterwarnings("ignore:contact", "ignore:time step")
def test_points_follow_the_patch_of_a_slow_hit_which_the_first_ones_do_not_see(tmp_path):
    model, speed = thrown(tmp_path, 0.02), 0.02
    end = 0.5 * GAP / speed + 0.5 * duration(speed)
    found = {}
    for points in (None, (6, 6)):
        contacts = [replace(one, points=points) for one in model.contacts]
        found[points] = dynamics.solve(replace(model, contacts=contacts), end, outputs=60)
    late = {points: (touch(one) - 0.5 * GAP / speed) / duration(speed) for points, one in found.items()}
    assert abs(late[None]) < 0.02 < late[6, 6]


def test_the_patch_is_known_where_it_stays(hit):
    found, _ = hit
    (result,) = found.contacts
    assert result.force == pytest.approx(found.contact_forces.max(), rel=1e-9)
    np.testing.assert_allclose(found.contact_forces[:, 0], found.contact_force, rtol=1e-12)
    own = patches(found.model, found.contacts, lines=False, moving=True)
    # Hertz' largest radius, of the way that all the energy makes; bars give way too.
    largest = np.sqrt(duration(0.5) * 1.0 / 2.943)
    for body in (0, 1):
        (patch,) = own[body]
        assert patch.u == pytest.approx(2.0, abs=0.3 * largest)
        assert 3.5 * patch.size / 2.0 == pytest.approx(largest, rel=0.3)
    assert not result.wanders
    assert not patches(found.model, [replace(result, wanders=True)], lines=False, moving=True)


@pytest.mark.filterwarnings("ignore:contact", "ignore:time step")
def test_a_patch_that_slides_along_a_bar_wanders(tmp_path):
    model = thrown(tmp_path, 0.5)
    velocity = [body.initial_velocity.copy() for body in model.bodies]
    velocity[0][:, 1] += 6.0 * model.bodies[0].space.is_control_point
    found = dynamics.solve(model, 0.4, outputs=20, velocity=np.concatenate(velocity).ravel())
    assert found.contacts[0].wanders


@pytest.mark.filterwarnings("ignore:contact", "ignore:time step")
def test_a_motion_with_a_checkpoint_takes_points_as_one_without(tmp_path):
    model, speed = thrown(tmp_path, 0.02), 0.02
    end, kept = 0.5 * GAP / speed + 0.4 * duration(speed), {"checkpoint": tmp_path / "state"}
    whole = dynamics.solve(model, end, outputs=20)
    early = dynamics.solve(model, 0.5 * end, outputs=10, **kept)
    late, again = (dynamics.solve(model, end, outputs=20, resume=True, **kept) for _ in range(2))
    assert not early.contact_force.any()
    for one in (late, again):
        np.testing.assert_array_equal(one.contact_force, whole.contact_force)
        assert one.contacts[0].active == whole.contacts[0].active > early.contacts[0].active
    # The points of the first part would not have done.
    assert (late.resumed, again.resumed) == (0.0, pytest.approx(end))


@pytest.mark.slow
def test_a_hit_of_a_file_lasts_as_long_as_on_a_finer_space(tmp_path):
    """Four cells across, stiffer penalties: 1.038 of Hertz' duration, as bars bend; 1.09 on the space chosen first."""
    speed = 0.2
    scene = written(tmp_path, speed, 1.3 * duration(speed), 0.1 * duration(speed) * speed)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found, _ = solving.solve(scene, scene.settings())
    assert not [one for one in said if "under-resolved" in str(one.message)]
    way = found.contact_force ** (2.0 / 3.0)
    k = np.flatnonzero(way)[-1] - 1
    end = found.times[k] + way[k] * (found.times[k + 1] - found.times[k]) / (way[k - 1] - way[k])
    assert (end - touch(found)) / duration(speed) == pytest.approx(1.038, abs=0.01)
