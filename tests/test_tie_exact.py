"""Rods welded to rods beside exact solutions: patch tests, transfer into a sleeve, composite cylinder, frequencies."""

import numpy as np
import pytest

from comparisons.joints import exact
from comparisons.joints.traction import Traction
from isorod import LinearElastic, Space, Tie, circle, modal, statics, straight
from isorod.model import Body, Model, Support
from isorod.model.tie import EndFace, LateralSurface

# Strains are to be small.
SIZE = 1e-4

# Spaces of two bars end on end; those of the last two are hollow.
PAIRS = {
    "control points": ({"order": 2, "elements": 2, "degree": 3}, {"order": 3, "elements": 3, "degree": 4}, None),
    "more control points": (
        {"order": 2, "section_points": 16, "elements": 1, "degree": 3},
        {"order": 2, "elements": 2, "degree": 3},
        None,
    ),
    "polynomials": ({"order": 2, "elements": 3, "degree": 3}, {"section_degree": 3, "elements": 2, "degree": 4}, None),
    "polynomials alone": (
        {"section_degree": 3, "elements": 2, "degree": 3},
        {"section_degree": 4, "elements": 3, "degree": 4},
        None,
    ),
    # The rule that is chosen for hollow rods sees constant stresses to 1e-8.
    "hollow": (
        {"section_degree": 3, "elements": 2, "degree": 3, "quadrature": "full"},
        {"section_degree": 4, "elements": 3, "degree": 3, "quadrature": "full"},
        0.5,
    ),
}
# Those whose functions have all quadratic fields.
QUADRATIC = ("polynomials alone", "hollow")
LENGTHS = (4.0, 3.0)


def bar(length, start=0.0, n=8, radius=1.0, rings=None, **space):
    rod = straight(length, start=(0.0, 0.0, start)).sweep(circle(n, radius))
    return Space(rod if rings is None else rod.with_rings(rings), **space)


def bars(pair):
    one, other, hole = PAIRS[pair]
    rings = (None, None) if hole is None else ((hole, 1.0), (hole, 0.7, 1.0))
    return bar(LENGTHS[0], rings=rings[0], **one), bar(LENGTHS[1], LENGTHS[0], 12, rings=rings[1], **other)


def on_face(space, which, field, body):
    """Return a support that moves an end face by a field that the section's functions have."""
    layer = space.end(which) % space.layers
    xi, _ = space.section_rule(space.basis.full(5))
    values = space.basis.functions(xi)[0]
    places = space.rod.grid(xi, [space.axis.breaks[space.end(which)]])[0][0]
    wanted = field(places)
    found = np.linalg.lstsq(values, wanted, rcond=1e-12)[0]
    assert np.abs(values @ found - wanted).max() < 1e-12 * max(1.0, np.abs(wanted).max())
    nodes = layer * space.layer_nodes + np.arange(space.layer_nodes)
    return Support(nodes, displacement=SIZE * found, body=body, space=space)


def tension(E, nu, length):
    """Stress 1 along both bars, if what they contract across is the same."""

    def field(x, body):
        offset = 0.0 if body == 0 else length / E[0]
        along = x[:, 2] - length * body
        return np.stack([*(-nu[body] / E[body] * x[:, :2].T), along / E[body] + offset], axis=1)

    return field, lambda x: np.tile([0.0, 0.0, 1.0], (len(x), 1))


def bending(E, nu, length):
    """Stress ``-x`` along both bars, if their anticlastic curvatures are the same."""

    def field(x, body):
        bend = 1.0 / np.array(E)
        z = x[:, 2] - length * body
        k, X, Y = bend[body], x[:, 0], x[:, 1]
        slope = bend[0] * length * body
        across = 0.5 * k * (z**2 + nu[body] * (X**2 - Y**2)) + slope * z + 0.5 * bend[0] * length**2 * body
        return np.stack([across, k * nu[body] * X * Y, -X * (k * z + slope)], axis=1)

    return field, lambda x: np.stack([0.0 * x[:, 0], 0.0 * x[:, 0], -x[:, 0]], axis=1)


def torsion(E, nu, length):
    """Shear stress ``r``."""

    def field(x, body):
        twist = 2.0 * (1.0 + np.array(nu)) / E
        turn = twist[body] * (x[:, 2] - length * body) + twist[0] * length * body
        return turn[:, None] * np.stack([-x[:, 1], x[:, 0], 0.0 * x[:, 0]], axis=1)

    return field, lambda x: np.stack([-x[:, 1], x[:, 0], 0.0 * x[:, 0]], axis=1)


