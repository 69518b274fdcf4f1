"""The mixed formulation: stable pairs, exact solutions near incompressibility, what refuses it."""

import numpy as np
import pytest
from conftest import as_array, straight
from models import SECTIONS
from scipy.linalg import cho_factor, cho_solve, eigh

from isorod import InputError, LinearElastic, NeoHookean, Rod, SolveError, Space, dynamics, statics
from isorod.assembly.assembler import Assembler
from isorod.assembly.mixed import MixedAssembler
from isorod.checks import rigid_motions
from isorod.model import Body, Model, SectionLoad, Support
from isorod.output import stress, vtk
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring

MU, EYE = 1.0, np.eye(3)


def law(nu, kind=NeoHookean):
    return kind(2.0 * MU * (1.0 + nu), nu)


def space(height=3.0, n=6, **keywords):
    return Space.paper(straight(n=n, height=height), **({"elements": 2, "degree": 3} | keywords))


def mixed(where, material, supports=(), **keywords):
    return Model([Body(where, material, density=1.0, formulation="mixed")], supports, **keywords)


# The pair of spaces


def saddle(where, ends=("start", "end")):
    """Return matrices: of the strain's norm, the divergence, and the pressures' norm."""
    supports = [Support.end(where, end) for end in ends]

    def matrices(nu):
        # mu = 1/2 either way; lame is infinite, or 1.
        model = mixed(where, LinearElastic(1.0 + nu, nu), supports)
        assembler = MixedAssembler(model)
        tangent = assembler.matrix()
        assembler.tangent(assembler.vector(), 1.0, tangent)
        K = as_array(tangent)
        marked = np.zeros(model.dofs)
        marked[model.free >= 0] = 1.0
        moves = assembler.state(marked).array > 0.0
        return K[np.ix_(moves, moves)], K[np.ix_(moves, ~moves)], K[np.ix_(~moves, ~moves)]

    A, B, zero = matrices(0.5)
    assert np.abs(zero).max() == 0.0
    return A, B, -matrices(1.0 / 3.0)[2]


def inf_sup(where):
    A, B, M = saddle(where)
    return np.sqrt(max(eigh(B.T @ cho_solve(cho_factor(A), B), M, eigvals_only=True)[0], 0.0))


def flat(ratio):
    round_ = straight(n=8, height=8.0)
    return Rod(round_.axis, round_.control_points * np.array([1.0, ratio, 1.0]))


@pytest.mark.parametrize(("degree", "continuity"), [(2, 1), (3, 2), (2, 0), (3, 1)])
@pytest.mark.parametrize(
    ("sections", "bound"),
    [({"order": 1}, 0.8), ({"order": 2}, 0.38), ({"order": 3}, 0.33), ({"section_degree": 4}, 0.27)],
    ids=str,
)
def test_inf_sup_constant_is_bounded_below_when_the_axis_is_refined(degree, continuity, sections, bound):
    rod = straight(n=8, height=8.0)
    found = [
        inf_sup(Space.paper(rod, elements=e, degree=degree, continuity=continuity, quadrature="auto", **sections))
        for e in (4, 8, 16)
    ]
    print(sections, degree, continuity, *(f"{beta:.3f}" for beta in found))
    assert found[0] > bound
    assert found[0] < found[1] < found[2]


@pytest.mark.parametrize(
    ("sections", "bound"), [({"order": 1}, 0.47), ({"order": 2}, 0.14), ({"section_degree": 4}, 0.19)], ids=str
)
def test_inf_sup_constant_of_a_flat_section(sections, bound):
    found = [inf_sup(Space.paper(flat(0.2), elements=e, degree=3, **sections)) for e in (4, 8)]
    assert bound < found[0] < found[1]


@pytest.mark.parametrize("n", [4, 5, 6, 7, 8])
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_no_pressure_goes_unseen_however_few_points_the_section_has(n, order):
    assert inf_sup(Space.paper(straight(n=n, height=4.0), elements=2, degree=3, order=order)) > 0.1


def test_inf_sup_constant_of_a_coil_with_kinks_in_its_parameter():
    found = [
        inf_sup(
            Space.paper(
                Spring(helix="paper", coils=1).rod(), elements=e, degree=2, continuity=1, quadrature="auto", order=2
            )
        )
        for e in (4, 8)
    ]
    assert 0.29 < found[0] < found[1]


