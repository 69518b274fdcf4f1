"""Rotation: centrifugal forces against exact solutions, and the stiffening of what rotates."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import as_array
from models import spinning
from scipy.linalg import eigh
from vibrations import ritz

from isorod import Body, InputError, LinearElastic, Model, NeoHookean, SolveError, Space, Spin, Support, modal, statics
from isorod.assembly.assembler import Assembler
from isorod.scenes.ring import Ring

E, RHO = 200.0, 2.0


def clamped(space):
    return [Support.end(space, "start")]


def standing(space):
    """The start face stays in its plane; two nodes of it on the x axis stay where they are."""
    return [Support.end(space, "start", "z"), Support([0, 2], "xy")]


@pytest.fixture
def bar(cylinder):
    """A bar along z without Poisson's ratio, rotating about a line along x (or ``axis``) at the height ``center``."""

    def make(
        speed, law=NeoHookean, held=clamped, length=5.0, radius=0.3, center=0.0, axis=(1.0, 0.0, 0.0), **refinement
    ):
        rod = cylinder(4, height=length, radius=radius)
        space = Space.paper(rod, **({"elements": 8, "degree": 4} | refinement))
        spin = Spin(tuple(speed * np.array(axis)), (0.0, 0.0, center)) if speed else None
        return Model([Body(space, law(E, 0.0), RHO)], held(space), spin)

    return make


# Exact solutions along the bar


@pytest.mark.parametrize("hub", [0.0, 2.0, -2.5])
@pytest.mark.parametrize("speed", [0.1, 1.0, 2.5])
def test_rotating_linear_bar_stretches_as_its_equation_says(speed, hub, bar):
    """E x'' + rho w^2 x = 0 for the distance x = hub + z + u from the axis of rotation, x(0) = hub, x'(L) = 1."""
    length, radius = 5.0, 0.3
    k = speed * np.sqrt(RHO / E)
    model = bar(speed, LinearElastic, standing, center=-hub)
    solution = statics.solve(model)
    u = np.linspace(0.0, 1.0, 11)
    z = length * u
    slope = (1.0 / k + hub * np.sin(k * length)) / np.cos(k * length)
    exact = hub * np.cos(k * z) + slope * np.sin(k * z) - z - hub
    found, _ = model.bodies[0].space.displacement(model.nodal(solution.displacement), [[0.0, 0.0], [0.3, -0.8]], u)
    # The axis leaves C (k h)^6 or so.
    assert np.abs(found[:, :, 2] - exact[:, None]).max() < 1e-7 * np.abs(exact).max()
    assert np.abs(found[:, 0, :2]).max() < 1e-12 * np.abs(exact).max()
    force = E * np.pi * radius**2 * (k * slope - 1.0)
    assert solution.reactions[0, 2] == pytest.approx(-force, rel=1e-8)


@pytest.mark.parametrize("hub", [0.0, 2.0])
@pytest.mark.parametrize("speed", [0.1, 0.7, 1.0])
def test_rotating_neo_hookean_bar_keeps_its_first_integral(speed, hub, bar):
    """s P(s) - W(s) + rho w^2 x^2 / 2 does not change along the bar; s = 1 at its end; P = mu (s - 1 / s)."""
    model = bar(speed, held=standing, center=-hub, elements=16)
    solution = statics.solve(model)
    u = np.linspace(0.0, 1.0, 21)
    moved, gradient = model.bodies[0].space.displacement(model.nodal(solution.displacement), [[0.0, 0.0]], u)
    s, x, mu = gradient[:, 0, 2, 2], hub + 5.0 * u + moved[:, 0, 2], E / 2
    kinetic = RHO * speed**2 * x**2 / 2
    constant = mu / 2 * (s**2 - 1) + mu * np.log(s) + kinetic
    print("stretch at the root", s[0], "change", np.ptp(constant) / kinetic[-1])
    assert np.ptp(constant) < 1e-6 * kinetic[-1]
    assert s[-1] == pytest.approx(1.0, abs=1e-6)
    assert np.all(np.diff(s) < 0)
    sideways = gradient - np.einsum("tqii->tqi", gradient)[..., None] * np.eye(3)
    assert np.abs(sideways).max() < 1e-10


def test_a_bar_that_rotates_too_fast_has_no_equilibrium(bar):
    """Far beyond the speed at which mu x'' + rho w^2 x = 0 has no solution: w L sqrt(rho / mu) = pi / 2."""
    too_fast = 2.0 * np.pi / 2 / 5.0 * np.sqrt(E / 2 / RHO)
    with pytest.raises(SolveError, match=r"load factor 0\.\d+: .*element \d of body 0"):
        statics.solve(bar(too_fast, held=standing))


