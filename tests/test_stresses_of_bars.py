"""The hardest bars of the study of stresses: right by the space that is chosen, wrong on even elements of degree 3."""

import numpy as np
import pytest

from comparisons.stability import stresses
from comparisons.stability.stresses import Bar, finer, off, places
from isorod import HolzapfelGasserOgden, LinearElastic, TransverselyIsotropic, statics
from isorod.files.scene import FileScene
from isorod.material.law import reach
from isorod.material.places import alone
from isorod.space import Space, choice

BARS = [
    Bar("ellipse", "isotropic", "shear", 10.0),
    pytest.param(Bar("ellipse", "fibred 20", "torsion", 20.0), marks=pytest.mark.slow),
    Bar("circle", "isotropic", "pressure", 50.0),
    Bar("airfoil", "isotropic", "pressure", 20.0),
    Bar("airfoil", "isotropic", "tension", 10.0),
    Bar("ellipse", "fibred 20", "shear", 5.0),
    pytest.param(Bar("tube 0.9", "isotropic", "pressure", 200.0), marks=pytest.mark.slow),
    pytest.param(Bar("ellipse", "fibred 20", "pressure", 20.0), marks=pytest.mark.slow),
    Bar("airfoil", "isotropic", "torsion", 20.0),
]


@pytest.mark.parametrize("bar", BARS, ids=str)
def test_stresses_are_right_by_default_and_wrong_on_even_elements(bar, tmp_path):
    scene = stresses.scene(bar, tmp_path)
    model = scene.model()
    space, at = model.bodies[0].space, places(model)
    exact = statics.solve(scene.on([finer(space)]).model()).stress(0, *at)
    solution = statics.solve(model)
    error = off(solution.stress(0, *at), exact)
    assert error < stresses.TOLERANCE
    assert error / 1.05 < solution.errors().stress < 5.0 * error
    even = FileScene(scene.path, elements=space.elements, section_degree=3)
    assert off(statics.solve(even.model()).stress(0, *at), exact) > stresses.TOLERANCE


def test_pressure_on_stiff_fibres_is_seen_by_functions_of_degree_8_in_shorter_elements(tmp_path):
    """Against two rings of degree 6 with twice the elements, whose functions see the rim of the held faces."""
    scene = stresses.scene(Bar("ellipse", "fibred 20", "pressure", 10.0), tmp_path)
    model = scene.model()
    space, at = model.bodies[0].space, places(model)
    rod = space.rod.with_rings(choice.RIM)
    fine = Space(rod, section_degree=6, **choice.halved(space))
    exact = statics.solve(scene.on([fine]).model()).stress(0, *at)
    assert space.section_degree == 8
    assert off(statics.solve(model).stress(0, *at), exact) < 0.6 * stresses.TOLERANCE
    plain = choice.axis(space.rod, None, None, None)
    before = Space(space.rod, plain.elements, knots=plain.knots, section_degree=6)
    assert off(statics.solve(scene.on([before]).model()).stress(0, *at), exact) > 0.9 * stresses.TOLERANCE


def test_places_are_on_all_surfaces_and_far_from_ends(tmp_path):
    model = stresses.scene(Bar("layers", "isotropic", "tension", 10.0), tmp_path).model()
    u, xi = places(model)
    assert 10.0 * u[[0, -1]] == pytest.approx([2.0, 8.0])
    assert np.unique(np.hypot(*xi.T).round(6)) == pytest.approx([0.0, 0.6, 1.0])


def test_outcomes():
    assert [stresses.outcome(*one) for one in ((0.009, 0.1), (0.02, 0.04), (0.02, 0.01), (0.04, None))] == [
        *stresses.OUTCOMES
    ]


def test_reach_along_fibres():
    """An incompressible matrix has E = 3 c, G = c, and with fibres E = 3 c + 4 k1; laws that split count as such."""
    assert reach(LinearElastic(7.0, 0.3), alone()) == pytest.approx(np.sqrt(3.0), rel=2e-3)
    fibred = TransverselyIsotropic(200.0, 10.0, 0.3, 0.3, 4.0)
    assert reach(fibred, alone()) == pytest.approx(np.sqrt(50.0))
    across = TransverselyIsotropic(200.0, 10.0, 0.3, 0.3, 4.0, "normal")
    assert reach(across, alone()) < 2.0
    assert reach(HolzapfelGasserOgden(2.0, 10.0, 1.0, np.inf), alone()) == pytest.approx(np.sqrt(23.0), rel=5e-3)
