"""Vibration modes: exact solutions of bars and rods, free bodies, prestress, nothing missed, and errors that say what to do."""

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from conftest import as_array
from numpy.polynomial import Legendre
from petsc4py import PETSc
from scipy.linalg import block_diag, eigh
from scipy.optimize import brentq

from isorod import modal, rigid, statics
from isorod.assembly import Assembler
from isorod.errors import InputError, SolveError
from isorod.material import LinearElastic, NeoHookean
from isorod.model import Body, Model, Support
from isorod.scenes.blade import Blade
from isorod.scenes.flower import Flower
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring
from isorod.space import Space

E, RHO = 200.0, 2.0
SPEED = np.sqrt(E / RHO)


def clamped(space):
    return [Support.end(space, "start")]


def sliding(space):
    """End faces that stay in their planes and are free of shear."""
    return [Support.end(space, end, "z") for end in ("start", "end")]


@pytest.fixture
def bar(cylinder):
    """A circular bar along z."""

    def make(length, held=lambda space: [], nu=0.3, radius=1.0, n=4, elements=8, degree=4, density=RHO, **more):
        rod = cylinder(n, height=length, radius=radius)
        space = Space(rod, elements=elements, degree=degree, **more)
        return Model([Body(space, LinearElastic(E, nu), density)], held(space))

    return make


def matrices(model, lumped=False):
    """Return stiffness and mass of the unknowns, dense."""
    assembler = Assembler(model, PETSc.COMM_SELF)
    stiffness = assembler.matrix()
    assembler.tangent(assembler.vector(), 0.0, stiffness)
    return [as_array(matrix) for matrix in (stiffness, assembler.mass(lumped))]


def rates(modes):
    """Return the angular frequencies, rigid modes left out."""
    return 2.0 * np.pi * modes.frequencies[modes.rigid :]


def share(modes, field):
    """Return how much of each mode, rigid ones left out, is in every layer of nodes a multiple of ``field`` (0 to 1)."""
    space = modes.model.bodies[0].space
    moved = modes.vectors[modes.rigid :].reshape(-1, space.layers, 3 * space.layer_nodes)
    field = np.where(space.carries[:, None], field, 0.0).reshape(space.layers, -1)
    field /= np.linalg.norm(field, axis=1)[:, None]
    return (np.einsum("mja,ja->mj", moved, field) ** 2).sum(axis=1) / (moved**2).sum(axis=(1, 2))


def turning(modes):
    """Return the share of each mode that turns sections about z."""
    x, y, z = modes.model.bodies[0].space.positions.T
    return share(modes, np.stack([-y, x, 0 * z], axis=1))


def stretching(modes):
    """Return the share of each mode that moves sections along z."""
    return share(modes, np.array([0.0, 0.0, 1.0]))


def mac(a, b):
    """Return the modal assurance criterion of the rows of two arrays."""
    return (a @ b.T) ** 2 / np.outer((a * a).sum(axis=1), (b * b).sum(axis=1))


# Exact solutions


@pytest.mark.parametrize("n", [3, 4, 8])
def test_torsion_of_a_free_circular_rod(n, bar):
    """f_m = m / 2L sqrt(G / rho), exact in three dimensions: turned sections are in the space, what is left is the axis.

    Splines of degree p on elements of length h have frequencies too high by C (k h)^2p.
    """
    length, nu = 6.0, 0.3
    exact = np.arange(1, 4) / (2 * length) * np.sqrt(E / (2 * (1 + nu)) / RHO)
    errors = []
    for elements in (8, 16, 32):
        modes = modal.solve(bar(length, n=n, degree=3, elements=elements), 12)
        errors.append(modes.frequencies[modes.rigid :][turning(modes) > 0.999][:3] / exact - 1.0)
        assert errors[-1].min() > 0
    errors = np.array(errors)
    print(errors)
    assert errors[-1].max() < 2e-8
    assert np.abs(np.log2(errors[0] / errors[1]) - 6.0).max() < 1.2
    assert np.abs(np.log2(errors[1] / errors[2]) - 6.0).max() < 0.6


# Free-free and cantilever: solutions of cos x cosh x = +1 and -1.
FREE_FREE = [4.7300407, 7.8532046, 10.9956078]
CANTILEVER = [1.8751041, 4.6940911, 7.8547574, 10.9955407]


def test_beta_l_of_the_beams_is_what_their_equations_say():
    for values, sign in ((FREE_FREE, 1.0), (CANTILEVER, -1.0)):
        for value in values:
            exact = brentq(lambda x, sign=sign: np.cos(x) - sign / np.cosh(x), value - 0.1, value + 0.1, xtol=1e-13)
            assert value == pytest.approx(exact, abs=6e-8)


