"""The band solver: right whatever the eigenvalues' signs, offered to banded numberings, gone before PETSc ends."""

import numpy as np
import pytest
from conftest import as_array
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from isorod import Body, Model, NeoHookean, SolveError, Space, Support, modal, statics
from isorod.assembly import factorisation
from isorod.assembly.assembler import Assembler
from isorod.petsc import banded
from isorod.petsc.direct import refined
from isorod.scenes.blade import Blade
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring

MUMPS = {"pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}


def band(rng, n, width, decades):
    """Return a symmetric matrix with entries in a band, which differ by decades from row to row."""
    dense = rng.standard_normal((n, n))
    dense[np.abs(np.subtract.outer(np.arange(n), np.arange(n))) > width] = 0.0
    scale = 10.0 ** rng.uniform(-decades, decades, n)
    return scale[:, None] * (dense + dense.T) * scale


def ksp(dense):
    rows = csr_matrix(dense)
    matrix = PETSc.Mat().createAIJ(rows.shape, csr=(rows.indptr, rows.indices, rows.data), comm=PETSc.COMM_SELF)
    solver = PETSc.KSP().create(PETSc.COMM_SELF)
    solver.setOperators(matrix)
    solver.setType("preonly")
    solver.getPC().setType("python")
    solver.getPC().setPythonType(banded.NAME)
    return solver, matrix


@pytest.mark.parametrize("width", [0, 1, 7, 29])
@pytest.mark.parametrize("definite", [True, False], ids=["definite", "indefinite"])
def test_solves_to_rounding(width, definite):
    """Definite: row by row, however much their sizes differ."""
    rng = np.random.default_rng(width)
    for n in (1, 2, 30, 61):
        dense = band(rng, n, width, 4.0 if definite else 0.0)
        if definite:
            diagonal = np.abs(dense).sum(axis=1) + np.abs(np.diag(dense))
            np.fill_diagonal(dense, 1.1 * diagonal + 1e-300)
        solver, matrix = ksp(dense)
        right, x = matrix.createVecs()
        right.array = dense @ rng.standard_normal(n)
        solver.solve(right, x)
        assert solver.getConvergedReason() > 0
        # Backward stable: the residual is small beside what was added up.
        amount = np.abs(dense) @ np.abs(x.array) + np.abs(right.array)
        assert (np.abs(dense @ x.array - right.array) / amount).max() < 1e-12


@pytest.mark.parametrize("definite", [True, False], ids=["definite", "indefinite"])
def test_several_right_hand_sides_are_solved_as_each_alone(definite):
    rng = np.random.default_rng(3)
    dense = band(rng, 200, 29, 0.0)
    if definite:
        np.fill_diagonal(dense, 1.1 * np.abs(dense).sum(axis=1))
    solver, matrix = ksp(dense)
    forces = [matrix.createVecLeft() for _ in range(5)]
    for one in forces:
        one.array = rng.standard_normal(200)
    solver.setUp()
    assert (solver.getPC().getPythonContext().negative > 0) is not definite
    for one, x in zip(forces, refined(solver, forces), strict=True):
        assert x.array == pytest.approx(np.linalg.solve(dense, one.array), rel=1e-9, abs=1e-9 * np.abs(x.array).max())


def test_several_solutions_are_made_right_once_more():
    """Of a preconditioner that leaves a share of the right-hand side its square is left, of factors rounding."""
    rng = np.random.default_rng(4)
    solver, matrix = ksp(np.eye(20) + band(rng, 20, 3, 0.0) / 1e6)
    solver.getPC().setType("jacobi")
    force = matrix.createVecLeft()
    force.array = rng.standard_normal(20)
    (x,) = refined(solver, [force])
    assert np.abs(as_array(matrix) @ x.array - force.array).max() < 1e-9
    # Newton's method does with some digits, and so may the iterations that a person asks for.
    solver.setType("gmres")
    solver.setTolerances(rtol=0.5)
    (x,) = refined(solver, [force])
    assert np.abs(as_array(matrix) @ x.array - force.array).max() < 1e-9
    solver.setTolerances(rtol=0.5, max_it=1)
    with pytest.raises(SolveError, match="linear solver failed"):
        refined(solver, [force])

    rng = np.random.default_rng(0)
    dense = band(rng, 200, 29, 2.0)
    solver, matrix = ksp(dense)
    forces = PETSc.Mat().createDense((200, 3), comm=PETSc.COMM_SELF)
    forces.setUp()
    # Arrays end with their matrices.
    right = forces.getDenseArray()
    right[:] = rng.standard_normal((200, 3))
    forces.assemble()
    found = forces.duplicate()
    solver.setUp()
    solver.getPC().matApply(forces, found)
    assert solver.getPC().getPythonContext().negative
    x = found.getDenseArray()
    assert (np.abs(dense @ x - right) / (np.abs(dense) @ np.abs(x) + np.abs(right))).max() < 1e-12


def test_factorises_again_when_the_matrix_changes():
    solver, matrix = ksp(np.diag([2.0, 4.0]))
    right, x = matrix.createVecs()
    right.set(1.0)
    for factor in (1.0, -0.5, 0.25):
        matrix.scale(factor)
        solver.solve(right, x)
        assert as_array(matrix) @ x.array == pytest.approx([1.0, 1.0], rel=1e-14)


@pytest.mark.parametrize(
    "dense", [np.zeros((3, 3)), np.ones((4, 4)), np.diag([1.0, 0.0])], ids=["zero", "ones", "zero row"]
)
def test_a_singular_matrix_makes_the_solve_fail_and_the_next_one_not(dense):
    solver, matrix = ksp(dense)
    right, x = matrix.createVecs()
    right.set(1.0)
    solver.solve(right, x)
    assert solver.getConvergedReason() < 0
    matrix.shift(1.0)
    solver.solve(right, x)
    assert solver.getConvergedReason() > 0
    assert as_array(matrix) @ x.array == pytest.approx(np.ones(x.array.size), rel=1e-13)


def two_springs():
    space = Space.paper(Spring(helix="paper", coils=1, section_points=4).rod(), elements=4)
    return Model([Body(space, NeoHookean(1.0, 0.3))] * 2, [Support.end(space, "start", body=b) for b in range(2)])


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        (lambda: Spring(preset="paper", coils=1).model(), True),
        (lambda: Spring(preset="paper", coils=1, order=3, section_points=8).model(), True),
        (lambda: Blade(preset="paper", section_degree=3, degree=4).model(), True),
        (two_springs, True),
        (lambda: Model([Body(Space.paper(Ring().rod(), elements=8, degree=3), NeoHookean(1.0, 0.3))]), False),
    ],
    ids=["spring", "order 3", "polynomials", "two bodies", "ring"],
)
def test_is_offered_where_the_matrix_is_banded(model, expected):
    model = model()
    assert factorisation.suits(model) == expected
    chosen = factorisation.factorisation(Assembler(model))
    assert (chosen["pc_type"] == "python") == expected
    width = 3 * model.bodies[0].space.element_nodes.shape[1]
    assembler = Assembler(model)
    matrix = assembler.matrix()
    start, column, _ = matrix.getValuesCSR()
    reach = np.abs(np.repeat(np.arange(matrix.getSize()[0]), np.diff(start)) - column).max()
    assert (reach < width) == expected


