"""Dead loads, supports that turn and ties: consistency, exact solutions, slenderness without locking, and bad input."""

import numpy as np
import pytest
from scipy.optimize import brentq

from isorod import dynamics, statics
from isorod.assembly.assembler import Assembler
from isorod.checks import rigid_motions
from isorod.errors import InputError, SolveError
from isorod.geometry.center_line import straight
from isorod.geometry.section import circle, ellipse
from isorod.material import LinearElastic, NeoHookean
from isorod.model import Body, BodyForce, Model, SectionLoad, Support
from isorod.model.support import rotation
from isorod.scenes.spring import Spring
from isorod.space import Space

LAW = NeoHookean(1.0, 0.3)

# Planar elastica under a dead tip load P L^2 / EI: deflection and shortening over L (elliptic integrals).
ELASTICA = {1.0: (0.30172077, 0.05643324), 3.0: (0.60325344, 0.25442018), 10.0: (0.81060902, 0.55499560)}


def prism(length, section=None, **space):
    return Space(straight(length).sweep(circle(4) if section is None else section), **space)


def slender(length, elements=8, degree=3):
    """Polynomials across, C0 elements with as many points as their degree along: no locking."""
    return prism(length, elements=elements, degree=degree, continuity=0, section_degree=3, quadrature=f"4x5x{degree}")


def line(space):
    """Nodes of the centre line of a space of polynomials, ends left out."""
    return np.arange(1, space.layers - 1) * space.layer_nodes


def tip(space, solution):
    return space.displacement(solution.model.nodal(solution.displacement), [[0.0, 0.0]], [1.0])[0][0, 0]


SPACES = {
    "control points": lambda: Space(Spring(coils=1, section_points=4).rod()),
    "order 2": lambda: Space(Spring(coils=1, section_points=4).rod(), order=2, degree=3),
    "polynomials": lambda: prism(6.0, elements=3, section_degree=3),
}


@pytest.mark.parametrize("name", SPACES)
def test_work_of_loads_on_rigid_motions(name):
    """On a translation a load works with its resultant, on a turn with its moment about the centroid of its place."""
    space, force = SPACES[name](), np.array([0.3, -0.7, 1.1])
    end = SectionLoad.end(space, "end", tuple(force)).nodal(space)
    table = space.tabulate(0, space.axis.elements)
    volume = table.weights.sum()
    weight = BodyForce(tuple(force / volume)).nodal(space)
    xi = [[0.0, 0.0]]
    for nodal in (end, weight):
        assert nodal[space.carries].sum(axis=0) == pytest.approx(force, rel=1e-8)
    places = np.array([space.rod.grid(table.xi, u)[0] for u in table.u])
    centroid = np.einsum("etq,etqa->a", table.weights, places) / volume
    top = space.rod.grid(xi, [space.axis.breaks[-1]])[0][0, 0]
    for nodal, place in ((end, top), (weight, centroid)):
        moment = np.cross(space.positions, nodal).sum(axis=0)
        assert moment == pytest.approx(np.cross(place, force), rel=1e-6, abs=1e-6 * np.abs(place).max())


def test_section_load_inside_is_that_of_the_end_when_it_gets_there():
    space = prism(6.0, elements=3, degree=3)
    assert SectionLoad((1.0, 2.0, 3.0)).nodal(space) == pytest.approx(
        SectionLoad.end(space, "end", (1.0, 2.0, 3.0)).nodal(space), abs=1e-15
    )
    inside = SectionLoad((1.0, 2.0, 3.0), u=0.4).nodal(space)
    assert inside[space.carries].sum(axis=0) == pytest.approx([1.0, 2.0, 3.0])


def test_bar_under_end_load_and_weight_is_stretched_as_in_one_dimension():
    """nu = 0, linear: w(L) = P L / EA + q L^2 / 2E."""
    space = prism(4.0, elements=3, degree=2)
    area = space.rod.volume() / 4.0
    loads = [SectionLoad.end(space, "end", (0.0, 0.0, 0.02 * area)), BodyForce((0.0, 0.0, 0.01))]
    model = Model([Body(space, LinearElastic(2.0, 0.0))], [Support.end(space, "start")], loads=loads)
    solution = statics.solve(model)
    assert tip(space, solution)[2] == pytest.approx(0.02 * 4.0 / 2.0 + 0.01 * 16.0 / 4.0, rel=1e-10)
    assert solution.reactions[0] == pytest.approx([0.0, 0.0, -(0.02 + 0.04) * area], rel=1e-10, abs=1e-12)


