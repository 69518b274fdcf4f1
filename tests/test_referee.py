"""isorod as a solver of cosseratbench: what of a scenario becomes what, and lines for what it cannot do."""

import json
import tomllib
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from refused import refused

import isorod
from comparisons.referee import equilibrium, laid, motion, rods, touching, twisted

ROOT = Path(__file__).parent.parent
E, RADIUS, LENGTH, DENSITY = 1e6, 0.02, 1.0, 1000.0
BENDING = E * np.pi * RADIUS**4 / 4.0


class Rod(SimpleNamespace):
    """A rod as scenarios have it, with evenly spaced points and a normal across the plane of its curve."""

    def __init__(self, centerline=((0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0)), start="free", end="free", **rest):
        given = {"friction": 0.0, "loads": (), "start_motion": None, "end_motion": None, "normal": (0.0, 1.0, 0.0)}
        given |= {"length": LENGTH, "radius": RADIUS} | rest
        moduli = SimpleNamespace(youngs_modulus=E, shear_modulus=E / 3.0, density=DENSITY)
        ends = {"start": SimpleNamespace(value=start), "end": SimpleNamespace(value=end)}
        super().__init__(centerline=centerline, material=moduli, **ends, **given)

    def nodes(self, count):
        points = np.asarray(self.centerline)
        places = np.linspace(0.0, len(points) - 1.0, count + 1)
        return np.stack([np.interp(places, np.arange(len(points)), points[:, a]) for a in range(3)], axis=1)

    def directors(self, count):
        return np.tile(self.normal, (count, 1))


def scenario(*given, **rest):
    asked = {"gravity": (0.0, 0.0, 0.0), "obstacles": (), "self_contact": False, "quasi_static": True, "duration": 1.0}
    return SimpleNamespace(rods=given, **(asked | rest))


def load(*force):
    return SimpleNamespace(force=force, at=SimpleNamespace(value="end"))


def arc(angle, count=80):
    """Points of an arc of a circle in the plane of x and z, that hangs, of length 1."""
    turn = np.linspace(-0.5 * angle, 0.5 * angle, count + 1)
    points = np.stack([np.sin(turn), 0.0 * turn, -np.cos(turn)], axis=1) / angle
    return points - points[0]


# The law


def test_the_law_has_the_moduli_of_the_rod():
    found = rods.law(SimpleNamespace(youngs_modulus=5.0, shear_modulus=2.0))
    assert (found.E, found.nu, found.mu) == pytest.approx((5.0, 0.25, 2.0))


def test_where_displacements_would_lock_the_shear_modulus_gives_way():
    given = SimpleNamespace(youngs_modulus=3.0, shear_modulus=1.0)
    assert rods.law(given).nu == 0.5
    found = rods.law(given, rods.NEARLY)
    assert found.E == 3.0 and 1.0 < found.mu < 1.01


def test_moduli_that_no_solid_has_are_refused():
    with pytest.raises(NotImplementedError, match=r"^E = 4 and G = 1 make a Poisson's ratio of 1; a solid has one"):
        rods.law(SimpleNamespace(youngs_modulus=4.0, shear_modulus=1.0))


# Places and directions


@pytest.mark.parametrize("touching_too", [False, True])
def test_a_body_starts_along_the_curve_its_sections_square_to_it(touching_too):
    given = Rod(arc(1.5))
    placed = rods.place(given, 12, touching_too)
    model = isorod.Model([placed.body])
    state = isorod.output.state.Deformation(model, placed.initial.ravel())
    nodes, directors = rods.configuration(placed, state, 0, 12)
    assert nodes == pytest.approx(given.nodes(12), abs=1e-4)
    assert directors == pytest.approx(given.directors(12), abs=1e-9)
    # A point of the surface is a radius away from the middle, at right angles to the line.
    u = np.array([0.3, 0.62])
    across = state.position(0, u, (0.0, 1.0)) - state.position(0, u)
    along = state.position(0, u + 1e-4) - state.position(0, u - 1e-4)
    assert np.linalg.norm(across, axis=1) == pytest.approx(RADIUS, rel=1e-3)
    assert np.abs(np.einsum("ua,ua->u", across, along)).max() < 1e-4 * RADIUS * np.linalg.norm(along)


def test_a_stretched_rod_starts_thinner():
    placed = rods.place(Rod(((0.0, 0.0, 0.0), (0.0, 0.0, -1.2)), normal=(0.0, 1.0, 0.0)), 4)
    state = isorod.output.state.Deformation(isorod.Model([placed.body]), placed.initial.ravel())
    assert state.position(0, 1.0)[2] == pytest.approx(-1.2)
    across = state.position(0, 0.5, (1.0, 0.0)) - state.position(0, 0.5)
    assert np.linalg.norm(across) == pytest.approx(RADIUS * 1.2**-rods.NEARLY)