# Moduli and Poisson's ratios; functions of control points bend exactly without contraction across alone.
PATCHES = {
    "tension": (tension, (10.0, 5.0), (0.4, 0.2)),
    "bending": (bending, (10.0, 1.0), (0.0, 0.0)),
    "anticlastic bending": (bending, (10.0, 5.0), (0.4, 0.2)),
    "torsion": (torsion, (26.0, 2.2), (0.3, 0.1)),
    "torsion of soft on stiff": (torsion, (1.0, 30.0), (0.1, 0.45)),
}
CASES = [(patch, pair) for patch in PATCHES for pair in PAIRS if patch != "anticlastic bending" or pair in QUADRATIC]


@pytest.mark.parametrize(("patch", "pair"), CASES)
@pytest.mark.parametrize("turned", [False, True])
def test_stresses_that_are_linear_across_the_section_pass_plane_faces(patch, pair, turned):
    make, E, nu = PATCHES[patch]
    field, traction = make(E, nu, LENGTHS[0])
    spaces = bars(pair)
    faces = EndFace(1, "start"), EndFace(0, "end")
    model = Model(
        [Body(space, LinearElastic(*law)) for space, law in zip(spaces, zip(E, nu, strict=True), strict=True)],
        [on_face(spaces[0], "start", lambda x: field(x, 0), 0)],
        loads=[Traction(EndFace(1, "end"), lambda x: SIZE * traction(x))],
        ties=[Tie(*(faces[::-1] if turned else faces))],
    )
    found = statics.solve(model)
    xi = spaces[0].section_rule(spaces[0].rule)[0]
    for body, space in enumerate(spaces):
        along = np.linspace(0.0, 1.0, 7)
        places = space.rod.grid(xi, along)[0]
        moved = field(places.reshape(-1, 3), body).reshape(places.shape)
        largest = np.abs(field(np.array([[1.0, 0.0, 7.0]]), 1)).max()
        assert np.abs(found.at(body, along, xi) / SIZE - moved).max() < 1e-10 * largest
    tie = found.ties[0]
    assert tie.jump < 1e-10 * SIZE * largest
    sign = 1.0 if turned else -1.0
    assert tie.traction / SIZE == pytest.approx(sign * traction(tie.points), abs=1e-8)


def in_sleeve(solution, E, nu, ends, turned, core, tube):
    """Return the equilibrium of a rod in a hollow rod that is loaded on its outer surface, and the spaces."""
    core = bar(solution.length, **core)
    tube = bar(solution.length, radius=solution.b, rings=(1.0 / solution.b, 1.0), **tube)
    supports = [
        Support.end(space, which, ends, body=body)
        for body, space in enumerate((core, tube))
        for which in ("start", "end")
    ]
    if ends == "z":
        # Of the master, so that all of the slave is tied.
        supports += pinned(tube, 1) if not turned else pinned(core, 0)
    surfaces = LateralSurface(0), LateralSurface(1, surface="inner")
    model = Model(
        [Body(space, LinearElastic(*law)) for space, law in zip((core, tube), zip(E, nu, strict=True), strict=True)],
        supports,
        loads=[Traction(LateralSurface(1), lambda x: SIZE * solution.load(x))],
        ties=[Tie(*(surfaces[::-1] if turned else surfaces))],
    )
    return statics.solve(model), core, tube


def pinned(space, body):
    """Return supports of a section that hold what symmetry holds: the other two translations and the turn."""
    nodes = space.layers // 2 * space.layer_nodes + np.arange(space.layer_nodes)
    x, y, _ = space.positions[nodes].T
    if space.section_degree is None:
        held = ((np.argmax(x), "y"), (np.argmin(x), "y"), (np.argmax(y), "x"))
    else:
        held = ((0, "xy"), (np.argmax(y), "x"))
    return [Support([nodes[k]], letters, body=body) for k, letters in held]


def work(found, tube, count):
    """Return half the work of the loads, for strains of size one."""
    nodal = found.model.loads[0].nodal(tube)
    return 0.5 * (nodal * found.displacement.reshape(-1, 3)[count:]).sum() / SIZE**2


COARSE = {"order": 2, "elements": 2, "degree": 3}, {"section_degree": 3, "elements": 2, "degree": 3}
FINE = {"order": 3, "elements": 4, "degree": 4}, {"section_degree": 6, "elements": 4, "degree": 4}


