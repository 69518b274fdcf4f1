"""Motions of rods of laws with memory: exact damped vibration, balances, steps that are cut, checkpoints, ranks."""

import numpy as np
import pytest
from refused import refused
from scipy.optimize import least_squares

from isorod import Body, InputError, Model, Muscle, Space, Support, circle, dynamics, straight
from isorod.dynamics.explicit.system import System
from isorod.dynamics.implicit import newton
from isorod.material.plastic import Plastic, Viscoplastic
from isorod.material.viscous import Creep, Viscoelastic
from isorod.output import checkpoint

# k c0 tau = 1 of the first torsional mode, k = pi / (2 L), c0 = 1.
LENGTH, SPIN = 10.0, 1e-3
TAU = 2.0 * LENGTH / np.pi
PRONY = Viscoelastic(2.6, 0.3, [[0.5, TAU]])
METAL = Plastic(2.6, 0.3, [[0.0, 2e-4], [0.1, 2e-3]], 0.05)
LAWS = {"plastic": METAL, "prony": PRONY, "creep": Creep(2.6, 0.3, 1e5, 3.0)}
LAWS |= {"recovery": Plastic(2.6, 0.3, [[0.0, 2e-4]], 1.0, 1e3)}
LAWS |= {"viscoplastic": Viscoplastic(2.6, 0.3, [[0.0, 2e-4]], 1.0, 1e3, A=1e-3, n=2.0)}

# Roots of tau s^3 + s^2 + k^2 c0^2 tau s + k^2 cinf^2, and the time tau with which k c0 tau is this.
ROOTS = {1.0: (-0.1761005644 + 0.8607166186j, -0.6477988713), 2.0: (-0.2334115825 + 1.9226595475j, -0.5331768349)}


def bar(*laws, rule="6x2x4", **space) -> Model:
    """Return a bar that turns about its axis, held at one end from time 0 on; half of it of each law."""
    given = {"section_degree": 3, "elements": max(2, len(laws)), "degree": 3, "quadrature": rule} | space
    made = Space(straight(LENGTH).sweep(circle(8, 1.0)), **given)
    body = Body(made, list(laws) if len(laws) > 1 else laws[0], 1.0, spin=(0, 0, SPIN))
    return Model([body], [Support.end(made, "start")])


def _first_mode(times, turns, product):
    """Return the roots, times tau, with which sums of turns at fifths of the length go on in time."""
    x = np.arange(1, 6) / 5
    share = np.where(x < 1.0, 0.4, 0.2) * np.sin(0.5 * np.pi * x)
    found, (root, real) = (turns @ share)[1:], ROOTS[product]
    t = times[1:] / (product * TAU)

    def missed(guess):
        s = complex(guess[0], guess[1])
        parts = np.stack([np.exp(s * t).real, np.exp(s * t).imag, np.exp(guess[2] * t)], axis=1)
        return (parts @ np.linalg.lstsq(parts, found, rcond=None)[0] - found) / np.abs(found).max()

    return least_squares(missed, (root.real, root.imag, real), xtol=1e-14, ftol=1e-14).x


@pytest.mark.parametrize("product", ROOTS)
def test_free_torsional_vibration(product) -> None:
    law = Viscoelastic(2.6, 0.3, [[0.5, product * TAU]])
    model = bar(law, elements=4)
    history = dynamics.solve(model, 40.0, outputs=80)
    along = np.array([0.0, 0.0, 1.0])
    turns = np.array([[one.rotation(0, u, along) for u in (0.2, 0.4, 0.6, 0.8, 1.0)] for one in history])
    found, exact = _first_mode(history.times, turns, product), ROOTS[product][0]
    assert found[0] == pytest.approx(exact.real, rel=1e-3)
    assert found[1] == pytest.approx(exact.imag, rel=2e-4)
    assert np.abs(history.energy_error).max() < 1e-3


