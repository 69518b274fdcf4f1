"""Paths beyond limit points and bifurcations: exact truss, Euler's column, its elastica, shallow arch, bad input."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from isorod import Axis, InputError, NeoHookean, Rod, SolveError, Space, circle, statics, straight
from isorod.assembly.assembler import Assembler
from isorod.model import Body, Model, SectionLoad, Support
from isorod.statics import continuation


def quadratic(centers, rotations=None):
    axis = Axis(2, np.repeat([0.0, 1.0], 3), np.ones(3))
    return Rod.sweep(circle(4), axis, np.array(centers, dtype=float), rotations)


def polynomials(rod, elements=8, degree=4):
    return Space.paper(
        rod, elements=elements, degree=degree, continuity=0, section_degree=3, quadrature=f"4x5x{degree}"
    )


def column(length, share=2.0):
    """A clamped-free column in a plane, pressed at its free end by ``share`` times Euler's load at factor 1."""
    space = polynomials(straight(length).sweep(circle(4)))
    force = share * np.pi**2 * 0.25 * np.pi / (4.0 * length**2)
    nodes = np.arange(1, space.layers) * space.layer_nodes
    return Model(
        [Body(space, NeoHookean(1.0, 0.0))],
        [Support.end(space, "start"), Support(nodes, "y")],
        loads=[SectionLoad.end(space, "end", (0.0, 0.0, -force))],
    )


def elastica(ratio):
    """Deflection and height of the tip by length, at a multiple of Euler's load (elliptic integrals, inextensible)."""
    m = brentq(lambda m: (2.0 / np.pi * ellipk(m)) ** 2 - ratio, 1e-14, 1.0 - 1e-12)
    return 2.0 * np.sqrt(m) / ellipk(m), 2.0 * ellipe(m) / ellipk(m) - 1.0


def arch(elements, load=9.8e-4 * 0.25 * np.pi * 0.5):
    """A clamped parabolic arch of span 100, rise 5 and radius 1 under a dead force at the crown."""
    rotations = []
    for slope in (0.2, 0.0, -0.2):
        t, y = np.array([1.0, 0.0, slope]) / np.hypot(1.0, slope), np.array([0.0, 1.0, 0.0])
        rotations.append(np.stack([y, np.cross(t, y), t], axis=1))
    space = polynomials(quadratic([[-50, 0, 0], [0, 0, 10], [50, 0, 0]], np.array(rotations)), elements)
    return Model(
        [Body(space, NeoHookean(1.0, 0.3))],
        [Support.end(space, "start"), Support.end(space, "end")],
        loads=[SectionLoad((0.0, 0.0, -load), u=0.5)],
    )


def crown(path):
    space = path.model.bodies[0].space
    return np.array(
        [space.displacement(path.model.nodal(d), [[0.0, 0.0]], [0.5])[0][0, 0, 2] for d in path.displacements]
    )


def extremes(path):
    """Limit loads, by the parabola through the three points about each."""
    f, w = path.factors, crown(path)
    found = []
    for k in range(1, f.size - 1):
        if (f[k] - f[k - 1]) * (f[k + 1] - f[k]) < 0.0:
            a, b, c = np.polyfit(w[k - 1 : k + 2], f[k - 1 : k + 2], 2)
            found.append(c - b * b / (4.0 * a))
    return np.array(found)