# Equilibria


def test_a_clamp_leaves_the_outline_free():
    """Else the rod would be stiffer near the clamp, by a length of a fifth of its radius."""
    force = 1e-3 * E * np.pi * RADIUS**2
    pulled = Rod(start="clamped", loads=(load(force, 0.0, 0.0),), length=0.1, centerline=((0, 0, 0), (0.1, 0, 0)))
    ((nodes, _),) = equilibrium.solve(scenario(pulled), 4)
    # Neo-Hooke: E strain (1 - strain) for small strain.
    assert nodes[-1, 0] - 0.1 == pytest.approx(1e-4 * 1.001, rel=1e-4)


def test_a_cantilever_bends_as_euler_and_bernoulli_say():
    force = 0.01 * 3.0 * BENDING
    given = Rod(start="clamped", loads=(load(0.0, 0.0, -force),), normal=(0.0, 0.0, 1.0))
    ((nodes, directors),) = equilibrium.solve(scenario(given), 3)
    assert nodes[-1, 2] == pytest.approx(-0.01, rel=1e-3) and nodes[-1, 1] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(np.einsum("ea,ea->e", directors, np.diff(nodes, axis=0))).max() < 1e-12
    assert directors[-1] == pytest.approx([0.015, 0.0, 1.0], abs=2e-3)


def test_a_rope_between_two_pins_sags_and_not_up():
    rope = Rod(arc(2.0), "pinned", "pinned", radius=0.005)
    ((nodes, _),) = equilibrium.solve(scenario(rope, gravity=(0.0, 0.0, -9.81)), 10)
    span = rope.centerline[-1][0]
    # The pin holds the section's mean, which in a bent one is not its centre to the last digit.
    assert nodes[-1] == pytest.approx([span, 0.0, 0.0], abs=1e-7) and np.abs(nodes[:, 1]).max() < 1e-9
    # The catenary of length 1, from sinh(a) / a = 1 / span; stretch adds half a per cent, and bending is small.
    low, high = 1e-6, 10.0
    for _ in range(100):
        a = 0.5 * (low + high)
        low, high = (a, high) if np.sinh(a) / a < 1.0 / span else (low, a)
    assert nodes[:, 2].min() == pytest.approx(-0.5 * span * (np.cosh(a) - 1.0) / a, rel=0.02)


test_equilibria_that_are_not_there_are_refused = refused(
    (Rod(start="pinned"), "an equilibrium of a rod that neither a clamp nor two pins hold"),
    (Rod(arc(1.0), start="clamped"), "a clamp at the start that holds the rod in another direction"),
    (Rod(start="clamped", normal=(1.0, 0.0, 0.0)), "a rod whose normal is along it"),
    by=lambda given: equilibrium.solve(scenario(given), 2),
    error=NotImplementedError,
)


# Motions


def test_a_rope_in_equilibrium_hangs_on():
    strain = DENSITY * 9.81 / E
    s = np.linspace(0.0, 1.0, 101)
    points = np.stack([0.0 * s, 0.0 * s, -(s + strain * (s - 0.5 * s**2))], axis=1)
    given = scenario(Rod(points, "pinned"), gravity=(0.0, 0.0, -9.81), quasi_static=False, duration=0.1)
    given.slowest_frequency = lambda: np.sqrt(9.81)
    (frames,) = motion.solve(given, 3, 3, False, 4.0)
    for nodes, directors in frames:
        # Neo-Hooke is softer than Hooke by the strain, 1 %.
        assert nodes == pytest.approx(frames[0][0], abs=2e-4) and directors == pytest.approx(np.tile([0, 1, 0], (3, 1)))
    assert frames[0][0] == pytest.approx(points[[0, 33, 67, 100]], abs=0.02)
    given.duration, fall = 0.1, np.array([0.0, 0.0, -0.5 * 9.81 * 0.1**2])
    given.rods = (Rod(points),)
    ((start, *_, end),) = motion.solve(given, 3, 2, False, 4.0)
    assert (end[0] - start[0]).mean(axis=0) == pytest.approx(fall, abs=2e-3)


def turning(level, **rest):
    asked = {"times": (0.0, 1.0), "displacement": ((0, 0, 0), (0, 0, 0)), "slides_along": (1.0, 0.0, 0.0)}
    asked |= {"rotation": ((0.0, 0.0, 0.0), (level, 0.0, 0.0)), "axis": np.array([1.0, 0.0, 0.0])}
    return SimpleNamespace(**(asked | rest))


