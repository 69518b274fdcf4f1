"""Harmonic and random vibrations: closed forms of bars, a direct complex solve, and what is refused."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from isorod import (
    Body,
    EndFace,
    LinearElastic,
    MeanSupport,
    Model,
    NeoHookean,
    Orthotropic,
    SectionLoad,
    Space,
    Spin,
    Support,
    Tie,
    Viscoelastic,
    circle,
    harmonic,
    matrices,
    random,
    statics,
    straight,
)
from isorod.output.stress import von_mises

L, R, E, RHO = 100.0, 2.0, 2.0e5, 8.0e-9
SPEED = np.sqrt(E / RHO)
DAMPINGS = {
    "ratio": {"ratio": 0.02},
    "rayleigh": {"rayleigh": (500.0, 1e-7)},
    "structural": {"structural": 0.03},
}


def bar(law, supports=None, loads=(), **more):
    rod = straight(L).sweep(circle(8, R))
    space = Space(rod, section_degree=more.pop("across", 2), degree=5, elements=5)
    body = Body(space, law, density=RHO)
    held = [Support.end(space, "start")] if supports is None else supports(space)
    return Model([body], held, loads=[make(space) for make in loads], **more)


def tip_of_shaken_bar(omega, damping):
    """Return the tip's displacement relative to a root shaken along the bar with acceleration 1, at ``omega``.

    ``E (1 + i w b + i eta) u'' + (w^2 - i w a) rho u = rho``, ``u(0) = u'(L) = 0``; of ratios the series of modes.
    """
    if "ratio" in damping:
        j = np.arange(2000)[:, None]
        k = (j + 0.5) * np.pi / L
        own = k * SPEED
        at_tip, shaken = (-1.0) ** j, 2.0 / (k * L)
        return -np.sum(at_tip * shaken / (own**2 - omega**2 + 2j * damping["ratio"] * own * omega), axis=0)
    a, b = damping.get("rayleigh", (0.0, 0.0))
    modulus = E * (1.0 + 1j * omega * b + 1j * damping.get("structural", 0.0))
    inertia = omega**2 - 1j * omega * a
    k = np.sqrt(inertia * RHO / modulus)
    return (1.0 - 1.0 / np.cos(k * L)) / inertia


@pytest.mark.parametrize("damping", DAMPINGS)
def test_bar_shaken_at_its_root_is_the_closed_form_over_three_resonances(damping):
    found = harmonic.solve(
        bar(LinearElastic(E=E, nu=0.0)),
        harmonic.Span(200.0, 2.8 * SPEED / (2.0 * L), 100),
        harmonic.Damping(**DAMPINGS[damping]),
        base=(0.0, 0.0, 1.0),
    )
    tip = found.at(0, "end")[:, 2]
    exact = tip_of_shaken_bar(found.omega, DAMPINGS[damping])
    assert (np.abs(found.resonances[:, None] / (np.array([1, 3, 5]) * SPEED / (4 * L)) - 1.0).min(axis=0) < 1e-4).all()
    # As complex numbers; next to zeros of the response over what it is around them.
    assert np.abs(tip / exact - 1.0)[np.abs(exact) > 0.1 * np.median(np.abs(exact))].max() < 1e-3
    assert found.truncation < 1e-3


def test_absolute_acceleration_and_base_displacement_agree_with_base_acceleration():
    model, damping = bar(LinearElastic(E=E, nu=0.0)), harmonic.Damping(ratio=0.05)
    frequencies = [1000.0, 12000.0, 13000.0]
    one = harmonic.solve(model, frequencies, damping, base=(0.0, 0.0, 1.0))
    other = harmonic.solve(model, frequencies, damping, base_displacement=(0.0, 0.0, 1.0))
    accelerations = [found.acceleration(0, "end")[:, 2] for found in (one, other)]
    assert accelerations[1] == pytest.approx(-(one.omega**2) * accelerations[0], rel=1e-9)
    # Far below resonance all of it moves with the root.
    still = harmonic.solve(model, [10.0], damping, base=(0.0, 0.0, 1.0))
    assert np.abs(still.acceleration(0, "end")[0, 2] - 1.0) < 1e-5


def direct(model, found, force, damping, state=None):
    """Return the response by a complex solve of all unknowns, on all degrees of freedom."""
    of = matrices(model, state)
    alpha, beta = damping.rayleigh
    answers = []
    for omega in found.omega:
        system = (1.0 + 1j * (damping.structural + omega * beta)) * of.stiffness + (
            1j * omega * alpha - omega**2
        ) * of.mass
        if of.gyroscopic is not None:
            system = system + 1j * omega * of.gyroscopic
        answers.append(of.expansion @ spsolve(system.tocsc(), of.expansion.T @ force))
    return np.array(answers)


def push(space):
    return SectionLoad.end(space, "end", (1.0, 0.5, 0.2))


@pytest.mark.parametrize("spin", [None, Spin(velocity=(0.0, 300.0, 100.0))])
def test_modes_and_residuals_are_the_direct_complex_solve(spin):
    model = bar(NeoHookean(E=E, nu=0.3), loads=[push], spin=spin)
    damping = harmonic.Damping(rayleigh=(50.0, 1e-6), structural=0.01)
    found = harmonic.solve(model, harmonic.Span(10.0, 3000.0, 8), damping)
    still = found.model
    exact = direct(still, found, model.external, damping, found.modes.equilibrium)
    moved = found.coordinates @ np.array([one.displacement for one in found.ritz])
    assert np.abs(moved - exact).max(axis=1) == pytest.approx(0.0, abs=1e-4 * np.abs(exact).max())
    assert (np.linalg.norm(moved - exact, axis=1) < 1e-3 * np.linalg.norm(exact, axis=1)).all()
    assert (found.ratios > 0.0).all() and len(found) > 8


def test_a_response_about_a_preload_is_at_its_frequencies():
    """A bar pulled along: its bending modes are higher, and so are the peaks of what swings."""
    model = bar(
        NeoHookean(E=E, nu=0.3),
        loads=[lambda space: SectionLoad.end(space, "end", (0.0, 0.0, 2000.0)), push],
    )
    found = harmonic.solve(model, harmonic.Span(100.0, 1000.0, 40), harmonic.Damping(ratio=0.01), loads=[1])
    size = np.abs(found.at(0, "end")[:, 0])
    rest = harmonic.solve(bar(NeoHookean(E=E, nu=0.3), loads=[push]), [100.0], harmonic.Damping(ratio=0.01))
    assert found.resonances[0] > 1.05 * rest.modes.frequencies[0]
    assert found.frequencies[size.argmax()] == pytest.approx(found.resonances[0], rel=1e-3)
    assert found.about == "the equilibrium under 1 load"


def test_torsion_of_a_viscoelastic_bar_is_the_closed_form():
    """``G*(w) = G (1 - sum g / (1 + i w tau))``: the tip turns by ``T tan(k L) / (k G* J)``, ``k^2 = rho w^2 / G*``."""
    nu, (share, time) = 0.3, (0.5, 4e-5)
    law = Viscoelastic(E=E, nu=nu, prony=[[share, time]])
    model = bar(law, loads=[lambda space: SectionLoad.end(space, "end", moment=(0.0, 0.0, 1000.0))])
    found = harmonic.solve(model, harmonic.Span(100.0, 20000.0, 30))
    shear = E / (2.0 * (1.0 + nu)) * (1.0 - share / (1.0 + 1j * found.omega * time))
    k = found.omega * np.sqrt(RHO / shear)
    exact = 1000.0 * np.tan(k * L) / (k * shear * 0.5 * np.pi * R**4)
    turned = found.at(0, "end", (1.0, 0.0))[:, 1] / R
    assert np.abs(turned / exact - 1.0).max() < 1e-3
    # Shear stress at the surface, of the torque T cos(k x) / cos(k L).
    stress = found.stress(0, 0.02, (1.0, 0.0))[:, 1, 2]
    torque = 1000.0 * np.cos(k * 0.02 * L) / np.cos(k * L)
    assert np.abs(stress / (torque * 2.0 / (np.pi * R**3)) - 1.0).max() < 2e-3


def test_a_free_body_moves_as_a_whole_below_its_resonances():
    model = bar(LinearElastic(E=E, nu=0.3), supports=lambda space: [], loads=[push])
    found = harmonic.solve(model, [20.0], harmonic.Damping(structural=0.01))
    mass = RHO * L * model.bodies[0].space.rod.volume() / L
    middle = found.at(0, 0.5)[0]
    assert middle[2] == pytest.approx(-0.2 / (mass * found.omega[0] ** 2), rel=2e-3)
    assert found.modes.rigid == 6


def test_supports_of_mean_motions_and_springs_shake_too():
    """A bar on a soft spring along it: one mass on one spring, shaken at its foot."""

    def supports(space):
        return [
            MeanSupport.spring(space, "start", stiffness=(0.0, 0.0, 10.0)),
            Support.end(space, "start", components="xy"),
            Support.end(space, "end", components="xy"),
        ]

    model = bar(LinearElastic(E=E, nu=0.0), supports=supports)
    mass = RHO * model.bodies[0].space.rod.volume()
    own = np.sqrt(10.0 / mass)
    frequencies, damping = np.array([0.5, 0.99, 1.5]) * own / (2 * np.pi), harmonic.Damping(structural=0.1)
    found = harmonic.solve(model, frequencies, damping, base=(0.0, 0.0, 1.0))
    share = found.omega / own
    exact = -1.0 / (own**2 * (1.0 + 0.1j - share**2))
    assert np.abs(found.at(0, "end")[:, 2] / exact - 1.0).max() < 5e-3


def test_von_mises_stress_of_a_period_is_its_largest_value():
    model = bar(LinearElastic(E=E, nu=0.3), loads=[push])
    found = harmonic.solve(model, [500.0, 2000.0], harmonic.Damping(ratio=0.2))
    u, xi = np.array([0.3]), np.array([[0.6, 0.7]])
    stress = found.stress(0, u, xi)[:, 0, 0]
    phases = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 2001))[:, None, None, None]
    assert found.signed(0, u, xi, "von_mises")[:, 0, 0] == pytest.approx(
        von_mises((phases * stress).real).max(axis=0), rel=1e-5
    )


def test_stress_at_the_root_carries_the_inertia_of_a_shaken_bar():
    model = bar(LinearElastic(E=E, nu=0.0))
    found = harmonic.solve(model, [3000.0, 12400.0], harmonic.Damping(structural=0.04), base=(0.0, 0.0, 1.0))
    k = found.omega * np.sqrt(RHO / (E * (1.0 + 0.04j)))
    exact = -(E * (1.0 + 0.04j)) * k * np.tan(k * L) / found.omega**2 * -1.0
    stress = found.stress(0, 0.0, (0.0, 0.0))[:, 2, 2] * (1.0 + 0.04j)
    assert np.abs(np.abs(stress / exact) - 1.0).max() < 1e-3


def test_random_vibration_is_the_integral_of_the_closed_form():
    damping = {"structural": 0.02}
    model = bar(LinearElastic(E=E, nu=0.0))
    table = [[500.0, 1.0], [10000.0, 4.0], [60000.0, 0.5]]
    found = random.solve(model, table, harmonic.Damping(**damping), base=(0.0, 0.0, 1.0))
    frequencies = np.linspace(500.0, 60000.0, 400_001)
    density = np.exp(np.interp(np.log(frequencies), *np.log(np.transpose(table))))
    square = density * np.abs(tip_of_shaken_bar(2.0 * np.pi * frequencies, damping)) ** 2
    exact = np.sqrt(0.5 * np.sum((square[1:] + square[:-1]) * np.diff(frequencies)))
    assert found.rms(found.at(0, "end")[:, 2]) == pytest.approx(exact, rel=1e-3)


def test_random_von_mises_stress_of_bending_is_that_along_the_rod():
    model = bar(LinearElastic(E=E, nu=0.0), across=3)
    found = random.solve(model, [[10.0, 1.0], [1000.0, 1.0]], harmonic.Damping(ratio=0.02), base=(1.0, 0.0, 0.0))
    u, xi = np.array([0.2]), np.array([[1.0, 0.0]])
    sizes = [found.rms(found.signed(0, u, xi, name))[0, 0] for name in ("von_mises", "along")]
    assert sizes[0] == pytest.approx(sizes[1], rel=1e-3)
    of = found.whole()
    assert of.amplitude(of.stress(0, u, xi), "von_mises", np.empty(0))[0, 0] == pytest.approx(sizes[0], rel=1e-9)


def test_the_estimate_sees_too_few_elements():
    rod = straight(L).sweep(circle(8, R))
    errors = []
    for elements in (2, 6):
        space = Space(rod, section_degree=2, degree=2, elements=elements)
        model = Model([Body(space, LinearElastic(E=E, nu=0.0), density=RHO)], [Support.end(space, "start")])
        found = harmonic.solve(
            model, harmonic.Span(30000.0, 42000.0, 30), harmonic.Damping(ratio=0.02), base=(0, 0, 1.0)
        )
        true = abs(found.resonances[np.abs(found.resonances - 37500.0).argmin()] / (3 * SPEED / (4 * L)) - 1.0)
        with pytest.warns(UserWarning, match="on a flank") if elements == 2 else pytest.warns(UserWarning):
            errors.append((found.estimate(), 2.0 * true))
    for estimate, true in errors:
        assert 0.5 * true < estimate < 3.0 * true


STATIC = {
    "mixed": (lambda: NeoHookean(E=E, nu=0.4999), None),
    "hinged": (
        lambda: NeoHookean(E=E, nu=0.3),
        lambda space: [
            MeanSupport.end(space, "start", "hinge", axis=(0.0, 1.0, 0.0)),
            MeanSupport.spring(space, "end", stiffness=(3.0, 3.0, 3.0)),
        ],
    ),
    "orthotropic": (lambda: Orthotropic(E=(E, 2 * E, 3 * E), nu=(0.2, 0.2, 0.2), G=(E, E, E)), None),
}


@pytest.mark.parametrize("name", STATIC)
def test_at_frequency_zero_it_is_the_static_answer(name):
    law, supports = STATIC[name]
    model = bar(law(), supports=supports, loads=[push], across=3)
    found = harmonic.solve(model, [0.0], harmonic.Damping(ratio=0.01))
    small = bar(
        law(), supports=supports, loads=[lambda space: SectionLoad.end(space, "end", (1e-4, 0.5e-4, 0.2e-4))], across=3
    )
    exact = statics.solve(small)
    at = 0, [0.3, 0.8], [(0.5, 0.4), (0.0, -1.0)]
    assert found.at(*at)[0].real == pytest.approx(1e4 * exact.at(*at), rel=1e-3, abs=1e-6 * np.abs(found.at(*at)).max())
    stresses = found.stress(*at)[0].real, 1e4 * exact.stress(*at)
    assert stresses[0] == pytest.approx(stresses[1], abs=2e-3 * np.abs(stresses[1]).max())


def test_two_bars_welded_on_springs_are_one_bar():
    """Ties, mean clamps and springs to ground are shaken too."""
    found = []
    for lengths in ([0.0, 40.0, 70.0], [0.0, 70.0]):
        rods = [straight(start=(0.0, 0.0, a), end=(0.0, 0.0, b)).sweep(circle(8, R)) for a, b in pairwise(lengths)]
        spaces = [Space(rod, section_degree=3, degree=5, elements=3) for rod in rods]
        last = len(rods) - 1
        supports = [
            MeanSupport.end(spaces[0], "start", "fixed"),
            MeanSupport.spring(spaces[last], "end", stiffness=(100.0, 100.0, 100.0), body=last),
        ]
        bodies = [Body(space, NeoHookean(E=E, nu=0.3), density=RHO) for space in spaces]
        ties = [Tie(slave=EndFace(1, "start"), master=EndFace(0, "end"))] if last else []
        damping = harmonic.Damping(ratio=0.02, rayleigh=(10.0, 1e-6))
        shaken = Model(bodies, supports, ties=ties)
        found.append(harmonic.solve(shaken, [100.0, 1500.0, 6000.0], damping, base=(1.0, 0.0, 0.5)).at(last, "end"))
    assert found[0] == pytest.approx(found[1], rel=2e-3, abs=1e-6 * np.abs(found[1]).max())
