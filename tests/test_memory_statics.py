"""Rods of laws with memory in statics: exact torsion and bending, what is left, ranks, and what is refused."""

import numpy as np
import pytest
from refused import refused

from isorod import (
    Body,
    Contact,
    MeanSupport,
    Model,
    Plane,
    SectionLoad,
    SolveError,
    Space,
    Support,
    UserMaterial,
    buckling,
    circle,
    statics,
    straight,
)
from isorod.geometry.quadrature import Rule, section_points
from isorod.material.plastic import Plastic
from isorod.material.viscous import Creep, Viscoelastic

E, NU, YIELD = 200e3, 0.3, 400.0
G, SHEAR = E / (2.0 + 2.0 * NU), YIELD / np.sqrt(3.0)


def _bar(law, **space) -> tuple[Space, Body]:
    given = {"section_degree": 3, "elements": 2, "degree": 3} | space
    made = Space(straight(4.0).sweep(circle(8, 1.0)), **given)
    return made, Body(made, law, 1.0)


def _twisted(x: float, law, factors=((0.0, 0.0), (1.0, 1.0)), load_steps: int = 1, **space):
    """Return a bar that is twisted to x times first yield, times factors by time."""
    made, body = _bar(law, **space)
    turn = (0.0, 0.0, 4.0 * x * SHEAR / G)
    ends = [Support.end(made, "start"), Support.end(made, "end", turn=turn, history=list(map(list, factors)))]
    return statics.solve(Model([body], ends), load_steps, end_time=factors[-1][0], keep=True)


def _hard(g: float) -> float:
    """Return the modulus of hardening with which a bar that flows is g times as stiff in shear."""
    return 3.0 * G * g / (1.0 - g)


@pytest.mark.parametrize(
    ("points", "twice", "worst"), [(12, 1e-3, 2.5e-3), (24, 2.6e-4, 6.6e-4), (32, 1.5e-4, 3.8e-4), (48, 6.8e-5, 1.7e-4)]
)
def test_how_far_points_across_are_off_in_torsion(points, twice, worst) -> None:
    """Without hardening, of a bar that flows beyond the radius c: at c = 1/2, and at the worst c."""
    xi, weights = section_points(8, Rule(points, 4, 3))
    r, c = np.linalg.norm(xi, axis=1), np.append(np.linspace(0.01, 1.0, 2000), 0.5)
    torque = (np.minimum(r / c[:, None], 1.0) * r) @ weights
    off = np.abs(torque / (2.0 * np.pi * (c**3 / 4.0 + (1.0 - c**3) / 3.0)) - 1.0)
    assert (off[-1], off.max()) == pytest.approx((twice, worst), rel=0.03)


# x, g: torque over tau_y R^3, twist left and stress left at the surface and where it begins to flow.
CASES = [(2.0, 0.0, 2.0289452554, 0.7083333333, -0.2916666667), (2.0, 0.1, 2.1402099953, 0.6375, -0.2625)]


@pytest.mark.parametrize("kinematic", [False, True])
@pytest.mark.parametrize(("x", "g", "torque", "left", "stress"), CASES)
def test_torsion_up_and_what_is_left(x, g, torque, left, stress, kinematic) -> None:
    table = [[0.0, YIELD]] + ([[1.0, YIELD + _hard(g)]] if g and not kinematic else [])
    law = Plastic(E, NU, table, _hard(g) if kinematic else 0.0)
    solution = _twisted(x, law, [(0.0, 0.0), (1.0, 1.0), (2.0, left / x)])
    up = next(state for time, state in solution.frames() if time == pytest.approx(1.0))
    assert up.moments[1, 2] == pytest.approx(torque * SHEAR, rel=2e-3)
    assert abs(solution.moments[1, 2]) < 2e-3 * torque * SHEAR
    surface = solution.stress(0, 0.5, [(1.0, 0.0)])[0]
    assert surface[1, 2] / SHEAR == pytest.approx(stress, abs=3e-3)
    # Where it has flown, and how far; unloading is elastic.
    p = [state.state("p", 0, 0.5, [(0.0, 0.3), (0.0, 1.0)])[:, 0] for state in (up, solution)]
    assert p[1] == pytest.approx(p[0], abs=1e-9)
    assert p[0][0] == 0.0
    shear = (x - 1.0) * SHEAR / G / (1.0 + _hard(g) / (3.0 * G))
    assert p[0][1] == pytest.approx(shear / np.sqrt(3.0), rel=1e-3)