def test_rigid_motions_are_all_that_a_free_incompressible_body_has(cylinder):
    for rod in (cylinder(n=6, height=3.0), Ring().rod()):
        where = Space.paper(rod, degree=3)
        model = mixed(where, LinearElastic(3.0, 0.5))
        assembler = MixedAssembler(model)
        tangent = assembler.matrix()
        assembler.tangent(assembler.vector(), 1.0, tangent)
        K = as_array(tangent)
        for motion in rigid_motions.motions(where).T:
            assert np.abs(K @ assembler.state(motion).array).max() < 1e-12 * np.abs(K).max()
        values = np.linalg.eigvalsh(K)
        size = np.abs(values).max()
        assert np.count_nonzero(np.abs(values) < 1e-10 * size) == 6
        # Sylvester: as many negative ones as pressures, if none goes unseen.
        assert np.count_nonzero(values < -1e-10 * size) == model.bodies[0].pressures.size


# Exact solutions


def stretched(material, across, stretch=1.3, **sections):
    """A rod of which both ends move as in a uniaxial state of stress; the lateral surface is free."""
    where, F = space(**sections), np.diag([across, across, stretch])
    nodes = [Support.end(where, which).nodes for which in ("start", "end")]
    return statics.solve(mixed(where, material, [Support(n, "xyz", where.positions[n] @ (F - EYE)) for n in nodes]))


@pytest.mark.parametrize("E", [3.0, 6e5])
@pytest.mark.parametrize("sections", SECTIONS, ids=str)
@pytest.mark.parametrize(
    ("kind", "nu"), [(NeoHookean, 0.5), (LinearElastic, 0.5), (LinearElastic, 0.499999), (LinearElastic, 0.25)]
)
def test_uniform_stretch_is_exact(kind, nu, sections, E):
    """Patch test: displacements, forces, pressures, and stress along the bar alone."""
    s, mu = 1.3, 0.5 * E / (1.0 + nu)
    across = s**-0.5 if kind is NeoHookean else 1.0 - nu * (s - 1.0)
    solution = stretched(kind(E, nu), across, s, **sections)
    body, u, xi = solution.model.bodies[0], np.array([0.0, 0.2, 0.9]), np.array([[0.0, 0.0], [0.5, -0.3], [0.0, 1.0]])
    moved = body.space.positions * [across - 1.0, across - 1.0, s - 1.0]
    assert solution.displacement.reshape(-1, 3) == pytest.approx(moved, abs=1e-9)
    nominal = mu * (s - s**-2) if kind is NeoHookean else E * (s - 1.0)
    assert solution.reactions[1] == pytest.approx([0.0, 0.0, nominal * np.pi], rel=1e-8, abs=1e-8 * E)
    lateral = mu * (1.0 - 1.0 / s) if kind is NeoHookean else 2.0 * mu * nu * (s - 1.0)
    found = body.pressures.evaluate(solution.pressures[0], xi, u)
    assert found == pytest.approx(np.full((3, 3), lateral), rel=1e-6)
    if kind is NeoHookean:
        axial = np.diag([0.0, 0.0, nominal * s])
        assert solution.stress(0, u, xi) == pytest.approx(np.broadcast_to(axial, (3, 3, 3, 3)), abs=1e-6 * E)


def test_mean_stress_in_files_is_a_third_of_the_trace():
    """In a bar under uniaxial stress a third of the axial one, and von Mises is the axial one itself."""
    pytest.importorskip("pyvista")
    solution = stretched(NeoHookean(21.0, 0.5), 1.3**-0.5)
    fields = {"displacement": solution.displacement.reshape(-1, 3), "pressure": solution.pressures[0]}
    mesh = vtk.grid(solution.model.bodies[0], fields, rings=1, around=6, slices=2)
    axial = 7.0 * (1.3**2 - 1.0 / 1.3)
    assert mesh.point_data["mean_stress"] == pytest.approx(np.full(mesh.n_points, axial / 3.0), rel=1e-6)
    assert mesh.point_data["von_mises"] == pytest.approx(np.full(mesh.n_points, axial), rel=1e-6)
    assert "pressure" not in mesh.point_data


