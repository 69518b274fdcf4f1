"""What is chosen where nothing is given: right by default, recorded, and never in the place of what is given."""

import dataclasses

import numpy as np
import pytest
from reference import BLADE_FREQUENCIES, SPRING_FORCE

from isorod import InputError, LinearElastic, NeoHookean, dynamics, helix, modal, statics, straight
from isorod.geometry import section
from isorod.model import Body, Contact, Model, Plane, Pressure, SectionLoad, Support
from isorod.scenes.blade import Blade
from isorod.scenes.flower import Flower
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring
from isorod.space import Space, choice

WITHIN = 5e-3


def test_spring_and_blade_without_options_are_right():
    """A tenth of what is asked for, and a quarter: there is room for rods that are less kind."""
    force = statics.solve(Spring().model()).reactions[1, 2]
    assert force == pytest.approx(SPRING_FORCE, rel=0.1 * WITHIN)
    frequencies = modal.solve(Blade().model()).frequencies
    assert frequencies == pytest.approx(np.array(BLADE_FREQUENCIES), rel=0.4 * WITHIN)


@pytest.mark.parametrize("nu", [0.4, 0.49, 0.4999, 0.5])
def test_a_spring_near_incompressibility_is_right(nu):
    fine = Spring(coils=1, nu=nu, section_degree=4, degree=6, elements_per_turn=8, formulation="mixed")
    expected = statics.solve(fine.model()).reactions[1, 2]
    model = Spring(coils=1, nu=nu).model()
    assert model.bodies[0].formulation == ("mixed" if nu >= 0.49 else "displacement")
    assert statics.solve(model).reactions[1, 2] == pytest.approx(expected, rel=0.2 * WITHIN)


def cantilever(space, length, law):
    load = SectionLoad.end(space, "end", (1e-4 / length**2, 0.0, 0.0))
    model = Model([Body(space, law)], [Support.end(space, "start")], loads=[load])
    found = statics.solve(model)
    return float(load.nodal(space).ravel() @ found.displacement)


@pytest.mark.parametrize("length", [2.0, 20.0, 1000.0])
@pytest.mark.parametrize("outline", [section.circle(4), section.ellipse(8, 1.0, 0.05), section.airfoil()], ids=len)
def test_a_bare_space_bends_as_a_fine_one(length, outline):
    rod, law = straight(length).sweep(outline), NeoHookean(1.0, 0.3)
    fine = Space(rod, section_degree=7, degree=6, elements=8, continuity=0, quadrature="9x4x6")
    assert cantilever(Space(rod), length, law) == pytest.approx(cantilever(fine, length, law), rel=WITHIN)


@pytest.mark.parametrize("free", [True, False])
def test_modes_of_a_bare_space(free):
    rod = straight(12.0).sweep(section.ellipse(8, 1.0, 0.4))

    def frequencies(space):
        supports = [] if free else [Support.end(space, "start")]
        found = modal.solve(Model([Body(space, LinearElastic(1.0, 0.3), 1.0)], supports))
        return found.frequencies[found.rigid :]

    knots = Space(rod).knots
    fine = Space(rod, section_degree=6, degree=6, elements=8, continuity=0, quadrature="auto", knots=knots)
    # The eighth mode wants a degree more across the section than is chosen, which the estimate tells.
    assert frequencies(Space(rod, section_degree=None if free else 5)) == pytest.approx(frequencies(fine), rel=WITHIN)


def test_stiffness_may_jump_where_the_rod_has_a_knot():
    """Bars in series, a law for each of the rod's own elements; nu = 0, so that exact values are known."""
    rod = straight(breaks=[0.0, 4.0, 10.0], degree=3).sweep(section.circle(8))
    space = Space(rod, continuity=0)
    assert space.axis.elements > 2
    with pytest.warns(UserWarning, match="stiffness jumps by 1e\\+03 at u = 4, .* use continuity 0"):
        Body(Space(rod), [LinearElastic(1000.0, 0.0), LinearElastic(1.0, 0.0)])
    body = Body(space, [LinearElastic(1000.0, 0.0), LinearElastic(1.0, 0.0)])
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, 1e-3))
    exact = np.pi * 1e-3 / (4.0 / 1000.0 + 6.0)
    assert statics.solve(Model([body], ends)).reactions[1, 2] == pytest.approx(exact, rel=1e-8)