def test_predictor_is_the_derivative_by_the_load_factor():
    """Loads, turning and tied supports together."""
    space = prism(6.0, elements=3, degree=3)
    supports = [
        Support.end(space, "start"),
        Support.end(space, "end", "y", (0.0, 0.2, 0.0), turn=(0.3, 0.5, -0.2), tied="xz"),
    ]
    model = Model([Body(space, LAW)], supports, loads=[BodyForce((0.01, 0.02, 0.03))])
    assembler = Assembler(model)
    x = assembler.vector()
    x.array[:] = 0.02 * np.random.default_rng(1).standard_normal(model.unknowns)
    matrix, out = assembler.matrix(), assembler.vector()
    h = 1e-5
    values = []
    for factor in (0.6 - h, 0.6 + h):
        assembler.residual(x, factor, out)
        values.append(out.array_r.copy())
    matrices = assembler.tangent(x, 0.6, matrix, keep=True)
    assembler.load_forces(x, 0.6, matrices, 1e-7, out)
    assert out.array_r * 1e7 == pytest.approx((values[1] - values[0]) / (2 * h), rel=1e-5, abs=1e-7)


def test_tangent_of_tied_supports_is_the_derivative_of_the_residual():
    space = prism(6.0, elements=2, degree=2)
    supports = [Support.end(space, "start"), Support.end(space, "end", "x", turn=(0.0, 0.4, 0.0), tied="yz")]
    model = Model([Body(space, LAW)], supports)
    assembler = Assembler(model)
    assert model.unknowns == 3 * space.nodes - model.bound.size + 2
    random = np.random.default_rng(2)
    state, way = (0.02 * random.standard_normal(model.unknowns) for _ in range(2))
    x, d, image, matrix = assembler.vector(), assembler.vector(), assembler.vector(), assembler.matrix()
    x.array[:], d.array[:] = state, way
    assembler.tangent(x, 0.5, matrix)
    matrix.mult(d, image)
    assert matrix.isSymmetric(1e-10)
    h, sides = 1e-5, []
    for sign in (-1.0, 1.0):
        x.array[:] = state + sign * h * way
        out = assembler.vector()
        assembler.residual(x, 0.5, out)
        sides.append(out.array_r.copy())
    assert image.array_r == pytest.approx((sides[1] - sides[0]) / (2 * h), rel=1e-6, abs=1e-9)
    back = assembler.state(assembler.displacement(x, 0.5))
    assert np.abs(back.array_r - x.array_r).max() < 1e-15


def test_rotation_is_orthogonal_and_turns_by_its_length():
    for vector in ((0.0, 0.0, 0.0), (1e-9, 0.0, 0.0), (0.3, -2.0, 1.0), (0.0, 0.0, 20.0 * np.pi)):
        R = rotation(vector)
        assert R @ R.T == pytest.approx(np.eye(3), abs=1e-15)
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert R @ vector == pytest.approx(vector, abs=1e-13)
        assert np.trace(R) == pytest.approx(1.0 + 2.0 * np.cos(np.linalg.norm(vector)))


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.parametrize("turns", [0.3, 1.7])
def test_both_ends_turned_alike_turn_the_rod_as_a_rigid_body(name, turns):
    """About a centre off the axis, with a displacement: no stress, and the position is R (x - c) + c + d everywhere."""
    space = SPACES[name]()
    turn, center, move = np.array([0.2, -0.5, 1.0]) * turns, (1.0, 2.0, -1.0), (0.5, 0.0, 0.3)
    supports = [Support.end(space, end, "xyz", move, turn=tuple(turn), center=center) for end in ("start", "end")]
    solution = statics.solve(Model([Body(space, LAW)], supports), 8)
    arms = space.positions - space.carries[:, None] * np.array(center)
    wanted = arms @ (rotation(turn) - np.eye(3)).T + space.carries[:, None] * np.array(move)
    found = solution.model.nodal(solution.displacement)
    assert np.abs(found - wanted).max() < 1e-8 * np.abs(wanted).max()
    assert np.abs(solution.reactions).max() < 1e-9
    assert np.abs(solution.moments).max() < 1e-8


