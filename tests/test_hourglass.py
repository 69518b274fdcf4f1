"""Which quadrature rules are held against the one that would be chosen, with which, and what the checks count by."""

from dataclasses import astuple, replace

import numpy as np
import pytest
from conftest import straight
from petsc4py import PETSc

from isorod import Axis, Body, LinearElastic, Model, NeoHookean, Rod, SolveError, Space, circle
from isorod.assembly.assembler import Assembler
from isorod.checks import hourglass
from isorod.geometry.quadrature import Rule
from isorod.petsc import inertia

SPACES = {
    "control points": {"degree": 2},
    "order 2": {"degree": 3, "order": 2},
    "polynomials": {"degree": 3, "section_degree": 5},
}


def with_rule(rule, nu=0.3, formulation="displacement", **keywords):
    space = Space.paper(straight(n=8, breaks=(0.0, 1.0, 2.0)), quadrature=str(rule), **keywords)
    return Model([Body(space, NeoHookean(1.0, nu), formulation=formulation)])


def chosen(**keywords):
    return Space.paper(straight(n=8, breaks=(0.0, 1.0, 2.0)), quadrature="auto", **keywords).rule


@pytest.mark.parametrize("name", SPACES)
def test_a_rule_with_a_point_less_in_any_direction_is_suspected(name):
    keywords = SPACES[name]
    good = chosen(**keywords)
    assert min(astuple(good)) >= 2
    assert not hourglass.better_rules(with_rule(good, **keywords))
    for direction in ("radial", "angular", "axial"):
        count = getattr(good, direction)
        fewer, more = replace(good, **{direction: count - 1}), replace(good, **{direction: count + 1})
        if fewer.radial > 1:
            assert hourglass.better_rules(with_rule(fewer, **keywords)), direction
        assert not hourglass.better_rules(with_rule(more, **keywords)), direction


@pytest.mark.parametrize("name", SPACES)
def test_as_many_points_as_the_degree_are_enough_where_elements_are_joined_without_slopes(name):
    """Of C0 elements alone: with continuous slopes they are too few, and one less is too few for all."""
    keywords = SPACES[name]
    good, degree = chosen(**keywords), keywords["degree"]
    for continuity, points, suspected in ((0, degree, False), (0, degree - 1, True), (degree - 1, degree, True)):
        model = with_rule(replace(good, axial=points), continuity=continuity, **keywords)
        assert bool(hourglass.better_rules(model)) is suspected, (continuity, points)


def test_one_smooth_joint_among_others_wants_all_points():
    knots = np.array([0.0, 0, 0, 1, 2, 2, 3, 3, 3])
    heights = np.array([knots[j + 1 : j + 3].mean() for j in range(6)])
    rod = Rod.sweep(circle(8), Axis(2, knots, np.ones(6)), heights[:, None] * np.array([0.0, 0.0, 1.0]))
    for points, suspected in ((2, True), (3, False)):
        space = Space.paper(rod, quadrature=str(replace(chosen(degree=2), axial=points)))
        assert bool(hourglass.better_rules(Model([Body(space, NeoHookean(1.0, 0.3))]))) is suspected


def test_one_poor_rule_among_good_ones_is_suspected():
    good, poor = with_rule(chosen(degree=2), degree=2), with_rule("2x1x3", degree=2)
    assert not hourglass.better_rules(Model(good.bodies * 2))
    assert hourglass.better_rules(Model([*good.bodies, *poor.bodies]))
    assert hourglass.better_rules(Model([*poor.bodies, *good.bodies]))


def test_the_mixed_formulation_is_not_suspected():
    assert not hourglass.better_rules(with_rule("2x1x2", formulation="mixed", degree=2))


@pytest.mark.parametrize("given", [Rule(2, 1, 2), Rule(2, 5, 3), Rule(7, 1, 3), Rule(2, 2, 6)])
def test_the_rule_it_is_held_against_has_the_more_points_in_each_direction(given):
    good = chosen(degree=2)
    (better,) = hourglass.better_rules(with_rule(given, degree=2)).values()
    assert astuple(better) == tuple(max(a, b) for a, b in zip(astuple(good), astuple(given), strict=True))


@pytest.mark.parametrize("law", [LinearElastic(3.0, 0.3), NeoHookean(3.0, 0.3)])
def test_curvatures_are_those_of_the_tangent_with_that_rule(law):
    """About a state, along motions that hold no end, seen by a rule that is not the space's own."""
    rod, random = straight(n=8, breaks=(0.0, 1.0, 2.0)), np.random.default_rng(1)
    poor, good = (
        Assembler(Model([Body(Space.paper(rod, degree=2, quadrature=rule), law)])) for rule in ("2x1x2", "3x2x4")
    )
    state, *motions = 0.05 * random.standard_normal((4, poor.model.dofs))
    ((_, better),) = poor.by_other_rules({0: Rule(3, 2, 4)})
    found = better.curvatures(poor.local(state), 1.0, [poor.local(motion) for motion in motions])
    tangent = good.matrix()
    good.tangent(good.state(state), 1.0, tangent)
    for motion, curvature in zip(motions, found, strict=True):
        x = good.state(motion)
        assert curvature == pytest.approx(x.dot(tangent * x), rel=1e-12)