def test_elements_follow_what_a_rod_turns():
    def elements(rod):
        return Space(rod).elements / rod.axis.elements

    assert elements(helix(6.0, 2.0, 2).sweep(section.circle(4))) == 1
    assert elements(helix(6.0, 2.0, 2, 3).sweep(section.circle(4))) == 2
    assert elements(Ring().rod()) == 2
    assert elements(Blade(twist=0.0).rod()) == elements(Blade(twist=90.0).rod()) == 5
    coarse = Space(straight(10.0).sweep(section.circle(4)), degree=2)
    assert (coarse.elements, coarse.degree, coarse.continuity) == (32, 2, 0)
    assert Space(straight(10.0).sweep(section.circle(4))).continuity == 2


def test_section_functions_follow_the_section():
    def functions(outline):
        space = Space(straight(30.0).sweep(outline))
        return space.section_degree or (space.order, space.section_points)

    square = section.from_points([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]])
    assert functions(section.circle(4)) == functions(section.ellipse(6, 1.0, 0.01)) == 3
    assert functions(square) == 4
    assert functions(section.airfoil()) == 4
    assert functions(section.flower()) == (2, 32)
    assert [Space(straight(2.0 * n).sweep(section.circle(4))).section_degree for n in (1, 3.9, 4.1, 9, 11)] == [
        *(5, 5, 4, 4, 3)
    ]


def test_hollow_sections_have_the_degree_that_carries_their_torsion():
    def degree(outline, hole):
        return Space(straight(10.0).sweep(outline).with_rings([hole, 1])).section_degree

    assert degree(section.circle(8), 0.8) == 4
    assert degree(section.ellipse(8, 3.0, 1.0), 0.8) == 5
    assert degree(section.naca("2430", 16), 0.5) == 9
    assert degree(section.naca("2418", 16), 0.6) == 10


@pytest.mark.parametrize(("hole", "length", "elements"), [(0.5, 2.0, 5), (0.8, 5.0, 6), (0.9, 20.0, 16)])
def test_a_tube_held_at_its_end_swells_as_a_fine_one(hole, length, elements):
    """Its wall bends where it is held: with 4 C0 elements it is off by 0.8 % and 1.9 % where it is long."""
    rod = straight(length).sweep(section.circle(8, 1.0)).with_rings([hole, 1])

    def swelling(space):
        model = Model(
            [Body(space, LinearElastic(1.0, 0.3))], [Support.end(space, "start")], loads=[Pressure(1e-3, "inner")]
        )
        found = statics.solve(model)
        return [found.at(rod, 0.5, (1.0, 0.0))[0], found.at(rod, "end", (hole, 0.0))[2]]

    bare = Space(rod)
    assert bare.elements == elements
    fine = Space(rod, elements=2 * elements, degree=6, continuity=0, section_degree=5, knots=bare.knots)
    assert swelling(bare) == pytest.approx(swelling(fine), rel=WITHIN)


def test_a_rod_in_contact_has_no_kinks():
    rod = straight(10.0).sweep(section.circle(8))
    assert choice.touching(rod) == {"elements": 12, "degree": 5, "continuity": 1}
    assert choice.touching(rod, 8) == {"elements": 8, "degree": 5, "continuity": 1}
    assert choice.touching(rod, degree=1) == {"elements": 154, "degree": 1, "continuity": 0}
    # 48 points are 2 pi r / 48 apart round the section, and no more along it.
    assert choice.touching_points(rod, 8, 12, 5, 3, 64) == (6, 7)
    assert choice.touching_points(rod, 8, 2, 5, 3, 64) == (6, 39)
    assert choice.touching_points(rod, 24, 1, 1, 3, 64) == (3, 64)
    assert choice.touching(rod, None, 3, 2) == {"elements": 29, "degree": 3, "continuity": 2}


def test_sections_that_are_no_images_of_each_other_have_functions_of_control_points():
    rod = straight(10.0).sweep(section.circle(4))
    points = rod.control_points.copy()
    points[1, 0] *= 1.2
    space = Space(dataclasses.replace(rod, control_points=points))
    assert (space.order, space.section_points, space.section_degree) == (2, 24, None)


def test_what_is_given_wins_and_the_rest_is_named():
    rod = Blade().rod()
    bare = Space(rod)
    assert bare.chosen == ("section_degree", "elements", "degree", "continuity", "knots", "quadrature")
    given = Space(rod, order=2, degree=3, elements=6, continuity=1, quadrature="full")
    assert (given.order, given.degree, given.elements, given.continuity) == (2, 3, 6, 1)
    assert (given.section_degree, given.quadrature, given.chosen) == (None, "full", ())
    assert Space(rod, elements=6, degree=3).continuity == 0
    assert str(Space(rod, elements=bare.elements, knots=bare.knots)) == str(bare)
    assert Space(rod, section_points=32).order == 2
    assert "polynomials, section degree 4; 7 elements of degree 5, C2, 2 of them short; quadrature 4x2x6" in repr(bare)