def test_moments_balance_the_forces():
    space = prism(6.0, elements=3, degree=3)
    supports = [
        Support.end(space, "start"),
        Support.end(space, "end", "xyz", (0.4, 0.0, -0.2), turn=(0.2, 0.5, 1.0)),
    ]
    solution = statics.solve(Model([Body(space, LAW)], supports), 2)
    places = space.positions + solution.model.nodal(solution.displacement)
    layers = places.reshape(space.layers, -1, 3)
    arms = np.array([layer.mean(axis=0) for layer in (layers[0], layers[-1])])
    total = solution.moments.sum(axis=0) + np.cross(arms, solution.reactions).sum(axis=0)
    assert np.abs(total).max() < 1e-8 * np.abs(solution.moments).max()
    assert np.abs(solution.reactions.sum(axis=0)).max() < 1e-9 * np.abs(solution.reactions).max()


def test_moment_is_the_derivative_of_the_energy_by_the_angle():
    space = prism(4.0, elements=3, degree=3, section_degree=3)

    def energy(angle):
        supports = [Support.end(space, "start"), Support.end(space, "end", turn=(0.0, 0.0, angle))]
        solution = statics.solve(Model([Body(space, LAW)], supports), 2)
        assembler = Assembler(solution.model)
        return assembler.energy(assembler.state(solution.displacement), 1.0), solution.moments[1, 2]

    h = 1e-3
    slope = (energy(1.0 + h)[0] - energy(1.0 - h)[0]) / (2 * h)
    assert energy(1.0)[1] == pytest.approx(slope, rel=1e-6)


def test_a_tied_face_stays_rigid_and_its_free_translation_carries_no_force():
    space = prism(6.0, elements=3, degree=3)
    cap = Support.end(space, "end", "", turn=(0.0, 0.6, 0.0), tied="xyz")
    solution = statics.solve(Model([Body(space, LAW)], [Support.end(space, "start"), cap]), 2)
    rest = space.positions[-4:]
    now = rest + solution.model.nodal(solution.displacement)[-4:]
    R = rotation((0.0, 0.6, 0.0))
    assert now - now.mean(axis=0) == pytest.approx((rest - rest.mean(axis=0)) @ R.T, abs=1e-13)
    assert np.abs(solution.reactions).max() < 1e-9
    assert solution.moments[1, 1] > 0.05
    assert solution.moments[0] == pytest.approx(-solution.moments[1], abs=1e-8)


def test_a_rod_rolls_up_to_a_circle():
    """nu = 0: shape of the elastica under a moment, and M = EI 2 pi / L, both to (r / L)^2."""
    errors = []
    for length in (50.0, 100.0):
        space = slender(length)
        supports = [
            Support.end(space, "start"),
            Support(line(space), "y"),
            Support.end(space, "end", "y", turn=(0.0, 2.0 * np.pi, 0.0), tied="xz"),
        ]
        solution = statics.solve(Model([Body(space, NeoHookean(1.0, 0.0))], supports), 8)
        moment = solution.moments[2, 1] / (0.25 * np.pi * 2.0 * np.pi / length)
        k, s = 2.0 * np.pi, np.array([0.25, 0.5, 0.75, 1.0])
        exact = np.stack([(1.0 - np.cos(k * s)) / k, 0.0 * s, np.sin(k * s) / k - s], axis=1)
        found = space.displacement(solution.model.nodal(solution.displacement), [[0.0, 0.0]], s)[0][:, 0] / length
        errors.append((moment - 1.0, np.abs(found - exact).max()))
        assert np.abs(solution.reactions).max() < 1e-9
    assert abs(errors[1][0]) < 2.5e-3
    assert errors[0][0] / errors[1][0] == pytest.approx(4.0, rel=0.05)
    assert errors[1][1] < 5e-4


@pytest.mark.parametrize("load", ELASTICA)
def test_cantilever_is_the_elastica_with_an_error_of_thickness_squared(load):
    shares = []
    for length in (100.0, 400.0):
        space = slender(length, degree=4)
        force = load * 0.25 * np.pi / length**2
        model = Model(
            [Body(space, NeoHookean(1.0, 0.0))],
            [Support.end(space, "start")],
            loads=[SectionLoad.end(space, "end", (force, 0.0, 0.0))],
        )
        solution = statics.solve(model)
        found = tip(space, solution) / length
        errors = np.array([found[0], -found[2]]) / ELASTICA[load] - 1.0
        shares.append(errors * length**2)
        assert solution.reactions[0, 0] == pytest.approx(-force, rel=1e-8)
    assert np.abs(shares[1]).max() < 6.0
    assert shares[0] == pytest.approx(shares[1], rel=0.05)


