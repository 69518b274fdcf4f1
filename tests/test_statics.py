"""Equilibrium: quadratic Newton, load steps that are cut and retried, and errors that say where."""

import re

import numpy as np
import pytest
from petsc4py import PETSc

from isorod import Body, LinearElastic, Model, NeoHookean, SolveError, Space, Support, statics
from isorod.assembly.assembler import Assembler
from isorod.scenes.spring import Spring

LAW = NeoHookean(1.0, 0.3)


@pytest.fixture
def bar(cylinder):
    """A clamped bar of radius 1 and height 4 whose upper face is displaced."""

    def make(displacement, law=LAW, n=4, elements=4, degree=2):
        space = Space.paper(cylinder(n, height=4.0), elements=elements, degree=degree)
        ends = [Support.end(space, "start"), Support.end(space, "end", displacement=displacement)]
        return Model([Body(space, law)], ends)

    return make


def assert_quadratic(norms, scale):
    """Each norm is the square of the one before, times a constant; what is at rounding level does not count."""
    norms = [norm for norm in norms if norm > 1e-13 * scale]
    orders = [
        np.log(c / b) / np.log(b / a) for a, b, c in zip(norms, norms[1:], norms[2:], strict=False) if b < 0.1 * a
    ]
    print("residual norms", *(f"{norm:.3e}" for norm in norms), "orders", *(f"{order:.2f}" for order in orders))
    assert len(orders) >= 1
    assert orders[-1] > 1.8


@pytest.mark.parametrize(
    "displacement",
    [(3.0, 0.0, 0.0), (1.5, 0.0, -0.5), (1.0, 1.0, 1.0), (0.0, 0.0, -2.0), (0.0, 0.0, 5.0)],
    ids=["bent", "bent and pressed", "askew", "pressed", "pulled"],
)
def test_newton_converges_quadratically(displacement, bar, petsc_options):
    petsc_options(snes_rtol=1e-14)
    solution = statics.solve(bar(displacement))
    assert solution.cuts == 0
    assert_quadratic(solution.residual_norms[1:], solution.residual_norms[0])


def test_newton_converges_quadratically_on_the_spring(petsc_options):
    """A slender rod, whose stretch follows its bending: without extrapolation two steps would make one order."""
    petsc_options(snes_rtol=1e-15)
    norms = statics.solve(Spring(preset="paper", travel=2.0).model()).residual_norms
    assert norms[-1] < 1e-13 * norms[0]
    assert len(norms) <= 6
    assert_quadratic(norms[1:], norms[0])


@pytest.mark.parametrize("steps", [2, 3, 7])
def test_result_does_not_depend_on_the_load_steps(steps, bar):
    for model in (bar((1.5, 0.5, -0.5)), Spring(preset="paper", coils=1, section_points=4).model()):
        one, many = statics.solve(model), statics.solve(model, steps)
        assert many.load_steps > one.load_steps
        assert np.abs(many.displacement - one.displacement).max() < 1e-8 * np.abs(one.displacement).max()
        assert np.abs(many.reactions - one.reactions).max() < 1e-8 * np.abs(one.reactions).max()


@pytest.mark.parametrize("displacement", [(0.0, 0.0, -3.9), (0.0, 0.0, 100.0)])
def test_steps_that_diverge_are_cut_and_the_load_still_gets_there(displacement, bar):
    solution = statics.solve(bar(displacement))
    assert solution.cuts > 0
    assert solution.load_steps > 1
    assert solution.residual_norms[-1] < 1e-8 * solution.residual_norms[0]
    assert np.abs(solution.reactions.sum(axis=0)).max() < 1e-8 * np.abs(solution.reactions).max()
    smaller_steps = statics.solve(bar(displacement), 40)
    assert solution.reactions == pytest.approx(smaller_steps.reactions, rel=1e-7, abs=1e-7)


def test_a_large_step_does_not_end_in_an_equilibrium_of_no_meaning(bar):
    """One linear prediction crushes the bar across; Newton's method would converge from there, near inversion."""
    model = bar((0.0, 0.0, 12.5))
    one, many = statics.solve(model), statics.solve(model, 40)
    assert one.reactions == pytest.approx(many.reactions, rel=1e-7, abs=1e-7)
    assembler = Assembler(model)
    assert assembler.smallest_jacobian(assembler.state(one.displacement), 1.0)[0] > 1.0


def test_a_bar_pressed_beyond_its_length_is_an_error_that_names_the_place(bar):
    with pytest.raises(SolveError) as caught:
        statics.solve(bar((0.0, 0.0, -6.0)))
    message = str(caught.value)
    found = re.fullmatch(
        r"load factor ([\d.]+): .*element (\d) of body 0, axis position u = ([\d.]+): det F = (-?[\d.e+-]+)", message
    )
    assert found, message
    factor, element, u, det = (float(text) for text in found.groups())
    assert 0 < factor <= 4 / 6 + 1e-3
    assert element / 4 <= u <= (element + 1) / 4
    assert det < 0.1


def test_a_failed_solve_leaves_nothing_that_disturbs_the_next(bar):
    before = statics.solve(bar((1.0, 0.0, 0.0)))
    with pytest.raises(SolveError):
        statics.solve(bar((0.0, 0.0, -6.0)))
    after = statics.solve(bar((1.0, 0.0, 0.0)))
    assert np.array_equal(before.displacement, after.displacement)
    assert not [name for name in PETSc.Options().getAll() if name.startswith(("snes", "ksp", "pc"))]