def test_unknown_pressures_of_a_rod_of_several_laws_are_counted_in_the_middle_shear_modulus():
    where = Space.paper(straight(n=6), elements=3, degree=2, continuity=0)
    laws = [NeoHookean(3.0 * mu, 0.5) for mu in (2.0, 90.0, 5.0)]
    assert Body(where, laws, formulation="mixed").pressure_unit == pytest.approx(5.0)


@pytest.mark.parametrize(("nu", "tolerance"), [(0.5, 1e-8), (0.499999, 5e-6)])
@pytest.mark.parametrize("sections", SECTIONS, ids=str)
def test_twisted_cylinder_of_rivlin(sections, nu, tolerance):
    """Torque ``pi mu tau R^4 / 2`` and thrust ``-pi mu tau^2 R^4 / 4`` (Rivlin 1948), at 14 degrees a radius."""
    length, angle = 2.0, 0.5
    where = space(length, n=8, degree=5, **sections)
    ends = Support.end(where, "start"), Support.end(where, "end", turn=(0.0, 0.0, angle))
    solution = statics.solve(mixed(where, law(nu), ends))
    tau = angle / length
    assert solution.moments[1, 2] == pytest.approx(0.5 * np.pi * MU * tau, rel=tolerance)
    assert solution.reactions[1, 2] == pytest.approx(-0.25 * np.pi * MU * tau**2, rel=tolerance)


def test_stress_of_the_twisted_cylinder():
    """``B = F F^T``: ``s = mu B - (mu - p) 1``, radial ``-mu tau^2 (R^2 - r^2) / 2``, von Mises from the deviator."""
    length, angle = 2.0, 0.5
    tau = angle / length
    where = space(length, n=8, degree=5, order=2)
    ends = Support.end(where, "start"), Support.end(where, "end", turn=(0.0, 0.0, angle))
    solution = statics.solve(mixed(where, law(0.5), ends))
    body = solution.model.bodies[0]
    r = np.linspace(0.0, 1.0, 5)
    # At the foot nothing has turned: x is the radial direction, y the angular one.
    found = stress.cauchy(
        body, solution.displacement, np.stack([r, 0.0 * r], axis=1), [0.0], pressure=solution.pressures[0]
    )[0]
    wanted = np.zeros((5, 3, 3))
    radial = -0.5 * MU * tau**2 * (1.0 - r**2)
    wanted[:, 0, 0] = wanted[:, 2, 2] = radial
    wanted[:, 1, 1] = radial + MU * tau**2 * r**2
    wanted[:, 1, 2] = wanted[:, 2, 1] = MU * tau * r
    assert found == pytest.approx(wanted, abs=1e-6)
    with pytest.raises(InputError, match="its pressure is missing"):
        stress.cauchy(body, solution.displacement, [[0.0, 0.0]], [0.0])


# Beside the displacement formulation


def test_both_formulations_agree_where_nothing_locks():
    forces = {
        formulation: statics.solve(Spring(preset="paper", formulation=formulation, order=2).model()).reactions[1, 2]
        for formulation in ("displacement", "mixed")
    }
    assert forces["mixed"] == pytest.approx(forces["displacement"], rel=1e-4)


def test_slender_and_incompressible_is_no_harder_than_either():
    """Elastica at ``P L^2 / E I = 3`` (exact: deflection 0.60325344 L), length 1000 radii; knots resolve the clamp."""
    length = 1000.0
    breaks = (0.0, 1.0, 3.0, *np.linspace(0.0, length, 13)[1:])
    where = Space.paper(straight(8, degree=4, breaks=breaks, height=length), order=2, quadrature="auto")
    force = 3.0 * 3.0 * MU * np.pi / 4.0 / length**2
    load = SectionLoad.end(where, "end", (0.0, force, 0.0))
    solution = statics.solve(mixed(where, law(0.5), [Support.end(where, "start")], loads=[load]))
    assert solution.load_steps == 1
    assert solution.newton_iterations <= 15
    deflection = load.nodal(where).ravel() @ solution.displacement / force
    assert deflection == pytest.approx(0.60325344 * length, rel=2e-3)


