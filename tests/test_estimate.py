"""The estimate that is printed with a result: near the true error, absent where there is none, said when large."""

import json

import numpy as np
import pytest
from petsc4py import PETSc
from reference import BLADE_FREQUENCIES, SPRING_FORCE
from scipy.sparse import csr_matrix
from test_contact_statics import crossing

from comparisons.stability import cost, estimates, random_files
from isorod import InputError, LinearElastic, NeoHookean, Space, modal, statics, straight
from isorod.assembly.formulation import assembler_for
from isorod.checks import adapt, correction, estimate_of_modes, stresses
from isorod.checks.finer import Finer
from isorod.command import cli, refine, solving
from isorod.contact.frozen import Frozen
from isorod.geometry import axis, coils, section
from isorod.model import Body, Contact, Cylinder, MeanSupport, Model, Plane, Pressure, SectionLoad, Spin, Support
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring
from isorod.space.closer import Patch, closer


@pytest.mark.parametrize(
    "changes",
    [{"preset": "paper"}, {"section_degree": 1}, {"section_degree": 2}, {"degree": 2, "elements_per_turn": 8}],
)
def test_error_of_the_spring(changes):
    """The estimate is of forces and moments in all directions; those across the axis err by more than the stiffness."""
    solution, exact = (
        statics.solve(Spring(helix="paper", **more).model()) for more in (changes, {"section_degree": 5, "degree": 6})
    )
    error = estimates.off(estimates.carried(solution), estimates.carried(exact))
    assert exact.reactions[1, 2] == pytest.approx(SPRING_FORCE, rel=2e-5)
    assert 0.5 * error < solution.estimate() < 2.0 * error


@pytest.mark.parametrize("changes", [{}, {"preset": "paper"}, {"section_degree": 2}, {"section_degree": 3}])
def test_error_of_the_blade(changes):
    solution = modal.solve(Blade(**changes).model())
    error = np.abs(solution.frequencies / np.array(BLADE_FREQUENCIES) - 1.0).max()
    assert 0.5 * error < solution.estimate() < 2.0 * error


def test_error_of_the_mixed_formulation():
    def force(**changes):
        solution = statics.solve(Spring(helix="paper", coils=1, nu=0.4999, **changes).model())
        return solution.reactions[1, 2], solution

    exact, _ = force(section_degree=4, degree=6)
    found, solution = force(section_degree=2, degree=3)
    error = abs(found / exact - 1.0)
    assert error > 1e-4
    assert error / 3.0 < solution.estimate() < 3.0 * error


def free_bar(space):
    return modal.solve(Model([Body(space, LinearElastic(1.0, 0.3), 1.0)]), 4)


def test_error_of_a_free_body_and_of_the_axis_alone():
    rod = straight(10.0).sweep(section.circle(8))
    exact = free_bar(Space(rod, section_degree=5, degree=6, elements=8, continuity=0)).frequencies[6:]
    solution = free_bar(Space(rod, section_degree=4, degree=3, elements=3, continuity=0))
    error = np.abs(solution.frequencies[6:] / exact - 1.0).max()
    assert error / 3.0 < solution.estimate() < 3.0 * error
    assert solution.estimate("axis") == pytest.approx(solution.estimate(), rel=0.1)
    across = free_bar(Space(rod, section_degree=1, elements=4, degree=5))
    assert across.estimate() > 100.0 * across.estimate("axis")


def bar(space, *more, **keywords):
    return Model([Body(space, NeoHookean(1.0, 0.3))], [Support.end(space, "start"), *more], **keywords)