@pytest.mark.parametrize(
    ("supports", "motion"),
    [
        (
            lambda space: [Support.end(space, end, "z") for end in ("start", "end")],
            r"move along \(|turn about \(0, 0, -?1\)",
        ),
        (lambda space: [Support.end(space, "end", "z"), Support([0], "xyz")], r"turn about \(0, 0, -?1\)"),
        (lambda space: [Support.end(space, end, "xy") for end in ("start", "end")], r"move along \(0, 0, -?1\)"),
        (lambda space: [Support([0], "xyz"), Support([space.nodes - 1], "xyz", (0.0, 0.0, 0.5))], r"turn about \("),
        (lambda space: [], r"(turn about|move along) \("),
    ],
)
@pytest.mark.parametrize(("n", "elements", "degree", "E"), [(3, 4, 2, 1.0), (16, 40, 2, 1e6)])
def test_a_free_rigid_motion_is_refused_and_named(n, elements, degree, E, supports, motion, cylinder):
    space = Space.paper(cylinder(n, height=4.0), elements=elements, degree=degree)
    with pytest.raises(SolveError, match=rf"body 0 is free to ({motion})") as caught:
        statics.solve(Model([Body(space, NeoHookean(E, 0.3))], supports(space)))
    assert "\n" not in str(caught.value)


def test_nothing_moves_where_nothing_is_displaced(bar):
    solution = statics.solve(bar((0.0, 0.0, 0.0)))
    assert not solution.displacement.any()
    assert not solution.reactions.any()


def test_a_model_held_everywhere_has_its_displacements(cylinder):
    space = Space.paper(cylinder(4))
    supports = [Support([k], "xyz", (0.1 * k, 0.0, 0.0)) for k in range(space.nodes)]
    solution = statics.solve(Model([Body(space, LinearElastic(1.0, 0.3))], supports))
    assert np.array_equal(solution.displacement.reshape(-1, 3)[:, 0], 0.1 * np.arange(12))


def test_reaction_is_the_derivative_of_the_energy_by_the_displacement():
    """dW/d(pull) = force: Castigliano at finite deformation."""

    def energy(pull):
        model = Spring(preset="paper", coils=1, section_points=4, travel=pull).model()
        solution = statics.solve(model)
        assembler = Assembler(model)
        x = assembler.vector()
        x.array[:] = solution.displacement[model.free >= 0]
        return assembler.energy(x, 1.0), solution.reactions[1, 2]

    h = 0.02
    values = {k: energy(1.5 + k * h)[0] for k in (-3, -2, -1, 1, 2, 3)}
    slope = sum(w * (values[k] - values[-k]) for k, w in ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))) / h
    assert slope == pytest.approx(energy(1.5)[1], rel=1e-7)


def test_linear_law_needs_no_newton_step_after_the_predictor(bar):
    """The predictor of a linear model is its solution, and the answer is proportional to the load."""
    one, two = (statics.solve(bar((0.1 * k, 0.0, 0.2 * k), LinearElastic(1.0, 0.3))) for k in (1, 2))
    assert one.residual_norms[1] < 1e-12 * one.residual_norms[0]
    assert np.abs(two.displacement - 2 * one.displacement).max() < 1e-13


def test_the_last_iteration_takes_the_tangent_of_the_one_before(bar, monkeypatch, petsc_options):
    """One assembly and factorisation less, and the displacements of a tolerance that lets Newton's method go on."""
    built = []
    tangent = Assembler.tangent

    def counted(self, x, factor, out, lags=False):
        built.append(factor)
        tangent(self, x, factor, out, lags)

    monkeypatch.setattr(Assembler, "tangent", counted)
    found = statics.solve(bar((1.0, 1.0, 1.0)))
    assert found.load_steps == 1
    assert len(built) == found.newton_iterations - 1
    built.clear()
    petsc_options(snes_rtol=1e-14)
    exact = statics.solve(bar((1.0, 1.0, 1.0)))
    assert len(built) == exact.newton_iterations >= found.newton_iterations
    assert found.displacement == pytest.approx(exact.displacement, abs=1e-9)
    assert found.reactions == pytest.approx(exact.reactions, rel=1e-9, abs=1e-9)


def test_record_of_the_run(bar):
    solution = statics.solve(bar((0.5, 0.0, 0.0)))
    assert solution.built == ["tangent"]
    assert solution.solver == {"snes": "newtonls", "ksp": "preonly", "pc": "banded"}
    assert sorted(solution.seconds) == ["assembly", "check", "setup", "solve"]
    assert min(solution.seconds.values()) > 0
    assert solution.newton_iterations == len(solution.residual_norms) - 1
    assert solution.ranks == 1


def test_what_the_user_types_wins(bar, petsc_options):
    petsc_options(snes_rtol=1e-2, ksp_type="gmres", pc_type="jacobi", ksp_rtol=1e-10)
    loose = statics.solve(bar((1.5, 0.0, -0.5)))
    assert (loose.solver["ksp"], loose.solver["pc"]) == ("gmres", "jacobi")
    assert loose.residual_norms[-1] > 1e-6 * loose.residual_norms[0]
