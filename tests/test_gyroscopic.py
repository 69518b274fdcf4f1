"""Modes with Coriolis forces: SciPy's dense solution, whirling shafts by Timoshenko's theory, blades in their plane."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import eigh
from test_modal_loaded import ROD, solved
from vibrations import quadratic, ritz

from isorod import InputError, NeoHookean, Space, circle, files, modal, statics, straight
from isorod.command.cli import main
from isorod.model import Body, Model, SectionLoad, Spin, Support
from isorod.scenes.spring import Spring

HELD = '[support.end]\nend = "end"\n'
SPIN = "[spin]\nvelocity = [{x}, 0.0, {z}]\n"
SHAFT = {"length": 1.0, "radius": 0.03, "E": 1.0, "nu": 0.0, "density": 1.0}


@pytest.fixture
def scene(tmp_path):
    def make(text, x=0.0, z=0.0, **changes):
        path = tmp_path / "scene.toml"
        path.write_text(text.format(x=x, z=z, **{"modes": 4} | changes))
        return files.find(str(path))

    return make


# The solver


def askew():
    """A clamped spring, pulled, that turns about a line askew to everything; its end is tied across."""
    space = Space.paper(Spring(helix="paper", coils=1, section_points=4).rod(), elements=4, order=2)
    supports = [Support.end(space, "start"), Support.end(space, "end", "z", (0.0, 0.0, 1.0), tied="x")]
    spin = Spin((0.06, -0.08, 0.2), (1.0, 2.0, -3.0))
    body, load = Body(space, NeoHookean(5e3, 0.3), 2.0), SectionLoad((0.0, 0.1, 0.0))
    return Model([body], supports, spin, loads=[load])


def coriolis_by_points(model):
    """Return ``2 int rho N^T [w] N`` over all degrees of freedom, from points one by one."""
    body, w = model.bodies[0], np.array(model.spin.velocity)
    space, table = body.space, body.space.tabulate(0, body.space.axis.elements)
    functions, weights = [], []
    for u, weight in zip(table.u, table.weights, strict=True):
        units = np.eye(space.nodes)[:, :, None] * np.array([1.0, 0.0, 0.0])
        functions.append(np.stack([space.displacement(one, table.xi, u)[0][..., 0].ravel() for one in units], axis=1))
        weights.append(weight.ravel())
    N, weight = np.concatenate(functions), np.concatenate(weights)
    cross = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    return np.kron(2.0 * np.asarray(body.density) * N.T @ (weight[:, None] * N), cross)


@pytest.mark.parametrize("lumped", [False, True])
def test_it_is_the_dense_solution(lumped):
    model = askew()
    modes = modal.solve(model, 8, lumped)
    found = modes.matrices()
    K, M, G, E = (one.toarray() for one in (found.stiffness, found.mass, found.gyroscopic, found.expansion))
    assert np.abs(G + G.T).max() < 1e-14 * np.abs(G).max()
    if not lumped:
        expected = E.T @ coriolis_by_points(model) @ E
        assert np.abs(G - expected).max() < 1e-10 * np.abs(G).max()
    rates = quadratic(K, G, M)
    exact = np.sort(rates.imag[rates.imag > 0.0])[:8]
    assert 2.0 * np.pi * modes.frequencies == pytest.approx(exact, rel=1e-7)
    assert modes.below == 8 and modes.falling == 0
    # Without Coriolis forces they are others.
    assert np.abs(np.sqrt(eigh(K, M, eigvals_only=True)[:8]) / exact - 1.0).max() > 0.01
    # At each time of a period forces are in balance.
    x, y = (E.T @ one.T / E.sum(axis=0)[:, None] for one in (modes.vectors, modes.quarter))
    omega = np.sqrt(modes.eigenvalues)
    for c, s in ((1.0, 0.0), (0.6, 0.8)):
        place, speed = c * x + s * y, omega * (c * y - s * x)
        left = K @ place + G @ speed - M @ place * modes.eigenvalues
        assert np.abs(left).max() < 1e-5 * np.abs(K @ place).max()
    assert np.diag(x.T @ M @ x + y.T @ M @ y) == pytest.approx(np.ones(8), rel=1e-9)


@pytest.mark.parametrize(("spin", "falling"), [(0.1, 0), (0.35, 2)])
def test_the_mixed_formulation_is_the_same(spin, falling):
    space = Space(straight(length=1.0).sweep(circle(8, 0.1)), elements=4, degree=3, order=3)
    supports = [Support.end(space, "start")]
    bodies = [Body(space, NeoHookean(1.0, 0.3), 1.0, kind) for kind in ("displacement", "mixed")]
    one, mixed = (modal.solve(Model([body], supports, Spin((0.0, 0.0, spin))), 6) for body in bodies)
    # As far as both are the same in the frame at rest.
    assert np.all(np.abs(mixed.frequencies - one.frequencies) < 2e-3 * (one.frequencies + spin / (2.0 * np.pi)))
    assert mixed.falling == one.falling == falling
    assert mixed.below == one.below == 6
    assert "pressures" in mixed.record()


def test_twins_are_all_found():
    """Two shafts that are alike have each frequency twice."""
    lines = [straight(start=(0.0, 0.0, z), end=(0.0, 0.0, z + 1.0)) for z in (0.0, 2.0)]
    spaces = [Space(line.sweep(circle(8, 0.03)), elements=4, degree=4, section_degree=3) for line in lines]
    supports = [Support.end(space, end, body=b) for b, space in enumerate(spaces) for end in ("start", "end")]
    bodies, spin = [Body(space, NeoHookean(1.0, 0.0), 1.0) for space in spaces], Spin((0.0, 0.0, 0.1))
    alone = modal.solve(Model(bodies[:1], supports[:2], spin), 3)
    both = modal.solve(Model(bodies, supports, spin), 6)
    assert both.frequencies == pytest.approx(np.repeat(alone.frequencies, 2), rel=1e-8)


# Shafts


@cache
def whirl(spin, count=12, modes=3):
    """Return forward and backward ``omega`` of a clamped shaft of Timoshenko's in the frame at rest, by Ritz.

    Complex deflection ``w`` and turn ``t``: energy ``E I |t'|^2 + k G A |w' - t|^2``, mass ``rho A`` and ``rho I``, and
    ``2 rho I spin`` between turn and rate of turn.
    """
    L, r = SHAFT["length"], SHAFT["radius"]
    area, inertia, shear = np.pi * r**2, np.pi * r**4 / 4, 0.5 * 6.0 / 7.0
    _, weight, table = ritz(count, [0.0, L, -1.0], L)
    f, df = table(0), table(1)
    inner = {(a, b): (p * weight) @ q.T for a, p in (("f", f), ("d", df)) for b, q in (("f", f), ("d", df))}
    K = np.block(
        [
            [shear * area * inner["d", "d"], -shear * area * inner["d", "f"]],
            [-shear * area * inner["f", "d"], inertia * inner["d", "d"] + shear * area * inner["f", "f"]],
        ]
    )
    zero = np.zeros((count, count))
    M = np.block([[area * inner["f", "f"], zero], [zero, inertia * inner["f", "f"]]])
    G = np.block([[zero, zero], [zero, 2.0 * inertia * spin * inner["f", "f"]]])
    # K - omega^2 M + omega G.
    omega = quadratic(-K, -G, M).real
    return np.sort(omega[omega > 0.0])[:modes], np.sort(-omega[omega < 0.0])[:modes]


@pytest.mark.parametrize("share", [0.3, 0.9, 1.2, 3.0])
def test_a_shaft_whirls_as_timoshenko_says(share, scene):
    """Below and beyond critical speeds; in the frame that turns they are ``|omega_f - spin|``, ``omega_b + spin``."""
    spin = share * whirl(0.0)[0][0]
    forward, backward = whirl(spin)
    modes = solved(scene(ROD + HELD + SPIN, z=spin, **SHAFT))
    exact = np.sort([*np.abs(forward - spin), *(backward + spin)])[:4]
    # As exact as in the frame at rest.
    assert np.all(np.abs(2.0 * np.pi * modes.frequencies - exact) < 1e-3 * (exact + spin))
    assert modes.about.endswith("spin, in the frame that turns")
    # Each speed beyond a critical one leaves two motions to Coriolis forces.
    assert modes.falling == 2 * np.count_nonzero(forward < spin)
    # What splits forward from backward is rotary inertia alone.
    found = 2.0 * np.pi * modes.frequencies[np.argmin(np.abs(2.0 * np.pi * modes.frequencies - backward[0] - spin))]
    assert whirl(0.0)[0][0] - (found - spin) == pytest.approx(whirl(0.0)[0][0] - backward[0], rel=0.05)


@pytest.mark.parametrize("share", [0.5, 1.5])
def test_a_slender_shaft_is_told_as_exactly(share, scene):
    """A thousand radii long: Euler and Bernoulli's ``omega``, less and more the spin, whatever rounding there is."""
    rod = SHAFT | {"radius": 1e-3}
    omega = np.array([4.730041, 7.853205, 10.995608]) ** 2 * 0.5e-3
    spin = share * omega[0]
    modes = solved(scene(ROD + HELD + SPIN, z=spin, **rod))
    exact = np.sort([*np.abs(omega - spin), *(omega + spin)])[:4]
    assert 2.0 * np.pi * modes.frequencies == pytest.approx(exact, rel=1e-3)
    assert modes.residuals.max() < 1e-6