def test_energies_are_held_against_those_of_the_better_rule(monkeypatch):
    """Refused from just below to just above what an assembler by that rule says."""
    rod, random = straight(n=8, breaks=(0.0, 1.0, 2.0)), np.random.default_rng(3)
    poor, good = (
        Assembler(Model([Body(Space.paper(rod, degree=2, quadrature=rule), NeoHookean(3.0, 0.3))]))
        for rule in ("2x1x2", "3x2x4")
    )
    displacement = 0.05 * random.standard_normal(poor.model.dofs)
    energy, seen = (one.energy(one.state(displacement), 1.0) for one in (poor, good))
    assert abs(seen / energy - 1.0) > 0.01
    rules = {0: Rule(3, 2, 4)}
    monkeypatch.setattr(hourglass, "FACTOR", (1.0 + 1e-9) * seen / energy)
    hourglass.check_energy(poor, rules, displacement, energy)
    monkeypatch.setattr(hourglass, "FACTOR", (1.0 - 1e-9) * seen / energy)
    with pytest.raises(SolveError, match=r"quadrature 2x1x2: 3x2x4 integrates .* times the stored energy"):
        hourglass.check_energy(poor, rules, displacement, energy)


@pytest.mark.parametrize("bodies", [1, 2])
def test_modes_are_held_against_the_better_rule(bodies, monkeypatch):
    """Whether every body has one, where what the model's own rule sees is known, or only the first of two."""
    rod, random = straight(n=8, breaks=(0.0, 1.0, 2.0)), np.random.default_rng(4)
    law = LinearElastic(3.0, 0.3)
    poor, good = (
        Assembler(Model([Body(Space.paper(rod, degree=2, quadrature=one), law) for one in [rule, "3x2x4"][:bodies]]))
        for rule in ("2x1x2", "3x2x4")
    )
    vector = random.standard_normal(poor.model.dofs)
    value, seen = (_along(one, vector) for one in (poor, good))
    assert seen > 1.01 * value
    rules, modes = {0: Rule(3, 2, 4)}, (np.array([value]), vector[None])
    monkeypatch.setattr(hourglass, "FACTOR", (1.0 + 1e-9) * seen / value)
    hourglass.check_modes(poor, rules, *modes, None)
    monkeypatch.setattr(hourglass, "FACTOR", (1.0 - 1e-9) * seen / value)
    ratio = f"{np.sqrt(seen / value):.2g}"
    with pytest.raises(SolveError, match=rf"quadrature 2x1x2: 3x2x4 gives mode 1 {ratio} times the frequency"):
        hourglass.check_modes(poor, rules, *modes, None)


def _along(assembler, vector):
    tangent = assembler.matrix()
    assembler.tangent(assembler.vector(), 0.0, tangent)
    x = assembler.state(vector)
    return x.dot(tangent * x)


@pytest.mark.parametrize("dense", [True, False])
def test_negative_eigenvalues_are_counted_where_pivots_are_blocks(dense, monkeypatch):
    """A zero diagonal leaves pivots of two rows, each with an eigenvalue of either sign."""
    random = np.random.default_rng(2)
    full = random.standard_normal((30, 30))
    full += full.T
    np.fill_diagonal(full, np.where(np.arange(30) < 20, 0.0, -40.0))
    matrix = PETSc.Mat().createAIJ((30, 30), nnz=30)
    matrix.setValues(range(30), range(30), full)
    matrix.assemble()
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    if not dense:
        monkeypatch.setattr(inertia, "_DENSE", 0)
    negative = int(np.count_nonzero(np.linalg.eigvalsh(full) < 0.0))
    assert 10 < negative < 30
    assert inertia.negative_eigenvalues(matrix) == negative


def test_a_failure_names_the_rule_where_it_may_be_the_cause():
    assert hourglass.hint(with_rule("3x1x3", degree=2)) == "; quadrature 3x1x3 has fewer points than 'auto'"
    assert hourglass.hint(with_rule(chosen(degree=2), degree=2)) == ""


def test_what_a_better_rule_adds_is_what_is_missing_alone():
    """More points along C0 elements would see energy that locks, which no rule is suspected for."""
    keywords = SPACES["polynomials"]
    good, degree = chosen(**keywords), keywords["degree"]
    model = with_rule(replace(good, axial=degree, radial=good.radial - 1), continuity=0, **keywords)
    assert hourglass.better_rules(model) == {0: replace(good, axial=degree)}
