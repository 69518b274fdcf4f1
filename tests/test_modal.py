"""Vibration modes: free bodies, nothing missed, what comes with every mode, on any number of ranks."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import as_array
from scipy.linalg import eigh
from vibrations import FREE, bars, clamped, matrices, rates, sliding, turning

from isorod import Body, LinearElastic, Model, SolveError, Space, Support, modal
from isorod.assembly.assembler import Assembler
from isorod.checks import rigid_motions
from isorod.modal import analysis
from isorod.modal.pencil import Pencil
from isorod.scenes.blade import Blade


@pytest.fixture
def bar(cylinder):
    """A circular bar along z."""
    return bars(cylinder)


# Free bodies, and the Sturm count


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
    motions = rigid_motions.motions(model.bodies[0].space)
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
    count = Pencil.count_below
    monkeypatch.setattr(Pencil, "count_below", lambda self, value: count(self, value) + error)
    with pytest.raises(SolveError, match=r"modes: \d+ eigenvalues lie at or below [\d.]+, but \d+ converged"):
        modal.solve(bar(6.0, clamped), 4)


@pytest.mark.parametrize("below", range(0, 20, 3))
def test_sturm_count_is_the_number_of_smaller_eigenvalues(below, bar):
    model = bar(6.0, clamped)
    exact = eigh(*matrices(model), eigvals_only=True)
    distinct = np.flatnonzero(np.diff(exact) > 1e-3 * exact[1:])
    assembler = Assembler(model)
    stiffness = assembler.matrix()
    assembler.tangent(assembler.vector(), 0.0, stiffness)
    problem = Pencil(stiffness, assembler.mass_operator(), entries=assembler.mass)
    k = distinct[below]
    assert problem.count_below(0.5 * (exact[k] + exact[k + 1])) == k + 1
    assert problem.count_below(exact[k]) == k + 1


@pytest.mark.parametrize("lumped", [False, True])
def test_the_mass_that_is_counted_with_is_the_one_that_is_multiplied_with(lumped, bar):
    assembler = Assembler(bar(6.0, clamped))
    pencil = analysis._pencil(assembler, lumped, [], turns=False)
    assert pencil.mass.getType() == "seqmaij"
    wanted = as_array(assembler.mass(lumped))
    np.testing.assert_allclose(as_array(pencil.entries()), wanted, atol=1e-15 * wanted.max())


# What comes with every mode


@pytest.mark.parametrize("name", ["clamped", "lumped", "sliding", "free", "blade"])
def test_modes_are_orthonormal_and_their_residuals_are_small(name, bar):
    model = {
        "sliding": lambda: bar(6.0, sliding, n=5),
        "free": lambda: FREE["helix"](bar),
        "blade": lambda: Blade(preset="paper", elements=6).model(),
    }.get(name, lambda: bar(6.0, clamped))()
    modes = modal.solve(model, 9, lumped=name == "lumped")
    stiffness, mass = matrices(model, name == "lumped")
    assert modes.vectors.shape == (modes.frequencies.size, model.dofs)
    assert not modes.vectors[:, model.held].any()
    x, values = modes.vectors[:, model.free >= 0], modes.eigenvalues
    assert np.all(np.diff(values[modes.rigid :]) >= 0) and modes.below >= modes.frequencies.size
    assert rates(modes) ** 2 == pytest.approx(values[modes.rigid :], rel=1e-14)
    assert np.abs(x @ mass @ x.T - np.eye(len(x))).max() < 1e-9
    assert np.abs(x @ stiffness @ x.T - np.diag(values)).max() < 1e-8 * values[-1]
    # Rayleigh's quotients, to the rounding of x^T K x.
    quotients = np.einsum("mi,ij,mj->m", x, stiffness, x) / np.einsum("mi,ij,mj->m", x, mass, x)
    rounding = 2e-16 * np.linalg.norm(stiffness, 2) * np.sum(x * x, axis=1)
    assert np.all(np.abs(quotients - values) < rounding + 1e-12 * np.abs(values))
    assert modes.residuals.max() < 1e-7
    for value, vector, residual in zip(values, x, modes.residuals, strict=True):
        scale = max(abs(value), values[modes.rigid]) * np.linalg.norm(mass @ vector)
        again = np.linalg.norm(stiffness @ vector - value * mass @ vector) / scale
        assert again == pytest.approx(residual, rel=0.5, abs=1e-13 * stiffness.max() * np.linalg.norm(vector) / scale)


def test_prescribed_displacements_do_not_move_a_mode(bar):
    """Supports that are displaced are at rest as far as vibrations about the state of rest go."""
    still = bar(6.0, clamped)
    moved = bar(6.0, lambda space: [Support.end(space, "start", displacement=(1.0, 2.0, 3.0))])
    a, b = modal.solve(still, 4), modal.solve(moved, 4, at_rest=True)
    assert np.array_equal(a.eigenvalues, b.eigenvalues)
    assert not b.vectors[:, moved.held].any()


@pytest.mark.parametrize(("E_", "rho", "size"), [(4.0, 1.0, 1.0), (1.0, 4.0, 1.0), (1.0, 1.0, 4.0), (1e6, 1e-3, 1e-2)])
@pytest.mark.parametrize("free", [True, False])
def test_frequencies_scale_with_wave_speed_over_length(E_, rho, size, free, cylinder):
    def find(E, rho, size):
        space = Space.paper(cylinder(4, height=5.0 * size, radius=size), elements=4, degree=3)
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
        shift[space.is_control_point, a] = 1.0
        exact = name in ("straight", "slender", "order 2", "polynomials")
        assert shift.ravel() @ mass @ shift.ravel() == pytest.approx(expected, rel=1e-12 if exact else 2e-4)


@pytest.mark.parametrize("n", [4, 8])
def test_lumped_mass_of_a_slender_bar_converges_to_the_same_bending(n, bar):
    """First bending frequency, L / R = 200: rotary inertia does not matter, row sums are of second order."""
    errors = []
    for elements in (8, 16, 32):
        model = bar(200.0, clamped, n=n, elements=elements, degree=2)
        errors.append(1.0 - modal.solve(model, 2, lumped=True).frequencies[0] / modal.solve(model, 2).frequencies[0])
    print(errors)
    assert 0 < errors[-1] < 2e-3
    assert all(b < 0.3 * a for a, b in pairwise(errors))


@pytest.mark.parametrize("n", [4, 8])
def test_lumped_mass_stands_on_the_surface(n, bar):
    """At the control points, 1 / cos(pi / n) from the axis, instead of spread: torsion is at cos(pi / n) / sqrt(2)."""
    ratios = []
    for elements in (8, 16, 32):
        model = bar(6.0, lambda space: [Support.end(space, "start")], n=n, elements=elements, degree=2)
        found = [modal.solve(model, 12, lumped=lumped) for lumped in (True, False)]
        lumped, true = (modes.frequencies[turning(modes) > 0.99][0] for modes in found)
        ratios.append(lumped / true)
    limit = np.cos(np.pi / n) / np.sqrt(2)
    assert ratios[-1] == pytest.approx(limit, rel=2e-3)
    assert abs(ratios[-1] - limit) < 0.3 * abs(ratios[-2] - limit)