def test_a_flat_shaft_is_unstable_between_its_critical_speeds(scene):
    """Of slender ones ``s^4 + (a^2 + b^2 + 2 w^2) s^2 + (a^2 - w^2) (b^2 - w^2) = 0`` with the frequencies at rest."""
    text = (ROD + HELD + SPIN).replace("circle = {{radius = {radius}}}", "ellipse = {{a = 0.02, b = 0.016}}")
    a, b = 2.0 * np.pi * solved(scene(text, modes=2, **SHAFT)).frequencies
    for share, falling in ((0.5, 0), (0.98, 0), (1.1, 1), (1.4, 2)):
        w = share * a
        half, product = 0.5 * (a**2 + b**2 + 2.0 * w**2), (a**2 - w**2) * (b**2 - w**2)
        squares = half - np.sqrt(half**2 - product), half + np.sqrt(half**2 - product)
        one = scene(text, z=w, modes=2, **SHAFT)
        modes = solved(one)
        assert modes.eigenvalues[0] == pytest.approx(squares[0], rel=0.02, abs=2e-3 * a**2)
        assert (modes.eigenvalues[0] < 0.0) == (squares[0] < 0.0) == (falling == 1)
        assert modes.falling == falling


def test_a_whirl_is_shown_as_one(scene):
    """The middle of the shaft goes round: in frames of an animation its place is that of the time."""
    mode = solved(scene(ROD + HELD + SPIN, z=0.2, modes=1, **SHAFT))[0]
    moments = mode._moments()
    places = np.array([one.state.at(0, 0.5) for one in moments])
    assert len(moments) == 24 and {one.amplitude for one in moments} == {1.0}
    sizes = np.linalg.norm(places, axis=1)
    assert sizes == pytest.approx(sizes[0], rel=1e-6)
    turned = np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
    # The slower one whirls forward, as the spin does.
    assert turned == pytest.approx(turned[0] + 2.0 * np.pi * np.arange(24) / 24, abs=1e-6)