def timoshenko(slenderness, free, count=40):
    """Return the angular frequencies of a bar of radius 1 with nu = 0 by Timoshenko's theory with shear coefficient 1.

    Ritz with polynomials, converged to rounding.  It is what the element of order 1 is made of: without Poisson's ratio, plane
    sections that move and tilt as wholes do not couple with anything else there.
    """
    x, w = np.polynomial.legendre.leggauss(count + 10)
    x, w = 0.5 * (x + 1.0), 0.5 * w * slenderness
    basis = [Legendre.basis(j, domain=[0, 1]) for j in range(count)]
    value, slope = np.array([f(x) for f in basis]), np.array([f.deriv()(x) for f in basis]) / slenderness
    if not free:
        value, slope = value * x, slope * x + value / slenderness
    area, inertia, shear = np.pi, np.pi / 4, E / 2

    def integral(a, b):
        return (a * w) @ b.T

    corner = area * shear * integral(slope, value)
    stiffness = np.block(
        [
            [area * shear * integral(slope, slope), corner],
            [corner.T, E * inertia * integral(slope, slope) + area * shear * integral(value, value)],
        ]
    )
    mass = RHO * block_diag(area * integral(value, value), inertia * integral(value, value))
    return np.sqrt(eigh(stiffness, mass, eigvals_only=True)[2 * free :])