def test_spinning_ring_widens_as_a_thin_hoop():
    """u / R = c / (1 - c), c = rho w^2 R^2 / E (it grows into a larger orbit), extrapolated in (thickness / R)^2."""
    speed, found = 1.0, []
    for thickness in (0.2, 0.1, 0.05):
        space = Space.paper(Ring(radius=1.0, a=thickness, b=thickness, section_points=4).rod(), elements=32, degree=5)
        # Layers of the first quadrant's ends, where the axis has its corners, and opposite.
        layer = np.arange(space.layer_nodes)
        quarter = space.layers // 4 * space.layer_nodes
        held = [Support(layer + k * quarter, "yx"[k % 2]) for k in range(4)]
        held.append(Support([0], "z"))
        model = Model([Body(space, LinearElastic(E, 0.0), RHO)], held, Spin((0.0, 0.0, speed)))
        solution = statics.solve(model)
        moved, _ = space.displacement(model.nodal(solution.displacement), [[0.0, 0.0]], np.linspace(0, 4, 13))
        radial = np.linalg.norm(moved[:, 0, :2], axis=1)
        assert np.ptp(radial) < 1e-5 * radial.max()
        assert np.abs(moved[:, 0, 2]).max() < 1e-9 * radial.max()
        found.append(radial.mean() / (RHO * speed**2 / E))
    first = [(4 * fine - coarse) / 3 for coarse, fine in pairwise(found)]
    print(found, first)
    assert first[-1] == pytest.approx(1.0 / (1.0 - RHO * speed**2 / E), rel=1e-5)


# Forces, tangent, load


def test_rotation_softens_the_tangent_by_the_mass():
    """What it adds is -f (|w|^2 1 - w w^T) in each block of the mass matrix, whatever the state."""
    assembler, factor = Assembler(spinning(1.0)), 0.7
    x = assembler.vector()
    x.array[:] = 0.03 * np.random.default_rng(0).uniform(-1, 1, x.getSize())
    without = Assembler(Model(assembler.model.bodies, assembler.model.supports))
    dense = []
    for each in (assembler, without):
        matrix = each.matrix()
        each.tangent(x, factor, matrix)
        dense.append(as_array(matrix))
    space, w = assembler.model.bodies[0].space, np.array(assembler.model.spin.velocity)
    free_body = Assembler(Model([Body(space, NeoHookean(1.0, 0.0), RHO)]))
    mass = as_array(free_body.mass())[::3, ::3]
    unknowns = assembler.model.free >= 0
    expected = factor * np.kron(mass, w @ w * np.eye(3) - np.outer(w, w))[np.ix_(unknowns, unknowns)]
    assert np.abs(dense[1] - dense[0] - expected).max() < 1e-12 * np.abs(dense[1]).max()
    assert np.abs(expected).max() > 1e-6 * np.abs(dense[1]).max()


def test_support_forces_hold_the_whole_body_on_its_orbit():
    """Their sum is what accelerates the body towards the axis of rotation, their moment likewise."""
    model = spinning(0.1)
    solution = statics.solve(model)
    space, spin, w = model.bodies[0].space, model.spin, np.array(model.spin.velocity)
    table = space.tabulate(0, space.axis.elements)
    force, moment = np.zeros(3), np.zeros(3)
    for u, weights in zip(table.u, table.weights, strict=True):
        moved, _ = space.displacement(model.nodal(solution.displacement), table.xi, u)
        place = space.rod.grid(table.xi, u)[0] + moved
        pull = RHO * np.cross(w, np.cross(w, place - np.array(spin.center))) * weights[..., None]
        force += pull.sum(axis=(0, 1))
        moment += np.cross(place, pull).sum(axis=(0, 1))
    assert np.abs(solution.reactions.sum(axis=0) - force).max() < 1e-8 * np.abs(force).max()
    assembler = Assembler(model)
    held = np.zeros(model.dofs)
    held[model.held] = assembler.reactions(assembler.state(solution.displacement), 1.0)
    arm = space.positions + model.nodal(solution.displacement)
    assert np.abs(np.cross(arm, held.reshape(-1, 3)).sum(axis=0) - moment).max() < 1e-8 * np.abs(moment).max()
    at_rest = statics.solve(Model(model.bodies, model.supports))
    assert np.abs(at_rest.reactions.sum(axis=0)).max() < 1e-8 * np.abs(force).max()


def test_a_slow_rotation_is_solved_as_well(bar):
    """Its forces may be below the rounding of the stresses.

    Displacements grow with the square of the speed all the same.
    """
    slow, fast = (statics.solve(bar(speed)).displacement for speed in (1e-6, 1e-3))
    assert np.abs(1e6 * slow - fast).max() < 1e-4 * np.abs(fast).max()