@pytest.mark.slow  # a file's own choice of space and steps: half a minute
def test_free_torsional_vibration_of_a_file(command, tmp_path) -> None:
    turns = "".join(f'[measure.a{k}]\nrotation = "bar"\nabout = "z"\nu = {0.2 * k}\n' for k in range(1, 6))
    path = tmp_path / "bar.toml"
    path.write_text(
        "[rod.bar]\ncurve = {straight = 10.0}\nsection = {circle = 1.0}\ndensity = 1.0\nspin = [0, 0, 0.001]\n"
        f"law = {{Viscoelastic = {{E = 2.6, nu = 0.3, prony = [[0.5, {TAU}]]}}}}\n"
        '[support.wall]\nend = "start"\n[analysis.dynamics]\nend_time = 60.0\noutputs = 120\n' + turns
    )
    record = command.record("run", path)
    found = _first_mode(np.array(record["times"]), np.transpose([record[f"a{k}"] for k in range(1, 6)]), 1.0)
    assert found[:2] == pytest.approx([ROOTS[1.0][0].real, ROOTS[1.0][0].imag], rel=1e-4)


@pytest.mark.parametrize("name", LAWS)
def test_what_is_stored_dissipated_and_moves_is_what_there_was(name) -> None:
    model = bar(LAWS[name])
    explicit = dynamics.solve(model, 12.0, outputs=12)
    implicit = dynamics.solve(model, 12.0, 0.2, outputs=12, integrator="implicit")
    slow = name in ("creep", "viscoplastic")
    for history, error in ((explicit, 1e-2 if slow else 1e-3), (implicit, 1e-3 if slow else 1e-7)):
        assert np.abs(history.energy_error).max() < error
        assert np.abs(history.momentum_error).max() < 1e-8
        assert np.diff(history.dissipated).min() > -1e-12 * history.kinetic[0]
        assert history.dissipated[-1] > 0.05 * history.kinetic[0]
    assert implicit.dissipated == pytest.approx(explicit.dissipated, abs=0.01 * explicit.dissipated[-1])


@pytest.mark.parametrize("name", LAWS)
def test_the_balance_of_explicit_steps_is_of_second_order(name) -> None:
    long, short = (dynamics.solve(bar(LAWS[name]), 6.0, step, outputs=2).energy_error[-1] for step in (0.1, 0.05))
    # Steps of viscoplastic flow err by first order themselves.
    assert (2.0 if name == "viscoplastic" else 3.5) < long / short < 4.5


def test_a_muscle_that_grows_active_beside_metal_does_its_own_work() -> None:
    muscle = Muscle(2.6, 0.3, sigma_max=0.02, m1=1.0, m2=0.5, fibre=(0, 0, 1))
    history = dynamics.solve(bar(muscle, METAL), 12.0, outputs=6, ramp=6.0)
    assert np.abs(history.energy_error).max() < 1e-3
    assert history.dissipated[-1] > 0.0


def test_what_flows_at_once_is_before_the_motion() -> None:
    model = bar(METAL)
    pulled = model.bodies[0].space.positions.copy()
    pulled[:, :2] = 0.0
    start = {"displacement": 1e-3 * pulled.ravel(), "velocity": np.zeros(model.dofs)}
    history = dynamics.solve(model, 1.0, 0.02, outputs=2, **start)
    assert np.abs(history.energy_error).max() < 3e-3
    assert history.dissipated[0] == 0.0


def test_forces_that_are_asked_for_leave_the_state() -> None:
    model = bar(METAL, PRONY).in_motion("explicit")
    system = System(model, explicit=True)
    moved = 1e-3 * np.random.default_rng(0).normal(size=model.dofs)
    system.state.displacement[:] = moved
    system.update_states(0.1)
    known = system.states
    assert np.abs(known).max() > 0.0
    first = system.forces(1.1 * moved, 0.0)[0]
    system.critical_step(1.1 * moved, 0.0)
    system.energies(1.1 * moved)
    np.testing.assert_array_equal(system.states, known)
    np.testing.assert_array_equal(system.forces(1.1 * moved, 0.0)[0], first)
    # Read and given back.
    system.update_states(0.1)
    system.set_states(known)
    np.testing.assert_array_equal(system.states, known)
    np.testing.assert_array_equal(system.forces(1.1 * moved, 0.0)[0], first)