@pytest.mark.parametrize("rings", [(0.0, 1.0), (0.5, 1.0), (0.0, 0.6, 1.0)])
@pytest.mark.parametrize(("direction", "degrees"), [("section", (4, 3)), ("axis", (3, 4))])
def test_a_finer_space_holds_the_same_displacements(direction, degrees, rings):
    rod = straight(3.0).sweep(section.ellipse(8, 1.0, 0.5)).with_rings(rings)
    space = Space(rod, section_degree=3, elements=2, degree=3)
    model = bar(space)
    finer = Finer.of(model, direction)
    moved = np.random.default_rng(1).normal(size=model.dofs)
    xi, u = [[0.3, -0.5], [0.7, 0.0], [0.0, 1.0]], [0.1, 0.5, 0.9]
    expected = space.displacement(moved, xi, u)[0]
    there = finer.model.bodies[0].space
    # Of a whole symmetric section two degrees more.
    degree = degrees[0] + (direction == "section" and rings == (0.0, 1.0))
    assert (there.section_degree, there.axis.degree) == (degree, degrees[1])
    assert there.displacement(finer.displacement(moved), xi, u)[0] == pytest.approx(expected, abs=1e-8)


def test_laws_of_layers_and_elements_are_those_of_the_finer_ones():
    """Axes of degree 6 get twice the elements."""
    rod = straight(3.0).sweep(section.circle(8)).with_rings((0.0, 0.6, 1.0))
    soft, hard, stiff = (NeoHookean(E, 0.3) for E in (1.0, 2.0, 3.0))
    space = Space(rod, section_degree=2, elements=2, degree=6)
    body = Body(space, [[soft, hard], [hard, stiff]], [[1.0, 2.0], [3.0, 4.0]])
    finer = Finer.of(Model([body], [Support.end(space, "start")]), "axis").model.bodies[0]
    assert finer.space.axis.elements == 4
    assert finer.laws == (soft, hard) * 2 + (hard, stiff) * 2
    assert finer.densities.tolist() == [1.0, 2.0] * 2 + [3.0, 4.0] * 2


@pytest.mark.parametrize(
    ("outline", "nu", "degree", "finer"),
    [
        (section.ellipse(8, 1.0, 0.5), 0.3, 1, 4),
        (section.ellipse(8, 1.0, 0.5), 0.3, 2, 4),
        (section.ellipse(8, 1.0, 0.5), 0.3, 3, 5),
        (section.ellipse(8, 1.0, 0.5), 0.0, 3, 5),
        (section.airfoil(), 0.3, 2, 3),
    ],
)
def test_more_degrees_where_one_tells_nothing(outline, nu, degree, finer):
    """Even and odd functions of a symmetric section have parts of their own."""
    space = Space(straight(3.0).sweep(outline), section_degree=degree, elements=1, degree=3)
    model = Model([Body(space, NeoHookean(1.0, nu))], [Support.end(space, "start")])
    assert Finer.of(model, "section").model.bodies[0].space.section_degree == finer


@pytest.mark.parametrize("seed", [1, 6, 28, 33, 35])
def test_error_of_random_rods_on_coarse_spaces(seed):
    """Files of the study; it counts them all, and here no estimate may be far off."""
    found = random_files.compare(seed, coarse=True)
    assert found["apart"] < 0.11 * found["error"]
    assert found["error"] / 3.0 < found["estimate"] < 3.0 * found["error"]


def test_shares_of_random_rods():
    def record(error, estimate, apart):
        return {"error": error, "estimate": estimate, "apart": apart}

    found = [record(1e-2, 2e-2, 1e-4), record(1e-3, 1e-4, 1e-4), record(0.1, None, 1e-3), record(1e-3, 1e-3, 3e-4)]
    found += [record(1e-7, 1.0, 0.0), record(1e-4, None, 0.0)]
    strict, loose = ([estimates.ratio(one, apart) for one in found] for apart in estimates.APART)
    assert strict == [0.5, pytest.approx(10.0), np.inf, None, None, None]
    assert loose[3] == 1.0
    told = estimates.statistics(strict)
    assert (told["rods"], told["counted"], told["largest"]) == (6, 3, "without an estimate")
    assert told["within 3"] == pytest.approx(1.0 / 3.0)