def test_eulers_load_with_an_error_of_thickness_squared():
    errors = []
    for length in (50.0, 100.0):
        point = continuation.critical(column(length), 0.1)
        errors.append(2.0 * point.factor - 1.0)
        tip = point.mode.reshape(-1, 3)[(point.mode.size // 3 // 10 - 1) * 10]
        assert np.abs(tip).max() == abs(tip[0]) == 1.0
    assert max(np.abs(errors)) < 2e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert abs((4.0 * errors[1] - errors[0]) / 3.0) < 2e-6


def test_postbuckling_branch_is_the_elastica_and_stable():
    model = column(200.0)
    point = continuation.critical(model, 0.1)
    path = continuation.follow(model, 0.04, 40, start=point)
    node = (model.bodies[0].space.layers - 1) * model.bodies[0].space.layer_nodes
    assert path.factors[-1] > 1.0
    assert (path.negative[2:] == 0).all()
    beyond = np.flatnonzero(path.factors > 1.005 * point.factor)
    assert beyond.size >= 5
    for k in beyond:
        wanted = elastica(2.0 * path.factors[k])
        found = abs(path.at(node, "x")[k]) / 200.0, 1.0 + path.at(node, "z")[k] / 200.0
        assert found == pytest.approx(wanted, abs=3e-4)


def test_straight_column_beyond_eulers_load_is_known_to_be_unstable():
    model = column(50.0)
    path = continuation.follow(model, 0.2, 30)
    assert path.factors[-1] > 1.0
    assert (path.negative[path.factors < 0.49] == 0).all()
    assert (path.negative[path.factors > 0.51] == 1).all()


@pytest.fixture(scope="module")
def snapped():
    return {elements: continuation.follow(arch(elements), 0.2, 60, (-5.0, 10.0), longest=1.0) for elements in (4, 8)}


def test_the_arch_snaps_through_and_its_limit_loads_converge(snapped):
    coarse, fine = (extremes(path) for path in snapped.values())
    assert coarse.size == fine.size == 2
    assert fine[0] > fine[1] > 0.0
    assert coarse == pytest.approx(fine, rel=3e-3)
    path = snapped[8]
    assert crown(path)[-1] < -5.0
    # Beside the limit points the inertia finds the two points where the arch would tilt.
    changes = np.abs(np.diff(path.negative)).sum()
    assert changes == 4
    assert path.negative[-1] == 0
    assert path.negative.max() == 2


def test_points_of_a_path_are_equilibria(snapped):
    path = snapped[4]
    assembler = Assembler(path.model)
    out = assembler.vector()
    for k in range(0, path.factors.size, 7):
        carried = assembler.residual(assembler.state(path.displacements[k]), path.factors[k], out)
        assert out.norm() <= 1e-9 * max(carried, 1e-6)


def test_path_passes_through_what_statics_finds(snapped):
    """At half the limit load, where the arch is stable on its first branch."""
    path = snapped[8]
    limit = extremes(path)[0]
    first = int(np.argmax(path.factors))
    factor = 0.5 * limit
    wanted = np.interp(factor, path.factors[: first + 1], crown(path)[: first + 1])
    model = arch(8, factor * 9.8e-4 * 0.25 * np.pi * 0.5)
    solution = statics.solve(model)
    space = model.bodies[0].space
    found = space.displacement(model.nodal(solution.displacement), [[0.0, 0.0]], [0.5])[0][0, 0, 2]
    assert found == pytest.approx(wanted, rel=0.02)


def test_supports_that_turn_can_be_followed():
    space = polynomials(quadratic([[0, 0, 0], [0, 0, 5], [0, 0, 10]]), 2, 3)
    supports = [
        Support.end(space, "start"),
        Support.end(space, "end", "y", turn=(0.0, 0.5, 0.0), tied="xz"),
    ]
    model = Model([Body(space, NeoHookean(1.0, 0.3))], supports)
    path = continuation.follow(model, 0.2, 20)
    assert path.factors[-1] > 1.0
    u = path.displacements[-1]
    factor = path.factors[-1]
    again = statics.solve(
        Model(
            model.bodies,
            [supports[0], Support.end(space, "end", "y", turn=(0.0, 0.5 * factor, 0.0), tied="xz")],
        )
    )
    assert again.displacement == pytest.approx(u, abs=1e-7)


def test_bad_input_and_paths_that_end():
    model = column(50.0)
    for step, steps, longest in ((0.0, 5, None), (float("nan"), 5, None), (0.1, 0, None), (0.1, 5, 0.01)):
        with pytest.raises(InputError):
            continuation.follow(model, step, steps, longest=longest)
    with pytest.raises(InputError):
        continuation.critical(model, -1.0)
    with pytest.raises(SolveError, match=r"no critical point up to load factor 0\.3"):
        continuation.critical(model, 0.1, 0.3)
    space = model.bodies[0].space
    with pytest.raises(SolveError, match="free to"):
        continuation.follow(Model(model.bodies, [Support.end(space, "start", "z")]), 0.1, 3)