@pytest.mark.parametrize("typed", [{"pc_type": "lu"}, {"pc_factor_mat_solver_type": "mumps"}, {"mat_type": "baij"}])
def test_what_is_typed_of_a_factorisation_or_matrix_wins(typed, petsc_options):
    petsc_options(**typed)
    solution = statics.solve(Spring(preset="paper", coils=1, section_points=4).model())
    assert solution.solver["pc"] == "lu"


@pytest.mark.parametrize(
    "scene",
    [
        Spring(preset="paper", coils=1, section_points=4, elements_per_turn=8),
        # Slender: the tangent's condition number is 3e15.
        Spring(preset="paper", coils=1, section_points=4, elements_per_turn=8, wire_radius=1e-3),
        Spring(preset="paper", coils=1, section_points=6, order=2, degree=3, elements_per_turn=4),
    ],
    ids=["spring", "slender", "order 2"],
)
def test_statics_agree_with_mumps(scene, petsc_options):
    own = statics.solve(scene.model())
    assert own.solver["pc"] == "banded"
    petsc_options(**MUMPS)
    theirs = statics.solve(scene.model())
    assert theirs.solver["factor"] == "mumps"
    # Of a condition of 3e15, roundings decide whether the last iteration is needed.
    more = 1 if scene.wire_radius == 1e-3 else 0
    assert abs(own.newton_iterations - theirs.newton_iterations) <= more
    assert own.reactions[1, 2] == pytest.approx(theirs.reactions[1, 2], rel=1e-7)