def bending(modes):
    """Return angular frequencies of the bending modes, having made sure that they come in pairs."""
    omega = rates(modes)[(turning(modes) < 1e-6) & (stretching(modes) < 1e-6)]
    omega = omega[: omega.size // 2 * 2].reshape(-1, 2)
    # Rounding: 1e-16 of the largest eigenvalue, 1e8 times the first one of the most slender bar here.
    assert np.abs(omega[:, 1] / omega[:, 0] - 1.0).max() < 1e-8
    return omega[:, 0]


@pytest.mark.parametrize("free", [True, False], ids=["free", "clamped"])
@pytest.mark.parametrize("slenderness", [10.0, 40.0])
def test_bending_without_poisson_is_timoshenkos(slenderness, free, bar):
    """Three modes to the error of the axis, C (k h)^2p with p = 5."""
    model = bar(slenderness, clamped if not free else lambda space: [], nu=0.0, degree=5, elements=16)
    found = bending(modal.solve(model, 12))[:3]
    deviation = found / timoshenko(slenderness, free)[:3] - 1.0
    print(deviation)
    assert np.abs(deviation).max() < 5e-8
    assert np.abs(deviation[0]) < 1e-9


@pytest.mark.parametrize(("free", "exact"), [(True, FREE_FREE), (False, CANTILEVER[:3])], ids=["free", "clamped"])
def test_bending_of_a_slender_bar_is_euler_and_bernoullis(free, exact, bar):
    """beta L extrapolated in (R / L)^2 and (R / L)^4 from three slendernesses; left is C (beta R)^6."""
    found = []
    for slenderness in (20.0, 40.0, 80.0):
        model = bar(slenderness, clamped if not free else lambda space: [], nu=0.0, degree=5, elements=12)
        omega = bending(modal.solve(model, 10))[:3]
        found.append(slenderness * np.sqrt(omega / (SPEED * 0.5)))
    first = [(4 * fine - coarse) / 3 for coarse, fine in pairwise(found)]
    limit = (16 * first[1] - first[0]) / 15
    print(np.array(found) / exact - 1.0, limit / exact - 1.0)
    assert np.all(np.diff(np.array(found), axis=0) > 0)
    assert np.abs(found[0] / exact - 1.0).min() > 1e-3
    assert np.all(np.abs(limit / exact - 1.0) < [1e-6, 1e-5, 5e-5])


def test_poissons_ratio_leaves_the_slender_limit_as_the_section_is_refined(bar):
    """The anticlastic field x^2 - y^2 is harmonic but not among the functions of n points: its error falls with n."""
    stiff = []
    for n in (4, 8, 16, 32):
        modes = modal.solve(bar(200.0, section_points=n, degree=5, elements=6), 2)
        stiff.append((200.0**2 * rates(modes)[0] / (SPEED * 0.5) / FREE_FREE[0] ** 2) ** 2 - 1.0)
    print(stiff)
    # Shear and rotary inertia, (beta R)^2, are left.
    assert -6e-4 < stiff[-1] < 0
    assert stiff[0] > 0.1
    assert all(b - stiff[-1] < 0.05 * (a - stiff[-1]) for a, b in pairwise(stiff[:-1]))


# Pochhammer and Chree: c / sqrt(E / rho) of longitudinal waves in a circular rod of radius 1, nu = 0.3, by k R.
LONGITUDINAL = {0.1: 0.9997746423, 0.5: 0.9941452085, 1.0: 0.9735264429}


def mindlin_herrmann(k, nu=0.3):
    """Return the speed if sections stay plane and widen in proportion to the radius: the element of order 1."""
    shear, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    stiffness = [[4 * (lame + shear) + shear * k * k / 2, 2 * lame * k], [2 * lame * k, (lame + 2 * shear) * k * k]]
    return np.sqrt(eigh(stiffness, RHO * np.diag([0.5, 1.0]), eigvals_only=True)[0]) / k / SPEED


# Order of the element, and its gap to the exact speed at each k R: 1e-10 is the precision of the reference.
GAPS = {1: (8.7e-5, 2.38e-3, 1.242e-2), 2: (2e-10, 6e-7, 4e-5), 3: (2e-10, 2e-10, 1e-8)}


@pytest.mark.parametrize("wave", range(3))
@pytest.mark.parametrize("order", GAPS)
def test_longitudinal_speed_is_pochhammers_and_chrees(order, wave, bar):
    """Ends in their planes, shear-free: k = pi / L is exact.  Order 1 has only u_r = r f(z), u_z = g(z) to offer."""
    k, exact = list(LONGITUDINAL.items())[wave]
    modes = modal.solve(bar(np.pi / k, sliding, degree=5, elements=6, order=order), 8 if k > 0.2 else 24)
    assert modes.rigid == 3
    speeds = rates(modes) / k / SPEED
    speed = speeds[stretching(modes) > 0.1][0]
    print(speed / exact - 1.0)
    assert abs(speed / exact - 1.0) < GAPS[order][wave]
    if order == 1:
        assert speed == pytest.approx(mindlin_herrmann(k), rel=1e-9)
        assert abs(speed / exact - 1.0) > 0.98 * GAPS[1][wave]


def test_ring_in_its_plane_is_rayleighs():
    """omega^2 = E I / (rho A R^4) n^2 (n^2 - 1)^2 / (n^2 + 1), extrapolated to a thin ring; in pairs."""
    found = []
    for thickness in (0.1, 0.05, 0.025):
        space = Space(Ring(radius=1.0, a=thickness, b=thickness, section_points=4).rod(), elements=32, degree=5)
        modes = modal.solve(Model([Body(space, LinearElastic(E, 0.0), RHO)]), 8)
        moved = modes.vectors[modes.rigid :].reshape(-1, space.nodes, 3) ** 2
        flat = rates(modes)[moved[:, :, 2].sum(axis=1) < 1e-3 * moved.sum(axis=(1, 2))][:4].reshape(2, 2)
        assert np.abs(flat[:, 1] / flat[:, 0] - 1.0).max() < 1e-3
        found.append((flat.mean(axis=1) / (SPEED * thickness / 2)) ** 2)
    n = np.array([2, 3])
    exact = n**2 * (n**2 - 1) ** 2 / (n**2 + 1)
    first = [(4 * fine - coarse) / 3 for coarse, fine in pairwise(found)]
    limit = (16 * first[1] - first[0]) / 15
    print(np.array(found) / exact, limit / exact)
    assert np.abs(limit / exact - 1.0).max() < 1e-5


# Free bodies, and the Sturm count


def free_model(rod, **refinement):
    return Model([Body(Space(rod, **refinement), LinearElastic(E, 0.3), RHO)])


FREE = {
    "straight": lambda bar: bar(6.0, degree=3),
    "slender": lambda bar: bar(60.0),
    "order 2": lambda bar: bar(6.0, order=2, elements=4),
    "helix": lambda bar: free_model(Spring(section_points=4).rod(), elements=12, degree=3),
    "slender helix": lambda bar: free_model(Spring(section_points=4, wire_radius=0.1).rod(), elements=24, degree=3),
    "ring": lambda bar: free_model(Ring(section_points=6).rod(), elements=8, degree=3),
    "flower": lambda bar: free_model(Flower().rod(), elements=4, quadrature="full"),
    "blade": lambda bar: Model(Blade(elements=6).model().bodies),
}


@pytest.mark.parametrize("name", FREE)
def test_a_free_body_has_six_rigid_modes_and_all_the_others(name, bar):
    """Against all eigenvalues of the dense matrices; rigid modes are zero to the rounding of the stiffness."""
    model = FREE[name](bar)
    modes = modal.solve(model, 8)
    exact = eigh(*matrices(model), eigvals_only=True)
    rounding = 1e-15 * exact[-1]
    assert (modes.rigid, modes.eigenvalues.size) == (6, 14)
    assert np.abs(modes.eigenvalues[:6]).max() < 10 * rounding
    assert modes.eigenvalues[6] > 100 * rounding
    assert np.abs(modes.eigenvalues[6:] - exact[6:14]).max() < 10 * rounding + 1e-10 * exact[6]
    assert modes.below == np.count_nonzero(exact < exact[13] * (1 + 1e-6))
    assert -modes.eigenvalues[6] < modes.shift < 0
    motions = rigid.motions(model.bodies[0].space)
    for vector in modes.vectors[:6]:
        assert np.linalg.norm(vector - motions @ (motions.T @ vector)) < 1e-6 * np.linalg.norm(vector)
    assert np.linalg.matrix_rank(motions.T @ modes.vectors[:6].T, tol=1e-3) == 6


PARTLY = {
    "one node": (lambda space: [Support([0])], 3),
    "two nodes": (lambda space: [Support([0, space.nodes - 1])], 1),
    "end along z": (lambda space: [Support.end(space, "start", "z")], 3),
    "ends along z": (sliding, 3),
    "ends across": (lambda space: [Support.end(space, end, "xy") for end in ("start", "end")], 1),
    "one component": (lambda space: [Support([0], "x")], 5),
    "end": (clamped, 0),
}


@pytest.mark.parametrize("name", PARTLY)
def test_a_body_partly_held_keeps_the_rigid_modes_it_has(name, bar):
    held, expected = PARTLY[name]
    model = bar(6.0, held)
    modes = modal.solve(model, 6)
    exact = eigh(*matrices(model), eigvals_only=True)
    assert modes.rigid == expected
    assert modes.frequencies.size == 6 + expected
    assert np.abs(modes.eigenvalues - exact[: 6 + expected]).max() < 1e-14 * exact[-1]
    assert modes.eigenvalues[expected] > 1e-3
    assert np.count_nonzero(np.abs(modes.eigenvalues) < 1e-9) == expected


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("held", [clamped, lambda space: []], ids=["clamped", "free"])
def test_equal_bodies_have_every_mode_as_often_as_there_are_bodies(held, count, bar):
    body = bar(6.0).bodies[0]
    supports = [replace(support, body=b) for b in range(count) for support in held(body.space)]
    one = modal.solve(Model([body], held(body.space)), 8)
    many = modal.solve(Model([body] * count, supports), 8 * count)
    assert many.rigid == count * one.rigid
    found = many.eigenvalues[many.rigid :].reshape(-1, count)
    assert np.abs(found / one.eigenvalues[one.rigid :, None] - 1.0).max() < 1e-9


MANY = {
    "straight": FREE["straight"],
    "ring": FREE["ring"],
    "clamped": lambda bar: bar(6.0, clamped),
    "sliding": lambda bar: bar(6.0, sliding),
    "twins": lambda bar: Model([bar(6.0).bodies[0]] * 2),
}


@pytest.mark.parametrize("name", MANY)
def test_no_number_of_modes_misses_or_doubles_one(name, bar):
    """Circular rods have double eigenvalues, free ones a sixfold zero: what a Krylov space sees only once."""
    model = MANY[name](bar)
    exact = eigh(*matrices(model), eigvals_only=True)
    for count in range(1, 25):
        modes = modal.solve(model, count)
        size = count + modes.rigid
        assert modes.eigenvalues.size == size
        assert np.abs(modes.eigenvalues - exact[:size]).max() < 1e-14 * exact[-1] + 1e-10 * exact[size]
        assert np.linalg.matrix_rank(modes.vectors, tol=1e-3 * np.linalg.norm(modes.vectors, 2)) == size
        assert modes.below == np.count_nonzero(exact < exact[size - 1] + 1e-6 * abs(exact[size - 1]) + 1e-9)


@pytest.mark.parametrize("wanted", ["all", "all but one", "half"])
def test_as_many_modes_as_there_are_unknowns(wanted, bar):
    model = bar(6.0, clamped, elements=2, degree=2)
    count = {"all": model.unknowns, "all but one": model.unknowns - 1, "half": model.unknowns // 2}[wanted]
    exact = eigh(*matrices(model), eigvals_only=True)[:count]
    assert modal.solve(model, count).eigenvalues == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("error", [-1, 1, 5])
def test_a_count_that_disagrees_is_refused(error, bar, monkeypatch):
    """More or fewer eigenvalues found than the inertia of K - tau M tells."""
    count = modal._Problem.count_below
    monkeypatch.setattr(modal._Problem, "count_below", lambda self, value: count(self, value) + error)
    with pytest.raises(SolveError, match=r"modes: \d+ eigenvalues lie at or below [\d.]+, but \d+ were found"):
        modal.solve(bar(6.0, clamped), 4)


@pytest.mark.parametrize("below", range(0, 20, 3))
def test_sturm_count_is_the_number_of_smaller_eigenvalues(below, bar):
    model = bar(6.0, clamped)
    exact = eigh(*matrices(model), eigvals_only=True)
    distinct = np.flatnonzero(np.diff(exact) > 1e-3 * exact[1:])
    assembler = Assembler(model)
    stiffness = assembler.matrix()
    assembler.tangent(assembler.vector(), 0.0, stiffness)
    problem = modal._Problem(assembler, False, [])
    assembler.tangent(assembler.vector(), 0.0, problem.stiffness)
    k = distinct[below]
    assert problem.count_below(0.5 * (exact[k] + exact[k + 1])) == k + 1
    assert problem.count_below(exact[k]) == k + 1


# What comes with every mode


@pytest.fixture(params=["clamped", "lumped", "sliding", "free", "blade"])
def solved(request, bar):
    """Modes, and the dense matrices."""
    lumped = request.param == "lumped"
    model = {
        "sliding": lambda: bar(6.0, sliding, n=5),
        "free": lambda: FREE["helix"](bar),
        "blade": lambda: Blade(elements=6).model(),
    }.get(request.param, lambda: bar(6.0, clamped))()
    return modal.solve(model, 9, lumped=lumped), *matrices(model, lumped)


def test_modes_are_orthonormal_with_the_mass(solved):
    modes, stiffness, mass = solved
    x = modes.vectors[:, modes.model.free >= 0]
    assert np.abs(x @ mass @ x.T - np.eye(len(x))).max() < 1e-9
    scale = modes.eigenvalues[-1]
    assert np.abs(x @ stiffness @ x.T - np.diag(modes.eigenvalues)).max() < 1e-8 * scale


def test_residuals_are_those_of_the_modes_and_small(solved):
    modes, stiffness, mass = solved
    assert modes.residuals.max() < 1e-7
    for value, vector, residual in zip(modes.eigenvalues, modes.vectors, modes.residuals, strict=True):
        x = vector[modes.model.free >= 0]
        scale = max(abs(value), modes.eigenvalues[modes.rigid]) * np.linalg.norm(mass @ x)
        again = np.linalg.norm(stiffness @ x - value * mass @ x) / scale
        assert again == pytest.approx(residual, rel=0.5, abs=1e-13 * stiffness.max() * np.linalg.norm(x) / scale)


def test_rayleigh_quotients_are_the_eigenvalues(solved):
    """To the rounding of x^T K x."""
    modes, stiffness, mass = solved
    x = modes.vectors[:, modes.model.free >= 0]
    quotients = np.einsum("mi,ij,mj->m", x, stiffness, x) / np.einsum("mi,ij,mj->m", x, mass, x)
    rounding = 2e-16 * np.linalg.norm(stiffness, 2) * np.sum(x * x, axis=1)
    assert np.all(np.abs(quotients - modes.eigenvalues) < rounding + 1e-12 * np.abs(modes.eigenvalues))


def test_held_degrees_of_freedom_do_not_move(solved):
    modes = solved[0]
    assert modes.vectors.shape == (modes.frequencies.size, modes.model.dofs)
    assert not modes.vectors[:, modes.model.held].any()


def test_modes_ascend_and_frequencies_are_cycles(solved):
    modes = solved[0]
    assert np.all(np.diff(modes.eigenvalues[modes.rigid :]) >= 0)
    assert rates(modes) ** 2 == pytest.approx(modes.eigenvalues[modes.rigid :], rel=1e-14)
    assert modes.below >= modes.frequencies.size


def test_prescribed_displacements_do_not_move_a_mode(bar):
    """Supports that are displaced are at rest as far as vibrations about the state of rest go."""
    still = bar(6.0, clamped)
    moved = bar(6.0, lambda space: [Support.end(space, "start", displacement=(1.0, 2.0, 3.0))])
    a, b = modal.solve(still, 4), modal.solve(moved, 4)
    assert np.array_equal(a.eigenvalues, b.eigenvalues)
    assert not b.vectors[:, moved.held].any()


@pytest.mark.parametrize(("E_", "rho", "size"), [(4.0, 1.0, 1.0), (1.0, 4.0, 1.0), (1.0, 1.0, 4.0), (1e6, 1e-3, 1e-2)])
@pytest.mark.parametrize("free", [True, False])
def test_frequencies_scale_with_wave_speed_over_length(E_, rho, size, free, cylinder):
    def find(E, rho, size):
        space = Space(cylinder(4, height=5.0 * size, radius=size), elements=4, degree=3)
        model = Model([Body(space, LinearElastic(E, 0.3), rho)], [] if free else clamped(space))
        return rates(modal.solve(model, 6))

    assert find(E_, rho, size) / find(1.0, 1.0, 1.0) == pytest.approx(np.sqrt(E_ / rho) / size, rel=1e-9)


@pytest.mark.parametrize("name", FREE)
@pytest.mark.parametrize("lumped", [False, True])
def test_total_mass_is_density_times_volume(name, lumped, bar):
    """By the three translations: rods of polynomial sections and the ring exactly, others to their rule."""
    model = FREE[name](bar)
    space = model.bodies[0].space
    _, mass = matrices(model, lumped)
    expected = model.bodies[0].density * space.rod.volume()
    for a in range(3):
        shift = np.zeros((space.nodes, 3))
        shift[space.carries, a] = 1.0
        exact = name in ("straight", "slender", "order 2")
        assert shift.ravel() @ mass @ shift.ravel() == pytest.approx(expected, rel=1e-12 if exact else 2e-4)


def test_mode_shapes_converge(bar):
    """MAC of the first eight on a grid, doubles turned into each other's plane."""
    xi, u = np.array([[0.0, 0.0], [0.7, 0.0], [0.0, 0.7]]), np.linspace(0.0, 1.0, 15)

    def shapes(**fields):
        model = bar(12.0, clamped, **fields)
        space = model.bodies[0].space
        modes = modal.solve(model, 8)
        return modes.eigenvalues, np.array(
            [space.displacement(model.nodal(vector), xi, u)[0].ravel() for vector in modes.vectors]
        )

    (values, coarse), (_, fine) = shapes(elements=6, degree=3), shapes(elements=24, degree=3)
    groups = np.split(np.arange(8), np.flatnonzero(np.diff(values) > 1e-6 * values[1:]) + 1)
    assert sorted(map(len, groups)) in ([1, 1, 2, 2, 2], [1, 1, 1, 1, 2, 2], [1, 1, 1, 2, 2])
    for group in groups[:-1]:
        fit, *_ = np.linalg.lstsq(fine[group].T, coarse[group].T, rcond=None)
        assert np.diag(mac(coarse[group], (fine[group].T @ fit).T)).min() > 0.99999


@pytest.mark.parametrize("n", [4, 8])
def test_lumped_mass_of_a_slender_bar_converges_to_the_same_bending(n, bar):
    """First bending frequency, L / R = 200: rotary inertia does not matter, the axis' row sums converge at second order."""
    errors = []
    for elements in (8, 16, 32):
        model = bar(200.0, clamped, n=n, elements=elements, degree=2)
        errors.append(1.0 - modal.solve(model, 2, lumped=True).frequencies[0] / modal.solve(model, 2).frequencies[0])
    print(errors)
    assert 0 < errors[-1] < 2e-3
    assert all(b < 0.3 * a for a, b in pairwise(errors))


@pytest.mark.parametrize("n", [4, 8])
def test_lumped_mass_stands_on_the_surface(n, bar):
    """At the control points, 1 / cos(pi / n) from the axis instead of spread: torsion comes at cos(pi / n) / sqrt(2)."""
    ratios = []
    for elements in (8, 16, 32):
        model = bar(6.0, lambda space: [Support.end(space, "start")], n=n, elements=elements, degree=2)
        found = [modal.solve(model, 12, lumped=lumped) for lumped in (True, False)]
        lumped, true = (modes.frequencies[turning(modes) > 0.99][0] for modes in found)
        ratios.append(lumped / true)
    limit = np.cos(np.pi / n) / np.sqrt(2)
    assert ratios[-1] == pytest.approx(limit, rel=2e-3)
    assert abs(ratios[-1] - limit) < 0.3 * abs(ratios[-2] - limit)


# Prestress


@pytest.fixture
def guided(cylinder):
    """A bar of nu = 0 whose end faces stay in their planes, its middle on the axis: bending modes cos(m pi z / L), m odd.

    Pulled to the stretch ``s`` its state is u_z = (s - 1) z exactly: without Poisson's ratio the law takes no width from it.
    """

    def make(length, stretch=1.0, radius=0.5):
        rod = cylinder(4, height=length, radius=radius)
        space = Space(rod, elements=8, degree=4, continuity=0)
        middle = space.layers // 2 * space.layer_nodes + np.arange(space.layer_nodes)
        ends = [
            Support.end(space, "start", "z"),
            Support.end(space, "end", "z", (0.0, 0.0, (stretch - 1.0) * length)),
            Support(middle, "xy"),
        ]
        return Model([Body(space, NeoHookean(E, 0.0), RHO)], ends)

    return make


def guided_rate(length, stretch, m, radius=0.5):
    """Return omega^2 of u_x = w cos kz, u_z = x f sin kz on the stretched bar: neo-Hookean Timoshenko theory, exact here.

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


@pytest.mark.parametrize("length", [20.0, 80.0])
def test_tension_raises_bending_as_that_of_a_string(length, guided):
    """omega^2 = omega_0^2 + T k^2 / (rho A) per current length, short of rotary inertia and shear: (k R)^2 of it."""
    stretch = 1.05
    model = guided(length, stretch)
    first = modal.solve(model, 4, state=statics.solve(model)).eigenvalues[0]
    k, inertia = np.pi / length, 0.5**2 / 4
    tension = E / 2 * (stretch - 1.0 / stretch)
    string = tension * k**2 / (RHO * stretch)
    beam = E / 2 * (1 + stretch**-2) * inertia * k**4 / RHO / stretch**2
    assert first == pytest.approx(string + beam, rel=(k * 0.5) ** 2)
    assert string > 10 * beam


def critical_stretch(length, radius=0.5):
    """Return the stretch at which `guided_rate` of m = 1 is zero; 1 - it is Euler's pi^2 I / (A L^2) for a slender bar."""
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
    """Far beyond Euler's load: several negative eigenvalues, far from the shift at zero."""
    model = guided(20.0, 0.8)
    state = statics.solve(model)
    assembler = Assembler(model)
    stiffness = assembler.matrix()
    assembler.tangent(assembler.state(state.displacement), 1.0, stiffness)
    exact = eigh(*(as_array(m) for m in (stiffness, assembler.mass())), eigvals_only=True)
    assert np.count_nonzero(exact < 0) > 8
    for count in (1, 3, 6):
        try:
            modes = modal.solve(model, count, state=state)
        except SolveError as problem:
            assert re.search(r"eigenvalues lie at or below .*-st_shift", str(problem))
        else:
            assert modes.eigenvalues == pytest.approx(exact[:count], rel=1e-8)


def test_an_undeformed_state_changes_nothing(cylinder):
    space = Space(cylinder(4, height=6.0), elements=4)
    model = Model([Body(space, NeoHookean(E, 0.3), RHO)], [Support.end(space, end) for end in ("start", "end")])
    about, rest = modal.solve(model, 5, state=statics.solve(model)), modal.solve(model, 5)
    assert about.eigenvalues == pytest.approx(rest.eigenvalues, rel=1e-12)
    linear = Model([Body(space, LinearElastic(E, 0.3), RHO)], model.supports)
    assert modal.solve(linear, 5).eigenvalues == pytest.approx(rest.eigenvalues, rel=1e-12)


def test_modes_are_the_curvature_of_the_energy_about_a_bent_state():
    """Along each mode of a pulled spring the stored energy bends up by its eigenvalue: no mode of rest would do."""
    spring = Spring(coils=1, section_points=4, pull=3.0, elements_per_turn=4)
    rest = spring.model()
    model = Model([replace(rest.bodies[0], density=RHO)], rest.supports)
    state = statics.solve(model)
    modes = modal.solve(model, 4, state=state)
    assembler = Assembler(model)
    for value, vector in zip(modes.eigenvalues, modes.vectors, strict=True):
        step = 1e-3 / np.abs(vector).max()
        energies = [assembler.energy(assembler.state(state.displacement + k * step * vector), 1.0) for k in (-1, 0, 1)]
        assert (energies[0] - 2 * energies[1] + energies[2]) / step**2 == pytest.approx(value, rel=1e-4)
    at_rest = modal.solve(model, 4)
    assert np.abs(modes.eigenvalues / at_rest.eigenvalues - 1.0).max() > 0.01


# Errors


def test_bodies_need_a_density(bar):
    good = bar(6.0, clamped)
    massless = Model([*good.bodies, replace(good.bodies[0], density=0.0)], good.supports)
    with pytest.raises(InputError, match="density of body 1: got 0, modes need a positive mass per volume"):
        modal.solve(massless)
    for density in (-1.0, np.nan, np.inf):
        with pytest.raises(InputError, match=f"density: got {density:g}, need a finite mass per volume"):
            replace(good.bodies[0], density=density)


@pytest.mark.parametrize("modes", [0, -1, 133, 10**9])
def test_number_of_modes_must_be_there(modes, bar):
    with pytest.raises(InputError, match=rf"modes: got {modes}, need 1 to 132 \(the unknowns there are\)"):
        modal.solve(bar(6.0, clamped), modes)


def test_rigid_modes_come_on_top_of_those_asked_for(bar):
    model = bar(6.0)
    with pytest.raises(InputError, match=f"need 1 to {model.unknowns - 6}"):
        modal.solve(model, model.unknowns - 5)


def test_a_model_held_everywhere_has_no_modes(bar):
    model = bar(6.0, lambda space: [Support(np.arange(space.nodes))])
    with pytest.raises(InputError, match=r"modes: got 1, .*unknowns"):
        modal.solve(model, 1)


def test_an_unconverged_solver_is_refused_with_what_to_do(bar, petsc_options):
    petsc_options(eps_max_it=1, eps_ncv=9)
    with pytest.raises(SolveError, match=r"modes: SLEPc found \d of 6 in 1 iterations .*raise -eps_max_it or -eps_ncv"):
        modal.solve(bar(6.0, clamped), 6)


FACTORS = [{}, {"st_pc_type": "cholesky", "st_pc_factor_mat_solver_type": "mumps"}]


@pytest.mark.parametrize("factors", FACTORS, ids=["default", "mumps"])
@pytest.mark.parametrize("name", ["straight", "ring", "helix"])
def test_a_singular_pencil_does_no_harm(name, factors, bar, petsc_options):
    """The shift that a user forces upon a free body is one of its eigenvalues, zero: its own direction blows up, no other."""
    model = FREE[name](bar)
    expected = modal.solve(model, 4).eigenvalues
    petsc_options(st_shift=0.0, **factors)
    found = modal.solve(model, 4).eigenvalues
    # What is factorised is singular but for rounding (eps), which leaves errors of about eps^(1/2) = 1.5e-8, -eps_tol 1e-12 or not.
    assert found[6:] == pytest.approx(expected[6:], rel=1e-7)
    assert np.abs(found[:6]).max() < 1e-8 * found[6]


@pytest.mark.parametrize("factors", FACTORS, ids=["default", "mumps"])
@pytest.mark.parametrize("mode", [0, 2, 5])
def test_a_shift_at_an_eigenvalue_does_no_harm(mode, factors, bar, petsc_options):
    model = bar(6.0, clamped)
    expected = modal.solve(model, 6).eigenvalues
    petsc_options(st_shift=repr(float(expected[mode])), **factors)
    assert modal.solve(model, 6).eigenvalues == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("mode", [0, 2, 5])
def test_a_shift_at_an_eigenvalue_is_refused_where_vectors_are_purified(mode, bar, petsc_options):
    """One more solve with the singular matrix turns all vectors into the same one."""
    model = bar(6.0, clamped)
    petsc_options(st_shift=repr(float(modal.solve(model, 6).eigenvalues[mode])), eps_purify=1)
    with pytest.raises(SolveError, match=r"the residual of mode \d+ is .*shift lies on an eigenvalue"):
        modal.solve(model, 6)


@pytest.mark.parametrize("shift", [-1e-3, -1.0, 3.0, 20.0])
def test_any_other_shift_gives_the_same_modes_or_says_which_it_missed(shift, bar, petsc_options):
    model = FREE["straight"](bar)
    expected = modal.solve(model, 6).eigenvalues
    petsc_options(st_shift=shift)
    try:
        found = modal.solve(model, 6).eigenvalues
    except SolveError as problem:
        assert re.search(r"eigenvalues lie at or below .*but \d+ were found.*-st_shift", str(problem))
        assert shift > 0
    else:
        assert np.abs(found - expected).max() < 1e-9 * expected[6]


def test_modes_about_a_state_of_a_linear_body_are_refused(bar):
    """Its tangent knows no stress."""
    model = bar(6.0, lambda space: [Support.end(space, "start"), Support.end(space, "end", "xyz", (0.0, 0.0, 0.1))])
    with pytest.raises(InputError, match="body 0 is linear elastic"):
        modal.solve(model, 2, state=statics.solve(model))


def test_a_failed_solve_leaves_no_options(bar, petsc_options):
    before = PETSc.Options().getAll()
    with pytest.raises(SolveError):
        petsc_options(eps_max_it=1, eps_ncv=9)
        modal.solve(bar(6.0, clamped), 6)
    assert {name for name in PETSc.Options().getAll() if name not in before} == {"eps_max_it", "eps_ncv"}


def test_record_of_the_run(bar):
    modes = modal.solve(bar(6.0, clamped), 3)
    assert modes.built == ["tangent", "mass"]
    assert modes.solver["eps"] == "krylovschur"
    assert (modes.solver["st"], modes.solver["ksp"]) == ("sinvert", "preonly")
    assert {"assembly", "setup", "solve"} <= set(modes.seconds)
    assert min(modes.seconds.values()) > 0
    assert (modes.ranks, modes.shift) == (1, 0.0)
    assert modes.iterations >= 1
    assert modal.solve(bar(6.0, clamped), 3, lumped=True).built == ["tangent", "lumped mass"]


@pytest.mark.parametrize("kind", ["lobpcg", "gd", "jd", "rqcg"])
@pytest.mark.parametrize("held", [clamped, lambda space: []], ids=["clamped", "free"])
def test_preconditioned_eigensolvers_agree(kind, held, bar, petsc_options):
    model = bar(6.0, held, elements=6)
    expected = modal.solve(model, 5)
    petsc_options(eps_type=kind)
    found = modal.solve(model, 5)
    assert found.solver["eps"] == kind
    assert np.abs(found.eigenvalues - expected.eigenvalues).max() < 1e-6 * expected.eigenvalues[expected.rigid]


# Ranks


def record(path):
    """Save what the ranks find together (called under mpirun)."""
    space = Space(Spring(section_points=4, coils=1).rod(), elements=4, degree=3)
    free = Model([Body(space, LinearElastic(E, 0.3), RHO)])
    pulled = Model(
        [Body(space, NeoHookean(E, 0.3), RHO)],
        [Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, 1.0))],
    )
    found = {}
    for name, modes in (
        ("free", modal.solve(free, 8)),
        ("two", modal.solve(Model([*free.bodies, *free.bodies], clamped(space)), 6)),
        ("pulled", modal.solve(pulled, 6, state=statics.solve(pulled))),
    ):
        assert modes.ranks == PETSc.COMM_WORLD.getSize()
        found |= {f"{name} eigenvalues": modes.eigenvalues, f"{name} rigid": modes.rigid, f"{name} below": modes.below}
        found[f"{name} vectors"] = modes.vectors
    if PETSc.COMM_WORLD.getRank() == 0:
        np.savez(path, **found)


