"""Rods in contact at rest: Newton stays quadratic, forces balance, and Hertz's pressure of a cylinder on a plane."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import as_array, straight
from loads import assert_load_forces_are_differences
from touching import STIFF, bars, strip

from isorod import Body, Contact, Cylinder, LinearElastic, Model, Plane, Rod, SolveError, Space, Support, statics
from isorod.assembly.assembler import Assembler
from isorod.contact.operator import ContactOperator
from isorod.statics import contact_policy
from isorod.statics.tuning import StepControl


def crossing(press=0.5, penalty=1e4, gap=0.05, **contact):
    return bars(press, gap, penalty=penalty, **{"points": (3, 4)} | contact)


def test_newton_is_quadratic_and_forces_balance(petsc_options):
    petsc_options(snes_rtol=1e-13)
    solution = statics.solve(crossing(), load_steps=2)
    norms = [norm for norm in solution.residual_norms[1:] if norm > 1e-10]
    print("residual norms", *(f"{norm:.2e}" for norm in solution.residual_norms))
    orders = [np.log(c / b) / np.log(b / a) for a, b, c in zip(norms, norms[1:], norms[2:], strict=False)]
    assert orders[-1] > 1.7
    assert solution.residual_norms[-1] < 1e-9
    (result,) = solution.contacts
    # What presses is what holds, on either bar; at this crossing the normals are nearly vertical.
    down = solution.reactions[2:].sum(axis=0)
    np.testing.assert_allclose(solution.reactions[:2].sum(axis=0), -down, atol=1e-7)
    assert down[1] < -30.0
    assert -down[1] < result.force < -1.02 * down[1]
    assert 0.0 < result.relative_penetration < 0.02
    assert result.relative_penetration == pytest.approx(result.penetration, rel=1e-12)
    assert result.pressure.max() == pytest.approx(1e4 * result.penetration, rel=1e-12)
    assert result.area == pytest.approx(result.areas[result.pressure > 0.0].sum(), rel=1e-12)
    assert set(result.body) == {0, 1}
    assert "contact" in solution.built


def test_a_step_too_long_for_contact_gets_where_any_steps_get():
    """In one step the bars pass half through each other before anything resists."""
    once, many = (statics.solve(crossing(press=1.0), steps) for steps in (1, 10))
    assert np.abs(many.displacement - once.displacement).max() < 1e-8 * np.abs(once.displacement).max()
    assert many.contacts[0].force == pytest.approx(once.contacts[0].force, rel=1e-7)


def test_tangent_of_the_model_is_the_derivative_of_its_residual():
    model = crossing(gap=-0.1)
    assembler = Assembler(model)
    x = assembler.vector()
    # A state in which no foot is within a step of a knot: the rod's curvature, and so the tangent, jumps there.
    x.array_w[:] = 0.003 * np.random.default_rng(1).standard_normal(model.unknowns)
    matrix = assembler.matrix()
    assembler.tangent(x, 0.2, matrix)
    tangent = as_array(matrix)
    # The pattern grew with contact: both bodies are coupled.
    half = np.count_nonzero(model.free[: 3 * model.first_node[1]] >= 0)
    assert np.abs(tangent[:half, half:]).max() > 1.0
    assert np.abs(tangent - tangent.T).max() < 1e-12 * np.abs(tangent).max()
    rng, step = np.random.default_rng(1), 1e-6
    out, energies = assembler.vector(), []
    for _ in range(3):
        v = assembler.vector()
        v.array_w[:] = rng.standard_normal(model.unknowns)
        sides = []
        for sign in (-1.0, 1.0):
            moved = x.copy()
            moved.axpy(sign * step, v)
            assembler.residual(moved, 0.2, out)
            sides.append(out.array_r.copy())
            energies.append(assembler.energy(moved, 0.2))
        change = (sides[1] - sides[0]) / (2.0 * step)
        np.testing.assert_allclose(tangent @ v.array_r, change, atol=1e-6 * np.abs(change).max())
        slope = (energies[-1] - energies[-2]) / (2.0 * step)
        assert slope == pytest.approx(0.5 * (sides[0] + sides[1]) @ v.array_r, rel=1e-5)


def test_load_forces_include_contact_of_held_nodes(petsc_options):
    """A bar all held moves onto another: its prescribed motion acts through contact alone."""
    model = crossing(gap=-0.02, press=0.01)
    high = model.bodies[1].space
    everything = Support(np.arange(high.nodes), "xyz", high.is_control_point[:, None] * np.array([0.0, -0.01, 0.0]), 1)
    model = replace(model, supports=[*model.supports[:2], everything])
    assembler = Assembler(model)
    assert_load_forces_are_differences(assembler)


def test_bodies_that_do_not_meet_move_as_without_contact():
    model = crossing(press=0.5, gap=0.6)
    # One end pressed: the bar bends.
    model = replace(model, supports=[*model.supports[:3], Support.end(model.bodies[1].space, "end", body=1)])
    there = statics.solve(model)
    alone = statics.solve(replace(model, contacts=()))
    assert there.contacts[0].force == 0.0
    assert there.contacts[0].penetration == 0.0
    np.testing.assert_allclose(there.displacement, alone.displacement, atol=1e-12)
    assert alone.contacts == ()
    assert "contact" not in alone.built


def test_augmented_lagrangian_takes_penetration_away_and_agrees_with_a_high_penalty():
    plain = statics.solve(crossing(), load_steps=4)
    solution = statics.solve(crossing(penetration=1e-6), load_steps=4)
    stiff = statics.solve(crossing(penalty=1e6), load_steps=8)
    print(plain.contacts[0].force, solution.contacts[0].force, stiff.contacts[0].force, solution.augmentations)
    assert solution.augmentations >= 1
    assert solution.contacts[0].penetration <= 1e-6 < plain.contacts[0].penetration
    # The penalty's error falls with the penalty.
    assert solution.contacts[0].force == pytest.approx(stiff.contacts[0].force, rel=2e-3)
    assert abs(plain.contacts[0].force / stiff.contacts[0].force - 1.0) > 0.01


def test_augmented_lagrangian_that_does_not_get_there_says_so(monkeypatch):
    monkeypatch.setattr(contact_policy, "CONTROL", StepControl(updates=1))
    text = r"contact 0: penetration .* after 1 augmented Lagrangian update.*, largest pressure on body \d at u = .*"
    with pytest.raises(SolveError, match=text):
        statics.solve(crossing(penetration=1e-14), load_steps=4)


def test_bar_bent_round_a_rigid_cylinder():
    """Held ends, an obstacle in the middle: symmetric, and the obstacle takes what the ends give."""
    rod = straight(8, breaks=tuple(np.linspace(0.0, 6.0, 7)), radius=0.5, height=12.0)
    space = Space.paper(Rod(rod.axis, rod.control_points - [0.0, 0.0, 6.0]), order=2, quadrature="auto", degree=3)
    ends = [Support.end(space, end, displacement=(0.0, -0.4, 0.0)) for end in ("start", "end")]
    obstacle = Cylinder((0.0, -1.5, 0.0), (1.0, 0.0, 0.0), 1.0)
    solution = statics.solve(Model([Body(space, STIFF)], ends, contacts=[Contact(0, obstacle, 1e4)]), load_steps=2)
    (result,) = solution.contacts
    held = solution.reactions.sum(axis=0)
    np.testing.assert_allclose(result.resultant, -held, atol=1e-6 * np.abs(held).max())
    up = -solution.reactions[:, 1]
    assert up[0] == pytest.approx(up[1], rel=1e-7)
    assert 0.98 * result.force < up.sum() < result.force
    touching = result.pressure > 0.0
    gaps = np.hypot(result.positions[:, 1] + 1.5, result.positions[:, 2]) - 1.0
    np.testing.assert_allclose(result.pressure[touching], -1e4 * gaps[touching], rtol=1e-10)


E, NU = 1.0, 0.3
HERTZ_LOAD = 0.02  # displacement of the cylinder's back over its radius


@cache
def hertz(n, radial):
    """Press a linear elastic cylinder of radius 1 on a rigid plane in plane strain; return errors of Hertz's theory.

    The partner is rigid and flat: ``R* = R``, ``E* = E / (1 - nu^2)``.  The penalty is 8 E over the length of an arc.
    """
    model = strip(n, LinearElastic(E, NU), f"{radial}x1x1", HERTZ_LOAD, penalty=1.25 * n * E, points=(4, 1))
    solution = statics.solve(model)
    (result,) = solution.contacts
    force, modulus = -solution.reactions[1, 1], E / (1.0 - NU**2)
    assert force == pytest.approx(result.force, rel=1e-9)
    width = np.sqrt(4.0 * force / (np.pi * modulus))
    peak = 2.0 * force / (np.pi * width)
    load = result.areas * result.pressure
    # Pressures are forces per reference area, which at the peak shrinks by (1 + nu) (1 - 2 nu) p / E, 2.5 per cent
    # here.
    initial = ContactOperator(model).results(np.zeros(model.dofs))[0].positions
    angle = np.arctan2(initial[:, 0], -initial[:, 1])
    middle = int(np.argmax(result.pressure))
    stretch = np.ptp(result.positions[[middle - 1, middle + 1], 0]) / np.ptp(angle[[middle - 1, middle + 1]])
    # Of an elliptic pressure the mean square distance is a quarter of the half width's square.
    mean_square = load @ result.positions[:, 0] ** 2 / load.sum()
    errors = {
        "half width": 2.0 * np.sqrt(mean_square) / width - 1.0,
        "area": 0.5 * result.area / width - 1.0,
        "peak": result.pressure[middle] / stretch / peak - 1.0,
    }
    print(f"n {n}, b/R {width:.4f}, penetration / R {result.relative_penetration:.2e}", errors)
    assert 0.09 < width < 0.11
    return errors | {"penetration": result.relative_penetration}


def test_penetration_is_relative_to_the_radius_of_the_named_elements():
    """A rod whose radius grows from 0.5 to 1.5; only its thick end takes part."""
    rod = straight(8, degree=1, breaks=(0.0, 1.0, 2.0), height=2.0)
    points = rod.control_points * np.array([0.5, 1.0, 1.5])[:, None, None]
    points[..., 2] = rod.control_points[..., 2]
    space = Space.paper(Rod(rod.axis, points))
    plane = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0))
    model = Model([Body(space, STIFF)], contacts=[Contact(0, plane, 1.0, elements) for elements in (None, [1])])
    whole, thick = ContactOperator(model).results(np.zeros(model.dofs))
    assert whole.penetration == thick.penetration == -thick.positions[:, 1].min() - 1.0
    assert whole.relative_penetration == pytest.approx(whole.penetration / 0.75, rel=1e-12)
    assert thick.relative_penetration == pytest.approx(whole.penetration / 1.25, rel=1e-12)


def test_hertz_half_width_and_peak_pressure():
    errors = hertz(96, 12)
    assert abs(errors["half width"]) < 0.03
    assert abs(errors["peak"]) < 0.03


@pytest.mark.slow
def test_hertz_converges():
    """Errors fall as arcs shrink, and with them penetration; what stays is the finite width, 0.1 of the radius."""
    runs = [hertz(64, 12), hertz(128, 12), hertz(192, 16)]
    worst = [max(abs(run["half width"]), abs(run["peak"])) for run in runs]
    assert worst[0] > 4.0 * worst[1] > 4.0 * worst[2]
    assert worst[1] < 0.015
    # The width of the area in contact is known to about a point, the less the finer the arcs.
    edges = [abs(run["area"]) for run in runs]
    assert edges[0] > edges[1]
    assert max(edges[1:]) < 0.03
    depths = [run["penetration"] for run in runs]
    assert depths[0] > 1.8 * depths[1] > 1.8 * depths[2]


def test_while_contact_settles_the_elements_tangent_is_kept_and_the_answer_is_the_same(monkeypatch):
    built, add = [], Assembler._add_stiffness
    monkeypatch.setattr(Assembler, "_add_stiffness", lambda *given: (built.append(1), add(*given))[1])
    found, counts = [], []
    for lags in (0.2, 0.0):
        monkeypatch.setattr("isorod.statics.newton._LAGS", lags)
        found.append(statics.solve(crossing(penetration=1e-6), load_steps=4))
        counts.append(len(built))
        built.clear()
    assert counts[0] < counts[1]
    assert found[0].contacts[0].force == pytest.approx(found[1].contacts[0].force, rel=1e-7)
    assert found[0].displacement == pytest.approx(found[1].displacement, abs=1e-7)