@pytest.mark.parametrize("turned", [False, True], ids=["rod slave", "sleeve slave"])
@pytest.mark.parametrize("problem", ["torsion", "axial"])
def test_transfer_into_a_sleeve_converges_to_the_exact_one(problem, turned):
    E, nu = ((26.0, 2.6) if problem == "torsion" else (10.0, 1.0)), (0.3, 0.3)
    torsion = problem == "torsion"
    solution = exact.Torsion((10.0, 1.0), 1.0, 3.0, 5.0) if torsion else exact.Axial(E, nu, 1.0, 3.0, 5.0, loaded=True)
    errors = []
    for core, tube in (COARSE, FINE):
        found, inner, outer = in_sleeve(solution, E, nu, "xyz" if torsion else "z", turned, core, tube)
        tie = found.ties[0]
        expected = (-1.0 if turned else 1.0) * solution.traction(tie.points)
        places = inner.rod.grid([[1.0, 0.0], [0.0, 1.0]], [0.3, 0.5])[0]
        moved = solution.displacement(places.reshape(-1, 3), 0).reshape(places.shape)
        reaction = found.moments[0, 2] if torsion else found.reactions[0, 2]
        errors.append(
            [
                work(found, outer, inner.nodes) / solution.energy - 1.0,
                np.abs(found.at(0, [0.3, 0.5], [[1.0, 0.0], [0.0, 1.0]]) / SIZE - moved).max() / np.abs(moved).max(),
                -reaction / SIZE / (solution.torque if torsion else solution.force) - 1.0,
                np.linalg.norm(tie.traction / SIZE - expected) / np.linalg.norm(expected),
            ]
        )
    coarse, fine = np.abs(errors)
    assert fine[0] < 2e-6
    assert fine[1:3].max() < 1e-4
    assert fine[3] < 1e-3
    assert (coarse[[0, 3]] / fine[[0, 3]]).min() > 5.0


@pytest.mark.parametrize("turned", [False, True], ids=["rod slave", "sleeve slave"])
def test_a_composite_cylinder_is_hills(turned):
    E, nu = (10.0, 1.0), (0.2, 0.4)
    solution = exact.Composite(E, nu, 1.0, 3.0)
    core = bar(2.0, order=2, elements=1, degree=3)
    tube = bar(2.0, radius=3.0, rings=(1.0 / 3.0, 1.0), section_degree=4, elements=1, degree=3)
    supports = [
        Support.end(space, which, "z", displacement=(0.0, 0.0, moved), body=body)
        for body, space in enumerate((core, tube))
        for which, moved in (("start", 0.0), ("end", 2.0 * SIZE))
    ]
    supports += pinned(core, 0) if turned else pinned(tube, 1)
    surfaces = LateralSurface(0), LateralSurface(1, surface="inner")
    model = Model(
        [Body(core, LinearElastic(E[0], nu[0])), Body(tube, LinearElastic(E[1], nu[1]))],
        supports,
        ties=[Tie(*(surfaces[::-1] if turned else surfaces))],
    )
    found = statics.solve(model)
    tie = found.ties[0]
    pressure = np.einsum("qa,qa->q", tie.traction, exact.polar(tie.points)[1]) / SIZE
    radial = [found.at(0, 0.5, (1.0, 0.0))[0], found.at(1, 0.5, (1.0, 0.0))[0]]
    force = found.reactions[[1, 3], 2].sum()
    assert pressure == pytest.approx(-(-1.0 if turned else 1.0) * solution.pressure, rel=1e-6)
    assert np.array(radial) / SIZE == pytest.approx([solution.radial(1.0), solution.radial(3.0)], rel=1e-7)
    assert force / SIZE == pytest.approx(solution.force, rel=1e-7)


def test_ends_welded_together_have_the_torsional_frequencies_of_the_characteristic_equation():
    lower, upper = bars("control points")
    G, density = (10.0, 1.0), (2.0, 1.0)
    # With sections held in their planes what is left are torsion and shear both ways, whose equations are the same.
    bodies = [
        Body(space, LinearElastic(2.6 * shear, 0.3), rho)
        for space, shear, rho in zip((lower, upper), G, density, strict=True)
    ]
    everything = [Support(np.arange(space.nodes), "z", body=body) for body, space in enumerate((lower, upper))]
    model = Model(
        bodies, [*everything, Support.end(lower, "start", "xy")], ties=[Tie(EndFace(1, "start"), EndFace(0, "end"))]
    )
    wanted = exact.end_to_end(G, density, LENGTHS, 3)
    assert 2.0 * np.pi * modal.solve(model, 9).frequencies == pytest.approx(np.repeat(wanted, 3), rel=1e-4)