def test_half_a_matrix_is_refused(scene):
    one = scene(ROD + HELD + SPIN, z=0.2, **SHAFT)
    with pytest.raises(InputError, match="sbaij: the Coriolis matrix is antisymmetric; use aij"):
        modal.solve(one.model(), 2, petsc={"mat_type": "sbaij"})


def test_the_printout_says_how_it_stands(scene, capsys):
    said = {}
    for share in (0.5, 1.2):
        one = scene(ROD + HELD + SPIN, z=share * whirl(0.0)[0][0], **SHAFT)
        assert main(["run", one.path, "--no-estimate"]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert "about               the equilibrium under spin, in the frame that turns" in lines
        said[share] = [line for line in lines if line.startswith(("critical", "unstable"))]
    assert said == {
        0.5: [],
        1.2: ["critical            2 motions gyroscopically stabilised, without damping"],
    }


def test_the_estimate_sees_coriolis_forces(scene):
    one = scene(ROD + HELD + SPIN, z=0.25, **SHAFT)
    coarse, fine = (solved(replace(one, elements=n, degree=3)) for n in (2, 16))
    error = np.abs(coarse.frequencies / fine.frequencies - 1.0).max()
    assert error > 0.002 and error / 3.0 < coarse.estimate() < 3.0 * error
    assert fine.estimate() < 0.005


# Blades


def lagging(speed, ratio, count=12):
    """Return the first ``omega`` of a clamped slender beam in the plane in which it turns, with and without Coriolis.

    Ritz, in the unit of ``sqrt(E I / rho A L^4)``; ``ratio`` is ``E A L^2 / E I``.  Lag ``v`` and stretch ``u``:
    ``v'''' - (T v')' - speed^2 v + v.. + 2 speed u. = 0``, ``-ratio u'' - speed^2 u + u.. - 2 speed v. = 0``.
    """
    (x, weight, across), (*_, along) = ritz(count, [0.0, 0.0, 1.0]), ritz(count, [0.0, 1.0])
    v, dv, ddv, u, du = *(across(k) for k in range(3)), along(0), along(1)
    pull = speed**2 * (1.0 - x**2) / 2.0
    of = {"v": (v * weight) @ v.T, "u": (u * weight) @ u.T, "vu": (v * weight) @ u.T}
    bend = (ddv * weight) @ ddv.T + (dv * weight * pull) @ dv.T - speed**2 * of["v"]
    zero = np.zeros((count, count))
    K = np.block([[bend, zero], [zero, ratio * (du * weight) @ du.T - speed**2 * of["u"]]])
    M = np.block([[of["v"], zero], [zero, of["u"]]])
    G = 2.0 * speed * np.block([[zero, of["vu"]], [-of["vu"].T, zero]])
    rates = quadratic(K, G, M)
    return np.sort(rates.imag[rates.imag > 1e-6])[0], np.sqrt(eigh(bend, of["v"], eigvals_only=True)[0])


@pytest.mark.parametrize("slenderness", [60.0, 100.0])
def test_coriolis_forces_slow_a_blade_in_its_plane(slenderness, scene):
    """By what they do on its stretch, 2e-3 and less; flapping has none, and is Wright's."""
    rod = {"length": slenderness, "radius": 1.0, "E": 4.0 * slenderness**4, "nu": 0.0, "density": 1.0}
    one = scene(ROD + SPIN, x=6.0, **rod | {"modes": 2})
    modes = solved(one)
    with_, without = lagging(6.0, 4.0 * slenderness**2)
    assert without == pytest.approx(np.sqrt(7.3604**2 - 36.0), rel=1e-4)
    lag, flap = 2.0 * np.pi * modes.frequencies
    assert (lag, flap) == pytest.approx((with_, 7.3604), rel=3e-3)
    model = one.model()
    K, M = (one.toarray() for one in (lambda m: (m.stiffness, m.mass))(statics.solve(model).matrices()))
    plain = np.sqrt(eigh(K, M, eigvals_only=True)[0])
    assert (plain - lag) / plain == pytest.approx((without - with_) / without, rel=0.03)
    assert (plain - lag) / plain > 5e-4
