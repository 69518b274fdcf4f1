"""The displacement space: refinements nest and leave the rod; stiffness has six zeros, bounded condition; bad input."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from isorod import Body, InputError, LinearElastic, Model, Rod, Space, Support, modal, statics
from isorod.assembly.assembler import Assembler
from isorod.checks import rigid_motions
from isorod.geometry.section import flower, refine, refinement_turn
from isorod.scenes.blade import Blade
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring
from isorod.space.basis import FAMILIES, PAPER, POLYHARMONIC, POLYNOMIALS
from isorod.space.graded import Graded

RODS = {"blade": Blade().rod(), "spring": Spring(helix="paper", coils=1, section_points=5).rod(), "ring": Ring().rod()}

REFINEMENTS = {
    "n x 2": {"section": 2},
    "n x 3": {"section": 3},
    "n x 4": {"section": 4},
    "K + 1": {"order": 3},
    "p + 1": {"degree": 4, "continuity": 2},
    "elements x 3": {"parts": 3},
    "less smooth": {"continuity": 0},
    "all": {"section": 2, "order": 3, "degree": 6, "parts": 2, "continuity": 1},
}


def space_on(rod, section=1, order=2, degree=3, parts=1, continuity=None, quadrature="auto"):
    elements, points = parts * 2 * rod.axis.elements, section * rod.section_points
    return Space.paper(rod, elements, degree, continuity, quadrature, order, points)


def grid(space, count=40):
    """Points of the disk, some on the circle, and of the axis, knots among them."""
    random = np.random.default_rng(1)
    r, t = np.sqrt(random.random(count)), 2 * np.pi * random.random(count)
    r[:8] = 1.0
    breaks = space.axis.breaks
    u = breaks[0] + (breaks[-1] - breaks[0]) * random.random(25)
    return np.stack([r * np.cos(t), r * np.sin(t)], axis=1), np.concatenate([breaks, u])


@pytest.mark.parametrize("change", REFINEMENTS)
@pytest.mark.parametrize("rod", RODS)
def test_refinement_does_not_move_the_rod(rod, change):
    rod = RODS[rod]
    space = space_on(rod, **REFINEMENTS[change])
    xi, u = grid(space)
    position, gradient = space.displacement(space.positions, xi, u)
    exact, _ = rod.grid(xi, u)
    size = np.abs(rod.control_points).max()
    assert np.abs(position - exact).max() < 1e-13 * size
    # the displacement that doubles all positions
    assert np.abs(gradient - 2 * np.eye(3)).max() < 1e-11
    assert not space.positions[~space.is_control_point].any()


@pytest.mark.parametrize("change", REFINEMENTS)
@pytest.mark.parametrize("rod", RODS)
def test_a_finer_space_holds_every_displacement_of_a_coarser_one(rod, change):
    coarse, fine = space_on(RODS[rod]), space_on(RODS[rod], **REFINEMENTS[change])
    nodal = np.random.default_rng(2).standard_normal((coarse.layers, coarse.layer_nodes, 3))
    # sections: the same functions in terms of others, wherever in the disk; axis: knots and degree
    xi, _ = grid(fine, 6 * fine.layer_nodes)
    own, others = fine.basis.functions(xi)[0], coarse.basis.functions(xi)[0]
    sections = np.linalg.lstsq(own, others, rcond=None)[0]
    assert np.abs(own @ sections - others).max() < 1e-12
    whole = np.concatenate([nodal, nodal[: coarse.rod.closed]])
    along = coarse.axis.transfer(fine.axis, whole)[: fine.layers]
    moved = np.einsum("fc,jca->jfa", sections, along)
    xi, u = grid(fine)
    before, after = coarse.displacement(nodal, xi, u), fine.displacement(moved, xi, u)
    assert np.abs(after[0] - before[0]).max() < 1e-12 * np.abs(nodal).max()
    # derivatives by place, of which the coarse ones may jump at coarse knots but at no others
    assert np.abs(after[1] - before[1]).max() < 1e-10 * np.abs(before[1]).max()


@pytest.mark.parametrize("multiple", [2, 3, 5])
@pytest.mark.parametrize("n", [3, 4, 7, 16])
def test_refined_control_points_make_the_same_map_of_the_disk(n, multiple, cylinder):
    """Harmonic functions follow their values on the circle: to keep the outline is to keep the map."""
    random = np.random.default_rng(3)
    points = random.standard_normal((n, 3))
    fine = refine(points, multiple)
    assert fine.shape == (n * multiple, 3)
    coarse, finer = Space.paper(cylinder(n)), Space.paper(cylinder(n), section_points=n * multiple)
    assert finer.turn == refinement_turn(n, multiple)
    xi, _ = grid(coarse, 200)
    difference = finer.basis.functions(xi)[0] @ fine - coarse.basis.functions(xi)[0] @ points
    assert np.abs(difference).max() < 1e-13 * np.abs(points).max()
    # joints stay joints
    arcs = (np.pi / n * (2 * np.arange(n) + 1) - finer.turn) * n * multiple / (2 * np.pi) - 0.5
    assert np.abs(arcs - np.round(arcs)).max() < 1e-10


def test_refining_in_two_steps_or_one_is_the_same():
    points = np.random.default_rng(4).standard_normal((5, 3))
    assert np.abs(refine(refine(points, 2), 3) - refine(points, 6)).max() < 1e-12


@pytest.mark.parametrize("degree", range(2, 7))
def test_number_of_nodes(degree, cylinder):
    rod = cylinder(4, breaks=(0.0, 1.0, 2.0))
    for continuity in range(degree):
        space = Space.paper(rod, 6, degree, continuity, "auto", 3, 12)
        # two elements of the rod, C1 between them; each cut in three
        knots = 4 * (degree - continuity) + degree - min(1, continuity)
        assert space.layers == degree + 1 + knots
        assert space.layer_nodes == 3 * 12
        assert space.nodes == space.layers * 36
        assert np.count_nonzero(space.is_control_point) == space.layers * 12


def clamped(rod, change, law, rule="12x6x8"):
    """Both ends held, the upper one moved askew."""
    space = space_on(rod, quadrature=rule, **{"order": 1, "degree": 2} | change)
    ends = [Support.end(space, "start"), Support.end(space, "end", displacement=(0.3, -0.2, 0.1))]
    return Model([Body(space, law, 1.0)], ends)


SEQUENCES = {
    "n": [{"section": 1}, {"section": 2}, {"section": 4}],
    "n by three": [{"section": 1}, {"section": 3}],
    "K": [{"order": 1}, {"order": 2}, {"order": 3}, {"order": 4}],
    "p": [
        {"degree": 2},
        {"degree": 3, "continuity": 1},
        {"degree": 4, "continuity": 1},
        {"degree": 6, "continuity": 1},
    ],
    "continuity": [{"degree": 4, "continuity": c, "parts": 2} for c in (3, 2, 1, 0)],
    "elements": [{"parts": 1}, {"parts": 2}, {"parts": 4}],
    "elements by three": [{"parts": 1}, {"parts": 3}],
    "n and K": [{"section": 1, "order": 1}, {"section": 2, "order": 2}, {"section": 2, "order": 3}],
}


@pytest.fixture(scope="module")
def prism(cylinder):
    """A sheared bar of concave section: nothing about it is symmetric or exact in any of the spaces."""
    rod = cylinder(8, breaks=(0.0, 0.4, 1.0), height=3.0)
    layers = rod.control_points.shape[0]
    points = np.concatenate([np.tile(flower(8, 2), (layers, 1, 1)), rod.control_points[..., 2:]], axis=2)
    return Rod(rod.axis, points @ np.array([[1.0, 0.2, 0.3], [0.0, 0.8, -0.2], [0.0, 0.0, 1.0]]))


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_energy_and_frequencies_fall_in_spaces_that_nest(sequence, prism):
    """Displacements prescribed, no loads: the solution has the least energy, less in a space that holds the other."""
    energies, found = [], []
    for change in SEQUENCES[sequence]:
        model = clamped(prism, change, LinearElastic(1.0, 0.3))
        assembler = Assembler(model)
        energies.append(assembler.energy(assembler.state(statics.solve(model).displacement), 1.0))
        found.append(modal.solve(model, 6, at_rest=True).frequencies)
    print(energies)
    for coarse, fine in pairwise(energies):
        assert 0.3 * coarse < fine < coarse * (1.0 - 1e-9)
    for coarse, fine in pairwise(found):
        assert np.all(fine < coarse * (1.0 - 1e-9)) and np.all(fine > 0.5 * coarse)


def stiffness(space, supports=()):
    assembler = Assembler(Model([Body(space, LinearElastic(1.0, 0.3))], supports))
    matrix = assembler.matrix()
    assembler.tangent(assembler.vector(), 0.0, matrix)
    first, column, values = matrix.getValuesCSR()
    return csr_matrix((values, column, first)).toarray()


def spectrum(matrix):
    """Eigenvalues of a matrix scaled to a unit diagonal."""
    scale = np.sqrt(np.diag(matrix))
    return np.linalg.eigvalsh(matrix / np.outer(scale, scale))


FEW = [{"n": n, "order": order} for n in (3, 4, 5, 8, 16) for order in (1, 2, 3, 4, 6)]
MORE = [{"order": order} for order in (1, 2, 3, 4)] + [{"section_degree": degree} for degree in (1, 2, 4)]


@pytest.mark.parametrize("rule", ["auto", "full"])
@pytest.mark.parametrize(
    ("name", "functions"),
    [("cylinder", one) for one in FEW] + [(rod, one) for rod in ("blade", "spring") for one in MORE],
)
def test_stiffness_has_exactly_six_zero_eigenvalues_of_rigid_motions(name, functions, rule, cylinder):
    functions = dict(functions)
    rod = cylinder(functions.pop("n"), height=2.0) if name == "cylinder" else RODS[name]
    axis = {} if name == "cylinder" else {"elements": 4, "degree": 3}
    space = Space.paper(rod, quadrature=rule, **axis, **functions)
    matrix = stiffness(space)
    values = spectrum(matrix)
    assert np.abs(values[:6]).max() < 1e-13 * values[-1]
    assert values[6] > 1e-9
    assert np.abs(matrix @ rigid_motions.motions(space)).max() < 1e-11 * np.abs(matrix).max()


@pytest.mark.parametrize(("n", "order"), [(16, 4), (32, 1), (32, 3), (64, 1), (64, 2)])
def test_the_default_rule_sees_the_waves_of_a_section_of_many_points(n, order, cylinder):
    """A wave of order n / 2 lives within 1 / n of the circle; a rule that looks nowhere near has it nearly free."""
    auto, fine = (
        spectrum(stiffness(Space.paper(cylinder(n, height=2.0), order=order, quadrature=rule)))
        for rule in ("auto", "13x2")
    )
    print(f"smallest eigenvalue over that of a fine rule: {auto[6] / fine[6]:.2g}")
    assert auto[6] > 0.01 * fine[6]


def conditions(space):
    """Condition numbers of the scaled stiffness with one end held, and free without the six zeros."""
    held, free = spectrum(stiffness(space, [Support.end(space, "start")])), spectrum(stiffness(space))
    return np.array([held[-1] / held[0], free[-1] / free[6]])


@pytest.mark.parametrize(("section", "n"), [("circle", 4), ("circle", 8), ("circle", 16), ("blade", 16)])
def test_condition_number_does_not_explode_with_the_order(section, n, cylinder):
    rod = RODS["blade"] if section == "blade" else cylinder(n, breaks=(0.0, 1.0, 2.0), height=2.0)
    found = [conditions(Space.paper(rod, 2, order=order, quadrature="12x4")) for order in (1, 2, 3, 4)]
    for order, pair in enumerate(found, 1):
        print(f"{section} n = {n}, K = {order}: held {pair[0]:.3g}, free {pair[1]:.3g}, over K = 1:", pair / found[0])
    assert np.all(np.array(found) < 4 * found[0])


BAD_SPACES = [
    ({"order": 0}, "polyharmonic order: got 0, need an integer from 1 to 6"),
    ({"order": 7}, "polyharmonic order: got 7, need an integer from 1 to 6"),
    ({"order": 1.5}, "Space: order: got 1.5, need an integer"),
    ({"section_points": 24}, "section points: got 24, need a multiple of the 16 of the rod itself"),
    ({"section_points": 8}, "section points: got 8, need a multiple of the 16"),
    ({"section_points": 0}, "section points: got 0, need a multiple of the 16"),
    ({"section_points": -16}, "section points: got -16, need a multiple of the 16"),
    ({"section_points": 3200}, "section control points: got 3200, need an integer from 3 to 2048"),
    ({"degree": 7}, "axis degree: got 7, need an integer from 2 to 6"),
    ({"degree": 1}, "axis degree: got 1, need an integer from 2 to 6"),
    ({"degree": 3, "continuity": 3}, "continuity: got 3, need an integer from 0 to 2"),
    ({"degree": 6, "continuity": 6}, "continuity: got 6, need an integer from 0 to 5"),
    ({"continuity": -1}, "continuity: got -1, need an integer from 0 to 1"),
    ({"elements": 0}, "elements: got 0, need a multiple of the 1 elements of the rod itself"),
]


@pytest.mark.parametrize(("values", "message"), BAD_SPACES, ids=str)
def test_a_space_that_cannot_be_is_refused_in_one_line(values, message):
    with pytest.raises(InputError) as caught:
        space = Space.paper(RODS["blade"], **values)
        Assembler(Model([Body(space, LinearElastic(1.0, 0.3))]))
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("blade --section-points 24", "section points: got 24, need a multiple of the 16 of the rod itself"),
        ("blade --order two", "--order: invalid int value: 'two'"),
        ("spring --degree 5 --continuity 5", "continuity: got 5, need an integer from 0 to 4"),
        ("spring --section-points 2", "section control points: got 2, need an integer from 3 to 2048"),
    ],
)
def test_the_command_line_refuses_it_in_one_line(arguments, message, command):
    assert message in command.refuses("run", *arguments.split(), "--preset", "paper", "--no-estimate")


def test_more_points_than_memory_holds_are_refused_before_they_are_made(cylinder):
    space = Space.paper(cylinder(), elements=10_000, quadrature="64x64x64")
    with pytest.raises(InputError, match=r"10,485,760,000 quadrature points needs about 2.*GB are free; take fewer"):
        space.tabulate(0, 10_000)


def test_a_space_and_its_record_begin_with_the_family_of_its_functions():
    """What makes the family is the functions: a preset of the paper's with another order is not the paper's element."""
    rod = RODS["ring"]
    tube, n = rod.with_rings([0.5, 1]), rod.section_points
    made = {
        PAPER: [Space.paper(rod), Space(rod, order=1), Space(rod, section_basis=Graded(n, (1,) * 8, 1))],
        POLYHARMONIC: [Space.paper(rod, order=2), Space(rod, section_basis=Graded(n, (1,) * 8))],
        POLYNOMIALS: [Space(rod), Space.paper(rod, section_degree=2), Space(tube)],
    }
    assert tuple(made) == FAMILIES
    for family, spaces in made.items():
        for space in spaces:
            assert space.basis.family == family
            assert str(space).startswith(f"{family}, ")
            record = Body(space, LinearElastic(1.0, 0.3)).discretisation
            assert record["family"] == family and record["element"] == str(space)