def turned_rod(duration):
    s = np.linspace(0.0, 1.0, 41)
    bent = np.stack([s, 1e-4 * (1.0 - np.cos(2.0 * np.pi * s)), 0.0 * s], axis=1)
    given = Rod(bent, "clamped", "clamped", end_motion=turning(2.0), loads=(load(1e-3 * BENDING, 0.0, 0.0),))
    given.normal = (0.0, 0.0, 1.0)
    asked = scenario(given, duration=duration)
    asked.slowest_frequency = lambda: 0.5
    return asked


def test_a_turned_clamp_twists_the_rod_evenly_and_then_it_stays():
    (frames,) = twisted.solve(turned_rod(1.5), 8, 4, 2.0)
    assert len(frames) == 4
    angles = [np.arctan2(-directors[:, 1], directors[:, 2]) for _, directors in frames]
    middle = (np.arange(8) + 0.5) / 8
    for angle, level in zip(angles, (0.0, 1.0, 2.0, 2.0), strict=True):
        assert angle == pytest.approx(level * middle, abs=5e-3)
    # What was there sideways is there when the clamp stands still.
    assert frames[2][0][4, 1] == pytest.approx(2e-4, rel=0.02)


def test_a_rod_that_strays_far_is_left_there_and_others_go_on(monkeypatch):
    heights = []
    for watched, far in ((20, 0.1), (1, 0.1), (1, 1e-5)):
        monkeypatch.setattr(twisted, "_WATCHED", watched)
        monkeypatch.setattr(twisted, "_FAR", far)
        (frames,) = twisted.solve(turned_rod(1.75), 4, 8, 2.0)
        heights.append([nodes[2, 1] for nodes, _ in frames])
    whole, pieces, left = heights
    assert len(left) == 8 and pieces == pytest.approx(whole, rel=1e-6) and whole[5] != pytest.approx(whole[7], rel=1e-3)
    assert left == pieces[:6] + 2 * [pieces[5]]


test_drives_that_are_not_there_are_refused = refused(
    (turning(1.0, displacement=((0, 0, 0), (0, 0, 1))), "a driven clamp that does not just turn about its rod"),
    (turning(1.0, slides_along=None), "a turning clamp that does not slide along its rod"),
    (None, "a driven end but the second of two clamps"),
    by=lambda given: twisted.solve(scenario(Rod(start="clamped", end="clamped", end_motion=given)), 2, 2, 1.0),
    error=NotImplementedError,
)


# Contact


def obstacle(kind, friction=0.0):
    return SimpleNamespace(
        kind=kind, friction=friction, point=(0, 0, 0), normal=(0, 0, 1), center=(0, 0, 0), axis=(0, 1, 0), radius=0.05
    )


def test_a_rod_touches_itself_where_it_is_asked_for():
    given = scenario(Rod(friction=0.2), self_contact=True)
    placed = [rods.place(given.rods[0], 4, True)]
    (own,) = touching.contacts(given, placed, 4)
    assert own.groups == [(0,)] and own.obstacle is None and own.friction == 0.2
    assert touching.contacts(scenario(Rod()), placed, 4) == []


def test_the_larger_coefficient_of_friction_applies():
    given = scenario(Rod(friction=0.1), Rod(friction=0.2), obstacles=(obstacle("plane", 0.3), obstacle("cylinder")))
    placed = [rods.place(one, 4, True) for one in given.rods]
    assert [one.friction for one in touching.contacts(given, placed, 4)] == [0.2, 0.3, 0.1, 0.3, 0.2]


def test_rods_touch_where_they_start_near_each_other():
    above = Rod(((0.5, -0.5, 0.1), (0.5, 0.5, 0.1)), "pinned", "pinned", normal=(1.0, 0.0, 0.0))
    asked = scenario(Rod(start="pinned", end="pinned"), above, obstacles=(obstacle("plane"),))
    placed = [rods.place(one, 11, True) for one in asked.rods]
    between, first, second = touching.contacts(asked, placed, 11)
    assert (between.first, between.second) == (0, 1) and between.first_elements == [4, 5, 6]
    assert (first.first, second.first) == (0, 1) and isinstance(first.second, isorod.Plane)
    around, along = between.points
    assert LENGTH / 11 / along <= 0.3 * RADIUS and 2 * np.pi * RADIUS / rods.POINTS / around <= 0.3 * RADIUS
    assert touching.pairs(scenario(Rod(), Rod(((0, 0, 1), (1, 0, 1)))), 11) == []