def test_what_estimates_cost_is_told():
    found = cost.measure(1)
    assert set(found) == {*(f"estimate of the {one}" for one in ("bar", "spring", "blade")), "tolerance on the blade"}
    # Within the machine's noise on one turn; it is measured on twenty.
    assert all(0.0 < one < 20.0 for one in found.values())
    solution, _ = solving.solve(cost.best(), {})
    assert solution.frequencies == pytest.approx(np.array(BLADE_FREQUENCIES), rel=cost.TOLERANCE)


def test_rings_take_more_than_eight_degrees():
    rod = straight(3.0).sweep(section.circle(8)).with_rings((0.5, 1.0))
    model = bar(Space(rod, section_degree=9, elements=1, degree=2))
    assert Finer.of(model, "section").model.bodies[0].space.section_degree == 10


def test_far_beyond_straight_steps_the_first_one_tells():
    """A nearly incompressible rod under pressure, six tenths off: the correction inverts elements."""
    rod = coils.helix(8.5, 5.3, 0.51).sweep(section.rounded_rectangle(16, 2.0, 1.83, 0.2))
    space = Space(rod, 15, 5, 4, section_degree=1)
    body = Body(space, [NeoHookean(1.0, 0.499)] * 2 + [NeoHookean(0.05, 0.45)] * 3)
    model = Model([body], [Support.end(space, "start")], loads=[Pressure(1.5e-4, "outer")])
    assert 0.2 < statics.solve(model).estimate() < 1.8


def test_a_rigid_motion_has_no_error_and_a_load_that_it_takes_along_is_no_false_alarm():
    """A bar that is moved alone, and one whose loaded end bends back to where it was."""
    space = Space(straight(10.0).sweep(section.circle(8)), section_degree=3, elements=2, degree=4)

    def held(way, force):
        load = SectionLoad.end(space, "end", (0.0, force, 0.0))
        end = Support.end(space, "start", displacement=(0.1, way, 0.0))
        return statics.solve(Model([Body(space, NeoHookean(100.0, 0.3))], [end], loads=[load] if force else []))

    assert held(0.3, 0.0).estimate() < 1e-9
    still = held(0.0, -0.001)
    sag = float(still.model.external @ still.displacement) / -0.001
    assert held(-sag, -0.001).estimate() == pytest.approx(still.estimate(), rel=0.01)


def bent_over(elements, **contact):
    """A bar whose end is pressed down, over a cylinder half way."""
    space = Space(straight(10.0).sweep(section.circle(8, 0.5)), elements, 3, 1, order=2)
    over = Contact(0, Cylinder((0.0, -1.2, 5.0), (1.0, 0.0, 0.0), 0.7), 300.0, points=(3, 6), **contact)
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, -0.6, 0.0))
    return statics.solve(Model([Body(space, NeoHookean(100.0, 0.3))], ends, contacts=[over]))


@pytest.mark.parametrize("friction", [0.0, 0.2, 5.0], ids=["smooth", "slips", "sticks"])
def test_error_of_a_bar_in_contact(friction):
    """With the penalty and the points of the finer one."""
    found, fine = bent_over(3, friction=friction), bent_over(12, friction=friction)
    (contact,) = found.contacts
    assert bool(contact.slipping) is (friction == 0.2) and bool(contact.sticking) is (friction == 5.0)
    error = abs(found.work / fine.work - 1.0)
    print(error, found.estimate("axis"))
    assert error > 0.02
    assert error / 3.0 < found.estimate() < 3.0 * error


def test_corrections_are_those_of_a_tangent_that_is_not_symmetric():
    """Where points slip."""
    found = bent_over(3, friction=0.2)
    finer = Finer.of(found.model, "axis")
    state = finer.displacement(found.displacement)
    assembler = assembler_for(finer.model)
    assembler.contact = correction.touching(finer, found.contacts, state, PETSc.COMM_SELF)
    x, force, change, matrix = (*(assembler.vector() for _ in range(3)), assembler.matrix())
    assembler.state(state).copy(x)
    assembler.residual(x, 1.0, force)
    assembler.tangent(x, 1.0, matrix)
    ksp = correction.solver(assembler, matrix)
    ksp.setOperators(matrix)
    ksp.solve(force, change)
    assert (matrix * change - force).norm() < 1e-9 * force.norm()