def test_a_cycle_with_kinematic_hardening_loses_the_area_of_its_loop() -> None:
    # 8 pi (1 - g) [x (1 - rp^3)/3 - (1 - rp^2)/2] tau_y^2 R^2/G a length.
    x, g = 2.0, 0.1
    law = Plastic(E, NU, [[0.0, YIELD]], _hard(g))
    cycle = [(0.0, 0.0), (1.0, 1.0), (3.0, -1.0), (5.0, 1.0)]
    solution = _twisted(x, law, cycle, load_steps=12)
    times, torques = np.transpose([(time, one.moments[1, 2]) for time, one in solution.frames()])
    turns = 4.0 * x * SHEAR / G * np.interp(times, *np.transpose(cycle))
    loop = times > 0.999
    area = np.sum(0.5 * (torques[loop][1:] + torques[loop][:-1]) * np.diff(turns[loop]))
    assert area == pytest.approx(4.7123889804 * SHEAR**2 / G * 4.0, rel=1e-2)


def test_bending_of_a_round_bar() -> None:
    law = Plastic(E, 0.5, [[0.0, YIELD]])
    made = Space(straight(8.0).sweep(circle(8, 1.0)), section_degree=3, elements=4, degree=3)
    turn = (2.0 * YIELD / E * 8.0, 0.0, 0.0)
    ends = [Support.end(made, "start"), Support.end(made, "end", components="", tied="xyz", turn=turn)]
    solution = statics.solve(Model([Body(made, law)], ends))
    F = solution.deformation_gradient(0, 0.5, [(0.0, 1.0), (0.0, -1.0)])
    strains = 0.5 * np.log([(one.T @ one)[2, 2] for one in F])
    c = 2.0 * YIELD / E / abs(strains[0] - strains[1])
    s = np.sqrt(1.0 - c**2)
    moment = YIELD * ((np.arcsin(c) - c * s * (1.0 - 2.0 * c**2)) / (2.0 * c) + 4.0 * s**3 / 3.0)
    assert abs(solution.moments[1, 0]) == pytest.approx(moment, rel=5e-3)


def test_held_twist_relaxes() -> None:
    twist = 4.0 * SHEAR / G / 2.0
    r = (np.arange(2000) + 0.5) / 2000
    for law, left in (
        (Viscoelastic(E, NU, [[0.5, 1.0]]), lambda tau, t: tau * (0.5 + 0.5 * np.exp(-t))),
        (Creep(E, NU, 1e-9, 3.0), lambda tau, t: tau / np.sqrt(1.0 + 2.0 * G * 9.0e-9 * t * tau**2)),
    ):
        made, body = _bar(law)
        ends = Support.end(made, "start"), Support.end(made, "end", turn=(0, 0, twist), history=[[0, 1], [2, 1]])
        torque = statics.solve(Model([body], ends), end_time=2.0).moments[1, 2]
        exact = np.mean(2.0 * np.pi * r**2 * left(G * twist / 4.0 * r, 2.0))
        assert torque == pytest.approx(exact, rel=1e-3)


def test_the_estimate_sees_too_few_points_across_the_section() -> None:
    law = Plastic(E, NU, [[0.0, YIELD]])
    with pytest.warns(UserWarning, match="too few points across the section"):
        coarse = _twisted(2.0, law, quadrature="4x4x4")
    off = abs(coarse.moments[1, 2] / (2.0289452554 * SHEAR) - 1.0)
    assert off > 5e-3
    assert coarse.errors("section").work > 0.5 * off
    assert _twisted(2.0, law).errors("section").work < 3e-3


def test_the_estimate_sees_steps_that_are_few() -> None:
    # Stresses turn from the elastic ratio of tension and torsion to that of flow.
    made, body = _bar(Plastic(E, NU, [[0.0, YIELD]]))
    end = Support.end(made, "end", displacement=(0.0, 0.0, 0.02), turn=(0.0, 0.0, 0.03))
    model = Model([body], [Support.end(made, "start"), end])
    one, four, many = (statics.solve(model, steps) for steps in (1, 4, 32))
    for few in (one, four):
        off = abs(few.moments[1, 2] / many.moments[1, 2] - 1.0)
        assert 0.5 * off < few.steps_error < 4.0 * off
    assert one.errors().work > one.steps_error > 5e-3
    assert four.steps_error < 0.7 * one.steps_error


def _let_go():
    """A bar whose load is gone in the end: forces of supports are those of the loads, however few steps there are."""
    made, body = _bar(Viscoelastic(30.0, NU, [[0.5, 1.0]]))
    pull = SectionLoad.end(
        made, "end", force=(0.0, 0.0, 0.3), history=[[0, 0], [0.001, 1], [5, 1], [5.001, 0], [10, 0]]
    )
    return Model([body], [Support.end(made, "start")], loads=[pull])