def test_bodies_of_both_formulations_share_a_model():
    """A rod does not feel another one beside it: forces are those of each alone."""
    where = space()
    ends = [
        (Support.end(where, "start", body=b), Support.end(where, "end", displacement=(0.0, 0.3, 0.2), body=b))
        for b in (0, 1)
    ]
    bodies = [Body(where, law(0.3)), Body(where, law(0.5), formulation="mixed")]
    together = statics.solve(Model(bodies, [*ends[0], *ends[1]]))
    for b, body in enumerate(bodies):
        alone = statics.solve(Model([body], ends[0]))
        assert together.reactions[2 * b + 1] == pytest.approx(alone.reactions[1], rel=1e-8, abs=1e-10)
    assert together.pressures[0] is None
    assert together.pressures[1] == pytest.approx(alone.pressures[0], rel=1e-6, abs=1e-8)


def test_loads_and_ties_work_on_the_displacements_alone():
    where = space(height=6.0)
    start = Support.end(where, "start")
    load = SectionLoad.end(where, "end", (0.0, 0.02, 0.01))
    solution = statics.solve(mixed(where, law(0.5), [start], loads=[load]))
    assert solution.reactions[0] == pytest.approx([0.0, -0.02, -0.01], abs=1e-9)
    tied = Support.end(where, "end", components="z", tied="xy")
    solution = statics.solve(mixed(where, law(0.5), [start, tied], loads=[load]))
    end = solution.displacement.reshape(-1, 3)[-where.layer_nodes :]
    assert np.ptp(end[:, 1]) < 1e-12
    assert end[0, 1] > 0.01


# What refuses it


def test_an_incompressible_material_needs_the_mixed_formulation():
    with pytest.raises(InputError, match="element 0: incompressible"):
        Body(space(), law(0.5), formulation="displacement")


def test_refuses_a_formulation_that_is_not_known():
    with pytest.raises(InputError, match="formulation: got 'hybrid', need one of displacement, mixed"):
        Body(space(), law(0.3), formulation="hybrid")


@pytest.mark.parametrize("nu", [0.0, -0.2])
def test_refuses_materials_whose_pressure_it_cannot_tell(nu):
    with pytest.raises(InputError, match="element 0: the mixed formulation needs"):
        statics.solve(mixed(space(), law(nu), [Support.end(space(), "start")]))


@pytest.mark.parametrize(
    ("sections", "said"), [({"n": 3}, "section points: got 3"), ({"section_degree": 1}, "section degree: got 1")]
)
def test_refuses_sections_too_poor_for_a_pressure(sections, said):
    where = space(**sections)
    with pytest.raises(InputError, match=said):
        statics.solve(mixed(where, law(0.49), [Support.end(where, "start")]))


def test_other_analyses_refuse_it():
    where = space()
    start = Support.end(where, "start")
    model = mixed(where, law(0.49), [start])
    with pytest.raises(InputError, match="'mixed', which needs the mixed assembler"):
        Assembler(model)
    with pytest.raises(InputError, match="body 0: formulation: got 'mixed', explicit steps take 'displacement' alone"):
        dynamics.solve(model, 1.0)


def test_a_factorisation_that_does_not_pivot_is_an_error_that_names_one_that_does(petsc_options):
    where = space()
    petsc_options(pc_type="lu", pc_factor_mat_solver_type="petsc")
    with pytest.raises(SolveError, match="try -ksp_type preonly -pc_type cholesky -pc_factor_mat_solver_type mumps"):
        statics.solve(mixed(where, law(0.5), [Support.end(where, "start"), Support.end(where, "end")]))


def test_nothing_of_it_is_imported_unless_asked_for(python):
    script = (
        "import sys; from isorod import options; options.initialize([]); from isorod import statics\n"
        "from isorod.scenes.spring import Spring\n"
        "statics.solve(Spring(preset='paper', coils=1, formulation=sys.argv[1]).model())\n"
        "print([name for name in ('isorod.assembly.mixed', 'isorod.space.pressure') if name in sys.modules])"
    )
    assert python(script, "displacement").stdout.strip() == "[]"
    assert python(script, "mixed").stdout.strip() == "['isorod.assembly.mixed', 'isorod.space.pressure']"


def test_command_runs_it_and_says_what_is_wrong(command, tmp_path):
    words = "run spring --preset paper --coils 1 --nu 0.5 --formulation mixed"
    assert "pressures" in str(command.record(*words.split(), "--output", tmp_path))
    assert command.refuses(*"run spring --preset paper --no-estimate --nu 0.5".split()) == (
        "material of element 0: incompressible (nu = 0.5, or a bulk modulus that is infinite); that takes "
        "formulation 'mixed'"
    )
