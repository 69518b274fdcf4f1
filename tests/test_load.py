"""Dead loads: consistency, exact solutions, slenderness without locking, and bad input."""

import numpy as np
import pytest
from prisms import LAW, SPACES, prism, slender, tip

from isorod import InputError, LinearElastic, NeoHookean, SolveError, Space, circle, dynamics, statics
from isorod.assembly.assembler import Assembler
from isorod.model import Body, BodyForce, Model, SectionLoad, Support

# Planar elastica under a dead tip load P L^2 / EI: deflection and shortening over L (elliptic integrals).
ELASTICA = {1.0: (0.30172077, 0.05643324), 3.0: (0.60325344, 0.25442018), 10.0: (0.81060902, 0.55499560)}


@pytest.mark.parametrize("name", SPACES)
def test_work_of_loads_on_rigid_motions(name):
    """On a translation a load works with its resultant, on a turn with its moment about where it acts."""
    space, force = SPACES[name](), np.array([0.3, -0.7, 1.1])
    end = SectionLoad.end(space, "end", tuple(force)).nodal(space)
    table = space.tabulate(0, space.axis.elements)
    volume = table.weights.sum()
    weight = BodyForce(tuple(force / volume)).nodal(space)
    xi = [[0.0, 0.0]]
    for nodal in (end, weight):
        assert nodal[space.is_control_point].sum(axis=0) == pytest.approx(force, rel=1e-8)
    places = np.array([space.rod.grid(table.xi, u)[0] for u in table.u])
    centroid = np.einsum("etq,etqa->a", table.weights, places) / volume
    top = space.rod.grid(xi, [space.axis.breaks[-1]])[0][0, 0]
    for nodal, place in ((end, top), (weight, centroid)):
        moment = np.cross(space.positions, nodal).sum(axis=0)
        assert moment == pytest.approx(np.cross(place, force), rel=1e-6, abs=1e-6 * np.abs(place).max())


def test_section_load_inside_is_that_of_the_end_when_it_gets_there():
    space = prism(6.0, elements=3, degree=3)
    assert SectionLoad((1.0, 2.0, 3.0)).nodal(space) == pytest.approx(
        SectionLoad.end(space, "end", (1.0, 2.0, 3.0)).nodal(space), abs=1e-15
    )
    inside = SectionLoad((1.0, 2.0, 3.0), u=0.4).nodal(space)
    assert inside[space.is_control_point].sum(axis=0) == pytest.approx([1.0, 2.0, 3.0])


def test_bar_under_end_load_and_weight_is_stretched_as_in_one_dimension():
    """nu = 0, linear: w(L) = P L / EA + q L^2 / 2E."""
    space = prism(4.0, elements=3, degree=2)
    area = space.rod.volume() / 4.0
    loads = [SectionLoad.end(space, "end", (0.0, 0.0, 0.02 * area)), BodyForce((0.0, 0.0, 0.01))]
    model = Model([Body(space, LinearElastic(2.0, 0.0))], [Support.end(space, "start")], loads=loads)
    solution = statics.solve(model)
    assert tip(space, solution)[2] == pytest.approx(0.02 * 4.0 / 2.0 + 0.01 * 16.0 / 4.0, rel=1e-10)
    assert solution.reactions[0] == pytest.approx([0.0, 0.0, -(0.02 + 0.04) * area], rel=1e-10, abs=1e-12)


def cantilever(space, force):
    """One without Poisson's ratio, a force across its end."""
    load = SectionLoad.end(space, "end", (force, 0.0, 0.0))
    return Model([Body(space, NeoHookean(1.0, 0.0))], [Support.end(space, "start")], loads=[load])


@pytest.mark.parametrize("load", ELASTICA)
def test_cantilever_is_the_elastica_with_an_error_of_thickness_squared(load):
    shares = []
    for length in (100.0, 400.0):
        space = slender(length, degree=4)
        force = load * 0.25 * np.pi / length**2
        model = cantilever(space, force)
        solution = statics.solve(model)
        found = tip(space, solution) / length
        errors = np.array([found[0], -found[2]]) / ELASTICA[load] - 1.0
        shares.append(errors * length**2)
        assert solution.reactions[0, 0] == pytest.approx(-force, rel=1e-8)
    assert np.abs(shares[1]).max() < 6.0
    assert shares[0] == pytest.approx(shares[1], rel=0.05)