def test_the_papers_element_is_that_of_the_rods_own_functions():
    space = Space.paper(Ring(section_points=5).rod())
    assert (space.order, space.points_around, space.elements, space.degree) == (1, 5, 4, 2)
    assert Space.paper(Blade().rod(), degree=4, elements=3).continuity == 3


def test_the_mixed_formulation_is_left_by_explicit_steps_alone():
    space = Space(straight(4.0).sweep(section.circle(8)), order=2)
    body = Body(space, NeoHookean(1.0, 0.499), 1.0)
    assert body.formulation == "mixed"
    below = Plane((0.0, -1.5, 0.0), (0.0, 1.0, 0.0))
    assert Model([body], contacts=[Contact(0, below, 1.0)]).bodies[0].formulation == "mixed"
    clamped = [Support.end(space, "start")]
    assert dynamics.solve(Model([body], clamped), 1e-3, outputs=1).model.bodies[0].formulation == "displacement"
    with pytest.raises(InputError, match="formulation: got 'mixed', explicit steps take 'displacement' alone"):
        dynamics.solve(Model([Body(space, NeoHookean(1.0, 0.499), 1.0, "mixed")], clamped), 1e-3)


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_a_free_rod_moves_with_all_its_mass(integrator):
    """As many points as the degree see no mass in one motion along a rod that nothing holds."""
    space = Space(straight(4.0).sweep(section.circle(8)))
    model = Model([Body(space, NeoHookean(1.0, 0.3), 2.0)])
    velocity = np.kron(space.is_control_point, [0.1, 0.0, 0.2])
    step = 0.05 if integrator == "implicit" else None
    found = dynamics.solve(model, 0.1, step, outputs=1, velocity=velocity, integrator=integrator)
    assert found.displacement[-1] == pytest.approx(0.1 * velocity, abs=1e-8)


def test_a_preset_fills_what_is_not_given():
    assert Spring(preset="paper") == Spring(
        helix="paper", order=1, degree=3, continuity=2, elements_per_turn=8,
        formulation="displacement", quadrature="auto",
        preset="paper",
    )  # fmt: skip
    assert Blade(preset="paper", degree=4).continuity == 3
    assert Blade(preset="paper", section_degree=3).order is None
    with pytest.raises(InputError, match="preset: got 'book', need 'paper'"):
        Spring(preset="book")


def test_a_record_says_what_was_chosen(command):
    (found,) = command.record("run", "blade", "--modes", "3", "--degree", "4")["discretisation"]
    assert (found["degree"], found["section_degree"], found["formulation"]) == (4, 4, "displacement")
    assert found["chosen"] == ["section_degree", "elements", "continuity", "knots", "quadrature"]
    text = " ".join(command.prints("run", "blade", "--modes", "3").split())
    assert (
        "element polynomials, section degree 4; 7 elements of degree 5, C2, 2 of them short; quadrature 4x2x6 (chosen: "
        "section" in text
    )


@pytest.mark.slow
def test_functions_of_control_points_carry_a_flower():
    """Against an order and a degree more: petals are where polynomials err by 4 % in torsion."""
    rod = dataclasses.replace(Flower(length=8.0), depth=0.3).rod()

    def twisted(space):
        ends = Support.end(space, "start"), Support.end(space, "end", turn=(0.0, 0.0, 1e-3))
        return statics.solve(Model([Body(space, LinearElastic(1.0, 0.3))], ends)).moments[1, 2]

    fine = Space(rod, order=3, section_points=48, degree=5, elements=4, continuity=0, quadrature="auto")
    assert twisted(Space(rod)) == pytest.approx(twisted(fine), rel=WITHIN)


@pytest.mark.parametrize("widths", [3.5, 5.0, 8.0])
@pytest.mark.parametrize("nu", [0.45, 0.49])
def test_short_bars_are_sheared_right_to_half_a_percent(widths, nu):
    def force(space):
        body, start = Body(space, NeoHookean(1.0, nu)), Support.end(space, "start")
        return statics.solve(
            Model([body], [start, Support.end(space, "end", displacement=(1e-3, 0.0, 0.0))])
        ).reactions[1, 0]

    rod = straight(2.0 * widths).sweep(section.circle(8))
    space = Space(rod)
    fine = Space(rod, section_degree=7, degree=6, elements=space.elements, continuity=3, knots=space.knots)
    assert force(space) == pytest.approx(force(fine), rel=5e-3)