def test_steps_are_as_many_as_their_error_asks_for() -> None:
    few, default, many = (statics.solve(_let_go(), steps, keep=True, end_time=10.0) for steps in (1, None, 32))
    largest = max(np.abs(one.displacement).max() for one in many.path)
    off, left = (np.abs(one.displacement - many.displacement).max() / largest for one in (few, default))
    assert off > 0.01
    assert 0.5 * off < few.steps_error < 4.0 * off
    assert 0.5 * left < default.steps_error < 2.5e-3
    rough = statics.solve(_let_go(), end_time=10.0, steps_tolerance=0.02)
    assert rough.steps_error < 0.02
    assert rough.load_steps < default.load_steps


def _loaded(law):
    made, body = _bar(law)
    load = SectionLoad.end(made, "end", force=(1.0, 0.0, 0.0))
    return Model([body], [Support.end(made, "start")], loads=[load])


PLASTIC = Plastic(E, NU, [[0.0, YIELD]])

test_what_knows_no_memory = refused(
    (lambda: buckling.solve(_loaded(Creep(E, NU, 1e-9, 3.0))), "buckling: Creep flows with time: the load factor"),
    (lambda: buckling.solve(_loaded(Plastic(E, NU, [[0.0, YIELD]], 1.0, 1.0))), "buckling: Plastic recovers"),
    (lambda: statics.solve(_loaded(PLASTIC), stable=True), "stability is unknown with laws that have a memory"),
    (lambda: statics.solve(_loaded(Creep(E, NU, 1e-9, 3.0))), "Creep flows with time; give an end_time"),
)


def test_contact_with_what_flows() -> None:
    made, body = _bar(PLASTIC)
    plane = Contact(0, Plane((0.0, 0.0, 4.001), (0.0, 0.0, -1.0)))
    held = Support.end(made, "start", displacement=(0.0, 0.0, 0.01))
    solution = statics.solve(Model([body], [held], contacts=[plane]))
    assert np.isfinite(solution.displacement).all()


def test_layers_that_flow_between_mean_supports_are_warned_of() -> None:
    """Shares of elastic moduli are not those of the stress: the section gives way, a short bar by 3 %."""
    rod = straight(4.0).sweep(circle(8, 1.0)).with_rings([0.0, 0.5, 1.0])
    made = Space(rod, section_degree=2, elements=1, degree=2)
    body = Body(made, [Plastic(E, NU, [[0.0, YIELD]]), Plastic(E, NU, [[0.0, 10.0 * YIELD]])])
    ends = [MeanSupport.end(made, "start", mean="fixed")]
    ends.append(MeanSupport.end(made, "end", displacement=(0.0, 0.0, 0.01), mean="fixed"))
    with pytest.warns(UserWarning, match="gives way where one of them flows"):
        solution = statics.solve(Model([body], ends), 1)
    # A point lies in one layer: the others have none.
    assert solution.stress(0, 0.5, (0.3, 0.0), "von Mises") == pytest.approx(YIELD, rel=0.01)
    core, shell = solution.state("p", 0, 0.5, [(0.3, 0.0), (0.7, 0.0)]).ravel()
    assert core > 1e-4
    assert shell == 0.0


def _brittle(F_old, F, state, dt, constants):
    growth, inverse = np.log(np.linalg.det(F)), np.linalg.inv(F).T
    return (F - inverse + growth * inverse) / (1.0 if F[2, 2] < 1.5 else 0.0)


@pytest.mark.parametrize(
    ("law", "pull", "said"),
    [
        (
            lambda: Plastic(E, NU, [[0.0, 1e5], [5.0, 1e8]]),
            100.0,
            r"Plastic: stretches beyond 12 .*u = .*: stretches \S+ to 1\d",
        ),
        (
            lambda: UserMaterial(_brittle, 0),
            4.0,
            r"UserMaterial: its local solution does not converge .*: stretches \S+ to 1\.",
        ),
    ],
    ids=["stretch", "routine"],
)
def test_a_law_without_a_stress_is_named_with_its_place(law, pull, said) -> None:
    made, body = _bar(law())
    model = Model([body], [Support.end(made, "start"), Support.end(made, "end", displacement=(0.0, 0.0, pull))])
    with pytest.raises(SolveError, match=said):
        statics.solve(model, 4, end_time=1.0)