@pytest.mark.parametrize("shift", [None, 30.0, -1.0])
def test_modes_agree_with_mumps_below_and_between_eigenvalues(shift, petsc_options):
    """Above the first eigenvalue the shifted matrix is not definite."""
    model = Blade(preset="paper", section_degree=2, degree=3, elements=6).model()
    if shift is not None:
        petsc_options(st_shift=shift)
    own = modal.solve(model, 6)
    assert own.solver["pc"] == "banded"
    petsc_options(**{f"st_{name}": value for name, value in MUMPS.items()})
    theirs = modal.solve(model, 6)
    assert own.frequencies == pytest.approx(theirs.frequencies, rel=1e-10)
    assert max(own.residuals.max(), theirs.residuals.max()) < 1e-7


@pytest.mark.parametrize("lumped", [False, True])
@pytest.mark.parametrize("held", ["xyz", "z"])
def test_the_mass_to_multiply_with_is_the_mass(lumped, held):
    space = Space.paper(Spring(helix="paper", coils=1, section_points=4).rod(), elements=4)
    model = Model([Body(space, NeoHookean(1.0, 0.3), 2.0)], [Support.end(space, "start", held)])
    assembler = Assembler(model)
    entries, operator = assembler.mass(lumped), assembler.mass_operator(lumped)
    assert (operator.getType() == "seqmaij") == (held == "xyz")
    x, one = operator.createVecs()
    x.setRandom()
    other = one.duplicate()
    operator.mult(x, one)
    entries.mult(x, other)
    assert one.array == pytest.approx(other.array, rel=1e-13, abs=1e-15 * np.abs(other.array).max())


@pytest.mark.parametrize(
    ("last", "code"),
    [
        ("", 0),
        ("raise SystemExit(3)", 3),
        ("raise ValueError('stop')", 1),
        ("import signal; signal.signal(2, signal.default_int_handler); signal.raise_signal(2)", 130),
    ],
    ids=["end", "exit", "error", "interrupt"],
)
def test_a_program_ends_as_it_would_without(last, code, python):
    """PETSc destroys at its end, after Python's, what was kept: no preconditioner written in Python may be among it."""
    done = python(
        "from isorod import options; options.initialize([])\n"
        "from isorod import modal; from isorod.statics import newton\n"
        "from isorod.assembly.formulation import assembler_for\n"
        "from isorod.scenes.spring import Spring; from isorod.scenes.blade import Blade\n"
        "solver = newton.Newton(assembler_for(Spring(preset='paper', coils=1, section_points=4).model()))\n"
        "solver.advance(0.0, 1.0)\n"
        "modes = modal.solve(Blade(preset='paper', elements=4).model(), 2)\n"
        f"{last}"
    )
    assert done.returncode in (code, -2 if code == 130 else code), done.stderr
    assert "Segmentation" not in done.stderr