@pytest.mark.parametrize("length", [1e3, 1e4, 1e5])
def test_slender_cantilever_neither_locks_nor_stops_early(length):
    """A tolerance relative to the largest stiffness, or to the predictor's forces, would accept the predictor here."""
    space = slender(length, degree=4)
    model = Model(
        [Body(space, NeoHookean(1.0, 0.0))],
        [Support.end(space, "start")],
        loads=[SectionLoad.end(space, "end", (0.25 * np.pi / length**2, 0.0, 0.0))],
    )
    found = tip(space, statics.solve(model)) / length
    assert abs(found[0] / ELASTICA[1.0][0] - 1.0) < 5e-7 + 2.1 / length**2
    assert abs(-found[2] / ELASTICA[1.0][1] - 1.0) < 5e-7 + 2.1 / length**2


def test_too_slender_a_rod_is_an_error():
    space = slender(1e7)
    model = Model(
        [Body(space, NeoHookean(1.0, 0.0))],
        [Support.end(space, "start")],
        loads=[SectionLoad.end(space, "end", (0.25e-14 * np.pi, 0.0, 0.0))],
    )
    with pytest.raises(SolveError, match="load factor"):
        statics.solve(model)


@pytest.mark.parametrize("length", [1e5, 1e6])
def test_a_load_below_rounding_is_an_error(length):
    """Control points carry the length itself: strains of a section are known to 1e-16 L / r only."""
    space = prism(length, circle(8), elements=8, degree=4, continuity=0, order=2, quadrature="4x2x4")
    model = Model(
        [Body(space, NeoHookean(1.0, 0.0))],
        [Support.end(space, "start")],
        loads=[SectionLoad.end(space, "end", (0.25 * np.pi / length**2, 0.0, 0.0))],
    )
    with pytest.raises(SolveError):
        statics.solve(model)


@pytest.mark.parametrize("stretch", [0.3, 0.5, 2.0, 5.0, 10.0])
def test_uniaxial_stretch_is_exact(stretch):
    """W of eq. 15: lateral stretch a of mu (a^2 - 1) + kappa ln(a^2 l) = 0, force mu (l - 1/l) + kappa ln(a^2 l) / l a
    reference area.
    """
    space = prism(10.0, ellipse(8, 1.0, 0.8), elements=4, section_degree=2, quadrature="auto")
    across = brentq(lambda a: LAW.mu * (a * a - 1.0) + LAW.lame * np.log(a * a * stretch), 1e-3, 10.0)
    stress = LAW.mu * (stretch - 1.0 / stretch) + LAW.lame * np.log(across**2 * stretch) / stretch
    # The coefficient of the coordinate x must not turn.
    along = int(np.argmax(np.abs(space.positions[: space.layer_nodes, 0])))
    supports = [
        Support.end(space, "start", "z"),
        Support.end(space, "end", "z", (0.0, 0.0, 10.0 * (stretch - 1.0))),
        Support([0], "xy"),
        Support([(space.layers - 1) * space.layer_nodes], "xy"),
        Support([along], "y"),
    ]
    solution = statics.solve(Model([Body(space, LAW)], supports))
    assert solution.reactions[1, 2] == pytest.approx(stress * space.rod.volume() / 10.0, rel=1e-9)
    exact = space.positions * (np.array([across, across, stretch]) - 1.0)
    assert np.abs(solution.model.nodal(solution.displacement) - exact).max() < 1e-8


def test_incompressible_cylinder_twisted_once_is_rivlins():
    """T = pi mu tau R^4 / 2 and N = -pi mu tau^2 R^4 / 4, ends held at their distance."""
    space = prism(20.0, elements=12, degree=3, section_degree=3, quadrature="auto")
    law = NeoHookean(3.0, 0.499999)
    supports = [
        Support.end(space, "start"),
        Support(line(space), "xy"),
        Support.end(space, "end", turn=(0.0, 0.0, 2.0 * np.pi)),
    ]
    solution = statics.solve(Model([Body(space, law, formulation="mixed")], supports), 4)
    twist = 2.0 * np.pi / 20.0
    assert solution.moments[2, 2] == pytest.approx(0.5 * np.pi * law.mu * twist, rel=2e-5)
    assert solution.reactions[2, 2] == pytest.approx(-0.25 * np.pi * law.mu * twist**2, rel=2e-4)


def test_free_motions_under_ties(cylinder):
    space = Space(cylinder(4, height=4.0), elements=3)
    body = Body(space, LAW)
    # A face tied in all components holds rotations, not translations.
    model = Model([body], [Support.end(space, "end", "", tied="xyz")])
    assert len(rigid_motions.free_motions(model)) == 3
    model = Model([body], [Support.end(space, "end", "z", tied="xy")])
    assert len(rigid_motions.free_motions(model)) == 2
    with pytest.raises(SolveError, match=r"free to move along"):
        statics.solve(model)


