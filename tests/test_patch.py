"""Supports of patches of the surface, named by angle and length: the patch moves exactly as is said."""

import numpy as np
import pytest

from isorod import Body, InputError, LinearElastic, Model, Support, statics
from isorod.geometry import center_line, coils, section
from isorod.space.space import Space
from isorod.tensors import rotation

AROUND, ALONG = (-30.0, 40.0), (4.0, 6.0)


@pytest.fixture(params=[1, 2])
def space(request):
    """A bar of length 10, whose axis parameter is the height over ten."""
    rod = center_line.straight(10.0).sweep(section.circle(8, 1.0))
    return Space(rod, elements=10, degree=2, continuity=1, order=request.param, quadrature="auto")


def surface(space, solution, around=AROUND, along=ALONG):
    """Return where points of the surface are at rest and their displacements, ``(points, 3)`` each."""
    theta = np.radians(np.linspace(*around, 7))
    xi, u = np.stack([np.cos(theta), np.sin(theta)], axis=1), np.linspace(*along, 9) / 10.0
    moved, _ = space.displacement(solution.model.nodal(solution.displacement), xi, u)
    return space.rod.grid(xi, u)[0].reshape(-1, 3), moved.reshape(-1, 3)


def solved(space, patch):
    body = Body(space, LinearElastic(1e3, 0.3))
    return statics.solve(Model([body], [Support.end(space, "start"), patch]))


def test_every_point_of_the_patch_is_displaced_as_is_said(space):
    given = (0.01, 0.0, 0.002)
    solution = solved(space, Support.patch(space, AROUND, ALONG, displacement=given))
    _, moved = surface(space, solution)
    np.testing.assert_allclose(moved, np.broadcast_to(given, moved.shape), atol=1e-15)
    # Not so what is farther than an arc and the elements that a function has.
    _, far = surface(space, solution, (170.0, 190.0))
    assert np.abs(far - given).max() > 1e-5
    _, near = surface(space, solution, along=(0.0, 0.5))
    assert np.abs(near).max() < 0.5 * 0.01


def test_the_patch_turns_about_a_point(space):
    turn, center = (0.0, 0.02, 0.01), (0.0, 0.0, 5.0)
    solution = solved(space, Support.patch(space, AROUND, ALONG, turn=turn, center=center))
    x, moved = surface(space, solution)
    np.testing.assert_allclose(moved, (x - center) @ (rotation(turn) - np.eye(3)).T, atol=1e-14)


def test_a_patch_holds_no_more_nodes_than_act_there(space):
    nodes = Support.patch(space, AROUND, ALONG).nodes
    whole = Support.patch(space, (0.0, 360.0), (0.0, 10.0)).nodes
    assert set(nodes) < set(whole)
    assert space.is_control_point[whole].all()
    assert len(whole) == np.count_nonzero(space.is_control_point)
    # Two elements of degree 2 have 4 layers; 70 degrees meet three arcs of 45, on which five functions live.
    assert len(nodes) == 4 * 5


def test_lengths_are_those_of_the_centre_line():
    """A quarter of a torus is a quarter of its length."""
    rod = coils.helix(6.0, 0.0, 1, 4).sweep(section.circle(8, 1.0), closed=True)
    space = Space.paper(rod, elements=16, quadrature="auto")
    length = 12.0 * np.pi
    quarter = Support.patch(space, (0.0, 360.0), (0.25 * length, 0.5 * length)).nodes
    assert set(quarter // space.layer_nodes) == set(space.element_layers[4:8].ravel())


@pytest.mark.parametrize(
    ("around", "along", "said"),
    [
        ((10.0, 10.0), ALONG, "around is from 10 to 10 degrees, need a positive angle of at most 360"),
        ((0.0, 361.0), ALONG, "around is from 0 to 361"),
        ((0.0, np.nan), ALONG, "around is from 0 to nan"),
        (AROUND, (6.0, 4.0), "along is from 6 to 4, need lengths from 0 to 10, ascending"),
        (AROUND, (4.0, 11.0), "along is from 4 to 11"),
        (AROUND, (np.nan, 5.0), "along is from nan to 5"),
    ],
)
def test_a_patch_out_of_range_is_refused(space, around, along, said):
    with pytest.raises(InputError, match=said):
        Support.patch(space, around, along)


def test_a_patch_needs_control_points_on_the_surface():
    rod = center_line.straight(10.0).sweep(section.circle(8, 1.0))
    with pytest.raises(InputError, match="patch: the section functions have no control points on the surface"):
        Support.patch(Space(rod, section_degree=3), AROUND, ALONG)
