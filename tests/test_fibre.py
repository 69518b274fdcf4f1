"""Directions of material as fields along rod and section: hand formulas, differences of the map, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from isorod import Body, HolzapfelGasserOgden, InputError, Muscle, Space, arc, circle, ellipse, helix, straight
from isorod.material import fibre
from isorod.material.places import Places, alone

XI = np.array([[0.9, 0.0], [0.1, 0.2], [0.0, -0.5], [-0.3, 0.4], [0.0, 0.0]])
ANGLE = np.array([0.0, np.arctan2(0.2, 0.1), -0.5 * np.pi, np.arctan2(0.4, -0.3), 0.0])
Z = np.array([0.0, 0.0, 1.0])
MUSCLE = Muscle(30.0, 0.3, 20.0, 10.0, 0.5, 0.7)


def at(rod, u, xi=XI):
    return Places(rod, np.asarray(u)[..., None], xi)


def directions(law, places):
    return law.placed(places).fibres(places.shape)


def test_a_helix_in_a_straight_rod():
    places = at(straight(3.0).sweep(circle(6, 0.5)), np.array([[0.1, 0.4], [0.7, 1.0]]))
    around = np.stack([-np.sin(ANGLE), np.cos(ANGLE), 0.0 * ANGLE], axis=1)
    for angle in (0.0, 30.0, -75.0, 90.0):
        found = directions(replace(MUSCLE, fibre=fibre.helix(angle)), places)
        assert found.shape == (2, 2, 5, 3)
        turn = np.radians(angle)
        assert np.abs(found - np.cos(turn) * Z - np.sin(turn) * around).max() < 1e-14
    words = {"tangent": Z, "normal": [1, 0, 0], "binormal": [0, 1, 0], "around": around, "radial": np.cross(around, Z)}
    for word, expected in words.items():
        assert np.abs(directions(replace(MUSCLE, fibre=word), places) - expected).max() < 1e-14
    # Along an ellipse like the outline.
    flat = at(straight(3.0).sweep(ellipse(6, 2.0, 0.5)), np.array([0.3]))
    along = np.stack([-2.0 * np.sin(ANGLE), 0.5 * np.cos(ANGLE), 0.0 * ANGLE], axis=1)
    assert np.abs(flat.around - along / np.linalg.norm(along, axis=1)[:, None]).max() < 1e-14
    assert np.abs(flat.position[0] - np.append(XI * [2.0, 0.5], np.full((5, 1), 0.9), axis=1)).max() < 1e-13


def test_a_helix_in_a_bent_and_twisted_rod():
    """An arc of radius 3 about z in the plane z = 0; sections turn by 40 degrees on the way."""
    rod = arc(3.0, 80.0).sweep(circle(8, 0.5), twist=40.0, tolerance=1e-6)
    u = np.linspace(*rod.axis.breaks[[0, -1]], 7)
    places = at(rod, u)
    middle = rod.points(np.zeros((7, 2)), u)
    angle = np.arctan2(middle[:, 1], middle[:, 0])
    outwards = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)[:, None]
    along = np.cross(Z, outwards)
    off = places.position - middle[:, None]
    off = (off - np.sum(off * along, axis=-1, keepdims=True) * along)[:, :4]
    radial = off / np.linalg.norm(off, axis=-1, keepdims=True)
    found = directions(replace(MUSCLE, fibre=fibre.helix(25.0)), places)[:, :4]
    turn = np.radians(25.0)
    assert np.abs(found - np.cos(turn) * along - np.sin(turn) * np.cross(along, radial)).max() < 1e-4
    assert np.abs(places.radial[:, :4] - radial).max() < 1e-4
    # The first axis of the section turns evenly against what is carried along without a turn, here z and outwards.
    at_start = np.arctan2(places.normal[0, 0] @ Z, places.normal[0, 0] @ outwards[0, 0])
    seen = np.arctan2(places.normal[:, 0] @ Z, np.sum(places.normal * outwards, axis=-1)[:, 0])
    share = angle / np.radians(80.0)
    assert np.unwrap(seen) - at_start == pytest.approx(-np.radians(40.0) * share, abs=1e-3)


def test_directions_are_the_maps_derivatives():
    """A flat section that turns on a helix: around, by differences along the disk's circle; all at right angles."""
    rod = helix(4.0, 6.0, 0.5).sweep(ellipse(8, 1.2, 0.4), twist=50.0)
    places = at(rod, np.array([0.3, 1.7, 3.9]), XI[:4])
    for k, u in enumerate([0.3, 1.7, 3.9]):
        radius, angle, h = np.hypot(*XI[:4].T), ANGLE[:4], 1e-5
        ahead, behind = (
            rod.points(radius[:, None] * np.stack([np.cos(a), np.sin(a)], axis=1), np.full(4, u))
            for a in (angle + h, angle - h)
        )
        tangent = places.tangent[k, 0]
        way = ahead - behind
        way = way - (way @ tangent)[:, None] * tangent
        assert np.abs(places.around[k] - way / np.linalg.norm(way, axis=1)[:, None]).max() < 1e-8
        assert np.abs(places.position[k] - rod.points(XI[:4], np.full(4, u))).max() < 1e-13
    for three in (
        (places.radial, places.around, places.tangent),
        (places.normal, places.binormal, places.tangent),
    ):
        frame = np.stack(np.broadcast_arrays(*three), axis=-1)
        assert np.abs(frame.swapaxes(-1, -2) @ frame - np.eye(3)).max() < 1e-14
        assert np.linalg.det(frame) == pytest.approx(np.ones(frame.shape[:-2]))
    # One place each is that of the grid.
    each = Places(rod, np.array([0.3, 3.9]), XI[[1, 2]])
    for name in ("around", "radial", "normal", "position"):
        whole = np.broadcast_to(getattr(places, name), (3, 4, 3))
        assert np.abs(getattr(each, name) - whole[[0, 2], [1, 2]]).max() < 1e-14