def test_bad_input(cylinder):
    space = Space(cylinder(4, height=4.0), elements=3)
    body, start = Body(space, LAW, density=1.0), Support.end(space, "start")
    nan = float("nan")
    cases = [
        (lambda: SectionLoad((1.0, nan, 0.0)), "section load"),
        (lambda: BodyForce((1.0, 0.0)), "body force"),
        (lambda: SectionLoad.end(space, "top", (1.0, 0.0, 0.0)), "'start' or 'end'"),
        (lambda: SectionLoad((1.0, 0.0, 0.0), u=1.5).nodal(space), "axis parameter"),
        (lambda: Model([body], [start], loads=[BodyForce((1.0, 0.0, 0.0), body=1)]), "load 0: body 1"),
        (lambda: Model([body], [Support.end(space, "end", "xy", tied="y")]), "held and 'y' tied"),
        (lambda: Model([body], [Support.end(space, "end", tied="w", components="")]), "need some of 'xyz'"),
        (lambda: Model([body], [Support.end(space, "end", turn=(0.0, nan, 0.0))]), "turn"),
        (lambda: Model([body], [Support([0], arms=[[0.0, 1.0]])]), "arms"),
        (lambda: Model([body], [start, Support.end(space, "start", turn=(0.0, 0.0, 1.0))]), "held elsewhere"),
        (lambda: Model([body], [start, Support.end(space, "start", "", tied="x")]), "held elsewhere"),
        (lambda: dynamics.solve(Model([body], [start], loads=[BodyForce((1.0, 0.0, 0.0))]), 1.0), "loads"),
        (lambda: dynamics.solve(Model([body], [Support.end(space, "end", "xy", tied="z")]), 1.0), "tied"),
    ]
    for make, words in cases:
        with pytest.raises(InputError, match=words) as caught:
            make()
        assert "\n" not in str(caught.value)


def test_a_load_no_equilibrium_bears_is_an_error_that_names_the_place():
    space = prism(4.0, elements=3, degree=2)
    model = Model(
        [Body(space, LAW)], [Support.end(space, "start")], loads=[SectionLoad.end(space, "end", (0.0, 0.0, -1e4))]
    )
    with pytest.raises(SolveError, match=r"load factor .* element \d of body 0") as caught:
        statics.solve(model)
    assert "\n" not in str(caught.value)


RANKS = """
from isorod import options
options.initialize([])
import numpy as np
from petsc4py import PETSc
from isorod import statics
from isorod.model import BodyForce, SectionLoad
from isorod.material import NeoHookean
from isorod.model import Body, Model, Support
from isorod.scenes.spring import Spring
from isorod.space import Space
space = Space(Spring(coils=1, section_points=4).rod())
supports = [Support.end(space, "start"), Support.end(space, "end", "y", turn=(0.0, 0.2, 0.0), tied="xz")]
loads = [BodyForce((0.0, 0.0, 1e-2)), SectionLoad((0.0, 0.1, 0.2), u=0.3)]
s = statics.solve(Model([Body(space, NeoHookean(100.0, 0.3))], supports, loads=loads))
if PETSc.COMM_WORLD.rank == 0:
    print("found", *s.moments.ravel(), *s.reactions.ravel(), np.linalg.norm(s.displacement))
"""


def test_loads_and_ties_do_not_depend_on_the_ranks(mpirun):
    found = []
    for ranks in (1, 3):
        done = mpirun(ranks, script=RANKS)
        assert done.returncode == 0, done.stderr
        text = next(text for text in done.stdout.splitlines() if text.startswith("found"))
        found.append([float(word) for word in text.split()[1:]])
    assert found[1] == pytest.approx(found[0], rel=1e-6, abs=1e-6)


def test_extrapolated_stress_halves_the_iterations_and_changes_no_result(monkeypatch):
    space = slender(1000.0)
    model = Model(
        [Body(space, NeoHookean(1.0, 0.0))],
        [Support.end(space, "start")],
        loads=[SectionLoad.end(space, "end", (0.25e-6 * np.pi, 0.0, 0.0))],
    )
    with_it = statics.solve(model)
    monkeypatch.setattr(Assembler, "extrapolate", lambda self: None)
    without = statics.solve(model)
    assert with_it.newton_iterations <= 0.6 * without.newton_iterations
    assert np.abs(with_it.displacement - without.displacement).max() < 1e-6 * 1000.0