@pytest.mark.parametrize("length", [1e3, 1e4, 1e5])
def test_slender_cantilever_neither_locks_nor_stops_early(length):
    """A tolerance relative to the largest stiffness, or to the predictor's forces, would accept the predictor here."""
    space = slender(length, degree=4)
    model = cantilever(space, 0.25 * np.pi / length**2)
    found = tip(space, statics.solve(model)) / length
    assert abs(found[0] / ELASTICA[1.0][0] - 1.0) < 5e-7 + 2.1 / length**2
    assert abs(-found[2] / ELASTICA[1.0][1] - 1.0) < 5e-7 + 2.1 / length**2


def test_too_slender_a_rod_is_an_error():
    space = slender(1e7)
    model = cantilever(space, 0.25e-14 * np.pi)
    with pytest.raises(SolveError, match="load factor"):
        statics.solve(model)


@pytest.mark.parametrize("length", [1e5, 1e6])
def test_a_load_below_rounding_is_an_error(length):
    """Control points carry the length itself: strains of a section are known to 1e-16 L / r only."""
    space = prism(length, circle(8), elements=8, degree=4, continuity=0, order=2, quadrature="4x2x4")
    model = cantilever(space, 0.25 * np.pi / length**2)
    with pytest.raises(SolveError):
        statics.solve(model)


def test_bad_input(cylinder):
    space = Space.paper(cylinder(4, height=4.0), elements=3)
    body, start = Body(space, LAW, density=1.0), Support.end(space, "start")
    nan = float("nan")
    cases = [
        (lambda: SectionLoad((1.0, nan, 0.0)), "section load"),
        (lambda: BodyForce((1.0, 0.0)), "need 3 numbers"),
        (lambda: BodyForce((1.0, nan, 0.0)), "body force"),
        (lambda: SectionLoad.end(space, "top", (1.0, 0.0, 0.0)), "'start' or 'end'"),
        (lambda: SectionLoad((1.0, 0.0, 0.0), u=1.5).nodal(space), "axis parameter"),
        (lambda: Model([body], [start], loads=[BodyForce((1.0, 0.0, 0.0), body=1)]), "load 0: body 1"),
        (lambda: Model([body], [Support.end(space, "end", "xy", tied="y")]), "held and 'y' tied"),
        (lambda: Model([body], [Support.end(space, "end", tied="w", components="")]), "need some of 'xyz'"),
        (lambda: Model([body], [Support.end(space, "end", turn=(0.0, nan, 0.0))]), "turn"),
        (lambda: Model([body], [Support([0], arms=[[0.0, 1.0]])]), "arms"),
        (
            lambda: Model([body], [start, Support.end(space, "start", turn=(0.0, 0.0, 1.0))]),
            "prescribed by another support",
        ),
        (lambda: Model([body], [start, Support.end(space, "start", "", tied="x")]), "prescribed by another support"),
        (lambda: dynamics.solve(Model([body], [Support.end(space, "end", "xy", tied="z")]), 1.0), "tied"),
    ]
    for make, words in cases:
        with pytest.raises(InputError, match=words) as caught:
            make()
        assert "\n" not in str(caught.value)


def test_a_load_no_equilibrium_bears_is_an_error_that_names_the_place():
    space = prism(4.0, elements=3, degree=2)
    model = Model(
        [Body(space, LAW)], [Support.end(space, "start")], loads=[SectionLoad.end(space, "end", (0.0, 0.0, -1e4))]
    )
    with pytest.raises(SolveError, match=r"load factor .* element \d of body 0") as caught:
        statics.solve(model)
    assert "\n" not in str(caught.value)


def test_extrapolated_stress_halves_the_iterations_and_changes_no_result(monkeypatch):
    space = slender(1000.0)
    model = cantilever(space, 0.25e-6 * np.pi)
    with_it = statics.solve(model)
    monkeypatch.setattr(Assembler, "extrapolate", lambda self: None)
    without = statics.solve(model)
    assert with_it.newton_iterations <= 0.6 * without.newton_iterations
    assert np.abs(with_it.displacement - without.displacement).max() < 1e-6 * 1000.0