def test_a_step_that_is_cut_leaves_no_trace(monkeypatch) -> None:
    model = bar(METAL, PRONY)
    halves = dynamics.solve(model, 1.0, 0.5, outputs=1, integrator="implicit")
    true, asked = newton.Newton.solve, []

    def solve(self, *given):
        asked.append(given)
        found = true(self, *given)
        return None if len(asked) <= 2 else found

    monkeypatch.setattr(newton.Newton, "solve", solve)
    cut = dynamics.solve(model, 1.0, 1.0, outputs=1, integrator="implicit")
    assert cut.cuts == 1
    for name in ("displacement", "dissipated", "stored"):
        assert getattr(cut, name)[-1] == pytest.approx(getattr(halves, name)[-1], rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_a_run_that_was_stopped_goes_on_to_the_last_bit(integrator, tmp_path, monkeypatch) -> None:
    model, file = bar(METAL, PRONY), tmp_path / "state"
    settings = {"time_step": 0.2, "outputs": 6, "integrator": integrator}
    whole = dynamics.solve(model, 3.0, **settings)
    true, count = checkpoint.write, []

    def write(*given):
        true(*given)
        count.append(1)
        if len(count) == 4:
            raise KeyboardInterrupt

    monkeypatch.setattr(checkpoint, "write", write)
    with pytest.raises(KeyboardInterrupt):
        dynamics.solve(model, 3.0, checkpoint=file, every=0.0, **settings)
    again = dynamics.solve(model, 3.0, checkpoint=file, resume=True, **settings)
    assert 0.0 < again.resumed < 3.0
    for name in ("displacement", "velocity", "stored", "dissipated", "energy_error"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name), name)


def _moved(integrator):
    history = dynamics.solve(bar(METAL, PRONY, METAL), 2.0, 0.2, outputs=2, integrator=integrator)
    return np.append(history.displacement[-1] / SPIN, history.dissipated / history.kinetic[0])


def same_as(file):
    """Compare with what one rank has found."""
    for integrator in ("explicit", "implicit"):
        found, kept = _moved(integrator), np.load(file)[integrator]
        assert np.abs(found - kept).max() < 1e-9 * np.abs(kept).max()


@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_ranks_do_not_count(ranks, on_ranks, tmp_path) -> None:
    file = tmp_path / "alone.npz"
    np.savez(file, **{integrator: _moved(integrator) for integrator in ("explicit", "implicit")})
    on_ranks(ranks, f"test_memory_motion.same_as({str(file)!r})")


def test_a_law_does_its_work_between_two_states() -> None:
    rng = np.random.default_rng(1)
    ways = rng.normal(size=(2, 40, 3, 3))
    # Where time counts, that the way is straight in one strain or another one is seen in large strains alone.
    for law, size, error in (
        (Plastic(200e3, 0.3, [[0.0, 400.0], [0.1, 500.0]], 1500.0), 0.02, 1e-10),
        (PRONY, 0.02, 1e-3),
        (PRONY, 2e-4, 1e-5),
    ):
        F, change = np.eye(3) + size * ways[0], size * ways[1]
        known = law.advanced(F, 0.0).lasting(0.3)
        stress, _ = known.discrete(F, change, False)
        after = known.advanced(F + change, 0.0)
        work = np.sum(stress * change, axis=(-2, -1))
        stored = after.lasting(0.0).energy(F + change) - known.lasting(0.0).energy(F)
        lost = after.state[..., -1] - known.state[..., -1]
        assert (lost >= 0.0).all()
        assert work == pytest.approx(stored + lost, abs=error * np.abs(work).max())


def test_other_points_tell_nothing_of_motions() -> None:
    history = dynamics.solve(bar(METAL), 0.5, 0.25, outputs=1)
    for ask in (lambda: history[-1].stress(0, 0.5), lambda: history[-1].state("p", 0, 0.5)):
        with pytest.raises(InputError, match="at quadrature points alone"):
            ask()
    assert history[-1].at(0, 1.0) == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)


class Dumb(Plastic):
    """A law that does not say what it dissipates."""

    states = {"plastic_strain": 6, "p": 2}  # noqa: RUF012


test_what_motions_do_not_take = refused(
    (lambda: dynamics.solve(bar(Dumb(2.6, 0.3, [[0, 1]])), 1.0), "Dumb does not compute its dissipation; use statics"),
)
