"""Forces along a line and at a place, and weight; equilibria evenly spaced on the way."""

import numpy as np
import pytest
from refused import refused

from isorod import LinearElastic, NeoHookean, Rod, Space, arc, circle, statics, straight
from isorod.model import Body, BodyForce, LineLoad, MeanSupport, Model, PointLoad, SectionLoad, Support, Weight

LAW = LinearElastic(2.1e5, 0.3)


def space(length=20.0, radius=0.5, **given):
    return Space(straight(length).sweep(circle(8, radius)), **{"elements": 6, "degree": 4, "section_degree": 3} | given)


def bent():
    return Space(arc(3.0, 120.0).sweep(circle(8, 0.5)), elements=4, degree=3, section_degree=3)


def resultants(own, nodal):
    return nodal[own.is_control_point].sum(axis=0), np.cross(own.positions, nodal).sum(axis=0)


def test_a_line_load_is_its_length_times_the_force():
    """On an arc: force by the length of the line, moment by the middle of the line."""
    own, force = bent(), np.array([0.3, -0.2, 0.5])
    total, moment = resultants(own, LineLoad(tuple(force)).nodal(own))
    angle = np.radians(120.0)
    length = 3.0 * angle
    center = [3.0 * np.sin(angle) / angle, 3.0 * (1.0 - np.cos(angle)) / angle]
    assert total == pytest.approx(length * force, rel=1e-8)
    assert moment == pytest.approx(np.cross([*center, 0.0], length * force), rel=1e-8)


def test_a_force_at_a_place_acts_there():
    own, force = bent(), np.array([0.3, -0.2, 0.5])
    load = PointLoad(0.7, tuple(force), 120.0)
    xi = [np.cos(np.radians(120.0)), np.sin(np.radians(120.0))]
    place = own.rod.points([xi], [0.7])[0]
    total, moment = resultants(own, load.nodal(own))
    assert total == pytest.approx(force, rel=1e-12) and moment == pytest.approx(np.cross(place, force), rel=1e-12)


def test_weight_is_density_times_acceleration_of_each_layer():
    own, pull = space(), (0.0, -9.81, 0.0)
    one = Weight(pull, Body(own, LAW, 0.5)).nodal(own)
    assert one == pytest.approx(BodyForce((0.0, -0.5 * 9.81, 0.0)).nodal(own), abs=1e-12)
    tube = Space(Rod.with_rings(straight(20.0).sweep(circle(8, 0.5)), (0.0, 0.8, 1.0)), elements=2)
    body = Body(tube, [LAW, LAW], [0.5, 2.0])
    total, _ = resultants(tube, Weight(pull, body).nodal(tube))
    area = np.pi * 0.25
    assert total[1] == pytest.approx(-9.81 * 20.0 * area * (0.5 * 0.64 + 2.0 * 0.36), rel=1e-6)


def test_a_beam_on_forks_sags_as_timoshenko_has_it():
    """A force in the middle, a line load and the weight: bending and shear, to 0.1 %."""
    own = Space(straight(20.0, [0.0, 0.5, 1.0]).sweep(circle(8, 0.5)), elements=8, degree=4, section_degree=3)
    supports = [MeanSupport.end(own, "start", mean="fork"), MeanSupport.end(own, "end", components="xy", mean="fork")]
    body = Body(own, LAW, 0.01)
    loads = [SectionLoad((0.0, -1.0, 0.0), 0.5), LineLoad((0.0, -0.1, 0.0)), Weight((0.0, -10.0, 0.0), body)]
    found = statics.solve(Model([body], supports, loads=loads))
    area, bending = np.pi / 4.0, 2.1e5 * np.pi / 64.0
    shear, spread = 7.8 / 8.8 * area * 2.1e5 / 2.6, 0.1 + 0.1 * area
    wanted = 20.0**3 / 48.0 / bending + 5.0 / shear
    wanted += spread * (5.0 * 20.0**4 / 384.0 / bending + 20.0**2 / 8.0 / shear)
    assert found.at(0, 0.5)[1] == pytest.approx(-wanted, rel=1e-3)
    assert found.reactions[:, 1] == pytest.approx(np.full(2, 0.5 + 10.0 * spread), rel=1e-9)


def test_outputs_are_evenly_spaced_equilibria():
    own = space(4.0, 0.5, elements=2, degree=2, section_degree=2)
    supports = [
        MeanSupport.end(own, "start", mean="fixed"),
        MeanSupport.end(own, "end", displacement=(0.0, 0.0, 1.0), mean="pin"),
    ]
    model = Model([Body(own, NeoHookean(10.0, 0.0))], supports)
    curves = statics.solve(model, outputs=5).curves()
    factors = np.linspace(0.0, 1.0, 6)
    assert curves["load factor"] == pytest.approx(factors, abs=1e-15)
    assert curves["support 1 displacement z"] == pytest.approx(factors, abs=1e-9)
    # Without Poisson's effect: P = E / 2 (l - 1 / l).
    stretch = 1.0 + factors / 4.0
    assert curves["support 1 force z"] == pytest.approx(np.pi / 4.0 * 5.0 * (stretch - 1.0 / stretch), abs=1e-9)


@pytest.mark.filterwarnings("ignore:load 0. a point force")
def test_a_force_at_a_place_says_how_far_it_is_spread():
    own = space()
    with pytest.warns(UserWarning, match="this space spreads it over about 0.425 round the section and 3.33 along"):
        Model([Body(own, LAW)], [MeanSupport.rigid(own)], loads=[PointLoad(0.5, (0.0, 1.0, 0.0))])


test_bad_input = refused(
    (
        lambda: PointLoad(1.5, (0.0, 1.0, 0.0)).nodal(space()),
        "point load: got u = 1.5, need an axis parameter from 0 to 1",
    ),
    (lambda: PointLoad(0.5, (0.0, 1.0, 0.0), surface="inner").nodal(space()), "the rod has no hole"),
    (lambda: PointLoad(0.5, (0.0, 1.0, 0.0), surface="side"), "point load: got surface 'side'"),
    (lambda: LineLoad((0.0, np.nan, 0.0)), "line load: per_length: got"),
    (lambda: Weight((0.0, -9.81, 0.0), Body(space(), LAW)), "gravity: body 0 has no density"),
    (lambda: statics.solve(Model([Body(space(), LAW)], [Support.end(space(), "end")]), outputs=0), "outputs: got 0"),
)