@pytest.fixture(scope="module")
def on_one_rank(tmp_path_factory):
    path = tmp_path_factory.mktemp("ranks") / "1.npz"
    record(path)
    return np.load(path)


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3, pytest.param(5, marks=pytest.mark.slow)])
def test_modes_do_not_depend_on_the_number_of_ranks(ranks, on_one_rank, mpirun, tmp_path):
    """Five ranks are more than the elements."""
    path = tmp_path / "ranks.npz"
    script = (
        f"import sys; sys.path[:0] = [{str(Path(__file__).parent)!r}]; import test_modal as t; t.record(sys.argv[1])"
    )
    done = mpirun(ranks, str(path), script=script)
    assert done.returncode == 0, done.stderr
    found = np.load(path)
    for name in ("free", "two", "pulled"):
        count = int(on_one_rank[f"{name} rigid"])
        assert found[f"{name} rigid"] == count
        assert found[f"{name} below"] == on_one_rank[f"{name} below"]
        a, b = (data[f"{name} eigenvalues"] for data in (found, on_one_rank))
        assert np.abs(a - b).max() < 1e-9 * np.abs(b[count])
    # Single modes have the same shape, sign included.
    values = on_one_rank["pulled eigenvalues"]
    assert np.diff(values).min() > 1e-3 * values[0]
    a, b = (data["pulled vectors"] for data in (found, on_one_rank))
    assert np.abs(a - b).max() < 1e-6 * np.abs(b).max()