def test_rotation_about_the_bars_own_axis_does_not_stretch_it(bar):
    solution = statics.solve(bar(1.0, LinearElastic, axis=(0.0, 0.0, 1.0)))
    moved = solution.displacement.reshape(-1, 3)
    assert np.abs(moved[:, 2]).max() < 1e-3 * np.abs(moved[:, :2]).max()
    assert np.abs(solution.reactions).max() < 1e-9


def test_sense_of_rotation_does_not_matter(bar):
    one, other = (statics.solve(bar(speed)).displacement for speed in (0.5, -0.5))
    assert np.array_equal(one, other)


@pytest.mark.parametrize(
    ("velocity", "center"),
    [
        ((np.nan, 0, 0), (0, 0, 0)),
        ((0, np.inf, 0), (0, 0, 0)),
        ((1, 0, 0), (0, 0, np.nan)),
        ((1, 0, 0), (-np.inf, 0, 0)),
    ],
)
def test_spin_must_be_finite(velocity, center):
    with pytest.raises(InputError, match=r"spin: (velocity|center): got .*, need finite numbers"):
        Spin(velocity, center)


def test_what_rotates_needs_a_density(cylinder):
    space = Space.paper(cylinder(4))
    bodies = [Body(space, NeoHookean(E, 0.0), RHO), Body(space, NeoHookean(E, 0.0))]
    with pytest.raises(InputError, match="spin: body 1 has no density"):
        Model(bodies, [], Spin((1.0, 0.0, 0.0)))


# Frequencies of rotating beams


def rotating_beam(speed, hub=0.0, count=14):
    """Return omega sqrt(rho A L^4 / E I) of flapping of a clamped Euler-Bernoulli beam, by Ritz with polynomials.

    ``speed`` is in the same unit, ``hub`` the distance of the clamp from the axis of rotation over the length.
    """
    x, w, table = ritz(count, [0.0, 0.0, 1.0])
    value, slope_, bend = (table(k) for k in range(3))
    pull = (1 - x**2) / 2 + hub * (1 - x)
    stiffness = (bend * w) @ bend.T + speed**2 * (slope_ * w * pull) @ slope_.T
    return np.sqrt(eigh(stiffness, (value * w) @ value.T, eigvals_only=True))[:3]


# Wright, Smith, Thresher, Wang, J. Appl. Mech. 49 (1982) 197-202: uniform clamped beam, no hub; first and second
# flapping.
WRIGHT = {
    0: (3.5160, 22.0345),
    1: (3.6816, 22.1810),
    3: (4.7973, 23.3203),
    6: (7.3604, 26.8091),
    12: (13.1702, 37.6031),
}


@pytest.mark.parametrize("speed", WRIGHT)
def test_rotating_beam_is_the_published_one(speed):
    assert rotating_beam(speed)[:2] == pytest.approx(WRIGHT[speed], abs=6e-5)


@pytest.fixture
def spectrum(bar):
    """Frequencies of a rotating bar of given slenderness, unit as in `rotating_beam`.

    Flapping (along x) and lagging (along y).
    """

    def find(slenderness, speed, hub=0.0):
        unit = np.sqrt(E / RHO) / 2 / slenderness**2
        model = bar(speed * unit, length=slenderness, radius=1.0, center=-hub * slenderness)
        modes = modal.solve(model, 4, state=statics.solve(model))
        size = (modes.vectors.reshape(4, -1, 3) ** 2).sum(axis=1)
        flaps = size[:, 0] > size[:, 1]
        omega = 2 * np.pi * modes.frequencies / unit
        assert np.minimum(size[:, 0], size[:, 1]).max() < 1e-12
        assert sorted(flaps) == [False, False, True, True]
        return omega[flaps], omega[~flaps]

    return find


@pytest.mark.parametrize(("speed", "hub"), [(1, 0.0), (3, 0.0), (6, 0.0), (3, 1.0)])
def test_frequencies_of_a_rotating_bar(speed, hub, spectrum):
    """Extrapolated in (R / L)^2 and (R / L)^4 to a slender one.

    In its plane of rotation the bar is softer by speed^2.
    """
    found = np.array([spectrum(slenderness, speed, hub) for slenderness in (20.0, 40.0, 80.0)])
    first = (4 * found[1:] - found[:-1]) / 3
    limit = (16 * first[1] - first[0]) / 15
    exact = rotating_beam(speed, hub)[:2]
    print(limit / [exact, np.sqrt(exact**2 - speed**2)] - 1)
    assert np.all(np.abs(limit[0] / exact - 1.0) < [1e-6, 1e-5])
    assert np.all(np.abs(limit[1] / np.sqrt(exact**2 - speed**2) - 1.0) < [2e-6, 1e-5])
