"""What a comparison is made of: limits of three meshes, fields at the same points, pairs of modes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import straight

from comparisons.measure import quantities, sampled
from comparisons.measure.distance import Judge
from comparisons.measure.quantities import Converged
from comparisons.measure.sampled import Places, Sample
from comparisons.measure.variants import variants
from comparisons.report import compare as report
from comparisons.report import plots
from isorod import modal, statics
from isorod.checks import stresses
from isorod.files.scene import FileScene
from isorod.material import LinearElastic, NeoHookean
from isorod.model import Body, Model, Support
from isorod.space.space import Space
from meshes import rods

SIZES = [1.0, 0.5, 0.25]


def limits(*columns):
    """Return the limits of one quantity of several numbers, each given mesh by mesh."""
    return quantities.converged(SIZES, [{"force": list(row)} for row in zip(*columns, strict=True)])[0]


@pytest.mark.parametrize("order", [1.0, 2.3, 4.0])
def test_each_number_is_extrapolated_with_its_own_order(order):
    found = limits([3.0 + h**order for h in SIZES], [-1.0 - 0.1 * h**2 for h in SIZES])
    assert found.values == pytest.approx([3.0, -1.0], abs=1e-9)
    assert found.orders == pytest.approx([order, 2.0], abs=1e-7)
    assert found.uncertainties == pytest.approx([0.25**order, 0.1 * 0.25**2])


def test_on_meshes_of_other_ratios_too():
    sizes = [1.0, 1.0 / 2.0, 1.0 / 3.0]
    (found,) = quantities.converged(sizes, [{"force": [5.0 + 0.2 * h**3]} for h in sizes])
    assert (found.values[0], found.orders[0]) == pytest.approx((5.0, 3.0), abs=1e-7)


@pytest.mark.parametrize("values", [(1.0, 1.2, 1.1), (1.0, 1.1, 1.3), (1.0, 1.1, 1.19), (2.0, 1.0, 1.0 - 1e-6)])
def test_what_shows_no_order_is_that_of_the_finest_mesh(values):
    """Back and forth, ever farther, hardly nearer, nearer than any order has it."""
    found = limits(values)
    assert found.values == [values[-1]] and found.orders == [None]
    assert found.uncertainties == pytest.approx([abs(values[2] - values[1])])


def test_below_first_order_the_limit_is_that_of_first_order():
    found = limits([2.0 + h**0.7 for h in SIZES])
    step = 0.5**0.7 - 0.25**0.7
    assert found.orders == pytest.approx([0.7], abs=1e-7)
    assert found.values == pytest.approx([2.0 + 0.25**0.7 - step]) and found.uncertainties == pytest.approx([step])


def test_two_meshes_tell_the_finest_and_its_difference():
    (found,) = quantities.converged([1.0, 0.5], [{"force": [1.0]}, {"force": [1.1]}])
    assert (found.values, found.orders) == ([1.1], [None]) and found.uncertainties == pytest.approx([0.1])


def test_errors_of_vectors_are_by_size_and_of_frequencies_the_largest():
    force = Converged("force", [3.0, 4.0, 0.0], [0.01, 0.0, 0.0], [None] * 3)
    assert (force.error([3.0, 4.0, 0.5]), force.uncertainty) == pytest.approx((0.1, 0.002))
    modes = Converged("frequencies", [1.0, 100.0], [0.001, 0.2], [None] * 2)
    assert (modes.error([1.02, 101.0]), modes.uncertainty) == pytest.approx((0.02, 0.002))


def test_what_is_zero_has_no_error_and_what_follows_from_equilibrium_is_known():
    zero = Converged("moment", [1e-12], [3e-12], [None])
    given = limits([5.0, 5.0 + 1e-11, 5.0])
    assert zero.vanishes and not given.vanishes and given.given
    assert not limits([5.0, 5.1, 5.12]).given
    found = quantities.errors([zero, given], {"moment": [2e-12], "force": [5.5]})
    assert found == {"force": pytest.approx(0.1)}


def test_frequencies_are_those_of_flexible_modes():
    record = {"frequencies": [-1e-3, 1e-3, 7.0, 8.0], "rigid": 2, "force": [1.0, 2.0, 3.0]}
    assert quantities.values(record, ["frequencies", "force"]) == {"frequencies": [7.0, 8.0], "force": [1.0, 2.0, 3.0]}


def test_relative_difference_of_known_fields():
    weights = np.array([1.0, 3.0])
    wanted = np.array([[2.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    found = wanted + np.array([[0.0, 0.0, 0.4], [0.0, 0.0, 0.0]])
    assert sampled.relative(found, wanted, weights) == pytest.approx(np.sqrt(0.16 / 16.0))
    assert sampled.relative(found[:, 0], wanted[:, 0], weights) == 0.0
    assert sampled.relative(0.0 * wanted, 0.0 * wanted, weights) == 0.0


def places_of(mesh):
    where, none = mesh.parameters, np.zeros(0)
    rod = np.zeros(len(where), dtype=np.int64)
    return Places(rod, where[:, :2], where[:, 2], rod, where[:, :2], where[:, 2]), none


def test_nodes_of_a_mesh_are_found_among_those_of_one_twice_as_fine():
    rod = straight(n=4, height=4.0)
    coarse, fine = (rods.build([rod], level) for level in (1, 2))
    here, there = sampled.common(places_of(coarse)[0], places_of(fine)[0])
    assert here.size == len(coarse.points)
    np.testing.assert_allclose(fine.points[there], coarse.points[here], atol=1e-9)


@pytest.fixture(scope="module")
def bar():
    """A bar of length 8, held at its start and pulled at its end: its equilibrium."""
    space = Space(straight(n=4, height=8.0), elements=4, degree=3, section_degree=3)
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.3, 0.1))
    return statics.solve(Model([Body(space, NeoHookean(100.0, 0.3))], ends))


def test_fields_at_nodes_in_any_order_are_what_the_solution_answers(bar):
    mesh = rods.build([bar.model.bodies[0].space.rod], 1)
    shuffled = np.random.default_rng(1).permutation(len(mesh.points))
    where = mesh.parameters[shuffled]
    rod = np.zeros(len(where), dtype=np.int64)
    found = sampled.fields(bar, Places(rod, where[:, :2], where[:, 2], rod[:5], where[:5, :2], where[:5, 2]))
    for k in (0, 7, len(where) - 1):
        assert found["displacement"][k] == pytest.approx(bar.at(0, where[k, 2], where[k, :2]), abs=1e-14)
    for k in range(5):
        stress = bar.stress(0, where[k, 2], where[k, :2], "von Mises")
        assert found["von_mises"][k] == pytest.approx(float(stress), rel=1e-6)


def test_places_come_back_from_their_file(tmp_path):
    mesh = rods.build([straight(n=4, height=2.0)], 1)
    places = places_of(mesh)[0]
    places.write(tmp_path / "places.npz")
    np.testing.assert_array_equal(Places.read(tmp_path / "places.npz").xi, places.xi)


def test_stresses_are_compared_farther_from_ends_than_the_section_is_wide(bar):
    u = stresses.away(bar.model, 0)
    # As far as the section is wide, 2, from both ends of 8.
    assert u.size > 4 and u.min() > 0.25 and u.max() < 0.75


def test_stresses_are_compared_away_from_a_patch_on_both_sides():
    space = Space(straight(n=4, height=16.0), elements=16, degree=2, order=1)
    patch = Support.patch(space, along=(7.9, 8.1), around=(-10.0, 10.0))
    u = stresses.away(Model([Body(space, NeoHookean(1.0, 0.3))], [patch]), 0)
    assert u.size and np.abs(u - 0.5).min() > 2.0 / 16.0 and np.abs(u - 0.5).max() < 0.5 - 2.0 / 16.0


def judged(stress=(), off=1.1, peak=90.0):
    """Return the errors of a run whose force is 1 % off, whose stress at surfaces is 10 %, and whose peak is 50 %."""
    one = np.ones(1)
    places = Places(*[one.astype(np.int64), np.zeros((1, 2)), one] * 2)
    best = np.array([1.0, 3.0, 10.0])
    finest = Sample(places, one, one, one.astype(np.int64), 2, np.ones((1, 3)), None, best)
    reference = [Converged("force", [2.0], [1e-3], [2.0]), Converged("peak", [60.0], [0.3], [2.0])]
    judge = Judge(reference, finest, ["force", "peak"], stress)
    record = {"force": 2.02, "peak": peak}
    run = judge.of_ours(record, {"displacement": np.ones((1, 3)), "von_mises": off * best})
    return judge, run


def test_stress_has_an_error_of_its_own_the_measured_one_where_there_is_one():
    judge, run = judged(["peak"])
    assert (run["error"], run["stress"]) == pytest.approx((0.01, 0.5))
    # Relative to the largest stress, where the difference is largest.
    assert (run["field"]["stress"], run["field"]["peak"]) == pytest.approx((0.1, 11.0))
    assert judge.between(run, None, judged(["peak"], peak=100.0)[1], None) == pytest.approx(0.1)
    judge, run = judged()
    assert (run["error"], run["stress"]) == pytest.approx((0.5, 0.1))
    assert judge.between(run, np.array([0.0, 9.0]), run, np.array([1.0, 10.0])) == pytest.approx(0.1)


def test_modes_of_one_frequency_are_compared_as_what_they_span():
    rng = np.random.default_rng(0)
    basis = rng.standard_normal((4, 50, 3))
    turned = basis.copy()
    c, s = np.cos(0.7), np.sin(0.7)
    turned[1], turned[2] = c * basis[1] + s * basis[2], -s * basis[1] + c * basis[2]
    frequencies = np.array([1.0, 2.0, 2.0001, 5.0])
    partner, left = sampled.pairs(basis, turned, np.ones(50), (frequencies, frequencies))
    assert sorted(partner) == [0, 1, 2, 3] and partner[0] == 0 and partner[3] == 3
    assert left.max() < 1e-12


def test_modes_whose_order_differs_find_each_other_by_shape():
    rng = np.random.default_rng(0)
    theirs = rng.standard_normal((3, 50, 3))
    ours = theirs[[0, 2, 1]] + 0.01 * rng.standard_normal((3, 50, 3))
    partner, left = sampled.pairs(ours, theirs, np.ones(50), (np.array([1.0, 2.0, 2.1]), np.array([1.0, 1.98, 2.12])))
    assert partner.tolist() == [0, 2, 1] and left == pytest.approx(0.01, rel=0.3)


def test_modes_of_isorod_are_sampled_without_rigid_ones():
    space = Space(straight(n=4, height=8.0), elements=2, degree=3, section_degree=3)
    found = modal.solve(Model([Body(space, LinearElastic(1.0, 0.3), 1.0)]), modes=3)
    where = np.array([[0.0, 0.0], [0.5, 0.0]])
    rod, none = np.zeros(2, dtype=np.int64), np.zeros(0)
    places = Places(rod, where, np.array([0.0, 0.7]), none.astype(np.int64), np.zeros((0, 2)), none)
    modes = sampled.fields(found, places)["modes"]
    assert modes.shape == (len(found) - found.rigid, 2, 3)
    assert modes[0, 1] == pytest.approx(found[found.rigid].at(0, 0.7, (0.5, 0.0)))


FILE = """
[rod.bar]
curve = {straight = 8.0}
section = {circle = 1.0}
law = {NeoHookean = {E = 1.0, nu = 0.3}}
[support.root]
end = "start"
[support.tip]
end = "end"
displacement = [0.0, 0.1, 0.0]
[analysis.statics]
[measure.force]
reaction = "tip"
component = "y"
"""


def test_coarser_and_finer_about_what_is_chosen(tmp_path):
    (tmp_path / "bar.toml").write_text(FILE)
    scene = FileScene(str(tmp_path / "bar.toml"))
    model = scene.model()
    known = [body.discretisation for body in model.bodies]
    found = variants(scene, model, known)
    assert [one.label for one in found if one.sequence] == ["N−1, e/2", "N+1, 2e"]
    assert {one.label for one in found} == {"N−1, e/2", "N+1, 2e", "N−1", "N+1", "N+2", "e/2", "2e"}
    finer = next(one for one in found if one.label == "2e").arguments
    own = model.bodies[0].space
    assert finer[0] == "--spaces" and own.knots
    told = json.loads(finer[1])["bar"]
    assert [told[name] for name in ("elements", "degree", "continuity", "section_degree")] == [10, 5, 2, 5]
    # Short elements at the ends stay, and all are cut in two at least.
    (axis,) = (body.space.axis for body in replace(scene, spaces=json.loads(finer[1])).model().bodies)
    assert axis.elements >= 2 * own.axis.elements
    assert set(own.axis.breaks.round(9)) < set(axis.breaks.round(9))
    wider = next(one for one in found if one.label == "N+1").arguments
    assert json.loads(wider[1])["bar"]["knots"] == pytest.approx(own.knots)


def test_meshes_that_do_not_nest_have_no_field_error(bar):
    rod = bar.model.bodies[0].space.rod
    samples = []
    for mesh in (rods.build([rod], 1), rods.build([rod], 2)):
        places = places_of(mesh)[0]
        samples.append(Sample(places, mesh.node_volumes(), mesh.points, mesh.cells, mesh.order, mesh.points))
    judge = Judge([], samples[1], [])
    # The same but for a rounding of where the nodes are.
    assert judge.of_mesh({}, samples[0])["field"] == pytest.approx({"displacement": 0.0}, abs=1e-14)
    moved = replace(samples[0].places, xi=0.9 * samples[0].places.xi, u=0.93 * samples[0].places.u)
    assert judge.of_mesh({}, replace(samples[0], places=moved))["field"] == {}


def test_sections_by_control_points_take_twice_as_many(tmp_path):
    (tmp_path / "bar.toml").write_text(FILE.replace("[support.root]", "space = {order = 2}\n[support.root]"))
    scene = FileScene(str(tmp_path / "bar.toml"))
    model = scene.model()
    found = variants(scene, model, [body.discretisation for body in model.bodies])
    assert [one.label for one in found] == ["e/2", "2n, 2e", "2n", "2e"]
    told = json.loads(found[1].arguments[1])["bar"]
    assert (told["order"], told["section_points"]) == (2, 16) and "section_degree" not in told


def test_labels_of_near_points_do_not_meet():
    pyplot = pytest.importorskip("matplotlib.pyplot")
    figure, axis = pyplot.subplots()
    axis.loglog([1.0, 10.0], [1.0, 10.0])
    near = [(f"run {k}", (3.0 * (1.0 + 1e-3 * k), 3.0), "black") for k in range(9)]
    plots._label(axis, [("default", (3.0, 3.0), "black"), *near])
    # Without the threads to their places, which those of annotations hold.
    figure.draw_without_rendering()
    boxes = [pyplot.Text.get_window_extent(one) for one in axis.texts]
    pyplot.close(figure)
    assert axis.texts[0].get_text() == "default"
    assert 1 < len(boxes) <= 10
    assert not any(one.overlaps(other) for k, one in enumerate(boxes) for other in boxes[:k])


@pytest.mark.parametrize(("count", "limit"), [(2, False), (3, True)])
def test_two_meshes_are_told_to_have_no_limit(count, limit):
    run = {"part": "work", "values": {"force": [1.0]}, "label": "default", "method": "cylindrical"}
    meshes = [{"part": "work", "method": "fem", "sequence": True, "label": f"mesh {k}"} for k in range(count)]
    known = vars(quantities.converged(SIZES[:count], [{"force": [value]} for value in (1.1, 1.02, 1.0)[:count]])[0])
    records = [run, *meshes, {"part": "scene", "units": {}}, {"part": "converged", "quantities": [known]}]
    said = report._measured(records)
    assert ("limit of the meshes" in said) == ("extrapolated from three meshes" in said) == limit
    assert ("finest mesh</th>" in said) == ("A third mesh was left out" in said) != limit