@pytest.mark.parametrize("law", [MUSCLE, HolzapfelGasserOgden(3.0, 2.4, 0.8, 50.0)], ids=lambda law: type(law).__name__)
def test_fibres_of_a_body_are_those_of_its_points_and_rings(law):
    """A core along the rod, and a sheath of which one half winds and the other has a function of all there is."""

    def slanted(places):
        assert np.broadcast_shapes(places.position.shape, places.u.shape) == (*places.shape, 3)
        return places.u * places.binormal - 2.0 * places.normal + places.position / 7.0

    rod = helix(10.0, 4.0, 1).sweep(circle(8, 1.0)).with_rings((0.0, 0.5, 1.0))
    space = Space(rod, elements=8, section_degree=2)
    winding, other = replace(law, fibre=fibre.helix(35.0)), replace(law, fibre=slanted)
    body = Body(space, [[law, winding]] * 4 + [[law, other]] * 4)
    table = space.tabulate(2, 6)
    found = body.known(table)
    places = Places(rod, table.u[..., None], table.xi)
    core = np.hypot(*table.xi.T) < 0.5
    turn = np.radians(35.0)
    wound = np.cos(turn) * places.tangent + np.sin(turn) * places.around
    slant = slanted(places)
    assert np.abs(found[:, :, core] - places.tangent).max() < 1e-14
    assert np.abs(found[:2, :, ~core] - wound[:2, :, ~core]).max() < 1e-14
    slant /= np.linalg.norm(slant, axis=-1, keepdims=True)
    assert np.abs(found[2:, :, ~core] - slant[2:, :, ~core]).max() < 1e-14
    # Those of some places alone, as extrapolated stresses want them.
    some = body.laws_at(table.u, table.xi).some(np.array([1, 3]))
    F = np.eye(3) + 0.1 * np.random.default_rng(1).normal(size=(2, *table.weights.shape[1:], 3, 3))
    whole = np.broadcast_to(np.eye(3), (*table.weights.shape, 3, 3)).copy()
    whole[[1, 3]] = F
    expected = body.laws_at(table.u, table.xi).stress(whole)[[1, 3]]
    assert np.abs(some.stress(F) - expected).max() < 1e-13 * np.abs(expected).max()


def test_a_law_without_a_rod_has_one_along_z():
    places = alone()
    for name, expected in {"tangent": Z, "normal": [1, 0, 0], "binormal": [0, 1, 0]}.items():
        assert np.array_equal(getattr(places, name)[0], expected)
    assert np.array_equal(places.radial[0], [1, 0, 0]) and np.array_equal(places.around[0], [0, 1, 0])
    # Stiff along its fibres, whatever word tells these.
    for word, axis in (("tangent", 2), ("around", 1), ("normal", 0)):
        law, told = (replace(MUSCLE, activation=0.0, fibre=one) for one in (word, np.eye(3)[axis]))
        assert law.surface_modulus == told.surface_modulus


@pytest.mark.parametrize(
    "given, message",
    [
        (lambda p: np.zeros(3), r"the function returns \(0, 0, 0\) at u = 0.5, disk point \(0.9, 0\), need a finite"),
        (lambda p: p.xi, r"the function returns shape \(5, 2\), need \(3,\) or what broadcasts to \(1, 5, 3\)"),
        (lambda p: np.ones((4, 3)), r"returns shape \(4, 3\)"),
        (lambda p: "tangent", "function of places: got 'tangent', need numbers"),
        (lambda p: np.where(p.xi[:, :1] < 0.0, np.nan, p.tangent), r"\(nan, nan, nan\) at u = 0.5, disk point \(-0.3"),
    ],
)
def test_functions_that_return_no_directions_are_refused(given, message):
    rod = straight(1.0).sweep(circle(4, 1.0))
    with pytest.raises(InputError, match=message) as caught:
        replace(MUSCLE, fibre=given).placed(at(rod, np.array([0.5])))
    assert "\n" not in str(caught.value)


def test_what_is_no_direction_is_refused():
    with pytest.raises(InputError, match="got 'up', need a vector"):
        replace(MUSCLE, fibre="up")
    with pytest.raises(InputError, match="need numbers"):
        replace(MUSCLE, fibre=("a", "b", "c"))
    with pytest.raises(InputError, match="need finite degrees"):
        fibre.helix(np.nan)
    with pytest.raises(InputError, match="a function of places: only a body knows"):
        replace(MUSCLE, fibre=fibre.helix(3.0)).energy(np.eye(3))
