"""What Python is given: refused in one line if it cannot be used, when it is given; and what results look like."""

import numpy as np
import pytest

from isorod import dynamics, modal, statics
from isorod.errors import InputError
from isorod.geometry.coils import helix
from isorod.material import LinearElastic, NeoHookean
from isorod.material.muscle import Muscle
from isorod.model import Body, Model, Support
from isorod.model.contact import Contact
from isorod.model.load import SectionLoad
from isorod.scenes.biceps import Biceps
from isorod.scenes.blade import Blade
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring
from isorod.space import Space

SPRING = Spring(preset="paper", coils=1, elements_per_turn=4, section_points=4)


@pytest.fixture(scope="module")
def body():
    return SPRING.model().bodies[0]


def other():
    return Spring(preset="paper", coils=2, elements_per_turn=4, section_points=4).model().bodies[0].space


BAD = {
    "a scene": (lambda body: statics.solve(SPRING), r"model: got Spring, need a Model \(its model\(\) is one\)"),
    "a scene's modes": (lambda body: modal.solve(Blade(preset="paper")), r"model: got Blade, need a Model \(its model"),
    "a scene's motion": (lambda body: dynamics.solve(Biceps(), 1.0), r"model: got Biceps, need a Model \(its model"),
    "no model": (lambda body: statics.solve(None), "model: got None, need a Model"),
    "steps": (lambda body: statics.solve(SPRING.model(), load_steps=2.5), "load steps: got 2.5, need an integer"),
    "no steps": (lambda body: statics.solve(SPRING.model(), load_steps=0), "load steps: got 0, need an integer from 1"),
    "words": (lambda body: statics.solve(SPRING.model(), load_steps="a"), "load steps: got a, need an integer"),
    "modes": (lambda body: modal.solve(Blade(preset="paper").model(), modes=2.5), "modes: got 2.5, need an integer"),
    "state": (
        lambda body: modal.solve(Blade(preset="paper").model(), state=3),
        "state: got 3, need a Equilibrium or None",
    ),
    "a field": (lambda body: Spring(preset="paper", E="a"), "Spring: E: got 'a', need a number"),
    "points": (
        lambda body: Spring(preset="paper", section_points="8"),
        "Spring: section_points: got '8', need an integer",
    ),
    "half a point": (
        lambda body: Spring(preset="paper", section_points=8.5),
        "Spring: section_points: got 8.5, need an integer",
    ),
    "NaN points": (
        lambda body: Spring(preset="paper", section_points=float("nan")),
        "Spring: section_points: got nan, need an integer",
    ),
    "a flag": (lambda body: Biceps(statics="no"), "Biceps: statics: got 'no', need True or False"),
    "a ring": (lambda body: Ring(radius=None), "Ring: radius: got None, need a number"),
    "a law": (lambda body: NeoHookean("a", 0.3), "NeoHookean: E: got 'a', need a number"),
    "elastic": (lambda body: LinearElastic(1.0, None), "LinearElastic: nu: got None, need a number"),
    "muscle": (lambda body: Muscle(1.0, 0.3, sigma_max=[1.0]), "Muscle: sigma_max: got \\[1.0\\], need a number"),
    "one load": (
        lambda body: Model([body], loads=SectionLoad((0.0, 0.0, 1.0))),
        "Model: loads: got SectionLoad, need a list of Load objects",
    ),
    "one body": (lambda body: Model(body), "Model: bodies: got Body, need a list of Body objects"),
    "no body": (lambda body: Model([]), "model: got no bodies, need at least one"),
    "one support": (
        lambda body: Model([body], Support.end(body.space, "end")),
        "Model: supports: got Support, need a list of Support or MeanSupport objects",
    ),
    "no support": (
        lambda body: Model([body], [3]),
        "Model: supports: got \\[3\\], need a list of Support or MeanSupport objects",
    ),
    "no law": (
        lambda body: Body(body.space, 3.0),
        "Body: material: got 3.0, need a Material or a list",
    ),
    "no space": (lambda body: Body(body, NeoHookean(1.0, 0.3)), "Body: space: got Body, need a Space"),
    "penalty": (lambda body: Contact(0, 1, "a"), "Contact: penalty: got 'a', need a number"),
    "force": (lambda body: SectionLoad("abc"), "SectionLoad: force: got 'abc', need 3 numbers"),
    "another support": (
        lambda body: Model([body], [Support.end(other(), "end")]),
        "support 0: made for another space than that of body 0",
    ),
    "another load": (
        lambda body: Model([body], loads=[SectionLoad.end(other(), "end", (0.0, 0.0, 1.0))]),
        "load 0: made for another space than that of body 0",
    ),
    "turns in words": (lambda body: helix(1.0, 1.0, "two"), "helix: turns: got 'two', need a number"),
    "half an arc": (lambda body: helix(1.0, 1.0, 1, 4.5), "helix: arcs a turn: got 4.5, need an integer"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_used_is_refused_in_one_line(case, body):
    call, said = BAD[case]
    with pytest.raises(InputError, match=f"^{said}") as refusal:
        call(body)
    assert "\n" not in str(refusal.value)


SPACES = {
    "order": ({"order": 7}, "polyharmonic order: got 7, need an integer from 1 to 6"),
    "half an order": ({"order": 1.5}, "Space: order: got 1.5, need an integer"),
    "points": ({"section_points": 9}, "section points: got 9, need a multiple of the 4"),
    "fewer points": ({"section_points": 2}, "section points: got 2, need a multiple of the 4"),
    "points in words": ({"section_points": "8"}, "Space: section_points: got '8', need an integer or None"),
    "degree": ({"degree": 1}, "axis degree: got 1, need an integer from 2 to 6"),
    "high degree": ({"degree": 7}, "axis degree: got 7, need an integer from 2 to 6"),
    "continuity": ({"continuity": 2}, "continuity: got 2, need an integer from 0 to 1"),
    "elements": ({"elements": 5}, "elements: got 5, need a multiple of the 4 elements"),
    "half an element": ({"elements": 4.5}, "Space: elements: got 4.5, need an integer or None"),
    "quadrature": ({"quadrature": "1x1x3"}, "quadrature: got '1x1x3'; one radial point"),
    "rule": ({"quadrature": 3}, "Space: quadrature: got 3, need a text"),
    "no rule": ({"quadrature": "good"}, "quadrature: got 'good', need 'auto'"),
    "section degree": ({"section_degree": 9}, "section degree: got 9, need an integer from 1 to 8"),
    "both": ({"section_degree": 2, "order": 2}, "section degree: polynomials take the place of order"),
    "basis": ({"section_basis": 3}, "Space: section_basis: got 3, need a SectionBasis or None"),
}


@pytest.mark.parametrize("case", SPACES)
def test_a_space_is_checked_when_it_is_made(case, body):
    given, said = SPACES[case]
    with pytest.raises(InputError, match=f"^{said}"):
        Space.paper(body.space.rod, **given)


def test_numbers_may_be_of_any_type():
    scene = Spring(
        preset="paper",
        coils=np.int64(1),
        section_points=4.0,
        elements_per_turn=np.float64(4.0),
        E=np.float32(3.0),
        nu=0,
    )
    assert [type(value) for value in (scene.coils, scene.section_points, scene.elements_per_turn)] == [
        np.int64,
        int,
        int,
    ]
    space = Space.paper(scene.rod(), elements=np.int32(8), degree=3.0, section_points=8.0)
    assert (space.axis.elements, space.axis.degree, space.points_around) == (8, 3, 8)
    assert helix(1.0, 1.0, np.float32(2.0), 4.0).axis.elements == 8


def test_a_support_of_an_equal_space_will_do(body):
    space = SPRING.model().bodies[0].space
    assert space is not body.space
    model = Model([body], [Support.end(space, "start")], loads=[SectionLoad.end(space, "end", (0.0, 0.0, 1.0))])
    assert model.unknowns == model.dofs - 3 * body.space.layer_nodes


def test_results_fit_on_a_screen(body):
    model = SPRING.model()
    biceps = Biceps(elements=5, order=1, end_time=2e-4, outputs=1)
    found = {
        "reaction of support 1 (": statics.solve(model),
        "3 modes": modal.solve(Blade(preset="paper", elements=4).model(), 3),
        "2 outputs from time 0": dynamics.solve(biceps.model(), **biceps.settings()),
        "bodies 1, supports 2; 156 degrees": model,
        "13 layers of 4 nodes": Space.paper(body.space.rod, elements=8, degree=2, continuity=1),
        "9 layers of 4 control points": body.space.rod,
        "degree 2, 4 elements": body.space.rod.axis,
    }
    for said, one in found.items():
        lines = repr(one).splitlines()
        assert len(lines) <= 10 and max(map(len, lines)) <= 100, repr(one)
        assert said in repr(one)
        assert "array" not in repr(one)