@pytest.mark.parametrize("turned", [False, True], ids=["rod slave", "sleeve slave"])
def test_a_rod_in_a_sleeve_has_the_torsional_frequencies_of_bessels_functions(turned):
    G, density, length = (10.0, 1.0), (2.0, 1.0), 10.0
    core = bar(length, order=3, elements=4, degree=4)
    tube = bar(length, radius=2.0, rings=(0.5, 1.0), section_degree=5, elements=4, degree=4)
    bodies = [
        Body(space, LinearElastic(2.6 * shear, 0.3), rho)
        for space, shear, rho in zip((core, tube), G, density, strict=True)
    ]
    surfaces = LateralSurface(0), LateralSurface(1, surface="inner")
    model = Model(
        bodies,
        [Support(np.arange(space.nodes), "z", body=body) for body, space in enumerate((core, tube))],
        ties=[Tie(*(surfaces[::-1] if turned else surfaces))],
    )
    found = np.array(torsional(model, 60))
    for waves in (1, 2):
        for wanted in exact.in_sleeve(G, density, 1.0, 2.0, length, waves, 2):
            assert np.abs(found / wanted - 1.0).min() < 1e-3, (waves, wanted, found)


def torsional(model, count):
    """Return the angular frequencies of modes whose sections turn: the mean of what is tangential is most of it."""
    found = modal.solve(model, count)
    angle = np.arange(16) * np.pi / 8
    xi, tangent = np.stack([np.cos(angle), np.sin(angle)], axis=1), np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    result = []
    for mode, frequency in zip(found, found.frequencies, strict=True):
        moved = mode.at(1, np.linspace(0.03, 1.0, 9), xi)
        turn = np.einsum("tqa,qa->tq", moved[..., :2], tangent).mean(axis=1)
        if np.linalg.norm(turn) * 4.0 > 0.99 * np.linalg.norm(moved):
            result.append(2.0 * np.pi * frequency)
    return result


@pytest.mark.parametrize("inner", [{"section_degree": 4}, {"order": 2}], ids=["polynomials", "control points"])
@pytest.mark.parametrize("turned", [False, True], ids=["rod slave", "sleeve slave"])
def test_a_tie_carries_what_the_load_says_whatever_the_section(inner, turned):
    core = bar(4.0, elements=2, degree=3, **inner)
    tube = bar(2.0, radius=2.0, rings=(0.5, 1.0), section_degree=3, elements=2, degree=3)
    surfaces = LateralSurface(0, (0.0, 2.0)), LateralSurface(1, surface="inner")
    core = bar(4.0, elements=2, degree=3, continuity=0, **inner)
    outside = [Support.end(tube, which, body=1) for which in ("start", "end")]
    force = np.array([1e-5, 2e-5, 3e-5])
    model = Model(
        [Body(core, LinearElastic(10.0, 0.3)), Body(tube, LinearElastic(1.0, 0.3))],
        outside,
        loads=[Traction(EndFace(0, "end"), lambda x: np.tile(force / np.pi, (len(x), 1)))],
        ties=[Tie(*(surfaces[::-1] if turned else surfaces))],
    )
    found = statics.solve(model)
    tie, sign = found.ties[0], (1.0 if turned else -1.0)
    assert tie.force == pytest.approx(sign * force, rel=1e-8)
    assert tie.moment == pytest.approx(sign * np.cross([0.0, 0.0, 4.0 - tie.center[2]], force), abs=1e-12)
    assert found.reactions.sum(axis=0) == pytest.approx(-force, rel=1e-8)


@pytest.mark.parametrize("turned", [False, True], ids=["rod slave", "sleeve slave"])
@pytest.mark.parametrize("elements", [1, 4])
def test_constant_tractions_pass_up_to_ends_that_are_held(turned, elements):
    """Traces of functions that are held are no multipliers of their own, and yet constants are among these."""
    gradient = np.array([[0.8, -0.5, 0.0], [0.3, -0.4, 0.0], [0.0, 0.0, 0.6]])
    solution = exact.Uniform(1.0, 0.3, gradient)
    core = bar(2.0, order=2, elements=elements, degree=3)
    tube = bar(2.0, radius=2.0, rings=(0.5, 1.0), section_degree=3, elements=elements, degree=3, quadrature="full")
    supports = [
        on_face(space, which, lambda x: solution.displacement(x, 0), body)
        for body, space in enumerate((core, tube))
        for which in ("start", "end")
    ]
    surfaces = LateralSurface(0), LateralSurface(1, surface="inner")
    model = Model(
        [Body(space, LinearElastic(1.0, 0.3)) for space in (core, tube)],
        supports,
        loads=[Traction(LateralSurface(1), lambda x: SIZE * solution.traction(x))],
        ties=[Tie(*(surfaces[::-1] if turned else surfaces))],
    )
    found = statics.solve(model)
    moved = solution.displacement(np.concatenate([core.positions, tube.positions]), 0)
    assert found.displacement.reshape(-1, 3) / SIZE == pytest.approx(moved, abs=1e-9)
    tie = found.ties[0]
    assert tie.traction / SIZE == pytest.approx((-1.0 if turned else 1.0) * solution.traction(tie.points), abs=1e-6)
