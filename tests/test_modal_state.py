"""Vibration modes about an equilibrium: prestress raises and lowers them, to zero at buckling."""

import numpy as np
import pytest
from conftest import as_array
from scipy.linalg import eigh
from vibrations import RHO, E

from isorod import Body, LinearElastic, Model, NeoHookean, Space, Support, modal, statics
from isorod.assembly.assembler import Assembler


@pytest.fixture
def guided(cylinder):
    """A bar of nu = 0, end faces in their planes, its middle on the axis: bending modes cos(m pi z / L), m odd.

    Pulled to the stretch ``s`` its state is u_z = (s - 1) z exactly: without Poisson's ratio the law takes no width
    from it.
    """

    def make(length, stretch=1.0, radius=0.5):
        rod = cylinder(4, height=length, radius=radius)
        space = Space.paper(rod, elements=8, degree=4, continuity=0)
        middle = space.layers // 2 * space.layer_nodes + np.arange(space.layer_nodes)
        ends = [
            Support.end(space, "start", "z"),
            Support.end(space, "end", "z", (0.0, 0.0, (stretch - 1.0) * length)),
            Support(middle, "xy"),
        ]
        return Model([Body(space, NeoHookean(E, 0.0), RHO)], ends)

    return make


def guided_rate(length, stretch, m, radius=0.5):
    """Return omega^2 of u_x = w cos kz, u_z = x f sin kz, stretched: neo-Hookean Timoshenko theory, exact here.

    Tangent moduli of W = mu / 2 (F : F - 2 log J) at diag(1, 1, s): mu (1 + 1 / s^2) along, mu across, mu / s mixed.
    """
    mu, k, inertia = E / 2, m * np.pi / length, radius**2 / 4
    stiffness = [[mu * k * k, -mu * k / stretch], [-mu * k / stretch, mu + inertia * mu * (1 + stretch**-2) * k * k]]
    return eigh(stiffness, RHO * np.diag([1.0, inertia]), eigvals_only=True)[0]


@pytest.mark.parametrize("stretch", [0.999, 1.0, 1.001, 1.02, 1.2, 3.0])
def test_modes_of_a_stretched_bar(stretch, guided):
    model = guided(20.0, stretch)
    state = statics.solve(model)
    z = model.bodies[0].space.positions[:, 2]
    assert np.abs(model.nodal(state.displacement) - np.outer(stretch - 1.0, [0, 0, 1]) * z[:, None]).max() < 1e-9
    modes = modal.solve(model, 12, state=state)
    assert modes.rigid == 0
    # The axis' error grows with m, C (k h)^2p; each mode comes twice.
    for m, tolerance in ((1, 2e-8), (3, 1e-5)):
        exact = guided_rate(20.0, stretch, m)
        assert np.count_nonzero(np.abs(modes.eigenvalues / exact - 1.0) < tolerance) == 2


def critical_stretch(length, radius=0.5):
    """Return the stretch at which `guided_rate` of m = 1 is zero: 1 - pi^2 I / (A L^2) for a slender bar (Euler)."""
    c = (radius * np.pi / length) ** 2 / 4
    return np.sqrt((1 - c) / (1 + c))


def test_the_lowest_frequency_falls_to_zero_at_eulers_load(guided):
    length = 20.0
    critical = critical_stretch(length)
    force = E / 2 * (1.0 / critical - critical)
    assert force == pytest.approx(np.pi**2 * E * 0.5**2 / 4 / length**2, rel=2 * (np.pi * 0.5 / length) ** 2)
    found = []
    for share_ in (0.0, 0.5, 0.9, 0.99, 0.9999):
        model = guided(length, 1.0 - share_ * (1.0 - critical))
        modes = modal.solve(model, 4, state=statics.solve(model))
        found.append(modes.eigenvalues[0])
        assert modes.eigenvalues[1] == pytest.approx(modes.eigenvalues[0], abs=1e-8 * found[0])
    # omega^2 is linear in the load but for the shortening, 0.15 %.
    assert np.array(found) / found[0] == pytest.approx([1.0, 0.5, 0.1, 0.01, 0.0001], rel=3e-3)


@pytest.mark.parametrize("share_", [1.0001, 1.2, 3.9])
def test_beyond_eulers_load_the_frequency_is_negative(share_, guided):
    stretch = 1.0 - share_ * (1.0 - critical_stretch(20.0))
    model = guided(20.0, stretch)
    modes = modal.solve(model, 4, state=statics.solve(model))
    exact = guided_rate(20.0, stretch, 1)
    assert exact < 0
    assert modes.eigenvalues[:2] == pytest.approx(exact, rel=1e-3 if share_ < 1.01 else 1e-6)
    assert modes.eigenvalues[2] > 0
    assert modes.frequencies[:2] == pytest.approx(-np.sqrt(-exact) / (2 * np.pi), rel=1e-3)


def test_all_unstable_modes_are_found(guided):
    """Far beyond Euler's load: many negative eigenvalues, those wanted the farthest from the shift at zero."""
    model = guided(20.0, 0.8)
    state = statics.solve(model)
    assembler = Assembler(model)
    stiffness = assembler.matrix()
    assembler.tangent(assembler.state(state.displacement), 1.0, stiffness)
    exact = eigh(*(as_array(m) for m in (stiffness, assembler.mass())), eigvals_only=True)
    assert np.count_nonzero(exact < 0) > 8
    for count in (1, 3, 6, 9):
        modes = modal.solve(model, count, state=state)
        assert modes.eigenvalues == pytest.approx(exact[:count], rel=1e-8)
        # Twins: of an odd number the last one's is counted too.
        assert modes.below == 2 * ((count + 1) // 2)


def test_an_undeformed_state_changes_nothing(cylinder):
    space = Space.paper(cylinder(4, height=6.0), elements=4)
    model = Model([Body(space, NeoHookean(E, 0.3), RHO)], [Support.end(space, end) for end in ("start", "end")])
    about, rest = modal.solve(model, 5, state=statics.solve(model)), modal.solve(model, 5)
    assert about.eigenvalues == pytest.approx(rest.eigenvalues, rel=1e-12)
    linear = Model([Body(space, LinearElastic(E, 0.3), RHO)], model.supports)
    assert modal.solve(linear, 5).eigenvalues == pytest.approx(rest.eigenvalues, rel=1e-12)