def test_springs_of_what_sticks_count_in_the_error():
    """A bar is drawn at, which two planes grip: the softer their springs, the larger their part."""
    found = []
    for penalty in (1e3, 4e3):
        space = Space(straight(6.0).sweep(section.circle(8, 0.5)), 4, 3, 1, order=2)
        planes = [Plane((0.0, -0.48 * way, 0.0), (0.0, way, 0.0)) for way in (1.0, -1.0)]
        grip = [Contact(0, one, penalty, first_elements=[0, 1], points=(6, 6), friction=2.0) for one in planes]
        end = Support.end(space, "end", displacement=(0.0, 0.0, 0.02))
        found.append(statics.solve(Model([Body(space, NeoHookean(100.0, 0.3))], [end], contacts=grip), load_steps=2))
    softer, stiffer = found
    assert all(one.slipping == 0 < one.sticking for each in found for one in each.contacts)
    stretched = [sum(contact.stretched for contact in one.contacts) / (2.0 * one.energy(0)) for one in found]
    assert stretched[0] > 2.0 * stretched[1] > abs(softer.work / stiffer.work - 1.0)
    assert softer.estimate("axis") > stretched[0]


def test_an_error_that_nobody_knows_with_friction_is_warned_of():
    space = Space(straight(4.0).sweep(section.circle(8)), elements=4, order=2)
    inside = Support(2 * space.layer_nodes + np.arange(3), "xyz")
    floor = Contact(0, Plane((0.0, -3.0, 0.0), (0.0, 1.0, 0.0)), 1.0, friction=0.3)
    load = SectionLoad.end(space, "end", (0.0, 1e-3, 0.0))
    with pytest.warns(UserWarning, match="no error estimate: no finer space is available"):
        found = solving.estimate(statics.solve(bar(space, inside, contacts=[floor], loads=[load])))
    assert found.keys() == {"estimate_seconds"}


def test_frozen_contact_is_that_of_the_equilibrium():
    """Two bars that cross, on their own spaces: forces are in balance, and the tangent is their derivative."""
    model = crossing()
    solution = statics.solve(model, load_steps=2)
    frozen = Frozen(model, model.contacts, solution.contacts, solution.displacement, PETSc.COMM_SELF)
    assembler = assembler_for(model)
    x, out = assembler.state(solution.displacement), assembler.vector()
    assembler.contact = frozen
    assembler.residual(x, 1.0, out)
    forces = frozen.forces(solution.displacement)[0]
    assert out.norm() < 1e-5 * np.linalg.norm(forces)
    assert np.abs(forces.reshape(-1, 3)[model.is_control_point].sum(axis=0)).max() < 1e-9 * np.abs(forces).sum()
    way = np.random.default_rng(0).normal(size=model.dofs)
    change = forces - frozen.forces(solution.displacement + way)[0]
    tangent = csr_matrix((frozen.tangent(way), (frozen.rows, frozen.columns)), shape=(model.dofs, model.dofs))
    np.testing.assert_allclose(tangent @ way, change, atol=1e-9 * np.abs(change).max())


def test_graded_functions_get_an_order_more():
    model = bar(closer(straight(4.0).sweep(section.circle(8)), [Patch(0.5, 0.0, 0.2, 0.2, 0.2)]))
    own, fine = (one.bodies[0].space.section_basis for one in (model, Finer.of(model, "section").model))
    assert (fine.arcs, fine.order) == (own.arcs, own.order + 1)
    xi = np.array([[0.3, -0.5], [0.0, 1.0]])
    across = Finer.of(model, "section").across[0]
    np.testing.assert_allclose(fine.functions(xi)[0] @ across, own.functions(xi)[0], atol=1e-8)