def test_a_pin_of_a_rod_that_touches_is_a_hinge():
    placed = rods.place(Rod(arc(1.0), "pinned", "pinned"), 6, True)
    model = isorod.Model([placed.body], rods.supports(placed, 0))
    # Two points of the circle at each end, all their components; turning about the line through both ends stays.
    assert model.held.size == 12 and model.unknowns == model.dofs - 12
    with pytest.raises(NotImplementedError, match="its normal not across"):
        rods.supports(rods.place(Rod(start="pinned", normal=(0.0, 0.6, 0.8)), 6, True), 0)


def crossed_ropes():
    """One along x, one along y that starts above it."""
    low, high = arc(0.4), arc(0.3)[:, [1, 0, 2]]
    across = high + np.array([0.5 * low[-1, 0], -0.5 * high[-1, 1], 0.01])
    return Rod(low, "pinned", "pinned"), Rod(across, "pinned", "pinned", normal=(1.0, 0.0, 0.0))


@pytest.mark.slow
def test_a_rope_comes_to_rest_on_another():
    """In the middle, a diameter above it but for what both give way; pins hold the means of sections."""
    asked = scenario(*crossed_ropes(), gravity=(0.0, 0.0, -9.81))
    found = [nodes for nodes, _ in laid.solve(asked, 2)]
    alone = [equilibrium.solve(scenario(rope, gravity=asked.gravity), 2)[0][0] for rope in asked.rods]
    for rope, nodes in zip(asked.rods, found, strict=True):
        assert nodes[[0, -1]] == pytest.approx(rope.nodes(1), abs=1e-4)
        assert nodes[::-1, 2] == pytest.approx(nodes[:, 2], abs=1e-5)
    lower, upper = (nodes[1] for nodes in found)
    assert upper - lower == pytest.approx([0.0, 0.0, 2.0 * RADIUS], abs=0.02 * RADIUS)
    assert lower[2] < alone[0][1, 2] - 0.4 * RADIUS and upper[2] > alone[1][1, 2] + 0.6 * RADIUS


@pytest.mark.parametrize(
    "change",
    [
        {"quasi_static": False},
        {"self_contact": True},
        {"gravity": (1.0, 0.0, -9.81)},
        {"obstacles": (obstacle("plane"),)},
    ],
)
def test_other_ropes_in_contact_move(change):
    asked = {"gravity": (0.0, 0.0, -9.81)} | change
    assert laid.takes(scenario(*crossed_ropes(), gravity=(0.0, 0.0, -9.81)), 11)
    assert not laid.takes(scenario(*crossed_ropes(), **asked), 11)
    assert not laid.takes(scenario(Rod(friction=0.1), crossed_ropes()[1], gravity=(0.0, 0.0, -9.81)), 11)


# The package


@pytest.fixture
def solver():
    pytest.importorskip("cosseratbench")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    place, _, name = project["entry-points"]["cosseratbench.solvers"]["isorod"].partition(":")
    return getattr(import_module(place), name)()


def test_the_package_takes_the_solver_and_scores_it(solver):
    from cosseratbench import registry, run
    from cosseratbench.solver import Solver

    assert isinstance(solver, Solver)
    result = run(registry.load_experiment("cantilever"), solver, n_elements=4, n_frames=3)
    assert result.outcome == "completed" and result.metrics["tip_deflection_error"] < 1e-3
    assert json.loads(json.dumps(dict(result.settings)))["solution"] == "statics"
    assert result.trajectory.directors[0].shape == (3, 4, 3)


def test_a_pile_is_unsupported(solver):
    from cosseratbench import registry, run

    result = run(registry.load_experiment("pile"), solver, n_elements=4, n_frames=3)
    line = "a driven end but the second of two clamps"
    assert (result.outcome, result.missing) == ("unsupported", (line,))


def test_what_has_no_solution_is_the_packages_divergence(solver, monkeypatch):
    from cosseratbench import registry, run

    def fail(*_):
        raise isorod.SolveError("load factor 1: no")

    monkeypatch.setattr(equilibrium, "solve", fail)
    result = run(registry.load_experiment("catenary"), solver, n_elements=4, n_frames=3)
    assert (result.outcome, result.failure) == ("diverged", "load factor 1: no")


@pytest.mark.parametrize(("name", "kind"), [("twist", "statics, then implicit steps"), ("pendulum", "implicit steps")])
def test_how_experiments_are_solved_and_with_which_steps(solver, name, kind):
    from cosseratbench import registry

    given = registry.load_experiment(name).scenario
    settings = solver.settings(given, n_elements=10, n_frames=3)
    assert settings["solution"] == kind
    assert type(solver)(2.0).settings(given, n_elements=10, n_frames=3)["time_step"] == 2.0 * settings["time_step"]
    assert (settings["damping_rate"] > 0.0) == given.quasi_static