def test_graded_functions_at_lines_get_shorter_arcs_as_well():
    model = bar(closer(straight(4.0).sweep(section.circle(8)), [Patch(0.5, 0.0, 4.0, 0.2, 4.0, 0.1)]))
    own, fine = (one.bodies[0].space.section_basis for one in (model, Finer.of(model, "section").model))
    assert fine.order == own.order + 1
    assert np.diff(fine.joints).min() == pytest.approx(0.5 * np.diff(own.joints).min())
    across, xi = Finer.of(model, "section").across[0], np.array([[0.3, -0.5], [0.0, 1.0], [1.0, 0.0]])
    np.testing.assert_allclose(fine.functions(xi)[0] @ across, own.functions(xi)[0], atol=1e-8)


@pytest.mark.parametrize(("outline", "rings"), [(section.circle(8), 2), (section.airfoil(), 1)])
def test_beyond_the_highest_degree_rings_of_round_sections_tell(outline, rings):
    laws = [NeoHookean(E, 0.3) for E in (1.0, 2.0)]
    space = Space(straight(3.0).sweep(outline), section_degree=8, elements=2, degree=2)
    finer = Finer.of(Model([Body(space, laws)], [Support.end(space, "start")]), "section")
    (body,) = finer.model.bodies
    assert (len(body.space.rod.rings) - 1, body.space.section_degree) == (rings, 6 if rings == 2 else 8)
    assert body.laws == tuple(law for law in laws for _ in range(rings))
    moved = (space.positions @ np.array([[0.1, 0.2, 0.0], [0.0, -0.3, 0.1], [0.2, 0.0, 0.1]])).ravel()
    at = [[0.3, -0.5], [0.0, 1.0]], [0.1, 0.7]
    found = body.space.displacement(finer.displacement(moved), *at)[0]
    assert found == pytest.approx(space.displacement(moved, *at)[0], abs=1e-8)


def test_stresses_at_sections_with_forces_do_not_count():
    """Where a shaft is held in the mean and pushed; elsewhere it bends as a beam does, which the space has exactly."""
    space = Space(straight(40.0).sweep(section.circle(8)), section_degree=3, elements=20, degree=4)
    ends = [MeanSupport.section(space, 0.3, "fork"), MeanSupport.section(space, 0.9, components="xy")]
    load = SectionLoad((0.0, 1e-3, 0.0), 0.5, space=space)
    solution = statics.solve(Model([Body(space, LinearElastic(1.0, 0.3))], ends, loads=[load]))
    u = stresses.away(solution.model, 0)
    assert min(np.abs(40.0 * (u - place)).min() for place in (0.0, 0.3, 0.5, 0.9, 1.0)) > 2.0
    finer = statics.solve(Finer.of(solution.model, "axis").model)
    xi = stresses.around([1.0])
    exact = finer.stress(0, u, xi)
    sizes = (np.linalg.norm(one, axis=(2, 3)).max() for one in (solution.stress(0, u, xi) - exact, exact))
    off = next(sizes) / next(sizes)
    assert off < solution.errors("axis").stress < 3.0 * off


def test_there_is_none_where_supports_are_within_the_rod():
    space = Space.paper(straight(4.0).sweep(section.circle(8)), elements=4, order=2)
    load = SectionLoad.end(space, "end", (0.0, 1e-3, 0.0))
    inside = Support(2 * space.layer_nodes + np.arange(3), "z")
    assert statics.solve(bar(space, inside, loads=[load])).estimate() is None
    free = statics.solve(bar(space, loads=[load])).estimate()
    assert free > 0.0
    apart = bar(space, contacts=[Contact(0, Plane((0.0, -3.0, 0.0), (0.0, 1.0, 0.0)), 1.0)], loads=[load])
    assert statics.solve(apart).estimate() == pytest.approx(free, rel=1e-6)


def test_there_is_none_where_no_finer_space_can_be_had(monkeypatch):
    space = Space(straight(4.0).sweep(section.circle(8)), section_degree=2, elements=4, degree=6)
    solution = statics.solve(bar(space, loads=[SectionLoad.end(space, "end", (0.0, 1e-3, 0.0))]))
    monkeypatch.setattr(axis, "MAX_ELEMENTS", 4)
    assert solution.estimate() is None


def test_there_is_none_where_shapes_depend_on_each_other():
    """As those of all modes of few unknowns may on the finer space; one of them alone has one."""
    found = modal.solve(Blade(preset="paper").model(), 1)
    twice = np.repeat(found.eigenvalues, 2), np.repeat(found.vectors, 2, axis=0)
    assert estimate_of_modes.of_modes(found.model, estimate_of_modes.Spectrum(*twice), ["axis"]) is None
    spectrum = estimate_of_modes.Spectrum(found.eigenvalues, found.vectors)
    assert estimate_of_modes.of_modes(found.model, spectrum, ["axis"]) > 0.0


def test_a_large_error_is_warned_of_and_a_small_one_said(capsys):
    assert cli.main("run blade --preset paper --json".split()) == 0
    out, err = capsys.readouterr()
    assert err.startswith("isorod: warning: estimated error ")
    assert json.loads(out)["error_estimate"] > 0.01
    assert cli.main("run spring --coils 1".split()) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert " %, by a finer space" in " ".join(out.split())
    assert cli.main("run spring --coils 1 --no-estimate --json".split()) == 0
    assert "error_estimate" not in capsys.readouterr().out


def test_a_tolerance_chooses_all_directions():
    reached = refine.refine(Blade(), {}, 5e-3)
    assert reached.solution.frequencies == pytest.approx(np.array(BLADE_FREQUENCIES), rel=5e-3)
    assert (reached.scene.section_degree, reached.scene.degree) == (4, 5)
    assert not reached.history
    finer = refine.refine(Blade(), {}, 2e-4)
    assert finer.error <= 2e-4
    assert finer.solution.frequencies == pytest.approx(np.array(BLADE_FREQUENCIES), rel=4e-4)


def test_a_tolerance_for_any_model():
    """What is built on a space, with what is wanted of it left to the caller."""
    rod = straight(10.0).sweep(section.circle(8))

    def solve(space):
        load = SectionLoad.end(space, "end", (0.0, 1e-4, 0.0))
        return statics.solve(bar(space, loads=[load]))

    coarse = Space(rod, section_degree=1, elements=1, degree=2, quadrature="auto")
    solution, (space,), steps, short = adapt.reach(lambda spaces: solve(*spaces), [coarse], 1e-3)
    assert not short
    assert steps[0].error > 0.1 > 1e-3 >= steps[-1].error
    assert space.section_degree > 1 and space.axis.degree > 2
    work = float(solution.model.external @ solution.displacement)
    fine = solve(Space(rod, section_degree=5, elements=8))
    assert work == pytest.approx(float(fine.model.external @ fine.displacement), rel=3e-3)
    with pytest.raises(InputError, match="tolerance: got 2, need a relative error between 0 and 1"):
        adapt.reach(lambda spaces: solve(*spaces), [coarse], 2.0)


@pytest.mark.parametrize("acts", ["pressure", "moments", "spin"])
def test_loads_that_depend_on_the_state_and_balance_are_no_false_alarm(acts):
    """What is left of a support's force is rounding beside them, and no force whose error counts."""
    space = Space(straight(10.0).sweep(section.circle(8)), section_degree=2, elements=2, degree=3)
    ends = [SectionLoad.end(space, end, (0.0,) * 3, moment=(0.0, 0.0, m)) for end, m in (("start", -9.0), ("end", 9.0))]
    loads = {"pressure": [Pressure(2.0, follows=True)], "moments": ends, "spin": []}[acts]
    spin = Spin((0.3, 0.0, 0.0), (0.0, 0.0, 5.0)) if acts == "spin" else None
    body = Body(space, NeoHookean(800.0, 0.3), density=1.0)
    found = statics.solve(Model([body], [MeanSupport.section(space, 0.5, "fixed")], loads=loads, spin=spin))
    assert found.estimate() < 1e-3
